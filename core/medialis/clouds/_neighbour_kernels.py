"""Kernels: neighbourhoods that lie evenly about their points, also on the lines of a scan."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def find_lines(points, near, k, slimmest, out_line):
    """Find points most of whose triangles with two of k neighbours are slim: all lie on a line.

    Slim: the sine of the angle at the point is below `slimmest`. Of points on a line about half the
    pairs lie on both sides; an outlier sees all of a surface on one side.
    """
    for i in range(len(near)):
        slim, opposite = 0, 0
        for a in range(k):
            ax = points[near[i, a], 0] - points[i, 0]
            ay = points[near[i, a], 1] - points[i, 1]
            az = points[near[i, a], 2] - points[i, 2]
            for b in range(a):
                bx = points[near[i, b], 0] - points[i, 0]
                by = points[near[i, b], 1] - points[i, 1]
                bz = points[near[i, b], 2] - points[i, 2]
                x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                sides = (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)
                if x * x + y * y + z * z <= slimmest * slimmest * sides:
                    slim += 1
                    opposite += ax * bx + ay * by + az * bz < 0.0
        out_line[i] = 4 * slim > k * (k - 1) and 4 * opposite > slim


@kernel
def spread_neighbours(points, rows, wide, apart, out_near):
    """Choose neighbours that lie evenly about a point from many that lie on lines.

    Nearest first, at least `apart` times the distance to the last one from the point and from each
    other. `out_near` (rows, k) keeps what it has where there are not so many.
    """
    k = out_near.shape[1]
    chosen = np.empty(k, np.int32)
    for row in range(len(rows)):
        i, last, count = rows[row], wide[row, -1], 0
        least = 0.0
        for c in range(3):
            least += (apart * (points[last, c] - points[i, c])) ** 2
        for j in wide[row]:
            free = count < k
            for q in range(-1, count):
                other = i if q < 0 else chosen[q]
                square = 0.0
                for c in range(3):
                    square += (points[j, c] - points[other, c]) ** 2
                free = free and square >= least
            if free:
                chosen[count] = j
                count += 1
        if count == k:
            out_near[row] = chosen


@kernel
def _square_off(x, y, z, a, b, c):
    """Square of the distance of a place from the line through 0 and (x, y, z); of 0 from itself."""
    square = x * x + y * y + z * z
    if square == 0.0:
        return a * a + b * b + c * c
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    return (u * u + v * v + w * w) / square


@kernel
def _is_strip(sides, count, thin, rest):
    """Whether places lie on two lines or fewer, one of them through 0 and one of the places."""
    for m in range(count):
        x, y, z = sides[m, 0], sides[m, 1], sides[m, 2]
        left = 0
        for j in range(count):
            a, b, c = sides[j, 0], sides[j, 1], sides[j, 2]
            if _square_off(x, y, z, a, b, c) > thin * thin * (a * a + b * b + c * c):
                for axis in range(3):
                    rest[left, axis] = sides[j, axis] - (rest[0, axis] if left else 0.0)
                left += 1
        longest, farthest = 0.0, 0
        for j in range(1, left):
            length = rest[j, 0] ** 2 + rest[j, 1] ** 2 + rest[j, 2] ** 2
            if length > longest:
                longest, farthest = length, j
        off = 0.0
        for j in range(1, left if longest > 0.0 else 0):
            x, y, z = rest[farthest, 0], rest[farthest, 1], rest[farthest, 2]
            off = max(off, _square_off(x, y, z, rest[j, 0], rest[j, 1], rest[j, 2]))
        if off <= thin * thin * longest:
            return True
    return False


@kernel
def find_strips(points, near, patches, size, bits, thin, out_strip):
    """Find patches all of whose places lie on two lines: any two lines side by side have a plane.

    `patches` is the number of slots of a point. Two lines of a scan, one on each side of an edge,
    make a chamfer that is on no surface. `thin` is the width of a line for its length.
    """
    k = near.shape[1]
    sides, rest = np.empty((k, 3)), np.empty((k, 3))
    for slot in range(len(size)):
        count, i = 0, slot // patches
        for m in range(k):
            if size[slot] > 0 and (bits[slot] >> np.uint64(m)) & np.uint64(1) != 0:
                for axis in range(3):
                    sides[count, axis] = points[near[i, m], axis] - points[i, axis]
                count += 1
        out_strip[slot] = count > 0 and _is_strip(sides, count, thin, rest)
