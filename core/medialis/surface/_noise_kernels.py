"""Kernels of the noise of a surface (noise.py): rings of vertices, and quadrics through them."""

from __future__ import annotations

import math

from medialis._kernels.jit import kernel
from medialis._kernels.solve_kernels import solve

SINGULAR = 1e-9  # weight of the six terms: neighbours on one line or conic


@kernel
def list_links(edges, used, out_offsets, out_neighbours):
    """Neighbours of each vertex along the edges between used ones; `out_offsets` (n + 2,) is 0."""
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if used[a] and used[b]:
            out_offsets[a + 2] += 1
            out_offsets[b + 2] += 1
    for v in range(1, len(out_offsets)):
        out_offsets[v] += out_offsets[v - 1]
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        if used[a] and used[b]:
            out_neighbours[out_offsets[a + 1]] = b
            out_neighbours[out_offsets[b + 1]] = a
            out_offsets[a + 1] += 1
            out_offsets[b + 1] += 1


@kernel
def mark_bent(half_edges, bends, least, faces, out_flat):
    """Tell that the vertices of edges that bend by `least` or more are not flat, (n,)."""
    for k in range(len(half_edges)):
        if bends[k] >= least:
            f = half_edges[k] // 3
            j = half_edges[k] - 3 * f
            out_flat[faces[f, j]] = out_flat[faces[f, (j + 1) % 3]] = False


@kernel
def find_rings(rows, steps, offsets, neighbours, seen, out_rings, out_counts):
    """Vertices within some steps of each row, without itself; one more than fit: too many.

    `seen` (n,) int32 is -1 for each vertex.
    """
    most = out_rings.shape[1]
    for k in range(len(rows)):
        seen[rows[k]] = k
        count, begin, end = 0, 0, 0
        for step in range(steps):
            for at in range(begin - (step == 0), end):
                v = rows[k] if step == 0 else out_rings[k, at]
                for i in range(offsets[v], offsets[v + 1]):
                    w = neighbours[i]
                    if seen[w] == k:
                        continue
                    seen[w] = k
                    if count < most:
                        out_rings[k, count] = w
                    count += 1
                    if count > most:
                        break
                if count > most:
                    break
            if count > most:
                break
            begin, end = end, count
        out_counts[k] = count


@kernel
def measure_spread(points, rows, rings, counts, out_spread):
    """Covariance of each ring round its mean; `out_spread` (k, 4, 3), the mean as last row."""
    for k in range(len(rows)):
        count = counts[k]
        for axis in range(3):
            total = 0.0
            for i in range(count):
                total += points[rings[k, i], axis]
            out_spread[k, 3, axis] = total / count
        for a in range(3):
            for b in range(3):
                total = 0.0
                for i in range(count):
                    v = rings[k, i]
                    x = points[v, a] - out_spread[k, 3, a]
                    total += x * (points[v, b] - out_spread[k, 3, b])
                out_spread[k, a, b] = total / count


@kernel
def _fill_terms(u, v, terms):
    terms[0], terms[1], terms[2], terms[3], terms[4], terms[5] = 1.0, u, v, u * u, u * v, v * v


@kernel
def measure_off_quadrics(
    points, rows, rings, counts, means, axes, sizes, matrix, right, terms, out_away
):
    """Distance of each row from the quadric through its ring, in deviations of equal noise.

    `axes` (k, 3, 3) has the normal as its first column, `sizes` (k,) the extent of the ring. What
    the noise of the ring makes of the quadric divides the distance. `matrix` (6, 6), `right` (6, 2)
    and `terms` (6,) are room.
    """
    for k in range(len(rows)):
        for a in range(6):
            right[a, 0] = 0.0
            for b in range(a + 1):
                matrix[a, b] = 0.0
        count, size = counts[k], sizes[k]
        for i in range(count + 1):
            v = rings[k, i] if i < count else rows[k]
            x, y, z = (
                points[v, 0] - means[k, 0],
                points[v, 1] - means[k, 1],
                points[v, 2] - means[k, 2],
            )
            h = (x * axes[k, 0, 0] + y * axes[k, 1, 0] + z * axes[k, 2, 0]) / size
            s = (x * axes[k, 0, 2] + y * axes[k, 1, 2] + z * axes[k, 2, 2]) / size
            t = (x * axes[k, 0, 1] + y * axes[k, 1, 1] + z * axes[k, 2, 1]) / size
            _fill_terms(s, t, terms)
            if i == count:
                break
            for a in range(6):
                right[a, 0] += terms[a] * h
                for b in range(a + 1):
                    matrix[a, b] += terms[a] * terms[b]
        for a in range(6):
            matrix[a, a] += SINGULAR * count
            right[a, 1] = terms[a]  # of the row itself
        solve(matrix, right)
        away, carried = h, 0.0
        for a in range(6):
            away -= right[a, 0] * terms[a]
            carried += right[a, 1] * terms[a]
        out_away[k] = abs(away) / math.sqrt(1.0 + max(carried, 0.0)) * size
