"""Which of the faces that have an opposite lie in a wall: an extended one of even thickness.

Sharp edges told from thin walls, by the two places that a ball touches (for thesis 3.5.1).

Towards the edge of a wedge balls get smaller and smaller, though the shape is not a thin wall
there. The two planes that touch such a ball at its feature points meet at the edge itself: with the
directions u and v from the center c to the two places, at c + r w / |w|^2 2, w = u + v, which is as
far as the bisector goes. Where a sharp edge of the shape lies there, the ball is one of that edge.
In an even wall the planes are parallel and meet nowhere; in one that tapers by the draft of a
moulded part they meet far away.

Ribs and bosses: walls that stand on another wall, and how thick they are beside it.

The foot of a rib is where the surface bends inward, sharply or in a fillet. Beside the foot one
sample lies on the wall and one on the rib, and the ball of each tells its thickness. What tells
rib from wall is the other side: across the rib there is a foot again, across the wall there is
none. At a corner of two walls neither has one; where walls cross, both have, and the thinner one
counts as the rib. A boss that is bored right through has no foot inside either, but its own goes
round it, with the wall outside. What they stand on must be a wall (`even_walls.py`): limbs are no
ribs.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from medialis.base.arrays import Described, Index, Mask, kd_tree, next_side, rows_of_labels, sums_of
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.creases import bends_inward
from medialis.shape.shape import Shape
from medialis.shape.surface import piece_labels
from medialis.skeleton.medial_cloud import MedialCloud

EXTENT = 2.0  # halved 0 %, doubled 100 %
"""Half thicknesses: widths by which what has an opposite is spread to tell whether it is a wall."""

WIDER = 2.0  # halved 0 %, doubled 0 %
"""Times that width: over which linear functions are fitted, so that the wall outweighs blends."""

SLOW = 0.05  # halved 0 %, doubled 0 %
"""Share of the half thickness by which this may differ from a linear function of the place, near
the end of a wall: it does where this goes over into a blend."""

INSIDE = 0.7  # halved 0 %, doubled 0 %
"""Of what is left when all is spread: half a thickness from the end of a wall, and more within."""

BESIDE_WALL = 0.1  # halved 0 %, doubled 0 %
"""Of what is left when walls are spread: 0.5 at their end, if it is long, 0.18 a width from it."""

CELL = 1 / 3  # halved 100 %, doubled 0 %
"""Half thicknesses: samples within a cube of this are one unknown, which is all this needs."""

MOST_CELLS = 20_000  # halved 0 %, doubled 0 %
"""Of the surface, or a few times as many; equations for more take long."""


def faces_in_walls(cloud: MedialCloud, core: Mask, width: float) -> Mask:
    """Tell which faces that have an opposite lie in a wall, (m,).

    What has an opposite is spread over the surface, by its thickness. In the middle of a strip
    that is narrower than 1.4 thicknesses less than half is left, in that of a disc below 2.5.
    Where half is left on both sides there is a wall, and so is what lies beside it; but not what
    changes its thickness at the end of a wall, where this goes over into a blend.
    """
    shape, n = cloud.surface, cloud.surface.point_count
    faces, half = np.asarray(shape.faces), np.nan_to_num(cloud.radii[:n])
    heat = _Diffusion(shape, half, CELL * width)
    third = np.repeat(shape.face_areas[core] / 3, 3)
    given = np.bincount(faces[core].ravel(), third, n) / np.maximum(shape.point_areas, 1e-300)
    share = heat.spread(given[:, None], EXTENT)[:, 0]
    # Moments of place and half thickness, over what has an opposite: linear functions of the place.
    place, value = (shape.points - shape.bounds[0]) / shape.diagonal, half / shape.diagonal
    x, y, z = place.T
    terms = np.stack([np.ones(n), x, y, z, value, x * x, y * y, z * z, x * y, x * z, y * z,
                      x * value, y * value, z * value], axis=1)  # fmt: skip
    moments = heat.spread(given[:, None] * terms, WIDER * EXTENT)
    smooth = shape.diagonal * _linear(moments / np.maximum(moments[:, :1], 1e-9), place)
    slow = (np.abs(smooth - half) < SLOW * half) | (share > INSIDE)
    touched = cloud.contact_faces[:n]
    there = np.where(touched >= 0, share[faces[touched]].mean(axis=1), share[cloud.features[:n, 1]])
    wall = (given > 0) & (np.minimum(share, there) > 0.5)
    left = heat.spread(wall[:, None].astype(np.float64), EXTENT)[:, 0]
    return np.asarray(core & (slow & (left > BESIDE_WALL))[faces].all(axis=1))


class _Diffusion:
    """Equations on cells of samples that lie near each other and face the same way."""

    def __init__(self, shape: Shape, half: FloatArray, cell: float) -> None:
        from scipy.sparse import triu

        cell = max(cell, (shape.area / MOST_CELLS) ** 0.5)
        place = np.floor((shape.points - shape.bounds[0]) / cell).astype(np.int64)
        across = np.abs(shape.normals).argmax(axis=1)
        facing = np.take_along_axis(shape.normals, across[:, None], axis=1)[:, 0] > 0
        size = place.max(axis=0) + 1
        if 6.0 * float(np.prod(size.astype(np.float64))) > 2.0**62:  # small bodies, far apart
            place = np.stack([np.unique(row, return_inverse=True)[1] for row in place.T], axis=1)
            size = place.max(axis=0) + 1
        key = 6 * np.ravel_multi_index(tuple(place.T), tuple(size)) + 2 * across + facing
        self.cell = np.unique(key, return_inverse=True)[1]
        self.mass = np.maximum(shape.point_areas, 1e-12 * shape.area / shape.point_count)
        self.area = np.bincount(self.cell, self.mass)
        count = len(self.area)
        middle = sums_of(self.cell, self.mass[:, None] * shape.points, count) / self.area[:, None]
        links = triu(shape.cotangent_weights, 1).tocoo()
        ends = self.cell[links.row], self.cell[links.col]
        step = np.linalg.norm(shape.points[links.row] - shape.points[links.col], axis=1)
        apart = np.maximum(np.linalg.norm(middle[ends[0]] - middle[ends[1]], axis=1), 1e-3 * cell)
        narrow = np.minimum(half[links.row], half[links.col])  # none at creases: they part
        parted = ends[0] != ends[1]
        self.ends = ends[0][parted], ends[1][parted]
        self.flow = (narrow**2 * np.maximum(links.data, 0.0) * step / apart)[parted]
        self.factors: dict[float, Any] = {}

    def spread(self, values: FloatArray, width: float) -> FloatArray:
        """Return values (n, k) spread by a width in half thicknesses, those of the cells."""
        if width not in self.factors:
            self.factors[width] = self._factors(width)
        held = sums_of(self.cell, self.mass[:, None] * values, len(self.area))
        return np.asarray(self.factors[width].solve(held)[self.cell])

    def _factors(self, width: float) -> Any:
        from scipy.sparse import coo_array, diags_array
        from scipy.sparse.linalg import splu

        count, (one, two), flow = len(self.area), self.ends, width**2 * self.flow
        between = coo_array((flow, (one, two)), shape=(count, count)).tocsr()
        between = between + between.T
        leaving = between.sum(axis=1)
        matrix: Any = diags_array(self.area + leaving) - between
        # Positive definite: an order for symmetric ones, without pivots, fills half as much.
        symmetric: Any = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0}
        symmetric["options"] = {"SymmetricMode": True}
        try:
            return splu(matrix.tocsc(), **symmetric)
        except RuntimeError:  # bodies so small that rounding loses their areas
            return splu((matrix + diags_array(1e-9 * leaving + 1e-300)).tocsc(), **symmetric)


ROUNDED = 1e-9
"""Squared diagonals: of places nearer to each other, rounding has left no second moments."""


def _linear(moments: FloatArray, places: FloatArray) -> FloatArray:
    """Return the values at places of linear functions, fitted by the moments beside each.

    Columns: 1, x, y, z, v, xx, yy, zz, xy, xz, yz, xv, yv, zv.
    """
    mean, value = moments[:, 1:4], moments[:, 4]
    square = moments[:, [5, 8, 9, 8, 6, 10, 9, 10, 7]].reshape(-1, 3, 3)
    square = square - mean[:, :, None] * mean[:, None, :]
    size = np.maximum(np.trace(square, axis1=1, axis2=2), ROUNDED)[:, None, None]
    right = moments[:, 11:14] - mean * value[:, None]
    slope = np.linalg.solve(square + 1e-6 * size * np.eye(3), right[:, :, None])[:, :, 0]
    return np.asarray(value + np.einsum("na,na->n", slope, places - mean))


LEAST_TAPER = 5.0  # halved 0 %, doubled 0 %
"""Degrees between the two sides. Moulded walls have drafts of 0.5 to 2 degrees a side: up to 4
between the sides, so that they stay walls even where they end sharp."""

SHARP_TAPER = 60.0  # halved 0.6 %, doubled 100 %
"""Degrees between the faces of an edge at which two sides of a wall can meet: those of spoke angles
of 120 and more (`fields.thickness.WALL_ANGLE`)."""


def edge_balls(cloud: MedialCloud) -> Mask:
    """Return which balls belong to a sharp edge that their two sides run into, (k,).

    Inner balls and convex edges, or outer balls and concave ones. None in a cloud of points.
    """
    result = np.zeros(len(cloud), np.bool_)
    if cloud.surface.faces is None:
        return result
    taper = math.pi - cloud.spoke_angles
    wide = cloud.valid & (taper > math.radians(LEAST_TAPER)) & (taper < math.radians(SHARP_TAPER))
    for side in (1, -1):
        rows = np.flatnonzero(wide & (cloud.side == side))
        edges = sharp_edges(cloud.surface, side)
        if len(rows) and len(edges):
            result[rows] = _near(cloud, rows, edges)
    return result


def sharp_edges(surface: Shape, side: int) -> FloatArray:
    """Return the ends (e, 2, 3) of the edges whose faces enclose less than `SHARP` on a side."""
    ends, inward = signed_edges(surface)
    sharp = surface.edge_bends > math.radians(180.0 - SHARP_TAPER)
    return np.asarray(surface.points[ends[sharp & (inward == (side < 0))]])


def signed_edges(surface: Shape) -> tuple[IntArray, Mask]:
    """Return the ends (p, 2) of each edge of two faces, and whether it bends inward."""
    first, second, _ = surface.edge_table.pairs
    corners = np.asarray(surface.faces).ravel()
    ends = np.stack([corners[first], corners[next_side(first)]], axis=1)
    return ends, bends_inward(surface, first, second)


def _near(cloud: MedialCloud, rows: Index, edges: FloatArray) -> Mask:
    """Tell whether the planes at the two contacts of some balls meet at one of some edges."""
    centers, radii = cloud.centers[rows], cloud.radii[rows]
    one = cloud.surface.points[cloud.features[rows, 0]] - centers
    other = cloud.contacts[rows] - centers
    ahead = (one + other) / radii[:, None]  # |u + v| = 2 cos(spoke angle / 2)
    square = np.maximum(np.einsum("ij,ij->i", ahead, ahead), 1e-300)  # 0: planes that never meet
    meet = centers + 2.0 * radii[:, None] * ahead / square[:, None]
    middles = edges.mean(axis=1)
    half = 0.5 * np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    distance, nearest = kd_tree(middles).query(meet)
    # Sides are not quite flat, and contacts lie up to a tolerance off: a radius to spare.
    return np.asarray(distance <= radii + half[nearest])


LEAST_BEND = math.radians(3.0)  # halved 0 %, doubled 7 %
"""Flat faces and noise bend less."""

# halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
SHARP, SMALL_TURN = math.radians(30.0), math.radians(1.0)
"""A bend that is no facet of a fillet; the least turn of normals along an edge inside of one."""

FILLET = 2.0  # halved 10 %, doubled 100 %
"""A foot may have a fillet of at most so many times the thickness there: curvature 1 / (2 t)."""

NEAREST = 3  # halved 2 %, doubled < 0.1 %
"""Samples of walls that face each way that are looked at round a sample of a foot."""

NEIGHBOURS, BESIDE = 48, 8  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Samples of feet that are looked at round one of them: over a gap in a foot, and beside it."""

