"""Unfolding a surface: one node for each normal and ball (for thesis 6.2.2; see `Unfolded`)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.model.unfolded import Unfolded
from medialis.sheets.strips import Fans, strips
from medialis.surface.creases import Creases, find_creases
from medialis.surface.surface_graph import mesh_graph, surface_graph
from medialis.validation import FloatArray, IntArray

Index = NDArray[np.int64]


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
    none = np.empty((0, 3), np.int32)
    return Unfolded(
        rows,
        cloud.centers[rows],
        cloud.radii[rows],
        cloud.surface.normals[cloud.source[rows]],
        cloud.contacts[rows],
        cloud.contact_normals[rows],
        np.zeros((len(rows), 2), np.int32),
        np.where(used, place, -1)[cloud.features[rows, 1]],
        none,
        none[:, 0],
        Ragged(offsets, place[graph.indices[kept]]),
        cloud=cloud,
    )


def _of_mesh(cloud: MedialCloud, creases: Creases, sign: int) -> Unfolded:
    """Nodes and triangles of one side of a mesh."""
    nodes = _nodes(cloud, creases, sign)
    contacts = _contacts(cloud, creases, nodes, sign)
    used = np.zeros(len(nodes.rows), np.bool_)
    used[: cloud.surface.point_count] = True
    used[creases.vertices] = False  # their corners have the nodes of sectors
    used[cloud.surface.point_count :] = True
    used &= nodes.rows >= 0
    place = np.where(used, np.cumsum(used, dtype=np.int32) - 1, -1)
    kept = used[nodes.faces].all(axis=1)
    faces, rows = place[nodes.faces[kept]], nodes.rows[used].astype(np.int32)
    centers, radii = cloud.centers[rows], cloud.radii[rows]
    on_crease = contacts.on_crease[used]
    centers[on_crease] = cloud.surface.points[nodes.samples[used][on_crease]]
    radii[on_crease] = 0.0
    across = contacts.nodes[used]
    return Unfolded(
        rows,
        centers,
        radii,
        nodes.normals[used],
        contacts.places[used],
        contacts.normals[used],
        np.stack([nodes.regions[used], contacts.regions[used]], axis=1).astype(np.int32),
        np.where(across >= 0, place[across], -1),
        faces,
        nodes.face_origin[kept].astype(np.int32),
        mesh_graph(faces, np.ones(len(rows), np.bool_)),
        cloud=cloud,
    )


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
    return _Nodes(
        np.concatenate([rows, fans.rows]),
        np.concatenate([samples, inside]),
        np.concatenate([normals, fan_normals]),
        np.concatenate([regions, regions[n + fans.sectors]]),
        corner,
        np.concatenate([corner.reshape(-1, 3), faces]),
        np.concatenate([np.arange(surface.face_count), beside]),
    )


@dataclass(frozen=True)
class _Contacts:
    """The second contact of each node: place, normal, region, nearest node, whether on a crease."""

    places: FloatArray
    normals: FloatArray
    regions: Index
    nodes: Index
    on_crease: NDArray[np.bool_]


def _contacts(cloud: MedialCloud, creases: Creases, nodes: _Nodes, sign: int) -> _Contacts:
    """Find the second contacts; those on convex creases are the faces across."""
    surface, rows = cloud.surface, nodes.rows  # of row -1 anything may come, and is left out
    n = surface.point_count
    near, regions = _contact_nodes(cloud, nodes, sign)
    places, normals = cloud.contacts[rows], cloud.contact_normals[rows]
    near, regions = near[rows], regions[rows]
    at_crease = (near >= n) & (cloud.contact_faces[rows] < 0)
    normals[at_crease] = sign * _unit(places - cloud.centers[rows])[at_crease]
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
    return _Contacts(places, normals, regions, near, on_crease)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


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
    turn = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    node = n + at_sample.indices[at_sample.offsets[sample[at]][owner] + turn]
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
