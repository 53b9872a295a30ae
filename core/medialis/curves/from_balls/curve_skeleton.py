"""Curve skeleton of a mesh from its surface skeleton, as a graph (thesis 3.6)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from medialis.curves.from_balls.area import area_importance
from medialis.curves.from_balls.ball_links import BallLinks
from medialis.curves.from_balls.candidates import (
    CandidateMeasure,
    candidate_measure,
    nearest_neighbours,
)
from medialis.curves.from_balls.reconstruction import (
    finish_graph,
    link_skeleton,
    node_importance,
    put_in_shape,
)
from medialis.curves.graph.growth import grow_graph
from medialis.curves.graph.handles import Handles, find_handles
from medialis.curves.graph.simplification import simplify_branches
from medialis.errors import InvalidShapeError
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.geodesic_paths import GeodesicPaths
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.validation import FloatArray, IntArray, as_number, frozen

DEFAULT_THRESHOLD = 0.04
DEFAULT_CANDIDATES = 0.015
"""Fraction of the diagonal. On hand, fertility, horse these are the curves one would draw."""

DEFAULT_SMOOTHING = 0.7

MOST_MEASURED = 2000
"""Candidates whose importance is measured; a curve needs no more, a round tube has far more."""


@dataclass(frozen=True, eq=False)
class CurveSkeletonResult:
    """A curve skeleton and what it was made of.

    Attributes
    ----------
    skeleton : CurveSkeleton
    measured : CandidateMeasure
        Of all k skeleton points.
    candidates : (c,) int32
        Rows of the skeleton points that are candidates.
    importance : (c,) float64
        Their mu, an area, each the median over itself and its neighbours.
    kept : (c,) bool
        Candidates whose importance reaches the threshold.
    genus : dict
        Genus of each component of the shape that encloses a solid; components with non-manifold
        edges are missing.
    loops : dict
        Loops that were closed, by the same components.
    """

    skeleton: CurveSkeleton
    measured: CandidateMeasure
    candidates: IntArray
    importance: FloatArray
    kept: NDArray[np.bool_]
    genus: dict[int, int]
    loops: dict[int, int]


def curve_skeleton(
    shape: Shape,
    cloud: MedialCloud,
    paths: GeodesicPaths,
    *,
    threshold: float = DEFAULT_THRESHOLD,
    candidates: float = DEFAULT_CANDIDATES,
    smoothing: float = DEFAULT_SMOOTHING,
    simplify: float = 0.0,
    progress: Progress | ProgressCallback | None = None,
) -> CurveSkeleton:
    """Compute the curve skeleton of a mesh as a graph.

    The graph has one component for each component of the shape and one loop for each handle. It
    runs along the points of the surface skeleton from which geodesics start to all sides; gaps
    between them are closed along the surface skeleton.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    cloud : MedialCloud
        ``surface_skeleton(shape)``: all n inner balls, row i of vertex i.
    paths : GeodesicPaths
        ``geodesic_importance(cloud)``.
    threshold : float
        Branches end where less surface hangs on them than the square of this fraction of the
        diagonal, 0 to 1.
    candidates : float
        Fraction of the diagonal, above 0 to 1: points whose measure I is larger are candidates.
    smoothing : float
        0 to 10: bends as short as this times the radius are smoothed; 0 leaves the zigzag of the
        samples.
    simplify : float
        Fraction of the diagonal, 0 to 1: nodes go where the branch changes by less; 0 keeps all.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    CurveSkeleton
        With the node and the branch of each vertex of the shape. Its importance is mu; a part that
        is a single node has its whole area.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, or the cloud is not its whole inner cloud with its paths.
    InvalidOptionError
        When an option is out of its range.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    Cost O(n log n): 4 s for 194,000 vertices after the geodesics. Source: thesis 3.6. Deviates: the
    linking. The thesis connects candidates within a radius, which leaves gaps and does not know the
    genus. See `growth.py` for branches and `handles.py` for loops.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(100)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> paths = medialis.geodesic_importance(cloud)
    >>> graph = medialis.curve_skeleton(shape, cloud, paths)
    >>> graph.component_count, graph.loops
    (1, 0)
    """
    return trace_curve_skeleton(
        shape,
        cloud,
        paths,
        threshold=threshold,
        candidates=candidates,
        smoothing=smoothing,
        simplify=simplify,
        progress=progress,
    ).skeleton


def trace_curve_skeleton(
    shape: Shape,
    cloud: MedialCloud,
    paths: GeodesicPaths,
    *,
    threshold: float = DEFAULT_THRESHOLD,
    candidates: float = DEFAULT_CANDIDATES,
    smoothing: float = DEFAULT_SMOOTHING,
    simplify: float = 0.0,
    progress: Progress | ProgressCallback | None = None,
) -> CurveSkeletonResult:
    """Compute a curve skeleton and return all that it was made of; see `curve_skeleton`."""
    threshold = as_number(threshold, "threshold", low=0.0, high=1.0)
    share = as_number(candidates, "candidates", low=0.0, high=1.0, open_low=True)
    smoothing = as_number(smoothing, "smoothing", low=0.0, high=10.0)
    simplify = as_number(simplify, "simplify", low=0.0, high=1.0)
    _require_whole_cloud(shape, cloud)
    progress = Progress.of(progress)
    with progress.stage("detect", 0.0, 0.3):
        measured = candidate_measure(shape, cloud, paths)
        found = np.flatnonzero(measured.measure > share * shape.diagonal)
        near, _ = nearest_neighbours(cloud.centers[found], shape.diagonal)
    with progress.stage("regularize", 0.3, 0.6):
        importance = _smooth_importance(shape, cloud, measured, found, progress)
        kept = importance >= (threshold * shape.diagonal) ** 2
    with progress.stage("reconstruct", 0.6, 1.0):
        links = link_skeleton(shape, cloud, measured, found, near, share * shape.diagonal)
        handles = find_handles(shape)
        strength = np.where(cloud.valid, np.nan_to_num(measured.measure), -np.inf)
        strength += 1e-9 * links.radii  # without any measure: the largest ball
        edges, loops = _grow(shape, cloud, links, strength, found[kept], handles)
        progress.update(0.5)
        graph, node_of_sample = finish_graph(
            links, edges, strength, spacing=shape.spacing, smoothing=smoothing
        )
        graph = put_in_shape(shape, graph, node_of_sample)
        if simplify > 0:
            graph = simplify_branches(graph, simplify * shape.diagonal)
        known = node_importance(shape, graph, found, cloud.centers[found], importance)
        graph = replace(graph, importance=known)
    return CurveSkeletonResult(
        graph,
        measured,
        frozen(found, np.int32),
        frozen(importance, np.float64),
        kept,
        {number: one.genus for number, one in handles.items()},
        loops,
    )


def _grow(
    shape: Shape,
    cloud: MedialCloud,
    links: BallLinks,
    strength: FloatArray,
    rows: NDArray[np.int64],
    handles: dict[int, Handles],
) -> tuple[NDArray[np.int64], dict[int, int]]:
    """Grow the graph along the balls of the surface; `rows` are the candidates to reach."""
    wanted = np.zeros(len(cloud), bool)
    wanted[rows] = True
    components = np.where(cloud.valid & _in_faces(shape), shape.components, -1)
    return grow_graph(links, components, strength, wanted, spacing=shape.spacing, handles=handles)


def _in_faces(shape: Shape) -> NDArray[np.bool_]:
    """Tell the vertices that faces use; others are no part of the surface."""
    used = np.zeros(shape.point_count, bool)
    if shape.faces is not None:
        used[shape.faces] = True
    return used


def _smooth_importance(
    shape: Shape,
    cloud: MedialCloud,
    measured: CandidateMeasure,
    found: NDArray[np.int64],
    progress: Progress,
) -> FloatArray:
    """Median importance of each candidate and its neighbours, from a sample of them if many.

    A single estimate fails where no neighbour has a geodesic on the other side.
    """
    from scipy.spatial import cKDTree

    some = found[:: 1 + len(found) // MOST_MEASURED]
    area = area_importance(shape, cloud, measured, some, progress=progress)
    near, _ = nearest_neighbours(cloud.centers[some], shape.diagonal)
    median = np.median(np.column_stack([area, area[near]]), axis=1)
    if len(some) == len(found):
        return median
    return np.asarray(median[cKDTree(cloud.centers[some]).query(cloud.centers[found])[1]])


def _require_whole_cloud(shape: Shape, cloud: MedialCloud) -> None:
    n = shape.point_count
    if shape.faces is None:
        raise InvalidShapeError(
            "A curve skeleton from geodesics needs a mesh, got a point cloud: build a surface with "
            "surface_of_cloud first."
        )
    if len(cloud) != n or (cloud.side < 0).any() or (cloud.source != np.arange(n)).any():
        raise InvalidShapeError(
            f"A curve skeleton needs the whole inner cloud of the shape, {n} rows in their order; "
            f"got {len(cloud)} rows."
        )
    if not cloud.valid.any():
        raise InvalidShapeError("A curve skeleton needs a ball with two feature points, got none.")
