"""Joints of a limb: where it bends, and where its thickness changes."""

from __future__ import annotations

import numpy as np

from medialis.validation import FloatArray

TAPER = 0.15
"""The radius may be so far from a straight taper along a bone (root mean square over the mean). It
is 0.17 where the second half is half as thick as the first."""
FINEST, MOST = 4, 128
"""Places a radius at which a joint may be, and places a limb at most."""


def sample_shares(length: float, radii: FloatArray) -> FloatArray:
    """Return shares of the length of a limb where joints may be, (n + 1,), both ends included."""
    scale = float(np.median(radii)) or length or 1.0
    return np.linspace(0.0, 1.0, int(np.clip(np.ceil(FINEST * length / scale), 2, MOST)) + 1)


def joint_rows(limbs: list[FloatArray], bend: float) -> list[int]:
    """Cut limbs that are alike into the fewest bones that they need; return the rows of the joints.

    Both ends are joints. A bone fits where its limb leaves it by no more than `bend` radii and its
    radius is nearly a straight taper. Of all ways with the fewest bones the one with the least
    squares is taken: with as many bones as there are straight parts, joints lie in the bends.

    Parameters
    ----------
    limbs : list of (n + 1, 4) float64
        Position and radius at equal steps along each limb.
    bend : float

    Notes
    -----
    Shortest path over all pairs of rows. Bones of one to two radii always fit and shorter ones
    never do, so that there is a path; a limb shorter than two radii is one bone.
    """
    last = len(limbs[0]) - 1
    steps = [np.linalg.norm(np.diff(limb[:, :3], axis=0), axis=1).mean() for limb in limbs]
    step = float(np.mean(steps))
    scale = max(float(np.median(np.concatenate([limb[:, 3] for limb in limbs]))), step)
    if last * step < 2 * scale or step == 0:
        return [0, last]
    found = [_misfits(limb, bend) for limb in limbs]
    squares = np.mean([mean for mean, _ in found], axis=0)
    most = np.mean([largest for _, largest in found], axis=0)
    taper = np.mean([_taper_misfits(limb[:, 3]) for limb in limbs], axis=0)
    apart = (np.arange(last + 1) - np.arange(last + 1)[:, None]) * step
    fits = ((most <= 1) & (taper <= TAPER) | (apart <= 2 * scale)) & (apart >= scale * (1 - 1e-9))
    # The shares sum to half a bone at most, so that one bone less always counts more.
    share = np.clip(squares, 0, 1) + np.minimum(taper / TAPER, 1) ** 2
    cost = np.where(fits, 1.0 + share * np.maximum(apart, 0) / (4 * last * step), np.inf)
    return _cheapest(cost)


def _cheapest(cost: FloatArray) -> list[int]:
    """Return the rows of the cheapest path from the first to the last by the costs of steps."""
    total, before = np.full(len(cost), np.inf), np.zeros(len(cost), int)
    total[0] = 0.0
    for row in range(1, len(cost)):
        sums = total[:row] + cost[:row, row]
        before[row] = int(np.argmin(sums))
        total[row] = sums[before[row]]
    rows = [len(cost) - 1]
    while rows[-1] > 0:
        rows.append(int(before[rows[-1]]))
    return rows[::-1]


def _misfits(samples: FloatArray, bend: float) -> tuple[FloatArray, FloatArray]:
    """Return mean and maximum of the square by which the limb leaves the bone i-j, (n, n) each.

    In units of the square that is allowed.
    """
    count = len(samples)
    # Tips may be as thin as they like: they count as half as thick as the limb.
    radii = np.maximum(samples[:, 3], 0.5 * np.median(samples[:, 3]))
    allowed = 1.0 / np.maximum(bend * radii, 1e-300) ** 2
    mean, most = np.zeros((count, count)), np.zeros((count, count))
    for i in range(count - 1):
        off = samples[i + 1 :, :3] - samples[i, :3]
        gram = off @ off.T
        # Row j: the bone ends there; column k: the sample, whose nearest place on it is sought.
        ends = np.diagonal(gram)
        share = np.clip(gram / np.maximum(ends, 1e-300)[:, None], 0.0, 1.0)
        apart = ends - 2 * share * gram + share**2 * ends[:, None]
        apart = np.tril(np.maximum(apart, 0) * allowed[i + 1 :])
        mean[i, i + 1 :] = apart.sum(axis=1) / np.arange(1, count - i)
        most[i, i + 1 :] = apart.max(axis=1)
    return mean, most


def _taper_misfits(radii: FloatArray) -> FloatArray:
    """Return how far the radii of the rows i to j are from a straight line, (n, n).

    Root mean square of the line of least squares, over the mean radius; from sums up to each row.
    """
    n = len(radii)
    x, y = np.arange(n, dtype=np.float64) - n / 2, np.asarray(radii / radii.mean(), np.float64)

    def summed(values: FloatArray) -> FloatArray:
        until = np.concatenate([[0.0], np.cumsum(values)])
        return until[1:] - until[:-1, None]

    count = np.maximum(np.arange(1, n + 1) - np.arange(n)[:, None], 1)
    mx, my = summed(x) / count, summed(y) / count
    xx, xy = summed(x**2) - count * mx**2, summed(x * y) - count * mx * my
    yy = summed(y**2) - count * my**2
    slope = np.divide(xy, xx, out=np.zeros_like(xy), where=xx > 0)
    left = np.maximum(yy - slope * xy, 0.0) / count
    return np.sqrt(left) / np.where(my > 0, my, 1.0)
