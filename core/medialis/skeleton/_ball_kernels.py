"""Kernels of balls that samples constrain, and of triangles between them (thesis 3.2, 3.4.1).

**Ball shrinking** (see medial_cloud.py) in one pass. The balls tangent at p with one normal are
nested, and the depth r - |q - c| of a sample q grows with the radius. So "the largest ball in which
no sample lies deeper than a" has the radius min r_a(q), where r_a(q) is the radius at which q lies
exactly a deep: with num = |q - p|^2 and den = 2 n.(p - q), |q - c|^2 = r^2 + num - r den = (r -
a)^2 gives

    r_a(q) = (num - a^2) / (den - 2 a),    den > 2 a, num > a^2.

One traversal that replaces the ball by a smaller one whenever a sample lies too deep finds the
minimum: what was outside a larger ball stays outside a smaller one, nothing is visited twice. For
a = 0 it is the maximal ball through p and q. For a > 0 samples that lie less than a below the
tangent plane, relief of the surface no higher than a, cannot shrink the ball, and where many
samples are nearly equidistant (tubes, spheres) the one farthest from p wins. The result is the
ball through p and the winner: it is smaller, so no sample lies deeper than a in it either.

Depth test without square root or division: deeper than a is num < r den - a (2 r - a); eight
samples are tested by one vector instruction. Nodes are skipped when their box or disc lies outside
the ball of radius r - a. The float32 bounds are good to `margin`, which is added to that radius, so
a skip is always right.

Certificate. After a traversal every sample is known to lie at least r0 - a from the center c0. By
the triangle inequality a ball (c, r) holds no sample deeper than a + |c - c0| + r - r0. Where the
warm start of a later sample gets this down to the tolerance, which is larger than a, no traversal
is needed: samples of a sphere cost O(1).

**Uniform subsampling** (thesis 3.2.1; see surface_skeleton.py). Points are visited in the given
order; a point is kept when no kept point lies within delta. Kept points live in a hash grid with
cells of edge at least delta, so only the 27 cells around a point can hold one that is near. A cell
chains its kept points; at most 8 points of a cell of edge delta can be delta apart, so a chain is
short. Open addressing in a table of at least twice the number of points: an empty slot is always
found.

**Triangles** (see skeleton_mesh.py for the argument). A *row* is a ball of the cloud. `test_faces`
decides for each surface triangle whether the triangle of its three centers is part of the skeleton.
A sheet is reached from both of its sides, so `join_sides` colours the rows: the same colour along a
side, the other colour across the sheet; it is a union-find with one bit of parity, and a
contradiction (a one-sided sheet, noise) is ignored, which leaves a seam. `lift_faces` replaces the
rows of the second colour by their partners across the sheet and keeps what still spans a triangle
and is not covered twice.

Only `test_faces` has enough work to run in chunks; the others take some ten milliseconds for 200k
samples and depend on the order of their items, so they run on one thread.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._box_tree_kernels import LEAF, is_certain, lowest_bit, test_children
from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import distance

SAME_SHEET = 0.7
"""Cosine: chords less than 45 degrees apart belong to one sheet. Where three sheets meet under
equal angles, as at a corner of a box, their chords are 60 degrees apart."""

CERTAIN = 0.9
"""Cosine: chords that agree this well are joined first, so that a contradiction falls where the
sheet is least certain."""

SEGMENT = 1e-12
"""Squared height of a triangle, in squared lengths of its side: to rounding it is a segment."""

OK, OPEN, NO_NORMAL = 0, 1, 2
"""What becomes of a ball: `BallStatus`."""

KNOWN = 16
"""Certificates kept: a leaf of a tube lies on about four rings, whose balls are the same."""

STACK = 8 * 12 + 8
"""Capacity of the traversal stack: at most 8 children on each of 11 levels, plus a margin."""

GROUP_SIZE = 32
"""Balls in a group on the GPU: the first ball of each group is computed in a launch of its own."""


class Columns(NamedTuple):
    """What shrinking finds of k balls; `second` is their second feature point, a sample.

    Attributes
    ----------
    centers, radii : (k, 3) and (k,) float64
        In units of the tree.
    second : (k,) int32
    status : (k,) int8
    angles : (k,) float64
    """

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    second: NDArray[np.int32]
    status: NDArray[np.int8]
    angles: NDArray[np.float64]


@kernel
def _scan_leaf(block, px, py, pz, nx, ny, nz, r, a, near2):
    """Smallest r_a(q) of a leaf's samples, if any lies deeper than a in the ball.

    Returns (radius, slot); slot is -1 when no sample does. `near2` >= a^2 is the squared distance
    below which a sample counts as p itself.
    """
    slack = a * (2.0 * r - a) if r > a else r * r
    inside = 0
    for j in range(LEAF):
        dx, dy, dz = px - block[0, j], py - block[1, j], pz - block[2, j]
        num = dx * dx + dy * dy + dz * dz
        den = 2.0 * (nx * dx + ny * dy + nz * dz)
        inside += num < r * den - slack
    slot = -1
    if inside:
        for j in range(LEAF):
            dx, dy, dz = px - block[0, j], py - block[1, j], pz - block[2, j]
            num = dx * dx + dy * dy + dz * dz
            den = 2.0 * (nx * dx + ny * dy + nz * dz)
            if num > near2 and num - a * a < r * (den - 2.0 * a):
                r = (num - a * a) / (den - 2.0 * a)
                slot = j
    return r, slot


@kernel
def _remember(feature, blocks, recent, names, spare):
    """Keep a second feature point where no other of its leaf is kept; return the next place.

    The warm start of a ball: samples that others nearby touch, side by side as in a leaf. On a
    relief, balls go back and forth between a few places: one of them alone leaves seven more
    steps, 16 of them one.
    """
    leaf, slot, known = feature // LEAF, feature % LEAF, 0
    for j in range(LEAF):
        known += names[j] // LEAF == leaf
    if known > 0:
        return spare
    for axis in range(3):
        recent[axis, spare] = blocks[leaf, axis, slot]
    names[spare] = feature
    return (spare + 1) % LEAF


class Memory(NamedTuple):
    """State that warm-starts the next ball, and scratch memory of the traversal.

    Attributes
    ----------
    stack, hits : (STACK,) int32
    recent, names : (3, LEAF) float64 and (LEAF,) int64
        Recent second feature points (`_remember`).
    known : (4, KNOWN) float64
        Certificates: the last centers x, y, z and a - r0.
    """

    stack: NDArray[np.int32]
    hits: NDArray[np.int32]
    recent: NDArray[np.float64]
    names: NDArray[np.int64]
    known: NDArray[np.float64]


@kernel
def shrink_some(begin, end, previous, sign, lengths, tree, normals, samples, out, memory):
    """Compute the balls begin..end in order; see `shrink_balls` for the arguments.

    `previous` is the leaf that contains the second feature point of a nearby ball, or -1. The loop
    is inside this function because one call per ball costs 9 % (array reference counting).
    """
    _, points, _, order, blocks, bounds, child, depth = tree
    _, tolerance, a, largest, near2, margin = lengths
    n = len(points)
    stack, hits, recent, names, known = memory
    spare, fresh, turn = 0, True, 0
    for k in range(4):
        for j in range(KNOWN):
            known[k, j] = math.inf
    for ball in range(begin, end):
        i = samples[ball] if len(samples) > 0 else ball
        source = ball if len(samples) > 0 else order[i]
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        nx, ny, nz = sign * normals[ball, 0], sign * normals[ball, 1], sign * normals[ball, 2]
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            out.status[source] = NO_NORMAL
            continue
        r, feature = largest, -1
        own = ((i + 1) << depth) // n  # a leaf close to the sample: its own or a neighbour
        own = min(own, (1 << depth) - 1)
        if previous >= 0:
            r, slot = _scan_leaf(blocks[previous], px, py, pz, nx, ny, nz, r, a, near2)
            if slot >= 0:
                feature = previous * LEAF + slot
        r, slot = _scan_leaf(blocks[own], px, py, pz, nx, ny, nz, r, a, near2)
        if slot >= 0:
            feature = own * LEAF + slot
        if fresh:
            for j in range(LEAF):
                names[j] = own * LEAF + j
                for axis in range(3):
                    recent[axis, j] = blocks[own, axis, j]
            fresh = False
        r, slot = _scan_leaf(recent, px, py, pz, nx, ny, nz, r, a, near2)
        if slot >= 0:
            leaf = names[slot] // LEAF
            feature = names[slot]
            r, slot = _scan_leaf(blocks[leaf], px, py, pz, nx, ny, nz, r, a, near2)
            if slot >= 0:
                feature = leaf * LEAF + slot
        cx, cy, cz = px - r * nx, py - r * ny, pz - r * nz
        # No sample lies too deep where |c - c0| + a - r0 <= tolerance - r.
        if not is_certain(known, cx, cy, cz, tolerance - r):
            stack[0] = 0
            reach = max(r - a + margin, 0.0)
            hits[0] = test_children(bounds[0], cx, cy, cz, reach)
            top = 1
            while top > 0:
                top -= 1
                base, bits = child[stack[top]], hits[top]
                while bits > 0:
                    j = lowest_bit(bits)
                    bits &= bits - 1
                    if base >= 0:
                        inside = test_children(bounds[base + j], cx, cy, cz, reach)
                        if inside > 0:
                            stack[top], hits[top] = base + j, inside
                            top += 1
                        continue
                    leaf = ~base + j
                    if leaf in (own, previous):
                        continue  # scanned with a larger ball
                    r, slot = _scan_leaf(blocks[leaf], px, py, pz, nx, ny, nz, r, a, near2)
                    if slot >= 0:
                        feature = leaf * LEAF + slot
                        cx, cy, cz = px - r * nx, py - r * ny, pz - r * nz
                        reach = max(r - a + margin, 0.0)
            known[0, turn], known[1, turn], known[2, turn] = cx, cy, cz
            known[3, turn] = a - r
            turn = (turn + 1) % KNOWN
        if feature < 0:
            out.centers[source, 0], out.centers[source, 1], out.centers[source, 2] = cx, cy, cz
            out.radii[source] = r
            out.status[source] = OPEN
            continue
        spare = _remember(feature, blocks, recent, names, spare)
        leaf, slot = feature // LEAF, feature % LEAF
        previous = leaf
        dx = px - blocks[leaf, 0, slot]
        dy = py - blocks[leaf, 1, slot]
        dz = pz - blocks[leaf, 2, slot]
        num = dx * dx + dy * dy + dz * dz
        r = num / (2.0 * (nx * dx + ny * dy + nz * dz))
        out.centers[source, 0] = px - r * nx
        out.centers[source, 1] = py - r * ny
        out.centers[source, 2] = pz - r * nz
        out.radii[source] = r
        out.angles[source] = 2.0 * math.asin(min(1.0, math.sqrt(num) / (2.0 * r)))
        first = (n * leaf) >> depth  # a padded slot stands for the last sample of its leaf
        out.second[source] = order[min(first + slot, ((n * (leaf + 1)) >> depth) - 1)]
        out.status[source] = OK


@kernel
def shrink_balls(begin, end, sign, lengths, tree, normals, samples, out):
    """Maximal balls of the samples begin..end (tree order); outputs are in the original order.

    Or of the balls begin..end where `samples` tells the sample of each: `normals` are those of the
    balls then, and so are the outputs.
    """
    memory = Memory(
        np.empty(STACK, np.int32), np.empty(STACK, np.int32), np.empty((3, LEAF)),
        np.empty(LEAF, np.int64), np.empty((4, KNOWN)),
    )  # fmt: skip
    shrink_some(begin, end, -1, sign, lengths, tree, normals, samples, out, memory)


@kernel
def shrink_apart(
    item, step, place, sign, lengths, tree, normals, samples, out, stack, hits, recent, names, known
):
    """Compute the ball `item * step` independently of the other balls, in one GPU thread.

    The first launch has step GROUP_SIZE. In the second launch (step 1) the other balls of a group
    start at the leaf that contains the second feature point of the first ball. `samples` holds the
    sample of each ball, `place` the index of each sample in tree order.
    """
    ball, leaf = item * step, -1
    if step == 1:
        leader = ball // GROUP_SIZE * GROUP_SIZE
        if leader == ball:
            return
        second = out.second[leader]
        if second >= 0:
            leaf = ((place[second] + 1) << tree.depth) // len(tree.points)
            leaf = min(leaf, (1 << tree.depth) - 1)
    memory = Memory(stack, hits, recent, names, known)
    shrink_some(ball, ball + 1, leaf, sign, lengths, tree, normals, samples, out, memory)


class Contacts(NamedTuple):
    """What k balls touch: columns of `Balls`, and arrays of their surface.

    Attributes
    ----------
    centers : (k, 3) float64
    features : (k, 2) int32
    on_faces : (k,) int32
        The face that each touches between its corners, -1 where it touches a sample.
    weights : (k, 3) float64
    points, normals : (n, 3) float64
    faces, face_normals : (m, 3) int32 and float64
    """

    centers: NDArray[np.float64]
    features: NDArray[np.int32]
    on_faces: NDArray[np.int32]
    weights: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    faces: NDArray[np.int32]
    face_normals: NDArray[np.float64]


@kernel
def find_outside(begin, end, contacts, wanted):
    """Leave of the wanted balls those that touch their second contact from its outside."""
    points, faces = contacts.points, contacts.faces
    for i in range(begin, end):
        if not wanted[i]:
            continue
        f, second, outward = contacts.on_faces[i], contacts.features[i, 1], 0.0
        for axis in range(3):
            if f < 0:
                place, along = points[second, axis], contacts.normals[second, axis]
            else:
                place, along = 0.0, contacts.face_normals[f, axis]
                for j in range(3):
                    place += contacts.weights[i, j] * points[faces[f, j], axis]
            outward += (place - contacts.centers[i, axis]) * along
        wanted[i] = outward < 0.0


@kernel
def nearest_of_all(points, rows, out_near):
    """Nearest points of some of them, each one itself among them, by looking at all."""
    count = out_near.shape[1]
    away = np.empty(count)
    for k in range(len(rows)):
        x, y, z = points[rows[k], 0], points[rows[k], 1], points[rows[k], 2]
        away[:] = np.inf
        for i in range(len(points)):
            dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
            d2 = dx * dx + dy * dy + dz * dz
            if d2 < away[count - 1]:
                place = count - 1
                while place > 0 and away[place - 1] > d2:
                    away[place], out_near[k, place] = away[place - 1], out_near[k, place - 1]
                    place -= 1
                away[place], out_near[k, place] = d2, i


class Grid(NamedTuple):
    """Points kept so far, in a hash table of cells: the first one of each and the next of each.

    Attributes
    ----------
    cell : float
        Edge of a cell.
    cells : (3,) int64
        Along x, y and z.
    keys, heads : (slots,) int64
        Number of the cell of each slot, -1: none; the point in it that was kept last.
    chain : (n,) int64
        The point kept before in the cell of each, -1: none.
    """

    cell: float
    cells: NDArray[np.int64]
    keys: NDArray[np.int64]
    heads: NDArray[np.int64]
    chain: NDArray[np.int64]


@kernel
def _slot(keys, key):
    mask = len(keys) - 1
    slot = ((key * 0x9E3779B97F4A7C1) >> 20) & mask
    while keys[slot] != key and keys[slot] != -1:
        slot = (slot + 1) & mask
    return slot


@kernel
def _has_neighbour(points, i, limit, cx, cy, cz, grid):
    """Tell whether a kept point of the 27 cells around (cx, cy, cz) is nearer than the limit."""
    for a in range(max(cx - 1, 0), cx + 2):
        for b in range(max(cy - 1, 0), cy + 2):
            for c in range(max(cz - 1, 0), cz + 2):
                slot = _slot(grid.keys, (a * grid.cells[1] + b) * grid.cells[2] + c)
                if grid.keys[slot] == -1:
                    continue
                j = grid.heads[slot]
                while j >= 0:
                    dx = points[i, 0] - points[j, 0]
                    dy = points[i, 1] - points[j, 1]
                    dz = points[i, 2] - points[j, 2]
                    if dx * dx + dy * dy + dz * dz < limit:
                        return True
                    j = grid.chain[j]
    return False


@kernel
def keep_apart(points, order, distance, grid, out_keep):
    """Set out_keep where a point is kept. Points are >= 0."""
    limit = distance * distance
    for i in order:
        cx = np.int64(math.floor(points[i, 0] / grid.cell))
        cy = np.int64(math.floor(points[i, 1] / grid.cell))
        cz = np.int64(math.floor(points[i, 2] / grid.cell))
        if _has_neighbour(points, i, limit, cx, cy, cz, grid):
            continue
        out_keep[i] = True
        key = (cx * grid.cells[1] + cy) * grid.cells[2] + cz
        slot = _slot(grid.keys, key)
        grid.keys[slot] = key
        grid.chain[i] = grid.heads[slot]
        grid.heads[slot] = i


class SheetBalls(NamedTuple):
    """The k balls of n samples.

    Attributes
    ----------
    points : (n, 3) float64
    source : (k,) int32
        Sample of each ball.
    centers, radii : (k, 3) and (k,) float64
    chords : (k, 3) float64
        Unit vectors from the second to the first feature point: the normal of the sheet.
    slopes : (k,) float64
        Cosines of half the spoke angles.
    """

    points: NDArray[np.float64]
    source: NDArray[np.int32]
    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    chords: NDArray[np.float64]
    slopes: NDArray[np.float64]


@kernel
def _agreement(chords, i, j):
    return chords[i, 0] * chords[j, 0] + chords[i, 1] * chords[j, 1] + chords[i, 2] * chords[j, 2]


@kernel
def in_balls(la, lb, lc, ra, rb, rc):
    """Tell whether three balls that meet in pairs cover the triangle of their centers.

    la is the side opposite a. Two balls cover the segment between their centers when they meet. If
    each side is covered and a hole remains inside, the point that has the same power to all three
    balls lies in it, so the power is positive there. With a at the origin and b on the x-axis it is
    x = (lc^2 + ra^2 - rb^2) / (2 lc), y = (lb^2 + ra^2 - rc^2 - 2 x cx) / (2 cy).
    """
    if la > rb + rc or lb > rc + ra or lc > ra + rb:
        return False
    if lc <= 0.0:
        return True
    cx = (lb * lb + lc * lc - la * la) / (2.0 * lc)
    cy2 = lb * lb - cx * cx
    if cy2 <= SEGMENT * lc * lc:
        return True
    cy = math.sqrt(cy2)
    x = (lc * lc + ra * ra - rb * rb) / (2.0 * lc)
    y = (lb * lb + ra * ra - rc * rc - 2.0 * x * cx) / (2.0 * cy)
    if x * x + y * y <= ra * ra:
        return True
    # A positive power outside the triangle says nothing: the sides are covered, so all of it is.
    v = y / cy
    u = (x - v * cx) / lc
    return u < 0.0 or v < 0.0 or u + v > 1.0


@kernel
def cover(corners, radii, out_whole):
    """Tell which triangles (t, 3, 3) the balls at their corners, of radii (t, 3), cover."""
    for f in range(len(corners)):
        at, size = corners[f], radii[f]
        sides = distance(at, 1, 2), distance(at, 2, 0), distance(at, 0, 1)
        out_whole[f] = in_balls(sides[0], sides[1], sides[2], size[0], size[1], size[2])


@kernel
def bridge_gaps(faces, points, source, row_near, out_row_near):
    """One round: a sample without a row takes the row of a neighbour, of the nearest source."""
    for f in range(len(faces)):
        for j in range(6):
            s, t = faces[f, j % 3], faces[f, (j + 1 + j // 3) % 3]
            row = row_near[t]
            if row_near[s] >= 0 or row < 0:
                continue
            old = out_row_near[s]
            if old >= 0:
                gain = distance(points, s, source[old]) - distance(points, s, source[row])
                if gain < 0.0 or (gain == 0.0 and old <= row):
                    continue
            out_row_near[s] = row


@kernel
def _inside(rows, sampled, balls):
    """Tell whether the balls of three rows cover the triangle of their centers.

    They are larger by the longest side of the surface triangle of the rows `sampled`, the sample
    spacing there.
    """
    points, source, centers, radii = balls.points, balls.source, balls.centers, balls.radii
    a, b, c = source[sampled[0]], source[sampled[1]], source[sampled[2]]
    reach = max(distance(points, a, b), distance(points, b, c), distance(points, c, a))
    a, b, c = rows[0], rows[1], rows[2]
    return in_balls(
        distance(centers, b, c), distance(centers, c, a), distance(centers, a, b),
        radii[a] + reach, radii[b] + reach, radii[c] + reach,
    )  # fmt: skip


@kernel
def test_faces(begin, end, slack, faces, row_near, balls, out_rows, out_ok):
    """Rows of the corners, and whether the centers of faces begin..end form a skeleton triangle."""
    for f in range(begin, end):
        for j in range(3):
            out_rows[f, j] = row_near[faces[f, j]]
        a, b, c = out_rows[f, 0], out_rows[f, 1], out_rows[f, 2]
        if min(a, b, c) < 0 or a == b or b == c or c == a:
            continue
        good = True
        for j in range(3):
            i, k = out_rows[f, j], out_rows[f, (j + 1) % 3]
            rise = abs(balls.radii[i] - balls.radii[k])
            run = distance(balls.centers, i, k)
            step = distance(balls.points, balls.source[i], balls.source[k])
            good &= rise <= 0.5 * (balls.slopes[i] + balls.slopes[k]) * run + slack * step
        out_ok[f] = good and _inside(out_rows[f], out_rows[f], balls)


@kernel
def longest_edges(rows, ok, centers, out_longest):
    """Longest side of the good lifted triangles at each row."""
    for f in range(len(rows)):
        if ok[f]:
            for j in range(3):
                i, k = rows[f, j], rows[f, (j + 1) % 3]
                length = distance(centers, i, k)
                out_longest[i] = max(out_longest[i], length)
                out_longest[k] = max(out_longest[k], length)


@kernel
def find_partners(usable, across, balls, longest, out_partner):
    """Row of the second feature point, where it holds nearly the same ball seen from there; -1.

    The true contact lies within one sample spacing of the second feature point, so the two centers
    are no further apart than the centers of neighbours there.
    """
    for i in range(len(usable)):
        j = across[i]
        if not (usable[i] and j >= 0 and usable[j]):
            continue
        if distance(balls.centers, i, j) <= longest[j] and _agreement(balls.chords, i, j) < 0.0:
            out_partner[i] = j


@kernel
def _root(parent, parity, i):
    """Root of i and the parity of i against it, with path halving."""
    turn = 0
    while parent[i] != i:
        up = parent[i]
        parity[i] ^= parity[up]
        parent[i] = parent[up]
        turn ^= parity[i]
        i = parent[i]
    return i, turn


@kernel
def _join(parent, parity, i, j, differ):
    a, pa = _root(parent, parity, i)
    b, pb = _root(parent, parity, j)
    if a == b:
        return
    if a > b:
        a, b = b, a
    parent[b] = a
    parity[b] = pa ^ pb ^ differ


@kernel
def join_sides(rows, ok, partner, chords, parent, parity, out_second):
    """Set out_second where a row belongs to the side of its sheet that is to be replaced.

    Of the two sides that one is replaced from which more rows have a partner.
    """
    for limit in (CERTAIN, SAME_SHEET):
        for i in range(len(partner)):
            if partner[i] >= 0 and _agreement(chords, i, partner[i]) < -limit:
                _join(parent, parity, i, partner[i], 1)
        for f in range(len(rows)):
            if ok[f]:
                for j in range(3):
                    i, k = rows[f, j], rows[f, (j + 1) % 3]
                    cosine = _agreement(chords, i, k)
                    if abs(cosine) > limit:
                        _join(parent, parity, i, k, np.int8(cosine < 0.0))
    votes = np.zeros(len(partner), np.int64)
    for i in range(len(partner)):
        if partner[i] >= 0:
            root, side = _root(parent, parity, i)
            votes[root] += 1 if side else -1
    for i in range(len(partner)):
        root, side = _root(parent, parity, i)
        out_second[i] = (side == 1) == (votes[root] >= 0)


@kernel
def lift_faces(rows, ok, partner, second, balls, out_rows, out_keep):
    """Lift faces with the second side replaced; keep those that are not covered from the first.

    A face whose corners all stand for themselves is kept. One with a replaced corner lies on the
    first side's triangles, unless its corners belong to several sheets (where sheets meet) or to
    both sides (a seam): there it closes the gap.
    """
    chords = balls.chords
    for f in range(len(rows)):
        if not ok[f]:
            continue
        replaced = False
        for j in range(3):
            i = rows[f, j]
            if second[i] and partner[i] >= 0 and not second[partner[i]]:
                i = partner[i]
                replaced = True
            out_rows[f, j] = i
        a, b, c = out_rows[f, 0], out_rows[f, 1], out_rows[f, 2]
        if a == b or b == c or c == a:
            continue
        if not replaced:
            out_keep[f] = True
            continue
        covered = (
            _agreement(chords, a, b) > SAME_SHEET
            and _agreement(chords, b, c) > SAME_SHEET
            and _agreement(chords, c, a) > SAME_SHEET
        )
        out_keep[f] = not covered and _inside(out_rows[f], rows[f], balls)
