"""Kernels of complexes: the dual of inside tetrahedra, its spikes, its growth, its topology.

1. The dual: edges across faces, polygons round edges; pruning of what bumps made.
2. Growth of a set of Delaunay tetrahedra by those that do not change the topology of its dual. One
   that joins brings a vertex, an edge for each neighbour in the set, and a polygon for each of its
   Delaunay edges that has no other tetrahedron left outside. What it is glued to, its link, is the
   graph of these neighbours, joined by these polygons. Where the link is a tree the homotopy type
   stays; where it is two trees that hang together elsewhere in the set, a loop is closed. A sample
   with no tetrahedron left outside would enclose a hollow: the last one never joins.
3. Ranks over the field of two elements, for Betti numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import pop, push
from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import distance


class Dual(NamedTuple):
    """A complex of v vertices: its edges, the sides of its triangles, and the edges at vertices.

    Attributes
    ----------
    edges : (e, 5) int64
        Two vertices, three samples.
    sides : (f, 3) int64
        Edges of each triangle.
    starts, items : (v + 1,), (2 e,) int64
        The edges of vertex i are items[starts[i]:starts[i + 1]].
    """

    edges: NDArray[np.int64]
    sides: NDArray[np.int64]
    starts: NDArray[np.int64]
    items: NDArray[np.int64]


class Live(NamedTuple):
    """Masks of the vertices, edges and triangles of a complex that are there."""

    vertices: NDArray[np.bool_]
    edges: NDArray[np.bool_]
    faces: NDArray[np.bool_]


class Tables(NamedTuple):
    """Delaunay tetrahedra; neighbour k is across from corner k, -1 for none.

    Attributes
    ----------
    corners, neighbours : (t, 4) int64
    edges : (t, 6) int64
        Numbers of the edges 01, 02, 03, 12, 13, 23.
    inside : (t,) bool
    depth : (t,) float64
    """

    corners: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    edges: NDArray[np.int64]
    inside: NDArray[np.bool_]
    depth: NDArray[np.float64]


class Grown(NamedTuple):
    """How many tetrahedra round each edge and each sample are not in the set, and the set (t,)."""

    left: NDArray[np.int64]
    around: NDArray[np.int64]
    member: NDArray[np.bool_]


class Heap(NamedTuple):
    """Room for a heap of keys and names."""

    keys: NDArray[np.float64]
    names: NDArray[np.int64]


@kernel
def dual_edges(corners, neighbours, number, out):
    """Edges between neighbouring inside tetrahedra: two vertices, three samples; returns how many.

    `number` (t,) is the vertex that a tetrahedron becomes, -1 outside; out (4 t, 5).
    """
    count = 0
    for t in range(len(corners)):
        if number[t] < 0:
            continue
        for k in range(4):
            s = neighbours[t, k]
            if s <= t or number[s] < 0:
                continue
            out[count, 0], out[count, 1] = number[t], number[s]
            column = 2
            for z in range(4):
                if z != k:
                    out[count, column] = corners[t, z]
                    column += 1
            count += 1
    return count


@kernel
def _ring(corners, neighbours, number, t, a, b, out_ring):
    """Count the tetrahedra round edge a b of t; 0 unless all are inside and t is the first."""
    c = 0
    while c in (a, b):
        c += 1
    d = 6 - a - b - c
    low, high, pivot = corners[t, a], corners[t, b], corners[t, d]
    current, leave, new, size = t, c, -1, 0
    while size < len(out_ring):
        out_ring[size] = current
        size += 1
        beyond = neighbours[current, leave]
        if beyond == t:
            return size
        if beyond < t or number[beyond] < 0:
            return 0
        for k in range(4):
            w = corners[beyond, k]
            if w == pivot:
                leave = k
            elif w != low and w != high:
                new = w
        current, pivot = beyond, new
    return 0


@kernel
def dual_triangles(corners, neighbours, number, ring, out_edges, out_triangles):
    """Polygons round Delaunay edges as fans from their first tetrahedron; returns both counts.

    out_triangles (.., 5): three vertices, two samples; out_edges (.., 5) are chords of the fans.
    Two tetrahedra that share one edge share no second one, so no chord is made twice.
    """
    edges, triangles = 0, 0
    for t in range(len(corners)):
        if number[t] < 0:
            continue
        for a in range(4):
            for b in range(a + 1, 4):
                size = _ring(corners, neighbours, number, t, a, b, ring)
                for k in range(1, size - 1):
                    row = out_triangles[triangles]
                    row[0], row[1], row[2] = number[ring[0]], number[ring[k]], number[ring[k + 1]]
                    row[3], row[4] = corners[t, a], corners[t, b]
                    triangles += 1
                    if k > 1:
                        chord = out_edges[edges]
                        chord[0], chord[1] = row[0], row[1]
                        chord[2], chord[3], chord[4] = row[3], row[4], row[3]
                        edges += 1
    return edges, triangles


@kernel
def _relief(points, normals, a, b):
    """How far the tangent planes of two contacts meet above their chord."""
    cosine, square = 0.0, 0.0
    for d in range(3):
        cosine += normals[a, d] * normals[b, d]
        square += (points[a, d] - points[b, d]) ** 2
    cosine = min(1.0, max(-1.0, cosine))
    return 0.5 * np.sqrt(square * (1.0 - cosine) / max(1.0 + cosine, 1e-12))


@kernel
def reliefs(rows, first, points, normals, out):
    """Largest relief of the contacts in columns `first` on of each row."""
    for i in range(len(rows)):
        largest = 0.0
        for a in range(first, rows.shape[1]):
            for b in range(a + 1, rows.shape[1]):
                largest = max(largest, _relief(points, normals, rows[i, a], rows[i, b]))
        out[i] = largest


@kernel
def sides_of(triangles, edges, starts, items, out):
    """Rows of the three edges of each triangle; `items` lists the edges at each vertex."""
    for t in range(len(triangles)):
        for k in range(3):
            a, b = triangles[t, k], triangles[t, (k + 1) % 3]
            for i in range(starts[a], starts[a + 1]):
                e = items[i]
                if edges[e, 0] == b or edges[e, 1] == b:
                    out[t, k] = e
                    break


@kernel
def prune(dual, edge_relief, relief, limit, live):
    """Collapse free edges and free vertices while what they carry has a relief below the limit.

    The masks are true at first; elementary collapses keep the homotopy type.
    """
    edges, sides = dual.edges, dual.sides
    count, around = np.zeros(len(edges), np.int64), np.zeros(len(edges), np.int64)
    degree = np.zeros(len(live.vertices), np.int64)
    for t in range(len(sides)):
        for k in range(3):
            count[sides[t, k]] += 1
            around[sides[t, k]] ^= t
    for e in range(len(edges)):
        degree[edges[e, 0]] += 1
        degree[edges[e, 1]] += 1
    free = np.empty(len(edges) + 3 * len(sides), np.int64)
    last, head = 0, 0
    for e in range(len(edges)):
        if count[e] == 1 and relief[around[e]] < limit:
            free[last] = e
            last += 1
    while head < last:
        e = free[head]
        head += 1
        if count[e] != 1:
            continue
        t = around[e]
        live.faces[t], live.edges[e] = False, False
        degree[edges[e, 0]] -= 1
        degree[edges[e, 1]] -= 1
        for k in range(3):
            other = sides[t, k]
            count[other] -= 1
            around[other] ^= t
            if count[other] == 1 and relief[around[other]] < limit:
                free[last] = other
                last += 1
    _prune_vertices(dual, count, edge_relief, limit, degree, live)


@kernel
def _prune_vertices(dual, count, relief, limit, degree, live):
    """Take ends of edges without triangles away, one after the other."""
    for first in range(len(live.vertices)):
        v = first
        while degree[v] == 1:
            e = -1
            for i in range(dual.starts[v], dual.starts[v + 1]):
                if live.edges[dual.items[i]]:
                    e = dual.items[i]
            if count[e] != 0 or relief[e] >= limit:
                break
            live.edges[e], live.vertices[v] = False, False
            degree[v] = 0
            v = dual.edges[e, 0] + dual.edges[e, 1] - v
            degree[v] -= 1


@kernel
def _link(t, tables, state, label):
    """Label the trees of the link, (4,), -1 for none; returns their number, and loops in it."""
    trees, loops = 0, 0
    for k in range(4):
        s = tables.neighbours[t, k]
        label[k] = k if s >= 0 and state.member[s] else -1
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
            if state.left[tables.edges[t, slot]] == 1 and label[c] >= 0 and label[d] >= 0:
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
def _encloses(t, tables, state):
    """Tell whether a corner of t has no other tetrahedron left outside the set."""
    found = False
    for k in range(4):
        found |= state.around[tables.corners[t, k]] == 1
    return found


@kernel
def join(t, tables, state, heap, size):
    """Let t join the set; its neighbours inside come onto the heap, deepest first."""
    corners, neighbours, edges, inside, depth = tables
    left, around, member = state
    member[t] = True
    for slot in range(6):
        left[edges[t, slot]] -= 1
    for k in range(4):
        around[corners[t, k]] -= 1
    for k in range(4):
        s = neighbours[t, k]
        if s >= 0 and inside[s] and not member[s]:
            size = push(heap.keys, heap.names, size, -depth[s], s)
    return size


@kernel
def grow(tables, state, heap, size, waiting):
    """Let tetrahedra on the heap join where the topology stays, until none does.

    `waiting` (t,) is scratch for those that may join later.
    """
    member, (keys, names) = state.member, heap
    label = np.empty(4, np.int64)
    queued = np.zeros(len(member), np.bool_)
    count, joined = 0, True
    while joined:
        joined = False
        while size > 0:
            size = pop(keys, names, size)
            t = names[size]
            if member[t]:
                continue
            trees, loops = _link(t, tables, state, label)
            if trees == 1 and loops == 0 and not _encloses(t, tables, state):
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
                    size = push(keys, names, size, -tables.depth[t], t)
        count = kept


@kernel
def closers(rows, tables, state, out):
    """Find tetrahedra among `rows` that would close a loop: out (r, 2) neighbours that they join.

    -1 where one would not.
    """
    neighbours, label = tables.neighbours, np.empty(4, np.int64)
    for i in range(len(rows)):
        t = rows[i]
        out[i, 0], out[i, 1] = -1, -1
        trees, loops = _link(t, tables, state, label)
        if trees != 2 or loops > 0 or _encloses(t, tables, state):
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
            further = so_far + distance(centers, t, s)
            if further < way[s]:
                if way[s] == np.inf:
                    touched[count] = s
                    count += 1
                way[s] = further
                size = push(keys, names, size, further, s)
    for i in range(count):
        way[touched[i]] = np.inf
    return result


@kernel
def free_faces(sides, edge_count, live):
    """Take triangles with an edge of their own away until there are none: no hollow has one."""
    count, around = np.zeros(edge_count, np.int64), np.zeros(edge_count, np.int64)
    for t in range(len(sides)):
        for k in range(3):
            count[sides[t, k]] += 1
            around[sides[t, k]] ^= t
    waiting = np.empty(edge_count, np.int64)
    size = 0
    for e in range(edge_count):
        if count[e] == 1:
            waiting[size] = e
            size += 1
    while size > 0:
        size -= 1
        if count[waiting[size]] != 1:
            continue
        t = around[waiting[size]]
        live[t] = False
        for k in range(3):
            e = sides[t, k]
            count[e] -= 1
            around[e] ^= t
            if count[e] == 1:
                waiting[size] = e
                size += 1


@kernel
def eliminate(sides, edge_count):
    """Count independent sets of triangles without border: sides (t, 3) ascending edges.

    Each triangle is reduced by those with the same last edge; what vanishes closes a hollow.
    """
    owner = np.full(edge_count, -1)
    starts, sizes = np.zeros(len(sides), np.int64), np.zeros(len(sides), np.int64)
    pool, used = np.empty(16 * len(sides) + 64, np.int64), 0
    row, other = np.empty(edge_count, np.int64), np.empty(edge_count, np.int64)
    hollows = 0
    for t in range(len(sides)):
        length = 3
        for k in range(3):
            row[k] = sides[t, k]
        while length > 0 and owner[row[length - 1]] >= 0:
            p = owner[row[length - 1]]
            length = _sum(row, length, pool, starts[p], sizes[p], other)
            row, other = other, row
        if length == 0:
            hollows += 1
            continue
        if used + length > len(pool):
            larger = np.empty(2 * (used + length), np.int64)
            larger[:used] = pool[:used]
            pool = larger
        owner[row[length - 1]] = t
        starts[t], sizes[t] = used, length
        pool[used : used + length] = row[:length]
        used += length
    return hollows


@kernel
def _sum(row, length, pool, start, size, out):
    """Edges in one of two ascending lists but not in both; returns their number."""
    i, j, count = 0, 0, 0
    while i < length or j < size:
        if j == size or (i < length and row[i] < pool[start + j]):
            out[count] = row[i]
            i, count = i + 1, count + 1
        elif i == length or pool[start + j] < row[i]:
            out[count] = pool[start + j]
            j, count = j + 1, count + 1
        else:
            i, j = i + 1, j + 1
    return count
