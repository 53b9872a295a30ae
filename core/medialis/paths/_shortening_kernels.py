"""Kernels that shorten a path over a mesh to a locally shortest geodesic (see geodesics.py).

A path is a row of items: the vertices that it passes through, as -1 - vertex, and between them the
half-edges through which it leaves the faces that it crosses (its strip). Two steps alternate:

- **Tighten.** Between two vertices the path becomes the shortest one in its strip
  (_funnel_kernels.py). Where it bends, it passes through a vertex.
- **Reroute.** A vertex with less than pi between the ways in and out, measured through the faces on
  one side, is left out: these faces join the strips before and after it. The old path runs along
  the rim of the new strip, so the next one is shorter.

So no path becomes longer, no strip comes twice, and the search ends: at a path which is straight in
every strip and has at least pi, or a border, on both sides of every vertex. A half-edge without a
twin (border, non-manifold) is never crossed; paths may run along it. As in Xin and Wang 2007.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis.paths._funnel_kernels import (
    angle_at,
    copy,
    distance,
    next_side,
    previous_side,
    tighten,
)

STRAIGHT = math.pi - 1e-7  # cutting a corner of pi - a saves a^2 / 8 at most: 1e-15 of the length


@kernel
def _far(corners, h, v):
    """Return the other end of half-edge h at vertex v."""
    return corners[next_side(h)] if corners[h] == v else corners[h]


@kernel
def _length(line):
    total = 0.0
    for i in range(1, len(line)):
        total += distance(line, i - 1, i)
    return total


@kernel
def _sector(points, corners, twins, v, h, angle, leaving, ahead, line, i, best, out):
    """Walk round vertex v, from the face into which half-edge h at v leads, to the way out.

    The way out is through half-edge `leaving` at line[i + 1], or, where that is -1, along the edge
    to vertex `ahead`. Returns the angle, inf when it reaches `best` or a border comes first, how
    many half-edges are crossed (written to `out`), and the last face.
    """
    count = 0
    while True:
        if corners[h] == v:
            other, opposite = previous_side(h), next_side(h)
        else:
            other, opposite = next_side(h), previous_side(h)
        if leaving == opposite:
            angle += angle_at(points, _far(corners, h, v), points, v, line, i + 1)
            return (angle if angle < best else math.inf), count, h // 3
        far = _far(corners, other, v)
        angle += angle_at(points, _far(corners, h, v), points, v, points, far)
        if not angle < best:
            return math.inf, 0, -1
        if leaving < 0 and far == ahead:
            return angle, count, h // 3
        if twins[other] < 0 or count == len(out):
            return math.inf, 0, -1
        out[count] = other
        count += 1
        h = twins[other]


@kernel
def _smallest_sector(points, corners, twins, fan_offsets, fan, items, line, i, sector, out):
    """Find the side of item i, a vertex, with the smallest angle; inf when none is below pi.

    Returns the angle, how many half-edges that side crosses (in `out`), its first and last face.
    """
    v = -1 - items[i]
    leaving = items[i + 1] if items[i + 1] >= 0 else -1
    ahead = -1 if leaving >= 0 else -1 - items[i + 1]
    best, count, first, last = math.inf, 0, -1, -1
    limit = STRAIGHT
    sector = sector[: fan_offsets[v + 1] - fan_offsets[v] + 1]  # no face is walked through twice
    if items[i - 1] >= 0:  # out of a face: to both sides of it
        t = twins[items[i - 1]]
        for side in range(2):
            exit_edge = previous_side(t) if side == 0 else next_side(t)
            far = _far(corners, exit_edge, v)
            angle = angle_at(line, i - 1, points, v, points, far)
            found, crossed, face = math.inf, 0, t // 3
            if leaving == t:  # back into the face it came from
                found = angle_at(line, i - 1, points, v, line, i + 1)
            elif leaving < 0 and far == ahead:
                found = angle
            elif twins[exit_edge] >= 0:
                sector[0] = exit_edge
                found, crossed, face = _sector(
                    points, corners, twins, v, twins[exit_edge], angle, leaving, ahead, line, i,
                    limit, sector[1:],
                )  # fmt: skip
                crossed += 1
            if found < limit:
                best, limit, count, first, last = found, found, crossed, t // 3, face
                copy(sector, count, out, 0)
        return best, count, first, last
    behind = -1 - items[i - 1]
    for k in range(fan_offsets[v], fan_offsets[v + 1]):
        for side in range(2):
            h = fan[k] if side == 0 else previous_side(fan[k])
            if _far(corners, h, v) != behind:
                continue
            found, crossed, face = _sector(
                points, corners, twins, v, h, 0.0, leaving, ahead, line, i, limit, sector
            )
            if found < limit:
                best, limit, count, first, last = found, found, crossed, h // 3, face
                copy(sector, count, out, 0)
    return best, count, first, last


@kernel
def _reroute(points, corners, twins, fan_offsets, fan, items, line):
    """Leave out every vertex that has less than pi on one side; returns whether there was one."""
    room, widest = len(items), 0
    for item in items:
        if item < 0:
            size = fan_offsets[-item] - fan_offsets[-1 - item]
            room += size + 2
            widest = max(widest, size + 2)
    out, count, changed = np.empty(room, np.int64), 0, False
    sector, chosen = np.empty(widest, np.int64), np.empty(widest, np.int64)
    at_vertex, before = False, -1  # whether the item before was left out, and the last face there
    for i in range(len(items)):
        if items[i] < 0 and 0 < i < len(items) - 1:
            angle, crossed, first, last = _smallest_sector(
                points, corners, twins, fan_offsets, fan, items, line, i, sector, chosen
            )
            join = -1  # the edge to cross between two left-out vertices that it joins
            if angle < math.inf and at_vertex and before != first:
                u, v = -1 - items[i - 1], -1 - items[i]
                for h in range(3 * before, 3 * before + 3):
                    a, b = corners[h], corners[next_side(h)]
                    if ((a == u and b == v) or (a == v and b == u)) and twins[h] // 3 == first:
                        join = h
                if join < 0:
                    angle = math.inf
                else:
                    out[count] = join
                    count += 1
            if angle < math.inf:
                copy(chosen, crossed, out, count)
                count += crossed
                at_vertex, before, changed = True, last, True
                continue
        out[count] = items[i]
        count += 1
        at_vertex = False
    return out[:count], changed


@kernel
def shorten(points, corners, twins, fan_offsets, fan, items):
    """Shorten a path, given as items, until no vertex can be left out; returns its points."""
    items, line = tighten(points, corners, twins, items)
    length = _length(line)
    while True:
        wider, changed = _reroute(points, corners, twins, fan_offsets, fan, items, line)
        if not changed:
            return line
        items, shorter = tighten(points, corners, twins, wider)
        size = _length(shorter)
        if not size < length:
            return line
        line, length = shorter, size
