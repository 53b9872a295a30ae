"""Kernel of connected importance (thesis 3.3; see connectivity.py).

Strategy. Links are taken from the most important to the least; a link joins the pieces of its two
ends (union-find). Above the importance of that link the smaller piece was an island: its points are
lowered to it. Each point is lowered at most log2(n) times, because its piece at least doubles, so
walking over the members of the smaller piece costs O(n log n) in all. Members form a ring
(`following`), and two rings are joined by swapping two entries.
"""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def lower_islands(links, strength, out_importance):
    """Lower `out_importance`; `links` (e, 2) come with falling `strength`."""
    n = len(out_importance)
    parent, following = np.arange(n), np.arange(n)
    size = np.ones(n, np.int64)
    for e in range(len(links)):
        a, b = _root(parent, links[e, 0]), _root(parent, links[e, 1])
        if a == b:
            continue
        if size[a] < size[b] or (size[a] == size[b] and a > b):
            a, b = b, a
        member = b
        for _ in range(size[b]):
            if out_importance[member] > strength[e]:
                out_importance[member] = strength[e]
            member = following[member]
        parent[b] = a
        size[a] += size[b]
        following[a], following[b] = following[b], following[a]
