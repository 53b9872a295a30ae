"""Bodies whose parts are beyond doubt, in several proportions: rods, rings, cups, bolts, hammers.

`known_bodies` yields name, shape and the part of each face. The weights of parts as people see
them are chosen from these as well as from what people did (`benchmarks/parts.py left_out`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import bodies
import medialis

EACH = 4
"""Bodies of a family."""


def known_bodies(
    families: tuple[str, ...] = (),
) -> Iterator[tuple[str, medialis.Shape, np.ndarray]]:
    """Yield each body: its name, family_number, and the part of each of its faces.

    Of these families, or of all.
    """
    for name in families or FAMILIES:
        family = FAMILIES[name]
        rng = np.random.default_rng(7)
        for k in range(EACH):
            shape, part = family(rng)
            assert shape.faces is not None
            yield f"{name}_{k}", shape, part(shape.points[shape.faces].mean(axis=1))


def _cell(*sides: float) -> float:
    """Length of cells: some 5000 vertices."""
    return 0.035 * float(np.max(sides))


def _all_one(at: np.ndarray) -> np.ndarray:
    return np.zeros(len(at), int)


def rod(rng: np.random.Generator) -> tuple:
    """Make a straight rod with round or flat ends: one part."""
    radius, half = rng.uniform(0.08, 0.3), 1.0
    if rng.uniform() < 0.5:
        shape = bodies.blended([((0, 0, -half), (0, 0, half), radius, radius)], 0.01, 0.04)
    else:
        side = (-radius, -radius, -half), (radius, radius, half)
        shape = bodies.meshed(lambda at: bodies.rod(at, (0, 0, 0), radius, half), *side, 0.04)
    return shape, _all_one


def ring(rng: np.random.Generator) -> tuple:
    """Make a torus: one part."""
    minor = rng.uniform(0.15, 0.45)

    def field(at: np.ndarray) -> np.ndarray:
        return np.hypot(np.hypot(at[..., 0], at[..., 1]) - 1.0, at[..., 2]) - minor

    side = np.array([1 + minor, 1 + minor, minor])
    return bodies.meshed(field, -side, side, _cell(*side)), _all_one


def block(rng: np.random.Generator) -> tuple:
    """Make a box with a fillet, or a plate: one part."""
    half = np.array([1.0, rng.uniform(0.4, 1.0), rng.uniform(0.06, 0.6)])
    shape = bodies.meshed(
        lambda at: bodies.rounded_box(at, (0, 0, 0), half, 0.05), -half, half, _cell(*half)
    )
    return shape, _all_one


def cup(rng: np.random.Generator) -> tuple:
    """Make a vessel with a wall, with or without a handle."""
    radius, wall, half = rng.uniform(0.5, 1.0), rng.uniform(0.07, 0.15), 0.9
    handle = rng.uniform() < 0.7

    def field(at: np.ndarray) -> np.ndarray:
        hole = bodies.rod(at, (0, 0, 2 * wall), radius - wall, half)
        vessel = bodies.without(bodies.rod(at, (0, 0, 0), radius, half), hole)
        if not handle:
            return vessel
        ring = np.hypot(np.hypot(at[..., 0] - radius, at[..., 2]) - 0.5, at[..., 1]) - 0.1
        outside = radius - wall / 2 - np.hypot(at[..., 0], at[..., 1])
        return bodies.joined([vessel, -bodies.joined([-ring, -outside], 0.01)], 0.01)

    side = np.array([radius, radius, half])
    far = np.array([radius + 0.62, radius, half]) if handle else side

    def part(at: np.ndarray) -> np.ndarray:
        return (np.hypot(at[:, 0], at[:, 1]) > radius + 1e-3).astype(int)

    return bodies.meshed(field, -side, far, _cell(*side)), part if handle else _all_one


def bolt(rng: np.random.Generator) -> tuple:
    """Make a flat wide head on a shaft."""
    head, shaft, thick = rng.uniform(0.5, 0.9), rng.uniform(0.2, 0.35), rng.uniform(0.15, 0.35)

    def field(at: np.ndarray) -> np.ndarray:
        plate = bodies.rod(at, (0, 0, 1.2), head, thick)
        return bodies.joined([plate, bodies.rod(at, (0, 0, 0), shaft, 1.2)], 0.01)

    shape = bodies.meshed(field, (-head, -head, -1.2), (head, head, 1.2 + thick), 0.045)
    return shape, lambda at: (at[:, 2] > 1.2 - thick - 0.01).astype(int)


def hammer(rng: np.random.Generator) -> tuple:
    """Make a head across the end of a shaft."""
    long, thick, shaft = rng.uniform(0.5, 0.9), rng.uniform(0.25, 0.4), rng.uniform(0.1, 0.2)

    def field(at: np.ndarray) -> np.ndarray:
        head = bodies.rounded_box(at, (0, 0, 1.5), (long, thick, thick), 0.08)
        return bodies.joined([head, bodies.rod(at, (0, 0, 0), shaft, 1.5)], 0.01)

    shape = bodies.meshed(field, (-long, -thick, -1.5), (long, thick, 1.5 + thick), 0.05)
    return shape, lambda at: (at[:, 2] > 1.5 - thick - 0.01).astype(int)


def bones(rng: np.random.Generator) -> tuple:
    """Make a bar between two balls."""
    ball, bar, half = rng.uniform(0.4, 0.7), rng.uniform(0.12, 0.28), 1.0

    def field(at: np.ndarray) -> np.ndarray:
        ends = [np.linalg.norm(at - [0, 0, z], axis=-1) - ball for z in (-half, half)]
        return bodies.joined([*ends, bodies.rod(at, (0, 0, 0), bar, half)], 0.02)

    neck = half - np.sqrt(ball**2 - bar**2)
    shape = bodies.meshed(field, (-ball, -ball, -half - ball), (ball, ball, half + ball), 0.045)
    return shape, lambda at: np.digitize(at[:, 2], [-neck, neck])


def stool(rng: np.random.Generator) -> tuple:
    """Make a plate on three or four legs."""
    count, thick, leg = int(rng.integers(3, 5)), rng.uniform(0.06, 0.15), rng.uniform(0.08, 0.16)
    turn = 2 * np.pi * np.arange(count) / count
    feet = 0.7 * np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def field(at: np.ndarray) -> np.ndarray:
        legs = [bodies.rod(at, (x, y, 0), leg, 0.6) for x, y in feet]
        return bodies.joined([bodies.rod(at, (0, 0, 0.6), 1.0, thick), *legs], 0.01)

    shape = bodies.meshed(field, (-1, -1, -0.6), (1, 1, 0.6 + thick), 0.045)

    def part(at: np.ndarray) -> np.ndarray:
        nearest = np.linalg.norm(at[:, None, :2] - feet, axis=2).argmin(axis=1)
        return np.where(at[:, 2] > 0.6 - thick - 0.01, 0, 1 + nearest)

    return shape, part


FAMILIES = {
    "rod": rod, "ring": ring, "block": block, "cup": cup, "bolt": bolt, "hammer": hammer,
    "bones": bones, "stool": stool,
}  # fmt: skip
