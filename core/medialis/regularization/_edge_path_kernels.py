"""Kernel of shortest paths along edges, where no plane cut arrives (thesis 3.3; see geodesics.py).

A* with the straight line to the end as the estimate, which never exceeds what remains. The queue is
a binary heap in two arrays; a vertex may stand in it several times, only its first removal counts.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis.regularization._geodesic_kernels import EDGES, direction


@kernel
def _sift_up(key, item, i):
    while i > 0:
        up = (i - 1) // 2
        if key[up] <= key[i]:
            break
        key[up], key[i] = key[i], key[up]
        item[up], item[i] = item[i], item[up]
        i = up


@kernel
def _sift_down(key, item, size):
    i = 0
    while True:
        low = 2 * i + 1
        if low >= size:
            break
        if low + 1 < size and key[low + 1] < key[low]:
            low += 1
        if key[i] <= key[low]:
            break
        key[low], key[i] = key[i], key[low]
        item[low], item[i] = item[i], item[low]
        i = low


@kernel
def edge_paths(
    begin, end_row, rows, points, corners, fan_offsets, fan, starts, ends,
    out_length, out_start_tangent, out_end_tangent, out_status,
):  # fmt: skip
    """Shortest paths along the edges (A*), an upper bound, for the pairs rows[begin..end_row].

    The queue holds at most one entry for each improvement of a vertex; it grows by doubling. A
    vertex is settled once, so a search ends after at most n of them.
    """
    n = len(points)
    length, parent = np.empty(n), np.empty(n, np.int64)
    # Search in which a vertex was reached, or settled; saves clearing n entries for each search.
    reached, settled = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    key, item = np.empty(1024), np.empty(1024, np.int64)
    for r in range(begin, end_row):
        row = rows[r]
        start, end = starts[row], ends[row]
        length[start] = 0.0
        reached[start] = r
        parent[start] = -1
        key[0], item[0] = 0.0, start
        size = 1
        while size > 0:
            v = item[0]
            size -= 1
            key[0], item[0] = key[size], item[size]
            _sift_down(key, item, size)
            if settled[v] == r:
                continue
            settled[v] = r
            if v == end:
                break
            for i in range(fan_offsets[v], fan_offsets[v + 1]):
                h = fan[i]
                for turn in range(2):
                    if turn == 0:
                        w = corners[h - 2 if h % 3 == 2 else h + 1]
                    else:
                        w = corners[h + 2 if h % 3 == 0 else h - 1]
                    if settled[w] == r:
                        continue
                    step = 0.0
                    rest = 0.0
                    for a in range(3):
                        step += (points[w, a] - points[v, a]) ** 2
                        rest += (points[w, a] - points[end, a]) ** 2
                    new = length[v] + math.sqrt(step)
                    if reached[w] != r or new < length[w]:
                        reached[w] = r
                        length[w] = new
                        parent[w] = v
                        if size == len(key):
                            key = np.concatenate((key, np.empty_like(key)))
                            item = np.concatenate((item, np.empty_like(item)))
                        key[size], item[size] = new + math.sqrt(rest), w
                        size += 1
                        _sift_up(key, item, size - 1)
        if reached[end] != r:
            continue
        out_length[row] = length[end]
        out_status[row] = EDGES
        v = end
        direction(points[parent[v]], points[v], out_end_tangent[row])
        while parent[v] != start:
            v = parent[v]
        direction(points[start], points[v], out_start_tangent[row])
