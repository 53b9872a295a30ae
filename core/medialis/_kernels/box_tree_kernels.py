"""Kernels of the bounding tree over surface samples (used by thesis 3.2; see box_tree.py).

Strategy. A balanced binary kd-tree of depth D over n samples needs no pointers: node j of level b
covers the samples (n*j >> b) .. (n*(j+1) >> b) of the sorted array. Three binary levels are stored
as one wide node with 8 children, whose bounds lie side by side (structure of arrays, float32), so
that one visit tests 8 boxes and 8 slabs with vector instructions. Leaves hold at most LEAF samples,
padded to LEAF, again side by side.

While the tree is built the samples are rows (x, y, z, original index): one row moves as one unit,
and float64 holds every int32 index exactly.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

LEAF = 16  # samples a leaf at most: two AVX-512 or four AVX2 loads for each coordinate
FAN = 8  # children of a wide node
# Rows of a node's bounds: box low x y z, box high x y z, slab direction x y z, slab low, slab high.
BOUND_ROWS = 11
_LOWEST_BIT = np.array([0, *((i & -i).bit_length() - 1 for i in range(1, 1 << FAN))])


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
def fill_leaves(rows, normals, depth, first, last, out_points, out_normals, out_order, out_blocks):
    """Copy samples into tree order and into the padded blocks of leaves first..last."""
    n = len(rows)
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
def _bound(points, normals, begin, end, out, slot):
    """Box and slab of the samples begin..end, into column `slot` of a node."""
    lx, ly, lz = points[begin, 0], points[begin, 1], points[begin, 2]
    hx, hy, hz = lx, ly, lz
    mx, my, mz = 0.0, 0.0, 0.0
    for i in range(begin, end):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        lx, ly, lz = min(lx, x), min(ly, y), min(lz, z)
        hx, hy, hz = max(hx, x), max(hy, y), max(hz, z)
        mx += normals[i, 0]
        my += normals[i, 1]
        mz += normals[i, 2]
    length = math.sqrt(mx * mx + my * my + mz * mz)
    if length > 0.0:
        # Rounded to float32 first: the offsets below must belong to the stored direction.
        mx = np.float64(np.float32(mx / length))
        my = np.float64(np.float32(my / length))
        mz = np.float64(np.float32(mz / length))
    low, high = math.inf, -math.inf
    for i in range(begin, end):
        s = mx * points[i, 0] + my * points[i, 1] + mz * points[i, 2]
        low, high = min(low, s), max(high, s)
    out[0, slot], out[1, slot], out[2, slot] = lx, ly, lz
    out[3, slot], out[4, slot], out[5, slot] = hx, hy, hz
    out[6, slot], out[7, slot], out[8, slot] = mx, my, mz
    out[9, slot], out[10, slot] = low, high


@kernel
def bound_nodes(points, normals, child_depth, fan, first, last, out_bounds):
    """Bounds of the children of wide nodes first..last of one level (children at `child_depth`)."""
    n = len(points)
    for node in range(first, last):
        for slot in range(fan):
            child = node * fan + slot
            begin, end = (n * child) >> child_depth, (n * (child + 1)) >> child_depth
            _bound(points, normals, begin, end, out_bounds[node], slot)


@kernel
def test_children(bound, cx, cy, cz, reach):
    """Children whose box and slab come nearer to the center than `reach`: a bit for each."""
    fx, fy, fz = np.float32(cx), np.float32(cy), np.float32(cz)
    reach1, reach2 = np.float32(reach), np.float32(reach * reach)
    zero = np.float32(0.0)
    bits = np.int32(0)
    for j in range(FAN):
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
        s = bound[6, j] * fx + bound[7, j] * fy + bound[8, j] * fz
        sa, sb = bound[9, j] - s, s - bound[10, j]
        slab = sa if sa > sb else sb
        hit = (dx * dx + dy * dy + dz * dz < reach2) & (slab < reach1)
        bits += np.int32(hit) << np.int32(j)
    return bits


@kernel
def lowest_bit(bits):
    """Lowest of the 16 bits of a number that is set; `bits & (bits - 1)` are those after it.

    To go from bit to bit takes a third less time than to ask for each of them.
    """
    low = bits & 255
    return _LOWEST_BIT[low] if low > 0 else 8 + _LOWEST_BIT[bits >> 8]
