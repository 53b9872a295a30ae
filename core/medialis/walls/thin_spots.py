"""Thin spots: where a shape is thinnest, one entry a place (for thesis 3.5.1).

1. Low places of the wall thickness (`low_places`). With a threshold, a place is a connected region
   below it. Without one, a place is a prominent minimum: from it one must climb to 1.25 times its
   value before reaching anywhere thinner. Its region is all that is connected to
   it below 1.25 times its value. Such regions never overlap: if those of two minima m1 < m2 met,
   both would be connected below 1.25 m2, and m2 would reach the lower m1 without climbing that
   high. One or two samples that are far too low (a fold, a bad normal) make no place there: minima
   are those of the third lowest value round each sample.
2. What a place is (`WallBalls`): a wall; an overlap, where parts of a mesh overlap and the value is
   how deep they do; or a speck, which a few samples make that are far too low.
3. The thinnest place near a ball, as a caliper finds it (`close_caliper`). Both contacts of the
   ball move over the faces of their sides, from patch to patch, while the ball between them gets
   smaller: the wall is thinnest between samples as a rule, or at one whose normal leans.
4. `thin_spots`: places are looked for again without the balls of specks and overlaps.

The ball that is tangent at a place a with the normal n and goes through b has the diameter
|a - b| / cos(angle of n and a - b). No ball that touches the surface at a is larger, nor at b, so
the larger of the two diameters is never below the thickness. They are |a - b| where the distance is
the least in all directions: only there, and at the sharp end of a wall, is it said to be the
thickness. Along a rounded rim, where |a - b| falls to 0, the diameters stay what they are, and
normals of facets are too rough to tell more than the balls of the samples do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import islice
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from medialis.base.arrays import Described, Index, Mask, kd_tree
from medialis.base.box_tree import nearest_on_triangles
from medialis.base.options import algorithm, length, number, whole
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, frozen, hold
from medialis.shape.graph import CLOUD_NEIGHBOURS, TWICE, Enclosure
from medialis.shape.shape import Shape
from medialis.shape.surface import linked_rows
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import balls_of, shape_or_cloud
from medialis.walls.thickness import (
    WallThicknessOptions,
    least_wall_angle,
    thickness_field,
    thickness_without,
    wall_balls,
    wall_thickness,
)

if TYPE_CHECKING:
    from medialis.walls._kernels import Patch

SpotKind = Literal["wall", "overlap"]

LOOKED_AT = 10  # halved 0 %, doubled 0 %
"""Places are looked at, thinnest first, until enough are walls, but no more than so many times the
number that was asked for."""

ROUNDS = 8  # halved 0 %, doubled 0 %
"""Times that places are looked for again, at most, because some were specks or overlaps."""

PROMINENCE = 0.25  # halved 100 %, doubled 99 %
"""Share of its value that one climbs from a minimum before it is a place of its own. Places at 0.1,
0.25, 0.5 and 1: hand 5, 5, 5, 4 (its five fingers), bunny 7, 6, 4, 3, scapula 23, 12, 11, 6."""

FEWEST, FEWEST_BELOW_SPACING = 6, 15  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Samples of a place without a threshold: three on each side of a wall; where it is thinner than
the samples are apart, more than a sample and its six neighbours on each side. Fewer that are far
below all around them are a flaw of the mesh (folds on horse2 and spider have 1 to 11), unless they
are all of a component."""

# halved 0 %, doubled 0 %; halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
FEWEST_CRUMPLED, THIN, CRUMPLED = 38, 2.0, math.cos(math.radians(120.0))
"""The same where a wall thinner than two spacings has faces that bend by more than 120 degrees: a
sample and its two rings of neighbours on each side (crumples on horse2 have 20 to 28)."""

FEWEST_BALLS, FEWEST_THICK_BALLS = 3, 2  # halved 0 %, doubled 56 %; halved 0 %, doubled 0 %
"""Balls between two walls of a place without a threshold, and of one thicker than two spacings: one
alone, among samples whose values are those of others, is a flaw. In a noisy limb there are few."""

STARTS, APART = 6, 4.0  # halved 19 %, doubled 28 %; halved 14 %, doubled 28 %
"""Balls of a place that its thinnest place is looked for from, and how many spacings they are
apart, at least: a long wall has several low places."""

