"""Halving of long edges, and of the faces at them; long thin faces become strips instead.

Halved again and again, a needle of 64 pieces along its long sides falls into 729 triangles, and a
flat triangle with a blunt corner into 4096, though neither has room for more than 128. So only the
sides of such a face are halved, with its neighbours; in the end triangles are put between them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from medialis.model.surface import Surface
from medialis.validation import FloatArray

Rows = NDArray[np.int64]
Allowed = Callable[[FloatArray], FloatArray]

LONG = 4.0
"""Longest edges: a face no higher than one and longer than this many is a strip. Shorter ones are
halved, into at most five times the triangles."""

# For each pattern of split edges (bit j: edge j, from corner j to corner j + 1), the new triangles
# in terms of corners 0, 1, 2 and midpoints 3, 4, 5 of edges 0, 1, 2. Two split edges leave a
# quadrangle, which is cut along its shorter diagonal.
_ONE = {1: ((0, 3, 2), (3, 1, 2)), 2: ((1, 4, 0), (4, 2, 0)), 4: ((2, 5, 1), (5, 0, 1))}
_THREE = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
# Two split edges: the corner where they meet and its two midpoints, then the far two corners.
_TWO = {3: (1, 4, 3, 0, 2), 6: (2, 5, 4, 1, 0), 5: (0, 3, 5, 2, 1)}


@dataclass(frozen=True)
class Cut:
    """A mesh while it is refined: faces that are halved, and strips of which only the sides are.

    Attributes
    ----------
    points : (n, 3) float64
    faces : (m, 3) int64
    origin : (m,) int64
        The given face that each face is a piece of.
    sides : (w, 2) int64
        Pieces of the sides of strips: strip after strip, once round, the longest side first.
    side_of : (w,) int64
        Twice the number of the strip, and one more on its two shorter sides; ascending.
    strip_origin : (s,) int64
        The given face of each strip.
    """

    points: FloatArray
    faces: Rows
    origin: Rows
    sides: Rows
    side_of: Rows
    strip_origin: Rows

    @classmethod
    def of(cls, surface: Surface) -> Cut:
        """Begin with all faces of a mesh, and no strip."""
        faces, none = np.asarray(surface.faces, np.int64), np.empty(0, np.int64)
        return cls(surface.points, faces, np.arange(len(faces)), none.reshape(0, 2), none, none)

    def with_strips(self, longest_edge: float) -> Cut:
        """Make strips of the faces that are long and no higher than an edge may be."""
        corners = self.points[self.faces]
        length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        longest = length.max(axis=1, initial=0.0)
        rows = np.flatnonzero(longest > LONG * longest_edge)
        a, b, c = np.moveaxis(corners[rows], 1, 0)
        thin = np.linalg.norm(np.cross(b - a, c - a), axis=1) <= longest_edge * longest[rows]
        rows = rows[thin]
        if len(rows) == 0:
            return self
        first = length[rows].argmax(axis=1)
        turned = self.faces[rows[:, None], (first[:, None] + np.arange(3)) % 3]
        count = len(self.strip_origin)
        number = 2 * (count + np.arange(len(rows)))
        side_of = number[:, None] + np.array([0, 1, 1])
        sides = np.stack([turned, np.roll(turned, -1, axis=1)], axis=2)
        rest = np.ones(len(self.faces), bool)
        rest[rows] = False
        return replace(
            self,
            faces=self.faces[rest],
            origin=self.origin[rest],
            sides=np.concatenate([self.sides, sides.reshape(-1, 2)]),
            side_of=np.concatenate([self.side_of, side_of.ravel()]),
            strip_origin=np.concatenate([self.strip_origin, self.origin[rows]]),
        )

    def without_strips(self) -> Cut:
        """Fill the strips with triangles."""
        from medialis.surface._strip_kernels import zip_strips

        count, none = len(self.strip_origin), np.empty(0, np.int64)
        if count == 0:
            return self
        pieces = np.bincount(self.side_of, minlength=2 * count).reshape(-1, 2)
        first = np.concatenate([[0], np.cumsum(pieces.sum(axis=1))])
        made = pieces.sum(axis=1) - 2
        filling = np.empty((made.sum(), 3), np.int64)
        ring = np.ascontiguousarray(self.sides[:, 0])
        zip_strips(self.points, ring, first, np.ascontiguousarray(pieces[:, 0]), filling)
        origin = np.concatenate([self.origin, np.repeat(self.strip_origin, made)])
        order = np.argsort(origin, kind="stable")
        return Cut(
            self.points,
            np.concatenate([self.faces, filling])[order],
            origin[order],
            none.reshape(0, 2),
            none,
            none,
        )

    def halved(self, longest_edge: float | Allowed, most_points: int) -> Cut | None:
        """Halve every edge that is too long once; None when there is none.

        `longest_edge` may be a function of the middles (e, 3) of the edges.

        Raises
        ------
        TooManyPointsError
            When there would be more than `most_points`.
        """
        m = len(self.faces)
        # A side of a strip is a face that names a vertex twice: it has one edge.
        surface = Surface(self.points, np.concatenate([self.faces, self.sides[:, [0, 1, 1]]]))
        bound: float | FloatArray
        if callable(longest_edge):
            bound = longest_edge(surface.points[surface.edges].mean(axis=1))
        else:
            bound = longest_edge
        n, long = surface.point_count, surface.edge_lengths > bound
        if not long.any():
            return None
        ends = surface.edges[long]
        if n + len(ends) > most_points:
            raise TooManyPointsError(n, len(ends))
        points = np.concatenate([surface.points, 0.5 * surface.points[ends].sum(axis=1)])
        middle = np.full(len(surface.edges) + 1, -1, np.int64)
        middle[:-1][long] = n + np.arange(len(ends))
        middles = middle[edges_of_sides(surface)]
        # Corners and midpoints of each face side by side: columns 0-2 and 3-5.
        six = np.concatenate([np.asarray(surface.faces), middles], axis=1)
        faces, parent = _cut_faces(points, six[:m])
        three = six[m:, [0, 3, 1]]
        two = three[:, 1] >= 0
        sides = np.stack([three[:, :2], three[:, 1:]], axis=1)
        sides[~two, 0, 1] = three[~two, 2]
        use = np.column_stack([np.ones(len(two), bool), two])
        return replace(
            self,
            points=points,
            faces=faces,
            origin=self.origin[parent],
            sides=sides[use],
            side_of=np.repeat(self.side_of, use.sum(axis=1)),
        )


class TooManyPointsError(Exception):
    """More points than allowed: how many there are, and how many would come."""


def edges_of_sides(surface: Surface) -> Rows:
    """Return the row in ``surface.edges`` of each side of each face, (m, 3); -1 for none."""
    table = surface.edge_table
    proper = table.low != table.high
    row = np.where(proper, np.cumsum(proper) - 1, -1)
    return row[table.edge_of].reshape(-1, 3)


def _cut_faces(points: FloatArray, six: Rows) -> tuple[Rows, Rows]:
    """Cut faces along the midpoints of their sides; new faces, and the row that each is from."""
    is_long = six[:, 3:] >= 0
    pattern = (is_long * np.array([1, 2, 4])).sum(axis=1)
    triangles, parents = [], []

    def cut(rows: Rows, pieces: tuple[tuple[int, int, int], ...]) -> None:
        for piece in pieces:
            triangles.append(six[rows][:, piece])
            parents.append(rows)

    cut(np.flatnonzero(pattern == 0), ((0, 1, 2),))
    for code, pieces in _ONE.items():
        cut(np.flatnonzero(pattern == code), pieces)
    for code, (tip, first, second, left, right) in _TWO.items():
        # The tip triangle goes off; the quadrangle (first, right, left, second) stays.
        rows = np.flatnonzero(pattern == code)
        p = points[six[rows]]
        one = np.linalg.norm(p[:, first] - p[:, left], axis=1)
        other = np.linalg.norm(p[:, second] - p[:, right], axis=1)
        tip_piece = (tip, first, second)
        cut(rows[one <= other], (tip_piece, (first, right, left), (first, left, second)))
        cut(rows[one > other], (tip_piece, (first, right, second), (second, right, left)))
    cut(np.flatnonzero(pattern == 7), _THREE)
    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")
    return np.concatenate(triangles)[order], parent[order]
