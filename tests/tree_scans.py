"""Scans of trees whose limbs are known: points seen from some positions, noise, ground, leaves."""

from dataclasses import dataclass

import numpy as np

PLACES = 12
"""Points of the middle of a limb."""


@dataclass
class Limb:
    """Middle (k, 3), radii (k,), order, and the number of the limb that it grows from."""

    points: np.ndarray
    radii: np.ndarray
    order: int = 0
    parent: int = -1

    @property
    def along(self):
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self):
        return self.along[-1]

    @property
    def volume(self):
        """Frustums."""
        a, b = self.radii[:-1], self.radii[1:]
        return float(np.sum(np.pi / 3 * np.diff(self.along) * (a * a + a * b + b * b)))

    def at(self, place):
        middle = np.stack([np.interp(place, self.along, x) for x in self.points.T], axis=-1)
        return middle, np.interp(place, self.along, self.radii)


def forked(radius=0.25, height=6.0):
    """A trunk with two branches."""
    t = np.linspace(0, 1, PLACES)[:, None]
    trunk = Limb(t * [0, 0, height], radius * (1 - 0.4 * t[:, 0]))
    return [trunk] + [
        Limb([0, 0, z] + t * way, 0.4 * radius * (1 - 0.3 * t[:, 0]), 1, 0)
        for z, way in ((0.5 * height, [2.0, 0, 2.0]), (0.7 * height, [-1.0, 1.7, 1.8]))
    ]


def grown(seed, limbs, height=12.0, radius=0.2, orders=2):
    """A trunk that tapers, with so many limbs that taper, bend and stay clear of each other."""
    rng, t = np.random.default_rng(seed), np.linspace(0, 1, PLACES)
    bent = 0.02 * height * np.stack([np.sin(2.5 * t), np.cos(2 * t) - 1, 0 * t], axis=1)
    found = [Limb(bent + height * t[:, None] * [0, 0, 1], radius * (1 - 0.8 * t))]
    for _ in range(4000):
        if len(found) > limbs:
            return found
        weights = np.array([one.length * (one.order < orders) for one in found])
        number = int(rng.choice(len(found), p=weights / weights.sum()))
        parent = found[number]
        place = rng.uniform(0.3, 0.9) * parent.length
        here, wide = parent.at(place)
        ahead = parent.at(min(place + 0.1, parent.length))[0] - here
        ahead /= np.linalg.norm(ahead)
        aside = np.cross(ahead, rng.normal(size=3))
        angle = np.radians(rng.uniform(40, 70))
        way = np.cos(angle) * ahead + np.sin(angle) * aside / np.linalg.norm(aside)
        base, length = wide * rng.uniform(0.35, 0.65), parent.length * rng.uniform(0.25, 0.5)
        if base < 0.03 * radius or length < 8 * wide:
            continue
        bend = 0.25 * np.array([0, 0, 1]) + 0.1 * rng.normal(size=3)
        middle = here + length * (t[:, None] * way + t[:, None] ** 2 * bend)
        limb = Limb(middle, base * (1 - 0.75 * t), parent.order + 1, number)
        if middle[:, 2].min() > 0.1 * height and all(_clear(limb, o, here, wide) for o in found):
            found.append(limb)
    raise AssertionError("no room for so many limbs")


def _clear(limb, other, here, wide):
    (a, ra), (b, rb) = (one.at(np.linspace(0, one.length, 60)) for one in (limb, other))
    gaps = np.linalg.norm(a[:, None] - b, axis=2) - ra[:, None] - rb
    if np.linalg.norm(b - here, axis=1).min() < wide + 0.1:
        gaps = gaps[np.linalg.norm(a - here, axis=1) > 2.5 * wide + 2 * ra[0]]
    return gaps.min() > max(ra[0], 0.06)


