"""Betti numbers of complexes of vertices, edges and triangles, over the field of two elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.model.topology import piece_labels

Index = NDArray[np.int64]


def betti_numbers(count: int, edges: Index, faces: Index) -> tuple[int, int, int]:
    """Return parts, independent loops and enclosed hollows of a complex.

    Parameters
    ----------
    count : int
        Vertices.
    edges : (e, 2) int
        All edges, also those of triangles, each once.
    faces : (f, 3) int
        Triangles, each once.
    """
    from medialis.model._betti_kernels import eliminate, free_faces

    parts = int(piece_labels(count, edges).max(initial=-1)) + 1
    rows = np.sort(np.asarray(faces, np.int64), axis=1)
    hollows = 0
    if len(rows):
        keys = rows[:, [0, 0, 1]] * count + rows[:, [1, 2, 2]]
        sides = np.unique(keys, return_inverse=True)[1].reshape(-1, 3)
        closed = np.ones(len(rows), bool)
        free_faces(sides, int(sides.max()) + 1, closed)
        if closed.any():
            hollows = eliminate(np.sort(sides[closed], axis=1), int(sides.max()) + 1)
    euler = count - len(edges) + len(faces)
    return parts, parts + hollows - euler, hollows
