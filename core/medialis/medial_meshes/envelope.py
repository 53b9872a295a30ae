"""The envelope of a medial mesh: the union of its balls, cones and slabs, and distances to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.medial_meshes.boxes import Boxes
from medialis.model.medial_mesh import Complex
from medialis.threads import run_chunks
from medialis.validation import FloatArray

Index = NDArray[np.int64]

PLACES_A_CHUNK = 1024


def primitives_of(given: Complex) -> Index:
    """Return triangles, edges of no triangle and lone balls, (s, 3), -1 where there are fewer."""
    n, faces, edges = len(given), given.faces, given.edges
    sides = np.sort(faces, axis=1)[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2)
    low_first = np.sort(edges, axis=1)
    bare = edges[~np.isin(low_first @ [n, 1], sides @ [n, 1])]
    used = np.zeros(n, bool)
    used[edges] = True
    alone = np.flatnonzero(~used)
    rows = np.full((len(faces) + len(bare) + len(alone), 3), -1)
    rows[: len(faces)] = faces
    rows[len(faces) : len(faces) + len(bare), :2] = bare
    rows[len(faces) + len(bare) :, 0] = alone
    return rows


@dataclass(frozen=True, eq=False)
class Envelope:
    """Balls, cones and slabs.

    Attributes
    ----------
    balls : (n, 4) float64
    rows : (s, 3) int64
        See `primitives_of`.
    before : Boxes or None
        The tree of an envelope of the same rows whose balls were near these.
    """

    balls: FloatArray
    rows: Index
    before: Boxes | None = None

    @classmethod
    def of(cls, given: Complex) -> Envelope:
        """Take the balls, cones and slabs of a complex."""
        return cls(given.balls, primitives_of(given))

    @cached_property
    def boxes(self) -> Boxes:
        """The tree of the primitives."""
        own = np.where(self.rows < 0, self.rows[:, :1], self.rows)
        balls = self.balls[own]
        build = Boxes.over if self.before is None else self.before.over_moved
        return build(balls[:, :, :3], balls[:, :, 3].max(axis=1))

    @cached_property
    def table(self) -> FloatArray:
        """What distances to the primitives need of them; see `_primitive_kernels.py`."""
        from medialis.medial_meshes._primitive_kernels import WIDTH, prepare

        table = np.empty((len(self.rows), WIDTH))
        prepare(self.balls, self.rows, table)
        return table

    def distances(
        self, places: FloatArray, enough: float = -np.inf
    ) -> tuple[FloatArray, Index, FloatArray]:
        """Return signed distances of places (q, 3), the primitives that decide them, and shares.

        Exact outside; inside minus the depth in the deepest primitive. Where `enough` is given, the
        first primitive nearer than that ends the search, and without any the distance is `enough`.
        Shares (q, 3) are those of the balls.
        """
        from medialis.medial_meshes._envelope_kernels import nearest_primitive

        count, boxes, table = len(places), self.boxes, self.table
        distance, shares = np.empty(count), np.empty((count, 3))
        row = np.empty(count, np.int64)

        def work(begin: int, end: int) -> None:
            nearest_primitive(
                begin, end, places, table, boxes.order, boxes.bounds, boxes.depth, enough,
                distance, row, shares,
            )  # fmt: skip

        run_chunks(work, count, PLACES_A_CHUNK)
        return distance, row, shares
