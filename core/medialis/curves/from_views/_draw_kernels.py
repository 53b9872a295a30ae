"""Kernels that draw views of triangles: their depths, or a silhouette alone (thesis 3.7.4).

Pixels are hit by their centers. Places of corners are whole numbers, of small parts of a pixel: so
it is exact on which side of an edge a center lies, and of two triangles that share the edge one has
the centers on it. Neighbours leave no gap and hit no pixel twice.

A silhouette needs no triangle: with each triangle turned so that its area is positive, the number
of triangles over a pixel follows from the edges alone. An edge counts by the sides of its two
triangles; where both face the camera, or both face away, it does not count. So only outlines are
walked, row by row, and sums along the rows count the triangles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel

FARTHEST = 1 << 28
"""Parts that a corner may be away: so products of two distances are whole numbers of 64 bits, and
parts are far smaller than what float32 keeps of a depth."""

NARROW = 4
"""Columns up to which all of a row are tried."""


class Box(NamedTuple):
    """Rows first..last - 1 and columns left..right - 1 that hold all of a silhouette."""

    first: int
    last: int
    left: int
    right: int


class Screen(NamedTuple):
    """Corners of triangles as a camera sees them.

    Attributes
    ----------
    spots : (n, 2) int32
        Column and row, in parts of a pixel.
    depths : (n,) float64
    bits : int
        A pixel has 2 to the power of so many parts.
    """

    spots: NDArray[np.int32]
    depths: NDArray[np.float64]
    bits: int


@kernel
def _centers(low, high, bits, size):
    """Return the first and the last pixel whose center lies between two places."""
    half = np.int64(1) << (bits - 1)
    return max((low + half - 1) >> bits, 0), min((high - half) >> bits, size - 1)


@kernel
def project_points(points, center, axes, size, pixel, out):
    """Write the screen of a camera; return the box of the pixels that may be covered."""
    parts = 1 << out.bits
    half, scale = 0.5 * size * parts + 0.5, parts / pixel
    x0, y0, z0 = center[0], center[1], center[2]
    right_x, right_y, right_z = axes[0, 0], axes[0, 1], axes[0, 2]
    up_x, up_y, up_z = axes[1, 0], axes[1, 1], axes[1, 2]
    on_x, on_y, on_z = axes[2, 0], axes[2, 1], axes[2, 2]
    left = top = FARTHEST
    right = bottom = -left
    for i in range(len(points)):
        x, y, z = points[i, 0] - x0, points[i, 1] - y0, points[i, 2] - z0
        across = half + (x * right_x + y * right_y + z * right_z) * scale
        down = half - (x * up_x + y * up_y + z * up_z) * scale
        column = math.floor(min(max(across, -FARTHEST), FARTHEST))
        row = math.floor(min(max(down, -FARTHEST), FARTHEST))
        out.spots[i, 0], out.spots[i, 1] = column, row
        out.depths[i] = x * on_x + y * on_y + z * on_z
        left, right = min(left, column), max(right, column)
        top, bottom = min(top, row), max(bottom, row)
    first, last = _centers(top, bottom, out.bits, size)
    left, right = _centers(left, right, out.bits, size)
    if first > last or left > right:
        return Box(0, 0, 0, 0)
    return Box(first, last + 1, left, right + 1)


@kernel
def _row_span(side, step, col0, col1):
    # Columns of col0..col1 where side - step (col - col0) may be 0 or more: a first and a last one.
    # The division only proposes; the exact test of each column decides.
    if step == 0:
        return (col0, col1) if side >= 0 else (col1 + 1, col1)
    at = side / step
    if step > 0:
        return col0, col0 + math.floor(min(at + 1.0, float(col1 - col0)))
    return col0 + math.ceil(min(max(at - 1.0, 0.0), col1 - col0 + 1.0)), col1


@kernel
def draw_depth_range(faces, screen, out_near, out_far):
    """Draw triangles over what is there; NaN is nothing."""
    spots, depths, bits = screen.spots, screen.depths, screen.bits
    size, half = len(out_near), np.int64(1) << (bits - 1)
    for i in range(len(faces)):
        # Without signs no index is tried from the end: a third faster.
        a, b, c = np.uint32(faces[i, 0]), np.uint32(faces[i, 1]), np.uint32(faces[i, 2])
        xa, xb, xc = np.int64(spots[a, 0]), np.int64(spots[b, 0]), np.int64(spots[c, 0])
        ya, yb, yc = np.int64(spots[a, 1]), np.int64(spots[b, 1]), np.int64(spots[c, 1])
        area = (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
        if area == 0:
            continue
        col0, col1 = _centers(min(xa, xb, xc), max(xa, xb, xc), bits, size)
        row0, row1 = _centers(min(ya, yb, yc), max(ya, yb, yc), bits, size)
        za, zb, zc = depths[a], depths[b], depths[c]
        turned = area < 0  # no branches: which way triangles face nobody can guess
        xb, xc = (xc if turned else xb), (xb if turned else xc)
        yb, yc = (yc if turned else yb), (yb if turned else yc)
        zb, zc = (zc if turned else zb), (zb if turned else zc)
        dx0, dy0, dx1, dy1, dx2, dy2 = xc - xb, yc - yb, xa - xc, ya - yc, xb - xa, yb - ya
        # Sides of the first center, not below 0 inside; of the two triangles at an edge with a
        # center on it, one has it.
        x, y = (col0 << bits) + half, (row0 << bits) + half
        s0 = dx0 * (y - yb) - dy0 * (x - xb) - (0 if (dy0 > 0) | ((dy0 == 0) & (dx0 < 0)) else 1)
        s1 = dx1 * (y - yc) - dy1 * (x - xc) - (0 if (dy1 > 0) | ((dy1 == 0) & (dx1 < 0)) else 1)
        s2 = dx2 * (y - ya) - dy2 * (x - xa) - (0 if (dy2 > 0) | ((dy2 == 0) & (dx2 < 0)) else 1)
        dx0, dy0, dx1 = dx0 << bits, dy0 << bits, dx1 << bits
        dy1, dx2, dy2 = dy1 << bits, dx2 << bits, dy2 << bits
        unit = 1.0 / abs(area)
        zb, zc = (zb - za) * unit, (zc - za) * unit
        z0, z_down, z_back = za + zb * s1 + zc * s2, zb * dx1 + zc * dx2, zb * dy1 + zc * dy2
        for row in range(row0, row1 + 1):
            first, last = col0, col1
            if col1 - col0 >= NARROW:  # wide: skip what the edges exclude
                f0, l0 = _row_span(s0, dy0, col0, col1)
                f1, l1 = _row_span(s1, dy1, col0, col1)
                f2, l2 = _row_span(s2, dy2, col0, col1)
                first, last = max(f0, f1, f2), min(l0, l1, l2)
            past = first - col0
            e0, e1, e2, z = s0 - past * dy0, s1 - past * dy1, s2 - past * dy2, z0 - past * z_back
            r = np.uint32(row)
            for col in range(first, last + 1):
                if (e0 | e1 | e2) >= 0:
                    k, depth = np.uint32(col), np.float32(z)
                    near, far = out_near[r, k], out_far[r, k]
                    out_near[r, k] = near if depth >= near else depth
                    out_far[r, k] = far if depth <= far else depth
                e0, e1, e2, z = e0 - dy0, e1 - dy1, e2 - dy2, z - z_back
            s0, s1, s2, z0 = s0 + dx0, s1 + dx1, s2 + dx2, z0 + z_down


@kernel
def face_sides(faces, spots, out_sides):
    """Write for each triangle 1 or -1, as the order of its corners on the screen; 0: no area."""
    for i in range(len(faces)):
        a, b, c = np.uint32(faces[i, 0]), np.uint32(faces[i, 1]), np.uint32(faces[i, 2])
        xa, ya = np.int64(spots[a, 0]), np.int64(spots[a, 1])
        area = (spots[b, 0] - xa) * (spots[c, 1] - ya) - (spots[b, 1] - ya) * (spots[c, 0] - xa)
        out_sides[i] = (1 if area > 0 else 0) - (1 if area < 0 else 0)


@kernel
def count_borders(edges, sides, screen, out_steps):
    """Add to a pixel how many more triangles cover it than the pixel before it in its row.

    `edges` (e, 4) has the corners a -> b of an edge of the triangle in the third column; b -> a is
    one of the triangle in the fourth, -1 for none. `out_steps` (h, h + 1) int32 comes with 0.
    """
    spots, bits, size = screen.spots, screen.bits, len(out_steps)
    half = np.int64(1) << (bits - 1)
    for i in range(len(edges)):
        weight = np.int64(sides[edges[i, 2]])
        if edges[i, 3] >= 0:
            weight -= sides[edges[i, 3]]
        if weight == 0:
            continue
        a, b = edges[i, 0], edges[i, 1]
        if spots[b, 1] < spots[a, 1]:
            a, b, weight = b, a, -weight
        # Downwards: what has the edge at its right ends here. Rows include the lower end.
        x, y = np.int64(spots[a, 0]) - half, np.int64(spots[a, 1]) - half
        dx, dy = spots[b, 0] - spots[a, 0], spots[b, 1] - spots[a, 1]
        row0, row1 = max((y >> bits) + 1, 0), min((y + dy) >> bits, size - 1)
        for row in range(row0, row1 + 1):
            col = (x * dy + dx * ((row << bits) - y)) // (dy << bits) + 1
            out_steps[row, min(max(col, 0), size)] -= weight


@kernel
def silhouette_runs(box, steps, out_runs):
    """List the runs of pixels that something covers, as `_kernels.Contours` has them.

    `steps` (h, h + 1) of `count_borders` is set to 0. Returns how many runs there are.
    """
    runs = 0
    for row in range(box.first, box.last):
        count = 0
        for col in range(box.left, box.right + 1):  # nothing covers the last one
            step = steps[row, col]
            if step == 0:
                continue
            steps[row, col] = 0
            if count == 0:
                out_runs[runs, 0], out_runs[runs, 1] = row, col
            elif count + step == 0:
                out_runs[runs, 2] = col
                runs += 1
            count += step
    return runs
