"""Figures of many pieces with known joints: capsules, clothes, hair, eyes, teeth, buttons."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import medialis

AROUND = 16


@dataclass(frozen=True)
class Figure:
    """What a figure is made of; lengths are fractions of its height.

    Attributes
    ----------
    arms : float
        Degrees by which the arms are lowered from the horizontal.
    stout : float
        Factor of all radii.
    gap : float
        Distance between limbs that are next to each other.
    fingers, eyes, teeth, hair, clothes, buttons, weapon : bool or int
    turn : int
        Seed of a rotation, 0: none.
    scale : float
    """

    arms: float = 30.0
    stout: float = 1.0
    gap: float = 0.0
    fingers: bool = False
    eyes: bool = False
    teeth: int = 0
    hair: int = 0
    clothes: bool = False
    buttons: int = 0
    weapon: bool = False
    turn: int = 0
    scale: float = 1.0


def capsule(start, end, radius, rings=4, along=4):
    """A closed capsule: points and faces."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    way = end - start
    length = np.linalg.norm(way)
    axis = way / length
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    lat = np.linspace(-np.pi / 2, np.pi / 2, 2 * rings + 1)[1:-1]
    heights = np.concatenate([
        radius * np.sin(lat[:rings]), np.linspace(0, length, along + 1)[1:-1],
        length + radius * np.sin(lat[rings - 1 :]),
    ])  # fmt: skip
    widths = np.concatenate([
        radius * np.cos(lat[:rings]), np.full(along - 1, radius), radius * np.cos(lat[rings - 1 :])
    ])  # fmt: skip
    points = start + tube_points(heights, widths, axis, u, v)
    ends = np.stack([start - radius * axis, end + radius * axis])
    faces = tube_faces(len(heights))
    here, onward = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
    bottom, top, last = len(points), len(points) + 1, AROUND * (len(heights) - 1)
    caps = [np.stack([np.full(AROUND, bottom), onward, here], axis=1),
            np.stack([np.full(AROUND, top), here + last, onward + last], axis=1)]  # fmt: skip
    return np.concatenate([points, ends]), np.concatenate([faces, *caps])


def tube_points(heights, widths, axis, u, v):
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    circle = np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v
    rows = heights[:, None, None] * axis + widths[:, None, None] * circle
    return rows.reshape(-1, 3)


def tube_faces(rows):
    here, onward = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
    steps = AROUND * np.arange(rows - 1)[:, None, None]
    one = np.stack([here, onward, onward + AROUND], axis=1)[None] + steps
    other = np.stack([here, onward + AROUND, here + AROUND], axis=1)[None] + steps
    return np.concatenate([one, other]).reshape(-1, 3)


