"""Kernel of how often a surface is wound round a place (enclosure.py)."""

from __future__ import annotations

from medialis._kernels.jit import kernel


@kernel
def _straddles(a, b, c):
    return not ((a > 0.0 and b > 0.0 and c > 0.0) or (a < 0.0 and b < 0.0 and c < 0.0))


@kernel
def _cross(corners, axis, out_counts):
    """Count a face for the two rays from the origin along an axis, where it meets one of them."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    a = corners[1, u] * corners[2, v] - corners[1, v] * corners[2, u]
    b = corners[2, u] * corners[0, v] - corners[2, v] * corners[0, u]
    c = corners[0, u] * corners[1, v] - corners[0, v] * corners[1, u]
    facing = 1 if a > 0.0 else -1
    if not (facing * a > 0.0 and facing * b > 0.0 and facing * c > 0.0):
        return
    height = a * corners[0, axis] + b * corners[1, axis] + c * corners[2, axis]
    if height / (a + b + c) > 0.0:
        out_counts[2 * axis] += facing
    else:
        out_counts[2 * axis + 1] -= facing


@kernel
def count_crossings(points, faces, place, corners, out_counts):
    """Faces that the six rays from a place along the axes leave through, less those they enter.

    `corners` (3, 3) is room.
    """
    for f in range(len(faces)):
        met = 0
        for axis in range(3):
            for j in range(3):
                corners[j, axis] = points[faces[f, j], axis] - place[axis]
            if _straddles(corners[0, axis], corners[1, axis], corners[2, axis]):
                met += 1 << axis
        for axis in range(3):
            if met | (1 << axis) == 7:
                _cross(corners, axis, out_counts)
