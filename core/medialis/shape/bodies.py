"""Bodies of a surface: the solids that it bounds, and where they touch.

A body is a closed component with the cavities in it. Components that are not closed are one body
together, as they may be faces of one part. Bodies that interpenetrate are one body: where the parts
of a character overlap, the surface of each lies inside of others. An overlap as shallow as `HAIR`
does not join bodies: pins are pressed into bores, and exchange formats round positions.

The relation of two bodies follows from signed distances of points of one body to the triangles of
the other one, for pairs whose bounding boxes meet. Facets of round bodies are chords of a smooth
surface (`Creases.own_bulges`), and distances are those of the smooth surfaces: a pin touches its
bore even where both have other facets.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from medialis.base.arrays import Described, Index, Mask, kd_tree, sums_of
from medialis.base.box_tree import NearestTree, nearest_on_triangles
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.surface import Surface, piece_labels

if TYPE_CHECKING:
    from medialis.shape.shape import Shape

CONTACT = 1e-5
"""Fraction of the diagonal: bodies less far apart touch. 1 um of a part of 100 mm: machines leave
no such gap."""

HAIR = 2e-3
"""Fraction of the diagonal: bodies that overlap by more are one body."""

NEAR = 1e-2
"""Fraction of the diagonal: balls of bodies less far apart are computed apart from each other. Half
the distance of samples: more than any ball passes a surface by."""

UNSURE = 0.3
"""Fraction of the height of the smooth surface over a facet that this height may be wrong by."""

GRID = 0.03
"""Fraction of the diagonal: spacing of points on large faces, for the comparison with others."""

MAX_GRID = 100
"""Points along the longest side of a face, or across it, at most."""

PROBES = 9
"""Vertices of a component that tell whether it lies in another one."""


@dataclass(frozen=True, eq=False, repr=False)
class Contact(Described):
    """Where two bodies touch.

    Attributes
    ----------
    bodies : (int, int)
        Their numbers, the lower one first.
    gap : float
        Least distance of the two surfaces; negative where they overlap.
    area : float
        Area of the surface of one of them that touches the other one.
    """

    bodies: tuple[int, int]
    gap: float
    area: float


@dataclass(frozen=True, eq=False, repr=False)
class Bodies(Described):
    """The bodies of a surface of n points.

    Attributes
    ----------
    count : int
    label : (n,) int32
        Body of each point, numbered by their lowest point; 0 everywhere in a cloud.
    touches : (n,) int32
        A body that each point touches, -1 for none.
    contacts : tuple of Contact
        Pairs of bodies that touch, by their numbers.
    near : (p, 2) int
        Pairs of bodies that touch or nearly do.
    """

    count: int
    label: IntArray
    touches: IntArray
    contacts: tuple[Contact, ...]
    near: Index

    @property
    def turns(self) -> Index:
        """Number of each body, (count,), such that bodies that are near have different ones."""
        neighbours: list[list[int]] = [[] for _ in range(self.count)]
        for one, other in self.near.tolist():
            neighbours[one].append(other)
            neighbours[other].append(one)
        turn = np.full(self.count, -1, np.int64)
        for body, around in enumerate(neighbours):
            taken = {int(turn[other]) for other in around}
            turn[body] = next(k for k in range(self.count) if k not in taken)
        return turn


def find_bodies(surface: Surface) -> Bodies:
    """Find the bodies of a surface, and where they touch.

    Notes
    -----
    Cost O(n) where there is one component; else O(q log m) for q points in the bounding boxes of
    other bodies.
    """
    label = np.zeros(surface.point_count, np.int32)
    if surface.faces is None or surface.part_count < 2:
        return _alone(label)
    label, closed = _with_cavities(surface)
    pairs = _meeting_pairs(surface, label, len(closed))
    bulges, of_face = _bulges(surface) if len(pairs) else None, label[surface.topology.faces[:, 0]]
    solids = {
        k: _Solid(surface, np.flatnonzero(of_face == k), bulges) for k in np.unique(pairs).tolist()
    }
    meetings = {}
    for a, b in pairs.tolist():
        for one, other in ((a, b), (b, a)):
            given = solids[one], solids[other], bool(closed[other]), surface.diagonal
            meetings[one, other] = _Meeting.of(*given)
    depths = [max(meetings[a, b].depth, meetings[b, a].depth) for a, b in pairs.tolist()]
    deep = np.array(depths) > HAIR * surface.diagonal
    joined = piece_labels(len(closed), pairs[deep])
    return _numbered(label, joined, pairs, meetings, surface.diagonal)


def _numbered(
    label: IntArray,
    joined: IntArray,
    pairs: Index,
    meetings: dict[tuple[int, int], _Meeting],
    diagonal: float,
) -> Bodies:
    """Return the bodies in the order of their lowest points, and where they touch."""
    body = joined[label]
    _, first, number = np.unique(body, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    of_part = np.zeros(len(joined), np.int64)
    of_part[label] = rank[number]
    touches, near, contacts = (
        np.full(len(label), -1),
        set(),
        dict[tuple[int, int], list[_Meeting]](),
    )
    for a, b in pairs.tolist():
        low, high = sorted((int(of_part[a]), int(of_part[b])))
        key = low, high
        if low == high:
            continue
        both = meetings[a, b], meetings[b, a]
        if min(one.gap for one in both) <= NEAR * diagonal:
            near.add(key)
        for one, other in zip(both, (b, a), strict=True):
            touches[one.touching] = of_part[other]
        if any(len(one.touching) or one.area > 0 for one in both):
            contacts.setdefault(key, []).extend(both)
    told = tuple(
        Contact(key, min(one.gap for one in met), 0.5 * sum(one.area for one in met))
        for key, met in sorted(contacts.items())
    )
    return Bodies(
        len(first),
        frozen(of_part[label], np.int32),
        frozen(touches, np.int32),
        told,
        np.array(sorted(near), np.int64).reshape(-1, 2),
    )


def _alone(label: IntArray) -> Bodies:
    touches, none = np.full(len(label), -1), np.empty((0, 2), np.int64)
    return Bodies(1, frozen(label, np.int32), frozen(touches, np.int32), (), none)


def _with_cavities(surface: Surface) -> tuple[IntArray, Mask]:
    """Provisional body of each point, (n,), and whether each body is closed.

    Cavities belong to the smallest closed component round them. Points without faces are in body 0.
    """
    faces = surface.topology.faces
    used = np.unique(surface.components[faces[:, 0]])
    number = np.zeros(int(surface.components.max()) + 1, np.int64)
    number[used] = np.arange(len(used))
    part = number[surface.components]
    of_face = part[faces[:, 0]]
    closed, volume = _closed_parts(surface, of_face, len(used))
    label = np.arange(len(used))
    for inner in np.flatnonzero(closed & (volume < 0)).tolist():
        around = _around(surface, part, of_face, inner, closed & (volume > 0))
        label[inner] = inner if around is None else around
    if (~closed).any():
        label[~closed] = np.flatnonzero(~closed)[0]
    bodies, label = np.unique(label, return_inverse=True)
    return label[part].astype(np.int32), closed[bodies]


def _closed_parts(surface: Surface, of_face: Index, count: int) -> tuple[Mask, FloatArray]:
    """Parts along whose edges as many faces run one way as the other; their signed volumes."""
    table = surface.edge_table
    direction = np.where(table.forward[table.order], 1, -1)
    open_edges = np.add.reduceat(direction, table.first[:-1]) != 0
    closed: Mask = np.ones(count, np.bool_)
    closed[of_face[table.order[table.first[:-1][open_edges]] // 3]] = False
    corners = surface.points[surface.topology.faces]
    sizes = np.bincount(of_face, minlength=count)
    middle = sums_of(of_face, corners.mean(axis=1), count) / sizes[:, None]
    corners = corners - middle[of_face][:, None]
    volume = np.einsum("fa,fa->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return closed, np.asarray(np.bincount(of_face, volume, count), np.float64)


def _around(surface: Surface, part: Index, of_face: Index, inner: int, outward: Mask) -> int | None:
    """Return the smallest outward part round a part, None without one."""
    points = surface.points[part == inner]
    low, high = points.min(axis=0), points.max(axis=0)
    probes = points[:: max(1, len(points) // PROBES)]
    found, smallest = None, np.inf
    for outer in np.flatnonzero(outward).tolist():
        mine = surface.points[part == outer]
        size = float(np.linalg.norm(np.ptp(mine, axis=0)))
        if size >= smallest or (mine.min(axis=0) > low).any() or (mine.max(axis=0) < high).any():
            continue
        solid = _Solid(surface, np.flatnonzero(of_face == outer))
        if np.median(solid.distances(probes)[0]) < 0:
            found, smallest = outer, size
    return found


class _Solid:
    """Some faces of a surface, and how far points lie outside of them."""

    def __init__(self, surface: Surface, faces: Index, bulges: FloatArray | None = None) -> None:
        from medialis.shape.normals import ring_normals

        used, place = np.unique(surface.topology.faces[faces], return_inverse=True)
        corners: IntArray = frozen(place.reshape(-1, 3).astype(np.int32), np.int32)
        self.vertices = np.asarray(used, np.int64)
        self.mesh = Surface.of_checked(surface.points[used], corners)
        self.bulges = np.zeros((len(faces), 3)) if bulges is None else bulges[faces]
        self._tree = NearestTree.of_triangles(self.mesh.points, corners)
        self._normals = ring_normals(self.mesh.points, corners, smooth=False)

    def distances(self, places: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compare positions with the smooth surface.

        Parameters
        ----------
        places : (q, 3) float64

        Returns
        -------
        distance : (q,) float64
            Signed distance of the positions, negative inside.
        height : (q,) float64
            How far the smooth surface lies off the facet there, counted outward.
        normals : (q, 3) float64
            Outward directions there, not of unit length.
        """
        places = np.ascontiguousarray(places)
        row = self._tree.distances(places)[1].astype(np.int64)
        corners = self.mesh.points[self.mesh.topology.faces[row]]
        weights = nearest_on_triangles(places, corners)
        away = places - np.einsum("qj,qja->qa", weights, corners)
        normals = self._normals_at(row, weights)
        outward = np.sign(np.einsum("qa,qa->q", away, normals))
        height = self.heights(row, weights)
        return np.linalg.norm(away, axis=1) * outward - height, height, normals

    @cached_property
    def longest_edge(self) -> float:
        """Length of the longest edge."""
        return float(self.mesh.edge_lengths.max(initial=0.0))

    def holds(self, mesh: Surface, far: Mask) -> bool:
        """Return whether vertices of a mesh, all far from this surface, are inside.

        Vertices that edges join are on the same side: one of each group is compared.
        """
        if not far.any():
            return False
        links = mesh.edges[far[mesh.edges].all(axis=1)]
        groups = np.where(far, piece_labels(mesh.point_count, links), -1)
        first = np.unique(groups, return_index=True)[1]
        return bool((self.distances(mesh.points[first[far[first]]])[0] < 0.0).any())

    def heights(self, faces: Index, weights: FloatArray) -> FloatArray:
        """Return how far the smooth surface lies outward of positions on faces, (q,)."""
        sides = weights * np.roll(weights, -1, axis=1)
        return np.asarray(np.einsum("qj,qj->q", sides, self.bulges[faces]))

    def _normals_at(self, row: Index, weights: FloatArray) -> FloatArray:
        """Return normals at positions on faces that tell inside from outside, (q, 3).

        Within a face its normal, on an edge the sum of both, at a vertex the mean by angles
        (Baerentzen and Aanaes 2005).
        """
        mesh = self.mesh
        result = np.array(mesh.face_normals[row])
        zeros = (weights == 0.0).sum(axis=1)
        edge = np.flatnonzero(zeros == 1)
        side = (np.argmax(weights[edge] == 0.0, axis=1) + 1) % 3
        twin = mesh.edge_twins[3 * row[edge] + side]
        result[edge[twin >= 0]] += mesh.face_normals[twin[twin >= 0] // 3]
        corner = np.flatnonzero(zeros == 2)
        vertex = mesh.topology.faces[row[corner], np.argmax(weights[corner], axis=1)]
        known = self._normals[vertex].any(axis=1)
        result[corner[known]] = self._normals[vertex[known]]
        return result


def _bulges(surface: Surface) -> FloatArray | None:
    """`Creases.own_bulges` of a shape, (m, 3); None of a surface without normals."""
    from medialis.shape.creases import find_creases
    from medialis.shape.normals import CREASE_ANGLE
    from medialis.shape.shape import Shape

    if not isinstance(surface, Shape):
        return None
    return find_creases(surface, CREASE_ANGLE).own_bulges


@dataclass(frozen=True, eq=False)
class _Meeting:
    """How one body lies to another one.

    Attributes
    ----------
    depth : float
        How deep it lies in the other one, beyond what facets explain.
    gap : float
        Least signed distance.
    area : float
        Area that touches the other one.
    touching : (k,) int64
        Vertices that do.
    """

    depth: float
    gap: float
    area: float
    touching: Index

    @classmethod
    def of(cls, one: _Solid, other: _Solid, closed: bool, diagonal: float) -> _Meeting:
        """Compare vertices and faces of one body with another one, with signs where it is closed.

        `diagonal` is that of the whole.
        """
        reach = max(NEAR * diagonal, 0.5 * one.longest_edge) + other.longest_edge
        low, high = other.mesh.bounds[0] - reach, other.mesh.bounds[1] + reach
        within = (one.mesh.points >= low) & (one.mesh.points <= high)
        inside = np.asarray(within[:, 0] & within[:, 1] & within[:, 2])
        rows = np.flatnonzero(inside)
        near = np.zeros(len(inside), np.bool_)
        near[rows] = np.isfinite(
            other.mesh.tree.query(one.mesh.points[rows], distance_upper_bound=reach)[0]
        )
        if closed and other.holds(one.mesh, inside & ~near):
            return cls(np.inf, -np.inf, 0.0, rows[:0])
        vertices: Index = np.flatnonzero(near)
        on_faces = _places(one, near, GRID * diagonal)
        count = len(vertices)
        if count + len(on_faces.faces) == 0:
            return cls(-np.inf, np.inf, 0.0, vertices)
        places = np.concatenate([one.mesh.points[vertices], on_faces.places])
        distance, height, normals = other.distances(places)
        slack = np.abs(height)
        slack[count:] += np.abs(on_faces.heights)
        slack *= UNSURE
        deep = float((-distance - slack).max()) if closed else -np.inf
        distance = distance if closed else np.abs(distance)
        touching = distance <= CONTACT * diagonal + slack
        facing = np.einsum("qa,qa->q", one.mesh.face_normals[on_faces.faces], normals[count:])
        facing = facing < -0.5 * np.linalg.norm(normals[count:], axis=1)
        area = float(on_faces.areas[touching[count:] & facing].sum())
        return cls(deep, float(distance.min()), area, one.vertices[vertices[touching[:count]]])


class _Places(NamedTuple):
    """Positions on the smooth surface over faces, their faces, heights over them, and areas."""

    places: FloatArray
    faces: Index
    heights: FloatArray
    areas: FloatArray


def _places(solid: _Solid, near: Mask, spacing: float) -> _Places:
    """Spread positions over the faces of a body with a vertex that is near the other body."""
    mesh = solid.mesh
    rows = np.flatnonzero(near[mesh.topology.faces].any(axis=1))
    corners = mesh.points[mesh.topology.faces[rows]]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    first, longest = sides.argmax(axis=1), sides.max(axis=1)
    height = 2.0 * mesh.face_areas[rows] / np.maximum(longest, 1e-300)
    along, across = (
        np.clip(np.ceil(length / spacing), 1, MAX_GRID).astype(np.int64)
        for length in (longest, height)
    )
    found = [_Places(np.empty((0, 3)), rows[:0], np.empty(0), np.empty(0))]
    for k in np.unique(along * (MAX_GRID + 1) + across).tolist():
        count = divmod(k, MAX_GRID + 1)
        mine = np.flatnonzero((along == count[0]) & (across == count[1]))
        weights, shares = _grid(*count)
        turn = (np.arange(3) - first[mine, None]) % 3
        spread = weights[:, turn].transpose(1, 0, 2).reshape(-1, 3)
        faces = np.repeat(rows[mine], len(weights))
        heights = solid.heights(faces, spread)
        places = np.einsum("qj,qja->qa", spread, np.repeat(corners[mine], len(weights), axis=0))
        places += heights[:, None] * mesh.face_normals[faces]
        areas = mesh.face_areas[faces] * np.tile(shares, len(mine))
        found.append(_Places(places, faces, heights, areas))
    columns: list[Any] = [np.concatenate(column) for column in zip(*found, strict=True)]
    return _Places(*columns)


def _grid(along: int, across: int) -> tuple[FloatArray, FloatArray]:
    """Return positions along and across the first side of a face, (k, 3), and shares of its area.

    As barycentric coordinates.
    """
    u = np.tile((np.arange(along) + 0.5) / along, across)
    v = np.repeat((np.arange(across) + 0.5) / across, along)
    weights = np.stack([(1.0 - v) * (1.0 - u), (1.0 - v) * u, v], axis=1)
    return weights, 2.0 * (1.0 - v) / (along * across)


def _meeting_pairs(surface: Surface, label: IntArray, count: int) -> Index:
    """Pairs of bodies whose bounding boxes nearly meet, (p, 2), the lower number first."""
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(count))
    points = surface.points[order]
    reach = 0.5 * NEAR * surface.diagonal
    low = np.minimum.reduceat(points, starts) - reach
    high = np.maximum.reduceat(points, starts) + reach
    pairs = []
    for one in range(count - 1):
        meets = (low[one] <= high[one + 1 :]).all(axis=1) & (high[one] >= low[one + 1 :]).all(
            axis=1
        )
        pairs.append(np.stack([np.full(int(meets.sum()), one), one + 1 + np.flatnonzero(meets)], 1))
    return np.concatenate(pairs) if pairs else np.empty((0, 2), np.int64)


