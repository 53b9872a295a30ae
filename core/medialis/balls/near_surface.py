"""The triangles of a mesh near some balls: nearest places, and on which side of them one is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from medialis.model.shape import Shape
from medialis.validation import FloatArray, IntArray

if TYPE_CHECKING:
    from medialis._kernels.nearest import NearestTree

BOUNDS = 1e-6
"""Fraction of the diagonal: the float32 bounds of a tree are good to less."""


@dataclass(frozen=True, eq=False)
class NearSurface:
    """The triangles that may reach into some balls.

    Attributes
    ----------
    shape : Shape
        The mesh.
    faces : (m, 3) int32
        Those of its triangles that are near.
    welded : (m, 3) int32
        The same with one vertex for each place, the lowest, so that seams are no borders.
    vertex : (n,) int32
        That vertex of each vertex.
    tree : NearestTree
    """

    shape: Shape
    faces: IntArray
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
        longest = 0.0
        for corner in range(3):
            side = points[faces[:, corner]] - points[faces[:, corner - 1]]
            longest = max(longest, math.sqrt(np.einsum("ij,ij->i", side, side).max()))
        reach = longest + BOUNDS * shape.diagonal
        distance, _ = NearestTree.of_balls(centers, radii).distances(points, enough=reach)
        near = (distance < reach)[faces].any(axis=1)
        faces = faces[near] if near.any() else faces
        used = np.unique(faces)
        _, first, again = np.unique(points[used], axis=0, return_index=True, return_inverse=True)
        vertex = np.arange(shape.point_count, dtype=np.int32)
        vertex[used] = used[first[again.ravel()]]
        welded = vertex[faces]
        return cls(shape, faces, welded, vertex, NearestTree.of_triangles(points, welded))

    def places(
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

    def at(self, face: IntArray, weights: FloatArray) -> FloatArray:
        """Return places given by face and barycentric coordinates, (q, 3)."""
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
        _, face, weights = self.places(queries)
        normals = self._face_normals[face]
        corners = (weights > 0).sum(axis=1)
        at_edge, at_vertex = np.flatnonzero(corners == 2), np.flatnonzero(corners == 1)
        edge, edge_normals = self._edges
        normals[at_edge] = edge_normals[edge[face[at_edge], weights[at_edge].argmin(axis=1)]]
        named = self.welded[face[at_vertex], weights[at_vertex].argmax(axis=1)]
        normals[at_vertex] = self.shape.normals[named]
        spoke = queries - self.at(face, weights)
        return np.asarray(np.einsum("ij,ij->i", spoke, normals) > 0), face

    @cached_property
    def _face_normals(self) -> FloatArray:
        """Unit normals of the faces, (m, 3); zero without an area."""
        corners = self.shape.points[self.faces] / self.shape.diagonal  # keeps squares in range
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)

    @cached_property
    def _edges(self) -> tuple[IntArray, FloatArray]:
        """Edge opposite of each corner, (m, 3), and sums of the normals of its faces; borders 0."""
        ends = np.sort(self.welded[:, [[1, 2], [2, 0], [0, 1]]], axis=2).astype(np.int64)
        keys = ends[..., 0] * self.shape.point_count + ends[..., 1]
        _, edge, uses = np.unique(keys, return_inverse=True, return_counts=True)
        edge = edge.reshape(keys.shape)
        normals = np.zeros((len(uses), 3))
        for corner in range(3):
            np.add.at(normals, edge[:, corner], self._face_normals)
        normals[uses < 2] = 0.0
        return edge, normals
