"""Kernels that change triangle meshes in place: edges split, flipped and collapsed, even triangles.

Half-edge 3 f + j runs from corner j of face f to the next one. `Mesh` says which arrays there are.
Long edges are split, short ones collapsed, flips make triangles Delaunay, and vertices move to the
middle of what is round them. Curves are the border and the marked edges; they are neither split nor
flipped.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import next_side, previous_side
from medialis.base.jit import kernel

FREE, SLIDING, FIXED = 0, 1, 2
"""What a vertex may do: move within the sheet; go, along its curve, as soon as it can; stay."""

SAME_SIDE = 0.3
"""Least cosine between a face before and after one of its corners moves."""

FLAT = 1e-3
"""Twice the area of a face over the square of its longest side: below, it is a needle."""

DELAUNAY = -1e-9
"""Sum of the cotangents across an edge, from which on it stays."""


class Mesh(NamedTuple):
    """A triangle mesh with room to spare.

    Attributes
    ----------
    points : (p, 3) float64
    faces : (f, 3) int64
        -1 in all corners of a face that is gone.
    twins : (3 f,) int64
        The half-edge across, -1 at a border.
    marks : (3 f,) int32
        What is drawn along an edge, the same on both sides, 0 nothing.
    tags : (f,) int32
        Handed on to what becomes of a face.
    leaving : (p,) int64
        A half-edge that leaves the vertex, -1 without faces.
    sizes : (2,) int64
        Vertices and faces so far.
    ring, other : (r,) int64
        Room for the half-edges that leave a vertex.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    twins: NDArray[np.int64]
    marks: NDArray[np.int32]
    tags: NDArray[np.int32]
    leaving: NDArray[np.int64]
    sizes: NDArray[np.int64]
    ring: NDArray[np.int64]
    other: NDArray[np.int64]


@kernel
def around(mesh, v, out):
    """List the half-edges that leave a vertex, in turn; return their number, negative at a border.

    At a border the list begins at the half-edge after which there is none: it covers the fan.
    """
    twins, start = mesh.twins, mesh.leaving[v]
    if start < 0:
        return 0
    h, count = start, 0
    # Turn back to the border, or once around.
    while True:
        twin = twins[h]
        if twin < 0:
            break
        h = next_side(twin)
        count += 1
        if h == start or count >= len(out):
            break
    closed = h == start and twins[start] >= 0
    first, count = h, 0
    while count < len(out):
        out[count] = h
        count += 1
        twin = twins[previous_side(h)]
        if twin < 0 or twin == first:
            break
        h = twin
    return count if closed else -count


@kernel
def split_edge(mesh, h, x, y, z):
    """Put a vertex on an edge; return its number. The two parts carry the mark of the edge."""
    points, faces, twins, marks, tags, leaving, sizes, _, _ = mesh
    w = sizes[0]
    sizes[0] += 1
    points[w, 0], points[w, 1], points[w, 2] = x, y, z
    g = twins[h]
    f1 = sizes[1]
    g1 = f1 + 1
    sizes[1] += 1 if g < 0 else 2
    hn, hp = next_side(h), previous_side(h)
    f = h // 3
    b, c = faces[f, hn % 3], faces[f, hp % 3]
    mark, outer, outer_mark = marks[h], twins[hn], marks[hn]
    faces[f, hn % 3] = w
    faces[f1, 0], faces[f1, 1], faces[f1, 2] = w, b, c
    tags[f1] = tags[f]
    twins[hn], twins[3 * f1 + 2] = 3 * f1 + 2, hn
    marks[hn] = marks[3 * f1 + 2] = 0
    twins[3 * f1 + 1], marks[3 * f1 + 1] = outer, outer_mark
    if outer >= 0:
        twins[outer] = 3 * f1 + 1
    marks[3 * f1] = mark
    leaving[b], leaving[c], leaving[w] = 3 * f1 + 1, 3 * f1 + 2, 3 * f1
    if g < 0:
        twins[3 * f1] = -1
        return w
    gn, gp = next_side(g), previous_side(g)
    e = g // 3
    a, d = faces[e, gn % 3], faces[e, gp % 3]
    outer, outer_mark = twins[gn], marks[gn]
    faces[e, gn % 3] = w
    faces[g1, 0], faces[g1, 1], faces[g1, 2] = w, a, d
    tags[g1] = tags[e]
    twins[gn], twins[3 * g1 + 2] = 3 * g1 + 2, gn
    marks[gn] = marks[3 * g1 + 2] = 0
    twins[3 * g1 + 1], marks[3 * g1 + 1] = outer, outer_mark
    if outer >= 0:
        twins[outer] = 3 * g1 + 1
    marks[3 * g1] = mark
    twins[h], twins[3 * g1] = 3 * g1, h
    twins[3 * f1], twins[g] = g, 3 * f1
    leaving[a], leaving[d] = 3 * g1 + 1, 3 * g1 + 2
    return w


