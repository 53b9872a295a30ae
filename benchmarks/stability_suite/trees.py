"""Trees of swept balls: bodies whose axes, radii, ends and loops are known.

Branches are polylines along which a ball runs whose radius changes evenly. A branch begins on the
axis of another one and ends in a half ball, or in a ring. Apart from where they begin, branches
keep away from each other.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

import medialis
from medialis.shape.generate import make_unambiguous, surface_nets

APART = 1.5
"""Times the sum of two radii that axes keep away from each other."""

TREES = (
    *((5, 0.3, 0), (8, 0.2, 0), (12, 0.15, 0), (15, 0.12, 0), (20, 0.12, 0), (25, 0.1, 0)),
    *((10, 0.2, 1), (15, 0.15, 2), (6, 0.1, 0), (9, 0.25, 1)),
)
"""Limbs, the thinnest radius as a share of the trunk's, and rings."""

PIECES = 4
DENSE = 0.05
"""Share of the radius: distance of places along the true axis."""


@dataclass(eq=False)
class Branch:
    """A polyline with radii, where it ends, and how thick what it stands on is."""

    points: np.ndarray
    radii: np.ndarray
    tips: list[int]
    on: float = 0.0


@dataclass(eq=False)
class Tree:
    """Branches; `places` are dense on the axis, with the radius and the limb of each."""

    branches: list[Branch]
    loops: int
    tips: np.ndarray = field(init=False)
    tip_radii: np.ndarray = field(init=False)
    places: np.ndarray = field(init=False)
    place_radii: np.ndarray = field(init=False)
    limb: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        tips, radii, places, place_radii, limb = [], [], [], [], []
        for one in self.branches:
            line, thick = dense(one)
            name = np.full(len(line), -1)
            for at in one.tips:
                if len(one.tips) == 2:  # the trunk: two limbs
                    half = len(line) // 2
                    name[slice(0, half) if at == 0 else slice(half, None)] = len(tips)
                else:
                    name[:] = len(tips)
                tips.append(one.points[at])
                radii.append(one.radii[at])
            places.append(line)
            place_radii.append(thick)
            limb.append(name)
        self.tips, self.tip_radii = np.array(tips).reshape(-1, 3), np.array(radii)
        self.places, self.place_radii = np.concatenate(places), np.concatenate(place_radii)
        self.limb = np.concatenate(limb)


def dense(branch: Branch) -> tuple[np.ndarray, np.ndarray]:
    """Places along a branch, and the radius there."""
    length = np.linalg.norm(np.diff(branch.points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(length)])
    wanted = np.linspace(0, along[-1], int(np.ceil(along[-1] / (DENSE * branch.radii.min()))) + 1)
    line = np.stack([np.interp(wanted, along, branch.points[:, k]) for k in range(3)], axis=1)
    return line, np.interp(wanted, along, branch.radii)


def grown_tree(rng: np.random.Generator, limbs: int, thinnest: float, rings: int = 0) -> Tree:
    """Grow a tree of so many limbs, the thinnest of them so thick as a share of the trunk."""
    trunk = Branch(_bent(rng, np.zeros(3), _way(rng), 14.0), np.linspace(1.0, 0.8, PIECES + 1), [])
    trunk.tips = [0, PIECES]
    branches, tries, loops = [trunk], 0, 0
    while len(branches) < limbs - 1 and tries < 5000:
        tries += 1
        ring = loops < rings
        mother = branches[rng.integers(len(branches))]
        if mother.on < 0:
            continue
        line, thick = dense(mother)
        low = 0.2 if mother is trunk else 0.35
        at = int(rng.uniform(low, 0.8) * (len(line) - 1))
        along = line[min(at + 1, len(line) - 1)] - line[max(at - 1, 0)]
        along /= np.linalg.norm(along)
        way = _way(rng)
        if abs(way @ along) > 0.6:
            continue
        base = float(np.clip(thick[at] * rng.uniform(0.3, 0.8), thinnest, None))
        if base > 0.85 * thick[at]:
            continue
        length = thick[at] + rng.uniform(5.0, 14.0) * base
        radii = np.linspace(base, max(base * rng.uniform(0.6, 1.0), thinnest), PIECES + 1)
        one = Branch(_bent(rng, line[at], way, length), radii, [PIECES], thick[at])
        if ring:
            one.tips = []
        if not _free(one, mother, branches):
            continue
        if ring:
            circle = _ring(rng, one)
            if not _free(circle, one, branches):
                continue
            loops += 1
            branches += [one, circle]
        else:
            branches.append(one)
    return Tree(branches, loops)


