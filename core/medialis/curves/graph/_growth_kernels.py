"""Kernels that grow a graph along linked balls (thesis 3.6.3; see growth.py)."""

from __future__ import annotations

import numpy as np

from medialis._kernels.heap_kernels import pop, push
from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import find_root


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
def weigh_paths(
    order, parent, radii, offsets, neighbours, length, weight, prime, path, anchor
):  # fmt: skip
    """Weigh the turns of the path from each ball to the root, in rising cost.

    `weight` is that of each link, modulo the prime. Balls of the tree (no parent) keep theirs.
    `anchor` becomes the last ball on the path that does not overlap the one after it, else that of
    the root: links between balls that are apart may leave the shape, so that turns are certain
    between balls of the same anchor only.
    """
    for v in order:
        p = parent[v]
        if p < 0:
            continue
        anchor[v] = anchor[p]
        for at in range(offsets[p], offsets[p + 1]):
            if neighbours[at] == v:
                if length[at] >= radii[v] + radii[p]:
                    anchor[v] = v
                path[v] = (path[p] + weight[at]) % prime
                break


@kernel
def cheapest_closing_link(
    rows, radii, offsets, neighbours, length, cost, spent, weight, prime, path, anchor
):  # fmt: skip
    """Return the cheapest link that closes a path which weighs something, -1 for none.

    Only links between balls that overlap count, and whose turns are certain (`weigh_paths`).
    """
    best, least = -1, np.inf
    for v in rows:
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            total = spent[v] + cost[at] + spent[w]
            if w <= v or total >= least:
                continue
            if length[at] >= radii[v] + radii[w] or anchor[v] != anchor[w]:
                continue
            if (path[v] + weight[at] - path[w]) % prime != 0:
                best, least = at, total
    return best


@kernel
def farthest_ends(rows, radii, offsets, neighbours, length, out_far):
    """Length of the longest link of each ball to one that it overlaps, 0 for none."""
    for v in rows:
        for at in range(offsets[v], offsets[v + 1]):
            if length[at] < radii[v] + radii[neighbours[at]]:
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
