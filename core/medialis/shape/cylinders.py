"""Cylinders and spheres: round walls, bends, bores, fillets and corners of a part (for thesis 3.2).

The vertices of a tessellated part lie on its surface. A cylinder is cut into needles, and needles
beside each other whose corners lie on one circle, as seen along them, are one. So that this is no
chance, more corners lie on it than a circle needs, and far nearer than its chords lie off it. From
the needles a cylinder grows over the faces beside them that have all corners on it: where another
surface cuts it, its triangles are no needles.

What is left between them, and lies on one sphere, is that: a corner where three blends meet.

There the smooth surface is known, and neither its normals nor its places are guessed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask, next_side, rows_of_labels, unit_rows
from medialis.base.validation import Directions, FloatArray, IntArray, Positions, frozen
from medialis.shape.rulings import ALONG, SHORTER, is_part, needles, only_rounded
from medialis.shape.surface import Surface, piece_labels

Rows = NDArray[np.int64]

ON_IT = 2e-6  # halved 0 %, doubled 0 %
"""Share of the diagonal: corners that lie less far off a cylinder are on it. Six digits of a text
file, twice that since a cylinder has two ends."""

CLEARLY = 10.0  # halved 0 %, doubled 0 %
"""So many times as far lies the chord of its arc off a cylinder, else it might be flat."""

LEAST_CORNERS = 5  # halved 0 %, doubled 0 %
"""Different corners, seen along the axis: three lie on a circle always, and two more tell. So does
each flat face that the cylinder is tangent to where it ends."""

LONG_SIDE = 0.25  # halved 0 %, doubled 0 %
"""Of the square of its longest side: needles lie beside each other over longer ones of both."""

WINDOW = 8  # halved 0 %, doubled 0 %
"""Needles that tell a cylinder where their chain goes on over another surface."""

LEAST_FACES = 8  # halved 0 %, doubled 0 %
"""Fewer needles, four chords, lie on a cylinder by chance: on a blend that is no cylinder."""

MOST_TRIES = 400  # halved 0 %, doubled 0 %
"""Places where none is found: a part that has more is none of cylinders. Each takes 0.3 ms."""

SAME_WAY = math.cos(math.radians(1.0))  # halved 0 %, doubled < 0.1 %
"""Cosine: directions of one axis, and normals of one surface."""

TANGENT = math.cos(math.radians(10.0))
"""The same for means of the normals of two chords."""

FITS = 12  # halved 0 %, doubled 0 %
"""Rounds of fitting at most: two are enough where the places are exact."""

PARALLEL, AMISS = 0.5, 0.1  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Cosine: sides of a face at a larger angle to the axis are at an end; share of the ends at which a
cylinder may go on bent."""

FACING = 0.5
"""Cosine of the angle between a facet and the cylinder that it is a chord of, at least."""


@dataclass(frozen=True, eq=False, repr=False)
class Cylinders:
    """Cylinders, and spheres between them, of a mesh of m faces.

    Attributes
    ----------
    label : (m,) int32
        The cylinder of each face; -1: none.
    axes : (c, 3) float64
        Unit vectors; zero: a sphere.
    centers : (c, 3) float64
        A point of each axis, or the center of the sphere.
    radii : (c,) float64
    signs : (c,) float64
        1 where the outside of the part is outside of the cylinder, -1 in a bore.
    """

    label: IntArray
    axes: Directions
    centers: Positions
    radii: FloatArray
    signs: FloatArray

    def normals(self, which: NDArray[Any], places: FloatArray) -> FloatArray:
        """Return the outward unit normals of cylinders (k,) at some places, (k, 3)."""
        return self.signs[which, None] * unit_rows(self._away(which, places), 1e-300)

    def heights(self, which: NDArray[Any], places: FloatArray) -> FloatArray:
        """Return how far cylinders (k,) lie outward of some places, (k,)."""
        away = np.linalg.norm(self._away(which, places), axis=1)
        return np.asarray(self.signs[which] * (self.radii[which] - away))

    def feet(self, which: NDArray[Any], places: FloatArray) -> FloatArray:
        """Return the nearest places of cylinders (k,), (k, 3)."""
        return places + self.heights(which, places)[:, None] * self.normals(which, places)

    def of_faces(self, rows: NDArray[Any]) -> Cylinders:
        """Return the same cylinders for a mesh that has pieces of some faces, (k,)."""
        return replace(self, label=frozen(self.label[rows], np.int32))

    def __repr__(self) -> str:
        """Return their number: a shape's arrays tell the rest."""
        return f"Cylinders({len(self.radii)})"

    def _away(self, which: NDArray[Any], places: FloatArray) -> FloatArray:
        axis, step = self.axes[which], places - self.centers[which]
        return np.asarray(step - np.einsum("ka,ka->k", step, axis)[:, None] * axis)


