"""Balls spread over flat convex sheets that share their sides: triangles as even as they go.

`Patch` is a sheet, `Spread` the triangles of all, with a spacing: sides are divided alike for all
sheets that have them, points within a sheet lie on a grid of equal triangles, moved to where their
neighbours are on all sides alike. `most_within` finds the spacing that gives a number of balls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import Index
from medialis.base.validation import FloatArray
from medialis.medial_meshes.mesh import Complex

OFF_SIDES = 0.6
"""Spacings that points within a sheet keep from its sides, at least."""

BULGE = 1e-3
"""How far divided sides stand out while triangles are sought, in their lengths: else three points
of one side would be a triangle."""

EVENED = 5
"""How often points within are moved between their neighbours."""

HALVINGS = 30
"""Steps in which the spacing is found."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A flat convex sheet.

    Attributes
    ----------
    ring : (c,) int64
        The vertices round it.
    middle, axes : (3,), (2, 3) float64
        Of its plane.
    flat : (c, 2) float64
        The ring in the plane, counterclockwise.
    """

    ring: Index
    middle: FloatArray
    axes: FloatArray
    flat: FloatArray

    @classmethod
    def of(cls, points: FloatArray, ring: Index) -> Patch:
        """Make one of points (v, 3) and the vertices round it; the first axis is a side."""
        corners = points[ring]
        middle = corners.mean(axis=0)
        _, _, axes = np.linalg.svd(corners - middle, full_matrices=False)
        sides = np.roll(corners, -1, axis=0) - corners
        along = sides[np.linalg.norm(sides, axis=1).argmax()]
        along = along / np.linalg.norm(along)
        axes = np.stack([along, np.cross(axes[2], along)])
        flat = (corners - middle) @ axes.T
        x, y = flat.T
        if x @ np.roll(y, -1) - y @ np.roll(x, -1) < 0:
            ring, flat = ring[::-1].copy(), flat[::-1].copy()
        return cls(ring, middle, axes, flat)

    def within(self, spacing: float) -> FloatArray:
        """Return points (p, 2) of a grid of equal triangles that are not near its sides."""
        low, high = self.flat.min(axis=0), self.flat.max(axis=0)
        rise = spacing * np.sqrt(0.75)
        size = high - low
        if size.max() < spacing:
            return np.empty((0, 2))
        rows, columns = int(size[1] / rise) + 1, int(size[0] / spacing) + 2
        j, i = np.mgrid[:rows, :columns]
        start = 0.5 * (size[1] - (rows - 1) * rise)
        places = np.stack([spacing * (i + 0.5 * (j % 2)), start + rise * j], axis=-1)
        places = places.reshape(-1, 2) + low
        ways = np.roll(self.flat, -1, axis=0) - self.flat
        inward = np.stack([-ways[:, 1], ways[:, 0]], axis=1)
        inward /= np.linalg.norm(inward, axis=1)[:, None]
        depth = places @ inward.T - np.einsum("ij,ij->i", self.flat, inward)
        return np.asarray(places[(depth > OFF_SIDES * spacing).all(axis=1)])


def _sides_of(patches: list[Patch], balls: FloatArray) -> tuple[Index, FloatArray, list[Index]]:
    """Return the sides (s, 2) of all sheets, their lengths, and which ones each sheet has."""
    ends = [np.stack([one.ring, np.roll(one.ring, -1)], axis=1) for one in patches]
    rows, which = np.unique(np.sort(np.concatenate(ends), axis=1), axis=0, return_inverse=True)
    lengths = np.linalg.norm(balls[rows[:, 0], :3] - balls[rows[:, 1], :3], axis=1)
    own = np.split(which.ravel(), np.cumsum([len(one) for one in ends])[:-1])
    return rows, lengths, own


def most_within(balls: FloatArray, patches: list[Patch], count: int) -> float:
    """Return the spacing with the most balls up to `count`; inf where only vertices are balls."""
    _, lengths, _ = _sides_of(patches, balls)
    largest_first = sorted(patches, key=lambda one: -float(np.prod(np.ptp(one.flat, axis=0))))

    def number(spacing: float) -> int:
        """Return how many balls, or of too many the first that are too many."""
        found = len(balls) + int((np.maximum(np.rint(lengths / spacing), 1) - 1).sum())
        for one in largest_first:
            if found > count:
                break
            found += len(one.within(spacing))
        return found

    high = 2.0 * float(lengths.max())
    low, best, most = high / np.sqrt(4.0 * count), np.inf, len(balls)
    while number(low) < count:
        low *= 0.7
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        if most < (found := number(middle)) <= count:
            best, most = middle, found
        low, high = (middle, high) if found > count else (low, middle)
        if found == count or high < 1.0001 * low:
            break
    return best


class Spread:
    """Balls on patches that share their sides, at a spacing."""

    def __init__(self, balls: FloatArray, patches: list[Patch], spacing: float) -> None:
        self.patches = patches
        ends, lengths, own = _sides_of(patches, balls)
        pieces = np.ones(len(ends), np.int64)
        if np.isfinite(spacing):
            pieces = np.maximum(np.rint(lengths / spacing), 1).astype(np.int64)
        starts = len(balls) + np.concatenate([[0], np.cumsum(pieces - 1)])
        side = np.repeat(np.arange(len(ends)), pieces - 1)
        share = np.arange(starts[-1] - len(balls)) - (starts[side] - len(balls)) + 1
        share = (share / pieces[side])[:, None]
        between = (1 - share) * balls[ends[side, 0]] + share * balls[ends[side, 1]]
        self.balls = [balls, between]
        self.count = int(starts[-1])
        self._rims = [self._rim(k, own[k], starts, share[:, 0]) for k in range(len(patches))]
        finite = np.isfinite(spacing)
        self._inner = [one.within(spacing) if finite else np.empty((0, 2)) for one in patches]
        self.count += sum(len(one) for one in self._inner)

    def _rim(
        self, k: int, sides: Index, starts: Index, share: FloatArray
    ) -> tuple[Index, FloatArray, FloatArray]:
        """Return numbers of the balls round a patch, their places, and places that bulge."""
        patch, vertices = self.patches[k], len(self.balls[0])
        numbers, places, out = [], [], []
        for corner, side in enumerate(sides):
            a, b = corner, (corner + 1) % len(patch.ring)
            rows = np.arange(starts[side], starts[side + 1])
            along = share[rows - vertices]
            if patch.ring[a] > patch.ring[b]:
                rows, along = rows[::-1], 1 - along[::-1]
            way = patch.flat[b] - patch.flat[a]
            straight = patch.flat[a] + along[:, None] * way
            away = np.array([way[1], -way[0]])
            numbers += [patch.ring[[a]], rows]
            places += [patch.flat[[a]], straight]
            bulge = BULGE * (4 * along * (1 - along))[:, None] * away
            out += [patch.flat[[a]], straight + bulge]
        return np.concatenate(numbers), np.concatenate(places), np.concatenate(out)

    def complex(self, count: int) -> Complex:
        """Return all of them; the largest triangles get more balls until there are `count`."""
        triangles = [self._triangles(k) for k in range(len(self.patches))]
        longest = [self._largest(k, triangles[k]) for k in range(len(self.patches))]
        while self.count < count:
            k = max(range(len(longest)), key=lambda i: longest[i][0])
            self._inner[k] = np.concatenate([self._inner[k], longest[k][1][None]])
            self.count += 1
            triangles[k] = self._triangles(k)
            longest[k] = self._largest(k, triangles[k])
        start = len(self.balls[0]) + len(self.balls[1])
        balls, faces = list(self.balls), []
        known = np.concatenate(self.balls)
        for k, patch in enumerate(self.patches):
            numbers, inner = self._rims[k][0], self._inner[k]
            inner = self._evened(k, triangles[k])
            faces.append(np.append(numbers, start + np.arange(len(inner)))[triangles[k]])
            start += len(inner)
            centers = patch.middle + inner @ patch.axes
            balls.append(np.column_stack([centers, _linear(known[patch.ring], centers)]))
        rows = np.sort(np.concatenate(faces), axis=1)
        sides = np.unique(rows[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2), axis=0)
        return Complex(np.concatenate(balls), sides, rows)

    def _triangles(self, k: int) -> Index:
        """Return the triangles of a patch, in rows of its rim and the points within."""
        from scipy.spatial import Delaunay

        _, _, out = self._rims[k]
        if len(out) + len(self._inner[k]) == 3:
            return np.array([[0, 1, 2]])
        found: Index = Delaunay(np.concatenate([out, self._inner[k]])).simplices.astype(np.int64)
        return found

    def _largest(self, k: int, triangles: Index) -> tuple[float, FloatArray]:
        """Return the area of the largest triangle of a patch, and its middle."""
        places = np.concatenate([self._rims[k][1], self._inner[k]])[triangles]
        b, c = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
        areas = np.abs(b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
        row = int(areas.argmax())
        return float(areas[row]), places[row].mean(axis=0)

    def _evened(self, k: int, triangles: Index) -> FloatArray:
        """Return the points within, each moved to the middle of its neighbours."""
        rim, inner = self._rims[k][1], self._inner[k]
        places = np.concatenate([rim, inner])
        ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        ends = np.unique(np.sort(ends, axis=1), axis=0)
        a, b = np.concatenate([ends, ends[:, ::-1]]).T
        degree = np.bincount(a, minlength=len(places))[len(rim) :, None]
        for _ in range(EVENED if len(inner) else 0):
            sums = np.zeros_like(places)
            np.add.at(sums, a, places[b])
            places[len(rim) :] = sums[len(rim) :] / degree
        return places[len(rim) :]


def _linear(corners: FloatArray, centers: FloatArray) -> FloatArray:
    """Return the radii at centers of a plane on which they are linear, told by its corners."""
    middle = corners.mean(axis=0)
    slope = np.linalg.lstsq(corners[:, :3] - middle[:3], corners[:, 3] - middle[3], rcond=1e-9)[0]
    return np.maximum(middle[3] + (centers - middle[:3]) @ slope, 0.0)
