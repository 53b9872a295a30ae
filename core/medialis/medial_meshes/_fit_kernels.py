"""Sums for fitting balls to a surface: weights, and the normal equations by vertex and edge."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def weigh(distances, weights, power, scale, out):
    """Weights w (|d| / scale)^(power - 2), and the sum of all weighted squares."""
    total = 0.0
    for i in range(len(distances)):
        out[i] = weights[i] * (abs(distances[i]) / scale + 1e-6) ** (power - 2.0)
        total += out[i] * distances[i] * distances[i]
    return total


@kernel
def add_rows(
    places,
    signs,
    balls,
    rows,
    row_edges,
    distances,
    row,
    shares,
    weights,
    out_diagonal,
    out_edges,
    out_gradient,
):
    """Add the rows of J^T W J and J^T W d for distances d of places to points of the complex.

    d = s |p - c(l)| - r(l) with shares l has the derivative -l_k (s n, 1) by ball k, n the
    direction from c(l) to the place. Blocks m m^T are symmetric: ten numbers a vertex and an edge.
    """
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


@kernel
def _add_block(out, factor, m):
    slot = 0
    for a in range(4):
        for b in range(a, 4):
            out[slot] += factor * m[a] * m[b]
            slot += 1
