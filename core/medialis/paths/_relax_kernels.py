"""Kernel that shortens paths through those of neighbouring balls (thesis 3.3; see importance.py).

Strategy. Two balls are neighbours when their first feature points share an edge of the mesh and
their second ones do or are the same vertex. Only where a path is longer than the one through a
neighbour does Dijkstra's search begin, so it visits few balls.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.heap_kernels import pop, push
from medialis._kernels.jit import kernel
from medialis.paths._funnel_kernels import distance

LESS = 1.0 - 1e-9
"""Shorter by rounding alone is not shorter."""


@kernel
def _adjacent(corners, fan_offsets, fan, a, b):
    """Whether two vertices share an edge or are the same one."""
    if a == b:
        return True
    for i in range(fan_offsets[a], fan_offsets[a + 1]):
        h = fan[i]
        after, before = h - 2 if h % 3 == 2 else h + 1, h + 2 if h % 3 == 0 else h - 1
        if corners[after] == b or corners[before] == b:
            return True
    return False


@kernel
def relax_lengths(
    rows, row_of, points, corners, fan_offsets, fan, starts, ends, length, origin
):  # fmt: skip
    """Lower the lengths of some rows, in place; `origin` becomes the row whose path they take.

    `row_of` tells the row of each vertex, -1: none.
    """
    keys, names, size = np.empty(1024), np.empty(1024, np.int64), 0
    for turn in range(2):
        at = 0
        while (turn == 0 and at < len(rows)) or (turn == 1 and size > 0):
            if turn == 0:
                row = rows[at]
                at += 1
            else:
                size = pop(keys, names, size)
                row = names[size]
                if keys[size] > length[row]:
                    continue
            if not length[row] < math.inf:
                continue
            start = starts[row]
            for i in range(2 * fan_offsets[start], 2 * fan_offsets[start + 1]):
                h = fan[i // 2]
                if i % 2 == 0:
                    near = row_of[corners[h - 2 if h % 3 == 2 else h + 1]]
                else:
                    near = row_of[corners[h + 2 if h % 3 == 0 else h - 1]]
                if near < 0 or length[near] <= length[row]:
                    continue
                found = length[row] + distance(points, start, starts[near])
                if found >= LESS * length[near]:
                    continue
                found += distance(points, ends[row], ends[near])
                if found >= LESS * length[near] or not _adjacent(
                    corners, fan_offsets, fan, ends[row], ends[near]
                ):
                    continue
                if size + 1 >= len(keys):
                    keys = np.concatenate((keys, np.empty_like(keys)))
                    names = np.concatenate((names, np.empty_like(names)))
                if turn == 0:
                    size = push(keys, names, size, length[row], row)
                    break
                length[near], origin[near] = found, origin[row]
                size = push(keys, names, size, found, near)
