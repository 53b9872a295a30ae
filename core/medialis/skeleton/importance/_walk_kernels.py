"""Kernels that walk over a mesh along planes and edges (thesis 3.3.1-3.3.2; see geodesics.py).

**Planes.** A plane through the end points s and e cuts the surface in a curve; walking along it
from s, triangle by triangle, costs one dot product a step: the plane distance of the one new vertex
tells through which edge the curve leaves.

Half-edges: number 3 f + j is the side of face f from corner j to corner j + 1; `twins` gives the
half-edge of the other face, -1 at a border or where three or more faces meet (a path ends there).

Sign rule: a vertex on the plane counts as above (distance >= 0). So every triangle is cut in no
or two sides, a path has one continuation, and no path is lost or counted twice. A plane cuts a
triangle in one segment, so a path visits a face at most once: m steps are the bound.

Admissible bound: a path is dropped as soon as its length plus the straight line to e reaches the
best length so far. What is dropped could not have won.

**Edges.** A* with the straight line to the end as the estimate, which never exceeds what remains.
The queue is a binary heap in two arrays; a vertex may stand in it several times, only its first
removal counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import next_side, previous_side
from medialis.base.jit import kernel

OPPOSITE = 1e-6
"""Sine: where the normals of both ends have less left across the line between them, any plane
through them will do."""

SURELY = 1.0 - 1e-14
"""Share of the best length below which a path is shorter whatever rounding does: no square root."""

NONE, PLANE, EDGES = 0, 1, 2
"""How a length was found."""


class Walk(NamedTuple):
    """A mesh to walk over.

    Attributes
    ----------
    points : (n, 3) float64
    corners : (3m,) int32
        Vertex that each half-edge leaves.
    twins : (3m,) int32
        Half-edge of the other face, -1: none.
    offsets, fan : (n + 1,) int64 and (3m,) int32
        The half-edges that leave vertex v are fan[offsets[v]:offsets[v + 1]].
    """

    points: NDArray[np.float64]
    corners: NDArray[np.int32]
    twins: NDArray[np.int32]
    offsets: NDArray[np.int64]
    fan: NDArray[np.int32]


class Paths(NamedTuple):
    """What is found for k pairs.

    Attributes
    ----------
    length : (k,) float64
    start_tangent, end_tangent : (k, 3) float64
    normal : (k, 3) float64
        Of the plane of the shortest cut; NaN: there is none, or an edge. (0, 3) where pairs follow
        others: nobody asks.
    status : (k,) int8
    """

    length: NDArray[np.float64]
    start_tangent: NDArray[np.float64]
    end_tangent: NDArray[np.float64]
    normal: NDArray[np.float64]
    status: NDArray[np.int8]


@kernel
def sure(i):
    """Return an index that is known not to be negative: no code counts it from the end.

    In the innermost loops here that is a third of all instructions.
    """
    return i & 0x7FFFFFFF


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def on_plane(points, a, b, da, db):
    """Where the edge from vertex a to b is cut by a plane at these distances from its ends."""
    share = da / (da - db)
    x = points[a, 0] + share * (points[b, 0] - points[a, 0])
    y = points[a, 1] + share * (points[b, 1] - points[a, 1])
    z = points[a, 2] + share * (points[b, 2] - points[a, 2])
    return x, y, z


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
    a, b = sure(corners[h]), sure(corners[next_side(h)])
    da = nx * points[a, 0] + ny * points[a, 1] + nz * points[a, 2] - offset
    db = nx * points[b, 0] + ny * points[b, 1] + nz * points[b, 2] - offset
    shorter = SURELY * best
    for _ in range(len(corners) // 3):
        if count < len(out_sides):
            out_sides[count] = h
        count += 1
        left, square = shorter - length, (x - ex) ** 2 + (y - ey) ** 2 + (z - ez) ** 2
        if left <= 0.0 or square >= left * left:
            rest = math.sqrt(square)
            if length + rest >= best:
                return length + rest, -1
        t = twins[h]
        if t < 0:
            return math.inf, count
        j = t % 3  # once for both neighbours: the innermost loop
        after = t - 2 if j == 2 else t + 1
        before = t + 2 if j == 0 else t - 1
        c = sure(corners[sure(before)])
        if c == end:
            out[0], out[1], out[2] = x, y, z
            return length + math.sqrt(square), count
        if c == start:  # once round without meeting the end: it lies on another piece of the cut
            return math.inf, count
        if corners[t] != a:  # neighbours that agree run along their edge in opposite directions
            a, b, da, db = b, a, db, da
        dc = nx * points[c, 0] + ny * points[c, 1] + nz * points[c, 2] - offset
        if (dc >= 0.0) == (da >= 0.0):
            h, a, da = sure(after), b, db
            b, db = c, dc
        else:
            h, b, db = sure(before), a, da
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
    across = next_side(h)
    a, b = corners[across], corners[next_side(across)]
    da, db = dot(normal, points[a]) - offset, dot(normal, points[b]) - offset
    if (da >= 0.0) == (db >= 0.0):
        return -1, 0.0, 0.0, 0.0
    x, y, z = on_plane(points, a, b, da, db)
    return across, x, y, z


@kernel
def is_edge(walk, start, end):
    corners = walk.corners
    for i in range(walk.offsets[start], walk.offsets[start + 1]):
        h = walk.fan[i]
        if corners[next_side(h)] == end or corners[previous_side(h)] == end:
            return True
    return False


@kernel
def set_frame(points, normals, start, end, frame):
    """Rows: the plane normal to begin with, and the one at right angles to it; both normal to f.

    The geodesic between the feature points of a ball runs close to the plane of the two surface
    normals; where these are opposite, any plane through the end points will do.
    """
    f, across = np.empty(3), np.empty(3)
    for a in range(3):
        f[a] = points[end, a] - points[start, a]
        across[a] = normals[start, a] + normals[end, a]
    length = math.sqrt(dot(f, f))
    if length == 0.0:
        return False
    for a in range(3):
        f[a] /= length
    first, second = frame[0], frame[1]
    cross(f, across, first)
    size = math.sqrt(dot(first, first))
    if size < OPPOSITE:  # the axis that f is least aligned with
        x, y, z = abs(f[0]), abs(f[1]), abs(f[2])
        across[:] = 0.0
        across[0 if x <= y and x <= z else (1 if y <= z else 2)] = 1.0
        cross(f, across, first)
        size = math.sqrt(dot(first, first))
    for a in range(3):
        first[a] /= size
    cross(f, first, second)
    return True


@kernel
def cross(a, b, out):
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = a[j] * b[k] - a[k] * b[j]


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
def way_towards(walk, start, normal, ahead):
    """Half-edge through whose face a plane leaves the start most in a direction, or -1."""
    points, fan = walk.points, walk.fan
    offset, most, chosen = dot(normal, points[start]), -2.0, -1
    for k in range(walk.offsets[start], walk.offsets[start + 1]):
        across, x, y, z = way_out(points, walk.corners, fan[k], normal, offset)
        if across < 0:
            continue
        x, y, z = x - points[start, 0], y - points[start, 1], z - points[start, 2]
        size = math.sqrt(x * x + y * y + z * z)
        along = x * ahead[0] + y * ahead[1] + z * ahead[2]
        if size > 0.0 and along > most * size:
            most, chosen = along / size, fan[k]
    return chosen


@kernel
def cut_from(walk, h, start, end, normal, best, strip, near):
    """Length of the path on a plane that leaves the start through the face of half-edge h.

    Returns also the number of half-edges that it crosses, which go to `strip`: -1 where it is
    dropped (see `trace_plane`). `near` receives its points next to both ends. Where the plane does
    not cut that face the length is inf.
    """
    points, corners = walk.points, walk.corners
    offset = dot(normal, points[start])
    across, x, y, z = way_out(points, corners, h, normal, offset)
    if across < 0:
        return math.inf, 0
    near[0, 0], near[0, 1], near[0, 2] = x, y, z
    first = 0.0
    for i in range(3):
        first += (near[0, i] - points[start, i]) ** 2
    return trace_plane(
        points, corners, walk.twins, across, x, y, z, math.sqrt(first), normal, offset, start, end,
        best, strip, near[1],
    )  # fmt: skip


@kernel
def record_cut(walk, start, end, normal, out_sides):
    """Half-edges that the shortest path on one plane crosses; returns how many."""
    nothing, near = np.empty(0, np.int64), np.empty((2, 3))
    best, way = np.inf, -1
    for i in range(walk.offsets[start], walk.offsets[start + 1]):
        h = walk.fan[i]
        length, count = cut_from(walk, h, start, end, normal, best, nothing, near)
        if count >= 0 and length < best:
            best, way = length, h
    if way < 0:
        return 0
    return cut_from(walk, way, start, end, normal, np.inf, out_sides, near)[1]


@kernel
def distance(points, i, j):
    total = 0.0
    for a in range(3):
        total += (points[j, a] - points[i, a]) ** 2
    return math.sqrt(total)


@kernel
def _sift_up(key, item, i):
    while i > 0:
        up = (i - 1) // 2
        if key[up] <= key[i]:
            break
        key[up], key[i] = key[i], key[up]
        item[up], item[i] = item[i], item[up]
        i = up


@kernel
def _sift_down(key, item, size):
    i = 0
    while True:
        low = 2 * i + 1
        if low >= size:
            break
        if low + 1 < size and key[low + 1] < key[low]:
            low += 1
        if key[i] <= key[low]:
            break
        key[low], key[i] = key[i], key[low]
        item[low], item[i] = item[i], item[low]
        i = low


@kernel
def _over(points, v, a, b, w):
    """Straight way from v over the edge a-b to w, its two faces unfolded; inf when it misses it."""
    size = distance(points, a, b)
    if size == 0.0:
        return math.inf
    along_v, along_w, vv, ww = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        e = (points[b, i] - points[a, i]) / size
        to_v, to_w = points[v, i] - points[a, i], points[w, i] - points[a, i]
        along_v, along_w = along_v + e * to_v, along_w + e * to_w
        vv, ww = vv + to_v * to_v, ww + to_w * to_w
    high_v = math.sqrt(max(vv - along_v * along_v, 0.0))
    high_w = math.sqrt(max(ww - along_w * along_w, 0.0))
    at = along_v * high_w + along_w * high_v
    if not 0.0 < at < size * (high_v + high_w):
        return math.inf
    return math.sqrt((along_w - along_v) ** 2 + (high_v + high_w) ** 2)


@kernel
def over_edges(walk, out_ends, out_length):
    """Straight ways over edges, from a vertex to that across; returns how many there are."""
    corners, count = walk.corners, 0
    for h in range(len(corners)):
        t = walk.twins[h]
        if t < h:
            continue
        v, w = corners[previous_side(h)], corners[previous_side(t)]
        size = _over(walk.points, v, corners[h], corners[next_side(h)], w)
        if v != w and size < math.inf:
            out_ends[count, 0], out_ends[count, 1], out_length[count] = v, w, size
            count += 1
    return count


class _Search(NamedTuple):
    """Where a search along edges is; `reached` and `settled` tell in which one a vertex was."""

    length: NDArray[np.float64]
    parent: NDArray[np.int64]
    reached: NDArray[np.int64]
    settled: NDArray[np.int64]


@kernel
def _new_search(n):
    # Numbers of searches save clearing n entries for each of them.
    search = _Search(np.empty(n), np.empty(n, np.int64), np.full(n, -1), np.full(n, -1))
    return search, (np.empty(1024), np.empty(1024, np.int64))


@kernel
def _look(walk, over, start, end, r, most, search, heap):
    """Search number r: fills the lengths and parents of the vertices reached, returns the queue.

    With `over` also straight over half-edges h to the vertex across, whose parent is then -2 - h.
    The queue holds at most one entry for each improvement of a vertex; it grows by doubling. A
    vertex is settled once, so a search ends after at most n of them; it is given up after `most`,
    and then the end is not settled.
    """
    points, corners, twins, offsets, fan = walk
    length, parent, reached, settled = search
    key, item = heap
    length[start] = 0.0
    reached[start] = r
    parent[start] = -1
    key[0], item[0] = 0.0, start
    size = 1
    while size > 0:
        v = item[0]
        size -= 1
        key[0], item[0] = key[size], item[size]
        _sift_down(key, item, size)
        if settled[v] == r:
            continue
        settled[v] = r
        most -= 1
        if v == end or most < 0:
            break
        for i in range(offsets[v], offsets[v + 1]):
            after, before = next_side(fan[i]), previous_side(fan[i])
            for turn in range(3 if over else 2):
                if turn < 2:
                    w = corners[after if turn == 0 else before]
                else:
                    if twins[after] < 0:
                        continue
                    w = corners[previous_side(twins[after])]
                if settled[w] == r:
                    continue
                if turn < 2:
                    new = length[v] + distance(points, v, w)
                else:
                    new = length[v] + _over(points, v, corners[after], corners[before], w)
                if (reached[w] != r or new < length[w]) and new < math.inf:
                    reached[w] = r
                    length[w] = new
                    parent[w] = v if turn < 2 else -2 - after
                    if size == len(key):
                        key = np.concatenate((key, np.empty_like(key)))
                        item = np.concatenate((item, np.empty_like(item)))
                    key[size], item[size] = new + distance(points, end, w), w
                    size += 1
                    _sift_up(key, item, size - 1)
    return key, item


@kernel
def edge_paths(begin, stop, rows, most, walk, ends, out):
    """Shortest paths along the edges (A*), an upper bound, for the pairs rows[begin..stop].

    A search that settles more than `most` vertices is given up: its pair stays as it is. So does
    one that has a path as short.
    """
    points = walk.points
    search, heap = _new_search(len(points))
    length, parent = search.length, search.parent
    for r in range(begin, stop):
        row = rows[r]
        start, end = ends[row, 0], ends[row, 1]
        heap = _look(walk, False, start, end, r, most, search, heap)
        if search.settled[end] != r or not length[end] < out.length[row]:
            continue
        out.length[row] = length[end]
        out.status[row] = EDGES
        v = end
        direction(points[parent[v]], points[v], out.end_tangent[row])
        while parent[v] != start:
            v = parent[v]
        direction(points[start], points[v], out.start_tangent[row])


@kernel
def short_path(walk, start, end):
    """Shortest path along edges and straight over single edges, as items (see `shorten`).

    These are twice as many directions as the edges have: on a mesh of equilateral triangles it is
    at most 1 / cos(15 degrees), 4 %, too long, not 15 %. Both ends lie in one component.
    """
    n = len(walk.points)
    search, heap = _new_search(n)
    _look(walk, True, start, end, 0, n, search, heap)
    path = np.empty(2 * n, np.int64)
    k, v, parent = len(path), end, search.parent
    while v != start:
        k -= 1
        path[k] = -1 - v
        if parent[v] < 0:  # half-edge -2 - parent, opposite to the vertex before
            h = -2 - parent[v]
            k -= 1
            path[k] = h
            v = walk.corners[previous_side(h)]
        else:
            v = parent[v]
    k -= 1
    path[k] = -1 - start
    return path[k:]


@kernel
def trim(walk, start, end, strip, count):
    """Shorten a strip in place: no way there and back, no half-edge at an end. Returns the range.

    What follows the last half-edge at the start begins in a face at the start.
    """
    corners, kept = walk.corners, 0
    for k in range(count):
        if kept > 0 and walk.twins[strip[kept - 1]] == strip[k]:
            kept -= 1
        else:
            strip[kept] = strip[k]
            kept += 1
    begin = 0
    for k in range(kept):
        if corners[strip[k]] == start or corners[next_side(strip[k])] == start:
            begin = k + 1
    for k in range(begin, kept):
        if corners[strip[k]] == end or corners[next_side(strip[k])] == end:
            return begin, k
    return begin, kept
