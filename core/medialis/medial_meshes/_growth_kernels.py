"""Growth of a set of Delaunay tetrahedra by those that do not change the topology of its dual.

A tetrahedron that joins the set brings a vertex to the dual complex, an edge for each neighbour
in the set, and a polygon for each of its Delaunay edges that has no other tetrahedron left outside.
What it is glued to, its link, is the graph of these neighbours, joined by these polygons. Where the
link is a tree the homotopy type stays; where it is two trees that hang together elsewhere in the
set, a loop is closed. A sample with no tetrahedron left outside would enclose a hollow: the last
one never joins.
"""

from __future__ import annotations

import numpy as np

from medialis._kernels.heap_kernels import pop, push
from medialis._kernels.jit import kernel


@kernel
def _link(t, neighbours, edges, left, member, label):
    """Label the trees of the link, (4,), -1 for none; returns their number, and loops in it."""
    trees, loops = 0, 0
    for k in range(4):
        s = neighbours[t, k]
        label[k] = k if s >= 0 and member[s] else -1
        if label[k] >= 0:
            trees += 1
    slot = 0
    for a in range(4):
        for b in range(a + 1, 4):
            # The faces at edge a b lie across from the other two corners.
            c = 0
            while c in (a, b):
                c += 1
            d = 6 - a - b - c
            if left[edges[t, slot]] == 1 and label[c] >= 0 and label[d] >= 0:
                x, y = label[c], label[d]
                if x == y:
                    loops += 1
                else:
                    trees -= 1
                    for k in range(4):
                        if label[k] == y:
                            label[k] = x
            slot += 1
    return trees, loops


@kernel
def _encloses(t, corners, around):
    """Tell whether a corner of t has no other tetrahedron left outside the set."""
    found = False
    for k in range(4):
        found |= around[corners[t, k]] == 1
    return found


@kernel
def join(t, tables, state, heap, size):
    """Let t join the set; its neighbours inside come onto the heap, deepest first."""
    corners, neighbours, edges, inside, depth = tables
    left, around, member = state
    keys, names = heap
    member[t] = True
    for slot in range(6):
        left[edges[t, slot]] -= 1
    for k in range(4):
        around[corners[t, k]] -= 1
    for k in range(4):
        s = neighbours[t, k]
        if s >= 0 and inside[s] and not member[s]:
            size = push(keys, names, size, -depth[s], s)
    return size


@kernel
def grow(tables, state, heap, size, waiting):
    """Let tetrahedra on the heap join where the topology stays, until none does.

    tables: corners (t, 4), neighbours (t, 4), edges (t, 6), inside (t,), depth (t,). state: how
    many tetrahedra round each edge and each sample are not in the set, and the set (t,). `waiting`
    (t,) is scratch for those that may join later.
    """
    corners, neighbours, edges, inside, depth = tables
    left, around, member = state
    keys, names = heap
    label = np.empty(4, np.int64)
    queued = np.zeros(len(inside), np.bool_)
    count, joined = 0, True
    while joined:
        joined = False
        while size > 0:
            size = pop(keys, names, size)
            t = names[size]
            if member[t]:
                continue
            trees, loops = _link(t, neighbours, edges, left, member, label)
            if trees == 1 and loops == 0 and not _encloses(t, corners, around):
                size = join(t, tables, state, heap, size)
                joined = True
            elif not queued[t]:
                queued[t] = True
                waiting[count] = t
                count += 1
        kept = 0
        for i in range(count):
            t = waiting[i]
            if not member[t]:
                waiting[kept] = t
                kept += 1
                if joined:
                    size = push(keys, names, size, -depth[t], t)
        count = kept


@kernel
def closers(rows, tables, state, out):
    """Find tetrahedra among `rows` that would close a loop: out (r, 2) neighbours that they join.

    -1 where one would not.
    """
    corners, neighbours, edges = tables[0], tables[1], tables[2]
    left, around, member = state
    label = np.empty(4, np.int64)
    for i in range(len(rows)):
        t = rows[i]
        out[i, 0], out[i, 1] = -1, -1
        trees, loops = _link(t, neighbours, edges, left, member, label)
        if trees != 2 or loops > 0 or _encloses(t, corners, around):
            continue
        first = -1
        for k in range(4):
            if label[k] < 0:
                continue
            if first < 0:
                first = label[k]
                out[i, 0] = neighbours[t, k]
            elif label[k] != first:
                out[i, 1] = neighbours[t, k]


@kernel
def way_between(start, end, neighbours, centers, member, heap, way):
    """Length of the shortest way in the set between two of its tetrahedra, over their centers.

    `way` (t,) is infinite, and is so again afterwards.
    """
    keys, names = heap
    touched = np.empty(len(way), np.int64)
    way[start] = 0.0
    touched[0] = start
    count, result = 1, np.inf
    size = push(keys, names, 0, 0.0, start)
    while size > 0:
        size = pop(keys, names, size)
        t, so_far = names[size], keys[size]
        if so_far > way[t]:
            continue
        if t == end:
            result = so_far
            break
        for k in range(4):
            s = neighbours[t, k]
            if s < 0 or not member[s]:
                continue
            square = 0.0
            for d in range(3):
                square += (centers[t, d] - centers[s, d]) ** 2
            further = so_far + np.sqrt(square)
            if further < way[s]:
                if way[s] == np.inf:
                    touched[count] = s
                    count += 1
                way[s] = further
                size = push(keys, names, size, further, s)
    for i in range(count):
        way[touched[i]] = np.inf
    return result
