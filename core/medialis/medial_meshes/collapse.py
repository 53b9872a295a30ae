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
    lists = []
    for given in (start.edges, start.faces):
        rows = given.astype(np.int32)  # half as much memory is gone through in half the time
        heads, after, before = (np.empty(n, np.int32) for n in (count, rows.size, rows.size))
        link_all(rows, heads, after, before)
        lists.append((rows, np.ones(len(rows), bool), heads, after, before))
    room = 2 * len(start.edges) + 1
    removed, into = np.empty(count, np.int64), np.empty(count, np.int64)
    after_balls = np.empty((count, 4))
    steps = run(
        start.balls.copy(), quadrics.copy(), *lists, target, LARGEST, np.empty(room),
        np.empty(room, np.int32), np.empty(room, np.int32), removed, into, after_balls,
    )  # fmt: skip
    return Collapse(start, removed[:steps].copy(), into[:steps].copy(), after_balls[:steps].copy())
