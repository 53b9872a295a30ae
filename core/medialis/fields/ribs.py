"""Ribs and bosses: walls that stand on another wall, and how thick they are beside it.

The foot of a rib is where the surface bends inward, sharply or in a fillet. Beside the foot one
sample lies on the wall and one on the rib, and the ball of each tells its thickness. What tells
rib from wall is the other side: across the rib there is a foot again, across the wall there is
none. At a corner of two walls neither has one; where walls cross, both have, and the thinner one
counts as the rib.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from medialis.fields.tapers import signed_bends
from medialis.kept import Described
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.validation import FloatArray, IntArray

LEAST_BEND = math.radians(3.0)
"""Flat faces and noise bend less."""

SHARP, SMALL_TURN = math.radians(30.0), math.radians(1.0)
"""A bend that is no facet of a fillet; the least turn of normals along an edge inside of one."""

FILLET = 2.0
"""A foot may have a fillet of at most so many times the thickness there: curvature 1 / (2 t)."""

NEIGHBOURS = 48
"""Samples of walls that are looked at round a sample of a foot."""

APART = math.cos(math.radians(45.0))
"""Rib and wall enclose at least 45 degrees more than nothing."""

ALONG = math.cos(math.radians(50.0))
"""A foot goes on where both normals turn by less: round a boss, but not round a corner of ribs."""

ACROSS = 0.45
"""Thicknesses that the foot across a rib may lie off its mirror image: less than half, so that the
foot itself never counts."""

ROUND = 1.5
"""A boss is at most so many times longer than it is thick."""

EQUAL, TIE = 0.02, np.array([0.36, 0.79, 0.49])
"""Of walls that cross and differ in thickness by a smaller share, the one whose normal is farther
from this direction counts as the rib."""

LEAST_SHARE = 0.75
"""What stands on a wall has a foot about as long as it is thick, at least: shorter rows of feet are
dents and corners."""

RibKind = Literal["rib", "boss"]


@dataclass(frozen=True, eq=False, repr=False)
class Rib(Described):
    """A wall that stands on another.

    Attributes
    ----------
    kind : {"rib", "boss"}
        A boss is about as long as it is thick.
    position : (3,) float64
        At its foot.
    thickness, wall : float
        Of the rib, and of the wall that it stands on, beside the foot: medians along it.
    ratio : float
        Of the two.
    length : float
        How far the foot extends.
    middle : (3,) float64
        Of the foot.
    vertices : (v,) int64
        Samples of the foot, ascending.
    """

    kind: RibKind
    position: FloatArray
    thickness: float
    wall: float
    ratio: float
    length: float
    middle: FloatArray
    vertices: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Feet:
    """What is beside each sample of a foot: rib and wall, and the place across the rib."""

    vertices: NDArray[np.int64]
    rib: FloatArray
    wall: FloatArray
    rib_normal: FloatArray
    wall_normal: FloatArray
    across: NDArray[np.int64]


def ribs(cloud: MedialCloud, values: FloatArray, walls: NDArray[np.int64]) -> list[Rib]:
    """Return what stands on walls, the highest ratio first.

    Parameters
    ----------
    cloud : MedialCloud
    values : (n,) float64
        Thickness at each sample.
    walls : (w,) int64
        Rows of the balls between two walls.
    """
    surface = cloud.surface
    if surface.faces is None or len(walls) == 0:
        return []
    edges, sharp = _foot_edges(surface, values)
    if len(edges) == 0:
        return []
    feet = _beside(cloud, walls, edges, sharp)
    found = [_rib(surface, feet, rows) for rows in _joined(surface, feet, edges)]
    found = [rib for rib in found if rib.length >= LEAST_SHARE * rib.thickness]
    found = _whole_bosses(found)
    return sorted(found, key=lambda rib: (-rib.ratio, int(rib.vertices[0])))


def _foot_edges(surface: Shape, values: FloatArray) -> tuple[IntArray, NDArray[np.bool_]]:
    """Return the edges (e, 2) along which the surface bends inward within a thickness.

    And which samples lie on sharp bends, (n,).
    """
    bends, inward = signed_bends(surface)
    first, second, _ = surface.edge_table.pairs
    faces = np.asarray(surface.faces)
    ends = np.stack([faces.ravel()[first], faces[first // 3, (first + 1) % 3]], axis=1)
    long = np.linalg.norm(surface.points[ends[:, 1]] - surface.points[ends[:, 0]], axis=1)
    # The lower of the two faces: the other one may be a flat side beside a fillet.
    high = 2.0 * np.minimum(surface.face_areas[first // 3], surface.face_areas[second // 3])
    curved = bends * long * FILLET * values[ends].min(axis=1) > high
    bent = inward & curved & (bends > LEAST_BEND)
    # Samples between the rows of a fillet lie on one facet: there the normals tell.
    sharp = np.zeros(surface.point_count, np.bool_)
    sharp[ends[bends > SHARP]] = True
    turn = surface.normals[ends[:, 1]] - surface.normals[ends[:, 0]]
    along = surface.points[ends[:, 1]] - surface.points[ends[:, 0]]
    closing = -np.einsum("ej,ej->e", turn, along)  # curvature x long^2, above 0 where it is hollow
    round_ = closing * FILLET * values[ends].min(axis=1) > long**2
    round_ &= (closing > SMALL_TURN * long) & ~sharp[ends].any(axis=1)
    return np.asarray(ends[bent | round_]), sharp


def _beside(
    cloud: MedialCloud, walls: NDArray[np.int64], edges: IntArray, sharp: NDArray[np.bool_]
) -> _Feet:
    """Find rib and wall beside each sample of the feet; leave out corners of walls."""
    from scipy.spatial import cKDTree

    surface = cloud.surface
    points, normals = surface.points, surface.normals
    vertices = np.unique(edges).astype(np.int64)
    is_foot = np.zeros(surface.point_count, np.bool_)
    is_foot[vertices] = True
    beside, in_fillet = is_foot.copy(), is_foot & ~sharp  # and on the outermost facet of a fillet
    beside[surface.edges[in_fillet[surface.edges].any(axis=1)]] = True
    own = walls[~beside[cloud.source[walls]]]
    samples = cloud.source[own].astype(np.int64)
    if len(samples) == 0:
        return _no_feet()
    count = min(NEIGHBOURS, len(samples))
    _, near = cKDTree(points[samples]).query(points[vertices], k=[*range(1, count + 1)])
    away = points[samples[near]] - points[vertices][:, None]
    distance = np.linalg.norm(away, axis=2)
    ahead = np.einsum("vkj,vj->vk", away, normals[vertices])
    seen = (distance > 0) & (ahead >= -0.2 * distance)  # not what lies behind a thin wall
    rows = np.arange(len(vertices))
    first = np.argmax(seen, axis=1)
    facing = normals[samples[near]]
    turned = np.einsum("vkj,vj->vk", facing, facing[rows, first]) < APART
    second = np.argmax(seen & turned, axis=1)
    good = seen.any(axis=1) & (seen & turned).any(axis=1)
    rows, first, second = rows[good], first[good], second[good]
    sides = [near[rows, which] for which in (first, second)]
    thick = np.stack([2.0 * cloud.radii[own[side]] for side in sides], axis=1)
    mirrored = [
        points[vertices[rows]] + cloud.contacts[own[side]] - points[samples[side]] for side in sides
    ]
    across, stands = zip(
        *(
            _foot_at(surface, edges, place, ACROSS * thick[:, j])
            for j, place in enumerate(mirrored)
        ),
        strict=True,
    )
    direction = np.stack([normals[samples[side]] for side in sides], axis=1)
    # Of two walls that cross the thinner one; of equal ones always the same.
    alike = np.abs(thick[:, 1] - thick[:, 0]) <= EQUAL * thick.max(axis=1)
    tie = np.abs(direction @ TIE)
    thinner = np.where(alike, tie[:, 1] < tie[:, 0], thick[:, 1] < thick[:, 0])
    rib = np.where(stands[0] & stands[1], thinner, stands[1]).astype(np.int64)
    kept = stands[0] | stands[1]
    rows, rib, wall = np.flatnonzero(kept), rib[kept], 1 - rib[kept]
    return _Feet(
        vertices[good][rows],
        thick[rows, rib],
        thick[rows, wall],
        direction[rows, rib],
        direction[rows, wall],
        np.stack(across, axis=1)[rows, rib],
    )


def _no_feet() -> _Feet:
    none, rows = np.zeros(0), np.zeros((0, 3))
    return _Feet(np.zeros(0, np.int64), none, none, rows, rows, np.zeros(0, np.int64))


def _foot_at(
    surface: Shape, edges: IntArray, places: FloatArray, near: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the sample of a foot nearest to each place, and whether its edge is near enough."""
    from scipy.spatial import cKDTree

    ends = surface.points[edges]
    count = min(8, len(edges))
    _, tried = cKDTree(ends.mean(axis=1)).query(places, k=[*range(1, count + 1)])
    start, along = ends[tried, 0], ends[tried, 1] - ends[tried, 0]
    away = places[:, None] - start
    share = np.einsum("pkj,pkj->pk", away, along) / np.einsum("pkj,pkj->pk", along, along)
    off = np.linalg.norm(away - np.clip(share, 0.0, 1.0)[..., None] * along, axis=2)
    best = np.argmin(off, axis=1)
    rows = np.arange(len(places))
    edge = tried[rows, best]
    vertex = edges[edge, (share[rows, best] > 0.5).astype(np.int64)]
    return vertex.astype(np.int64), np.asarray(off[rows, best] <= near)


