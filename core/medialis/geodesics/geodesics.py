"""Shortest straightest geodesics between vertices of a mesh (thesis 3.3.1-3.3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import Described
from medialis.model.geodesic_paths import GeodesicPaths, PathStatus
from medialis.model.shape import Shape
from medialis.options import Options, whole
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_chunks
from medialis.validation import FloatArray, frozen

HALVINGS = 4
"""Of the angle between planes, round the best one: 18 degrees become about 1. Eight extra paths
bring the median error of the default from 0.01 % down to 0.001 % (docs/benchmarks.md)."""

PAIRS_A_CHUNK = 256
SEARCHES_A_CHUNK = 16
PATHS_A_CHUNK = 4

Walk = tuple[NDArray[Any], ...]
"""What `surface_walk` returns."""


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

    points: FloatArray
    length: float
    status: PathStatus


def geodesic_lengths(
    shape: Shape,
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
    Cost: directions times the faces that a path crosses, O(sqrt(n)) each. The result does not
    depend on the order of the pairs or the number of threads.

    Source: thesis 3.3.1-3.3.2, Eq. 3.1. Deviates: planes are spread from the plane of the two
    vertex normals, and halved round the best one; a path is dropped when its length plus the
    straight line that remains exceeds the best length (the thesis compares the length so far);
    where no plane cut arrives, the shortest path along the edges is taken.

    Examples
    --------
    >>> import medialis
    >>> square = medialis.make_shape([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    ...                              [[0, 1, 2], [0, 2, 3]])
    >>> medialis.geodesic_lengths(square, [[1, 3], [0, 0]]).length.round(6).tolist()
    [1.414214, 0.0]
    """
    options = GeodesicOptions(directions=directions)
    ends = _as_pairs(pairs, shape.point_count)
    out = _trace(shape, ends, options.directions, Progress.of(progress))
    return GeodesicPaths(out["length"], out["start_tangent"], out["end_tangent"], out["status"])


def geodesic(
    shape: Shape, start: int, end: int, *, directions: int = GeodesicOptions.directions
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
    if min(start, end) < 0:
        raise InvalidShapeError(f"Vertices must be 0..{shape.point_count - 1}, got {start}, {end}.")
    path = geodesics(shape, [[start, end]], directions=directions)[0]
    if path is None:
        raise InvalidShapeError(
            f"No path joins the vertices {start} and {end}: they lie in different components."
        )
    return path


def geodesics(
    shape: Shape,
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
    ends, walk = _as_pairs(pairs, shape.point_count), surface_walk(shape)
    with task.stage("plane cuts", 0.0, 0.3):
        out = _cut(shape, np.sort(ends, axis=1), options.directions, task)
    paths: list[Geodesic | None] = [None] * len(ends)

    def shorten_rows(begin: int, end: int) -> None:
        for row in range(begin, end):
            paths[row] = _shortest(shape, walk, ends[row], row, out)

    with task.stage("shortening", 0.3, 1.0):
        run_chunks(shorten_rows, len(ends), PATHS_A_CHUNK, progress=task)
    return paths


def _shortest(
    shape: Shape, walk: Walk, ends: NDArray[np.int32], row: int, out: dict[str, NDArray[Any]]
) -> Geodesic | None:
    """Shorten the plane cut and the path along the edges; the lower vertex first, for symmetry."""
    from medialis.geodesics._edge_path_kernels import short_path
    from medialis.geodesics._geodesic_kernels import record_cut
    from medialis.geodesics._shortening_kernels import shorten

    low, high = np.sort(ends)
    if low < 0 or shape.components[low] != shape.components[high]:
        return None
    is_cut = out["status"][row] == PathStatus.PLANE
    if is_cut and np.isnan(out["normal"][row, 0]):  # a common edge, or no way to go
        return _as_geodesic(shape.points[ends], PathStatus.PLANE)
    starts = [(short_path(*walk, low, high), PathStatus.EDGES)]
    if is_cut:
        sides = np.empty(shape.face_count, np.int64)
        count = record_cut(*walk, low, high, out["normal"][row], sides)
        cut = np.concatenate([[-1 - low], sides[:count], [-1 - high]])
        starts.insert(0, (cut, PathStatus.PLANE))
    paths = [_as_geodesic(shorten(*walk, items), status) for items, status in starts]
    best = min(paths, key=lambda path: path.length)
    back = ends[0] != low
    return replace(best, points=frozen(best.points[::-1], np.float64)) if back else best


def _as_geodesic(points: FloatArray, status: PathStatus) -> Geodesic:
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return Geodesic(frozen(points, np.float64), length, status)


def surface_walk(shape: Shape) -> Walk:
    """Return the arrays that kernels need to walk over a mesh.

    Points, corners (3m,), half-edge twins (3m,), and the half-edges that leave each vertex as
    offsets (n + 1,) and a list (3m,).

    Raises
    ------
    InvalidShapeError
        When the shape has no faces.
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "Geodesics need a surface: this shape is a point cloud without faces. Use the "
            "local measures (spoke angle, radius), or reconstruct a mesh first."
        )
    fans = shape.fans
    return shape.points, shape.faces.ravel(), shape.edge_twins, fans.offsets, fans.indices


def _trace(
    shape: Shape, ends: NDArray[np.int32], directions: int, progress: Progress
) -> dict[str, NDArray[Any]]:
    """Cut all pairs by planes; follow the edges where no plane cut arrives."""
    from medialis.geodesics._edge_path_kernels import edge_paths

    with progress.stage("geodesics", 0.0, 0.9):
        out = _cut(shape, ends, directions, progress)
    starts, goals = np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1])
    points, corners, _, offsets, fan = surface_walk(shape)
    components = shape.components
    with progress.stage("edge paths", 0.9, 1.0):
        lost = out["status"] == PathStatus.NONE
        lost &= (ends >= 0).all(axis=1) & (components[starts] == components[goals])
        rows = np.flatnonzero(lost)

        def search(begin: int, end: int) -> None:
            edge_paths(
                begin, end, rows, points, corners, offsets, fan, starts, goals, out["length"],
                out["start_tangent"], out["end_tangent"], out["status"],
            )  # fmt: skip

        run_chunks(search, len(rows), SEARCHES_A_CHUNK, progress=progress)
    return out


def _cut(
    shape: Shape, ends: NDArray[np.int32], directions: int, progress: Progress
) -> dict[str, NDArray[Any]]:
    """Shortest plane cut of each pair, with the plane's normal (NaN: an edge, or one place)."""
    from medialis.geodesics._geodesic_kernels import trace_geodesics

    k = len(ends)
    out: dict[str, NDArray[Any]] = {
        "length": np.empty(k),
        "start_tangent": np.full((k, 3), np.nan),
        "end_tangent": np.full((k, 3), np.nan),
        "normal": np.full((k, 3), np.nan),
        "status": np.zeros(k, np.int8),
    }
    starts, goals = np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1])
    points, *connectivity = surface_walk(shape)
    components = shape.components

    def trace(begin: int, end: int) -> None:
        trace_geodesics(
            begin, end, points, shape.normals, *connectivity, components,
            starts, goals, math.ceil(directions / 2), HALVINGS, *out.values(),
        )  # fmt: skip

    run_chunks(trace, k, PAIRS_A_CHUNK, progress=progress)
    return out


def _as_pairs(pairs: ArrayLike, count: int) -> NDArray[np.int32]:
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
    return np.ascontiguousarray(array, dtype=np.int32)
