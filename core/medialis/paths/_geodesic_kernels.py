"""Kernels of shortest straightest geodesics (thesis 3.3.1-3.3.2; see geodesics.py).

Strategy. A plane through the end points s and e cuts the surface in a curve; walking along it from
s, triangle by triangle, costs one dot product a step: the plane distance of the one new vertex
tells through which edge the curve leaves. Of many planes round the line s-e the shortest cut wins.

Half-edges: number 3 f + j is the side of face f from corner j to corner j + 1; `twins` gives the
half-edge of the other face, -1 at a border or where three or more faces meet (a path ends there).

Sign rule: a vertex on the plane counts as above (distance >= 0). So every triangle is cut in no
or two sides, a path has one continuation, and no path is lost or counted twice. A plane cuts a
triangle in one segment, so a path visits a face at most once: m steps are the bound.

Admissible bound: a path is dropped as soon as its length plus the straight line to e reaches the
best length so far. What is dropped could not have won. Before there is a best length, a limit that
doubles until a path arrives stands in for it: else the wrong way round a large shape would be
walked to its end. The caller says how long paths may be: a pair without a shorter one stays open.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

NONE, PLANE, EDGES = 0, 1, 2  # how a length was found
OPEN = -1  # no path is short enough, a longer one may arrive


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
def _shortest_on_plane(
    points, corners, twins, fan_offsets, fan, start, end, normal, best, out_first, out_last
):
    """Shortest path from start to end on one plane, over all ways out of the start vertex.

    Returns its length, or `best` when none is shorter (then the points next to the ends are kept),
    and the least length that a dropped path would have had (inf: none was dropped).
    """
    sx, sy, sz = points[start, 0], points[start, 1], points[start, 2]
    offset = normal[0] * sx + normal[1] * sy + normal[2] * sz
    nothing = np.empty(0, np.int64)
    last = np.empty(3)
    least = math.inf
    for i in range(fan_offsets[start], fan_offsets[start + 1]):
        across, x, y, z = way_out(points, corners, fan[i], normal, offset)
        if across < 0:
            continue
        first = math.sqrt((x - sx) ** 2 + (y - sy) ** 2 + (z - sz) ** 2)
        length, count = trace_plane(
            points, corners, twins, across, x, y, z, first, normal, offset, start, end, best,
            nothing, last,
        )  # fmt: skip
        if count < 0:
            least = min(least, length)
        elif length < best:
            best = length
            out_first[0], out_first[1], out_first[2] = x, y, z
            out_last[0], out_last[1], out_last[2] = last[0], last[1], last[2]
    return best, least


@kernel
def _is_edge(corners, fan_offsets, fan, start, end):
    for i in range(fan_offsets[start], fan_offsets[start + 1]):
        h = fan[i]
        after = h - 2 if h % 3 == 2 else h + 1
        before = h + 2 if h % 3 == 0 else h - 1
        if corners[after] == end or corners[before] == end:
            return True
    return False


@kernel
def _set_frame(points, normals, start, end, frame):
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
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _turn(frame, angle, out):
    """Plane normal at an angle in the frame."""
    for a in range(3):
        out[a] = math.cos(angle) * frame[0, a] + math.sin(angle) * frame[1, a]


@kernel
def _best_plane(
    points, corners, twins, fan_offsets, fan, start, end, frame, planes, halvings, likely,
    limit, longest, out_first, out_last,
):  # fmt: skip
    """Length and angle of the shortest path: evenly spread planes, then halving round the best.

    The planes are tried from number `likely` outwards, so that a good bound comes early; which one
    wins does not depend on it. Without a path shorter than `longest` the length is inf, and NaN if
    a longer one may arrive; `limit` is where the search for it begins.
    """
    normal = np.empty(3)
    step = math.pi / planes
    limit = min(limit, longest)
    while True:
        best, angle, least = limit, 0.0, math.inf
        for turn in range(planes):
            k = (turn + 1) // 2 if turn % 2 else -(turn // 2)  # 0, +1, -1, +2, -2, ...
            alpha = ((likely + k) % planes) * step
            _turn(frame, alpha, normal)
            found, dropped = _shortest_on_plane(
                points, corners, twins, fan_offsets, fan, start, end, normal, best,
                out_first, out_last,
            )  # fmt: skip
            least = min(least, dropped)
            if found < best:
                best, angle = found, alpha
        if best < limit:
            break
        if least == math.inf:
            return math.inf, angle
        if limit >= longest:
            return math.nan, angle
        while limit <= least:  # no path arrives before
            limit *= 2.0
        limit = min(limit, longest)
    for _ in range(halvings):
        step *= 0.5
        middle = angle
        for side in (-1.0, 1.0):
            _turn(frame, middle + side * step, normal)
            found, _ = _shortest_on_plane(
                points, corners, twins, fan_offsets, fan, start, end, normal, best,
                out_first, out_last,
            )  # fmt: skip
            if found < best:
                best, angle = found, middle + side * step
    return best, angle


@kernel
def trace_geodesics(
    begin, end_row, rows, limits, longest,
    points, normals, corners, twins, fan_offsets, fan, component,
    starts, ends, planes, halvings,
    out_length, out_start_tangent, out_end_tangent, out_normal, out_status,
):  # fmt: skip
    """Shortest straightest geodesics of the pairs rows[begin..end_row].

    They are looked for among paths of up to limits[row] first, then among longer ones, up to
    longest[row].
    """
    frame = np.empty((2, 3))
    first, last = np.empty(3), np.empty(3)
    old = np.zeros(3)  # plane normal that won for the previous pair
    has_old = False
    for r in range(begin, end_row):
        row = rows[r]
        start, end = starts[row], ends[row]
        out_length[row] = math.inf
        out_status[row] = NONE
        if start < 0 or end < 0:
            out_length[row] = math.nan
            continue
        if start == end:
            out_length[row] = 0.0
            out_status[row] = PLANE
            continue
        if component[start] != component[end]:
            continue
        if not _set_frame(points, normals, start, end, frame):
            out_length[row] = 0.0  # two vertices at the same place
            out_status[row] = PLANE
            continue
        if _is_edge(corners, fan_offsets, fan, start, end):
            best = 0.0
            for a in range(3):
                first[a], last[a] = points[end, a], points[start, a]
                best += (points[end, a] - points[start, a]) ** 2
            best = math.sqrt(best)
        else:
            likely = 0
            if has_old:
                u, w = _dot(old, frame[0]), _dot(old, frame[1])
                likely = round(math.atan2(w, u) * planes / math.pi) if u * u + w * w > 0.25 else 0
            best, angle = _best_plane(
                points, corners, twins, fan_offsets, fan, start, end, frame, planes, halvings,
                likely, limits[row], longest[row], first, last,
            )  # fmt: skip
            if math.isnan(best):
                best = math.inf
                out_status[row] = OPEN
            if best < math.inf:
                _turn(frame, angle, old)
                has_old = True
                for a in range(3):
                    out_normal[row, a] = old[a]
        if best == math.inf:
            continue
        out_length[row] = best
        out_status[row] = PLANE
        direction(points[start], first, out_start_tangent[row])
        direction(last, points[end], out_end_tangent[row])


@kernel
def direction(a, b, out):
    """Write the unit vector from a to b; nothing where they coincide."""
    size = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    if size > 0.0:
        for i in range(3):
            out[i] = (b[i] - a[i]) / size


@kernel
def record_cut(points, corners, twins, fan_offsets, fan, start, end, normal, out_sides):
    """Half-edges that the shortest path on one plane crosses; returns how many."""
    first, last = np.empty(3), np.empty(3)
    _shortest_on_plane(
        points, corners, twins, fan_offsets, fan, start, end, normal, np.inf, first, last
    )
    offset = _dot(normal, points[start])
    for i in range(fan_offsets[start], fan_offsets[start + 1]):
        across, x, y, z = way_out(points, corners, fan[i], normal, offset)
        if across < 0:
            continue
        if x == first[0] and y == first[1] and z == first[2]:
            _, count = trace_plane(
                points, corners, twins, across, x, y, z, 0.0, normal, offset, start, end, np.inf,
                out_sides, last,
            )  # fmt: skip
            return count
    return 0
