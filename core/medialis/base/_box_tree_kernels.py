"""Kernels of the box tree: building it over samples, and nearest things by it (see box_tree.py).

Strategy. A balanced binary kd-tree of depth D over n samples needs no pointers: node j of level b
covers the samples (n*j >> b) .. (n*(j+1) >> b) of the sorted array. Three binary levels are stored
as one wide node with 8 children, whose bounds lie side by side (structure of arrays, float32), so
that one visit tests 8 boxes and 8 discs with vector instructions. Leaves hold at most LEAF samples,
padded to LEAF, again side by side.

While the tree is built the samples are rows (x, y, z, original index): one row moves as one unit,
and float64 holds every int32 index exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel

LEAF = 16  # samples a leaf at most: two AVX-512 or four AVX2 loads for each coordinate
FAN = 8  # children of a wide node
# Rows of a node's bounds: box low x y z, box high x y z; axis of the disc x y z, where it begins
# and ends along that from the middle of the box, and its radius.
BOUND_ROWS = 12
BITS = np.array([1 << j for j in range(16)], np.int32)
"""What stands for item j in a mask. A mask of 32 bits is made by vectors of 8 float32; numba's own
shifts and sums have 64 bits, and vectors are as long as their widest number: half as many."""
_LOWEST_BIT = np.array([0, *((i & -i).bit_length() - 1 for i in range(1, 1 << FAN))])


class BoxTree(NamedTuple):
    """Samples in tree order with a box and a disc for every node.

    Coordinates are relative to `center`, so that float32 bounds are good to 1e-7 of the diagonal
    wherever the shape lies.

    Attributes
    ----------
    center : (3,) float64
        Middle of the bounding box, subtracted from all coordinates below.
    points, normals : (n, 3) float64
        Samples in tree order.
    order : (n,) int32
        Original index of each sample in tree order.
    blocks : (leaves, 3, LEAF) float64
        Leaf coordinates side by side; a short leaf repeats its last sample.
    bounds : (nodes, 12, 8) float32
        For the 8 children of a node: box low, box high, axis, low, high, radius. The disc round the
        middle of the box has the mean normal of the samples as its axis: where the surface is
        nearly flat it is thinner than the box, and ends where the samples end. Of slabs without an
        end a ball meets three times as many. Unused children have an empty box.
    child : (nodes,) int64
        First child: a node number, or ~leaf where the children are leaves.
    depth : int
        Binary levels: leaf j covers samples (n*j >> depth) .. (n*(j+1) >> depth).
    """

    center: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    order: NDArray[np.int32]
    blocks: NDArray[np.float64]
    bounds: NDArray[np.float32]
    child: NDArray[np.int64]
    depth: int

    @property
    def place(self) -> NDArray[np.int32]:
        """Where each sample lies in tree order, (n,); computed each time."""
        place = np.empty(len(self.order), np.int32)
        place[self.order] = np.arange(len(place), dtype=np.int32)
        return place


class Leaves(NamedTuple):
    """What lies in each leaf of a tree, for `bound_nodes`.

    Attributes
    ----------
    points : (k, 3) float64
    first : (leaves + 1,) int64
        Where the points of each leaf start.
    normals : (l, 3) float64
        The sum of those of a node is the axis of its disc.
    sides : (leaves + 1,) int64
        Where the normals of each leaf start.
    """

    points: NDArray[np.float64]
    first: NDArray[np.int64]
    normals: NDArray[np.float64]
    sides: NDArray[np.int64]


class Items(NamedTuple):
    """Balls, or balls round triangles, in the order of the tree of their centers.

    Attributes
    ----------
    radii : (k,) float64
    largest : (nodes, 8) float64
        Largest radius below each child of a tree of balls; boxes of triangles hold them whole: 0.
    corners : (k, 3, 3) or (0, 3, 3) float64
        Corners of triangles, relative to the tree's center; none for balls.
    """

    radii: NDArray[np.float64]
    largest: NDArray[np.float64]
    corners: NDArray[np.float64]


@kernel
def _widest_axis(rows, begin, end):
    axis, widest = 0, -1.0
    for a in range(3):
        low = rows[begin, a]
        high = low
        for i in range(begin + 1, end):
            value = rows[i, a]
            low = min(low, value)
            high = max(high, value)
        if high - low > widest:
            axis, widest = a, high - low
    return axis


@kernel
def _select(rows, begin, end, middle, axis):
    """Quickselect: afterwards rows before `middle` are <= and rows from `middle` on are >=."""
    low, high = begin, end - 1
    while low < high:
        a, b, c = rows[low, axis], rows[(low + high) // 2, axis], rows[high, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while rows[i, axis] < pivot:
                i += 1
            while rows[j, axis] > pivot:
                j -= 1
            if i <= j:
                for k in range(4):
                    rows[i, k], rows[j, k] = rows[j, k], rows[i, k]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def split_nodes(rows, level, depth, first, last):
    """Sort nodes first..last of a level down to `depth`: each node's samples become contiguous."""
    n = len(rows)
    for top in range(first, last):
        for b in range(level, depth):
            for j in range(top << (b - level), (top + 1) << (b - level)):
                begin, end = (n * j) >> b, (n * (j + 1)) >> b
                middle = (n * (2 * j + 1)) >> (b + 1)
                if end - begin > 1:
                    _select(rows, begin, end, middle, _widest_axis(rows, begin, end))


