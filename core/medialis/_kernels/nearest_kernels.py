"""Kernels of the distances to balls and triangles (see nearest.py)."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.box_tree_kernels import FAN
from medialis._kernels.jit import kernel


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
def _box_distance(bound, j, x, y, z):
    dx = max(bound[0, j] - x, x - bound[3, j], 0.0)
    dy = max(bound[1, j] - y, y - bound[4, j], 0.0)
    dz = max(bound[2, j] - z, z - bound[5, j], 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def dot(ax, ay, az, bx, by, bz):
    """Scalar product of two vectors."""
    return ax * bx + ay * by + az * bz


@kernel
def nearest_place(px, py, pz, a, b, c):
    """Nearest place a + s (b - a) + t (c - a) of a triangle: the regions of its plane, in turn.

    Returns (s, t, squared distance).
    """
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = px - a[0], py - a[1], pz - a[2]
    d1, d2 = dot(abx, aby, abz, apx, apy, apz), dot(acx, acy, acz, apx, apy, apz)
    bpx, bpy, bpz = px - b[0], py - b[1], pz - b[2]
    d3, d4 = dot(abx, aby, abz, bpx, bpy, bpz), dot(acx, acy, acz, bpx, bpy, bpz)
    cpx, cpy, cpz = px - c[0], py - c[1], pz - c[2]
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
def nearest_item(
    begin, end, queries, centers, radii, corners, bounds, child, largest, depth,
    margin, enough, out_distance, out_item,
):  # fmt: skip
    """Smallest distance to balls, |x - c| - r, or to the triangles within them; all in tree order.

    `corners` has no row for balls. A node is skipped when even its largest ball at the nearest
    place of its box is no nearer. The child that promises most is visited first: it is pushed
    last. A distance below `enough` ends the search.
    """
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
                bound[j] = _box_distance(bounds[node], j, x, y, z) - largest[node, j] - margin
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
                            a, b, c = corners[k, 0], corners[k, 1], corners[k, 2]
                            value = math.sqrt(nearest_place(x, y, z, a, b, c)[2])
                        if value < best or (value == best and k < winner):
                            best, winner = value, k
        out_distance[i] = best
        out_item[i] = winner


@kernel
def nearest_places(queries, corners, out_places):
    """Nearest place of one triangle for each query, as s and t of `nearest_place`."""
    for i in range(len(queries)):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        s, t, _ = nearest_place(x, y, z, corners[i, 0], corners[i, 1], corners[i, 2])
        out_places[i, 0], out_places[i, 1] = s, t
