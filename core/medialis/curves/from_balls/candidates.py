"""Candidates of the curve skeleton: where geodesics to all sides start (thesis 3.6.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.geodesics.geodesics import surface_walk
from medialis.model.geodesic_paths import GeodesicPaths
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.threads import run_chunks, thread_count
from medialis.validation import FloatArray, IntArray, frozen

NEIGHBOURS = 10
"""Of each skeleton point, as in the thesis."""

JITTER = 1e-9
"""Fraction of the diagonal by which centers move for the search of neighbours only: exactly equal
ones, as of a sphere, could not be split by a tree, and every search would visit all of them."""

TIE = 0.01
"""Two geodesics are equally long when they differ by less than this share. A half circle of 30
edges is 0.2 % shorter than round."""

LONGER = 1.1
"""Times the length of the geodesic up to which a plane cut is followed: where that was shortened
through its neighbours, the cut in its plane is a little longer."""

POINTS_A_CHUNK = 2048


@dataclass(frozen=True, eq=False)
class CandidateMeasure:
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
    """

    measure: FloatArray
    spread: FloatArray
    tangents: FloatArray
    tied: NDArray[np.bool_]
    ends: IntArray


def tangent_field(shape: Shape, cloud: MedialCloud, paths: GeodesicPaths) -> FloatArray:
    """Compute the side of each skeleton point on which its geodesic runs.

    Parameters
    ----------
    shape : Shape
        The mesh that the cloud was computed from.
    cloud : MedialCloud
        k skeleton points.
    paths : GeodesicPaths
        ``geodesic_importance(cloud)``, k rows.

    Returns
    -------
    (k, 3) float64
        Unit vectors at right angles to the line between the feature points; zero where both ends
        of the geodesic cancel, NaN where there is no geodesic.

    Raises
    ------
    InvalidShapeError
        When there is not one path for each skeleton point.

    Notes
    -----
    Source: thesis 3.6.1, Eq. 3.2, with both end tangents taken as pointing away from the ball.
    """
    return _field(shape, cloud, paths)[1]


def candidate_measure(shape: Shape, cloud: MedialCloud, paths: GeodesicPaths) -> CandidateMeasure:
    """Measure how likely each skeleton point lies on the curve skeleton.

    On the two sides of the curve skeleton geodesics run to opposite sides. So the mean of the
    tangents of the neighbours is short there, and long everywhere else.

    Parameters
    ----------
    shape : Shape
        The mesh that the cloud was computed from.
    cloud : MedialCloud
        k skeleton points.
    paths : GeodesicPaths
        ``geodesic_importance(cloud)``, k rows.

    Returns
    -------
    CandidateMeasure

    Raises
    ------
    InvalidShapeError
        When there is not one path for each skeleton point.

    Notes
    -----
    Cost O(k log k): the 10 nearest neighbours of each point, and one plane cut. Source: thesis
    3.6.1, the measure I after Eq. 3.2. Deviates: where a second geodesic on the other side is as
    long, which is how the thesis defines a curve-skeleton point, the tangent counts as zero; a ball
    that touches the surface all round is a candidate whatever its geodesic is, with I = pi r.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(100)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> paths = medialis.geodesic_importance(cloud)
    >>> found = medialis.candidate_measure(shape, cloud, paths)
    >>> bool(np.nanmin(found.spread) >= 0 and np.nanmax(found.spread) <= 1)
    True
    """
    from medialis.curves.from_balls._candidate_kernels import find_rings, measure_spread

    rows, tangents, feature = _field(shape, cloud, paths)
    k, r = len(cloud), len(rows)
    measure, spread = np.full(k, np.nan), np.full(k, np.nan)
    tied, ends = np.zeros(k, bool), np.array(cloud.features)
    field = np.array(tangents)
    if r:
        length, tangent = paths.length[rows], field[rows]
        alike = _find_ties(shape, cloud, rows, tangent, length)
        near, distance = nearest_neighbours(cloud.centers[rows], shape.diagonal)
        found, ring, opposite = np.empty(r), np.empty(r, bool), np.empty(r, np.int32)
        turned = field[rows]
        smallest = 1e-12 * shape.diagonal

        def look_round(begin: int, end: int) -> None:
            find_rings(
                begin, end, near, distance, rows, cloud.centers, cloud.radii, shape.points,
                cloud.features, ring, opposite, turned,
            )  # fmt: skip

        run_chunks(look_round, r, POINTS_A_CHUNK)
        # Which of two equal geodesics was found is chance, and in a round tube with regular samples
        # always the one on the same side: such a point takes no side.
        tangent = np.where((alike | ring)[:, None], 0.0, tangent)

        def average(begin: int, end: int) -> None:
            measure_spread(begin, end, near, distance, length, tangent, feature, smallest, found)

        run_chunks(average, r, POINTS_A_CHUNK)
        # The second contact of a ball in a round tube is any of its ring; half round it is pi r.
        length = np.where(ring, np.maximum(length, np.pi * cloud.radii[rows]), length)
        found[ring] = 1.0
        measure[rows], spread[rows] = found * length, found
        tied[rows], field[rows] = alike | ring, turned
        ends[rows[ring], 1] = opposite[ring]
    return CandidateMeasure(
        frozen(measure, np.float64),
        frozen(spread, np.float64),
        frozen(field, np.float64),
        frozen(tied, np.bool_),
        frozen(ends, np.int32),
    )


