"""Clusters of sites, from the share of people who put each two together.

Clusters with the largest mean share are joined first, which makes a tree: a level of it is a
division of the surface. Then sites move to the cluster with which they have most in common, as long
as more people agree with that. Several levels of the tree are tried: what most people agree with is
then the same on copies of a surface that differ a little, where a single start would lead to one
place or another.
"""

from __future__ import annotations

import numpy as np

from medialis.validation import FloatArray, IntArray

MOVES = 20
"""Rounds in which sites move, each one half of them. Few need more than ten."""

STARTS = (0.0, -0.4, 0.4, -0.85, 0.85)
"""Levels of the tree to begin with, as differences of the logarithm of level / (1 - level): about
0.5, 0.4, 0.6, 0.3 and 0.7. Thirteen between 0.2 and 0.8 lead to the same on nearly all shapes."""

ROUNDING = 1e-12
"""Differences of agreement that count for nothing."""


def divide_sites(shares: FloatArray, areas: FloatArray, level: float, count: int = 0) -> IntArray:
    """Return the cluster of each of s sites, (s,), numbered from 0.

    Parameters
    ----------
    shares : (s, s) float64
        Of people who put both sites in one part; 0: never.
    areas : (s,) float64
    level : float
        Clusters are joined while their mean share is at least this.
    count : int
        Join to so many clusters instead, where shares are above 0; 0: by the level.
    """
    pairs, joined = join_tree(shares, areas)
    s, weight = len(areas), areas / areas.sum()
    if count > 0:
        turns = min(max(s - count, 0), len(pairs))
        level = float(joined[turns - 1]) if turns else 1.0
        return _moved(shares, weight, _after_joins(pairs[:turns], s), level, True)
    starts = np.log(level / (1.0 - level)) + np.array(STARTS)
    best, most = np.zeros(s, np.int32), -np.inf
    tried: set[int] = set()
    for start in 1.0 / (1.0 + np.exp(-starts)):
        turns = int((joined >= start).sum())
        if turns in tried:
            continue
        tried.add(turns)
        moved = _moved(shares, weight, _after_joins(pairs[:turns], s), level, False)
        found = _joined(shares, areas, moved, level)
        agreed = _agreement(shares, weight, found, level)
        if agreed > most + ROUNDING:
            best, most = found, agreed
    return best


def _agreement(shares: FloatArray, areas: FloatArray, cluster: IntArray, level: float) -> float:
    """Sum of share - level over the areas of all pairs in one cluster."""
    members = np.zeros((len(areas), int(cluster.max(initial=0)) + 1))
    members[np.arange(len(areas)), cluster] = areas
    return float((members * ((shares - level) @ members)).sum())


def join_tree(shares: FloatArray, areas: FloatArray) -> tuple[IntArray, FloatArray]:
    """Join clusters from s single ones on, those with the largest mean share first.

    Returns
    -------
    pairs : (j, 2) int32
        Clusters that are joined, by their lowest member; the second one becomes part of the first.
    joined : (j,) float64
        Their mean share, which never rises. j < s - 1 where shares are 0.
    """
    from medialis.segments._site_kernels import average_linkage

    s = len(areas)
    pairs, joined = np.empty((max(s - 1, 0), 2), np.int32), np.empty(max(s - 1, 0))
    turns = average_linkage(np.array(shares), np.array(areas), pairs, joined) if s else 0
    return pairs[:turns], np.minimum.accumulate(joined[:turns])


def _after_joins(pairs: IntArray, s: int) -> IntArray:
    """Cluster of each of s sites after these joins."""
    lowest = np.arange(s)
    for kept, dropped in pairs[::-1].tolist():  # the last ones first: their target is final
        lowest[dropped] = lowest[kept]
    return np.unique(lowest, return_inverse=True)[1].reshape(-1).astype(np.int32)


def _joined(shares: FloatArray, areas: FloatArray, cluster: IntArray, level: float) -> IntArray:
    """Join clusters whose mean share has come up to the level since sites moved."""
    members = np.zeros((len(areas), int(cluster.max(initial=0)) + 1))
    members[np.arange(len(areas)), cluster] = areas
    total = members.sum(axis=0)
    between = members.T @ shares @ members / (total[:, None] * total[None, :])
    pairs, joined = join_tree(between, total)
    return _after_joins(pairs[: int((joined >= level).sum())], len(total))[cluster]


def _moved(
    shares: FloatArray, areas: FloatArray, cluster: IntArray, level: float, keep_all: bool
) -> IntArray:
    """Move sites to where the sum of share - level over the areas of a cluster is largest.

    That is the Rand index which can be expected, at level 0.5: each move raises it. Neighbours in
    the order of the sites take turns, as moves of both at once might lower it.
    """
    site, turn = np.arange(len(areas)), 0
    gains = shares - level
    np.fill_diagonal(gains, 0.0)
    moved, still = cluster.copy(), 0
    while turn < MOVES and still < 2:
        members = np.zeros((len(areas), int(cluster.max(initial=0)) + 1))
        members[site, moved] = areas
        gain = gains @ members
        best = gain.argmax(axis=1)
        better = (gain[site, best] > gain[site, moved] + ROUNDING) & (site % 2 == turn % 2)
        moved[better] = best[better]
        still, turn = 0 if better.any() else still + 1, turn + 1
    used, number = np.unique(moved, return_inverse=True)
    if keep_all and len(used) <= cluster.max(initial=0):
        return cluster
    return number.reshape(-1).astype(np.int32)
