"""Kernels that find the shortest path in a strip of faces (see _shortening_kernels.py).

Unfolded into the plane, the strip between two vertices is a polygon with its ends at two corners.
The funnel algorithm (Lee and Preparata 1984) finds the shortest path inside in one sweep: the two
sides of the funnel are lines from the last bend to the left and right end of a half-edge; each
half-edge of the strip narrows it, until one side crosses the other and the path bends there.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def next_side(h):
    return h - 2 if h % 3 == 2 else h + 1


@kernel
def previous_side(h):
    return h + 2 if h % 3 == 0 else h - 1


@kernel
def angle_at(a, i, b, j, c, k):
    """Angle at point b[j] between a[i] and c[k]; rows are not views, which compile slowly."""
    ux, uy, uz = a[i, 0] - b[j, 0], a[i, 1] - b[j, 1], a[i, 2] - b[j, 2]
    wx, wy, wz = c[k, 0] - b[j, 0], c[k, 1] - b[j, 1], c[k, 2] - b[j, 2]
    x, y, z = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    return math.atan2(math.sqrt(x * x + y * y + z * z), ux * wx + uy * wy + uz * wz)


@kernel
def distance(points, i, j):
    total = 0.0
    for a in range(3):
        total += (points[j, a] - points[i, a]) ** 2
    return math.sqrt(total)


@kernel
def copy(values, count, out, at):
    """Copy the first values; a loop compiles ten times faster than slices do."""
    for k in range(count):
        out[at + k] = values[k]


@kernel
def _stop_at(v, points, out, line, count):
    """Write vertex v as an item with its place."""
    out[count] = -1 - v
    for a in range(3):
        line[count, a] = points[v, a]


@kernel
def _trim(corners, twins, start, goal, strip):
    """Shorten a strip in place: no way there and back, no half-edge at an end. Returns the range.

    What follows the last half-edge at the start begins in a face at the start.
    """
    count = 0
    for h in strip:
        if count > 0 and twins[strip[count - 1]] == h:
            count -= 1
        else:
            strip[count] = h
            count += 1
    begin = 0
    for k in range(count):
        if corners[strip[k]] == start or corners[next_side(strip[k])] == start:
            begin = k + 1
    for k in range(begin, count):
        if corners[strip[k]] == goal or corners[next_side(strip[k])] == goal:
            return begin, k
    return begin, count


@kernel
def _unfold(points, corners, twins, strip, vertex, flat, left, right):
    """Lay the faces of a strip into the plane.

    Node 0 is the start, the last one the goal; `vertex` and `flat` (m + 3) tell which vertex a node
    is and where it lies, `left` and `right` (m + 1) the nodes at both ends of each half-edge.
    """
    m = len(strip)
    h = strip[0]
    vertex[0], vertex[1], vertex[2] = corners[previous_side(h)], corners[h], corners[next_side(h)]
    far = distance(points, vertex[0], vertex[2])
    angle = angle_at(points, vertex[1], points, vertex[0], points, vertex[2])
    flat[0, 0], flat[0, 1] = 0.0, 0.0
    flat[1, 0], flat[1, 1] = distance(points, vertex[0], vertex[1]), 0.0
    flat[2, 0], flat[2, 1] = far * math.cos(angle), far * math.sin(angle)
    right[0], left[0] = 1, 2
    for k in range(m):
        t = twins[strip[k]]
        node = k + 3
        c = corners[previous_side(t)]
        vertex[node] = c
        r, l = right[k], left[k]  # noqa: E741
        ex, ey = flat[l, 0] - flat[r, 0], flat[l, 1] - flat[r, 1]
        size = math.sqrt(ex * ex + ey * ey)
        if size > 0.0:
            ex, ey = ex / size, ey / size
        angle = angle_at(points, vertex[l], points, vertex[r], points, c)
        far = distance(points, vertex[r], c)
        along, across = far * math.cos(angle), far * math.sin(angle)
        flat[node, 0] = flat[r, 0] + along * ex + across * ey
        flat[node, 1] = flat[r, 1] + along * ey - across * ex
        if k + 1 < m:
            keeps_first = strip[k + 1] == previous_side(
                t
            )  # runs from c to the corner that t leaves
            if keeps_first == (corners[t] == vertex[l]):
                right[k + 1], left[k + 1] = node, l
            else:
                right[k + 1], left[k + 1] = r, node
    right[m], left[m] = m + 2, m + 2


@kernel
def _area(flat, a, b, c):
    """Twice the area of a triangle of nodes, positive when c lies to the left of a to b."""
    return (flat[b, 0] - flat[a, 0]) * (flat[c, 1] - flat[a, 1]) - (
        flat[b, 1] - flat[a, 1]
    ) * (flat[c, 0] - flat[a, 0])  # fmt: skip


@kernel
def _funnel(flat, left, right, last, out):
    """Nodes at which the shortest path through an unfolded strip bends, start and goal included.

    The funnel opens on the first half-edge that does not end at its apex; `last` tells which one of
    each node precedes it. A side that crosses the other one makes that one's node the next apex.
    """
    count, apex = 0, 0
    while True:
        out[count] = apex
        count += 1
        k = last[apex] + 1
        l, r = left[k], right[k]  # noqa: E741
        turn = -1
        while turn < 0 and k + 1 < len(left):
            k += 1
            if right[k] != r and _area(flat, apex, r, right[k]) >= 0.0:
                if _area(flat, apex, l, right[k]) > 0.0:
                    turn = l
                    continue
                r = right[k]
            if left[k] != l and _area(flat, apex, l, left[k]) <= 0.0:
                if _area(flat, apex, r, left[k]) < 0.0:
                    turn = r
                    continue
                l = left[k]  # noqa: E741
        if turn < 0:
            out[count] = len(flat) - 1
            return count + 1
        apex = turn


@kernel
def _crossing(points, vertex, flat, left, right, k, a, b, line, count):
    """Where the line from node a to node b crosses half-edge k of the strip."""
    u, w = _area(flat, a, b, right[k]), _area(flat, a, b, left[k])
    share = u / (u - w) if u != w else 0.0
    share = min(max(share, 0.0), 1.0)
    p, q = vertex[right[k]], vertex[left[k]]
    for i in range(3):
        line[count, i] = points[p, i] + share * (points[q, i] - points[p, i])


@kernel
def tighten(points, corners, twins, items):
    """Shortest path in every strip of a path: its items and their places.

    They are no more than before: each bend takes the place of a half-edge that ends there.
    """
    out, line = np.empty(len(items), np.int64), np.empty((len(items), 3))
    _stop_at(-1 - items[0], points, out, line, 0)
    strip = np.empty(len(items), np.int64)
    count, i = 1, 0
    while i + 1 < len(items):
        stop = i + 1
        while items[stop] >= 0:
            stop += 1
        start, goal = -1 - out[count - 1], -1 - items[stop]
        copy(items[i + 1 :], stop - i - 1, strip, 0)
        begin, end = _trim(corners, twins, start, goal, strip[: stop - i - 1])
        i = stop
        if start == goal:
            continue
        m = end - begin
        if m > 0:
            vertex, flat = np.empty(m + 3, np.int64), np.empty((m + 3, 2))
            left, right = np.empty(m + 1, np.int64), np.empty(m + 1, np.int64)
            _unfold(points, corners, twins, strip[begin:end], vertex, flat, left, right)
            first, last = np.empty(m + 3, np.int64), np.empty(m + 3, np.int64)
            last[0] = -1
            for k in range(m, -1, -1):
                first[left[k]], first[right[k]] = k, k
            for k in range(m + 1):
                last[left[k]], last[right[k]] = k, k
            bends = np.empty(m + 2, np.int64)
            number = _funnel(flat, left, right, last, bends)
            for n in range(number - 1):
                a, b = bends[n], bends[n + 1]
                for k in range(last[a] + 1, first[b]):
                    out[count] = strip[begin + k]
                    _crossing(points, vertex, flat, left, right, k, a, b, line, count)
                    count += 1
                if n + 2 < number:
                    _stop_at(vertex[b], points, out, line, count)
                    count += 1
        _stop_at(goal, points, out, line, count)
        count += 1
    return out[:count], line[:count]
