"""Ranks over the field of two elements, for Betti numbers."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def free_faces(sides, edge_count, live):
    """Take triangles with an edge of their own away until there are none: no hollow has one."""
    count, around = np.zeros(edge_count, np.int64), np.zeros(edge_count, np.int64)
    for t in range(len(sides)):
        for k in range(3):
            count[sides[t, k]] += 1
            around[sides[t, k]] ^= t
    waiting = np.empty(edge_count, np.int64)
    size = 0
    for e in range(edge_count):
        if count[e] == 1:
            waiting[size] = e
            size += 1
    while size > 0:
        size -= 1
        if count[waiting[size]] != 1:
            continue
        t = around[waiting[size]]
        live[t] = False
        for k in range(3):
            e = sides[t, k]
            count[e] -= 1
            around[e] ^= t
            if count[e] == 1:
                waiting[size] = e
                size += 1


@kernel
def eliminate(sides, edge_count):
    """Count independent sets of triangles without border: sides (t, 3) ascending edges.

    Each triangle is reduced by those with the same last edge; what vanishes closes a hollow.
    """
    owner = np.full(edge_count, -1)
    starts, sizes = np.zeros(len(sides), np.int64), np.zeros(len(sides), np.int64)
    pool, used = np.empty(16 * len(sides) + 64, np.int64), 0
    row, other = np.empty(edge_count, np.int64), np.empty(edge_count, np.int64)
    hollows = 0
    for t in range(len(sides)):
        length = 3
        for k in range(3):
            row[k] = sides[t, k]
        while length > 0 and owner[row[length - 1]] >= 0:
            p = owner[row[length - 1]]
            length = _sum(row, length, pool, starts[p], sizes[p], other)
            row, other = other, row
        if length == 0:
            hollows += 1
            continue
        if used + length > len(pool):
            larger = np.empty(2 * (used + length), np.int64)
            larger[:used] = pool[:used]
            pool = larger
        owner[row[length - 1]] = t
        starts[t], sizes[t] = used, length
        pool[used : used + length] = row[:length]
        used += length
    return hollows


@kernel
def _sum(row, length, pool, start, size, out):
    """Edges in one of two ascending lists but not in both; returns their number."""
    i, j, count = 0, 0, 0
    while i < length or j < size:
        if j == size or (i < length and row[i] < pool[start + j]):
            out[count] = row[i]
            i, count = i + 1, count + 1
        elif i == length or pool[start + j] < row[i]:
            out[count] = pool[start + j]
            j, count = j + 1, count + 1
        else:
            i, j = i + 1, j + 1
    return count
