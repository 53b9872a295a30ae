"""The inside of a solid as tetrahedra whose dual has a wanted topology, whatever its samples are.

From the deepest one on, inside tetrahedra join where the topology of the dual stays: one part
without loops or hollows, up to seams where it meets itself. The seams that close the longest loops
are then closed, as many as the solid has handles. What stays out are single tetrahedra at places
where samples are too few, mostly along sharp edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.topology import piece_labels
from medialis.validation import FloatArray

Index = NDArray[np.int64]

PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))

NEVER = 1 << 40
"""Tetrahedra that are missing round edges and samples on the hull."""


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """Delaunay tetrahedra.

    Attributes
    ----------
    corners, neighbours : (t, 4) int64
        Neighbour k is across from corner k, -1 for none.
    centers, radii : (t, 3), (t,) float64
    inside : (t,) bool
    """

    corners: Index
    neighbours: Index
    centers: FloatArray
    radii: FloatArray
    inside: NDArray[np.bool_]


def grown(cells: Tetrahedra, loops: int) -> NDArray[np.bool_]:
    """Return the tetrahedra (t,) of a dual of one part with this many loops and without hollows.

    There are fewer loops where no more can be closed. Cost: O(t log t), and a shortest way for each
    loop that could be closed.
    """
    from medialis.medial_meshes._growth_kernels import grow, join

    growth = _Growth(cells)
    depth = growth.tables[4]
    first = int(np.where(cells.inside, depth, -1.0).argmax())
    size = join(first, growth.tables, growth.state, growth.heap, 0)
    grow(growth.tables, growth.state, growth.heap, size, growth.waiting)
    for _ in range(loops):
        t = growth.longest()
        if t < 0:
            break
        size = join(t, growth.tables, growth.state, growth.heap, 0)
        grow(growth.tables, growth.state, growth.heap, size, growth.waiting)
    return growth.state[2]


class _Growth:
    """The set, and what its kernels need."""

    def __init__(self, cells: Tetrahedra) -> None:
        self.cells = cells
        corners, count = cells.corners, int(cells.corners.max()) + 1
        ends = np.sort(corners[:, PAIRS], axis=2)
        edges = np.unique((ends[..., 0] * count + ends[..., 1]).ravel(), return_inverse=True)[1]
        edges = edges.reshape(-1, 6).astype(np.int64)
        left, around = np.bincount(edges.ravel()), np.bincount(corners.ravel())
        rim, across = np.nonzero(cells.neighbours < 0)
        for slot, (a, b) in enumerate(PAIRS):
            left[edges[rim[(across != a) & (across != b)], slot]] = NEVER
        for k in range(4):
            around[corners[rim[across != k], k]] = NEVER
        depth = np.where(np.isfinite(cells.radii), cells.radii, 0.0)
        self.tables = (corners, cells.neighbours, edges, cells.inside, depth)
        self.state: tuple[Any, ...] = (left, around, np.zeros(len(corners), bool))
        room = 8 * len(corners) + 64  # each pushes its four neighbours once, and waits
        self.heap = (np.empty(room), np.empty(room, np.int64))
        self.waiting = np.empty(len(corners), np.int64)
        self._way = np.full(len(corners), np.inf)
        self._known: dict[int, float] = {}

    def longest(self) -> int:
        """Return the tetrahedron that closes the longest loop, -1 where none closes any.

        One of each seam is looked at, the deepest. Loops only get shorter as the set grows, so a
        length known before is an upper bound.
        """
        from medialis.medial_meshes._growth_kernels import closers

        inside, member = self.cells.inside, self.state[2]
        rest = np.flatnonzero(inside & ~member)
        ends = np.empty((len(rest), 2), np.int64)
        closers(rest, self.tables, self.state, ends)
        closing = ends[:, 1] >= 0
        if not closing.any():
            return -1
        seam, depth = self._seams(rest), self.tables[4]
        order = np.flatnonzero(closing)
        order = order[np.argsort(-depth[rest[order]], kind="stable")]
        order = order[np.unique(seam[order], return_index=True)[1]]
        bound = np.array([self._known.get(int(rest[i]), np.inf) for i in order])
        fresh = np.zeros(len(order), bool)
        while not fresh[k := int(bound.argmax())]:
            bound[k], fresh[k] = self._length(*ends[order[k]]), True
            self._known[int(rest[order[k]])] = bound[k]
        return int(rest[order[k]])

    def _length(self, a: int, b: int) -> float:
        from medialis.medial_meshes._growth_kernels import way_between

        cells = self.cells
        return float(
            way_between(a, b, cells.neighbours, cells.centers, self.state[2], self.heap, self._way)
        )

    def _seams(self, rest: Index) -> Index:
        """Return the connected piece of each of some tetrahedra."""
        place = np.full(len(self.cells.corners), -1)
        place[rest] = np.arange(len(rest))
        beside = self.cells.neighbours[rest]
        row, side = np.nonzero((beside >= 0) & (place[beside] >= 0))
        links = np.stack([row, place[beside[row, side]]], axis=1)
        return np.asarray(piece_labels(len(rest), links), np.int64)
