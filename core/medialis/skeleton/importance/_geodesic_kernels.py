"""Kernels of shortest straightest geodesics (thesis 3.3.1-3.3.2; see geodesics.py).

**Search.** Of many planes round the line between two vertices s and e the shortest cuts win, one on
each slope of lengths round the line; the best one, and those hardly longer, are shortened to
locally shortest paths (_strip_kernels.py). Before there is a best length, a limit that doubles
until a path arrives stands in for it: else the wrong way round a large shape would be walked to its
end. The caller says how long paths may be: a pair without a shorter one stays open.

**Follow.** The geodesic of a pair close by tells where to look: distances change by at most
the distance D of the ends. A search remembers its shortest cuts, the slopes, and the length below
which there is no other; while that is at least the length of a path found from these slopes plus D,
no other can be shorter and no search is needed. On the slope of the nearest pair known, searched or
not, a walk beside its path (_strip_kernels.py) needs least shortening; on others a plane cut is
turned to where it is shortest. Pairs are followed within a chunk.
"""

from __future__ import annotations

import math

import numpy as np

from medialis.base.jit import kernel
from medialis.skeleton.importance._plane_kernels import (
    cut_from,
    direction,
    dot,
    is_edge,
    set_frame,
    turn,
    way_towards,
)
from medialis.skeleton.importance._strip_kernels import (
    PLACES,
    make_room,
    straighten,
    walk_beside,
    write_trail,
)

NONE, PLANE, EDGES = 0, 1, 2  # how a length was found
OPEN = -1  # no path is short enough, a longer one may arrive

RECENT = 128
"""Pairs known last that are looked at for one to follow."""

SLOPES = 4
"""Shortest cuts of a search that are remembered."""

SLOPE = 3
"""Directions on both sides of the shortest one that belong to its slope: 54 degrees by default."""

SIMILAR = 1.1
"""Times the best length: cuts up to that are shortened, since they may become the shortest."""

AROUND = 1.5
"""Times the best length: what a search looks at that others follow."""

BENT = 1.25
"""Times the length that is expected of a followed path: what its plane cut may have."""

SHALLOW = 1.05
"""Times the straight line: pairs with a path as short as this in the plane of the normals do not
look for another one when they follow others; it could not be much shorter."""

ACROSS = 0.5
"""Of the normal of a plane what must be left across the line between the ends of another pair."""

BESIDE, CLOSE = math.radians(7.0), math.radians(4.0)
"""Between the three planes of a parabola: of a search, and of a pair that follows another one."""

MANY = 12
"""Half-edges that a cut must cross for this to be worth while."""


@kernel
def _try_planes(
    points, corners, twins, fan_offsets, fan, start, end, frame, planes, likely, limit, around,
    length, way, near,
):  # fmt: skip
    """Lengths of the cuts in all directions, and the half-edges through whose faces they leave.

    Direction k is that of plane k, k + planes the opposite one. The planes are tried from number
    `likely` outwards, so that a good bound comes early. Nothing longer than the limit, or than
    `around` times the best length, is followed: its length is inf. Returns the best length, that
    bound, and the least length that a dropped path would have had.
    """
    normal, nothing = np.empty(3), np.empty(0, np.int64)
    best, least = math.inf, math.inf
    length[:] = math.inf
    for number in range(planes):
        k = (number + 1) // 2 if number % 2 else -(number // 2)  # 0, +1, -1, +2, -2, ...
        k = (likely + k) % planes
        turn(frame, k * math.pi / planes, normal)
        along, across = math.cos(k * math.pi / planes), math.sin(k * math.pi / planes)
        for i in range(fan_offsets[start], fan_offsets[start + 1]):
            found, count = cut_from(
                points, corners, twins, fan[i], start, end, normal, limit, nothing, near
            )
            if count < 0:
                least = min(least, found)
                continue
            if found >= limit:
                continue
            ahead = 0.0
            for a in range(3):
                ahead += (near[0, a] - points[start, a]) * (
                    across * frame[0, a] - along * frame[1, a]
                )
            column = k if ahead >= 0.0 else k + planes
            if found < length[column]:
                length[column], way[column] = found, fan[i]
                best = min(best, found)
                limit = min(limit, around * best)
    return best, limit, least


@kernel
def _lowest(length, limit, place):
    """Directions at the foot of each slope of lengths, shortest first; how many, and a bound.

    That is the least length of a direction that is none of them nor beside one, at most the limit.
    On a round shape, where all directions are nearly as long, little tells where the shortest is.
    """
    count, size = 0, len(length)
    for k in range(size):
        value = length[k]
        if not (value < limit and value <= length[k - 1] and value < length[(k + 1) % size]):
            continue
        at = count
        while at > 0 and length[place[at - 1]] > value:
            at -= 1
        count = min(count + 1, len(place))
        for i in range(count - 1, at, -1):
            place[i] = place[i - 1]
        if at < count:
            place[at] = k
    if count == 0:  # all directions are as long
        place[0], count = 0, 1
    for k in range(size):
        near = False
        for i in range(count):
            away = abs(k - place[i])
            near = near or min(away, size - away) <= SLOPE
        if not near:
            limit = min(limit, length[k])
    return count, limit


