"""Repair that moves no vertex: weld (welding.py), drop what is useless, face outward (before 3.2).

A flat face a, b, c of three different corners has c on the segment a b. Dropping it would open a
slit between its neighbours. Its neighbour b, a, d across the longest edge covers the same segment,
so replacing both by c, a, d and d, b, c leaves the surface exactly as it is, with no flat face.
Flat faces are rare, so this is a plain loop over them; each round turns edges of faces not yet
touched in it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described, EdgeTable, Index, Mask
from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Message
from medialis.base.validation import FloatArray, IntArray, as_faces, as_normals, as_points, frozen
from medialis.shape.diagnosis import (
    Examined,
    agreeing_flips,
    faces_to_drop,
    finite_points,
    flipped,
    outward_flips,
    piece_volumes,
    power_of_two_scale,
    repeated_bodies,
    scaled,
    solid_pieces,
)
from medialis.shape.surface import Surface
from medialis.shape.welding import Weld, weld

_ROUNDS = 30
_APART = np.arange(6, dtype=np.int32).reshape(2, 3)


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
        flat = Surface.of_checked(surface.points, faces).flat_faces
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
        if Surface.of_checked(points[new.ravel()], _APART).flat_faces.any():
            continue
        faces[[face, other // 3]] = new
        source[face] = source[other // 3]
        edges.add((min(c, d), max(c, d)))
        touched.update((face, other // 3))
        done += 1
    return done


PLURALS = {"vertex": "vertices", "cavity": "cavities"}


@dataclass(frozen=True, eq=False, repr=False)
class Repair(Described):
    """A repaired mesh or cloud and where its parts come from.

    Attributes
    ----------
    points : (n, 3) float64
        The kept points, in their old order, none moved.
    faces : (m, 3) int32 or None
        None when no faces were given.
    normals : (n, 3) float64 or None
        Unit normals, a zero row where a point has none; None when none were given.
    vertex_map : (n_in,) int32
        The point that each input point became, -1 for a dropped one.
    face_map : (m,) int32
        The input face that each face comes from (lies in).
    messages : tuple of Message
        One sentence for each thing done or noticed; empty for a clean input.
    """

    points: FloatArray
    faces: IntArray | None
    normals: FloatArray | None
    vertex_map: IntArray
    face_map: IntArray
    messages: tuple[Message, ...]


def joined_corners(
    points: FloatArray, faces: IntArray | None
) -> tuple[FloatArray, IntArray | None, tuple[Message, ...]]:
    """Return points and faces with welded vertices, and what was done beyond exact welding.

    Only where each triangle has three corners of its own, as STL files store them: these do not say
    which triangles are connected.

    Examples
    --------
    >>> soup = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    >>> points, faces, _ = joined_corners(soup, np.arange(6, dtype=np.int32).reshape(2, 3))
    >>> len(points), faces.tolist()
    (4, [[0, 1, 2], [1, 3, 2]])
    """
    if faces is None or len(points) != faces.size:
        return points, faces, ()
    if not np.array_equal(np.sort(faces, axis=None), np.arange(len(points))):
        return points, faces, ()
    joined = _welded(points, scaled(points, faces))
    messages = tuple(note for note in joined.messages if note.code != "welded")
    return points[joined.first], joined.faces, messages


def _welded(points: FloatArray, surface: Surface, bodies: IntArray | None = None) -> Weld:
    """Weld a scaled surface of some points, with the distance in the units of these."""
    result = weld(surface, bodies)
    return replace(result, distance=result.distance / power_of_two_scale(points))


def repair(
    points: ArrayLike, faces: ArrayLike | None = None, normals: ArrayLike | None = None
) -> Repair:
    """Repair a mesh or cloud without moving a vertex, in this order.

    - Drop points with NaN or infinity.
    - Merge vertices at exactly the same position in components that are not closed, and boundary
      edges that rounding has parted; the first vertex stays, with the first normal that is not
      zero. Bodies that only touch are kept apart (see `medialis.shape.welding`). All points of a
      cloud at the same position are merged.
    - Drop faces with a repeated corner. A face of three different corners without height (at most
      1e-12 of its longest edge) is merged into its neighbour by turning their common edge, which
      changes no surface; it is dropped where that is impossible.
    - Keep one of the faces with the same corners, and one of the closed components that are equal.
      Small folds - faces lying on their own back that
      hang on a surface - are dropped whole, so that no boundary appears.
    - Drop vertices that no face uses (never the points of a cloud).
    - Flip faces so that neighbours across edges of exactly two faces agree on the outside; the side
      with more faces wins.
    - Turn pieces (faces joined across such edges, and open pieces that close each other) outward:
      closed ones by their signed volume, except cavities, which are inward pieces directly inside
      an outward one; open ones when their volume, closed by cones from the middle of the boundary,
      is more than a fifth of what its parts add up to without signs and more than 0.001 area^(3/2).
      Normals that then disagree with the faces of a turned piece are turned too.

    Parameters
    ----------
    points : (n, 3) array of numbers
        NaN and infinity only in points that no face uses.
    faces : (m, 3) integers, optional
    normals : (n, 3) array of numbers, optional

    Returns
    -------
    Repair
        Of a clean input: the same arrays, no messages.

    Raises
    ------
    InvalidShapeError
        When an array has a wrong shape or is out of range, a face uses a point that is not finite,
        or no point or face is left.

    See Also
    --------
    diagnose : says what is wrong.
    read_shape : does both.

    Examples
    --------
    >>> fixed = repair([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 1, 2], [0, 3, 1]])
    >>> fixed.faces.tolist(), fixed.vertex_map.tolist()
    ([[0, 1, 2]], [0, 1, 2, 1])
    """
    return repaired(points, faces, normals)[0]


def repaired(
    points: ArrayLike,
    faces: ArrayLike | None,
    normals: ArrayLike | None,
    examined: Examined | None = None,
    bodies: ArrayLike | None = None,
) -> tuple[Repair, Surface]:
    """Repair, given what `examine` found of the same arrays; return what is then known as well.

    `bodies` (m,) is the body of the file that each face belongs to, where the file stores that.
    """
    work = _Work.begin(points, faces, normals)
    known = None
    if examined is not None:
        surface = examined.surface
        if np.array_equal(work.faces, surface.topology.faces):
            work.faces, work.measured, known = surface.topology.faces, surface, examined.weld
    work.weld(known, None if bodies is None else np.asarray(bodies))
    if len(work.faces):
        work.drop_degenerate()
        work.drop_duplicate_faces()
        if len(work.faces) == 0:
            raise InvalidShapeError(
                f"none of the {work.given_faces} faces has an area: all are degenerate or lie on "
                "each other; check the mesh."
            )
        work.drop_unused()
        work.agree()
        work.turn_outward()
    return work.result(faces is not None), work.surface()


@dataclass(eq=False)
class _Work:
    """The state between the steps."""

    points: FloatArray
    faces: IntArray
    normals: FloatArray | None
    vertex_map: IntArray
    face_map: IntArray
    given_faces: int
    messages: list[Message]
    measured: Surface | None = None

    @classmethod
    def begin(cls, points: ArrayLike, faces: ArrayLike | None, normals: ArrayLike | None) -> _Work:
        """Check the arrays, and drop points that are not finite."""
        triangles: ArrayLike = np.empty((0, 3), np.int32) if faces is None else faces
        keep = finite_points(points, triangles)
        xyz = as_points(points if keep is None else np.where(keep[:, None], points, 0.0))
        n = len(xyz)
        checked = as_faces(triangles, n)
        vectors = None if normals is None else as_normals(normals, n)
        identity = np.arange(max(n, len(checked)), dtype=np.int32)
        work = cls(xyz, checked, vectors, identity[:n], identity[: len(checked)], len(checked), [])
        text = "Dropped {} with NaN or infinity."
        if keep is not None and work._note(text, "not_finite_dropped", "point", ~keep):
            work._keep_points(keep)
        return work

    def _note(self, text: str, code: str, noun: str, counted: ArrayLike) -> bool:
        """Record a sentence about what a mask or a number counts, if it counts any; tell whether.

        The noun names its data.
        """
        number, plural = int(np.sum(counted)), PLURALS.get(noun, f"{noun}s")
        words = f"{number} {noun if number == 1 else plural}"
        if number:
            self.messages.append(Message(text.format(words), code, **{plural.split()[-1]: number}))
        return number > 0

    def weld(self, known: Weld | None, bodies: NDArray[Any] | None) -> None:
        welded = known or _welded(self.points, self.surface(), bodies)
        self.messages += welded.messages
        if welded.faces is self.faces and len(welded.first) == len(self.points):
            return
        if self.normals is not None:
            kept = welded.first[welded.vertex_map]
            self.normals = _first_normals(self.normals, kept)[welded.first]
        self.points, self.faces = self.points[welded.first], welded.faces
        place = welded.vertex_map
        self.vertex_map = np.where(self.vertex_map < 0, -1, place[self.vertex_map])

    def drop_degenerate(self) -> None:
        if not self.surface().flat_faces.any():
            return
        a, b, c = self.faces.T
        keep = (a != b) & (b != c) & (c != a)
        if self._note("Dropped {} with a repeated corner.", "repeated_corners", "face", ~keep):
            self._keep_faces(keep)
        if len(self.faces) == 0:
            return
        surface = self.surface()
        flat = surface.flat_faces
        if not flat.any():
            return
        faces, source, turned = flip_flat_faces(surface, flat)
        text = "Merged {} without area into neighbours by turning an edge."
        if self._note(text, "flat_faces_merged", "face", turned):
            self.faces, self.face_map = faces, self.face_map[source]
        keep = ~self.surface().flat_faces
        if self._note("Dropped {} without area.", "flat_faces_dropped", "face", ~keep):
            self._keep_faces(keep)

    def surface(self) -> Surface:
        """Return the mesh as it is now, at a scale of about 1."""
        if self.measured is None or self.measured.topology.faces is not self.faces:
            self.measured = scaled(self.points, frozen(self.faces, np.int32))
            self.faces = self.measured.topology.faces
        return self.measured

    def drop_duplicate_faces(self) -> None:
        repeated, folds = faces_to_drop(self.surface().topology)
        repeated = repeated | repeated_bodies(self.surface())
        text = "Dropped {} of small folds that lie on their own back."
        some = self._note("Dropped {}.", "duplicates_dropped", "duplicate face", repeated)
        if self._note(text, "folds_dropped", "face", folds) or some:
            self._keep_faces(~(repeated | folds))

    def drop_unused(self) -> None:
        used = self.surface().used_points
        if self._note("Dropped {} that no face uses.", "unused_dropped", "vertex", ~used):
            self._keep_points(used)

    def agree(self) -> None:
        flip, one_sided = agreeing_flips(self.surface())
        text = "Flipped {} to agree with the neighbours on the outside."
        if self._note(text, "faces_flipped", "face", flip):
            self.faces = flipped(self.faces, flip)
        text = "{} in one-sided pieces, like a Moebius band, have no outside."
        self._note(text, "one_sided", "face", one_sided)

    def turn_outward(self) -> None:
        surface = self.surface()
        piece = solid_pieces(surface)
        measured = piece_volumes(surface, piece)
        one_sided = np.zeros(len(measured.closed), bool)
        a, _, opposite = surface.edge_table.pairs
        one_sided[piece[a[~opposite] // 3]] = True
        flip, cavity = outward_flips(surface, measured, one_sided, piece)
        closed, opened = flip & measured.closed, flip & ~measured.closed
        self._note("Turned {} outward.", "closed_turned", "closed piece", closed)
        text = "Turned {} outward, judging by the volume under the surface."
        self._note(text, "open_turned", "open piece", opened)
        self._note("Kept {} facing inward.", "cavities_kept", "cavity", cavity)
        if flip.any():
            self.faces = flipped(self.faces, flip[piece])
            self.surface().adopt_turned(surface, flip[piece])
            self._turn_normals(surface, flip, piece)

    def _turn_normals(self, before: Surface, flip: NDArray[np.bool_], piece: IntArray) -> None:
        """Turn the normals of turned pieces where they disagree with the turned faces."""
        if self.normals is None:
            return
        double = np.where(flip[piece][:, None], -before.face_vectors, before.face_vectors)
        alike = sum(np.einsum("ij,ij->i", self.normals[self.faces[:, i]], double) for i in range(3))
        wrong = flip & (np.bincount(piece, alike, len(flip)) < 0)
        turn = np.zeros(len(self.points), bool)
        turn[self.faces[wrong[piece]]] = True
        self.normals = np.where(turn[:, None], -self.normals, self.normals) + 0.0

    def _keep_points(self, keep: NDArray[np.bool_]) -> None:
        """Drop points that no face uses."""
        place = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
        self.points = self.points[keep]
        self.normals = None if self.normals is None else self.normals[keep]
        self.faces = place[self.faces]
        self.vertex_map = np.where(self.vertex_map < 0, -1, place[self.vertex_map])

    def _keep_faces(self, keep: NDArray[np.bool_]) -> None:
        self.faces, self.face_map = self.faces[keep], self.face_map[keep]

    def result(self, with_faces: bool) -> Repair:
        return Repair(
            frozen(self.points, np.float64),
            frozen(self.faces, np.int32) if with_faces else None,
            None if self.normals is None else frozen(self.normals, np.float64),
            frozen(self.vertex_map, np.int32),
            frozen(self.face_map, np.int32),
            tuple(self.messages),
        )


def _first_normals(normals: FloatArray, first: NDArray[np.int64]) -> FloatArray:
    """Give each first point the first normal among its equals that is not zero."""
    result = normals.copy()
    known = np.flatnonzero((normals != 0).any(axis=1))
    # Written from last to first, so the first one stays.
    missing = ~(normals[first[known]] != 0).any(axis=1)
    late = known[missing][::-1]
    result[first[late]] = normals[late]
    return result
