"""Kernels that shorten a plane cut to a locally shortest path, and walk beside one that is known.

**Straighten** (thesis 3.3.2; see geodesics.py). A path is the strip of half-edges through which it
leaves the faces that it crosses. Two steps alternate. Tighten: the strip is laid into the plane,
where the funnel algorithm (Lee and Preparata 1984) finds the shortest path between its sides; it
bends at vertices. Reroute: where less than pi lies on the other side of such a vertex, the strip
goes round it on that side. Angles are products of complex numbers, which take no arc tangents.
Shortening ends where no vertex is left out or a round gains less than LEAST_GAIN. This is what
`_path_kernels.shorten` does for polylines, which may pass through vertices, at a tenth of its cost:
paths here begin as plane cuts, which cross edges only.

**Walk beside** (see _geodesic_kernels.py). A trail is some places along a locally shortest path:
where they lie, which way is across the path on the surface, and how far along the path they are. A
pair close by moves them with its ends and walks towards one after the other, in the plane through
the next one that is as good as at right angles to the way across. The faces that it crosses are
nearly those of its own locally shortest path. Planes through both ends miss it, since paths bend
sideways.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import next_side, previous_side
from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import (
    dot,
    on_plane,
    sure,
    trim,
    way_out,
    way_towards,
)

LONGEST_STRIP = 16384
"""Half-edges of the longest strip that is shortened."""

WIDEST = 256
"""Half-edges that a path may cross round a vertex."""

LEAST_GAIN = 2e-5
"""Share of its length that a round must gain for another one."""

MOST_ROUNDS = 16
"""Of shortening, at most."""

BENT_BY = 0.01
"""Radians by which the other side of a vertex must have less than pi. Leaving one out that has more
gains less than a^2 / 8 of the length."""

PLACES = 8
"""Of a trail; paths that cross hardly more half-edges have none."""

SPAN = 3
"""Half-edges over which the direction of a path is taken."""

ACROSS, FAR = 3, 6
"""Columns of a trail, (PLACES, 7): behind the place the unit vector across, and how far along."""


class Room(NamedTuple):
    """The arrays that `straighten` works in, and what it leaves there of a path.

    Attributes
    ----------
    strips : (2, s) int64
        Half-edges that a path crosses; the first row is given.
    ends : (s, 2) int64
        Vertex at the left and at the right end of each half-edge of the strip.
    flat : (s, 4) float64
        Place in the plane of both these ends: x, x, y, y.
    side : (s,) int64
        Which of them the half-edge before does not have: 0 left, 1 right.
    bends : (2, s) int64
        At which half-edge the path bends and at which end: 0 left, 1 right.
    tips, at : (2, 2) float64 and (2,) int64
        Of the left and the right side of the funnel: from its apex, and at which half-edge first;
        the left one is turned round, so that both see the same side as the inside.
    turned : (w,) int64
        Half-edges round a vertex.
    near : (3, 3) float64
        Points next to the start and to the end of the path, and the place of its end in the plane.
    last : (2,) int64
        How many half-edges it crosses, and how often it bends.
    """

    strips: NDArray[np.int64]
    ends: NDArray[np.int64]
    flat: NDArray[np.float64]
    side: NDArray[np.int64]
    bends: NDArray[np.int64]
    tips: NDArray[np.float64]
    at: NDArray[np.int64]
    turned: NDArray[np.int64]
    near: NDArray[np.float64]
    last: NDArray[np.int64]


@kernel
def make_room(faces):
    size = min(faces + 1, LONGEST_STRIP)
    strips, bends = np.empty((2, size), np.int64), np.empty((2, size), np.int64)
    ends, side = np.empty((size, 2), np.int64), np.zeros(size, np.int64)
    turned, last = np.empty(WIDEST, np.int64), np.zeros(2, np.int64)
    flat, tips, near = np.empty((size, 4)), np.empty((2, 2)), np.empty((3, 3))
    at = np.empty(2, np.int64)
    return Room(strips, ends, flat, side, bends, tips, at, turned, near, last)


@kernel
def _products(points, v, a, b):
    """Scalar products of the vectors from v to a and to b: the first one's, both's, the other's."""
    aa = ab = bb = 0.0
    for i in range(3):
        u, w = points[a, i] - points[v, i], points[b, i] - points[v, i]
        aa += u * u
        ab += u * w
        bb += w * w
    return aa, ab, bb


