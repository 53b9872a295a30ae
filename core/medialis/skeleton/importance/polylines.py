"""Geodesics as polylines: plane cuts and paths along edges, shortened (thesis 3.3.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described
from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, Positions, frozen
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.shape import Shape
from medialis.skeleton.importance.geodesics import (
    GeodesicOptions,
    PathStatus,
    Walk,
    as_pairs,
    cut_by_planes,
    surface_walk,
)

PATHS_A_CHUNK = 4


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


def _shortest(
    shape: Shape, walk: Walk, ends: NDArray[np.int32], row: int, out: dict[str, NDArray[Any]]
) -> Geodesic | None:
    """Shorten the plane cut and the path along the edges; the lower vertex first, for symmetry."""
    from medialis.skeleton.importance._path_kernels import short_path, shorten
    from medialis.skeleton.importance._plane_kernels import record_cut

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
