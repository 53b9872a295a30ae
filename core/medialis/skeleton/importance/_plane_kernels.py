"""Kernels that walk along a plane through two vertices (thesis 3.3.1-3.3.2; see geodesics.py).

A plane through the end points s and e cuts the surface in a curve; walking along it from s,
triangle by triangle, costs one dot product a step: the plane distance of the one new vertex tells
through which edge the curve leaves.

Half-edges: number 3 f + j is the side of face f from corner j to corner j + 1; `twins` gives the
half-edge of the other face, -1 at a border or where three or more faces meet (a path ends there).

Sign rule: a vertex on the plane counts as above (distance >= 0). So every triangle is cut in no
or two sides, a path has one continuation, and no path is lost or counted twice. A plane cuts a
triangle in one segment, so a path visits a face at most once: m steps are the bound.

Admissible bound: a path is dropped as soon as its length plus the straight line to e reaches the
best length so far. What is dropped could not have won.

**Strips.** `tighten` finds the shortest path in a strip of faces, for polylines
(_path_kernels.py). Unfolded into the plane, the strip between two vertices is a polygon with its
ends at two corners. The funnel algorithm (Lee and Preparata 1984) finds the shortest path inside in
one sweep: the two sides of the funnel are lines from the last bend to the left and right end of a
half-edge; each half-edge of the strip narrows it, until one side crosses the other and the path
bends there.
"""

from __future__ import annotations

import math

import numpy as np

from medialis.base.jit import kernel