@kernel
def _shorten(points, corners, twins, start, end, length, count, room):
    """Length of the path in a strip once shortened; one too long for the room stays as it is."""
    if length == math.inf or count > len(room[0][0]):
        return length
    return min(length, straighten(points, corners, twins, start, end, count, room))


@kernel
def _take(points, start, end, near, plane, tangents, normal):
    """Keep the path at hand: its directions at both ends and the plane that it began with."""
    direction(points[start], near[0], tangents[0])
    direction(near[1], points[end], tangents[1])
    for a in range(3):
        normal[a] = plane[a]


@kernel
def _descend(
    points, corners, twins, fan_offsets, fan, start, end, frame, angle, length, count, ahead, step,
    room, normal,
):  # fmt: skip
    """Turn a plane to where a parabola through the lengths of its cut and two others is lowest.

    The cut at hand leaves in the direction `ahead`. Returns the length of the shortest, and the
    half-edges that it crosses; `normal` receives its plane's. The length is inf where it is lost.
    """
    strips, near = room[0], room[4]
    best, low, high, turned, held = length, math.inf, math.inf, angle, True
    for number in range(4):
        shift = step if number == 1 else -step
        if number == 2:
            bend = low - 2.0 * length + high
            if not 0.0 < bend < math.inf:
                continue
            shift = min(max(0.5 * (low - high) / bend, -2.0), 2.0) * step
        if number == 3:  # once more, where the last one was not the shortest
            if held:
                return best, count
            shift = turned - angle
        turn(frame, angle + shift, normal)
        way = way_towards(points, corners, fan_offsets, fan, start, normal, ahead)
        if way < 0:
            found, crossed = math.inf, 0
        else:
            found, crossed = cut_from(
                points, corners, twins, way, start, end, normal,
                math.inf if number == 3 else SIMILAR * length, strips[0], near,
            )  # fmt: skip
        held = False
        if crossed < 0:
            found = math.inf
        if number == 0:
            low = found
        elif number == 1:
            high = found
        if found < best or number == 3:
            best, count, turned, held = found, crossed, angle + shift, True
    return best, count


@kernel
def _search(
    points, normals, corners, twins, fan_offsets, fan, start, end, frame, planes, likely, limit,
    longest, around, room, length, way, place, tangents, slopes, trail, normal,
):  # fmt: skip
    """Shortest path found in all directions: its length, its bound, the number of slopes.

    The length is NaN if a longer path than `longest` may arrive. For the path itself, see `_take`.
    Rows of `slopes`: direction at the start, normal of the plane,
    length at least.
    """
    near = room[4]
    limit = min(limit, longest)
    while True:
        best, bound, least = _try_planes(
            points, corners, twins, fan_offsets, fan, start, end, frame, planes, likely, limit,
            around, length, way, near,
        )  # fmt: skip
        if best < math.inf:
            break
        if least == math.inf:
            return math.inf, math.inf, 0, -1
        if limit >= longest:
            return math.nan, longest, 0, -1
        while limit <= least:  # no path arrives before
            limit *= 2.0
        limit = min(limit, longest)
    count, bound = _lowest(length, bound, place)
    shortest, chosen, ahead = math.inf, -1, np.empty(3)
    for i in range(count):
        k, plane = place[i], np.empty(3)
        angle = math.pi * (k % planes) / planes
        turn(frame, angle, plane)
        if length[k] > SIMILAR * best:
            sign = 1.0 if k < planes else -1.0
            for a in range(3):
                towards = math.sin(angle) * frame[0, a] - math.cos(angle) * frame[1, a]
                slopes[i, a], slopes[i, 3 + a] = sign * towards, plane[a]
            slopes[i, 6] = length[k] / SIMILAR
            continue
        found, crossed = cut_from(
            points, corners, twins, way[k], start, end, plane, math.inf, room[0][0], near
        )
        if crossed > MANY:
            direction(points[start], near[0], ahead)
            found, crossed = _descend(
                points, corners, twins, fan_offsets, fan, start, end, frame, angle, found, crossed,
                ahead, BESIDE, room, plane,
            )  # fmt: skip
            if found == math.inf:
                turn(frame, angle, plane)
                found, crossed = cut_from(
                    points, corners, twins, way[k], start, end, plane, math.inf, room[0][0], near
                )
        found = _shorten(points, corners, twins, start, end, found, crossed, room)
        direction(points[start], near[0], ahead)
        slopes[i, 6] = found
        for a in range(3):
            slopes[i, a], slopes[i, 3 + a] = ahead[a], plane[a]
        if found < shortest:
            shortest, chosen = found, -1
            if len(trail) > 0 and write_trail(points, normals, room, trail):
                chosen = i
            _take(points, start, end, near, plane, tangents, normal)
    return shortest, bound, count, chosen


