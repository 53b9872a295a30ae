"""Kernel of calipers (calipers.py): the smallest ball between two patches of faces.

A place with its normal is six numbers.
"""

from __future__ import annotations

import math

from medialis._kernels.jit import kernel
from medialis._kernels.nearest_kernels import nearest_place

PARALLEL = 1e-12  # part of the product of squared lengths: edges without a closest place


@kernel
def _measure(a, b, across, touching):
    """Diameter of the ball between two places; inf where they do not face each other."""
    dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length <= touching:
        return 0.0
    size_a = math.sqrt(a[3] * a[3] + a[4] * a[4] + a[5] * a[5])
    size_b = math.sqrt(b[3] * b[3] + b[4] * b[4] + b[5] * b[5])
    along = (a[3] * dx + a[4] * dy + a[5] * dz) / max(size_a, 1e-300)
    back = -(b[3] * dx + b[4] * dy + b[5] * dz) / max(size_b, 1e-300)
    lean = min(along, back)  # a length times a cosine
    if lean < across * length or lean <= 0.0:
        return math.inf
    return length * length / lean


@kernel
def _offer(a, b, before, limits, best, out_ends):
    """Take the ball between two places if it is smaller, or equal and nearer to those before.

    `limits`: the least cosine across, the length of touching places, and what is equal. `best` is
    the smallest diameter, that of the ball that is taken, and how far that one is off.
    """
    diameter, equal = _measure(a, b, limits[0], limits[1]), 1.0 + limits[2]
    if diameter == math.inf or diameter > best[0] * equal:
        return
    best[0] = min(best[0], diameter)
    x, y, z = a[0] - before[0, 0], a[1] - before[0, 1], a[2] - before[0, 2]
    moved = math.sqrt(x * x + y * y + z * z)
    x, y, z = b[0] - before[1, 0], b[1] - before[1, 1], b[2] - before[1, 2]
    moved += math.sqrt(x * x + y * y + z * z)
    # What was taken may have been equal to a ball that is no longer the smallest.
    if best[1] > best[0] * equal or moved < best[2]:
        best[1], best[2] = diameter, moved
        for axis in range(3):
            out_ends[0, axis], out_ends[1, axis] = a[axis], b[axis]


@kernel
def try_corners(
    vertices, faces, others, foot, corner, first, second, before, limits, best, out_ends
):
    """Offer each vertex of the other patch with the place of each face that is nearest to it.

    `foot` and `corner` are room for these two; `first` and `second` the same in their order.
    """
    for v in range(len(others)):
        for part in range(6):
            corner[part] = others[v, part]
        for f in range(len(faces)):
            a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
            s, t, _ = nearest_place(corner[0], corner[1], corner[2], a, b, c)
            for part in range(6):
                foot[part] = (1.0 - s - t) * a[part] + s * b[part] + t * c[part]
            _offer(first, second, before, limits, best, out_ends)


@kernel
def try_edges(vertices, edges, others, other_edges, p, q, before, limits, best, out_ends):
    """Offer the closest places of each pair of edges, where they lie within both."""
    for i in range(len(edges)):
        a, b = vertices[edges[i, 0]], vertices[edges[i, 1]]
        for j in range(len(other_edges)):
            c, d = others[other_edges[j, 0]], others[other_edges[j, 1]]
            uu, uv, vv, uw, vw = 0.0, 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                u, v, w = b[axis] - a[axis], d[axis] - c[axis], a[axis] - c[axis]
                uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
                uw, vw = uw + u * w, vw + v * w
            bottom = uu * vv - uv * uv
            if not bottom > PARALLEL * uu * vv:
                continue
            s, t = (uv * vw - vv * uw) / bottom, (uu * vw - uv * uw) / bottom
            if s < 0.0 or s > 1.0 or t < 0.0 or t > 1.0:
                continue
            for part in range(6):
                p[part] = (1.0 - s) * a[part] + s * b[part]
                q[part] = (1.0 - t) * c[part] + t * d[part]
            _offer(p, q, before, limits, best, out_ends)
