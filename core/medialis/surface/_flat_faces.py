"""Faces of three different corners without height: turn their longest edge.

A flat face a, b, c has c on the segment a b. Dropping it would open a slit between its neighbours.
Its neighbour b, a, d across the longest edge covers the same segment, so replacing both by c, a, d
and d, b, c leaves the surface exactly as it is, with no flat face. Flat faces are rare, so this is
a plain loop over them; each round turns edges of faces not yet touched in it.
"""

from __future__ import annotations

import numpy as np

from medialis.model.edge_table import EdgeTable, Index, Mask
from medialis.model.surface import Surface
from medialis.validation import FloatArray, IntArray

_ROUNDS = 30
_APART = np.arange(6).reshape(2, 3)


def flip_flat_faces(surface: Surface, flat: Mask) -> tuple[IntArray, Index, int]:
    """Turn edges of flat faces where that helps.

    Returns
    -------
    faces : (m, 3) int32
    source : (m,) int64
        The given face that each face lies in.
    turned : int
        How many flat faces were merged into a neighbour.
    """
    faces = np.array(surface.faces)
    source = np.arange(len(faces))
    turned = 0
    for _ in range(_ROUNDS):
        done = _turn_once(surface.points, faces, source, np.flatnonzero(flat))
        turned += done
        if done == 0:
            break
        flat = Surface(surface.points, faces).flat_faces
    return faces, source, turned


def _turn_once(points: FloatArray, faces: IntArray, source: Index, flat: Index) -> int:
    """Turn one edge of each flat face where both new faces are fine; change faces in place."""
    table = EdgeTable.of(faces, len(points))
    a_half, b_half, opposite = table.pairs
    partner = np.full(3 * len(faces), -1, np.int64)
    partner[a_half[opposite]], partner[b_half[opposite]] = b_half[opposite], a_half[opposite]
    edges = set(zip(table.low.tolist(), table.high.tolist(), strict=True)) if len(flat) else set()
    touched: set[int] = set()
    done = 0
    for face in flat.tolist():
        corners = points[faces[face]]
        lengths = ((np.roll(corners, -1, axis=0) - corners) ** 2).sum(axis=1)
        j = int(lengths.argmax())
        other = int(partner[3 * face + j])
        if other < 0 or face in touched or other // 3 in touched:
            continue
        a, b, c = (int(faces[face, (j + i) % 3]) for i in range(3))
        d = int(faces[other // 3, (other % 3 + 2) % 3])
        new = np.array([[c, a, d], [d, b, c]], faces.dtype)
        if c == d or (min(c, d), max(c, d)) in edges:
            continue
        if Surface(points[new.ravel()], _APART).flat_faces.any():
            continue
        faces[[face, other // 3]] = new
        source[face] = source[other // 3]
        edges.add((min(c, d), max(c, d)))
        touched.update((face, other // 3))
        done += 1
    return done
