"""Faces that agree on the outside, and pieces that face outward.

Strategy: faces are nodes, edges of exactly two faces are links with a sign (do both faces run
opposite ways along it?). A breadth-first tree from one root over all pieces gives each face a
parent, signs along the tree say which faces to flip, and the side with more faces wins. Where two
faces lie on each other and face the same way, as at the rim of a surface given twice, the edge is
no link: it would turn one of two right surfaces over.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.model.edge_table import Index, Mask
from medialis.model.surface import Surface
from medialis.model.topology import piece_labels
from medialis.surface._signs import propagate_signs
from medialis.surface._volumes import PieceVolumes
from medialis.validation import FloatArray, IntArray

ON_EACH_OTHER = 1.0 - 1e-6
"""Cosine of the angle between faces from which on they lie on each other (0.08 degrees)."""


def agreeing_flips(surface: Surface) -> tuple[Mask, Mask]:
    """Return the faces to flip so that neighbours agree (m,), and the one-sided pieces' faces (m,).

    Fewer faces of each piece are flipped than are kept. A one-sided piece, such as a Moebius band,
    cannot agree everywhere: its faces are flipped only where that leaves fewer disagreements.
    """
    m = surface.face_count
    flip = np.zeros(m, bool)
    a, b, opposite = surface.edge_table.pairs
    if opposite.all():
        return flip, flip.copy()
    linked = opposite | ~_on_each_other(surface, a // 3, b // 3, ~opposite)
    a, b, opposite = a[linked], b[linked], opposite[linked]
    across = np.full((m, 3), -1, np.int32)
    across.flat[a], across.flat[b] = b // 3, a // 3
    # +1 where faces run opposite ways along an edge (they agree), -1 where they run the same way.
    agree = np.zeros((m, 3), np.int8)
    agree.flat[a] = agree.flat[b] = np.where(opposite, 1, -1)
    piece = surface.face_pieces if linked.all() else piece_labels(m, np.stack([a, b], axis=1) // 3)
    count = int(piece.max()) + 1
    parent = _tree(across, piece, count)
    link = across == parent[:, None]
    to_parent = agree[np.arange(m), link.argmax(axis=1)]
    flip = propagate_signs(parent, to_parent) < 0
    # The side with more faces wins; on a tie the side of the lowest face.
    flip ^= (np.bincount(piece, flip, count) > 0.5 * np.bincount(piece, minlength=count))[piece]
    before = np.bincount(piece, (agree < 0).sum(axis=1), count)
    now = agree * np.where(flip, -1, 1)[:, None] * np.where(flip[across], -1, 1)
    left = np.bincount(piece, (now < 0).sum(axis=1), count)
    flip &= (left < before)[piece]
    return flip, (left > 0)[piece]


def _on_each_other(surface: Surface, a: IntArray, b: IntArray, looked_at: Mask) -> Mask:
    """Tell which pairs of faces that run the same way along their edge also face the same way.

    Such faces are folded onto each other.
    """
    result = np.zeros(len(a), bool)
    rows = np.flatnonzero(looked_at)
    normals = surface.face_normals
    alike = np.einsum("ij,ij->i", normals[a[rows]], normals[b[rows]])
    result[rows] = alike > ON_EACH_OTHER
    return result


def _tree(across: IntArray, piece: IntArray, count: int) -> Index:
    """Return the parent face of each face, -1 for the lowest face of each piece."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order

    # One search covers all pieces: an extra node m points at the first face of each.
    m = len(across)
    roots = np.unique(piece, return_index=True)[1]
    present = across >= 0
    starts = np.zeros(m + 2, np.int32)
    np.cumsum(present.sum(axis=1), out=starts[1:-1])
    starts[-1] = starts[-2] + count
    targets = np.concatenate([across[present], roots]).astype(np.int32)
    graph = csr_array((np.ones(len(targets), np.int8), targets, starts), shape=(m + 1, m + 1))
    _, parent = breadth_first_order(graph, m, directed=True, return_predecessors=True)
    result = parent[:m].astype(np.int64)
    result[result == m] = -1
    return result


