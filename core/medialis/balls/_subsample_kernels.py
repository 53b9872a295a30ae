"""Kernel of uniform subsampling (thesis 3.2.1; see subsampling.py).

Strategy. Points are visited in the given order; a point is kept when no kept point lies within
delta. Kept points live in a hash grid with cells of edge at least delta, so only the 27 cells
around a point can hold one that is near. A cell chains its kept points; at most 8 points of a cell
of edge delta can be delta apart, so a chain is short. Open addressing in a table of at least twice
the number of points: an empty slot is always found.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def _slot(table_key, key):
    mask = len(table_key) - 1
    slot = ((key * 0x9E3779B97F4A7C1) >> 20) & mask
    while table_key[slot] != key and table_key[slot] != -1:
        slot = (slot + 1) & mask
    return slot


@kernel
def _has_neighbour(points, i, limit, cx, cy, cz, cells, table_key, table_head, chain):
    """Tell whether a kept point of the 27 cells around (cx, cy, cz) is nearer than the limit."""
    for a in range(max(cx - 1, 0), cx + 2):
        for b in range(max(cy - 1, 0), cy + 2):
            for c in range(max(cz - 1, 0), cz + 2):
                slot = _slot(table_key, (a * cells[1] + b) * cells[2] + c)
                if table_key[slot] == -1:
                    continue
                j = table_head[slot]
                while j >= 0:
                    dx = points[i, 0] - points[j, 0]
                    dy = points[i, 1] - points[j, 1]
                    dz = points[i, 2] - points[j, 2]
                    if dx * dx + dy * dy + dz * dz < limit:
                        return True
                    j = chain[j]
    return False


@kernel
def keep_apart(points, order, delta, cell, cells, table_key, table_head, chain, out_keep):
    """Set out_keep where a point is kept. Points are >= 0; `cells`: cells along x, y, z."""
    limit = delta * delta
    for turn in range(len(order)):
        i = order[turn]
        cx = np.int64(math.floor(points[i, 0] / cell))
        cy = np.int64(math.floor(points[i, 1] / cell))
        cz = np.int64(math.floor(points[i, 2] / cell))
        if _has_neighbour(points, i, limit, cx, cy, cz, cells, table_key, table_head, chain):
            continue
        out_keep[i] = True
        key = (cx * cells[1] + cy) * cells[2] + cz
        slot = _slot(table_key, key)
        table_key[slot] = key
        chain[i] = table_head[slot]
        table_head[slot] = i
