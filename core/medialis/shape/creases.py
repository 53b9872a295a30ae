"""Creases: where a mesh is meant to bend, as against facets of a smooth surface (for thesis 3.2).

A mesh stands for a smooth surface through its vertices that is broken along creases, the edges
where it bends by more than an angle. Round a vertex, creases part the faces into sectors. The
normal of the smooth surface at a corner of a face is that of the sector that the corner is in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import next_side, sums_of, unit_rows
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.cylinders import corner_normals
from medialis.shape.planes import only_plane, plane_normals
from medialis.shape.rulings import find_mitres, find_rulings
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface, piece_labels

STEEPER = 1e-4  # halved < 0.1 %, doubled 0.1 %
"""Cosine: more than rounding makes of one angle."""

LEAST_BEND = 1e-4  # halved 0 %, doubled 0 %
"""Radians: what rounding bends a plane that is cut into triangles, at most; three chords of a right
angle bend by 30 degrees, and are all smooth."""

FACES_A_CHUNK = 16384


@dataclass(frozen=True, eq=False)
class Creases:
    """The creases of a mesh and the normals beside them.

    Attributes
    ----------
    shape : Shape
    angle : float
        Degrees: edges that bend by more are creases.
    corners : (c,) int64
        The corners 3 f + j of faces at vertices with creases, ascending.
    sector : (c,) int32
        The sector of each of them, numbered through.
    normals : (s, 3) float64
        Unit normal of each sector: that of the vertex where there is but one, else the mean of its
        faces, weighted by angle; zero where these have no area.
    vertices : (s,) int32
        Vertex of each sector.
    pairs : (p, 2) int32
        Sectors of the same vertex on both sides of a crease, each pair once.
    concave : (p,) bool
        Whether the surface bends inward there.
    half_edges : (e, 2) int64
        The two half-edges 3 f + j of each crease.
    inward : (e,) bool
        Whether the surface bends inward there.
    """

    shape: Shape
    angle: float
    corners: NDArray[np.int64]
    sector: IntArray
    normals: FloatArray
    vertices: IntArray
    pairs: IntArray
    concave: NDArray[np.bool_]
    half_edges: NDArray[np.int64]
    inward: NDArray[np.bool_]

    def regions(self, sign: int) -> IntArray:
        """Return the region of each face, (m,): regions end at the creases that part sheets.

        Those are convex as seen from the side of the balls: `sign` is +1 for balls inside, -1 for
        those outside. Over the others a contact moves smoothly from face to face.
        """
        first, second, _ = self.shape.edge_table.pairs
        parting = np.zeros(3 * self.shape.face_count, np.bool_)
        parting[self.half_edges[self.inward == (sign < 0)]] = True
        joined = ~parting[first]
        links = np.stack([first[joined], second[joined]], axis=1) // 3
        return piece_labels(self.shape.face_count, links)

    @cached_property
    def least_cosines(self) -> FloatArray:
        """Smallest cosine of the angles between each face and the normals at its corners, (m,).

        The smooth surface over a face bulges by what these angles tell. At a crease the largest
        angle at the vertex counts for all of its corners: where one side is round, the crease is a
        curve and bulges over its edges, also over those of a flat side. 1 at a corner without a
        normal; 0 where a face has no area, and never less.
        """
        return self._measured()[1]

    @property
    def own_bulges(self) -> FloatArray:
        """How far the smooth surface bulges over the sides of each face, (m, 3), as a length.

        With the slopes s_i and s_j of the surface against the side at its ends, by the normals
        there, b is the length of the side times their harmonic mean: the radius of curvature is the
        mean of those at the ends. The surface over the place sum w_i v_i lies the sum of w_i w_j b
        outward. 0 where the surface bends to both sides, or an end has no normal. Computed each
        time: they are large, and asked for once.
        """
        return self._measured()[0]

    def _measured(self) -> tuple[NDArray[np.float64], FloatArray]:
        """Compute bulges and least cosines in one pass; these are kept, those are not."""
        from medialis.shape._kernels import CreasedMesh, bulge_faces

        shape = self.shape
        mesh = CreasedMesh(
            shape.points, shape.normals, np.asarray(shape.faces), shape.face_normals,
            self.corners, self.sector, self.normals, self.smoothness,
        )  # fmt: skip
        bulges, cosines = np.empty((shape.face_count, 3)), np.empty(shape.face_count)
        run_chunks(bulge_faces, shape.face_count, FACES_A_CHUNK, mesh, bulges, cosines)
        if shape.planes is not None:
            bulges[shape.planes >= 0] = 0.0
        self.__dict__["least_cosines"] = frozen(cosines, np.float64)
        return bulges, self.least_cosines

    def corner_normals(self, faces: NDArray[np.int64]) -> FloatArray:
        """Return the normals of the smooth surface at the corners of some faces, (f, 3, 3)."""
        normals = self.shape.normals[np.asarray(self.shape.faces)[faces]]
        corners = 3 * faces[:, None] + np.arange(3)
        place = np.searchsorted(self.corners, corners)
        place[place == len(self.corners)] = 0
        if len(self.corners):
            mine = self.corners[place] == corners
            normals[mine] = self.normals[self.sector[place[mine]]]
        if self.shape.planes is not None:
            plane = self.shape.planes[faces]
            flat = plane_normals(self.shape, self.shape.planes)[plane[plane >= 0]]
            normals[plane >= 0] = flat[:, None]
        return np.asarray(normals)

    @property
    def bulges(self) -> FloatArray:
        """`own_bulges`; at a crease both faces have the larger one: it may be round on one side."""
        bulges = self._measured()[0]
        result = bulges.ravel()
        first, second = self.half_edges.T
        one, other = result[first], result[second]
        result[first] = result[second] = np.where(np.abs(one) < np.abs(other), other, one)
        return bulges

    @cached_property
    def smoothness(self) -> FloatArray:
        """Cosine of the largest angle between faces and sectors at a vertex, (n,); 1 elsewhere."""
        shape, face = self.shape, self.corners // 3
        cosine = np.einsum("fa,fa->f", self.normals[self.sector], shape.face_normals[face])
        vertex = np.asarray(shape.faces).ravel()[self.corners]
        result = np.ones(shape.point_count)
        np.minimum.at(result, vertex, np.where(shape.face_areas[face] > 0, cosine, 1.0))
        return frozen(result, np.float64)

    def cut_vertices(self, sign: int) -> IntArray:
        """Return the vertices at creases whose tangent balls cut a face, however small they are.

        Seen from a center on the line of the mean normal, the nearest place of the corner of a face
        is not the vertex: it is further along a side or inside, and more inclined than the smooth
        surface over the face explains. `sign` is +1 for balls inside, -1 for those outside.
        """
        from medialis.shape._kernels import mark_cut

        shape, cut = self.shape, np.zeros(self.shape.point_count, np.bool_)
        mesh = shape.points, shape.normals, np.asarray(shape.faces), shape.face_normals
        mark_cut(*mesh, self.corners, self.least_cosines, STEEPER, float(sign), cut)
        return frozen(np.flatnonzero(cut), np.int32)


def find_creases(shape: Shape, angle: float) -> Creases:
    """Find the edges where a mesh bends by more than an angle, and the sectors beside them.

    Parameters
    ----------
    shape : Shape
        A mesh.
    angle : float
        Degrees. 0: every edge that bends is a crease; 180: none is.

    Notes
    -----
    Borders, and edges of more than two faces, are no creases. Cost O(m), and what lies at creases.
    """
    first, second, bent = crease_edges(shape, angle)
    if shape.planes is not None and angle < 180.0:
        opposite = shape.edge_table.pairs[2]
        bent = bent | find_mitres(shape, shape.planes)[opposite]
    first, second = first[bent], second[bent]
    flat = shape.topology.faces.ravel()
    touched = np.zeros(shape.point_count, np.bool_)
    touched[flat[first]] = touched[flat[next_side(first)]] = True
    corners = np.flatnonzero(touched.take(flat))
    row = np.full(len(flat), -1, np.int32)
    row[corners] = np.arange(len(corners))
    parted = np.concatenate([first, second])
    sector = piece_labels(len(corners), _links_within_sectors(shape, corners, parted, row))
    count = int(sector.max(initial=-1)) + 1
    vertices = np.zeros(count, np.int32)
    vertices[sector] = flat[corners]
    normals = _sector_normals(shape, corners, sector, vertices, angle)
    # Side h of one face runs from u to v, its twin from v to u: the corners that lie together.
    left = np.concatenate([row[first], row[next_side(first)]])
    right = np.concatenate([row[next_side(second)], row[second]])
    pairs = np.sort(np.stack([sector[left], sector[right]], axis=1), axis=1).reshape(-1, 2)
    bent_inward = bends_inward(shape, first, second)
    inward = np.tile(bent_inward, 2)
    apart = pairs[:, 0] != pairs[:, 1]
    # As one number each: numpy compares rows ten times as slowly.
    keys, which = np.unique(pairs[apart] @ np.array([count, 1]), return_inverse=True)
    pairs = np.stack(np.divmod(keys, max(count, 1)), axis=1)
    concave = np.zeros(len(pairs), np.bool_)
    concave[which[inward[apart]]] = True
    return Creases(
        shape,
        angle,
        corners,
        frozen(sector, np.int32),
        frozen(normals, np.float64),
        frozen(vertices, np.int32),
        frozen(pairs, np.int32),
        concave,
        frozen(np.stack([first, second], axis=1), np.int64),
        frozen(bent_inward, np.bool_),
    )


def crease_edges(surface: Surface, angle: float) -> tuple[IntArray, IntArray, NDArray[np.bool_]]:
    """Return the two half-edges of each edge between two faces, and whether it is a crease."""
    first, second, opposite = surface.edge_table.pairs
    bent = surface.edge_bends > math.radians(angle) + LEAST_BEND
    if opposite.all():
        return first, second, bent
    return first[opposite], second[opposite], bent[opposite]


def _links_within_sectors(
    shape: Shape, corners: NDArray[np.int64], parted: NDArray[np.int64], row: IntArray
) -> NDArray[np.int64]:
    """Return pairs of corners (rows) at the same vertex on both sides of smooth edges."""
    twin = shape.edge_twins[corners].astype(np.int64)
    smooth = twin >= 0
    smooth[row[parted[row[parted] >= 0]]] = False
    here, there = corners[smooth], next_side(twin[smooth])
    flat = np.asarray(shape.faces).ravel()
    opposite = flat[here] == flat[there]  # else both half-edges run the same way
    return np.stack([row[here[opposite]], row[there[opposite]]], axis=1).astype(np.int64)


def _sector_normals(
    shape: Shape,
    corners: NDArray[np.int64],
    sector: IntArray,
    vertices: IntArray,
    angle: float,
) -> NDArray[np.float64]:
    """Return the normals of sectors; `vertices` are those that they are at."""
    count = len(vertices)
    if count == 0:
        return np.empty((0, 3))
    assert shape.faces is not None
    face, corner = np.divmod(corners, 3)
    points = shape.points[shape.faces[face]] / (shape.diagonal or 1.0)
    rows = np.arange(len(face))
    tip, left, right = (points[rows, (corner + step) % 3] for step in range(3))
    cross = np.linalg.norm(np.cross(left - tip, right - tip), axis=1)
    weight = np.arctan2(cross, np.einsum("ij,ij->i", left - tip, right - tip))
    total = sums_of(sector, weight[:, None] * shape.face_normals[face], count)
    result = unit_rows(total, 1e-12)
    alone = np.bincount(vertices, minlength=shape.point_count)[vertices] == 1
    result[alone] = shape.normals[vertices[alone]]
    if shape.planes is not None:
        rulings = find_rulings(shape, shape.planes, math.radians(angle) + LEAST_BEND)
        side = np.concatenate([rulings.sides, next_side(rulings.sides)])
        place = np.minimum(np.searchsorted(corners, side), len(corners) - 1)
        mine = np.flatnonzero(corners[place] == side)
        own = sector[place[mine]]
        single = np.bincount(own, minlength=count)[own] == 1
        result[own[single]] = rulings.normals[mine[single] % len(rulings.sides)]
        if shape.cylinders is not None:
            result = corner_normals(result, vertices, face, sector, shape, shape.cylinders)
        plane = only_plane(sector, shape.planes[face], count)
        flat = np.flatnonzero(plane >= 0)
        result[flat] = plane_normals(shape, shape.planes)[plane[flat]]
    return result


def bends_inward(
    shape: Shape, first: NDArray[np.integer[Any]], second: NDArray[np.integer[Any]]
) -> NDArray[np.bool_]:
    """Tell the edges whose second face lies in front of the first one."""
    flat = np.asarray(shape.faces).ravel()
    tip = shape.points[flat[next_side(next_side(second))]]
    ahead = np.einsum("ij,ij->i", tip - shape.points[flat[first]], shape.face_normals[first // 3])
    return np.asarray(ahead > 0)
