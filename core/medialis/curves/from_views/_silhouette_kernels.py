"""Kernels of thesis 3.7.3: contours, exact feature transform and saliency skeleton of a silhouette.

Strategy. A contour is a closed chain of *cracks*, the edges between a pixel of the shape and one
of the background; each crack belongs to one contour and has one arc position on it, also where the
shape or a gap is one pixel wide. The feature point of a pixel is the nearest background pixel b;
its crack is the side of b that faces the pixel, along the longer leg of the way (that neighbour of
b is nearer to the pixel, so it cannot be background). Given the distance to the background within
each column, rows are independent: the lower envelope of parabolas gives the feature points of a row
(Meijster et al. 2000), and within a run of shape pixels only its own columns and the two background
columns beside it matter.
"""

import math

from medialis._kernels.jit import kernel

TURN = math.sqrt(0.5)
"""Distance of the midpoints of two cracks that meet at a right angle."""
STAIRS = 6.0
"""Importance below this many pixels is what the steps of a pixel border make."""


@kernel
def column_offsets(near, down, out_offset):
    """Write rows to the nearest background of the column (negative: above; 0: background).

    Background is where `near` is NaN; the border of the picture must be background. `down` is room
    for one row. Returns the number of cracks, of shape pixels, the first row and one after the last
    row of the shape.
    """
    height, width = near.shape
    cracks, pixels, first, last = 0, 0, height, 0
    for col in range(width):
        out_offset[0, col] = 0
        down[col] = 0
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
def trace_contours(offset, first, last, out_upright, out_flat, out_arc, out_contour, out_length):
    """Write number and arc position of every crack; return the number of contours and cracks.

    Crack `out_upright[r, c]` is the left side of pixel (r, c), `out_flat[r, c]` its top. Crack k
    has the arc position out_arc[k] on contour out_contour[k], which is out_length[...] long. Arcs
    run between midpoints of cracks, in pixels: exact along rows, columns and diagonals, at most 8 %
    too long between. Shape pixels that share a corner are connected.
    """
    width = offset.shape[1]
    for row in range(first, last):
        for col in range(1, width):
            if offset[row, col] != 0 and offset[row, col - 1] == 0:
                out_upright[row, col] = -1
    contours, cracks = 0, 0
    for row in range(first, last):
        for col in range(1, width):
            if offset[row, col] == 0 or offset[row, col - 1] != 0 or out_upright[row, col] >= 0:
                continue
            # Up along the left side of the pixel, with the shape at the right hand. (r, c) is the
            # corner we come to: the top left one of the pixel (r, c).
            r, c, dr, dc = row, col, -1, 0
            arc = 0.0
            while True:
                if dc == 0:
                    if dr < 0:
                        out_upright[r, c] = cracks
                    else:
                        out_upright[r - 1, c] = cracks
                elif dc > 0:
                    out_flat[r, c - 1] = cracks
                else:
                    out_flat[r, c] = cracks
                out_arc[cracks], out_contour[cracks] = arc, contours
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
            out_length[contours] = arc
            contours += 1
    return contours, cracks


@kernel
def facing_crack(row, col, site_row, site_col, upright, flat):
    """Return the crack of the background pixel `site` that faces a shape pixel."""
    dr, dc = row - site_row, col - site_col
    if abs(dc) >= abs(dr):
        return upright[site_row, site_col + 1] if dc > 0 else upright[site_row, site_col]
    return flat[site_row + 1, site_col] if dr > 0 else flat[site_row, site_col]


@kernel
def arc_between(a, b, arc, contour, length, longest):
    """Return the shorter arc between two cracks; different contours count as the longest."""
    if contour[a] != contour[b]:
        return longest
    way = abs(arc[a] - arc[b])
    return min(way, length[contour[a]] - way)


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
    offset,
    first,
    last,
    cracks,
    saliency,
    room,
    out_begin,
    out_col,
    out_importance,
    out_distance,
    out_field,
):
    """Find where rows cross the saliency skeleton, and, on request, the distance field.

    cracks = (upright, flat, arc, contour, length, longest). room (6, w + 2) int64 holds the
    envelope and the feature points of this and the last row. Crossings of row r have the numbers
    out_begin[r] to out_begin[r + 1], ascending; out_col is sub-pixel, with pixel centers at halves,
    and out_distance the distance to the contour. An `out_field` of the size of the picture gets the
    distance of every pixel center, negative beside the skeleton (crossings of rows and columns).
    Returns the number of crossings.
    """
    upright, flat, arc, contour, length, longest = cracks
    width = offset.shape[1]
    stack, start, site_r, site_c, past_r, past_c = (
        room[0], room[1], room[2], room[3], room[4], room[5],
    )  # fmt: skip
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
                crack = facing_crack(row, x, r, c, upright, flat)
                away = math.sqrt((row - r) ** 2 + (x - c) ** 2) - 0.5
                if with_field:
                    out_field[row, x] = away
                if x > begin and crack != crack_before:
                    rho = arc_between(crack, crack_before, arc, contour, length, longest)
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
                    above = facing_crack(row - 1, x, past_r[x], past_c[x], upright, flat)
                    if above != crack:
                        rho = arc_between(crack, above, arc, contour, length, longest)
                        if rho > max(saliency * abs(out_field[row, x]), STAIRS):
                            out_field[row, x] = -abs(out_field[row, x])
                            out_field[row - 1, x] = -abs(out_field[row - 1, x])
                crack_before = crack
        site_r, past_r = past_r, site_r
        site_c, past_c = past_c, site_c
    for row in range(last, len(out_begin)):
        out_begin[row] = found
    return found
