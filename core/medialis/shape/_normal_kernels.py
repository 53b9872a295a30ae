"""Kernels that fit quadrics to rings of vertices: normals (normals.py) and noise (noise.py).

Strategy of normals. Where the faces go all round a vertex without parting at creases, the surface
through its neighbours tells the normal. In a frame (s, t, n) at the vertex a neighbour at
(x, y, z), l away, satisfies

    z = g x + h y + c l^2 / 2 + a (x^2 - y^2) / 2 + b x y

to second order: the term of l^2 alone is a sphere through the vertex, exactly and in every frame;
a and b tell how the curvatures differ. Five unknowns, solved by least squares of the slopes z / l.
A ring of few or badly placed neighbours leaves some of them open: there a and b are kept small, and
the surface is a sphere; a and b enter as one square, so the result turns with the mesh. The normal
is that of the surface at the vertex, (-g, -h, 1). Elsewhere it is the mean of the faces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import solve
from medialis.base.jit import kernel

MOST_CORNERS = 64  # of a ring that is walked round; each step looks at all corners
UNEVEN = 1e-2  # weight of a and b against that of a neighbour
EXACT = 1e-10  # weight of all unknowns: rings on one line have solutions without number
SAME_PLACE = 1e-12  # part of the mean squared length of spokes: no direction


class Fans(NamedTuple):
    """Triangles by their vertices: corner 3 f + j is corner j of face f.

    Attributes
    ----------
    points : (n, 3) float64
    faces : (m, 3) int32
    offsets : (n + 1,) int64
        Where the corners of each vertex begin.
    corners : (3m,) int32
        Vertex after vertex.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int32]
    offsets: NDArray[np.int64]
    corners: NDArray[np.int32]


@kernel
def _unit_of(points, faces, f):
    """Compute the unit normal of a face, zero without an area: it takes as long to read one."""
    a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
    x, y, z = points[a, 0], points[a, 1], points[a, 2]
    ux, uy, uz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
    vx, vy, vz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(x * x + z * z + y * y)
    return (x / length, y / length, z / length) if length > 0.0 else (x, y, z)


