"""Small systems of equations, solved in place."""

from __future__ import annotations

from medialis._kernels.jit import kernel


@kernel
def solve(matrix, x):
    """Solve a symmetric positive system for columns x, by its factors L D L^T.

    Of `matrix` (n, n) the lower half is read and becomes the factors; `x` (n, c) becomes the
    solutions.
    """
    size = len(x)
    for i in range(size):
        for j in range(i):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k] * matrix[k, k]
            matrix[i, j] /= matrix[j, j]
        for k in range(i):
            matrix[i, i] -= matrix[i, k] * matrix[i, k] * matrix[k, k]
    for column in range(x.shape[1]):
        for i in range(size):
            for k in range(i):
                x[i, column] -= matrix[i, k] * x[k, column]
        for i in range(size):
            x[i, column] /= matrix[i, i]
        for i in range(size - 1, -1, -1):
            for k in range(i + 1, size):
                x[i, column] -= matrix[k, i] * x[k, column]
