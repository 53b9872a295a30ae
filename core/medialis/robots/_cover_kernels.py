"""Kernels of covers: which capsule or ball needs how much to hold which patch of a surface.

A capsule with axis from `a` to `b` whose points are all `depth` or deeper in a solid sticks out of
it by at most its radius minus that depth (a ball is a capsule with a = b). So the protrusion that a
capsule needs to hold a patch is the largest distance of the patch's corners from the axis, minus
the depth: one number for each pair, and covering a surface becomes choosing columns of a matrix.
"""

from __future__ import annotations

import math

import numpy as np

from medialis.base.jit import kernel


@kernel
def mark_voxels(triangles, low, side, out_wall):
    """Mark the voxels that triangles (t, 3, 3) pass through in `out_wall`, which must be False.

    Points of a triangle are at most half a voxel apart, so that it passes between no two
    neighbouring voxels without a mark in either.
    """
    for t in range(len(triangles)):
        longest = 0.0
        for k in range(3):
            square = 0.0
            for axis in range(3):
                square += (triangles[t, k, axis] - triangles[t, k - 1, axis]) ** 2
            longest = max(longest, square)
        parts = max(math.ceil(math.sqrt(longest) / (0.5 * side)), 1)
        for i in range(parts + 1):
            for j in range(parts + 1 - i):
                u, v = i / parts, j / parts
                w = 1.0 - u - v
                x = w * triangles[t, 0, 0] + u * triangles[t, 1, 0] + v * triangles[t, 2, 0]
                y = w * triangles[t, 0, 1] + u * triangles[t, 1, 1] + v * triangles[t, 2, 1]
                z = w * triangles[t, 0, 2] + u * triangles[t, 1, 2] + v * triangles[t, 2, 2]
                out_wall[
                    int((x - low[0]) / side), int((y - low[1]) / side), int((z - low[2]) / side)
                ] = True


@kernel
def fill_needs(begin, end, corners, starts, axes, depths, out_needs):
    """Fill the protrusion that each capsule needs to hold each patch, rows `begin` to `end`.

    Patch i has the corners `starts[i]` to `starts[i + 1]` of `corners` (c, 3); capsule j has the
    axis `axes[j]` (6,) and the depth `depths[j]`. `out_needs` is (n, m) float32.
    """
    for i in range(begin, end):
        for j in range(len(axes)):
            ax, ay, az = axes[j, 0], axes[j, 1], axes[j, 2]
            ux, uy, uz = axes[j, 3] - ax, axes[j, 4] - ay, axes[j, 5] - az
            square = ux * ux + uy * uy + uz * uz
            largest = 0.0
            for k in range(starts[i], starts[i + 1]):
                x, y, z = corners[k, 0] - ax, corners[k, 1] - ay, corners[k, 2] - az
                if square > 0.0:
                    along = (x * ux + y * uy + z * uz) / square
                    along = min(max(along, 0.0), 1.0)
                    x, y, z = x - along * ux, y - along * uy, z - along * uz
                largest = max(largest, x * x + y * y + z * z)
            out_needs[i, j] = math.sqrt(largest) - depths[j]


@kernel
def choose_columns(needs, limits, most, counts, out_columns, out_owners):
    """Choose few columns that hold all patches, each within its limit, the most useful ones first.

    Greedy set cover; `limits` is (m,) float32. `counts` (m,) receives scratch values, `out_columns`
    (most,) the chosen columns, and `out_owners` (n,) the position in it for each patch. Returns
    their number, or -1 where more than `most` would be needed or no column holds a patch.
    """
    n, m = needs.shape
    counts[:] = 0
    for i in range(n):
        out_owners[i] = -1
        for j in range(m):
            if needs[i, j] <= limits[j]:
                counts[j] += 1
    chosen, left = 0, n
    while left > 0:
        best = 0
        for j in range(1, m):
            if counts[j] > counts[best]:
                best = j
        if counts[best] <= 0 or chosen == most:
            return -1
        for i in range(n):
            if out_owners[i] < 0 and needs[i, best] <= limits[best]:
                out_owners[i] = chosen
                left -= 1
                for j in range(m):
                    if needs[i, j] <= limits[j]:
                        counts[j] -= 1
        out_columns[chosen] = best
        chosen += 1
    return chosen


@kernel
def improve_columns(needs, rounds, largest, columns, owners, out_needed):
    """Give each patch to the column that needs least for it, and replace columns by better ones.

    Lloyd's algorithm over the columns of `needs` (n, m). `columns` (k,) and `owners` (n,) are
    changed; `largest` (k, m) receives scratch values; `out_needed` (k,) the protrusion of each, -1
    where it holds nothing. Returns the largest of them.
    """
    n, m = needs.shape
    k = len(columns)
    before = np.inf
    for step in range(rounds + 1):
        out_needed[:] = -1.0
        for i in range(n):
            best = 0
            for c in range(1, k):
                if needs[i, columns[c]] < needs[i, columns[best]]:
                    best = c
            owners[i] = best
            out_needed[best] = max(out_needed[best], needs[i, columns[best]])
        worst = out_needed.max()
        if step == rounds or worst >= before:
            break
        before = worst
        largest[:] = -1.0
        for i in range(n):
            row = largest[owners[i]]
            for j in range(m):
                row[j] = max(row[j], needs[i, j])
        for c in range(k):
            best = columns[c]
            for j in range(m):
                if largest[c, j] < largest[c, best]:
                    best = j
            columns[c] = best
    return out_needed.max()


@kernel
def fill_radii(corners, owners, axes, out_radii):
    """Enlarge `out_radii` (k,) until each corner (c, 3) is within that of its owner's axis."""
    for i in range(len(corners)):
        axis = axes[owners[i]]
        x, y, z = corners[i, 0] - axis[0], corners[i, 1] - axis[1], corners[i, 2] - axis[2]
        ux, uy, uz = axis[3] - axis[0], axis[4] - axis[1], axis[5] - axis[2]
        square = ux * ux + uy * uy + uz * uz
        if square > 0.0:
            along = min(max((x * ux + y * uy + z * uz) / square, 0.0), 1.0)
            x, y, z = x - along * ux, y - along * uy, z - along * uz
        out_radii[owners[i]] = max(out_radii[owners[i]], math.sqrt(x * x + y * y + z * z))