def find_cylinders(
    surface: Surface,
    planes: IntArray,
    crease: float,
    ruled: tuple[Mask, FloatArray] | None = None,
) -> Cylinders:
    """Find the cylinders that the needles of a part are cut from.

    Parameters
    ----------
    surface : Surface
        A mesh of m faces.
    planes : (m,) int32
        `find_planes`: its faces are of no cylinder.
    crease : float
        Radians: over edges that bend by more no cylinder goes on.
    ruled : tuple, optional
        `needles`, where they are known.

    Notes
    -----
    Cost O(m), and 0.3 ms for each cylinder.
    """
    label, found = np.full(surface.face_count, -1, np.int32), list[_Fitted]()
    near = ON_IT * surface.diagonal
    tries = MOST_TRIES
    needle, longest = needles(surface, planes) if ruled is None else ruled
    for chain in _chains(surface, planes, crease, needle, longest):
        begin = 0
        while begin + LEAST_CORNERS - 2 < len(chain) and tries > 0:  # two chords at least
            rest, which = chain[begin:], _known(surface, chain[begin : begin + 2], found, near)
            if which < 0:
                # All of the chain as a rule; else what a few tell, and as far as it goes.
                fitted = _fit(surface, rest, near, 3) if begin == 0 else None
                fitted = fitted or _fit(surface, rest[:WINDOW], near, LEAST_CORNERS)
                if fitted is None:
                    begin, tries = begin + 1, tries - 1
                    continue
                which = len(found)
                found.append(fitted)
            one = _table(label, found[which : which + 1])
            on_it = _lie_on(surface, rest, one, np.zeros(len(rest), np.int64), near)
            end = len(rest) if on_it.all() else max(int(on_it.argmin()), 1)
            label[rest[:end]] = which
            begin += end
    cylinders = _table(label, found)
    if not found:  # a scan is looked at no further
        return _with_spheres(surface, planes, cylinders, crease, near)
    no_more = _goes_on(surface, planes, cylinders, crease)
    no_more |= ~_are_sure(surface, planes, cylinders, np.array([one[4] for one in found], int))
    number = np.append(np.where(no_more, -1, np.cumsum(~no_more) - 1), -1)
    label = frozen(number[label], np.int32)
    cylinders = _table(label, [one for one, bad in zip(found, no_more, strict=True) if not bad])
    cylinders = replace(cylinders, label=_grown(surface, planes, cylinders, crease, near))
    return _with_spheres(surface, planes, cylinders, crease, near)


def _with_spheres(
    surface: Surface, planes: IntArray, cylinders: Cylinders, crease: float, near: float
) -> Cylinders:
    """Add what is rounded between flat faces and cylinders where all of it lies on a sphere."""
    label, faces = np.array(cylinders.label), np.asarray(surface.faces)
    rest = (planes < 0) & (label < 0)
    if not rest.any() or rest.all():
        return cylinders
    first, second, opposite = surface.edge_table.pairs
    one, two = first // 3, second // 3
    inner = opposite & (surface.edge_bends <= crease) & rest[one] & rest[two]
    rows = np.flatnonzero(rest)
    piece = piece_labels(len(faces), np.stack([one[inner], two[inner]], axis=1))[rows]
    found: list[_Fitted] = []
    pieces = [rows[some] for some in rows_of_labels(piece) if len(some) >= LEAST_FACES]
    for some in sorted(pieces, key=lambda some: -len(some))[:MOST_TRIES]:
        points = surface.points[np.unique(faces[some])]
        origin = points.mean(axis=0)
        local = points - origin
        system = np.column_stack([2.0 * local, np.ones(len(local))])
        right = np.einsum("pa,pa->p", local, local)
        center, *rank = np.linalg.lstsq(system, right, rcond=None)
        radius = math.sqrt(max(center[3] + center[:3] @ center[:3], 0.0))
        off = np.linalg.norm(local - center[:3], axis=1) - radius
        middle = surface.points[faces[some]].mean(axis=1) - origin - center[:3]
        bulge = radius - float(np.linalg.norm(center[:3]))  # of the whole cap
        if rank[1] < 4 or np.abs(off).max() > near or bulge < CLEARLY * near:
            continue
        facing = math.copysign(1.0, np.einsum("fa,fa->f", middle, surface.face_vectors[some]).sum())
        ball = np.zeros(3), origin + center[:3], radius, facing, len(points)
        if _ends_tangent(surface, some, rest, _table(label, [ball])):
            label[some] = len(cylinders.radii) + len(found)
            found.append(ball)
    more = _table(frozen(label, np.int32), found)
    both = zip(*((c.axes, c.centers, c.radii, c.signs) for c in (cylinders, more)), strict=True)
    return Cylinders(more.label, *(np.concatenate(pair) for pair in both))


