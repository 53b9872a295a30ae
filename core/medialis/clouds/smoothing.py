"""Positions of a jittering cloud without its jitter, for the classification of its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.progress import Progress
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray

NEIGHBOURS = 54
"""Neighbours that fit a plane. Of 24, 36, 54, 80: the fewest at which planes, a sphere and a spiral
with a jitter of 0.5 % stay whole; 80 flattens the spiral."""

SMALL, LARGE = 16, 36
"""Neighbourhoods whose flatness is compared. The distance to the tangent plane grows with the
square of the size on a curved surface, and not at all for jitter."""

LEAST_JITTER = 0.03
"""Scatter over size of the small neighbourhood below which a cloud is accurate enough: its
triangles then lie well within d_max."""

BAND = 2.5
"""How far a point may lie from a plane it belongs to, in units of the scatter."""

SECOND_BAND = 0.7
"""The second pass finds less scatter than the first."""

SAMPLES = 2000
TRIPLES = 60
FITS = 3
CHUNK = 512


def nearest_points(points: FloatArray, count: int, progress: Progress) -> NDArray[np.int32]:
    """Return the `count` nearest other points of each, (n, count), by distance.

    The points must differ.
    """
    return neighbours_of(points, points, count, progress)


def jitter(points: FloatArray) -> float:
    """Measure how far points scatter about the surfaces they sample.

    Parameters
    ----------
    points : (n, 3) float
        All different.

    Returns
    -------
    float
        Standard deviation in the units of the points; 0 where the cloud is accurate, curved more
        than it scatters, or too small to tell.

    Notes
    -----
    Least median of squares planes of 2000 neighbourhoods of two sizes. Scatter does not grow with
    the neighbourhood, so its share of the size falls; the share of curvature grows.
    """
    if len(points) <= LARGE + 1:
        return 0.0
    from medialis.clouds._smoothing_kernels import measure_flatness

    # Chosen by the distance to the center: the same samples however the cloud is turned.
    order = np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")
    rows = order[np.linspace(0, len(points) - 1, min(SAMPLES, len(points))).astype(np.int64)]
    near = neighbours_of(points, points[rows], LARGE, Progress())
    scatter, share = {}, {}
    for size in (SMALL, LARGE):
        found, radius = np.empty(len(rows)), np.empty(len(rows))
        measure_flatness(points, near[:, :size].copy(), rows, _triples(size), found, radius)
        # 1.48 makes a median a standard deviation; the second factor corrects small samples
        # (Rousseeuw and Leroy, Robust Regression and Outlier Detection, 1987).
        found *= 1.4826 * (1 + 5 / (size - 2))
        scatter[size], share[size] = np.median(found), np.median(found / radius)
    falls = share[LARGE] < share[SMALL]
    return float(scatter[LARGE]) if falls and share[SMALL] > LEAST_JITTER else 0.0


def without_jitter(points: FloatArray, scatter: float, progress: Progress) -> FloatArray:
    """Move each point onto the plane that its neighbours support best (two passes).

    Points that no plane passes within 2.5 times the scatter stay.
    """
    from medialis.clouds._smoothing_kernels import smooth_positions

    count = min(NEIGHBOURS, len(points) - 1)
    for band in (BAND * scatter, SECOND_BAND * BAND * scatter):
        near, triples = nearest_points(points, count, progress), _triples(count)
        moved = np.empty_like(points)

        def work(begin: int, end: int) -> None:
            smooth_positions(points, near, triples, band, FITS, begin, end, moved)  # noqa: B023

        run_chunks(work, len(points), CHUNK, progress=progress)
        points = moved
    return points


def neighbours_of(
    points: FloatArray, queries: FloatArray, count: int, progress: Progress
) -> NDArray[np.int32]:
    """Return the `count` nearest points of each query but itself, (q, count), by distance."""
    from scipy.spatial import cKDTree

    tree = run_patiently(lambda: cKDTree(points), progress)
    near = np.empty((len(queries), count), np.int32)

    def search(begin: int, end: int) -> None:
        near[begin:end] = tree.query(queries[begin:end], k=count + 1)[1][:, 1:]

    # Not the query's own threads: Ctrl-C leaves them running in a tree that is freed.
    run_chunks(search, len(queries), 1 << 13, progress=progress)
    return near


def _triples(neighbours: int) -> NDArray[np.int64]:
    """Return ranks of three different places of a neighbourhood, 0 the point itself, (t, 3)."""
    rng = np.random.default_rng(0)
    ranks = [rng.choice(neighbours + 1, 3, replace=False) for _ in range(TRIPLES)]
    return np.array(ranks, np.int64)
