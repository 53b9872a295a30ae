"""Normal equations of a fit, by the balls and edges of a complex, and their solution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.validation import FloatArray

Index = NDArray[np.int64]

EVEN = 10.0
"""Share of the mean diagonal in the damping: balls that few samples tell about hold still."""

SIDES = ((0, 1), (0, 2), (1, 2))

ON_DIAGONAL = (0, 4, 7, 9)
"""Where the diagonal is among the ten numbers of a symmetric block."""


class Equations:
    """Symmetric equations whose blocks belong to the vertices and edges of a complex.

    Which blocks of the factor there are, and the order of the vertices that makes them few, is the
    same for all values.

    Attributes
    ----------
    row_edges : (s, 3) int64
        The edges of each primitive, -1 for none.
    """

    def __init__(self, count: int, edges: Index, rows: Index) -> None:
        self.row_edges = _edges_of(rows, edges, count)
        self.diagonal, self.blocks = np.zeros((count, 10)), np.zeros((len(edges), 10))
        self.gradient = np.zeros((count, 4))
        self._place, self._starts, self._rows = _factor_of(count, edges)
        self._order = np.argsort(self._place)
        ends = np.sort(self._place[edges], axis=1)
        columns = np.repeat(np.arange(count), np.diff(self._starts))
        self._slots = np.searchsorted(columns * count + self._rows, ends @ [count, 1])

    def cleared(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the sums, all zero."""
        for array in (self.diagonal, self.blocks, self.gradient):
            array[:] = 0.0
        return self.diagonal, self.blocks, self.gradient

    def solve(self, damping: float) -> FloatArray:
        """Return the step (n, 4) of the damped equations."""
        from medialis.medial_meshes._equation_kernels import solve

        damped, step = self.diagonal[self._order], self.gradient[self._order]
        main = damped[:, ON_DIAGONAL]
        damped[:, ON_DIAGONAL] += damping * (main + EVEN * main.mean()) + 1e-6 * main.max()
        factors = np.empty((len(self._rows), 4, 4))
        solve(damped, self.blocks, self._slots, self._starts, self._rows, step, factors)
        return np.asarray(step[self._place])


def _factor_of(count: int, edges: Index) -> tuple[Index, Index, Index]:
    """Return the places of vertices in the factor, and its columns: where they start, their rows.

    Those are read off the factor of the Laplacian with a little on its diagonal, whose entries
    neither cancel nor get too small.
    """
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    vertices = np.arange(count)
    i, j = (np.concatenate([vertices, edges[:, k], edges[:, 1 - k]]) for k in (0, 1))
    degrees = np.bincount(edges.ravel(), minlength=count) + 1.0 / count
    values = np.concatenate([degrees, np.full(2 * len(edges), -1.0)])
    found = splu(
        csc_array((values, (i, j)), shape=(count, count)), permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0, options={"SymmetricMode": True},
    )  # fmt: skip
    lower = found.L
    lower.sort_indices()
    place, starts, rows = found.perm_c, lower.indptr, lower.indices
    return place.astype(np.int64), starts.astype(np.int64), rows.astype(np.int64)


def _edges_of(rows: Index, edges: Index, count: int) -> Index:
    """Return the edges (s, 3) between the vertices 01, 02, 12 of primitives; -1 for none."""
    keys = np.sort(edges, axis=1) @ [count, 1]
    order = np.argsort(keys, kind="stable")
    result = np.full((len(rows), 3), -1)
    for column, (a, b) in enumerate(SIDES):
        has = rows[:, b] >= 0
        pair = np.sort(rows[has][:, [a, b]], axis=1) @ [count, 1]
        result[has, column] = order[np.searchsorted(keys[order], pair)]
    return result