def _are_sure(
    surface: Surface, planes: IntArray, cylinders: Cylinders, corners: NDArray[Any]
) -> Mask:
    """Tell the cylinders that corners, and flat faces tangent to them, leave no doubt of, (c,)."""
    count = len(corners)
    face, side = np.nonzero((cylinders.label[:, None] >= 0) & (surface.face_adjacency >= 0))
    plane = planes[surface.face_adjacency[face, side]]
    face, side, plane = face[plane >= 0], side[plane >= 0], plane[plane >= 0]
    points, flat = surface.points, np.asarray(surface.faces)
    middle = 0.5 * (points[flat[face, side]] + points[flat[face, (side + 1) % 3]])
    which = cylinders.label[face].astype(np.int64)
    beside = surface.face_normals[surface.face_adjacency[face, side]]
    cosine = np.einsum("fa,fa->f", cylinders.normals(which, middle), beside)
    tangent = cosine >= SAME_WAY
    pairs = np.unique(np.stack([which[tangent], plane[tangent]], axis=1), axis=0)
    tangents = np.bincount(pairs[:, 0], minlength=count)
    faces = np.bincount(cylinders.label[cylinders.label >= 0], minlength=count)
    return np.asarray((corners + tangents >= LEAST_CORNERS) & (faces + 2 * tangents >= LEAST_FACES))


def _goes_on(surface: Surface, planes: IntArray, cylinders: Cylinders, crease: float) -> Mask:
    """Tell the cylinders that go on bent, (c,): a ring is cut into strips that are cylinders each.

    Beyond an end of a cylinder are no faces, or such as are far shorter along it, of a blend.
    """
    label, count = cylinders.label, len(cylinders.radii)
    first, second, opposite = surface.edge_table.pairs
    step = surface.points[np.asarray(surface.faces)]
    step = np.roll(step, -1, axis=1) - step
    total, beyond = np.zeros(count), np.zeros(count)
    for one, two in ((first, second), (second, first)):
        face, other = one // 3, two // 3
        rows = np.flatnonzero((label[face] >= 0) & (label[face] != label[other]))
        which, end = label[face[rows]], step[face[rows], one[rows] % 3]
        along, size = np.einsum("ea,ea->e", end, cylinders.axes[which]), np.linalg.norm(end, axis=1)
        keep = np.abs(along) < PARALLEL * size
        rows, which, size = rows[keep], which[keep], size[keep]
        axis = cylinders.axes[which][:, None]
        own, its = (np.abs((step[f[rows]] * axis).sum(axis=2)).max(axis=1) for f in (face, other))
        bent = opposite[rows] & (surface.edge_bends[rows] <= crease) & (planes[other[rows]] < 0)
        bent &= its >= SHORTER * own
        np.add.at(total, which, size)
        np.add.at(beyond, which[bent], size[bent])
    return np.asarray(beyond > AMISS * total)


_Fitted = tuple[FloatArray, FloatArray, float, float, int]
"""Axis, center, radius and sign of a cylinder, and the number of its different corners."""


def _table(label: IntArray, found: list[_Fitted]) -> Cylinders:
    axes, centers = (np.array([one[k] for one in found]).reshape(-1, 3) for k in (0, 1))
    radii, signs = (np.array([one[k] for one in found], np.float64) for k in (2, 3))
    return Cylinders(label, axes, centers, radii, signs)


def _known(surface: Surface, faces: Rows, found: list[_Fitted], near: float) -> int:
    """Return the first cylinder found so far that all of some faces are chords of; -1: none."""
    count = len(found)
    cylinders = _table(np.empty(0, np.int32), found)
    good = np.ones(count, np.bool_)
    for face in faces:
        every = np.full(count, face, np.int64)
        good &= _lie_on(surface, every, cylinders, np.arange(count), near)
    return int(good.argmax()) if good.any() else -1


