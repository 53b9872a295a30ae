"""Rulings: where what is rounded of a part is straight one way (for thesis 3.2).

Cylinders, cones and rounded edges are cut into needles, whose long sides lie on the surface: along
them it does not bend. Where such a strip goes over into a blend, facets beyond its end are far
shorter, and tell nothing of the strip. A smooth surface fitted through all of them would lean the
normals at its end, and bulge needles as long as the part. So a normal there is at right angles to
the ruling, that of the circle through the rulings beside it; and where two strips meet askew, as
rounded rims do in a corner, there is a crease, however little it bends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask, next_side, unit_rows
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.surface import Surface

NEEDLE = 4.0
"""A face so many times as long as it is high is ruled: its longest side, or the diagonal of two
such faces, leans by at most 14 degrees from where its surface is straight."""

ALONG = math.cos(math.atan(1.0 / NEEDLE))
"""Cosine of that angle."""

TURNS = math.cos(math.radians(30.0))
"""Straight directions that differ by more than two diagonals explain are not of one surface."""

LEAST_BEND = 1e-4
"""Radians: what rounding bends a plane that is cut into triangles, at most."""

RULED_PART = 0.5
"""Share of the surface that is ruled, in a part without flat faces: a pipe has 0.9 of it."""

SHORTER, BEYOND = 1 / 3, -0.5
"""Of a ruling: how long edges beyond its end may be, those within 60 degrees of its direction. Half
of an even mesh of needles is as long on both sides."""


@dataclass(frozen=True)
class Rulings:
    """Edges along which a surface is straight, between two needles each.

    Attributes
    ----------
    sides : (e,) int64
        Their first half-edges 3 f + j.
    ends : (e, 2) int64
    normals : (e, 3) float64
        Unit normals of the circles through the rulings on both sides.
    """

    sides: NDArray[np.int64]
    ends: NDArray[np.int64]
    normals: FloatArray


@dataclass(frozen=True)
class _Needles:
    """Edges between two needles that lie in no plane: rows of the pairs, and three directions.

    Attributes
    ----------
    rows : (e,) int64
    along, one, two : (e, 3) float64
        Of the edge, and the straight ones of both faces.
    """

    rows: NDArray[np.int64]
    along: FloatArray
    one: FloatArray
    two: FloatArray


def needles(surface: Surface, planes: IntArray) -> tuple[Mask, FloatArray]:
    """Tell the faces that are needles and in no plane, (m,), and the squares of longest sides."""
    from medialis.shape._kernels import find_needles

    needle, longest = np.empty(surface.face_count, np.bool_), np.empty(surface.face_count)
    mesh = surface.points, np.asarray(surface.faces), surface.face_areas, planes
    find_needles(*mesh, NEEDLE, needle, longest)
    return needle, longest


def _between_needles(surface: Surface, needle: Mask) -> _Needles:
    first, second, opposite = surface.edge_table.pairs
    rows = np.flatnonzero(needle[first // 3])  # few as a rule
    both = needle[second[rows] // 3] & opposite[rows] & (surface.edge_bends[rows] > LEAST_BEND)
    rows = rows[both]
    corners = [
        surface.points[np.asarray(surface.faces)[side[rows] // 3]] for side in (first, second)
    ]
    sides = [np.roll(places, -1, axis=1) - places for places in corners]
    longest = [np.einsum("fja,fja->fj", side, side).argmax(axis=1) for side in sides]
    every = np.arange(len(rows))
    straight = [unit_rows(side[every, turn]) for side, turn in zip(sides, longest, strict=True)]
    return _Needles(rows, unit_rows(sides[0][every, first[rows] % 3]), *straight)


def is_part(surface: Surface, planes: IntArray, ruled: NDArray[Any]) -> bool:
    """Tell whether a mesh is of a part: it has flat faces, or most of it, these faces, is ruled.

    Elsewhere needles lie beside each other by chance.
    """
    if (planes >= 0).any():
        return True
    return bool(surface.face_areas[ruled].sum() >= RULED_PART * surface.area)


def find_rulings(
    surface: Surface, planes: IntArray, crease: float, needle: Mask | None = None
) -> Rulings:
    """Find the edges of a part along which its rounded surface is straight.

    Parameters
    ----------
    surface : Surface
        A mesh of m faces.
    planes : (m,) int32
        `find_planes`.
    crease : float
        Radians: edges that bend by more are sharp.
    needle : (m,) bool, optional
        `needles`, where they are known.
    """
    first, second, _ = surface.edge_table.pairs
    needle = needles(surface, planes)[0] if needle is None else needle
    if not is_part(surface, planes, needle):
        return Rulings(np.empty(0, np.int64), np.empty((0, 2), np.int64), np.empty((0, 3)))
    edges = _between_needles(surface, needle)
    leans = [np.abs(np.einsum("ea,ea->e", edges.along, u)) for u in (edges.one, edges.two)]
    rows = edges.rows[np.minimum(*leans) >= ALONG]
    rows = rows[surface.edge_bends[rows] <= crease]
    ruled = np.unique(np.concatenate([first[rows], second[rows]]) // 3)
    if not is_part(surface, planes, ruled):
        rows = rows[:0]
    # Over the circle the normal turns by as much of the bend as its side is wide: areas tell that.
    one, two = first[rows] // 3, second[rows] // 3
    areas, normals = surface.face_areas, surface.face_normals
    mean = areas[two, None] * normals[one] + areas[one, None] * normals[two]
    corners = np.asarray(surface.faces).ravel()
    ends = np.stack([corners[first[rows]], corners[next_side(first[rows])]], axis=1)
    return Rulings(first[rows].astype(np.int64), ends.astype(np.int64), unit_rows(mean, 1e-300))


def find_mitres(surface: Surface, planes: IntArray) -> Mask:
    """Tell the pairs of faces between which ruled strips meet askew, (p,).

    A mitre bends less and less towards the flat face that both strips are tangent to.
    """
    result = np.zeros(len(surface.edge_bends), np.bool_)
    if (planes < 0).all():
        return result
    edges = _between_needles(surface, needles(surface, planes)[0])
    turns = np.ones(len(edges.rows), np.bool_)
    for u, v in ((edges.one, edges.two), (edges.one, edges.along), (edges.two, edges.along)):
        turns &= np.abs(np.einsum("ea,ea->e", u, v)) < TURNS
    result[edges.rows[turns]] = True
    return result


def only_rounded(surface: Surface, planes: IntArray, crease: float) -> Mask:
    """Tell the vertices of no flat face and of no edge that bends by more than a crease, (n,)."""
    faces, result = np.asarray(surface.faces), np.ones(surface.point_count, np.bool_)
    result[faces[planes >= 0]] = False
    bent = surface.edge_table.pairs[0][surface.edge_bends > crease]
    for side in (bent, next_side(bent)):
        result[faces.ravel()[side]] = False
    return result


def with_rulings(
    normals: FloatArray,
    surface: Surface,
    planes: IntArray,
    crease: float,
    needle: Mask | None = None,
) -> FloatArray:
    """Return vertex normals that are those of ruled strips, where one ends at shorter facets.

    Parameters
    ----------
    normals : (n, 3) float64
    surface : Surface
    planes : (m,) int32
        `find_planes`.
    crease : float
        Radians: vertices at edges that bend by more keep their normals.
    needle : (m,) bool, optional
        `needles`, where they are known.
    """
    rulings, points = find_rulings(surface, planes, crease, needle), surface.points
    if len(rulings.sides) == 0:
        return normals
    count = surface.point_count
    vertex = rulings.ends.ravel()
    step = points[rulings.ends[:, ::-1].ravel()] - points[vertex]
    long = np.linalg.norm(step, axis=1)
    order = np.lexsort((np.arange(len(vertex)), long))
    best = np.full(count, -1, np.int64)
    best[vertex[order]] = order  # the longest of each vertex
    free = (np.bincount(vertex, minlength=count) > 0) & only_rounded(surface, planes, crease)
    beyond = np.zeros(count)
    for a, b in (surface.edges.T, surface.edges.T[::-1]):
        rows = np.flatnonzero(free[a])
        away = points[b[rows]] - points[a[rows]]
        size = np.linalg.norm(away, axis=1)
        mine = best[a[rows]]
        back = np.einsum("ea,ea->e", away, step[mine]) < BEYOND * size * long[mine]
        np.maximum.at(beyond, a[rows[back]], size[back])
    rows = np.flatnonzero(free)
    rows = rows[beyond[rows] < SHORTER * long[best[rows]]]
    rows = rows[np.asarray(normals)[rows].any(axis=1)]
    result = np.array(normals)
    result[rows] = rulings.normals[best[rows] // 2]
    return frozen(result, np.float64)