RINGS = 2  # halved 10 %, doubled 0.6 %
"""Rings of faces round a contact that make a patch."""

STEPS = 24  # halved 0 %, doubled 0 %
"""Patches on the way down, at most: the lowest sample lies a few rings from the lowest place."""

CONVEX = math.cos(math.radians(30.0))  # halved 9 %, doubled 30 %
"""A side of a wall ends where it bends outward by more than 30 degrees: at a sharp edge."""

LEANING = math.cos(math.radians(60.0))  # halved 3 %, doubled 20 %
"""Faces that lean more than 60 degrees from across the wall are no side of it."""

ACROSS = math.cos(math.radians(30.0))  # halved 4 %, doubled 20 %
"""Normals at the two places lean no more from the line between them than in a wall that tapers by
60 degrees."""

STEEP = math.cos(math.radians(15.0))  # halved 18 %, doubled 21 %
"""A vertex with a face that leans more than this from its normal is at a crease: the normal is a
mean over faces of two sides, and leans itself."""

ALIKE = 1e-3
"""Share of a thickness: of walls that differ by less the middle counts."""

EQUAL = 1e-9  # halved 0 %, doubled 0 %
"""Relative: lengths that differ by less are the same one."""

NEARER, ON_CREASE = 1e-6, 1e-6  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Shares: of its length by which a caliper that is not the least is longer than another one, and of
an edge and the diagonal within which an end lies on a crease."""


@dataclass(frozen=True, eq=False)
class LowPlace:
    """A region where a field is low.

    Attributes
    ----------
    vertex : int
        The lowest sample.
    value : float
        The field there; without a threshold, the third lowest value round it where that is a
        prominence higher.
    vertices : (v,) int32
        All samples of the region, ascending.
    persistence : float
        From its value to where the place ends: the threshold, else the lowest height over which
        one reaches a lower place, and the largest one where there is none.
    """

    vertex: int
    value: float
    vertices: IntArray
    persistence: float


class PlaceGraph:
    """The graph on which places are connected: edges, or near samples, and balls across a wall.

    Parameters
    ----------
    shape : Shape
        n samples.
    walls : (w, 2) int
        Samples on both sides of walls.
    """

    def __init__(self, shape: Shape, walls: IntArray) -> None:
        from medialis.walls._kernels import Links

        edges = shape.edges if shape.faces is not None else _cloud_links(shape)
        links = np.concatenate([edges, walls])
        first, neighbours, self._times = linked_rows(shape.point_count, links)
        self.links = Links(first[:-1], first[1:].copy(), neighbours)

    def take_out(self, walls: IntArray) -> None:
        """Take some walls out again."""
        from medialis.walls._kernels import take_out

        take_out(walls, self._times, self.links)


def low_places(
    graph: PlaceGraph, field: FloatArray, *, level: float = 0.0, prominence: float = 0.25
) -> Iterator[LowPlace]:
    """Go through the low places of a field (n,), 0 or more, the lowest first.

    `level` is the threshold, 0 for none. Ties: the lowest sample first. Where the field is inf,
    nothing is.
    """
    from medialis.walls._kernels import third_lowest

    if level > 0:
        rows = np.flatnonzero(field < level)
        starts = rows[np.argsort(field[rows], kind="stable")]
        lives = level - field[starts]
        return _regions(field, (starts, field[starts], np.full(len(starts), level), lives), graph)
    ratio = 1.0 + prominence
    calm = np.empty_like(field)  # the third lowest value round each sample
    third_lowest(field, graph.links, calm)
    rows, heights = _prominent(calm, field, graph, ratio)
    # A sample so much lower than those round it that it could be a place of its own is a speck.
    depth = np.where(calm[rows] < ratio * field[rows], field[rows], calm[rows])
    turn = np.lexsort((rows, field[rows], calm[rows], depth))
    depth = depth[turn]
    lives = np.subtract(heights[turn], depth, out=np.zeros_like(depth), where=depth < np.inf)
    return _regions(calm, (rows[turn], depth, ratio * calm[rows[turn]], lives), graph)


def _cloud_links(shape: Shape) -> IntArray:
    n, k = shape.point_count, min(CLOUD_NEIGHBOURS + 1, shape.point_count)
    near = shape.tree.query(shape.points, k=k)[1].reshape(n, k)
    links = np.stack([np.repeat(np.arange(n), k), near.ravel()], axis=1)
    return frozen(links[links[:, 0] != links[:, 1]], np.int32)


def _prominent(
    calm: FloatArray, field: FloatArray, graph: PlaceGraph, ratio: float
) -> tuple[Index, FloatArray]:
    """Return the minima from which one climbs to a ratio of their value, and to what height."""
    from medialis.walls._kernels import climbs, find_basins, list_passes

    basin, heights = np.empty(len(field), np.int32), np.zeros(len(field))
    find_basins(calm, field, graph.links, basin)
    passes = np.empty((len(graph.links.neighbours), 2), np.int32)
    passes = passes[: list_passes(basin, calm, field, graph.links, passes)]
    passes = passes[np.argsort(calm[passes[:, 0]], kind="stable")]
    climbs(passes, basin, calm, field, heights)
    lowest = basin == np.arange(len(basin))
    rows = np.flatnonzero(lowest | ((heights > 0.0) & (heights >= ratio * calm)))
    return rows, heights[rows]


def _regions(
    field: FloatArray, starts: tuple[Index, FloatArray, FloatArray, FloatArray], graph: PlaceGraph
) -> Iterator[LowPlace]:
    """Collect what lies below its level round each start: samples, values, levels, persistence."""
    from medialis.walls._kernels import flood_below

    label, queue = np.full(len(field), -1, np.int32), np.empty(len(field), np.int32)
    number = 0
    for start, depth, level, lives in zip(*(column.tolist() for column in starts), strict=True):
        if label[start] >= 0 or depth == np.inf:
            continue
        size = flood_below(start, level, field, graph.links, number, label, queue)
        number += 1
        yield LowPlace(start, depth, frozen(np.sort(queue[:size]), np.int32), lives)


@dataclass(frozen=True)
class Caliper:
    """Two places on opposite sides of a wall.

    Attributes
    ----------
    ends : (2, 3) float64
    faces : two (f,) int arrays
        The faces that each of them lies on, those of its side of the wall.
    thickness : float
        Diameter of the ball between them.
    """

    ends: FloatArray
    faces: tuple[Index, Index]
    thickness: float

    @property
    def length(self) -> float:
        """Distance of the two places."""
        return math.dist(*self.ends.tolist())


class PatchRoom:
    """What patches of faces of a mesh are listed in.

    Parameters
    ----------
    shape : Shape
        n samples and m faces.
    """

    def __init__(self, shape: Shape) -> None:
        from medialis.walls._kernels import Mesh

        assert shape.faces is not None
        self.shape, self.faces = shape, shape.faces
        self._mesh = Mesh(
            shape.points, shape.normals, shape.faces, shape.face_normals, shape.face_adjacency
        )
        self._marked = np.zeros(shape.face_count, np.uint8)
        self._known = np.zeros(shape.point_count, np.int32)
        self._listed = np.empty(shape.face_count, np.int64)

    def around(self, seeds: Index, rings: int) -> Index:
        """Return some faces and those round them, so many rings, ascending."""
        from medialis.walls._kernels import list_around

        fans, marks = self.shape.fans, (self._marked, self._known)
        count = list_around(
            seeds, rings, self.faces, fans.offsets, fans.indices, *marks, self._listed
        )
        return np.sort(self._listed[:count])

    def side(self, seeds: Index, outward: FloatArray) -> Index:
        """Return the faces round some seeds that are of the same side of a wall, ascending."""
        from medialis.walls._kernels import list_side

        near, room = self.around(seeds, RINGS), (self._marked, self._listed)
        count = list_side(near, seeds, outward, self._mesh, LEANING, CONVEX, *room)
        return np.sort(self._listed[:count])

    def patch(self, faces: Index) -> Patch:
        """Return some faces as a patch."""
        from medialis.walls._kernels import Patch, fill_patch, list_corners

        count = len(faces)
        corners = np.empty(3 * count, np.int32)
        corners = np.sort(corners[: list_corners(faces, self.faces, self._known, corners)])
        vertices, own = np.empty((len(corners), 6)), np.empty((count, 3), np.int64)
        edges = np.empty(3 * count, np.int64)
        fill_patch(faces, corners, self._mesh, STEEP, self._known, vertices, own, edges)
        return Patch(vertices, own, np.stack(np.divmod(np.unique(edges), len(corners)), axis=1))


def close_caliper(room: PatchRoom, start: Caliper) -> Caliper | None:
    """Move both ends over their sides of a wall until it gets no thinner.

    Parameters
    ----------
    room : PatchRoom
        Of a mesh.
    start : Caliper
        Contacts of a ball between two walls, and faces there.

    Returns
    -------
    Caliper or None
        None where the distance of the ends is the least neither in all directions nor up to sharp
        edges where a wall ends: along a rounded rim, at a fingertip, or where the sides meet in an
        edge. The ball says what is known there.

    Notes
    -----
    Cost: some milliseconds; a step measures all pairs of vertices, edges and faces of two patches.
    """
    shape = room.shape
    # The ball touches the smooth surface, the caliper the faces: only calipers are compared.
    here = replace(start, thickness=math.inf)
    across = (start.ends[0] - start.ends[1]) / max(start.length, 1e-300)
    for _ in range(STEPS):
        one, other = room.side(here.faces[0], across), room.side(here.faces[1], -across)
        if not len(one) or not len(other):
            break
        ends, thickness = _thinnest_places(room, one, other, here.ends)
        if math.dist(*ends.tolist()) <= EQUAL * shape.diagonal:
            return None
        if thickness >= here.thickness * (1.0 - EQUAL):
            break
        faces = _faces_at(shape, one, ends[0]), _faces_at(shape, other, ends[1])
        here = Caliper(ends, faces, thickness)
    return here if _is_least(room, here) or _ends_wall(shape, here) else None


def _sharp(shape: Shape, faces: Index, across: IntArray) -> Mask:
    """Tell the sides (f, 3) of faces that are convex creases."""
    assert shape.faces is not None
    normals, points = shape.face_normals, shape.points
    bent = np.einsum("fa,fja->fj", normals[faces], normals[across]) < CONVEX
    ahead = points[shape.faces[across]].mean(axis=2) - points[shape.faces[faces, 0]][:, None]
    return np.asarray(bent & (np.einsum("fa,fja->fj", normals[faces], ahead) < 0))


def _faces_at(shape: Shape, patch: Index, place: FloatArray) -> Index:
    """Return the faces of a patch that a place lies on."""
    assert shape.faces is not None
    corners = shape.points[shape.faces[patch]]
    weights = nearest_on_triangles(np.repeat(place[None], len(patch), axis=0), corners)
    apart = np.linalg.norm(np.einsum("fj,fja->fa", weights, corners) - place, axis=1)
    return patch[apart <= apart.min() + EQUAL * shape.diagonal]


def _is_least(room: PatchRoom, caliper: Caliper) -> bool:
    """Tell whether no face round one end is nearer to the other end."""
    for j in (0, 1):
        corners = room.shape.points[room.faces[room.around(caliper.faces[j], 1)]]
        other = np.repeat(caliper.ends[1 - j][None], len(corners), axis=0)
        feet = np.einsum("fj,fja->fa", nearest_on_triangles(other, corners), corners)
        if np.linalg.norm(feet - other, axis=1).min() < caliper.length * (1.0 - NEARER):
            return False
    return True


def _ends_wall(shape: Shape, caliper: Caliper) -> bool:
    """Tell whether both ends lie on convex creases."""
    assert shape.faces is not None
    for place, faces in zip(caliper.ends, caliper.faces, strict=True):
        side, crease = np.nonzero(_sharp(shape, faces, shape.face_adjacency[faces]))
        corners = np.asarray(shape.faces)[faces[side]]
        rows = np.arange(len(side))
        first, last = (shape.points[corners[rows, (crease + step) % 3]] for step in (0, 1))
        off = np.linalg.norm(np.cross(last - first, place - first), axis=1)
        long = np.linalg.norm(last - first, axis=1)
        if not (off <= ON_CREASE * long * shape.diagonal).any():
            return False
    return True


def _thinnest_places(
    room: PatchRoom, one: Index, other: Index, before: FloatArray
) -> tuple[FloatArray, float]:
    """Return places of two patches with the smallest ball between them, (2, 3), and its diameter.

    Two triangles are closest at a corner of one of them, or on an edge of each. Of equal balls the
    one nearest to the places before is taken. The places stay, and the diameter is inf, where no
    two faces face each other.
    """
    from medialis.walls._kernels import Search, try_corners, try_edges

    a, b, touching = room.patch(one), room.patch(other), EQUAL * room.shape.diagonal
    result = np.full(3, np.inf), np.array(before)
    search = Search(before, ACROSS, touching, EQUAL, *result, np.empty(6), np.empty(6))
    try_corners(a, b, False, search)
    try_corners(b, a, True, search)
    try_edges(a, b, search)
    return search.ends, float(search.best[1])


class WallBalls:
    """The balls between two walls, and what they tell of places.

    Parameters
    ----------
    cloud : MedialCloud
    options : WallThicknessOptions
        Of the field that the places are those of: `share`, and the angle of walls, which is at
        least `WALL_ANGLE`.
    with_threshold : bool
        Whether places are regions below a threshold: then specks are places, too.
    """

    def __init__(
        self, cloud: MedialCloud, options: WallThicknessOptions, *, with_threshold: bool
    ) -> None:
        rows = wall_balls(cloud, options.min_spoke_angle)
        self.balls, self.surface = cloud.subset(rows), cloud.surface
        self.share, self.with_threshold = options.share, with_threshold
        self._least_cosine = math.cos(math.pi - least_wall_angle(options.min_spoke_angle))
        enclosure = Enclosure(self.surface)
        # Each place is asked for again and again.
        self._enclosed = cache(lambda *place: float(enclosure.times(np.array([place]))[0]))
        self.marked = np.zeros(self.surface.point_count, np.bool_)

    @cached_property
    def _patches(self) -> PatchRoom:
        return PatchRoom(self.surface)

    @cached_property
    def _graph(self) -> PlaceGraph:
        return PlaceGraph(self.surface, self.balls.features)

    def leave_out(self, samples: Mask) -> bool:
        """Forget the balls of some samples; tell whether there were any."""
        gone = samples[self.balls.source]
        if not gone.any():
            return False
        self._graph.take_out(self.balls.features[gone])
        self.balls = self.balls.subset(~gone)
        return True

    def low_places(self, values: FloatArray, **how: float) -> Iterator[LowPlace]:
        """Go through the low places of a field; balls join the two sides of walls."""
        return low_places(self._graph, values, **how)

    def grown(self, samples: Mask, rings: int) -> Mask:
        """Return some samples of a mesh with so many rings of neighbours, (n,)."""
        result, border = samples.copy(), np.flatnonzero(samples)
        for _ in range(rings):
            around = self._around(border)
            border = around[~result[around]]
            result[border] = True
        return result

    def _around(self, vertices: Index) -> Index:
        """Return the vertices of the faces at some vertices, ascending."""
        surface = self.surface
        if surface.faces is None or len(vertices) == 0:
            return np.empty(0, np.int64)
        return np.unique(surface.faces[surface.fans.joined(vertices) // 3])

    def kind(self, place: LowPlace) -> Literal["wall", "overlap", "speck"]:
        """Tell what a place is: a speck has too few samples or balls, and is no whole component.

        The smallest ball of an overlap lies inside of two parts of a mesh.
        """
        surface, vertices = self.surface, place.vertices
        if surface.faces is None:
            return "wall"
        spacings = place.value / (self.share * surface.spacing)
        rows = self._rows_in(vertices)
        few = len(vertices) < (FEWEST_BELOW_SPACING if spacings < 1.0 else FEWEST)
        few |= len(rows) < (FEWEST_BALLS if spacings < THIN else FEWEST_THICK_BALLS)
        twice = len(rows) and self._enclosed(*self.balls.centers[rows[0]]) >= TWICE
        if not few and not twice and spacings < THIN and len(vertices) < FEWEST_CRUMPLED:
            few = self._crumpled(vertices)
        if few and not self.with_threshold:
            mine = np.unique(surface.components[vertices])
            if len(vertices) < np.bincount(surface.components)[mine].sum():
                return "speck"
        return "overlap" if twice else "wall"

    def _crumpled(self, vertices: IntArray) -> bool:
        """Tell whether faces at some samples bend back."""
        surface = self.surface
        faces = np.unique(surface.fans.joined(vertices) // 3)
        across, normals = surface.face_adjacency[faces], surface.face_normals
        bent = np.einsum("fa,fja->fj", normals[faces], normals[across]) < CRUMPLED
        return bool((bent & (across >= 0)).any())

    def touches(self, place: LowPlace, samples: Mask) -> bool:
        """Tell whether a place is next to some samples: it is the rest of their place."""
        return bool(samples[self._around(place.vertices.astype(np.int64))].any())

    def thinnest(self, place: LowPlace) -> tuple[FloatArray, FloatArray, float]:
        """Return both ends of the shortest line across the wall at a place, and the value there.

        Of lines that are as good as equal, that which is deepest inside of the place.
        """
        rows, surface = self._rows_in(place.vertices), self.surface
        position, value = surface.points[place.vertex], place.value
        if len(rows) == 0:
            return position, np.full(3, np.nan), value
        # What is much thinner is a speck, as in the field: the same with and without a threshold.
        least = value / (1.0 + PROMINENCE)
        sizes = 2.0 * self.share * self.balls.radii[rows]
        high = rows[sizes >= least]
        rows, sizes = (high, sizes[sizes >= least]) if len(high) else (rows, sizes)
        start = self._deepest(rows[sizes <= (1.0 + ALIKE) * sizes[0]], place.vertices)
        position = surface.points[self.balls.features[start, 0]]
        # The ball touches the smooth surface over its contact.
        center, contact = self.balls.centers[start], self.balls.contacts[start]
        away = float(np.linalg.norm(contact - center))
        opposite = center + (contact - center) * (self.balls.radii[start] / max(away, 1e-300))
        value = min(value, 2.0 * self.share * float(self.balls.radii[start]))
        if surface.faces is None:
            return position, opposite, value
        for row in (start, *self._apart(rows)):
            caliper = close_caliper(self._patches, self._caliper(row))
            most = value if row == start else value / (1.0 + ALIKE)
            if caliper is None or not self._both_in(caliper, place.vertices):
                continue
            caliper = self._on_cylinders(caliper)
            if not self._across_wall(caliper):
                continue
            if least <= self.share * caliper.length <= most:
                position, opposite = caliper.ends
                value = self.share * caliper.length
        return position, opposite, value

    def _both_in(self, caliper: Caliper, vertices: IntArray) -> bool:
        """Tell whether both ends of a caliper lie on faces with samples of a place."""
        faces = np.asarray(self.surface.faces)
        self.marked[vertices] = True
        inside = [bool(self.marked[faces[rows]].any()) for rows in caliper.faces]
        self.marked[vertices] = False
        return all(inside)

    def _on_cylinders(self, caliper: Caliper) -> Caliper:
        """Return a caliper whose ends lie on the cylinders or spheres that faces are chords of."""
        if (cylinders := self.surface.cylinders) is None:
            return caliper
        ends = np.array(caliper.ends)
        for j, faces in enumerate(caliper.faces):
            which = cylinders.label[faces]
            if len(which) and which.min() >= 0:
                ends[j] = cylinders.feet(which[:1], ends[j : j + 1])[0]
        return replace(caliper, ends=ends)

    def _across_wall(self, caliper: Caliper) -> bool:
        """Tell whether the faces at both ends taper no more than those of walls do.

        Along a rim that is rounded by few facets, as by a chamfer, the ends lie on creases as well.
        """
        one, other = (self.surface.face_vectors[rows].sum(axis=0) for rows in caliper.faces)
        size = float(np.linalg.norm(one) * np.linalg.norm(other))
        return bool(-(one @ other) >= (self._least_cosine - NEARER) * size)

    def _deepest(self, rows: Index, vertices: IntArray) -> int:
        """Return the ball, of some with samples in a place, that is farthest from its border.

        And from samples that have no ball between two walls.
        """
        if len(rows) == 1:
            return int(rows[0])
        points = self.surface.points[self.balls.source[rows]]
        depth = np.full(len(rows), np.inf)
        if self._beyond is not None:
            depth = self._beyond.query(points)[0]
        self.marked[vertices] = True
        around = self._around(vertices.astype(np.int64))
        border = around[~self.marked[around]]
        self.marked[vertices] = False
        if len(border):
            tree = kd_tree(self.surface.points[border], near=False)
            depth = np.minimum(depth, tree.query(points)[0])
        return int(rows[np.argmax(np.round(depth / self.surface.spacing, 6))])

    @cached_property
    def _beyond(self) -> Any:
        """Tree of the samples without a ball between two walls; None: there are none."""
        without = np.ones(self.surface.point_count, np.bool_)
        without[self.balls.source] = False
        return kd_tree(self.surface.points[without], near=False) if without.any() else None

    def _rows_in(self, vertices: IntArray) -> Index:
        """Return the balls of some samples, by rising radius."""
        self.marked[vertices] = True
        rows = np.flatnonzero(self.marked[self.balls.source])
        self.marked[vertices] = False
        return rows[np.argsort(self.balls.radii[rows], kind="stable")]

    def _apart(self, rows: Index) -> Iterator[int]:
        """Go through the smallest of some balls, by rising radius, that are apart."""
        points, chosen = self.surface.points[self.balls.source[rows]], 0
        while len(rows) and chosen < STARTS:
            yield int(rows[0])
            chosen += 1
            far = np.linalg.norm(points - points[0], axis=1) > APART * self.surface.spacing
            rows, points = rows[far], points[far]

    def _caliper(self, row: int) -> Caliper:
        """Return the two contacts of a ball."""
        balls, fans = self.balls, self.surface.fans
        first, second = balls.features[row]
        face = balls.contact_faces[row]
        own, other = (fans[v].astype(np.int64) // 3 for v in (first, second))
        if face >= 0:
            other = np.array([face], np.int64)
        ends = np.stack([self.surface.points[first], balls.contacts[row]])
        diameter = 2.0 * float(balls.radii[row])
        return Caliper(ends, (np.unique(own), np.unique(other)), diameter)


@dataclass(frozen=True, eq=False, repr=False)
class ThinSpot(Described):
    """A place where the shape is thin.

    Attributes
    ----------
    position : (3,) float64
        The thinnest place, on the surface; in a cloud the thinnest sample.
    opposite : (3,) float64
        The place that it faces on the other side of the wall; NaN where no ball between two walls
        is near, as in a cube.
    value : float
        The thickness there: the distance of the two places, or the ball of the thinnest sample
        where that distance has no minimum (at the end of a finger, along a sharp edge). Without a
        threshold, no less than what the third lowest sample there is a prominence above.
    kind : {"wall", "overlap"}
        "overlap" where two parts of a mesh, or a part with itself, overlap: the value tells how
        deep, not how thick a wall is.
    vertex : int
        Index of the thinnest sample.
    vertices : (v,) int32
        All samples of the place, ascending.
    area : float
        Of the surface that they stand for (a third of each face at each corner); NaN in a cloud.
    persistence : float
        How sure the place is, a length: how much the thickness rises, at least, on any way from it
        to a thinner place; where none is thinner, to the thickest place there is. 0 for a plate
        that is as thick everywhere. With a threshold, how far it is below that.
    """

    position: FloatArray
    opposite: FloatArray
    value: float
    kind: SpotKind
    vertex: int
    vertices: IntArray
    area: float
    persistence: float

    def __post_init__(self) -> None:
        hold(self, position=(3,), opposite=(3,))
        hold(self, vertices=len(self.vertices))


@dataclass(frozen=True, kw_only=True)
class ThinSpotOptions(WallThicknessOptions):
    """Options of `thin_spots`."""

    threshold: float = length(
        0.0,
        "Thin below",
        "Every connected region thinner than this share of the size is a thin spot. 0 finds the "
        "places that are thinner than all around them.",
    )
    spots: int = whole(
        10,
        "Thin spots",
        "List at most this many places of each kind, the thinnest first.",
        low=1,
        high=100_000,
    )
    prominence: float = number(
        PROMINENCE,
        "Prominence",
        "Without a threshold: how far the thickness rises around a place before it counts as one "
        "of its own, as a share of its thickness.",
        high=100.0,
        advanced=True,
    )


@algorithm(ThinSpotOptions, door=shape_or_cloud, prepare=balls_of)
def thin_spots(
    cloud: MedialCloud, options: ThinSpotOptions, progress: Progress
) -> tuple[ThinSpot, ...]:
    """List the thinnest places of a shape, thinnest first.

    Parameters
    ----------
    cloud : MedialCloud
        Balls on n samples. Those between two walls join their sides into one place.

    Returns
    -------
    tuple of ThinSpot
        Walls, then overlaps of parts (`kind`), each by rising value. No two walls have the same
        vertices, nor two overlaps.

    Raises
    ------
    InvalidShapeError
        When no inner ball is valid.

    See Also
    --------
    wall_thickness : the field whose low places these are.

    Notes
    -----
    Cost: sorting n values and the edges, 0.2 s for 194,000 vertices, and some 20 ms a place.
    Source: thesis 3.5.1 (locally thin parts).

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> spots = medialis.thin_spots(cloud)
    >>> spots[0].kind, bool(spots[0].value < spots[1].value)
    ('wall', True)
    """
    wall_thickness.of(cloud, options, progress)  # raises where there is no ball
    spots, specks = run_patiently(lambda: _find(cloud, options), progress)
    if specks:
        text = (
            f"{counted(specks, 'place', verbs=('was', 'were'))} left out that only a few "
            "samples make far thinner than all around, such as folds; a threshold counts them."
        )
        progress.note(text, "specks", places=specks)
    return spots


def _find(cloud: MedialCloud, options: ThinSpotOptions) -> tuple[tuple[ThinSpot, ...], int]:
    """Return thin spots, walls before overlaps, and the number of specks that were as thin.

    Balls of specks and of overlaps are left out, the thickness completed and its places looked for
    again: the wall round them is a place when nothing in it is thinner. What is beside specks is
    crumpled as well as a rule: each round leaves out one ring more round new ones.
    """
    share, level, field = options.share, options.threshold, thickness_field(cloud, options)
    assert field is not None
    values = share * field.values
    every = partial(WallBalls, cloud, options, with_threshold=level > 0)
    balls, level = every(), level * cloud.surface.diagonal
    flawed = specks = np.zeros(cloud.surface.point_count, np.bool_)
    found: dict[str, list[LowPlace]] = {"wall": [], "overlap": [], "speck": []}
    changed = True
    for rings in range(ROUNDS):
        before = int(flawed.sum())
        if changed:
            found["wall"], specks = [], np.zeros_like(flawed)
            low = balls.low_places(values, prominence=options.prominence)
            for place in islice(low, LOOKED_AT * options.spots):
                if len(found["wall"]) == options.spots or place.value >= (level or np.inf):
                    break
                what = balls.kind(place)
                if what == "wall" or not balls.touches(place, flawed):
                    found[what].append(place)
                if what != "wall":
                    (specks if what == "speck" else flawed)[place.vertices] = True
        flawed = flawed | balls.grown(specks, rings)
        if int(flawed.sum()) == before:
            break
        rest = field and thickness_without(cloud, flawed, options, field)
        changed = balls.leave_out(flawed) or rest is not field
        field = rest
        values = np.full(len(flawed), np.inf) if field is None else share * field.values
    if level > 0:
        found["wall"] = list(islice(balls.low_places(values, level=level), options.spots))
    spots: list[ThinSpot] = []
    kinds: tuple[SpotKind, ...] = ("wall", "overlap")
    for kind in kinds:
        places = found[kind][: options.spots]
        by = every() if kind == "overlap" and places else balls
        spots += sorted((_spot(kind, by, place) for place in places), key=lambda spot: spot.value)
    return tuple(spots), len(found["speck"])


def _spot(kind: SpotKind, balls: WallBalls, place: LowPlace) -> ThinSpot:
    surface = balls.surface
    position, opposite, value = balls.thinnest(place)
    area = np.nan if surface.faces is None else float(surface.point_areas[place.vertices].sum())
    told = kind, place.vertex, place.vertices, area, place.persistence
    return ThinSpot(position, opposite, value, *told)
