"""Triangle meshes that are changed in place, and even triangles on a sheet with fixed curves.

`EditMesh` is cut, refined and coarsened by kernels. `remesh` splits, collapses, flips and smooths
in rounds (Botsch and Kobbelt 2004), and keeps vertices on the sheet.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Mask
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.surface import Topology
from medialis.walls.midsurface import _kernels as kernels
from medialis.walls.midsurface._kernels import FREE, SAME_SIDE, Mesh
from medialis.walls.midsurface.sides import RawSheet

ROUNDS = 12  # halved 0.2 %, doubled 0.2 %
"""Of splitting, collapsing, flipping and smoothing; the angles change little after eight."""

LONG, SHORT = 4 / 3, 4 / 5  # halved 77 %, doubled 58 %; halved 55 %, doubled 1 %
"""Edge lengths, as shares of the one wished for, from which on edges are split or collapsed:
halves of a split edge are not collapsed again (Botsch and Kobbelt 2004)."""

# halved < 0.1 %, doubled 0 %; halved 7 %, doubled 2 %; halved 2 %, doubled 4 %
MOST_FLIPS, MOST_COLLAPSES, SMOOTHINGS = 8, 3, 2
"""Passes in a round."""

ROOM = 256  # halved 0 %, doubled 0 %
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
        self.faces = number.reshape(-1, 3).astype(np.int64)
        self.twins = np.array(topology.edge_twins, np.int64)
        self.marks = np.zeros(3 * m, np.int32)
        self.tags = np.array(tags, np.int32)
        self.leaving = np.full(n, -1, np.int64)
        self.leaving[self.faces.ravel()] = np.arange(3 * m)
        most = 4 * int(np.bincount(self.faces.ravel(), minlength=1).max()) + ROOM
        self.ring, self.other = np.empty(most, np.int64), np.empty(most, np.int64)

    @property
    def arrays(self) -> Mesh:
        """What kernels change."""
        return Mesh(*(getattr(self, name) for name in Mesh._fields))

    @property
    def vertex_count(self) -> int:
        """Vertices so far, those without faces included."""
        return int(self.sizes[0])

    @property
    def face_count(self) -> int:
        """Faces so far, those that are gone included."""
        return int(self.sizes[1])

    @property
    def alive(self) -> Mask:
        """Which faces are there, (f,)."""
        return np.asarray(self.faces[: self.face_count, 0] >= 0)

    def half_edges(self) -> tuple[Index, Index, Index]:
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
        more_vertices, more_faces = self.vertex_count + vertices, self.face_count + faces
        for names, need in (
            (("points", "leaving"), more_vertices),
            (("faces", "tags"), more_faces),
            (("twins", "marks"), 3 * more_faces),
        ):
            for name in names:
                old = getattr(self, name)
                if need <= len(old):
                    continue
                room = np.full((max(need, 2 * len(old)), *old.shape[1:]), -1, old.dtype)
                room[: len(old)] = old
                setattr(self, name, room)

    def split(self, a: int, b: int, place: FloatArray) -> int:
        """Put a vertex on the edge between two others and return its number."""
        return int(self.split_between(np.array([a]), np.array([b]), place[None])[0])

    def split_between(self, a: Index, b: Index, places: FloatArray) -> Index:
        """Put vertices on the edges between pairs of vertices; -1 where there is no such edge."""
        self.reserve(len(a), 2 * len(a))
        result = np.empty(len(a), np.int64)
        kernels.split_edges(self.arrays, a, b, np.ascontiguousarray(places), result)
        return result

    def split_face(self, f: int, place: FloatArray) -> int:
        """Put a vertex into a face and return its number."""
        self.reserve(1, 2)
        return int(kernels.split_face(self.arrays, f, place[0], place[1], place[2]))

    def leaving_edges(self, v: int) -> tuple[Index, bool]:
        """Return the half-edges that leave a vertex, and whether it lies on the border."""
        count = kernels.around(self.arrays, v, self.ring)
        return self.ring[: abs(count)].copy(), count < 0

    def may_move(self, v: int, place: FloatArray) -> bool:
        """Tell whether no face around a vertex would fold over when it moves to a place."""
        count = kernels.around(self.arrays, v, self.ring)
        moved = float(place[0]), float(place[1]), float(place[2])
        return bool(kernels.keeps_sides(self.arrays, abs(count), v, -1, moved, SAME_SIDE))

    def mark(self, h: int, mark: int) -> None:
        """Draw along an edge."""
        self.marks[h] = mark
        if self.twins[h] >= 0:
            self.marks[self.twins[h]] = mark

    def end(self, h: int) -> int:
        """Return the vertex that a half-edge leads to."""
        return int(self.faces[h // 3, (h + 1) % 3])

    def edge_between(self, a: int, b: int) -> int:
        """Return a half-edge from a to b, or from b to a; -1: there is none."""
        return int(kernels.find_edge(self.arrays, a, b))

    def without(self, gone: Mask) -> EditMesh:
        """Return a mesh without some faces (f,) and those that are gone already, and its marks."""
        rows = np.flatnonzero(self.alive & ~gone)
        used, faces = np.unique(self.faces[rows], return_inverse=True)
        new = EditMesh(self.points[used], faces.reshape(-1, 3), self.tags[rows])
        new.marks = self.marks[(3 * rows[:, None] + np.arange(3)).ravel()].copy()
        return new


def remesh(
    mesh: EditMesh, kind: NDArray[np.int8], raw: RawSheet, edge: float, progress: Progress
) -> None:
    """Make the triangles of a sheet even, with edges of about one length.

    Parameters
    ----------
    mesh : EditMesh
        Changed in place; its curves are the border and the marked edges.
    kind : (n,) int8
        FREE, SLIDING or FIXED for each vertex.
    raw : RawSheet
        The sheet that vertices are kept on.
    edge : float
        The length wished for, in the units of the shape.
    """
    for turn in range(ROUNDS):
        progress.update(turn / ROUNDS)
        last = turn == ROUNDS - 1
        if not last:
            kind = _split(mesh, kind, LONG * edge)
            lengths = SHORT * edge, LONG * edge
            _until_none(MOST_COLLAPSES, kernels.collapse_edges, mesh, kind, *lengths)
        _until_none(MOST_FLIPS, kernels.flip_edges, mesh)
        for _ in range(SMOOTHINGS):
            kernels.smooth_vertices(mesh.arrays, kind)
        _project(mesh, kind, raw)
        _until_none(MOST_FLIPS, kernels.flip_edges, mesh)


def _split(mesh: EditMesh, kind: NDArray[np.int8], longest: float) -> NDArray[np.int8]:
    most = 3 * mesh.face_count // 2 + 3
    a, b, places = np.empty(most, np.int64), np.empty(most, np.int64), np.empty((most, 3))
    count = kernels.find_long(mesh.arrays, longest, a, b, places)
    mesh.split_between(a[:count], b[:count], places[:count])
    return np.concatenate([kind, np.full(mesh.vertex_count - len(kind), FREE, np.int8)])


def _until_none(most: int, change: Callable[..., int], mesh: EditMesh, *how: Any) -> None:
    """Change edges again and again, until there is none to change."""
    for _ in range(most):
        if change(mesh.arrays, *how) == 0:
            return


def _project(mesh: EditMesh, kind: NDArray[np.int8], raw: RawSheet) -> None:
    used = (mesh.leaving[: mesh.vertex_count] >= 0) & (kind[: mesh.vertex_count] == FREE)
    rows = np.flatnonzero(used)
    if len(rows):
        mesh.points[rows] = raw.at(mesh.points[rows])[0]
