"""Kernels across a line: the outlines in which planes cut triangles, and the balls beside it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._box_tree_kernels import FAN, box_distance2
from medialis.base._kernels import find_root, join
from medialis.base.jit import kernel

BLOCK = 32
"""Faces that are passed over together."""

NEGLIGIBLE = 1e-6
"""Share of the constant that a power along a line must have: else the balls lie at one or two
places along it."""


class Mesh(NamedTuple):
    """What is cut.

    Attributes
    ----------
    points : (n, 3) float64
    faces : (m, 3) int32
    edge_of : (3m,) int32
        The edge of each half-edge.
    edges : int
        How many there are.
    spheres : (b, 4) float64
        Middle and radius of one round each block of `BLOCK` faces.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int32]
    edge_of: NDArray[np.int32]
    edges: int
    spheres: NDArray[np.float64]


@kernel
def _height(points, v, place, frame):
    total = 0.0
    for k in range(3):
        total += (points[v, k] - place[k]) * frame[2, k]
    return total


@kernel
def _cross(mesh, place, frame, low, high):
    """Place in the plane, by its frame, where the edge from one vertex to another meets it."""
    height = _height(mesh.points, low, place, frame)
    share = height / (height - _height(mesh.points, high, place, frame))
    x, y = 0.0, 0.0
    for k in range(3):
        start = mesh.points[low, k] - place[k]
        there = start + share * (mesh.points[high, k] - mesh.points[low, k])
        x += there * frame[0, k]
        y += there * frame[1, k]
    return x, y


@kernel
def _cut(mesh, place, frame, number, crossings, segments):
    """Cut triangles; return how many crossings and segments there are.

    Each cut triangle is entered where an edge leads down, and left where one leads up: `segments`
    (m, 2) are the crossings there, `crossings` (c, 2) their places, `number` (e,) the crossing of
    each edge, -1 before and after. Blocks of faces on one side of the plane are not looked at.
    """
    count = cut = 0
    for block in range(len(mesh.spheres)):
        if abs(_height(mesh.spheres, block, place, frame)) > mesh.spheres[block, 3]:
            continue
        for f in range(block * BLOCK, min((block + 1) * BLOCK, len(mesh.faces))):
            here0 = _height(mesh.points, mesh.faces[f, 0], place, frame) > 0.0
            here1 = _height(mesh.points, mesh.faces[f, 1], place, frame) > 0.0
            here2 = _height(mesh.points, mesh.faces[f, 2], place, frame) > 0.0
            if here0 == here1 and here1 == here2:
                continue
            above = here0
            for k in range(3):
                onward = here1 if k == 0 else (here2 if k == 1 else here0)
                if above != onward:
                    a, b = mesh.faces[f, k], mesh.faces[f, (k + 1) % 3]
                    edge = mesh.edge_of[3 * f + k]
                    if number[edge] < 0:
                        number[edge] = count
                        x, y = _cross(mesh, place, frame, min(a, b), max(a, b))
                        crossings[count, 0], crossings[count, 1] = x, y
                        crossings[count, 2] = edge
                        count += 1
                    segments[cut, 0 if above else 1] = number[edge]
                above = onward
            cut += 1
    for k in range(count):
        number[int(crossings[k, 2])] = -1
    return count, cut


@kernel
def _innermost(crossings, segments, parent, state, once):
    """Return the root of the closed outline round the origin that is nearest to it; -1: none.

    `state` (c, 3) receives, for the root of each outline, how far it turns, whether it is open
    (above 0), and how near it comes.
    """
    for c in range(len(crossings)):
        parent[c] = c
        state[c, 0], state[c, 1], state[c, 2] = 0.0, 0.0, math.inf
    for s in range(len(segments)):
        state[segments[s, 0], 1] += 1.0
        state[segments[s, 1], 1] += 1.0
        join(parent, segments[s, 0], segments[s, 1])
    for c in range(len(crossings)):
        odd = 1.0 if state[c, 1] != 2.0 else 0.0
        root = find_root(parent, c)  # the lowest of its outline: it comes first
        state[c, 1] = odd
        state[root, 1] = max(state[root, 1], odd)
    for s in range(len(segments)):
        a, b = segments[s, 0], segments[s, 1]
        ax, ay, bx, by = crossings[a, 0], crossings[a, 1], crossings[b, 0], crossings[b, 1]
        root = find_root(parent, a)
        state[root, 0] += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        state[root, 2] = min(state[root, 2], ax * ax + ay * ay)
    best, near = -1, math.inf
    for c in range(len(crossings)):
        goes_round = parent[c] == c and abs(state[c, 0]) / (2.0 * math.pi) > once
        if goes_round and state[c, 1] == 0.0 and state[c, 2] < near:
            best, near = c, state[c, 2]
    return best


