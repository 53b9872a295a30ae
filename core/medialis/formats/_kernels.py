"""Kernel that cuts one polygon into triangles, ear by ear (see meshes.py)."""

from __future__ import annotations

import numpy as np

from medialis.base.jit import kernel


@kernel
def _turn(ring, a, b, c):
    """Twice the signed area of the triangle of three corners."""
    ux, uy = ring[b, 0] - ring[a, 0], ring[b, 1] - ring[a, 1]
    vx, vy = ring[c, 0] - ring[a, 0], ring[c, 1] - ring[a, 1]
    return ux * vy - uy * vx


@kernel
def _same(ring, a, b):
    return ring[a, 0] == ring[b, 0] and ring[a, 1] == ring[b, 1]


@kernel
def _blocker(ring, following, before, ear):
    """Corner that lies in the triangle of an ear and at none of its corners; -1 without one."""
    a, c = before[ear], following[ear]
    k = following[c]
    while k != a:
        if (
            _turn(ring, a, ear, k) >= 0.0
            and _turn(ring, ear, c, k) >= 0.0
            and _turn(ring, c, a, k) >= 0.0
            and not (_same(ring, k, a) or _same(ring, k, ear) or _same(ring, k, c))
        ):
            return k
        k = following[k]
    return -1


@kernel
def _fatness(ring, a, b, c):
    """Area of a triangle over the square of its longest side but one, the base of the ear."""
    dx, dy = ring[c, 0] - ring[a, 0], ring[c, 1] - ring[a, 1]
    return _turn(ring, a, b, c) / max(dx * dx + dy * dy, 1e-300)


@kernel
def clip_ears(ring, out_triangles):
    """Cut off the fattest ear again and again; always ends, also where the polygon crosses itself.

    An ear that another corner lies in stays none until that corner has gone, so it is looked at
    again only then: O(corners) for a cut, besides the tests of new ears.
    """
    n = len(ring)
    following, before = np.empty(n, np.int64), np.empty(n, np.int64)
    fat, blocked = np.empty(n), np.full(n, -1, np.int64)
    for k in range(n):
        following[k], before[k] = (k + 1) % n, (k + n - 1) % n
    for k in range(n):
        fat[k] = _fatness(ring, before[k], k, following[k])
    gone = np.zeros(n, np.bool_)
    first = 0
    for step in range(n - 3):
        best = -1
        while True:
            best, k = -1, first
            for _ in range(n - step):
                free = blocked[k] < 0 or gone[blocked[k]]
                if free and fat[k] > 0.0 and (best < 0 or fat[k] > fat[best]):
                    best = k
                k = following[k]
            if best < 0:
                break
            blocked[best] = _blocker(ring, following, before, best)
            if blocked[best] < 0:
                break
        if best < 0:  # no ear: the corner with the largest area
            k, largest = first, -np.inf
            for _ in range(n - step):
                area = _turn(ring, before[k], k, following[k])
                if area > largest:
                    best, largest = k, area
                k = following[k]
        a, c = before[best], following[best]
        out_triangles[step, 0], out_triangles[step, 1], out_triangles[step, 2] = a, best, c
        gone[best] = True
        following[a], before[c] = c, a
        if best == first:
            first = c
        for k in (a, c):
            fat[k] = _fatness(ring, before[k], k, following[k])
            blocked[k] = -1
    out_triangles[n - 3, 0] = first
    out_triangles[n - 3, 1] = following[first]
    out_triangles[n - 3, 2] = following[following[first]]