@kernel
def trace_plane(
    points, corners, twins, h, x, y, z, length, normal, offset, start, end, best, out_sides, out
):  # fmt: skip
    """Walk along a plane from half-edge h, which the path leaves through at (x, y, z).

    Returns the length up to vertex `end`, or inf when it ends at a border or comes back, and the
    number of crossings. A path that is dropped has -1 crossings and a length that it would have
    had at least, not below `best`. `out` receives the last point before the end;
    `out_sides`, when it has room, the half-edges that the path leaves faces through.
    """
    ex, ey, ez = points[end, 0], points[end, 1], points[end, 2]
    count = 0
    nx, ny, nz = normal[0], normal[1], normal[2]
    a = corners[h]
    b = corners[h - 2 if h % 3 == 2 else h + 1]
    da = nx * points[a, 0] + ny * points[a, 1] + nz * points[a, 2] - offset
    db = nx * points[b, 0] + ny * points[b, 1] + nz * points[b, 2] - offset
    for _ in range(len(corners) // 3):
        if count < len(out_sides):
            out_sides[count] = h
        count += 1
        rest = math.sqrt((x - ex) ** 2 + (y - ey) ** 2 + (z - ez) ** 2)
        if length + rest >= best:
            return length + rest, -1
        t = twins[h]
        if t < 0:
            return math.inf, count
        j = t % 3
        after = t - 2 if j == 2 else t + 1
        before = t + 2 if j == 0 else t - 1
        c = corners[before]
        if c == end:
            out[0], out[1], out[2] = x, y, z
            return length + rest, count
        if c == start:  # once round without meeting the end: it lies on another piece of the cut
            return math.inf, count
        if corners[t] != a:  # neighbours that agree run along their edge in opposite directions
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
    return math.inf, count


@kernel
def way_out(points, corners, h, normal, offset):
    """Where a plane through the vertex that half-edge h leaves cuts the side across.

    Returns the half-edge of that side, -1 when it is not cut, and the point.
    """
    across = h - 2 if h % 3 == 2 else h + 1
    a = corners[across]
    b = corners[across - 2 if across % 3 == 2 else across + 1]
    da = normal[0] * points[a, 0] + normal[1] * points[a, 1] + normal[2] * points[a, 2] - offset
    db = normal[0] * points[b, 0] + normal[1] * points[b, 1] + normal[2] * points[b, 2] - offset
    if (da >= 0.0) == (db >= 0.0):
        return -1, 0.0, 0.0, 0.0
    share = da / (da - db)
    x = points[a, 0] + share * (points[b, 0] - points[a, 0])
    y = points[a, 1] + share * (points[b, 1] - points[a, 1])
    z = points[a, 2] + share * (points[b, 2] - points[a, 2])
    return across, x, y, z


@kernel
def is_edge(corners, fan_offsets, fan, start, end):
    for i in range(fan_offsets[start], fan_offsets[start + 1]):
        h = fan[i]
        after = h - 2 if h % 3 == 2 else h + 1
        before = h + 2 if h % 3 == 0 else h - 1
        if corners[after] == end or corners[before] == end:
            return True
    return False


@kernel
def set_frame(points, normals, start, end, frame):
    """Rows: the plane normal to begin with, and the one at right angles to it; both normal to f.

    The geodesic between the feature points of a ball runs close to the plane of the two surface
    normals; where these are opposite, any plane through the end points will do.
    """
    fx = points[end, 0] - points[start, 0]
    fy = points[end, 1] - points[start, 1]
    fz = points[end, 2] - points[start, 2]
    length = math.sqrt(fx * fx + fy * fy + fz * fz)
    if length == 0.0:
        return False
    fx, fy, fz = fx / length, fy / length, fz / length
    mx = normals[start, 0] + normals[end, 0]
    my = normals[start, 1] + normals[end, 1]
    mz = normals[start, 2] + normals[end, 2]
    ux, uy, uz = fy * mz - fz * my, fz * mx - fx * mz, fx * my - fy * mx
    size = math.sqrt(ux * ux + uy * uy + uz * uz)
    if size < 1e-6:  # the axis that f is least aligned with
        if abs(fx) <= abs(fy) and abs(fx) <= abs(fz):
            ux, uy, uz = 0.0, fz, -fy
        elif abs(fy) <= abs(fz):
            ux, uy, uz = -fz, 0.0, fx
        else:
            ux, uy, uz = fy, -fx, 0.0
        size = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / size, uy / size, uz / size
    frame[0, 0], frame[0, 1], frame[0, 2] = ux, uy, uz
    frame[1, 0], frame[1, 1], frame[1, 2] = fy * uz - fz * uy, fz * ux - fx * uz, fx * uy - fy * ux
    return True


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def turn(frame, angle, out):
    """Plane normal at an angle in the frame."""
    for a in range(3):
        out[a] = math.cos(angle) * frame[0, a] + math.sin(angle) * frame[1, a]


@kernel
def direction(a, b, out):
    """Write the unit vector from a to b; nothing where they coincide."""
    size = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    if size > 0.0:
        for i in range(3):
            out[i] = (b[i] - a[i]) / size


@kernel
def way_towards(points, corners, fan_offsets, fan, start, normal, ahead):
    """Half-edge through whose face a plane leaves the start most in a direction, or -1."""
    offset, most, chosen = dot(normal, points[start]), -2.0, -1
    for k in range(fan_offsets[start], fan_offsets[start + 1]):
        across, x, y, z = way_out(points, corners, fan[k], normal, offset)
        if across < 0:
            continue
        x, y, z = x - points[start, 0], y - points[start, 1], z - points[start, 2]
        size = math.sqrt(x * x + y * y + z * z)
        along = x * ahead[0] + y * ahead[1] + z * ahead[2]
        if size > 0.0 and along > most * size:
            most, chosen = along / size, fan[k]
    return chosen


@kernel
def cut_from(points, corners, twins, h, start, end, normal, best, strip, near):
    """Length of the path on a plane that leaves the start through the face of half-edge h.

    Returns also the number of half-edges that it crosses, which go to `strip`: -1 where it is
    dropped (see `trace_plane`). `near` receives its points next to both ends. Where the plane does
    not cut that face the length is inf.
    """
    offset = dot(normal, points[start])
    across, x, y, z = way_out(points, corners, h, normal, offset)
    if across < 0:
        return math.inf, 0
    near[0, 0], near[0, 1], near[0, 2] = x, y, z
    first = 0.0
    for i in range(3):
        first += (near[0, i] - points[start, i]) ** 2
    return trace_plane(
        points, corners, twins, across, x, y, z, math.sqrt(first), normal, offset, start, end, best,
        strip, near[1],
    )  # fmt: skip


@kernel
def record_cut(points, corners, twins, fan_offsets, fan, start, end, normal, out_sides):
    """Half-edges that the shortest path on one plane crosses; returns how many."""
    nothing, near = np.empty(0, np.int64), np.empty((2, 3))
    best, way = np.inf, -1
    for i in range(fan_offsets[start], fan_offsets[start + 1]):
        length, count = cut_from(
            points, corners, twins, fan[i], start, end, normal, best, nothing, near
        )
        if count >= 0 and length < best:
            best, way = length, fan[i]
    if way < 0:
        return 0
    return cut_from(points, corners, twins, way, start, end, normal, np.inf, out_sides, near)[1]


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
