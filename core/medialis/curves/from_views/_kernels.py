"""Kernels of silhouettes and of their matching, in the order in which they run (thesis 3.7).

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
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel
from medialis.curves.from_views._view_kernels import FAR, NEAR, numbers_of

TURN = math.sqrt(0.5)
"""Distance of the midpoints of two cracks that meet at a right angle."""

STAIRS = 6.0
"""Importance below this many pixels is what the steps of a pixel border make."""


class Rows(NamedTuple):
    """Where the rows of a view cross the skeleton of its silhouette.

    Attributes
    ----------
    begin : (h + 1,) int32
        Crossings of row r have the numbers begin[r]..begin[r + 1].
    column : (s,) float64
        Sub-pixel column, ascending within a row.
    """

    begin: NDArray[np.int32]
    column: NDArray[np.float64]


class Contours(NamedTuple):
    """A silhouette and its contours, chains of cracks.

    Attributes
    ----------
    offset : (h, w) int32
        Rows to the nearest background of the column, negative above; 0 is background. Comes with 0
        and is left so.
    runs : (r, 3) int32
        Row, first column and one after the last column of pixels of the shape, in order.
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
    runs: NDArray[np.int32]
    upright: NDArray[np.int32]
    flat: NDArray[np.int32]
    arc: NDArray[np.float64]
    contour: NDArray[np.int32]
    length: NDArray[np.float64]
    longest: float


class Envelope(NamedTuple):
    """Scratch memory for the parabolas of a run: its pixels + 2 numbers each, int64."""

    column: NDArray[np.int64]
    key: NDArray[np.int64]
    start: NDArray[np.int64]


class Found(NamedTuple):
    """Sub-pixel column, importance and distance to the contour of crossings, float64."""

    column: NDArray[np.float64]
    importance: NDArray[np.float64]
    distance: NDArray[np.float64]


@kernel
def depths_at(view, row, column):
    """Return near and far depth where a row has a sub-pixel column, or of the pixel beside it.

    A crossing lies between two pixels of the shape.
    """
    col = int(column)
    at = numbers_of(view, row, col)
    if at < 0:
        at = numbers_of(view, row, col - 1 if column - col < 0.5 else col + 1)
    return view.values[at, NEAR], view.values[at, FAR]


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
def pair_crossings(first, view, second, cosine, sine, out):
    """Write right, up and depth, as the first camera sees them, of the matched points.

    A match counts when the point lies within the depth range of the first view, a packed one.
    Returns the number of points.
    """
    size, pixel = view.size, view.pixel
    middle = 0.5 * size
    count = 0
    for row in range(size):
        for i in range(first.begin[row], first.begin[row + 1]):
            x = (first.column[i] - middle) * pixel
            low, high = depths_at(view, row, first.column[i])
            j, k = best_partner(x, 0.5 * (low + high), second, row, pixel, cosine, sine)
            if j < 0 or not low <= k <= high:
                continue
            out[count, 0] = x
            out[count, 1] = (middle - row - 0.5) * pixel
            out[count, 2] = k
            count += 1
    return count


@kernel
def find_runs(near, box, out_runs):
    """List the runs of pixels that are not NaN in a box (`Contours`); return how many."""
    count = 0
    for row in range(box.first, box.last):
        r, col, last = np.uint32(row), np.uint32(box.left), np.uint32(box.right)
        while col < last:
            if math.isnan(near[r, col]):
                col += np.uint32(1)
                continue
            out_runs[count, 0], out_runs[count, 1] = row, col
            while col < last and not math.isnan(near[r, col]):
                col += np.uint32(1)
            out_runs[count, 2] = col
            count += 1
    return count


@kernel
def column_offsets(runs, first, last, out_offset):
    """Write rows to the nearest background of the column for pixels in the columns first..last - 1.

    Returns the number of runs of these columns. `out_offset` must be zero-initialised.
    """
    tops = 0
    for i in range(len(runs)):
        row, begin, end = runs[i, 0], max(runs[i, 1], first), min(runs[i, 2], last)
        for col in range(begin, end):
            above = out_offset[row - 1, col]
            out_offset[row, col] = above + 1
            tops += 1 if above == 0 else 0
    for i in range(len(runs) - 1, -1, -1):
        row, begin, end = runs[i, 0], max(runs[i, 1], first), min(runs[i, 2], last)
        for col in range(begin, end):
            # Where the pixel below is nearer to the background above, so is this one.
            up, below = out_offset[row, col], out_offset[row + 1, col]
            out_offset[row, col] = below + 1 if 0 <= below < up - 1 else -up
    return tops


@kernel
def trace_contours(contours):
    """Fill in the cracks of a silhouette; return the number of its contours.

    Shape pixels that share a corner are connected.
    """
    offset, upright, flat = contours.offset, contours.upright, contours.flat
    runs = contours.runs
    for i in range(len(runs)):
        upright[runs[i, 0], runs[i, 1]] = -1
    count, cracks = 0, 0
    for i in range(len(runs)):
        row, col = np.int64(runs[i, 0]), np.int64(runs[i, 1])
        if upright[row, col] >= 0:
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
def arc_between(a, b, contours):
    """Return the shorter arc between two cracks; different contours count as the longest."""
    arc, contour = contours.arc, contours.contour
    if contour[a] != contour[b]:
        return contours.longest
    way = abs(arc[a] - arc[b])
    return min(way, contours.length[contour[a]] - way)


