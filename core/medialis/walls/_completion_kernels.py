"""A field that is as even as the surface allows, between the samples where it is known.

It is harmonic: each free vertex has the mean of its neighbours, weighed by cotangents, which stand
for the surface and not for its triangles. Coarser systems of clusters of vertices carry it over
any number of edges; a few steps on each level make it even.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import group_keys, pop, push
from medialis.base.jit import kernel

LEAST_WEIGHT = 1e-3
"""Of a link, where 0.5 is an edge of right triangles: opposite obtuse angles have none, or less."""

LARGEST_WEIGHT = 1e3
"""Of a link: across a needle a field is the same."""


LAST_SWEEPS = 4
"""Down and up the clusters of the last level."""

LARGER = 1.5
"""What clusters say is taken so many times: below 2, where it would shake."""


class System(NamedTuple):
    """Free vertices, or clusters of them, and what pulls at each.

    Attributes
    ----------
    first : (k + 1,) int64
    links : (l,) int32
        The other rows that row i is linked with: ``links[first[i]:first[i + 1]]``.
    weights : (l,) float64
    degree : (k,) float64
        The sum of all weights of a row, those of its links with known vertices too.
    pull : (k,) float64
        The sum of the values of these known ones, times weights.
    """

    first: NDArray[np.int64]
    links: NDArray[np.int32]
    weights: NDArray[np.float64]
    degree: NDArray[np.float64]
    pull: NDArray[np.float64]


@kernel
def weigh_links(points, faces, wanted, offsets, neighbours, out_weights):
    """Enter half the cotangents of the angles across each listed link of a wanted vertex."""
    for f in range(len(faces)):
        if not (wanted[faces[f, 0]] or wanted[faces[f, 1]] or wanted[faces[f, 2]]):
            continue
        for j in range(3):
            c, a, b = faces[f, j], faces[f, (j + 1) % 3], faces[f, (j + 2) % 3]
            if not (wanted[a] or wanted[b]):
                continue
            ux, uy = points[a, 0] - points[c, 0], points[a, 1] - points[c, 1]
            uz, vx = points[a, 2] - points[c, 2], points[b, 0] - points[c, 0]
            vy, vz = points[b, 1] - points[c, 1], points[b, 2] - points[c, 2]
            x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            twice = math.sqrt(x * x + y * y + z * z)
            if twice == 0.0:
                continue
            half = 0.5 * (ux * vx + uy * vy + uz * vz) / twice
            if wanted[a]:
                _add_weight(a, b, half, offsets, neighbours, out_weights)
            if wanted[b]:
                _add_weight(b, a, half, offsets, neighbours, out_weights)
    for at in range(len(out_weights)):
        out_weights[at] = min(max(out_weights[at], LEAST_WEIGHT), LARGEST_WEIGHT)


@kernel
def _add_weight(v, w, weight, offsets, neighbours, out_weights):
    for at in range(offsets[v], offsets[v + 1]):
        if neighbours[at] == w:
            out_weights[at] += weight
            return


@kernel
def mark_near(starts, room, points, faces, fans, free, out_left):
    """How much of its room is left at each free vertex near the starts; -1 elsewhere.

    Room is a length along edges from a start. `fans` has the corners 3 f + j of vertex v at
    ``fans[1][fans[0][v]:fans[0][v + 1]]``. A vertex enters the heap once at most a corner twice.
    """
    offsets, corners = fans
    size, most = 0, len(starts)
    for v in range(len(free)):
        if free[v]:
            most += 2 * (offsets[v + 1] - offsets[v])
    keys, names = np.empty(most), np.empty(most, np.int32)
    for i in range(len(starts)):
        if room[i] > out_left[starts[i]]:
            out_left[starts[i]] = room[i]
            size = push(keys, names, size, -room[i], starts[i])
    while size > 0:
        size = pop(keys, names, size)
        v = names[size]
        if -keys[size] < out_left[v]:
            continue
        for at in range(offsets[v], offsets[v + 1]):
            for j in range(3):
                w = faces[corners[at] // 3, j]
                if w == v or not free[w]:
                    continue
                x, y = points[v, 0] - points[w, 0], points[v, 1] - points[w, 1]
                z = points[v, 2] - points[w, 2]
                left = out_left[v] - math.sqrt(x * x + y * y + z * z)
                if left > out_left[w] and left > 0.0:
                    out_left[w] = left
                    size = push(keys, names, size, -left, w)


@kernel
def enter_rows(rows, offsets, neighbours, weights, values, out):
    """Fill the system of the vertices at `rows`; all others are known. Return its links."""
    row_of = np.full(len(values), -1, np.int32)
    for row in range(len(rows)):
        row_of[rows[row]] = row
    filled = 0
    for row in range(len(rows)):
        out.first[row], out.degree[row], out.pull[row] = filled, 0.0, 0.0
        for at in range(offsets[rows[row]], offsets[rows[row] + 1]):
            weight, other = weights[at], row_of[neighbours[at]]
            out.degree[row] += weight
            if other < 0:
                out.pull[row] += weight * values[neighbours[at]]
                continue
            out.links[filled], out.weights[filled] = other, weight
            filled += 1
    out.first[len(rows)] = filled
    return filled


@kernel
def make_clusters(system, out_cluster):
    """Name the cluster of each row: one that has no neighbour in a cluster, with its neighbours.

    What is left goes where its heaviest link leads. Returns how many there are.
    """
    count = 0
    for row in range(len(system.degree)):
        out_cluster[row] = -1
    for row in range(len(system.degree)):
        alone = out_cluster[row] < 0
        for at in range(system.first[row], system.first[row + 1]):
            alone = alone and out_cluster[system.links[at]] < 0
        if alone:
            out_cluster[row] = count
            for at in range(system.first[row], system.first[row + 1]):
                out_cluster[system.links[at]] = count
            count += 1
    for row in range(len(system.degree)):
        if out_cluster[row] >= 0:
            continue
        heaviest = 0.0  # a row that is left has a neighbour in a cluster
        for at in range(system.first[row], system.first[row + 1]):
            other = out_cluster[system.links[at]]
            if other >= 0 and system.weights[at] > heaviest:
                heaviest, out_cluster[row] = system.weights[at], other
    return count


@kernel
def enter_clusters(system, cluster, out):
    """Fill the system of clusters. Return its links."""
    count = len(out.degree)
    start, members = np.zeros(count + 2, np.int64), np.empty(len(cluster), np.int32)
    group_keys(cluster, start, members)
    slot, filled = np.full(count, -1, np.int64), 0
    for c in range(count):
        out.first[c], out.degree[c], out.pull[c] = filled, 0.0, 0.0
        for i in range(start[c], start[c + 1]):
            row = members[i]
            out.degree[c] += system.degree[row]
            out.pull[c] += system.pull[row]
            for at in range(system.first[row], system.first[row + 1]):
                other, weight = cluster[system.links[at]], system.weights[at]
                if other == c:
                    out.degree[c] -= weight
                elif slot[other] >= out.first[c]:
                    out.weights[slot[other]] += weight
                else:
                    slot[other] = filled
                    out.links[filled], out.weights[filled] = other, weight
                    filled += 1
    out.first[count] = filled
    return filled


class Levels(NamedTuple):
    """Systems one after the other: that of the vertices, of their clusters, of clusters of these.

    Attributes
    ----------
    begin : (m + 1,) int64
        The rows of level l are begin[l] to begin[l + 1].
    cluster : (r,) int32
        The row on the next level of each row; those of the last level have none.
    system : System
        Of all r rows; links are rows as well.
    """

    begin: NDArray[np.int64]
    cluster: NDArray[np.int32]
    system: System


@kernel
def make_harmonic(levels, level, most_steps, accuracy, values):
    """Change the values of a level until each is the mean of those it is linked with.

    `values` are those of all levels. Conjugate gradients, preconditioned by a cycle through the
    levels from this one on, so that the number of steps rises little with that of rows. The sums
    run in the order of the rows.
    """
    system, low, high = levels.system, levels.begin[level], levels.begin[level + 1]
    rest, better = np.empty(len(values)), np.empty(len(values))
    residual, direction, change = np.empty(high), np.zeros(high), np.empty(high)
    for row in range(low, high):
        total = system.pull[row] - system.degree[row] * values[row]  # 0 where it is harmonic
        for at in range(system.first[row], system.first[row + 1]):
            total += system.weights[at] * values[system.links[at]]
        residual[row] = total
    before, enough = 0.0, 0.0
    for step in range(most_steps + 1):
        rest[low:high] = residual[low:high]
        cycle(levels, level, rest, better)
        size = 0.0
        for row in range(low, high):
            size += residual[row] * better[row]
        if step == 0:
            enough = accuracy * accuracy * size
        if size <= enough or step == most_steps:
            return
        bend, share = 0.0, size / before if step > 0 else 0.0
        for row in range(low, high):
            direction[row] = better[row] + share * direction[row]
        for row in range(low, high):
            total = -system.degree[row] * direction[row]
            for at in range(system.first[row], system.first[row + 1]):
                total += system.weights[at] * direction[system.links[at]]
            change[row] = total
            bend -= direction[row] * total
        length, before = size / bend, size
        for row in range(low, high):
            values[row] += length * direction[row]
            residual[row] += length * change[row]


@kernel
def cycle(levels, begins, rest, better):
    """Solve roughly for `rest` from level to level down and up again; `better` is the solution.

    Sweeps down the rows first and up them last: as symmetric as conjugate gradients ask. Clusters
    are stiffer than what they stand for, so that what they say is taken a little larger.
    """
    begin, system = levels.begin, levels.system
    last = len(begin) - 2
    better[begin[begins] :] = 0.0
    for level in range(begins, last):
        _sweep(system, begin[level], begin[level + 1], 1, rest, better)
        for row in range(begin[level + 1], begin[level + 2]):
            rest[row] = 0.0
        for row in range(begin[level], begin[level + 1]):
            total = rest[row] - system.degree[row] * better[row]
            for at in range(system.first[row], system.first[row + 1]):
                total += system.weights[at] * better[system.links[at]]
            rest[levels.cluster[row]] += total
    for _ in range(LAST_SWEEPS):
        _sweep(system, begin[last], begin[last + 1], 1, rest, better)
        _sweep(system, begin[last], begin[last + 1], -1, rest, better)
    for level in range(last - 1, begins - 1, -1):
        for row in range(begin[level], begin[level + 1]):
            better[row] += LARGER * better[levels.cluster[row]]
        _sweep(system, begin[level], begin[level + 1], -1, rest, better)


@kernel
def _sweep(system, low, high, way, rest, better):
    """Solve each row for itself, one after the other (Gauss and Seidel)."""
    for i in range(high - low):
        row = low + i if way > 0 else high - 1 - i
        total = rest[row]
        for at in range(system.first[row], system.first[row + 1]):
            total += system.weights[at] * better[system.links[at]]
        better[row] = total / system.degree[row]
