"""Balls that slipped between the samples of a wall, shrunk until its triangles touch them.

Where the samples of a wall are further apart than the wall is thick, a ball can grow through it and
touch a sample from the other side. There the triangles count, by the iteration of the thesis
(3.2.1, Algorithm 1) with the nearest place of the surface instead of the nearest sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.balls.hidden_walls import THINNEST, endless, in_closed_part, touches_from_outside
from medialis.model.medial_cloud import BallStatus, MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress, counted
from medialis.validation import FloatArray, IntArray

if TYPE_CHECKING:
    from medialis._kernels.nearest import NearestTree

BOUNDS = 1e-6
"""Fraction of the diagonal: the float32 bounds of a tree are good to less."""

ROUNDING = 1e-10
"""Fraction of the diagonal: a place less deep than this in a ball is on it."""


def shrink_to_triangles(cloud: MedialCloud, tolerance: float, progress: Progress) -> MedialCloud:
    """Shrink the inner balls of a mesh that touch a wall from its outside until none does.

    Parameters
    ----------
    cloud : MedialCloud
        k balls of n samples; row i < n belongs to sample i where there are inner balls. Nothing
        changes without faces.
    tolerance : float
        Fraction of the diagonal: how deep the surface may lie inside a ball.
    progress : Progress

    Returns
    -------
    MedialCloud
        A ball that changed still is the ball through its sample p, with its center c on the normal
        there. It touches the surface at a place q that is no sample: the spoke angle is that
        between p, c and q, and the second feature point is the corner nearest to q of the triangle
        that q lies on, so |f2 - c| may exceed the radius by the length of an edge.

    Notes
    -----
    The triangles that meet at p do not count: like samples nearer to p than the tolerance, they
    would shrink every ball at a convex edge to nothing.

    In a closed part, a center in front of the nearest place of the part lies outside: a wall
    thinner than the tolerance is in the ball. Then the tolerance is divided by 10 until it does
    not. Where no tolerance helps (parts that cross themselves, normals that point inward in a fold)
    the ball stays as it was with the first one.

    Cost: nothing for balls that touch a wall from its inside; about 10 us for each other one, and a
    tree over the triangles near them.

    Source: thesis 3.2.1, Algorithm 1. Deviates: triangles.
    """
    shape = cloud.surface
    rows = np.flatnonzero(touches_from_outside(cloud) | endless(cloud))
    if len(rows) == 0 or shape.face_count == 0:
        return cloud
    balls = _Balls(shape, rows, cloud.radii[rows])
    every = np.arange(len(rows))
    balls.shrink(every, tolerance * shape.diagonal)
    outside, finer = balls.outside(every), tolerance
    first = balls.state(outside)
    while len(outside) and finer > 0:
        finer = finer / 10 if finer > THINNEST else 0.0
        balls.shrink(outside, finer * shape.diagonal)
        still = balls.outside(outside)
        first = tuple(values[np.isin(outside, still)] for values in first)
        outside = still
    balls.set_state(outside, first)
    return _replaced(cloud, balls, progress)


def _replaced(cloud: MedialCloud, balls: _Balls, progress: Progress) -> MedialCloud:
    """Return the cloud with the balls that touch a triangle, and say how many."""
    changed = balls.nearest >= 0
    rows = balls.rows[changed]
    if len(rows) == 0:
        return cloud
    progress.note(
        f"{counted(len(rows), 'ball', of=balls.shape.point_count, verbs=('was', 'were'))} shrunk "
        "to fit into walls thinner than the spacing of their samples.",
        "slipped_balls",
        samples=len(rows),
        of=balls.shape.point_count,
    )
    return cloud.with_rows(
        rows,
        centers=balls.centers()[changed],
        radii=balls.radii[changed],
        features=np.stack([cloud.source[rows], balls.nearest[changed]], axis=1),
        status=np.full(len(rows), BallStatus.OK),
        spoke_angles=balls.spoke_angles()[changed],
    )


class _Balls:
    """Balls that shrink: their samples `rows`, `radii`, and where they touch the surface.

    `touched` is the place (NaN: not yet), `nearest` the nearest corner of its triangle (-1).
    """

    def __init__(self, shape: Shape, rows: NDArray[np.int64], radii: FloatArray) -> None:
        self.shape, self.rows, self.radii = shape, rows, np.array(radii)
        self.touched = np.full((len(rows), 3), np.nan)
        self.nearest = np.full(len(rows), -1, np.int32)
        self.surface = NearSurface.of(shape, self.centers(), radii)

    def centers(self) -> FloatArray:
        return self.shape.points[self.rows] - self.radii[:, None] * self.shape.normals[self.rows]

    def spoke_angles(self) -> FloatArray:
        spoke = np.linalg.norm(self.shape.points[self.rows] - self.touched, axis=1)
        return np.asarray(2.0 * np.arcsin(np.minimum(1.0, spoke / (2.0 * self.radii))))

    def shrink(self, which: NDArray[np.int64], tolerance: float) -> None:
        """Shrink some balls until no triangle lies deeper inside than the tolerance (a length).

        A ball that a place q lies in shrinks to the ball through q, so radii only fall, by half the
        tolerance at least. A ball that shrinks no more, as rounding decides where q is, is left.
        """
        rounding = 4 * np.finfo(np.float64).eps * float(np.abs(self.shape.points).max())
        least = max(tolerance, ROUNDING * self.shape.diagonal, rounding)
        while len(which):
            centers = self.centers()[which]
            distance, face, weights = self.surface.nearest(centers, without=self.rows[which])
            deep = distance < self.radii[which] - least
            which, face = which[deep], face[deep]
            place = self.surface.positions(face, weights[deep])
            p, normal = self.shape.points[self.rows[which]], self.shape.normals[self.rows[which]]
            across = p - place
            # |q - c| < r, so the denominator is above 0, but for rounding.
            along = np.maximum(np.einsum("ij,ij->i", across, normal), 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                radii = np.einsum("ij,ij->i", across, across) / (2.0 * along)
            less = radii < self.radii[which]
            which, face, place = which[less], face[less], place[less]
            self.radii[which] = radii[less]
            self.touched[which] = place
            corners = self.surface.faces[face]
            apart = np.linalg.norm(self.shape.points[corners] - place[:, None], axis=2)
            self.nearest[which] = corners[np.arange(len(which)), apart.argmin(axis=1)]

    def outside(self, which: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return those of some balls whose center lies outside the closed part of their sample."""
        front, faces = self.surface.in_front(self.centers()[which])
        which, corner = which[front], self.surface.faces[faces[front], 0]
        if len(which) == 0:  # parts take longer to find than all else
            return which
        part, rows = self.shape.components, self.rows[which]
        return which[(part[corner] == part[rows]) & in_closed_part(self.shape, rows)]

    def state(self, which: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
        """Return a copy of radii, touched places and nearest corners of some balls."""
        return self.radii[which], self.touched[which], self.nearest[which]

    def set_state(self, which: NDArray[np.int64], state: tuple[NDArray[Any], ...]) -> None:
        self.radii[which], self.touched[which], self.nearest[which] = state


@dataclass(frozen=True, eq=False)
class NearSurface:
    """The triangles that may reach into some balls.

    Attributes
    ----------
    shape : Shape
        The mesh.
    near : (m,) int
        Those of its triangles that are near.
    welded : (m, 3) int32
        Their corners, with one vertex for each place, the lowest, so that seams are no borders.
    vertex : (n,) int32
        That vertex of each vertex.
    tree : NearestTree
    """

    shape: Shape
    near: NDArray[np.int64]
    welded: IntArray
    vertex: IntArray
    tree: NearestTree

    @classmethod
    def of(cls, shape: Shape, centers: FloatArray, radii: FloatArray) -> NearSurface:
        """Choose the triangles near balls of a mesh; all of them where none is.

        A triangle that reaches into a ball has a corner within its longest side of it.
        """
        from medialis._kernels.nearest import NearestTree

        points, faces = shape.points, np.asarray(shape.faces)
        enough = float(shape.edge_lengths.max(initial=0.0)) + BOUNDS * shape.diagonal
        distance, _ = NearestTree.of_balls(centers, radii).distances(points, enough=enough)
        near = np.flatnonzero((distance < enough)[faces].any(axis=1))
        near = near if len(near) else np.arange(len(faces))
        faces = faces[near]
        used = np.unique(faces)
        _, first, again = np.unique(points[used], axis=0, return_index=True, return_inverse=True)
        vertex = np.arange(shape.point_count, dtype=np.int32)
        vertex[used] = used[first[again.ravel()]]
        welded = vertex[faces]
        return cls(shape, near, welded, vertex, NearestTree.of_triangles(points, welded))

    @cached_property
    def faces(self) -> IntArray:
        """Corners of the triangles, (m, 3)."""
        return np.asarray(self.shape.faces)[self.near]

    def nearest(
        self, queries: FloatArray, *, without: NDArray[np.int64] | None = None
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Find the nearest place of each point.

        Parameters
        ----------
        queries : (q, 3) float64
        without : (q,) int, optional
            A vertex for each point: triangles that meet there do not count.

        Returns
        -------
        distance : (q,) float64
            inf where no triangle counts.
        face : (q,) int32
            Row of `faces`.
        weights : (q, 3) float64
            Barycentric coordinates of the place.
        """
        from medialis._kernels.nearest import nearest_on_triangles

        left_out = None if without is None else self.vertex[without]
        distance, face = self.tree.distances(queries, without=left_out)
        corners = self.shape.points[self.faces[face]]
        return distance, face, nearest_on_triangles(queries, corners)

    def positions(self, face: IntArray, weights: FloatArray) -> FloatArray:
        """Return the points with these barycentric coordinates on some faces, (q, 3)."""
        return np.asarray(np.einsum("ij,ijk->ik", weights, self.shape.points[self.faces[face]]))

    def in_front(self, queries: FloatArray) -> tuple[NDArray[np.bool_], IntArray]:
        """Tell the points on the outer side of the place nearest to them, (q,), and its face.

        The normal there is that of the face, the sum of those of the two faces at an edge, or that
        of the vertex, which tell the sides of a closed surface (Baerentzen and Aanaes, Signed
        distance computation using the angle weighted pseudonormal, 2005). Where the place is at a
        border or has no normal, the answer is no.
        """
        if len(queries) == 0:
            return np.zeros(0, np.bool_), np.zeros(0, np.int32)
        _, face, weights = self.nearest(queries)
        normals = self.shape.face_normals[self.near[face]]
        corners = (weights > 0).sum(axis=1)
        at_edge, at_vertex = np.flatnonzero(corners == 2), np.flatnonzero(corners == 1)
        edge, edge_normals = self._edges
        normals[at_edge] = edge_normals[edge[face[at_edge], weights[at_edge].argmin(axis=1)]]
        named = self.welded[face[at_vertex], weights[at_vertex].argmax(axis=1)]
        normals[at_vertex] = self.shape.normals[named]
        spoke = queries - self.positions(face, weights)
        return np.asarray(np.einsum("ij,ij->i", spoke, normals) > 0), face

    @cached_property
    def _edges(self) -> tuple[IntArray, FloatArray]:
        """Edge opposite of each corner, (m, 3), and sums of the normals of its faces; borders 0."""
        ends = np.sort(self.welded[:, [[1, 2], [2, 0], [0, 1]]], axis=2).astype(np.int64)
        keys = ends[..., 0] * self.shape.point_count + ends[..., 1]
        _, edge, uses = np.unique(keys, return_inverse=True, return_counts=True)
        edge = edge.reshape(keys.shape)
        normals = np.zeros((len(uses), 3))
        for corner in range(3):
            np.add.at(normals, edge[:, corner], self.shape.face_normals[self.near])
        normals[uses < 2] = 0.0
        return edge, normals
