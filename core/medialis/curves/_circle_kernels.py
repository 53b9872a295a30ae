"""Kernels that fit circles to points of a section: some on one side only, some strays."""

from __future__ import annotations

import math

import numpy as np

from medialis.base.jit import kernel

DRAW_POINTS = 250
"""Maximum number of points that a hypothesis is scored on; more points do not change the best."""

CONSENSUS = 0.6
"""Fraction of points that a hypothesis has to explain: up to 40 % may be strays."""

WIDEST_RADIUS = 1.5
"""Maximum radius in units of the distance from the median point to the farthest one. An arc of 90
degrees has 1.3."""

CUT = 4.0
"""Residuals of more than so many standard deviations have no weight (Tukey's biweight)."""

ROUNDS = 15
"""Maximum number of Gauss-Newton steps; most fits need 6."""


@kernel
def _kth_smallest(values, count, k):
    """Return the k-th smallest of values[:count], from 0; the values are reordered."""
    low, high = 0, count - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            return values[k]
    return values[low]


@kernel
def _spread(points, begin, end, values):
    """Return the maximum distance from the median point."""
    count = end - begin
    middle_x = middle_y = 0.0
    for axis in range(2):
        for k in range(count):
            values[k] = points[begin + k, axis]
        middle = _kth_smallest(values, count, count // 2)
        if axis == 0:
            middle_x = middle
        else:
            middle_y = middle
    farthest = 0.0
    for k in range(begin, end):
        farthest = max(farthest, math.hypot(points[k, 0] - middle_x, points[k, 1] - middle_y))
    return farthest


@kernel
def _circumcircle(points, a, b, c):
    """Return center and radius of the circle through three points; radius inf if collinear."""
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    det = 2.0 * (ux * vy - uy * vx)
    uu, vv = ux * ux + uy * uy, vx * vx + vy * vy
    if abs(det) <= 1e-12 * math.sqrt(uu * vv):
        return 0.0, 0.0, math.inf
    x, y = (vy * uu - uy * vv) / det, (ux * vv - vx * uu) / det
    return points[a, 0] + x, points[a, 1] + y, math.hypot(x, y)


@kernel
def _best_draw(points, begin, end, draws, widest, values):
    """Return x, y, radius and score of the circle through three points that most others are near.

    The score is the residual below which `CONSENSUS` of the points are (least quantile of
    squares); inf without a valid circle.
    """
    step = max(1, -(-(end - begin) // DRAW_POINTS))
    count = -(-(end - begin) // step)
    k = max(3, math.ceil(CONSENSUS * count)) - 1
    best_x = best_y = best_r = 0.0
    best = math.inf
    for row in range(len(draws)):
        # Three points that are about a third of the range apart: no point twice.
        a = begin + step * int(draws[row, 0] * count)
        b = begin + step * (int((draws[row, 0] + (1.0 + draws[row, 1]) / 3.0) * count) % count)
        c = begin + step * (int((draws[row, 0] + (2.0 + draws[row, 2]) / 3.0) * count) % count)
        x, y, r = _circumcircle(points, a, b, c)
        if not 0.0 < r < widest:
            continue
        for j in range(count):
            p = begin + step * j
            values[j] = abs(math.hypot(points[p, 0] - x, points[p, 1] - y) - r)
        score = _kth_smallest(values, count, min(k, count - 1))
        if score < best:
            best, best_x, best_y, best_r = score, x, y, r
    return best_x, best_y, best_r, best


@kernel
def _normal_equations(points, begin, end, circle, sigma, out):
    """Sum the weighted normal equations of the residuals (3, 4) for a step of x, y and r.

    Returns the sums of weights and of weighted squared residuals, and the number of points with
    weight.
    """
    x, y, r = circle
    out[:] = 0.0
    weights = squares = 0.0
    inliers = 0
    for p in range(begin, end):
        dx, dy = points[p, 0] - x, points[p, 1] - y
        d = max(math.hypot(dx, dy), 1e-300)
        e = d - r
        u = e / (CUT * sigma)
        if abs(u) >= 1.0:
            continue
        w = (1.0 - u * u) * (1.0 - u * u)
        jx, jy = -dx / d, -dy / d
        out[0, 0] += w * jx * jx
        out[0, 1] += w * jx * jy
        out[0, 2] -= w * jx
        out[1, 1] += w * jy * jy
        out[1, 2] -= w * jy
        out[2, 2] += w
        out[0, 3] -= w * jx * e
        out[1, 3] -= w * jy * e
        out[2, 3] += w * e
        weights += w
        squares += w * e * e
        inliers += 1
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    return weights, squares, inliers


@kernel
def _cofactors(m):
    """Return the determinant of a symmetric matrix (3, 3) and its cofactor of the last entry."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]
    c01 = m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]
    c02 = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    return m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02, c00, c01, c02


@kernel
def _refine(points, begin, end, circle, sigma, floor, widest, out):
    """Refine a circle by weighted least squares; write x, y, radius, sigma, error, inliers."""
    x, y, r = circle
    m = np.empty((3, 4))
    inliers = 0
    cofactor = det = 0.0
    for _ in range(ROUNDS):
        weights, squares, inliers = _normal_equations(points, begin, end, (x, y, r), sigma, m)
        det, c00, c01, c02 = _cofactors(m)
        if inliers < 4 or det < 1e-9 * weights**3:
            return
        c11 = m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]
        c12 = m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]
        cofactor = m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]
        dx = (c00 * m[0, 3] + c01 * m[1, 3] + c02 * m[2, 3]) / det
        dy = (c01 * m[0, 3] + c11 * m[1, 3] + c12 * m[2, 3]) / det
        dr = (c02 * m[0, 3] + c12 * m[1, 3] + cofactor * m[2, 3]) / det
        step = math.sqrt(dx * dx + dy * dy + dr * dr)
        shrink = min(1.0, widest / (3.0 * max(step, 1e-300)))
        x, y, r = x + shrink * dx, y + shrink * dy, r + shrink * dr
        if not 0.0 < r < widest:
            return
        # 1.25: the weights take that much off the standard deviation of normal residuals.
        freedom = max(weights - 3.0, 0.1 * weights)
        sigma = max(1.25 * math.sqrt(squares / freedom), floor)
        if step < 1e-3 * r:
            break
    out[0], out[1], out[2], out[3] = x, y, r, sigma
    out[4] = sigma * math.sqrt(cofactor / det) / r
    out[5] = inliers


@kernel
def fit_circles(begin, end, points, first, draws, floor, out):
    """Fit a circle to the points (n, 2) of each section: rows first[s] to first[s + 1].

    `draws` (d, 3) holds random numbers in 0..1; `out` (s, 6) gets x, y, radius, standard deviation
    of the residuals, relative standard error of the radius and number of inliers. It must be
    initialised with NaN, which stays where no circle fits.
    """
    for s in range(begin, end):
        low, high = first[s], first[s + 1]
        if high - low < 5:
            continue
        values = np.empty(high - low)
        widest = WIDEST_RADIUS * _spread(points, low, high, values)
        x, y, r, score = _best_draw(points, low, high, draws, widest, values)
        if score == math.inf:
            continue
        _refine(points, low, high, (x, y, r), max(1.2 * score, floor), floor, widest, out[s])
