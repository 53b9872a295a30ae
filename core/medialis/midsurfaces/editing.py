"""A triangle mesh that is changed in place: cut, refined and coarsened (see `_edit_kernels`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.midsurfaces import _edit_kernels as kernels
from medialis.midsurfaces._remesh_kernels import keeps_sides
from medialis.model.topology import Topology
from medialis.validation import FloatArray, IntArray

ROOM = 256
"""Half-edges more than four times those of any vertex at first: no collapse gives one more."""


class EditMesh:
    """Triangles that can be changed; vertices where fans of faces only touch are taken apart.

    Parameters
    ----------
    points : (n, 3) float64
    faces : (m, 3) int
    tags : (m,) int32
        Handed on to what becomes of a face.
    """

    def __init__(self, points: FloatArray, faces: NDArray[Any], tags: IntArray) -> None:
        topology = Topology(np.ascontiguousarray(faces, np.int32), len(points))
        fans = topology.corner_fans()
        first = np.unique(fans, return_index=True)[1]
        number = np.searchsorted(np.sort(fans[first]), fans)
        n, m = len(first), len(faces)
        self.sizes = np.array([n, m], np.int64)
        self.points = np.empty((n, 3))
        self.points[number] = points[np.asarray(topology.faces).ravel()]
        self.faces = number.reshape(-1, 3).astype(np.int32)
        self.twins = np.array(topology.edge_twins, np.int64)
        self.marks = np.zeros(3 * m, np.int32)
        self.tags = np.array(tags, np.int32)
        self.leaving = np.full(n, -1, np.int64)
        self.leaving[self.faces.ravel()] = np.arange(3 * m)
        most = 4 * int(np.bincount(self.faces.ravel(), minlength=1).max()) + ROOM
        self.ring, self.other = np.empty(most, np.int64), np.empty(most, np.int64)

    @property
    def vertex_count(self) -> int:
        """Vertices so far, those without faces included."""
        return int(self.sizes[0])

    @property
    def face_count(self) -> int:
        """Faces so far, those that are gone included."""
        return int(self.sizes[1])

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Which faces are there, (f,)."""
        return np.asarray(self.faces[: self.face_count, 0] >= 0)

    def half_edges(self) -> tuple[NDArray[np.int64], IntArray, IntArray]:
        """Return the half-edges of all faces, one for each edge, and their ends."""
        count = 3 * self.face_count
        h = np.arange(count)
        twin = self.twins[:count]
        there = np.repeat(self.alive, 3) & ((twin < 0) | (h < twin))
        rows = h[there]
        corners = self.faces[: self.face_count]
        return rows, corners[rows // 3, rows % 3], corners[rows // 3, (rows + 1) % 3]

    def reserve(self, vertices: int, faces: int) -> None:
        """Make room for so many more."""
        for name, more, used in (
            ("points", vertices, 0), ("leaving", vertices, 0),
            ("faces", faces, 1), ("tags", faces, 1),
            ("twins", 3 * faces, 2), ("marks", 3 * faces, 2),
        ):  # fmt: skip
            old = getattr(self, name)
            need = (self.vertex_count, self.face_count, 3 * self.face_count)[used] + more
            if need <= len(old):
                continue
            room = np.full((max(need, 2 * len(old)), *old.shape[1:]), -1, old.dtype)
            room[: len(old)] = old
            setattr(self, name, room)

    def split(self, h: int, place: FloatArray) -> int:
        """Put a vertex on an edge and return its number."""
        a, b = (np.array([v], np.int32) for v in (self.start(h), self.end(h)))
        return int(self.split_between(a, b, place[None])[0])

    def split_between(
        self, a: NDArray[np.int32], b: NDArray[np.int32], places: FloatArray
    ) -> NDArray[np.int64]:
        """Put vertices on the edges between pairs of vertices; -1 where there is no such edge."""
        self.reserve(len(a), 2 * len(a))
        result = np.empty(len(a), np.int64)
        kernels.split_edges(
            self.points, self.faces, self.twins, self.marks, self.tags, self.leaving, self.sizes,
            a, b, np.ascontiguousarray(places), self.ring, result,
        )  # fmt: skip
        return result

    def split_face(self, f: int, place: FloatArray) -> int:
        """Put a vertex into a face and return its number."""
        self.reserve(1, 2)
        return int(
            kernels.split_face(
                self.points, self.faces, self.twins, self.marks, self.tags, self.leaving,
                self.sizes, f, place[0], place[1], place[2],
            )
        )  # fmt: skip

    def leaving_edges(self, v: int) -> tuple[NDArray[np.int64], bool]:
        """Return the half-edges that leave a vertex, and whether it lies on the border."""
        count = kernels.around(self.faces, self.twins, self.leaving, v, self.ring)
        return self.ring[: abs(count)].copy(), count < 0

    def may_move(self, v: int, place: FloatArray) -> bool:
        """Tell whether no face around a vertex would fold over when it moves to a place."""
        count = kernels.around(self.faces, self.twins, self.leaving, v, self.ring)
        x, y, z = (float(value) for value in place)
        return bool(
            keeps_sides(self.points, self.faces, self.ring, abs(count), v, -1, x, y, z, 0.3)
        )

    def mark(self, h: int, mark: int) -> None:
        """Draw along an edge."""
        self.marks[h] = mark
        if self.twins[h] >= 0:
            self.marks[self.twins[h]] = mark

    def end(self, h: int) -> int:
        """Return the vertex that a half-edge leads to."""
        return int(self.faces[h // 3, (h + 1) % 3])

    def start(self, h: int) -> int:
        """Return the vertex that a half-edge leaves."""
        return int(self.faces[h // 3, h % 3])

    def edge_between(self, a: int, b: int) -> int:
        """Return a half-edge from a to b, or from b to a; -1: there is none."""
        return int(kernels.find_edge(self.faces, self.twins, self.leaving, a, b, self.ring))

    def without(self, gone: NDArray[np.bool_]) -> EditMesh:
        """Return a mesh without some faces (f,) and those that are gone already, and its marks."""
        rows = np.flatnonzero(self.alive & ~gone)
        used, faces = np.unique(self.faces[rows], return_inverse=True)
        new = EditMesh(self.points[used], faces.reshape(-1, 3), self.tags[rows])
        new.marks = self.marks[(3 * rows[:, None] + np.arange(3)).ravel()].copy()
        return new
