"""Kernels that tell flat faces of a part from facets, and needles (see planes.py, rulings.py).

One pass each over the edges, the faces or the borders of regions. Borders stand in both directions:
border k of h pairs of regions is that of the lower one with the higher one, border h + k the other.
Sums run in the order of the edges, and ties go to the first, so that nothing depends on the order
of regions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import group_keys, join, number_pieces, sort_keys
from medialis.base.jit import kernel

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

NEGLIGIBLE = 1e-6
"""Share of the length of a border: regions as narrow as this across it tell nothing."""

FEW_FACES = 32
"""Faces of a region that are looked at for its width."""

MOST_BORDERS = 12
"""Borders of a region that are looked at for its curvature: facets have three or four."""

TINY = 1e-300
"""Instead of nothing, where something is divided by it."""


class Mesh(NamedTuple):
    """A mesh of m faces and p pairs of half-edges 3 f + j that share an edge each.

    Attributes
    ----------
    points : (n, 3) float64
    faces : (m, 3) int32
    vectors, units : (m, 3) float64
        Normals of the faces, as long as twice their area, and of length 1.
    areas : (m,) float64
    first, second : (p,) int32
    bends : (p,) float64
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int32]
    vectors: NDArray[np.float64]
    units: NDArray[np.float64]
    areas: NDArray[np.float64]
    first: NDArray[np.int32]
    second: NDArray[np.int32]
    bends: NDArray[np.float64]


class Regions(NamedTuple):
    """Regions of faces that hang together in one plane.

    Attributes
    ----------
    label : (m,) int32
        The region of each face.
    count : (r,) int64
        Faces of each region.
    normal : (r, 3) float64
    area : (r,) float64
    flat : (r,) bool
        Whether all of its corners lie in one plane.
    """

    label: NDArray[np.int32]
    count: NDArray[np.int64]
    normal: NDArray[np.float64]
    area: NDArray[np.float64]
    flat: NDArray[np.bool_]


class Borders(NamedTuple):
    """Rounded borders of region `one` with region `other`, (b,).

    Attributes
    ----------
    one, other : (b,) int32
    length, bend : (b,) float64
        Of all edges, and their mean bend.
    along : (b, 3) float64
        Direction of the longest edge.
    """

    one: NDArray[np.int32]
    other: NDArray[np.int32]
    length: NDArray[np.float64]
    bend: NDArray[np.float64]
    along: NDArray[np.float64]


@kernel
def _height(points, vertex, start, unit):
    """Height of a vertex over another one, along a unit vector."""
    x = (points[vertex, 0] - points[start, 0]) * unit[0]
    y = (points[vertex, 1] - points[start, 1]) * unit[1]
    return x + y + (points[vertex, 2] - points[start, 2]) * unit[2]


@kernel
def join_planes(mesh, near, parent, out_label):
    """Put faces that hang together in one plane into regions, (m,); `parent` is 0, 1, 2 and so on.

    Two faces do so where the tip of each is nearer than `near` to the plane of the other.
    """
    corners = mesh.faces
    for k in range(len(mesh.first)):
        if not mesh.bends[k] < MOST_TURN:
            continue
        a, b = mesh.first[k], mesh.second[k]
        one, two = a // 3, b // 3
        same = mesh.bends[k] < SAME_TURN
        if not same:
            tip, start = corners[two, (b + 2) % 3], corners[one, a % 3]
            same = abs(_height(mesh.points, tip, start, mesh.units[one])) < near
            if same:
                tip, start = corners[one, (a + 2) % 3], corners[two, b % 3]
                same = abs(_height(mesh.points, tip, start, mesh.units[two])) < near
        if same:
            join(parent, one, two)
    number_pieces(parent, out_label)