@kernel
def split_face(mesh, f, x, y, z):
    """Put a vertex into a face; return its number."""
    points, faces, twins, marks, tags, leaving, sizes, _, _ = mesh
    w, f1 = sizes[0], sizes[1]
    f2 = f1 + 1
    sizes[0] += 1
    sizes[1] += 2
    points[w, 0], points[w, 1], points[w, 2] = x, y, z
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    tags[f1] = tags[f2] = tags[f]
    faces[f, 2] = w
    faces[f1, 0], faces[f1, 1], faces[f1, 2] = b, c, w
    faces[f2, 0], faces[f2, 1], faces[f2, 2] = c, a, w
    for side, face in ((1, f1), (2, f2)):
        outer = twins[3 * f + side]
        twins[3 * face], marks[3 * face] = outer, marks[3 * f + side]
        if outer >= 0:
            twins[outer] = 3 * face
    for one, other in ((f, f1), (f1, f2), (f2, f)):
        twins[3 * one + 1], twins[3 * other + 2] = 3 * other + 2, 3 * one + 1
        marks[3 * one + 1] = marks[3 * other + 2] = 0
    leaving[a], leaving[b], leaving[c], leaving[w] = 3 * f, 3 * f1, 3 * f2, 3 * f + 2
    return w


@kernel
def flip(mesh, h):
    """Replace the edge between two faces by the other diagonal of their four corners."""
    faces, twins, marks, leaving = mesh.faces, mesh.twins, mesh.marks, mesh.leaving
    g = twins[h]
    f, e = h // 3, g // 3
    hn, hp, gn, gp = next_side(h), previous_side(h), next_side(g), previous_side(g)
    a, b, c, d = faces[f, h % 3], faces[f, hn % 3], faces[f, hp % 3], faces[e, gp % 3]
    t = (twins[hp], twins[gn], twins[gp], twins[hn])
    m = (marks[hp], marks[gn], marks[gp], marks[hn])
    faces[f, 0], faces[f, 1], faces[f, 2] = c, a, d
    faces[e, 0], faces[e, 1], faces[e, 2] = d, b, c
    for k, slot in enumerate((3 * f, 3 * f + 1, 3 * e, 3 * e + 1)):
        twins[slot], marks[slot] = t[k], m[k]
        if t[k] >= 0:
            twins[t[k]] = slot
    twins[3 * f + 2], twins[3 * e + 2] = 3 * e + 2, 3 * f + 2
    marks[3 * f + 2] = marks[3 * e + 2] = 0
    leaving[a], leaving[b], leaving[c], leaving[d] = 3 * f + 1, 3 * e + 1, 3 * f, 3 * e