@kernel
def fill_leaves(rows, normals, depth, first, last, out):
    """Copy samples into tree order and into the padded blocks of leaves first..last.

    `out` is the points, normals, order and blocks of the tree.
    """
    n = len(rows)
    out_points, out_normals, out_order, out_blocks = out
    for leaf in range(first, last):
        begin, end = (n * leaf) >> depth, (n * (leaf + 1)) >> depth
        for i in range(begin, end):
            source = int(rows[i, 3])
            out_order[i] = source
            for a in range(3):
                out_points[i, a] = rows[i, a]
                out_normals[i, a] = normals[source, a]
        for slot in range(LEAF):
            i = min(begin + slot, end - 1)  # padding repeats the last sample
            for a in range(3):
                out_blocks[leaf, a, slot] = rows[i, a]


@kernel
def _bound(leaves, one, other, out, slot):
    """Box and disc of the points of the leaves one..other, into column `slot` of a node."""
    points, normals, sides = leaves.points, leaves.normals, leaves.sides
    begin, end = leaves.first[one], leaves.first[other]
    lx, ly, lz, hx, hy, hz = math.inf, math.inf, math.inf, -math.inf, -math.inf, -math.inf
    for i in range(begin, end):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        lx, ly, lz = min(lx, x), min(ly, y), min(lz, z)
        hx, hy, hz = max(hx, x), max(hy, y), max(hz, z)
    mx, my, mz = 0.0, 0.0, 0.0
    for i in range(sides[one], sides[other]):
        mx += normals[i, 0]
        my += normals[i, 1]
        mz += normals[i, 2]
    length = math.sqrt(mx * mx + my * my + mz * mz)
    if length > 0.0:
        # Rounded to float32 first: the offsets below must belong to the stored direction.
        mx = np.float64(np.float32(mx / length))
        my = np.float64(np.float32(my / length))
        mz = np.float64(np.float32(mz / length))
    out[0, slot], out[1, slot], out[2, slot] = lx, ly, lz
    out[3, slot], out[4, slot], out[5, slot] = hx, hy, hz
    out[6, slot], out[7, slot], out[8, slot] = mx, my, mz
    # The middle of the box as `disc_distance2` rounds it.
    x0, y0 = 0.5 * (out[0, slot] + out[3, slot]), 0.5 * (out[1, slot] + out[4, slot])
    z0 = 0.5 * (out[2, slot] + out[5, slot])
    low, high, far = math.inf, -math.inf, 0.0
    for i in range(begin, end):
        x, y, z = points[i, 0] - x0, points[i, 1] - y0, points[i, 2] - z0
        s = mx * x + my * y + mz * z
        x, y, z = x - s * mx, y - s * my, z - s * mz
        low, high, far = min(low, s), max(high, s), max(far, x * x + y * y + z * z)
    out[9, slot], out[10, slot], out[11, slot] = low, high, math.sqrt(far)


