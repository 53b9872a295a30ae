"""What a curve skeleton grows along: links between balls (thesis 3.6.3).

A link between two balls stays inside the shape when each center lies in the other ball, or at least
when the balls overlap. So a graph of such links leads along the surface skeleton only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.threads import thread_count
from medialis.validation import FloatArray, frozen

NEIGHBOURS = 10
"""Of each point, as in the thesis."""

JITTER = 1e-9
"""Fraction of the diagonal by which points move for the search of neighbours only: exactly equal
ones, as the centers of a sphere, could not be split by a tree, and every search would visit all."""

OFF_CURVE = 20.0
"""Times what a link costs on the curve skeleton that one far from it costs."""

SHORT = 0.3
"""Share of the smaller radius up to which a link counts as short: the distance of the nodes in the
end. In a thick body centers are many spacings apart; a path through it must not cost more than one
along thin balls below its surface."""

OVERLAP_ONLY, APART = 10.0, 1000.0
"""Factors of the cost where a center lies outside the other ball, and where the balls are apart:
last resorts that keep the graph in one piece."""


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


@dataclass(frozen=True, eq=False)
class BallLinks:
    """Balls and the links between them; row i of any array belongs to ball i.

    Attributes
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    offsets : (k + 1,) int64
        Links of ball i are numbers offsets[i] to offsets[i + 1]; each is listed from both ends.
    neighbours : (l,) int32
        The other end.
    length : (l,) float64
        Distance of the centers.
    cost : (l,) float64
        What a path along the link costs: low near the curve skeleton.
    spacing : float
        Typical distance of neighbouring balls.
    widths : (k,) float64
        Half the width of the shape across each ball; inf where it is not known.
    """

    centers: FloatArray
    radii: FloatArray
    offsets: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    length: FloatArray
    cost: FloatArray
    spacing: float
    widths: FloatArray

    def __len__(self) -> int:
        return len(self.radii)


def link_balls(
    centers: FloatArray,
    radii: FloatArray,
    closeness: FloatArray,
    near: NDArray[np.int64],
    needed: NDArray[np.int64],
    *,
    spacing: float,
    widths: FloatArray | None = None,
) -> BallLinks:
    """Link balls and give each link a cost.

    Parameters
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    closeness : (k,) float64
        1 on the curve skeleton, 0 far from it.
    near : (a, 2) int
        Pairs that may be linked: used where each center lies in the other ball.
    needed : (b, 2) int
        Pairs that are linked in any case, for the graph to hang together.
    spacing : float
        Typical distance of neighbouring balls; a link longer than this, and than a share of the
        smaller radius, costs more for its length.
    widths : (k,) float64, optional
        As in `BallLinks`.

    Returns
    -------
    BallLinks
    """
    k = len(radii)
    pairs = np.sort(np.concatenate([near, needed]).astype(np.int64), axis=1)
    wanted = np.arange(len(pairs)) >= len(near)
    key = pairs[:, 0] * k + pairs[:, 1]
    distance, smaller, both = _measure(centers, radii, pairs)
    use = (pairs[:, 0] != pairs[:, 1]) & (wanted | (distance < smaller))
    key = np.sort(key[use])
    key = key[np.r_[True, key[1:] != key[:-1]][: len(key)]]
    low, high = np.divmod(key, k)
    distance, smaller, both = _measure(centers, radii, np.stack([low, high], axis=1))
    density = 1 / (1 / OFF_CURVE + closeness)
    long = 1 + distance / np.maximum(SHORT * smaller, spacing)
    cost = distance * long * (density[low] + density[high]) / 2
    cost *= np.where(distance < smaller, 1.0, np.where(distance < both, OVERLAP_ONLY, APART))
    cost += 1e-9 * spacing  # coincident centers: the path with fewer links
    start = np.concatenate([low, high])
    order = np.argsort(start, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(start, minlength=k))])
    return BallLinks(
        centers,
        radii,
        offsets,
        np.concatenate([high, low])[order].astype(np.int32),
        frozen(np.concatenate([distance, distance])[order], np.float64),
        frozen(np.concatenate([cost, cost])[order], np.float64),
        spacing,
        np.full(k, np.inf) if widths is None else widths,
    )


def _measure(
    centers: FloatArray, radii: FloatArray, pairs: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance of each pair, its smaller radius, the sum of its radii."""
    a, b = pairs.T
    distance = np.linalg.norm(centers[a] - centers[b], axis=1)
    return distance, np.minimum(radii[a], radii[b]), radii[a] + radii[b]