@kernel
def _gather_ring(vertex, mesh, out_ring, out_ends):
    """Mean of the faces at a vertex by angle, not of unit length; its last corners are noted.

    `out_ring` has the normal of the face of each corner, the spoke to the vertex after it, and what
    its angle has as tangent; `out_ends` the vertices after and before the corner. They have all of
    up to `MOST_CORNERS`. Angles come after the places of all: those are waited for once. Rows are
    unsigned: others might be counted from the end, which is looked at each time.
    """
    points, faces, ring = mesh.points, mesh.faces, out_ring
    nx, ny, nz = 0.0, 0.0, 0.0
    x, y, z = points[vertex, 0], points[vertex, 1], points[vertex, 2]
    for begin in range(mesh.offsets[vertex], mesh.offsets[vertex + 1], MOST_CORNERS):
        count = min(mesh.offsets[vertex + 1] - begin, MOST_CORNERS)
        for k in range(count):
            f = np.uint32(mesh.corners[begin + k] // 3)
            j = np.uint32(mesh.corners[begin + k] % 3)
            after, before = np.uint32(faces[f, (j + 1) % 3]), np.uint32(faces[f, (j + 2) % 3])
            ux, uy, uz = points[after, 0] - x, points[after, 1] - y, points[after, 2] - z
            vx, vy, vz = points[before, 0] - x, points[before, 1] - y, points[before, 2] - z
            cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            out_ends[k, 0], out_ends[k, 1] = after, before
            ring[k, 0], ring[k, 1], ring[k, 2] = _unit_of(points, faces, f)
            ring[k, 3], ring[k, 4], ring[k, 5] = ux, uy, uz
            ring[k, 6] = math.sqrt(cx * cx + cy * cy + cz * cz)
            ring[k, 7] = ux * vx + uy * vy + uz * vz
        for k in range(count):
            angle = math.atan2(ring[k, 6], ring[k, 7])
            nx, ny, nz = nx + angle * ring[k, 0], ny + angle * ring[k, 1], nz + angle * ring[k, 2]
    return nx, ny, nz


@kernel
def _least_cosine(vertex, mesh, ring, nx, ny, nz):
    """Least cosine between a direction and the faces at a vertex; those without area are 0."""
    begin, end, least = mesh.offsets[vertex], mesh.offsets[vertex + 1], 1.0
    if end - begin <= MOST_CORNERS:
        for k in range(end - begin):
            least = min(least, nx * ring[k, 0] + ny * ring[k, 1] + nz * ring[k, 2])
        return least
    for i in range(begin, end):
        x, y, z = _unit_of(mesh.points, mesh.faces, mesh.corners[i] // 3)
        least = min(least, nx * x + ny * y + nz * z)
    return least


@kernel
def _goes_round(count, ring, ends, crease):
    """Tell whether the faces at a vertex form one ring that creases do not part.

    `crease` is the cosine of the bend of a crease. A single one ends at the vertex and parts none.
    """
    if count > MOST_CORNERS:
        return False
    at, creases = 0, 0
    for step in range(count):
        found, times, end = 0, 0, ends[at, 1]
        for other in range(count):  # without a branch that is guessed wrong
            same = ends[other, 0] == end
            found, times = other if same else found, times + same
        if times != 1:
            return False  # a border, or three faces at an edge
        here, there, cosine = 0.0, 0.0, 0.0
        for axis in range(3):
            here += abs(ring[at, axis])
            there += abs(ring[found, axis])
            cosine += ring[at, axis] * ring[found, axis]
        creases += here > 0.0 and there > 0.0 and cosine < crease
        at = found
        if at == 0:
            return step == count - 1 and creases < 2
    return False


@kernel
def _slopes(m00, m10, m11, m20, m21, m22, m30, m31, m32, m33,
            m40, m41, m42, m43, m44, x0, x1, x2, x3, x4):  # fmt: skip
    """Return the first two unknowns of a symmetric positive system, as `solve` finds them.

    Written out it takes half the time.
    """
    m10, m20, m30, m40 = m10 / m00, m20 / m00, m30 / m00, m40 / m00
    m11 -= m10 * m10 * m00
    m21 = (m21 - m20 * m10 * m00) / m11
    m31 = (m31 - m30 * m10 * m00) / m11
    m41 = (m41 - m40 * m10 * m00) / m11
    m22 = m22 - m20 * m20 * m00 - m21 * m21 * m11
    m32 = (m32 - m30 * m20 * m00 - m31 * m21 * m11) / m22
    m42 = (m42 - m40 * m20 * m00 - m41 * m21 * m11) / m22
    m33 = m33 - m30 * m30 * m00 - m31 * m31 * m11 - m32 * m32 * m22
    m43 = (m43 - m40 * m30 * m00 - m41 * m31 * m11 - m42 * m32 * m22) / m33
    m44 = m44 - m40 * m40 * m00 - m41 * m41 * m11 - m42 * m42 * m22 - m43 * m43 * m33
    x1 -= m10 * x0
    x2 = x2 - m20 * x0 - m21 * x1
    x3 = x3 - m30 * x0 - m31 * x1 - m32 * x2
    x4 = x4 - m40 * x0 - m41 * x1 - m42 * x2 - m43 * x3
    x4 /= m44
    x3 = x3 / m33 - m43 * x4
    x2 = x2 / m22 - m32 * x3 - m42 * x4
    x1 = x1 / m11 - m21 * x2 - m31 * x3 - m41 * x4
    return x0 / m00 - m10 * x1 - m20 * x2 - m30 * x3 - m40 * x4, x1


@kernel
def _of_surface(count, ring, nx, ny, nz):
    """Compute the normal of the surface through a ring; nx, ny, nz is about the normal."""
    if abs(nx) < 0.6:
        sx, sy, sz = 0.0, nz, -ny
    else:
        sx, sy, sz = -nz, 0.0, nx
    length = math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx / length, sy / length, sz / length
    tx, ty, tz = ny * sz - nz * sy, nz * sx - nx * sz, nx * sy - ny * sx
    mean2 = 0.0
    for i in range(count):
        mean2 += ring[i, 3] * ring[i, 3] + ring[i, 4] * ring[i, 4] + ring[i, 5] * ring[i, 5]
    mean2 /= count
    unit, even = math.sqrt(mean2), 0.0
    x0, x1, x2, x3, x4 = 0.0, 0.0, 0.0, 0.0, 0.0
    m00, m10, m11, m20, m21, m22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    m30, m31, m32, m33, m40, m41, m42, m43, m44 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        dx, dy, dz = ring[i, 3], ring[i, 4], ring[i, 5]
        length2 = dx * dx + dy * dy + dz * dz
        if length2 <= SAME_PLACE * mean2:
            continue
        length = math.sqrt(length2)
        g = (dx * sx + dy * sy + dz * sz) / length
        h = (dx * tx + dy * ty + dz * tz) / length
        z = (dx * nx + dy * ny + dz * nz) / length
        part = length / unit
        c, a, b = part / 2, part * (g * g - h * h) / 2, part * g * h
        even += part * part
        x0, x1, x2, x3, x4 = x0 + g * z, x1 + h * z, x2 + c * z, x3 + a * z, x4 + b * z
        m00, m10, m11 = m00 + g * g, m10 + h * g, m11 + h * h
        m20, m21, m22 = m20 + c * g, m21 + c * h, m22 + c * c
        m30, m31, m32, m33 = m30 + a * g, m31 + a * h, m32 + a * c, m33 + a * a
        m40, m41, m42, m43, m44 = m40 + b * g, m41 + b * h, m42 + b * c, m43 + b * a, m44 + b * b
    more = EXACT * count
    m00, m11, m22 = m00 + more, m11 + more, m22 + more
    m33, m44 = m33 + more + UNEVEN * even, m44 + more + UNEVEN * even
    g, h = _slopes(m00, m10, m11, m20, m21, m22, m30, m31, m32, m33,
                   m40, m41, m42, m43, m44, x0, x1, x2, x3, x4)  # fmt: skip
    ox, oy, oz = nx - g * sx - h * tx, ny - g * sy - h * ty, nz - g * sz - h * tz
    length = math.sqrt(ox * ox + oy * oy + oz * oz)
    return ox / length, oy / length, oz / length


@kernel
def fill_normals(begin, end, mesh, crease, away, smooth, out_normals):
    """Compute the normals of the vertices begin..end; left as they are (zero) where there is none.

    `crease` is the cosine of the bend of a crease, `away` how far below zero the cosine to a face
    that looks away is. `smooth`: take surfaces through rings.
    """
    ring, ends = np.empty((MOST_CORNERS, 8)), np.empty((MOST_CORNERS, 2), np.int64)
    for v in range(begin, end):
        count = mesh.offsets[v + 1] - mesh.offsets[v]
        nx, ny, nz = _gather_ring(v, mesh, ring, ends)
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length <= 1e-12:  # the faces cancel out (a fin): rounding decides
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        least = _least_cosine(v, mesh, ring, nx, ny, nz)
        if least < -away:
            continue
        if smooth and _goes_round(count, ring, ends, crease):
            sx, sy, sz = _of_surface(count, ring, nx, ny, nz)
            lowest = _least_cosine(v, mesh, ring, sx, sy, sz)
            if lowest >= min(least, 0.0):
                nx, ny, nz = sx, sy, sz
        out_normals[v, 0], out_normals[v, 1], out_normals[v, 2] = nx, ny, nz


SINGULAR = 1e-9  # weight of the six terms: neighbours on one line or conic


@kernel
def list_links(edges, most, out_offsets, out_neighbours):
    """Neighbours along edges of those that have at most `most`; `out_offsets` (n + 2,) is 0."""
    for e in range(len(edges)):
        out_offsets[edges[e, 0] + 2] += 1
        out_offsets[edges[e, 1] + 2] += 1
    hubs = out_offsets[2:] > most
    if hubs.any():
        for e in range(len(edges)):
            a, b = edges[e, 0], edges[e, 1]
            if hubs[a] or hubs[b]:
                out_offsets[a + 2] -= 1
                out_offsets[b + 2] -= 1
    for v in range(1, len(out_offsets)):
        out_offsets[v] += out_offsets[v - 1]
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if not (hubs[a] or hubs[b]):
            out_neighbours[out_offsets[a + 1]] = b
            out_neighbours[out_offsets[b + 1]] = a
            out_offsets[a + 1] += 1
            out_offsets[b + 1] += 1


@kernel
def mark_bent(half_edges, bends, least, faces, out_flat):
    """Tell that the vertices of edges that bend by `least` or more are not flat, (n,)."""
    for k in range(len(half_edges)):
        if bends[k] >= least:
            f = half_edges[k] // 3
            j = half_edges[k] - 3 * f
            out_flat[faces[f, j]] = out_flat[faces[f, (j + 1) % 3]] = False


@kernel
def find_rings(rows, steps, offsets, neighbours, out_rings, out_counts):
    """Vertices within some steps of each row, without itself; one more than fit: too many."""
    most, seen = out_rings.shape[1], np.full(len(offsets), -1, np.int32)
    for k in range(len(rows)):
        seen[rows[k]] = k
        count, begin, end = 0, 0, 0
        for step in range(steps):
            for at in range(begin - (step == 0), end):
                v = rows[k] if step == 0 else out_rings[k, at]
                for i in range(offsets[v], offsets[v + 1]):
                    w = neighbours[i]
                    if seen[w] == k:
                        continue
                    seen[w] = k
                    if count < most:
                        out_rings[k, count] = w
                    count += 1
                    if count > most:
                        break
                if count > most:
                    break
            if count > most:
                break
            begin, end = end, count
        out_counts[k] = count


@kernel
def measure_spread(points, rows, rings, counts, out_spread):
    """Covariance of each ring round its mean; `out_spread` (k, 4, 3), the mean as last row."""
    for k in range(len(rows)):
        count = counts[k]
        for axis in range(3):
            total = 0.0
            for i in range(count):
                total += points[rings[k, i], axis]
            out_spread[k, 3, axis] = total / count
        for a in range(3):
            for b in range(3):
                total = 0.0
                for i in range(count):
                    v = rings[k, i]
                    x = points[v, a] - out_spread[k, 3, a]
                    total += x * (points[v, b] - out_spread[k, 3, b])
                out_spread[k, a, b] = total / count


@kernel
def _fill_terms(u, v, terms):
    terms[0], terms[1], terms[2], terms[3], terms[4], terms[5] = 1.0, u, v, u * u, u * v, v * v


@kernel
def measure_off_quadrics(points, rows, rings, counts, means, axes, sizes, out_away):
    """Distance of each row from the quadric through its ring, in deviations of equal noise.

    `axes` (k, 3, 3) has the normal as its first column, `sizes` (k,) the extent of the ring. What
    the noise of the ring makes of the quadric divides the distance.
    """
    matrix, right, terms = np.empty((6, 6)), np.empty((6, 2)), np.empty(6)
    for k in range(len(rows)):
        for a in range(6):
            right[a, 0] = 0.0
            for b in range(a + 1):
                matrix[a, b] = 0.0
        count, size = counts[k], sizes[k]
        for i in range(count + 1):
            v = rings[k, i] if i < count else rows[k]
            x, y, z = (
                points[v, 0] - means[k, 0],
                points[v, 1] - means[k, 1],
                points[v, 2] - means[k, 2],
            )
            h = (x * axes[k, 0, 0] + y * axes[k, 1, 0] + z * axes[k, 2, 0]) / size
            s = (x * axes[k, 0, 2] + y * axes[k, 1, 2] + z * axes[k, 2, 2]) / size
            t = (x * axes[k, 0, 1] + y * axes[k, 1, 1] + z * axes[k, 2, 1]) / size
            _fill_terms(s, t, terms)
            if i == count:
                break
            for a in range(6):
                right[a, 0] += terms[a] * h
                for b in range(a + 1):
                    matrix[a, b] += terms[a] * terms[b]
        for a in range(6):
            matrix[a, a] += SINGULAR * count
            right[a, 1] = terms[a]  # of the row itself
        solve(matrix, right)
        away, carried = h, 0.0
        for a in range(6):
            away -= right[a, 0] * terms[a]
            carried += right[a, 1] * terms[a]
        out_away[k] = abs(away) / math.sqrt(1.0 + max(carried, 0.0)) * size
