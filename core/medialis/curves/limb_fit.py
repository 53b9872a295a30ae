"""Axis and radii of a limb of a scanned tree, from its points.

The axis starts as the smoothed middle of its sections. Points are cut into windows along it, seen
along the axis, and a circle is fitted to each (`_circle_kernels.py`): from three points drawn at
random (RANSAC; Fischler and Bolles 1981), then by weighted least squares. Points on one side are
enough; strays inside and beside the limb have no weight. The axis moves to the centers of the
circles, and the fit is repeated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import (
    Index,
    Mask,
    kd_tree,
    perpendicular,
    places_along,
    rows_at,
    unit_rows,
)
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray
from medialis.curves._circle_kernels import fit_circles

DRAWS = 120
"""Triples of points drawn for a window. With 40 % of strays one triple in 5 has none."""

ROUNDS = 3
"""Fits of the windows, each about the axis of the one before."""

POINTS_A_ROUND = 10
"""A limb needs so many points for each round: circles of few windows do not improve its axis."""

WINDOW = 2.0
"""Length of a window in distances of its points from the axis."""

MIN_POINTS = 10
"""Minimum number of points in a window; a circle has three parameters."""

MAX_ERROR = 0.1
"""Maximum standard error of a measured radius, as a fraction of the radius."""

MAX_MISFIT = 0.15
"""Maximum deviation of a section from a circle beyond the noise, as a fraction of the radius."""

MAX_NOISE = 0.4
"""Maximum noise, as a fraction of the radius: least squares are biased by noise**2 / (2 radius),
8 % here."""

MIN_INLIERS = 0.7
"""Minimum fraction of the points of a window that its circle explains."""

BARK = 0.05
"""Standard deviation of radii about a smooth taper, as a fraction: sections are no circles."""

WINDOWS_A_CHUNK = 64


def smoothed(points: FloatArray, width: FloatArray) -> FloatArray:
    """Return a polyline (k, 3) after local linear regression over `width` (k,), a deviation."""
    if len(points) < 3:
        return points
    along = places_along(points)
    result = points.copy()
    low = np.searchsorted(along, along - 2.0 * width)
    high = np.searchsorted(along, along + 2.0 * width)
    for k in range(len(points)):
        part = slice(min(int(low[k]), max(k - 1, 0)), max(int(high[k]), k + 2))
        t = along[part] - along[k]
        weight = np.exp(-0.5 * (t / width[k]) ** 2)
        s0, s1, s2 = weight.sum(), weight @ t, weight @ (t * t)
        if (det := s0 * s2 - s1 * s1) > 1e-12 * s0 * s2:
            result[k] = (weight * (s2 - s1 * t)) @ points[part] / det
    return result


def onto(points: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the place along a polyline and the distance from it for each point, (n,) each.

    The polyline goes straight on beyond both ends: places may be negative or beyond its length.
    """
    along, steps = places_along(axis), np.diff(axis, axis=0)
    last = len(steps) - 1
    count = min(len(steps), 4)
    nearest = kd_tree((axis[1:] + axis[:-1]) / 2.0).query(points, k=count)[1]
    nearest = nearest.reshape(len(points), count)
    squares = np.maximum(np.einsum("sa,sa->s", steps, steps), 1e-300)
    place, away = np.zeros(len(points)), np.full(len(points), np.inf)
    for rows in nearest.T:
        share = np.einsum("na,na->n", points - axis[rows], steps[rows]) / squares[rows]
        share = np.where((share < 0) & (rows > 0), 0.0, share)
        share = np.where((share > 1) & (rows < last), 1.0, share)
        off = np.linalg.norm(points - axis[rows] - share[:, None] * steps[rows], axis=1)
        better = off < away
        away[better] = off[better]
        place[better] = along[rows[better]] + share[better] * np.sqrt(squares[rows[better]])
    return place, away


