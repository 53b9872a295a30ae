"""Kernels of the sampling of limbs: rays through a shape, as thick and as wide as it is there."""

from __future__ import annotations

import math

import numpy as np

from medialis.base._box_tree_kernels import FAN
from medialis.base.jit import kernel

LEAST = 1e-9
"""Share of the size of the shape below which a ray hits what it starts from."""


@kernel
def _entries(bound, place, way, reach, out):
    """How far along a ray it enters the boxes of eight children, inf where not before so far."""
    x, y, z = place[0], place[1], place[2]
    u, v, w = way[3], way[4], way[5]
    for j in range(FAN):
        ax, bx = (bound[0, j] - x) * u, (bound[3, j] - x) * u
        ay, by = (bound[1, j] - y) * v, (bound[4, j] - y) * v
        az, bz = (bound[2, j] - z) * w, (bound[5, j] - z) * w
        # Conditional expressions, not max(): max() treats NaN apart and is not vectorised.
        first, last = ax if ax < bx else bx, bx if ax < bx else ax
        low, high = ay if ay < by else by, by if ay < by else ay
        first, last = first if first > low else low, last if last < high else high
        low, high = az if az < bz else bz, bz if az < bz else az
        first, last = first if first > low else low, last if last < high else high
        first, last = first if first > 0.0 else 0.0, last if last < reach else reach
        # Boxes are of single precision.
        meets = (first <= last + 1e-6 * (first + abs(last))) & (bound[0, j] < math.inf)
        out[j] = first if meets else math.inf


@kernel
def _hit(place, way, corner, least):
    """Length of a ray up to a triangle, inf where it misses; its sides belong to it.

    It asks once, at the end: which question a triangle fails cannot be foreseen, and a wrong guess
    of the processor costs more than all of them.
    """
    e1x, e1y, e1z = (
        corner[1, 0] - corner[0, 0],
        corner[1, 1] - corner[0, 1],
        corner[1, 2] - corner[0, 2],
    )
    e2x, e2y, e2z = (
        corner[2, 0] - corner[0, 0],
        corner[2, 1] - corner[0, 1],
        corner[2, 2] - corner[0, 2],
    )
    px, py, pz = (
        way[1] * e2z - way[2] * e2y,
        way[2] * e2x - way[0] * e2z,
        way[0] * e2y - way[1] * e2x,
    )
    det = e1x * px + e1y * py + e1z * pz
    some = det if det != 0.0 else 1.0
    sx, sy, sz = place[0] - corner[0, 0], place[1] - corner[0, 1], place[2] - corner[0, 2]
    u = (sx * px + sy * py + sz * pz) / some
    qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    v = (way[0] * qx + way[1] * qy + way[2] * qz) / some
    length = (e2x * qx + e2y * qy + e2z * qz) / some
    beside = (u < -1e-9) | (v < -1e-9) | (u + v > 1.0 + 1e-9)
    return length if (det != 0.0) & (length > least) & (not beside) else math.inf


@kernel
def first_hit(place, way, tree, corners, stack, box, least, reach):
    """Length of a ray up to the first triangle that it hits; inf for none nearer than `reach`.

    `place` is relative to the center of the tree, whose boxes hold whole triangles. Behind the
    `way` is room for one over each of its parts.
    """
    bounds, child, depth, n = tree.bounds, tree.child, tree.depth, len(corners)
    for k in range(3):
        way[3 + k] = 1.0 / way[k] if way[k] != 0.0 else 1e300
    best, top = reach, 1
    stack[0] = 0
    while top > 0:
        top -= 1
        node = stack[top]
        base = child[node]
        _entries(bounds[node], place, way, best, box)
        for j in range(FAN):
            if box[j] == math.inf:
                continue
            if base >= 0:
                stack[top] = base + j
                top += 1
                continue
            leaf = ~base + j
            for k in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                best = min(best, _hit(place, way, corners[k], least))
    return best if best < reach else math.inf


@kernel
def measure_sections(begin, end, faces, tree, corners, wide, least, out_sections):
    """Measure how thick a shape is below places of its surface, and how wide across there.

    `faces` are rows of place, inward normal, three ways at right angles to it, and the thickness
    from which on it does not matter (m, 16); `out_sections` (m, 2) receives the length of the ray
    inwards and the least length of a line across its middle: along one of the ways, or at right
    angles to it; inf where one of them is longer than it matters, which for the line across is
    `wide` times the thickness. Rays begin `least` above what they start from.
    """
    stack, box = np.empty(8 * 12 + 8, np.int64), np.empty(FAN)
    way, middle = np.empty(6), np.empty(3)
    for i in range(begin, end):
        place, normal = faces[i, :3], faces[i, 3:6]
        for k in range(3):
            way[k] = normal[k]
        thick = first_hit(place, way, tree, corners, stack, box, least, faces[i, 15])
        out_sections[i, 0], out_sections[i, 1] = thick, math.inf
        if thick == math.inf:
            continue
        for k in range(3):
            middle[k] = place[k] + thick / 2.0 * normal[k]
        width = wide * thick
        for turn in range(6):
            along = faces[i, 6 + 3 * (turn // 2) : 9 + 3 * (turn // 2)]
            for k in range(3):
                a, b = (k + 1) % 3, (k + 2) % 3
                way[k] = along[k] if turn % 2 else normal[a] * along[b] - normal[b] * along[a]
            across = first_hit(middle, way, tree, corners, stack, box, least, width)
            if across < width:
                for k in range(3):
                    way[k] = -way[k]
                across += first_hit(middle, way, tree, corners, stack, box, least, width - across)
                if across < width:
                    width = out_sections[i, 1] = across
