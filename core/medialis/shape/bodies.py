"""Bodies of a surface: the solids that it bounds, and where they touch.

A body is a closed component with the cavities in it. Components that are not closed are one body
together, as they may be faces of one part. Bodies that interpenetrate are one body: where the parts
of a character overlap, the surface of each lies inside of others. An overlap as shallow as `HAIR`
does not join bodies: pins are pressed into bores, and exchange formats round positions.

What lies where is told by signed distances: points of one body against the triangles of another
one, of those pairs alone whose bounding boxes meet. Facets of round bodies lie off the smooth
surface; `_sagittas` says how far, so that a pin and a bore of other facets touch, too.
"""

from __future__ import annotations

from dataclasses import dataclass
import numpy as np

from medialis.base.arrays import Described, Index, Mask, next_side, sums_of
from medialis.base.box_tree import NearestTree, nearest_on_triangles
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.surface import Surface, piece_labels

CONTACT = 1e-5
"""Fraction of the diagonal: bodies less far apart touch. 1 um of a part of 100 mm: machines leave
no such gap."""

HAIR = 2e-3
"""Fraction of the diagonal: bodies that overlap by more are one body."""

NEAR = 1e-2
"""Fraction of the diagonal: balls of bodies less far apart are computed apart from each other. Half
the distance of samples: more than any ball passes a surface by."""

SMOOTH_BEND = np.radians(50.0)
"""Edges that bend by less may be those of a round surface: of a cylinder of eight facets and more."""

GRID = 0.03
"""Fraction of the diagonal: distance of points on large faces that are compared with other bodies."""

