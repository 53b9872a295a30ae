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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel
from medialis.skeleton.importance._strip_kernels import (
    PLACES,
    Room,
    make_room,
    straighten,
    walk_beside,
    write_trail,
)
from medialis.skeleton.importance._walk_kernels import (
    NONE,
    PLANE,
    Walk,
    cut_from,
    direction,
    distance,
    dot,
    is_edge,
    set_frame,
    turn,
    way_towards,
)

OPEN = -1
"""Status of a pair without a path that is short enough: a longer one may arrive."""

MOST_RECENT = 128
"""Pairs known last that are looked at for one to follow."""

SLOPES = 4
"""Shortest cuts of a search that are remembered."""

BESIDE_SLOPE = 3
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

LEFT_ACROSS = 0.5
"""Of the normal of a plane what must be left across the line between the ends of another pair."""

LIKELY = 0.25
"""The same, squared, for the plane of the previous pair to tell where a search begins."""

TURN_SEARCHED = math.radians(7.0)
"""Radians between the three planes of a parabola, of a search."""

TURN_FOLLOWED = math.radians(4.0)
"""The same, of a pair that follows another one."""

LEAST_TURNED = 12
"""Half-edges that a cut must cross for turning its plane to be worth while."""

NORMAL, LENGTH = 3, 6
"""Columns of a slope, behind the direction at the start: the normal of its plane, and the length
that a path there has at least."""


class Search(NamedTuple):
    """What paths are looked for.

    Attributes
    ----------
    normals : (n, 3) float64
    components : (n,) int32
    ends : (k, 2) int32
        Start and end of each pair, negative: masked.
    limits, longest : (k,) float64
        Paths of up to the limit are looked for first, then longer ones, up to the longest.
    planes : int
        Through both ends, each of which has two directions.
    following : bool
        Whether pairs follow those of their range that are near.
    """

    normals: NDArray[np.float64]
    components: NDArray[np.int32]
    ends: NDArray[np.int32]
    limits: NDArray[np.float64]
    longest: NDArray[np.float64]
    planes: int
    following: bool


class _Pair(NamedTuple):
    """The pair at hand: the frame of the planes through its ends, and the path it has (`_take`)."""

    walk: Walk
    normals: NDArray[np.float64]
    start: int
    end: int
    frame: NDArray[np.float64]
    room: Room
    tangents: NDArray[np.float64]
    normal: NDArray[np.float64]


class _Directions(NamedTuple):
    """Length of the cut in each direction, the half-edge it starts with; the shortest ones."""

    length: NDArray[np.float64]
    way: NDArray[np.int64]
    place: NDArray[np.int64]


class _Known(NamedTuple):
    """Pairs known of a range, one row each.

    Their row among all; the known one searched in all directions that they follow (`seeds`), and
    the slope with their trail (-1: none). Of seeds besides the length below which there is no other
    path (`bounds`), their own, and their slopes and how many.
    """

    rows: NDArray[np.int64]
    seeds: NDArray[np.int64]
    beside: NDArray[np.int64]
    bounds: NDArray[np.float64]
    lengths: NDArray[np.float64]
    counts: NDArray[np.int64]
    slopes: NDArray[np.float64]
    trails: NDArray[np.float64]


@kernel
def _no_pairs(most, following):
    rows, seeds = np.empty(most, np.int64), np.empty(most, np.int64)
    beside, counts = np.empty(most, np.int64), np.empty(most, np.int64)
    bounds, lengths = np.empty(most), np.empty(most)
    slopes, trails = np.empty((most, SLOPES, 7)), np.empty((most, PLACES if following else 0, 7))
    return _Known(rows, seeds, beside, bounds, lengths, counts, slopes, trails)


