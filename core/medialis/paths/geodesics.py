"""Shortest straightest geodesics between vertices of a mesh (thesis 3.3.1-3.3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError
from medialis.model.geodesic_paths import GeodesicPaths, PathStatus
from medialis.model.shape import Shape
from medialis.options import Options, whole
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_chunks

HALVINGS = 4
"""Of the angle between planes, round the best one: 18 degrees become about 1. Eight extra paths
bring the median error of the default from 0.01 % down to 0.001 % (docs/benchmarks.md)."""

PAIRS_A_CHUNK = 256
SEARCHES_A_CHUNK = 16

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
    ends = as_pairs(pairs, shape.point_count)
    out = _trace(shape, ends, options.directions, Progress.of(progress))
    return GeodesicPaths(out["length"], out["start_tangent"], out["end_tangent"], out["status"])


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
    from medialis.paths._edge_path_kernels import edge_paths

    with progress.stage("geodesics", 0.0, 0.9):
        out = cut_by_planes(shape, ends, directions, progress)
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


def cut_by_planes(
    shape: Shape, ends: NDArray[np.int32], directions: int, progress: Progress
) -> dict[str, NDArray[Any]]:
    """Shortest plane cut of each pair, with the plane's normal (NaN: an edge, or one place)."""
    from medialis.paths._geodesic_kernels import trace_geodesics

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


def as_pairs(pairs: ArrayLike, count: int) -> NDArray[np.int32]:
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
    return np.ascontiguousarray(array, dtype=np.int32)
