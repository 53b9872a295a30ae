"""Kernels of even triangles: long edges split, short ones collapsed, flips, smooth vertices.

See `_edit_kernels` for the arrays of a mesh. `kind` tells what a vertex may do: FREE moves within
the sheet, SLIDING goes as soon as it can along the curve that it lies on, FIXED stays. Curves are
the border and the marked edges; they are neither split nor flipped here.
"""

from __future__ import annotations

import math

from medialis._kernels.jit import kernel
from medialis.midsurfaces._edit_kernels import after, around, before, collapse, flip, may_collapse

FREE, SLIDING, FIXED = 0, 1, 2
"""What a vertex may do: move within the sheet; go, along its curve, as soon as it can; stay."""


@kernel
def _length(points, a, b):
    x, y, z = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    return math.sqrt(x * x + y * y + z * z)


@kernel
def _normal(ax, ay, az, bx, by, bz, cx, cy, cz):
    """Return the normal of a triangle times twice its area."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@kernel
def keeps_sides(points, faces, ring, count, v, avoid, x, y, z, least):
    """Tell whether the faces around a vertex keep their side when it moves to a place.

    Faces that have the corner `avoid` do not count. `least` is the smallest cosine between a face
    before and after; faces without an area may become any.
    """
    p = points[v]
    for i in range(count):
        h = ring[i]
        b, c = faces[h // 3, after(h) % 3], faces[h // 3, before(h) % 3]
        if b == avoid or c == avoid:
            continue
        q, r = points[b], points[c]
        ox, oy, oz = _normal(p[0], p[1], p[2], q[0], q[1], q[2], r[0], r[1], r[2])
        nx, ny, nz = _normal(x, y, z, q[0], q[1], q[2], r[0], r[1], r[2])
        old = math.sqrt(ox * ox + oy * oy + oz * oz)
        new = math.sqrt(nx * nx + ny * ny + nz * nz)
        side = max(_length(points, b, c), 1e-300)
        if new <= 1e-3 * side * side and new < old:
            return False
        if ox * nx + oy * ny + oz * nz < least * old * new:
            return False
    return True


@kernel
def collapse_edges(points, faces, twins, marks, leaving, sizes, kind, low, high, ring, other):
    """Collapse edges shorter than `low` where none longer than `high` follows; return how many.

    The start of an edge that is free joins its end; one that slides does so along its curve,
    however long the edge is.
    """
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
            a, b = faces[h // 3, h % 3], faces[h // 3, after(h) % 3]
            curve = g < 0 or marks[h] != 0
            if turn == 1:
                a, b = b, a
            sliding = kind[a] == SLIDING
            if kind[a] == FIXED or (sliding and not curve):
                continue
            if not sliding and _length(points, a, b) >= low:
                continue
            if not may_collapse(faces, twins, leaving, h, ring, other):
                continue
            n = around(faces, twins, leaving, a, ring)
            if kind[a] == FREE and n < 0:
                continue
            n = abs(n)
            q = points[b]
            if not keeps_sides(points, faces, ring, n, a, b, q[0], q[1], q[2], 0.3):
                continue
            if not sliding:
                longest = 0.0
                for i in range(n):
                    longest = max(
                        longest, _length(points, faces[ring[i] // 3, after(ring[i]) % 3], b)
                    )
                if longest > high:
                    continue
            if turn == 0:
                collapse(faces, twins, marks, leaving, h, ring)
            else:
                # A border edge against its direction: the end joins the start.
                x, y, z = q[0], q[1], q[2]
                collapse(faces, twins, marks, leaving, h, ring)
                # collapse() kept the vertex numbered a: it takes the place and the number of b.
                for i in range(abs(around(faces, twins, leaving, a, ring))):
                    faces[ring[i] // 3, ring[i] % 3] = b
                leaving[b], leaving[a] = leaving[a], -1
                points[b, 0], points[b, 1], points[b, 2] = x, y, z
            done += 1
            break
    return done


@kernel
def find_long(points, faces, twins, marks, sizes, high, out_a, out_b, out_places):
    """List the edges longer than `high` that lie on no curve, and their middles."""
    count = 0
    for h in range(3 * sizes[1]):
        if faces[h // 3, 0] < 0 or twins[h] < h or marks[h] != 0:
            continue
        a, b = faces[h // 3, h % 3], faces[h // 3, after(h) % 3]
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
def flip_edges(points, faces, twins, marks, leaving, sizes, ring):
    """Flip the edges that are not Delaunay, once each; return how many."""
    done = 0
    for h in range(3 * sizes[1]):
        g = twins[h]
        if faces[h // 3, 0] < 0 or g < h or marks[h] != 0:
            continue
        a, b = faces[h // 3, h % 3], faces[h // 3, after(h) % 3]
        c, d = faces[h // 3, before(h) % 3], faces[g // 3, before(g) % 3]
        if c == d:
            continue
        if _cotangent(points, c, a, b) + _cotangent(points, d, a, b) >= -1e-9:
            continue
        there = False
        for i in range(abs(around(faces, twins, leaving, c, ring))):
            e = ring[i]
            if faces[e // 3, after(e) % 3] == d or faces[e // 3, before(e) % 3] == d:
                there = True
        if there:
            continue
        p, q, r, s = points[a], points[b], points[c], points[d]
        x1, y1, z1 = _normal(p[0], p[1], p[2], q[0], q[1], q[2], r[0], r[1], r[2])
        x2, y2, z2 = _normal(q[0], q[1], q[2], p[0], p[1], p[2], s[0], s[1], s[2])
        x, y, z = x1 + x2, y1 + y2, z1 + z2
        u1, v1, w1 = _normal(r[0], r[1], r[2], p[0], p[1], p[2], s[0], s[1], s[2])
        u2, v2, w2 = _normal(s[0], s[1], s[2], q[0], q[1], q[2], r[0], r[1], r[2])
        if u1 * x + v1 * y + w1 * z <= 0.0 or u2 * x + v2 * y + w2 * z <= 0.0:
            continue
        flip(faces, twins, marks, leaving, h)
        done += 1
    return done


@kernel
def smooth_vertices(points, faces, twins, leaving, sizes, kind, ring):
    """Move each free vertex to the middle of the faces around it, weighted by area, in turn."""
    for v in range(sizes[0]):
        if kind[v] != FREE or leaving[v] < 0:
            continue
        n = around(faces, twins, leaving, v, ring)
        if n <= 0:
            continue
        total, x, y, z = 0.0, 0.0, 0.0, 0.0
        p = points[v]
        for i in range(n):
            h = ring[i]
            q, r = points[faces[h // 3, after(h) % 3]], points[faces[h // 3, before(h) % 3]]
            nx, ny, nz = _normal(p[0], p[1], p[2], q[0], q[1], q[2], r[0], r[1], r[2])
            area = math.sqrt(nx * nx + ny * ny + nz * nz)
            total += area
            x += area * (p[0] + q[0] + r[0]) / 3
            y += area * (p[1] + q[1] + r[1]) / 3
            z += area * (p[2] + q[2] + r[2]) / 3
        if total <= 0.0:
            continue
        x, y, z = x / total, y / total, z / total
        if keeps_sides(points, faces, ring, n, v, -1, x, y, z, 0.0):
            points[v, 0], points[v, 1], points[v, 2] = x, y, z
