"""Kernels of balls that triangles constrain (thesis 3.2; see triangle_balls.py).

Strategy. A mesh stands for a smooth surface through its vertices, so a facet T may lie as deep in a
ball as that surface bulges over it, and a tolerance a besides. With the normals n_i at the corners
v_i, the surface of second order over the place x = sum w_i v_i lies

    h(x) = sum over sides ij of w_i w_j b_ij,    b_ij = (n_j - n_i).(v_j - v_i) / 2

above T: for a sphere of radius R with n = v / R it is |v|^2 - |x|^2 = 2 R h(x), exactly. So T
constrains the ball (c, r) where for a place x of T

    |c - x|^2 < (k r - a)^2 - 2 r h(x),

for h = 0 and k = 1 the ball of samples. A facet is relief to balls that see it as a part of a
smooth surface, no more of it than the angle A of a crease: h is at most r sin^2 A / 2. k is less
than 1 where the ball is tangent at a corner of T: the cosine of the angle between the smooth
surface there and T, or T would be a wall to a ball that leaves it at that corner; there h is 0. The
ball tangent at p with normal n has its center at p - r n. With num = |x - p|^2 and
den = 2 n.(p - x), T lies just at its depth where

    (1 - k^2) r^2 - (den - 2 k a - 2 h) r + num - a^2 = 0,

whose lower root is the radius that x allows. The ball shrinks to that of the deepest place, which
is looked for again, until T constrains it no more: each step is a root below the last one, and the
places converge as quickly as in Newton's method. In the end the ball is the one for a = 0.

Triangles hang on the leaves of the tree of samples, at the leaf of their first corner. Bounds of
their own (box and disc, float32, good to `margin`) hold them whole. Within a leaf, the hull of each
triangle is tested first, side by side: the disc round it, or for a sliver, whose disc would reach
far beside it and into balls that it does not touch, the cylinder round its longest side.

Certificate. After a traversal no T lies deeper in (c0, r0) than h + a. By the triangle inequality
none lies deeper than h + tolerance in a ball (c, r) where |c - c0| + max(r - r0, 0) is at most
tolerance - a.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._box_tree_kernels import (
    BITS,
    FAN,
    box_distance2,
    disc_distance2,
    dot,
    lowest_bit,
    nearest_place,
    test_children,
)
from medialis.base.jit import kernel

KNOWN = 16
"""Certificates kept, as for samples."""

MOST_STEPS = 60
"""Of the iteration; each shrinks the ball, and it ends where rounding decides."""

SLIVER = 8.0
"""A face is a sliver where it is so many times as long as it is high."""

SURE = 1e-12
"""Squared length in units of the tree: more than rounding makes of corners that lie outside."""

NOWHERE = -1e15
"""Radius of the disc of a slot left over: never near, whatever the margins."""

BLOCK = 8
"""Faces side by side; the last block of a leaf is filled up with faces that are nowhere."""

MIDDLE, BREADTH, AXIS, THICK, ROWS = 0, 3, 4, 7, 8
"""Rows of `hulls`: middle, radius and axis of disc or cylinder, half the height of the cylinder (0
for a disc); how many."""

COSINE = 3
"""Column of `reliefs`, after the bulges b of the sides: the smallest cosine at the corners."""


class Hung(NamedTuple):
    """Faces hung on the tree of n samples, in b blocks, those of each leaf in blocks of their own.

    Attributes
    ----------
    points : (n, 3) float64
        Samples in tree order, in units of the tree.
    bounds : (nodes, 12, 8) float32
        As those of the tree, round faces.
    child : (nodes,) int64
        Of the tree.
    first : (leaves + 1,) int64
        Where the blocks of each leaf start.
    corners : (8 b, 3) int32
        Samples in tree order; -1 where a slot is left.
    reliefs : (8 b, 4) float64
        Bulges of the sides, and the smallest cosine at the corners (see `Creases`).
    hulls : (b, 8, 8) float32
        Disc or cylinder round each face.
    """

    points: NDArray[np.float64]
    bounds: NDArray[np.float32]
    child: NDArray[np.int64]
    first: NDArray[np.int64]
    corners: NDArray[np.int32]
    reliefs: NDArray[np.float64]
    hulls: NDArray[np.float32]


class TangentBalls(NamedTuple):
    """Balls tangent at samples, and what they touch.

    Attributes
    ----------
    samples : (k,) int32
        In tree order.
    directions : (k, 3) float64
        From the center to the sample.
    signs : (k,) int8
        +1 inside, -1 outside.
    at_own : bool
        Whether faces that meet at the sample itself take part: with a normal of its sector none of
        them constrains a ball.
    radii : (k,) float64
        Shrunk in place.
    faces : (k,) int64
        Slot of the face that a ball touches, -1 where none constrains it.
    weights : (k, 3) float64
        Of the place there at its corners.
    """

    samples: NDArray[np.int32]
    directions: NDArray[np.float64]
    signs: NDArray[np.int8]
    at_own: bool
    radii: NDArray[np.float64]
    faces: NDArray[np.int64]
    weights: NDArray[np.float64]


@kernel
def fill_hulls(begin, end, points, corners, out_hulls):
    """Discs and cylinders round the faces of the blocks begin..end."""
    for block in range(begin, end):
        for slot in range(BLOCK):
            i = block * BLOCK + slot
            a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
            if a >= 0:
                _fill_hull(points, a, b, c, out_hulls[block, :, slot])
                continue
            for row in range(ROWS):
                out_hulls[block, row, slot] = 0.0
            out_hulls[block, BREADTH, slot] = NOWHERE


@kernel
def _fill_hull(points, a, b, c, out):
    ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
    bx, by, bz = points[b, 0], points[b, 1], points[b, 2]
    cx, cy, cz = points[c, 0], points[c, 1], points[c, 2]
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    uu, vv = dot(ux, uy, uz, ux, uy, uz), dot(vx, vy, vz, vx, vy, vz)
    wx, wy, wz = cx - bx, cy - by, cz - bz
    if SLIVER * length < max(max(uu, vv), dot(wx, wy, wz, wx, wy, wz)):
        _lay_along(points, a, b, c, out)
        return
    if length > 0.0:
        nx, ny, nz = nx / length, ny / length, nz / length
    out[AXIS], out[AXIS + 1], out[AXIS + 2], out[THICK] = nx, ny, nz, 0.0
    x, y = np.float32((ax + bx + cx) / 3.0), np.float32((ay + by + cy) / 3.0)
    z = np.float32((az + bz + cz) / 3.0)
    out[MIDDLE], out[MIDDLE + 1], out[MIDDLE + 2] = x, y, z
    far = dot(ax - x, ay - y, az - z, ax - x, ay - y, az - z)
    far = max(far, dot(bx - x, by - y, bz - z, bx - x, by - y, bz - z))
    far = max(far, dot(cx - x, cy - y, cz - z, cx - x, cy - y, cz - z))
    out[BREADTH] = math.sqrt(far)


@kernel
def _lay_along(points, a, b, c, out):
    """Lay a cylinder along the longest side of a sliver."""
    longest, first, second, third = 0.0, a, b, c
    for i, j, k in ((a, b, c), (b, c, a), (c, a, b)):
        d2 = 0.0
        for axis in range(3):
            d2 += (points[j, axis] - points[i, axis]) ** 2
        if d2 > longest:
            longest, first, second, third = d2, i, j, k
    share = 0.0  # of the longest side, where the third corner stands over it
    for axis in range(3):
        side = points[second, axis] - points[first, axis]
        share += side * (points[third, axis] - points[first, axis]) / longest
    for axis in range(3):
        side = points[second, axis] - points[first, axis]
        height = points[third, axis] - points[first, axis] - share * side
        out[AXIS + axis] = side / math.sqrt(longest)
        out[MIDDLE + axis] = points[first, axis] + 0.5 * (side + height)
    along, beside = 0.0, 0.0
    for corner in (a, b, c):
        off, d2 = 0.0, 0.0
        for axis in range(3):
            d = points[corner, axis] - np.float64(out[MIDDLE + axis])
            off += d * np.float64(out[AXIS + axis])
        for axis in range(3):
            d = points[corner, axis] - np.float64(out[MIDDLE + axis])
            d -= off * np.float64(out[AXIS + axis])
            d2 += d * d
        along, beside = max(along, abs(off)), max(beside, d2)
    out[THICK], out[BREADTH] = along, math.sqrt(beside)


@kernel
def gather_corners(points, corners, first, place, out):
    """Corners of the faces of each leaf, each once, and the sum of their normals; how many.

    `first` is that of `Hung`; `place` (n,) holds -1 and is changed. `out` are the points, where
    those of each leaf start, and the sums, of normals as long as faces are large.
    """
    out_points, out_first, out_normals = out
    filled = 0
    for leaf in range(len(first) - 1):
        out_first[leaf] = filled
        mx, my, mz = 0.0, 0.0, 0.0
        for i in range(BLOCK * first[leaf], BLOCK * first[leaf + 1]):
            if corners[i, 0] < 0:
                continue
            for j in range(3):
                p = corners[i, j]
                if place[p] < out_first[leaf]:
                    place[p] = filled
                    for axis in range(3):
                        out_points[filled, axis] = points[p, axis]
                    filled += 1
            a, b, c = place[corners[i, 0]], place[corners[i, 1]], place[corners[i, 2]]
            ax, ay, az = out_points[a, 0], out_points[a, 1], out_points[a, 2]
            ux, uy, uz = out_points[b, 0] - ax, out_points[b, 1] - ay, out_points[b, 2] - az
            vx, vy, vz = out_points[c, 0] - ax, out_points[c, 1] - ay, out_points[c, 2] - az
            mx += uy * vz - uz * vy
            my += uz * vx - ux * vz
            mz += ux * vy - uy * vx
        out_normals[leaf, 0], out_normals[leaf, 1], out_normals[leaf, 2] = mx, my, mz
    out_first[len(first) - 1] = filled
    return filled


@kernel
def _lowest(d1, d2, aa, ab, cc):
    """Lowest place (s, t) of s^2 aa + 2 s t ab + t^2 cc - 2 s d1 - 2 t d2 within a triangle.

    With the sides u and v of the triangle from one corner, aa = u.u, ab = u.v, cc = v.v, d1 = u.w
    and d2 = v.w it is the place nearest to w: the regions of its plane, in turn. Where a bulge
    makes the form fall on both sides of a line, the lowest place is a corner, or on a side.
    """
    d3, d4, d5, d6 = d1 - aa, d2 - ab, d1 - ab, d2 - cc
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        return d1 / (d1 - d3), 0.0
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        return 0.0, d2 / (d2 - d6)
    if va <= 0.0 and d4 >= d3 and d5 >= d6 and d4 - d3 + d5 - d6 > 0.0:
        t = (d4 - d3) / (d4 - d3 + d5 - d6)
        return 1.0 - t, t
    if va >= 0.0 and vb >= 0.0 and vc >= 0.0 and va + vb + vc > 0.0:
        return vb / (va + vb + vc), vc / (va + vb + vc)
    return 0.0, 0.0


@kernel
def _shrink_to(i, nx, ny, nz, sign, r, relief, least, highest, points, corners, reliefs, slot):
    """Shrink the ball tangent at sample i until a triangle lies no deeper in it than it may.

    `slot` is that of the triangle (views of rows would cost a third more), `sign` that of the side
    of the ball, and `highest` the most that h may be of r. The deepest place is that of the least
    |c - x|^2 + 2 r h(x): as the place nearest to c, with all squared lengths of sides less 2 r b.
    All that depends on r does so linearly.

    With f = |c - x|^2 - (r - a)^2 at the corners, the form is the sum of w_i^2 f_i and of w_i w_j
    (f_i + f_j - the squared side less 2 r b). Where all of these are positive T is no wall: so it
    is with nine of ten faces that a large ball nearly touches in a ring.

    Returns (radius, s, t): the same radius when it lies no deeper already; else s and t tell the
    place corner0 + s (corner1 - corner0) + t (corner2 - corner0) that it touches.
    """
    c0, c1, c2 = corners[slot, 0], corners[slot, 1], corners[slot, 2]
    ox, oy, oz = points[c0, 0], points[c0, 1], points[c0, 2]
    ux, uy, uz = points[c1, 0] - ox, points[c1, 1] - oy, points[c1, 2] - oz
    vx, vy, vz = points[c2, 0] - ox, points[c2, 1] - oy, points[c2, 2] - oz
    wx, wy, wz = points[i, 0] - ox, points[i, 1] - oy, points[i, 2] - oz
    uu, vv = dot(ux, uy, uz, ux, uy, uz), dot(vx, vy, vz, vx, vy, vz)
    uv, uw = dot(ux, uy, uz, vx, vy, vz), dot(ux, uy, uz, wx, wy, wz)
    vw, ww = dot(vx, vy, vz, wx, wy, wz), dot(wx, wy, wz, wx, wy, wz)
    un, vn = dot(ux, uy, uz, nx, ny, nz), dot(vx, vy, vz, nx, ny, nz)
    wn = dot(wx, wy, wz, nx, ny, nz)
    k, b0, b1, b2 = 1.0, 0.0, 0.0, 0.0
    if c0 == i or c1 == i or c2 == i:
        k = reliefs[slot, COSINE]
    else:
        b0, b1 = max(sign * reliefs[slot, 0], 0.0), max(sign * reliefs[slot, 1], 0.0)
        b2 = max(sign * reliefs[slot, 2], 0.0)
        n1, n2 = ww - 2.0 * uw + uu, ww - 2.0 * vw + vv
        near = max(ww, max(n1, n2)) < 2.0 * r * r - SURE
        a = relief if near else min(relief, least)
        slack = a * (2.0 * r - a) - SURE
        f0, f1 = ww - 2.0 * r * wn + slack, n1 - 2.0 * r * (wn - un) + slack
        f2 = n2 - 2.0 * r * (wn - vn) + slack
        off = min(f0, min(f1, f2)) >= 0.0 and f0 + f1 >= uu - 2.0 * r * b0
        off = off and f0 + f2 >= vv - 2.0 * r * b2
        off = off and f1 + f2 >= uu - 2.0 * uv + vv - 2.0 * r * b1
        if off and r > a and max(b0, max(b1, b2)) <= 3.0 * highest * r:
            return r, -1.0, -1.0
    best_s, best_t = -1.0, -1.0
    for _ in range(MOST_STEPS):
        s, t = _lowest(
            uw - r * (un + b0), vw - r * (vn + b2),
            uu - 2.0 * r * b0, uv - r * (b0 + b2 - b1), vv - 2.0 * r * b2,
        )  # fmt: skip
        h = (1.0 - s - t) * (s * b0 + t * b2) + s * t * b1
        num = ww - 2.0 * (s * uw + t * vw) + s * s * uu + 2.0 * s * t * uv + t * t * vv
        den = 2.0 * (wn - s * un - t * vn)
        a = least if num >= 2.0 * r * r else relief
        may = k * r - a
        square, linear, rest = 1.0 - k * k, den - 2.0 * (k * a + h), num - a * a
        if h > highest * r:
            square, linear = square + 2.0 * highest, linear + 2.0 * h
        if may <= 0.0 or square * r * r - linear * r + rest >= 0.0:
            break
        if rest <= 0.0 or linear <= 0.0:
            break
        root = math.sqrt(max(linear * linear - 4.0 * square * rest, 0.0))
        less = 2.0 * rest / (linear + root)
        if less >= r:
            break
        r, best_s, best_t = less, s, t
    return r, best_s, best_t


@kernel
def _is_near(hull, f, px, py, pz, x, y, z, r, relief, least):
    """Tell whether face f of a block may constrain the ball with center x, y, z, tangent at px, ...

    The hull of a face is no farther than the face. All is float32, good to `margin`: `relief`
    and `least` are those of `_shrink_to` less the margin. The distance at right angles to the axis
    is that of the foot, without squares that cancel out.
    """
    mx, my, mz = hull[MIDDLE, f], hull[MIDDLE + 1, f], hull[MIDDLE + 2, f]
    nx, ny, nz = hull[AXIS, f], hull[AXIS + 1, f], hull[AXIS + 2, f]
    size = hull[BREADTH, f] + hull[THICK, f]
    dx, dy, dz = px - mx, py - my, pz - mz
    # Faces wholly nearer to p than sqrt(2) r are relief; |d| + size < sqrt(2) r by squares.
    wide2 = dx * dx + dy * dy + dz * dz + size * (r + r + r + size)
    may = r - (relief if wide2 < r * (r + r) else least)
    dx, dy, dz = x - mx, y - my, z - mz
    off = nx * dx + ny * dy + nz * dz
    dx, dy, dz = dx - off * nx, dy - off * ny, dz - off * nz
    beside = math.sqrt(dx * dx + dy * dy + dz * dz) - hull[BREADTH, f]
    beside = beside if beside > 0 else np.float32(0.0)
    off = abs(off) - hull[THICK, f]
    off = off if off > 0 else np.float32(0.0)
    return (off * off + beside * beside < may * may) & (may > 0)


@kernel
def _test_relief(bound, px, py, pz, cx, cy, cz, reach, closer, wide2):
    """`test_children`, but what lies within a distance (squared) of p must be closer.

    Faces there are relief. Asked in one go with all others, which takes half the time.
    """
    fx, fy, fz = np.float32(cx), np.float32(cy), np.float32(cz)
    reach2, closer2 = np.float32(reach * reach), np.float32(closer * closer)
    none, limit = np.int32(0), np.float32(wide2)
    bits = none
    for j in range(FAN):
        ax, bx = px - bound[0, j], bound[3, j] - px
        ay, by = py - bound[1, j], bound[4, j] - py
        az, bz = pz - bound[2, j], bound[5, j] - pz
        dx = ax if ax > bx else bx
        dy = ay if ay > by else by
        dz = az if az > bz else bz
        own = closer2 if dx * dx + dy * dy + dz * dz < limit else reach2
        box, disc = box_distance2(bound, j, fx, fy, fz), disc_distance2(bound, j, fx, fy, fz)
        bits = np.int32(bits | (BITS[j] if (box < own) & (disc < own) else none))
    return bits


@kernel
def _near_faces(hull, px, py, pz, x, y, z, r, relief, least):
    """Faces of a block that may constrain a ball: a bit for each."""
    none = np.int32(0)
    bits = none
    for f in range(BLOCK):
        near = _is_near(hull, f, px, py, pz, x, y, z, r, relief, least)
        bits = np.int32(bits | (BITS[f] if near else none))
    return bits


@kernel
def shrink_to_triangles(begin, end, balls, lengths, least, highest, hung):
    """Shrink the balls begin..end to fit between triangles; lengths are those of `Shrinking`.

    `least` is how deep a face may lie that is no relief, `highest` the most that h may be of r.
    """
    samples, directions, signs, at_own, radii, out_face, out_weights = balls
    _, tolerance, a, _, _, margin = lengths
    points, bounds, child, first, corners, reliefs, hulls = hung
    stack = np.empty(8 * 12 + 8, np.int64)
    hits = np.empty(8 * 12 + 8, np.int32)
    most, fewest = np.float32(a - margin), np.float32(least - margin)
    known = np.full((4, KNOWN), np.inf)  # certificates: centers and radii
    turn = 0
    for i in range(begin, end):
        r = radii[i]
        if not r > 0.0:
            continue
        i0, sign = samples[i], np.float64(signs[i])
        x, y, z = points[i0, 0], points[i0, 1], points[i0, 2]
        nx, ny, nz = directions[i, 0], directions[i, 1], directions[i, 2]
        px, py, pz = np.float32(x), np.float32(y), np.float32(z)
        cx, cy, cz = x - r * nx, y - r * ny, z - r * nz
        certain = 0
        for j in range(KNOWN):
            dx, dy, dz = cx - known[0, j], cy - known[1, j], cz - known[2, j]
            room = tolerance - a - max(r - known[3, j], 0.0)
            certain += (room >= 0.0) & (dx * dx + dy * dy + dz * dz <= room * room)
        if certain > 0:
            continue
        face, best_s, best_t = -1, 0.0, 0.0
        reach, closer = max(r - least + margin, 0.0), max(r - a + margin, 0.0)
        wide2 = (2.0 - 1e-5) * r * r
        stack[0] = 0
        hits[0] = _test_relief(bounds[0], px, py, pz, cx, cy, cz, reach, closer, wide2)
        top = 1
        while top > 0:
            top -= 1
            base, bits = child[stack[top]], hits[top]
            while bits > 0:
                j = lowest_bit(bits)
                bits &= bits - 1
                if base >= 0:
                    inside = _test_relief(
                        bounds[base + j], px, py, pz, cx, cy, cz, reach, closer, wide2
                    )
                    if inside > 0:
                        stack[top], hits[top] = base + j, inside
                        top += 1
                    continue
                leaf = ~base + j
                for block in range(first[leaf], first[leaf + 1]):
                    fx, fy, fz, fr = np.float32(cx), np.float32(cy), np.float32(cz), np.float32(r)
                    near = _near_faces(hulls[block], px, py, pz, fx, fy, fz, fr, most, fewest)
                    while near > 0:
                        slot = BLOCK * block + lowest_bit(near)
                        near &= near - 1
                        one, two, three = corners[slot, 0], corners[slot, 1], corners[slot, 2]
                        if not at_own and (one == i0 or two == i0 or three == i0):
                            continue
                        less, s, t = _shrink_to(
                            i0, nx, ny, nz, sign, r, a, least, highest,
                            points, corners, reliefs, slot,
                        )  # fmt: skip
                        if s >= 0.0:
                            r, best_s, best_t = less, s, t
                            face = slot
                            cx, cy, cz = x - r * nx, y - r * ny, z - r * nz
                            reach, closer = max(r - least + margin, 0.0), max(r - a + margin, 0.0)
                            wide2 = (2.0 - 1e-5) * r * r
        known[0, turn], known[1, turn], known[2, turn], known[3, turn] = cx, cy, cz, r
        turn = (turn + 1) % KNOWN
        if face >= 0:
            less, s, t = _shrink_to(
                i0, nx, ny, nz, sign, r, 0.0, 0.0, highest, points, corners, reliefs, face
            )
            if s >= 0.0:
                r, best_s, best_t = less, s, t
            radii[i] = r
            out_face[i] = face
            out_weights[i, 0] = 1.0 - best_s - best_t
            out_weights[i, 1], out_weights[i, 2] = best_s, best_t


@kernel
def find_contacts(points, faces, touched, weights, out_contact, out_nearest):
    """Places of touched faces by their weights, and the corner nearest to each."""
    for k in range(len(touched)):
        corners, nearest, least = faces[touched[k]], -1, math.inf
        for axis in range(3):
            place = 0.0
            for j in range(3):
                place += weights[k, j] * points[corners[j], axis]
            out_contact[k, axis] = place
        for j in range(3):
            d2 = 0.0
            for axis in range(3):
                d2 += (points[corners[j], axis] - out_contact[k, axis]) ** 2
            if math.sqrt(d2) < least:
                nearest, least = corners[j], math.sqrt(d2)
        out_nearest[k] = nearest


@kernel
def _room(x, y, z, r, margin, hung, stack):
    """Distance of the triangle nearest to a place, where that is less than r; else r."""
    points, bounds, child, first, corners, _, hulls = hung
    fx, fy, fz, slack = np.float32(x), np.float32(y), np.float32(z), np.float32(-margin)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        bits = test_children(bounds[node], x, y, z, r + margin)
        base = child[node]
        while bits > 0:
            j = lowest_bit(bits)
            bits &= bits - 1
            if base >= 0:
                stack[top] = base + j
                top += 1
                continue
            leaf = ~base + j
            for block in range(first[leaf], first[leaf + 1]):
                hull, fr = hulls[block], np.float32(r)
                near = _near_faces(hull, fx, fy, fz, fx, fy, fz, fr, slack, slack)
                while near > 0:
                    slot = BLOCK * block + lowest_bit(near)
                    near &= near - 1
                    a, b, c = corners[slot, 0], corners[slot, 1], corners[slot, 2]
                    apart = nearest_place(x, y, z, points, a, b, c)[2]
                    r = min(r, math.sqrt(apart))
    return r


@kernel
def measure_room(begin, end, centers, margin, hung, radii):
    """Lower the radii begin..end to the distance of the nearest triangle, where that is less."""
    stack = np.empty(8 * 12 + 8, np.int64)
    for i in range(begin, end):
        x, y, z = centers[i, 0], centers[i, 1], centers[i, 2]
        radii[i] = _room(x, y, z, radii[i], margin, hung, stack)


class Below(NamedTuple):
    """Places and the way into the surface there, for k balls; all in units of the tree.

    Attributes
    ----------
    places, inward : (k, 3) float64
    cosines : (k,) float64
        Radius of the ball at each over how deep it lies.
    center : (3,) float64
        Of the tree: where places in the tree are counted from.
    """

    places: NDArray[np.float64]
    inward: NDArray[np.float64]
    cosines: NDArray[np.float64]
    center: NDArray[np.float64]


@kernel
def fit_below(begin, end, below, lengths, hung, depths):
    """Halve the depths begin..end until balls that deep fit in, and smaller ones on the way there.

    `lengths` are the margin, the least share of its radius that a ball has room for, how many
    depths are probed, and how often one is halved at most; it is 0 where that is to be told alone:
    then depths where nothing fits become -1.
    """
    margin, least, probes, halvings = lengths
    stack = np.empty(8 * 12 + 8, np.int64)
    for i in range(begin, end):
        deep, cosine, turn, fits = depths[i], below.cosines[i], 0, False
        while True:
            fits, part = True, 1.0
            for _ in range(probes):
                d = deep / part
                part *= 8.0
                x = (below.places[i, 0] + d * below.inward[i, 0]) - below.center[0]
                y = (below.places[i, 1] + d * below.inward[i, 1]) - below.center[1]
                z = (below.places[i, 2] + d * below.inward[i, 2]) - below.center[2]
                room = _room(x, y, z, d * cosine, margin, hung, stack)
                if not room >= least * d * cosine:
                    fits = False
                    break
            if fits or turn >= halvings:
                break
            deep /= 2.0
            turn += 1
        depths[i] = deep if fits or halvings > 0 else -1.0


@kernel
def count_blocks(place, faces, depth, out_leaf, out_first):
    """Find the leaf that each face hangs on, that of its first corner; and where its blocks start.

    `out_first` (leaves + 1,) is 0.
    """
    n = len(place)
    for f in range(len(faces)):
        lowest = min(min(place[faces[f, 0]], place[faces[f, 1]]), place[faces[f, 2]])
        leaf = (((np.int64(lowest) + 1) << depth) + n - 1) // n - 1
        out_leaf[f] = leaf
        out_first[leaf + 1] += 1
    for leaf in range(len(out_first) - 1):
        out_first[leaf + 1] = out_first[leaf] + (out_first[leaf + 1] + BLOCK - 1) // BLOCK


@kernel
def fill_blocks(place, faces, leaf, first, bulges, cosines, unit, out):
    """Lay faces into the blocks of their leaves; `out` are faces, corners and reliefs of slots."""
    order, corners, reliefs = out
    filled = np.zeros(len(first) - 1, np.int64)
    order[:], corners[:], reliefs[:] = -1, -1, 0.0
    for f in range(len(faces)):
        slot = BLOCK * first[leaf[f]] + filled[leaf[f]]
        filled[leaf[f]] += 1
        order[slot] = f
        for j in range(3):
            corners[slot, j] = place[faces[f, j]]
            reliefs[slot, j] = bulges[f, j] / unit
        reliefs[slot, COSINE] = cosines[f]
