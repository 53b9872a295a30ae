"""Detect points of clouds on lines: wires, cables, rods, bars of lattices.

Most of the nearest neighbours of such a point are close to one line, on both sides of the point,
and the point is as close to the line as its neighbours are. Outliers hardly ever meet this: of 16
random points in a ball, 10 are in such a slim cylinder once in a billion balls. Ends of lines and
crossings have no single line: they are as close to points on lines as these are to each other.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.clouds.smoothing import FARTHER, neighbours_of

SIZES = ((8, 6, 0.1), (16, 10, 0.15))
"""Number of neighbours, minimum number of them along the line, and maximum distance from the line
as a fraction of the distance of the last neighbour. Eight detect short bars and bent lines, sixteen
detect points that scatter about a line."""

FITS = 2
"""Number of times that the line is fitted again to the neighbours closest to it."""

MIN_PER_SIDE = 2
"""Minimum number of neighbours along the line on each side of a point."""

MIN_KEPT_NEIGHBOURS = 2
"""Minimum number of kept points among the eight nearest neighbours of a point on a line: a single
point on a line is a coincidence."""

OUTSIDE, SPREAD = 1.5, 4.0
"""Maximum distance of a point from its line: this factor times that of the farthest neighbour along
the line, or that distance plus this factor times the spread of the distances."""

ROUNDING = 1e-5
"""Distance from a line that counts as zero, as a fraction of the distance of the last neighbour."""

NEIGHBOUR = 6
"""The local spacing is the distance to this neighbour."""

CHUNK = 2048
"""Number of points fitted at a time."""


def on_lines(points: FloatArray, rest: Mask, progress: Progress) -> Mask:
    """Return which points of the rest of a cloud are on lines.

    Parameters
    ----------
    points : (n, 3) float
        A cloud.
    rest : (n,) bool
        Points to classify: those on no surface.

    Returns
    -------
    (n,) bool
        A subset of `rest`.
    """
    places, first, place = np.unique(points, axis=0, return_index=True, return_inverse=True)
    rest_rows, on = np.flatnonzero(rest[first]), np.zeros(len(places), bool)
    sizes = [size for size in SIZES if size[0] < len(places)]
    if len(rest_rows) == 0 or not sizes:
        return np.zeros(len(points), bool)
    neighbours = neighbours_of(places, places[rest_rows], sizes[-1][0], progress)
    for count, along, slim in sizes:
        left = np.flatnonzero(~on[rest_rows])
        near = neighbours[left, :count]
        on[rest_rows[left]] = _along_lines(places, rest_rows[left], near, along, slim, progress)
    kept = on.copy()
    kept[~rest[first]] = True
    company = kept[neighbours[:, : SIZES[0][0]]].sum(axis=1)
    on[rest_rows[company < MIN_KEPT_NEIGHBOURS]] = False
    on[_beside(places, rest_rows, neighbours, on, progress)] = True
    return np.asarray(on[place.reshape(-1)] & rest)


def _along_lines(
    places: FloatArray, rows: Index, near: IntArray, along: int, slim: float, progress: Progress
) -> Mask:
    """Return which rows of places are on a line through their neighbours (r, k)."""
    result = np.zeros(len(rows), bool)

    def fit(begin: int, end: int) -> None:
        spokes = places[near[begin:end]] - places[rows[begin:end], None]
        result[begin:end] = _line_like(spokes, along, slim)

    run_chunks(fit, len(rows), CHUNK, progress=progress)
    return result


def _line_like(spokes: FloatArray, along: int, slim: float) -> Mask:
    """Return which neighbourhoods (r, k, 3) of a point at 0 follow a line through the point."""
    spokes = spokes / np.linalg.norm(spokes[:, -1:], axis=2, keepdims=True)
    away = _off_best_spoke(spokes, along)
    for _ in range(FITS):
        middle, way = _fitted(spokes, np.argpartition(away, along - 1, axis=1)[:, :along])
        at, away = _along_and_off(spokes - middle[:, None], way)
    own_at, own = (one[:, 0] for one in _along_and_off(-middle[:, None], way))
    order = np.sort(away, axis=1)
    last, near = order[:, along - 1], order[:, away.shape[1] // 4 - 1]
    limit = np.maximum(OUTSIDE * last, last + SPREAD * (last - near)) + ROUNDING
    beside = away <= last[:, None]
    ahead = (beside & (at > own_at[:, None])).sum(axis=1)
    behind = (beside & (at < own_at[:, None])).sum(axis=1)
    both_sides = np.minimum(ahead, behind) >= MIN_PER_SIDE
    return np.asarray(both_sides & (last <= slim) & (own <= np.minimum(limit, slim)))


def _off_best_spoke(spokes: FloatArray, along: int) -> FloatArray:
    """Return distances (r, k) from the line through 0 and the neighbour closest to most others."""
    products = spokes @ spokes.transpose(0, 2, 1)
    squares = np.einsum("rkk->rk", products)
    away = squares[:, None] - products**2 / squares[..., None]
    best = np.partition(away, along - 1, axis=2)[..., along - 1].argmin(axis=1)
    return np.asarray(away[np.arange(len(away)), best])


def _fitted(spokes: FloatArray, chosen: Index) -> tuple[FloatArray, FloatArray]:
    """Return a point (r, 3) and the direction (r, 3) of the line through chosen neighbours."""
    some = np.take_along_axis(spokes, chosen[..., None], axis=1)
    middle = some.mean(axis=1)
    some = some - middle[:, None]
    return middle, np.linalg.eigh(some.transpose(0, 2, 1) @ some)[1][..., 2]


def _along_and_off(away: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the positions of points (r, k, 3) along lines through 0, and their distances."""
    along = np.einsum("rki,ri->rk", away, way)
    square = np.einsum("rki,rki->rk", away, away) - along**2
    return along, np.sqrt(np.maximum(square, 0.0))


def _beside(
    places: FloatArray, rows: Index, neighbours: IntArray, on: Mask, progress: Progress
) -> Index:
    """Return the rows that are as close to points on lines, and as dense, as these points are."""
    ends, lines = rows[~on[rows]], np.flatnonzero(on)
    if len(ends) == 0 or len(lines) == 0:
        return ends[:0]
    last = places[neighbours[:, NEIGHBOUR - 1]]
    spacing = np.zeros(len(places))
    spacing[rows] = np.linalg.norm(last - places[rows], axis=1)
    gap, nearest = run_patiently(lambda: kd_tree(places[lines]).query(places[ends]), progress)
    of_line = spacing[lines[nearest]]
    return ends[(gap <= of_line) & (spacing[ends] <= FARTHER * of_line)]
