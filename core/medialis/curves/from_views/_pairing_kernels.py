"""Kernel of thesis 3.7.4: points of the two skeletons of a pair of views, matched along rows.

Both cameras have the same center and the same up-axis; the second one is the first one turned
about it by the angle alpha. So a row of the one is the same row of the other, and a point at column
x, depth k of the first has the column x cos(alpha) - k sin(alpha) in the second, both measured from
the middle in units of length (Eq. 3.9).
"""

import math

from medialis._kernels.jit import kernel


@kernel
def middle_depth(near, far, row, column):
    """Return near and far depth where a row has a sub-pixel column; of the nearer pixel, if in."""
    col = int(column)
    if math.isnan(near[row, col]):  # a crossing lies between two pixels of the shape
        col = col - 1 if column - col < 0.5 else col + 1
    return near[row, col], far[row, col]


@kernel
def best_partner(x, estimate, others, begin, end, middle, pixel, cosine, sine):
    """Return the number of the crossing whose depth is nearest to the estimate, and its depth.

    Columns ascend, so depths descend: scanned from the right, depths grow, and the scan stops as
    soon as the distance to the estimate grows (thesis 3.7.4.2).
    """
    best, depth, least = -1, 0.0, math.inf
    for j in range(end - 1, begin - 1, -1):
        k = (x * cosine - (others[j] - middle) * pixel) / sine
        gap = abs(estimate - k)
        if gap >= least:
            break
        best, depth, least = j, k, gap
    return best, depth


@kernel
def pair_crossings(
    begin_a, column_a, near_a, far_a, begin_b, column_b, near_b, far_b, pixel, cosine, sine, out
):
    """Write right, up and depth, as the first camera sees them, of the matched points.

    A match counts when the point lies within the depth range of both views. Returns the number of
    points.
    """
    size = len(begin_a) - 1
    middle = 0.5 * size
    count = 0
    for row in range(size):
        for i in range(begin_a[row], begin_a[row + 1]):
            x = (column_a[i] - middle) * pixel
            low, high = middle_depth(near_a, far_a, row, column_a[i])
            j, k = best_partner(
                x, 0.5 * (low + high), column_b, begin_b[row], begin_b[row + 1],
                middle, pixel, cosine, sine,
            )  # fmt: skip
            if j < 0 or not low <= k <= high:
                continue
            low, high = middle_depth(near_b, far_b, row, column_b[j])
            depth = k * cosine + x * sine
            if not low <= depth <= high:
                continue
            out[count, 0] = x
            out[count, 1] = (middle - row - 0.5) * pixel
            out[count, 2] = k
            count += 1
    return count
