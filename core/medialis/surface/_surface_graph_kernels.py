"""Kernels on the graph of vertices: nearest seeds along the surface, harmonic values.

A graph is two arrays, as in `Ragged`: the neighbours of vertex v are
``neighbours[offsets[v]:offsets[v + 1]]``. Every link is listed from both ends.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.heap_kernels import pop, push
from medialis._kernels.jit import kernel


@kernel
def count_corners(faces, wanted, out_offsets):
    """Room for the neighbours of every vertex, by the faces with a wanted corner: 2 a corner."""
    for f in range(len(faces)):
        if wanted[faces[f, 0]] or wanted[faces[f, 1]] or wanted[faces[f, 2]]:
            for j in range(3):
                out_offsets[faces[f, j] + 1] += 2
    for v in range(len(out_offsets) - 1):
        out_offsets[v + 1] += out_offsets[v]


@kernel
def list_neighbours(faces, wanted, cursor, out_neighbours):
    """Enter the other two corners at each corner; `cursor` starts as the offsets and moves on."""
    for f in range(len(faces)):
        if wanted[faces[f, 0]] or wanted[faces[f, 1]] or wanted[faces[f, 2]]:
            for j in range(3):
                v = faces[f, j]
                for other in range(1, 3):
                    out_neighbours[cursor[v]] = faces[f, (j + other) % 3]
                    cursor[v] += 1


@kernel
def drop_repeats(offsets, neighbours):
    """List every neighbour once, moving the lists together in place; return the new length.

    Rows have about 12 entries, so looking through the row is faster than sorting it.
    """
    filled, begin = 0, 0
    for v in range(len(offsets) - 1):
        end = offsets[v + 1]
        offsets[v] = filled
        for at in range(begin, end):
            w = neighbours[at]
            known = w == v
            for earlier in range(offsets[v], filled):
                if neighbours[earlier] == w:
                    known = True
                    break
            if not known:
                neighbours[filled] = w
                filled += 1
        begin = end
    offsets[-1] = filled
    return filled


@kernel
def _apart(points, v, w):
    """Distance of two points."""
    x, y, z = points[v, 0] - points[w, 0], points[v, 1] - points[w, 1], points[v, 2] - points[w, 2]
    return math.sqrt(x * x + y * y + z * z)


@kernel
def spread_from_seeds(points, offsets, neighbours, keys, names, out_distance, out_seed):
    """Dijkstra's search from all seeds at once: the nearest seed along edges, and its distance.

    On entry `out_seed` is the vertex itself and `out_distance` 0 at the seeds, -1 and inf
    elsewhere; what cannot be reached stays so. Equally near seeds: the lowest index wins. A vertex
    is entered in the heap once at most for each of its listed neighbours, so `keys` and `names`
    need len(neighbours) places.
    """
    size, turn, count = 0, 0, len(out_seed)
    while turn < count or size > 0:
        if turn < count:  # the seeds first, which need no heap
            v = turn
            turn += 1
            if out_distance[v] > 0.0:
                continue
        else:
            size = pop(keys, names, size)
            v = names[size]
            if keys[size] > out_distance[v]:
                continue  # a shorter way was found since
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            reach = out_distance[v] + _apart(points, v, w)
            if reach < out_distance[w]:
                out_distance[w], out_seed[w] = reach, out_seed[v]
                size = push(keys, names, size, reach, w)
            elif reach == out_distance[w] and out_seed[v] < out_seed[w]:
                out_seed[w] = out_seed[v]


@kernel
def spread_again(rows, wanted, points, offsets, neighbours, keys, names, out_distance, out_seed):
    """Find the nearest seeds of some rows from those of all others, which stay.

    On entry rows have the seed -1 and the distance inf; `wanted` tells which vertices they are. A
    row enters the heap once at first, and then once at most for each of its neighbours.
    """
    size = 0
    for i in range(len(rows)):
        v = rows[i]
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if wanted[w] or out_seed[w] < 0:
                continue
            reach = out_distance[w] + _apart(points, v, w)
            if reach < out_distance[v] or (reach == out_distance[v] and out_seed[w] < out_seed[v]):
                out_distance[v], out_seed[v] = reach, out_seed[w]
        if out_seed[v] >= 0:
            size = push(keys, names, size, out_distance[v], v)
    while size > 0:
        size = pop(keys, names, size)
        v = names[size]
        if keys[size] > out_distance[v]:
            continue
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if not wanted[w]:
                continue
            reach = out_distance[v] + _apart(points, v, w)
            if reach < out_distance[w]:
                out_distance[w], out_seed[w] = reach, out_seed[v]
                size = push(keys, names, size, reach, w)
            elif reach == out_distance[w] and out_seed[v] < out_seed[w]:
                out_seed[w] = out_seed[v]


@kernel
def _link_rows(rows, offsets, neighbours, most, out_first, out_links):
    """Neighbours of each row that are rows themselves, by their row; `most` is that of vertices."""
    row_of = np.full(most, -1, np.int32)
    for row in range(len(rows)):
        row_of[rows[row]] = row
    filled = 0
    for row in range(len(rows)):
        out_first[row] = filled
        for at in range(offsets[rows[row]], offsets[rows[row] + 1]):
            other = row_of[neighbours[at]]
            if other >= 0:
                out_links[filled] = other
                filled += 1
    out_first[len(rows)] = filled


@kernel
def make_harmonic(rows, offsets, neighbours, most_steps, accuracy, values):
    """Change the values at `rows` until each is the mean of its neighbours; all others stay.

    Conjugate gradients, preconditioned by the number of neighbours: a step carries a change one
    edge further, but unlike averaging (which needs the square of the steps to smooth as far) it
    needs few of them for a smooth field. The sums run in the order of the rows. Of the graph only
    what joins rows is gone through again and again.
    """
    count = len(rows)
    first, links = np.empty(count + 1, np.int64), np.empty(len(neighbours), np.int32)
    _link_rows(rows, offsets, neighbours, len(values), first, links)
    residual, degree, direction = np.empty(count), np.empty(count), np.empty(count)
    change, size = np.empty(count), 0.0
    for row in range(count):
        v = rows[row]
        total = 0.0  # of the differences to the neighbours: 0 where the field is harmonic
        for at in range(offsets[v], offsets[v + 1]):
            total += values[neighbours[at]] - values[v]
        residual[row], degree[row] = total, offsets[v + 1] - offsets[v]
        direction[row] = total / degree[row]
        size += total * direction[row]
    enough = accuracy * accuracy * size
    for _ in range(most_steps):
        if size <= enough:
            return
        bend = 0.0
        for row in range(count):
            total = -degree[row] * direction[row]
            for at in range(first[row], first[row + 1]):
                total += direction[links[at]]
            change[row] = total
            bend -= direction[row] * total
        step = size / bend
        before, size = size, 0.0
        for row in range(count):
            values[rows[row]] += step * direction[row]
            residual[row] += step * change[row]
            size += residual[row] * residual[row] / degree[row]
        for row in range(count):
            direction[row] = residual[row] / degree[row] + size / before * direction[row]
