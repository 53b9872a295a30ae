"""Gaps: the room between walls that face each other, by balls outside of the shape.

Wall check: walls that are too thin or too thick, gaps that are too narrow (for thesis 3.5.1).

Too thin is a wall: a ball between two opposite faces, whose feature points are far apart as seen
from the center, and whose planes meet neither at a sharp edge (`walls/ribs.py`) nor in a rounded
rim (`rim_balls`). All other samples have the thickness of the wall around them
(`walls/thickness.py`), so that neither edges nor fillets are thin. Too thick is any place into
which a ball larger than the maximum fits: lumps, junctions of walls and round bodies alike.

A region is connected below the minimum, or above the maximum, along the surface and across the
wall; its area is that of one side of the wall (`side_area`).

The check speaks for the surface that encloses something: an open surface whose balls are outside of
it has no walls (`checked_samples`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Described, Index, Mask, kd_tree
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.graph import ENCLOSED, Enclosure
from medialis.shape.shape import Shape
from medialis.shape.surface import piece_labels
from medialis.skeleton.layers import weighted_median
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.walls.ribs import Rib, edge_balls, over_feet, ribs
from medialis.walls.thickness import (
    LargestBalls,
    Room,
    WallThicknessOptions,
    facet_heights,
    largest_balls,
    thickness_field,
    wall_thickness,
)
from medialis.walls.thin_spots import (
    PlaceGraph,
    ThinSpotOptions,
    low_places,
    thin_spots,
)

RegionKind = Literal["too thin", "too thick", "gap", "overlap", "part lines"]

LEAST_SHARE, LARGEST_SHARE = 0.5, 1.5  # halved 100 %, doubled 100 %; halved 100 %, doubled 100 %
"""Of the typical wall, where no limit is given. Moulding guides ask for no wall below 40 to 60 % of
the one beside it; a rib as thick as its wall makes 1.25 times the thickness where they meet."""

EQUAL = 1e-3
"""Of a limit: walls that differ from it by less are as thick as it says."""

UNSURE = 0.5
"""Of the height of facets: the middle of two that make a quadrangle lies a quarter of it off the
smooth surface, at the ends of pipes half of it. Where both sides of a wall are rounded, one of them
makes it thicker, the other thinner."""

ROUNDED = 3e-3
"""Of the thickness of a rounded wall: balls there are as exact as their tolerance, not exact as
between planes. Tubes, bends and corners of trays were off by up to so much."""

RIM_TAPER, RIM = 3.0, 0.6
"""Degrees and thicknesses: where a rim is rounded, the two sides are parallel up to so much at its
border, where the ball is 0.05 % smaller than the wall if the radius is 0.9 of it, and no wall any
more, at 30 degrees, so much farther out: 0.52 radii, which are at most a thickness."""

PARALLEL = 0.05
"""Degrees between flat faces that are parallel, at most. On a facet at 15 degrees or more that is
as wide as a rim at most, sides differ by more where it is thinner than its wall by `EQUAL`."""

RIM_WALLS = 16
"""Places of the wall beside a rim that are looked at: the nearest ones may be thinner as well."""

SIDE = math.cos(math.radians(45.0))
"""Faces that turn by less from a sample in a wall are of the same side of it."""

PROBES = 64
"""Balls of an open component that are tested for being inside of it."""

GROWN, GROWING, GROWTH_STEPS, GROWTH = 0.9, 16, 40, 1.1
"""Fraction of the largest diameter from which on balls are grown, how many, by how many steps, and
a bound of the first radius."""

AROUND = np.array([way for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
"""Steps around a center."""

FLAW, BESIDE = 0.25, 3  # halved 58 %, doubled 73 %; halved 0 %, doubled 0 %
"""A ball smaller than this share of the spacing counts where so many neighbours have a ball within
twice its size: along a fold there are two."""


@dataclass(frozen=True, eq=False, repr=False)
class WallRegion(Described):
    """A connected region that fails the check.

    Attributes
    ----------
    kind : {"too thin", "too thick", "gap", "overlap", "part lines"}
        "overlap": parts of the mesh overlap, by a value that is no thickness. "part lines": a wall
        that is not a number of whole lines of a nozzle.
    position, opposite : (3,) float64
        Both ends at the worst place; the second is NaN where no wall is there.
    value : float
        The thickness, or the width of the gap, there.
    most, least : float
        Over its samples.
    area : float
        Of the wall, one of its sides; without rims, blends and corners. NaN in a cloud of points.
    vertices : (v,) int
        Samples, ascending.
    """

    kind: RegionKind
    position: FloatArray
    opposite: FloatArray
    value: float
    least: float
    most: float
    area: float
    vertices: NDArray[np.integer]


@dataclass(frozen=True, eq=False, repr=False)
class WallCheck(Described):
    """What a check of walls found.

    Attributes
    ----------
    thickness : (n,) float64
        Diameter of the largest ball that touches or contains each sample.
    walls : (n,) float64
        Thickness of the wall at each sample, which is compared with the minimum; samples at edges,
        rims and folds have that of the wall around them.
    checked : (n,) bool
        Samples of bodies that enclose something; the check speaks for no others.
    largest_ball : float
        Diameter of the largest ball that fits inside.
    edge : (n,) bool
        Samples at a sharp edge: their own ball, thinner than the minimum, counts for no wall.
    flaws : int
        Balls of folds of the mesh, which were left out.
    minimum, maximum, gap : float
        The limits in the units of the shape; inf for no maximum, 0 for no minimum or gap.
    typical : float
        Median of the wall thickness over the area.
    regions : tuple of WallRegion
        Too thin, too thick, gaps, overlaps, part lines; the worst of each first.
    ribs : tuple of Rib
        The highest ratio first.
    """

    thickness: FloatArray
    walls: FloatArray
    checked: Mask
    largest_ball: float
    edge: Mask
    flaws: int
    minimum: float
    maximum: float
    gap: float
    typical: float
    regions: tuple[WallRegion, ...]
    ribs: tuple[Rib, ...]

    def of_kind(self, kind: RegionKind) -> list[WallRegion]:
        """Return the regions of a kind."""
        return [region for region in self.regions if region.kind == kind]


@dataclass(frozen=True)
class WallLimits:
    """Limits in the units of the shape; None where none is given, lines of 0 are not looked at.

    Walls miss whole lines by more than `line_tolerance` of a line; those thicker than `most_lines`
    are filled between their lines.
    """

    minimum: float | None
    maximum: float | None
    gap: float
    most_regions: int
    rib_ratio: float = math.inf
    line_width: float = 0.0
    line_tolerance: float = 0.0
    most_lines: float = 0.0


def check_walls(
    cloud: MedialCloud,
    outer: MedialCloud | None,
    limits: WallLimits,
    wall_angle: float,
    progress: Progress,
) -> WallCheck:
    """Check the walls of a shape.

    Parameters
    ----------
    cloud : MedialCloud
        Inner balls.
    outer : MedialCloud or None
        Outer balls of the same samples, for gaps.
    limits : WallLimits
        Without minimum and maximum they follow from the typical wall.
    wall_angle : float
        Degrees: least spoke angle of a ball between two sides of a wall.

    Raises
    ------
    InvalidShapeError
        When no inner ball is valid.
    """
    angle = math.radians(wall_angle)
    balls = largest_balls(cloud, progress)
    checked = run_patiently(lambda: checked_samples(cloud), progress)
    at_edge = run_patiently(lambda: edge_balls(cloud), progress)
    flaws = run_patiently(lambda: _flaws(cloud, ~at_edge & (cloud.wall_angles >= angle)), progress)
    at_rim = run_patiently(lambda: rim_balls(cloud, angle), progress)
    rest = ~(at_edge | flaws | at_rim)  # unless nothing is left
    some = not rest.all() and (cloud.valid & (cloud.side > 0) & rest).any()
    walls = cloud.subset(rest) if some else cloud
    values = wall_thickness.of(walls, WallThicknessOptions(min_spoke_angle=wall_angle), progress)
    assert balls is not None  # `wall_thickness` has raised
    typical = weighted_median(values, cloud.surface.point_areas)
    least, largest = limits.minimum, limits.maximum
    if least is None and largest is None:
        least, largest = LEAST_SHARE * typical, LARGEST_SHARE * typical
    minimum, maximum = least or 0.0, largest or math.inf
    rows = np.flatnonzero((walls.side > 0) & (walls.wall_angles >= angle))
    thick = run_patiently(lambda: _Thick(cloud, balls, checked), progress)
    regions = _thin(walls, values, minimum, limits, wall_angle, progress)
    regions = [region for region in regions if checked[region.vertices].any()]
    if maximum < math.inf:
        regions += run_patiently(lambda: thick.regions(maximum, limits.most_regions), progress)
    if outer is not None and limits.gap > 0:
        regions += run_patiently(lambda: _gaps(outer, limits, angle), progress)
    if limits.line_width > 0:
        lines = walls, values, rows, minimum, limits
        regions += run_patiently(lambda: _part_lines(*lines), progress)
    standing = run_patiently(lambda: ribs(walls, values, rows, cloud.inner.own), progress)
    order: tuple[RegionKind, ...] = ("too thin", "too thick", "gap", "overlap", "part lines")
    regions.sort(key=lambda region: order.index(region.kind))
    edge = np.zeros(len(values), np.bool_)
    edge[cloud.source[at_edge & (2.0 * cloud.radii < minimum)]] = True
    return WallCheck(
        thickness=balls.diameters,
        walls=values,
        checked=checked,
        largest_ball=thick.largest,
        edge=edge,
        flaws=int(flaws.sum()),
        minimum=minimum,
        maximum=maximum,
        gap=limits.gap,
        typical=typical,
        regions=tuple(regions),
        ribs=tuple(standing),
    )


def checked_samples(cloud: MedialCloud) -> Mask:
    """Return the samples (n,) with an inner ball in a body that encloses something.

    A closed component does. Of an open one, or a cloud, the centers of some balls must be inside.
    """
    surface = cloud.surface
    result = np.zeros(surface.point_count, np.bool_)
    inner = cloud.valid & (cloud.side > 0)
    result[cloud.source[inner]] = True
    closed = surface.closed_components[surface.components]
    if surface.faces is not None and closed.all():
        return result
    enclosure = Enclosure(surface)
    source = cloud.source[inner]
    for component in np.unique(surface.components[source[~closed[source]]]).tolist():
        rows = np.flatnonzero(inner & (surface.components[cloud.source] == component))
        rows = rows[np.linspace(0, len(rows) - 1, min(PROBES, len(rows))).astype(np.int64)]
        if (enclosure.times(cloud.centers[rows]) < ENCLOSED).mean() > 0.5:
            result[surface.components == component] = False
    return result


def _flaws(cloud: MedialCloud, walls: Mask) -> Mask:
    """Return the balls (k,) of folds: far smaller than the spacing, with few of their like beside.

    A wall that thin is known from the triangles of its sides alone, and has samples all round.
    """
    surface, result = cloud.surface, np.zeros(len(cloud), np.bool_)
    small = np.flatnonzero(walls & (cloud.side > 0))
    small = small[2.0 * cloud.radii[small] < FLAW * surface.spacing]
    if surface.faces is None or len(small) == 0:
        return result
    sizes = np.full(surface.point_count, np.nan)
    sizes[cloud.source[small]] = cloud.radii[small]
    a, b = surface.edges.T
    alike = np.abs(np.log(sizes[a] / sizes[b])) <= math.log(2.0)
    beside = np.bincount(np.concatenate([a[alike], b[alike]]), minlength=surface.point_count)
    result[small] = beside[cloud.source[small]] < BESIDE
    return result


def rim_balls(cloud: MedialCloud, least_angle: float) -> Mask:
    """Return the inner balls (k,) between the two sides of a wall that ends in a rounded rim there.

    The wall beside has parallel sides and faces the same way, beyond it is no wall. Between the two
    its own sides are not parallel: by more than a few degrees, or they are less thick than the
    taper of the wall beside explains, since normals say little where few facets round a rim.
    """
    result, surface = np.zeros(len(cloud), np.bool_), cloud.surface
    angles = cloud.wall_angles
    rows = np.flatnonzero((cloud.side > 0) & (angles >= least_angle))
    is_flat = angles[rows] >= math.pi - math.radians(RIM_TAPER)
    beyond = np.ones(surface.point_count, np.bool_)
    beyond[cloud.source[rows]] = False
    if surface.faces is None or not is_flat.any() or not beyond.any():
        return result
    flat, points = rows[is_flat], surface.points
    rows = rows[tapers := angles[rows] < math.pi - math.radians(PARALLEL)]
    is_flat = is_flat[tapers]
    near = 2.0 * RIM * cloud.radii[rows] + surface.spacing
    ends = kd_tree(points[beyond]).query(points[cloud.source[rows]])[0] < near
    rows, is_flat, near = rows[ends], is_flat[ends], near[ends]
    count = min(RIM_WALLS, len(flat))
    away, walls = kd_tree(points[cloud.source[flat]]).query(points[cloud.source[rows]], k=count)
    away, walls = away.reshape(-1, count), flat[walls.reshape(-1, count)]
    expected = 2.0 * cloud.radii[walls] - away * (math.pi - angles[walls])
    thinner = expected * (1.0 - EQUAL) > 2.0 * cloud.radii[rows, None]
    normals = surface.normals
    same = np.einsum("ra,rwa->rw", normals[cloud.source[rows]], normals[cloud.source[walls]]) > SIDE
    thinner &= same
    result[rows] = ((away < near[:, None]) & (thinner | ~is_flat[:, None])).any(axis=1)
    return result


def surely(cloud: MedialCloud, values: FloatArray, known: Mask, beyond: FloatArray) -> Mask:
    """Tell the samples (n,) whose wall is surely beyond a limit.

    By more than is unsure there; or where most of what is beyond the limit, or may be, is beyond:
    facets make a wall thicker here and thinner there, and half of it is as thick as it is.

    Parameters
    ----------
    cloud : MedialCloud
    values : (n,) float64
        Thickness.
    known : (n,) bool
        Samples of walls.
    beyond : (n,) float64
        How far the thickness is beyond the limit.
    """
    surface, unsure = cloud.surface, unsure_by(cloud, values)
    sure = known & (beyond > unsure)
    if surface.faces is None or not unsure.any():
        return sure
    # What is as thick as the limit counts as well: a tray is no thicker than its flat sides.
    may = known & (beyond > -unsure - 2.0 * EQUAL * values)
    links = surface.edges[may[surface.edges].all(axis=1)].astype(np.int64)
    label = piece_labels(surface.point_count, links)
    every, fails = (
        np.bincount(label[rows], surface.point_areas[rows], surface.point_count)
        for rows in (may, known & (beyond > 0))
    )
    return np.asarray(sure | (may & (fails > 0.5 * every)[label]))


def unsure_by(cloud: MedialCloud, values: FloatArray) -> FloatArray:
    """Return how much the thickness at each sample may be off, (n,), where facets are rounded.

    They are as high as the smooth surface that was put on them, which is 0 where they are so small
    that nothing was. What is flat is not off, nor is a mesh that was not refined.
    """
    surface, height = cloud.surface, facet_heights(cloud.surface)
    if surface.faces is None or surface.face_origin is None:
        return height
    faces = np.asarray(surface.faces)
    rows = np.flatnonzero(cloud.valid & (cloud.side > 0))
    result = height.copy()
    mine, other = cloud.source[rows], cloud.features[rows, 1]
    result[mine] = np.maximum(height[mine], height[other])
    rounded = height > 1e-9 * surface.diagonal
    if surface.planes is not None and (surface.planes >= 0).any():
        rounded[faces[surface.planes < 0]] = True
    rounded[mine] |= rounded[other]
    return UNSURE * result + np.where(rounded, ROUNDED * values, 0.0)


def side_area(surface: Shape, wall: NDArray[np.integer], samples: NDArray[np.integer]) -> float:
    """Return the area of one side of a wall; NaN in a cloud of points.

    Parameters
    ----------
    surface : Shape
        n samples.
    wall : (n,) int
        The sample that each has its wall from, itself or a near one; -1 for none.
    samples : (v,) int
        Of the region.

    Notes
    -----
    Half of the faces with corners whose wall is in the region, as it sees them: neither rims nor
    the further half of a fillet.
    """
    if surface.faces is None:
        return math.nan
    mine = np.zeros(surface.point_count + 1, np.bool_)  # the last one is none
    mine[samples] = True
    corners = np.asarray(wall)[np.asarray(surface.faces)]
    chosen = np.flatnonzero(mine[corners].any(axis=1))
    corners = corners[chosen]
    along = np.einsum("fa,fja->fj", surface.face_normals[chosen], surface.normals[corners])
    seen = np.where(mine[corners] & (along > SIDE), along, 0.0).mean(axis=1)
    return 0.5 * float(seen @ surface.face_areas[chosen])


def _thin(
    cloud: MedialCloud,
    values: FloatArray,
    minimum: float,
    limits: WallLimits,
    wall_angle: float,
    progress: Progress,
) -> list[WallRegion]:
    level = minimum * (1.0 - EQUAL)
    if minimum <= 0.0 or not (values < level).any():
        return []
    options = ThinSpotOptions(
        min_spoke_angle=wall_angle,
        threshold=min(level / cloud.surface.diagonal, 1.0),
        spots=limits.most_regions,
    )
    found, field = [], thickness_field(cloud, options)
    assert field is not None
    sure = surely(cloud, values, ~np.isnan(field.known), level - values)
    for spot in thin_spots.of(cloud, options, progress):
        thin = spot.kind == "wall"
        if thin and not sure[spot.vertices].any():
            continue
        kind: RegionKind = "too thin" if thin else "overlap"
        most = float(values[spot.vertices].max())
        area = side_area(cloud.surface, field.seed, spot.vertices) if thin else spot.area
        told = spot.value, spot.value, most, area, spot.vertices
        found.append(WallRegion(kind, spot.position, spot.opposite, *told))
    return found


class _Thick:
    """Where balls are large, and the largest one that fits inside.

    Parameters
    ----------
    cloud : MedialCloud
    balls : LargestBalls
        Of its samples.
    checked : (n,) bool
        Samples that count.
    """

    def __init__(self, cloud: MedialCloud, balls: LargestBalls, checked: Mask) -> None:
        self.cloud, self.balls, self.enclosure = cloud, balls, Enclosure(cloud.surface)
        self.closed = cloud.surface.closed_components[cloud.surface.components]
        self.values = np.where(checked, balls.diameters, 0.0)
        """Diameter at each sample: of its ball, or of the larger one that this ball grows to."""
        self.exact = np.zeros(len(checked), np.bool_)
        """Samples whose ball was grown between the triangles themselves."""
        self.room = None if cloud.surface.faces is None else Room(cloud.surface)
        if self.room is not None:
            self._grow(self.room)
        self.largest = float(self.values[self.exact if self.exact.any() else ...].max())

    def _grow(self, room_of: Room) -> None:
        """Move the largest balls, some apart from each other, until they grow no more.

        Balls touch samples: the largest one that fits between the triangles touches none as a rule.
        The center takes the best of several steps around it, which are halved where none is better.
        """
        surface, cloud = self.cloud.surface, self.cloud
        rows = np.unique(self.balls.rows[self.values > GROWN * self.values.max()])
        rows = rows[np.argsort(-cloud.radii[rows], kind="stable")]
        chosen: list[int] = []
        while len(rows) and len(chosen) < GROWING:
            row = int(rows[0])
            chosen.append(row)
            far = np.linalg.norm(cloud.centers[rows] - cloud.centers[row], axis=1)
            rows = rows[far > 0.5 * cloud.radii[row]]
        chosen = [row for row in chosen if self._inside(np.array([row]))[0]]
        if not chosen:
            return
        samples = cloud.source[chosen]

        def room_at(places: FloatArray, bound: FloatArray) -> FloatArray:
            whose = np.broadcast_to(samples[:, None], places.shape[:-1]).ravel()
            bounds = np.broadcast_to(bound[:, None], places.shape[:-1]).ravel()
            return room_of.measure(places.reshape(-1, 3), whose, bounds).reshape(places.shape[:-1])

        centers = cloud.centers[chosen]
        radii = room_at(centers[:, None], cloud.radii[chosen] * GROWTH)[:, 0]
        steps = np.minimum(surface.spacing, 0.25 * radii)  # centers stay in the ball, and inside
        for _ in range(GROWTH_STEPS):
            tried = centers[:, None] + steps[:, None, None] * AROUND
            room = room_at(tried, radii + 2.0 * steps)
            best = room.argmax(axis=1)
            better = room[np.arange(len(best)), best] > radii * (1.0 + 1e-9)
            centers[better] = tried[better, best[better]]
            radii[better] = room[better, best[better]]
            steps[~better] *= 0.5
            if (steps < 1e-4 * radii).all():
                break
        self.exact[samples] = True
        self.values[samples] = 2.0 * radii

    def _inside(self, rows: Index) -> Mask:
        """Return which balls (k,) have their center inside of the surface."""
        inside = self.closed[self.cloud.source[rows]].copy()
        others = np.flatnonzero(~inside)
        inside[others] = self.enclosure.times(self.cloud.centers[rows[others]]) >= ENCLOSED
        return inside

    def regions(self, maximum: float, most: int) -> list[WallRegion]:
        """Return the regions into which a ball larger than the maximum fits, the largest first."""
        cloud, surface, level = self.cloud, self.cloud.surface, maximum * (1.0 + EQUAL)
        beyond = self.values > level
        if not beyond.any():
            return []
        ball = self.balls.rows
        beyond &= self.exact | self._fits(ball, 0.5 * level, beyond)
        found: dict[int, IntArray] = {}
        samples = np.arange(surface.point_count, dtype=np.int32)
        links = [cloud.features[ball], np.stack([samples, cloud.source[ball]], axis=1)]
        field = np.full(len(ball), np.inf)
        field[beyond] = level / self.values[beyond]
        for place in low_places(PlaceGraph(surface, np.concatenate(links)), field, level=1.0):
            worst = int(place.vertices[np.argmax(self.values[place.vertices])])
            away = [
                math.dist(cloud.centers[ball[one]], cloud.centers[ball[worst]]) for one in found
            ]
            same = np.flatnonzero(np.array(away) < 0.25 * self.values[worst])
            if len(same):  # one ball touches several sides, which are not connected
                lump = list(found)[int(same[0])]
                found[lump] = np.union1d(found[lump], place.vertices)
            elif self._inside(ball[[worst]])[0]:
                found[worst] = place.vertices
        return [self._region(worst, found[worst]) for worst in list(found)[:most]]

    def _fits(self, balls: Index, radius: float, wanted: Mask) -> Mask:
        """Return where a ball of a radius fits between the triangles, at centers of balls (n,)."""
        result = wanted.copy()
        if self.room is not None and wanted.any():
            rows, place = np.unique(balls[wanted], return_inverse=True)
            bound = np.full(len(rows), radius)
            room = self.room.measure(self.cloud.centers[rows], self.cloud.source[rows], bound)
            result[wanted] = (room >= radius)[place]
        return result

    def _region(self, worst: int, vertices: IntArray) -> WallRegion:
        """Return the region of some samples; the ball of sample `worst` is the largest."""
        cloud, surface, row = self.cloud, self.cloud.surface, int(self.balls.rows[worst])
        inside = self.values[vertices]
        area = side_area(surface, np.arange(surface.point_count), vertices)
        measured = float(self.values[worst]), float(inside.min()), float(inside.max()), area
        ends = surface.points[cloud.source[row]], cloud.contacts[row]
        return WallRegion("too thick", *ends, *measured, vertices)


def _part_lines(
    cloud: MedialCloud, values: FloatArray, rows: Index, minimum: float, limits: WallLimits
) -> list[WallRegion]:
    """Return the regions of walls that are not whole lines, the farthest from it first.

    Walls between two sides count, of the minimum and more, beside the feet of others. What is
    smaller than a square of a line is no wall of its own.
    """
    width = limits.line_width
    lines = values / width
    off = np.abs(lines - np.round(lines))
    chosen = np.zeros(len(values), np.bool_)
    chosen[cloud.source[rows]] = True
    chosen &= (values >= minimum * (1.0 - EQUAL)) & ~over_feet(cloud, values, rows)
    chosen &= (lines < limits.most_lines) & (off > limits.line_tolerance + EQUAL)
    chosen &= (off - limits.line_tolerance) * width > unsure_by(cloud, values)
    if not chosen.any():
        return []
    field = np.where(chosen, 1.0 - off, 1.0)
    level = 1.0 - limits.line_tolerance
    found = _regions("part lines", cloud, rows, values, field, level, chosen)
    large = (region for region, _ in found if not region.area < width**2)
    return list(islice(large, limits.most_regions))


def _gaps(outer: MedialCloud, limits: WallLimits, least_angle: float) -> list[WallRegion]:
    """Return the regions where a gap is narrower than allowed, the narrowest first.

    Outer balls count whose two contacts face each other: seen from the center at least
    `least_angle` (radians) apart, and with normals as far apart. Those of concave edges do not.
    Inside of another part an outer ball spans no gap: parts that overlap have none there.
    """
    surface = outer.surface
    chosen = outer.valid & (outer.side < 0) & (outer.wall_angles >= least_angle)
    rows = np.flatnonzero(chosen & ~edge_balls(outer))
    level = limits.gap * (1.0 - EQUAL)
    rows = rows[2.0 * outer.radii[rows] < level]
    if len(rows) == 0:
        return []
    widths, enclosure = np.full(surface.point_count, np.inf), Enclosure(surface)
    widths[outer.source[rows]] = 2.0 * outer.radii[rows]
    found = (
        region
        for region, row in _regions("gap", outer, rows, widths, widths, level)
        if enclosure.times(outer.centers[row][None])[0] < ENCLOSED
    )
    return list(islice(found, limits.most_regions))


def _regions(
    kind: RegionKind,
    cloud: MedialCloud,
    rows: Index,
    values: FloatArray,
    field: FloatArray,
    level: float,
    telling: Mask | None = None,
) -> Iterator[tuple[WallRegion, int]]:
    """Go through the regions where a field is below a level, with the ball of the worst place.

    Where samples that are `telling` (n,) are given, of these; regions without are left out.
    """
    surface = cloud.surface
    ball = np.full(surface.point_count, -1, np.int64)
    ball[cloud.source[rows]] = rows
    own = np.where(ball >= 0, np.arange(len(ball)), -1)
    for place in low_places(PlaceGraph(surface, cloud.features[rows]), field, level=level):
        vertex = place.vertex
        if telling is not None:
            mine = place.vertices[telling[place.vertices] & (ball[place.vertices] >= 0)]
            if len(mine) == 0:
                continue
            vertex = int(mine[np.argmin(field[mine])])
        row, inside = int(ball[vertex]), values[place.vertices]
        opposite = cloud.contacts[row] if row >= 0 else np.full(3, np.nan)
        area = side_area(surface, own, place.vertices)
        told = float(values[vertex]), float(inside.min()), float(inside.max())
        position = surface.points[vertex]
        yield WallRegion(kind, position, opposite, *told, area, place.vertices), row
