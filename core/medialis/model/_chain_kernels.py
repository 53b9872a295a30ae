"""Kernel of chains of edges, from end to end (curve_skeleton.py)."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def walk_chains(edges, order, starts, degrees, out_nodes):
    """Nodes along each chain; a closed one ends with its first node.

    Chain k has the edges order[starts[k]:starts[k + 1]], and its nodes get the places
    starts[k] + k to starts[k + 1] + k. It begins at its lowest node whose degree is not 2, a closed
    one without any at its lowest.
    """
    near = np.empty((len(degrees), 2), np.int32)
    for chain in range(len(starts) - 1):
        rows = order[starts[chain] : starts[chain + 1]]
        here, end = len(degrees), len(degrees)
        for e in rows:
            for j in range(2):
                v = edges[e, j]
                near[v, 0] = near[v, 1] = -1
                here = min(here, v)
                if degrees[v] != 2:
                    end = min(end, v)
        if end < len(degrees):
            here = end
        for e in rows:
            for j in range(2):
                v = edges[e, j]
                near[v, 0 if near[v, 0] < 0 else 1] = edges[e, 1 - j]
        place, before = starts[chain] + chain, -1
        out_nodes[place] = here
        for step in range(1, len(rows) + 1):
            on = near[here, 1] if near[here, 0] == before and near[here, 1] >= 0 else near[here, 0]
            before, here = here, on
            out_nodes[place + step] = here
