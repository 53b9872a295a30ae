"""Kernels that draw views of triangles: whole, as a silhouette, and at a few pixels (thesis 3.7.4).

Pixels are hit by their centers, with the shared-edge rule of `edge`: neighbouring triangles leave
no gap. Positions are columns and rows of the picture. The *cell* of a position says where it lies
among the centers: 2 i on center i, 2 i + 1 behind it. Triangles whose corners all have one cell
cover no center, and of the others cells give the rows and columns without rounding again.

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

from medialis.base._splat_kernels import edge
from medialis.base.jit import kernel

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
    places : (n, 3) float64
        Column, row, depth.
    cells : (n, 2) int32
        Of column and row, from -2 to 2 * size.
    """

    places: NDArray[np.float64]
    cells: NDArray[np.int32]


@kernel
def cell_of(position, size):
    """Return where a position lies among the centers of pixels."""
    at = min(max(position - 0.5, -1.0), float(size))
    below = int(at + 1.0) - 1
    return 2 * below + (1 if at > below else 0)


@kernel
def project_points(points, center, axes, size, pixel, out):
    """Write the screen of a camera; return the box of the pixels that may be covered."""
    half, scale = 0.5 * size, 1.0 / pixel
    x0, y0, z0 = center[0], center[1], center[2]
    right_x, right_y, right_z = axes[0, 0], axes[0, 1], axes[0, 2]
    up_x, up_y, up_z = axes[1, 0], axes[1, 1], axes[1, 2]
    on_x, on_y, on_z = axes[2, 0], axes[2, 1], axes[2, 2]
    left = top = 2 * size
    right = bottom = -2
    for i in range(len(points)):
        x, y, z = points[i, 0] - x0, points[i, 1] - y0, points[i, 2] - z0
        column = half + (x * right_x + y * right_y + z * right_z) * scale
        row = half - (x * up_x + y * up_y + z * up_z) * scale
        out.places[i, 0], out.places[i, 1] = column, row
        out.places[i, 2] = x * on_x + y * on_y + z * on_z
        c, r = cell_of(column, size), cell_of(row, size)
        out.cells[i, 0], out.cells[i, 1] = c, r
        left, right = min(left, c), max(right, c)
        top, bottom = min(top, r), max(bottom, r)
    first, last = max((top + 1) >> 1, 0), min((bottom >> 1) + 1, size)
    left, right = max((left + 1) >> 1, 0), min((right >> 1) + 1, size)
    if first >= last or left >= right:
        return Box(0, 0, 0, 0)
    return Box(first, last, left, right)


@kernel
def begin_picture(box, out_near, out_far):
    """Write near +inf and far -inf in a box, and NaN outside it."""
    for row in range(len(out_near)):
        inside = box.first <= row < box.last
        for col in range(len(out_near)):
            if inside and box.left <= col < box.right:
                out_near[row, col], out_far[row, col] = math.inf, -math.inf
            else:
                out_near[row, col] = out_far[row, col] = math.nan


@kernel
def mark_outside(box, near, far):
    """Write NaN where nothing was drawn in a box."""
    for row in range(box.first, box.last):
        for col in range(box.left, box.right):
            if near[row, col] == math.inf:
                near[row, col] = far[row, col] = math.nan


@kernel
def _row_span(e, slope, closed, col0, col1):
    # Columns of col0..col1 where e - slope (col - col0) is inside: a first and a last one. The
    # division only proposes; the caller's exact test at both ends decides.
    if slope == 0.0:
        if e < 0 or (e == 0 and not closed):
            return col1 + 1, col1
        return col0, col1
    at = e / slope
    if slope > 0:
        return col0, col0 + math.floor(min(at + 1.0, float(col1 - col0)))
    return col0 + math.ceil(min(max(at - 1.0, 0.0), col1 - col0 + 1.0)), col1


@kernel
def _pixels_of(cells, a, b, c, top):
    """Rows and columns, from and to, of the pixels whose center a triangle may cover."""
    ca, cb, cc = cells[a, 0], cells[b, 0], cells[c, 0]
    ra, rb, rc = cells[a, 1], cells[b, 1], cells[c, 1]
    col0, col1 = max((min(ca, cb, cc) + 1) >> 1, 0), min(max(ca, cb, cc) >> 1, top)
    row0, row1 = max((min(ra, rb, rc) + 1) >> 1, 0), min(max(ra, rb, rc) >> 1, top)
    return row0, row1, col0, col1