MAX_GRID = 24
"""Points along the side of a face, at most."""

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
    sagittas, of_face = _sagittas(surface), label[surface.topology.faces[:, 0]]
    solids = {k: _Solid(surface, np.flatnonzero(of_face == k)) for k in np.unique(pairs).tolist()}
    meetings = {}
    for a, b in pairs.tolist():
        for one, other in ((a, b), (b, a)):
            given = surface, solids[one], solids[other], bool(closed[other]), sagittas
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
    """Number the bodies by their lowest point, and list where they touch."""
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
        key = tuple(sorted((int(of_part[a]), int(of_part[b]))))
        if key[0] == key[1]:
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
    closed = np.ones(count, np.bool_)
    closed[of_face[table.order[table.first[:-1][open_edges]] // 3]] = False
    corners = surface.points[surface.topology.faces]
    sizes = np.bincount(of_face, minlength=count)
    middle = sums_of(of_face, corners.mean(axis=1), count) / sizes[:, None]
    corners = corners - middle[of_face][:, None]
    volume = np.einsum("fa,fa->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return closed, np.bincount(of_face, volume, count)


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

    def __init__(self, surface: Surface, faces: Index) -> None:
        from medialis.shape.normals import ring_normals

        used, corners = np.unique(surface.topology.faces[faces], return_inverse=True)
        self.vertices, self.faces = used, faces
        self.mesh = Surface.of_checked(
            surface.points[used], corners.reshape(-1, 3).astype(np.int32)
        )
        self._tree = NearestTree.of_triangles(self.mesh.points, self.mesh.topology.faces)
        self._normals = ring_normals(self.mesh.points, self.mesh.topology.faces, smooth=False)

    def distances(self, places: FloatArray) -> tuple[FloatArray, Index, FloatArray]:
        """Return signed distances of places (q, 3), negative inside, nearest faces and normals."""
        _, row = self._tree.distances(places)
        corners = self.mesh.points[self.mesh.topology.faces[row]]
        weights = nearest_on_triangles(places, corners)
        away = places - np.einsum("qj,qja->qa", weights, corners)
        normals = self._normals_at(row, weights)
        outward = np.einsum("qa,qa->q", away, normals)
        return np.linalg.norm(away, axis=1) * np.sign(outward), row, normals

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


def _sagittas(surface: Surface) -> FloatArray:
    """How far the smooth surface may lie off each face, (m,), where its edges bend little.

    A chord of width w between chords at an angle a lies w a / 8 off its circle, an equilateral
    triangle on a sphere up to 2.7 times as much as its height and bends tell by that; half of it
    is in between.
    """
    first, second, opposite = surface.edge_table.pairs
    bends = np.where(opposite & (surface.edge_bends < SMOOTH_BEND), surface.edge_bends, 0.0)
    corner = surface.topology.faces.ravel()
    sides = surface.points[corner[next_side(first)]] - surface.points[corner[first]]
    length = np.maximum(np.linalg.norm(sides, axis=1), 1e-300)
    result = np.zeros(surface.face_count)
    for half in (first, second):
        height = 2.0 * surface.face_areas[half // 3] / length
        np.maximum.at(result, half // 3, bends * height / 6.0)
    return result


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
    def of(
        cls, surface: Surface, one: _Solid, other: _Solid, closed: bool, sagittas: FloatArray
    ) -> _Meeting:
        """Compare the vertices and faces of one body with another one; signs where it is closed."""
        reach = NEAR * surface.diagonal
        low, high = other.mesh.bounds[0] - reach, other.mesh.bounds[1] + reach
        inside = ((one.mesh.points >= low) & (one.mesh.points <= high)).all(axis=1)
        vertices = np.flatnonzero(inside)
        places, faces, areas = _face_places(one.mesh, low, high, GRID * surface.diagonal)
        count = len(vertices)
        if count + len(places) == 0:
            return cls(-np.inf, np.inf, 0.0, vertices)
        distance, row, normals = other.distances(
            np.concatenate([one.mesh.points[vertices], places])
        )
        slack = sagittas[other.faces[row]]
        slack[count:] += sagittas[one.faces[faces]]
        deep = float((-distance - slack).max()) if closed else -np.inf
        distance = distance if closed else np.abs(distance)
        touching = distance <= CONTACT * surface.diagonal + slack
        facing = np.einsum("qa,qa->q", one.mesh.face_normals[faces], normals[count:])
        lengths = np.linalg.norm(normals[count:], axis=1)
        area = float(areas[touching[count:] & (facing < -0.5 * lengths)].sum())
        return cls(deep, float(distance.min()), area, one.vertices[vertices[touching[:count]]])


def _face_places(
    mesh: Surface, low: FloatArray, high: FloatArray, spacing: float
) -> tuple[FloatArray, Index, FloatArray]:
    """Points on the faces of a mesh within a box: positions, their faces, the area of each."""
    corners = mesh.points[mesh.topology.faces]
    inside = (corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)
    rows = np.flatnonzero(inside.all(axis=1))
    sides = np.linalg.norm(corners[rows] - np.roll(corners[rows], 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(sides / spacing), 1, MAX_GRID).astype(np.int64)
    places, faces, areas = [], [], []
    for k in np.unique(parts).tolist():
        mine, weights = rows[parts == k], _middles(k)
        places.append(np.einsum("wj,fja->fwa", weights, corners[mine]).reshape(-1, 3))
        faces.append(np.repeat(mine, len(weights)))
        areas.append(np.repeat(mesh.face_areas[mine] / len(weights), len(weights)))
    if not places:
        return np.empty((0, 3)), rows, np.empty(0)
    everywhere, faces_of, area = map(np.concatenate, (places, faces, areas))
    within = ((everywhere >= low) & (everywhere <= high)).all(axis=1)
    return everywhere[within], faces_of[within], area[within]


def _middles(parts: int) -> FloatArray:
    """Return barycentric coordinates of the middles of the parts of a face, (parts^2, 3)."""
    i, j = (g.ravel() for g in np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij"))
    up, down = i + j < parts, i + j < parts - 1
    first = np.stack([i[up] + 1 / 3, j[up] + 1 / 3], axis=1)
    second = np.stack([i[down] + 2 / 3, j[down] + 2 / 3], axis=1)
    two = np.concatenate([first, second]) / parts
    return np.column_stack([two, 1.0 - two.sum(axis=1)])


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
