"""The boundary of the solid that a mesh encloses, as a closed manifold: handles are counted on it.

Where a mesh touches itself in a vertex, the boundary has a vertex for each fan of faces. Where more
than two faces meet at an edge, it passes there once for each wedge of the solid: the solid lies
behind each face, so on going round the edge a face that enters it belongs to the next that leaves.
Faces that are left over are walls within the solid or fins on it. Holes are closed by fans of
triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, next_side
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.shape import Shape
from medialis.shape.surface import piece_labels


@dataclass(frozen=True, eq=False)
class SolidBoundary:
    """A closed manifold, cut from a mesh.

    Attributes
    ----------
    points : (p, 3) float64
        The vertices of the mesh, a copy for each further fan of a vertex, and one in the middle of
        each hole.
    faces : (q, 3) int32
        Those of the mesh, and those that close holes.
    twins : (3q,) int64
        The same edge in the neighbouring face. Two edges may have the same ends.
    component : (p,) int32
        Component of the mesh (`Shape.components`) that each point belongs to.
    seams : (c,) int64
        For each component of the mesh: edges with three or more faces, and vertices apart from
        these with several fans.
    unclear : (c,) int64
        Edges with faces left over, and edges beyond which a one-sided surface (a Moebius band) has
        its back: there the solid is a guess.
    """

    points: FloatArray
    faces: IntArray
    twins: Index
    component: IntArray
    seams: Index
    unclear: Index


def solid_boundary(shape: Shape) -> SolidBoundary:
    """Cut a mesh into the closed manifolds that bound its solid.

    Parameters
    ----------
    shape : Shape
        A mesh.
    """
    assert shape.faces is not None
    a, b, unclear = _joined_sides(shape)
    faces, vertex = _copied_vertices(shape, a, b)
    table, count = shape.edge_table, int(shape.components.max()) + 1
    many = table.counts > 2
    several = np.bincount(vertex) > 1
    several[np.concatenate([table.low[many], table.high[many]])] = False
    twins = np.full(faces.size, -1)
    twins[a], twins[b] = b, a
    points, component = shape.points[vertex], shape.components[vertex]
    seams = np.concatenate([np.flatnonzero(several), table.low[many]])
    return SolidBoundary(
        *_closed(points, faces, twins, component),
        np.bincount(shape.components[seams], minlength=count),
        np.bincount(shape.components[table.low[unclear]], minlength=count),
    )


def _joined_sides(shape: Shape) -> tuple[IntArray, IntArray, Index]:
    """Pairs of half-edges that the boundary joins, and the edges where others are left over."""
    table = shape.edge_table
    a, b, opposite = table.pairs
    unclear = np.flatnonzero(table.counts == 2)[~opposite].tolist()
    pairs, many = [], np.flatnonzero(table.counts > 2)
    fin = _fins(shape) if len(many) else np.zeros(0, bool)
    for edge in many.tolist():
        sides = table.order[table.first[edge] : table.first[edge + 1]]
        found = _paired(shape, sides, fin[sides // 3])
        pairs += found
        if 2 * len(found) < len(sides):
            unclear.append(edge)
    more = np.array(pairs, np.int32).reshape(-1, 2)
    a, b = np.concatenate([a[opposite], more[:, 0]]), np.concatenate([b[opposite], more[:, 1]])
    return a, b, np.array(unclear, np.int64)


def _fins(shape: Shape) -> NDArray[np.bool_]:
    """Faces of pieces that have a border."""
    return np.isin(shape.face_pieces, shape.face_pieces[shape.edge_table.single // 3])


def _paired(shape: Shape, sides: IntArray, fin: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pair the half-edges of one edge: each face that enters the solid with one that leaves it.

    Of as many as enter and leave, each that enters takes the nearest that leaves, round the edge.
    Where their numbers differ, closed pieces go before fins, and flat pairs before sharp ones.
    """
    assert shape.faces is not None
    corner, forward = shape.faces.ravel(), shape.edge_table.forward[sides]
    ends = shape.points[corner[[sides[0], next_side(sides[:1])[0]]]]
    low, high = ends if forward[0] else ends[::-1]
    angle = _angles_round(low, high, shape.points[corner[next_side(next_side(sides))]])
    enters, leaves = np.flatnonzero(~forward), np.flatnonzero(forward)
    cost = (angle[leaves] - angle[enters][:, None]) % (2 * np.pi)
    if len(enters) != len(leaves):
        cost = np.abs(cost - np.pi) + 2 * np.pi * (fin[enters][:, None] | fin[leaves])
    pairs, used = [], np.zeros(cost.shape, bool)
    for place in np.argsort(cost, axis=None, kind="stable").tolist():
        i, j = divmod(place, len(leaves))
        if not used[i, j]:
            pairs.append((int(sides[enters[i]]), int(sides[leaves[j]])))
            used[i], used[:, j] = True, True
    return pairs


