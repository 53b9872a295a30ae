"""Shortest straightest geodesics between vertices of a mesh (thesis 3.3.1-3.3.2).

`trace` measures many pairs: plane cuts in all directions, the best of them shortened; where none
arrives, the shortest path along the edges, found by a search of its own or through landmarks.
`GeodesicPaths` holds the lengths and the directions at both ends, a `Geodesic` one path as a
polyline: the cut or the path along the edges, shortened until it is straight everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described, Index, Mask, Ragged, along_space, unit_rows
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.options import Options, whole
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, Positions, frozen, hold
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.shape import Shape

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from medialis.skeleton.importance._walk_kernels import Paths, Walk

FIRST_LIMIT = 1.7  # halved 0 %, doubled < 0.1 %
"""Times the straight line between the ends, where the search for plane cuts begins; a half circle
has pi / 2."""

SHORT_CUT = 3.4  # halved < 0.1 %, doubled 100 %
"""Times the straight line: pairs without a plane cut as short as this are looked at anew."""

SHORT_SPACINGS = 16  # halved 15 %, doubled 34 %
"""Or this many spacings, where pairs follow others: in thin walls the straight line is short."""

OPEN_SHARE = 0.1  # halved 0 %, doubled < 0.1 %
"""Where more pairs than this part of the vertices are open then, as on crumpled surfaces and thin
plates, paths through landmarks tell how long their plane cuts may be."""

MOST_BOUNDED = 100_000  # halved 0 %, doubled 0 %
"""Vertices up to which they do: on more, the landmarks take too long."""

BOUNDING_LANDMARKS = 16  # halved 6 %, doubled 3 %
"""Landmarks that tell how long plane cuts may be."""

DETOUR = 1.25  # halved 100 %, doubled 89 %
"""Times a path along the edges through a landmark: longer cuts are not straight, they go the wrong
way round."""

PAIRS_A_CHUNK = 256  # halved 0 %, doubled 0 %
"""Searched on their own."""

FOLLOWING_A_CHUNK = 1024  # halved 23 %, doubled 6 %
"""That may follow each other."""

FEW_PAIRS = 0.25
"""Share of the vertices: for more pairs the mesh is put in order first, for 3 % of their time."""

PLACED_A_CHUNK = 1 << 14
"""Vertices or faces that are put in order at a time."""

SEARCHES_A_CHUNK = 16  # halved 0 %, doubled 0 %
"""Along edges."""

SETTLED_FIRST = 4
"""Vertices that the first searches along edges may look at in all, for each one of the shape."""

SOON_FOUND = 0.1
"""Share of pairs found by which more may look at four times as many. Round a hole one ends soon;
between the sides of a wall it looks at most of the shape, and one from a landmark serves all."""

SETTLED_LAST = 2_000_000
"""Vertices that the last ones may look at in all, for pairs that no landmark is on the way of."""

SETTLED_ALONG_BORDERS = 1000
"""Vertices that a search along edges may look at where a hole is between the ends of a pair."""

MANY_FAR = 0.02
"""Part of the vertices: where more pairs have plane cuts that lead far round, as on crumpled
surfaces, they stay."""

USUAL_FACES = 12.0  # halved 0 %, doubled 0 %
"""Faces at a vertex, twice as many as usual, from which on fewer vertices are looked at."""

LANDMARKS = 64  # halved 45 %, doubled 22 %
"""Vertices that paths lead through where the searches along edges are too long, at most."""

NEARLY_SHORTEST = 1.01
"""Times the shortest that paths through landmarks may be long. They lead straight over single edges
as well: among equilateral triangles up to 1.04 times the geodesic, where others have 1.15."""

PATHS_A_CHUNK = 4
"""Polylines."""


class PathStatus(IntEnum):
    """How the length of a geodesic was found."""

    NONE = 0
    """There is no path, as the ends lie in different components, or the pair is masked."""
    PLANE = 1
    """A cut of the surface by a plane through the ends, shortened to a locally shortest path (or a
    common edge)."""
    EDGES = 2
    """The shortest path along the edges, where no plane cut arrives (holes, non-manifold edges).
    For a polyline: it was shortened from the path along the edges, as that is shorter."""
    NEIGHBOUR = 3
    """Along edges to the ends of a neighbouring path, and along that; shorter than its own."""


@dataclass(frozen=True, eq=False, repr=False)
class GeodesicPaths(Bound):
    """One geodesic for each of k pairs of vertices.

    Attributes
    ----------
    length : (k,) float64
        Length of the path in the units of the shape. +inf: there is no path, the ends lie in
        different components. NaN: the pair is masked (a ball without a second feature point).
    start_tangent, end_tangent : (k, 3) float64
        Unit direction of the path as it leaves the first vertex (t_s of the thesis) and as it
        arrives at the second one (t_e); NaN where there is no path or the ends coincide.
    status : (k,) int8
        A `PathStatus`.

    Raises
    ------
    InvalidShapeError
        When the arrays do not have the same number of rows.
    """

    length: FloatArray
    start_tangent: FloatArray
    end_tangent: FloatArray
    status: NDArray[np.int8]

    def __post_init__(self) -> None:
        k = len(self.length)
        hold(self, length=k, start_tangent=(k, 3), end_tangent=(k, 3), status=k)

    def __len__(self) -> int:
        return len(self.length)

    @property
    def reached(self) -> Mask:
        """True where a path was found, (k,)."""
        return self.status != PathStatus.NONE

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self)} paths, {int(self.reached.sum())} arrive)"


@dataclass(frozen=True, eq=False, repr=False)
class Geodesic(Described):
    """One path over the surface.

    Attributes
    ----------
    points : (p, 3) float64
        Polyline from end to end.
    length : float
        In the units of the shape.
    status : PathStatus
        PLANE or EDGES: the path that was shortened to this one.
    """

    points: Positions
    length: float
    status: PathStatus


@dataclass(frozen=True, kw_only=True)
class GeodesicOptions(Options):
    """Options of all that measures geodesics; `directions` is M of the thesis."""

    directions: int = whole(
        20,
        "Directions",
        "Directions in which each geodesic is tried. More find shorter paths in strongly folded "
        "places and take longer.",
        low=2,
        high=1000,
        advanced=True,
    )


def geodesic_lengths(
    shape: ShapeLike,
    pairs: ArrayLike,
    *,
    directions: int = GeodesicOptions.directions,
    progress: Progress | ProgressCallback | None = None,
) -> GeodesicPaths:
    """Compute shortest straightest geodesics for pairs of vertices.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    pairs : (k, 2) int
        Vertex indices 0..n-1; a negative one masks its pair (length NaN).
    directions : int
        Directions round the line between the ends, 2 to 1000: more find shorter paths in strongly
        folded places and take longer.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    GeodesicPaths
        Lengths are never below the exact geodesic distance, but for rounding.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, or the pairs are not (k, 2) vertex indices.
    InvalidOptionError
        When `directions` is out of its range.
    Cancelled
        When `progress` asks for it.

    See Also
    --------
    geodesics : the polylines, shortened.
    geodesic_importance : between the feature points of balls.

    Notes
    -----
    Cost: directions times the faces that a path crosses, O(sqrt(n)) each, and some rounds over
    those of the best one. The result does not depend on the order of the pairs or the number of
    threads.

    Source: thesis 3.3.1-3.3.2, Eq. 3.1. Deviates: planes are spread from the plane of the two
    vertex normals; the best cut, and up to three others at most 1.1 times as long, are shortened to
    locally shortest paths; a path is dropped when its length plus the straight line that remains
    exceeds the best length (the thesis compares the length so far); where no plane cut arrives, the
    shortest path along the edges is taken. Where such a search would look at too many vertices, it
    is one through the starts of such pairs, and straight over single edges, until it is at most
    1.01 times too long; 64 starts are tried. Where many pairs have no cut of less than 3.4 times
    the straight line, one that is 1.25 times as long as such a path is given up.

    Examples
    --------
    >>> import medialis
    >>> square = medialis.make_shape([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    ...                              [[0, 1, 2], [0, 2, 3]])
    >>> medialis.geodesic_lengths(square, [[1, 3], [0, 0]]).length.round(6).tolist()
    [1.414214, 0.0]
    """
    options = GeodesicOptions(directions=directions)
    steps = Progress.of(progress)
    shape = as_shape(shape, steps)
    ends = as_pairs(pairs, shape.point_count)
    return trace(shape, ends, options.directions, False, steps)


def surface_walk(shape: Shape) -> Walk:
    """Return a mesh as kernels walk over it.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces.
    """
    from medialis.skeleton.importance._walk_kernels import Walk

    if shape.faces is None:
        raise InvalidShapeError(
            "Geodesics need a surface: this shape is a point cloud without faces. Use the "
            "local measures (spoke angle, radius), or reconstruct a mesh first."
        )
    fans = shape.fans
    return Walk(shape.points, shape.faces.ravel(), shape.edge_twins, fans.offsets, fans.indices)


def trace(
    shape: Shape, ends: IntArray, directions: int, following: bool, progress: Progress
) -> GeodesicPaths:
    """Cut all pairs by planes, with `following` few in all directions and the others as these.

    Where no plane cut arrives, follow the edges.
    """
    with progress.stage("geodesics", 0.0, 0.9):
        out = cut_by_planes(shape, ends, directions, progress, following)
        if following and (shape.edge_twins < 0).any():
            _along_borders(shape, ends, out, progress.still)
    joined = np.equal(*shape.components[ends].T) & (ends >= 0).all(axis=1)
    with progress.stage("edge paths", 0.9, 1.0):
        rows, found = np.flatnonzero((out.status == PathStatus.NONE) & joined), math.inf
        most = SETTLED_FIRST * shape.point_count
        while found > SOON_FOUND * len(rows):
            _follow_edges(shape, ends, rows, _share(shape, most, rows), out, progress.still)
            left = rows[out.status[rows] == PathStatus.NONE]
            found, rows, most = len(rows) - len(left), left, 4 * most
        with progress.stage("edge paths", 0.1, 0.5):
            rows = _through_landmarks(shape, ends, rows, out, progress)
        with progress.stage("edge paths", 0.5, 0.9):
            _follow_edges(shape, ends, rows, _share(shape, SETTLED_LAST, rows), out, progress)
        rows = rows[out.status[rows] == PathStatus.NONE]
        with progress.stage("edge paths", 0.9, 1.0):
            _follow_edges(shape, ends, rows, shape.point_count, out, progress)
    return GeodesicPaths(out.length, out.start_tangent, out.end_tangent, out.status)


def _along_borders(shape: Shape, ends: IntArray, out: Paths, progress: Progress) -> None:
    """Search along the edges for pairs whose plane cuts, which end at borders, lead far round."""
    straight = np.linalg.norm(shape.points[ends[:, 0]] - shape.points[ends[:, 1]], axis=1)
    far = (out.length > 2.0 * SHORT_CUT * straight) & (out.status == PathStatus.PLANE)
    rows = np.flatnonzero(far)
    if len(rows) > MANY_FAR * shape.point_count:
        return
    parts = {name: values for name, values in out._asdict().items() if name != "normal"}
    found = out._replace(**{name: values[rows] for name, values in parts.items()})
    _follow_edges(shape, ends[rows], np.arange(len(rows)), SETTLED_ALONG_BORDERS, found, progress)
    shorter = found.length < out.length[rows]
    for name, values in parts.items():
        values[rows[shorter]] = getattr(found, name)[shorter]


def _share(shape: Shape, most: int, rows: Index) -> int:
    """Return how many vertices each search for some pairs may look at, of so many in all.

    A vertex with hundreds of faces costs as many times what another one does, and searches pass
    through it: the fewer vertices, the more faces there are at the vertices of a face, in the mean.
    """
    if len(rows) == 0:
        return 0
    faces = shape.fans.lengths.astype(np.float64)
    busy = float(np.square(faces).sum()) / max(float(faces.sum()), 1.0) / USUAL_FACES
    return int(most / max(1.0, busy)) // max(len(rows), 1)


def _follow_edges(
    shape: Shape, ends: IntArray, rows: Index, most: int, out: Paths, progress: Progress
) -> None:
    """Search the shortest paths along edges of some pairs, each among `most` vertices."""
    from medialis.skeleton.importance._walk_kernels import edge_paths

    given = rows, most, surface_walk(shape), ends, out
    run_chunks(edge_paths, len(rows), SEARCHES_A_CHUNK, *given, progress=progress)


def _through_landmarks(
    shape: Shape, ends: IntArray, rows: Index, out: Paths, progress: Progress
) -> Index:
    """Give some pairs the shortest path that passes through a landmark; return those it fails.

    One search from each landmark serves all pairs. The landmarks are start vertices: each that of
    the path that may be too long by the largest share of its length.
    """
    from scipy.sparse.csgraph import dijkstra

    if len(rows) == 0:
        return rows
    points = shape.points
    starts, goals = ends[rows].T
    least = np.linalg.norm(points[starts] - points[goals], axis=1)
    least = np.maximum(least, 1e-9 * shape.diagonal)  # vertices may be at the same place
    graph, worst = run_patiently(lambda: _graph(shape, True), progress), 0
    for number in range(LANDMARKS):
        progress.update(number / LANDMARKS)
        landmark = int(starts[worst])
        limit = NEARLY_SHORTEST * float(out.length[rows].max())
        distance, before = dijkstra(graph, True, landmark, True, limit=limit)
        length = distance[starts] + distance[goals]
        shorter = np.flatnonzero(length < out.length[rows])
        for side, tangents, sign in ((starts, out.start_tangent, 1), (goals, out.end_tangent, -1)):
            here, other = side[shorter], (starts + goals - side)[shorter]
            there = np.array(before[here])
            for k in np.flatnonzero(here == landmark):  # the path begins or ends in the landmark
                there[k] = other[k]
                while before[there[k]] != landmark:
                    there[k] = before[there[k]]
            tangents[rows[shorter]] = unit_rows(
                sign * (points[there] - points[here]), instead=np.nan
            )
        out.length[rows[shorter]] = length[shorter]
        out.status[rows[shorter]] = PathStatus.EDGES
        known = np.isfinite(length)  # of this component
        apart = np.abs(distance[starts[known]] - distance[goals[known]])
        least[known] = np.maximum(least[known], apart)
        excess = out.length[rows] / least
        worst = int(excess.argmax())
        if excess[worst] <= NEARLY_SHORTEST:
            break
    return rows[excess > NEARLY_SHORTEST]


def _graph(shape: Shape, over: bool) -> csr_array:
    """Return the lengths of edges (n, n), with `over` of straight ways over single ones as well."""
    from scipy.sparse import csr_array

    from medialis.skeleton.importance._walk_kernels import over_edges

    (a, b), size, n = shape.edges.T, shape.edge_lengths, shape.point_count
    if over:
        ends, ways = np.empty((3 * shape.face_count, 2), np.int32), np.empty(3 * shape.face_count)
        count = over_edges(surface_walk(shape), ends, ways)
        a, b = np.concatenate([shape.edges, ends[:count]]).T
        size = np.concatenate([size, ways[:count]])
        key = np.minimum(a, b) * np.int64(n) + np.maximum(a, b)
        order = np.lexsort((size, key))  # of ways between the same vertices the shortest counts
        kept = order[np.diff(key[order], prepend=-1) != 0]
        a, b, size = a[kept], b[kept], size[kept]
    size = np.maximum(size, 1e-300)  # a stored zero is no edge
    return csr_array((np.r_[size, size], (np.r_[a, b], np.r_[b, a])), shape=(n, n))


def cut_by_planes(
    shape: Shape, ends: IntArray, directions: int, progress: Progress, following: bool = False
) -> Paths:
    """Shortest plane cut of each pair, shortened."""
    from medialis.shape._kernels import measure_edges
    from medialis.skeleton.importance._geodesic_kernels import OPEN, Search, trace_geodesics
    from medialis.skeleton.importance._walk_kernels import Paths

    k, starts, named, normals = len(ends), ends[:, 0], ends, shape.normals
    start, end, normal = (np.full((n, 3), np.nan) for n in (k, k, 0 if following else k))
    out = Paths(np.full(k, np.inf), start, end, normal, np.zeros(k, np.int8))
    walk = run_patiently(lambda: surface_walk(shape), progress)
    components = run_patiently(lambda: shape.components, progress)
    if k > FEW_PAIRS * shape.point_count:
        place, order, walk = run_patiently(lambda: along_curve(shape, walk), progress)
        named = np.where(ends < 0, ends, place[ends])
        normals, components = normals[order], components[order]
        del place
    planes = math.ceil(directions / 2)

    def trace_all(rows: Index, limits: FloatArray, longest: FloatArray) -> None:
        search = Search(normals, components, named, limits, longest, planes, following)
        size = FOLLOWING_A_CHUNK if following else PAIRS_A_CHUNK
        run_chunks(trace_geodesics, len(rows), size, rows, walk, search, out, progress=progress)

    with progress.stage("geodesics", 0.0, 0.8):
        straight = np.empty(k)
        measure_edges(shape.points, ends, straight)
        least = SHORT_SPACINGS * shape.spacing if following else 0.0
        order = run_patiently(
            lambda: np.argsort(along_space(shape.points)[starts], kind="stable"), progress
        )
        trace_all(order, FIRST_LIMIT * straight, np.maximum(SHORT_CUT * straight, least))
    rows = order[out.status[order] == OPEN]
    with progress.stage("geodesics", 0.8, 1.0):
        longest = _longest_cuts(shape, ends, rows, progress)
        usual = np.where(np.isfinite(longest), longest / 2, 0.0)
        trace_all(rows, np.maximum(usual, 2 * SHORT_CUT * straight), longest)
    out.status[rows] = np.maximum(out.status[rows], PathStatus.NONE)
    return out


def along_curve(shape: Shape, walk: Walk) -> tuple[IntArray, Index, Walk]:
    """Return a walk whose vertices and faces stand in memory as along a Z-curve: places, order.

    Where they do not, as after a subdivision, each step waits for memory. What follows a vertex
    and what follows a face stays in its order, so that all paths are the same.
    """
    from medialis.skeleton.importance._walk_kernels import Walk

    order = np.argsort(along_space(shape.points), kind="stable")
    place = np.empty(shape.point_count, np.int32)
    place[order] = np.arange(shape.point_count, dtype=np.int32)
    corners = place[walk.corners].reshape(-1, 3)
    lowest = np.minimum(np.minimum(corners[:, 0], corners[:, 1]), corners[:, 2])
    turn = Ragged.group(lowest, shape.point_count).indices
    rank = np.empty(len(turn), np.int32)
    rank[turn] = np.arange(len(turn), dtype=np.int32)

    twins, fan = np.empty((len(turn), 3), np.int32), np.empty_like(walk.fan)
    offsets = np.concatenate([[0], np.cumsum(np.diff(walk.offsets)[order])])

    def side(old: IntArray) -> IntArray:
        face = old // 3
        return np.where(old < 0, -1, old + 3 * (rank[face] - face))

    def place_twins(begin: int, end: int) -> None:
        twins[begin:end] = side(walk.twins.reshape(-1, 3)[turn[begin:end]])

    def place_fans(begin: int, end: int) -> None:
        fan[offsets[begin] : offsets[end]] = side(shape.fans.joined(order[begin:end]))

    run_chunks(place_twins, len(turn), PLACED_A_CHUNK)
    run_chunks(place_fans, len(order), PLACED_A_CHUNK)
    points, corners = shape.points[order], corners[turn]
    return place, order, Walk(points, corners.ravel(), twins.ravel(), offsets, fan)


def _longest_cuts(shape: Shape, ends: IntArray, rows: Index, progress: Progress) -> FloatArray:
    """Return how long the plane cuts of some pairs may be, for all k pairs."""
    from scipy.sparse.csgraph import dijkstra

    longest = np.full(len(ends), np.inf)
    if OPEN_SHARE * shape.point_count < len(rows) and shape.point_count <= MOST_BOUNDED:
        starts, goals = ends[rows].T
        far, landmark, graph = np.full(len(starts), np.inf), int(starts[0]), _graph(shape, False)
        for number in range(BOUNDING_LANDMARKS):
            progress.still.update(number / BOUNDING_LANDMARKS)
            distance = dijkstra(graph, indices=landmark)
            through = DETOUR * (distance[starts] + distance[goals])
            longest[rows] = np.minimum(longest[rows], through)
            far = np.minimum(far, distance[starts])
            landmark = int(starts[far.argmax()])
    return longest


def as_pairs(pairs: ArrayLike, count: int) -> IntArray:
    """Return pairs of vertices (k, 2) int32, checked; negative ones are masked."""
    array = np.asarray(pairs)
    if array.size == 0:
        array = np.empty((0, 2), np.int64)
    if array.ndim != 2 or array.shape[1] != 2 or array.dtype.kind not in "iu":
        raise InvalidShapeError(
            f"pairs must be a (k, 2) array of vertex indices, got {array.dtype} {array.shape}."
        )
    if array.size and array.max() >= count:
        raise InvalidShapeError(
            f"pairs must name vertices 0..{count - 1} (negative: masked), got {array.max()}."
        )
    return np.array(array, np.int32, order="C")  # a copy, which kernels see as one type


def geodesic(
    shape: ShapeLike, start: int, end: int, *, directions: int = GeodesicOptions.directions
) -> Geodesic:
    """Compute one geodesic with its polyline: a locally shortest path.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    start, end : int
        Vertex indices.
    directions : int
        As in `geodesic_lengths`.

    Returns
    -------
    Geodesic
        ``points`` (p, 3) runs from the start to the end vertex over the faces. It is never longer
        than the best plane cut, nor than the shortest path along the edges.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, a vertex does not exist, or no path joins the two.
    InvalidOptionError
        When `directions` is out of its range.

    See Also
    --------
    geodesics : many at once.
    geodesic_lengths : lengths alone, faster.

    Notes
    -----
    Cost: a search over all vertices, O(n log n), and some rounds over the faces that the path
    crosses: 10 to 40 ms on 50,000 vertices. Start and end may be exchanged: the path is the same.

    Source: thesis 3.3.2. Deviates: between distant vertices of a folded shape every plane cut is a
    detour; so both the best cut and the shortest path along edges, and straight over single edges,
    are shortened until they are straight everywhere, and the shorter one is taken. It is the
    shortest in its neighbourhood; another way round may be shorter by some per cent.

    Examples
    --------
    >>> import medialis
    >>> path = medialis.geodesic(medialis.organic_shape(56), 0, 100)
    >>> path.points.shape[1], bool(path.length > 0)
    (3, True)
    """
    shape = as_shape(shape)
    if min(start, end) < 0:
        raise InvalidShapeError(f"Vertices must be 0..{shape.point_count - 1}, got {start}, {end}.")
    path = geodesics(shape, [[start, end]], directions=directions)[0]
    if path is None:
        raise InvalidShapeError(
            f"No path joins the vertices {start} and {end}: they lie in different components."
        )
    return path


def geodesics(
    shape: ShapeLike,
    pairs: ArrayLike,
    *,
    directions: int = GeodesicOptions.directions,
    progress: Progress | ProgressCallback | None = None,
) -> list[Geodesic | None]:
    """Compute the polylines of many geodesics; None where there is no path or the pair is masked.

    Parameters and errors are those of `geodesic_lengths`, paths and cost those of `geodesic`.

    See Also
    --------
    geodesic : one path.
    geodesic_lengths : lengths alone, faster.

    Examples
    --------
    >>> import medialis
    >>> paths = medialis.geodesics(medialis.organic_shape(56), [[0, 100], [5, 5]])
    >>> [round(path.length, 1) for path in paths]
    [..., 0.0]
    """
    options, task = GeodesicOptions(directions=directions), Progress.of(progress)
    shape = as_shape(shape, task)
    ends, walk = as_pairs(pairs, shape.point_count), surface_walk(shape)
    with task.stage("plane cuts", 0.0, 0.3):
        out = cut_by_planes(shape, np.sort(ends, axis=1), options.directions, task)
    paths: list[Geodesic | None] = [None] * len(ends)

    def shorten_rows(begin: int, end: int) -> None:
        for row in range(begin, end):
            paths[row] = _shortest(shape, walk, ends[row], row, out)

    with task.stage("shortening", 0.3, 1.0):
        run_chunks(shorten_rows, len(ends), PATHS_A_CHUNK, progress=task)
    return paths


def _shortest(shape: Shape, walk: Walk, ends: IntArray, row: int, out: Paths) -> Geodesic | None:
    """Shorten the plane cut and the path along the edges; the lower vertex first, for symmetry."""
    from medialis.skeleton.importance._path_kernels import shorten
    from medialis.skeleton.importance._walk_kernels import record_cut, short_path

    low, high = np.sort(ends)
    if low < 0 or shape.components[low] != shape.components[high]:
        return None
    is_cut = out.status[row] == PathStatus.PLANE
    if is_cut and np.isnan(out.normal[row, 0]):  # a common edge, or no way to go
        return _as_geodesic(shape.points[ends], PathStatus.PLANE)
    starts = [(short_path(walk, low, high), PathStatus.EDGES)]
    if is_cut:
        sides = np.empty(shape.face_count, np.int64)
        count = record_cut(walk, low, high, out.normal[row], sides)
        cut = np.concatenate([[-1 - low], sides[:count], [-1 - high]])
        starts.insert(0, (cut, PathStatus.PLANE))
    paths = [_as_geodesic(shorten(walk, items), status) for items, status in starts]
    best = min(paths, key=lambda path: path.length)
    back = ends[0] != low
    return replace(best, points=frozen(best.points[::-1], np.float64)) if back else best


def _as_geodesic(points: FloatArray, status: PathStatus) -> Geodesic:
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return Geodesic(frozen(points, np.float64), length, status)
