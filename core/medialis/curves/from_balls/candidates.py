"""Candidates of the curve skeleton, and the area that hangs on each (thesis 3.6.1, 3.6.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.curves.graph.ground import nearest_neighbours
from medialis.kept import Bound, kept
from medialis.model.geodesic_paths import Importance
from medialis.model.medial_cloud import MedialCloud
from medialis.options import Options, algorithm
from medialis.paths.geodesics import surface_walk
from medialis.paths.importance import geodesic_importance
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray, IntArray, frozen

TIE = 0.01
"""Two geodesics are equally long when they differ by less than this share. A half circle of 30
edges is 0.2 % shorter than round."""

LONGER = 1.1
"""Times the length of the geodesic up to which a plane cut is followed: where that was shortened
through its neighbours, the cut in its plane is a little longer."""

DIRECTIONS = 50
"""Plane cuts of a candidate: the thesis's P."""

LONGEST = 2.0
"""Diagonals: a plane cut that is longer does not lead to the other feature point."""

POINTS_A_CHUNK, CANDIDATES_A_CHUNK = 2048, 8


@dataclass(frozen=True, eq=False, repr=False)
class CandidateMeasure(Bound):
    """How likely each of k skeleton points lies on the curve skeleton.

    Attributes
    ----------
    measure : (k,) float64
        I of the thesis, a length: 0 where all geodesics near by run to the same side, up to the
        length of the geodesic where they run to all sides. NaN where it has none: masked balls,
        and balls between parts that no path joins.
    spread : (k,) float64
        I / rho, 0 to 1, NaN likewise.
    tangents : (k, 3) float64
        The tangent t of each point (`tangent_field`).
    tied : (k,) bool
        Whether a second geodesic, as long, runs on the other side, or the ball touches the surface
        all round. Such a ball has a tangent of chance.
    ends : (k, 2) int32
        The feature points between which the geodesic runs; for a ball that touches all round the
        first one and the contact farthest from it.
    cloud : MedialCloud
        The skeleton points.
    """

    measure: FloatArray
    spread: FloatArray
    tangents: FloatArray
    tied: NDArray[np.bool_]
    ends: IntArray
    cloud: MedialCloud = field(kw_only=True)


@algorithm(Options, keep=False)
def tangent_field(cloud: MedialCloud, options: Options, progress: Progress) -> FloatArray:
    """Compute the side of each skeleton point on which its geodesic runs.

    Parameters
    ----------
    cloud : MedialCloud
        k skeleton points of a mesh.

    Returns
    -------
    (k, 3) float64
        Unit vectors at right angles to the line between the feature points; zero where both ends
        of the geodesic cancel, NaN where there is no geodesic.

    Raises
    ------
    InvalidShapeError
        When the surface is a point cloud.

    See Also
    --------
    candidate_measure : what the field is for.

    Notes
    -----
    Source: thesis 3.6.1, Eq. 3.2, with both end tangents taken as pointing away from the ball.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> medialis.tangent_field(cloud).shape == (len(cloud), 3)
    True
    """
    return _field(geodesic_importance.of(cloud, options, progress))[1]