def _find_ties(
    shape: Shape,
    cloud: MedialCloud,
    rows: NDArray[np.int64],
    tangent: FloatArray,
    length: FloatArray,
) -> NDArray[np.bool_]:
    """Tell where a second geodesic, as long, runs on the other side."""
    from medialis.curves.from_balls._area_kernels import find_ties

    walk, ends = surface_walk(shape), np.ascontiguousarray(cloud.features[rows])
    found, longest = np.empty(len(rows), bool), LONGER * length

    def work(begin: int, end: int) -> None:
        find_ties(begin, end, *walk, ends, tangent, longest, TIE, found)

    run_chunks(work, len(rows), POINTS_A_CHUNK)
    return found


def nearest_neighbours(
    points: NDArray[np.float64], size: float, count: int = NEIGHBOURS
) -> tuple[NDArray[np.int32], FloatArray]:
    """Find the nearest other points of each point, (k, count) indices and distances.

    With fewer than count + 1 points there are fewer columns.
    """
    from scipy.spatial import cKDTree

    k = len(points)
    count = min(count, k - 1)
    if count <= 0:
        return np.empty((k, 0), np.int32), np.empty((k, 0))
    moved = points + JITTER * size * np.random.default_rng(0).uniform(-1, 1, points.shape)
    distance, near = cKDTree(moved).query(moved, k=count + 1, workers=thread_count())
    return np.ascontiguousarray(near[:, 1:], np.int32), np.ascontiguousarray(distance[:, 1:])


def _field(
    shape: Shape, cloud: MedialCloud, paths: GeodesicPaths
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Rows with a geodesic, the tangents of all rows, the unit feature vectors of these rows."""
    from medialis.curves.from_balls._candidate_kernels import project_tangents

    if len(paths) != len(cloud):
        raise InvalidShapeError(
            f"Expected one path for each of the {len(cloud)} skeleton points, got {len(paths)}: "
            "use geodesic_importance(cloud)."
        )
    known = cloud.valid & np.isfinite(paths.length) & (paths.length > 0)
    known &= np.isfinite(paths.start_tangent).all(1) & np.isfinite(paths.end_tangent).all(1)
    rows = np.flatnonzero(known)
    found, feature = np.empty((len(rows), 3)), np.empty((len(rows), 3))

    def work(begin: int, end: int) -> None:
        project_tangents(
            begin, end, shape.points, cloud.features, rows, paths.start_tangent,
            paths.end_tangent, found, feature,
        )  # fmt: skip

    run_chunks(work, len(rows), POINTS_A_CHUNK)
    tangents = np.full((len(cloud), 3), np.nan)
    tangents[rows] = found
    return rows, frozen(tangents, np.float64), feature
