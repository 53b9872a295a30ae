"""Kernels of paths along edges, of polylines, and of importance over links (thesis 3.3).

**Edge paths** (see geodesics.py). A* with the straight line to the end as the estimate, which never
exceeds what remains. The queue is a binary heap in two arrays; a vertex may stand in it several
times, only its first removal counts.

**Polylines** (see polylines.py): a path over a mesh is shortened to a locally shortest geodesic. A
path is a row of items: the vertices that it passes through, as -1 - vertex, and between them the
half-edges through which it leaves the faces that it crosses (its strip). Two steps alternate:

- **Tighten.** Between two vertices the path becomes the shortest one in its strip (`tighten` in
  _plane_kernels.py). Where it bends, it passes through a vertex.
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

import numpy as np

from medialis.base._kernels import find_root, pop, push
from medialis.base.jit import kernel
from medialis.skeleton.importance._geodesic_kernels import EDGES
from medialis.skeleton.importance._plane_kernels import (
    angle_at,
    copy,
    direction,
    distance,
    next_side,
    previous_side,
    tighten,
)


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
    ex, ey, ez = (
        points[b, 0] - points[a, 0],
        points[b, 1] - points[a, 1],
        points[b, 2] - points[a, 2],
    )
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    if size == 0.0:
        return math.inf
    ex, ey, ez = ex / size, ey / size, ez / size
    vx, vy, vz = (
        points[v, 0] - points[a, 0],
        points[v, 1] - points[a, 1],
        points[v, 2] - points[a, 2],
    )
    wx, wy, wz = (
        points[w, 0] - points[a, 0],
        points[w, 1] - points[a, 1],
        points[w, 2] - points[a, 2],
    )
    along_v, along_w = ex * vx + ey * vy + ez * vz, ex * wx + ey * wy + ez * wz
    high_v = math.sqrt(max(vx * vx + vy * vy + vz * vz - along_v * along_v, 0.0))
    high_w = math.sqrt(max(wx * wx + wy * wy + wz * wz - along_w * along_w, 0.0))
    at = along_v * high_w + along_w * high_v
    if not 0.0 < at < size * (high_v + high_w):
        return math.inf
    return math.sqrt((along_w - along_v) ** 2 + (high_v + high_w) ** 2)


@kernel
def _search(
    points,
    corners,
    twins,
    fan_offsets,
    fan,
    start,
    end,
    r,
    most,
    length,
    parent,
    reached,
    settled,
    heap,
):
    """Search number r: fills the lengths and parents of the vertices reached, returns the queue.

    With `twins` (else empty) also straight over half-edges h to the vertex across, whose parent is
    then -2 - h. The queue holds at most one entry for each improvement of a vertex; it grows by
    doubling. A vertex is settled once, so a search ends after at most n of them; it is given up
    after `most`, and then the end is not settled.
    """
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
        for i in range(fan_offsets[v], fan_offsets[v + 1]):
            h = fan[i]
            after, before = h - 2 if h % 3 == 2 else h + 1, h + 2 if h % 3 == 0 else h - 1
            for turn in range(3 if len(twins) > 0 else 2):
                if turn < 2:
                    w = corners[after if turn == 0 else before]
                else:
                    t = twins[after]
                    if t < 0:
                        continue
                    w = corners[t + 2 if t % 3 == 0 else t - 1]
                if settled[w] == r:
                    continue
                step = 0.0
                rest = 0.0
                for a in range(3):
                    step += (points[w, a] - points[v, a]) ** 2
                    rest += (points[w, a] - points[end, a]) ** 2
                step = math.sqrt(step)
                if turn == 2:
                    step = _over(points, v, corners[after], corners[before], w)
                new = length[v] + step
                if (reached[w] != r or new < length[w]) and new < math.inf:
                    reached[w] = r
                    length[w] = new
                    parent[w] = v if turn < 2 else -2 - after
                    if size == len(key):
                        key = np.concatenate((key, np.empty_like(key)))
                        item = np.concatenate((item, np.empty_like(item)))
                    key[size], item[size] = new + math.sqrt(rest), w
                    size += 1
                    _sift_up(key, item, size - 1)
    return key, item


@kernel
def edge_paths(
    begin, end_row, rows, most, points, corners, fan_offsets, fan, starts, ends,
    out_length, out_start_tangent, out_end_tangent, out_status,
):  # fmt: skip
    """Shortest paths along the edges (A*), an upper bound, for the pairs rows[begin..end_row].

    A search that settles more than `most` vertices is given up: its pair stays as it is.
    """
    n = len(points)
    length, parent = np.empty(n), np.empty(n, np.int64)
    # Search in which a vertex was reached, or settled; saves clearing n entries for each search.
    reached, settled = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    heap, no_twins = (np.empty(1024), np.empty(1024, np.int64)), corners[:0]
    for r in range(begin, end_row):
        row = rows[r]
        start, end = starts[row], ends[row]
        heap = _search(
            points, corners, no_twins, fan_offsets, fan, start, end, r, most,
            length, parent, reached, settled, heap,
        )  # fmt: skip
        if settled[end] != r:
            continue
        out_length[row] = length[end]
        out_status[row] = EDGES
        v = end
        direction(points[parent[v]], points[v], out_end_tangent[row])
        while parent[v] != start:
            v = parent[v]
        direction(points[start], points[v], out_start_tangent[row])


@kernel
def short_path(points, corners, twins, fan_offsets, fan, start, end):
    """Shortest path along edges and straight over single edges, as items (see `shorten`).

    These are twice as many directions as the edges have: on a mesh of equilateral triangles it is
    at most 1 / cos(15 degrees), 4 %, too long, not 15 %. Both ends lie in one component.
    """
    n = len(points)
    length, parent = np.empty(n), np.empty(n, np.int64)
    reached, settled = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    heap = np.empty(1024), np.empty(1024, np.int64)
    _search(
        points, corners, twins, fan_offsets, fan, start, end, 0, n,
        length, parent, reached, settled, heap,
    )  # fmt: skip
    path = np.empty(2 * n, np.int64)
    k = len(path)
    v = end
    while v != start:
        k -= 1
        path[k] = -1 - v
        if parent[v] < 0:  # half-edge -2 - parent, opposite to the vertex before
            h = -2 - parent[v]
            k -= 1
            path[k] = h
            v = corners[h + 2 if h % 3 == 0 else h - 1]
        else:
            v = parent[v]
    k -= 1
    path[k] = -1 - start
    return path[k:]


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


LESS = 1.0 - 1e-9
"""Shorter by rounding alone is not shorter."""


@kernel
def _adjacent(corners, fan_offsets, fan, a, b):
    """Whether two vertices share an edge or are the same one."""
    if a == b:
        return True
    for i in range(fan_offsets[a], fan_offsets[a + 1]):
        h = fan[i]
        after, before = h - 2 if h % 3 == 2 else h + 1, h + 2 if h % 3 == 0 else h - 1
        if corners[after] == b or corners[before] == b:
            return True
    return False


@kernel
def relax_lengths(
    rows, row_of, points, corners, fan_offsets, fan, starts, ends, length, origin
):  # fmt: skip
    """Lower the lengths of some rows, in place; `origin` becomes the row whose path they take.

    `row_of` tells the row of each vertex, -1: none.
    """
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
            start = starts[row]
            for i in range(2 * fan_offsets[start], 2 * fan_offsets[start + 1]):
                h = fan[i // 2]
                if i % 2 == 0:
                    near = row_of[corners[h - 2 if h % 3 == 2 else h + 1]]
                else:
                    near = row_of[corners[h + 2 if h % 3 == 0 else h - 1]]
                if near < 0 or length[near] <= length[row]:
                    continue
                found = length[row] + distance(points, start, starts[near])
                if found >= LESS * length[near]:
                    continue
                found += distance(points, ends[row], ends[near])
                if found >= LESS * length[near] or not _adjacent(
                    corners, fan_offsets, fan, ends[row], ends[near]
                ):
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
def join_pieces(
    links, order, level, strength, large, out_importance, out_tree, out_bridges
):  # fmt: skip
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
