"""Kernels of mean shift (thesis 5.3.2) and of even sites on a surface (mean_shift.py, sites.py).

Mean shift: paths of seeds over a cloud, and the votes along them. Points lie in the cells of a
grid, sorted by cell; what is within reach of a place lies in the cells up to `reach / width` away.
Sums run in that order.

Sites: where lines of a lattice cross faces, places that are apart, caps round them, and what two
caps have in common; then the cheapest paths between sites and clusters of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel

STILL = 1e-3
"""Search radii: a seed that moves less in a step has arrived. The thesis stops below 1e-4, of a
size that it does not state; with a search radius of 5 % of the diagonal, this is 5e-5 of it."""

ROWS_NEAR = 25
"""Maximum number of cell rows within a search radius; cells are at least half a radius wide."""

EXPONENTIAL = tuple(1.0 / math.factorial(k) for k in range(12))
"""Coefficients of the power series, accurate to rounding for arguments from -0.25 to 0.25."""

VERTICES_A_SITE = 256
"""Room for the vertices of a cap, to begin with."""

LISTS = 128
"""Of vertices by how far they are, in a search: caps of dense meshes have 30 edges to a radius."""


class Grid(NamedTuple):
    """Points sorted by the cell of a grid that they lie in; lengths are in search radii.

    Attributes
    ----------
    points : (n, 3) float64
    starts : (cells + 1,) int64
        The first point of each cell; cells along the last axis follow each other.
    low : (3,) float64
        The lowest corner of the grid.
    width : float
        Of a cell.
    shape : (3,) int64
        Cells along each axis.
    sigma : float
        Width of the Gaussian by which points weigh (Eq. 5.2 without its constant), 0: all the same.
    """

    points: NDArray[np.float64]
    starts: NDArray[np.int64]
    low: NDArray[np.float64]
    width: float
    shape: NDArray[np.int64]
    sigma: float


class Graph(NamedTuple):
    """Links of n vertices and their lengths; those of v are offsets[v] to offsets[v + 1]."""

    offsets: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    lengths: NDArray[np.float64]


class Waiting(NamedTuple):
    """Entries of vertices that a search has reached, in lists by how far they are.

    Attributes
    ----------
    heads : (lists,) int64
        The first entry of each list, -1 for none.
    far : (entries,) float64
    vertices : (entries,) int32
        -1 when its turn is over.
    after : (entries,) int64
        The entry behind each in its list, -1 for none.
    """

    heads: NDArray[np.int64]
    far: NDArray[np.float64]
    vertices: NDArray[np.int32]
    after: NDArray[np.int64]


class Caps(NamedTuple):
    """Shares of sites in samples; those of sample i are offsets[i] to offsets[i + 1]."""

    offsets: NDArray[np.int32]
    sites: NDArray[np.int32]
    shares: NDArray[np.float64]


@kernel
def _cell(x, low, width, size):
    """Cell along one axis; far outside the grid it is held where no cell of it is near."""
    return int(min(max(math.floor((x - low) / width), -1e6), size + 1e6))


@kernel
def _runs_near(grid, place, runs):
    """List the runs of points in the cells within a search radius; return the number of runs.

    A run is the range of points in adjacent cells along the last axis; `runs` is (ROWS_NEAR, 2).
    """
    low, width, shape = grid.low, grid.width, grid.shape
    span, count = 2 if width < 1.0 else 1, 0
    a, b = _cell(place[0], low[0], width, shape[0]), _cell(place[1], low[1], width, shape[1])
    c = _cell(place[2], low[2], width, shape[2])
    first, last = max(c - span, 0), min(c + span, shape[2] - 1)
    if first > last:
        return 0
    for i in range(max(a - span, 0), min(a + span + 1, shape[0])):
        for j in range(max(b - span, 0), min(b + span + 1, shape[1])):
            row = (i * shape[1] + j) * shape[2]
            runs[count, 0] = grid.starts[row + first]
            runs[count, 1] = grid.starts[row + last + 1]
            count += 1
    return count


@kernel
def _exponential(x):
    """Return exp(x) for -2 <= x <= 0, with the same bits on every processor and GPU.

    Evaluates the series of exp(x / 8) by Estrin's scheme, and squares the result three times.
    """
    x = 0.125 * x
    c, x2 = EXPONENTIAL, x * x
    x4 = x2 * x2
    low = (c[0] + c[1] * x) + (c[2] + c[3] * x) * x2
    middle = (c[4] + c[5] * x) + (c[6] + c[7] * x) * x2
    high = (c[8] + c[9] * x) + (c[10] + c[11] * x) * x2
    power = low + middle * x4 + high * (x4 * x4)
    power *= power
    power *= power
    return power * power


@kernel
def _weight(square, sigma):
    """Weight of a point by the square of its distance."""
    return _exponential(-0.5 * square / (sigma * sigma)) if sigma > 0.0 else 1.0


@kernel
def _shift(grid, place, runs, out):
    """Weighted mean of the points within reach (Eq. 5.1); return the sum of the weights."""
    points, total, x, y, z = grid.points, 0.0, 0.0, 0.0, 0.0
    for run in range(_runs_near(grid, place, runs)):
        for p in range(runs[run, 0], runs[run, 1]):
            dx = points[p, 0] - place[0]
            dy = points[p, 1] - place[1]
            dz = points[p, 2] - place[2]
            square = dx * dx + dy * dy + dz * dz
            if square > 1.0:
                continue
            weight = _weight(square, grid.sigma)
            total += weight
            x += weight * dx
            y += weight * dy
            z += weight * dz
    if total > 0.0:
        x, y, z = x / total, y / total, z / total
    out[0], out[1], out[2] = place[0] + x, place[1] + y, place[2] + z
    return total


@kernel
def shift_seed(seed, grid, seeds, out_paths, out_counts, place, runs):
    """Shift a seed until a step is at most `STILL`.

    `out_paths` (seeds, steps, 3) gets the position after each step, `out_counts` the number of
    steps.
    """
    for axis in range(3):
        place[axis] = seeds[seed, axis]
    count, step = 0, math.inf
    while count < out_paths.shape[1] and step > STILL * STILL:
        moved = out_paths[seed, count]
        _shift(grid, place, runs, moved)
        count += 1
        step = 0.0
        for axis in range(3):
            way = moved[axis] - place[axis]
            step += way * way
            place[axis] = moved[axis]
    out_counts[seed] = count


@kernel
def follow_seeds(grid, seeds, out_paths, out_counts):
    """Shift all seeds; see `shift_seed`."""
    place, runs = np.empty(3), np.empty((ROWS_NEAR, 2), np.int64)
    for seed in range(len(seeds)):
        shift_seed(seed, grid, seeds, out_paths, out_counts, place, runs)


@kernel
def pack_path(seed, paths, counts, offsets, out_steps):
    """Copy the last steps of a path to the rows offsets[seed] to offsets[seed + 1]."""
    begin, end = offsets[seed], offsets[seed + 1]
    for row in range(begin, end):
        for axis in range(3):
            out_steps[row, axis] = paths[seed, counts[seed] - (end - row), axis]


@kernel
def pack_paths(paths, counts, offsets, out_steps):
    """Copy the last steps of all paths; see `pack_path`."""
    for seed in range(len(counts)):
        pack_path(seed, paths, counts, offsets, out_steps)


@kernel
def weigh_place(at, grid, places, out, moved, runs):
    """Compute the density at a position: the sum of the weights of the points around it."""
    out[at] = _shift(grid, places[at], runs, moved)


@kernel
def weigh_places(grid, places, begin, end, out):
    """Compute the densities at the positions begin..end; see `weigh_place`."""
    moved, runs = np.empty(3), np.empty((ROWS_NEAR, 2), np.int64)
    for at in range(begin, end):
        weigh_place(at, grid, places, out, moved, runs)


@kernel
def vote(at, grid, owner, points, votes, touched, out, share, runs):
    """Find the cluster with the largest sum of weights K(|y - m(x)|) of path steps at a point.

    The grid contains the steps; `owner` is the cluster of each step. `out` is -1 if no step is
    within the search radius; `share` is the winner's fraction of the votes. Ties go to the lowest
    cluster. `votes` and `touched` (rows, clusters) are scratch memory for `rows` points at a time;
    `votes` must be zero-initialised, and is zero again afterwards.
    """
    line, count = at % len(votes), 0
    for run in range(_runs_near(grid, points[at], runs)):
        for p in range(runs[run, 0], runs[run, 1]):
            square = 0.0
            for axis in range(3):
                away = grid.points[p, axis] - points[at, axis]
                square += away * away
            if square > 1.0:
                continue
            name = owner[p]
            if votes[line, name] == 0.0:
                touched[line, count] = name
                count += 1
            votes[line, name] += _weight(square, grid.sigma)
    best, most, total = np.int64(-1), 0.0, 0.0
    for k in range(count):
        name = touched[line, k]
        value = votes[line, name]
        total += value
        votes[line, name] = 0.0
        if value > most or (value == most and name < best):
            best, most = name, value
    out[at] = best
    share[at] = most / total if best >= 0 else 0.0


@kernel
def count_votes(grid, owner, clusters, points, begin, end, out, share):
    """Find the clusters of the points begin..end; see `vote`."""
    votes, touched = np.zeros((1, clusters)), np.empty((1, clusters), np.int64)
    runs = np.empty((ROWS_NEAR, 2), np.int64)
    for at in range(begin, end):
        vote(at, grid, owner, points, votes, touched, out, share, runs)


@kernel
def mark_crossed(first, last, cells, faces, out_crossed):
    """Mark the axes along which a line of the lattice may cross each of the faces first..last.

    `cells` numbers the gap between two planes of lines that each vertex lies in, along each axis.
    """
    for f in range(first, last):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        x = cells[a, 0] != cells[b, 0] or cells[a, 0] != cells[c, 0]
        y = cells[a, 1] != cells[b, 1] or cells[a, 1] != cells[c, 1]
        z = cells[a, 2] != cells[b, 2] or cells[a, 2] != cells[c, 2]
        out_crossed[f, 0], out_crossed[f, 1], out_crossed[f, 2] = y and z, z and x, x and y


@kernel
def list_crossings(points, faces, axis, step):
    """Where lines of a square lattice along an axis cross faces, and how often each face."""
    place, counts, row = np.empty(3), np.empty(len(faces), np.int64), 0
    for f in range(len(faces)):
        counts[f] = _cross(points, faces[f], axis, step, place, np.empty((0, 3)), 0)
    places = np.empty((counts.sum(), 3))
    for f in range(len(faces)):
        row += _cross(points, faces[f], axis, step, place, places, row)
    return places, counts


@kernel
def _cross(points, face, axis, step, place, out_places, row):
    """Count the lines that cross one face; list the places where there is room for them.

    A side belongs to the face on one side of it only, so no place is there twice.
    """
    u, v, count = (axis + 1) % 3, (axis + 2) % 3, 0
    a, b, c = points[face[0]], points[face[1]], points[face[2]]
    twice = (b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u])
    if twice == 0.0:
        return 0
    i = math.ceil(min(a[u], b[u], c[u]) / step - 0.5)
    while (i + 0.5) * step < max(a[u], b[u], c[u]):
        x = (i + 0.5) * step
        low, high = math.inf, -math.inf
        for side in range(3):
            p, q = points[face[side]], points[face[(side + 1) % 3]]
            if (p[u] <= x) != (q[u] <= x):
                y = p[v] + (x - p[u]) / (q[u] - p[u]) * (q[v] - p[v])
                low, high = min(low, y), max(high, y)
        if low < high:
            j = math.ceil(low / step - 0.5)
            while (j + 0.5) * step < high:
                if len(out_places) > 0:
                    y = (j + 0.5) * step - a[v]
                    s = ((x - a[u]) * (c[v] - a[v]) - y * (c[u] - a[u])) / twice
                    t = ((b[u] - a[u]) * y - (b[v] - a[v]) * (x - a[u])) / twice
                    for k in range(3):
                        place[k] = a[k] + s * (b[k] - a[k]) + t * (c[k] - a[k])
                    out_places[row + count] = place
                count += 1
                j += 1
        i += 1
    return count


@kernel
def choose_apart(places, distance, out_chosen):
    """Choose each place that is at least a distance from all chosen before; return their number."""
    n, size = places.shape
    count, least = 0, distance * distance
    for i in range(n):
        free = True
        for k in range(count):
            total = 0.0
            for c in range(size):
                away = places[i, c] - places[out_chosen[k], c]
                total += away * away
            if total < least:
                free = False
                break
        if free:
            out_chosen[count] = i
            count += 1
    return count


@kernel
def measure_links(first, last, points, graph):
    """Fill in the lengths of the links of the vertices first..last."""
    for v in range(first, last):
        for at in range(graph.offsets[v], graph.offsets[v + 1]):
            w = graph.neighbours[at]
            x = points[v, 0] - points[w, 0]
            y = points[v, 1] - points[w, 1]
            z = points[v, 2] - points[w, 2]
            graph.lengths[at] = math.sqrt(x * x + y * y + z * z)


@kernel
def _room_for(graph):
    """Return empty lists for `_search`: each vertex may stand in them twice, and those beside one.

    Most of it is never written to, and takes no memory.
    """
    most = 0
    for v in range(len(graph.offsets) - 1):
        most = max(most, graph.offsets[v + 1] - graph.offsets[v])
    room = 2 * len(graph.offsets) + most
    heads = np.full(LISTS, -1)
    return Waiting(heads, np.empty(room), np.empty(room, np.int32), np.empty(room, np.int64))


@kernel
def _enter(waiting, entry, far, vertex, radius):
    """Enter a vertex into the list of those as far."""
    heads, fars, vertices, after = waiting
    number = min(int(far / radius * LISTS), LISTS - 1)
    fars[entry], vertices[entry] = far, vertex
    after[entry], heads[number] = heads[number], entry


@kernel
def _without_old(waiting, size, distance, radius):
    """Enter anew all whose turn is to come, each once; returns how many entries there are."""
    waiting.heads[:] = -1
    count = 0
    for entry in range(size):
        far, v = waiting.far[entry], waiting.vertices[entry]
        if v >= 0 and far == distance[v]:
            _enter(waiting, count, far, v, radius)
            count += 1
    return count


@kernel
def _search(graph, radius, waiting, size, distance, out_reached):
    """Find how far the vertices are that lie within a radius of those that wait, along edges.

    Dijkstra's search with lists in the place of a heap: within one list vertices come in any order,
    and again when they turn out nearer. `distance` comes with infinity but for those that wait.
    Returns how many others are reached, and what they are; lists are empty then.
    """
    offsets, neighbours, lengths = graph
    heads, fars, vertices, after = waiting
    used = 0
    for number in range(LISTS):
        while heads[number] >= 0:
            entry = heads[number]
            heads[number] = -1
            while entry >= 0:
                here, v = fars[entry], vertices[entry]
                vertices[entry], entry = -1, after[entry]
                if here > distance[v]:
                    continue
                begin, end = offsets[v], offsets[v + 1]
                if size + end - begin > len(fars):
                    size, entry = _without_old(waiting, size, distance, radius), -1
                for at in range(begin, end):
                    w, length = neighbours[at], here + lengths[at]
                    if length < radius and length < distance[w]:
                        if distance[w] == np.inf:
                            out_reached[used] = w
                            used += 1
                        distance[w] = length
                        _enter(waiting, size, length, w, radius)
                        size += 1
    return used


@kernel
def near_sites(first, last, graph, starts, gaps, radius, out_count):
    """Return the vertices along edges within a radius of the sites first..last, and how far.

    Those of one site after those of another, `out_count` of each. A site lies `gaps` beside its
    vertex `starts`.
    """
    n, room, used = len(graph.offsets) - 1, VERTICES_A_SITE * (last - first), 0
    vertex, far = np.empty(room, np.int32), np.empty(room)
    distance, reached, waiting = np.full(n, np.inf), np.empty(n, np.int32), _room_for(graph)
    for s in range(first, last):
        reached[0], distance[starts[s]] = starts[s], gaps[s]
        _enter(waiting, 0, gaps[s], starts[s], radius)
        count = 1 + _search(graph, radius, waiting, 1, distance, reached[1:])
        while used + count > len(vertex):
            vertex = np.concatenate((vertex, np.empty_like(vertex)))
            far = np.concatenate((far, np.empty_like(far)))
        for k in range(count):
            v = reached[k]
            vertex[used + k], far[used + k], distance[v] = v, distance[v], np.inf
        used += count
        out_count[s] = count
    return vertex[:used].copy(), far[:used].copy()


@kernel
def far_from(starts, graph, radius, out_distance):
    """Find how far vertices are from the nearest start along edges, within a radius.

    `out_distance` comes with infinity, and keeps it beyond.
    """
    waiting, reached = _room_for(graph), np.empty(len(out_distance), np.int32)
    for k in range(len(starts)):
        out_distance[starts[k]] = 0.0
        _enter(waiting, k, 0.0, starts[k], radius)
    _search(graph, radius, waiting, len(starts), out_distance, reached)


@kernel
def add_in_common(rows, others, weights, own, other, out_common):
    """Add the weight of each pair of samples to the sites with shares in the one and the other."""
    for k in range(len(rows)):
        i, j = rows[k], others[k]
        for a in range(own.offsets[i], own.offsets[i + 1]):
            share = weights[k] * own.shares[a]
            for b in range(other.offsets[j], other.offsets[j + 1]):
                out_common[own.sites[a], other.sites[b]] += share * other.shares[b]


@kernel
def least_sums(costs, most):
    """Replace symmetric costs of steps by the least sums on the way between all pairs.

    Ways that cost more than `most` need not be found.
    """
    n = len(costs)
    row = np.empty_like(costs[0])
    for k in range(n):
        for j in range(n):
            row[j] = costs[k, j] if j < k else costs[j, k]
        for i in range(n):
            if row[i] >= most:
                continue
            for j in range(i):
                through, known = row[i] + row[j], costs[i, j]
                costs[i, j] = through if through < known else known
    for i in range(n):
        costs[i, i] = 0.0
        for j in range(i):
            costs[j, i] = costs[i, j]


@kernel
def average_linkage(shares, weights, out_pairs, out_shares):
    """Join the two clusters with the largest mean share, again and again; return how often.

    `shares` and `weights` are used up. Ties: the lowest indices. A joined cluster has the lower
    index of the two. Clusters whose mean share is 0 are not joined.
    """
    n = len(shares)
    alive = np.ones(n, np.bool_)
    best, partner = np.zeros(n), np.full(n, -1)
    for i in range(n):
        _find_partner(shares, alive, i, best, partner)
    for turn in range(n - 1):
        one, largest = -1, 0.0
        for i in range(n):
            if alive[i] and best[i] > largest:
                one, largest = i, best[i]
        if one < 0:
            return turn
        other = partner[one]
        if other < one:
            one, other = other, one
        out_pairs[turn, 0], out_pairs[turn, 1], out_shares[turn] = one, other, largest
        alive[other] = False
        total = weights[one] + weights[other]
        for k in range(n):
            if alive[k] and k != one:
                mean = (weights[one] * shares[one, k] + weights[other] * shares[other, k]) / total
                shares[one, k] = shares[k, one] = mean
        weights[one] = total
        for k in range(n):
            if not alive[k]:
                continue
            if k == one or partner[k] == one or partner[k] == other:
                _find_partner(shares, alive, k, best, partner)
            elif shares[k, one] > best[k]:
                best[k], partner[k] = shares[k, one], one
    return n - 1


@kernel
def _find_partner(shares, alive, i, best, partner):
    best[i], partner[i] = 0.0, -1
    for j in range(len(shares)):
        if alive[j] and j != i and shares[i, j] > best[i]:
            best[i], partner[i] = shares[i, j], j