@kernel
def _try_planes(pair, directions, likely, limit, around):
    """Lengths of the cuts in all directions, and the half-edges through whose faces they leave.

    Direction k is that of plane k, k + planes the opposite one. The planes are tried from number
    `likely` outwards, so that a good bound comes early. Nothing longer than the limit, or than
    `around` times the best length, is followed: its length is inf. Returns the best length, that
    bound, and the least length that a dropped path would have had.
    """
    walk, frame, start, near = pair.walk, pair.frame, pair.start, pair.room.near
    length, way, _ = directions
    planes = len(length) // 2
    normal, nothing = np.empty(3), np.empty(0, np.int64)
    best, least = math.inf, math.inf
    length[:] = math.inf
    for number in range(planes):
        k = (number + 1) // 2 if number % 2 else -(number // 2)  # 0, +1, -1, +2, -2, ...
        k = (likely + k) % planes
        turn(frame, k * math.pi / planes, normal)
        along, across = math.cos(k * math.pi / planes), math.sin(k * math.pi / planes)
        for i in range(walk.offsets[start], walk.offsets[start + 1]):
            h = walk.fan[i]
            found, count = cut_from(walk, h, start, pair.end, normal, limit, nothing, near)
            if count < 0:
                least = min(least, found)
                continue
            if found >= limit:
                continue
            ahead = 0.0
            for a in range(3):
                step = across * frame[0, a] - along * frame[1, a]
                ahead += (near[0, a] - walk.points[start, a]) * step
            column = k if ahead >= 0.0 else k + planes
            if found < length[column]:
                length[column], way[column] = found, h
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
            near = near or min(away, size - away) <= BESIDE_SLOPE
        if not near:
            limit = min(limit, length[k])
    return count, limit


@kernel
def _cut(pair, h, plane, best):
    """Length of the cut that leaves the start through the face of h, and what it crosses."""
    room = pair.room
    return cut_from(pair.walk, h, pair.start, pair.end, plane, best, room.strips[0], room.near)


@kernel
def _shorten(pair, length, count):
    """Length of the path in a strip once shortened; one too long for the room stays as it is."""
    if length == math.inf or count > pair.room.strips.shape[1]:
        return length
    return min(length, straighten(pair.walk, pair.start, pair.end, count, pair.room))


@kernel
def _take(pair, plane):
    """Keep the path at hand: its directions at both ends and the plane that it began with."""
    points, near = pair.walk.points, pair.room.near
    direction(points[pair.start], near[0], pair.tangents[0])
    direction(near[1], points[pair.end], pair.tangents[1])
    for a in range(3):
        pair.normal[a] = plane[a]


@kernel
def _descend(pair, angle, length, count, ahead, step, normal):
    """Turn a plane to where a parabola through the lengths of its cut and two others is lowest.

    The cut at hand leaves in the direction `ahead`. Returns the length of the shortest, and the
    half-edges that it crosses; `normal` receives its plane's. The length is inf where it is lost.
    """
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
        turn(pair.frame, angle + shift, normal)
        way = way_towards(pair.walk, pair.start, normal, ahead)
        found, crossed = math.inf, 0
        if way >= 0:
            limit = math.inf if number == 3 else SIMILAR * length
            found, crossed = _cut(pair, way, normal, limit)
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
def _search(pair, directions, likely, limit, longest, around, slopes, trail):
    """Shortest path found in all directions: its length, its bound, the number of slopes.

    The length is NaN if a longer path than `longest` may arrive. For the path itself, see `_take`.
    """
    points, start, frame, near = pair.walk.points, pair.start, pair.frame, pair.room.near
    length, way, place = directions
    planes, limit = len(length) // 2, min(limit, longest)
    while True:
        best, bound, least = _try_planes(pair, directions, likely, limit, around)
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
                slopes[i, a], slopes[i, NORMAL + a] = sign * towards, plane[a]
            slopes[i, LENGTH] = length[k] / SIMILAR
            continue
        found, crossed = _cut(pair, way[k], plane, math.inf)
        if crossed > LEAST_TURNED:
            direction(points[start], near[0], ahead)
            found, crossed = _descend(pair, angle, found, crossed, ahead, TURN_SEARCHED, plane)
            if found == math.inf:
                turn(frame, angle, plane)
                found, crossed = _cut(pair, way[k], plane, math.inf)
        found = _shorten(pair, found, crossed)
        direction(points[start], near[0], ahead)
        slopes[i, LENGTH] = found
        for a in range(3):
            slopes[i, a], slopes[i, NORMAL + a] = ahead[a], plane[a]
        if found < shortest:
            shortest, chosen = found, -1
            if len(trail) > 0 and write_trail(points, pair.normals, pair.room, trail):
                chosen = i
            _take(pair, plane)
    return shortest, bound, count, chosen


