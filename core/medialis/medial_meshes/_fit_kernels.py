"""Kernels of fits of balls to a surface: weights, normal equations by vertex and edge, solution.

The equations are a symmetric matrix of 4 x 4 blocks. Column k of its Cholesky factor has its blocks
at starts[k] up to starts[k + 1], the diagonal one first and then down the rows, which are
ascending: with each block also those that its column fills.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel


class Points(NamedTuple):
    """Places (q, 3) and what they tell of the points of a complex.

    Attributes
    ----------
    places : (q, 3) float64
    signs, distances : (q,) float64
        Distance d = s |p - c(l)| - r(l) with the sign s.
    row : (q,) int64
        The primitive that each belongs to.
    shares : (q, 3) float64
        l: those of its balls.
    weights : (q,) float64
    """

    places: NDArray[np.float64]
    signs: NDArray[np.float64]
    distances: NDArray[np.float64]
    row: NDArray[np.int64]
    shares: NDArray[np.float64]
    weights: NDArray[np.float64]


class Sums(NamedTuple):
    """J^T W J by n vertices and e edges, ten numbers a block, and J^T W d."""

    diagonal: NDArray[np.float64]
    """(n, 10)"""
    blocks: NDArray[np.float64]
    """(e, 10)"""
    gradient: NDArray[np.float64]
    """(n, 4)"""


@kernel
def fill(values, out):
    """Write a symmetric block (4, 4) of its ten numbers."""
    slot = 0
    for a in range(4):
        for b in range(a, 4):
            out[a, b] = out[b, a] = values[slot]
            slot += 1


@kernel
def factor(block, least):
    """Put a lower triangle in place of a block L L^T, with no square below `least`."""
    for i in range(4):
        for j in range(i + 1):
            s = block[i, j]
            for k in range(j):
                s -= block[i, k] * block[j, k]
            block[i, j] = np.sqrt(max(s, least)) if i == j else s / block[j, j]


@kernel
def _divide(block, triangle):
    """Multiply a block by the inverse of a transposed lower triangle."""
    for i in range(4):
        for j in range(4):
            s = block[i, j]
            for k in range(j):
                s -= block[i, k] * triangle[j, k]
            block[i, j] = s / triangle[j, j]


@kernel
def _factorize(starts, rows, factors):
    """Put the factor in place of the matrix, column by column."""
    turned = np.empty((4, 4))
    for column in range(len(starts) - 1):
        first, end = starts[column], starts[column + 1]
        factor(factors[first], 1e-300)
        for p in range(first + 1, end):
            _divide(factors[p], factors[first])
        for p in range(first + 1, end):
            for a in range(4):
                for b in range(4):
                    turned[a, b] = factors[p, b, a]
            at = starts[rows[p]]
            for q in range(p, end):
                while rows[at] != rows[q]:
                    at += 1
                for a in range(4):
                    for k in range(4):
                        for b in range(4):
                            factors[at, a, b] -= factors[q, a, k] * turned[k, b]


@kernel
def solve(diagonal, blocks, slots, starts, rows, right, factors):
    """Solve the equations of blocks on the diagonal (n, 10) and beside it (e, 10), in place.

    `slots` (e,) are where the latter belong in the factor; `right` (n, 4) becomes the solution,
    `factors` (l, 4, 4) is scratch.
    """
    n = len(diagonal)
    factors[:] = 0.0
    for column in range(n):
        fill(diagonal[column], factors[starts[column]])
    for e in range(len(blocks)):
        fill(blocks[e], factors[slots[e]])
    _factorize(starts, rows, factors)
    for column in range(n):
        own, first = right[column], starts[column]
        for i in range(4):
            for k in range(i):
                own[i] -= factors[first, i, k] * own[k]
            own[i] /= factors[first, i, i]
        for p in range(first + 1, starts[column + 1]):
            for i in range(4):
                for k in range(4):
                    right[rows[p], i] -= factors[p, i, k] * own[k]
    for column in range(n - 1, -1, -1):
        own, first = right[column], starts[column]
        for p in range(first + 1, starts[column + 1]):
            for i in range(4):
                for k in range(4):
                    own[k] -= factors[p, i, k] * right[rows[p], i]
        for i in range(3, -1, -1):
            for k in range(i + 1, 4):
                own[i] -= factors[first, k, i] * own[k]
            own[i] /= factors[first, i, i]


@kernel
def weigh(distances, weight, power, scale, out):
    """Weights w (|d| / scale)^(power - 2), and the sum of all weighted squares."""
    total = 0.0
    for i in range(len(distances)):
        out[i] = weight * (abs(distances[i]) / scale + 1e-6) ** (power - 2.0)
        total += out[i] * distances[i] * distances[i]
    return total


@kernel
def _add_block(out, factor, m):
    slot = 0
    for a in range(4):
        for b in range(a, 4):
            out[slot] += factor * m[a] * m[b]
            slot += 1


@kernel
def add_rows(given, balls, rows, row_edges, out):
    """Add the rows of J^T W J and J^T W d for the distances d of points.

    d = s |p - c(l)| - r(l) with shares l has the derivative -l_k (s n, 1) by ball k, n the
    direction from c(l) to the place. `rows` (s, 3) are the balls of the primitives, `row_edges`
    (s, 3) the edges between them. Blocks m m^T are symmetric: ten numbers a vertex and an edge.
    """
    places, signs, distances, row, shares, weights = given
    out_diagonal, out_edges, out_gradient = out
    m = np.empty(4)
    for q in range(len(places)):
        w, s = weights[q], row[q]
        square = 0.0
        for d in range(3):
            center = 0.0
            for k in range(3):
                if rows[s, k] >= 0:
                    center += shares[q, k] * balls[rows[s, k], d]
            m[d] = places[q, d] - center
            square += m[d] * m[d]
        factor = signs[q] / (np.sqrt(square) + 1e-15)
        for d in range(3):
            m[d] *= factor
        m[3] = 1.0
        for k in range(3):
            if rows[s, k] < 0 or shares[q, k] == 0.0:
                continue
            for a in range(4):
                out_gradient[rows[s, k], a] += w * shares[q, k] * distances[q] * m[a]
            _add_block(out_diagonal[rows[s, k]], w * shares[q, k] * shares[q, k], m)
            for j in range(k + 1, 3):
                if rows[s, j] >= 0 and shares[q, j] != 0.0:
                    _add_block(
                        out_edges[row_edges[s, k + j - 1]], w * shares[q, k] * shares[q, j], m
                    )