@kernel
def bound_nodes(leaves, below, fan, first, last, out_bounds):
    """Bounds of the children of wide nodes first..last of one level, with `below` leaves each."""
    for node in range(first, last):
        for slot in range(fan):
            child = node * fan + slot
            _bound(leaves, child * below, (child + 1) * below, out_bounds[node], slot)


@kernel
def box_distance2(bound, j, fx, fy, fz):
    """Squared distance of the box of child j; all float32, or all float64."""
    zero = np.float32(0.0)
    ax, bx = bound[0, j] - fx, fx - bound[3, j]
    ay, by = bound[1, j] - fy, fy - bound[4, j]
    az, bz = bound[2, j] - fz, fz - bound[5, j]
    # Conditional expressions, not max(): max() treats NaN apart and is not vectorised.
    dx = ax if ax > bx else bx
    dy = ay if ay > by else by
    dz = az if az > bz else bz
    dx = dx if dx > zero else zero
    dy = dy if dy > zero else zero
    dz = dz if dz > zero else zero
    return dx * dx + dy * dy + dz * dz


@kernel
def disc_distance2(bound, j, fx, fy, fz):
    """Squared distance of the disc of child j; all float32."""
    half, zero = np.float32(0.5), np.float32(0.0)
    x, y = fx - half * (bound[0, j] + bound[3, j]), fy - half * (bound[1, j] + bound[4, j])
    z = fz - half * (bound[2, j] + bound[5, j])
    s = bound[6, j] * x + bound[7, j] * y + bound[8, j] * z
    x, y, z = x - s * bound[6, j], y - s * bound[7, j], z - s * bound[8, j]
    beside = math.sqrt(x * x + y * y + z * z) - bound[11, j]
    beside = beside if beside > zero else zero
    before, behind = bound[9, j] - s, s - bound[10, j]
    off = before if before > behind else behind
    off = off if off > zero else zero
    return off * off + beside * beside


@kernel
def test_children(bound, cx, cy, cz, reach):
    """Children whose box and disc come nearer to the center than `reach`: a bit for each."""
    fx, fy, fz = np.float32(cx), np.float32(cy), np.float32(cz)
    reach2, none = np.float32(reach * reach), np.int32(0)
    bits = none
    for j in range(FAN):
        box, disc = box_distance2(bound, j, fx, fy, fz), disc_distance2(bound, j, fx, fy, fz)
        bits = np.int32(bits | (BITS[j] if (box < reach2) & (disc < reach2) else none))
    return bits


@kernel
def is_certain(known, x, y, z, length):
    """Tell whether a certificate holds: |c - c0| <= length - w, of places c0 and lengths w (4, k).

    All are asked in one go: vectors take less time than the first that holds would save.
    """
    certain = 0
    for j in range(known.shape[1]):
        dx, dy, dz = x - known[0, j], y - known[1, j], z - known[2, j]
        room = length - known[3, j]
        certain += (room >= 0.0) & (dx * dx + dy * dy + dz * dz <= room * room)
    return certain > 0


@kernel
def lowest_bit(bits):
    """Lowest of the 16 bits of a number that is set; `bits & (bits - 1)` are those after it.

    To go from bit to bit takes a third less time than to ask for each of them.
    """
    low = bits & 255
    return _LOWEST_BIT[low] if low > 0 else 8 + _LOWEST_BIT[bits >> 8]


@kernel
def largest_radii(radii, child_depth, fan, first, last, out_largest):
    """Largest radius below each child of the nodes first..last of one level of a box tree."""
    n = len(radii)
    for node in range(first, last):
        for slot in range(fan):
            at = node * fan + slot
            begin, end = (n * at) >> child_depth, (n * (at + 1)) >> child_depth
            largest = 0.0
            for i in range(begin, end):
                largest = max(largest, radii[i])
            out_largest[node, slot] = largest


@kernel
def dot(ax, ay, az, bx, by, bz):
    """Scalar product of two vectors."""
    return ax * bx + ay * by + az * bz