@kernel
def _along_slope(pair, slope, limit, plane):
    """Length of the plane cut that leaves as another path does, and the half-edges it crosses.

    `plane` receives the normal of the plane through both ends that is turned least from the other.
    """
    u, w = dot(slope[NORMAL:], pair.frame[0]), dot(slope[NORMAL:], pair.frame[1])
    size = math.sqrt(u * u + w * w)
    if size < LEFT_ACROSS:
        return math.inf, 0
    for a in range(3):
        plane[a] = (u * pair.frame[0, a] + w * pair.frame[1, a]) / size
    way = way_towards(pair.walk, pair.start, plane, slope)
    if way < 0:
        return math.inf, 0
    return _cut(pair, way, plane, limit)


@kernel
def _follow(pair, known, near_pair, this, apart, moved, ahead):
    """Length of the shortest path on the slopes of the seed of a known pair; inf: search anew.

    That seed is `apart`; `moved` tells how far the ends are from those of the known pair, `ahead`
    in which direction its path begins. Returns also the slope of the path, -1: no trail.
    """
    near, plane, best, chosen = pair.room.near, np.empty(3), math.inf, -1
    seed, beside = known.seeds[near_pair], known.beside[near_pair]
    slopes = known.slopes[seed]
    for number in range(known.counts[seed]):
        i = number
        if beside >= 0:
            i = beside if number == 0 else (number - 1 if number <= beside else number)
        if slopes[i, LENGTH] - apart >= best:
            continue
        expected = BENT * (slopes[i, LENGTH] + apart)
        found = math.inf
        if i == beside:
            for a in range(3):
                plane[a] = slopes[i, NORMAL + a]
            found, crossed = walk_beside(
                pair.walk, pair.start, pair.end, known.trails[near_pair], moved, ahead, expected,
                pair.room.strips[0],
            )  # fmt: skip
        if found == math.inf:
            limit = min(expected, SIMILAR * best)
            found, crossed = _along_slope(pair, slopes[i], limit, plane)
            if crossed < 0 and SIMILAR * best < expected:
                continue
            if crossed < 0 or found == math.inf:
                return math.inf, -1
            if crossed > LEAST_TURNED:
                direction(pair.walk.points[pair.start], near[0], ahead)
                angle = math.atan2(dot(plane, pair.frame[1]), dot(plane, pair.frame[0]))
                found, crossed = _descend(pair, angle, found, crossed, ahead, TURN_FOLLOWED, plane)
                if found == math.inf:
                    return math.inf, -1
        found = _shorten(pair, found, crossed)
        if found < best:
            best, chosen = found, -1
            if write_trail(pair.walk.points, pair.normals, pair.room, known.trails[this]):
                chosen = i
            _take(pair, plane)
    return best, chosen


@kernel
def _over_shallow(pair):
    """Length of the path in the plane of the normals; inf where a shorter one may matter."""
    slope, plane = np.empty(6), np.empty(3)
    for a in range(3):
        slope[a], slope[NORMAL + a] = -pair.frame[1, a], pair.frame[0, a]
    limit = SHALLOW * distance(pair.walk.points, pair.start, pair.end)
    found, crossed = _along_slope(pair, slope, SIMILAR * limit, plane)
    if crossed < 0 or found == math.inf:
        return math.inf
    found = _shorten(pair, found, crossed)
    if found > limit:
        return math.inf
    _take(pair, plane)
    return found