def outward_flips(
    surface: Surface, measured: PieceVolumes, one_sided: Mask, piece: IntArray
) -> tuple[Mask, Mask]:
    """Return which pieces to turn outward (c,), and which inward ones are cavities (c,).

    An inward closed piece directly inside an outward one is a cavity and stays; when the piece
    around it is turned, everything inside is turned along. Pieces of unclear sign and `one_sided`
    ones (c,) stay.
    """
    sign = np.where(one_sided, 0, measured.sign)
    flip = np.zeros(len(sign), bool)
    cavity = np.zeros(len(sign), bool)
    if not (sign < 0).any():
        return flip, cavity
    flip |= ~measured.closed & (sign < 0)
    solid = measured.closed & (sign != 0)
    inside, size = _enclosures(surface, sign, solid, piece)
    # From large to small: a piece is always smaller than the one around it.
    for c in np.lexsort((np.arange(len(sign)), -size)):
        if not solid[c] or (sign[c] > 0 and len(inside.get(c, ())) == 0):
            continue
        around = min(inside.get(c, ()), key=lambda o: (size[o], o), default=None)
        flip[c] = around is not None and flip[around]
        if sign[c] * (-1 if flip[c] else 1) < 0:
            inward_around = around is not None and sign[around] * (-1 if flip[around] else 1) < 0
            if around is None or inward_around:
                flip[c] = not flip[c]
            else:
                cavity[c] = True
    return flip, cavity


def _enclosures(
    surface: Surface, sign: Index, solid: Mask, piece: IntArray
) -> tuple[dict[int, list[int]], FloatArray]:
    """Return which closed pieces lie around each piece, and the diagonal of each piece's box.

    Only pairs with an inward piece are looked at: among outward ones nothing is ever turned.
    """
    assert surface.faces is not None
    order = np.argsort(piece, kind="stable")
    starts = np.searchsorted(piece[order], np.arange(len(sign)))
    corners = surface.points[surface.faces[order]]
    # Three at a time: numpy goes along the short axis one by one.
    a, b, c = (corners[:, j] for j in range(3))
    low = np.minimum.reduceat(np.minimum(np.minimum(a, b), c), starts)
    high = np.maximum.reduceat(np.maximum(np.maximum(a, b), c), starts)
    size = np.linalg.norm(high - low, axis=1)
    ends = np.append(starts[1:], len(piece))
    probe = corners[starts, 0]
    inside: dict[int, list[int]] = {}
    for outer in np.flatnonzero(solid):
        within = solid & (low >= low[outer]).all(axis=1) & (high <= high[outer]).all(axis=1)
        within &= size < size[outer]
        if sign[outer] > 0:
            within &= sign < 0
        inner = np.flatnonzero(within)
        if len(inner):
            turns = winding_numbers(probe[inner], corners[starts[outer] : ends[outer]])
            for one in inner[np.abs(turns) > 0.5]:
                inside.setdefault(int(one), []).append(int(outer))
    return inside, size


def winding_numbers(queries: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return how often closed triangles (m, 3, 3) wind around each query point, (q,).

    About +1 inside an outward surface, -1 inside an inward one, 0 outside (van Oosterom and
    Strackee 1983). Cost O(q m), in blocks of about a million pairs.
    """
    result = np.empty(len(queries))
    for i, query in enumerate(queries):
        a, b, c = (triangles[:, j] - query for j in range(3))
        la, lb, lc = (np.sqrt(np.einsum("ij,ij->i", v, v)) for v in (a, b, c))
        det = np.einsum("ij,ij->i", a, np.cross(b, c))
        dot_ab, dot_bc, dot_ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
        result[i] = np.arctan2(det, la * lb * lc + dot_ab * lc + dot_bc * la + dot_ca * lb).sum()
    return result / (2 * np.pi)


def flipped(faces: IntArray, rows: NDArray[np.bool_]) -> IntArray:
    """Return faces with the given rows turned over; their first corner stays first."""
    return np.where(rows[:, None], faces[:, [0, 2, 1]], faces)