def _angles_round(low: FloatArray, high: FloatArray, tips: FloatArray) -> FloatArray:
    """Angle of each tip round the line from low to high, counted from the first, (k,)."""
    axis = (high - low) / max(float(np.linalg.norm(high - low)), 1e-300)
    away = tips - low
    away = away - np.outer(away @ axis, axis)
    x = away[0] / max(float(np.linalg.norm(away[0])), 1e-300)
    return np.asarray(np.arctan2(away @ np.cross(axis, x), away @ x))


def _copied_vertices(shape: Shape, a: IntArray, b: IntArray) -> tuple[IntArray, Index]:
    """Faces with a copy of a vertex for each further fan there, and the vertex of each point, (p,).

    A fan are corners of a vertex joined across pairs of half-edges; copies come after the vertices.
    """
    from medialis.shape._kernels import label_corner_fans

    assert shape.faces is not None
    corner, n = shape.faces.ravel(), shape.point_count
    fan = np.empty(len(corner), np.int32)
    ones = np.ones(len(a), bool)
    label_corner_fans(a, b, ones, np.arange(len(corner), dtype=np.int32), fan)
    vertex = np.empty(int(fan.max()) + 1, np.int64)
    vertex[fan] = corner
    further = np.ones(len(vertex), bool)
    further[np.unique(vertex, return_index=True)[1]] = False
    point = np.where(further, n + np.cumsum(further) - 1, vertex)
    faces = point[fan].reshape(-1, 3).astype(np.int32)
    return faces, np.concatenate([np.arange(n), vertex[further]])


def _closed(
    points: FloatArray, faces: IntArray, twins: Index, component: IntArray
) -> tuple[FloatArray, IntArray, Index, IntArray]:
    """Close each hole by a fan of triangles round the mean of its border.

    One half-edge of a border starts and one ends in each of its vertices: a vertex is one fan.
    """
    sides = np.flatnonzero(twins < 0)
    if len(sides) == 0:
        return points, faces, twins, component
    start, end = faces.ravel()[sides], faces.ravel()[next_side(sides)]
    label = piece_labels(len(points), np.stack([start, end], axis=1))[start]
    _, first, ring = np.unique(label, return_index=True, return_inverse=True)
    size = np.bincount(ring, minlength=len(first))
    middle = np.stack([np.bincount(ring, points[start, k]) / size for k in range(3)], axis=1)
    fan = np.stack([end, start, len(points) + ring], axis=1)
    new = len(twins) + 3 * np.arange(len(sides))
    twins = np.concatenate([twins, np.empty(3 * len(sides), np.int64)])
    twins[sides], twins[new] = new, sides
    # From the start of a side to the middle, and back in the triangle of the side that ends there.
    before = np.empty(len(points), np.int64)
    before[end] = new
    twins[new + 1], twins[before[start] + 2] = before[start] + 2, new + 1
    return (
        frozen(np.concatenate([points, middle]), np.float64),
        frozen(np.concatenate([faces, fan]), np.int32),
        twins,
        frozen(np.concatenate([component, component[start[first]]]), np.int32),
    )
