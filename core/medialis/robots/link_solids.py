"""The solid of one link: patches of its surface, how deep a point is inside, medial balls.

Meshes of links are often not closed, hold screws and motors, or are hollow. What nothing from
outside can reach counts as inside, whatever the triangles say: a grid of voxels is flooded from
outside. Where a mesh is thinner than a voxel, the triangles decide.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from medialis.base.arrays import Index, Mask
from medialis.base.box_tree import NearestTree
from medialis.base.validation import FloatArray, IntArray
from medialis.medial_meshes.distances import pieces_of
from medialis.medial_meshes.sampling import Solid
from medialis.shape.shape import Shape

VOXELS = 40
"""Voxels along the longest side of a link: cavities behind slits narrower than one are inside."""

HALVINGS = 12
"""Bisections of the length of a ray to the center of a medial ball: 1e-4 of the diagonal."""

TANGENT = 1e-3
"""Relative amount by which a medial ball may reach across the surface while it is searched."""


BITS = 16
"""Corners of a patch with the same coordinates, in so many bits, count once while covers are
chosen; radii are taken from all."""


class Patches:
    """Patches of a surface, each of which one ball or capsule has to hold as a whole.

    Parameters
    ----------
    pieces : (p, 3, 3) float64
        Triangles that are small.
    within : (p,) int64
        Pieces with different numbers are in different patches.
    side : float
        Extent of a patch: pieces whose middles are in one cell of a grid are one.

    Attributes
    ----------
    pieces : (p, 3, 3) float64
        In the order of patches.
    corners : (3 p, 3) float64
        What holds the corners of a patch holds the patch.
    starts : (n + 1,) int64
        Patch i has the corners `starts[i]` to `starts[i + 1]`.
    """

    def __init__(self, pieces: FloatArray, within: Index, side: float) -> None:
        middles = middles_of(pieces)
        cell = np.floor((middles - middles.min(axis=0)) / side).astype(np.int64)
        wide = cell.max(axis=0) + 1
        key = ((within * wide[0] + cell[:, 0]) * wide[1] + cell[:, 1]) * wide[2] + cell[:, 2]
        patch = np.unique(key, return_inverse=True)[1].reshape(-1)
        order = np.argsort(patch, kind="stable")
        self.pieces, self.side = pieces[order], side
        self.corners = np.ascontiguousarray(self.pieces.reshape(-1, 3))
        self.starts: Index = 3 * np.concatenate([[0], np.cumsum(np.bincount(patch))])

    @classmethod
    def of_triangles(cls, triangles: FloatArray, count: int) -> Patches:
        """Cut triangles (t, 3, 3) into about so many patches."""
        sides = triangles[:, 1:] - triangles[:, :1]
        area = 0.5 * float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum())
        side = math.sqrt(area / count)
        small = longest_sides(triangles) <= side
        pieces = triangles
        if not small.all():
            pieces = np.concatenate([triangles[small], pieces_of(triangles[~small], side)])
        return cls(pieces, np.zeros(len(pieces), np.int64), side)

    def halved(self) -> Patches:
        """Return patches of half the extent, each within one of these."""
        half, parts = 0.5 * self.side, []
        pieces, patch = self.pieces, self.owner_of_corners[::3]
        while len(pieces):
            longest = longest_sides(pieces)
            small = longest <= half
            parts.append((pieces[small], patch[small]))
            pieces, patch = pieces[~small], np.tile(patch[~small], 2)
            sides = pieces - np.roll(pieces, -1, axis=1)
            first = np.einsum("tkc,tkc->tk", sides, sides).argmax(axis=1)
            a, b, c = (pieces[np.arange(len(first)), (first + k) % 3] for k in range(3))
            middle = 0.5 * (a + b)
            pieces = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        found, owners = zip(*parts, strict=True)
        return Patches(np.concatenate(found), np.concatenate(owners), half)

    def __len__(self) -> int:
        return len(self.starts) - 1

    @cached_property
    def distinct(self) -> tuple[FloatArray, Index]:
        """Return corners and starts without those that a patch has twice, up to rounding."""
        low = self.corners.min(axis=0)
        unit = float((self.corners.max(axis=0) - low).max()) / ((1 << BITS) - 1) or 1.0
        cell = np.round((self.corners - low) / unit).astype(np.int64)
        key = self.owner_of_corners
        for axis in range(3):
            key = (key << BITS) | cell[:, axis]
        key, first = np.unique(key, return_index=True)
        counts = np.bincount(key >> (3 * BITS), minlength=len(self))
        return self.corners[first], np.concatenate([[0], np.cumsum(counts)])

    @cached_property
    def owner_of_corners(self) -> Index:
        """Patch of each corner, (3 p,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.starts))


def longest_sides(triangles: FloatArray) -> FloatArray:
    """Return the length of the longest side of triangles (t, 3, 3), (t,)."""
    largest = np.zeros(len(triangles))
    for k in range(3):
        side = triangles[:, k] - triangles[:, k - 1]
        largest = np.maximum(largest, np.einsum("tc,tc->t", side, side))
    return np.sqrt(largest)


def middles_of(triangles: FloatArray) -> FloatArray:
    """Return the middles of triangles (t, 3, 3), by sums: a third of the time of means."""
    return np.asarray((triangles[:, 0] + triangles[:, 1] + triangles[:, 2]) / 3.0)