@kernel
def measure_regions(mesh, near, regions):
    """Fill the columns of regions but their label; `count`, `normal` and `area` are 0."""
    points, label, normal = mesh.points, regions.label, regions.normal
    for f in range(len(label)):
        r = label[f]
        regions.count[r] += 1
        regions.area[r] += mesh.areas[f]
        for axis in range(3):
            normal[r, axis] += mesh.vectors[f, axis]
    for r in range(len(normal)):
        x, y, z = normal[r, 0], normal[r, 1], normal[r, 2]
        length = math.sqrt(x * x + y * y + z * z)
        for axis in range(3):
            normal[r, axis] = normal[r, axis] / length if length > TINY else 0.0
        regions.flat[r] = regions.area[r] > 0.0
    center = np.zeros(normal.shape)
    for f in range(len(label)):
        r = label[f]
        if regions.count[r] > 1:
            a, b, c = mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2]
            weight = mesh.areas[f] / max(regions.area[r], TINY)
            for axis in range(3):
                middle = (points[a, axis] + points[b, axis] + points[c, axis]) / 3.0
                center[r, axis] += weight * middle
    for f in range(len(label)):
        r = label[f]
        if regions.count[r] > 1 and regions.flat[r]:
            for j in range(3):
                off = 0.0
                for axis in range(3):
                    off += (points[mesh.faces[f, j], axis] - center[r, axis]) * normal[r, axis]
                regions.flat[r] = regions.flat[r] and abs(off) < near


