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