APART = math.cos(math.radians(45.0))  # halved 0 %, doubled 100 %
"""Rib and wall enclose at least 45 degrees, on both sides."""

ALONG = math.cos(math.radians(50.0))  # halved 0 %, doubled 100 %
"""A foot goes on where both normals turn by less: round a boss, but not round a corner of ribs."""

ACROSS = 0.45  # halved 3 %, doubled 2 %
"""Thicknesses that the foot across a rib may lie off its mirror image: less than half, so that the
foot itself never counts."""

OPPOSITE = math.cos(math.radians(120.0))  # halved 0 %, doubled 100 %
"""The foot across a rib faces the other way, at least by this."""

EVEN = 0.1  # halved 0 %, doubled 0 %
"""Share of a thickness, for each radian, by which that of a wall that bends may change: over the
last 5 degrees of the fillet of a rib it changes by more, and more still below."""

BENT = 1.1  # halved 100 %, doubled 0 %
"""A wall that bends keeps its thickness at the bend up to this factor; over a foot balls are wider,
in a T with a fillet of half the thickness 1.2 times."""

ROUND = 1.5  # halved 0 %, doubled 100 %
"""A boss is at most so many times longer than wide or thick."""

WIDEST = 8.0  # halved 0 %, doubled 0 %
"""Of its walls a bored boss is at most so wide. Moulding guides ask for twice to 2.4 times the
bore, which is 3.4 to 4 walls."""

