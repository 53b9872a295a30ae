"""Topology: what follows from the faces of a mesh alone, whatever their points."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.edge_table import EdgeTable
from medialis.model.equal_rows import first_equal_row
from medialis.model.ragged import Ragged
from medialis.validation import IntArray, frozen


class Topology:
    """How triangles hang together; each quantity is computed when it is first asked for, once.

    Half-edge 3 f + j is side j of face f, from its corner j to the next one.

    Parameters
    ----------
    faces : (m, 3) int32
        May be empty.
    point_count : int
    """

    def __init__(self, faces: IntArray, point_count: int) -> None:
        self.faces = faces
        self.point_count = point_count

    @cached_property
    def edge_table(self) -> EdgeTable:
        """The half-edges of each edge, sorted once for all that needs them."""
        return EdgeTable.of(self.faces, self.point_count)

    @cached_property
    def edges(self) -> IntArray:
        """Undirected edges (e, 2), see `Surface.edges`."""
        edges = self.edge_table.ends
        loops = edges[:, 0] == edges[:, 1]
        return frozen(edges[~loops] if loops.any() else edges, np.int32)

    @cached_property
    def edge_twins(self) -> IntArray:
        """The same edge in the neighbouring face, (3m,), see `Surface.edge_twins`."""
        a, b, _ = self.edge_table.pairs
        apart = a // 3 != b // 3
        result = np.full(3 * len(self.faces), -1, np.int32)
        result[a[apart]], result[b[apart]] = b[apart], a[apart]
        return frozen(result, np.int32)

    @cached_property
    def fans(self) -> Ragged:
        """For each point the half-edges that leave it, ascending: one for each face there."""
        return Ragged.group(self.faces.ravel(), self.point_count)

    @cached_property
    def components(self) -> IntArray:
        """Connected component of each point, (n,), numbered by their lowest vertex."""
        return piece_labels(self.point_count, self.edges)

    @cached_property
    def part_count(self) -> int:
        """Number of components that have faces."""
        return int(np.count_nonzero(np.bincount(self.components[self.faces[:, 0]])))

    @cached_property
    def face_pieces(self) -> IntArray:
        """Piece of each face, (m,), see `Surface.face_pieces`."""
        from medialis.model._surface_kernels import label_face_pieces

        a, b, _ = self.edge_table.pairs
        label = np.empty(len(self.faces), np.int32)
        label_face_pieces(a, b, np.arange(len(label), dtype=np.int32), label)
        return frozen(label, np.int32)

    def corner_fans(self) -> IntArray:
        """Fan of each corner, (3m,): corners of one vertex joined across edges of two faces."""
        from medialis.model._surface_kernels import label_corner_fans

        label = np.empty(3 * len(self.faces), np.int32)
        label_corner_fans(*self.edge_table.pairs, np.arange(len(label), dtype=np.int32), label)
        return frozen(label, np.int32)

    @cached_property
    def first_equal_face(self) -> NDArray[np.int64]:
        """The first face with the same three corners in any order, (m,); mostly the face itself."""
        # Three at a time: numpy goes along the short axis one by one.
        a, b, c = (self.faces[:, j].astype(np.int64) for j in range(3))
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        middle = a + b + c - low - high
        return first_equal_row(np.stack([low, middle, high], axis=1))


def piece_labels(count: int, links: NDArray[Any]) -> IntArray:
    """Return the connected piece of each of `count` nodes, numbered by their lowest node.

    Parameters
    ----------
    count : int
    links : (e, 2) int
        Pairs of nodes in any order.

    Examples
    --------
    >>> piece_labels(5, np.array([[0, 3], [1, 4]])).tolist()
    [0, 1, 2, 0, 1]
    """
    from medialis._kernels.union_find_kernels import label_pieces

    pairs = np.ascontiguousarray(np.asarray(links).reshape(-1, 2), np.int64)
    label = np.empty(count, np.int32)
    label_pieces(pairs, np.arange(count, dtype=np.int32), label)
    return frozen(label, np.int32)