@kernel
def _plane_along(frame, old, out):
    """Write the normal of the plane through two vertices that is turned least from another one."""
    u, w = dot(old, frame[0]), dot(old, frame[1])
    size = math.sqrt(u * u + w * w)
    if size < ACROSS:
        return False
    for a in range(3):
        out[a] = (u * frame[0, a] + w * frame[1, a]) / size
    return True


@kernel
def _along_slope(
    points, corners, twins, fan_offsets, fan, start, end, frame, slope, limit, plane, room
):  # fmt: skip
    """Length of the plane cut that leaves as another path does, and the half-edges it crosses."""
    if not _plane_along(frame, slope[3:], plane):
        return math.inf, 0
    way = way_towards(points, corners, fan_offsets, fan, start, plane, slope)
    if way < 0:
        return math.inf, 0
    return cut_from(
        points, corners, twins, way, start, end, plane, limit, room[0][0], room[4]
    )  # fmt: skip


@kernel
def _follow(
    points, normals, corners, twins, fan_offsets, fan, start, end, frame, apart, slopes, count,
    beside, moved, ahead, old, trail, room, tangents, normal,
):  # fmt: skip
    """Length of the shortest path on the slopes of a pair that is `apart`; inf: search anew.

    On slope `beside` a trail is known, `old`. Returns also the slope of the path, -1: no trail.
    """
    near, plane, best, chosen = room[4], np.empty(3), math.inf, -1
    for number in range(count):
        i = number
        if beside >= 0:
            i = beside if number == 0 else (number - 1 if number <= beside else number)
        if slopes[i, 6] - apart >= best:
            continue
        expected = BENT * (slopes[i, 6] + apart)
        found = math.inf
        if i == beside:
            for a in range(3):
                plane[a] = slopes[i, 3 + a]
            found, crossed = walk_beside(
                points, corners, twins, fan_offsets, fan, start, end, old, moved, ahead, expected,
                room[0][0],
            )  # fmt: skip
        if found == math.inf:
            found, crossed = _along_slope(
                points, corners, twins, fan_offsets, fan, start, end, frame, slopes[i],
                min(expected, SIMILAR * best), plane, room,
            )  # fmt: skip
            if crossed < 0 and SIMILAR * best < expected:
                continue
            if crossed < 0 or found == math.inf:
                return math.inf, -1
            if crossed > MANY:
                direction(points[start], near[0], ahead)
                angle = math.atan2(dot(plane, frame[1]), dot(plane, frame[0]))
                found, crossed = _descend(
                    points, corners, twins, fan_offsets, fan, start, end, frame, angle, found,
                    crossed, ahead, CLOSE, room, plane,
                )  # fmt: skip
                if found == math.inf:
                    return math.inf, -1
        found = _shorten(points, corners, twins, start, end, found, crossed, room)
        if found < best:
            best, chosen = found, -1
            if write_trail(points, normals, room, trail):
                chosen = i
            _take(points, start, end, near, plane, tangents, normal)
    return best, chosen


@kernel
def _distance(points, a, b):
    total = 0.0
    for i in range(3):
        total += (points[a, i] - points[b, i]) ** 2
    return math.sqrt(total)


@kernel
def _over_shallow(
    points, corners, twins, fan_offsets, fan, start, end, frame, room, tangents, normal
):  # fmt: skip
    """Length of the path in the plane of the normals; inf where a shorter one may matter."""
    slope, plane = np.empty(6), np.empty(3)
    for a in range(3):
        slope[a], slope[3 + a] = -frame[1, a], frame[0, a]
    limit = SHALLOW * _distance(points, start, end)
    found, crossed = _along_slope(
        points, corners, twins, fan_offsets, fan, start, end, frame, slope, SIMILAR * limit, plane,
        room,
    )  # fmt: skip
    if crossed < 0 or found == math.inf:
        return math.inf
    found = _shorten(points, corners, twins, start, end, found, crossed, room)
    if found > limit:
        return math.inf
    _take(points, start, end, room[4], plane, tangents, normal)
    return found


