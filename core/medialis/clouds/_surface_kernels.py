"""Kernels: triangles round each point from the Voronoi cell in its tangent plane."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def _clip(corners, owners, count, x, y, heavier, name, spare, spare_owners):
    """Cut a convex polygon by the half plane nearer to the origin than to (x, y).

    `heavier` is the weight of the origin less that of (x, y): squared distances count less by it.

    Edge e runs from corner e to the next one and belongs to `owners[e]`. Return the corners left.
    """
    limit = 0.5 * (x * x + y * y + heavier)
    filled = 0
    for e in range(count):
        ahead = (e + 1) % count
        here = corners[e, 0] * x + corners[e, 1] * y - limit
        there = corners[ahead, 0] * x + corners[ahead, 1] * y - limit
        if here <= 0.0:
            spare[filled, 0], spare[filled, 1] = corners[e, 0], corners[e, 1]
            spare_owners[filled] = owners[e]
            filled += 1
        if (here <= 0.0) != (there <= 0.0):
            share = here / (here - there)
            for axis in range(2):
                spare[filled, axis] = corners[e, axis] + share * (
                    corners[ahead, axis] - corners[e, axis]
                )
            # Going out, the cut begins here; coming in, the rest of this edge does.
            spare_owners[filled] = name if here <= 0.0 else owners[e]
            filled += 1
    corners[:filled] = spare[:filled]
    owners[:filled] = spare_owners[:filled]
    return filled


@kernel
def list_stars(flat, near, weights, farthest, begin, end, out_triangles, out_radii):
    """Delaunay triangles (i, a, b) of each point among its neighbours in the tangent plane.

    `flat` (n, k, 2) are the neighbours there, the point at the origin. Two neighbouring edges of
    the Voronoi cell of the point belong to two corners of a triangle, and the corner between them
    is the center of its circle. Circles with a radius above `farthest` are left out: a hole or the
    border. Small weights, the same for all cells, decide between the two diagonals of four points
    on a circle. `out_triangles` (n, k, 3) comes filled with -1.
    """
    k = near.shape[1]
    room = k + 8  # each cut adds one corner at most to the four of the square
    corners, spare = np.empty((room, 2)), np.empty((room, 2))
    owners, spare_owners = np.empty(room, np.int64), np.empty(room, np.int64)
    for i in range(begin, end):
        half = 4.0 * farthest[i]
        for e in range(4):
            corners[e, 0] = half if e in (0, 3) else -half
            corners[e, 1] = half if e in (0, 1) else -half
            owners[e] = -1
        count = 4
        for m in range(k):
            x, y = flat[i, m, 0], flat[i, m, 1]
            heavier = weights[i] - weights[near[i, m]]
            count = _clip(corners, owners, count, x, y, heavier, m, spare, spare_owners)
        filled = 0
        for e in range(count):
            a, b = owners[e - 1 if e > 0 else count - 1], owners[e]
            radius = math.hypot(corners[e, 0], corners[e, 1])
            if a < 0 or b < 0 or a == b or radius > farthest[i] or filled == k:
                continue
            out_triangles[i, filled, 0] = i
            out_triangles[i, filled, 1] = near[i, a]
            out_triangles[i, filled, 2] = near[i, b]
            out_radii[i, filled] = radius
            filled += 1