@kernel
def may_collapse(mesh, h):
    """Tell whether the start of an edge may join its end: the mesh stays a surface.

    Both may have no common neighbours but the tips of the faces at the edge, and an edge between
    two places of the border must be one of it.
    """
    faces, ring, other = mesh.faces, mesh.ring, mesh.other
    a, b = faces[h // 3, h % 3], faces[h // 3, next_side(h) % 3]
    g = mesh.twins[h]
    n, k = around(mesh, a, ring), around(mesh, b, other)
    if n < 0 and k < 0 and g >= 0:
        return False
    if abs(n) + abs(k) >= len(ring):
        return False
    if 0 < n <= 3 or 0 < k <= 3:
        return False
    if (n == -1 or k == -1) and g < 0 and abs(n) + abs(k) <= 2:
        return False
    common = 0
    for i in range(abs(n)):
        for s in range(2):
            if s == 1 and not (n < 0 and i == abs(n) - 1):
                continue
            u = faces[ring[i] // 3, next_side(ring[i]) % 3]
            if s == 1:
                u = faces[ring[i] // 3, previous_side(ring[i]) % 3]
            for j in range(abs(k)):
                q = other[j]
                if faces[q // 3, next_side(q) % 3] == u:
                    common += 1
                if k < 0 and j == abs(k) - 1 and faces[q // 3, previous_side(q) % 3] == u:
                    common += 1
    return common == (1 if g < 0 else 2)


@kernel
def collapse(mesh, h):
    """Let the start of an edge join its end; two faces go, one at a border."""
    faces, twins, marks, leaving = mesh.faces, mesh.twins, mesh.marks, mesh.leaving
    f, ring = h // 3, mesh.ring
    a, b = faces[f, h % 3], faces[f, next_side(h) % 3]
    g = twins[h]
    n = abs(around(mesh, a, ring))
    for i in range(n):
        faces[ring[i] // 3, ring[i] % 3] = b
    for edge in (h, g):
        if edge < 0:
            continue
        one, two = twins[next_side(edge)], twins[previous_side(edge)]
        mark = max(marks[next_side(edge)], marks[previous_side(edge)])
        face = edge // 3
        tip = faces[face, previous_side(edge) % 3]
        if one >= 0:
            twins[one], marks[one] = two, mark
            leaving[tip] = one if faces[one // 3, one % 3] == tip else next_side(one)
            leaving[b] = next_side(one) if faces[one // 3, one % 3] == tip else one
        if two >= 0:
            twins[two], marks[two] = one, mark
            leaving[tip] = two if faces[two // 3, two % 3] == tip else next_side(two)
            leaving[b] = next_side(two) if faces[two // 3, two % 3] == tip else two
        if one < 0 and two < 0:
            leaving[tip] = -1
        for j in range(3):
            faces[face, j] = -1
            twins[3 * face + j] = -1
            marks[3 * face + j] = 0
    leaving[a] = -1


@kernel
def find_edge(mesh, a, b):
    """Return a half-edge from a to b, else one from b to a; -1: there is no such edge."""
    faces, ring = mesh.faces, mesh.ring
    for turn in range(2):
        v, w = (a, b) if turn == 0 else (b, a)
        for i in range(abs(around(mesh, v, ring))):
            if faces[ring[i] // 3, next_side(ring[i]) % 3] == w:
                return ring[i]
    return -1


@kernel
def split_edges(mesh, a, b, places, out_vertices):
    """Put a vertex on each of some edges, given by their ends; out_vertices: -1 without edge."""
    for i in range(len(a)):
        h = find_edge(mesh, a[i], b[i])
        out_vertices[i] = -1
        if h >= 0:
            out_vertices[i] = split_edge(mesh, h, places[i, 0], places[i, 1], places[i, 2])


@kernel
def _length(points, a, b):
    x, y, z = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    return math.sqrt(x * x + y * y + z * z)


@kernel
def _normal(a, b, c):
    """Return the normal of a triangle times twice its area."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@kernel
def keeps_sides(mesh, count, v, avoid, place, least):
    """Tell whether the faces around a vertex keep their side when it moves to a place.

    The first `count` half-edges of `mesh.ring` leave it. Faces that have the corner `avoid` do not
    count. `least` is the smallest cosine between a face before and after; faces without an area may
    become any.
    """
    points, faces, ring, p = mesh.points, mesh.faces, mesh.ring, mesh.points[v]
    for i in range(count):
        h = ring[i]
        b, c = faces[h // 3, next_side(h) % 3], faces[h // 3, previous_side(h) % 3]
        if b == avoid or c == avoid:
            continue
        q, r = points[b], points[c]
        ox, oy, oz = _normal(p, q, r)
        nx, ny, nz = _normal(place, q, r)
        old = math.sqrt(ox * ox + oy * oy + oz * oz)
        new = math.sqrt(nx * nx + ny * ny + nz * nz)
        side = max(_length(points, b, c), 1e-300)
        if new <= FLAT * side * side and new < old:
            return False
        if ox * nx + oy * ny + oz * nz < least * old * new:
            return False
    return True


@kernel
def collapse_edges(mesh, kind, low, high):
    """Collapse edges shorter than `low` where none longer than `high` follows; return how many.

    `kind` (p,) tells what vertices may do. The start of an edge that is free joins its end; one
    that slides does so along its curve, however long the edge is.
    """
    points, faces, twins, marks, _, leaving, sizes, ring, _ = mesh
    done = 0
    for h in range(3 * sizes[1]):
        if faces[h // 3, 0] < 0:
            continue
        for turn in range(2):
            if faces[h // 3, 0] < 0:
                break
            g = twins[h]
            if turn == 1 and g >= 0:
                break  # its twin has its own turn
            a, b = faces[h // 3, h % 3], faces[h // 3, next_side(h) % 3]
            curve = g < 0 or marks[h] != 0
            if turn == 1:
                a, b = b, a
            sliding = kind[a] == SLIDING
            if kind[a] == FIXED or (sliding and not curve):
                continue
            if not sliding and _length(points, a, b) >= low:
                continue
            if not may_collapse(mesh, h):
                continue
            n = around(mesh, a, ring)
            if kind[a] == FREE and n < 0:
                continue
            n = abs(n)
            x, y, z = points[b, 0], points[b, 1], points[b, 2]
            if not keeps_sides(mesh, n, a, b, (x, y, z), SAME_SIDE):
                continue
            if not sliding:
                longest = 0.0
                for i in range(n):
                    tip = faces[ring[i] // 3, next_side(ring[i]) % 3]
                    longest = max(longest, _length(points, tip, b))
                if longest > high:
                    continue
            collapse(mesh, h)
            if turn == 1:
                # A border edge against its direction: the end joins the start.
                # collapse() kept the vertex numbered a: it takes the place and the number of b.
                for i in range(abs(around(mesh, a, ring))):
                    faces[ring[i] // 3, ring[i] % 3] = b
                leaving[b], leaving[a] = leaving[a], -1
                points[b, 0], points[b, 1], points[b, 2] = x, y, z
            done += 1
            break
    return done


@kernel
def find_long(mesh, high, out_a, out_b, out_places):
    """List the edges longer than `high` that lie on no curve, and their middles."""
    points, faces, twins, marks, count = mesh.points, mesh.faces, mesh.twins, mesh.marks, 0
    for h in range(3 * mesh.sizes[1]):
        if faces[h // 3, 0] < 0 or twins[h] < h or marks[h] != 0:
            continue
        a, b = faces[h // 3, h % 3], faces[h // 3, next_side(h) % 3]
        if _length(points, a, b) > high:
            out_a[count], out_b[count] = a, b
            for d in range(3):
                out_places[count, d] = (points[a, d] + points[b, d]) / 2
            count += 1
    return count


@kernel
def _cotangent(points, tip, a, b):
    """Cotangent of the angle at a tip between two corners."""
    ux, uy, uz = (points[a, 0] - points[tip, 0], points[a, 1] - points[tip, 1],
                  points[a, 2] - points[tip, 2])  # fmt: skip
    vx, vy, vz = (points[b, 0] - points[tip, 0], points[b, 1] - points[tip, 1],
                  points[b, 2] - points[tip, 2])  # fmt: skip
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = math.sqrt(x * x + y * y + z * z)
    return (ux * vx + uy * vy + uz * vz) / max(area, 1e-300)


@kernel
def flip_edges(mesh):
    """Flip the edges that are not Delaunay, once each; return how many."""
    points, faces, twins, marks, ring = mesh.points, mesh.faces, mesh.twins, mesh.marks, mesh.ring
    done = 0
    for h in range(3 * mesh.sizes[1]):
        g = twins[h]
        if faces[h // 3, 0] < 0 or g < h or marks[h] != 0:
            continue
        a, b = faces[h // 3, h % 3], faces[h // 3, next_side(h) % 3]
        c, d = faces[h // 3, previous_side(h) % 3], faces[g // 3, previous_side(g) % 3]
        if c == d:
            continue
        if _cotangent(points, c, a, b) + _cotangent(points, d, a, b) >= DELAUNAY:
            continue
        there = False
        for i in range(abs(around(mesh, c, ring))):
            e = ring[i]
            if faces[e // 3, next_side(e) % 3] == d or faces[e // 3, previous_side(e) % 3] == d:
                there = True
        if there:
            continue
        p, q, r, s = points[a], points[b], points[c], points[d]
        x1, y1, z1 = _normal(p, q, r)
        x2, y2, z2 = _normal(q, p, s)
        x, y, z = x1 + x2, y1 + y2, z1 + z2
        u1, v1, w1 = _normal(r, p, s)
        u2, v2, w2 = _normal(s, q, r)
        if u1 * x + v1 * y + w1 * z <= 0.0 or u2 * x + v2 * y + w2 * z <= 0.0:
            continue
        flip(mesh, h)
        done += 1
    return done


@kernel
def smooth_vertices(mesh, kind):
    """Move each free vertex to the middle of the faces around it, weighted by area, in turn."""
    points, faces, ring = mesh.points, mesh.faces, mesh.ring
    for v in range(mesh.sizes[0]):
        if kind[v] != FREE or mesh.leaving[v] < 0:
            continue
        n = around(mesh, v, ring)
        if n <= 0:
            continue
        total, x, y, z = 0.0, 0.0, 0.0, 0.0
        p = points[v]
        for i in range(n):
            h = ring[i]
            face = faces[h // 3]
            q, r = points[face[next_side(h) % 3]], points[face[previous_side(h) % 3]]
            nx, ny, nz = _normal(p, q, r)
            area = math.sqrt(nx * nx + ny * ny + nz * nz)
            total += area
            x += area * (p[0] + q[0] + r[0]) / 3
            y += area * (p[1] + q[1] + r[1]) / 3
            z += area * (p[2] + q[2] + r[2]) / 3
        if total <= 0.0:
            continue
        x, y, z = x / total, y / total, z / total
        if keeps_sides(mesh, n, v, -1, (x, y, z), 0.0):
            points[v, 0], points[v, 1], points[v, 2] = x, y, z