def bodies_apart(shape: Shape) -> list[tuple[Shape, Index, Index]]:
    """Divide a mesh into parts in which no bodies are near each other.

    Returns
    -------
    list of (Shape, (k,) int64, (f,) int64)
        Each part with its points and faces; the mesh itself where no bodies are near.
    """
    bodies = shape.body_contacts
    turn = bodies.turns
    if turn.max(initial=0) == 0:
        return [(shape, np.arange(shape.point_count), np.arange(shape.face_count))]
    return [shape.some_bodies(turn[bodies.label] == k) for k in range(int(turn.max()) + 1)]


EQUALLY_NEAR, MOST_EQUAL = 1e-6, 12
"""Relative difference of distances that are equal, and how many of them are compared."""


def nearest_in_body(surface: Surface, known: Index, queries: Index, values: FloatArray) -> Index:
    """Return the nearest of some known points in the same body for each query, (q,).

    Parameters
    ----------
    surface : Surface
    known : (k,) int64
        Rows of points, at least one.
    queries : (q,) int64
        Rows of points. Those whose body has no known point get the nearest one of all.
    values : (n,) float64
        Of equally near points the one with the largest value is taken, so that the result does not
        depend on rounding.
    """
    points, label = surface.points, surface.bodies
    result = np.full(len(queries), -1, np.int64)
    for body in np.unique(label[queries]).tolist():
        own, rows = known[label[known] == body], np.flatnonzero(label[queries] == body)
        own = own if len(own) else known
        count = np.arange(1, min(MOST_EQUAL, len(own)) + 1)
        distance, near = kd_tree(points[own]).query(points[queries[rows]], k=count)
        equal = distance <= (1.0 + EQUALLY_NEAR) * distance[:, :1]
        best = np.where(equal, values[own[near]], -np.inf).argmax(axis=1)
        result[rows] = own[near[np.arange(len(rows)), best]]
    return result
