"""Planes: the flat faces of a part, as against the facets of what is rounded (for thesis 3.2).

A mesh of a part has faces of two kinds that look alike: flat ones, which are meant as they are, and
facets, chords of a smooth surface. Faces that lie in one plane and hang together are a region. What
tells both kinds apart is how much regions bend against each other, and how wide they are. Facets of
widths w and v on a surface of curvature k bend by k (w + v) / 2 at their common edge. Where the
surface goes over from a flat face into a rounded one, tangentially, the first half of this is
missing: k v / 2, however wide the flat face is. Curvature k is told by the next edge of the rounded
region. So a wide flat face beside a strip of facets bends far too little to be a chord itself.

Such a region stays as it is: at its corners the smooth surface has its normal, so that nothing of
it bulges, and what is rounded beside it ends tangent to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Mask, sums_of, unit_rows
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.diagnosis import power_of_two_scale
from medialis.shape.surface import Surface, piece_labels

SAME_PLANE = 1e-6
"""Share of the diagonal: what lies less far from a plane is in it. Six digits of a text file."""

SAME_TURN = 1e-4
"""Radians: faces that bend by less are of one plane, whatever their size."""

MOST_TURN = 0.05
"""Radians: rounding of the coordinates turns a slim face by this much at most."""

PARALLEL = 0.5
"""Cosine: the next edge of a region tells its curvature where it runs about as the first one."""

WIDER = 2.0
"""A region so many times as wide as all that is rounded beside it may be a flat face."""

NARROWER, ONE_WAY = 0.3, 0.99
"""The same of one that is rounded one way only, as in extruded outlines, whose borders are
parallel: share of their length along their mean direction."""

EVEN = 0.1
"""Share by which curvature may grow from facet to facet beside a flat face below `FAR_WIDER`: where
a surface bends one way, then the other, it grows by more."""

FAR_WIDER = 3.0
"""Beside a region whose curvature no other edge tells."""

MUCH_WIDER = 10.0
"""Beside a strip so narrow its curvature does not matter, which triangles of a ruled strip hide."""

LARGE = 4.0
"""Mean areas of faces: smaller triangles between needles are no flat faces."""

NEGLIGIBLE = 1e-6
"""Share of the length of a border: regions as narrow as this across it tell nothing."""

AMISS = 0.1
"""Share of its rounded border at which a flat face may look like a facet."""


OF_A_PART = 0.05
"""Share of the surface that is flat in a part. A scan or an isosurface has some faces in a plane by
chance, up to 1.2 % on those tried, and nothing about them is special."""

LEAST_SCALE = 2.0**-100
"""Smaller and larger shapes are scaled, so that squares of areas stay in range."""

FEW_FACES = 32
"""Faces of a region that are looked at for its width."""

MOST_BORDERS = 12
"""Borders of a region that are looked at for its curvature: facets have three or four."""


@dataclass(frozen=True)
class _Regions:
    """Regions of faces that hang together in one plane.

    Attributes
    ----------
    label : (m,) int64
        The region of each face.
    count : (r,) int64
        Faces of each region.
    normal : (r, 3) float64
    area : (r,) float64
    flat : (r,) bool
        Whether all of its corners lie in one plane.
    """

    label: Index
    count: Index
    normal: FloatArray
    area: FloatArray
    flat: Mask


@dataclass(frozen=True)
class _Borders:
    """Rounded borders of region `one` with region `other`, (b,); each in both directions."""

    one: Index
    other: Index
    length: FloatArray
    bend: FloatArray
    along: FloatArray


def find_planes(surface: Surface, crease: float) -> IntArray:
    """Return the flat face of a part that each face of a mesh lies in, (m,); -1: in none.

    Parameters
    ----------
    surface : Surface
        A mesh of m faces.
    crease : float
        Radians: edges that bend by more are sharp, and tell nothing of what is rounded.

    Notes
    -----
    A region is no flat face where it looks like a facet along more than a tenth of its rounded
    border. Of single triangles nothing may: on irregular meshes of smooth shapes one in some
    thousands does so by chance, and there the surface is nearly flat. Cost O(m).
    """
    surface = _in_range(surface)
    first, second, opposite = surface.edge_table.pairs
    use = opposite & ~(surface.flat_faces[first // 3] | surface.flat_faces[second // 3])
    first, second, bends = first[use], second[use], surface.edge_bends[use]
    regions = _regions(surface, first, second, bends)
    rows = np.flatnonzero(bends <= crease)
    least = OF_A_PART * regions.area.sum()
    needed, may = _may_tell(regions, first[rows], second[rows])
    may &= regions.flat
    if regions.area[may].sum() < least:  # whatever their borders tell
        return frozen(np.full(surface.face_count, -1), np.int32)
    rows = rows[needed]
    borders = _borders(surface, regions, first[rows], second[rows], bends[rows])
    wide = _widths(regions, borders, surface)
    fails = _looks_like_facets(regions, borders, wide)
    count = len(regions.area)
    rounded = np.bincount(borders.one, borders.length, count)
    amiss = np.bincount(borders.one[fails], borders.length[fails], count)
    sure = _never_by_chance(regions, borders)
    plane = may & (amiss <= AMISS * rounded * sure)
    plane &= (rounded > 0) | (regions.count > 1)
    plane &= regions.area[plane].sum() >= least
    number = np.where(plane, np.cumsum(plane) - 1, -1)[regions.label]
    number[surface.flat_faces] = -1
    return frozen(number, np.int32)


def _in_range(surface: Surface) -> Surface:
    scale = power_of_two_scale(surface.points)
    if LEAST_SCALE < scale < 1.0 / LEAST_SCALE:
        return surface
    return Surface.of_checked(surface.points * scale, surface.faces).adopt(surface.topology)


def _regions(surface: Surface, first: IntArray, second: IntArray, bends: FloatArray) -> _Regions:
    """Put faces that hang together in one plane into regions."""
    faces, points = np.asarray(surface.faces), surface.points
    units, near = surface.face_normals, SAME_PLANE * surface.diagonal
    slow = np.flatnonzero(bends < MOST_TURN)
    one, two = first[slow] // 3, second[slow] // 3
    tips = points[faces[two, (second[slow] + 2) % 3]] - points[faces[one, first[slow] % 3]]
    back = points[faces[one, (first[slow] + 2) % 3]] - points[faces[two, second[slow] % 3]]
    same = np.abs(np.einsum("ej,ej->e", tips, units[one])) < near
    same &= np.abs(np.einsum("ej,ej->e", back, units[two])) < near
    same |= bends[slow] < SAME_TURN
    links = np.stack([one[same], two[same]], axis=1)
    label = piece_labels(len(faces), links).astype(np.int64)
    count = np.bincount(label)
    area = np.bincount(label, surface.face_areas).astype(np.float64)
    normal = unit_rows(sums_of(label, np.asarray(surface.face_vectors), len(area)), 1e-300)
    several = np.flatnonzero(count[label] > 1)
    corners, mine = points[faces[several]], label[several]
    weight = surface.face_areas[several] / np.maximum(area[mine], 1e-300)
    center = sums_of(mine, weight[:, None] * corners.mean(axis=1), len(area))
    off = np.abs(np.einsum("fja,fa->fj", corners - center[mine][:, None], normal[mine]))
    worst = np.zeros(len(area))
    np.maximum.at(worst, mine, off.max(axis=1))
    return _Regions(label, count, normal, area, (worst < near) & (area > 0))


def _may_tell(regions: _Regions, first: IntArray, second: IntArray) -> tuple[Mask, Mask]:
    """Tell the edges that are needed, and the regions that may be flat faces.

    Needed are those of such regions and of those beside them.

    A single triangle is one only where all that is rounded beside it are strips of several, or much
    narrower: on a smooth shape all are single triangles of about one size.
    """
    one, two = regions.label[first // 3], regions.label[second // 3]
    both = (regions.count[one] == 1) & (regions.count[two] == 1)
    may = np.ones(len(regions.area), np.bool_)
    large = regions.area >= LARGE * regions.area.sum() / regions.count.sum()
    for here, there in ((one[both], two[both]), (two[both], one[both])):
        wide = large[here] & (regions.area[here] >= MUCH_WIDER * regions.area[there])
        may[here[~wide]] = False
    beside = may.copy()
    beside[one[may[two]]] = beside[two[may[one]]] = True
    return np.asarray(beside[one] | beside[two]), may


def _borders(
    surface: Surface, regions: _Regions, first: IntArray, second: IntArray, bends: FloatArray
) -> _Borders:
    """Return the borders of pairs of regions at some edges: they lie on one line each."""
    one, two = regions.label[first // 3], regions.label[second // 3]
    rows = np.flatnonzero(one != two)
    one, two, side, bends = one[rows], two[rows], first[rows], bends[rows]
    faces, points = np.asarray(surface.faces), surface.points
    step = points[faces[side // 3, (side + 1) % 3]] - points[faces[side // 3, side % 3]]
    length = np.linalg.norm(step, axis=1)
    count = len(regions.area)
    keys, which = np.unique(
        np.minimum(one, two) * count + np.maximum(one, two), return_inverse=True
    )
    which = which.ravel()
    total = np.bincount(which, length, len(keys))
    bend = np.bincount(which, length * bends, len(keys)) / np.maximum(total, 1e-300)
    order = np.argsort(length, kind="stable")
    longest = np.zeros(len(keys), np.int64)
    longest[which[order]] = order
    along = unit_rows(step[longest])
    low, high = np.divmod(keys, count)
    return _Borders(
        np.concatenate([low, high]),
        np.concatenate([high, low]),
        np.tile(total, 2),
        np.tile(bend, 2),
        np.tile(along, (2, 1)),
    )


def _widths(regions: _Regions, borders: _Borders, surface: Surface) -> FloatArray:
    """Return how wide region `one` is across each border, (b,).

    Of a triangle twice the distance of its circumcenter, which is less than 0 beyond its longest
    side: so on a sphere what is said of bends at the top holds for any two triangles. Else the
    extent at right angles to the border, but no more than that of a triangle of this area: a large
    face with a short border on it, as beside a hole, is as wide as it looks from there.
    """
    faces, points = np.asarray(surface.faces), surface.points
    across = np.cross(borders.along, regions.normal[borders.one])
    wide = 2.0 * regions.area[borders.one] / np.maximum(borders.length, 1e-300)
    count = regions.count[borders.one]
    rows = np.flatnonzero(count > 2)
    if len(rows):
        # A square is as wide as this, and a ring half as wide: the top one of a torus is no plate.
        around = _perimeters(surface, regions)[borders.one[rows]]
        most = 4.0 * regions.area[borders.one[rows]] / np.maximum(around, 1e-300)
        wide[rows] = np.minimum(wide[rows], most)
    order = np.argsort(regions.label, kind="stable")
    begin = (np.cumsum(regions.count) - regions.count)[borders.one]
    rows = np.flatnonzero(count == 1)
    if len(rows):
        # 2 d = L cot(angle at the tip), and cot = (a.b) / |a x b| with sides a, b from there.
        corners = points[faces[order[begin[rows]]]]
        sides = np.einsum("bja,ba->bj", np.roll(corners, -1, axis=1) - corners, across[rows])
        tip = (np.abs(sides).argmin(axis=1) + 2) % 3
        at = np.arange(len(rows))
        left = corners[at, (tip + 1) % 3] - corners[at, tip]
        right = corners[at, (tip + 2) % 3] - corners[at, tip]
        cross = 2.0 * regions.area[borders.one[rows]]
        twice = borders.length[rows] * np.einsum("ba,ba->b", left, right) / cross
        # A needle that leans over its side is no wider than it is high.
        wide[rows] = np.minimum(wide[rows], twice)
    rows = np.flatnonzero((count <= FEW_FACES) & (count > 1))
    if len(rows):
        owner = np.repeat(np.arange(len(rows)), count[rows])
        start = np.cumsum(count[rows]) - count[rows]
        face = order[begin[rows][owner] + np.arange(len(owner)) - start[owner]]
        height = np.einsum("fja,fa->fj", points[faces[face]], across[rows][owner])
        extent = np.maximum.reduceat(height.max(axis=1), start)
        extent -= np.minimum.reduceat(height.min(axis=1), start)
        wide[rows] = np.minimum(wide[rows], extent)
    return wide


def _perimeters(surface: Surface, regions: _Regions) -> FloatArray:
    """Return the length of all sides of faces where a region ends, (r,)."""
    beside = surface.face_adjacency
    face, side = np.nonzero((beside < 0) | (regions.label[beside] != regions.label[:, None]))
    corners = np.asarray(surface.faces)
    step = surface.points[corners[face, (side + 1) % 3]] - surface.points[corners[face, side]]
    length = np.linalg.norm(step, axis=1)
    return np.bincount(regions.label[face], length, len(regions.area)).astype(np.float64)


def _looks_like_facets(regions: _Regions, borders: _Borders, wide: FloatArray) -> Mask:
    """Tell at which borders region `one`, so wide, is a chord of what is rounded there, (b,)."""
    half = len(borders.one) // 2
    back = np.concatenate([half + np.arange(half), np.arange(half)])
    several = regions.count > 1
    beside = wide[back]
    # What each region shows at each of its borders, were it a facet; a region beyond that may be
    # flat counts as no wider than itself.
    beyond = np.where(several[borders.other], np.minimum(wide, beside), beside)
    least = NEGLIGIBLE * borders.length + 1e-300
    shown = np.where(wide + beyond > least, 2.0 * borders.bend, 0.0)
    shown /= np.maximum(wide + beyond, least)
    own, by = _told_elsewhere(regions, borders, shown)
    told = own[back]
    next_one = by[back]  # the other border of the region beside, and what is beyond it
    grows = (next_one >= 0) & (own[back[next_one]] > (1.0 + EVEN) * told)
    as_facet = 2.0 * borders.bend / np.maximum(wide + beside, least)
    ratio = wide / np.maximum(beside, least)
    sure, one_way = _never_by_chance(regions, borders), _one_way(regions, borders)
    strip = (several & one_way)[borders.one]
    enough = (ratio >= WIDER) | (strip & (ratio >= NARROWER))
    enough &= ~grows | (ratio >= FAR_WIDER)
    bends_too_little = (told > np.sqrt(1.0 + np.maximum(ratio, 0.0)) * as_facet) & enough
    untold = (told == 0.0) & ((own == 0.0) | (ratio >= FAR_WIDER))
    untold &= sure[borders.one]
    alone = ~(several[borders.one] | several[borders.other])
    # A blunt triangle beside is less than nothing wide by its circumcenter, and tells no curvature.
    bends_too_little, untold = bends_too_little & (beside > least), untold & (beside > least)
    height = 2.0 * regions.area[borders.other] / np.maximum(borders.length, 1e-300)
    beside = np.where(beside > least, beside, height)
    much_wider = (wide >= MUCH_WIDER * beside) & (beside > least)
    return np.asarray((wide <= 0.0) | ~((bends_too_little & ~alone) | untold | much_wider))


def _one_way(regions: _Regions, borders: _Borders) -> Mask:
    """Tell the regions that are rounded one way at most, as in extruded outlines, (r,)."""
    outer = (borders.along[:, :, None] * borders.along[:, None, :]).reshape(-1, 9)
    count = len(regions.area)
    total = np.bincount(borders.one, borders.length, count)
    spread = sums_of(borders.one, borders.length[:, None] * outer, count)
    return np.asarray(np.linalg.norm(spread, axis=1) >= ONE_WAY * total)


def _never_by_chance(regions: _Regions, borders: _Borders) -> Mask:
    """Tell the regions of more faces than lie in a plane by chance on a smooth shape, (r,)."""
    pair = (regions.count == 2) & _one_way(regions, borders)
    return np.asarray((regions.count > 2) | pair)


def _told_elsewhere(
    regions: _Regions, borders: _Borders, shown: FloatArray
) -> tuple[FloatArray, Index]:
    """Return the largest curvature that region `one` shows at its other borders, about parallel.

    And the border where it does, -1 where it shows none.
    """
    order = np.argsort(borders.one, kind="stable")
    region = borders.one[order]
    size = np.bincount(region, minlength=len(regions.area))
    begin, size = (np.cumsum(size) - size)[region], size[region]
    place = np.arange(len(order)) - begin
    result, by = np.zeros(len(order)), np.full(len(order), -1, np.int64)
    for turn in range(1, min(int(size.max(initial=0)), MOST_BORDERS)):
        more = size > turn
        rows, mate = order[more], order[begin[more] + (place[more] + turn) % size[more]]
        parallel = np.abs(np.einsum("ba,ba->b", borders.along[rows], borders.along[mate]))
        told = np.where(parallel > PARALLEL, shown[mate], 0.0)
        larger = told > result[rows]
        result[rows[larger]], by[rows[larger]] = told[larger], mate[larger]
    return result, by


def plane_normals(surface: Surface, planes: IntArray) -> FloatArray:
    """Return the unit normal of each plane, (p, 3)."""
    rows = np.flatnonzero(planes >= 0)
    count = int(planes.max(initial=-1)) + 1
    vectors = np.asarray(_in_range(surface).face_vectors)[rows]
    return unit_rows(sums_of(planes[rows], vectors, count), 1e-300)


def only_plane(group: NDArray[Any], planes: NDArray[Any], count: int) -> Index:
    """Return the plane of each group of faces, (count,); -1: there is none, or there are several.

    Of each face its group and its plane are given, -1 where it lies in none.
    """
    rows = np.flatnonzero(planes >= 0)
    most, least = np.full(count, -1, np.int64), np.full(count, np.iinfo(np.int64).max)
    np.maximum.at(most, group[rows], planes[rows])
    np.minimum.at(least, group[rows], planes[rows])
    return np.where(most == least, most, -1)


def with_planes(
    normals: FloatArray, surface: Surface, planes: IntArray, crease: float
) -> FloatArray:
    """Return vertex normals that are those of planes, where a smooth surface ends at one.

    Parameters
    ----------
    normals : (n, 3) float64
    surface : Surface
    planes : (m,) int32
        `find_planes`.
    crease : float
        Radians: vertices where two edges bend by more keep their normals.
    """
    if (planes < 0).all():
        return normals
    faces = np.asarray(surface.faces)
    plane = only_plane(faces.ravel(), np.repeat(planes, 3), surface.point_count)
    first = surface.edge_table.pairs[0][surface.edge_bends > crease]
    ends = [faces[first // 3, (first + step) % 3] for step in (0, 1)]
    creases = np.bincount(np.concatenate(ends), minlength=surface.point_count)
    rows = np.flatnonzero((plane >= 0) & (creases < 2) & np.asarray(normals).any(axis=1))
    result = np.array(normals)
    result[rows] = plane_normals(surface, planes)[plane[rows]]
    return frozen(result, np.float64)
