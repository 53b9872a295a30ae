"""Areas, signed volumes and degenerate faces, with the criteria that say when a sign is clear.

A closed piece has the signed volume of its tetrahedra with any apex. An open piece is closed by
cones from the middle of its boundary: with that point as apex the cones have no volume. Whether the
sign means anything is judged by how much of the tetrahedra cancels and how bulky the piece is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.model.edge_table import Index, Mask
from medialis.model.surface import Surface
from medialis.model.topology import piece_labels
from medialis.validation import FloatArray, IntArray, frozen

_CLOSED_SHARE = 1e-9
_OPEN_SHARE = 0.2
_OPEN_BULK = 1e-3
"""A bowl of depth d and width w has bulk of about 0.14 d/w; a sphere 0.094."""


def power_of_two_scale(points: FloatArray) -> float:
    """Return the power of two that brings the largest coordinate near 1: scaling by it is exact."""
    largest = float(np.abs(points).max(initial=0.0))
    exponent = int(np.frexp(largest)[1])
    return float(np.ldexp(1.0, min(max(-exponent, -1020), 1020)))


def scaled(points: FloatArray, faces: IntArray | None = None) -> Surface:
    """Return a surface near size 1, so that squares and cubes of its lengths stay in range."""
    return Surface(points * power_of_two_scale(points), faces)


@dataclass(frozen=True, eq=False)
class PieceVolumes:
    """Signed volume and what is needed to trust its sign, for each piece."""

    volume: FloatArray
    """(c,) signed volume; open pieces are closed by cones from the middle of their boundary."""
    absolute: FloatArray
    """(c,) sum of the absolute volumes of the tetrahedra."""
    area: FloatArray
    """(c,) surface area."""
    closed: Mask
    """(c,) True when along every edge as many faces run one way as the other."""

    @property
    def sign(self) -> Index:
        """+1 outward, -1 inward, 0 when that is not clear, (c,).

        Closed: the volume is more than 1e-9 of the absolute one (else it is a double sheet).
        Open: it is more than a fifth of the absolute one (most tetrahedra point the same way) and
        more than 0.001 area^(3/2) (the piece is no flat sheet).
        """
        size = np.abs(self.volume)
        bulky = (size > _OPEN_SHARE * self.absolute) & (size > _OPEN_BULK * self.area**1.5)
        clear = np.where(self.closed, size > _CLOSED_SHARE * self.absolute, bulky)
        return np.where(clear, np.sign(self.volume), 0).astype(np.int64)


def solid_pieces(surface: Surface) -> IntArray:
    """Piece of each face (m,): open pieces of `Surface.face_pieces` that close each other are one.

    Along an edge that they share as many faces run one way as the other, as where a solid touches
    itself along a line. By itself no such piece tells where its outside is.
    """
    pieces, table = surface.face_pieces, surface.edge_table
    half, edge = _unbalanced(surface, pieces)
    net = np.bincount(edge, np.where(table.forward[half], 1.0, -1.0), len(table.counts))
    closing = (net[edge] == 0) & (table.counts[edge] > 2)
    if not closing.any():
        return pieces
    piece, edge = pieces[half[closing] // 3], edge[closing]
    one = np.full(len(table.counts), -1)
    one[edge] = piece
    label = piece_labels(int(pieces.max()) + 1, np.stack([piece, one[edge]], axis=1))
    return frozen(label[pieces], np.int32)


def piece_volumes(surface: Surface, pieces: IntArray) -> PieceVolumes:
    """Measure the pieces of a surface, given that of each face (m,)."""
    from medialis.model._surface_kernels import sum_pieces

    assert surface.faces is not None
    points, table = surface.points, surface.edge_table
    count = int(pieces.max()) + 1
    half, edge = _unbalanced(surface, pieces)
    piece = pieces[half // 3]
    closed = np.ones(count, bool)
    closed[piece] = False
    # The apex is the middle of the boundary, or of all corners of a closed piece.
    rim = np.concatenate([table.low[edge], table.high[edge]])
    apex = _middles(points[rim], np.concatenate([piece, piece]), count)
    corner = points[surface.faces[:, 0]]
    apex[closed] = _middles(corner, pieces, count)[closed]
    sums = np.zeros((3, count))
    sum_pieces(corner, surface.face_vectors, surface.face_areas, pieces, apex, sums)
    return PieceVolumes(sums[0], sums[1], sums[2], closed)


def _unbalanced(surface: Surface, pieces: IntArray) -> tuple[Index, Index]:
    """Return half-edges and their edges where the faces of one piece do not cancel."""
    table, count = surface.edge_table, int(pieces.max()) + 1
    plain = np.zeros(len(table.counts), bool)
    a, b, agree = table.pairs
    plain[table.counts == 2] = agree & (pieces[a // 3] == pieces[b // 3])
    if plain.all():  # closed, as most meshes
        return np.empty(0, np.int64), np.empty(0, np.int64)
    edge = np.repeat(np.arange(len(table.counts)), table.counts)
    rest = ~plain[edge]
    half, edge = table.order[rest], edge[rest]
    _, group = np.unique(edge * count + pieces[half // 3], return_inverse=True)
    net = np.bincount(group, np.where(table.forward[half], 1.0, -1.0))
    open_ = net[group] != 0
    return half[open_], edge[open_]


def _middles(points: FloatArray, pieces: IntArray, count: int) -> FloatArray:
    """Return the mean point of each piece, (count, 3); zero for a piece without points."""
    sums = np.stack([np.bincount(pieces, points[:, i], count) for i in range(3)], axis=1)
    return sums / np.maximum(np.bincount(pieces, minlength=count), 1)[:, None]
