"""Kernels of shortest paths along edges (thesis 3.3; see geodesics.py).

A* with the straight line to the end as the estimate, which never exceeds what remains. The queue is
a binary heap in two arrays; a vertex may stand in it several times, only its first removal counts.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis.paths._geodesic_kernels import EDGES
from medialis.paths._plane_kernels import direction


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
def _over(points, v, a, b, w):
    """Straight way from v over the edge a-b to w, its two faces unfolded; inf when it misses it."""
    ex, ey, ez = (
        points[b, 0] - points[a, 0],
        points[b, 1] - points[a, 1],
        points[b, 2] - points[a, 2],
    )
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    if size == 0.0:
        return math.inf
    ex, ey, ez = ex / size, ey / size, ez / size
    vx, vy, vz = (
        points[v, 0] - points[a, 0],
        points[v, 1] - points[a, 1],
        points[v, 2] - points[a, 2],
    )
    wx, wy, wz = (
        points[w, 0] - points[a, 0],
        points[w, 1] - points[a, 1],
        points[w, 2] - points[a, 2],
    )
    along_v, along_w = ex * vx + ey * vy + ez * vz, ex * wx + ey * wy + ez * wz
    high_v = math.sqrt(max(vx * vx + vy * vy + vz * vz - along_v * along_v, 0.0))
    high_w = math.sqrt(max(wx * wx + wy * wy + wz * wz - along_w * along_w, 0.0))
    at = along_v * high_w + along_w * high_v
    if not 0.0 < at < size * (high_v + high_w):
        return math.inf
    return math.sqrt((along_w - along_v) ** 2 + (high_v + high_w) ** 2)


@kernel
def _search(
    points,
    corners,
    twins,
    fan_offsets,
    fan,
    start,
    end,
    r,
    most,
    length,
    parent,
    reached,
    settled,
    heap,
):
    """Search number r: fills the lengths and parents of the vertices reached, returns the queue.

    With `twins` (else empty) also straight over half-edges h to the vertex across, whose parent is
    then -2 - h. The queue holds at most one entry for each improvement of a vertex; it grows by
    doubling. A vertex is settled once, so a search ends after at most n of them; it is given up
    after `most`, and then the end is not settled.
    """
    key, item = heap
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
        most -= 1
        if v == end or most < 0:
            break
        for i in range(fan_offsets[v], fan_offsets[v + 1]):
            h = fan[i]
            after, before = h - 2 if h % 3 == 2 else h + 1, h + 2 if h % 3 == 0 else h - 1
            for turn in range(3 if len(twins) > 0 else 2):
                if turn < 2:
                    w = corners[after if turn == 0 else before]
                else:
                    t = twins[after]
                    if t < 0:
                        continue
                    w = corners[t + 2 if t % 3 == 0 else t - 1]
                if settled[w] == r:
                    continue
                step = 0.0
                rest = 0.0
                for a in range(3):
                    step += (points[w, a] - points[v, a]) ** 2
                    rest += (points[w, a] - points[end, a]) ** 2
                step = math.sqrt(step)
                if turn == 2:
                    step = _over(points, v, corners[after], corners[before], w)
                new = length[v] + step
                if (reached[w] != r or new < length[w]) and new < math.inf:
                    reached[w] = r
                    length[w] = new
                    parent[w] = v if turn < 2 else -2 - after
                    if size == len(key):
                        key = np.concatenate((key, np.empty_like(key)))
                        item = np.concatenate((item, np.empty_like(item)))
                    key[size], item[size] = new + math.sqrt(rest), w
                    size += 1
                    _sift_up(key, item, size - 1)
    return key, item


@kernel
def edge_paths(
    begin, end_row, rows, most, points, corners, fan_offsets, fan, starts, ends,
    out_length, out_start_tangent, out_end_tangent, out_status,
):  # fmt: skip
    """Shortest paths along the edges (A*), an upper bound, for the pairs rows[begin..end_row].

    A search that settles more than `most` vertices is given up: its pair stays as it is.
    """
    n = len(points)
    length, parent = np.empty(n), np.empty(n, np.int64)
    # Search in which a vertex was reached, or settled; saves clearing n entries for each search.
    reached, settled = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    heap, no_twins = (np.empty(1024), np.empty(1024, np.int64)), corners[:0]
    for r in range(begin, end_row):
        row = rows[r]
        start, end = starts[row], ends[row]
        heap = _search(
            points, corners, no_twins, fan_offsets, fan, start, end, r, most,
            length, parent, reached, settled, heap,
        )  # fmt: skip
        if settled[end] != r:
            continue
        out_length[row] = length[end]
        out_status[row] = EDGES
        v = end
        direction(points[parent[v]], points[v], out_end_tangent[row])
        while parent[v] != start:
            v = parent[v]
        direction(points[start], points[v], out_start_tangent[row])


@kernel
def short_path(points, corners, twins, fan_offsets, fan, start, end):
    """Shortest path along edges and straight over single edges, as items (see `shorten`).

    These are twice as many directions as the edges have: on a mesh of equilateral triangles it is
    at most 1 / cos(15 degrees), 4 %, too long, not 15 %. Both ends lie in one component.
    """
    n = len(points)
    length, parent = np.empty(n), np.empty(n, np.int64)
    reached, settled = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    heap = np.empty(1024), np.empty(1024, np.int64)
    _search(
        points, corners, twins, fan_offsets, fan, start, end, 0, n,
        length, parent, reached, settled, heap,
    )  # fmt: skip
    path = np.empty(2 * n, np.int64)
    k = len(path)
    v = end
    while v != start:
        k -= 1
        path[k] = -1 - v
        if parent[v] < 0:  # half-edge -2 - parent, opposite to the vertex before
            h = -2 - parent[v]
            k -= 1
            path[k] = h
            v = corners[h + 2 if h % 3 == 0 else h - 1]
        else:
            v = parent[v]
    k -= 1
    path[k] = -1 - start
    return path[k:]