def _way(rng: np.random.Generator) -> np.ndarray:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way)


def _bent(
    rng: np.random.Generator, start: np.ndarray, way: np.ndarray, length: float
) -> np.ndarray:
    points, here = [start], way
    for _ in range(PIECES):
        points.append(points[-1] + length / PIECES * here)
        here = here + 0.2 * _way(rng)
        here /= np.linalg.norm(here)
    return np.array(points)


def _ring(rng: np.random.Generator, stem: Branch) -> Branch:
    """Return a ring at the end of a stem, as thick as it."""
    radius = float(stem.radii[-1])
    way = stem.points[-1] - stem.points[-2]
    way /= np.linalg.norm(way)
    across = np.cross(way, _way(rng))
    across /= np.linalg.norm(across)
    wide, turn = 4.0 * radius, np.linspace(0, 2 * np.pi, 41)
    middle = stem.points[-1] + wide * way
    points = middle + wide * (np.sin(turn)[:, None] * across - np.cos(turn)[:, None] * way)
    return Branch(points, np.full(41, radius), [], -1.0)


def _free(one: Branch, mother: Branch, branches: list[Branch]) -> bool:
    """Tell whether a branch keeps away from all others, and from its mother but for its base."""
    line, thick = dense(one)
    for other in branches if mother in branches else [*branches, mother]:
        there, wide = dense(other)
        there, wide = there[::4], wide[::4]
        if other is mother:
            start = np.linalg.norm(line - one.points[0], axis=1)
            own = start > APART * (one.on if one.on > 0 else 3 * thick[0]) + 2 * thick
        else:
            own = np.ones(len(line), bool)
        far = line[own][::4]
        if len(far) == 0:
            continue
        gap = np.linalg.norm(far[:, None] - there, axis=2) - APART * (
            thick[own][::4][:, None] + wide
        )
        if gap.min() < 0:
            return False
    return True


def meshed(tree: Tree, cell: float) -> medialis.Shape:
    """Mesh the surface of a tree; creases stay where branches meet."""
    field, low = depth_grid(tree, cell)
    make_unambiguous(field)
    points, faces = surface_nets(field, low, cell)
    return medialis.make_shape(points, faces)


def depth_grid(tree: Tree, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance to a tree on a grid, at most four cells, and the place of its corner."""
    cones = [
        (b.points[k], b.points[k + 1], b.radii[k], b.radii[k + 1])
        for b in tree.branches
        for k in range(len(b.points) - 1)
    ]
    ends = np.concatenate([b.points for b in tree.branches])
    thick = np.concatenate([b.radii for b in tree.branches])
    low = (ends - thick[:, None]).min(axis=0) - 3.31 * cell
    high = (ends + thick[:, None]).max(axis=0) + 3.4 * cell
    count = np.ceil((high - low) / cell).astype(int) + 1
    field = np.full(count, 4 * cell)
    axes = [low[k] + cell * np.arange(count[k]) for k in range(3)]
    for a, b, ra, rb in cones:
        reach = max(ra, rb) + 4 * cell
        begin = np.floor((np.minimum(a, b) - reach - low) / cell).astype(int).clip(0)
        stop = np.minimum(np.ceil((np.maximum(a, b) + reach - low) / cell).astype(int) + 1, count)
        part = tuple(slice(i, j) for i, j in zip(begin, stop, strict=True))
        grid = np.stack(np.meshgrid(*(axes[k][part[k]] for k in range(3)), indexing="ij"), axis=-1)
        value = _cone(grid.reshape(-1, 3), a, b, ra, rb).reshape(grid.shape[:3])
        field[part] = np.minimum(field[part], value)
    return field, low


def _cone(at: np.ndarray, a: np.ndarray, b: np.ndarray, ra: float, rb: float) -> np.ndarray:
    """Signed distance to the hull of two balls."""
    along = b - a
    length = float(np.linalg.norm(along))
    way, slope = along / length, (ra - rb) / length
    rise = np.sqrt(1 - slope**2)
    y = (at - a) @ way
    x = np.linalg.norm(at - a - y[:, None] * way, axis=1)
    share = np.clip((y + x * slope / rise) / length, 0.0, 1.0)
    middle = np.hypot(x, y - share * length)
    return middle - (ra + share * (rb - ra))
