"""Refinement: a denser sampling of exactly the same surface (thesis 3.2.1, re-sampling).

A flat face given by its corners has no samples inside, so no balls. Edges longer than h are halved
again and again; every face is cut along the new vertices, so neighbouring faces always agree and no
vertex moves. Halving an edge makes no other one long: the new edge across a face is no longer than
the mean of the two sides beside it. So faces without a long edge stay as they are, and are left
out (`LongEdges`).

Halved again and again, a needle of 64 pieces along its long sides falls into 729 triangles, and a
flat triangle with a blunt corner into 4096, though neither has room for more than 128. So only the
sides of such a face are halved, with its neighbours; in the end triangles are put between them
(the strips of `Cut`).

Facets of smooth parts are chords: new vertices on them lie inside the smooth surface that the mesh
stands for, and their balls would be those of a polyhedron. `on_smooth_surface` moves them out by
how far that surface bulges over the facets (`Creases`). Where a mesh is flat nothing moves; on
creases, samples move to where the surfaces of both sides meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Ragged, kd_tree, sums_of, unit_rows
from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, length
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.shape.creases import Creases
from medialis.shape.diagnosis import power_of_two_scale
from medialis.shape.normals import CREASE_ANGLE, ring_normals
from medialis.shape.reading import as_shape
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface

Rows = NDArray[np.int64]
Allowed = Callable[[Surface, Rows], FloatArray]
"""Tells how long each edge of a surface may be (e,), whose faces are pieces of given ones (m,)."""

LONG = 4.0  # halved 11 %, doubled 36 %
"""Longest edges: a face no higher than one and longer than this many is a strip. Shorter ones are
halved, into at most five times the triangles."""

# For each pattern of split edges (bit j: edge j, from corner j to corner j + 1), the new triangles
# in terms of corners 0, 1, 2 and midpoints 3, 4, 5 of edges 0, 1, 2. Two split edges leave a
# quadrangle, which is cut along its shorter diagonal.
_ONE = {1: ((0, 3, 2), (3, 1, 2)), 2: ((1, 4, 0), (4, 2, 0)), 4: ((2, 5, 1), (5, 0, 1))}
_THREE = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
# Two split edges: the corner where they meet and its two midpoints, then the far two corners.
_TWO = {3: (1, 4, 3, 0, 2), 6: (2, 5, 4, 1, 0), 5: (0, 3, 5, 2, 1)}


NO_STRIPS = np.empty((0, 2), np.int64), np.empty(0, np.int64), np.empty(0, np.int64)


@dataclass(frozen=True)
class Cut:
    """A mesh while it is refined: faces that are halved, and strips of which only the sides are.

    Attributes
    ----------
    points : (n, 3) float64
    faces : (m, 3) int64
    origin : (m,) int64
        The given face that each face is a piece of.
    sides : (w, 2) int64
        Pieces of the sides of strips: strip after strip, once round, the longest side first.
    side_of : (w,) int64
        Twice the number of the strip, and one more on its two shorter sides; ascending.
    strip_origin : (s,) int64
        The given face of each strip.
    """

    points: FloatArray
    faces: Rows
    origin: Rows
    sides: Rows
    side_of: Rows
    strip_origin: Rows

    @classmethod
    def of(cls, surface: Surface) -> Cut:
        """Begin with all faces of a mesh, and no strip."""
        faces = np.asarray(surface.faces, np.int64)
        return cls(surface.points, faces, np.arange(len(faces)), *NO_STRIPS)

    def with_strips(self, longest_edge: float) -> Cut:
        """Make strips of the faces that are long and no higher than an edge may be."""
        corners = self.points[self.faces]
        length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        longest = length.max(axis=1, initial=0.0)
        rows = np.flatnonzero(longest > LONG * longest_edge)
        a, b, c = np.moveaxis(corners[rows], 1, 0)
        thin = np.linalg.norm(np.cross(b - a, c - a), axis=1) <= longest_edge * longest[rows]
        rows = rows[thin]
        if len(rows) == 0:
            return self
        first = length[rows].argmax(axis=1)
        turned = self.faces[rows[:, None], (first[:, None] + np.arange(3)) % 3]
        count = len(self.strip_origin)
        number = 2 * (count + np.arange(len(rows)))
        side_of = number[:, None] + np.array([0, 1, 1])
        sides = np.stack([turned, np.roll(turned, -1, axis=1)], axis=2)
        return Cut(
            self.points,
            np.delete(self.faces, rows, axis=0),
            np.delete(self.origin, rows),
            np.concatenate([self.sides, sides.reshape(-1, 2)]),
            np.concatenate([self.side_of, side_of.ravel()]),
            np.concatenate([self.strip_origin, self.origin[rows]]),
        )

    def without_strips(self) -> Cut:
        """Fill the strips with triangles."""
        from medialis.shape._kernels import zip_strips

        count = len(self.strip_origin)
        if count == 0:
            return self
        pieces = np.bincount(self.side_of, minlength=2 * count).reshape(-1, 2)
        first = np.concatenate([[0], np.cumsum(pieces.sum(axis=1))])
        made = pieces.sum(axis=1) - 2
        filling = np.empty((made.sum(), 3), np.int64)
        ring = np.ascontiguousarray(self.sides[:, 0])
        zip_strips(self.points, ring, first, np.ascontiguousarray(pieces[:, 0]), filling)
        origin = np.concatenate([self.origin, np.repeat(self.strip_origin, made)])
        order = np.argsort(origin, kind="stable")
        faces = np.concatenate([self.faces, filling])
        return Cut(self.points, faces[order], origin[order], *NO_STRIPS)

    def halved(self, longest_edge: float | Allowed, most_points: int) -> Cut | None:
        """Halve every edge that is too long once; None when there is none.

        `longest_edge` may be a function of the mesh so far, without strips.

        Raises
        ------
        TooManyPointsError
            When there would be more than `most_points`.
        """
        m = len(self.faces)
        # A side of a strip is a face that names a vertex twice: it has one edge.
        surface = Surface.of_checked(
            self.points, np.concatenate([self.faces, self.sides[:, [0, 1, 1]]])
        )
        bound: Any = longest_edge
        if callable(bound):
            bound = bound(surface, self.origin)
        n, long = surface.point_count, surface.edge_lengths > bound
        if not long.any():
            return None
        ends = surface.edges[long]
        if n + len(ends) > most_points:
            raise TooManyPointsError(n, len(ends))
        points = np.concatenate([surface.points, 0.5 * surface.points[ends].sum(axis=1)])
        middle = np.full(len(surface.edges) + 1, -1, np.int64)
        middle[:-1][long] = n + np.arange(len(ends))
        middles = middle[edges_of_sides(surface)]
        # Corners and midpoints of each face side by side: columns 0-2 and 3-5.
        six = np.concatenate([np.asarray(surface.faces), middles], axis=1)
        faces, parent = _cut_faces(points, six[:m])
        three = six[m:, [0, 3, 1]]
        two = three[:, 1] >= 0
        sides = np.stack([three[:, :2], three[:, 1:]], axis=1)
        sides[~two, 0, 1] = three[~two, 2]
        use = np.column_stack([np.ones(len(two), bool), two])
        side_of = np.repeat(self.side_of, use.sum(axis=1))
        return Cut(points, faces, self.origin[parent], sides[use], side_of, self.strip_origin)


class TooManyPointsError(Exception):
    """More points than allowed: how many there are, and how many would come."""


def edges_of_sides(surface: Surface) -> Rows:
    """Return the row in ``surface.edges`` of each side of each face, (m, 3); -1 for none."""
    table = surface.edge_table
    proper = table.low != table.high
    row = np.where(proper, np.cumsum(proper) - 1, -1)
    return row[table.edge_of].reshape(-1, 3)


def _cut_faces(points: FloatArray, six: Rows) -> tuple[Rows, Rows]:
    """Cut faces along the midpoints of their sides; new faces, and the row that each is from."""
    is_long = six[:, 3:] >= 0
    pattern = (is_long * np.array([1, 2, 4])).sum(axis=1)
    triangles, parents = [], []

    def cut(rows: Rows, pieces: tuple[tuple[int, int, int], ...]) -> None:
        for piece in pieces:
            triangles.append(six[rows][:, piece])
            parents.append(rows)

    cut(np.flatnonzero(pattern == 0), ((0, 1, 2),))
    for code, pieces in _ONE.items():
        cut(np.flatnonzero(pattern == code), pieces)
    for code, (tip, first, second, left, right) in _TWO.items():
        # The tip triangle goes off; the quadrangle (first, right, left, second) stays.
        rows = np.flatnonzero(pattern == code)
        p = points[six[rows]]
        one = np.linalg.norm(p[:, first] - p[:, left], axis=1)
        other = np.linalg.norm(p[:, second] - p[:, right], axis=1)
        tip_piece = (tip, first, second)
        cut(rows[one <= other], (tip_piece, (first, right, left), (first, left, second)))
        cut(rows[one > other], (tip_piece, (first, right, second), (second, right, left)))
    cut(np.flatnonzero(pattern == 7), _THREE)
    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")
    return np.concatenate(triangles)[order], parent[order]


@dataclass(frozen=True)
class LongEdges:
    """The faces of a mesh that have a long edge: halving never makes others long.

    Attributes
    ----------
    whole : Surface
    surface : Surface
        The part, with vertices of its own in their order.
    vertices : (v,) int64
        Those vertices in the mesh, ascending.
    faces : (f,) int64
        Its faces in the mesh, ascending.
    """

    whole: Surface
    surface: Surface
    vertices: NDArray[np.int64]
    faces: NDArray[np.int64]

    @classmethod
    def of(cls, whole: Surface, longest_edge: float | FloatArray) -> LongEdges:
        """Return the faces with edges longer than `longest_edge`: one for all, or one for each."""
        table, corners = whole.edge_table, np.asarray(whole.faces)
        proper = table.low != table.high  # a face that names a vertex twice has a side of no length
        long = np.flatnonzero(proper)[whole.edge_lengths > longest_edge]
        has_long = np.zeros(whole.face_count, np.bool_)
        for turn in range(int(table.counts.max(initial=0))):
            here = long[table.counts[long] > turn]
            has_long[table.order[table.first[here] + turn] // 3] = True
        faces = np.flatnonzero(has_long)
        used = np.zeros(whole.point_count, np.bool_)
        used[corners[faces]] = True
        vertices, place = np.flatnonzero(used), np.cumsum(used) - 1
        part = Surface.of_checked(whole.points[vertices], place[corners[faces]])
        return cls(whole, part, vertices, faces)

    def cut(self, longest_edge: float, most_points: int) -> Cut:
        """Halve long edges until there are none; return the whole mesh.

        Raises
        ------
        TooManyPointsError
            When there would be more than `most_points`.
        """
        others = self.whole.point_count - len(self.vertices)
        most, cut = most_points - others, Cut.of(self.surface)
        try:
            while (more := cut.with_strips(longest_edge).halved(longest_edge, most)) is not None:
                cut = more
            cut = cut.without_strips()
            # The ways across a strip may be a little too long.
            while (more := cut.halved(longest_edge, most)) is not None:
                cut = more
        except TooManyPointsError as error:
            made, wanted = error.args
            raise TooManyPointsError(made + others, wanted) from None
        return self.with_rest(cut)

    def with_rest(self, cut: Cut) -> Cut:
        """Put the part, cut into smaller faces, back in its place."""
        points, count = self.whole.points, len(self.vertices)
        new = cut.points[count:]
        place = np.append(self.vertices, len(points) + np.arange(len(new)))
        rest = np.delete(np.arange(self.whole.face_count), self.faces)
        origin = np.append(rest, self.faces[cut.origin])
        order = np.argsort(origin, kind="stable")
        faces = np.concatenate([np.asarray(self.whole.faces)[rest], place[cut.faces]])
        points, faces = np.concatenate([points, new]), faces[order].astype(np.int64)
        return replace(cut, points=points, faces=faces, origin=origin[order])


def has_new(faces: NDArray[Any], n: int) -> NDArray[np.bool_]:
    """Tell the faces that have a vertex from the n-th on."""
    a, b, c = faces.T
    return np.asarray((a >= n) | (b >= n) | (c >= n))


MOST_POINTS = 10_000_000  # halved 100 %, doubled 100 %
"""Refinement stops with a sentence before it fills the memory."""

MOST_HALVINGS = 6

USUAL, USUAL_A_VERTEX = 25_000, 4  # halved 56 %, doubled 0 %; halved 0 %, doubled 0 %
"""Samples that a mesh is refined to at most where no one asks for more: so many, and so many for
each vertex that it has. A box has 12,000, no thin cup and none of 97 real meshes more; a heap of
large triangles that cross each other would have hundreds of thousands, and no use for them."""

MEANT = 20_000  # halved 0 %, doubled 0 %
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
    surface = Surface.of_checked(points, shape.faces).adopt(shape.topology)
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
    if not np.isfinite(allowed).any():
        return shape
    scale, tree = power_of_two_scale(shape.points), kd_tree(shape.points)

    def bound(surface: Surface, _: Rows) -> FloatArray:
        middles = surface.points[surface.edges].mean(axis=1) / scale
        return np.asarray(scale * allowed[tree.query(middles)[1]])

    begun = Cut.of(Surface.of_checked(shape.points * scale, np.asarray(shape.faces)))
    cut = _halved(begun, bound, most_points)
    return shape if cut is begun else _with_faces_of(shape, cut, scale)


def refine_faces(shape: Shape, allowed: FloatArray, most_points: int = MOST_POINTS) -> Shape:
    """Split edges that are longer than what a face beside them allows.

    Pieces of a face allow what it does, so that no other face is looked at.

    Parameters
    ----------
    shape : Shape
        A mesh of m faces.
    allowed : (m,) float64
        Longest edge of each face; inf: any.
    most_points : int
        Of as many points refinement stops.

    Returns
    -------
    Shape
        As `refine` returns it; the same object when nothing is to do.
    """
    scale = power_of_two_scale(shape.points)
    whole = Surface.of_checked(shape.points * scale, shape.faces).adopt(shape.topology)
    lengths = scale * allowed
    part = LongEdges.of(whole, _least_of_faces(whole, lengths))
    if len(part.faces) == 0:
        return shape
    lengths, begun = lengths[part.faces], Cut.of(part.surface)
    most = most_points - (whole.point_count - len(part.vertices))
    cut = _halved(begun, lambda surface, origin: _least_of_faces(surface, lengths[origin]), most)
    return shape if cut is begun else _with_faces_of(shape, part.with_rest(cut), scale)


def _least_of_faces(surface: Surface, values: FloatArray) -> FloatArray:
    """Return the least value of the faces beside each edge, (e,)."""
    least = np.full(len(surface.edges) + 1, np.inf)
    np.minimum.at(least, edges_of_sides(surface), values[:, None])
    return least[:-1]


def _halved(cut: Cut, bound: Allowed, most_points: int) -> Cut:
    """Halve edges that are too long, six times at most, and not into too many points."""
    try:
        for _ in range(MOST_HALVINGS):
            more = cut.halved(bound, most_points)
            if more is None:
                break
            cut = more
    except TooManyPointsError:
        pass  # as fine as it may be
    return cut


def _with_faces_of(shape: Shape, cut: Cut, scale: float) -> Shape:
    """Return a shape with the points and faces that it was cut into, as lengths times `scale`."""
    points, faces, n = cut.points / scale, cut.faces.astype(np.int32), shape.point_count
    points[:n] = shape.points
    around = ring_normals(points, faces[has_new(faces, n)], smooth=False)
    origin = np.full(len(points), -1, np.int32)
    origin[:n] = np.arange(n) if shape.origin is None else shape.origin
    made: dict[str, Any] = {
        "points": points,
        "normals": np.concatenate([shape.normals, around[n:]]),
    }
    made |= {"faces": faces, "origin": origin, "face_origin": cut.origin.astype(np.int32)}
    for name in ("face_origin", "face_map", "patches", "planes"):
        if (values := getattr(shape, name)) is not None:
            made[name] = values[cut.origin]
    if shape.cylinders is not None:
        made["cylinders"] = shape.cylinders.of_faces(cut.origin)
    return shape.remade(**made)


def with_refined_parts(
    shape: Shape, parts: Sequence[tuple[Shape, NDArray[np.int64], NDArray[np.int64]]]
) -> Shape:
    """Return a shape whose bodies were refined one by one.

    Parameters
    ----------
    shape : Shape
        n vertices and m faces.
    parts : sequence of (Shape, (k,) int64, (f,) int64)
        Each refined part with the points and faces of the shape that it was made of
        (`Shape.some_bodies`); together they are all faces.

    Returns
    -------
    Shape
        As `refine` returns it; the same object when no part has new points.
    """
    n = shape.point_count
    if all(part.point_count == len(rows) for part, rows, _ in parts):
        return shape
    points, normals, faces, origin = [shape.points], [shape.normals], [], []
    count = n
    for part, vertices, rows in parts:
        new = part.point_count - len(vertices)
        place = np.concatenate([vertices, count + np.arange(new)])
        points.append(part.points[len(vertices) :])
        normals.append(part.normals[len(vertices) :])
        faces.append(place[np.asarray(part.faces)])
        origin.append(rows if part.face_origin is None else rows[part.face_origin])
        count += new
    given = np.concatenate(origin)
    first = np.arange(n) if shape.origin is None else shape.origin
    made: dict[str, Any] = {
        "points": np.concatenate(points),
        "normals": np.concatenate(normals),
        "faces": np.concatenate(faces).astype(np.int32),
        "origin": np.concatenate([first, np.full(count - n, -1)]).astype(np.int32),
        "face_origin": given.astype(np.int32),
    }
    for name in ("face_origin", "face_map", "patches", "planes"):
        if (values := getattr(shape, name)) is not None:
            made[name] = values[given]
    if shape.cylinders is not None:
        made["cylinders"] = shape.cylinders.of_faces(given)
    return shape.remade(**made)


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
    surface = Surface.of_checked(shape.points * power_of_two_scale(shape.points), shape.faces)
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


APART = 0.05  # halved 0.8 %, doubled 0.8 %
"""Share of the largest eigenvalue of the sum of n n^T over the faces at a vertex above which the
others count: the second one of two normals 26 degrees apart."""

TURN = math.cos(math.radians(CREASE_ANGLE))
"""Cosine of the angle by which a face may turn: more would be a crease."""


def on_smooth_surface(shape: Shape, fine: Shape, creases: Creases) -> Shape:
    """Move the new vertices of a refined mesh to the smooth surface through the given ones.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    fine : Shape
        ``refine(shape)``: the n vertices first.
    creases : Creases
        Of `shape`.

    Returns
    -------
    Shape
        `fine` with other places and normals of its new vertices.

    Notes
    -----
    With the bulges h_f and normals n_f of the faces f at a new vertex, it moves by the shortest d
    with n_f.d = h_f. On cylinders both are known, else they follow from the normals at the corners.
    Cost O(n), and 1 us for each vertex on an edge.
    """
    from medialis.base.box_tree import nearest_on_triangles

    n = shape.point_count
    assert shape.faces is not None and fine.faces is not None and fine.face_origin is not None
    vertex, face = _vertices_of_faces(fine, n)
    corners = np.asarray(shape.faces)[face]
    weights = nearest_on_triangles(fine.points[vertex], shape.points[corners])
    normals = np.einsum("ij,ijk->ik", weights, creases.corner_normals(face))
    normals = unit_rows(normals, 0.5)
    pairs = weights * weights[:, [1, 2, 0]]
    height = np.einsum("ij,ij->i", pairs, creases.own_bulges[face])
    if (cylinders := shape.cylinders) is not None:
        rows = np.flatnonzero(cylinders.label[face] >= 0)
        which, places = cylinders.label[face[rows]], fine.points[vertex[rows]]
        normals[rows] = cylinders.normals(which, places)
        height[rows] = cylinders.heights(which, places)
    step, mean, on_crease = _common_steps(vertex - n, normals, height, fine.point_count - n)
    points = _unfolded(fine, n, np.concatenate([np.zeros((n, 3)), step]))
    around = ring_normals(points, np.asarray(fine.faces)[has_new(fine.faces, n)], smooth=False)
    directions = np.array(fine.normals)
    smooth = ~on_crease & mean.any(axis=1)
    directions[n:] = np.where(smooth[:, None], mean, around[n:])
    return fine.remade(points=points, normals=directions)


def _unfolded(fine: Shape, n: int, step: FloatArray) -> NDArray[np.float64]:
    """Return the moved points, but where a face would turn by more than what a mesh may be off.

    There, at slivers and on limbs thinner than their bulge, vertices stay on their facets.
    """
    faces = np.asarray(fine.faces)
    faces = faces[has_new(faces, n)]
    before = Surface.of_checked(fine.points, faces).face_normals
    points = fine.points + step
    while True:
        turned = (
            np.einsum("ij,ij->i", Surface.of_checked(points, faces).face_normals, before) < TURN
        )
        stay = np.unique(faces[turned & before.any(axis=1)])
        stay = stay[(points[stay] != fine.points[stay]).any(axis=1)]
        if len(stay) == 0:
            return points
        points[stay] = fine.points[stay]


def _vertices_of_faces(fine: Shape, n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the new vertices and the given faces that they lie on, each pair once.

    The pieces of a face follow each other.
    """
    flat = np.asarray(fine.faces).ravel()
    groups = Ragged.group(flat, fine.point_count)
    sides = groups.indices[groups.offsets[n] :]
    vertex, face = flat[sides].astype(np.int64), np.asarray(fine.face_origin, np.int64)[sides // 3]
    first = np.ones(len(sides), np.bool_)
    first[1:] = (vertex[1:] != vertex[:-1]) | (face[1:] != face[:-1])
    return vertex[first], face[first]


def _common_steps(
    vertex: NDArray[np.int64], normals: FloatArray, height: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return the step, the mean normal and whether sides are apart, for each vertex."""
    outer = (normals[:, :, None] * normals[:, None, :]).reshape(-1, 9)
    total = sums_of(vertex, outer, count)
    right = sums_of(vertex, height[:, None] * normals, count)
    mean = sums_of(vertex, normals, count)
    faces = np.bincount(vertex, minlength=count)
    step = right / np.maximum(faces, 1)[:, None]
    several = np.flatnonzero(faces > 1)
    values, axes = np.linalg.eigh(total.reshape(-1, 3, 3)[several])
    apart = values > APART * values[:, -1:]
    along = np.einsum("ikj,ik->ij", axes, right[several])
    along = np.divide(along, values, out=np.zeros_like(along), where=apart & (values > 0))
    step[several] = np.einsum("ikj,ij->ik", axes, along)
    on_crease = np.zeros(count, np.bool_)
    on_crease[several] = apart.sum(axis=1) > 1
    return step, unit_rows(mean, 0.5), on_crease
