"""Outliers of clouds that surfaces do not explain: wires, poles, twigs, and few points.

There no smooth patch tells an outlier, only the distance to its neighbours. The distances of a
clean scan vary slowly from place to place, and scatter about that by an amount that depends on what
was scanned: by a fifth on a surface, by two fifths along a wire, not at all on a grid. An outlier
is much farther from its neighbours than they are from theirs, compared with this scatter. Outliers
far from everything have other outliers around them: they are found once those nearer to the scan
are gone, so that the search is repeated.
"""

from __future__ import annotations

import math

import numpy as np

from medialis.base.arrays import Mask
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray
from medialis.clouds.smoothing import neighbours_of

NEIGHBOUR = 6
"""The distance to this neighbour is the local spacing: on a surface as many lie about a point."""

AROUND = 32
"""Neighbours whose spacings a point's is compared with."""

AROUND_QUANTILE = 0.25
"""Quantile of these: of an outlier's neighbours a quarter or more belong to the scan."""

CALM = (0.1, 0.4)
"""Quantiles of the logarithms of all ratios that measure their scatter: outliers are above."""

CALM_DEVIATIONS = (-1.2816, -0.2533)
"""The same quantiles of a normal distribution with deviation 1."""

MAX_DEVIATIONS = 4.0
"""Deviations of the logarithm of the ratio above its mean, from which on a point is an outlier."""

MIN_RATIO = 2.25
"""Ratio of spacings of an outlier, at least. At an end of a wire of evenly spaced points the
spacing is doubled, and slightly more where the wire bends."""

MAX_ROUNDS = 8
"""Searches; the last ones find next to nothing."""

MIN_CONTRAST, MIN_ISOLATED = 2.0, 0.06
"""Contrast of removed points, or the fraction of them that is isolated, from which on they are
outliers. On 195 generated clouds that lost points, scans as clean as they were had contrasts of
0.98 to 1.58 where they lost more than 1 % (one in twenty: 2.1), and next to no isolated points;
those with outliers 1.3 to 13."""


def isolated_points(points: FloatArray, progress: Progress) -> Mask:
    """Return which points (n, 3) are much farther from their neighbours than these from theirs.

    Repeated points count once. Up to `NEIGHBOUR` different points have no isolated ones.
    """
    places, place = np.unique(points, axis=0, return_inverse=True)
    alive = np.arange(len(places))
    for number in range(MAX_ROUNDS):
        progress.update(number / MAX_ROUNDS)
        isolated = _much_farther(places[alive], progress)
        if not isolated.any():
            break
        alive = alive[~isolated]
    kept = np.zeros(len(places), bool)
    kept[alive] = True
    return ~kept[place.reshape(-1)]


def _much_farther(places: FloatArray, progress: Progress) -> Mask:
    """Return which of different places are isolated, by one search."""
    if len(places) <= NEIGHBOUR + 1:
        return np.zeros(len(places), bool)
    near = neighbours_of(places, places, min(AROUND, len(places) - 1), progress.still)
    spacing = _spacing(places, near)
    ratio = spacing - np.quantile(spacing[near], AROUND_QUANTILE, axis=1)
    low, high = np.quantile(ratio, CALM)
    deviation = (high - low) / (CALM_DEVIATIONS[1] - CALM_DEVIATIONS[0])
    mean = high - CALM_DEVIATIONS[1] * deviation
    return np.asarray(ratio > mean + max(math.log(MIN_RATIO), MAX_DEVIATIONS * deviation))


def _spacing(places: FloatArray, near: IntArray) -> FloatArray:
    """Return the logarithm of the distance of each place to its sixth neighbour."""
    return np.log(np.linalg.norm(places[near[:, NEIGHBOUR - 1]] - places, axis=1))


def are_sparser(points: FloatArray, kept: Mask, progress: Progress) -> bool:
    """Return whether the points (n, 3) that are not kept are sparser than the kept ones.

    If not, they are thin or rough parts of what was scanned rather than outliers.
    """
    if contrast(points, kept, progress) >= MIN_CONTRAST:
        return True
    isolated = isolated_points(points, progress)
    return bool(isolated[~kept].mean() >= MIN_ISOLATED)


def contrast(points: FloatArray, kept: Mask, progress: Progress) -> float:
    """Return how many times farther apart removed points are than the kept ones beside them.

    The median over removed points of their spacing over that of the nearest kept points; 1 where
    none or nearly all are removed.
    """
    places, first = np.unique(points, axis=0, return_index=True)
    stay = kept[first]
    if stay.all() or stay.sum() <= 2 * NEIGHBOUR:
        return 1.0
    near = neighbours_of(places, places, NEIGHBOUR, progress.still)
    spacing = _spacing(places, near)
    beside = neighbours_of(places[stay], places[~stay], 2 * NEIGHBOUR, progress.still)
    ratio = spacing[~stay] - np.median(spacing[stay][beside], axis=1)
    return float(math.exp(np.median(ratio)))
