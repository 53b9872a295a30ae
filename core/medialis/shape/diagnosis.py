"""Diagnosis: what is right and wrong with a mesh or cloud, before anything is computed on it.

`diagnose` counts and measures. The judgements behind it serve repair as well, and stand here first:
whether faces agree on the outside, which pieces face inward, which faces lie on each other.

Agreement: faces are nodes, edges of exactly two faces are links with a sign (do both faces run
opposite ways along it?). A breadth-first tree from one root over all pieces gives each face a
parent, signs along the tree say which faces to flip, and the side with more faces wins. Where two
faces lie on each other and face the same way, as at the rim of a surface given twice, the edge is
no link: it would turn one of two right surfaces over.

Outside: a closed piece has the signed volume of its tetrahedra with any apex. An open piece is
closed by cones from the middle of its boundary: with that point as apex the cones have no volume.
Whether the sign means anything is judged by how much of the tetrahedra cancels and how bulky the
piece is.

Repeated faces: two faces with the same corners and opposite directions have no volume between them.
Scanned meshes hold small folds of such pairs that hang on the surface; dropping one face of a pair
would open the surface along the fold (an edge with 4 faces gets 3, one with 2 gets 1), dropping
both closes it. A whole sheet modelled with a front and a back must not vanish, so only small folds
that touch other faces are dropped; elsewhere one face of each pair stays.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described, EdgeTable, Index, Mask, first_equal_row, next_side
from medialis.base.validation import FloatArray, IntArray, all_finite, as_faces, as_points, frozen
from medialis.shape.surface import Surface, Topology, piece_labels
from medialis.shape.welding import Weld, weld


def propagate_signs(predecessors: ArrayLike, agree: ArrayLike) -> NDArray[np.int8]:
    """Return the sign of each node relative to its root, (k,).

    Parameters
    ----------
    predecessors : (k,) integers
        The parent of each node in a forest; negative at a root.
    agree : (k,)
        +1 where a node agrees with its parent, -1 where it does not; ignored at roots.

    Notes
    -----
    Pointer doubling: after round r a node knows its product of signs over 2^r ancestors. Cost
    O(k log depth).

    Examples
    --------
    >>> propagate_signs([-1, 0, 1, 2], [1, -1, 1, -1])
    array([ 1, -1, -1,  1], dtype=int8)
    """
    parent = np.array(predecessors, dtype=np.int64)
    sign = np.array(agree, dtype=np.int8)
    roots = parent < 0
    parent[roots] = np.flatnonzero(roots)
    sign[roots] = 1
    while True:
        above = parent[parent]
        if (above == parent).all():
            # A parent that is a root carries sign +1, so every sign is complete now.
            return sign
        sign = sign * sign[parent]
        parent = above


_CLOSED_SHARE = 1e-9
_OPEN_SHARE = 0.2
_OPEN_BULK = 1e-3
"""A bowl of depth d and width w has bulk of about 0.14 d/w; a sphere 0.094."""


LEAST_SCALE = 2.0**-100
"""Shapes of larger and smaller coordinates than its inverse and itself are scaled."""


def power_of_two_scale(points: FloatArray) -> float:
    """Return 1 where squares and cubes of lengths stay in range, or a power of two that does it.

    It brings the largest coordinate near 1; scaling by it is exact.
    """
    largest = max(-float(points.min(initial=0.0)), float(points.max(initial=0.0)))
    exponent = int(np.frexp(largest)[1])
    scale = float(np.ldexp(1.0, min(max(-exponent, -1020), 1020)))
    return 1.0 if LEAST_SCALE < scale < 1.0 / LEAST_SCALE else scale


def scaled(points: FloatArray, faces: IntArray | None = None) -> Surface:
    """Return a surface of a size such that squares and cubes of its lengths stay in range."""
    scale = power_of_two_scale(points)
    return Surface.of_checked(points if scale == 1.0 else points * scale, faces)


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
    if len(half) == 0:
        return pieces
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
    from medialis.shape._kernels import add_corners, add_ends, sum_pieces

    assert surface.faces is not None
    points, faces, table = surface.points, surface.faces, surface.edge_table
    count = int(pieces.max()) + 1
    half, edge = _unbalanced(surface, pieces)
    piece = pieces[half // 3]
    closed = np.ones(count, bool)
    closed[piece] = False
    # The apex is the middle of the boundary, or of all corners of a closed piece.
    middle, met = np.zeros((count, 3)), np.zeros(count, np.int64)
    add_ends(points, table.ends, edge, piece, middle, met)
    apex = middle / np.maximum(met, 1)[:, None]
    if closed.any():
        middle, met = np.zeros((count, 3)), np.zeros(count, np.int64)
        add_corners(points, faces, pieces, middle, met)
        apex[closed] = (middle / met[:, None])[closed]
    sums = np.zeros((3, count))
    sum_pieces(points, faces, surface.face_vectors, surface.face_areas, pieces, apex, sums)
    return PieceVolumes(sums[0], sums[1], sums[2], closed)


def _unbalanced(surface: Surface, pieces: IntArray) -> tuple[Index, Index]:
    """Return half-edges and their edges where the faces of one piece do not cancel.

    Faces at an edge of two are of one piece.
    """
    table, count = surface.edge_table, int(pieces.max()) + 1
    *_, agree = table.pairs
    if len(agree) == len(table.counts) and agree.all():  # closed, as most meshes
        return np.empty(0, np.int64), np.empty(0, np.int64)
    plain = np.zeros(len(table.counts), bool)
    plain[table.counts == 2] = agree
    edge = np.repeat(np.arange(len(table.counts)), table.counts)
    rest = ~plain[edge]
    half, edge = table.order[rest], edge[rest]
    open_ = table.counts[edge] == 1
    if not open_.all():
        rows = np.flatnonzero(~open_)
        key = edge[rows] * count + pieces[half[rows] // 3]
        _, group = np.unique(key, return_inverse=True)
        net = np.bincount(group, np.where(table.forward[half[rows]], 1.0, -1.0))
        open_[rows] = net[group] != 0
    return half[open_], edge[open_]


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
    linked, rows = np.ones(len(a), bool), np.flatnonzero(~opposite)
    # Faces that run the same way along their edge and face the same way are folded on each other.
    one, other = (surface.face_normals[side[rows] // 3] for side in (a, b))
    linked[rows] = np.einsum("ij,ij->i", one, other) <= ON_EACH_OTHER
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
    if np.count_nonzero(solid) < 2:
        return {}, np.zeros(len(sign))
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
    a, b, c = faces.T
    return np.stack([a, np.where(rows, c, b), np.where(rows, b, c)], axis=1)


@dataclass(frozen=True, repr=False)
class Diagnosis(Described):
    """Counts and measures of a mesh or cloud; lengths, areas, volumes in the caller's units.

    Edges and everything derived from them leave faces with a repeated corner out.
    """

    vertices: int
    faces: int
    edges: int
    closed: bool
    """Every edge has at least two faces; False for a cloud."""
    boundary_edges: int
    """Edges with one face."""
    boundary_loops: int
    nonmanifold_edges: int
    """Edges with three or more faces."""
    nonmanifold_vertices: int
    """Vertices whose faces, joined across all edges at the vertex, form several fans."""
    components: int
    """Sets of faces joined by shared vertices; 0 for a cloud."""
    genus: int | None
    """Handles, summed over the components; None for a cloud, a non-manifold or a one-sided mesh."""
    orientation: str
    """"out" or "in" (sign of the volume; open parts closed by cones), "mixed" when two faces run
    along a common edge in the same direction (so at every non-manifold edge), "none" for clouds
    and when the sign means nothing (a flat sheet)."""
    inconsistent_edges: int
    """Edges of two faces that run along them in the same direction."""
    duplicate_vertices: int
    """Vertices at exactly the place of an earlier one."""
    crack_vertices: int
    """Boundary vertices that rounding has parted from another one: merging them closes cracks."""
    weld_distance: float
    """How far apart such vertices may be, from the precision of the coordinates; 0 without any."""
    duplicate_faces: int
    """Faces with the same three vertices as an earlier one."""
    degenerate_faces: int
    """Faces with a repeated corner or a height of at most 1e-12 of their longest edge."""
    unused_vertices: int
    """Vertices of no face; 0 for a cloud."""
    nonfinite_vertices: int
    """Vertices with NaN or infinity; the other measures leave them out."""
    area: float
    volume: float | None
    """Signed; None when the mesh is not closed or neighbouring faces disagree."""
    diagonal: float
    """Of the bounding box of all vertices."""
    spacing: float
    """Mean edge length; for a cloud the mean distance to the nearest other point."""
    min_edge: float
    """Shortest edge; for a cloud the smallest distance to a nearest other point."""
    max_edge: float
    """Longest edge; for a cloud the largest distance to a nearest other point."""

    def as_dict(self) -> dict[str, Any]:
        """Return all fields by name, for JSON."""
        return asdict(self)

    def summary(self, unit: str | None = None) -> str:
        """Return a few lines for people; `unit` is that of the points, where it is known."""
        length, area, volume = (f" {unit}{power}" if unit else "" for power in ("", "²", "³"))
        if self.faces == 0:
            lines = [f"point cloud of {_counted(self.vertices, 'point')}"]
        else:
            lines = [
                f"mesh of {self.vertices} vertices, {_counted(self.faces, 'face')}, {self.edges} "
                f"edges in {_counted(self.components, 'component')}",
                self._surface_line(),
            ]
        lines += self._trouble_lines()
        size = f"diagonal {self.diagonal:.6g}{length}, spacing {self.spacing:.6g}{length}"
        lines.append(f"{size} ({self.min_edge:.6g} to {self.max_edge:.6g}{length})")
        if self.faces:
            enclosed = "none" if self.volume is None else f"{self.volume:.6g}{volume}"
            lines.append(f"area {self.area:.6g}{area}, volume {enclosed}")
        return "\n".join(lines)

    def _surface_line(self) -> str:
        state = "closed" if self.closed else f"open ({_counted(self.boundary_loops, 'hole')})"
        genus = "" if self.genus is None else f", genus {self.genus}"
        if self.orientation == "mixed" and not self.inconsistent_edges:
            return f"{state}{genus}, faces agree on the outside except at non-manifold edges"
        facing = {"out": "facing outward", "in": "facing inward", "none": "outside unclear"}
        return f"{state}{genus}, {facing.get(self.orientation, 'faces disagree on the outside')}"

    def _trouble_lines(self) -> list[str]:
        troubles = (
            (self.nonmanifold_edges, "edge with three or more faces"),
            (self.nonmanifold_vertices, "vertex joining separate fans of faces"),
            (self.inconsistent_edges, "edge whose two faces disagree on the outside"),
            (self.duplicate_vertices, "duplicate vertex"),
            (self.crack_vertices, f"vertex of cracks at most {self.weld_distance:.3g} wide"),
            (self.duplicate_faces, "duplicate face"),
            (self.degenerate_faces, "face without area"),
            (self.unused_vertices, "vertex of no face"),
            (self.nonfinite_vertices, "vertex with NaN or infinity"),
        )
        return [_counted(number, what) for number, what in troubles if number]


def _counted(number: int, what: str) -> str:
    head, _, tail = what.partition(" ")
    if number != 1:
        head = "vertices" if head == "vertex" else head + "s"
        if head == "duplicates":
            head, tail = "duplicate", {"vertex": "vertices", "face": "faces"}[tail]
    return f"{number} {head} {tail}".rstrip()


_SMALL_FOLD = 16
"""Most triangles of a fold that is dropped; in the Stanford dragon folds have up to 6."""


def faces_to_drop(topology: Topology) -> tuple[Mask, Mask]:
    """Return, (m,) each, the repeated faces to drop and the faces of small folds to drop."""
    faces, first = topology.faces, topology.first_equal_face
    m = len(faces)
    repeated = first != np.arange(m)
    folds = np.zeros(m, bool)
    if not repeated.any():
        return repeated, folds
    # +1 for an even permutation of the sorted corners, -1 for an odd one.
    direction = np.where((faces[:, [1, 2, 0]] > faces).sum(axis=1) == 2, 1, -1)
    net = np.bincount(first, direction, m)
    groups = np.unique(first[repeated])
    paired = np.zeros(m, bool)
    paired[groups] = net[groups] == 0
    folds = _small_folds(topology, paired[first], paired)[first]
    # Of the others the first face in the prevailing direction stays.
    fits = direction == np.where(net[first] < 0, -1, 1)
    candidates = np.flatnonzero(fits | paired[first])
    keeper = np.full(m, m)
    np.minimum.at(keeper, first[candidates], candidates)
    repeated = keeper[first] != np.arange(m)
    return repeated & ~folds, folds


def _small_folds(topology: Topology, in_pairs: Mask, leaders: Mask) -> Mask:
    """Return the leading faces (m,) of pairs that belong to small folds touching other faces."""
    faces, n = topology.faces, topology.point_count
    result = np.zeros(len(faces), bool)
    fold_faces = np.flatnonzero(leaders)
    if len(fold_faces) == 0:
        return result
    touched = np.zeros(n, bool)
    touched[faces[~in_pairs]] = True
    # Folds are pairs joined by edges: a graph of pairs and of the edges they have.
    pairs = faces[fold_faces]
    k, table = len(pairs), EdgeTable.of(pairs, n)
    links = np.stack([np.repeat(np.arange(k), 3), k + table.edge_of], axis=1)
    fold = piece_labels(k + len(table.low), links)[:k]
    count = int(fold.max()) + 1
    hangs = np.bincount(fold, touched[pairs].any(axis=1), count) > 0
    small = np.bincount(fold, minlength=count) <= _SMALL_FOLD
    result[fold_faces] = (hangs & small)[fold]
    return result


def repeated_bodies(surface: Surface) -> Mask:
    """Return the faces (m,) of closed components that are equal to an earlier one.

    Closed components are never welded, so a body that a file holds twice has two sets of vertices.
    """
    faces, equal = surface.topology.faces, surface.first_equal_point
    repeated = np.zeros(len(faces), np.bool_)
    if (equal == np.arange(surface.point_count)).all():
        return repeated
    corners, rows = equal[faces], np.arange(len(faces))
    lowest = corners.argmin(axis=1)
    corners = np.stack([corners[rows, (lowest + k) % 3] for k in range(3)], axis=1)
    first = first_equal_row(corners)
    component = surface.components[faces[:, 0]]
    count = len(surface.closed_components)
    same = first != rows
    whole = np.bincount(component, same, count) == np.bincount(component, minlength=count)
    low, high = np.full(count, count), np.full(count, -1)
    np.minimum.at(low, component, component[first])
    np.maximum.at(high, component, component[first])
    return (whole & (low == high) & surface.closed_components)[component]


def diagnose(points: ArrayLike, faces: ArrayLike | None = None) -> Diagnosis:
    """Examine a mesh or cloud; nothing is changed.

    Parameters
    ----------
    points : (n, 3) array of numbers
        NaN and infinity are allowed in points that no face uses: they are counted and left out.
    faces : (m, 3) integers, optional

    Returns
    -------
    Diagnosis

    Raises
    ------
    InvalidShapeError
        When points or faces have a wrong shape or are out of range, or a face uses a point that
        is not finite.

    See Also
    --------
    repair : mends what it finds.
    read_shape : does both.

    Examples
    --------
    >>> tetrahedron = diagnose(
    ...     [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ...     [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    ... )
    >>> tetrahedron.closed, tetrahedron.genus, tetrahedron.orientation
    (True, 0, 'out')
    """
    return examine(points, faces).diagnosis


class Examined(NamedTuple):
    """A diagnosis, and what else is then known.

    Attributes
    ----------
    diagnosis : Diagnosis
    surface : Surface
        The finite points and the faces, at a scale near 1.
    weld : Weld
        Its vertices that are one; the distance is in the caller's units.
    """

    diagnosis: Diagnosis
    surface: Surface
    weld: Weld


def examine(
    points: ArrayLike, faces: ArrayLike | None, bodies: ArrayLike | None = None
) -> Examined:
    """Return the diagnosis and what it rests on; `bodies` as in `repaired`."""
    xyz, triangles, lost = _finite_part(points, faces)
    # Very large and very small lengths are measured at a scale of about 1, which costs no accuracy
    # (a power of two) and keeps squares and cubes in range.
    scale = power_of_two_scale(xyz)
    surface = scaled(xyz, triangles)
    values: dict[str, Any] = {"vertices": len(xyz), "faces": len(triangles)}
    values |= {"duplicate_vertices": _repeated(surface.first_equal_point)}
    values |= {"nonfinite_vertices": lost, "diagonal": surface.diagonal}
    values |= _diagnose_cloud(surface) if surface.faces is None else _diagnose_faces(surface)
    welded = weld(surface, None if bodies is None else np.asarray(bodies))
    welded = replace(welded, distance=_unscaled(welded.distance, scale, 1))
    values |= {"crack_vertices": welded.near, "weld_distance": welded.distance}
    for names, power in ((("diagonal", "spacing", "min_edge", "max_edge"), 1), (("area",), 2)):
        for name in names:
            values[name] = _unscaled(values[name], scale, power)
    if values["volume"] is not None:
        values["volume"] = _unscaled(values["volume"], scale, 3)
    values["vertices"] += lost
    if len(triangles):
        values["unused_vertices"] += lost
    return Examined(Diagnosis(**values), surface, welded)


def _finite_part(points: ArrayLike, faces: ArrayLike | None) -> tuple[FloatArray, IntArray, int]:
    """Return the finite points, the faces counted in them, and how many points are not finite."""
    triangles: ArrayLike = np.empty((0, 3), np.int32) if faces is None else faces
    if (finite := finite_points(points, triangles)) is not None:
        place = (np.cumsum(finite) - 1).astype(np.int32)
        xyz, lost = np.asarray(points)[finite], int((~finite).sum())
        return as_points(xyz), place[as_faces(triangles, len(finite))], lost
    xyz = as_points(points)
    return xyz, as_faces(triangles, len(xyz)), 0


def finite_points(points: ArrayLike, faces: ArrayLike) -> Mask | None:
    """Tell which points are finite, where others are there that no face uses; None elsewhere."""
    raw = np.asarray(points)
    if raw.dtype.kind == "f" and raw.ndim == 2 and raw.shape[1] == 3 and not all_finite(raw):
        finite = np.asarray(np.isfinite(raw).all(axis=1))
        if finite.any() and not finite.all() and finite[as_faces(faces, len(raw))].all():
            return finite
    return None


def _unscaled(value: float, scale: float, power: int) -> float:
    for _ in range(power):
        value /= scale
    return float(value)


def _repeated(first: Index) -> int:
    """Count rows that are equal to an earlier one."""
    return int((first != np.arange(len(first))).sum())


def _diagnose_cloud(surface: Surface) -> dict[str, Any]:
    names = [
        *("edges", "boundary_edges", "boundary_loops", "nonmanifold_edges", "components"),
        *("nonmanifold_vertices", "inconsistent_edges", "duplicate_faces", "degenerate_faces"),
        "unused_vertices",
    ]
    values: dict[str, Any] = dict.fromkeys(names, 0)
    values |= {"closed": False, "genus": None, "orientation": "none", "area": 0.0, "volume": None}
    nearest = np.empty(0)
    if surface.point_count > 1:
        nearest = surface.nearest_distances
    return values | _lengths(nearest)


def _lengths(lengths: FloatArray) -> dict[str, float]:
    if len(lengths) == 0:
        return {"spacing": 0.0, "min_edge": 0.0, "max_edge": 0.0}
    low, mean, high = lengths.min(), lengths.mean(), lengths.max()
    return {"spacing": float(mean), "min_edge": float(low), "max_edge": float(high)}


def _diagnose_faces(surface: Surface) -> dict[str, Any]:
    faces = surface.faces
    assert faces is not None
    values: dict[str, Any] = {
        "duplicate_faces": _repeated(surface.topology.first_equal_face),
        "degenerate_faces": int(surface.flat_faces.sum()),
        "unused_vertices": int((~surface.used_points).sum()),
        "area": surface.area,
    }
    if values["degenerate_faces"]:
        a, b, c = faces.T
        proper = (a != b) & (b != c) & (c != a)
        if not proper.any():
            return _diagnose_cloud(Surface.of_checked(surface.points)) | values
        if not proper.all():
            surface = Surface.of_checked(surface.points, faces[proper])
    return values | _lengths(surface.edge_lengths) | _topology(surface) | _facing(surface)


def _topology(surface: Surface) -> dict[str, Any]:
    table = surface.edge_table
    single, many = table.single, table.counts > 2
    inconsistent = int((~table.pairs[2]).sum())
    if surface.topology.is_solid:  # one fan a vertex
        several, loops, fans = 0, 0, int(np.count_nonzero(surface.used_points))
    else:
        fan = surface.topology.corner_fans()
        fans = int(fan.max()) + 1
        several, loops = _split_vertices(surface, fan), _loops(single, fan, fans)
    genus = None
    orientable = not inconsistent or not agreeing_flips(surface)[1].any()
    if not many.any() and not several and orientable:
        # Euler characteristic with b boundary loops: V - E + F = 2 C - 2 g - b. Each vertex in use
        # has one fan here.
        euler = fans - len(table.counts) + surface.face_count
        genus = (2 * surface.part_count - loops - euler) // 2
    return {
        "edges": len(table.counts),
        "closed": len(single) == 0,
        "boundary_edges": len(single),
        "boundary_loops": loops,
        "nonmanifold_edges": int(many.sum()),
        "nonmanifold_vertices": several,
        "components": surface.part_count,
        "genus": genus,
        "inconsistent_edges": inconsistent,
    }


def _split_vertices(surface: Surface, fan: IntArray) -> int:
    """Count vertices whose fans stay apart when also joined across non-manifold edges."""
    assert surface.faces is not None
    table, fans = surface.edge_table, int(fan.max()) + 1
    fan_vertex = np.empty(fans, np.int64)
    fan_vertex[fan] = surface.faces.ravel()
    if (table.counts > 2).any():
        edge = np.repeat(np.arange(len(table.counts)), table.counts)
        half = table.order[table.counts[edge] > 2]
        edge = edge[table.counts[edge] > 2]
        anchor = np.empty((2, len(table.counts)), np.int64)
        links = []
        for end, at_start in ((0, table.forward[half]), (1, ~table.forward[half])):
            touching = fan[np.where(at_start, half, next_side(half))]
            anchor[end, edge] = touching
            links.append(np.stack([touching, anchor[end, edge]], axis=1))
        group = piece_labels(fans, np.concatenate(links))
        fan_vertex = fan_vertex[np.unique(group, return_index=True)[1]]
    return int((np.bincount(fan_vertex) > 1).sum())


def _loops(single: IntArray, fan: IntArray, fans: int) -> int:
    """Count boundary loops: boundary edges chained through the fans at their ends."""
    if len(single) == 0:
        return 0
    ends = np.stack([fan[single], fan[next_side(single)]], axis=1)
    there = np.zeros(fans, bool)
    there[ends] = True
    return int(piece_labels(fans, ends).max()) + 1 - int(np.count_nonzero(~there))


def _facing(surface: Surface) -> dict[str, Any]:
    """Return orientation and volume."""
    from medialis.shape._kernels import add_corners, measure_tetrahedra

    assert surface.faces is not None
    counts = surface.edge_table.counts
    if not surface.edge_table.pairs[2].all():
        return {"orientation": "mixed", "volume": None}
    if (counts == 1).any():
        measured = piece_volumes(surface, surface.face_pieces)
        volume = float((measured.volume * np.abs(measured.sign)).sum())
        result: dict[str, Any] = {"orientation": _word(volume), "volume": None}
    else:
        # Pieces that meet at non-manifold edges are closed together, so one apex serves them all.
        every = np.zeros(surface.face_count, np.int32)
        middle, corners = np.zeros((1, 3)), np.zeros(1, np.int64)
        add_corners(surface.points, surface.faces, every, middle, corners)
        tetra, apex = np.empty(surface.face_count), middle[0] / corners[0]
        measure_tetrahedra(surface.points, surface.faces, surface.face_vectors, apex, tetra)
        volume = float(tetra.sum())
        clear = abs(volume) > 1e-9 * np.abs(tetra).sum()
        result = {"orientation": _word(volume * clear), "volume": volume}
    if (counts > 2).any():
        # Of three faces at an edge, two run along it in the same direction.
        result["orientation"] = "mixed"
    return result


def _word(volume: float) -> str:
    return "out" if volume > 0 else "in" if volume < 0 else "none"
