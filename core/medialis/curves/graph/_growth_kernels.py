"""Kernels that grow a graph along linked balls (thesis 3.6.3; see growth.py)."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.heap_kernels import pop, push
from medialis._kernels.jit import kernel


@kernel
def spread_from_tree(
    sources, offsets, neighbours, length, cost, keys, names, spent, parent, path, base
):  # fmt: skip
    """Dijkstra's search from new sources: the cheapest path of each ball to the tree so far.

    `spent` is the cost of that path, `parent` the next ball on it, `path` its length, `base` where
    it ends. They come with the answer for the sources before (inf and -1 at first), so that only
    balls that the new sources serve better are visited. A ball enters the heap at most once
    for each of its links in one search: `keys` and `names` have room for all links and sources.
    """
    size = 0
    for v in sources:
        spent[v], path[v], parent[v], base[v] = 0.0, 0.0, -1, v
        size = push(keys, names, size, 0.0, v)
    while size > 0:
        size = pop(keys, names, size)
        here, v = keys[size], names[size]
        if here > spent[v]:
            continue
        for link in range(offsets[v], offsets[v + 1]):
            w = neighbours[link]
            there = here + cost[link]
            if there < spent[w]:
                spent[w], path[w] = there, path[v] + length[link]
                parent[w], base[w] = v, base[v]
                size = push(keys, names, size, there, w)


@kernel
def count_turns(order, parent, theta, turns):
    """Whole turns round each handle on the path from each ball to the root, in rising cost.

    `theta` (k, c) are angles in turns, known up to whole ones; along a link they change by less
    than half a turn. Balls of the tree (no parent) keep their turns.
    """
    for v in order:
        p = parent[v]
        if p >= 0:
            for c in range(theta.shape[1]):
                turns[v, c] = turns[p, c] + round(theta[v, c] - theta[p, c])


@kernel
def find_closing_links(
    rows, radii, offsets, neighbours, length, spent, theta, turns, out_links
):  # fmt: skip
    """Links that close a path round a handle: the turns of both ends do not match.

    Only links whose ends lie in each other's ball count: along a longer one the angle may change by
    more than half a turn. Returns how many; only the first len(out_links) are listed.
    """
    count = 0
    for v in rows:
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if w <= v or spent[v] == np.inf or spent[w] == np.inf:
                continue
            if length[at] >= min(radii[v], radii[w]):
                continue
            for c in range(theta.shape[1]):
                if turns[v, c] + round(theta[w, c] - theta[v, c]) != turns[w, c]:
                    if count < len(out_links):
                        out_links[count] = at
                    count += 1
                    break
    return count


@kernel
def solid_angles(begin, stop, rows, centers, loop_offsets, loops, points, out_theta):
    """Solid angle of each closed polyline seen from the centers, in turns of 4 pi.

    The polyline is the border of a fan of triangles round its first point (Van Oosterom and
    Strackee 1983); another surface with the same border differs by whole turns.
    """
    for i in range(begin, stop):
        x, y, z = centers[rows[i], 0], centers[rows[i], 1], centers[rows[i], 2]
        for c in range(len(loop_offsets) - 1):
            first = loops[loop_offsets[c]]
            ax, ay, az = points[first, 0] - x, points[first, 1] - y, points[first, 2] - z
            a = math.sqrt(ax * ax + ay * ay + az * az)
            total = 0.0
            bx, by, bz, b = ax, ay, az, a
            for at in range(loop_offsets[c] + 1, loop_offsets[c + 1]):
                v = loops[at]
                cx, cy, cz = points[v, 0] - x, points[v, 1] - y, points[v, 2] - z
                d = math.sqrt(cx * cx + cy * cy + cz * cz)
                triple = (
                    ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
                )
                bottom = (
                    a * b * d
                    + (ax * bx + ay * by + az * bz) * d
                    + (ax * cx + ay * cy + az * cz) * b
                    + (bx * cx + by * cy + bz * cz) * a
                )
                total += 2.0 * math.atan2(triple, bottom)
                bx, by, bz, b = cx, cy, cz, d
            out_theta[rows[i], c] = total / (4.0 * math.pi)


@kernel
def cut_open(corners, twins, offsets, neighbours, start, face, seen, used, parent, out_sides):
    """Sides of a closed surface that are in no spanning tree of vertices nor of faces.

    A tree of vertices from `start` (in `parent`, -1 at its root), then a tree of faces from `face`
    that crosses no side of the first tree. On a closed surface of genus g, 2 g sides are left; each
    closes a loop with the tree of vertices (tree-cotree, Eppstein 2003). Returns how many; `seen`
    (vertices) and `used` (faces) come with False.
    """
    queue = np.empty(max(len(seen), len(used)), np.int64)
    queue[0], seen[start], parent[start] = start, True, -1
    count, done = 1, 0
    while done < count:
        v = queue[done]
        done += 1
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if not seen[w]:
                seen[w], parent[w] = True, v
                queue[count] = w
                count += 1
    crossed = np.zeros(len(corners), np.bool_)
    queue[0], used[face] = face, True
    faces, done = 1, 0
    while done < faces:
        f = queue[done]
        done += 1
        for h in range(3 * f, 3 * f + 3):
            t = twins[h]
            if t < 0 or used[t // 3] or _in_tree(corners, h, parent):
                continue
            used[t // 3], crossed[h], crossed[t] = True, True, True
            queue[faces] = t // 3
            faces += 1
    found = 0
    for at in range(faces):
        for h in range(3 * queue[at], 3 * queue[at] + 3):
            t = twins[h]
            if t > h and not crossed[h] and not _in_tree(corners, h, parent):
                if found < len(out_sides):
                    out_sides[found] = h
                found += 1
    return found


@kernel
def _in_tree(corners, h, parent):
    a = corners[h]
    b = corners[h - 2 if h % 3 == 2 else h + 1]
    return parent[a] == b or parent[b] == a
