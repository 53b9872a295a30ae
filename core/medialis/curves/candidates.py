"""Candidates of the curve skeleton, and the area that hangs on each (thesis 3.6.1, 3.6.2).

On the two sides of the curve skeleton geodesics run to opposite sides of the shape: where their
tangents turn round from ball to ball is a candidate (`candidate_measure`). Geodesics to both sides
part the surface; the area of the smaller part is the importance (`area_importance`), by which
branches end.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.arrays import Index, Mask, kd_tree, unit_rows
from medialis.base.kept import Bound
from medialis.base.options import Options, algorithm
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import Directions, FloatArray, IntArray, frozen
from medialis.curves.growth import NEIGHBOURS
from medialis.skeleton.importance.geodesics import surface_walk
from medialis.skeleton.importance.importance import Importance, geodesic_importance
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import as_cloud, points_apart

LONGER_CUT = 1.1  # halved 36 %, doubled 0 %
"""Times the length of the geodesic up to which a plane cut is followed: where that was shortened
through its neighbours, the cut in its plane is a little longer."""

LEAST_SPREAD = 0.75
"""What a tip that tapers by 60 degrees has: blunter ones are corners and edges, sharper ones limbs.
The tangents of a flat tip turn by 120 degrees from one side to the other: (1 - cos 120) / 2."""

HALF_ROUND = 0.58  # halved 9 %, doubled 100 %
"""The same, in half turns about the ball: the geodesic half round a cone that tapers by 60 degrees
is 2 r cos 30 / sin 30 sin(90 sin 30) = 0.78 pi r long, times 0.75."""

DIRECTIONS = 50  # halved 28 %, doubled 5 %
"""Plane cuts of a candidate: the thesis's P."""

LONGEST_CUT = 2.0  # halved 100 %, doubled 6 %
"""Diagonals: a plane cut that is longer does not lead to the other feature point."""

MEASURED_APART = 0.5  # halved 5 %, doubled 5 %
"""Times the radius of its ball: the importance of one candidate is measured for all that are
nearest to it, up to so far, or half as far. Some ten of those measured lie in the ball of each."""

