"""Kernels of polylines, and of importance over links between balls (thesis 3.3).

**Polylines** (see geodesics.py): a path over a mesh is shortened to a locally shortest geodesic. A
path is a row of items: the vertices that it passes through, as -1 - vertex, and between them the
half-edges through which it leaves the faces that it crosses (its strip). Two steps alternate:

- **Tighten.** Between two vertices the path becomes the shortest one in its strip. Unfolded into
  the plane, that is a polygon with its ends at two corners. The funnel algorithm (Lee and Preparata
  1984) finds the shortest path inside in one sweep: the two sides of the funnel are lines from the
  last bend to the left and right end of a half-edge; each half-edge of the strip narrows it, until
  one side crosses the other and the path bends there: it passes through a vertex.
- **Reroute.** A vertex with less than pi between the ways in and out, measured through the faces on
  one side, is left out: these faces join the strips before and after it. The old path runs along
  the rim of the new strip, so the next one is shorter.

So no path becomes longer, no strip comes twice, and the search ends: at a path which is straight in
every strip and has at least pi, or a border, on both sides of every vertex. A half-edge without a
twin (border, non-manifold) is never crossed; paths may run along it. As in Xin and Wang 2007.

**Paths through neighbours** (see importance.py). Two balls are neighbours when their first feature
points share an edge of the mesh and their second ones do or are the same vertex. Only where a path
is longer than the one through a neighbour does Dijkstra's search begin, so it visits few balls.

**Connected importance** (see importance.py). Links are taken from the most important to the least;
a link joins the pieces of its two ends (union-find). Above the importance of that link the smaller
piece was an island. A small island is lowered to that importance. Each point is lowered at most
log2(n) times, because its piece at least doubles, so walking over the members of the smaller piece
costs O(n log n) in all. Members form a ring (`following`), and two rings are joined by swapping two
entries. For a large island the peaks of both pieces are recorded: they are to be joined by a
bridge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import find_root, next_side, pop, previous_side, push
from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import (
    distance,
    is_edge,
    trim,
)

STRAIGHT = math.pi - 1e-7
"""Cutting a corner of pi - a saves a^2 / 8 at most: 1e-15 of the length."""

LESS_THAN = 1.0 - 1e-9
"""Shorter by rounding alone is not shorter."""


class _Unfolded(NamedTuple):
    """A strip of m half-edges in the plane.

    Node 0 is the start, the last one the goal; `vertex` and `flat` (m + 3) tell which vertex a node
    is and where it lies, `left` and `right` (m + 1) the nodes at both ends of each half-edge.
    """

    vertex: NDArray[np.int64]
    flat: NDArray[np.float64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]


@kernel
def angle_at(a, i, b, j, c, k):
    """Angle at point b[j] between a[i] and c[k]; rows are not views, which compile slowly."""
    ux, uy, uz = a[i, 0] - b[j, 0], a[i, 1] - b[j, 1], a[i, 2] - b[j, 2]
    wx, wy, wz = c[k, 0] - b[j, 0], c[k, 1] - b[j, 1], c[k, 2] - b[j, 2]
    x, y, z = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    return math.atan2(math.sqrt(x * x + y * y + z * z), ux * wx + uy * wy + uz * wz)


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
def _unfold(walk, strip):
    """Lay the faces of a strip into the plane."""
    points, corners, twins, _, _ = walk
    m, h = len(strip), strip[0]
    vertex, flat = np.empty(m + 3, np.int64), np.empty((m + 3, 2))
    left, right = np.empty(m + 1, np.int64), np.empty(m + 1, np.int64)
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
            # It runs from c to the corner that t leaves.
            keeps_first = strip[k + 1] == previous_side(t)
            if keeps_first == (corners[t] == vertex[l]):
                right[k + 1], left[k + 1] = node, l
            else:
                right[k + 1], left[k + 1] = r, node
    right[m], left[m] = m + 2, m + 2
    return _Unfolded(vertex, flat, left, right)


@kernel
def _area(flat, a, b, c):
    """Twice the area of a triangle of nodes, positive when c lies to the left of a to b."""
    return (flat[b, 0] - flat[a, 0]) * (flat[c, 1] - flat[a, 1]) - (
        flat[b, 1] - flat[a, 1]
    ) * (flat[c, 0] - flat[a, 0])  # fmt: skip


@kernel
def _funnel(unfolded, last, out):
    """Nodes at which the shortest path through an unfolded strip bends, start and goal included.

    The funnel opens on the first half-edge that does not end at its apex; `last` tells which one of
    each node precedes it. A side that crosses the other one makes that one's node the next apex.
    """
    _, flat, left, right = unfolded
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
def _crossing(points, unfolded, k, a, b, line, count):
    """Where the line from node a to node b crosses half-edge k of the strip."""
    vertex, flat, left, right = unfolded
    u, w = _area(flat, a, b, right[k]), _area(flat, a, b, left[k])
    share = u / (u - w) if u != w else 0.0
    share = min(max(share, 0.0), 1.0)
    p, q = vertex[right[k]], vertex[left[k]]
    for i in range(3):
        line[count, i] = points[p, i] + share * (points[q, i] - points[p, i])


@kernel
def _tighten(walk, items):
    """Shortest path in every strip of a path: its items and their places.

    They are no more than before: each bend takes the place of a half-edge that ends there.
    """
    points = walk.points
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
        begin, end = trim(walk, start, goal, strip, stop - i - 1)
        i = stop
        if start == goal:
            continue
        m = end - begin
        if m > 0:
            unfolded = _unfold(walk, strip[begin:end])
            left, right = unfolded.left, unfolded.right
            first, last = np.empty(m + 3, np.int64), np.empty(m + 3, np.int64)
            last[0] = -1
            for k in range(m, -1, -1):
                first[left[k]], first[right[k]] = k, k
            for k in range(m + 1):
                last[left[k]], last[right[k]] = k, k
            bends = np.empty(m + 2, np.int64)
            number = _funnel(unfolded, last, bends)
            for n in range(number - 1):
                a, b = bends[n], bends[n + 1]
                for k in range(last[a] + 1, first[b]):
                    out[count] = strip[begin + k]
                    _crossing(points, unfolded, k, a, b, line, count)
                    count += 1
                if n + 2 < number:
                    _stop_at(unfolded.vertex[b], points, out, line, count)
                    count += 1
        _stop_at(goal, points, out, line, count)
        count += 1
    return out[:count], line[:count]


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
def _sector(walk, v, h, angle, leaving, ahead, line, i, best, out):
    """Walk round vertex v, from the face into which half-edge h at v leads, to the way out.

    The way out is through half-edge `leaving` at line[i + 1], or, where that is -1, along the edge
    to vertex `ahead`. Returns the angle, inf when it reaches `best` or a border comes first, how
    many half-edges are crossed (written to `out`), and the last face.
    """
    points, corners, twins, _, _ = walk
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
def _smallest_sector(walk, items, line, i, sector, out):
    """Find the side of item i, a vertex, with the smallest angle; inf when none is below pi.

    Returns the angle, how many half-edges that side crosses (in `out`), its first and last face.
    """
    points, corners, twins, offsets, fan = walk
    v = -1 - items[i]
    leaving = items[i + 1] if items[i + 1] >= 0 else -1
    ahead = -1 if leaving >= 0 else -1 - items[i + 1]
    best, count, first, last = math.inf, 0, -1, -1
    limit = STRAIGHT
    sector = sector[: offsets[v + 1] - offsets[v] + 1]  # no face is walked through twice
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
                onward = twins[exit_edge]
                found, crossed, face = _sector(
                    walk, v, onward, angle, leaving, ahead, line, i, limit, sector[1:]
                )
                crossed += 1
            if found < limit:
                best, limit, count, first, last = found, found, crossed, t // 3, face
                copy(sector, count, out, 0)
        return best, count, first, last
    behind = -1 - items[i - 1]
    for k in range(offsets[v], offsets[v + 1]):
        for side in range(2):
            h = fan[k] if side == 0 else previous_side(fan[k])
            if _far(corners, h, v) != behind:
                continue
            found, crossed, face = _sector(walk, v, h, 0.0, leaving, ahead, line, i, limit, sector)
            if found < limit:
                best, limit, count, first, last = found, found, crossed, h // 3, face
                copy(sector, count, out, 0)
    return best, count, first, last


@kernel
def _reroute(walk, items, line):
    """Leave out every vertex that has less than pi on one side; returns whether there was one."""
    corners, twins, room, widest = walk.corners, walk.twins, len(items), 0
    for item in items:
        if item < 0:
            size = walk.offsets[-item] - walk.offsets[-1 - item]
            room += size + 2
            widest = max(widest, size + 2)
    out, count, changed = np.empty(room, np.int64), 0, False
    sector, chosen = np.empty(widest, np.int64), np.empty(widest, np.int64)
    at_vertex, before = False, -1  # whether the item before was left out, and the last face there
    for i in range(len(items)):
        if items[i] < 0 and 0 < i < len(items) - 1:
            angle, crossed, first, last = _smallest_sector(walk, items, line, i, sector, chosen)
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
def shorten(walk, items):
    """Shorten a path, given as items, until no vertex can be left out; returns its points."""
    items, line = _tighten(walk, items)
    length = _length(line)
    while True:
        wider, changed = _reroute(walk, items, line)
        if not changed:
            return line
        items, shorter = _tighten(walk, wider)
        size = _length(shorter)
        if not size < length:
            return line
        line, length = shorter, size


@kernel
def relax_lengths(rows, row_of, walk, ends, length, origin):
    """Lower the lengths of some rows, in place; `origin` becomes the row whose path they take.

    `row_of` tells the row of each vertex, -1: none; `ends` (k, 2) the vertices that paths join.
    """
    points, corners, _, offsets, fan = walk
    keys, names, size = np.empty(1024), np.empty(1024, np.int64), 0
    for turn in range(2):
        at = 0
        while (turn == 0 and at < len(rows)) or (turn == 1 and size > 0):
            if turn == 0:
                row = rows[at]
                at += 1
            else:
                size = pop(keys, names, size)
                row = names[size]
                if keys[size] > length[row]:
                    continue
            if not length[row] < math.inf:
                continue
            start, end = ends[row, 0], ends[row, 1]
            for i in range(2 * offsets[start], 2 * offsets[start + 1]):
                h = fan[i // 2]
                near = row_of[corners[next_side(h) if i % 2 == 0 else previous_side(h)]]
                if near < 0 or length[near] <= length[row]:
                    continue
                found = length[row] + distance(points, start, ends[near, 0])
                if found >= LESS_THAN * length[near]:
                    continue
                other = ends[near, 1]
                found += distance(points, end, other)
                if found >= LESS_THAN * length[near]:
                    continue
                if end != other and not is_edge(walk, end, other):
                    continue
                if size + 1 >= len(keys):
                    keys = np.concatenate((keys, np.empty_like(keys)))
                    names = np.concatenate((names, np.empty_like(names)))
                if turn == 0:
                    size = push(keys, names, size, length[row], row)
                    break
                length[near], origin[near] = found, origin[row]
                size = push(keys, names, size, found, near)


@kernel
def join_pieces(links, order, level, strength, large, out_importance, out_tree, out_bridges):
    """Lower small islands in `out_importance`.

    `links` (e, 2) are taken in `order`, with falling strength[level]. `out_tree` receives the links
    that joined pieces, `out_bridges` the peaks of two pieces of at least `large` points each.
    Returns the numbers of both.
    """
    n = len(out_importance)
    parent, following, peak = np.arange(n), np.arange(n), np.arange(n)
    size = np.ones(n, np.int64)
    joined, bridges = 0, 0
    for e in order:
        a, b = find_root(parent, links[e, 0]), find_root(parent, links[e, 1])
        if a == b:
            continue
        out_tree[joined, 0], out_tree[joined, 1] = links[e, 0], links[e, 1]
        joined += 1
        if size[a] < size[b] or (size[a] == size[b] and a > b):
            a, b = b, a
        if size[b] >= large:
            out_bridges[bridges, 0], out_bridges[bridges, 1] = peak[a], peak[b]
            bridges += 1
        else:
            member, lowest = b, strength[level[e]]
            for _ in range(size[b]):
                if out_importance[member] > lowest:
                    out_importance[member] = lowest
                member = following[member]
        if out_importance[peak[b]] > out_importance[peak[a]]:
            peak[a] = peak[b]
        parent[b] = a
        size[a] += size[b]
        following[a], following[b] = following[b], following[a]
    return joined, bridges


@kernel
def falling_links(links, rank, centers, longest):
    """Levels of links, the rank of their lower end, n where they are too long; and their order."""
    n = len(rank)
    level, place = np.empty(len(links), np.int32), np.zeros(n + 2, np.int64)
    for e in range(len(links)):
        a, b = links[e, 0], links[e, 1]
        apart = 0.0
        for i in range(3):
            apart += (centers[a, i] - centers[b, i]) ** 2
        level[e] = n if apart > longest * longest else max(rank[a], rank[b])
        place[level[e] + 1] += 1
    for k in range(n + 1):
        place[k + 1] += place[k]
    order = np.empty(len(links), np.int64)
    for e in range(len(links)):
        order[place[level[e]]] = e
        place[level[e]] += 1
    return level, order


@kernel
def best_neighbours(edges, values):
    """For each point the neighbour of the highest value above its own, or the point itself."""
    best = np.arange(len(values)).astype(np.int32)
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if values[b] > values[best[a]]:
            best[a] = b
        if values[a] > values[best[b]]:
            best[b] = a
    return best