class LinkSolid:
    """A link at diagonal 1 about the origin, and what of space it fills.

    Parameters
    ----------
    shape : Shape
        A mesh in the frame of the link; it need not be closed.
    patches : int
        Number of patches that its surface is cut into, about.
    """

    def __init__(self, shape: Shape, patches: int) -> None:
        assert shape.faces is not None
        self.shape, self.scale = shape, shape.diagonal or 1.0
        self.middle = 0.5 * (shape.bounds[0] + shape.bounds[1])
        self.solid = Solid((shape.points - self.middle) / self.scale, shape.faces)
        self.triangles = self.solid.points[self.solid.faces]
        self.patches = Patches.of_triangles(self.triangles, patches)

    @cached_property
    def _voxels(self) -> tuple[FloatArray, float, Mask, Mask]:
        """Return corner and side of a grid, and which voxels are outside, and on the surface."""
        from scipy import ndimage

        from medialis.robots._cover_kernels import mark_voxels

        low, high = self.box
        side = float((high - low).max()) / VOXELS
        low = low - 1.5 * side
        shape = tuple(np.ceil((high - low) / side + 1.5).astype(int))
        wall = np.zeros(shape, bool)
        mark_voxels(self.triangles, low, side, wall)
        labels: IntArray = ndimage.label(~wall)[0]
        outside: Mask = np.equal(labels, labels[0, 0, 0])
        return low, side, outside, wall

    @cached_property
    def _is_one_body(self) -> bool:
        """True when the triangles alone say what is inside: a closed mesh of one piece."""
        return self.solid.whole and bool((self.shape.components == 0).all())

    def _voxels_of(self, points: FloatArray) -> tuple[Mask, Mask]:
        """Return which points (q, 3) are in voxels outside, and in voxels on the surface."""
        low, side, outside, wall = self._voxels
        cell = np.floor((points - low) / side).astype(np.int64)
        within: Mask = np.asarray(((cell >= 0) & (cell < outside.shape)).all(axis=1))
        rows = tuple(np.where(within[:, None], cell, 0).T)
        return np.where(within, np.asarray(outside)[rows], True), within & np.asarray(wall)[rows]

    @cached_property
    def _tree(self) -> NearestTree:
        """Triangles that can be reached from outside."""
        triangles = self.triangles
        if not self._is_one_body:
            from scipy import ndimage

            low, side, outside, _ = self._voxels
            away = ndimage.distance_transform_edt(~outside)
            pieces = self.patches.pieces
            cell = np.floor((middles_of(pieces) - low) / side).astype(np.int64)
            seen = away[tuple(cell.T)] <= 0.6 * self.patches.side / side + 2.5
            triangles = pieces[seen] if seen.any() else pieces
        points = np.ascontiguousarray(triangles.reshape(-1, 3))
        return NearestTree.of_triangles(
            points, np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        )

    def contains(self, points: FloatArray) -> Mask:
        """Return which points (q, 3) are inside."""
        inside = self.solid.contains(points)
        if self._is_one_body:
            return inside
        outside, on_wall = self._voxels_of(points)
        if not self.solid.whole:  # rays of open meshes tell sides only near their triangles
            inside = inside & ~outside
        return inside | ~(outside | on_wall)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (q, 3) from the outer surface."""
        return self._tree.distances(np.ascontiguousarray(points))[0]

    def depths(self, points: FloatArray) -> FloatArray:
        """Return how deep points (q, 3) are inside; negative outside."""
        return np.where(self.contains(points), 1.0, -1.0) * self.distances(points)

    @cached_property
    def medial_balls(self) -> tuple[FloatArray, FloatArray]:
        """Return center (m, 3) and depth (m,) of the largest ball inside at each patch.

        A ball of any center that sticks out by p lies in one about the center of a medial ball
        that sticks out by p as well, so no others have to be looked at. A patch with nothing
        behind it, such as one of a sheet, has its middle and depth 0.
        """
        first = self.patches.pieces[self.patches.starts[:-1] // 3]
        middles = middles_of(first)
        normals = np.cross(first[:, 1] - first[:, 0], first[:, 2] - first[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        centers, depths = middles.copy(), np.zeros(len(middles))
        left = np.arange(len(middles))
        for side in (-1.0, 1.0):
            found, depth = self._largest(middles[left], side * normals[left])
            inside = self.contains(found) & (depth > 0.0)
            centers[left[inside]], depths[left[inside]] = found[inside], depth[inside]
            left = left[~inside]
            if self._is_one_body or len(left) == 0:
                break
        return centers, depths

    def _largest(self, places: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return centers and radii of the largest empty balls that touch places from one side."""
        low, high = np.zeros(len(places)), np.full(len(places), 0.5)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            free = self.distances(places + middle[:, None] * directions) >= middle * (1 - TANGENT)
            low, high = np.where(free, middle, low), np.where(free, high, middle)
        centers = places + low[:, None] * directions
        return centers, self.distances(centers)

    @cached_property
    def thickness(self) -> float:
        """Diameter of the largest ball inside; 0 for a sheet."""
        return 2.0 * float(self.medial_balls[1].max())

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates, (3,) each."""
        return self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))

    def placed(self, points: FloatArray) -> FloatArray:
        """Return points (q, 3) of the link's frame, in metres, at diagonal 1."""
        return (points - self.middle) / self.scale


def spread(low: FloatArray, high: FloatArray, count: int) -> FloatArray:
    """Return points spread evenly over a box, (count, 3), by irrational steps."""
    steps = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])
    return np.asarray(low + (np.arange(1, count + 1)[:, None] * steps % 1.0) * (high - low))