CANCELLED = 1e-12  # halved 0 %, doubled 0 %
"""Length of the sum of two unit tangents below which they cancel."""

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
        I / rho, 0 to 1, NaN likewise: (1 - cos a) / 2, a the angle by which tangents near by turn.
    tangents : (k, 3) float64
        The tangent t of each point (`tangent_field`).
    tied : (k,) bool
        Whether a second geodesic, as long, runs on the other side, or the ball touches the surface
        all round. Such a ball has a tangent of chance.
    ends : (k, 2) int32
        The feature points between which the geodesic runs; for a ball that touches all round the
        first one and the contact farthest from it.
    near : (k, c) int32
        The nearest others, up to 10, of those that have a measure, among those; -1: none.
    cloud : MedialCloud
        The skeleton points.
    """

    measure: FloatArray
    spread: FloatArray
    tangents: Directions
    tied: Mask
    ends: IntArray
    near: IntArray = field(repr=False)
    cloud: MedialCloud = field(kw_only=True)

    def on_curve(self, least: float) -> Mask:
        """Tell the candidates: geodesics of a length start from them to opposite sides.

        The length is `least`, at least that half round a limb with the radius of the ball.
        """
        limb = HALF_ROUND * np.pi * self.cloud.radii
        return (self.spread > LEAST_SPREAD) & (self.measure > np.maximum(least, limb))

    @cached_property
    def widths(self) -> FloatArray:
        """Half the width (k,) of the cross-section round each candidate: r of a round one.

        That of a stadium, two half discs of radius r and a rectangle between, half round which the
        geodesic is as long: rho = pi r + 2 (w - r). Infinite for what is no candidate.
        """
        sure, r = self.spread > LEAST_SPREAD, self.cloud.radii
        rho = np.divide(self.measure, self.spread, out=np.full(len(r), np.inf), where=sure)
        return frozen(np.maximum(r, rho / 2 - (np.pi / 2 - 1) * r), np.float64)


@algorithm(Options, keep=False, door=as_cloud)
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


@algorithm(Options, door=as_cloud)
def candidate_measure(cloud: MedialCloud, options: Options, progress: Progress) -> CandidateMeasure:
    """Measure how likely each skeleton point lies on the curve skeleton.

    On the two sides of the curve skeleton geodesics run to opposite sides. So the tangents of the
    neighbours turn round there, and hardly turn everywhere else.

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
    3.6.1, the measure I after Eq. 3.2. Deviates: the second largest angle to the tangents of the
    neighbours instead of the length of their mean, which depends on how many samples lie on either
    side; neighbours count whose geodesic is as long up to twice their distance and a spacing. Where
    a second geodesic on the other side is as long, which is how the thesis defines a curve-skeleton
    point, the spread is 1; so it is for a ball that touches the surface all round, with rho = pi r.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(100))
    >>> measured = medialis.candidate_measure(cloud)
    >>> bool(np.nanmin(measured.spread) >= 0 and np.nanmax(measured.spread) <= 1)
    True
    """
    from medialis.base.box_tree import nearest_others
    from medialis.curves._kernels import Balls, find_rings, measure_spread, point_spokes

    with progress.stage("importance", 0.0, 0.8):
        paths = geodesic_importance.of(cloud, options, progress)
    rows, tangents, feature = run_patiently(lambda: _field(paths), progress)
    k, r, shape = len(cloud), len(rows), cloud.surface
    measure, spread = np.full(k, np.nan), np.full(k, np.nan)
    tied, ends, turning = np.zeros(k, bool), np.array(cloud.features), np.array(tangents)
    nearest = np.full((k, min(NEIGHBOURS, max(r - 1, 0))), -1, np.int32)
    if r:
        length, tangent, still = paths.length[rows], turning[rows], progress.still
        near, distance = nearest_others(cloud.centers[rows], NEIGHBOURS, still)
        nearest[rows] = rows[near]
        sure, ring, opposite = np.empty(r), np.empty(r, bool), np.empty(r, np.int32)
        turned = turning[rows]
        ball_of = np.full(shape.point_count, -1)
        ball_of[cloud.features[rows, 0]] = rows
        known = cloud.centers, cloud.radii, cloud.features, shape.points, ball_of
        balls = Balls(rows, near, distance, length, tangent, feature, *known, np.empty((k, 2, 3)))
        run_chunks(point_spokes, r, POINTS_A_CHUNK, balls, balls.spokes, progress=still)
        run_chunks(find_rings, r, POINTS_A_CHUNK, balls, ring, opposite, turned, progress=still)
        alike, other = ring.copy(), np.flatnonzero(~ring)
        alike[other] = _find_ties(cloud, rows[other], tangent[other], length[other], progress)
        # Which of two equal geodesics was found is chance, and in a round tube with regular samples
        # always the one on the same side: such a point takes no side.
        sided = balls._replace(tangent=np.where(alike[:, None], 0.0, tangent))
        given = sided, 1e-12 * shape.diagonal, sure
        run_chunks(measure_spread, r, POINTS_A_CHUNK, *given, progress=still)
        # The second contact of a ball in a round tube is any of its ring; half round it is pi r.
        length = np.where(ring, np.maximum(length, np.pi * cloud.radii[rows]), length)
        sure[alike] = 1.0
        measure[rows], spread[rows] = sure * length, sure
        tied[rows], turning[rows] = alike, turned
        ends[rows[ring], 1] = opposite[ring]
    measure, spread, turning = (frozen(x, np.float64) for x in (measure, spread, turning))
    tied, ends, nearest = frozen(tied, np.bool_), frozen(ends, np.int32), frozen(nearest, np.int32)
    return CandidateMeasure(measure, spread, turning, tied, ends, nearest, cloud=cloud)


def _find_ties(
    cloud: MedialCloud, rows: Index, tangent: FloatArray, length: FloatArray, progress: Progress
) -> Mask:
    """Tell where a second geodesic, as long, runs on the other side."""
    from medialis.curves._kernels import find_ties

    walk = run_patiently(lambda: surface_walk(cloud.surface), progress)
    ends = np.ascontiguousarray(cloud.features[rows])
    tied, longest = np.empty(len(rows), bool), LONGER_CUT * length
    given = walk, ends, tangent, longest, tied
    run_chunks(find_ties, len(rows), POINTS_A_CHUNK, *given, progress=progress.still)
    return tied


def _field(paths: Importance) -> tuple[Index, FloatArray, FloatArray]:
    """Rows with a geodesic, the tangents of all rows, the unit feature vectors of these rows."""
    cloud, points = paths.cloud, paths.cloud.surface.points
    known = cloud.valid & np.isfinite(paths.length) & (paths.length > 0)
    known &= np.isfinite(paths.start_tangent).all(1) & np.isfinite(paths.end_tangent).all(1)
    rows = np.flatnonzero(known)
    first, second = cloud.features[rows].T
    feature = unit_rows(points[first] - points[second])
    # Both tangents point away from the ball: at the second end that is the way back.
    tangent = paths.start_tangent[rows] - paths.end_tangent[rows]
    tangent -= (feature * tangent).sum(axis=1, keepdims=True) * feature
    tangents = np.full((len(cloud), 3), np.nan)
    tangents[rows] = unit_rows(tangent, least=CANCELLED)
    return rows, frozen(tangents, np.float64), feature


def area_importance(
    measured: CandidateMeasure,
    rows: ArrayLike,
    *,
    progress: Progress | ProgressCallback | None = None,
) -> FloatArray:
    """Estimate how much of the surface hangs on each candidate: the importance mu.

    Geodesics to both sides of a candidate part the surface; mu is the area of the smaller part.

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
        Areas. 0 where no plane cut leads from one feature point to the other.

    Raises
    ------
    Cancelled
        When `progress` asks for it.

    See Also
    --------
    curve_skeleton : whose branches end where less hangs on them than on a corner.

    Notes
    -----
    Cost: 50 plane cuts a candidate, none of which can end early. Source: thesis 3.6.2, Eq. 3.4 and
    3.5. Deviates: b = (2 gamma - pi a) / pi, from the half perimeter pi (a + b) / 2 of an ellipse
    (the thesis divides by 2, which does not give a circle for a sphere); the smallest area of half
    a turn instead of that between the geodesics of the candidate and of a neighbour (Eq. 3.3),
    whose directions are of chance in round limbs and thin ones. A cut that does not arrive takes
    the length of the nearest direction that does.

    Examples
    --------
    >>> import medialis
    >>> measured = medialis.candidate_measure(
    ...     medialis.surface_skeleton(medialis.organic_shape(56))
    ... )
    >>> rows = np.flatnonzero(measured.on_curve(0.005 * measured.cloud.surface.diagonal))
    >>> area = medialis.area_importance(measured, rows)
    >>> bool(area.max() < measured.cloud.surface.area)
    True
    """
    from medialis.curves._kernels import least_half, trace_all_round

    shape, chosen = measured.cloud.surface, np.asarray(rows, np.int64)
    progress = Progress.of(progress)
    ends = np.ascontiguousarray(measured.ends[chosen])
    tangent = np.ascontiguousarray(measured.tangents[chosen])
    length, area = np.empty((len(chosen), DIRECTIONS)), np.empty(len(chosen))
    half = np.linalg.norm(shape.points[ends[:, 1]] - shape.points[ends[:, 0]], axis=1) / 2
    walk = run_patiently(lambda: surface_walk(shape), progress)
    longest = LONGEST_CUT * shape.diagonal

    def work(begin: int, end: int) -> None:
        trace_all_round(begin, end, walk, ends, tangent, longest, length)
        least_half(begin, end, length, half, area)

    run_chunks(work, len(chosen), CANDIDATES_A_CHUNK, progress=progress)
    return frozen(area, np.float64)


def smooth_importance(
    measured: CandidateMeasure, candidates: Index, progress: Progress
) -> FloatArray:
    """Median importance of each candidate and of those in its ball, from a sample of them if many.

    A single estimate fails where plane cuts do not arrive.
    """
    from medialis.base.box_tree import nearest_others

    if len(candidates) == 0:
        return frozen(np.empty(0), np.float64)
    centers = measured.cloud.centers
    some = candidates[_apart(measured, candidates)]
    area = area_importance(measured, some, progress=progress)
    near, distance = nearest_others(centers[some], NEIGHBOURS, progress.still)
    around = np.where(distance < measured.cloud.radii[some, None], area[near], np.nan)
    median = np.nanmedian(np.column_stack([area, around]), axis=1)
    nearest = run_patiently(lambda: kd_tree(centers[some]).query(centers[candidates])[1], progress)
    return frozen(median[nearest], np.float64)


def _apart(measured: CandidateMeasure, candidates: Index) -> Index:
    """Choose the surest candidates that are a quarter to half of their radius apart.

    They are taken in classes of radii, each up to twice the least of it.
    """
    size = float(np.sqrt(max(measured.cloud.surface.area, 1e-300)))  # turns with the shape
    radii = measured.cloud.radii[candidates] / size
    level = np.frexp(radii * MEASURED_APART)[1] - 1
    keys = measured.cloud.radii, measured.measure, measured.spread
    order = np.lexsort([-key[candidates] for key in keys])
    chosen = []
    for one in np.unique(level).tolist():
        mine = order[level[order] == one]
        points = measured.cloud.centers[candidates[mine]]
        distance = float(np.ldexp(size, one))
        chosen.append(mine[points_apart(points, np.arange(len(mine)), distance)])
    return np.sort(np.concatenate(chosen))
