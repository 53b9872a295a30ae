"""The raw sheet between the two sides of a wall, extended to the rim and into junctions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis._kernels.nearest import NearestTree, nearest_on_triangles
from medialis.midsurfaces.walls import Side, Sides, side_of
from medialis.validation import FloatArray, IntArray

ABRUPT = 0.9
"""Factor of the area of a side that ends before another one of a different thickness: where the
opposite side ends at an edge of the step, that one tells better where the sheet ends."""

UNCOVERED = 0.3
"""Share of the opposite of a side that no sheet has yet, from which on it makes one."""

ON_RIM = 0.02
"""Half thicknesses: so near to the surface a sheet has come to the rim."""

FARTHEST = 3.0
"""Largest half thickness of all walls, as the unit: how far sheets are extended at most."""

ROUND = 0.95
"""Cosine of 18 degrees: a face whose corners have normals that differ by more is not rounded."""

ALONG_RIM = 0.7
"""Cosine: a rim that leads on more steeply than this is a ragged one, and leads nowhere."""

NEAREST = 24
"""Faces whose mean normal tells the plane in which a border is extended."""

SMOOTHINGS = 4
"""Of the directions in which a border is extended, along the border."""

OUT_OF_WALL = 2.5
"""Half thicknesses: how far from the border of a sheet the rim of its wall may be; what is extended
farther must lead to another sheet."""

LEAST_AREA = 2.0
"""Squares of its thickness: what lies between opposite walls of a sheet, at least."""

GROWN, CORE, OUT, AHEAD = 0, 1, 2, 3
"""What the faces of a sheet are."""

STEPS = 48
"""Of the march to the surface; each ends at the sphere of the distance."""


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
    """

    points: FloatArray
    faces: IntArray
    half: FloatArray
    kind: IntArray

    @property
    def core(self) -> NDArray[np.bool_]:
        """Faces between two opposite walls, (f,)."""
        return np.asarray(self.kind == CORE)

    @cached_property
    def tree(self) -> NearestTree:
        """The tree of the triangles."""
        return NearestTree.of_triangles(self.points, self.faces)

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals of the faces; zero where they have no area."""
        a, b, c = (self.points[self.faces[:, j]] for j in range(3))
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        return np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)

    @cached_property
    def vertex_normals(self) -> FloatArray:
        """Unit normals of the vertices, by the areas of their faces."""
        a, b, c = (self.points[self.faces[:, j]] for j in range(3))
        cross, total = np.cross(b - a, c - a), np.zeros_like(self.points)
        for j in range(3):
            np.add.at(total, self.faces[:, j], cross)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        return np.divide(total, length, out=np.zeros_like(total), where=length > 0)

    @property
    def areas(self) -> FloatArray:
        """Area of each face."""
        a, b, c = (self.points[self.faces[:, j]] for j in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

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
        return flat + smooth[:, None] * bulge, half


def raw_sheets(sides: Sides) -> list[RawSheet]:
    """Return a sheet for each wall, made from the side that tells most of it, extended."""
    shape = sides.shape
    chosen = [_as_sheet(side, sides) for side in _chosen_sides(sides)]
    chosen = [sheet for sheet in chosen if _large(sheet)]
    if not chosen:
        return []
    surface = NearestTree.of_triangles(shape.points, np.asarray(shape.faces))
    farthest = FARTHEST * max(float(sheet.half.max()) for sheet in chosen)
    return [extended(sheet, surface, farthest) for sheet in chosen]


def _large(sheet: RawSheet) -> bool:
    return float((sheet.areas * sheet.core).sum()) > LEAST_AREA * sheet.thickness**2


def _chosen_sides(sides: Sides) -> list[Side]:
    """Return sides whose opposites cover all others, the largest middles first."""
    shape, count = sides.shape, sides.count
    faces = np.asarray(shape.faces)
    every = [side_of(sides, number) for number in range(count)]
    areas = np.array([_area(side.middle, side.faces) for side in every])
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


def _area(points: FloatArray, faces: NDArray[np.int64]) -> float:
    a, b, c = (points[faces[:, j]] for j in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _as_sheet(side: Side, sides: Sides) -> RawSheet:
    core = sides.core[side.rows]
    a, b, c = (side.middle[side.faces[:, j]] for j in range(3))
    fine = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0
    kind = np.where(core[fine], CORE, GROWN).astype(np.int32)
    return RawSheet(side.middle, side.faces[fine].astype(np.int32), side.half, kind)


def extended(sheet: RawSheet, surface: NearestTree, farthest: float) -> RawSheet:
    """Extend a sheet straight on wherever it ends within the solid, up to the surface.

    Where its border has come to the surface, it is the rim. Elsewhere each vertex of the border is
    moved on in the plane of its faces, at right angles to the border; at the ends of such a piece
    of the border along the rim. The march stops at the surface, or after `farthest`.
    """
    from medialis.model.topology import Topology

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
    along = points[b] - points[a]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.where(length > 0, length, 1.0)
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
    reach = _march(points, direction, moving[~ending[moving]], surface, farthest)
    _reach_of_ends(reach, direction, ending, a[inner], b[inner])
    moving = np.flatnonzero((weight > 0) & (reach > 0))
    ahead = reach > OUT_OF_WALL * sheet.half
    far = points + reach[:, None] * direction
    return _with_strip(sheet, far, moving, a[inner], b[inner], ahead)


def _normals_of_core(sheet: RawSheet, places: FloatArray) -> FloatArray:
    """Return the mean normals of the nearest faces between opposite walls: no blend bends them."""
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(sheet.core)
    tree = cKDTree(sheet.points[sheet.faces[rows]].mean(axis=1))
    near = tree.query(places, k=np.arange(1, min(NEAREST, len(rows)) + 1))[1]
    total = sheet.normals[rows[near]].sum(axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(length > 0, length, 1.0))


def _smoothed(direction: FloatArray, a: IntArray, b: IntArray) -> FloatArray:
    """Return unit vectors at the ends of edges a, b, each with those of its neighbours."""
    for _ in range(SMOOTHINGS):
        size = np.linalg.norm(direction, axis=1, keepdims=True)
        direction = direction / np.where(size > 0, size, 1.0)
        total = 2.0 * direction
        np.add.at(total, a, direction[b])
        np.add.at(total, b, direction[a])
        direction = total
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    return np.asarray(direction / np.where(size > 0, size, 1.0))


def _march(
    points: FloatArray,
    direction: FloatArray,
    moving: NDArray[np.int64],
    surface: NearestTree,
    farthest: float,
) -> FloatArray:
    """Return how far it is to the surface from some points (0 for all others), at most."""
    reach = np.zeros(len(points))
    going = moving
    for _ in range(STEPS if len(moving) else 0):
        places = points[going] + reach[going, None] * direction[going]
        step = surface.distances(places)[0]
        reach[going] = np.minimum(reach[going] + step, farthest)
        going = going[(step > 1e-4 * farthest) & (reach[going] < farthest)]
        if len(going) == 0:
            break
    return reach


def _reach_of_ends(
    reach: FloatArray, direction: FloatArray, ending: NDArray[np.bool_], a: IntArray, b: IntArray
) -> None:
    """Let ends on the rim go as far as their neighbours do."""
    for end, other in ((a, b), (b, a)):
        rows = ending[end] & ~ending[other] & direction[end].any(axis=1)
        cosine = np.einsum("ia,ia->i", direction[end[rows]], direction[other[rows]])
        reach[end[rows]] = reach[other[rows]] / np.maximum(cosine, 0.5)


def _with_strip(
    sheet: RawSheet,
    far: FloatArray,
    moving: NDArray[np.int64],
    a: IntArray,
    b: IntArray,
    ahead: NDArray[np.bool_],
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
    x, y, z = (points[more[:, j]] for j in range(3))
    fine = np.linalg.norm(np.cross(y - x, z - x), axis=1) > 0
    return RawSheet(
        points,
        np.concatenate([sheet.faces, more[fine]]),
        np.concatenate([sheet.half, sheet.half[moving]]),
        np.concatenate([sheet.kind, np.where(kind[fine], AHEAD, OUT).astype(np.int32)]),
    )