STANDING = 0.3  # halved 0 %, doubled 0 %
"""Share of a foot beside which there is a wall, at least: that in a blind bore may be too small."""

LEAST_AREA = 2.0  # halved 0 %, doubled 0 %
"""Squares of its thickness that one side of a wall has at least."""

LEVEL = math.cos(math.radians(30.0))  # halved 100 %, doubled 0 %
"""The wall round a boss faces one way, up to this."""

NO_GAP = math.radians(60.0)  # halved 0 %, doubled 0 %
"""A foot goes round a boss where no part of the circle as large as this has none: ribs may join."""

EQUAL, TIE = 0.02, np.array([0.36, 0.79, 0.49])  # halved 0 %, doubled 0 %; -
"""Of walls that cross and differ in thickness by a smaller share, the one whose normal is farther
from this direction counts as the rib."""

LEAST_SHARE = 0.75
"""What stands on a wall has a foot about as long as it is thick, at least: shorter rows of feet are
dents and corners."""

OVER = 1.1
"""Radii from the center of a ball over which a foot makes it larger, with room for a fillet."""

FAIR = 0.2
"""Share of a foot that has a piece of a wall beside it, at least: others are corners."""

STEEPEST_DRAFT = math.tan(math.radians(10.0))
"""Slope of one side of a rib, at most: moulding guides have 0.5 to 3 degrees."""

