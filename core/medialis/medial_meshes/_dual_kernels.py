"""The dual of inside tetrahedra: edges across faces, polygons round edges; pruning its spikes."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


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
def prune(edges, sides, edge_relief, relief, limit, starts, items, live_vertex, live_edge, live):
    """Collapse free edges and free vertices while what they carry has a relief below the limit.

    The masks are true at first; elementary collapses keep the homotopy type.
    """
    count, around = np.zeros(len(edges), np.int64), np.zeros(len(edges), np.int64)
    degree = np.zeros(len(live_vertex), np.int64)
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
        live[t], live_edge[e] = False, False
        degree[edges[e, 0]] -= 1
        degree[edges[e, 1]] -= 1
        for k in range(3):
            other = sides[t, k]
            count[other] -= 1
            around[other] ^= t
            if count[other] == 1 and relief[around[other]] < limit:
                free[last] = other
                last += 1
    _prune_vertices(edges, count, edge_relief, limit, starts, items, degree, live_vertex, live_edge)


@kernel
def _prune_vertices(edges, count, relief, limit, starts, items, degree, live_vertex, live_edge):
    """Take ends of edges without triangles away, one after the other."""
    for first in range(len(live_vertex)):
        v = first
        while degree[v] == 1:
            e = -1
            for i in range(starts[v], starts[v + 1]):
                if live_edge[items[i]]:
                    e = items[i]
            if count[e] != 0 or relief[e] >= limit:
                break
            live_edge[e], live_vertex[v] = False, False
            degree[v] = 0
            v = edges[e, 0] + edges[e, 1] - v
            degree[v] -= 1