@kernel
def measure_across(begin, end, mesh, places, frames, once, ways, out_measures):
    """Measure the outlines round places.

    Parameters
    ----------
    mesh : Mesh
    places : (k, 3) float64
    frames : (k, 3, 3) float64
        Two directions in the plane, and its normal.
    once : float
        An outline that winds more often than this round a place goes round it.
    ways : (d, 2) float64
        Directions in the plane in which widths are measured.
    out_measures : (k, 3) float64
        Area, least and largest width; as it was where no closed outline goes round.
    """
    number, crossings = np.full(mesh.edges, -1, np.int32), np.empty((mesh.edges, 3))
    segments = np.empty((len(mesh.faces), 2), np.int32)
    parent, state = np.empty(mesh.edges, np.int32), np.empty((mesh.edges, 3))
    for i in range(begin, end):
        place, frame = places[i], frames[i]
        count, cut = _cut(mesh, place, frame, number, crossings, segments)
        root = _innermost(crossings[:count], segments[:cut], parent, state, once)
        if root < 0:
            continue
        area, own = 0.0, 0
        for s in range(cut):
            a, b = segments[s, 0], segments[s, 1]
            if find_root(parent, a) == root:
                area += crossings[a, 0] * crossings[b, 1] - crossings[a, 1] * crossings[b, 0]
                segments[own, 0] = a
                own += 1
        least, most = math.inf, 0.0
        for w in range(len(ways)):
            low, high = math.inf, -math.inf
            for s in range(own):
                a = segments[s, 0]
                along = crossings[a, 0] * ways[w, 0] + crossings[a, 1] * ways[w, 1]
                low, high = min(low, along), max(high, along)
            least, most = min(least, high - low), max(most, high - low)
        out_measures[i, 0], out_measures[i, 1], out_measures[i, 2] = abs(area) / 2.0, least, most


class Line(NamedTuple):
    """Places along a line.

    Attributes
    ----------
    places, tangents : (k, 3) float64
        Places are relative to the center of the tree of balls.
    radii : (k,) float64
        The unit of lengths at each place.
    """

    places: NDArray[np.float64]
    tangents: NDArray[np.float64]
    radii: NDArray[np.float64]


class Balls(NamedTuple):
    """Balls that a line may lie among, in the order of the tree of their centers.

    Attributes
    ----------
    radii : (n,) float64
    touching : (n, 3) float64
        Unit vectors to the samples.
    areas : (n,) float64
        Of the samples.
    """

    radii: NDArray[np.float64]
    touching: NDArray[np.float64]
    areas: NDArray[np.float64]


@kernel
def _wide_balls(line, i, tree, balls, limits, stack, kept, table):
    """Write which balls count for place i, and of each how far along and aside; return how many."""
    unit, largest, count = line.radii[i], 0.0, 0
    px, py, pz = line.places[i]
    x, y, z = line.tangents[i]
    reach, n = limits[0] * unit, len(tree.points)
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        node = stack[top]
        for j in range(FAN):
            if not box_distance2(tree.bounds[node], j, px, py, pz) < reach * reach:
                continue
            base = tree.child[node]
            if base >= 0:
                stack[top] = base + j
                top += 1
                continue
            leaf = ~base + j
            for ball in range((n * leaf) >> tree.depth, (n * (leaf + 1)) >> tree.depth):
                off_x, off_y = tree.points[ball, 0] - px, tree.points[ball, 1] - py
                off_z = tree.points[ball, 2] - pz
                share = (off_x * x + off_y * y + off_z * z) / unit
                length = unit * share
                off_x, off_y, off_z = off_x - length * x, off_y - length * y, off_z - length * z
                away = math.sqrt(off_x * off_x + off_y * off_y + off_z * off_z) / unit
                if share * share + away * away < limits[0] * limits[0] and away < limits[1]:
                    kept[count], table[0, count], table[1, count] = ball, share, away
                    count += 1
                    if abs(share) < limits[2]:
                        largest = max(largest, balls.radii[ball])
    wide = 0
    for k in range(count):
        if balls.radii[kept[k]] >= limits[3] * largest:
            kept[wide], table[0, wide], table[1, wide] = kept[k], table[0, k], table[1, k]
            wide += 1
    return wide