@kernel
def nearest_place(px, py, pz, points, a, b, c):
    """Nearest place a + s (b - a) + t (c - a) of a triangle: the regions of its plane, in turn.

    Its corners are points a, b and c. Returns (s, t, squared distance).
    """
    ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
    abx, aby, abz = points[b, 0] - ax, points[b, 1] - ay, points[b, 2] - az
    acx, acy, acz = points[c, 0] - ax, points[c, 1] - ay, points[c, 2] - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1, d2 = dot(abx, aby, abz, apx, apy, apz), dot(acx, acy, acz, apx, apy, apz)
    bpx, bpy, bpz = px - points[b, 0], py - points[b, 1], pz - points[b, 2]
    d3, d4 = dot(abx, aby, abz, bpx, bpy, bpz), dot(acx, acy, acz, bpx, bpy, bpz)
    cpx, cpy, cpz = px - points[c, 0], py - points[c, 1], pz - points[c, 2]
    d5, d6 = dot(abx, aby, abz, cpx, cpy, cpz), dot(acx, acy, acz, cpx, cpy, cpz)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    s, t = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        s = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        s = d1 / (d1 - d3)
    elif d6 >= 0.0 and d5 <= d6:
        t = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        t = d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6 and d4 - d3 + d5 - d6 > 0.0:
        t = (d4 - d3) / (d4 - d3 + d5 - d6)
        s = 1.0 - t
    elif va + vb + vc > 0.0:
        s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    x, y, z = apx - s * abx - t * acx, apy - s * aby - t * acy, apz - s * abz - t * acz
    return s, t, dot(x, y, z, x, y, z)


@kernel
def _box_of_three(points, a, b, c, x, y, z):
    """Squared distance of the box of a triangle: that of a sliver is smaller than its ball."""
    d2 = 0.0
    for axis, at in ((0, x), (1, y), (2, z)):
        one, two, three = points[a, axis], points[b, axis], points[c, axis]
        before, behind = min(one, min(two, three)) - at, at - max(one, max(two, three))
        d = max(max(before, behind), 0.0)
        d2 += d * d
    return d2


@kernel
def nearest_item(begin, end, queries, tree, items, margin, enough, out):
    """Smallest distance to balls, |x - c| - r, or to the triangles within them; all in tree order.

    A node is skipped when even its largest ball at the nearest place of its box is no nearer. The
    child that promises most is visited first: it is pushed last. A distance below `enough` ends the
    search. `out` is the distances (q,) and the items (q,) int64.
    """
    centers, bounds, child, depth = tree.points, tree.bounds, tree.child, tree.depth
    radii, largest, corners = items
    points = corners.reshape(-1, 3)  # no views of rows: to count who holds them took half the time
    out_distance, out_item = out
    n = len(radii)
    stack = np.empty(8 * 12 + 8, np.int64)
    promise = np.empty(8 * 12 + 8)
    bound = np.empty(FAN)
    for i in range(begin, end):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        best, winner = math.inf, -1
        stack[0], promise[0] = 0, -math.inf
        top = 1
        while top > 0 and best >= enough:
            top -= 1
            node = stack[top]
            if promise[top] > best:
                continue
            base = child[node]
            nearest = 0
            for j in range(FAN):
                box = math.sqrt(box_distance2(bounds[node], j, x, y, z))
                bound[j] = box - largest[node, j] - margin
                if bound[j] < bound[nearest]:
                    nearest = j
            for turn in range(FAN):
                j = (nearest + 1 + turn) % FAN  # the nearest one comes last
                if base >= 0 and bound[j] <= best and bound[j] < math.inf:  # inf: no such child
                    stack[top], promise[top] = base + j, bound[j]
                    top += 1
            for turn in range(FAN):
                j = (nearest + turn) % FAN
                if base < 0 and bound[j] <= best and bound[j] < math.inf:
                    leaf = ~base + j
                    for k in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                        dx, dy, dz = x - centers[k, 0], y - centers[k, 1], z - centers[k, 2]
                        value = math.sqrt(dx * dx + dy * dy + dz * dz) - radii[k]
                        if len(corners) > 0 and value - margin <= best:
                            a, b, c = 3 * k, 3 * k + 1, 3 * k + 2
                            if _box_of_three(points, a, b, c, x, y, z) > (best + margin) ** 2:
                                continue
                            value = math.sqrt(nearest_place(x, y, z, points, a, b, c)[2])
                        if value < best or (value == best and k < winner):
                            best, winner = value, k
        out_distance[i] = best
        out_item[i] = winner


