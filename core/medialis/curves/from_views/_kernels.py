"""Kernels of curve skeletons from views, in the order in which they run (thesis 3.7).

Views: nearest and furthest depth of triangles in one pass. Pixels are hit by their centers, with
the shared-edge rule of `edge`: neighbouring triangles leave no gap. Positions are columns and rows
of the picture. Views that are needed again are packed as bit masks and numbers of their pixels.

Silhouettes (3.7.3): contours, exact feature transform and saliency skeleton. A contour is a closed
chain of *cracks*, the edges between a pixel of the shape and one of the background; each crack
belongs to one contour and has one arc position on it, also where the shape or a gap is one pixel
wide. The feature point of a pixel is the nearest background pixel b; its crack is the side of b
that faces the pixel, along the longer leg of the way (that neighbour of b is nearer to the pixel,
so it cannot be background). Given the distance to the background within each column, rows are
independent: the lower envelope of parabolas gives the feature points of a row (Meijster et al.
2000), and within a run of shape pixels only its own columns and the two background columns beside
it matter.

Pairs (3.7.4): points of two silhouette skeletons, matched along rows. Both cameras have the same
center and the same up-axis; the second one is the first one turned about it by the angle alpha. So
a row of the one is the same row of the other, and a point at column x, depth k of the first has the
column x cos(alpha) - k sin(alpha) in the second, both measured from the middle in units of length
(Eq. 3.9).

Sharpening (3.7.5): points are dropped that a view sees outside, and moved to where views agree.
Every point is treated on its own, view by view in their order, so the threads cannot change the
result.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._splat_kernels import covers, edge, orient, pixel_range
from medialis.base.jit import kernel

BITS = 8
"""Pixels in a byte of a packed mask."""

MIDDLE = 0.25
"""Share of the depth range up to which a point is in its middle: farther off a view sees it before
or behind something else."""

TURN = math.sqrt(0.5)
"""Distance of the midpoints of two cracks that meet at a right angle."""

STAIRS = 6.0
"""Importance below this many pixels is what the steps of a pixel border make."""


class Views(NamedTuple):
    """Depths and distance fields of v views side by side.

    Attributes
    ----------
    centers : (v, 3) float64
        The points in the middle of the pictures.
    axes : (v, 3, 3) float64
        Unit right, up and forward of each camera.
    pixels : (v,) float64
        Edge of a pixel in the units of the shape.
    near, far : (v, h, w) float32
        Depths of the nearest and the furthest surface; NaN outside the silhouette.
    field : (v, h, w) float32
        Distance to the contour in pixels, negative beside the skeleton of the silhouette.
    """

    centers: NDArray[np.float64]
    axes: NDArray[np.float64]
    pixels: NDArray[np.float64]
    near: NDArray[np.float32]
    far: NDArray[np.float32]
    field: NDArray[np.float32]


class Rows(NamedTuple):
    """Where the rows of a view cross the skeleton of its silhouette.

    Attributes
    ----------
    begin : (h + 1,) int32
        Crossings of row r have the numbers begin[r]..begin[r + 1].
    column : (s,) float64
        Sub-pixel column, ascending within a row.
    near, far : (h, w) float32
        Depths, as of `Views`.
    """

    begin: NDArray[np.int32]
    column: NDArray[np.float64]
    near: NDArray[np.float32]
    far: NDArray[np.float32]


class Contours(NamedTuple):
    """A silhouette and its contours, chains of cracks.

    Attributes
    ----------
    offset : (h, w) int32
        Rows to the nearest background of the column, negative above; 0 is background.
    first, last : int
        The first row and one after the last row of the shape.
    upright, flat : (h, w) int32
        Crack at the left side of a pixel, and at its top.
    arc : (c,) float64
        Position of each crack on its contour, in pixels between midpoints of cracks: exact along
        rows, columns and diagonals, at most 8 % too long between.
    contour : (c,) int32
    length : (at least as many as contours,) float64
    longest : float
        The arc between different contours.
    """

    offset: NDArray[np.int32]
    first: int
    last: int
    upright: NDArray[np.int32]
    flat: NDArray[np.int32]
    arc: NDArray[np.float64]
    contour: NDArray[np.int32]
    length: NDArray[np.float64]
    longest: float


@kernel
def project_points(points, center, axes, size, pixel, out_screen):
    """Write column, row and depth of every point."""
    half, scale = 0.5 * size, 1.0 / pixel
    for i in range(len(points)):
        x, y, z = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        out_screen[i, 0] = half + (x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]) * scale
        out_screen[i, 1] = half - (x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]) * scale
        out_screen[i, 2] = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]


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
def draw_depth_range(faces, screen, out_near, out_far):
    """Draw all triangles; near starts at +inf and far at -inf."""
    size = len(out_near)
    for i in range(len(faces)):
        a, b, c, area = orient(faces[i], screen)
        xa, ya, xb, yb = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1]
        xc, yc = screen[c, 0], screen[c, 1]
        row0, row1 = pixel_range(min(ya, yb, yc), max(ya, yb, yc), 0, size)
        col0, col1 = pixel_range(min(xa, xb, xc), max(xa, xb, xc), 0, size)
        if not area > 0 or row0 > row1 or col0 > col1:
            continue
        ox0, oy0, dx0, dy0, closed0 = edge(xb, yb, xc, yc)
        ox1, oy1, dx1, dy1, closed1 = edge(xc, yc, xa, ya)
        ox2, oy2, dx2, dy2, closed2 = edge(xa, ya, xb, yb)
        za, zb, zc = screen[a, 2], screen[b, 2], screen[c, 2]
        low, high = min(za, zb, zc), max(za, zb, zc)
        unit = 1.0 / area
        x = col0 + 0.5
        for row in range(row0, row1 + 1):
            y = row + 0.5
            s0, s1, s2 = dx0 * (y - oy0), dx1 * (y - oy1), dx2 * (y - oy2)
            first, last = col0, col1
            if col1 - col0 > 3:  # wide: skip what the edges exclude
                f0, l0 = _row_span(s0 - dy0 * (x - ox0), dy0, closed0, col0, col1)
                f1, l1 = _row_span(s1 - dy1 * (x - ox1), dy1, closed1, col0, col1)
                f2, l2 = _row_span(s2 - dy2 * (x - ox2), dy2, closed2, col0, col1)
                first, last = max(f0, f1, f2), min(l0, l1, l2)
            for col in range(first, last + 1):
                e0 = s0 - dy0 * (col + 0.5 - ox0)
                e1 = s1 - dy1 * (col + 0.5 - ox1)
                e2 = s2 - dy2 * (col + 0.5 - ox2)
                if not covers(e0, e1, e2, closed0, closed1, closed2):
                    continue
                z = min(max((e0 * za + e1 * zb + e2 * zc) * unit, low), high)
                if z < out_near[row, col]:
                    out_near[row, col] = z
                if z > out_far[row, col]:
                    out_far[row, col] = z


@kernel
def mark_outside(near, far):
    """Write NaN where nothing was drawn."""
    size = len(near)
    for row in range(size):
        for col in range(size):
            if near[row, col] == math.inf:
                near[row, col] = math.nan
                far[row, col] = math.nan


@kernel
def pack_view(near, far, field, out_mask, out_values):
    """Pack depths and distances (h, w) of the pixels where `near` is a number.

    `out_mask` ((h * w + 7) // 8) uint8 comes with 0. `out_values` (p, 3) has a row for each such
    pixel, in the order of rows.
    """
    width, count = near.shape[1], 0
    for row in range(len(near)):
        for col in range(width):
            if math.isnan(near[row, col]):
                continue
            at = row * width + col
            out_mask[at // BITS] |= np.uint8(1 << (at % BITS))
            out_values[count, 0] = near[row, col]
            out_values[count, 1] = far[row, col]
            out_values[count, 2] = field[row, col]
            count += 1


@kernel
def unpack_view(mask, values, out_near, out_far, out_field):
    """Unpack what `pack_view` packed; `out_field` comes with 0."""
    width, count = out_near.shape[1], 0
    for row in range(len(out_near)):
        for col in range(width):
            at = row * width + col
            if mask[at // BITS] & (1 << (at % BITS)):
                out_near[row, col] = values[count, 0]
                out_far[row, col] = values[count, 1]
                out_field[row, col] = values[count, 2]
                count += 1
            else:
                out_near[row, col] = out_far[row, col] = math.nan


@kernel
def middle_depth(near, far, row, column):
    """Return near and far depth where a row has a sub-pixel column; of the nearer pixel, if in."""
    col = int(column)
    if math.isnan(near[row, col]):  # a crossing lies between two pixels of the shape
        col = col - 1 if column - col < 0.5 else col + 1
    return near[row, col], far[row, col]


@kernel
def best_partner(x, estimate, other, row, pixel, cosine, sine):
    """Return the number of the crossing whose depth is nearest to the estimate, and its depth.

    Columns ascend, so depths descend: scanned from the right, depths grow, and the scan stops as
    soon as the distance to the estimate grows (thesis 3.7.4.2).
    """
    best, depth, least, middle = -1, 0.0, math.inf, 0.5 * (len(other.begin) - 1)
    for j in range(other.begin[row + 1] - 1, other.begin[row] - 1, -1):
        k = (x * cosine - (other.column[j] - middle) * pixel) / sine
        gap = abs(estimate - k)
        if gap >= least:
            break
        best, depth, least = j, k, gap
    return best, depth


@kernel
def pair_crossings(first, second, pixel, cosine, sine, out):
    """Write right, up and depth, as the first camera sees them, of the matched points.

    A match counts when the point lies within the depth range of both views. Returns the number of
    points.
    """
    size = len(first.begin) - 1
    middle = 0.5 * size
    count = 0
    for row in range(size):
        for i in range(first.begin[row], first.begin[row + 1]):
            x = (first.column[i] - middle) * pixel
            low, high = middle_depth(first.near, first.far, row, first.column[i])
            j, k = best_partner(x, 0.5 * (low + high), second, row, pixel, cosine, sine)
            if j < 0 or not low <= k <= high:
                continue
            low, high = middle_depth(second.near, second.far, row, second.column[j])
            depth = k * cosine + x * sine
            if not low <= depth <= high:
                continue
            out[count, 0] = x
            out[count, 1] = (middle - row - 0.5) * pixel
            out[count, 2] = k
            count += 1
    return count


@kernel
def _seen(point, views, v):
    """Return sub-pixel column and row, depth and pixel of a point, and whether it is seen inside.

    Inside: in the silhouette and the depth range.
    """
    size, center, axes = len(views.near[v]), views.centers[v], views.axes[v]
    x, y, z = point[0] - center[0], point[1] - center[1], point[2] - center[2]
    right = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
    up = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
    depth = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]
    column, row = 0.5 * size + right / views.pixels[v], 0.5 * size - up / views.pixels[v]
    if not (1.0 <= column < size - 1.0 and 1.0 <= row < size - 1.0):
        return column, row, depth, 0, 0, False
    r, c = int(row), int(column)  # false for NaN, outside the silhouette
    return column, row, depth, r, c, views.near[v, r, c] <= depth <= views.far[v, r, c]


@kernel
def cull_and_sharpen(views, steps, begin, end, points, alive):
    """Test and move the points begin..end, in place, by every view of the batch.

    A point moves parallel to the picture by steps[v] pixels times the gradient of the distance
    transform, unless it lies beside the skeleton of the silhouette already. A view in which it lies
    far from the middle of the depth range sees it before or behind something else: it may drop the
    point, not move it.
    """
    for v in range(len(steps)):  # all points of a range by one view: its pixels stay in the cache
        field, axes, pixel = views.field[v], views.axes[v], views.pixels[v]
        for i in range(begin, end):
            if not alive[i]:
                continue
            point = points[i]
            _, _, depth, r, c, inside = _seen(point, views, v)
            if not inside:
                alive[i] = False
                continue
            if field[r, c] < 0:
                continue
            low, high = views.near[v, r, c], views.far[v, r, c]
            if abs(depth - 0.5 * (low + high)) > MIDDLE * (high - low):
                continue
            gx = 0.5 * (abs(field[r, c + 1]) - abs(field[r, c - 1])) * steps[v] * pixel
            gy = 0.5 * (abs(field[r - 1, c]) - abs(field[r + 1, c])) * steps[v] * pixel
            for j in range(3):
                point[j] += gx * axes[0, j] + gy * axes[1, j]


@kernel
def distance_at(field, column, row):
    """Return the distance transform at a sub-pixel position, to the nearest pixel centers outside.

    Bilinear between pixel centers. The field counts to the border of those pixels, half a pixel
    less; but of many pixels along a contour some have their center right behind it.
    """
    x, y = column - 0.5, row - 0.5
    c, r = int(x), int(y)
    s, t = x - c, y - r
    above = (1 - s) * abs(field[r, c]) + s * abs(field[r, c + 1])
    below = (1 - s) * abs(field[r + 1, c]) + s * abs(field[r + 1, c + 1])
    return (1 - t) * above + t * below + 0.5


@kernel
def measure_radii(views, begin, end, points, out_radii):
    """Lower out_radii to the distance to the surface that any view shows; 0 where one is outside.

    A ball round a point inside the shape is seen as a disc inside the silhouette and as a depth
    within the range, so the distance to the contour and the ways to both depths are no smaller than
    its radius; over many views the smallest is near it.
    """
    for v in range(len(views.pixels)):
        for i in range(begin, end):
            column, row, depth, r, c, inside = _seen(points[i], views, v)
            if not inside:
                out_radii[i] = 0.0
                continue
            ways = min(depth - views.near[v, r, c], views.far[v, r, c] - depth)
            away = distance_at(views.field[v], column, row) * views.pixels[v]
            out_radii[i] = min(out_radii[i], ways, away)


@kernel
def column_offsets(near, out_offset):
    """Write rows to the nearest background of the column (negative: above; 0: background).

    Background is where `near` is NaN; the border of the picture must be background. The first
    column of `out_offset` comes with 0. Returns the number of cracks, of shape pixels, the first
    row and one after the last row of the shape.
    """
    height, width = near.shape
    cracks, pixels, first, last = 0, 0, height, 0
    out_offset[0] = 0
    down = np.zeros(width, np.int32)
    for row in range(1, height):
        before, here_before = 0, pixels
        for col in range(width):
            above = out_offset[row - 1, col]
            here = 0 if math.isnan(near[row, col]) else 1
            out_offset[row, col] = above + 1 if here == 1 else 0
            cracks += (here ^ before) + (here ^ (above > 0))
            pixels += here
            before = here
        if pixels > here_before:
            first, last = min(first, row), row + 1
    for row in range(last - 1, first - 1, -1):
        for col in range(width):
            up = out_offset[row, col]
            down[col] = down[col] + 1 if up > 0 else 0
            out_offset[row, col] = down[col] if down[col] < up else -up
    return cracks, pixels, first, last


@kernel
def trace_contours(contours):
    """Fill in the cracks of a silhouette; return the number of its contours.

    Shape pixels that share a corner are connected.
    """
    offset, upright, flat = contours.offset, contours.upright, contours.flat
    width = offset.shape[1]
    for row in range(contours.first, contours.last):
        for col in range(1, width):
            if offset[row, col] != 0 and offset[row, col - 1] == 0:
                upright[row, col] = -1
    count, cracks = 0, 0
    for row in range(contours.first, contours.last):
        for col in range(1, width):
            if offset[row, col] == 0 or offset[row, col - 1] != 0 or upright[row, col] >= 0:
                continue
            # Up along the left side of the pixel, with the shape at the right hand. (r, c) is the
            # corner we come to: the top left one of the pixel (r, c).
            r, c, dr, dc = row, col, -1, 0
            arc = 0.0
            while True:
                if dc == 0:
                    if dr < 0:
                        upright[r, c] = cracks
                    else:
                        upright[r - 1, c] = cracks
                elif dc > 0:
                    flat[r, c - 1] = cracks
                else:
                    flat[r, c] = cracks
                contours.arc[cracks], contours.contour[cracks] = arc, count
                cracks += 1
                # The two pixels ahead, left and right of the way, at the corner (r, c).
                if dc == 0:
                    left_r = right_r = r - 1 if dr < 0 else r
                    left_c, right_c = (c - 1, c) if dr < 0 else (c, c - 1)
                else:
                    left_c = right_c = c if dc > 0 else c - 1
                    left_r, right_r = (r - 1, r) if dc > 0 else (r, r - 1)
                if offset[left_r, left_c] != 0:
                    dr, dc = -dc, dr
                    arc += TURN
                elif offset[right_r, right_c] != 0:
                    arc += 1.0
                else:
                    dr, dc = dc, -dr
                    arc += TURN
                r, c = r + dr, c + dc
                if r == row and c == col and dr == -1:
                    break
            contours.length[count] = arc
            count += 1
    return count


@kernel
def facing_crack(row, col, site_row, site_col, contours):
    """Return the crack of the background pixel `site` that faces a shape pixel."""
    dr, dc = row - site_row, col - site_col
    if abs(dc) >= abs(dr):
        return contours.upright[site_row, site_col + 1 if dc > 0 else site_col]
    return contours.flat[site_row + 1 if dr > 0 else site_row, site_col]


@kernel
def arc_between(a, b, contours):
    """Return the shorter arc between two cracks; different contours count as the longest."""
    arc, contour = contours.arc, contours.contour
    if contour[a] != contour[b]:
        return contours.longest
    way = abs(arc[a] - arc[b])
    return min(way, contours.length[contour[a]] - way)


@kernel
def row_features(offset, row, begin, end, stack, start, out_row, out_col):
    """Write the nearest background pixel of the pixels begin..end of a row, a run of the shape.

    The lower envelope of the parabolas (x - c)^2 + offset(c)^2 over the columns c from begin - 1 to
    end; `stack` and `start` are room for end - begin + 2 numbers. Ties go to the left.
    """
    top = 0
    stack[0], start[0] = begin - 1, begin
    for c in range(begin, end + 1):
        g = offset[row, c] * offset[row, c] + c * c
        x = 0
        while top >= 0:
            b = stack[top]
            # First column at which the parabola of c is strictly lower than that of b.
            x = (g - offset[row, b] * offset[row, b] - b * b) // (2 * (c - b)) + 1
            if x > start[top]:
                break
            top -= 1
        if top < 0:
            x = begin
        if x < end:
            top += 1
            stack[top], start[top] = c, x
    k = 0
    for x in range(begin, end):
        while k < top and start[k + 1] <= x:
            k += 1
        out_col[x] = stack[k]
        out_row[x] = row + offset[row, stack[k]]


@kernel
def bisector(row, ra, ca, rb, cb):
    """Return the column at which a row is as far from pixel (ra, ca) as from (rb, cb), ca != cb."""
    return ((rb - row) ** 2 + cb * cb - (ra - row) ** 2 - ca * ca) / (2.0 * (cb - ca))


@kernel
def saliency_skeleton(
    contours, saliency, out_begin, out_col, out_importance, out_distance, out_field
):  # fmt: skip
    """Find where rows cross the saliency skeleton, and, on request, the distance field.

    Crossings of row r have the numbers out_begin[r] to out_begin[r + 1], ascending; out_col is
    sub-pixel, with pixel centers at halves, and out_distance the distance to the contour. An
    `out_field` of the size of the picture gets the distance of every pixel center, negative beside
    the skeleton (crossings of rows and columns). Returns the number of crossings.
    """
    offset, first, last = contours.offset, contours.first, contours.last
    width = offset.shape[1]
    room = width + 2
    stack, start = np.empty(room, np.int64), np.empty(room, np.int64)  # the envelope
    site_r, site_c = np.empty(room, np.int64), np.empty(room, np.int64)  # feature points
    past_r, past_c = np.empty(room, np.int64), np.empty(room, np.int64)  # those of the last row
    with_field = out_field.shape[0] > 0
    found = 0
    for row in range(first):
        out_begin[row] = 0
    for row in range(first, last):
        out_begin[row] = found
        col = 1
        while col < width:
            if offset[row, col] == 0:
                col += 1
                continue
            begin = col
            while offset[row, col] != 0:
                col += 1
            row_features(offset, row, begin, col, stack, start, site_r, site_c)
            crack_before = -1
            for x in range(begin, col):
                r, c = site_r[x], site_c[x]
                crack = facing_crack(row, x, r, c, contours)
                away = math.sqrt((row - r) ** 2 + (x - c) ** 2) - 0.5
                if with_field:
                    out_field[row, x] = away
                if x > begin and crack != crack_before:
                    rho = arc_between(crack, crack_before, contours)
                    if rho > max(saliency * away, STAIRS) and c != site_c[x - 1]:
                        at = bisector(row, site_r[x - 1], site_c[x - 1], r, c)
                        away = math.sqrt((at - c) ** 2 + (row - r) ** 2) - 0.5
                        if rho > saliency * away:
                            out_col[found] = at + 0.5
                            out_importance[found], out_distance[found] = rho, away
                            found += 1
                            if with_field:
                                out_field[row, x] = -abs(out_field[row, x])
                                out_field[row, x - 1] = -abs(out_field[row, x - 1])
                if with_field and offset[row - 1, x] != 0:
                    above = facing_crack(row - 1, x, past_r[x], past_c[x], contours)
                    if above != crack:
                        rho = arc_between(crack, above, contours)
                        if rho > max(saliency * abs(out_field[row, x]), STAIRS):
                            out_field[row, x] = -abs(out_field[row, x])
                            out_field[row - 1, x] = -abs(out_field[row - 1, x])
                crack_before = crack
        site_r, past_r = past_r, site_r
        site_c, past_c = past_c, site_c
    for row in range(last, len(out_begin)):
        out_begin[row] = found
    return found
