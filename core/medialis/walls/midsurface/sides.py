"""Walls: which faces of a surface lie opposite to which, and how thick the solid is there.

The raw sheet between the two sides of a wall, extended to the rim and into junctions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import (
    Index,
    Mask,
    corner_vectors,
    kd_tree,
    next_side,
    twice_areas,
    unit_rows,
)
from medialis.base.box_tree import NearestTree, nearest_on_triangles
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.creases import Creases, find_creases
from medialis.shape.cylinders import Cylinders, corner_normals
from medialis.shape.shape import Shape
from medialis.shape.surface import Topology, link_matrix, piece_labels
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.walls.ribs import faces_in_walls

LEAST_WEIGHT = 1e-6  # halved 0 %, doubled 0 %
"""Of a contact in a corner of its face: below, the ball does not touch that far from the edge."""

TANGENT = math.cos(math.radians(15.0))  # halved 5 %, doubled 100 %
"""Cosine: a ball touches a wall where its spoke is the normal there, else it touches an edge."""

STRAIGHT = math.cos(math.radians(15.0))  # halved 89 %, doubled 77 %
"""Cosine: sides go on over faces that turn by less from the nearest part that has an opposite."""

FOLDED = math.cos(math.radians(12.0))  # halved 0 %, doubled 100 %
"""Cosine: a face that is more inclined to the mean of what is round it lies at an edge."""

TURNS_ALONG = math.radians(168.0)
"""Spoke angle from which on both sides of a rounded wall beside a flat one are parallel."""

BEGINNING = 0.5
"""Share of the area of a blend up to which what is rounded beside it is its beginning."""

BESIDE_CREASE = 1.2
"""Radii of the ball: nearer to a crease nothing tells whether the other side turns along."""

SPREAD = 3.0  # halved 0 %, doubled 26 %
"""Steps from face to face in which a mean spreads by an edge length, squared: a step is a third."""

MOST_STEPS = 80  # halved 0 %, doubled 0 %
"""Of these; with samples more than five to half a thickness the mean spreads less far."""

FARTHEST = 4.0  # halved 50 %, doubled 100 %
"""Half thicknesses: how far sides go on over faces without an opposite, over a rib, or a rim."""

ROWS = 3.0  # halved 100 %, doubled 100 %
"""Spacings of samples that they go on in any case: faces at the end of a wall have no opposite."""

NEIGHBOURS = 8  # halved 20 %, doubled 2 %
"""Balls at each of three places, one behind the other, that tell how the thickness goes on: they
lie as far apart as it goes on, so that what scatters a little is not magnified."""

ALIKE = 0.05  # halved 0 %, doubled 20 %
"""Share of the half thickness by which two sides that go on may differ where they meet."""

FLUSH = 0.15  # halved 0 %, doubled 0 %
"""The same for the distance of the middles that both give: 0.17 where they bend by 10 degrees."""

STEEPEST = math.tan(math.radians(15.0))  # halved 20 %, doubled 0 %
"""Slope of the thickness: that of the steepest wall that counts as one."""

LEAST_LEFT = 0.1  # halved 0 %, doubled 0 %
"""Share of the mean thickness near a place that is left there at least, however steep walls are."""

LEAST_FACES = 6  # halved 4 %, doubled 0 %
"""Fewer faces that have an opposite are no side of a wall."""


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of walls: connected faces between creases, and the ball behind each vertex.

    Attributes
    ----------
    cloud : MedialCloud
        Of n samples; its surface has m faces.
    wide : (n,) bool
        Samples whose ball touches the opposite wall, not an edge.
    label : (m,) int32
        The side of each face; -1: none.
    core : (m,) bool
        Faces of sides whose three corners are wide.
    abrupt : (s,) bool
        Sides that end before another one of a different thickness, on the same smooth face.
    filleted : bool
        Whether blends lie between walls, where sides end.
    """

    cloud: MedialCloud
    wide: Mask
    label: IntArray
    core: Mask
    abrupt: Mask
    filleted: bool = False

    @property
    def shape(self) -> Shape:
        """The surface as computed on."""
        return self.cloud.surface

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.abrupt)

    @cached_property
    def opposite(self) -> IntArray:
        """The side that the ball of each wide sample touches, (n,); -1: none."""
        cloud, n = self.cloud, self.shape.point_count
        faces = np.asarray(self.shape.faces)
        of_vertex = np.full(n, -1, np.int32)
        of_vertex[faces] = self.label[:, None]
        result = of_vertex[cloud.features[:n, 1]]
        touched = cloud.contact_faces[:n]
        result = np.where(touched >= 0, self.label[touched], result)
        return np.where(self.wide, result, -1).astype(np.int32)


