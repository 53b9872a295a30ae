"""Trees of known limbs: swept capsules that taper, joined, with order and parent of each."""

from dataclasses import dataclass

import numpy as np

from medialis.shape.generate import make_unambiguous, surface_nets
from medialis.shape.normals import vertex_normals
from medialis.shape.shape import Shape

PLACES = 6
"""Of the middle of a limb."""


@dataclass
class KnownLimb:
    """Middle (k, 3), radii (k,), order, and the number of the limb that it grows from."""

    points: np.ndarray
    radii: np.ndarray
    order: int = 0
    parent: int = -1

    @property
    def length(self):
        return np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum()

    def dense(self, count=20):
        """Places along the limb with their radii."""
        at, to = np.linspace(0, 1, len(self.points)), np.linspace(0, 1, count * len(self.points))
        points = np.stack([np.interp(to, at, column) for column in self.points.T], axis=1)
        return points, np.interp(to, at, self.radii)


def known_tree(seed, limbs, *, ratio=10.0, orders=3, taper=True, bend=0.3):
    """A trunk of radius 0.5 and height 10 with so many limbs; the thinnest has 1 / ratio of it.

    Limbs leave at 40 to 75 degrees with 0.4 to 0.65 of the radius there, bend upwards, and stay
    clear of each other.
    """
    rng, t = np.random.default_rng(seed), np.linspace(0, 1, PLACES)
    middle = np.stack([bend * np.sin(2 * t), bend * np.cos(1.5 * t) - bend, 10.0 * t], axis=1)
    found = [KnownLimb(middle, 0.5 + (ratio**-0.5 - 1.0) * 0.5 * t * taper)]
    for _ in range(5000):
        if len(found) > limbs:
            return found
        number = int(rng.integers(len(found)))
        parent = found[number]
        place = rng.uniform(0.3, 0.9) * (PLACES - 1)
        row, rest = int(place), place % 1.0
        here = parent.points[row] + rest * (parent.points[row + 1] - parent.points[row])
        wide = parent.radii[row] + rest * (parent.radii[row + 1] - parent.radii[row])
        along = parent.points[row + 1] - parent.points[row]
        along /= np.linalg.norm(along)
        aside = np.cross(along, rng.normal(size=3))
        angle = np.radians(rng.uniform(40, 75))
        way = np.cos(angle) * along + np.sin(angle) * aside / np.linalg.norm(aside)
        base = wide * rng.uniform(0.4, 0.65)
        length = max(parent.length * rng.uniform(0.3, 0.55), 6 * base + wide)
        if parent.order == orders or base < 0.5 / ratio:
            continue
        tip = max(0.5 * base, 0.5 / ratio) if taper else base
        middle = here + length * (t[:, None] * way + 0.15 * t[:, None] ** 2 * [0, 0, 1])
        limb = KnownLimb(middle, base + (tip - base) * t, parent.order + 1, number)
        if all(_clear(limb, other, here, wide) for other in found):
            found.append(limb)
    raise AssertionError("no room for so many limbs")


def _clear(limb, other, here, wide):
    """Whether two limbs are apart, but for where one grows from the other."""
    (a, ra), (b, rb) = limb.dense(), other.dense()
    gaps = np.linalg.norm(a[:, None] - b, axis=2) - ra[:, None] - rb
    if np.linalg.norm(b - here, axis=1).min() < 0.5 * wide:
        gaps = gaps[np.linalg.norm(a - here, axis=1) > 1.3 * wide + 2.5 * ra[0]]
    return gaps.min() > ra[0]


def meshed(limbs, cell):
    """The surface of all limbs as one closed mesh."""
    low = np.min([(one.points - one.radii[:, None]).min(axis=0) for one in limbs], axis=0)
    high = np.max([(one.points + one.radii[:, None]).max(axis=0) for one in limbs], axis=0)
    low = low - 2.31 * cell
    counts = np.ceil((high - low) / cell).astype(int) + 3
    axes = [low[d] + cell * np.arange(counts[d]) for d in range(3)]
    field = np.full([len(axis) for axis in axes], 10.0 * cell)
    for limb in limbs:
        for row in range(PLACES - 1):
            a, b = limb.points[row : row + 2]
            ra, rb = limb.radii[row : row + 2]
            near = np.minimum(a - ra, b - rb) - 4 * cell, np.maximum(a + ra, b + rb) + 4 * cell
            ends = [np.searchsorted(axes[d], [near[0][d], near[1][d]]) for d in range(3)]
            part = tuple(slice(*one) for one in ends)
            grid = np.stack(np.meshgrid(*[axes[d][part[d]] for d in range(3)], indexing="ij"), -1)
            t = np.clip((grid - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            away = np.linalg.norm(grid - a - t[..., None] * (b - a), axis=-1) - ra - (rb - ra) * t
            field[part] = np.minimum(field[part], away)
    make_unambiguous(field)
    points, faces = surface_nets(field, low, cell)
    return Shape(points, vertex_normals(points, faces), faces)
