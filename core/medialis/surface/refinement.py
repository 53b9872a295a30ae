"""Refinement: a denser sampling of exactly the same surface (thesis 3.2.1, re-sampling).

A flat face given by its corners has no samples inside, so no balls. Edges longer than h are halved
again and again; every face is cut along the new vertices, so neighbouring faces always agree and no
vertex moves.
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
from medialis.surface._halving import LONG, Cut, TooManyPointsError, edges_of_sides
from medialis.surface._long_edges import LongEdges, has_new
from medialis.surface._volumes import power_of_two_scale
from medialis.surface.given_shapes import as_shape
from medialis.surface.normals import mean_normals
from medialis.threads import run_patiently
from medialis.validation import FloatArray

MOST_POINTS = 10_000_000
"""Refinement stops with a sentence before it fills the memory."""

MOST_HALVINGS = 6

USUAL, USUAL_A_VERTEX = 25_000, 4
"""Samples that a mesh is refined to at most where no one asks for more: so many, and so many for
each vertex that it has. A box has 12,000, no thin cup and none of 97 real meshes more; a heap of
large triangles that cross each other would have hundreds of thousands, and no use for them."""

MEANT = 20_000
"""The same where edges of less than half the default length are asked for, at the default."""


@dataclass(frozen=True, kw_only=True)
class RefineOptions(Options):
    """Options of `refine`."""

    longest_edge: float = length(
        0.02,
        "Refine edges above",
        "Split edges longer than this share of the size for the computation, so that flat faces "
        "get samples; the surface stays the same. 0 computes with the given vertices only.",
    )


@algorithm(RefineOptions, door=as_shape)
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
    Cost O(n log(longest / h)). Faces longer than four edges and no higher than one get new vertices
    on their sides only. Source: thesis 3.2.1 (re-sampling before ball shrinking).

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
    surface = Surface(points, shape.faces).adopt(shape.topology)
    if not (surface.edge_lengths > h).any():
        return shape
    part = LongEdges.of(surface, h)
    _check_affordable(part, h, scale)
    try:
        cut = part.cut(h, MOST_POINTS)
    except TooManyPointsError as error:
        made, wanted = error.args
        _refuse(h / scale, f"{made} were made and {wanted} edges are still longer")
    return _with_faces_of(shape, cut, scale)


def refine_where(shape: Shape, allowed: FloatArray, most_points: int = MOST_POINTS) -> Shape:
    """Split edges that are longer than what the vertex nearest to their middle allows.

    Edges are halved six times at most: where long faces lie beside short edges, each cut makes
    another long edge.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    allowed : (n,) float64
        Longest edge at each vertex; inf: any.
    most_points : int
        Of as many points refinement stops.

    Returns
    -------
    Shape
        As `refine` returns it; the same object when nothing is to do.
    """
    from scipy.spatial import cKDTree

    near = np.flatnonzero(np.isfinite(allowed))
    if len(near) == 0:
        return shape
    scale = power_of_two_scale(shape.points)
    tree, bound = cKDTree(shape.points * scale), allowed * scale
    cut = begun = Cut.of(Surface(shape.points * scale, np.asarray(shape.faces)))
    try:
        for _ in range(MOST_HALVINGS):
            more = cut.halved(lambda middles: bound[tree.query(middles)[1]], most_points)
            if more is None:
                break
            cut = more
    except TooManyPointsError:
        pass  # as fine as it may be
    return shape if cut is begun else _with_faces_of(shape, cut, scale)


def _with_faces_of(shape: Shape, cut: Cut, scale: float) -> Shape:
    """Return a shape with the points and faces that it was cut into, as lengths times `scale`."""
    points, faces = np.array(cut.points), cut.faces.astype(np.int32)
    face_origin = cut.origin.astype(np.int32)
    n = shape.point_count
    points /= scale
    points[:n] = shape.points
    normals = np.concatenate([shape.normals, mean_normals(points, faces[has_new(faces, n)])[n:]])
    origin = np.full(len(points), -1, np.int32)
    origin[:n] = np.arange(n) if shape.origin is None else shape.origin
    of_faces = {
        name: values[face_origin]
        for name in ("face_map", "patches")
        if (values := getattr(shape, name)) is not None
    }
    if shape.face_origin is not None:
        face_origin = shape.face_origin[face_origin]
    return replace(
        shape,
        points=points,
        normals=normals,
        faces=faces,
        origin=origin,
        face_origin=face_origin,
        **of_faces,
    )


def affordable_edge(shape: Shape, fraction: float) -> float:
    """Return how long edges must be for a number of samples in proportion to the mesh.

    Parameters
    ----------
    shape : Shape
        A mesh.
    fraction : float
        The `longest_edge` that is asked for. Half the default, which some operations have,
        allows twice the samples; what is below that is meant, and allows four times as many for
        each halving.

    Returns
    -------
    float
        `fraction`, or the first of its multiples by powers of 2^(1/4) that does.
    """
    asked = max(1.0, RefineOptions().longest_edge / fraction)
    most = asked * USUAL if asked <= 2.0 else asked**2 * MEANT
    most += asked**2 * USUAL_A_VERTEX * shape.point_count
    surface = Surface(shape.points * power_of_two_scale(shape.points), shape.faces)
    surface.adopt(shape.topology)
    if not (surface.edge_lengths > fraction * surface.diagonal).any():
        return fraction
    part = LongEdges.of(surface, fraction * surface.diagonal)
    while fraction < 1.0 and _about_points(part, fraction * surface.diagonal) > most:
        fraction = min(1.0, 2.0**0.25 * fraction)
    return fraction


def _about_points(part: LongEdges, longest_edge: float) -> float:
    """Estimate how many points `refine` makes: on real shapes 0.6 to 1.5 times as many.

    A face with l pieces on its longest side and s on its shortest one becomes s^2 faces with an
    undivided side, and each of these a row of 2 l / s - 1; a strip takes no more than its rim.
    """
    surface = part.surface
    rows = edges_of_sides(surface)
    pieces = np.append(_pieces(surface.edge_lengths, longest_edge), 1.0)
    of_side, rim = pieces[rows], pieces[rows].sum(axis=1)
    short, most = of_side.min(axis=1), of_side.max(axis=1)
    longest = np.append(surface.edge_lengths, 0.0)[rows].max(axis=1)
    thin = (longest > LONG * longest_edge) & (2 * surface.face_areas <= longest_edge * longest)
    faces = np.where(thin, rim - 2.0, short * (2.0 * most - short))
    inside = np.maximum((faces - rim) / 2 + 1.0, 0.0).sum()
    return float(part.whole.point_count + (pieces - 1.0).sum() + inside)


def _check_affordable(part: LongEdges, longest_edge: float, scale: float) -> None:
    """Refuse a length that needs too many points, before any of them is made.

    `scale` is what lengths were multiplied with; sentences tell them in the caller's units.

    A lower bound of the number: an edge is halved until its 2^k pieces are short enough, and has
    2^k - 1 new points. A face of area A gets at least F = A / (sqrt(3)/4 h^2) triangles, since none
    with edges up to h is larger than the equilateral one; a triangulation with B vertices on its
    rim and I inside has 2 I + B - 2 triangles, so I >= (F - B) / 2 + 1.
    """
    surface = part.surface
    with np.errstate(over="ignore"):  # infinitely many are too many as well
        triangles = surface.face_areas / longest_edge / longest_edge / (math.sqrt(3.0) / 4.0)
    pieces = _pieces(surface.edge_lengths, longest_edge)
    # A face that names a vertex twice has a side without length: its edge is the row -1.
    rim = np.append(pieces, 1.0)[edges_of_sides(surface)].sum(axis=1)
    inside = np.maximum(0.5 * (triangles - rim) + 1.0, 0.0).sum()
    needed = part.whole.point_count + (pieces - 1.0).sum() + inside
    if needed > MOST_POINTS:
        _refuse(longest_edge / scale, f"the longest edge is {surface.edge_lengths.max() / scale:g}")
    rounding = np.finfo(np.float64).eps * float(np.abs(part.whole.points).max())
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
