"""Distances to balls, cones and slabs, in closed form.

Between balls (c_i, r_i) centers and radii are linear, so f(l) = |p - c(l)| - r(l) is convex: its
smallest value over a segment or a triangle is the signed distance to their cone or slab, exact
outside. Let g be the gradient of the radius in the plane of the centers. Without the borders f is
smallest where the foot of p has moved by g h / sqrt(1 - g^2), h the height of p over the plane, and
is h sqrt(1 - g^2) - r(foot) there. Where that lies beyond sides, one of those sides has the
smallest value. All but the place is prepared once for each primitive, in a row of a table.
"""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel

SIDE = 11
"""Numbers of a side: start (3), its radius, way to the end (3), growth of the radius, 1 / length^2,
shift of the foot for each height, sqrt(1 - g^2). The last is 0 where one ball holds the other: the
shift then tells which, 0 or 1."""

SIDES = 19
"""Column where the sides 01, 12, 02 begin. Before: number of balls (4: no inside of its own), first
center, its radius, the dual vectors of the sides from it (3, 3), the unit normal (3), growths of
the radius (2), shifts of the foot (2), sqrt(1 - g^2)."""

ROUND = SIDES + 3 * SIDE
"""Column where the middle (3) and the radius of a ball begin that holds the primitive."""

WIDTH = ROUND + 4
"""Numbers of a primitive."""


@kernel
def _prepare_side(balls, i, j, out):
    square = 0.0
    for d in range(3):
        out[d] = balls[i, d]
        out[4 + d] = balls[j, d] - balls[i, d]
        square += out[4 + d] * out[4 + d]
    grows = balls[j, 3] - balls[i, 3]
    out[3], out[7] = balls[i, 3], grows
    if square <= grows * grows * (1.0 + 1e-12) or square < 1e-24:
        out[8], out[9], out[10] = 0.0, 1.0 if grows > 0.0 else 0.0, 0.0
    else:
        lean = np.sqrt(1.0 - grows * grows / square)
        out[8], out[9], out[10] = 1.0 / square, grows / (square * lean), lean


@kernel
def _prepare_inside(balls, i, j, k, out):
    """Fill the columns before the sides; False where a slab has no inside of its own."""
    a, b = balls[j, :3] - balls[i, :3], balls[k, :3] - balls[i, :3]
    ar, br = balls[j, 3] - balls[i, 3], balls[k, 3] - balls[i, 3]
    aa, ab, bb = (a * a).sum(), (a * b).sum(), (b * b).sum()
    area = aa * bb - ab * ab
    if area <= 1e-10 * aa * bb:
        return False
    ga, gb = (ar * bb - br * ab) / area, (br * aa - ar * ab) / area
    steep = ga * ar + gb * br
    if steep >= 1.0:
        return False
    lean = np.sqrt(1.0 - steep)
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        out[5 + d] = (bb * a[d] - ab * b[d]) / area
        out[8 + d] = (aa * b[d] - ab * a[d]) / area
        out[11 + d] = (a[e] * b[f] - a[f] * b[e]) / np.sqrt(area)
    out[14], out[15], out[16], out[17], out[18] = ar, br, ga / lean, gb / lean, lean
    return True


@kernel
def _prepare_round(balls, row, out):
    count = 0
    out[:] = 0.0
    for k in range(3):
        if row[k] >= 0:
            count += 1
            for d in range(3):
                out[d] += balls[row[k], d]
    for d in range(3):
        out[d] /= count
    for k in range(3):
        if row[k] >= 0:
            square = 0.0
            for d in range(3):
                square += (balls[row[k], d] - out[d]) ** 2
            out[3] = max(out[3], np.sqrt(square) + balls[row[k], 3])


@kernel
def is_beyond(p, table, s, limit):
    """Tell that primitive s is no nearer than `limit`, if the ball round it says so."""
    x, y, z = p[0] - table[s, ROUND], p[1] - table[s, ROUND + 1], p[2] - table[s, ROUND + 2]
    reach = limit + table[s, ROUND + 3]
    return reach <= 0.0 or x * x + y * y + z * z >= reach * reach


