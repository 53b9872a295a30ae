"""Kernels on the graph of vertices: nearest seeds along the surface, sublevel sets of a field.

A graph is two arrays, as in `Ragged`: the neighbours of vertex v are
``neighbours[offsets[v]:offsets[v + 1]]``. Every link is listed from both ends.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.heap_kernels import pop, push
from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import find_root


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
            x = points[v, 0] - points[w, 0]
            y = points[v, 1] - points[w, 1]
            z = points[v, 2] - points[w, 2]
            reach = out_distance[v] + math.sqrt(x * x + y * y + z * z)
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


@kernel
def third_lowest(values, offsets, neighbours, out):
    """Find the third lowest value of each vertex and its neighbours; the highest of fewer than 3.

    One or two samples that are far too low vanish; a line of low samples (a groove has itself and
    two neighbours in it) keeps its depth.
    """
    for v in range(len(values)):
        first, second, third = values[v], np.inf, np.inf
        for at in range(offsets[v], offsets[v + 1]):
            value = values[neighbours[at]]
            if value < first:
                first, second, third = value, first, second
            elif value < second:
                second, third = value, second
            elif value < third:
                third = value
        count = offsets[v + 1] - offsets[v] + 1
        out[v] = first if count == 1 else (second if count == 2 else third)


@kernel
def prominent_minima(order, values, offsets, neighbours, ratio, parent, out_minima):
    """Minima from which one climbs to `ratio` times their value before reaching a lower one.

    The vertices enter in rising order and join the pieces of the sublevel set that they touch. A
    piece is known by its lowest vertex, its root in `parent` (path halving keeps the ways short).
    Where two pieces meet at the height L, the one with the higher minimum m ends; it counts if
    L >= ratio m. On entry `parent` holds -1. Ties go to the vertex that comes first in `order`.
    """
    n = len(order)
    rank = np.empty(n, np.int32)
    for place in range(n):
        rank[order[place]] = place
    for place in range(n):
        v = order[place]
        parent[v] = v
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if parent[w] < 0:
                continue
            a, b = find_root(parent, v), find_root(parent, w)
            if a == b:
                continue
            low, high = (a, b) if rank[a] < rank[b] else (b, a)
            parent[high] = low
            # v itself has just entered: a piece of height zero, which never counts.
            out_minima[high] = high != v and values[v] >= ratio * values[high]
    for v in range(n):
        if parent[v] == v:
            out_minima[v] = True


@kernel
def flood_below(start, level, values, offsets, neighbours, label, out_label, out_vertices):
    """Label the piece of {values < level} that holds `start`; return how many vertices it has.

    They are listed in `out_vertices` (room for n), which is the queue of the search as well.
    """
    out_vertices[0] = start
    out_label[start] = label
    count, done = 1, 0
    while done < count:
        v = out_vertices[done]
        done += 1
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if out_label[w] < 0 and values[w] < level:
                out_label[w] = label
                out_vertices[count] = w
                count += 1
    return count