def open_tube(start, end, radii):
    """A sheet around a line, open at both ends."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    u /= np.linalg.norm(u)
    heights = np.linspace(0, np.linalg.norm(end - start), 6)
    widths = np.linspace(*radii, 6)
    return start + tube_points(heights, widths, axis, u, np.cross(axis, u)), tube_faces(6)


def strip(points, width):
    """A sheet along a line, of two points a row."""
    points = np.asarray(points, float)
    side = np.array([0, width / 2, 0])
    rows = np.stack([points - side, points + side], axis=1).reshape(-1, 3)
    steps = 2 * np.arange(len(points) - 1)[:, None]
    one, other = steps + np.array([0, 1, 3]), steps + np.array([0, 3, 2])
    return rows, np.concatenate([one, other])


def limbs(figure):
    """Start, end and radius of each capsule of a biped, height 1, that looks along -y."""
    low = np.radians(figure.arms)
    found = {
        "hips": ([-0.035, 0, 0.52], [0.035, 0, 0.52], 0.075),
        "belly": ([0, 0, 0.56], [0, 0, 0.62], 0.068),
        "chest": ([0, 0, 0.68], [0, 0, 0.74], 0.085),
        "neck": ([0, 0, 0.82], [0, 0, 0.86], 0.03),
        "head": ([0, 0, 0.91], [0, 0, 0.945], 0.055),
    }
    for side, mark in ((1, "L"), (-1, "R")):
        way = np.array([side * np.cos(low), 0, -np.sin(low)])
        shoulder = np.array([side * 0.095, 0, 0.78])
        elbow, wrist = shoulder + 0.17 * way, shoulder + 0.32 * way
        found[f"upper_arm.{mark}"] = (shoulder, elbow, 0.03)
        found[f"forearm.{mark}"] = (elbow, wrist, 0.025)
        found[f"hand.{mark}"] = (wrist + 0.02 * way, wrist + 0.06 * way, 0.022)
        hip, knee, ankle = (np.array([side * x, 0, z]) for x, z in
                            ((0.055, 0.49), (0.06, 0.27), (0.065, 0.06)))  # fmt: skip
        found[f"thigh.{mark}"] = (hip, knee, 0.045)
        found[f"shin.{mark}"] = (knee, ankle, 0.035)
        found[f"foot.{mark}"] = (
            ankle + np.array([0, 0, -0.03]),
            ankle + np.array([0, -0.11, -0.035]),
            0.025,
        )
        if figure.fingers:
            across = np.array([0, 1, 0])
            for k, place in enumerate((-0.015, -0.005, 0.005, 0.015)):
                base = wrist + 0.075 * way + place * across
                found[f"finger_{k}.{mark}"] = (base, base + 0.035 * way, 0.0042)
    return found


def pieces_of(figure):
    """Points and faces of each piece."""
    found, parts = [], limbs(figure)
    for start, end, radius in parts.values():
        start, end = np.asarray(start, float), np.asarray(end, float)
        way = end - start
        cut = figure.gap / 2 + (radius if figure.gap else 0)
        cut = min(cut, 0.45 * np.linalg.norm(way)) * way / np.linalg.norm(way)
        found.append(capsule(start + cut, end - cut, radius * figure.stout))
    eye = np.array([0.02, -0.05, 0.935])
    for side in (1, -1) if figure.eyes else ():
        place = eye * [side, 1, 1]
        found.append(capsule(place, place + np.array([0, -0.002, 0]), 0.009))
    for k in range(figure.teeth):
        place = np.array([0.004 * (k - figure.teeth / 2), -0.045, 0.895])
        found.append(capsule(place, place + np.array([0, 0, 0.004]), 0.0015))
    for k in range(figure.hair):
        angle = np.pi * (0.1 + 0.8 * k / max(figure.hair - 1, 1))
        out = np.array([np.cos(angle), np.sin(angle), 0])
        line = [[0, 0, 1.0] + 0.062 * out * min(s, 1) - [0, 0, 0.1 * s] for s in
                np.linspace(0.1, 1.6, 8)]  # fmt: skip
        found.append(strip(line, 0.012))
    for k in range(figure.buttons):
        place = np.array([0, -0.085 * figure.stout - 0.001, 0.6 + 0.14 * k / figure.buttons])
        found.append(capsule(place, place - [0, 0.002, 0], 0.005))
    if figure.clothes:
        wide = 1.15 * figure.stout
        found.append(open_tube([0, 0, 0.5], [0, 0, 0.8], (0.095 * wide, 0.09 * wide)))
        for mark in "LR":
            for name in ("upper_arm", "thigh"):
                start, end, radius = parts[f"{name}.{mark}"]
                found.append(open_tube(start, end, (radius * 1.2 * figure.stout,) * 2))
    if figure.weapon:
        start = parts["hand.R"][1]
        found.append(
            capsule(start + np.array([0, -0.06, 0]), start + np.array([0, -0.3, 0]), 0.008)
        )
    return found


def shape_of(figure):
    """The figure as one shape of unnamed pieces."""
    pieces = pieces_of(figure)
    starts = np.cumsum([0, *(len(points) for points, _ in pieces)])
    faces = np.concatenate([faces + start for (_, faces), start in zip(pieces, starts,
                                                                       strict=False)])  # fmt: skip
    points = np.concatenate([points for points, _ in pieces])
    if figure.turn:
        points = points @ Rotation.random(random_state=figure.turn).as_matrix().T
    return medialis.make_shape(figure.scale * points, faces)


def members(count, seed):
    """Figures of the family, at random."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield Figure(
            arms=float(rng.uniform(0, 65)), stout=float(rng.uniform(0.85, 1.2)),
            gap=float(rng.choice([0, 0, 0.005, 0.02, 0.05])), fingers=bool(rng.random() < 0.4),
            eyes=bool(rng.random() < 0.5), teeth=int(rng.choice([0, 0, 8])),
            hair=int(rng.choice([0, 5, 12])), clothes=bool(rng.random() < 0.5),
            buttons=int(rng.choice([0, 4])), turn=int(rng.integers(0, 1000)),
            scale=float(10 ** rng.uniform(-1, 3)),
        )  # fmt: skip
