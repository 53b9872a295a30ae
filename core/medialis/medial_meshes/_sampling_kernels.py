"""Normals of corners, and samples no nearer to each other than their spacing."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def corner_normals(vectors, starts, corners, cosine, out):
    """Find the normal at each corner, (m, 3, 3): of the faces there that bend little from its own.

    `vectors` (m, 3) are normals times areas; `corners` lists the corners 3 f + j of each vertex.
    """
    for vertex in range(len(starts) - 1):
        for i in range(starts[vertex], starts[vertex + 1]):
            own = vectors[corners[i] // 3]
            length = np.sqrt(own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
            x, y, z = 0.0, 0.0, 0.0
            for j in range(starts[vertex], starts[vertex + 1]):
                other = vectors[corners[j] // 3]
                size = np.sqrt(other[0] * other[0] + other[1] * other[1] + other[2] * other[2])
                along = own[0] * other[0] + own[1] * other[1] + own[2] * other[2]
                if along >= cosine * length * size:
                    x, y, z = x + other[0], y + other[1], z + other[2]
            size = max(np.sqrt(x * x + y * y + z * z), 1e-300)
            row = out[corners[i] // 3, corners[i] % 3]
            row[0], row[1], row[2] = x / size, y / size, z / size


@kernel
def _cell_of(cell, level, mask):
    """Slot of a grid cell (3,) of a level in the hash table."""
    return (
        (cell[0] * 73856093) ^ (cell[1] * 19349663) ^ (cell[2] * 83492791) ^ (level * 2654435761)
    ) & mask


@kernel
def _conflict(i, points, normals, spacing, smallest, heads, following, levels, cell):
    """Return a kept sample that faces the same way and is too near to sample i; -1 for none.

    Samples of spacing s lie in the grid of level log2(s / smallest), whose cells are 1 to 2 s wide.
    """
    mask = len(heads) - 1
    for level in range(levels):
        width = smallest * 2.0 ** (level + 1)
        x, y, z = (
            int(points[i, 0] // width),
            int(points[i, 1] // width),
            int(points[i, 2] // width),
        )
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    cell[0], cell[1], cell[2] = x + dx, y + dy, z + dz
                    j = heads[_cell_of(cell, level, mask)]
                    while j >= 0:
                        near = min(spacing[i], spacing[j])
                        a = points[i, 0] - points[j, 0]
                        b = points[i, 1] - points[j, 1]
                        c = points[i, 2] - points[j, 2]
                        if a * a + b * b + c * c < near * near:
                            same = (
                                normals[i, 0] * normals[j, 0]
                                + normals[i, 1] * normals[j, 1]
                                + normals[i, 2] * normals[j, 2]
                            )
                            if same > -0.3:
                                return j
                        j = following[j]
    return -1


@kernel
def _keep(i, points, spacing, smallest, heads, following, levels, cell):
    """Enter a sample into the grid of its level."""
    level = min(levels - 1, int(np.floor(np.log2(spacing[i] / smallest))))
    width = smallest * 2.0 ** (level + 1)
    for d in range(3):
        cell[d] = int(points[i, d] // width)
    slot = _cell_of(cell, level, len(heads) - 1)
    following[i] = heads[slot]
    heads[slot] = i


@kernel
def thin_out(points, normals, spacing, mirror, order, heads, following, out_owner):
    """Keep samples in this order where none is too near; sample and mirror are kept together.

    `mirror` (n,) is the sample on the other side of a thin wall, -1 for none. out_owner (n,): the
    sample itself where kept, else a kept one near it, else -1.
    """
    smallest = spacing.min()
    levels = int(np.floor(np.log2(spacing.max() / smallest))) + 1
    cell = np.empty(3, np.int64)
    for i in order:
        if out_owner[i] >= 0:
            continue
        near = _conflict(i, points, normals, spacing, smallest, heads, following, levels, cell)
        if near >= 0:
            out_owner[i] = near
            continue
        other = mirror[i]
        if other >= 0:
            near = _conflict(
                other, points, normals, spacing, smallest, heads, following, levels, cell
            )
            if near >= 0:
                out_owner[other] = near
                continue
            out_owner[other] = other
            _keep(other, points, spacing, smallest, heads, following, levels, cell)
        out_owner[i] = i
        _keep(i, points, spacing, smallest, heads, following, levels, cell)