@kernel
def prepare(balls, rows, out):
    """Fill the table, out (s, WIDTH)."""
    for s in range(len(rows)):
        i, j, k = rows[s]
        for d in range(4):
            out[s, 1 + d] = balls[i, d]
        _prepare_round(balls, rows[s], out[s, ROUND:])
        out[s, 0] = 1.0
        if j >= 0:
            out[s, 0] = 2.0
            _prepare_side(balls, i, j, out[s, SIDES : SIDES + SIDE])
        if k >= 0:
            out[s, 0] = 3.0 if _prepare_inside(balls, i, j, k, out[s]) else 4.0
            _prepare_side(balls, j, k, out[s, SIDES + SIDE : SIDES + 2 * SIDE])
            _prepare_side(balls, i, k, out[s, SIDES + 2 * SIDE : ROUND])


@kernel
def _side_distance(px, py, pz, table, s, first):
    """Signed distance to a cone, and the share of its second ball."""
    x, y, z = px - table[s, first], py - table[s, first + 1], pz - table[s, first + 2]
    dx, dy, dz = table[s, first + 4], table[s, first + 5], table[s, first + 6]
    lean, share = table[s, first + 10], table[s, first + 9]
    if lean > 0.0:
        foot = (x * dx + y * dy + z * dz) * table[s, first + 8]
        hx, hy, hz = x - foot * dx, y - foot * dy, z - foot * dz
        height = np.sqrt(hx * hx + hy * hy + hz * hz)
        share = foot + height * share
        if 0.0 < share < 1.0:
            return height * lean - table[s, first + 3] - foot * table[s, first + 7], share
        share = 0.0 if share <= 0.0 else 1.0
    x, y, z = x - share * dx, y - share * dy, z - share * dz
    far = np.sqrt(x * x + y * y + z * z)
    return far - table[s, first + 3] - share * table[s, first + 7], share


@kernel
def primitive_distance(p, table, s, out):
    """Signed distance to primitive s; out (3,): shares of its balls where the distance is met."""
    px, py, pz, kind = p[0], p[1], p[2], table[s, 0]
    out[0], out[1], out[2] = 1.0, 0.0, 0.0
    if kind == 1.0:
        x, y, z = px - table[s, 1], py - table[s, 2], pz - table[s, 3]
        return np.sqrt(x * x + y * y + z * z) - table[s, 4]
    if kind == 2.0:
        best, share = _side_distance(px, py, pz, table, s, SIDES)
        out[0], out[1] = 1.0 - share, share
        return best
    u, v, w = -1.0, -1.0, -1.0
    if kind == 3.0:
        x, y, z = px - table[s, 1], py - table[s, 2], pz - table[s, 3]
        height = abs(x * table[s, 11] + y * table[s, 12] + z * table[s, 13])
        foot_u = x * table[s, 5] + y * table[s, 6] + z * table[s, 7]
        foot_v = x * table[s, 8] + y * table[s, 9] + z * table[s, 10]
        u, v = foot_u + height * table[s, 16], foot_v + height * table[s, 17]
        w = 1.0 - u - v
        if u >= 0.0 and v >= 0.0 and w >= 0.0:
            out[0], out[1], out[2] = w, u, v
            radius = table[s, 4] + foot_u * table[s, 14] + foot_v * table[s, 15]
            return height * table[s, 18] - radius
    best = np.inf
    if v < 0.0:
        best, share = _side_distance(px, py, pz, table, s, SIDES)
        out[0], out[1] = 1.0 - share, share
    if w < 0.0:
        found, share = _side_distance(px, py, pz, table, s, SIDES + SIDE)
        if found < best:
            best = found
            out[0], out[1], out[2] = 0.0, 1.0 - share, share
    if u < 0.0:
        found, share = _side_distance(px, py, pz, table, s, SIDES + 2 * SIDE)
        if found < best:
            best = found
            out[0], out[1], out[2] = 1.0 - share, 0.0, share
    return best
