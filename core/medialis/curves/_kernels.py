"""Kernels of curve skeletons: candidates and their importance, links, growth, loops (thesis 3.6).

Candidates (candidates.py): how far the tangents of geodesics turn from ball to ball, and balls that
touch the surface all round. Importance: lengths of geodesics in all directions, and the area of the
smaller part that they cut off.

Links (growth.py): candidates for links are listed from both ends, sorted, and weighed; the cheapest
paths along them are those of `_search_kernels.py`. Handles: trees of vertices and of faces. Loops:
links that cross a surface which a loop spans, and the cheapest link that closes a loop.

A spanned surface is a binary tree of triangles. All tests are signs of volumes of four points,
computed in one order wherever they are asked for: so a path crosses the surface as often as it
should, also where it goes through the side of two triangles, or where one of its points lies in a
triangle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import find_root
from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import (
    cross,
    cut_from,
    direction,
    distance,
    dot,
    turn,
    way_out,
)

SHORT_LINK = 0.3
"""Share of the smaller radius up to which a link counts as short: the distance of the nodes in the
end. In a thick body centers are many spacings apart; a path through it must not cost more than one
along thin balls below its surface."""

OVERLAP_COST = 10.0
"""Times what a link costs where a center lies outside the other ball."""

APART_COST = 1000.0
"""Times what a link costs where the balls are apart: a last resort that keeps the graph whole."""

LEAST_COST = 1e-9
"""Spacings that any link costs: of paths between coincident centers the one with fewer links."""

DEEPEST = 64
"""Of a tree that halves its loop again and again."""


class BallLinks(NamedTuple):
    """Balls and the links between them; row i of any array belongs to ball i or link i.

    Attributes
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    offsets : (k + 1,) int64
        Links of ball i are numbers offsets[i] to offsets[i + 1]; each is listed from both ends.
    neighbours : (l,) int32
        The other end.
    length : (l,) float64
        Distance of the centers.
    cost : (l,) float64
        What a path along the link costs: low near the curve skeleton.
    spacing : float
        Typical distance of neighbouring balls.
    widths : (k,) float64
        Half the width of the shape across each ball; inf where it is not known.
    """

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    offsets: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    length: NDArray[np.float64]
    cost: NDArray[np.float64]
    spacing: float
    widths: NDArray[np.float64]


class SpanningSurface(NamedTuple):
    """Triangles whose border is a loop, in a binary tree.

    Attributes
    ----------
    points : (l, 3) float64
        Those of the loop.
    corners : (l - 1, 3) int64
        Of each triangle, in the order of the loop; the first one has no area.
    children : (l - 1, 2) int64
        Triangles that lie at its first and second side, -1 for none.
    lowest, highest : (l - 1, 3) float64
        Corners of the box round a triangle and all below it.
    normals : (l - 1, 3) float64
        Unit normal of the plane of each triangle.
    levels : (l - 1,) float64
        The plane holds the points x with normal x = level.
    slack : float
        By which boxes and planes are wider than they are: rounding.
    """

    points: NDArray[np.float64]
    corners: NDArray[np.int64]
    children: NDArray[np.int64]
    lowest: NDArray[np.float64]
    highest: NDArray[np.float64]
    normals: NDArray[np.float64]
    levels: NDArray[np.float64]
    slack: float


@kernel
def weigh_paths(order, parent, links, weight, prime, path, anchor):
    """Weigh the turns of the path from each ball to the root, in rising cost.

    `weight` is that of each link, modulo the prime. Balls of the tree (no parent) keep theirs.
    `anchor` becomes the last ball on the path that does not overlap the one after it, else that of
    the root: links between balls that are apart may leave the shape, so that turns are certain
    between balls of the same anchor only.
    """
    offsets, radii = links.offsets, links.radii
    for v in order:
        p = parent[v]
        if p < 0:
            continue
        anchor[v] = anchor[p]
        for at in range(offsets[p], offsets[p + 1]):
            if links.neighbours[at] == v:
                if links.length[at] >= radii[v] + radii[p]:
                    anchor[v] = v
                path[v] = (path[p] + weight[at]) % prime
                break


@kernel
def cheapest_closing_link(rows, links, spent, weight, prime, path, anchor):
    """Return the cheapest link that closes a path which weighs something, -1 for none.

    Only links between balls that overlap count, and whose turns are certain (`weigh_paths`).
    """
    best, least, radii = -1, np.inf, links.radii
    for v in rows:
        for at in range(links.offsets[v], links.offsets[v + 1]):
            w = links.neighbours[at]
            total = spent[v] + links.cost[at] + spent[w]
            if w <= v or total >= least:
                continue
            if links.length[at] >= radii[v] + radii[w] or anchor[v] != anchor[w]:
                continue
            if (path[v] + weight[at] - path[w]) % prime != 0:
                best, least = at, total
    return best


@kernel
def farthest_ends(rows, links, out_far):
    """Length of the longest link of each ball to one that it overlaps, 0 for none."""
    length, radii = links.length, links.radii
    for v in rows:
        for at in range(links.offsets[v], links.offsets[v + 1]):
            if length[at] < radii[v] + radii[links.neighbours[at]]:
                out_far[v] = max(out_far[v], length[at])


@kernel
def steps_from(starts, offsets, neighbours, queue, steps, parent):
    """Breadth-first trees from vertices: steps to the root, and the next vertex on the way there.

    `steps` and `parent` come with -1, and keep it at the roots' `parent` and where no way leads.
    """
    count, done = len(starts), 0
    for i in range(count):
        queue[i] = starts[i]
        steps[starts[i]] = 0
    while done < count:
        v = queue[done]
        done += 1
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if steps[w] < 0:
                steps[w], parent[w] = steps[v] + 1, v
                queue[count] = w
                count += 1


@kernel
def join_faces(sides, twins, group, out_left):
    """Join the faces on both sides of each side in turn; marks the sides that joined nothing.

    With the sides of no tree of vertices (tree-cotree, Eppstein 2003) 2 g are left on a closed
    surface of genus g. `group` comes with the number of each face.
    """
    for at in range(len(sides)):
        a, b = find_root(group, sides[at] // 3), find_root(group, twins[sides[at]] // 3)
        out_left[at] = a == b
        group[max(a, b)] = min(a, b)


@kernel
def fill_boxes(surface):
    """Fill in the box round each triangle and all below it, and its plane.

    Children come after their parents.
    """
    points, corners, children, lowest, highest, normals, levels, _ = surface
    for t in range(len(corners) - 1, -1, -1):
        a, b, c = points[corners[t, 0]], points[corners[t, 1]], points[corners[t, 2]]
        for axis in range(3):
            low, high = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
            for child in children[t]:
                if child >= 0:
                    low, high = min(low, lowest[child, axis]), max(high, highest[child, axis])
            lowest[t, axis], highest[t, axis] = low, high
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        size = max(math.sqrt(x * x + y * y + z * z), 1e-300)
        normals[t, 0], normals[t, 1], normals[t, 2] = x / size, y / size, z / size
        levels[t] = (x * a[0] + y * a[1] + z * a[2]) / size


@kernel
def _volume(p, q, a, b):
    """Six times the signed volume of four points."""
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = a[0] - p[0], a[1] - p[1], a[2] - p[2]
    wx, wy, wz = b[0] - p[0], b[1] - p[1], b[2] - p[2]
    return ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)


@kernel
def _passes(p, q, points, i, j):
    """Tell on which side of a directed edge a line passes: the other one for the edge reversed."""
    if i < j:
        return _volume(p, q, points[i], points[j]) > 0.0
    return not _volume(p, q, points[j], points[i]) > 0.0


@kernel
def _crossing(p, q, points, corner):
    """Whether the segment from p to q crosses a triangle: 1 along its normal, -1 against it."""
    a, b, c = points[corner[0]], points[corner[1]], points[corner[2]]
    above = _volume(a, b, c, p) > 0.0
    if above == (_volume(a, b, c, q) > 0.0):
        return 0
    side = _passes(p, q, points, corner[0], corner[1])
    if side != _passes(p, q, points, corner[1], corner[2]):
        return 0
    if side != _passes(p, q, points, corner[2], corner[0]):
        return 0
    return -1 if above else 1


@kernel
def _is_away(x, y, z, far, low, high):
    """Whether a box lies farther from a place along an axis than so far."""
    if x + far < low[0] or y + far < low[1] or z + far < low[2]:
        return True
    return x - far > high[0] or y - far > high[1] or z - far > high[2]


@kernel
def cross_links(begin, stop, rows, reach, links, surface, out_turns):
    """Count how often links between balls that overlap cross the surface, against its normals.

    `reach` is the length of the longest such link of each ball (k,). `out_turns` has one place for
    each link and comes with 0.
    """
    centers, radii, points, normals = links.centers, links.radii, surface.points, surface.normals
    stack = np.empty(DEEPEST, np.int64)
    for i in range(begin, stop):
        v = rows[i]
        x, y, z, far = centers[v, 0], centers[v, 1], centers[v, 2], reach[v] + surface.slack
        stack[0], size = 0, 1
        while size > 0:
            size -= 1
            t = stack[size]
            if _is_away(x, y, z, far, surface.lowest[t], surface.highest[t]):
                continue
            for child in surface.children[t]:
                if child >= 0:
                    stack[size] = child
                    size += 1
            off = normals[t, 0] * x + normals[t, 1] * y + normals[t, 2] * z - surface.levels[t]
            if abs(off) > far:
                continue
            for at in range(links.offsets[v], links.offsets[v + 1]):
                w = links.neighbours[at]
                if links.length[at] >= radii[v] + radii[w]:
                    continue
                low, high, sign = (v, w, -1) if v < w else (w, v, 1)
                corner = surface.corners[t]
                out_turns[at] += sign * _crossing(centers[low], centers[high], points, corner)


@kernel
def take_turns(rows, offsets, turns, out_links, out_turns):
    """List the links of some balls that have turns, and set those to 0; returns how many."""
    count = 0
    for v in rows:
        for at in range(offsets[v], offsets[v + 1]):
            if turns[at] != 0:
                out_links[count], out_turns[count] = at, turns[at]
                turns[at] = 0
                count += 1
    return count


@kernel
def list_links(ends, others, needed, groups, centers, radii, places, out_neighbours):
    """List links from both their ends, at the places of each ball, which then move on.

    Row i of `others` are balls that ball ``ends[i]`` may be linked to (-1: none): of the same
    group, and where the link is not needed, each within the other. Without room in `out_neighbours`
    they are only counted.
    """
    for i in range(len(ends)):
        a = ends[i]
        for j in range(others.shape[1]):
            b = others[i, j]
            if b < 0 or a == b or groups[a] != groups[b] or groups[a] < 0:
                continue
            if not needed and not distance(centers, a, b) < min(radii[a], radii[b]):
                continue
            if len(out_neighbours) > 0:
                out_neighbours[places[a]], out_neighbours[places[b]] = b, a
            places[a] += 1
            places[b] += 1


@kernel
def sort_links(offsets, neighbours, out_offsets, out_neighbours):
    """Write links that are listed from both ends in ascending order, each once; return how many.

    Passing on the lists of each ball in turn to the other ends sorts those.
    """
    k = len(offsets) - 1
    last = offsets[:-1].copy()
    for v in range(k):
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if last[w] == offsets[w] or out_neighbours[last[w] - 1] != v:
                out_neighbours[last[w]] = v
                last[w] += 1
    count = 0
    for v in range(k):
        out_offsets[v] = count
        for at in range(offsets[v], last[v]):
            out_neighbours[count] = out_neighbours[at]
            count += 1
    out_offsets[k] = count
    return count


@kernel
def weigh_links(begin, end, links, dearness):
    """Fill in length and cost of the links of the balls begin..end (see `link_balls`)."""
    radii = links.radii
    for v in range(begin, end):
        for at in range(links.offsets[v], links.offsets[v + 1]):
            w = links.neighbours[at]
            apart, smaller = distance(links.centers, v, w), min(radii[v], radii[w])
            long = 1.0 + apart / max(SHORT_LINK * smaller, links.spacing)
            cost = apart * long * (dearness[v] + dearness[w]) / 2.0
            if apart >= radii[v] + radii[w]:
                cost *= APART_COST
            elif apart >= smaller:
                cost *= OVERLAP_COST
            links.length[at], links.cost[at] = apart, cost + LEAST_COST * links.spacing


SAME_PLACE = 0.3
"""Radii: centers this close belong to one ball as far as its contacts go."""

HOPS = 8
"""Balls that are followed from contact to contact."""

LEAST_SPOKES = 6
"""Contacts of a ring at least: those of three balls."""

ACROSS = 0.5
"""Sine of the angle to the axis of a ring from which on a spoke says where round it it lies."""

WIDEST_GAP = 5.0 * math.pi / 6.0
"""Radians between neighbouring contacts of a ball that touches the surface all round."""

OFF_AXIS = 0.06
"""Square of the sine of 14 degrees: where contacts are all round, one lies farther than that off
each side of any axis, as no gap is wider than 150 degrees."""

TIE = 0.01
"""Two geodesics are equally long when they differ by less than this share. A half circle of 30
edges is 0.2 % shorter than round."""


class Balls(NamedTuple):
    """The r of k balls that have a geodesic, and their nearest others.

    Attributes
    ----------
    rows : (r,) int64
        Their numbers among all balls.
    near, distance : (r, c) int32, float64
        The others, numbered among the r.
    length : (r,) float64
        Of the geodesic.
    tangent : (r, 3) float64
        Unit direction in which it runs, zero for none.
    feature : (r, 3) float64
        Unit direction between the feature points.
    centers, radii, features : (k, 3), (k,) float64, (k, 2) int32
        All balls.
    points : (n, 3) float64
        The samples.
    ball_of : (n,) int64
        The ball of each sample, one of the r, or -1.
    spokes : (k, 2, 3) float64
        Unit directions from each of the r to its contacts (`point_spokes`).
    """

    rows: NDArray[np.int64]
    near: NDArray[np.int32]
    distance: NDArray[np.float64]
    length: NDArray[np.float64]
    tangent: NDArray[np.float64]
    feature: NDArray[np.float64]
    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    features: NDArray[np.int32]
    points: NDArray[np.float64]
    ball_of: NDArray[np.int64]
    spokes: NDArray[np.float64]


@kernel
def median_of(values):
    """Median of a few values, which are sorted in place; 0 of none."""
    k = len(values)
    if k == 0:
        return 0.0
    for i in range(1, k):
        value = values[i]
        j = i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = value
    if k % 2:
        return values[k // 2]
    return (values[k // 2 - 1] + values[k // 2]) / 2


@kernel
def measure_spread(begin, stop, balls, smallest, out_spread):
    """How far tangents turn: (1 - cos) / 2 of the second largest angle to those of the neighbours.

    0 where all point the same way, 1 where two neighbours' point the opposite way. A neighbour with
    a tangent counts as far as its line of contacts is parallel and its geodesic as long.
    """
    near, length = balls.near, balls.length
    for i in range(begin, stop):
        sigma = max(median_of(balls.distance[i].copy()), smallest)
        largest, out_spread[i] = 0.0, 0.0
        for c in range(near.shape[1]):
            j = near[i, c]
            here, there = balls.tangent[i], balls.tangent[j]
            side = abs(there[0]) + abs(there[1]) + abs(there[2])
            if side == 0.0 or abs(length[i] - length[j]) > 2.0 * balls.distance[i, c] + sigma:
                continue
            same = abs(dot(balls.feature[i], balls.feature[j]))
            value = same * (1.0 - dot(here, there)) / 2.0
            if value > largest:
                largest, out_spread[i] = value, largest
            elif value > out_spread[i]:
                out_spread[i] = value


@kernel
def point_spokes(begin, stop, balls, out_spokes):
    """Fill in the unit directions from the center of each ball to both its contacts, (k, 2, 3)."""
    for i in range(begin, stop):
        row = balls.rows[i]
        for side in range(2):
            sample, spoke = balls.features[row, side], out_spokes[row, side]
            for k in range(3):
                spoke[k] = balls.points[sample, k] - balls.centers[row, k]
            size = max(math.sqrt(dot(spoke, spoke)), 1e-300)
            for k in range(3):
                spoke[k] /= size


@kernel
def _is_near(centers, a, b, reach):
    gap = 0.0
    for k in range(3):
        gap += (centers[a, k] - centers[b, k]) ** 2
    return gap <= reach * reach


@kernel
def find_rings(begin, stop, balls, out_ring, out_opposite, out_tangent):
    """Balls that touch the surface all round: gaps between contacts stay below 150 degrees.

    The contacts are those of the ball and of others at the same place: its neighbours, and the
    ball of its second contact, that of the second contact of that one, and so on (`ball_of` has the
    ball of each sample, or -1). Each is seen from its own ball. `out_opposite` receives the contact
    farthest from f1, `out_tangent` a direction across, both for rings only.
    """
    rows, near, spokes = balls.rows, balls.near, balls.spokes
    most = near.shape[1] + 1 + HOPS
    members, along = np.empty(most, np.int64), np.empty((most, 2))
    angles, flat, across = np.empty(2 * most), np.empty((2 * most, 2)), np.empty(3)
    for i in range(begin, stop):
        out_ring[i] = False
        count, again, reach, row = 0, False, SAME_PLACE * balls.radii[rows[i]], rows[i]
        for _ in range(1 + HOPS):
            members[count] = row
            count += 1
            row = balls.ball_of[balls.features[row, 1]]
            if row < 0 or not _is_near(balls.centers, row, rows[i], reach):
                break
            again = count > 1 and row == members[count - 2]
            if again:  # to and fro between two balls, for ever
                break
        for c in range(near.shape[1]):
            if balls.distance[i, c] <= reach:
                members[count] = rows[near[i, c]]
                count += 1
        if 2 * count < LEAST_SPOKES and not again:
            continue
        first, best, best_size, lowest = spokes[rows[i], 0], 0, 0.0, 2.0
        for c in range(2 * count):
            here = members[c // 2]
            along[c // 2, c % 2] = size = dot(spokes[here, c % 2], first)
            if c > 0 and 1.0 - size * size > best_size:
                best, best_size = c, 1.0 - size * size
            if c > 0 and size < lowest:
                lowest = size
                out_opposite[i] = balls.features[here, c % 2]
        if best_size < ACROSS * ACROSS:
            continue
        for k in range(3):
            out = spokes[members[best // 2], best % 2, k] - along[best // 2, best % 2] * first[k]
            across[k] = out / math.sqrt(best_size)
        used, behind, below = 0, False, False
        for c in range(2 * count):
            x, y = along[c // 2, c % 2], dot(spokes[members[c // 2], c % 2], across)
            size = x * x + y * y
            if size > ACROSS * ACROSS:
                flat[used, 0], flat[used, 1] = x, y
                behind |= x < 0.0 and x * x > OFF_AXIS * size
                below |= y < 0.0 and y * y > OFF_AXIS * size
                used += 1
        if not (behind and below):
            continue
        for c in range(used):
            angle = math.atan2(flat[c, 1], flat[c, 0])
            at = c
            while at > 0 and angles[at - 1] > angle:
                angles[at] = angles[at - 1]
                at -= 1
            angles[at] = angle
        gap = angles[0] + 2.0 * math.pi - angles[used - 1]
        for c in range(1, used):
            gap = max(gap, angles[c] - angles[c - 1])
        if gap < WIDEST_GAP:
            out_ring[i] = True
            for k in range(3):
                out_tangent[i, k] = across[k]


@kernel
def _leave(walk, h, start, end, way, normal, longest, near):
    """Cut a surface by a plane through two of its points, beginning over the face of half-edge h.

    Returns the length of the cut from one to the other, inf where it does not arrive or is longer
    than `longest`, and how far it begins along a direction: anything where it does not begin.
    """
    length, count = cut_from(walk, h, start, end, normal, longest, np.empty(0, np.int64), near)
    along = 0.0
    for k in range(3):
        along += (near[0, k] - walk.points[start, k]) * way[k]
    return length if count >= 0 else math.inf, along


@kernel
def trace_all_round(begin, stop, walk, ends, tangent, longest, out_length):
    """Lengths of the straightest geodesics that leave f1 in evenly spread directions.

    Direction 0 is the tangent of the ball; a plane through f1 and f2 serves two directions, half a
    turn apart. A direction whose plane cut does not arrive, or is longer than `longest`, gets inf.
    `walk` is that of `surface_walk`.
    """
    points, _, _, fan_offsets, fan = walk
    half = out_length.shape[1] // 2
    frame, near, axis, normal = np.empty((2, 3)), np.zeros((2, 3)), np.empty(3), np.empty(3)
    first, way = frame[0], np.empty(3)
    for i in range(begin, stop):
        start, end = ends[i, 0], ends[i, 1]
        out_length[i] = np.inf
        if distance(points, start, end) == 0.0:
            continue
        direction(points[start], points[end], axis)
        along = dot(axis, tangent[i])
        for k in range(3):
            first[k] = tangent[i, k] - along * axis[k]
        size = math.sqrt(dot(first, first))
        if size < 1e-9:
            continue
        for k in range(3):
            first[k] /= size
        cross(axis, first, frame[1])
        for number in range(half):
            turn(frame, math.pi * number / half, way)
            cross(axis, way, normal)
            for at in range(fan_offsets[start], fan_offsets[start + 1]):
                length, ahead = _leave(walk, fan[at], start, end, way, normal, longest, near)
                column = number if ahead >= 0.0 else number + half
                out_length[i, column] = min(out_length[i, column], length)


@kernel
def _shortest_cut(walk, start, end, way, normal, ahead, longest, strip, near):
    """Length of the shortest cut from one point to another that begins ahead, or behind.

    `longest` where none is shorter. `strip` and `near` are room for `cut_from`.
    """
    points, fan = walk.points, walk.fan
    offset = dot(normal, points[start])
    for at in range(walk.offsets[start], walk.offsets[start + 1]):
        across, x, y, z = way_out(points, walk.corners, fan[at], normal, offset)
        if across < 0:
            continue
        along = (x - points[start, 0]) * way[0] + (y - points[start, 1]) * way[1]
        if (along + (z - points[start, 2]) * way[2] > 0.0) == ahead:
            length, count = cut_from(walk, fan[at], start, end, normal, longest, strip, near)
            longest = length if count >= 0 and length < longest else longest
    return longest


@kernel
def find_ties(begin, stop, walk, ends, tangent, longest, out_tied):
    """Whether geodesics to both sides in the plane of the tangent are equally long.

    Both are plane cuts, so that they are comparable; what is longer than `longest` does not count.
    The geodesic runs ahead: most often nothing behind is as short, and its own cut is not followed.
    """
    points, room = walk.points, (np.empty(0, np.int64), np.zeros((2, 3)))
    axis, normal = np.empty(3), np.empty(3)
    for i in range(begin, stop):
        start, end, way = ends[i, 0], ends[i, 1], tangent[i]
        for k in range(3):
            axis[k] = points[end, k] - points[start, k]
        cross(axis, way, normal)
        out_tied[i] = False
        behind = _shortest_cut(walk, start, end, way, normal, False, longest[i], *room)
        if behind < longest[i]:
            most = min(longest[i], (1.0 + 2.0 * TIE) * behind)
            ahead = _shortest_cut(walk, start, end, way, normal, True, most, *room)
            longer = max(ahead, behind)
            out_tied[i] = ahead < most and longer <= (1.0 + TIE) * min(ahead, behind)


@kernel
def spheroid_wedge(half_width, long_axis, angle):
    """Area of the wedge of an oblate spheroid with radii a and c >= a (Eq. 3.4)."""
    a, c = half_width, max(long_axis, half_width)
    if a < 1e-8 * c or c == 0.0:  # e is 1, its atanh infinite, and a a times it below rounding
        return angle * c * c
    e = math.sqrt(max(0.0, 1.0 - (a / c) ** 2))
    # ln((1 + e) / (1 - e)) / (2 e) = 1 + e^2/3 + ...: 1 for a sphere.
    stretch = math.atanh(e) / e if e > 1e-4 else 1.0 + e * e / 3.0
    return angle * (c * c + a * a * stretch)


@kernel
def least_half(begin, stop, length, half_width, out_area):
    """Smallest area of half a turn of wedges between geodesics (Eq. 3.5).

    Directions without a length take that of the nearest one that has; without any the area is 0.
    """
    count = length.shape[1]
    beta = 2.0 * math.pi / count
    axis, wedge = np.empty(count), np.empty(count)
    for i in range(begin, stop):
        a = half_width[i]
        for k in range(count):
            # The half perimeter of an ellipse is close to pi (a + b) / 2.
            axis[k] = max(a, 2.0 * length[i, k] / math.pi - a)
        out_area[i] = 0.0
        if _known(axis, 0, count) == np.inf:
            continue
        for k in range(count):
            b, following = _known(axis, k, count), _known(axis, (k + 1) % count, count)
            wedge[k] = spheroid_wedge(a, (b + following) / 2.0, beta)
        total = 0.0
        for k in range(count // 2):
            total += wedge[k]
        least = total
        for k in range(count):
            total += wedge[(k + count // 2) % count] - wedge[k]
            least = min(least, total)
        out_area[i] = least


@kernel
def _known(axis, k, count):
    """Value at k, else at the nearest place round the circle that has one, else inf."""
    for step in range(count // 2 + 1):
        if axis[(k + step) % count] < np.inf:
            return axis[(k + step) % count]
        if axis[(k - step) % count] < np.inf:
            return axis[(k - step) % count]
    return np.inf
