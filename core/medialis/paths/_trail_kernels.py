"""Kernels that walk over a surface beside a path that is known (see _geodesic_kernels.py).

A trail is some places along a locally shortest path: where they lie, which way is across the path
on the surface, and how far along the path they are. A pair close by moves them with its ends and
walks towards one after the other, in the plane through the next one that is as good as at right
angles to the way across. The faces that it crosses are nearly those of its own locally shortest
path. Planes through both ends miss it, since paths bend sideways.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis.paths._plane_kernels import dot, way_out, way_towards
from medialis.paths._straightening_kernels import place_on

PLACES = 8
"""Of a trail; paths that cross hardly more half-edges have none."""

SPAN = 3
"""Half-edges over which the direction of a path is taken."""


@kernel
def _across(normals, ends, k, there, place):
    """Write the unit vector across a path from one place to another at half-edge k; False: none."""
    u, v, w = place[0] - there[0], place[1] - there[1], place[2] - there[2]
    left, right = ends[0, k], ends[1, k]
    p = normals[left, 0] + normals[right, 0]
    q = normals[left, 1] + normals[right, 1]
    r = normals[left, 2] + normals[right, 2]
    x, y, z = q * w - r * v, r * u - p * w, p * v - q * u
    size = math.sqrt(x * x + y * y + z * z)
    if size > 0.0:
        place[3], place[4], place[5] = x / size, y / size, z / size
    return size > 0.0


@kernel
def write_trail(points, normals, room, trail):
    """Write the trail of the path that was straightened last; False if that is too short for it.

    A row holds a place, the unit vector across, and how long the path is to there, which needs to
    be known to an edge length or so: it is that to the middle of the half-edge.
    """
    ends, flat, near, last = room[1], room[2], room[4], room[5]
    count, bends, number = last[0], last[1], len(trail)
    if count <= number + 1:
        return False
    bend, x, y, length, there = 0, 0.0, 0.0, 0.0, np.empty(3)
    for i in range(number):
        k = (i + 1) * count // (number + 1)
        while bend < bends and ends[2, bend] < k:
            at, row = ends[2, bend], 2 * ends[3, bend]
            length += math.sqrt((flat[row, at] - x) ** 2 + (flat[row + 1, at] - y) ** 2)
            x, y = flat[row, at], flat[row + 1, at]
            bend += 1
        ahead_x, ahead_y = near[2, 0] - x, near[2, 1] - y
        if bend < bends:
            at, row = ends[2, bend], 2 * ends[3, bend]
            ahead_x, ahead_y = flat[row, at] - x, flat[row + 1, at] - y
        size = math.sqrt(ahead_x * ahead_x + ahead_y * ahead_y)
        if size == 0.0:
            return False
        place_on(points, ends, flat, k, x, y, ahead_x, ahead_y, trail[i])
        place_on(points, ends, flat, max(k - SPAN, 0), x, y, ahead_x, ahead_y, there)
        if not _across(normals, ends, k, there, trail[i]):
            return False
        middle_x, middle_y = flat[0, k] + flat[2, k], flat[1, k] + flat[3, k]
        along = (0.5 * middle_x - x) * ahead_x + (0.5 * middle_y - y) * ahead_y
        trail[i, 6] = length + along / size
    return True


@kernel
def _aim(points, trail, moved, end, number, x, y, z, plane):
    """Write the normal of the plane from (x, y, z) to a place of a trail; False: already there."""
    before, after = max(number - 1, 0), min(number, PLACES - 1)
    share = (number + 1.0) / (PLACES + 1.0)
    u, v, w = points[end, 0] - x, points[end, 1] - y, points[end, 2] - z
    if number < PLACES:
        u = trail[number, 0] + (1.0 - share) * moved[0, 0] + share * moved[1, 0] - x
        v = trail[number, 1] + (1.0 - share) * moved[0, 1] + share * moved[1, 1] - y
        w = trail[number, 2] + (1.0 - share) * moved[0, 2] + share * moved[1, 2] - z
    size = u * u + v * v + w * w
    if size == 0.0:
        return False
    for a in range(3):
        plane[a] = trail[before, 3 + a] + trail[after, 3 + a]
    along = (plane[0] * u + plane[1] * v + plane[2] * w) / size
    plane[0] -= along * u
    plane[1] -= along * v
    plane[2] -= along * w
    return True


@kernel
def walk_beside(
    points, corners, twins, fan_offsets, fan, start, end, trail, moved, slope, limit, strip
):  # fmt: skip
    """Length of the path between two vertices that follows a trail, and how much it crosses.

    The half-edges go to `strip`. `moved` tells how far both ends are from those of the trail,
    `slope` in which direction that begins. The length is inf where the path does not arrive before
    the limit.
    """
    plane, number = np.empty(3), 0
    x, y, z = points[start, 0], points[start, 1], points[start, 2]
    if not _aim(points, trail, moved, end, 0, x, y, z, plane):
        return math.inf, 0
    way = way_towards(points, corners, fan_offsets, fan, start, plane, slope)
    if way < 0:
        return math.inf, 0
    h, px, py, pz = way_out(points, corners, way, plane, dot(plane, points[start]))
    length = math.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
    x, y, z = px, py, pz
    a = corners[h]
    b = corners[h - 2 if h % 3 == 2 else h + 1]
    nx, ny, nz = plane[0], plane[1], plane[2]
    offset = nx * x + ny * y + nz * z
    da = nx * points[a, 0] + ny * points[a, 1] + nz * points[a, 2] - offset
    db = nx * points[b, 0] + ny * points[b, 1] + nz * points[b, 2] - offset
    if (da >= 0.0) == (db >= 0.0):
        return math.inf, 0
    for count in range(len(strip)):
        strip[count] = h
        t = twins[h]
        if t < 0 or length >= limit:
            return math.inf, 0
        j = t % 3
        after = t - 2 if j == 2 else t + 1
        before = t + 2 if j == 0 else t - 1
        c = corners[before]
        if c == end:
            u, v, w = points[end, 0] - x, points[end, 1] - y, points[end, 2] - z
            return length + math.sqrt(u * u + v * v + w * w), count + 1
        if c == start:
            return math.inf, 0
        if corners[t] != a:
            a, b, da, db = b, a, db, da
        dc = nx * points[c, 0] + ny * points[c, 1] + nz * points[c, 2] - offset
        if (dc >= 0.0) == (da >= 0.0):
            h, a, da = after, b, db
            b, db = c, dc
        else:
            h, b, db = before, a, da
            a, da = c, dc
        share = da / (da - db)
        qx = points[a, 0] + share * (points[b, 0] - points[a, 0])
        qy = points[a, 1] + share * (points[b, 1] - points[a, 1])
        qz = points[a, 2] + share * (points[b, 2] - points[a, 2])
        length += math.sqrt((qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2)
        x, y, z = qx, qy, qz
        if number < PLACES and length >= trail[number, 6]:
            number += 1
            if not _aim(points, trail, moved, end, number, x, y, z, plane):
                return math.inf, 0
            nx, ny, nz = plane[0], plane[1], plane[2]
            offset = nx * x + ny * y + nz * z
            da = nx * points[a, 0] + ny * points[a, 1] + nz * points[a, 2] - offset
            db = nx * points[b, 0] + ny * points[b, 1] + nz * points[b, 2] - offset
            if (da >= 0.0) == (db >= 0.0):
                return math.inf, 0
    return math.inf, 0