@algorithm(Options)
def candidate_measure(cloud: MedialCloud, options: Options, progress: Progress) -> CandidateMeasure:
    """Measure how likely each skeleton point lies on the curve skeleton.

    On the two sides of the curve skeleton geodesics run to opposite sides. So the mean of the
    tangents of the neighbours is short there, and long everywhere else.

    Parameters
    ----------
    cloud : MedialCloud
        k skeleton points of a mesh.

    Returns
    -------
    CandidateMeasure

    Raises
    ------
    InvalidShapeError
        When the surface is a point cloud.

    See Also
    --------
    area_importance : how much of the surface hangs on a candidate.
    curve_skeleton : the graph along the candidates.

    Notes
    -----
    Cost O(k log k): the 10 nearest neighbours of each point, and one plane cut. Source: thesis
    3.6.1, the measure I after Eq. 3.2. Deviates: where a second geodesic on the other side is as
    long, which is how the thesis defines a curve-skeleton point, the tangent counts as zero; a ball
    that touches the surface all round is a candidate whatever its geodesic is, with I = pi r.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(100))
    >>> measured = medialis.candidate_measure(cloud)
    >>> bool(np.nanmin(measured.spread) >= 0 and np.nanmax(measured.spread) <= 1)
    True
    """
    from medialis.curves.from_balls._candidate_kernels import find_rings, measure_spread

    with progress.stage("importance", 0.0, 0.8):
        paths = geodesic_importance.of(cloud, options, progress)
    rows, tangents, feature = run_patiently(lambda: _field(paths), progress)
    k, r, shape = len(cloud), len(rows), cloud.surface
    measure, spread = np.full(k, np.nan), np.full(k, np.nan)
    tied, ends = np.zeros(k, bool), np.array(cloud.features)
    turning = np.array(tangents)
    if r:
        length, tangent = paths.length[rows], turning[rows]
        alike = _find_ties(cloud, rows, tangent, length, progress)
        near, distance = near_balls(cloud, rows, progress)
        sure, ring, opposite = np.empty(r), np.empty(r, bool), np.empty(r, np.int32)
        turned = turning[rows]
        smallest = 1e-12 * shape.diagonal

        def look_round(begin: int, end: int) -> None:
            find_rings(
                begin, end, near, distance, rows, cloud.centers, cloud.radii, shape.points,
                cloud.features, ring, opposite, turned,
            )  # fmt: skip

        run_chunks(look_round, r, POINTS_A_CHUNK, progress=progress.still)
        # Which of two equal geodesics was found is chance, and in a round tube with regular samples
        # always the one on the same side: such a point takes no side.
        tangent = np.where((alike | ring)[:, None], 0.0, tangent)

        def average(begin: int, end: int) -> None:
            measure_spread(begin, end, near, distance, length, tangent, feature, smallest, sure)

        run_chunks(average, r, POINTS_A_CHUNK, progress=progress.still)
        # The second contact of a ball in a round tube is any of its ring; half round it is pi r.
        length = np.where(ring, np.maximum(length, np.pi * cloud.radii[rows]), length)
        sure[ring] = 1.0
        measure[rows], spread[rows] = sure * length, sure
        tied[rows], turning[rows] = alike | ring, turned
        ends[rows[ring], 1] = opposite[ring]
    return CandidateMeasure(
        frozen(measure, np.float64),
        frozen(spread, np.float64),
        frozen(turning, np.float64),
        frozen(tied, np.bool_),
        frozen(ends, np.int32),
        cloud=cloud,
    )


def _find_ties(
    cloud: MedialCloud,
    rows: NDArray[np.int64],
    tangent: FloatArray,
    length: FloatArray,
    progress: Progress,
) -> NDArray[np.bool_]:
    """Tell where a second geodesic, as long, runs on the other side."""
    from medialis.curves.from_balls._area_kernels import find_ties

    walk = run_patiently(lambda: surface_walk(cloud.surface), progress)
    ends = np.ascontiguousarray(cloud.features[rows])
    tied, longest = np.empty(len(rows), bool), LONGER * length

    def work(begin: int, end: int) -> None:
        find_ties(begin, end, *walk, ends, tangent, longest, TIE, tied)

    run_chunks(work, len(rows), POINTS_A_CHUNK, progress=progress.still)
    return tied


