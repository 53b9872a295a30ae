"""Kernels of low places: minima and sublevel sets of a field on a graph (see low_places.py).

The neighbours of vertex v are ``neighbours[first[v]:last[v]]``. Every link is listed from both
ends. A vertex is lower than another one by its value, then by the field, then by its number.
"""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import find_root


@kernel
def take_out(pairs, times, first, last, neighbours):
    """Take links out of a graph; `times` says how often each one is in it."""
    for i in range(len(pairs)):
        for j in range(2):
            v, w = pairs[i, j], pairs[i, 1 - j]
            for at in range(first[v], last[v]):
                if neighbours[at] != w:
                    continue
                times[at] -= 1
                if times[at] == 0:
                    last[v] -= 1
                    neighbours[at], times[at] = neighbours[last[v]], times[last[v]]
                break


@kernel
def third_lowest(values, first, last, neighbours, out):
    """Find the third lowest value of each vertex and its neighbours; the highest of fewer than 3.

    One or two samples that are far too low vanish; a line of low samples (a groove has itself and
    two neighbours in it) keeps its depth.
    """
    for v in range(len(values)):
        lowest, second, third = values[v], np.inf, np.inf
        for at in range(first[v], last[v]):
            value = values[neighbours[at]]
            if value < lowest:
                lowest, second, third = value, lowest, second
            elif value < second:
                second, third = value, second
            elif value < third:
                third = value
        count = last[v] - first[v] + 1
        out[v] = lowest if count == 1 else (second if count == 2 else third)


@kernel
def _lower(v, w, values, field):
    if values[v] != values[w]:
        return values[v] < values[w]
    if field[v] != field[w]:
        return field[v] < field[w]
    return v < w


@kernel
def find_basins(values, field, first, last, neighbours, out_basin):
    """Find the minimum that each vertex descends to, always to the lowest neighbour."""
    n = len(values)
    for v in range(n):
        down = v
        for at in range(first[v], last[v]):
            if _lower(neighbours[at], down, values, field):
                down = neighbours[at]
        out_basin[v] = down
    for v in range(n):
        root = v
        while out_basin[root] != root:
            root = out_basin[root]
        while out_basin[v] != root:
            out_basin[v], v = root, out_basin[v]


@kernel
def list_passes(basin, values, field, first, last, neighbours, out_passes):
    """List the links between basins, the higher end first; returns how many, at most all links."""
    count = 0
    for v in range(len(basin)):
        for at in range(first[v], last[v]):
            w = neighbours[at]
            if basin[v] != basin[w] and _lower(w, v, values, field):
                out_passes[count, 0], out_passes[count, 1] = v, w
                count += 1
    return count


@kernel
def prominent_minima(passes, basin, values, field, ratio, out_minima):
    """Minima from which one climbs to `ratio` times their value before reaching a lower one.

    Basins join at the passes, in rising order. `basin` becomes that of the joined ones: it is known
    by its lowest vertex. Where two meet at the height L, the one with the higher minimum m ends; it
    counts if L >= ratio m.
    """
    for i in range(len(passes)):
        a, b = find_root(basin, passes[i, 0]), find_root(basin, passes[i, 1])
        if a == b:
            continue
        low, high = (a, b) if _lower(a, b, values, field) else (b, a)
        basin[high] = low
        out_minima[high] = values[passes[i, 0]] >= ratio * values[high]
    for v in range(len(basin)):
        if basin[v] == v:
            out_minima[v] = True


@kernel
def flood_below(start, level, values, first, last, neighbours, label, out_label, out_vertices):
    """Label the piece of {values < level} that holds `start`; return how many vertices it has.

    They are listed in `out_vertices` (room for n), which is the queue of the search as well.
    """
    out_vertices[0] = start
    out_label[start] = label
    count, done = 1, 0
    while done < count:
        v = out_vertices[done]
        done += 1
        for at in range(first[v], last[v]):
            w = neighbours[at]
            if out_label[w] < 0 and values[w] < level:
                out_label[w] = label
                out_vertices[count] = w
                count += 1
    return count