@kernel
def _first_portal(points, a, b, start, ends, flat):
    """Lay the half-edge a-b, seen from the start, into the plane: a on the axis, b left of it."""
    aa, ab, bb = _products(points, start, a, b)
    size = math.sqrt(aa)
    ends[0, 0], ends[0, 1] = b, a
    flat[0, 1], flat[0, 3] = size, 0.0
    if size > 0.0:
        flat[0, 0], flat[0, 2] = ab / size, math.sqrt(max(aa * bb - ab * ab, 0.0)) / size
    else:
        flat[0, 0], flat[0, 2] = 0.0, math.sqrt(bb)


@kernel
def _unfold(walk, strip, first, count, start, room):
    """Lay a strip into the plane, with the start at the origin; returns the place of the end.

    The half-edges before the `first` lie there already. Nothing branches on which end changes: that
    is as good as chance.
    """
    points, corners, twins, _, _ = walk
    ends, flat, side = room.ends, room.flat, room.side
    if first == 0:
        h = strip[0]
        _first_portal(points, corners[h], corners[next_side(h)], start, ends, flat)
    before = sure(max(first - 1, 0))
    x = y = 0.0
    for k in range(count - before):
        k += before
        t = sure(twins[sure(strip[k])])
        after = sure(next_side(t))
        a, b, c = sure(corners[t]), sure(corners[after]), sure(corners[sure(previous_side(t))])
        # Where the third corner of a face lies from its side: how far along that, as a share, and
        # how far to its left, in its lengths.
        square, along, far = _products(points, a, b, c)
        high, agrees = 0.0, a == ends[k, 0]
        if square > 0.0:
            high = math.sqrt(max(far * square - along * along, 0.0)) / square
            along /= square
        if not agrees:  # neighbours that agree run along their edge in opposite directions
            along = 1.0 - along
        fx, fy = flat[k, 1] - flat[k, 0], flat[k, 3] - flat[k, 2]
        x, y = flat[k, 0] + along * fx - high * fy, flat[k, 2] + along * fy + high * fx
        if k + 1 == count:
            break
        new = 1 if (strip[k + 1] == after) != agrees else 0
        old = 1 - new
        side[k + 1] = new
        flat[k + 1, new], flat[k + 1, new + 2] = x, y
        flat[k + 1, old], flat[k + 1, old + 2] = flat[k, old], flat[k, old + 2]
        ends[k + 1, new], ends[k + 1, old] = c, ends[k, old]
    return x, y


@kernel
def _funnel(count, room, x, y):
    """Length of the shortest path in a strip, and how many times it bends.

    From an apex, the tips are the ends on both sides that leave the funnel narrowest. Where a new
    end lies across the tip of the other side, and at last where the end of the path is not between
    the tips, the path bends at one: that is the apex from the next half-edge on that it is not of.
    """
    flat, side, tips, at, bends = room.flat, room.side, room.tips, room.at, room.bends
    number, length, px, py, k = 0, 0.0, 0.0, 0.0, 0
    at[0] = at[1] = 0
    while True:
        k = sure(k)
        tips[0, 0], tips[0, 1] = px - flat[k, 0], py - flat[k, 2]
        tips[1, 0], tips[1, 1] = flat[k, 1] - px, flat[k, 3] - py
        bend = -1
        for i in range(count - k - 1):
            i += k + 1
            new = side[i] & 1
            ux, uy = flat[i, new] - px, flat[i, new + 2] - py
            if tips[new, 0] * uy - tips[new, 1] * ux >= 0.0:
                if tips[1 - new, 0] * uy - tips[1 - new, 1] * ux < 0.0:
                    bend = 1 - new
                    break
                out = 2.0 * new - 1.0
                tips[new, 0], tips[new, 1] = out * ux, out * uy
                at[new] = i
        if bend < 0:
            ux, uy = x - px, y - py
            if tips[1, 0] * uy - tips[1, 1] * ux < 0.0:
                bend = 1
            elif tips[0, 0] * uy - tips[0, 1] * ux < 0.0:
                bend = 0
            else:
                return length + math.sqrt(ux * ux + uy * uy), number
        length += math.sqrt(tips[bend, 0] ** 2 + tips[bend, 1] ** 2)
        k = sure(at[bend])
        px, py = flat[k, bend], flat[k, bend + 2]
        bends[0, number], bends[1, number] = k, bend
        number += 1
        other = k
        while other > 0 and side[other] == bend:
            other -= 1
        k += 1
        while k < count and side[k] != bend:
            other = k
            k += 1
        if k == count:
            return length + math.sqrt((x - px) ** 2 + (y - py) ** 2), number
        at[bend], at[1 - bend] = k, other