@kernel
def _nearest_known(points, start, end, starts, ends, rows, seeds, count, bounds, lengths):
    """Nearest known pair whose seed has no other path within its distance, or -1.

    Returns also the distance of the ends from those of the seed, both together.
    """
    chosen, least, from_seed = -1, math.inf, 0.0
    for k in range(max(0, count - RECENT), count):
        apart = _distance(points, start, starts[rows[k]])
        if apart >= least:
            continue
        apart += _distance(points, end, ends[rows[k]])
        if apart >= least:
            continue
        seed, far = seeds[k], apart
        if seed != k:
            far = _distance(points, start, starts[rows[seed]])
            far += _distance(points, end, ends[rows[seed]])
        if 2.0 * far <= bounds[seed] - lengths[seed]:
            chosen, least, from_seed = k, apart, far
    return chosen, from_seed


@kernel
def trace_geodesics(
    begin, end_row, rows, limits, longest, points, normals, corners, twins, fan_offsets, fan,
    component, starts, ends, planes, following,
    out_length, out_start_tangent, out_end_tangent, out_normal, out_status,
):  # fmt: skip
    """Shortest straightest geodesics of the pairs rows[begin..end_row].

    They are looked for among paths of up to limits[row] first, then among longer ones, up to
    longest[row]. With `following` pairs follow those of the range that are near.
    """
    frame, tangents, normal = np.empty((2, 3)), np.empty((2, 3)), np.empty(3)
    length, way = np.empty(2 * planes), np.empty(2 * planes, np.int64)
    place, room = np.empty(SLOPES, np.int64), make_room(len(corners) // 3)
    # Known pairs: the one among them that was searched in all directions, its seed, and a trail.
    most, known = end_row - begin if following else 1, 0
    known_rows, seeds, beside = np.empty((3, most), np.int64)
    bounds, lengths, counts = np.empty(most), np.empty(most), np.empty(most, np.int64)
    slopes, trails = np.empty((most, SLOPES, 7)), np.empty((most, PLACES if following else 0, 7))
    moved, ahead = np.empty((2, 3)), np.empty(3)
    old = np.zeros(3)  # plane normal that won for the previous pair
    for r in range(begin, end_row):
        row = rows[r]
        start, end = starts[row], ends[row]
        out_length[row], out_status[row] = math.inf, NONE
        if start < 0 or end < 0:
            out_length[row] = math.nan
            continue
        if component[start] != component[end]:
            continue
        if start == end or not set_frame(points, normals, start, end, frame):
            out_length[row], out_status[row] = 0.0, PLANE  # one vertex, or two at the same place
            continue
        if is_edge(corners, fan_offsets, fan, start, end):
            out_length[row], out_status[row] = _distance(points, start, end), PLANE
            direction(points[start], points[end], out_start_tangent[row])
            direction(points[start], points[end], out_end_tangent[row])
            continue
        best, tangents[:] = math.inf, math.nan
        if following:
            best = _over_shallow(
                points, corners, twins, fan_offsets, fan, start, end, frame, room, tangents, normal
            )
        this = min(known, most - 1)
        if following and best == math.inf:
            near, apart = _nearest_known(
                points, start, end, starts, ends, known_rows, seeds, known, bounds, lengths
            )
            if near >= 0:
                seed, other = seeds[near], known_rows[near]
                if counts[seed] == 0:
                    out_status[row] = OPEN
                    continue
                for a in range(3):
                    moved[0, a] = points[start, a] - points[starts[other], a]
                    moved[1, a] = points[end, a] - points[ends[other], a]
                    ahead[a] = out_start_tangent[other, a]
                best, beside[this] = _follow(
                    points, normals, corners, twins, fan_offsets, fan, start, end, frame, apart,
                    slopes[seed], counts[seed], beside[near], moved, ahead, trails[near],
                    trails[this], room, tangents, normal,
                )  # fmt: skip
                if best + apart > bounds[seed]:
                    best = math.inf
                else:
                    known_rows[this], seeds[this] = row, seed
                    known += 1
        if best == math.inf:
            u, w = dot(old, frame[0]), dot(old, frame[1])
            likely = round(math.atan2(w, u) * planes / math.pi) if u * u + w * w > 0.25 else 0
            best, bounds[this], counts[this], beside[this] = _search(
                points, normals, corners, twins, fan_offsets, fan, start, end, frame, planes,
                likely, limits[row], longest[row], AROUND if following else SIMILAR, room, length,
                way, place, tangents, slopes[this], trails[this], normal,
            )  # fmt: skip
            known_rows[this], seeds[this] = row, this
            lengths[this] = best if best < math.inf else 0.0
            if following and best != math.inf:
                known += 1
        if math.isnan(best):
            out_status[row] = OPEN
        if best < math.inf:
            out_length[row], out_status[row] = best, PLANE
            for a in range(3):
                old[a] = out_normal[row, a] = normal[a]
                out_start_tangent[row, a] = tangents[0, a]
                out_end_tangent[row, a] = tangents[1, a]