@kernel
def _nearest_known(pair, ends, known, count):
    """Nearest known pair whose seed has no other path within its distance, or -1.

    Returns also the distance of the ends from those of the seed, both together.
    """
    points, start, end = pair.walk.points, pair.start, pair.end
    chosen, least, from_seed = -1, math.inf, 0.0
    for k in range(max(0, count - MOST_RECENT), count):
        row, seed = known.rows[k], known.seeds[k]
        apart = distance(points, start, ends[row, 0])
        if apart >= least:
            continue
        apart += distance(points, end, ends[row, 1])
        if apart >= least:
            continue
        far = apart
        if seed != k:
            row = known.rows[seed]
            far = distance(points, start, ends[row, 0])
            far += distance(points, end, ends[row, 1])
        if 2.0 * far <= known.bounds[seed] - known.lengths[seed]:
            chosen, least, from_seed = k, apart, far
    return chosen, from_seed


@kernel
def trace_geodesics(begin, stop, rows, walk, search, out):
    """Shortest straightest geodesics of the pairs rows[begin..stop]."""
    normals, components, ends, limits, longest, planes, following = search
    points, frame, tangents, normal = walk.points, np.empty((2, 3)), np.empty((2, 3)), np.empty(3)
    room = make_room(len(walk.corners) // 3)
    directions = _Directions(
        np.empty(2 * planes), np.empty(2 * planes, np.int64), np.empty(SLOPES, np.int64)
    )
    most, count = stop - begin if following else 1, 0
    known = _no_pairs(most, following)
    moved, ahead = np.empty((2, 3)), np.empty(3)
    old = np.zeros(3)  # plane normal that won for the previous pair
    for r in range(begin, stop):
        row = rows[r]
        start, end = ends[row, 0], ends[row, 1]
        out.length[row], out.status[row] = math.inf, NONE
        if start < 0 or end < 0:
            out.length[row] = math.nan
            continue
        if components[start] != components[end]:
            continue
        if start == end or not set_frame(points, normals, start, end, frame):
            out.length[row], out.status[row] = 0.0, PLANE  # one vertex, or two at the same place
            continue
        if is_edge(walk, start, end):
            out.length[row], out.status[row] = distance(points, start, end), PLANE
            direction(points[start], points[end], out.start_tangent[row])
            direction(points[start], points[end], out.end_tangent[row])
            continue
        pair = _Pair(walk, normals, start, end, frame, room, tangents, normal)
        best, tangents[:] = math.inf, math.nan
        if following:
            best = _over_shallow(pair)
        this = min(count, most - 1)
        if following and best == math.inf:
            near, apart = _nearest_known(pair, ends, known, count)
            if near >= 0:
                seed, other = known.seeds[near], known.rows[near]
                if known.counts[seed] == 0:
                    out.status[row] = OPEN
                    continue
                for a in range(3):
                    moved[0, a] = points[start, a] - points[ends[other, 0], a]
                    moved[1, a] = points[end, a] - points[ends[other, 1], a]
                    ahead[a] = out.start_tangent[other, a]
                best, known.beside[this] = _follow(pair, known, near, this, apart, moved, ahead)
                if best + apart > known.bounds[seed]:
                    best = math.inf
                else:
                    known.rows[this], known.seeds[this] = row, seed
                    count += 1
        if best == math.inf:
            u, w = dot(old, frame[0]), dot(old, frame[1])
            likely = round(math.atan2(w, u) * planes / math.pi) if u * u + w * w > LIKELY else 0
            around = AROUND if following else SIMILAR
            best, known.bounds[this], known.counts[this], known.beside[this] = _search(
                pair, directions, likely, limits[row], longest[row], around, known.slopes[this],
                known.trails[this],
            )  # fmt: skip
            known.rows[this], known.seeds[this] = row, this
            known.lengths[this] = best if best < math.inf else 0.0
            if following and best != math.inf:
                count += 1
        if math.isnan(best):
            out.status[row] = OPEN
        if best < math.inf:
            out.length[row], out.status[row] = best, PLANE
            for a in range(3):
                old[a] = normal[a]
                if not following:
                    out.normal[row, a] = normal[a]
                out.start_tangent[row, a] = tangents[0, a]
                out.end_tangent[row, a] = tangents[1, a]
