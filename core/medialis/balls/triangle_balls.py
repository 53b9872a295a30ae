"""Balls of a mesh that its triangles constrain, not its samples alone (thesis 3.2).

Between samples, balls that only samples constrain poke out of the surface. What counts as surface
is said in `surface/creases.py`; how a triangle constrains a ball, in `_triangle_kernels.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from medialis.balls.ball_shrinking import SAMPLES_A_CHUNK, shrink_options
from medialis.model.medial_cloud import BallStatus, MedialCloud
from medialis.model.shape import Shape
from medialis.model.surface import Surface
from medialis.progress import Progress
from medialis.surface.creases import Creases
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray

if TYPE_CHECKING:
    from medialis._kernels.box_tree import BoxTree

BLOCKS_A_CHUNK, NODES_A_CHUNK = 1024, 64

ROUNDING = 1e-10
"""Fraction of the diagonal: a place less deep than this in a ball is on it."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The triangles of a mesh as what constrains balls, hung on the tree of its samples.

    Attributes
    ----------
    creases : Creases
        Of the mesh.
    tree : BoxTree
        Of the samples.
    faces : (16 b,) int32
        Faces in blocks of 16, those of each leaf in blocks of their own; -1 where a slot is left.
    first : (leaves + 1,) int64
        Where the blocks of each leaf start.
    corners : (16 b, 3) int32
        Their corners as samples in tree order.
    reliefs : (16 b, 4) float64
        Bulges of their sides, and the smallest cosine at their corners (see `Creases`).
    hulls : (b, 8, 16) float32
        Disc or cylinder round each face.
    bounds : (nodes, 11, 8) float32
        As those of the tree, round faces.
    """

    creases: Creases
    tree: BoxTree
    faces: IntArray
    first: NDArray[np.int64]
    corners: IntArray
    reliefs: FloatArray
    hulls: NDArray[np.float32]
    bounds: NDArray[np.float32]

    @classmethod
    def of(cls, creases: Creases, tree: BoxTree) -> Walls:
        """Hang the triangles of a mesh on the tree of its samples. Cost O(m), parallel."""
        from medialis._kernels.box_tree import wide_levels
        from medialis.balls._triangle_kernels import (
            BLOCK,
            ROWS,
            bound_faces,
            count_blocks,
            fill_blocks,
            fill_hulls,
        )

        shape, place = creases.shape, tree.place
        n, m, depth = shape.point_count, shape.face_count, tree.depth
        faces = np.asarray(shape.faces)
        leaf, first = np.empty(m, np.int32), np.zeros((1 << depth) + 1, np.int64)
        count_blocks(faces, place, n, depth, leaf, first)
        blocks = int(first[-1])
        order = np.full(BLOCK * blocks, -1, np.int32)
        fill_blocks(leaf, first, order)
        corners = np.empty((len(order), 3), np.int32)
        hulls = np.empty((blocks, ROWS, BLOCK), np.float32)
        reliefs, unit = np.empty((len(order), 4)), shrink_options(shape.diagonal, 0.0, 0.0).unit
        bulges, cosines = creases.bulges, creases.least_cosines

        def fill(begin: int, end: int) -> None:
            fill_hulls(
                begin, end, order, faces, place, tree.points, bulges, cosines, unit,
                corners, reliefs, hulls,
            )  # fmt: skip

        run_chunks(fill, blocks, BLOCKS_A_CHUNK)
        bounds = np.empty_like(tree.bounds)
        bounds[:, :3], bounds[:, 3:6], bounds[:, 6:9], bounds[:, 9:] = np.inf, -np.inf, 0.0, np.inf
        for nodes, child_depth, fan in wide_levels(len(tree.child), depth):

            def bound(
                begin: int, end: int, at: slice = nodes, d: int = child_depth, f: int = fan
            ) -> None:
                bound_faces(tree.points, corners, first, d, depth, f, begin, end, bounds[at])

            run_chunks(bound, nodes.stop - nodes.start, NODES_A_CHUNK)
        return cls(creases, tree, order, first, corners, reliefs, hulls, bounds)

    @property
    def shape(self) -> Shape:
        """The mesh."""
        return self.creases.shape

    def room(self, centers: FloatArray, most: FloatArray) -> NDArray[np.float64]:
        """Return how far places (k, 3) are from the nearest triangle, but at most `most` (k,)."""
        from medialis.balls._triangle_kernels import measure_room

        lengths = shrink_options(self.shape.diagonal, 0.0, 0.0)
        places = centers / lengths.unit - self.tree.center
        radii = most / lengths.unit

        def work(begin: int, end: int) -> None:
            measure_room(
                begin, end, places, lengths.margin, self.tree.points, self.bounds,
                self.tree.child, self.first, self.corners, self.hulls, radii,
            )  # fmt: skip

        run_chunks(work, len(places), SAMPLES_A_CHUNK)
        radii *= lengths.unit
        return radii

    def constrain(
        self,
        cloud: MedialCloud,
        tolerance: float,
        progress: Progress,
        *,
        directions: FloatArray | None = None,
    ) -> MedialCloud:
        """Shrink balls until no triangle lies deeper in them than it may.

        Parameters
        ----------
        cloud : MedialCloud
            k balls of this shape.
        tolerance : float
            Fraction of the diagonal.
        progress : Progress
        directions : (k, 3) float64, optional
            From the center to the sample; else the outward normal there, turned for outer balls.
            Where it is given, the faces that meet at the sample constrain the ball too.

        Returns
        -------
        MedialCloud
            A ball that changed touches a face between its corners, or at one of them.
        """
        from medialis.balls._triangle_kernels import shrink_to_triangles

        tree, shape = self.tree, self.shape
        at_own = directions is not None
        samples = tree.place[cloud.source]
        # Neighbours share certificates; inner balls, the first, are the same with outer ones.
        order = _in_tree_order(cloud, tree)
        samples, signs = samples[order], cloud.side[order]
        if directions is None:
            direction = tree.normals[samples]
            direction *= signs[:, None]
        else:
            direction = np.ascontiguousarray(directions[order])
        largest = float(np.nanmax(cloud.radii, initial=0.0)) / shape.diagonal
        lengths = shrink_options(shape.diagonal, tolerance, largest)
        radii = cloud.radii[order] / lengths.unit
        face, places = np.full(len(order), -1, np.int64), np.zeros((len(order), 3))
        least = max(ROUNDING * shape.diagonal / lengths.unit, lengths.tolerance / 16)
        highest = math.sin(math.radians(min(self.creases.angle, 90.0))) ** 2 / 2

        def work(begin: int, end: int) -> None:
            shrink_to_triangles(
                begin, end, samples, direction, signs, at_own, lengths.tolerance,
                lengths.clearance, lengths.margin, least, highest, tree.points, self.bounds,
                tree.child, self.first, self.corners, self.reliefs, self.hulls, radii, face,
                places,
            )  # fmt: skip

        run_chunks(work, len(order), SAMPLES_A_CHUNK, progress=progress)
        touching = np.flatnonzero(face >= 0)
        rows = order[touching]
        radii = radii[touching] * lengths.unit
        faces, weights = self.faces[face[touching]], places[touching]
        return _touching_faces(cloud, rows, direction[touching], radii, faces, weights)


def _in_tree_order(cloud: MedialCloud, tree: BoxTree) -> NDArray[np.int64]:
    """Return the inner balls in the order of the tree, then the outer ones."""
    n, k = len(tree.order), len(cloud)
    if k % n == 0 and (cloud.source.reshape(-1, n) == np.arange(n)).all():
        return (n * np.arange(k // n)[:, None] + tree.order).ravel()
    return np.lexsort((tree.place[cloud.source], -cloud.side))


def _touching_faces(
    cloud: MedialCloud,
    rows: NDArray[np.int64],
    directions: FloatArray,
    radii: FloatArray,
    faces: IntArray,
    weights: FloatArray,
) -> MedialCloud:
    """Return a cloud whose balls in some rows are tangent to their sample and touch a face."""
    surface = cloud.surface
    corners = np.asarray(surface.faces)[faces]
    own = surface.points[cloud.source[rows]]
    contact = np.einsum("ij,ija->ia", weights, surface.points[corners])
    second = corners[np.arange(len(rows)), _nearest_corner(surface, corners, contact)]
    centers = own - radii[:, None] * directions
    return cloud.with_rows(
        rows,
        centers=centers,
        radii=radii,
        features=np.stack([cloud.source[rows], second], axis=1),
        status=np.full(len(rows), BallStatus.OK),
        spoke_angles=_angles(directions, contact - centers),
        contact_faces=faces,
        contact_weights=weights,
    )


def _nearest_corner(surface: Surface, corners: IntArray, places: FloatArray) -> NDArray[np.int64]:
    apart = np.linalg.norm(surface.points[corners] - places[:, None], axis=2)
    return np.asarray(apart.argmin(axis=1))


def _angles(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the angle between vectors, row by row, in radians."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(across, np.einsum("ij,ij->i", one, other))