def _chains(
    surface: Surface, planes: IntArray, crease: float, needle: Mask, longest: FloatArray
) -> list[Rows]:
    """Return chains of needles, each beside the next over a long side, the largest first."""
    if not is_part(surface, planes, needle):
        return []
    first, second, opposite = surface.edge_table.pairs
    rows = np.flatnonzero(needle[first // 3])  # few as a rule
    both = needle[second[rows] // 3] & opposite[rows] & (surface.edge_bends[rows] <= crease)
    rows = rows[both]
    one, two, ends = first[rows] // 3, second[rows] // 3, first[rows]
    corners = np.asarray(surface.faces).ravel()
    step = surface.points[corners[next_side(ends)]] - surface.points[corners[ends]]
    long = np.einsum("ea,ea->e", step, step) >= LONG_SIDE * np.maximum(longest[one], longest[two])
    one, two = one[long], two[long]
    if not is_part(surface, planes, np.unique(np.concatenate([one, two]))):
        return []
    beside: dict[int, list[int]] = {}
    for f, g in zip(one.tolist(), two.tolist(), strict=True):
        beside.setdefault(f, []).append(g)
        beside.setdefault(g, []).append(f)
    ends_first = sorted(beside, key=lambda face: len(beside[face]) > 1)
    seen: set[int] = set()
    chains = []
    for start in ends_first:
        if start in seen:
            continue
        chain, face = [], start
        while face >= 0:
            seen.add(face)
            chain.append(face)
            face = next((other for other in beside[face] if other not in seen), -1)
        chains.append(np.array(chain, np.int64))
    areas = [float(surface.face_areas[chain].sum()) for chain in chains]
    return [chains[k] for k in np.argsort(-np.array(areas), kind="stable")]


def _ends_tangent(surface: Surface, faces: Rows, rest: Mask, ball: Cylinders) -> bool:
    """Tell whether a sphere is tangent to what is round it along half of its border or more.

    Any two parallel circles lie on a sphere, as those of a cone do.
    """
    beside = surface.face_adjacency[faces]
    row, side = np.nonzero((beside >= 0) & ~rest[beside])
    corners, face = np.asarray(surface.faces), faces[row]
    ends = surface.points[corners[face, side]], surface.points[corners[face, (side + 1) % 3]]
    length = np.linalg.norm(ends[1] - ends[0], axis=1)
    other = beside[row, side]
    # Both are chords there: the surface has the mean of their normals.
    mean = unit_rows(surface.face_normals[face] + surface.face_normals[other], 1e-300)
    cosine = np.einsum(
        "fa,fa->f", ball.normals(np.zeros(len(row), int), (ends[0] + ends[1]) / 2), mean
    )
    return bool(length[cosine >= TANGENT].sum() > 0.5 * length.sum())


def _fit(surface: Surface, faces: Rows, near: float, least: int) -> _Fitted | None:
    """Return the cylinder through faces of at least so many corners; None: there is none."""
    sides = surface.points[np.asarray(surface.faces)[faces]]
    sides = np.roll(sides, -1, axis=1) - sides
    longest = np.einsum("fja,fja->fj", sides, sides).argmax(axis=1)
    steps = sides[np.arange(len(faces)), longest]
    axis = needle = np.linalg.eigh(steps.T @ steps)[1][:, 2]
    vertices = np.unique(np.asarray(surface.faces)[faces])
    points = surface.points[vertices]
    origin = points.mean(axis=0)
    local = points - origin
    across = np.linalg.svd(axis[None])[2][1:]
    flat = local @ across.T
    size = float(np.abs(local).max())
    # A circle first (Kasa), then all by least squares: two angles, two shifts and the radius.
    system = np.column_stack([2.0 * flat, np.ones(len(flat))])
    middle = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    shift, radius = middle[:2], math.sqrt(max(middle[2] + middle[:2] @ middle[:2], 0.0))
    center = shift @ across
    for _ in range(FITS):
        step = local - center
        along = step @ axis
        out = step - along[:, None] * axis
        away = np.linalg.norm(out, axis=1)
        if not radius > 0 or not (away > 0).all():
            return None
        off = away - radius
        unit = out / away[:, None]
        across = np.linalg.svd(axis[None])[2][1:]
        slopes = unit @ across.T
        system = np.column_stack([-along[:, None] / size * slopes, -slopes, -np.ones(len(off))])
        change = np.linalg.lstsq(system, -off, rcond=None)[0]
        axis = axis + change[:2] / size @ across
        axis = axis / np.linalg.norm(axis)
        center, radius = center + change[2:4] @ across, radius + change[4]
        if np.abs(change).max() < 1e-3 * near:
            break
    if np.abs(off).max() > near or radius <= CLEARLY * near or abs(axis @ needle) < ALONG:
        return None
    angle = np.sort(np.arctan2(unit @ across[1], unit @ across[0]))
    gaps = np.diff(angle, append=angle[0] + 2.0 * math.pi)
    apart = gaps * radius > 10.0 * near
    chords = np.sort(gaps[apart])[:-1]
    if len(chords) + 1 < least:
        return None
    # The arc through all corners: single chords of a fine mesh tell nothing.
    if radius * (1.0 - math.cos(0.5 * float(chords.sum()))) < CLEARLY * near:
        return None
    middle = surface.points[np.asarray(surface.faces)[faces]].mean(axis=1) - origin - center
    facing = np.einsum("fa,fa->f", middle, surface.face_vectors[faces]).sum()
    return axis, origin + center, radius, math.copysign(1.0, facing), len(chords) + 1


def _lie_on(
    surface: Surface, face: Rows, cylinders: Cylinders, which: NDArray[Any], near: float
) -> Mask:
    """Tell which faces have all corners on a cylinder, (k,), and are chords of it."""
    corners = surface.points[np.asarray(surface.faces)[face]]
    good = np.einsum(
        "fa,fa->f", cylinders.normals(which, corners.mean(axis=1)), surface.face_normals[face]
    ) >= FACING  # fmt: skip
    for corner in range(3):
        good &= np.abs(cylinders.heights(which, corners[:, corner])) <= near
    return np.asarray(good)


def _grown(
    surface: Surface, planes: IntArray, cylinders: Cylinders, crease: float, near: float
) -> IntArray:
    """Return labels that go on over faces with all corners on the cylinder beside them."""
    label = np.array(cylinders.label)
    first, second, opposite = surface.edge_table.pairs
    smooth = opposite & (surface.edge_bends <= crease)
    one = np.concatenate([first[smooth], second[smooth]]) // 3
    two = np.concatenate([second[smooth], first[smooth]]) // 3
    free = (planes[two] < 0) & (label[two] < 0)
    one, two = one[free], two[free]
    while True:
        rows = np.flatnonzero((label[one] >= 0) & (label[two] < 0))
        which, face = label[one[rows]], two[rows]
        good = _lie_on(surface, face, cylinders, which, near)
        if not good.any():
            return frozen(label, np.int32)
        label[face[good]] = which[good]


def corner_normals(
    normals: FloatArray, vertices: NDArray[Any], faces: Rows, groups: NDArray[Any],
    surface: Surface, cylinders: Cylinders,
) -> FloatArray:  # fmt: skip
    """Return normals of groups of corners: those of the cylinder that they have a face on, if any.

    Parameters
    ----------
    normals : (g, 3) float64
        Of each group.
    vertices : (g,) int
        The vertex of each.
    faces, groups : (k,) int64
        The face and the group of each corner.
    surface, cylinders : Surface, Cylinders

    Notes
    -----
    Where two cylinders of one group have other normals, they meet at a crease that bends little.
    """
    which = cylinders.label[faces]
    rows = np.flatnonzero(which >= 0)
    group = groups[rows]
    found = cylinders.normals(which[rows], surface.points[vertices[group]])
    result = np.array(normals)
    result[group] = found
    apart = group[np.einsum("ka,ka->k", result[group], found) < SAME_WAY]
    result[apart] = normals[apart]
    return result


def with_cylinders(
    normals: FloatArray, surface: Surface, planes: IntArray, cylinders: Cylinders, crease: float
) -> FloatArray:
    """Return vertex normals that are those of cylinders.

    Parameters
    ----------
    normals : (n, 3) float64
    surface : Surface
    planes : (m,) int32
        `find_planes`: at their corners, normals stay.
    cylinders : Cylinders
    crease : float
        Radians: vertices at edges that bend by more keep their normals.
    """
    if len(cylinders.radii) == 0:
        return normals
    corners = np.asarray(surface.faces)
    free = normals.any(axis=1) & only_rounded(surface, planes, crease)
    vertex: Rows = corners.ravel().astype(np.int64)
    face = np.repeat(np.arange(len(corners)), 3)
    found = corner_normals(normals, np.arange(len(normals)), face, vertex, surface, cylinders)
    return frozen(np.where(free[:, None], found, normals), np.float64)