@kernel
def pick_faces(faces, cells, size, wanted, out_picked):
    """List the triangles that may cover the center of a pixel; return how many they are.

    With `wanted` (h + 1, w + 1) int32, which `count_crossings` writes, only those with a wanted
    pixel in their rows and columns. No branches: nobody can guess which these are.
    """
    top, few, count = size - 1, len(wanted) > 0, 0
    for i in range(len(faces)):
        # Without signs no index is tried from the end: a third faster.
        a, b, c = np.uint32(faces[i, 0]), np.uint32(faces[i, 1]), np.uint32(faces[i, 2])
        row0, row1, col0, col1 = _pixels_of(cells, a, b, c, top)
        keep = (row0 <= row1) & (col0 <= col1)
        if few:
            above, below = np.uint32(row0), np.uint32(row1 + 1)
            left, right = np.uint32(col0), np.uint32(col1 + 1)
            inside = wanted[below, right] - wanted[above, right]
            keep &= inside != wanted[below, left] - wanted[above, left]
        out_picked[count] = i
        count += 1 if keep else 0
    return count


@kernel
def draw_depth_range(faces, picked, screen, out_near, out_far):
    """Draw the triangles of a list; near starts at +inf and far at -inf."""
    top = len(out_near) - 1
    places, cells = screen.places, screen.cells
    for number in range(len(picked)):
        i = np.uint32(picked[number])
        a, b, c = np.uint32(faces[i, 0]), np.uint32(faces[i, 1]), np.uint32(faces[i, 2])
        row0, row1, col0, col1 = _pixels_of(cells, a, b, c, top)
        xa, ya, xb, yb = places[a, 0], places[a, 1], places[b, 0], places[b, 1]
        xc, yc = places[c, 0], places[c, 1]
        za, zb, zc = places[a, 2], places[b, 2], places[c, 2]
        area = (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
        turned = area < 0  # no branches: which way triangles face nobody can guess
        area = abs(area)
        if not area > 0:
            continue
        xb, xc = (xc if turned else xb), (xb if turned else xc)
        yb, yc = (yc if turned else yb), (yb if turned else yc)
        zb, zc = (zc if turned else zb), (zb if turned else zc)
        dx0, dy0, dx1, dy1, dx2, dy2 = xc - xb, yc - yb, xa - xc, ya - yc, xb - xa, yb - ya
        from0 = (xc < xb) | ((xc == xb) & (yc < yb))  # the end that `edge` takes for the origin
        from1 = (xa < xc) | ((xa == xc) & (ya < yc))
        from2 = (xb < xa) | ((xb == xa) & (yb < ya))
        ox0, oy0 = (xc if from0 else xb), (yc if from0 else yb)
        ox1, oy1 = (xa if from1 else xc), (ya if from1 else yc)
        ox2, oy2 = (xb if from2 else xa), (yb if from2 else ya)
        closed0 = (dy0 > 0) | ((dy0 == 0) & (dx0 < 0))
        closed1 = (dy1 > 0) | ((dy1 == 0) & (dx1 < 0))
        closed2 = (dy2 > 0) | ((dy2 == 0) & (dx2 < 0))
        low, high = min(za, zb, zc), max(za, zb, zc)
        unit = 1.0 / area
        x = col0 + 0.5
        for row in range(row0, row1 + 1):
            y = row + 0.5
            s0, s1, s2 = dx0 * (y - oy0), dx1 * (y - oy1), dx2 * (y - oy2)
            first, last = col0, col1
            if col1 - col0 >= NARROW:  # wide: skip what the edges exclude
                f0, l0 = _row_span(s0 - dy0 * (x - ox0), dy0, closed0, col0, col1)
                f1, l1 = _row_span(s1 - dy1 * (x - ox1), dy1, closed1, col0, col1)
                f2, l2 = _row_span(s2 - dy2 * (x - ox2), dy2, closed2, col0, col1)
                first, last = max(f0, f1, f2), min(l0, l1, l2)
            r = np.uint32(row)
            for col in range(first, last + 1):
                e0 = s0 - dy0 * (col + 0.5 - ox0)
                e1 = s1 - dy1 * (col + 0.5 - ox1)
                e2 = s2 - dy2 * (col + 0.5 - ox2)
                hit = (e0 > 0) | ((e0 == 0) & closed0)
                hit &= (e1 > 0) | ((e1 == 0) & closed1)
                hit &= (e2 > 0) | ((e2 == 0) & closed2)
                k = np.uint32(col)
                z = np.float32(min(max((e0 * za + e1 * zb + e2 * zc) * unit, low), high))
                near, far = out_near[r, k], out_far[r, k]
                out_near[r, k] = z if hit & (z < near) else near
                out_far[r, k] = z if hit & (z > far) else far


@kernel
def face_sides(faces, places, out_sides):
    """Write for each triangle 1 or -1, as the order of its corners on the screen; 0: no area."""
    for i in range(len(faces)):
        a, b, c = np.uint32(faces[i, 0]), np.uint32(faces[i, 1]), np.uint32(faces[i, 2])
        xa, ya = places[a, 0], places[a, 1]
        area = (places[b, 0] - xa) * (places[c, 1] - ya) - (places[b, 1] - ya) * (places[c, 0] - xa)
        out_sides[i] = (1 if area > 0 else 0) - (1 if area < 0 else 0)


@kernel
def count_borders(edges, sides, screen, out_steps):
    """Add to a pixel how many more triangles cover it than the pixel before it in its row.

    `edges` (e, 4) has the corners a -> b of an edge of the triangle in the third column; b -> a is
    one of the triangle in the fourth, -1 for none. `out_steps` (h, h + 1) int32 comes with 0.
    """
    places, cells, size = screen.places, screen.cells, len(out_steps)
    for i in range(len(edges)):
        weight = np.int64(sides[edges[i, 2]])
        if edges[i, 3] >= 0:
            weight -= sides[edges[i, 3]]
        if weight == 0:
            continue
        a, b = edges[i, 0], edges[i, 1]
        if places[b, 1] < places[a, 1]:
            a, b, weight = b, a, -weight
        # Downwards: what has the edge at its right ends here. Rows include the lower end.
        row0, row1 = max((cells[a, 1] >> 1) + 1, 0), min(cells[b, 1] >> 1, size - 1)
        if row0 > row1:
            continue
        ox, oy, dx, dy, _ = edge(places[a, 0], places[a, 1], places[b, 0], places[b, 1])
        slope = dx / dy
        for row in range(row0, row1 + 1):
            s = dx * (row + 0.5 - oy)
            at = min(max(ox + slope * (row + 0.5 - oy) - 0.5, -1.0), float(size))
            col = min(int(at + 1.0), size)
            while col > 0 and s - dy * (col - 0.5 - ox) < 0:  # the exact test decides
                col -= 1
            while col < size and s - dy * (col + 0.5 - ox) >= 0:
                col += 1
            out_steps[row, col] -= weight


@kernel
def fill_silhouette(box, steps, out_near, out_far):
    """Write NaN at pixels of a box that nothing covers; `steps` (h, h + 1) is set to 0."""
    for row in range(box.first, box.last):
        count = 0
        for col in range(box.left, box.right):
            count += steps[row, col]
            steps[row, col] = 0
            if count == 0:
                out_near[row, col] = out_far[row, col] = math.nan
        steps[row, box.right] = 0


@kernel
def pixel_beside(near, row, column):
    """Return the column of the pixel of the shape that a sub-pixel column lies in, or is next to.

    A crossing lies between two pixels of the shape.
    """
    col = int(column)
    if math.isnan(near[row, col]):
        col = col - 1 if column - col < 0.5 else col + 1
    return col


@kernel
def count_crossings(box, begin, column, near, out_wanted):
    """Write how many pixels of crossings lie in the rows before a row and the columns before one.

    `out_wanted` (h + 1, w + 1) int32; what is outside the box, and not beside it, stays.
    """
    for col in range(box.left, box.right + 1):
        out_wanted[box.first, col] = 0
    for row in range(box.first, box.last):
        for col in range(box.left, box.right + 1):
            out_wanted[row + 1, col] = 0
        for i in range(begin[row], begin[row + 1]):
            out_wanted[row + 1, pixel_beside(near, row, column[i]) + 1] += 1
        count = 0
        for col in range(box.left, box.right + 1):
            count += out_wanted[row + 1, col]
            out_wanted[row + 1, col] = out_wanted[row, col] + count