@kernel
def find_candidates(mesh, regions, crease, large, out_may, out_beside):
    """Tell the regions that may be flat faces, (r,), and those or regions beside them, (r,).

    A single triangle larger than `large` is one only where all that is rounded beside it are strips
    of several, or much narrower: on a smooth shape all are single triangles of about one size.
    """
    label, count, area = regions.label, regions.count, regions.area
    out_may[:] = True
    for k in range(len(mesh.first)):
        one, two = label[mesh.first[k] // 3], label[mesh.second[k] // 3]
        if mesh.bends[k] > crease or count[one] > 1 or count[two] > 1:
            continue
        if not (area[one] >= large and area[one] >= MUCH_WIDER * area[two]):
            out_may[one] = False
        if not (area[two] >= large and area[two] >= MUCH_WIDER * area[one]):
            out_may[two] = False
    out_beside[:] = out_may
    for k in range(len(mesh.first)):
        if mesh.bends[k] <= crease:
            one, two = label[mesh.first[k] // 3], label[mesh.second[k] // 3]
            if out_may[one]:
                out_beside[two] = True
            if out_may[two]:
                out_beside[one] = True


@kernel
def list_borders(mesh, regions, crease, beside, out_keys, out_starts):
    """List the rounded edges between two regions one of which is wanted, by these.

    A counting sort by the lower region; the few of each are put in order by the higher one, which
    stands above the edge in `out_keys` (p,). `out_starts` (p + 1,) gets where each pair of regions
    starts there, and where the last one ends. Return how many pairs there are.
    """
    label, filled = regions.label, 0
    low, keys = np.empty(len(mesh.first), np.int32), np.empty(len(mesh.first), np.int64)
    place = np.zeros(len(regions.area), np.int32)
    for k in range(len(mesh.first)):
        if mesh.bends[k] <= crease:
            one, two = label[mesh.first[k] // 3], label[mesh.second[k] // 3]
            if one != two and (beside[one] or beside[two]):
                low[filled], keys[filled] = min(one, two), np.int64(max(one, two)) << 32 | k
                place[low[filled]] += 1
                filled += 1
    total = 0
    for r in range(len(place)):
        total, place[r] = total + place[r], total
    for e in range(filled):
        out_keys[place[low[e]]] = keys[e]
        place[low[e]] += 1
    pairs, begin = 0, 0
    for r in range(len(place)):
        before = -1
        sort_keys(out_keys, begin, place[r])
        for e in range(begin, place[r]):
            if out_keys[e] >> 32 != before:
                before = out_keys[e] >> 32
                out_starts[pairs] = e
                pairs += 1
        begin = place[r]
    out_starts[pairs] = filled
    return pairs


@kernel
def measure_borders(mesh, regions, keys, starts, out):
    """Fill the borders of pairs of regions from their edges, in both directions."""
    points, label, half = mesh.points, regions.label, len(starts) - 1
    step, along = np.empty(3), np.empty(3)
    for k in range(half):
        total, bend, longest = 0.0, 0.0, -1.0
        for e in range(starts[k], starts[k + 1]):
            row = keys[e] & 0xFFFFFFFF
            side = mesh.first[row]
            face = side // 3
            a, b = mesh.faces[face, side % 3], mesh.faces[face, (side + 1) % 3]
            for axis in range(3):
                step[axis] = points[b, axis] - points[a, axis]
            length = math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
            total += length
            bend += length * mesh.bends[row]
            if length >= longest:
                longest = length
                for axis in range(3):
                    along[axis] = step[axis] / length if length > 0.0 else 0.0
        row = keys[starts[k]] & 0xFFFFFFFF
        one, two = label[mesh.first[row] // 3], label[mesh.second[row] // 3]
        for place in (k, half + k):
            out.length[place], out.bend[place] = total, bend / max(total, TINY)
            for axis in range(3):
                out.along[place, axis] = along[axis]
        out.one[k], out.other[k] = min(one, two), max(one, two)
        out.one[half + k], out.other[half + k] = max(one, two), min(one, two)


@kernel
def measure_perimeters(mesh, regions, twins, out_around):
    """Length of all sides of faces where a region of several ends, (r,)."""
    points, label = mesh.points, regions.label
    for f in range(len(label)):
        if regions.count[label[f]] < 3:
            continue
        for j in range(3):
            twin = twins[3 * f + j]
            if twin < 0 or label[twin // 3] != label[f]:
                a, b = mesh.faces[f, j], mesh.faces[f, (j + 1) % 3]
                x, y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
                z = points[b, 2] - points[a, 2]
                out_around[label[f]] += math.sqrt(x * x + y * y + z * z)


@kernel
def _across_triangle(points, corners, across, length, area):
    """Twice the distance of the circumcenter of a triangle from its side across a direction.

    2 d = L cot(angle at the tip), and cot = (a.b) / |a x b| with sides a, b from there.
    """
    least, tip = math.inf, 0
    for j in range(3):
        lean = abs(_height(points, corners[(j + 1) % 3], corners[j], across))
        if lean < least:
            least, tip = lean, (j + 2) % 3
    cosine = 0.0
    for axis in range(3):
        place = points[corners[tip], axis]
        left, right = points[corners[(tip + 1) % 3], axis], points[corners[(tip + 2) % 3], axis]
        cosine += (left - place) * (right - place)
    return length * cosine / max(2.0 * area, TINY)


@kernel
def measure_widths(mesh, regions, borders, around, offsets, order, out_wide):
    """How wide region `one` is across each border, (b,); `order` has the faces of each region.

    Of a triangle twice the distance of its circumcenter, which is less than 0 beyond its longest
    side: so on a sphere what is said of bends at the top holds for any two triangles. Else the
    extent at right angles to the border, but no more than that of a triangle of this area: a large
    face with a short border on it, as beside a hole, is as wide as it looks from there.
    """
    points, across = mesh.points, np.empty(3)
    for k in range(len(borders.one)):
        r = borders.one[k]
        count, area = regions.count[r], regions.area[r]
        u, v = borders.along[k], regions.normal[r]
        across[0], across[1] = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]
        across[2] = u[0] * v[1] - u[1] * v[0]
        wide = 2.0 * area / max(borders.length[k], TINY)
        if count > 2:
            # A square is as wide as this, a ring half as wide: the top one of a torus is no plate.
            wide = min(wide, 4.0 * area / max(around[r], TINY))
        if count == 1:
            # A needle that leans over its side is no wider than it is high.
            corners = mesh.faces[order[offsets[r]]]
            wide = min(wide, _across_triangle(points, corners, across, borders.length[k], area))
        elif count <= FEW_FACES:
            low, high = math.inf, -math.inf
            for at in range(offsets[r], offsets[r + 1]):
                for j in range(3):
                    p = points[mesh.faces[order[at], j]]
                    height = p[0] * across[0] + p[1] * across[1] + p[2] * across[2]
                    low, high = min(low, height), max(high, height)
            wide = min(wide, high - low)
        out_wide[k] = wide


@kernel
def _find_one_way(regions, borders, out_one_way, out_rounded):
    """Tell the regions that are rounded one way at most, as in extruded outlines, (r,)."""
    spread = np.zeros((len(regions.area), 3, 3))
    for k in range(len(borders.one)):
        r, u = borders.one[k], borders.along[k]
        out_rounded[r] += borders.length[k]
        for i in range(3):
            for j in range(i, 3):
                spread[r, i, j] += borders.length[k] * (u[i] * u[j])
    for r in range(len(spread)):
        square = 0.0
        for i in range(3):
            for j in range(3):
                part = spread[r, min(i, j), max(i, j)]
                square += part * part
        out_one_way[r] = math.sqrt(square) >= ONE_WAY * out_rounded[r]


@kernel
def _find_shown(regions, borders, wide, out_shown):
    """Curvature that region `one` shows at each border, were it a facet, (b,).

    A region beyond that may be flat counts as no wider than itself.
    """
    half = len(wide) // 2
    for k in range(2 * half):
        beyond = wide[k + half if k < half else k - half]
        if regions.count[borders.other[k]] > 1:
            beyond = min(wide[k], beyond)
        least = NEGLIGIBLE * borders.length[k] + TINY
        out_shown[k] = 2.0 * borders.bend[k] / (wide[k] + beyond) if wide[k] + beyond > least else 0


@kernel
def _find_told(borders, offsets, order, shown, out_told, out_by):
    """Largest curvature that region `one` shows at its other borders, about parallel, (b,).

    And the border where it does, -1 where it shows none.
    """
    for r in range(len(offsets) - 1):
        begin, size = offsets[r], offsets[r + 1] - offsets[r]
        for place in range(size):
            k = order[begin + place]
            u = borders.along[k]
            out_told[k], out_by[k] = 0.0, -1
            for turn in range(1, min(size, MOST_BORDERS)):
                mate = order[begin + (place + turn) % size]
                v = borders.along[mate]
                parallel = abs(u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) > PARALLEL
                if parallel and shown[mate] > out_told[k]:
                    out_told[k], out_by[k] = shown[mate], mate


@kernel
def find_flat_regions(regions, borders, may, wide, amiss, out_plane):
    """Tell the regions that are flat faces, (r,), of those that may be.

    A region is one where it looks like a facet along no more than a share `amiss` of its rounded
    border: there it is a chord of what is rounded beside it.
    """
    count, half = len(regions.area), len(wide) // 2
    one_way, rounded = np.empty(count, np.bool_), np.zeros(count)
    wrong, sure = np.zeros(count), np.empty(count, np.bool_)
    _find_one_way(regions, borders, one_way, rounded)
    for r in range(count):  # of more faces than lie in a plane by chance on a smooth shape
        sure[r] = regions.count[r] > 2 or (regions.count[r] == 2 and one_way[r])
    shown, own, by = np.empty(2 * half), np.empty(2 * half), np.empty(2 * half, np.int64)
    _find_shown(regions, borders, wide, shown)
    offsets, order = np.zeros(count + 2, np.int64), np.empty(2 * half, np.int32)
    group_keys(borders.one, offsets, order)
    _find_told(borders, offsets[:-1], order, shown, own, by)
    for k in range(2 * half):
        if wide[k] <= 0.0:
            wrong[borders.one[k]] += borders.length[k]
            continue
        r, other, back = borders.one[k], borders.other[k], k + half if k < half else k - half
        several, beside, told, next_one = regions.count[r] > 1, wide[back], own[back], by[back]
        least = NEGLIGIBLE * borders.length[k] + TINY
        grows = False  # the other border of the region beside, and what is beyond it
        if next_one >= 0:
            beyond = next_one + half if next_one < half else next_one - half
            grows = own[beyond] > (1.0 + EVEN) * told
        as_facet = 2.0 * borders.bend[k] / max(wide[k] + beside, least)
        ratio = wide[k] / max(beside, least)
        enough = ratio >= WIDER or (several and one_way[r] and ratio >= NARROWER)
        enough = enough and (not grows or ratio >= FAR_WIDER)
        flat = told > math.sqrt(1.0 + ratio) * as_facet and enough
        flat = flat and (several or regions.count[other] > 1)
        untold = told == 0.0 and (own[k] == 0.0 or ratio >= FAR_WIDER)
        flat = flat or (untold and sure[r])
        # A blunt triangle beside is less than nothing wide by its circumcenter, and tells nothing.
        flat = flat and beside > least
        if not beside > least:
            beside = 2.0 * regions.area[other] / max(borders.length[k], TINY)
        flat = flat or (wide[k] >= MUCH_WIDER * beside and beside > least)
        if not flat:
            wrong[r] += borders.length[k]
    for r in range(count):
        most = amiss * rounded[r] if sure[r] else 0.0
        out_plane[r] = may[r] and wrong[r] <= most and (rounded[r] > 0.0 or regions.count[r] > 1)