@kernel
def _other_side(walk, v, h, last, re, im, re_end, im_end, out):
    """Half-edges that a path round the other side of v crosses (in `out`), 0 if it is not shorter.

    It begins in the face of half-edge h and ends in the face `last`; re and im are the rotation
    from the way in to the rim of the first face, re_end and im_end that from the last one on.
    """
    points, corners, twins, _, _ = walk
    count = 0
    while count < len(out):
        out[count] = previous_side(h) if corners[h] == v else next_side(h)
        t = twins[out[count]]
        count += 1
        if t < 0:
            return 0
        if t // 3 == last:
            x, y = re * re_end - im * im_end, re * im_end + im * re_end
            shorter = y > -BENT_BY * x if x < 0.0 else y >= 0.0
            return count if shorter else 0
        a, b = corners[t], corners[previous_side(t)]
        if a == v:
            a = corners[next_side(t)]
        uu, along, ww = _products(points, v, a, b)
        across = math.sqrt(max(uu * ww - along * along, 0.0))
        re, im = re * along - im * across, re * across + im * along
        if im < 0.0 or (im == 0.0 and re < 0.0):
            return 0
        size = abs(re) + im
        if size > 0.0:
            re, im = re / size, im / size
        h = t
    return 0


@kernel
def _rotation(vx, vy, ax, ay, bx, by, side):
    """Rotation about v from a to b, as a complex number; on the left it runs clockwise."""
    ax, ay, bx, by = ax - vx, ay - vy, bx - vx, by - vy
    turn = ax * by - ay * bx
    return ax * bx + ay * by, max(turn if side == 1 else -turn, 0.0)  # below 0 by rounding alone


@kernel
def _put_back(walk, strip, k, stop, written, out):
    """Append strip[k..stop] to a strip without what leads there and back; its size, and before."""
    while k < stop and written > 0 and walk.twins[out[written - 1]] == strip[k]:
        written, k = written - 1, k + 1
    for i in range(k, stop):
        out[written + i - k] = strip[i]
    return written + stop - k, written


@kernel
def _reroute(walk, start, end, strip, count, room, x, y, bends, out):
    """Lead a strip round the other side of its bends where that is shorter.

    Of two bends at the same half-edge only the first one is left out. Returns the first half-edge
    that is not as it was, the size of the new strip or -1, and whether it may touch an end.
    """
    ends, flat, turned, corners = room.ends, room.flat, room.turned, walk.corners
    written = done = 0
    first, touching = -1, False
    old_x = old_y = 0.0
    for i in range(bends):
        bend, side = room.bends[0, i], room.bends[1, i]
        v, vx, vy = ends[bend, side], flat[bend, side], flat[bend, side + 2]
        next_x, next_y = x, y
        if i + 1 < bends:
            at, column = room.bends[0, i + 1], room.bends[1, i + 1]
            next_x, next_y = flat[at, column], flat[at, column + 2]
        begin = stop = bend
        while begin > 0 and ends[begin - 1, side] == v:
            begin -= 1
        while stop + 1 < count and ends[stop + 1, side] == v:
            stop += 1
        before_x, before_y, old_x, old_y = old_x, old_y, vx, vy
        if begin < done:
            continue
        in_x = in_y = 0.0
        if begin > 0:
            in_x, in_y = flat[begin - 1, side], flat[begin - 1, side + 2]
        out_x, out_y = x, y
        if stop + 1 < count:
            out_x, out_y = flat[stop + 1, side], flat[stop + 1, side + 2]
        re, im = _rotation(vx, vy, before_x, before_y, in_x, in_y, side)
        re_end, im_end = _rotation(vx, vy, out_x, out_y, next_x, next_y, side)
        last = walk.twins[strip[stop]] // 3
        crossed = _other_side(walk, v, strip[begin], last, re, im, re_end, im_end, turned)
        if crossed == 0 or written + begin - done + crossed + count - stop > len(out):
            continue
        written, seam = _put_back(walk, strip, done, begin, written, out)
        first = written if first < 0 else min(first, seam)
        for k in range(crossed):
            h = turned[k]
            if written > 0 and walk.twins[out[written - 1]] == h:
                written -= 1
                first = min(first, written)
                continue
            out[written] = h
            written += 1
            a, b = corners[h], corners[next_side(h)]
            touching |= (a == start) | (a == end) | (b == start) | (b == end)
        done = stop + 1
    if first < 0 or written + count - done > len(out):
        return 0, -1, False
    written, seam = _put_back(walk, strip, done, count, written, out)
    return min(first, seam), written, touching


