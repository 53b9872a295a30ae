"""Kernels of vertex normals (see normals.py): mean of the faces, or of a surface through the ring.

Strategy. Where the faces go all round a vertex without parting at creases, the surface through its
neighbours tells the normal. In a frame (s, t, n) at the vertex a neighbour at (x, y, z), l away,
satisfies

    z = g x + h y + c l^2 / 2 + a (x^2 - y^2) / 2 + b x y

to second order: the term of l^2 alone is a sphere through the vertex, exactly and in every frame;
a and b tell how the curvatures differ. Five unknowns, solved by least squares of the slopes z / l.
A ring of few or badly placed neighbours leaves some of them open: there a and b are kept small, and
the surface is a sphere; a and b enter as one square, so the result turns with the mesh. The normal
is that of the surface at the vertex, (-g, -h, 1).
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

MOST_CORNERS = 64  # of a ring that is walked round; each step looks at all corners
UNEVEN = 1e-2  # weight of a and b against that of a neighbour
EXACT = 1e-10  # weight of all unknowns: rings on one line have solutions without number
SAME_PLACE = 1e-12  # part of the mean squared length of spokes: no direction


@kernel
def group_corners(vertices, out_offsets, out_corners):
    """List the corners 3 f + j of each vertex, ascending."""
    for i in range(len(vertices)):
        out_offsets[vertices[i] + 2] += 1
    for v in range(len(out_offsets) - 1):
        out_offsets[v + 1] += out_offsets[v]
    for i in range(len(vertices)):
        at = out_offsets[vertices[i] + 1]
        out_corners[at] = i
        out_offsets[vertices[i] + 1] = at + 1


@kernel
def _angle(points, faces, corner):
    f, j = corner // 3, corner % 3
    a, b, c = points[faces[f, j]], points[faces[f, (j + 1) % 3]], points[faces[f, (j + 2) % 3]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return math.atan2(math.sqrt(nx * nx + ny * ny + nz * nz), ux * vx + uy * vy + uz * vz)


@kernel
def _least_cosine(corners, units, nx, ny, nz):
    """Least cosine between a direction and the faces at some corners; those without area are 0."""
    least = 1.0
    for i in range(len(corners)):
        u = units[corners[i] // 3]
        least = min(least, nx * u[0] + ny * u[1] + nz * u[2])
    return least


@kernel
def _goes_round(corners, faces, units, crease):
    """Tell whether the faces at some corners of a vertex form one ring that creases do not part.

    `crease` is the cosine of the bend of a crease. A single one ends at the vertex and parts none.
    """
    count = len(corners)
    if count > MOST_CORNERS:
        return False
    at, creases = 0, 0
    for step in range(count):
        f, j = corners[at] // 3, corners[at] % 3
        ahead, found = faces[f, (j + 2) % 3], -1
        for other in range(count):
            g, k = corners[other] // 3, corners[other] % 3
            if faces[g, (k + 1) % 3] == ahead:
                if found >= 0:
                    return False  # three faces at an edge
                found = other
        if found < 0:
            return False
        u, w = units[f], units[corners[found] // 3]
        flat = (u[0] == 0 and u[1] == 0 and u[2] == 0) or (w[0] == 0 and w[1] == 0 and w[2] == 0)
        creases += (not flat) and u[0] * w[0] + u[1] * w[1] + u[2] * w[2] < crease
        at = found
        if at == 0:
            return step == count - 1 and creases < 2
    return False


@kernel
def _solve(matrix, x):
    """Solve a symmetric positive system in place, by its factors L D L^T."""
    size = len(x)
    for i in range(size):
        for j in range(i):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k] * matrix[k, k]
            matrix[i, j] /= matrix[j, j]
        for k in range(i):
            matrix[i, i] -= matrix[i, k] * matrix[i, k] * matrix[k, k]
    for i in range(size):
        for k in range(i):
            x[i] -= matrix[i, k] * x[k]
    for i in range(size):
        x[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            x[i] -= matrix[k, i] * x[k]


@kernel
def _of_surface(vertex, corners, points, faces, nx, ny, nz, matrix, x, row):
    """Compute the normal of the surface through a ring; nx, ny, nz is about the normal."""
    if abs(nx) < 0.6:
        sx, sy, sz = 0.0, nz, -ny
    else:
        sx, sy, sz = -nz, 0.0, nx
    length = math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx / length, sy / length, sz / length
    tx, ty, tz = ny * sz - nz * sy, nz * sx - nx * sz, nx * sy - ny * sx
    p, count = points[vertex], len(corners)
    mean2 = 0.0
    for i in range(count):
        q = points[faces[corners[i] // 3, (corners[i] + 1) % 3]]
        mean2 += (q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2
    mean2 /= count
    unit = math.sqrt(mean2)
    matrix[:] = 0.0
    x[:] = 0.0
    even = 0.0
    for i in range(count):
        q = points[faces[corners[i] // 3, (corners[i] + 1) % 3]]
        dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        length2 = dx * dx + dy * dy + dz * dz
        if length2 <= SAME_PLACE * mean2:
            continue
        length = math.sqrt(length2)
        row[0] = (dx * sx + dy * sy + dz * sz) / length
        row[1] = (dx * tx + dy * ty + dz * tz) / length
        z = (dx * nx + dy * ny + dz * nz) / length
        part = length / unit
        row[2] = part / 2
        row[3] = part * (row[0] * row[0] - row[1] * row[1]) / 2
        row[4] = part * row[0] * row[1]
        even += part * part
        for j in range(5):
            x[j] += row[j] * z
            for k in range(j + 1):
                matrix[j, k] += row[j] * row[k]
    for j in range(5):
        matrix[j, j] += EXACT * count
    matrix[3, 3] += UNEVEN * even
    matrix[4, 4] += UNEVEN * even
    _solve(matrix, x)
    ox, oy, oz = nx - x[0] * sx - x[1] * tx, ny - x[0] * sy - x[1] * ty, nz - x[0] * sz - x[1] * tz
    length = math.sqrt(ox * ox + oy * oy + oz * oz)
    return ox / length, oy / length, oz / length


@kernel
def fill_normals(
    begin, end, points, faces, units, offsets, all_corners, crease, away, smooth, out_normals
):
    """Compute the normals of the vertices begin..end; left as they are (zero) where there is none.

    `units` has the unit normals of the faces, zero without an area. `away` is how far below zero
    the cosine to a face that looks away is. `smooth`: take surfaces through rings.
    """
    matrix, x, row = np.empty((5, 5)), np.empty(5), np.empty(5)
    for v in range(begin, end):
        corners = all_corners[offsets[v] : offsets[v + 1]]
        nx, ny, nz = 0.0, 0.0, 0.0
        for i in range(len(corners)):
            u, angle = units[corners[i] // 3], _angle(points, faces, corners[i])
            nx, ny, nz = nx + angle * u[0], ny + angle * u[1], nz + angle * u[2]
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length <= 1e-12:  # the faces cancel out (a fin): rounding decides
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        least = _least_cosine(corners, units, nx, ny, nz)
        if least < -away:
            continue
        if smooth and _goes_round(corners, faces, units, crease):
            sx, sy, sz = _of_surface(v, corners, points, faces, nx, ny, nz, matrix, x, row)
            if _least_cosine(corners, units, sx, sy, sz) >= min(least, 0.0):
                nx, ny, nz = sx, sy, sz
        out_normals[v, 0], out_normals[v, 1], out_normals[v, 2] = nx, ny, nz
