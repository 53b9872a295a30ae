"""The area that hangs on each candidate of the curve skeleton (thesis 3.6.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.curves.from_balls.candidates import CandidateMeasure, near_balls
from medialis.paths.geodesics import surface_walk
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray, frozen

DIRECTIONS = 50
"""Plane cuts of a candidate: the thesis's P."""

LONGEST = 2.0
"""Diagonals: a plane cut that is longer does not lead to the other feature point."""

CELL = 0.5
"""Times the radius of its ball: the importance of one candidate is measured for all within a cell
that is between half as wide and as wide. Some ten such cells lie in the ball of each."""

CANDIDATES_A_CHUNK = 8


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
    curve_skeleton : whose branches end where the importance falls below a threshold.

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
    from medialis.curves.from_balls._area_kernels import least_half, trace_all_round

    shape, chosen = measured.cloud.surface, np.asarray(rows, np.int64)
    progress = Progress.of(progress)
    ends = np.ascontiguousarray(measured.ends[chosen])
    tangent = np.ascontiguousarray(measured.tangents[chosen])
    length, area = np.empty((len(chosen), DIRECTIONS)), np.empty(len(chosen))
    half = np.linalg.norm(shape.points[ends[:, 1]] - shape.points[ends[:, 0]], axis=1) / 2
    walk = run_patiently(lambda: surface_walk(shape), progress)
    longest = LONGEST * shape.diagonal

    def work(begin: int, end: int) -> None:
        trace_all_round(begin, end, *walk, ends, tangent, longest, length)
        least_half(begin, end, length, half, area)

    run_chunks(work, len(chosen), CANDIDATES_A_CHUNK, progress=progress)
    return frozen(area, np.float64)


def smooth_importance(
    measured: CandidateMeasure, candidates: NDArray[np.int64], progress: Progress
) -> FloatArray:
    """Median importance of each candidate and of those in its ball, from a sample of them if many.

    A single estimate fails where plane cuts do not arrive.
    """
    from scipy.spatial import cKDTree

    if len(candidates) == 0:
        return frozen(np.empty(0), np.float64)
    centers = measured.cloud.centers
    some = candidates[_one_a_cell(measured, candidates)]
    area = area_importance(measured, some, progress=progress)
    near, distance = near_balls(measured.cloud, some, progress)
    around = np.where(distance < measured.cloud.radii[some, None], area[near], np.nan)
    median = np.nanmedian(np.column_stack([area, around]), axis=1)
    nearest = run_patiently(lambda: cKDTree(centers[some]).query(centers[candidates])[1], progress)
    return frozen(median[nearest], np.float64)


def _one_a_cell(measured: CandidateMeasure, candidates: NDArray[np.int64]) -> NDArray[np.int64]:
    """Choose the surest candidate of each cell, a quarter to half as wide as its ball is thick.

    A cell is one of an octree: its width is a power of two.
    """
    radii = measured.cloud.radii[candidates]
    level = np.frexp(radii * CELL)[1] - 1
    cell = np.floor(measured.cloud.centers[candidates] / np.ldexp(1.0, level)[:, None])
    order = np.lexsort((-measured.spread[candidates], *cell.T, level))
    keys = np.column_stack([level, cell])[order]
    first = np.ones(len(order), bool)
    first[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    return np.sort(order[first])
