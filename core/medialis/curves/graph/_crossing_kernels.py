"""Kernels of links that cross a surface which a loop spans (see spanning.py).

The surface is a binary tree of triangles. All tests are signs of volumes of four points, computed
in one order wherever they are asked for: so a path crosses the surface as often as it should, also
where it goes through the side of two triangles, or where one of its points lies in a triangle.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

DEEPEST = 64  # the tree halves its loop again and again


@kernel
def fill_boxes(points, corners, children, out_boxes, out_planes):
    """Box round each triangle and all below it, and its plane: unit normal and offset.

    Children come after their parents.
    """
    for t in range(len(corners) - 1, -1, -1):
        a, b, c = points[corners[t, 0]], points[corners[t, 1]], points[corners[t, 2]]
        for axis in range(3):
            low, high = (
                min(a[axis], b[axis], c[axis]),
                max(a[axis], b[axis], c[axis]),
            )
            for j in range(2):
                child = children[t, j]
                if child >= 0:
                    low = min(low, out_boxes[child, axis])
                    high = max(high, out_boxes[child, 3 + axis])
            out_boxes[t, axis], out_boxes[t, 3 + axis] = low, high
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        size = max(math.sqrt(x * x + y * y + z * z), 1e-300)
        out_planes[t, 0], out_planes[t, 1], out_planes[t, 2] = x / size, y / size, z / size
        out_planes[t, 3] = (x * a[0] + y * a[1] + z * a[2]) / size


@kernel
def _volume(p, q, a, b):
    """Six times the signed volume of four points."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = a[0] - p[0], a[1] - p[1], a[2] - p[2]
    wx, wy, wz = b[0] - p[0], b[1] - p[1], b[2] - p[2]
    return ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)


@kernel
def _passes(p, q, points, i, j):
    """Tell on which side of a directed edge a line passes: the other one for the edge reversed."""
    if i < j:
        return _volume(p, q, points[i], points[j]) > 0.0
    return not _volume(p, q, points[j], points[i]) > 0.0


@kernel
def _crossing(p, q, points, corner):
    """Whether the segment from p to q crosses a triangle: 1 along its normal, -1 against it."""
    a, b, c = points[corner[0]], points[corner[1]], points[corner[2]]
    above = _volume(a, b, c, p) > 0.0
    if above == (_volume(a, b, c, q) > 0.0):
        return 0
    side = _passes(p, q, points, corner[0], corner[1])
    if side != _passes(p, q, points, corner[1], corner[2]):
        return 0
    if side != _passes(p, q, points, corner[2], corner[0]):
        return 0
    return -1 if above else 1


@kernel
def cross_links(
    begin, stop, rows, reach, centers, radii, offsets, neighbours, length, points, corners,
    children, boxes, planes, slack, out_turns,
):  # fmt: skip
    """Count how often links between balls that overlap cross the surface, against its normals.

    `reach` is the length of the longest such link of each ball (r,). `out_turns` has one place for
    each link and comes with 0.
    """
    stack = np.empty(DEEPEST, np.int64)
    for i in range(begin, stop):
        v = rows[i]
        x, y, z, far = centers[v, 0], centers[v, 1], centers[v, 2], reach[v] + slack
        stack[0], size = 0, 1
        while size > 0:
            size -= 1
            t = stack[size]
            if x + far < boxes[t, 0] or y + far < boxes[t, 1] or z + far < boxes[t, 2]:
                continue
            if x - far > boxes[t, 3] or y - far > boxes[t, 4] or z - far > boxes[t, 5]:
                continue
            for j in range(2):
                if children[t, j] >= 0:
                    stack[size] = children[t, j]
                    size += 1
            off = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z - planes[t, 3]
            if abs(off) > far:
                continue
            for at in range(offsets[v], offsets[v + 1]):
                w = neighbours[at]
                if length[at] >= radii[v] + radii[w]:
                    continue
                if v < w:
                    out_turns[at] -= _crossing(centers[v], centers[w], points, corners[t])
                else:
                    out_turns[at] += _crossing(centers[w], centers[v], points, corners[t])


@kernel
def take_turns(rows, offsets, turns, out_links, out_turns):
    """List the links of some balls that have turns, and set those to 0; returns how many."""
    count = 0
    for v in rows:
        for at in range(offsets[v], offsets[v + 1]):
            if turns[at] != 0:
                out_links[count], out_turns[count] = at, turns[at]
                turns[at] = 0
                count += 1
    return count
