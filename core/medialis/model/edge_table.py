"""EdgeTable: half-edges grouped by the edge they lie on; the one place that sorts them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.validation import IntArray

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Half-edges grouped by the undirected edge they lie on.

    Half-edge h = 3 f + j runs from corner j of face f to the next corner. The edges are in
    ascending order of their vertices; one of them joins a vertex with itself where a face names a
    vertex twice.

    Attributes
    ----------
    order : (3m,) int32
        Half-edges, edge after edge, ascending within an edge.
    first : (e + 1,) int32
        Where the half-edges of each edge start in `order`.
    ends : (e, 2) int32
        Lower and higher vertex of each edge.
    forward : (3m,) bool
        Whether a half-edge runs from its lower to its higher vertex.
    """

    order: IntArray
    first: IntArray
    ends: IntArray
    forward: Mask

    @classmethod
    def of(cls, faces: IntArray, n: int) -> EdgeTable:
        """Group the half-edges of faces (m, 3) over n vertices."""
        start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
        key = np.minimum(start, end).astype(np.int64) * n + np.maximum(start, end)
        bits = len(key).bit_length()
        if (n * n) << bits < 2**63:
            # Sorting (key, half-edge) in one integer is 2 times faster than argsort, and stable.
            packed = np.sort((key << bits) | np.arange(len(key)))
            order = (packed & ((1 << bits) - 1)).astype(np.int32)
            key = np.right_shift(packed, bits, out=packed)
        else:
            order = np.argsort(key, kind="stable").astype(np.int32)
            key = key[order]
        first = np.flatnonzero(np.diff(key, prepend=-1))
        ends = np.stack(divmod(key[first], n), axis=1).astype(np.int32)
        return cls(order, np.append(first, len(key)).astype(np.int32), ends, start < end)

    @property
    def low(self) -> IntArray:
        """Lower vertex of each edge, (e,)."""
        return self.ends[:, 0]

    @property
    def high(self) -> IntArray:
        """Higher vertex of each edge, (e,)."""
        return self.ends[:, 1]

    @cached_property
    def counts(self) -> IntArray:
        """Number of half-edges on each edge, (e,)."""
        return np.diff(self.first)

    @property
    def edge_of(self) -> Index:
        """Row of the edge that each half-edge lies on, (3m,)."""
        result = np.empty(len(self.order), np.int64)
        result[self.order] = np.repeat(np.arange(len(self.low)), self.counts)
        return result

    @cached_property
    def pairs(self) -> tuple[IntArray, IntArray, Mask]:
        """Both half-edges of each edge with exactly two, and whether they run opposite ways."""
        both = self.first[:-1][self.counts == 2]
        a, b = self.order[both], self.order[both + 1]
        return a, b, self.forward[a] != self.forward[b]

    @property
    def single(self) -> IntArray:
        """The half-edges of boundary edges."""
        return self.order[self.first[:-1][self.counts == 1]]
