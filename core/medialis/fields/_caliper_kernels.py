"""Kernel of calipers (calipers.py): the smallest ball between two patches of faces."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis._kernels.nearest_kernels import nearest_place

PARALLEL = 1e-12  # part of the product of squared lengths: edges without a closest place


@kernel
def _measure(a, b, across, touching):
    """Diameter of the ball between two places with normals (2, 3); inf where they do not face."""
    dx, dy, dz = a[0, 0] - b[0, 0], a[0, 1] - b[0, 1], a[0, 2] - b[0, 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length <= touching:
        return 0.0
    size_a = math.sqrt(a[1, 0] ** 2 + a[1, 1] ** 2 + a[1, 2] ** 2)
    size_b = math.sqrt(b[1, 0] ** 2 + b[1, 1] ** 2 + b[1, 2] ** 2)
    along = (a[1, 0] * dx + a[1, 1] * dy + a[1, 2] * dz) / max(size_a, 1e-300)
    back = -(b[1, 0] * dx + b[1, 1] * dy + b[1, 2] * dz) / max(size_b, 1e-300)
    lean = min(along, back)  # a length times a cosine
    if lean < across * length or lean <= 0.0:
        return math.inf
    return length * length / lean


@kernel
def _is_better(a, b, before, diameter, equal, best):
    """Tell whether a ball is smaller, or equal and nearer to the places before; note it in `best`.

    `best` is the smallest diameter, that of the ball that is taken, and how far that one is off.
    """
    if diameter == math.inf or not diameter <= best[0] * (1.0 + equal):
        return False
    best[0] = min(best[0], diameter)
    moved = 0.0
    for side in range(2):
        place = a if side == 0 else b
        x, y, z = (
            place[0, 0] - before[side, 0],
            place[0, 1] - before[side, 1],
            place[0, 2] - before[side, 2],
        )
        moved += math.sqrt(x * x + y * y + z * z)
    # What was taken may have been equal to a ball that is no longer the smallest.
    if best[1] <= best[0] * (1.0 + equal) and moved >= best[2]:
        return False
    best[1], best[2] = diameter, moved
    return True


@kernel
def _interpolate(vertices, face, s, t, out):
    for part in range(2):
        for axis in range(3):
            x = vertices[face[0], part, axis]
            y, z = vertices[face[1], part, axis], vertices[face[2], part, axis]
            out[part, axis] = (1.0 - s - t) * x + s * y + t * z


@kernel
def _try_corners(vertices, faces, others, turned, before, limits, best, foot, out):
    """Each vertex of the other side with the place of each face nearest to it."""
    across, touching, equal = limits
    for v in range(len(others)):
        x, y, z = others[v, 0, 0], others[v, 0, 1], others[v, 0, 2]
        for f in range(len(faces)):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            s, t, _ = nearest_place(x, y, z, vertices[a, 0], vertices[b, 0], vertices[c, 0])
            _interpolate(vertices, faces[f], s, t, foot)
            one, other = (others[v], foot) if turned else (foot, others[v])
            diameter = _measure(one, other, across, touching)
            if _is_better(one, other, before, diameter, equal, best):
                out[0], out[1] = one[0], other[0]


@kernel
def find_thinnest(
    vertices, faces, edges, other_vertices, other_faces, other_edges,
    before, across, touching, equal, out_ends,
):  # fmt: skip
    """Places of two patches with the smallest ball between them; return its diameter.

    A patch has vertices (v, 2, 3), places and normals, faces (f, 3) and edges (e, 2). Two triangles
    are closest at a corner of one of them, or on an edge of each. Of balls that are equal, up to
    `equal`, the one nearest to the places before is taken.
    """
    best = np.full(3, np.inf)
    limits = (across, touching, equal)
    p, q = np.empty((2, 3)), np.empty((2, 3))
    _try_corners(vertices, faces, other_vertices, False, before, limits, best, p, out_ends)
    _try_corners(other_vertices, other_faces, vertices, True, before, limits, best, p, out_ends)
    for i in range(len(edges)):
        a, b = vertices[edges[i, 0]], vertices[edges[i, 1]]
        for j in range(len(other_edges)):
            c, d = other_vertices[other_edges[j, 0]], other_vertices[other_edges[j, 1]]
            uu, uv, vv, uw, vw = 0.0, 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                u, v = b[0, axis] - a[0, axis], d[0, axis] - c[0, axis]
                w = a[0, axis] - c[0, axis]
                uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
                uw, vw = uw + u * w, vw + v * w
            bottom = uu * vv - uv * uv
            if not bottom > PARALLEL * uu * vv:
                continue
            s, t = (uv * vw - vv * uw) / bottom, (uu * vw - uv * uw) / bottom
            if s < 0.0 or s > 1.0 or t < 0.0 or t > 1.0:
                continue
            for part in range(2):
                for axis in range(3):
                    p[part, axis] = (1.0 - s) * a[part, axis] + s * b[part, axis]
                    q[part, axis] = (1.0 - t) * c[part, axis] + t * d[part, axis]
            diameter = _measure(p, q, across, touching)
            if _is_better(p, q, before, diameter, equal, best):
                out_ends[0], out_ends[1] = p[0], q[0]
    return best[1]
