"""From many balls to few: the collapse of a complex."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.medial_meshes.sampling import Samples
from medialis.model.medial_mesh import Collapse, Complex
from medialis.validation import FloatArray

HOLD = 1e-3
"""Weight of staying in place against the planes of the surface, which alone leave slack."""

LARGEST = 0.5
"""No merged ball is larger, in diagonals."""


def planes_of(samples: Samples, balls: FloatArray, owner: NDArray[np.int64]) -> FloatArray:
    """Return the quadric of each ball: the planes of the candidates that belong to it, (v, 15)."""
    from medialis.medial_meshes._collapse_kernels import add_places, add_planes

    quadrics = np.zeros((len(balls), 15))
    add_planes(samples.points, samples.normals, samples.areas, owner, quadrics)
    weights = np.bincount(owner, samples.areas, len(balls))
    add_places(balls, HOLD * (weights + 1e-9 * weights.sum()), quadrics)
    return quadrics


def collapse(start: Complex, quadrics: FloatArray, target: int) -> Collapse:
    """Merge vertices, the cheapest pair first, until `target` are left or none may be merged."""
    from medialis.medial_meshes._collapse_kernels import collapse as run
    from medialis.medial_meshes._collapse_kernels import link_all

    count = len(start)
    edges, faces = start.edges.copy(), start.faces.copy()
    lists = []
    for rows in (edges, faces):
        heads = np.empty(count, np.int64)
        after, before = np.empty(rows.size, np.int64), np.empty(rows.size, np.int64)
        link_all(rows, heads, after, before)
        lists.append((rows, np.ones(len(rows), bool), heads, after, before))
    room = 12 * len(edges) + 16384
    removed, into = np.empty(count, np.int64), np.empty(count, np.int64)
    after_balls = np.empty((count, 4))
    steps = run(
        start.balls.copy(), quadrics.copy(), *lists, np.zeros(len(edges), np.int64), target,
        LARGEST, np.empty(room), np.empty(room, np.int64), np.empty(2 * len(edges) + 1, np.int64),
        removed, into, after_balls,
    )  # fmt: skip
    return Collapse(start, removed[:steps].copy(), into[:steps].copy(), after_balls[:steps].copy())
