"""Points on no smooth patch that are no outliers either: tips, edges and thin parts (thesis 4.2.4).

Outliers differ from a surface by the distance to their neighbours. Where all points that the
patches leave out lie as close together as those on the surface beside them, nothing tells them
from it: a clean scan keeps them. Those among outliers go, as some outliers lie near a surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.clouds.smoothing import nearest_points, neighbours_of
from medialis.progress import Progress
from medialis.validation import FloatArray

NEIGHBOURS = 6
"""On a surface as many lie about a point."""

AROUND = 12
"""Points whose median tells what a place is like."""

MOST = 0.8
"""Share of the candidates around that must be dense too; of outliers near a surface fewer are."""

FARTHER = 1.5
"""Distance of the last neighbour, for that of surface points, from which a point is isolated. On a
surface sampled at random the distance to the sixth neighbour varies by a fifth."""


def dense_points(
    points: FloatArray, noise: NDArray[np.bool_], least: int, progress: Progress
) -> NDArray[np.bool_]:
    """Tell which points of noise lie as close together as the surface beside them.

    Parameters
    ----------
    points : (n, 3) float
        A cloud.
    noise : (n,) bool
        Points in no manifold.
    least : int
        Points that hang together, with those of the surface, are as many or more.

    Returns
    -------
    (n,) bool
        A part of `noise`.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    places, place = np.unique(points, axis=0, return_inverse=True)
    place, rest = place.reshape(-1), np.zeros(len(places), bool)
    rest[place[noise]] = True
    surface, candidates = np.flatnonzero(~rest), np.flatnonzero(rest)
    if len(candidates) == 0 or len(surface) <= AROUND:
        return np.zeros(len(points), bool)
    near = nearest_points(places, NEIGHBOURS, progress)
    last = np.linalg.norm(places[near[:, -1]] - places, axis=1)
    beside = neighbours_of(places[surface], places[candidates], AROUND, progress)
    dense = last[candidates] <= FARTHER * np.median(last[surface][beside], axis=1)
    if len(candidates) > AROUND:
        around = nearest_points(places[candidates], AROUND, progress)
        dense &= dense[around].mean(axis=1) >= MOST
    good = ~rest
    good[candidates[dense]] = True
    a, b = np.repeat(np.arange(len(places)), NEIGHBOURS), near.reshape(-1)
    joined = good[a] & good[b]
    graph = coo_array((np.ones(joined.sum()), (a[joined], b[joined])), (len(places),) * 2)
    part = connected_components(graph, directed=False)[1]
    good &= rest & (np.bincount(part[good], minlength=part.max() + 1)[part] >= least)
    return good[place]
