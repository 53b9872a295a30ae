"""Areas, signed volumes and degenerate faces, with the criteria that say when a sign is clear.

A closed piece has the signed volume of its tetrahedra with any apex. An open piece is closed by
cones from the middle of its boundary: with that point as apex the cones have no volume. Whether the
sign means anything is judged by how much of the tetrahedra cancels and how bulky the piece is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.surface._edges import EdgeTable, Index, Mask
from medialis.validation import FloatArray, IntArray

DEGENERATE_HEIGHT = 1e-12
"""A face is degenerate when its height is at most this part of its longest edge. Rounding of the
differences leaves a height of about 1e-16 to an exactly flat face; no real face is that thin."""

_CLOSED_SHARE = 1e-9
_OPEN_SHARE = 0.2
_OPEN_BULK = 1e-3
"""A bowl of depth d and width w has bulk of about 0.14 d/w; a sphere 0.094."""


def power_of_two_scale(points: FloatArray) -> float:
    """Return the power of two that brings the largest coordinate near 1: scaling by it is exact."""
    largest = float(np.abs(points).max(initial=0.0))
    exponent = int(np.frexp(largest)[1])
    return float(np.ldexp(1.0, min(max(-exponent, -1020), 1020)))


def face_vectors(points: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return twice the area vector (m, 3) and the longest edge squared (m,) of each face."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    u, v = b - a, c - a
    w = v - u
    double = np.empty_like(u)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        double[:, i] = u[:, j] * v[:, k] - u[:, k] * v[:, j]
    longest = np.einsum("ij,ij->i", u, u)
    for side in (v, w):
        np.maximum(longest, np.einsum("ij,ij->i", side, side), out=longest)
    return double, longest


def degenerate_faces(double: FloatArray, longest: FloatArray) -> Mask:
    """Return (m,) where a face has (nearly) no height, see `DEGENERATE_HEIGHT`."""
    area = np.sqrt(np.einsum("ij,ij->i", double, double))
    return area <= DEGENERATE_HEIGHT * longest


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


def piece_volumes(
    points: FloatArray,
    faces: IntArray,
    double: FloatArray,
    table: EdgeTable,
    pieces: IntArray,
    count: int,
) -> PieceVolumes:
    """Measure `count` pieces; `pieces` (m,) is the piece of each face, `double` its area vector."""
    half, edge = _unbalanced(table, pieces, count)
    piece = pieces[half // 3]
    closed = np.ones(count, bool)
    closed[piece] = False
    # The apex is the middle of the boundary, or of all corners of a closed piece.
    rim = np.concatenate([table.low[edge], table.high[edge]])
    apex = _middles(points[rim], np.concatenate([piece, piece]), count)
    inner = closed[pieces]
    corner = points[faces[:, 0]]
    apex[closed] = _middles(corner[inner], pieces[inner], count)[closed]
    tetra = np.einsum("ij,ij->i", corner - apex[pieces], double) / 6.0
    area = np.sqrt(np.einsum("ij,ij->i", double, double)) / 2.0
    return PieceVolumes(
        _summed(pieces, tetra, count),
        _summed(pieces, np.abs(tetra), count),
        _summed(pieces, area, count),
        closed,
    )


def _summed(pieces: IntArray, values: FloatArray, count: int) -> FloatArray:
    return np.bincount(pieces, values, count).astype(np.float64)


def _unbalanced(table: EdgeTable, pieces: IntArray, count: int) -> tuple[Index, Index]:
    """Return half-edges and their edges where the faces of one piece do not cancel."""
    counts = table.counts
    two = counts == 2
    plain = np.zeros(len(counts), bool)
    a, b, agree = table.pairs()
    plain[two] = agree & (pieces[a // 3] == pieces[b // 3])
    edge = np.repeat(np.arange(len(counts)), counts)
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