@kernel
def _product(table, i, j, count):
    total = 0.0
    for k in range(count):
        total += table[i, k] * table[j, k]
    return total


@kernel
def _take_out(table, i, j, share, count):
    for k in range(count):
        table[j, k] -= share * table[i, k]


@kernel
def _constant(table, powers, count, out):
    """Least squares of rows 3 to 8 of a table by its first three, whose order is that of powers.

    Rows that depend on those before count for nothing. `out` (6,) receives what row 0 has to do
    with each; they keep what is left of them.
    """
    upper, share = np.zeros((3, 3)), np.zeros((3, 6))
    for i in range(powers):
        for j in range(i):
            upper[j, i] = _product(table, j, i, count)
            _take_out(table, j, i, upper[j, i], count)
        upper[i, i] = math.sqrt(_product(table, i, i, count))
        if not upper[i, i] > NEGLIGIBLE * upper[0, 0]:
            upper[i, i] = math.inf
        for k in range(count):
            table[i, k] /= upper[i, i]
        for c in range(6):
            share[i, c] = _product(table, i, 3 + c, count)
            _take_out(table, i, 3 + c, share[i, c], count)
    for c in range(6):
        for i in range(powers - 1, -1, -1):
            for j in range(i + 1, powers):
                share[i, c] -= upper[i, j] * share[j, c]
            share[i, c] /= upper[i, i]
        out[c] = share[0, c]


@kernel
def fit_parabolas(begin, end, line, tree, balls, limits, fewest, out_moves):
    """Fit parabolas along tangents to the wide balls round places begin..end, by least squares.

    A ball that touches noise is too small, so it lies towards where it touches: as much on all
    sides, of which a bend has more outside. That much is found, and taken away.

    Parameters
    ----------
    line : Line
    tree : BoxTree
        Of centers, with bounds in float64.
    balls : Balls
    limits : (4,) float64
        How far off and aside a ball may lie; how far along it is compared with others, and the
        share of the radius of the largest of these that it has at least.
    fewest : int
        Balls that a parabola is fitted to; where there are fewer, a mean is taken.
    out_moves : (k, 3) float64
        How far the parabola passes from each place, across the tangent; as it was where there are
        no balls, or it is more than a radius.
    """
    n, stack, found = len(tree.points), np.empty(8 * 12 + 8, np.int64), np.empty(6)
    kept, table = np.empty(n, np.int64), np.empty((9, n))
    for i in range(begin, end):
        count = _wide_balls(line, i, tree, balls, limits, stack, kept, table)
        if count == 0:
            continue
        heaviest = 0.0
        for k in range(count):
            along, aside = table[0, k] / limits[0], table[1, k] / limits[1]
            weight = (1.0 - along * along) * (1.0 - aside * aside) * balls.areas[kept[k]]
            table[2, k] = weight
            heaviest = max(heaviest, weight)
        for k in range(count):
            along, root, ball = table[0, k], math.sqrt(table[2, k] / heaviest), kept[k]
            table[0, k], table[1, k], table[2, k] = root, root * along, root * along * along
            for c in range(3):
                table[3 + c, k] = root * balls.touching[ball, c]
                table[6 + c, k] = root * (tree.points[ball, c] - line.places[i, c])
        _constant(table, 3 if count >= fewest else 1, count, found)
        known = left = 0.0
        for c in range(3):
            known += _product(table, 3 + c, 3 + c, count)
            left += _product(table, 3 + c, 6 + c, count)
        share = left / known if known > 0.0 else 0.0
        along = size = 0.0
        for c in range(3):
            found[3 + c] -= share * found[c]
            along += found[3 + c] * line.tangents[i, c]
        for c in range(3):  # it moves across the line alone
            found[3 + c] -= along * line.tangents[i, c]
            size += found[3 + c] * found[3 + c]
        if math.sqrt(size) <= line.radii[i]:
            for c in range(3):
                out_moves[i, c] = found[3 + c]