def _field(paths: Importance) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Rows with a geodesic, the tangents of all rows, the unit feature vectors of these rows."""
    from medialis.curves.from_balls._candidate_kernels import project_tangents

    cloud, points = paths.cloud, paths.cloud.surface.points
    known = cloud.valid & np.isfinite(paths.length) & (paths.length > 0)
    known &= np.isfinite(paths.start_tangent).all(1) & np.isfinite(paths.end_tangent).all(1)
    rows = np.flatnonzero(known)
    tangent, feature = np.empty((len(rows), 3)), np.empty((len(rows), 3))

    def work(begin: int, end: int) -> None:
        project_tangents(
            begin, end, points, cloud.features, rows, paths.start_tangent, paths.end_tangent,
            tangent, feature,
        )  # fmt: skip

    run_chunks(work, len(rows), POINTS_A_CHUNK)
    tangents = np.full((len(cloud), 3), np.nan)
    tangents[rows] = tangent
    return rows, frozen(tangents, np.float64), feature


def near_balls(
    cloud: MedialCloud, rows: NDArray[np.int64], progress: Progress
) -> tuple[IntArray, FloatArray]:
    """Find the nearest others of some balls among themselves (`nearest_neighbours`); kept."""
    return kept(
        nearest_neighbours, cloud, rows.tobytes(),
        lambda: run_patiently(
            lambda: nearest_neighbours(cloud.centers[rows], cloud.surface.diagonal), progress
        ),
        progress,
    )  # fmt: skip


def area_importance(
    measured: CandidateMeasure,
    rows: ArrayLike,
    *,
    progress: Progress | ProgressCallback | None = None,
) -> FloatArray:
    """Estimate how much of the surface hangs on each candidate: the importance mu.

    The geodesics of a candidate and of its neighbour on the other side of the curve skeleton
    enclose two parts of the surface; mu is the area of the smaller one.

    Parameters
    ----------
    measured : CandidateMeasure
        ``candidate_measure(cloud)``.
    rows : (c,) int
        The candidates: rows of the cloud that have a measure.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    (c,) float64
        Areas. 0 where no neighbour has a geodesic on the other side.

    Raises
    ------
    Cancelled
        When `progress` asks for it.

    See Also
    --------
    curve_skeleton : whose branches end where the importance falls below a threshold.

    Notes
    -----
    Cost: 50 plane cuts a candidate, none of which can end early. Source: thesis 3.6.2, Eq. 3.3 to
    3.5. Deviates: b = (2 gamma - pi a) / pi, from the half perimeter pi (a + b) / 2 of an ellipse
    (the thesis divides by 2, which does not give a circle for a sphere); the angle between the
    tangents is taken with its sign, and the wedge in which it ends is shared. A cut that does not
    arrive takes the length of the nearest direction that does.

    Examples
    --------
    >>> import medialis
    >>> measured = medialis.candidate_measure(
    ...     medialis.surface_skeleton(medialis.organic_shape(56))
    ... )
    >>> rows = np.flatnonzero(measured.measure > 0.015 * measured.cloud.surface.diagonal)
    >>> area = medialis.area_importance(measured, rows)
    >>> bool(area.max() < measured.cloud.surface.area)
    True
    """
    from medialis.curves.from_balls._area_kernels import add_wedges, find_opposite, trace_all_round

    shape, chosen = measured.cloud.surface, np.asarray(rows, np.int64)
    if len(chosen) < 2:
        return frozen(np.zeros(len(chosen)), np.float64)
    progress = Progress.of(progress)
    near, distance = near_balls(measured.cloud, chosen, progress)
    tangent, measure = np.ascontiguousarray(measured.tangents[chosen]), measured.measure[chosen]
    opposite = np.empty(len(chosen), np.int64)
    smallest = 1e-12 * shape.diagonal

    def look(begin: int, end: int) -> None:
        find_opposite(begin, end, near, distance, measure, tangent, smallest, opposite)

    run_chunks(look, len(chosen), POINTS_A_CHUNK, progress=progress.still)
    ends = np.ascontiguousarray(measured.ends[chosen])
    length = np.empty((len(chosen), DIRECTIONS))
    walk = run_patiently(lambda: surface_walk(shape), progress)
    longest = LONGEST * shape.diagonal

    def trace(begin: int, end: int) -> None:
        trace_all_round(begin, end, *walk, ends, tangent, longest, length)

    run_chunks(trace, len(chosen), CANDIDATES_A_CHUNK, progress=progress)
    feature = shape.points[ends[:, 1]] - shape.points[ends[:, 0]]
    half = np.linalg.norm(feature, axis=1) / 2
    axis = feature / np.maximum(2 * half, 1e-300)[:, None]
    other = tangent[opposite]
    across = np.einsum("ij,ij->i", np.cross(axis, tangent), other)
    ahead = np.einsum("ij,ij->i", tangent, other)
    opening = np.mod(np.arctan2(across, ahead), 2 * math.pi)
    opening[measured.tied[chosen]] = math.pi  # the second geodesic is its own
    area = np.empty(len(chosen))
    add_wedges(0, len(chosen), length, half, opening, area)
    return frozen(area, np.float64)