BEHIND = 0.2  # halved 2 %, doubled 100 %
"""Sine of the angle by which a sample may lie behind the tangent plane of a place that sees it."""

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
    vertices: Index


@dataclass(frozen=True, eq=False)
class _Feet:
    """What is beside each sample of a foot: rib and wall, and the foot across the rib, or -1."""

    vertices: Index
    rib: FloatArray
    rib_normal: FloatArray
    wall: FloatArray
    wall_normal: FloatArray
    wall_sample: Index
    rib_sample: Index
    across: Index


def ribs(cloud: MedialCloud, values: FloatArray, walls: Index, balls: MedialCloud) -> list[Rib]:
    """Return what stands on walls, the highest ratio first.

    Parameters
    ----------
    cloud : MedialCloud
    values : (n,) float64
        Thickness at each sample.
    walls : (w,) int64
        Rows of the balls between two walls.
    balls : MedialCloud
        Inner balls, row i that of sample i.
    """
    surface = cloud.surface
    if surface.faces is None or len(walls) == 0:
        return []
    own = _own_thickness(cloud, walls)
    edges, sharp = _foot_edges(surface, values, own)
    even = _even_walls(cloud, own, balls) if len(edges) else np.empty(0, np.int64)
    if len(even) == 0:
        return []
    feet = _beside(cloud, walls, edges, sharp, even)
    if feet is None or len(feet.vertices) == 0:
        return []
    stand = _on_walls(feet, surface, own, even)
    groups = [rows for rows in _joined(surface, feet, edges) if stand[rows].mean() > STANDING]
    found = [(_rib(surface, feet, rows), rows) for rows in groups]
    found = [(rib, rows) for rib, rows in found if rib.length >= LEAST_SHARE * rib.thickness]
    pieces = _wall_pieces(cloud, own, edges)
    kept = _whole_bosses(_each_once(cloud.surface, feet, found, pieces))
    return sorted(kept, key=lambda rib: (-rib.ratio, int(rib.vertices[0])))


def _own_thickness(cloud: MedialCloud, walls: Index) -> FloatArray:
    """Return the thickness of the wall behind each sample (n,); NaN where there is none."""
    own = np.full(cloud.surface.point_count, np.nan)
    own[cloud.source[walls]] = 2.0 * cloud.radii[walls]
    return own


def over_feet(cloud: MedialCloud, values: FloatArray, walls: Index) -> Mask:
    """Tell which samples (n,) have a ball that touches a foot: where walls meet, it is larger.

    Parameters are those of `ribs`.
    """
    surface = cloud.surface
    result = np.zeros(surface.point_count, np.bool_)
    if surface.faces is None or len(walls) == 0:
        return result
    feet = np.unique(_foot_edges(surface, values, _own_thickness(cloud, walls))[0])
    if len(feet):
        away = kd_tree(surface.points[feet]).query(cloud.centers[walls])[0]
        near = walls[away < OVER * cloud.radii[walls] + surface.spacing]
        result[cloud.features[near].ravel()] = True
    return result


def _foot_edges(surface: Shape, values: FloatArray, own: FloatArray) -> tuple[IntArray, Mask]:
    """Return the edges (e, 2) along which the surface bends inward within a thickness.

    And which samples lie on sharp bends, (n,). Where a wall bends as a whole it keeps its thickness
    `own` (n,), NaN where no wall is: over a fillet it grows.
    """
    (ends, inward), bends = signed_edges(surface), surface.edge_bends
    first, second, _ = surface.edge_table.pairs
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
    ends = ends[bent | round_]
    one, two = surface.edges.T
    turns = np.linalg.norm(surface.normals[two] - surface.normals[one], axis=1)
    even = np.abs(np.log(own[two] / own[one])) < EVEN * turns
    across = np.where(turns > SMALL_TURN, np.where(even, 1.0, -1.0), 0.0)
    hollow = np.bincount(surface.edges.ravel(), np.repeat(across, 2), surface.point_count) > 0
    return np.asarray(ends[~hollow[ends].any(axis=1)]), sharp