@dataclass(frozen=True, eq=False)
class Side:
    """One side: its k vertices, and the middle of the wall behind each.

    Attributes
    ----------
    vertices : (k,) int64
        Of the surface.
    faces : (f, 3) int64
        Of these vertices, outward.
    rows : (f,) int64
        The same as faces of the surface.
    middle : (k, 3) float64
    half : (k,) float64
        Half the thickness.
    """

    vertices: Index
    faces: Index
    rows: Index
    middle: FloatArray
    half: FloatArray


def find_sides(cloud: MedialCloud, least_angle: float, crease: float) -> Sides:
    """Find the sides of walls.

    Parameters
    ----------
    cloud : MedialCloud
        Inner balls, row i that of sample i, of a mesh.
    least_angle : float
        Radians: balls with a wider spoke angle lie between opposite walls.
    crease : float
        Degrees: sides end at edges that bend by more.
    """
    shape = cloud.surface
    creases = find_creases(shape, crease)
    wide = wide_samples(cloud, creases, least_angle)
    links = _smooth_links(shape, creases)
    core = wide[np.asarray(shape.faces)].all(axis=1)
    blend = np.zeros(len(core), np.bool_)
    if core.any():
        half = float(np.median(balls_of(core, cloud)))
        core &= ~folded_faces(shape, links, half)
        blend = blends(cloud, creases, links, half)
        core &= ~(blend | touching(cloud, blend))
        core = faces_in_walls(cloud, core, half)
    label = _pieces(core, links)
    grown, source = _grown(cloud, label, links[~blend[links].any(axis=1)])
    united = _united(cloud, wide, core & (label >= 0), grown, source, links)
    return replace(united, filleted=bool(blend.any()))


def blends(cloud: MedialCloud, creases: Creases, links: Index, width: float) -> Mask:
    """Tell the faces of fillets and other blends beside walls, (m,): no sides of these.

    What is rounded and ends tangent to a flat face is a wall where it bends along with its other
    side, as in sheet metal. On a blend the ball touches what does not turn along: what most faces
    within `width` say counts, since facets and the beginning of a blend may say otherwise. A
    cylinder that turns along with its other side is the wall of a pipe, as sure as a flat one.
    """
    shape = cloud.surface
    m, n = shape.face_count, shape.point_count
    if shape.planes is None:
        return np.zeros(m, np.bool_)
    faces, radii = np.asarray(shape.faces), cloud.radii[:n]
    known = cloud.valid[:n] & (radii > 0)
    if len(creases.vertices):
        # Beside a crease the ball touches what is across it.
        away = kd_tree(shape.points[np.unique(creases.vertices)]).query(shape.points)[0]
        known &= away > BESIDE_CREASE * np.nan_to_num(radii)
    open_ = known & (np.nan_to_num(cloud.spoke_angles[:n]) < TURNS_ALONG)
    told = np.stack([known[faces].any(axis=1), open_[faces].any(axis=1)], axis=1)
    wall = _round_walls(shape, told)
    if (wall < 0).all():
        return np.zeros(m, np.bool_)
    rounded, (first, second) = wall < 0, links.T
    piece = piece_labels(m, links[rounded[first] & rounded[second]])
    rounded &= _beside_walls(shape, wall, piece, links)[piece]
    told &= rounded[:, None]
    value, mean = (
        told.astype(np.float64),
        _mean_beside(shape, links[rounded[first] & rounded[second]]),
    )
    for _ in range(_steps(shape, width)):
        value = mean @ value
    blend = rounded & (value[:, 1] > 0.5 * value[:, 0])
    return blend | _beginnings(shape, rounded, blend, links)


def _round_walls(shape: Shape, told: Mask) -> Index:
    """Return the wall of each face, (m,): a flat face, or a cylinder that turns along; -1: none."""
    planes = np.asarray(shape.planes, np.int64)
    if (cylinders := shape.cylinders) is None or len(cylinders.radii) == 0:
        return planes
    count, label = len(cylinders.radii), cylinders.label
    on = label >= 0
    known, open_ = (
        np.bincount(label[on], shape.face_areas[on] * told[on, k], count) for k in (0, 1)
    )
    along = (known > 0) & (open_ <= 0.5 * known)
    number = np.where(along, int(planes.max()) + 1 + np.arange(count), -1)
    return np.where(on, number[label], planes)


