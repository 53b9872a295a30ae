"""Borders between labels on a surface, as curves (thesis 6.3).

Where vertices have labels, a border crosses the edges between two of them. Each crossing moves
along its edge to where the curve is as short as it can be within these triangles; curves that meet
in a triangle of three labels meet in a point of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.model.surface import Surface
from medialis.validation import FloatArray, IntArray, frozen

STEPS = 100
"""Rounds in which crossings move towards the middle of their neighbours: they move along one edge
only, so that more change nothing that can be seen."""


def vertex_borders(surface: Surface, labels: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the borders between labels of vertices: points (p, 3) and edges (e, 2) of curves."""
    assert surface.faces is not None
    corners = labels[surface.faces]
    following = np.roll(corners, -1, axis=1)
    crossed = (corners != following) & (corners >= 0) & (following >= 0)
    kinds = crossed.sum(axis=1)
    sides = np.flatnonzero(crossed & (kinds >= 2)[:, None])
    start, end = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    ends = np.sort(np.stack([start[sides], end[sides]], axis=1), axis=1)
    cut, point = np.unique(ends, axis=0, return_inverse=True)
    point, face = point.reshape(-1), sides // 3
    two = kinds[face] == 2
    pairs = point[two].reshape(-1, 2)
    middle, place = np.unique(face[~two], return_inverse=True)
    spokes = np.stack([point[~two], len(cut) + place], axis=1)
    edges = np.concatenate([pairs, spokes])
    points = _shortened(surface.points[cut], edges, len(middle))
    return frozen(points, np.float64), frozen(edges, np.int32)


def _shortened(cut: FloatArray, edges: NDArray[np.int64], junctions: int) -> FloatArray:
    """Move crossings along their edges (c, 2, 3), and junctions, to shorten the curves."""
    count = len(cut) + junctions
    ends, other = np.concatenate([edges, edges[:, ::-1]]).T
    degree = np.maximum(np.bincount(ends, minlength=count), 1)[:, None]
    low, along = cut[:, 0], cut[:, 1] - cut[:, 0]
    size = np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)

    def middles(points: FloatArray) -> FloatArray:
        sums = [np.bincount(ends, points[other, axis], minlength=count) for axis in range(3)]
        return np.asarray(np.stack(sums, axis=1) / degree)

    points = np.concatenate([cut.mean(axis=1), np.zeros((junctions, 3))])
    points[len(cut) :] = middles(points)[len(cut) :]
    for _ in range(STEPS):
        wanted = (points + middles(points)) / 2
        share = np.einsum("ij,ij->i", wanted[: len(cut)] - low, along) / size
        points = np.concatenate([low + np.clip(share, 0, 1)[:, None] * along, wanted[len(cut) :]])
    return points


def face_borders(surface: Surface, labels: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the borders between labels of faces: edges of the mesh."""
    assert surface.faces is not None
    first, second, _ = surface.edge_table.pairs
    a, b = labels[first // 3], labels[second // 3]
    sides = first[(a != b) & (a >= 0) & (b >= 0)]
    start, end = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    used, edges = np.unique(np.stack([start[sides], end[sides]], axis=1), return_inverse=True)
    return surface.points[used], frozen(edges.reshape(-1, 2), np.int32)