def sampled(limbs, count, rng):
    """About so many points on the surfaces of all limbs, evenly, outside of others; normals."""
    area = np.array([np.trapezoid(one.radii, one.along) for one in limbs])
    points, normals, number = [], [], []
    for k, limb in enumerate(limbs):
        n = round(count * area[k] / area.sum())
        fine = np.linspace(0, limb.length, 1000)
        total = np.concatenate([[0.0], np.cumsum(limb.at(fine)[1][1:])])
        middle, radii = limb.at(place := np.interp(rng.uniform(0, total[-1], n), total, fine))
        tangent = np.gradient(limb.points, limb.along, axis=0)
        way = np.stack([np.interp(place, limb.along, x) for x in tangent.T], axis=1)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        u = np.cross(way, [0.3, 0.5, 0.8])
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        turn = rng.uniform(0, 2 * np.pi, (n, 1))
        normal = np.cos(turn) * u + np.sin(turn) * np.cross(way, u)
        points.append(middle + radii[:, None] * normal)
        normals.append(normal)
        number.append(np.full(n, k))
    points, normals, number = map(np.concatenate, (points, normals, number))
    hidden = np.zeros(len(points), bool)
    for k, limb in enumerate(limbs):
        middle, radii = limb.at(np.linspace(0, limb.length, 200))
        for part in range(0, len(points), 5000):
            rows = slice(part, part + 5000)
            away = np.linalg.norm(points[rows, None] - middle, axis=2) - 0.97 * radii
            hidden[rows] |= (away.min(axis=1) < 0) & (number[rows] != k)
    return points[~hidden], normals[~hidden]


def in_front(points, eye, angle=0.01):
    """Whether nothing is before each point: a depth buffer whose pixels have an angle."""
    way = points - eye
    away = np.linalg.norm(way, axis=1)
    pixel = np.floor(
        [np.arctan2(way[:, 1], way[:, 0]) / angle, np.arcsin(way[:, 2] / away) / angle]
    )
    _, pixel = np.unique(pixel, axis=1, return_inverse=True)
    nearest = np.full(len(points), np.inf)
    np.minimum.at(nearest, pixel.ravel(), away)
    return away < nearest[pixel.ravel()] + 4.0 * angle * away


def scanned(
    limbs, count, *, positions=0, seed=0, noise=0.0, shift=0.0, ground=0.0, strays=0, occluded=False
):
    """About so many points seen from so many positions around the tree; 0: from everywhere.

    `shift` is the registration error of each position, `ground` the half side of a square of
    ground, `strays` a number of points inside of the trunk; `occluded`: without what is behind
    something else.
    """
    rng, parts = np.random.default_rng(seed), []
    for k in range(max(positions, 1)):
        points, normals = sampled(limbs, (2 if positions else 1) * count // max(positions, 1), rng)
        if ground:
            flat = rng.uniform(-ground, ground, (len(points) // 6, 2))
            below = np.column_stack([flat, 0.05 * np.sin(flat[:, 0])])
            points = np.concatenate([points, below])
            normals = np.concatenate([normals, np.tile([0.0, 0.0, 1.0], (len(flat), 1))])
        if positions:
            turn = 2 * np.pi * k / positions + 0.3
            eye = np.array([12 * np.cos(turn), 12 * np.sin(turn), 1.5])
            view = eye - points
            seen = np.einsum("na,na->n", view, normals) > 0.05 * np.linalg.norm(view, axis=1)
            if occluded:
                seen &= in_front(points, eye)
            points = points[seen]
        error = rng.normal(size=3)
        parts.append(points + shift * error / np.linalg.norm(error))
    inside = rng.uniform(0, 1, strays) * limbs[0].length
    middle, radii = limbs[0].at(inside)
    away = rng.normal(size=(strays, 3))
    away *= (0.8 * radii * rng.uniform(size=strays) / np.linalg.norm(away, axis=1))[:, None]
    points = np.concatenate([*parts, middle + away])
    return points + noise * rng.normal(size=points.shape)
