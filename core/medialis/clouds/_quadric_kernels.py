"""Kernels of the smoothing of clouds: each point on the quadric through the points round it."""

from __future__ import annotations

import math

import numpy as np

from medialis.base._kernels import solve
from medialis.base.jit import kernel

TERMS = 6
"""1, u, v, u u, u v, v v."""

BANDS = (0.25, 0.12, 0.0, 0.0)
"""Shares of the radius of the neighbourhood: half the band of each fit at least. What bends lies
off the plane of the first one, and off the quadrics of the others by its noise alone."""

DAMPING = 1e-9
"""Share of the largest diagonal term that is added to all: neighbourhoods on a line."""

FEWEST = 12
"""Points, by weight, that name a quadric: twice its terms."""


@kernel
def _fit(rows, count, size, band, terms):
    """Fit heights over a plane by weights that fall to 0 at the rim, and at a band's borders.

    `rows` are u, v, height; `terms` those of the quadric before and after, in units of the size.
    Returns the sum of the weights.
    """
    matrix, right = np.zeros((TERMS, TERMS)), np.zeros((TERMS, 1))
    form, total = np.empty(TERMS), 0.0
    for i in range(count):
        u, v = rows[i, 0] / size, rows[i, 1] / size
        form[0], form[1], form[2] = 1.0, u, v
        form[3], form[4], form[5] = u * u, u * v, v * v
        away = rows[i, 2]
        for a in range(TERMS):
            away -= terms[a] * form[a]
        off, rim = (away / band) ** 2, u * u + v * v
        if off >= 1.0 or rim >= 1.0:
            continue
        weight = (1.0 - off) ** 2 * (1.0 - rim)
        total += weight
        for a in range(TERMS):
            right[a, 0] += weight * form[a] * rows[i, 2]
            for b in range(a + 1):
                matrix[a, b] += weight * form[a] * form[b]
    if total < FEWEST:
        return total
    largest = 0.0
    for a in range(TERMS):
        largest = max(largest, matrix[a, a])
    for a in range(TERMS):
        matrix[a, a] += DAMPING * largest
    solve(matrix, right)
    for a in range(TERMS):
        terms[a] = right[a, 0]
    return total


@kernel
def move_onto_quadrics(begin, end, points, near, starts, scatter, bands, out_points):
    """Move points onto the quadrics through their neighbours that hold most of them.

    `points` are the neighbours (m, 3); row r of `near` numbers those of place r. `starts` (q, 7)
    are the places, with a unit normal and the height of the surface above them along it. Of `bands`
    times the scatter the first is half that of a fit; points that are off by the second stay.
    """
    band, farthest = bands
    k = near.shape[1]
    rows, terms, axes = np.empty((k, 3)), np.empty(TERMS), np.empty((3, 3))
    for i in range(begin, end):
        for c in range(3):
            axes[2, c] = starts[i, 3 + c]
        first = 0
        for c in range(3):
            if abs(axes[2, c]) < abs(axes[2, first]):
                first = c
        size = 0.0
        for c in range(3):
            axes[0, c] = (1.0 if c == first else 0.0) - axes[2, first] * axes[2, c]
            size += axes[0, c] ** 2
        for c in range(3):
            axes[0, c] /= math.sqrt(size)
        for c in range(3):
            a, b = (c + 1) % 3, (c + 2) % 3
            axes[1, c] = axes[2, a] * axes[0, b] - axes[2, b] * axes[0, a]
        size = 0.0
        for j in range(k):
            for axis in range(3):
                rows[j, axis] = 0.0
                for c in range(3):
                    rows[j, axis] += axes[axis, c] * (points[near[i, j], c] - starts[i, c])
            size = max(size, rows[j, 0] ** 2 + rows[j, 1] ** 2)
        size = math.sqrt(size) * 1.001
        terms[:] = 0.0
        terms[0] = starts[i, 6]
        known = size > 0.0
        for share in BANDS:
            known = (
                known and _fit(rows, k, size, max(share * size, band * scatter), terms) >= FEWEST
            )
        if not known or abs(terms[0]) > farthest * scatter:
            continue
        slope = (terms[1] ** 2 + terms[2] ** 2) / size**2
        for c in range(3):
            along = axes[2, c] - (terms[1] * axes[0, c] + terms[2] * axes[1, c]) / size
            out_points[i, c] += terms[0] * along / (1.0 + slope)