@kernel
def _place_on(points, room, k, x, y, ux, uy, out):
    """Where the line through (x, y) in direction u crosses half-edge k of a strip."""
    ends, flat = room.ends, room.flat
    right_x, right_y = flat[k, 1] - x, flat[k, 3] - y
    along = ux * (flat[k, 2] - flat[k, 3]) - uy * (flat[k, 0] - flat[k, 1])
    share = 0.0
    if along != 0.0:
        share = min(max(-(ux * right_y - uy * right_x) / along, 0.0), 1.0)
    left, right = ends[k, 0], ends[k, 1]
    for i in range(3):
        out[i] = points[right, i] + share * (points[left, i] - points[right, i])


@kernel
def _next_to_ends(points, count, room, x, y, bends):
    """Write the points of a path next to its start and its end."""
    flat, near = room.flat, room.near
    first_x, first_y, last_x, last_y = x, y, 0.0, 0.0
    if bends > 0:
        at, column = room.bends[0, 0], room.bends[1, 0]
        first_x, first_y = flat[at, column], flat[at, column + 2]
        at, column = room.bends[0, bends - 1], room.bends[1, bends - 1]
        last_x, last_y = flat[at, column], flat[at, column + 2]
    _place_on(points, room, 0, 0.0, 0.0, first_x, first_y, near[0])
    _place_on(points, room, count - 1, x, y, x - last_x, y - last_y, near[1])


@kernel
def straighten(walk, start, end, count, room):
    """Length of a locally shortest path near the strip that the room holds."""
    points, strips, near, last = walk.points, room.strips, room.near, room.last
    last[0] = 0
    here, length, rounds, first = 0, math.inf, MOST_ROUNDS, 0
    while count > 0:
        rounds -= 1
        x, y = _unfold(walk, strips[here], first, count, start, room)
        found, bends = _funnel(count, room, x, y)
        gained = length - found
        length = min(length, found)
        written, touching = -1, False
        if bends > 0 and gained > LEAST_GAIN * length and rounds > 0:
            first, written, touching = _reroute(
                walk, start, end, strips[here], count, room, x, y, bends, strips[1 - here]
            )
        if written < 0:
            _next_to_ends(points, count, room, x, y, bends)
            last[0], last[1], near[2, 0], near[2, 1] = count, bends, x, y
            return length
        here, count = 1 - here, written
        if touching:
            begin, stop = trim(walk, start, end, strips[here], written)
            count = stop - begin
            if begin > 0:
                first = 0
            for k in range(count):
                strips[here, k] = strips[here, begin + k]
    length = 0.0
    for i in range(3):  # both ends in one face
        near[0, i], near[1, i] = points[end, i], points[start, i]
        length += (points[end, i] - points[start, i]) ** 2
    return math.sqrt(length)


@kernel
def _across(normals, ends, k, there, place):
    """Write the unit vector across a path from one place to another at half-edge k; False: none."""
    u, v, w = place[0] - there[0], place[1] - there[1], place[2] - there[2]
    left, right = ends[k, 0], ends[k, 1]
    p = normals[left, 0] + normals[right, 0]
    q = normals[left, 1] + normals[right, 1]
    r = normals[left, 2] + normals[right, 2]
    x, y, z = q * w - r * v, r * u - p * w, p * v - q * u
    size = math.sqrt(x * x + y * y + z * z)
    if size > 0.0:
        place[ACROSS], place[ACROSS + 1], place[ACROSS + 2] = x / size, y / size, z / size
    return size > 0.0


