"""Unfolded: a surface whose every node has one normal and one ball (for thesis 6.2.2).

`unfold` cuts the surface along the creases that sheets end on, gives each sector of faces at a
crease a node of its own (`_nodes`), joins the sectors by strips of triangles between the balls of
fans along the other creases (`strips`), and finds the second contact of each node (`_contacts`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Mask, Ragged, next_side, twice_areas, unit_rows
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.validation import FloatArray, IntArray, frozen, hold
from medialis.shape.creases import Creases, find_creases
from medialis.shape.graph import mesh_graph, surface_graph
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.triangle_balls import angles_between

TANGENT = 0.95  # halved 22 %, doubled 30 %
"""Cosine, of 18 degrees: between a spoke and the normal of the wall that its ball touches."""

SAME_NORMAL = 1e-6  # halved 0 %, doubled 0 %
"""Radians: what rounding turns the normal of a ball of a fan, with room."""


@dataclass(frozen=True, eq=False, repr=False)
class Unfolded(Bound):
    """The surface as balls see it: cut along creases where sheets end, spread out along the others.

    A sample has one node. At a crease it has one for each smooth sector of faces, so that triangles
    on both sides end in balls of their own normal. Where the surface bends inward, strips of
    triangles between the balls of fans join the sectors; where it bends outward nothing does.

    Attributes
    ----------
    rows : (u,) int32
        Row of the cloud that holds the ball of each node.
    centers, radii : (u, 3) and (u,) float64
        Of the ball; the sample itself and 0 on a crease where a sheet ends.
    normals : (u, 3) float64
        Normal of the surface at the first contact: that of the sector.
    contacts, contact_normals : (u, 3) float64
        Second contact and the normal there: on such a crease, the sample and the normal across.
    regions : (u, 2) int32
        Region of the surface (`Creases.regions`) of the first and of the second contact.
    across : (u,) int32
        Node at the second contact, or the nearest one to it; -1 where there is none.
    faces : (t, 3) int32
        Triangles between nodes: those of the surface, then the strips; none of a point cloud.
    face_origin : (t,) int32
        Face of the surface that each triangle is, or lies beside.
    graph : Ragged
        Neighbours of each node, u rows.
    cloud : MedialCloud
        The balls.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    rows: IntArray
    centers: FloatArray
    radii: FloatArray
    normals: FloatArray
    contacts: FloatArray
    contact_normals: FloatArray
    regions: IntArray
    across: IntArray
    faces: IntArray
    face_origin: IntArray
    graph: Ragged
    cloud: MedialCloud = field(kw_only=True)

    def __post_init__(self) -> None:
        u, t = len(self.rows), len(self.faces)
        vectors = dict.fromkeys(("centers", "normals", "contacts", "contact_normals"), (u, 3))
        hold(self, rows=u, radii=u, regions=(u, 2), across=u, **vectors)
        hold(self, faces=(t, 3), face_origin=t)

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return f"Unfolded({len(self)} nodes, {len(self.faces)} triangles)"

    @cached_property
    def samples(self) -> IntArray:
        """Sample of each node, (u,)."""
        return frozen(self.cloud.source[self.rows], np.int32)

    @cached_property
    def points(self) -> FloatArray:
        """Place of each node on the surface, (u, 3)."""
        return frozen(self.cloud.surface.points[self.samples], np.float64)

    @cached_property
    def parted(self) -> Mask:
        """True where a crease lies between the two contacts, (u,): they are not the same wall."""
        return frozen(self.regions[:, 0] != self.regions[:, 1], np.bool_)

    @cached_property
    def areas(self) -> FloatArray:
        """Area of the surface round each node, (u,)."""
        if self.cloud.surface.faces is None:
            return frozen(self.cloud.surface.point_areas[self.samples], np.float64)
        third = twice_areas(self.points, self.faces) / 6
        total = np.bincount(self.faces.ravel(), np.repeat(third, 3), len(self))
        return frozen(total, np.float64)

    @cached_property
    def spokes(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors from the center to the first and to the second contact, each (u, 3).

        The second one is the normal of the wall there, unless the two have little in common: a
        tolerance turns a spoke by some degrees.
        """
        side = self.cloud.side[self.rows][:, None]
        first = unit_rows(self.points - self.centers, instead=side * self.normals)
        wall = side * self.contact_normals
        second = unit_rows(self.contacts - self.centers, instead=wall)
        tangent = np.einsum("ij,ij->i", second, wall) > TANGENT
        second = np.where(tangent[:, None], wall, second)
        return frozen(first, np.float64), frozen(second, np.float64)


@dataclass(frozen=True)
class Fans:
    """The balls of fans between the sectors of a vertex.

    Attributes
    ----------
    keys : (p,) int64
        First sector times the number of sectors, plus the second, of each pair of sectors with a
        fan between; ascending.
    first : (p + 1,) int64
        Where the balls of each pair start.
    rows : (b,) int64
        Their rows in the cloud, pair after pair, from the first sector to the second.
    turns : (b,) float64
        Where the normal of each lies between those of the sectors, above 0 and below 1.
    sectors : (b,) int64
        The first sector.
    ends : (e, 2) int64
        Sectors, and the row of the ball that has the normal of one.
    """

    keys: Index
    first: Index
    rows: Index
    turns: FloatArray
    sectors: Index
    ends: Index

    @classmethod
    def of(cls, cloud: MedialCloud, creases: Creases, pairs: IntArray, rows: Index) -> Self:
        """Sort the rows of fans into pairs of sectors (p, 2)."""
        pairs = pairs.astype(np.int64)
        at_vertex = Ragged.group(cloud.source[rows], cloud.surface.point_count)
        vertex = creases.vertices[pairs[:, 0]]
        pair = np.repeat(np.arange(len(pairs)), at_vertex.lengths[vertex])
        row = rows[at_vertex.joined(vertex)]
        away = cloud.surface.points[cloud.source[row]] - cloud.centers[row]
        away = away * cloud.side[row][:, None]
        one, other = (creases.normals[pairs[pair, j]] for j in range(2))
        left, right = angles_between(one, away), angles_between(away, other)
        whole = angles_between(one, other)
        between = left + right < whole + SAME_NORMAL
        at_end = np.stack([left < SAME_NORMAL, right < SAME_NORMAL], axis=1)
        ends = [np.stack([pairs[pair, j], row], axis=1)[at_end[:, j]] for j in range(2)]
        inside, part = np.flatnonzero(between & ~at_end.any(axis=1)), left / whole
        order = inside[np.lexsort((part[inside], pair[inside]))]
        keys = pairs[:, 0] * len(creases.vertices) + pairs[:, 1]
        first = np.searchsorted(pair[order], np.arange(len(pairs) + 1))
        ordered = row[order], part[order], pairs[pair[order], 0]
        return cls(keys, first, *ordered, np.concatenate(ends))


def strips(
    creases: Creases, fans: Fans, corner: Index, first: int, sign: int
) -> tuple[Index, Index]:
    """Return the triangles that join the two sides of creases, (t, 3), and a face beside each.

    Parameters
    ----------
    creases : Creases
    fans : Fans
    corner : (3m,) int64
        Node of each corner of the faces; n + s for sector s.
    first : int
        Node of the first ball of the fans.
    sign : int
        +1 for balls inside, -1 for those outside.
    """
    there, back = creases.half_edges[creases.inward == (sign > 0)].T
    # From the face of the first half-edge to that of the second, at its start and at its end.
    sides = [(corner[there], corner[next_side(back)]), (corner[next_side(there)], corner[back])]
    steps = [_steps(fans, start, end, first, len(creases.vertices)) for start, end in sides]
    edge = np.concatenate([step[0] for step in steps])
    which = np.repeat([0, 1], [len(step[0]) for step in steps])
    middle, old, new = (np.concatenate([s[j] for s in steps]) for j in (1, 2, 3))
    order = np.lexsort((which, middle, edge))
    edge, which, old, new = edge[order], which[order], old[order], new[order]
    if len(edge) == 0:
        return np.empty((0, 3), np.int64), edge
    # Each step of one side makes a triangle with where the other side is by then.
    begin = np.searchsorted(edge, np.arange(len(there)))
    done = np.stack([np.cumsum(which == side) for side in (0, 1)], axis=1)
    tip = np.empty(len(edge), np.int64)
    for side in (0, 1):
        mine = which != side  # steps whose tip is on this side
        before = np.where(begin > 0, done[begin - 1, side], 0)[edge[mine]]
        taken = done[mine, side]
        path = new[which == side]
        start = sides[side][0][edge[mine]]
        last = path[np.maximum(taken - 1, 0)] if len(path) else start
        tip[mine] = np.where(taken > before, last, start)
    triangles = np.stack([old, new, tip], axis=1)
    return triangles, there[edge] // 3


def _steps(
    fans: Fans, start: Index, end: Index, first: int, sectors: int
) -> tuple[Index, FloatArray, Index, Index]:
    """Edge, turn in the middle, node before and node after of each step from start to end."""
    base = first - sectors
    low, high = np.minimum(start, end) - base, np.maximum(start, end) - base
    bends = np.flatnonzero(low != high)  # at the end of a crease both are the same sector
    key = low[bends] * sectors + high[bends]
    pair = np.minimum(np.searchsorted(fans.keys, key), max(len(fans.keys) - 1, 0))
    # Two sectors that meet along creases of both kinds have a fan on one side only.
    count = np.where(fans.keys[pair] == key, fans.first[pair + 1] - fans.first[pair], 0)
    edge = np.repeat(bends, count)
    place = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    place += np.repeat(fans.first[pair], count)
    turned = (start > end)[edge]
    turn = np.where(turned, 1.0 - fans.turns[place], fans.turns[place])
    edges = np.concatenate([bends, edge, bends])
    nodes = np.concatenate([start[bends], first + place, end[bends]])
    turns = np.concatenate([np.zeros(len(bends)), turn, np.ones(len(bends))])
    order = np.lexsort((turns, edges))
    edges, nodes, turns = edges[order], nodes[order], turns[order]
    step = np.flatnonzero(edges[1:] == edges[:-1])
    return edges[step], (turns[step] + turns[step + 1]) / 2, nodes[step], nodes[step + 1]


class _Nodes(NamedTuple):
    """Nodes before those without a ball are left out: samples, then sectors, then fans."""

    rows: Index
    samples: Index
    normals: FloatArray
    regions: Index
    corner: Index
    """Node of each corner 3 f + j of the faces."""
    faces: Index
    face_origin: Index


def unfold(cloud: MedialCloud, angle: float) -> Unfolded:
    """Unfold the surface of balls.

    Parameters
    ----------
    cloud : MedialCloud
        One ball for each sample and side at most; besides those of fans, if there are any.
    angle : float
        Degrees: edges that bend by more are creases.

    Raises
    ------
    InvalidShapeError
        When the cloud has other balls besides.

    Notes
    -----
    Cost O(n).
    """
    signs = [sign for sign in (1, -1) if (cloud.valid & (cloud.side == sign)).any()]
    if cloud.surface.faces is None:
        return _joined([_of_cloud(cloud, sign) for sign in signs], cloud)
    creases = find_creases(cloud.surface, angle)
    return _joined([_of_mesh(cloud, creases, sign) for sign in signs], cloud)


def _own_rows(cloud: MedialCloud, sign: int) -> tuple[Index, Index]:
    """Return the first row of each sample on a side, (n,), -1: none; and the other rows.

    Balls of convex creases between samples are none of them: sheets end on the crease itself.
    """
    rows = np.flatnonzero(cloud.valid & (cloud.side == sign))
    row_of = np.full(cloud.surface.point_count, -1, np.int64)
    row_of[cloud.source[rows[::-1]]] = rows[::-1]
    others = rows[row_of[cloud.source[rows]] != rows]
    return row_of, others[cloud.features[others, 0] != cloud.features[others, 1]]


def _require_fans(cloud: MedialCloud, others: Index, allowed: IntArray) -> None:
    if not np.isin(cloud.source[others], allowed).all():
        raise InvalidShapeError("The cloud has several balls for one sample and side.")


def _of_cloud(cloud: MedialCloud, sign: int) -> Unfolded:
    """One node for each sample of a point cloud that has a ball."""
    row_of, others = _own_rows(cloud, sign)
    _require_fans(cloud, others, np.empty(0, np.int32))
    used = row_of >= 0
    place = np.cumsum(used, dtype=np.int32) - 1
    graph, rows = surface_graph(cloud.surface), row_of[used].astype(np.int32)
    start = np.repeat(np.arange(len(graph)), graph.lengths)
    kept = used[start] & used[graph.indices]
    counts = np.bincount(place[start[kept]], minlength=len(rows))
    offsets = np.concatenate([[0], np.cumsum(counts)])
    none, links = np.empty((0, 3), np.int32), Ragged(offsets, place[graph.indices[kept]])
    across = np.where(used, place, -1)[cloud.features[rows, 1]]
    normals, regions = cloud.surface.normals[cloud.source[rows]], np.zeros((len(rows), 2), np.int32)
    nodes = rows, cloud.centers[rows], cloud.radii[rows], normals
    contacts = cloud.contacts[rows], cloud.contact_normals[rows], regions, across
    return Unfolded(*nodes, *contacts, none, none[:, 0], links, cloud=cloud)


def _of_mesh(cloud: MedialCloud, creases: Creases, sign: int) -> Unfolded:
    """Nodes and triangles of one side of a mesh."""
    nodes = _nodes(cloud, creases, sign)
    used = nodes.rows >= 0
    used[creases.vertices] = False  # their corners have the nodes of sectors
    contacts, normals, regions, across, on_crease = (
        values[used] for values in _contacts(cloud, creases, nodes, sign)
    )
    place = np.where(used, np.cumsum(used, dtype=np.int32) - 1, -1)
    kept = used[nodes.faces].all(axis=1)
    faces, rows = place[nodes.faces[kept]], nodes.rows[used].astype(np.int32)
    centers, radii = cloud.centers[rows], cloud.radii[rows]
    centers[on_crease] = cloud.surface.points[nodes.samples[used][on_crease]]
    radii[on_crease] = 0.0
    regions = np.stack([nodes.regions[used], regions], axis=1).astype(np.int32)
    balls = rows, centers, radii, nodes.normals[used]
    touched = contacts, normals, regions, np.where(across >= 0, place[across], -1)
    origin, graph = nodes.face_origin[kept], mesh_graph(faces, np.ones(len(rows), np.bool_))
    return Unfolded(*balls, *touched, faces, origin.astype(np.int32), graph, cloud=cloud)


def _nodes(cloud: MedialCloud, creases: Creases, sign: int) -> _Nodes:
    """Nodes of samples, sectors and fans, and the triangles between them."""
    surface = cloud.surface
    n, sectors, corners = surface.point_count, len(creases.vertices), np.asarray(surface.faces)
    row_of, others = _own_rows(cloud, sign)
    corner = corners.ravel().astype(np.int64)
    corner[creases.corners] = n + creases.sector
    samples = np.concatenate([np.arange(n), creases.vertices])
    rows, normals = row_of[samples], np.concatenate([surface.normals, creases.normals])
    regions = np.full(n + sectors, -1, np.int64)
    regions[corner] = np.repeat(creases.regions(sign), 3)
    bent = creases.concave == (sign > 0)
    _require_fans(cloud, others, creases.vertices[creases.pairs[bent, 0]])
    fans = Fans.of(cloud, creases, creases.pairs[bent], others)
    rows[n + fans.ends[:, 0]] = fans.ends[:, 1]
    first = n + sectors
    faces, beside = strips(creases, fans, corner, first, sign)
    # What lies in a fan has the normal of its ball.
    inside = cloud.source[fans.rows]
    away = surface.points[inside] - cloud.centers[fans.rows]
    fan_normals = sign * away / cloud.radii[fans.rows, None]
    of_nodes = (rows, fans.rows), (samples, inside), (normals, fan_normals)
    nodes = (np.concatenate(both) for both in (*of_nodes, (regions, regions[n + fans.sectors])))
    of_faces = (corner.reshape(-1, 3), faces), (np.arange(surface.face_count), beside)
    return _Nodes._make([*nodes, corner, *map(np.concatenate, of_faces)])


def _contacts(
    cloud: MedialCloud, creases: Creases, nodes: _Nodes, sign: int
) -> tuple[NDArray[Any], ...]:
    """Find the second contacts; those on convex creases are the faces across.

    Returns place, normal, region, nearest node, and whether it is on a crease, for each node.
    """
    surface, rows = cloud.surface, nodes.rows  # of row -1 anything may come, and is left out
    n = surface.point_count
    near, regions = _contact_nodes(cloud, nodes, sign)
    places, normals = cloud.contacts[rows], cloud.contact_normals[rows]
    near, regions = near[rows], regions[rows]
    at_crease = (near >= n) & (cloud.contact_faces[rows] < 0)
    spokes = places - cloud.centers[rows]
    normals[at_crease] = sign * unit_rows(spokes)[at_crease]
    # The sector across the crease, of those whose ball is the end of a sheet.
    convex = creases.pairs[creases.concave == (sign < 0)].astype(np.int64)
    across = np.full(len(rows), -1, np.int64)
    for one, other in (convex.T[::-1], convex.T):
        across[n + one[::-1]] = n + other[::-1]  # of several, the first
    at_end = (cloud.features[rows, 0] == cloud.features[rows, 1]) & (rows >= 0)
    on_crease = at_end & (across >= 0)
    there = across[on_crease]
    places[on_crease] = surface.points[nodes.samples[on_crease]]
    normals[on_crease] = nodes.normals[there]
    regions[on_crease], near[on_crease] = nodes.regions[there], there
    return places, normals, regions, near, on_crease


def _contact_nodes(cloud: MedialCloud, nodes: _Nodes, sign: int) -> tuple[Index, Index]:
    """Return the node nearest to the second contact of each row, and the region there."""
    n = cloud.surface.point_count
    near = cloud.features[:, 1].astype(np.int64)
    on_face = np.flatnonzero(cloud.contact_faces >= 0)
    corner = 3 * cloud.contact_faces[on_face] + cloud.contact_weights[on_face].argmax(axis=1)
    near[on_face] = nodes.corner[corner]
    region = np.where(near >= 0, nodes.regions[near], -1)
    touched = np.zeros(len(cloud), np.bool_)
    touched[on_face] = True
    # Of the nodes of a sample at a crease, that which faces the center most.
    at_sample = Ragged.group(nodes.samples[n:], n)
    sample = np.maximum(cloud.features[:, 1], 0)
    at = np.flatnonzero((near >= 0) & (at_sample.lengths[sample] > 0))
    counts = at_sample.lengths[sample[at]]
    owner = np.repeat(np.arange(len(at)), counts)
    node = n + at_sample.joined(sample[at])
    row = at[owner]
    spoke = sign * (cloud.contacts[row] - cloud.centers[row])
    facing = np.einsum("ij,ij->i", spoke, nodes.normals[node]) / cloud.radii[row]
    other = touched[row] & (nodes.regions[node] != region[row])
    facing[other | (nodes.rows[node] < 0)] -= 4.0
    near[at] = node[np.lexsort((facing, owner))[np.cumsum(counts) - 1]]
    region[at] = np.where(touched[at], region[at], nodes.regions[near[at]])
    return near, region


def _joined(parts: list[Unfolded], cloud: MedialCloud) -> Unfolded:
    """Return the two sides as one; a surface without balls has no nodes."""
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return _of_cloud(cloud, 1)
    one, other = parts
    u, regions = len(one), one.regions.max(initial=-1) + 1
    shift: dict[str, Any] = {"faces": u, "regions": regions, "across": u}
    columns: dict[str, Any] = {}
    for name in (f.name for f in fields(Unfolded) if f.name not in ("graph", "cloud")):
        values = getattr(other, name)
        if name in shift:
            values = np.where(values < 0, -1, values + shift[name])
        columns[name] = np.concatenate([getattr(one, name), values])
    graph = Ragged(
        np.concatenate([one.graph.offsets, one.graph.offsets[-1] + other.graph.offsets[1:]]),
        np.concatenate([one.graph.indices, other.graph.indices + u]),
    )
    return Unfolded(**columns, graph=graph, cloud=cloud)
