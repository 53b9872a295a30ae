"""Kernel of connected importance (thesis 3.3; see connectivity.py).

Strategy. Links are taken from the most important to the least; a link joins the pieces of its two
ends (union-find). Above the importance of that link the smaller piece was an island. A small island
is lowered to that importance. Each point is lowered at most log2(n) times, because its piece at
least doubles, so walking over the members of the smaller piece costs O(n log n) in all. Members
form a ring (`following`), and two rings are joined by swapping two entries. For a large island the
peaks of both pieces are recorded: they are to be joined by a bridge.
"""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import find_root


@kernel
def join_pieces(
    links, order, level, strength, large, out_importance, out_tree, out_bridges
):  # fmt: skip
    """Lower small islands in `out_importance`.

    `links` (e, 2) are taken in `order`, with falling strength[level]. `out_tree` receives the links
    that joined pieces, `out_bridges` the peaks of two pieces of at least `large` points each.
    Returns the numbers of both.
    """
    n = len(out_importance)
    parent, following, peak = np.arange(n), np.arange(n), np.arange(n)
    size = np.ones(n, np.int64)
    joined, bridges = 0, 0
    for e in order:
        a, b = find_root(parent, links[e, 0]), find_root(parent, links[e, 1])
        if a == b:
            continue
        out_tree[joined, 0], out_tree[joined, 1] = links[e, 0], links[e, 1]
        joined += 1
        if size[a] < size[b] or (size[a] == size[b] and a > b):
            a, b = b, a
        if size[b] >= large:
            out_bridges[bridges, 0], out_bridges[bridges, 1] = peak[a], peak[b]
            bridges += 1
        else:
            member, lowest = b, strength[level[e]]
            for _ in range(size[b]):
                if out_importance[member] > lowest:
                    out_importance[member] = lowest
                member = following[member]
        if out_importance[peak[b]] > out_importance[peak[a]]:
            peak[a] = peak[b]
        parent[b] = a
        size[a] += size[b]
        following[a], following[b] = following[b], following[a]
    return joined, bridges


@kernel
def falling_links(links, rank, centers, longest):
    """Levels of links, the rank of their lower end, n where they are too long; and their order."""
    n = len(rank)
    level, place = np.empty(len(links), np.int32), np.zeros(n + 2, np.int64)
    for e in range(len(links)):
        a, b = links[e, 0], links[e, 1]
        apart = 0.0
        for i in range(3):
            apart += (centers[a, i] - centers[b, i]) ** 2
        level[e] = n if apart > longest * longest else max(rank[a], rank[b])
        place[level[e] + 1] += 1
    for k in range(n + 1):
        place[k + 1] += place[k]
    order = np.empty(len(links), np.int64)
    for e in range(len(links)):
        order[place[level[e]]] = e
        place[level[e]] += 1
    return level, order


@kernel
def best_neighbours(edges, values):
    """For each point the neighbour of the highest value above its own, or the point itself."""
    best = np.arange(len(values)).astype(np.int32)
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if values[b] > values[best[a]]:
            best[a] = b
        if values[a] > values[best[b]]:
            best[b] = a
    return best