@kernel
def nearest_places(queries, corners, out_places):
    """Nearest place of one triangle for each query, as s and t of `nearest_place`."""
    points = corners.reshape(-1, 3)
    for i in range(len(queries)):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        s, t, _ = nearest_place(x, y, z, points, 3 * i, 3 * i + 1, 3 * i + 2)
        out_places[i, 0], out_places[i, 1] = s, t


@kernel
def nearest_in_tree(first, last, tree, out_distance, out_near):
    """Find the nearest others of the points in leaves first..last of a box tree, nearest first.

    Points, blocks and bounds (float64) are in tree order, the rows of the answer and its indices in
    the given one. Each search begins in the leaf of its point: what it finds there is nearly always
    as near as the answer, so that few other boxes come near enough to be opened.
    """
    points, order, bounds, child, depth = (
        tree.points, tree.order, tree.bounds, tree.child, tree.depth,
    )  # fmt: skip
    n, count = len(points), out_near.shape[1]
    stack, least = np.empty(8 * 12 + 8, np.int64), np.empty(8 * 12 + 8)
    box, turn, square = np.empty(FAN), np.empty(FAN, np.int64), np.empty(LEAF)
    best, names = np.empty(count), np.empty(count, np.int64)
    for leaf in range(first, last):
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            best[:] = np.inf
            _take_leaf(i, leaf, tree, square, best, names)
            stack[0], least[0] = 0, 0.0
            top = 1
            while top > 0:
                top -= 1
                if least[top] >= best[count - 1]:
                    continue
                node = stack[top]
                base = child[node]
                _measure_boxes(bounds[node], x, y, z, box)
                hits = _sort_hits(box, best[count - 1], turn)
                if base >= 0:
                    for at in range(hits - 1, -1, -1):  # the nearest comes last, and is next
                        stack[top], least[top] = base + turn[at], box[turn[at]]
                        top += 1
                    continue
                for at in range(hits):
                    if ~base + turn[at] != leaf and box[turn[at]] < best[count - 1]:
                        other = ~base + turn[at]
                        _take_leaf(i, other, tree, square, best, names)
            row = order[i]
            for k in range(count):
                out_distance[row, k], out_near[row, k] = math.sqrt(best[k]), order[names[k]]


@kernel
def _measure_boxes(bound, x, y, z, out):
    """Squared distances to the boxes of eight children; infinite where there is none."""
    for j in range(FAN):
        out[j] = box_distance2(bound, j, x, y, z)


@kernel
def _sort_hits(box, reach, out_turn):
    """List the children nearer than `reach`, the nearest first; return how many."""
    hits = 0
    for j in range(FAN):
        if box[j] >= reach:
            continue
        at = hits
        while at > 0 and box[out_turn[at - 1]] > box[j]:
            out_turn[at] = out_turn[at - 1]
            at -= 1
        out_turn[at] = j
        hits += 1
    return hits


@kernel
def _take_leaf(i, leaf, tree, square, best, names):
    """Enter the points of a leaf, but point i, into the sorted list of the nearest so far."""
    n, depth, blocks = len(tree.points), tree.depth, tree.blocks
    x, y, z = tree.points[i, 0], tree.points[i, 1], tree.points[i, 2]
    begin, count = (n * leaf) >> depth, len(best)
    for slot in range(LEAF):
        dx, dy, dz = blocks[leaf, 0, slot] - x, blocks[leaf, 1, slot] - y, blocks[leaf, 2, slot] - z
        square[slot] = dx * dx + dy * dy + dz * dz
    for slot in range(((n * (leaf + 1)) >> depth) - begin):
        value = square[slot]
        if value >= best[count - 1] or begin + slot == i:
            continue
        k = count - 1
        while k > 0 and best[k - 1] > value:
            best[k], names[k] = best[k - 1], names[k - 1]
            k -= 1
        best[k], names[k] = value, begin + slot
