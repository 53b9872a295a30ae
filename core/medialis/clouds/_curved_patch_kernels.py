"""Kernels: patches of neighbourhoods too coarse for their curvature, bent along a quadric.

Heights over a plane through point i, h(u, v) = a + b u + c v + d u u + e u v + f v v, are fitted to
its neighbours by least squares, without the point itself: whether the surface passes through it
is the question. What is left is compared with the same angle as the triangles of a flat patch.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

TERMS = 6

CHANCE = 2.0
"""Deviation of a corner from its quadric, in units of the largest mean deviation."""

OFF, CLOSE = 3.0, 0.02
"""Deviation of the point itself, in units of the mean deviation and of the mean distance, beyond
which it is an outlier: three deviations are chance once in 370 times. Where there is no noise the
mean deviation is next to nothing; a sphere of radius r leaves d^4 / (8 r^3) of its quadric at the
distance d, which is 1.6 % of d at the steepest."""

STEEPEST = 0.7
"""Slopes of the quadric in both directions together, at the mean distance d of the neighbours. On a
sphere that is sqrt 2 d / r. Its height over the tangent plane has one value up to the distance r
only, and neighbours reach as far as 2 d: so d / r is at most a half."""

ROUNDS = 3
"""The plane is turned into the tangent plane of the quadric; its second turn is small."""


@kernel
def _frame(axis, frame):
    """Fill two unit directions across an axis."""
    m = 0
    for c in range(1, 3):
        if abs(axis[c]) < abs(axis[m]):
            m = c
    length = math.sqrt(1.0 - axis[m] * axis[m])
    for c in range(3):
        frame[0, c] = ((1.0 if c == m else 0.0) - axis[m] * axis[c]) / length
    frame[1, 0] = axis[1] * frame[0, 2] - axis[2] * frame[0, 1]
    frame[1, 1] = axis[2] * frame[0, 0] - axis[0] * frame[0, 2]
    frame[1, 2] = axis[0] * frame[0, 1] - axis[1] * frame[0, 0]


@kernel
def _terms(sides, m, frame, radius, row):
    """Terms of the quadric at a neighbour, in units of the radius."""
    u = (sides[m, 0] * frame[0, 0] + sides[m, 1] * frame[0, 1] + sides[m, 2] * frame[0, 2]) / radius
    v = (sides[m, 0] * frame[1, 0] + sides[m, 1] * frame[1, 1] + sides[m, 2] * frame[1, 2]) / radius
    row[0], row[1], row[2], row[3], row[4], row[5] = 1.0, u, v, u * u, u * v, v * v


@kernel
def _height(sides, m, axis, radius):
    return (sides[m, 0] * axis[0] + sides[m, 1] * axis[1] + sides[m, 2] * axis[2]) / radius


@kernel
def _solve(matrix, right):
    """Solve a symmetric positive definite system in place (Cholesky); False if it is singular."""
    for i in range(TERMS):
        whole = matrix[i, i]
        for j in range(i):
            whole -= matrix[i, j] * matrix[i, j]
        if whole <= 1e-9 * matrix[i, i]:
            return False
        matrix[i, i] = math.sqrt(whole)
        for k in range(i + 1, TERMS):
            value = matrix[k, i]
            for j in range(i):
                value -= matrix[k, j] * matrix[i, j]
            matrix[k, i] = value / matrix[i, i]
    for i in range(TERMS):
        for j in range(i):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    for i in range(TERMS - 1, -1, -1):
        for j in range(i + 1, TERMS):
            right[i] -= matrix[j, i] * right[j]
        right[i] /= matrix[i, i]
    return True


@kernel
def _fit(sides, used, axis, frame, radius, row, matrix, right):
    """Coefficients of the quadric of the used neighbours in `right`; False if there is none."""
    matrix[:, :] = 0.0
    right[:] = 0.0
    for m in range(len(used)):
        if not used[m]:
            continue
        _terms(sides, m, frame, radius, row)
        height = _height(sides, m, axis, radius)
        for a in range(TERMS):
            right[a] += row[a] * height
            for b in range(a + 1):
                matrix[a, b] += row[a] * row[b]
    return _solve(matrix, right)


@kernel
def _misfit(sides, used, axis, frame, radius, row, right):
    """Root mean square of what the quadric leaves, for its degrees of freedom, and the worst."""
    total, most, worst, count = 0.0, -1.0, -1, 0
    for m in range(len(used)):
        if not used[m]:
            continue
        _terms(sides, m, frame, radius, row)
        left = _height(sides, m, axis, radius)
        for a in range(TERMS):
            left -= right[a] * row[a]
        total += left * left
        count += 1
        if abs(left) > most:
            most, worst = abs(left), m
    return math.sqrt(total / max(count - TERMS, 1)), worst


@kernel
def _corners(sides, used, axis, bend, offset, flattest, radius):
    """Return the used neighbours as bits, but those farther off than chance explains."""
    bits = np.uint64(0)
    for m in range(len(used)):
        left = _height(sides, m, axis, 1.0)
        for c in range(3):
            for b in range(3):
                left -= 0.5 * sides[m, c] * bend[c, b] * sides[m, b]
        if used[m] and abs(left / radius - offset) <= CHANCE * flattest:
            bits |= np.uint64(1) << np.uint64(m)
    return bits


@kernel
def flat_misfit(sides, axes, count, drops):
    """Return what the planes of flat patches leave of the neighbours, in units of `bend_patch`.

    Each neighbour counts with the plane that is nearest to it; the `drops` farthest do not.
    """
    k = len(sides)
    heights, radius = np.empty(k), 0.0
    for m in range(k):
        radius += math.sqrt(sides[m, 0] ** 2 + sides[m, 1] ** 2 + sides[m, 2] ** 2) / k
        height = np.inf
        for p in range(count):
            height = min(height, abs(_height(sides, m, axes[p], 1.0)))
        at = m
        while at > 0 and heights[at - 1] > height:
            heights[at] = heights[at - 1]
            at -= 1
        heights[at] = height
    total = 0.0
    for m in range(k - drops):
        total += heights[m] ** 2
    return math.sqrt(total / max(k - drops - 2 * count, 1)) / radius


@kernel
def bend_patch(sides, flattest, drops, axis, out_bend):
    """Bend a patch along a quadric: turn `axis` into its normal; tell its neighbours as bits.

    `sides` (k, 3) are the neighbours from the point. What the quadric leaves, on average and at the
    point, must not exceed `flattest` times their mean distance; up to `drops` neighbours may lie
    elsewhere. No bits: there is no such patch. The normal at x is ``axis - out_bend x``.
    """
    k = len(sides)
    frame, row = np.empty((2, 3)), np.empty(TERMS)
    matrix, right = np.empty((TERMS, TERMS)), np.empty(TERMS)
    used = np.ones(k, np.bool_)
    radius = 0.0
    for m in range(k):
        radius += math.sqrt(sides[m, 0] ** 2 + sides[m, 1] ** 2 + sides[m, 2] ** 2) / k
    for drop in range(drops + 1):
        for _ in range(ROUNDS):
            _frame(axis, frame)
            if not _fit(sides, used, axis, frame, radius, row, matrix, right):
                return np.uint64(0)
            misfit, worst = _misfit(sides, used, axis, frame, radius, row, right)
            offset = right[0]
            length = math.sqrt(1.0 + right[1] ** 2 + right[2] ** 2)
            for c in range(3):
                axis[c] = (axis[c] - right[1] * frame[0, c] - right[2] * frame[1, c]) / length
                for b in range(3):
                    out_bend[c, b] = (
                        2.0 * right[3] * frame[0, c] * frame[0, b]
                        + right[4] * (frame[0, c] * frame[1, b] + frame[1, c] * frame[0, b])
                        + 2.0 * right[5] * frame[1, c] * frame[1, b]
                    ) / (radius * length)
        if misfit <= flattest:
            break
        if drop == drops:
            return np.uint64(0)
        used[worst] = False
    turn = 0.0
    for c in range(3):
        for b in range(3):
            turn += (radius * out_bend[c, b]) ** 2
    if turn > STEEPEST * STEEPEST or abs(offset) > min(flattest, OFF * misfit + CLOSE):
        return np.uint64(0)
    return _corners(sides, used, axis, out_bend, offset, flattest, radius)
