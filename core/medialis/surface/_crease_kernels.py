"""Kernels over the edges and corners of a mesh that may bend (see creases.py)."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def _first_of(corners, least):
    """Where the first corner from `least` on stands in the ascending `corners`."""
    low, high = 0, len(corners)
    while low < high:
        middle = (low + high) // 2
        if corners[middle] < least:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def bulge_faces(
    begin, end, points, faces, normals, units, corners, sector, beside, smoothness,
    out_bulges, out_cosines,
):  # fmt: skip
    """Bulges over the sides of the faces begin..end, and their least cosine (`Creases`).

    `normals` are those of the vertices, `units` those of the faces. At the corners 3 f + j that
    `corners` lists, the normal is that of their sector, in `beside`, and the cosine the
    `smoothness` of the vertex.
    """
    n = np.empty((3, 3))
    at = _first_of(corners, 3 * begin)
    for f in range(begin, end):
        flat = units[f, 0] == 0.0 and units[f, 1] == 0.0 and units[f, 2] == 0.0
        out_cosines[f] = 0.0 if flat else 1.0
        for j in range(3):
            v = faces[f, j]
            cosine = 0.0
            for axis in range(3):
                n[j, axis] = normals[v, axis]
                cosine += n[j, axis] * units[f, axis]
            if n[j, 0] == 0.0 and n[j, 1] == 0.0 and n[j, 2] == 0.0:
                cosine = 1.0
            if at < len(corners) and corners[at] == 3 * f + j:
                cosine = smoothness[v]
                for axis in range(3):
                    n[j, axis] = beside[sector[at], axis]
                at += 1
            out_cosines[f] = max(min(cosine, out_cosines[f]), 0.0)
        for j in range(3):
            k = j + 1 if j < 2 else 0
            u, v = faces[f, j], faces[f, k]
            one, other = 0.0, 0.0
            for axis in range(3):
                side = points[v, axis] - points[u, axis]
                one -= n[j, axis] * side
                other += n[k, axis] * side
            out_bulges[f, j] = 2.0 * one * other / (one + other) if one * other > 0.0 else 0.0
