"""Points of clouds that lie on lines: wires, cables, rods, bars of lattices.

There most of the nearest neighbours of a point lie along one line, on both sides of the point, and
the point is as near to this line as they are. Of outliers that is hardly ever true: of 16 places
anywhere in a ball, 10 lie in a cylinder as slim as this once in a billion balls. Ends, and places
where lines meet, have no one line: they are as close to points on lines as these are to each other.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.progress import Progress
from medialis.base.threads import nearest_rows, run_chunks, run_patiently
from medialis.base.validation import FloatArray
from medialis.clouds.smoothing import FARTHER, neighbours_of

SIZES = ((8, 6, 0.1), (16, 10, 0.15))
"""Neighbours, how many of them lie along a line, and how far from it, for the distance of the last
neighbour: few where lines bend or bars are short, more where points scatter about lines."""

FITS = 2
"""Times that the line is fitted again to those nearest to it."""

LEAST_AHEAD = 2
"""Neighbours along the line on either side of a point, at least."""

COMPANY = 2
"""Points that stay, among the nearest neighbours of one on a line: one alone is there by chance."""

OUTSIDE = 1.5
"""Distance of a point from a line over that of the last of those that lie along it, and"""

SPREAD = 4.0
"""how much farther it may be, over the spread of their distances: four deviations."""

ROUNDING = 1e-5
"""Distance from a line that is none, for the distance of the last neighbour."""

NEIGHBOUR = 6
"""The distance to this neighbour is the local spacing."""

CHUNK = 2048
"""Points."""


def on_lines(points: FloatArray, rest: Mask, progress: Progress) -> Mask:
    """Tell which points of the rest of a cloud lie on lines.

    Parameters
    ----------
    points : (n, 3) float
        A cloud.
    rest : (n,) bool
        Points that are asked about: those on no surface.

    Returns
    -------
    (n,) bool
        A part of `rest`.
    """
    places, first, place = np.unique(points, axis=0, return_index=True, return_inverse=True)
    rows, on = np.flatnonzero(rest[first]), np.zeros(len(places), bool)
    for count, along, slim in SIZES:
        if count >= len(places):
            break
        left = rows[~on[rows]]
        on[left] = _along_lines(places, left, count, along, slim, progress)
    asked = np.zeros(len(places), bool)
    asked[rows] = True
    on &= _in_company(places, on, on | ~asked, progress)
    on[_beside(places, rows[~on[rows]], np.flatnonzero(on), progress)] = True
    return np.asarray(on[place.reshape(-1)] & rest)


def _in_company(places: FloatArray, on: Mask, stay: Mask, progress: Progress) -> Mask:
    """Tell the points on lines that have others that stay among their nearest neighbours."""
    rows, result = np.flatnonzero(on), np.zeros(len(on), bool)
    if len(rows):
        tree = run_patiently(lambda: kd_tree(places), progress)
        count = min(SIZES[0][0], len(places) - 1)
        near = nearest_rows(tree, places[rows], count + 1, progress)[:, 1:]
        result[rows] = stay[near].sum(axis=1) >= COMPANY
    return result


def _along_lines(
    places: FloatArray, rows: Index, count: int, along: int, slim: float, progress: Progress
) -> Mask:
    """Tell which rows of places lie on a line of their neighbours."""
    tree = run_patiently(lambda: kd_tree(places), progress)
    near = nearest_rows(tree, places[rows], count + 1, progress)[:, 1:]
    found = np.zeros(len(rows), bool)

    def fit(begin: int, end: int) -> None:
        spokes = places[near[begin:end]] - places[rows[begin:end], None]
        found[begin:end] = _line_like(spokes, along, slim)

    run_chunks(fit, len(rows), CHUNK, progress=progress)
    return found


def _line_like(spokes: FloatArray, along: int, slim: float) -> Mask:
    """Tell which neighbourhoods (r, k, 3), about a point at 0, lie along a line, and it on this."""
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
    both_sides = np.minimum(ahead, behind) >= LEAST_AHEAD
    return np.asarray(both_sides & (last <= slim) & (own <= np.minimum(limit, slim)))


def _off_best_spoke(spokes: FloatArray, along: int) -> FloatArray:
    """Return distances (r, k) from the line through 0 and the neighbour that has most beside it."""
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
    """Return how far places (r, k, 3) are along lines through 0, and how far from these."""
    along = np.einsum("rki,ri->rk", away, way)
    square = np.einsum("rki,rki->rk", away, away) - along**2
    return along, np.sqrt(np.maximum(square, 0.0))


def _beside(places: FloatArray, rows: Index, lines: Index, progress: Progress) -> Index:
    """Return the rows that are as close to points on lines, and as dense, as these are."""
    if len(rows) == 0 or len(lines) == 0:
        return rows[:0]
    gap, nearest = run_patiently(lambda: kd_tree(places[lines]).query(places[rows]), progress)
    both = np.concatenate([rows, lines[nearest]])
    near = neighbours_of(places, places[both], NEIGHBOUR, progress)[:, -1]
    spacing = np.linalg.norm(places[near] - places[both], axis=1)
    own, of_lines = np.split(spacing, 2)
    return rows[(gap <= of_lines) & (own <= FARTHER * of_lines)]
