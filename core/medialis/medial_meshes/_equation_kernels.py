"""Cholesky factors of symmetric matrices of 4 x 4 blocks, and what they solve.

Column k of the factor has its blocks at starts[k] up to starts[k + 1], the diagonal one first and
then down the rows, which are ascending: with each block also those that its column fills.
"""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def _fill(values, out):
    """Write a symmetric block (4, 4) of its ten numbers."""
    slot = 0
    for a in range(4):
        for b in range(a, 4):
            out[a, b] = out[b, a] = values[slot]
            slot += 1


@kernel
def _factor(block):
    """Put a lower triangle in place of a block L L^T."""
    for i in range(4):
        for j in range(i + 1):
            s = block[i, j]
            for k in range(j):
                s -= block[i, k] * block[j, k]
            block[i, j] = np.sqrt(max(s, 1e-300)) if i == j else s / block[j, j]


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
        _factor(factors[first])
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
        _fill(diagonal[column], factors[starts[column]])
    for e in range(len(blocks)):
        _fill(blocks[e], factors[slots[e]])
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