def _beside(
    cloud: MedialCloud, walls: Index, edges: IntArray, sharp: Mask, even: Index
) -> _Feet | None:
    """Find rib and wall beside each sample of the feet; leave out corners of walls."""
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
        return None
    # Only what is near a real wall can stand on one.
    farthest = (FILLET + 1.0) * 2.0 * float(cloud.radii[walls].max()) + 2.0 * surface.spacing
    apart = kd_tree(points[even]).query(points[vertices], distance_upper_bound=farthest)[0]
    vertices = vertices[np.isfinite(apart)]
    near, distance = _nearest_each_way(points[samples], normals[samples], points[vertices])
    away = points[samples[near]] - points[vertices][:, None]
    ahead = np.einsum("vkj,vj->vk", away, normals[vertices])
    seen = (distance > 0) & (ahead >= -BEHIND * distance)  # not what lies behind a thin wall
    facing = normals[samples[near]]
    # Nor the far side of a bore.
    seen &= np.einsum("vkj,vj->vk", facing, normals[vertices]) > OPPOSITE
    seen &= distance < FILLET * 2.0 * cloud.radii[own[near]] + 2.0 * surface.spacing
    rows = np.arange(len(vertices))
    first = np.argmin(np.where(seen, distance, np.inf), axis=1)
    cosine = np.einsum("vkj,vj->vk", facing, facing[rows, first])
    turned = np.abs(cosine) < APART
    second = np.argmin(np.where(seen & turned, distance, np.inf), axis=1)
    good = seen.any(axis=1) & (seen & turned).any(axis=1)
    rows, first, second = rows[good], first[good], second[good]
    sides = np.stack([near[rows, which] for which in (first, second)], axis=1)
    direction, thick = normals[samples[sides]], 2.0 * cloud.radii[own[sides]]
    bent = _bends(cloud, walls, points[vertices[rows]], direction, thick.min(axis=1))
    edges = edges[~np.isin(edges, vertices[rows[bent]]).any(axis=1)]
    vertices, sides, direction, thick = (
        values[~bent] for values in (vertices[rows], sides, direction, thick)
    )
    if len(edges) == 0 or len(vertices) == 0:
        return None
    row = np.full(surface.point_count, -1, np.int64)
    row[vertices] = np.arange(len(vertices))
    mirrored = points[vertices][:, None] + cloud.contacts[own[sides]] - points[samples[sides]]
    across, stands = np.empty(sides.shape, np.int64), np.empty(sides.shape, np.bool_)
    for j in (0, 1):
        across[:, j], stands[:, j] = _foot_at(surface, edges, mirrored[:, j], ACROSS * thick[:, j])
        # There the rib faces the other way, and the wall the same.
        there = row[across[:, j]]
        facing = np.einsum("va,vka->vk", direction[:, j], direction[there])
        level = np.einsum("va,vka->vk", direction[:, 1 - j], direction[there][:, ::-1])
        stands[:, j] &= (there >= 0) & ((facing < OPPOSITE) & (level > ALONG)).any(axis=1)
    # Of two walls that cross the thinner one; of equal ones always the same.
    alike = np.abs(thick[:, 1] - thick[:, 0]) <= EQUAL * thick.max(axis=1)
    tie = np.abs(direction @ TIE)
    thinner = np.where(alike, tie[:, 1] < tie[:, 0], thick[:, 1] < thick[:, 0])
    rib = np.where(stands.all(axis=1), thinner, stands[:, 1]).astype(np.int64)
    across[~stands] = -1
    round_ = _outside_of_bosses(points[vertices], direction, thick)
    alone = np.flatnonzero(~stands.any(axis=1) & (round_ < 0))  # ribs may join bosses
    round_[alone] = _outside_of_bosses(points[vertices[alone]], direction[alone], thick[alone])
    rib = np.where(round_ >= 0, round_, rib)
    rows = np.flatnonzero(stands.any(axis=1) | (round_ >= 0))
    rib, wall = rib[rows], 1 - rib[rows]
    both = [(thick[rows, side], direction[rows, side]) for side in (rib, wall)]
    on = samples[sides[rows, wall]], samples[sides[rows, rib]], across[rows, rib]
    return _Feet(vertices[rows], *both[0], *both[1], *on)


def _bends(
    cloud: MedialCloud, walls: Index, places: FloatArray, sides: FloatArray, thick: FloatArray
) -> Mask:
    """Tell where both sides (v, 2, 3) of a foot are one wall that bends, as in a bore, (v,).

    It is as thick where it faces between them as it is beside; a fillet is not.
    """
    samples = cloud.source[walls]
    points, normals = cloud.surface.points[samples], cloud.surface.normals[samples]
    middle = sides.sum(axis=1) / np.linalg.norm(sides.sum(axis=1), axis=1, keepdims=True)
    scale = FILLET * float(np.median(thick)) if len(thick) else 1.0
    tree = kd_tree(np.concatenate([points / scale, normals], axis=1))
    wanted = np.concatenate([places / scale, middle], axis=1)
    near = tree.query(wanted, k=[*range(1, min(NEAREST, len(samples)) + 1)])[1]
    away = np.linalg.norm(points[near] - places[:, None], axis=2)
    turn = np.arccos(np.clip(np.einsum("va,va->v", sides[:, 0], sides[:, 1]), -1.0, 1.0))
    cosine = np.einsum("vka,vja->vkj", normals[near], sides)
    between = (cosine < np.cos(turn / 4)[:, None, None]).all(axis=2)
    between &= np.einsum("vka,va->vk", normals[near], middle) > np.cos(turn / 2)[:, None]
    between &= away < FILLET * thick[:, None]
    between &= 2 * cloud.radii[walls[near]] < BENT * thick[:, None]
    return np.asarray(between.any(axis=1))