def _joined(surface: Shape, feet: _Feet, edges: IntArray) -> list[NDArray[np.int64]]:
    """Return the rows of each connected foot: along its edges and across its rib."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    row = np.full(surface.point_count, -1, np.int64)
    row[feet.vertices] = np.arange(len(feet.vertices))
    along = row[edges]
    along = along[(along >= 0).all(axis=1)]
    across = np.stack([np.arange(len(feet.vertices)), row[feet.across]], axis=1)
    across = across[across[:, 1] >= 0]
    a, b = along.T
    same = np.einsum("ij,ij->i", feet.rib_normal[a], feet.rib_normal[b]) > ALONG
    same &= np.einsum("ij,ij->i", feet.wall_normal[a], feet.wall_normal[b]) > ALONG
    c, d = across.T
    level = np.einsum("ij,ij->i", feet.wall_normal[c], feet.wall_normal[d]) > ALONG
    links = np.concatenate([along[same], across[level]])
    count = len(feet.vertices)
    if count == 0:
        return []
    graph = coo_array((np.ones(len(links), np.int8), tuple(links.T)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(order, np.cumsum(np.bincount(label))[:-1])


def _whole_bosses(found: list[Rib]) -> list[Rib]:
    """Keep one of the two pairs of sides of a boss with corners, that which is thinner."""
    kept: list[Rib] = []
    for rib in sorted(found, key=lambda rib: rib.thickness):
        middle = rib.middle
        if rib.kind == "rib" or all(
            other.kind == "rib"
            or float(np.linalg.norm(middle - other.middle)) > 0.5 * other.thickness
            for other in kept
        ):
            kept.append(rib)
    return kept


def _rib(surface: Shape, feet: _Feet, rows: NDArray[np.int64]) -> Rib:
    vertices = feet.vertices[rows]
    places = surface.points[vertices]
    middle = places.mean(axis=0)
    far = places[np.argmax(np.linalg.norm(places - middle, axis=1))]
    long = float(np.linalg.norm(places - far, axis=1).max())
    thick, wall = float(np.median(feet.rib[rows])), float(np.median(feet.wall[rows]))
    at = int(np.argmin(np.linalg.norm(places - middle, axis=1)))
    kind: RibKind = "boss" if long <= ROUND * thick else "rib"
    return Rib(kind, places[at], thick, wall, thick / wall, long, middle, np.sort(vertices))