@kernel
def row_envelope(offset, row, begin, end, column, key, start):
    """Find the background pixels nearest to the pixels begin..end of a row, a run of the shape.

    They make the lower envelope of the parabolas (x - c)^2 + offset(c)^2 over the columns c from
    begin - 1 to end. Writes the columns of its parts, and their first pixels; `key` is room for as
    many, end - begin + 2 numbers. Returns the number of parts. Ties go to the left.
    """
    count = 1
    column[0], start[0] = begin - 1, begin
    key[0] = (begin - 1) * (begin - 1)
    for c in range(begin, end + 1):
        g = offset[row, c] * offset[row, c] + c * c
        # Where the parabola of c gets strictly lower than that of another, at (g - key) / steep;
        # it hides what it is lower than from the beginning on. Products, since divisions are slow.
        while count > 0 and g - key[count - 1] < start[count - 1] * 2 * (c - column[count - 1]):
            count -= 1
        first = begin
        if count > 0:
            rise, steep = g - key[count - 1], 2 * (c - column[count - 1])
            if rise >= (end - 1) * steep:
                continue
            first = int(float(rise) / float(steep)) + 1  # whole ones divide slowly
        column[count], key[count], start[count] = c, g, first
        count += 1
    start[count] = end
    return count


@kernel
def bisector(row, ra, ca, rb, cb):
    """Return the column at which a row is as far from pixel (ra, ca) as from (rb, cb), ca != cb."""
    a, b = ra - row, rb - row
    return (b * b + cb * cb - a * a - ca * ca) / (2.0 * (cb - ca))


@kernel
def run_crossings(run, contours, saliency, scratch, begin, out, out_cracks, out_field):
    """Find where a run of pixels crosses the saliency skeleton; return the number of crossings.

    Crossings are written to `out` from index `begin` on, in ascending order. An `out_field` (h, w)
    that is not empty gets the distance of every pixel center, negative beside a crossing of this
    row. `out_cracks` (n, w) then gets the nearest crack of each pixel, in row `row % n`.
    """
    offset, upright, flat = contours.offset, contours.upright, contours.flat
    column, start = scratch.column, scratch.start
    row, first, col = (
        np.int64(contours.runs[run, 0]), np.int64(contours.runs[run, 1]),
        np.int64(contours.runs[run, 2]),
    )  # fmt: skip
    with_field = len(out_field) > 0
    line = row % max(len(out_cracks), 1)
    found, crack_before = begin, np.int32(-1)
    for part in range(row_envelope(offset, row, first, col, column, scratch.key, start)):
        c, x, end = column[part], start[part], start[part + 1]
        r = row + offset[row, c]
        high = abs(row - r)
        while x < end:
            # The crack of the feature point that faces the pixels from here to `past`.
            if x <= c - high:
                crack, past = upright[r, c], min(c - high + 1, end)
            elif x < c + high:
                crack, past = flat[r + 1 if row > r else r, c], min(c + high, end)
            else:
                crack, past = upright[r, c + 1], end
            if with_field:
                for k in range(x, past):
                    out_field[row, k] = math.sqrt(high * high + (k - c) * (k - c)) - 0.5
                    out_cracks[line, k] = crack
            if part > 0 and x == start[part] and crack != crack_before:
                rho = arc_between(crack, crack_before, contours)
                away = math.sqrt(high * high + (x - c) * (x - c)) - 0.5
                if rho > max(saliency * away, STAIRS):
                    left = column[part - 1]
                    at = bisector(row, row + offset[row, left], left, r, c)
                    away = math.sqrt((at - c) * (at - c) + high * high) - 0.5
                    if rho > saliency * away:
                        out.column[found] = at + 0.5
                        out.importance[found], out.distance[found] = rho, away
                        found += 1
                        if with_field:
                            out_field[row, x] = -abs(out_field[row, x])
                            out_field[row, x - 1] = -abs(out_field[row, x - 1])
            crack_before, x = crack, past
    return found - begin


@kernel
def compare_rows(run, contours, saliency, cracks, out_field):
    """Make distances negative beside crossings of columns between a run and the row above.

    `run_crossings` must have been called for the runs of both rows.
    """
    row, begin, end = contours.runs[run, 0], contours.runs[run, 1], contours.runs[run, 2]
    here, above = row % len(cracks), (row - 1) % len(cracks)
    for k in range(begin, end):
        if contours.offset[row - 1, k] != 0 and cracks[above, k] != cracks[here, k]:
            rho = arc_between(cracks[here, k], cracks[above, k], contours)
            if rho > max(saliency * abs(out_field[row, k]), STAIRS):
                out_field[row, k] = -abs(out_field[row, k])
                out_field[row - 1, k] = -abs(out_field[row - 1, k])


@kernel
def saliency_skeleton(contours, saliency, out_begin, out, out_field):
    """Find where rows cross the saliency skeleton, and, on request, the distance field.

    Crossings of row r have the numbers out_begin[r] to out_begin[r + 1], ascending. An `out_field`
    of the size of the picture gets the distance of every pixel center, negative beside the skeleton
    (crossings of rows and columns). Returns the number of crossings.
    """
    offset, runs = contours.offset, contours.runs
    room = offset.shape[1] + 2
    scratch = Envelope(np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64))
    cracks = np.empty((2, room), np.int32)
    found, begun = 0, 0
    for i in range(len(runs)):
        while begun <= runs[i, 0]:
            out_begin[begun] = found
            begun += 1
        found += run_crossings(i, contours, saliency, scratch, found, out, cracks, out_field)
        if len(out_field) > 0:
            compare_rows(i, contours, saliency, cracks, out_field)
    while begun < len(out_begin):
        out_begin[begun] = found
        begun += 1
    for i in range(len(runs)):
        offset[runs[i, 0], runs[i, 1] : runs[i, 2]] = 0
    return found