def _nearest_each_way(
    points: FloatArray, normals: FloatArray, places: FloatArray
) -> tuple[Index, FloatArray]:
    """Return for some places (v) the nearest points that face each of 26 ways, and how far.

    The nearest of all would lie on one face where samples are fine. (v, 26 NEAREST) rows of points,
    inf for none.
    """
    ways = np.array([way for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    facing = np.argmax(normals @ ways.T, axis=1)
    shape = len(places), len(ways), NEAREST
    near = np.zeros(shape, np.int64)
    distance = np.full(shape, np.inf)
    for way in np.unique(facing):
        rows = np.flatnonzero(facing == way)
        count = min(NEAREST, len(rows))
        away, which = kd_tree(points[rows]).query(places, k=[*range(1, count + 1)])
        near[:, way, :count], distance[:, way, :count] = rows[which], away
    flat = len(places), len(ways) * NEAREST
    return near.reshape(flat), distance.reshape(flat)


def _outside_of_bosses(places: FloatArray, directions: FloatArray, thick: FloatArray) -> Index:
    """Return which of two sides is that of a boss whose foot goes round it; -1: none.

    Parameters
    ----------
    places : (v, 3) float64
    directions : (v, 2, 3) float64
        Normals of both sides.
    thick : (v, 2) float64
    """
    result = np.full(len(places), -1, np.int64)
    if len(places) < 3:
        return result
    count = min(NEIGHBOURS, len(places))
    away, near = kd_tree(places).query(places, k=[*range(1, count + 1)])
    # Linked where they have a side in common, so that the corners of a square bore are none of it.
    alike = np.einsum("vja,vkla->vkjl", directions, directions[near]).max(axis=(2, 3)) > ALONG
    one, which = np.nonzero(alike & (away < ROUND * thick.min(axis=1)[:, None]))
    label = piece_labels(len(places), np.stack([one, near[one, which]], axis=1).astype(np.int64))
    for rows in rows_of_labels(label):
        axis = directions[rows].sum(axis=(0, 1))
        axis /= max(float(np.linalg.norm(axis)), 1e-300)
        rib = np.argmin(directions[rows] @ axis, axis=1)
        out = places[rows] - places[rows].mean(axis=0)
        out -= (out @ axis)[:, None] * axis
        wide = float(np.linalg.norm(out, axis=1).max())
        faces_out = np.einsum("va,va->v", directions[rows, rib], out) > 0
        faces_out &= directions[rows, 1 - rib] @ axis > LEVEL
        if (
            2 * wide <= (1.0 + EQUAL) * WIDEST * float(np.median(thick[rows, rib]))
            and _largest_gap(out[faces_out], axis) < NO_GAP
        ):
            result[rows[faces_out]] = rib[faces_out]
    return result


def _largest_gap(out: FloatArray, axis: FloatArray) -> float:
    """Return the largest angle between neighbours of directions round an axis."""
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    angle = np.sort(np.arctan2(out @ np.cross(axis, across), out @ across))
    return float(np.diff(angle, append=angle[:1] + 2 * math.pi).max(initial=0.0)) or math.inf


def _even_walls(cloud: MedialCloud, own: FloatArray, balls: MedialCloud) -> Index:
    """Return the samples of real walls, which are of even thickness."""
    surface = cloud.surface
    faces, wide = np.asarray(surface.faces), np.isfinite(own)
    core = wide[faces].all(axis=1)
    inside = faces_in_walls(balls, core, float(np.median(own[wide])) / 2)
    first, second, _ = surface.edge_table.pairs
    links = np.stack([first // 3, second // 3], axis=1).astype(np.int64)
    piece = piece_labels(len(faces), links[inside[links].all(axis=1)])
    share = surface.face_areas / own[faces].mean(axis=1) ** 2
    size = np.bincount(piece[inside], share[inside], minlength=len(faces))
    return np.unique(faces[inside & (size[piece] > LEAST_AREA)]).astype(np.int64)


def _on_walls(feet: _Feet, surface: Shape, own: FloatArray, even: Index) -> Mask:
    """Tell which feet stand on a real wall, (v,)."""
    near, away = _nearest_each_way(
        surface.points[even], surface.normals[even], surface.points[feet.wall_sample]
    )
    found = even[near]
    alike = np.einsum("vka,va->vk", surface.normals[found], feet.wall_normal) > ALONG
    step = np.abs(np.log(own[found] / feet.wall[:, None]))
    alike &= (step < math.log(BENT)) & (away < feet.wall[:, None])
    return np.asarray(alike.any(axis=1))


def _foot_at(
    surface: Shape, edges: IntArray, places: FloatArray, near: FloatArray
) -> tuple[Index, Mask]:
    """Return the sample of a foot nearest to each place, and whether its edge is near enough."""
    ends = surface.points[edges]
    count = min(8, len(edges))
    _, tried = kd_tree(ends.mean(axis=1)).query(places, k=[*range(1, count + 1)])
    start, along = ends[tried, 0], ends[tried, 1] - ends[tried, 0]
    away = places[:, None] - start
    share = np.einsum("pkj,pkj->pk", away, along) / np.einsum("pkj,pkj->pk", along, along)
    off = np.linalg.norm(away - np.clip(share, 0.0, 1.0)[..., None] * along, axis=2)
    best = np.argmin(off, axis=1)
    rows = np.arange(len(places))
    edge = tried[rows, best]
    vertex = edges[edge, (share[rows, best] > 0.5).astype(np.int64)]
    return vertex.astype(np.int64), np.asarray(off[rows, best] <= near)


def _joined(surface: Shape, feet: _Feet, edges: IntArray) -> list[Index]:
    """Return the rows of each connected foot: along its edges, beside it and across its rib."""
    count = len(feet.vertices)
    row = np.full(surface.point_count + 1, -1, np.int64)  # the last one is none
    row[feet.vertices] = np.arange(count)
    rows = np.arange(count)
    places = surface.points[feet.vertices]
    away, near = kd_tree(places).query(places, k=[*range(1, min(BESIDE, count) + 1)])
    one, which = np.nonzero(away < 0.5 * feet.rib[:, None])
    # The rows of a fine fillet lie nearer to each other than the samples along it.
    faces = row[np.asarray(surface.faces)]
    inside = faces[(faces >= 0).all(axis=1)]
    beside = np.concatenate([inside[:, :2], inside[:, 1:]])
    along = np.concatenate([row[edges], np.stack([one, near[one, which]], axis=1), beside])
    a, b = along[(along >= 0).all(axis=1)].T
    same = np.einsum("ij,ij->i", feet.rib_normal[a], feet.rib_normal[b]) > ALONG
    # Or round the corner of a boss, which turns outward; that of two ribs does so inward.
    step = places[b] - places[a]
    outward = np.einsum("ij,ij->i", feet.rib_normal[b] - feet.rib_normal[a], step) > 0
    same |= outward & (np.abs(np.log(feet.rib[b] / feet.rib[a])) < math.log(BENT))
    c, d = np.stack([rows, row[feet.across]])[:, row[feet.across] >= 0]
    links = np.concatenate([np.stack([a[same], b[same]], axis=1), np.stack([c, d], axis=1)])
    normals = feet.wall_normal[links]
    level = np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]) > ALONG
    return rows_of_labels(piece_labels(count, links[level]))


def _wall_pieces(cloud: MedialCloud, own: FloatArray, edges: IntArray) -> IntArray:
    """Return labels (n,) of samples: of the same piece of wall, which ends at feet and creases."""
    surface, n = cloud.surface, cloud.surface.point_count
    inside = np.isfinite(own)
    inside[edges.ravel()] = False
    rows = cloud.valid & (cloud.side > 0)
    across = cloud.features[rows & inside[cloud.source]]
    links = np.concatenate([surface.edges, across[inside[across].all(axis=1)]])
    links = links[inside[links].all(axis=1)].astype(np.int64)
    cosine = np.einsum("ea,ea->e", *surface.normals[links.T])
    return np.asarray(piece_labels(n, links[np.abs(cosine) > APART]))


def _each_once(
    surface: Shape, feet: _Feet, found: list[tuple[Rib, Index]], pieces: IntArray
) -> list[Rib]:
    """Return each rib once, on the thinnest wall that it stands on.

    What stands on several walls has a foot on each. A rib that crosses another wall has one on both
    sides of it: it is one rib, which stands on that wall only where it stands on no other.
    """
    count = len(found)
    if count < 2:
        return [rib for rib, _ in found]
    base = [_most(pieces[feet.wall_sample[rows]]) for _, rows in found]
    # A wall goes on under what stands on it, and behind what crosses it.
    under = [np.stack([some, np.roll(some, 1)], axis=1) for some in base]
    wall = piece_labels(len(pieces), np.concatenate(under).astype(np.int64))
    walls = [np.unique(wall[some]) for some in base]
    own = [np.unique(wall[_most(pieces[feet.rib_sample[rows]])]) for _, rows in found]
    links, crosses = [], np.zeros(count, np.bool_)
    for i, j in itertools.combinations(range(count), 2):
        if np.intersect1d(walls[i], walls[j]).size and _cross(surface, feet, found[i], found[j]):
            crosses[[i, j]] = True
            links.append((i, j))
        mine, others = (np.setdiff1d(own[k], walls[k]) for k in (i, j))
        one, other = found[i][0], found[j][0]
        alike = max(one.thickness, other.thickness) < BENT * min(one.thickness, other.thickness)
        if np.intersect1d(mine, others).size and (alike or one.kind == other.kind):
            links.append((i, j))
    label = piece_labels(count, np.array(links, np.int64).reshape(-1, 2))
    kept = []
    for rows in rows_of_labels(label):
        standing = rows[~crosses[rows]] if (~crosses[rows]).any() else rows
        if all(found[row][0].kind == "boss" for row in rows):
            kept += [found[row][0] for row in rows]
            continue
        # A short piece of its foot may look like a boss, as round the end of a rib with a fillet.
        several = [found[row][0] for row in standing]
        several = [rib for rib in several if rib.kind == "rib"] or several
        thinnest = min(rib.wall for rib in several)
        on_it = [rib for rib in several if rib.wall < BENT * thinnest]
        kept.append(max(on_it, key=lambda rib: rib.length))
    return kept


def _most(labels: IntArray) -> IntArray:
    """Return the labels that a fair share of some have."""
    found, counts = np.unique(labels, return_counts=True)
    return np.asarray(found[counts > FAIR * len(labels)])


def _cross(surface: Shape, feet: _Feet, one: tuple[Rib, Index], other: tuple[Rib, Index]) -> bool:
    """Tell whether two feet are those of a rib that goes on behind the wall that it meets."""
    (a, first), (b, second) = one, other
    if max(a.thickness, b.thickness) > BENT * min(a.thickness, b.thickness):
        return False
    up, down = (feet.wall_normal[rows].mean(axis=0) for rows in (first, second))
    if float(up @ down) > -APART * float(np.linalg.norm(up) * np.linalg.norm(down)):
        return False
    up = up / np.linalg.norm(up)
    step = b.middle - a.middle
    along = step - (step @ up) * up
    wide = a.wall + 2.0 * FILLET * a.thickness
    return bool(abs(step @ up) < wide and np.linalg.norm(along) < a.thickness)


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


def _at_foot(surface: Shape, feet: _Feet, rows: Index) -> FloatArray:
    """Return the thickness of a rib where it stands on its wall, (r,): with draft it grows there.

    It is measured above fillets, and goes on to the wall as both sides lean.
    """
    normal, up = feet.rib_normal[rows], feet.wall_normal[rows]
    apart = surface.points[feet.rib_sample[rows]] - surface.points[feet.wall_sample[rows]]
    high = np.maximum(np.einsum("va,va->v", apart, up), 0.0)
    place = np.full(surface.point_count + 1, -1, np.int64)  # the last one is none
    place[feet.vertices] = np.arange(len(feet.vertices))
    other = place[feet.across[rows]]
    facing = np.where((other >= 0)[:, None], feet.rib_normal[other], normal)
    lean = (np.einsum("va,va->v", side, up) for side in (normal, facing))
    slopes = [x / np.sqrt(np.maximum(1.0 - x * x, 1e-300)) for x in lean]
    grows = np.clip(sum(slopes), 0.0, 2.0 * STEEPEST_DRAFT)
    return np.asarray(feet.rib[rows] + high * grows)


def _rib(surface: Shape, feet: _Feet, rows: Index) -> Rib:
    vertices = feet.vertices[rows]
    places = surface.points[vertices]
    middle = places.mean(axis=0)
    far = places[np.argmax(np.linalg.norm(places - middle, axis=1))]
    long = float(np.linalg.norm(places - far, axis=1).max())
    thick = float(np.median(_at_foot(surface, feet, rows)))
    wall = float(np.median(feet.wall[rows]))
    side = np.cross(far - middle, feet.wall_normal[rows].mean(axis=0))
    side = side / max(float(np.linalg.norm(side)), 1e-300)
    wide = float(np.ptp(places @ side)) if long <= (1.0 + EQUAL) * WIDEST * thick else 0.0
    at = int(np.argmin(np.linalg.norm(places - middle, axis=1)))
    kind: RibKind = "boss" if long <= ROUND * max(thick, wide) else "rib"
    outside = np.einsum("va,va->v", feet.rib_normal[rows], places - middle) > 0
    if kind == "boss" and outside.any():  # the floor of a bore may be thinner than the wall
        wall = float(np.median(feet.wall[rows[outside]]))
    return Rib(kind, places[at], thick, wall, thick / wall, long, middle, np.sort(vertices))
