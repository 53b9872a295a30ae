"""Refinement: a denser sampling of exactly the same surface (thesis 3.2.1, re-sampling).

A flat face given by its corners has no samples inside, so no balls. Edges longer than h are halved
again and again; every face is cut along the new vertices by one of three patterns, so neighbouring
faces always agree and no vertex moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.shape import Shape
from medialis.model.surface import Surface
from medialis.options import Options, algorithm, length
from medialis.progress import Progress
from medialis.surface._volumes import power_of_two_scale
from medialis.surface.normals import vertex_normals
from medialis.threads import run_patiently

MOST_POINTS = 10_000_000
"""Refinement stops with a sentence before it fills the memory."""

# For each pattern of split edges (bit j: edge j, from corner j to corner j + 1), the new triangles
# in terms of corners 0, 1, 2 and midpoints 3, 4, 5 of edges 0, 1, 2. Two split edges leave a
# quadrangle, which is cut along its shorter diagonal.
_ONE = {1: ((0, 3, 2), (3, 1, 2)), 2: ((1, 4, 0), (4, 2, 0)), 4: ((2, 5, 1), (5, 0, 1))}
_THREE = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
# Two split edges: the corner where they meet and its two midpoints, then the far two corners.
_TWO = {3: (1, 4, 3, 0, 2), 6: (2, 5, 4, 1, 0), 5: (0, 3, 5, 2, 1)}


@dataclass(frozen=True, kw_only=True)
class RefineOptions(Options):
    """Options of `refine`."""

    longest_edge: float = length(
        0.02,
        "Refine edges above",
        "Split edges longer than this fraction of the size for the computation, so that flat faces "
        "get samples; the surface stays the same. 0 computes with the given vertices only.",
    )


@algorithm(RefineOptions)
def refine(shape: Shape, options: RefineOptions, progress: Progress) -> Shape:
    """Split edges until none is longer than `longest_edge`; the surface stays exactly the same.

    Parameters
    ----------
    shape : Shape
        A mesh. A point cloud is returned unchanged (it has no edges).

    Returns
    -------
    Shape
        The given vertices first, unmoved, in their order and with their normals, then the new ones
        with angle-weighted normals. ``origin`` (n,) is the vertex of the given shape or -1,
        ``face_origin`` (m,) the face of the given shape. The same object when nothing is to do.

    Raises
    ------
    InvalidShapeError
        When more than 10 million points would be needed, or `longest_edge` is so small that the
        coordinates cannot tell the points apart.

    See Also
    --------
    surface_skeleton : refines by itself.
    make_shape : shapes from arrays.

    Notes
    -----
    Cost O(n log(longest / h)). Source: thesis 3.2.1 (re-sampling before ball shrinking).

    Examples
    --------
    >>> from medialis import make_shape, refine
    >>> square = make_shape([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> fine = refine(square, longest_edge=0.4)
    >>> fine.point_count, int((fine.origin >= 0).sum()), fine.face_origin.tolist()
    (13, 4, [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1])
    """
    if shape.faces is None or options.longest_edge == 0.0 or shape.diagonal == 0.0:
        return shape
    return run_patiently(lambda: _refined(shape, options.longest_edge), progress)


def _refined(shape: Shape, longest_edge: float) -> Shape:
    # A power of two changes no digit, and keeps squares of tiny or huge lengths in range.
    scale = power_of_two_scale(shape.points)
    points = shape.points * scale
    h = max(longest_edge * shape.diagonal * scale, float(np.finfo(np.float64).tiny))
    ends = points[shape.edges]
    if not (np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > h).any():
        return shape
    surface = Surface(points, shape.faces)
    _check_affordable(surface, h, scale)
    face_origin = np.arange(shape.face_count, dtype=np.int32)
    while (split := _split_once(surface, h, scale)) is not None:
        surface, parents = split
        face_origin = face_origin[parents]
    points, faces = np.array(surface.points), surface.faces
    assert faces is not None
    n = shape.point_count
    points /= scale
    points[:n] = shape.points
    normals = np.array(vertex_normals(points, faces))
    normals[:n] = shape.normals
    origin = np.full(len(points), -1, np.int32)
    origin[:n] = np.arange(n) if shape.origin is None else shape.origin
    face_map = None if shape.face_map is None else shape.face_map[face_origin]
    if shape.face_origin is not None:
        face_origin = shape.face_origin[face_origin]
    return replace(
        shape,
        points=points,
        normals=normals,
        faces=faces,
        origin=origin,
        face_origin=face_origin,
        face_map=face_map,
    )


def _check_affordable(surface: Surface, longest_edge: float, scale: float) -> None:
    """Refuse a length that needs too many points, before any of them is made.

    `scale` is what lengths were multiplied with; sentences tell them in the caller's units.

    A lower bound of the number: an edge is halved until its 2^k pieces are short enough, and has
    2^k - 1 new points. A face of area A gets at least F = A / (sqrt(3)/4 h^2) triangles, since none
    with edges up to h is larger than the equilateral one; a triangulation with B vertices on its
    rim and I inside has 2 I + B - 2 triangles, so I >= (F - B) / 2 + 1.
    """
    with np.errstate(over="ignore"):  # infinitely many are too many as well
        triangles = surface.face_areas / longest_edge / longest_edge / (math.sqrt(3.0) / 4.0)
    pieces = _pieces(surface.edge_lengths, longest_edge)
    # A face that names a vertex twice has a side without length: its edge is the row -1.
    rim = np.append(pieces, 1.0)[_edges_of_sides(surface)].sum(axis=1)
    inside = np.maximum(0.5 * (triangles - rim) + 1.0, 0.0).sum()
    needed = surface.point_count + (pieces - 1.0).sum() + inside
    if needed > MOST_POINTS:
        _refuse(longest_edge / scale, f"the longest edge is {surface.edge_lengths.max() / scale:g}")
    rounding = np.finfo(np.float64).eps * float(np.abs(surface.points).max())
    if longest_edge < 16.0 * rounding:
        raise InvalidShapeError(
            f"Edges of {longest_edge / scale:g} are lost in the rounding of the coordinates "
            f"({rounding / scale:.1g}). Ask for longer edges, or move the shape to the origin."
        )


def _pieces(length: NDArray[np.float64], longest_edge: float) -> NDArray[np.float64]:
    """Return 2^k pieces, the least that are no longer than `longest_edge`."""
    with np.errstate(over="ignore"):
        ratio = np.clip(length / longest_edge, 1.0, 1e30)
    return 2.0 ** np.ceil(np.log2(ratio))


def _refuse(longest_edge: float, measure: str) -> NoReturn:
    raise InvalidShapeError(
        f"Refining to edges of at most {longest_edge:g} needs more than {MOST_POINTS} points; "
        f"{measure}. Ask for longer edges."
    )


def _edges_of_sides(surface: Surface) -> NDArray[np.int64]:
    """Return the row in ``surface.edges`` of each side of each face, (m, 3); -1 for none."""
    table = surface.edge_table
    proper = table.low != table.high
    row = np.where(proper, np.cumsum(proper) - 1, -1)
    return row[table.edge_of].reshape(-1, 3)


def _split_once(
    surface: Surface, longest_edge: float, scale: float
) -> tuple[Surface, NDArray[np.int64]] | None:
    """Halve every edge that is too long once; None when there is none."""
    points, faces, n = surface.points, surface.faces, surface.point_count
    long_edges = surface.edges[surface.edge_lengths > longest_edge]
    if len(long_edges) == 0:
        return None
    if n + len(long_edges) > MOST_POINTS:
        _refuse(longest_edge / scale, f"{n} were made and {len(long_edges)} edges are still longer")
    new_points = np.concatenate([points, 0.5 * points[long_edges].sum(axis=1)])

    # Corners and midpoints of each face side by side: columns 0-2 and 3-5.
    middle = np.full(len(surface.edges) + 1, -1, np.int64)
    middle[:-1][surface.edge_lengths > longest_edge] = n + np.arange(len(long_edges))
    six = np.concatenate([np.asarray(faces), middle[_edges_of_sides(surface)]], axis=1)
    is_long = six[:, 3:] >= 0
    pattern = (is_long * np.array([1, 2, 4])).sum(axis=1)

    triangles, parents = [], []

    def cut(rows: NDArray[np.int64], pieces: tuple[tuple[int, int, int], ...]) -> None:
        for piece in pieces:
            triangles.append(six[rows][:, piece])
            parents.append(rows)

    cut(np.flatnonzero(pattern == 0), ((0, 1, 2),))
    for code, pieces in _ONE.items():
        cut(np.flatnonzero(pattern == code), pieces)
    for code, (tip, first, second, left, right) in _TWO.items():
        # The tip triangle goes off; the quadrangle (first, right, left, second) stays.
        rows = np.flatnonzero(pattern == code)
        p = new_points[six[rows]]
        one = np.linalg.norm(p[:, first] - p[:, left], axis=1)
        other = np.linalg.norm(p[:, second] - p[:, right], axis=1)
        tip_piece = (tip, first, second)
        cut(rows[one <= other], (tip_piece, (first, right, left), (first, left, second)))
        cut(rows[one > other], (tip_piece, (first, right, second), (second, right, left)))
    cut(np.flatnonzero(pattern == 7), _THREE)

    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")
    new_faces = np.concatenate(triangles)[order].astype(np.int32)
    return Surface(new_points, new_faces), parent[order]
