"""Rays through triangles: how often a surface is wound round a place, and how thick it is there."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def _side(points, a, b, x, y):
    """+1 or -1: on which side of edge a b a place lies in the plane, the opposite for b a.

    The edge is always taken from its lower vertex on, and zero belongs to that side, so a ray
    through an edge or a vertex is counted once.
    """
    low, high, sign = (a, b, 1) if a < b else (b, a, -1)
    cross = (points[high, 0] - points[low, 0]) * (y - points[low, 1]) - (
        points[high, 1] - points[low, 1]
    ) * (x - points[low, 0])
    return sign if cross >= 0.0 else -sign


@kernel
def _height(points, a, b, c, x, y):
    """Height at which the upright line through (x, y) meets the plane of a triangle."""
    bx, by = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    cx, cy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    px, py = x - points[a, 0], y - points[a, 1]
    area = bx * cy - by * cx
    if area == 0.0:
        return points[a, 2]
    u, v = (px * cy - py * cx) / area, (bx * py - by * px) / area
    z = points[a, 2]
    return z + u * (points[b, 2] - z) + v * (points[c, 2] - z)


@kernel
def count_crossings(begin, end, places, points, faces, order, bounds, depth, out):
    """Faces that the rays up and down from each place leave through, less those entered through.

    out (q, 2): both are how often the surface is wound round the place, where it is closed.
    """
    n, leaves = len(faces), 1 << depth
    stack = np.empty(2 * depth + 2, np.int64)
    for q in range(begin, end):
        x, y, z = places[q, 0], places[q, 1], places[q, 2]
        up, down = 0, 0
        stack[0], size = 1, 1
        while size > 0:
            size -= 1
            node = stack[size]
            box = bounds[node]
            if x < box[0] or x > box[3] or y < box[1] or y > box[4]:
                continue
            if node < leaves:
                stack[size], stack[size + 1] = 2 * node, 2 * node + 1
                size += 2
                continue
            leaf = node - leaves
            for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                a, b, c = faces[order[i], 0], faces[order[i], 1], faces[order[i], 2]
                side = _side(points, a, b, x, y)
                if side != _side(points, b, c, x, y) or side != _side(points, c, a, x, y):
                    continue
                if _height(points, a, b, c, x, y) > z:
                    up += side
                else:
                    down -= side
        out[q, 0], out[q, 1] = up, down


@kernel
def _meets_box(box, origin, inverse, length):
    """Tell whether a ray meets a box before `length`."""
    near, far = 0.0, length
    for d in range(3):
        first = (box[d] - origin[d]) * inverse[d]
        second = (box[3 + d] - origin[d]) * inverse[d]
        if first > second:
            first, second = second, first
        near, far = max(near, first), min(far, second)
    return near <= far


@kernel
def _meet(points, a, b, c, origin, direction):
    """Length of a ray up to a triangle; infinite where they do not meet."""
    ex, ey, ez = (
        points[b, 0] - points[a, 0],
        points[b, 1] - points[a, 1],
        points[b, 2] - points[a, 2],
    )
    fx, fy, fz = (
        points[c, 0] - points[a, 0],
        points[c, 1] - points[a, 1],
        points[c, 2] - points[a, 2],
    )
    px = direction[1] * fz - direction[2] * fy
    py = direction[2] * fx - direction[0] * fz
    pz = direction[0] * fy - direction[1] * fx
    det = ex * px + ey * py + ez * pz
    if det == 0.0:
        return np.inf
    tx, ty, tz = origin[0] - points[a, 0], origin[1] - points[a, 1], origin[2] - points[a, 2]
    u = (tx * px + ty * py + tz * pz) / det
    qx, qy, qz = ty * ez - tz * ey, tz * ex - tx * ez, tx * ey - ty * ex
    v = (direction[0] * qx + direction[1] * qy + direction[2] * qz) / det
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return np.inf
    return (fx * qx + fy * qy + fz * qz) / det


@kernel
def ray_lengths(
    begin,
    end,
    origins,
    directions,
    skip,
    longest,
    points,
    faces,
    order,
    bounds,
    depth,
    out_length,
    out_face,
):
    """Length of each ray up to the first face, but `longest` (q,) at most, and that face or -1.

    `skip` (q,) is its own face; others are met from 1e-9 on, so that its neighbours do not count.
    """
    n, leaves = len(faces), 1 << depth
    stack = np.empty(2 * depth + 2, np.int64)
    inverse = np.empty(3)
    for q in range(begin, end):
        best, met, origin, direction = longest[q], -1, origins[q], directions[q]
        for d in range(3):
            inverse[d] = 1.0 / direction[d] if direction[d] != 0.0 else 1e300
        stack[0], size = 1, 1
        while size > 0:
            size -= 1
            node = stack[size]
            if not _meets_box(bounds[node], origin, inverse, best):
                continue
            if node < leaves:
                stack[size], stack[size + 1] = 2 * node, 2 * node + 1
                size += 2
                continue
            leaf = node - leaves
            for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                face = order[i]
                if face == skip[q]:
                    continue
                a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                length = _meet(points, a, b, c, origin, direction)
                if 1e-9 < length < best:
                    best, met = length, face
        out_length[q], out_face[q] = best, met