@kernel
def write_trail(points, normals, room, trail):
    """Write the trail of the path that was straightened last; False if that is too short for it.

    How long the path is to a place needs to be known to an edge length or so: it is that to the
    middle of the half-edge.
    """
    ends, flat, near, last = room.ends, room.flat, room.near, room.last
    count, bends, number = last[0], last[1], len(trail)
    if count <= number + 1:
        return False
    bend, x, y, length, there = 0, 0.0, 0.0, 0.0, np.empty(3)
    for i in range(number):
        k = (i + 1) * count // (number + 1)
        while bend < bends and room.bends[0, bend] < k:
            at, column = room.bends[0, bend], room.bends[1, bend]
            length += math.sqrt((flat[at, column] - x) ** 2 + (flat[at, column + 2] - y) ** 2)
            x, y = flat[at, column], flat[at, column + 2]
            bend += 1
        ahead_x, ahead_y = near[2, 0] - x, near[2, 1] - y
        if bend < bends:
            at, column = room.bends[0, bend], room.bends[1, bend]
            ahead_x, ahead_y = flat[at, column] - x, flat[at, column + 2] - y
        size = math.sqrt(ahead_x * ahead_x + ahead_y * ahead_y)
        if size == 0.0:
            return False
        _place_on(points, room, k, x, y, ahead_x, ahead_y, trail[i])
        _place_on(points, room, max(k - SPAN, 0), x, y, ahead_x, ahead_y, there)
        if not _across(normals, ends, k, there, trail[i]):
            return False
        middle_x, middle_y = flat[k, 0] + flat[k, 1], flat[k, 2] + flat[k, 3]
        along = (0.5 * middle_x - x) * ahead_x + (0.5 * middle_y - y) * ahead_y
        trail[i, FAR] = length + along / size
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
        plane[a] = trail[before, ACROSS + a] + trail[after, ACROSS + a]
    along = (plane[0] * u + plane[1] * v + plane[2] * w) / size
    plane[0] -= along * u
    plane[1] -= along * v
    plane[2] -= along * w
    return True


@kernel
def walk_beside(walk, start, end, trail, moved, slope, limit, strip):
    """Length of the path between two vertices that follows a trail, and how much it crosses.

    The half-edges go to `strip`. `moved` tells how far both ends are from those of the trail,
    `slope` in which direction that begins. The length is inf where the path does not arrive before
    the limit.
    """
    points, corners, twins, _, _ = walk
    plane, number = np.empty(3), 0
    x, y, z = points[start, 0], points[start, 1], points[start, 2]
    if not _aim(points, trail, moved, end, 0, x, y, z, plane):
        return math.inf, 0
    way = way_towards(walk, start, plane, slope)
    if way < 0:
        return math.inf, 0
    h, px, py, pz = way_out(points, corners, way, plane, dot(plane, points[start]))
    h = sure(h)
    length = math.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
    x, y, z = px, py, pz
    a, b = sure(corners[h]), sure(corners[next_side(h)])
    turned = True
    for count in range(len(strip)):
        if turned:  # the plane leads to another place from here on
            offset = plane[0] * x + plane[1] * y + plane[2] * z
            da, db = dot(plane, points[a]) - offset, dot(plane, points[b]) - offset
            if (da >= 0.0) == (db >= 0.0):
                return math.inf, 0
        strip[count] = h
        t = twins[h]
        if t < 0 or length >= limit:
            return math.inf, 0
        after, before = sure(next_side(t)), sure(previous_side(t))
        c = sure(corners[before])
        if c == end:
            u, v, w = points[end, 0] - x, points[end, 1] - y, points[end, 2] - z
            return length + math.sqrt(u * u + v * v + w * w), count + 1
        if c == start:
            return math.inf, 0
        if corners[t] != a:
            a, b, da, db = b, a, db, da
        dc = dot(plane, points[c]) - offset
        if (dc >= 0.0) == (da >= 0.0):
            h, a, b, da, db = after, b, c, db, dc
        else:
            h, a, b, da, db = before, c, a, dc, da
        qx, qy, qz = on_plane(points, a, b, da, db)
        length += math.sqrt((qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2)
        x, y, z = qx, qy, qz
        turned = number < PLACES and length >= trail[number, FAR]
        if turned:
            number += 1
            if not _aim(points, trail, moved, end, number, x, y, z, plane):
                return math.inf, 0
    return math.inf, 0