def falling(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the non-increasing values that are nearest in weighted absolute deviation.

    Examples
    --------
    >>> falling(np.array([3.0, 9.0, 2.0, 1.0]), np.array([2.0, 1.0, 1.0, 1.0])).tolist()
    [3.0, 3.0, 2.0, 1.0]
    """
    blocks: list[tuple[list[float], list[float], float]] = []
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        block = [value], [weight], value
        while blocks and block[2] >= blocks[-1][2]:
            before = blocks.pop()
            joined = before[0] + block[0], before[1] + block[1]
            block = *joined, weighted_median(np.array(joined[0]), np.array(joined[1]))
        blocks.append(block)
    return np.concatenate([np.full(len(one[0]), one[2]) for one in blocks])


def weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Return the lower weighted median."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


@dataclass(frozen=True, eq=False)
class LimbFit:
    """The axis of a limb (k, 3), and what its windows (w,) say.

    Attributes
    ----------
    axis, along : (k, 3), (k,)
        Polyline from the base to the tip, and the place of each of its points.
    at : (w,)
        Place of each window along the axis.
    radii, errors, noise : (w,)
        Radius of the circle, its relative standard error, standard deviation of the residuals;
        NaN where none fits.
    points, inliers : (w,)
        Number of points, and of those that the circle explains.
    extent : float, float
        Places of the first and the last point.
    distance : float
        Median distance of the points from the axis.
    """

    axis: FloatArray
    along: FloatArray
    at: FloatArray
    radii: FloatArray
    errors: FloatArray
    noise: FloatArray
    points: FloatArray
    inliers: FloatArray
    extent: tuple[float, float]
    distance: float

    @property
    def lengths(self) -> FloatArray:
        """Length of each window, (w,)."""
        between = 0.5 * (self.at[1:] + self.at[:-1])
        return np.diff(np.concatenate([self.extent[:1], between, self.extent[1:]]))

    def middles(self) -> FloatArray:
        """Return the places of the windows in space, (w, 3)."""
        return rows_at(np.clip(self.at, 0.0, self.along[-1]), self.along, self.axis)

    def measured(self, noise: float) -> Mask:
        """Return the windows whose radius can be relied on, given the noise of the scan."""
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (self.errors < MAX_ERROR)
                & (self.misfit(noise) < MAX_MISFIT)
                & (noise < MAX_NOISE * self.radii)
                & (self.inliers >= np.maximum(MIN_INLIERS * self.points, 8))
            )

    def misfit(self, noise: float) -> FloatArray:
        """Return how far sections deviate from circles beyond the noise, in radii."""
        return np.sqrt(np.maximum(self.noise**2 - noise**2, 0.0)) / self.radii

    def weights(self, noise: float) -> FloatArray:
        """Return the weight of each radius: the inverse of its relative variance."""
        variance = BARK**2 + self.errors**2 + self.misfit(noise) ** 2
        return np.nan_to_num(1.0 / variance)

    def profile(self) -> FloatArray:
        """Return falling radii at the windows from this limb alone."""
        sound = self.noise < 0.3 * self.radii
        if not sound.any():
            return np.full(len(self.at), self.distance)
        fit = falling(self.radii[sound], self.weights(0.0)[sound])
        return np.asarray(np.interp(self.at, self.at[sound], fit))


def _windows(place: FloatArray, away: FloatArray, width: float) -> Index:
    """Return where windows begin among points sorted by their place, (w + 1,)."""
    count, first = len(place), [0]
    while (low := first[-1]) < count:
        near = away[low : low + 3 * MIN_POINTS]
        length = max(width, WINDOW * float(np.median(near)))
        high = int(np.searchsorted(place, place[low] + length))
        high = max(high, low + MIN_POINTS)
        first.append(count if count - high < MIN_POINTS else high)
    return np.array(first, np.int64)


def _across(
    points: FloatArray, place: FloatArray, first: Index, axis: FloatArray, width: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return points seen along the axis of their window, its frame, and places of windows."""
    along = places_along(axis)
    number = np.repeat(np.arange(len(first) - 1), np.diff(first))
    at = np.add.reduceat(place, first[:-1]) / np.diff(first)
    ahead, behind = (np.clip(at + s * width, 0.0, along[-1]) for s in (1.0, -1.0))
    ways = unit_rows(rows_at(ahead, along, axis) - rows_at(behind, along, axis))
    u = perpendicular(ways)
    v = np.cross(ways, u)
    away = points - rows_at(np.clip(place, 0.0, along[-1]), along, axis)
    seen = np.stack([np.einsum("na,na->n", away, one[number]) for one in (u, v)], axis=1)
    return np.ascontiguousarray(seen), u, v, at


def fit_limb(
    points: FloatArray, axis: FloatArray, width: float, floor: float, rounds: int = ROUNDS
) -> LimbFit:
    """Fit axis and radii of a limb to its points.

    Parameters
    ----------
    points : (n, 3) float64
    axis : (k, 3) float64
        Where the limb is about, from its base to its tip; k >= 2.
    width : float
        Resolution: minimum length of a window, and of what is smoothed.
    floor : float
        Standard deviation of residuals below which points count as exact.
    rounds : int
        Maximum number of fits, each about the axis of the one before. A limb of few points has
        fewer, or none: then no radius is measured.
    """
    draws = np.random.default_rng(0).random((DRAWS, 3))
    rounds = min(rounds, len(points) // POINTS_A_ROUND)
    if rounds == 0:
        return _unmeasured(points, axis)
    for left in range(rounds - 1, -1, -1):
        place, away = onto(points, axis)
        order = np.argsort(place, kind="stable")
        first = _windows(place[order], away[order], width)
        seen, u, v, at = _across(points[order], place[order], first, axis, width)
        found = np.full((len(at), 6), np.nan)
        run_chunks(fit_circles, len(at), WINDOWS_A_CHUNK, seen, first, draws, floor, found)
        x, y, radii, noise, errors, inliers = found.T
        sound = (errors < 0.25) & (noise < 0.3 * radii)
        if not left or not sound.any():
            break
        shift = (x[:, None] * u + y[:, None] * v)[sound]
        axis = _moved(axis, at[sound], shift, radii[sound], width)
    extent = float(place.min()), float(place.max())
    measures = radii, errors, noise, np.diff(first).astype(np.float64), inliers
    return LimbFit(axis, places_along(axis), at, *measures, extent, float(np.median(away)))


def _unmeasured(points: FloatArray, axis: FloatArray) -> LimbFit:
    """Return a limb of one window without a circle."""
    place, away = onto(points, axis)
    extent = float(place.min()), float(place.max())
    at, unknown = np.array([0.5 * (extent[0] + extent[1])]), np.full(1, np.nan)
    counts = np.full(1, float(len(points))), np.zeros(1)
    measures = unknown, unknown, unknown, *counts
    return LimbFit(axis, places_along(axis), at, *measures, extent, float(np.median(away)))


def _moved(
    axis: FloatArray, at: FloatArray, shift: FloatArray, radii: FloatArray, width: float
) -> FloatArray:
    """Return the axis moved to the centers of circles, where there is one within four radii."""
    along = places_along(axis)
    radius = np.interp(along, at, radii)
    right = np.clip(np.searchsorted(at, along), 0, len(at) - 1)
    gap = np.minimum(np.abs(at[right] - along), np.abs(at[np.maximum(right - 1, 0)] - along))
    near = np.clip(2.0 - gap / np.maximum(4.0 * radius, 2.0 * width), 0.0, 1.0)
    moved = axis + near[:, None] * rows_at(along, at, shift)
    return smoothed(moved, np.maximum(width, radius * near))