def _beside_walls(shape: Shape, wall: Index, piece: NDArray[Any], links: Index) -> Mask:
    """Tell the pieces of what is rounded that end tangent to walls larger than themselves.

    Where only a small flat face lies beside a large rounded one, that is a wall and no blend.
    """
    m = shape.face_count
    first, second = np.concatenate([links, links[:, ::-1]]).T
    edge = (wall[first] < 0) & (wall[second] >= 0)
    count = int(wall.max()) + 1
    pairs = np.unique(piece[first[edge]].astype(np.int64) * count + wall[second[edge]])
    flat = wall >= 0
    areas = np.bincount(wall[flat], shape.face_areas[flat], count)
    beside = np.bincount(pairs // count, areas[pairs % count], m)
    return np.asarray(beside > np.bincount(piece, shape.face_areas, m))


def _beginnings(shape: Shape, rounded: Mask, blend: Mask, links: Index) -> Mask:
    """Tell the rest of the faces of blends, (m,): smaller pieces of what is rounded beside them."""
    m, first, second = shape.face_count, links[:, 0], links[:, 1]
    alike = rounded[first] & rounded[second] & (blend[first] == blend[second])
    piece = piece_labels(m, links[alike])
    area = np.bincount(piece, shape.face_areas, m)
    largest = np.zeros(m)
    for here, there in ((first, second), (second, first)):
        meets = rounded[here] & ~blend[here] & blend[there]
        np.maximum.at(largest, piece[here[meets]], area[piece[there[meets]]])
    return np.asarray(rounded & ~blend & (area[piece] < BEGINNING * largest[piece]))


def _mean_beside(shape: Shape, links: Index) -> Any:
    """Return the matrix (m, m) that gives each face the mean of its own value and those beside."""
    from scipy.sparse import diags_array

    m = shape.face_count
    matrix = link_matrix(m, links)
    return diags_array(1.0 / (1.0 + matrix.sum(axis=1))) @ (matrix + diags_array(np.ones(m)))


def _steps(shape: Shape, width: float) -> int:
    """Return how often means are taken so that a value spreads over a width."""
    steps = round((width / max(shape.spacing, 1e-300)) ** 2 * SPREAD)
    return min(max(steps, 1), MOST_STEPS)


def touching(cloud: MedialCloud, chosen: Mask) -> Mask:
    """Tell the faces of which a ball touches chosen faces and no others, (m,)."""
    shape, n = cloud.surface, cloud.surface.point_count
    faces = np.asarray(shape.faces)
    others = np.zeros(n, np.bool_)
    others[faces[~chosen]] = True
    second, face = cloud.features[:n, 1], cloud.contact_faces[:n]
    there = np.where(face >= 0, chosen[face], ~others[np.maximum(second, 0)])
    return np.asarray(there[faces].any(axis=1))


def balls_of(chosen: Mask, cloud: MedialCloud) -> FloatArray:
    """Return the radii of the balls at the corners of chosen faces."""
    return cloud.radii[np.unique(np.asarray(cloud.surface.faces)[chosen])]


def folded_faces(shape: Shape, links: Index, width: float) -> Mask:
    """Tell the faces beside edges that are sharp at the scale of a wall, (m,), though no crease is.

    Chamfers and small fillets turn in steps. Each face takes the mean normal of its neighbours, so
    often that this spreads over `width`: beside an edge of 50 degrees it is 25 degrees off, on a
    cylinder none, and where a bend of the inner radius of two widths begins 7.
    """
    mean, normals = _mean_beside(shape, links), np.array(shape.face_normals)
    for _ in range(_steps(shape, width)):
        normals = mean @ normals
    length = np.linalg.norm(normals, axis=1)
    cosine = np.einsum("fa,fa->f", normals, shape.face_normals) / np.where(length > 0, length, 1.0)
    return np.asarray(cosine < FOLDED)


def wide_samples(cloud: MedialCloud, creases: Creases, least_angle: float) -> Mask:
    """Tell the samples whose ball touches an opposite wall, (n,), and no edge of it."""
    shape, n = cloud.surface, cloud.surface.point_count
    sharp = np.zeros(n, np.bool_)
    sharp[creases.vertices] = True
    wide = cloud.valid[:n] & ~sharp & (np.nan_to_num(cloud.spoke_angles[:n]) > least_angle)
    spoke = cloud.contacts[:n] - cloud.centers[:n]
    along = np.einsum("ij,ij->i", spoke, cloud.contact_normals[:n])
    wide &= np.nan_to_num(along) > TANGENT * cloud.radii[:n]
    second, face = cloud.features[:n, 1], cloud.contact_faces[:n]
    held = cloud.contact_weights[:n] > LEAST_WEIGHT
    corners = np.asarray(shape.faces)[np.maximum(face, 0)]
    on_edge = (held.sum(axis=1) < 3) & (sharp[corners] | ~held).all(axis=1)
    edge = np.where(face >= 0, on_edge, sharp[np.maximum(second, 0)])
    return np.asarray(wide & ~edge)


def _smooth_links(shape: Shape, creases: Creases) -> Index:
    """Return the pairs of faces (e, 2) that hang together across edges that are no creases."""
    first, second, _ = shape.edge_table.pairs
    parted = np.zeros(3 * shape.face_count, np.bool_)
    parted[creases.half_edges.ravel()] = True
    smooth = ~parted[first]
    return np.stack([first[smooth] // 3, second[smooth] // 3], axis=1).astype(np.int64)


def _pieces(chosen: Mask, links: Index) -> IntArray:
    """Give numbers to the connected pieces of chosen faces; -1: tiny ones, and all others."""
    inner = links[chosen[links].all(axis=1)]
    piece = np.where(chosen, piece_labels(len(chosen), inner), -1)
    size = np.bincount(piece[chosen], minlength=1)
    piece[(piece >= 0) & (size[piece] < LEAST_FACES)] = -1
    result = np.full(len(chosen), -1, np.int32)
    result[piece >= 0] = np.unique(piece[piece >= 0], return_inverse=True)[1]
    return result


def _grown(cloud: MedialCloud, label: IntArray, links: Index) -> tuple[IntArray, Index]:
    """Let sides go on over smooth faces, each face with the nearest one that has an opposite."""
    shape = cloud.surface
    faces, normals = np.asarray(shape.faces), shape.face_normals
    plane = np.full(len(faces), -1) if shape.planes is None else shape.planes
    middle = shape.points[faces].mean(axis=1)
    half = cloud.radii[: shape.point_count][faces].mean(axis=1)
    limit = FARTHEST * half + ROWS * shape.spacing
    both = np.concatenate([links, links[:, ::-1]])
    source = np.where(label >= 0, np.arange(len(label)), -1)
    distance = np.where(label >= 0, 0.0, np.inf)
    moved = label >= 0
    while True:
        rows = np.flatnonzero(moved[both[:, 0]])
        here, there = both[rows].T
        origin = source[here]
        new = np.linalg.norm(middle[there] - middle[origin], axis=1)
        better = (new < distance[there]) & (new < limit[origin])
        better &= np.einsum("ij,ij->i", normals[origin], normals[there]) > STRAIGHT
        better &= plane[origin] == plane[there]
        there, new, origin = there[better], new[better], origin[better]
        if len(there) == 0:
            break
        order = np.lexsort((origin, new, there))
        chosen = order[np.unique(there[order], return_index=True)[1]]
        moved = np.zeros(len(label), np.bool_)
        moved[there[chosen]] = True
        distance[there[chosen]], source[there[chosen]] = new[chosen], origin[chosen]
    return np.where(source >= 0, label[source], -1).astype(np.int32), source


def _united(
    cloud: MedialCloud, wide: Mask, core: Mask, label: IntArray, source: Index, links: Index
) -> Sides:
    """Join sides that go on into each other with the same thickness; mark those that do not."""
    count = int(label.max(initial=-1)) + 1
    sides = Sides(cloud, wide, label, core, np.zeros(count, np.bool_))
    ends = label[links]
    meeting = links[(ends[:, 0] != ends[:, 1]) & (ends >= 0).all(axis=1)]
    if len(meeting) == 0:
        return sides
    corners = np.asarray(cloud.surface.faces)[meeting]
    shared = (corners[:, 0][:, :, None] == corners[:, 1][:, None, :]).any(axis=2)
    edge = np.argsort(~shared, axis=1, kind="stable")[:, :2]  # the two corners both faces have
    vertex = np.take_along_axis(corners[:, 0], edge, axis=1)
    pair = label[meeting]
    middle, half = np.full((2, *vertex.shape, 3), np.nan), np.full((2, *vertex.shape), np.nan)
    row = np.empty(cloud.surface.point_count, np.int64)
    for number in np.unique(pair):
        one = side_of(sides, int(number))
        row[one.vertices] = np.arange(len(one.vertices))
        for k in (0, 1):
            mine = pair[:, k] == number
            here = row[vertex[mine]]
            middle[k, mine], half[k, mine] = one.middle[here], one.half[here]
    thinner = np.minimum(half[0], half[1])
    steps = np.abs(half[0] - half[1]) / thinner
    folds = np.linalg.norm(middle[0] - middle[1], axis=2) / thinner
    fits = ((steps < ALIKE) & (folds < FLUSH)).all(axis=1)
    pairs, which = np.unique(np.sort(pair, axis=1), axis=0, return_inverse=True)
    alike = np.bincount(which.ravel(), np.where(fits, 1.0, -1.0)) > 0
    new = piece_labels(count, pairs[alike])
    number = np.unique(new, return_inverse=True)[1].astype(np.int32)
    abrupt = np.zeros(int(number.max()) + 1, np.bool_)
    apart = pairs[~alike]
    abrupt[number[apart[new[apart[:, 0]] != new[apart[:, 1]]]]] = True
    joined = np.where(label >= 0, number[label], -1).astype(np.int32)
    return Sides(cloud, wide, joined, core, abrupt)


def side_of(sides: Sides, number: int) -> Side:
    """Return one side with the middle of the wall behind each of its vertices.

    Behind a wide vertex it is the center of its ball. Elsewhere half the thickness goes on as a
    linear function of the place, fitted to the nearest balls, along the normal of the side.
    """
    shape, cloud = sides.shape, sides.cloud
    rows = np.flatnonzero(sides.label == number)
    corners = np.asarray(shape.faces)[rows]
    vertices, faces = np.unique(corners, return_inverse=True)
    faces = faces.reshape(-1, 3)
    inside = np.zeros(shape.point_count, np.bool_)
    inside[np.asarray(shape.faces)[rows[sides.core[rows]]]] = True
    known = inside[vertices] & sides.wide[vertices]
    points, half = shape.points[vertices], np.array(cloud.radii[vertices])
    normals = _side_normals(vertices, faces, shape, rows)
    half[~known] = _extended(points[known], half[known], points[~known], normals[~known])
    middle = points - half[:, None] * normals
    middle[known] = cloud.centers[vertices[known]]
    return Side(vertices.astype(np.int64), faces.astype(np.int64), rows, middle, half)


def _side_normals(
    vertices: NDArray[Any], faces: NDArray[Any], shape: Shape, rows: Index
) -> FloatArray:
    """Return unit normals of the vertices by the faces of the side alone, weighted by angle."""
    points = shape.points[vertices]
    total = np.zeros_like(points)
    for j, weight in enumerate(_angles(points[faces])):
        np.add.at(total, faces[:, j], weight[:, None] * shape.face_normals[rows])
    normals = unit_rows(total)
    if shape.cylinders is None:
        return normals
    corners = np.repeat(rows, 3), faces.ravel()
    return corner_normals(normals, vertices, *corners, shape, shape.cylinders)


def _angles(corners: FloatArray) -> Iterator[FloatArray]:
    """Go through the angles of triangles (f, 3, 3) at their three corners, in radians."""
    for j in range(3):
        left = corners[:, (j + 1) % 3] - corners[:, j]
        right = corners[:, (j + 2) % 3] - corners[:, j]
        cross = np.linalg.norm(np.cross(left, right), axis=1)
        yield np.arctan2(cross, np.einsum("ij,ij->i", left, right))


def _extended(
    known: FloatArray, values: FloatArray, places: FloatArray, normals: FloatArray
) -> FloatArray:
    """Return values at places by linear functions through those at the nearest known points.

    The slope is at most that of the steepest wall that counts as one.
    """
    if len(places) == 0:
        return np.empty(0)
    tree, k = kd_tree(known), min(NEIGHBOURS, len(known))
    distance, first = tree.query(places)
    back = (known[first] - places) / np.where(distance > 0, distance, 1.0)[:, None]
    step = np.maximum(distance, values[first] / 2)[:, None]
    behind = [known[first] + turn * step * back for turn in range(3)]
    near = np.concatenate([tree.query(place, k=[*range(1, k + 1)])[1] for place in behind], axis=1)
    away = known[near] - places[:, None]
    away = away - np.einsum("qka,qa->qk", away, normals)[..., None] * normals[:, None]
    middle, mean = away.mean(axis=1), values[near].mean(axis=1)
    shifted = away - middle[:, None]
    spread = np.einsum("qka,qkb->qab", shifted, shifted)
    size = np.trace(spread, axis1=1, axis2=2)[:, None, None] + 1e-300
    right = np.einsum("qka,qk->qa", shifted, values[near] - mean[:, None])
    slope = np.linalg.solve(spread + 1e-9 * size * np.eye(3), right[..., None])[..., 0]
    steep = np.linalg.norm(slope, axis=1)
    slope *= np.minimum(1.0, STEEPEST / np.maximum(steep, 1e-300))[:, None]
    result = mean - np.einsum("qa,qa->q", slope, middle)
    return np.maximum(result, LEAST_LEFT * mean)


ABRUPT = 0.9  # halved 0 %, doubled 12 %
"""Factor of the area of a side that ends before another one of a different thickness: where the
opposite side ends at an edge of the step, that one tells better where the sheet ends."""

UNCOVERED = 0.3  # halved 0 %, doubled 0 %
"""Share of the opposite of a side that no sheet has yet, from which on it makes one."""

ON_RIM = 0.02  # halved 4 %, doubled 20 %
"""Half thicknesses: so near to the surface a sheet has come to the rim."""

FARTHEST_PIECE = 3.0  # halved 100 %, doubled 4 %
"""Largest half thickness of all walls, as the unit: how far sheets are extended at most."""

UNDER_FILLETS = 7.0
"""The same where there are fillets: they may be two walls wide, and the sheet goes on below."""

ROUND = 0.95  # halved 0.8 %, doubled 0.8 %
"""Cosine of 18 degrees: a face whose corners have normals that differ by more is not rounded."""

ALONG_RIM = 0.7  # halved 0 %, doubled 2 %
"""Cosine: a rim that leads on more steeply than this is a ragged one, and leads nowhere."""

EVEN_WALL, UNEVEN_SHARE = 0.01, 0.1
"""Half thicknesses: the middle of a round wall is a cylinder where it lies no farther off, but for
such a share of its vertices."""

ALONG_AXIS = 0.9
"""Cosine: the border of a round wall that leads on so is an end of it."""

NEAREST = 24  # halved 2 %, doubled 0.4 %
"""Faces whose mean normal tells the plane in which a border is extended."""

SMOOTHINGS = 4  # halved 15 %, doubled 13 %
"""Of the directions in which a border is extended, along the border."""

OUT_OF_WALL = 2.5  # halved 17 %, doubled 100 %
"""Half thicknesses: how far from the border of a sheet the rim of its wall may be; what is extended
farther must lead to another sheet."""

LEAST_AREA = 2.0  # halved 0 %, doubled 100 %
"""Squares of its thickness: what lies between opposite walls of a sheet, at least."""

GROWN, CORE, OUT, AHEAD = 0, 1, 2, 3
"""What the faces of a sheet are."""

STEPS = 48  # halved 1 %, doubled < 0.1 %
"""Of the march to the surface; each ends at the sphere of the distance."""

ARRIVED = 1e-4  # halved 0.2 %, doubled < 0.1 %
"""Share of the way at most: a step as short as this has come to the surface."""


@dataclass(frozen=True, eq=False)
class RawSheet:
    """A sheet with all that may have to be cut off.

    Attributes
    ----------
    points : (k, 3) float64
    faces : (f, 3) int32
    half : (k,) float64
        Half the thickness.
    kind : (f,) int32
        CORE: between two opposite walls; GROWN: where a side goes on; OUT: extended straight on to
        the surface; AHEAD: extended, and it came to no surface.
    rounds : Cylinders or None
        Cylinders in the middle of walls that are round, and the one of each face.
    """

    points: FloatArray
    faces: IntArray
    half: FloatArray
    kind: IntArray
    rounds: Cylinders | None = None

    @property
    def core(self) -> Mask:
        """Faces between two opposite walls, (f,)."""
        return np.asarray(self.kind == CORE)

    @cached_property
    def tree(self) -> NearestTree:
        """The tree of the triangles."""
        return NearestTree.of_triangles(self.points, self.faces)

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals of the faces; zero where they have no area."""
        return unit_rows(corner_vectors(self.points, self.faces))

    @cached_property
    def vertex_normals(self) -> FloatArray:
        """Unit normals of the vertices: by the areas of their faces, so that wide ones tell most.

        On the border they are weighted by angle: no diagonal that ends there counts.
        """
        count = len(self.points)
        on_border = np.zeros(count, np.bool_)
        sides = np.flatnonzero(Topology(self.faces, count).edge_twins < 0)
        corners = self.faces.ravel()
        on_border[corners[sides]] = on_border[corners[next_side(sides)]] = True
        total, areas = np.zeros_like(self.points), self.areas
        for j, angle in enumerate(_angles(self.points[self.faces])):
            weight = np.where(on_border[self.faces[:, j]], angle, areas)
            np.add.at(total, self.faces[:, j], weight[:, None] * self.normals)
        return unit_rows(total)

    @property
    def areas(self) -> FloatArray:
        """Area of each face."""
        return twice_areas(self.points, self.faces) / 2

    @cached_property
    def thickness(self) -> float:
        """Mean thickness of its core."""
        weight = self.areas * self.core
        return float(2 * (weight * self.half[self.faces].mean(axis=1)).sum() / weight.sum())

    def offsets(self, places: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return the signed heights of places over the nearest face, distances, and the face."""
        distance, row = self.tree.distances(places)
        away = places - self.points[self.faces[row, 0]]
        return np.einsum("qa,qa->q", away, self.normals[row]), distance, row

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places on the smooth sheet near some others, and half the thickness there."""
        _, row = self.tree.distances(places)
        weights = nearest_on_triangles(places, self.points[self.faces[row]])
        corners = self.faces[row]
        flat = np.einsum("qj,qja->qa", weights, self.points[corners])
        # The plane through each corner: half the way there is the quadric through all three.
        normals = self.vertex_normals[corners]
        height = np.einsum("qja,qja->qj", self.points[corners] - flat[:, None], normals)
        smooth = np.einsum("qja,qa->qj", normals, self.normals[row]).min(axis=1) > ROUND
        bulge = np.einsum("qj,qj,qja->qa", weights, height, normals) / 2
        half = np.einsum("qj,qj->q", weights, self.half[corners])
        result = flat + smooth[:, None] * bulge
        if self.rounds is not None:
            on = np.flatnonzero(self.rounds.label[row] >= 0)
            result[on] = self.rounds.feet(self.rounds.label[row[on]], result[on])
        return result, half


def raw_sheets(sides: Sides) -> list[RawSheet]:
    """Return a sheet for each wall, made from the side that tells most of it, extended."""
    shape = sides.shape
    chosen = [
        sheet
        for sheet in (_as_sheet(side, sides) for side in _chosen_sides(sides))
        if float((sheet.areas * sheet.core).sum()) > LEAST_AREA * sheet.thickness**2
    ]
    if not chosen:
        return []
    surface = NearestTree.of_triangles(shape.points, np.asarray(shape.faces))
    reach = UNDER_FILLETS if sides.filleted else FARTHEST_PIECE
    farthest = reach * max(float(sheet.half.max()) for sheet in chosen)
    return [extended(sheet, surface, farthest) for sheet in chosen]


def _chosen_sides(sides: Sides) -> list[Side]:
    """Return sides whose opposites cover all others, the largest middles first."""
    shape, count = sides.shape, sides.count
    faces = np.asarray(shape.faces)
    every = [side_of(sides, number) for number in range(count)]
    areas = np.array([float(twice_areas(s.middle, s.faces).sum() / 2) for s in every])
    areas[sides.abrupt] *= ABRUPT
    core = sides.core & (sides.label >= 0)
    own = sides.label[core]
    across = sides.opposite[faces[core]]
    weight = np.repeat(shape.face_areas[core] / 3, 3)
    table = np.zeros((count, count + 1))
    np.add.at(table, (np.repeat(own, 3), across.ravel()), weight)
    chosen: list[int] = []
    for number in np.lexsort((np.arange(count), -areas)):
        total = table[number, :count].sum()
        left = total - table[number, chosen].sum()
        if total > 0 and left > UNCOVERED * total:
            chosen.append(int(number))
    return [every[number] for number in chosen]


def _as_sheet(side: Side, sides: Sides) -> RawSheet:
    fine = twice_areas(side.middle, side.faces) > 0
    kind = np.where(sides.core[side.rows][fine], CORE, GROWN).astype(np.int32)
    faces, cylinders = side.faces[fine].astype(np.int32), sides.shape.cylinders
    sheet = RawSheet(side.middle, faces, side.half, kind)
    if cylinders is not None and len(cylinders.radii):
        sheet = replace(sheet, rounds=_in_the_middle(cylinders.of_faces(side.rows[fine]), sheet))
    return sheet


def _in_the_middle(cylinders: Cylinders, sheet: RawSheet) -> Cylinders:
    """Return cylinders with the radii of the middle of their walls; those of even walls alone."""
    radii, label = np.array(cylinders.radii), np.array(cylinders.label)
    for number in np.unique(label[label >= 0]):
        vertices = np.unique(sheet.faces[sheet.core & (label == number)])
        height = cylinders.heights(np.full(len(vertices), number), sheet.points[vertices])
        depth = float(np.median(height)) if len(vertices) else math.nan
        uneven = ~(np.abs(height - depth) <= EVEN_WALL * sheet.half[vertices])
        if uneven.mean() < UNEVEN_SHARE:  # never of none
            radii[number] -= cylinders.signs[number] * depth
        else:
            label[label == number] = -1
    return replace(cylinders, radii=radii, label=frozen(label, np.int32))


def extended(sheet: RawSheet, surface: NearestTree, farthest: float) -> RawSheet:
    """Extend a sheet straight on wherever it ends within the solid, up to the surface.

    Where its border has come to the surface, it is the rim. Elsewhere each vertex of the border is
    moved on in the plane of its faces, at right angles to the border; at the ends of such a piece
    of the border along the rim. The march stops at the surface, or after `farthest`.
    """
    points, faces = sheet.points, sheet.faces
    twins = Topology(faces, len(points)).edge_twins
    border = np.flatnonzero(twins < 0)
    if len(border) == 0:
        return sheet
    corners = faces.ravel()
    a, b = corners[border], corners[border - border % 3 + (border + 1) % 3]
    middle = (points[a] + points[b]) / 2
    half = (sheet.half[a] + sheet.half[b]) / 2
    inner = surface.distances(middle)[0] > ON_RIM * half
    count = np.bincount(np.r_[a, b], minlength=len(points))
    inner &= (count[a] == 2) & (count[b] == 2)
    if not inner.any():
        return sheet
    along = unit_rows(points[b] - points[a])
    outward = np.cross(along, _normals_of_core(sheet, middle))
    direction, weight = np.zeros_like(points), np.zeros(len(points))
    for ends in (a, b):
        np.add.at(direction, ends[inner], outward[inner])
        np.add.at(weight, ends[inner], 1.0)
    moving = np.flatnonzero(weight)
    direction = _smoothed(direction, a[inner], b[inner])
    # At the end of a piece the way on is that of the rim.
    ending = np.zeros(len(points), np.bool_)
    for ends, sign in ((a, -1.0), (b, 1.0)):
        rim = ~inner & (weight[ends] == 1)
        on = sign * along[rim]
        fits = np.einsum("ia,ia->i", on, direction[ends[rim]]) > ALONG_RIM
        direction[ends[rim][fits]] = on[fits]
        direction[ends[rim][~fits]] = 0.0  # a ragged rim: the end stays where it is
        ending[ends[rim]] = True
    direction = _along_rounds(sheet, direction, border[inner] // 3, a[inner], b[inner])
    reach = _march(points, direction, moving[~ending[moving]], surface, farthest)
    _reach_of_ends(reach, direction, ending, a[inner], b[inner])
    moving = np.flatnonzero((weight > 0) & (reach > 0))
    ahead = reach > OUT_OF_WALL * sheet.half
    far = points + reach[:, None] * direction
    return _with_strip(sheet, far, moving, a[inner], b[inner], ahead)


def _normals_of_core(sheet: RawSheet, places: FloatArray) -> FloatArray:
    """Return the mean normals of the nearest faces between opposite walls: no blend bends them."""
    rows = np.flatnonzero(sheet.core)
    tree = kd_tree(sheet.points[sheet.faces[rows]].mean(axis=1))
    near = tree.query(places, k=np.arange(1, min(NEAREST, len(rows)) + 1))[1]
    return unit_rows(sheet.normals[rows[near]].sum(axis=1))


def _smoothed(direction: FloatArray, a: IntArray, b: IntArray) -> FloatArray:
    """Return unit vectors at the ends of edges a, b, each with those of its neighbours."""
    for _ in range(SMOOTHINGS):
        before = unit_rows(direction)
        direction = 2.0 * before
        np.add.at(direction, a, before[b])
        np.add.at(direction, b, before[a])
    return unit_rows(direction)


def _along_rounds(
    sheet: RawSheet, direction: FloatArray, faces: Index, a: IntArray, b: IntArray
) -> FloatArray:
    """Return directions at the ends of edges a, b of faces that are the axis of a round wall.

    Where they lead about along it, that is: from a bend a sheet goes straight on.
    """
    if sheet.rounds is None:
        return direction
    label, result = sheet.rounds.label[faces], np.array(direction)
    for ends in (a, b):
        rows = np.flatnonzero(label >= 0)
        axis = sheet.rounds.axes[label[rows]]
        along = np.einsum("ia,ia->i", direction[ends[rows]], axis)
        on = np.abs(along) > ALONG_AXIS
        result[ends[rows[on]]] = np.sign(along[on])[:, None] * axis[on]
    return result


def _march(
    points: FloatArray, direction: FloatArray, moving: Index, surface: NearestTree, farthest: float
) -> FloatArray:
    """Return how far it is to the surface from some points (0 for all others), at most."""
    reach = np.zeros(len(points))
    going = moving
    for _ in range(STEPS if len(moving) else 0):
        places = points[going] + reach[going, None] * direction[going]
        step = surface.distances(places)[0]
        reach[going] = np.minimum(reach[going] + step, farthest)
        going = going[(step > ARRIVED * farthest) & (reach[going] < farthest)]
        if len(going) == 0:
            break
    return reach


def _reach_of_ends(
    reach: FloatArray, direction: FloatArray, ending: Mask, a: IntArray, b: IntArray
) -> None:
    """Let ends on the rim go as far as their neighbours do."""
    for end, other in ((a, b), (b, a)):
        rows = ending[end] & ~ending[other] & direction[end].any(axis=1)
        cosine = np.einsum("ia,ia->i", direction[end[rows]], direction[other[rows]])
        reach[end[rows]] = reach[other[rows]] / np.maximum(cosine, 0.5)


def _with_strip(
    sheet: RawSheet, far: FloatArray, moving: Index, a: IntArray, b: IntArray, ahead: Mask
) -> RawSheet:
    """Return a sheet with two faces more at each edge a, b of which both or one end has moved."""
    n = len(sheet.points)
    new = np.full(n, -1, np.int64)
    new[moving] = n + np.arange(len(moving))
    both = (new[a] >= 0) & (new[b] >= 0)
    only_a, only_b = (new[a] >= 0) & ~both, (new[b] >= 0) & ~both
    strips = [
        np.stack([b[both], a[both], new[a[both]]], axis=1),
        np.stack([b[both], new[a[both]], new[b[both]]], axis=1),
        np.stack([b[only_a], a[only_a], new[a[only_a]]], axis=1),
        np.stack([b[only_b], a[only_b], new[b[only_b]]], axis=1),
    ]
    more = np.concatenate(strips).astype(np.int32)
    stays = ahead[a] | ahead[b]
    kind = np.concatenate([stays[both], stays[both], stays[only_a], stays[only_b]])
    points = np.concatenate([sheet.points, far[moving]])
    fine = twice_areas(points, more) > 0
    rounds = sheet.rounds
    if rounds is not None:
        none = np.full(int(fine.sum()), -1, np.int32)
        rounds = replace(rounds, label=np.concatenate([rounds.label, none]))
    return RawSheet(
        points,
        np.concatenate([sheet.faces, more[fine]]),
        np.concatenate([sheet.half, sheet.half[moving]]),
        np.concatenate([sheet.kind, np.where(kind[fine], AHEAD, OUT).astype(np.int32)]),
        rounds,
    )
