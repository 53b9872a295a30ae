"""Convex decomposition: few convex pieces that hold a solid and leave its holes open.

Holes of the surface are closed first. A shape whose hull sticks out by no more than the error is
one piece. Of others:

1. The surface is cut into small triangles. Each has a foot, the center of the ball that touches it
   from within: triangles on both sides of a wall have the same. The group of all is halved where
   its feet lie farthest apart, again and again, until the hull of a group, and of its feet, sticks
   out by no more than the error.
2. A piece grows from one of these groups: neighbours are merged with it, the nearest first, while
   the hull sticks out by no more than the error; of those that do not fit the halves are tried.
   The next piece begins beside what is covered, and takes what is not.
3. If there are more pieces than wanted, that is done again with a larger error.

A hull sticks out by more than the error where it reaches the surface that runs outside of the solid
at that distance, in holes and cavities as well: places on that surface are looked at.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from medialis.base.arrays import (
    Described,
    Index,
    Mask,
    distinct,
    enclosed_volume,
    extent,
    unit_rows,
)
from medialis.base.box_tree import NearestTree
from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, length, whole
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray, IntArray, Positions
from medialis.medial_meshes.distances import pieces_of
from medialis.medial_meshes.sampling import BESIDE, Solid, without_holes
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import ShrinkOptions, shrink_balls

if TYPE_CHECKING:
    from medialis.robots._hull_kernels import Facets
    from medialis.shape.diagnosis import Diagnosis

SIDE, FINER = 0.04, 0.25
"""Diagonals: sides of the small triangles; no more than this share of the root of the error, since
flat hulls in a round hole reach between places by the square of their distance."""

MOST_BORDER = 0.4
"""Share of the half-edges that lie on borders, up to which holes are closed: a tube of two rings
has a third, triangles that share no vertices all."""

RIM = 0.005
"""Diagonals: sides of small triangles that close holes, or the error where that is more: a thin
ring is not told from what it goes round by coarse ones, and finer ones take time."""

APART = 0.6
"""Sides of small triangles: of several places nearer than that one is looked at."""

LEVEL = 0.9
"""Share of the error at which places outside are looked at: hulls reach a bit farther between."""

THINNED = 0.25
"""Share of the error by which a hull may miss corners of its triangles, which keeps it small."""

HALVINGS, TRIED_HALVINGS, FEWEST = 16, 4, 16
"""Of a group that sticks out; of one that does not fit, and small triangles from which on: those
that do not fit are halved often, so that borders between pieces are straight."""

MET = 8
"""Places that a growing hull met last, which it is likely to meet again."""

AGAIN = 30
"""Times that a piece grows, at most: places where it sticks out farther are looked at from then on,
and where it begins with such a place, it begins with half."""

LOOSER = 1.4
"""Times the error of before, where there are too many pieces."""

LAYER = 2.0
"""Times the surface and the error: a hull with more besides the solid sticks out farther."""

GRID, ON_HULL = 1.0 / 64, 0.04
"""Diagonals: steps of the grid outside, and sides of parts of hulls, at which is measured at last
how far they stick out."""

STRIDE = 16
"""Of places at which is measured, those that are looked at first."""

TESTED = 20_000
"""Small triangles of a closed mesh that are tested for having the inside beneath and the outside
above; where all have, no parts overlap by more than is near to a few of the others."""

IN_UNION = 50_000
"""Places at which the volume of all pieces together is estimated."""

ROUNDING = 1e-9

LEAST = 1e-6
"""Diagonals: hulls leave out places that lie outside of them by no more."""

WAYS = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))[:13]
"""Hulls begin with the outermost points along these, so that none is left out at a sharp edge."""

MOVED = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""Diagonals by which places are moved where they would have no hull, one after the other."""


@dataclass(frozen=True, eq=False, repr=False)
class ConvexPieces(Described):
    """Convex pieces that hold a solid.

    Attributes
    ----------
    points : (n, 3) float64
        Corners of all pieces, in the units of the shape; each piece has its own.
    faces : (m, 3) int32
        Outward; those of a piece are a closed convex surface.
    of_points, of_faces : (n,), (m,) int32
        Number of the piece that each belongs to, ascending; piece 0 is the largest.
    pieces_to_surface : float
        How far a piece sticks out of the solid, at most; measured at places on and in the pieces.
    surface_to_pieces : float
        How far the surface lies outside of all pieces, at most.
    volume_ratio : float
        Volume of the pieces together over that of the solid; an estimate, good to about 1 %. NaN
        for a sheet, which has no volume.
    """

    points: Positions
    faces: IntArray
    of_points: IntArray
    of_faces: IntArray
    pieces_to_surface: float
    surface_to_pieces: float
    volume_ratio: float

    def __len__(self) -> int:
        return int(self.of_points.max(initial=-1)) + 1

    def piece(self, number: int) -> tuple[FloatArray, IntArray]:
        """Return points (k, 3) and faces (f, 3) of one piece."""
        own = np.flatnonzero(self.of_points == number)
        return self.points[own], self.faces[self.of_faces == number] - np.int32(own[0])


@dataclass(frozen=True, kw_only=True)
class ConvexPiecesOptions(Options):
    """Options of `convex_pieces`."""

    error: float = length(
        0.02,
        "Largest error",
        "Pieces stick out of the shape by no more than this: holes and gaps that are wider than "
        "twice this stay open.",
        low=0.001,
        high=0.5,
    )
    pieces: int = whole(
        64,
        "Pieces",
        "At most so many pieces; where more would be needed, they stick out farther.",
        low=1,
        high=10_000,
    )


@algorithm(ConvexPiecesOptions)
def convex_pieces(shape: Shape, options: ConvexPiecesOptions, progress: Progress) -> ConvexPieces:
    """Hold a solid by few convex pieces that leave its holes open, as physics engines want it.

    Parameters
    ----------
    shape : Shape
        A mesh of m faces; holes are closed, each by triangles round its middle. Those of a sheet
        whose faces are written twice, once from either side, stay open.

    Returns
    -------
    ConvexPieces
        They may overlap.

    Raises
    ------
    InvalidShapeError
        For a cloud, and for a mesh that encloses nothing and is not drawn from both sides.

    See Also
    --------
    shrink_balls : whose centers are the feet.

    Notes
    -----
    Cost: O(p g log v) for p pieces, g groups of small triangles and v corners of a hull, most of it
    in convex hulls of few points.

    Examples
    --------
    >>> import medialis
    >>> found = medialis.convex_pieces(medialis.organic_shape(56), error=0.05)
    >>> 1 < len(found) < 10, found.pieces_to_surface < 0.05 * medialis.organic_shape(56).diagonal
    (True, True)
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "Convex pieces need a surface with faces, got a point cloud: reconstruct a surface "
            "first."
        )
    if shape.diagonal == 0.0:
        raise InvalidShapeError("All points of the shape coincide: it encloses nothing.")
    middle, scale = 0.5 * (shape.bounds[0] + shape.bounds[1]), shape.diagonal
    given = (shape.points - middle) / scale, shape.faces
    cut = _cut_of(*given, shape.diagnosis, options.error, progress)
    one = _as_one(cut)
    if one is not None:
        hulls = [one]
    else:
        with progress.stage("groups", 0.0, 0.4):
            cut.group(progress)
        with progress.stage("pieces", 0.4, 0.9):
            hulls = _few(cut, options, progress)
    with progress.stage("measure", 0.9, 1.0):
        pieces = _measured(cut, hulls, middle, scale)
        _report_error(cut, hulls, pieces.pieces_to_surface / scale, progress)
    return pieces


def _cut_of(
    points: FloatArray,
    faces: IntArray,
    diagnosis: Diagnosis | None,
    error: float,
    progress: Progress,
) -> _Cut:
    """Return the solid that a mesh bounds, with holes closed, or its sheet; report which."""
    if _is_double_sheet(faces, diagnosis):
        both = _with_backs(faces)
        text = (
            "The mesh is a sheet whose faces are written twice: it encloses nothing, and its "
            "openings stay open. The pieces hold the sheet."
        )
        progress.warn(text, "double_sheet", faces=len(both) // 2)
        return _Cut.of_sheet(Solid(points, both), error)
    closed_points, closed_faces, holes = without_holes(points, faces, np.inf, MOST_BORDER)
    cut = _Cut.of(Solid(closed_points, closed_faces), len(faces), error)
    if holes:
        _report_closed_holes(cut.solid, len(faces), holes, error, progress)
    if cut.sheet_share > 0.0:
        text = (
            f"{100 * cut.sheet_share:.3g} % of the surface encloses nothing (sheets, parts that "
            "face inward): the pieces hold it as thin sheets."
        )
        progress.warn(text, "sheets", share=cut.sheet_share)
    return cut


def _is_double_sheet(faces: IntArray, diagnosis: Diagnosis | None) -> bool:
    """Return whether a mesh is an open sheet whose faces are written twice or more.

    The copies are in the faces, or were dropped when the file was read.
    """
    same, counts = np.unique(np.sort(faces, axis=1), axis=0, return_counts=True)
    dropped = 0 if diagnosis is None else diagnosis.duplicate_faces
    twice = bool((counts > 1).all()) or dropped >= len(counts)
    return twice and not _is_closed(np.asarray(same, np.int64))


def _is_closed(faces: Index) -> bool:
    """Return whether each edge of faces, whatever their orientation, has at least two of them."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] > 1).all())


def _with_backs(faces: IntArray) -> IntArray:
    """Return each face from both of its sides, once."""
    rows = np.unique(np.sort(faces, axis=1), axis=0)
    return np.concatenate([rows, rows[:, ::-1]]).astype(np.int32)


def _report_closed_holes(
    solid: Solid, given: int, holes: int, error: float, progress: Progress
) -> None:
    """Report the openings that were filled; a warning if one is wider than pieces may stick out."""
    fills = solid.faces[given:]
    owner = np.unique(fills.max(axis=1), return_inverse=True)[1]
    rims = solid.points[fills]
    widest = max(float(np.linalg.norm(np.ptp(rims[owner == row].reshape(-1, 3), axis=0)))
                 for row in range(holes))  # fmt: skip
    areas = solid.surface.face_areas
    share = float(areas[given:].sum() / areas.sum())
    verb = "was" if holes == 1 else "were"
    text = (
        f"{counted(holes, 'hole')} of the mesh {verb} closed, the widest {100 * widest:.3g} % of "
        f"the size across; {100 * share:.3g} % of the surface is new. What lies behind counts as "
        "solid: pieces fill it."
    )
    level = logging.WARNING if widest > 2.0 * error else logging.INFO
    data = {"holes": holes, "widest": widest, "share": share}
    progress.note(text, "holes_closed", level=level, **data)


def _report_error(cut: _Cut, hulls: list[Hull], reached: float, progress: Progress) -> None:
    """Warn where pieces stick out by more than the error, or where that cannot be measured."""
    if reached > cut.error:
        text = (
            f"Pieces stick out by {100 * reached:.3g} % of the size; {100 * cut.error:.3g} % was "
            "requested."
        )
        progress.warn(text, "error_exceeded", error=cut.error, reached=reached)
    odd, edges = _unbalanced_edges(cut.solid.faces)
    if odd == 0:
        return
    most = _sticking_out(cut, hulls, certain=True)
    text = (
        f"The mesh is not closed at {odd:,} of {edges:,} edges, and its inside is estimated: "
        f"pieces stick out by {100 * reached:.3g} to {100 * most:.3g} % of the size."
    )
    data = {"edges": odd, "of": edges, "reached": reached, "most": most}
    progress.warn(text, "inside_estimated", **data)


def _unbalanced_edges(faces: Index) -> tuple[int, int]:
    """Return the number of edges along which more faces run one way than the other, and of all.

    Without such edges the surface is wound round each place a whole number of times.
    """
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    way = np.where(ends[:, 0] < ends[:, 1], 1.0, -1.0)
    keys = np.sort(ends, axis=1) @ np.array([faces.max() + 1, 1])
    edge = np.unique(keys, return_inverse=True)[1]
    sums = np.bincount(edge, way)
    return int(np.count_nonzero(sums)), len(sums)


def _as_one(cut: _Cut) -> Hull | None:
    """Return the hull of a closed solid where that sticks out by no more than the error."""
    solid, error = cut.solid, cut.error
    volume = enclosed_volume(solid.points, solid.faces)
    if not solid.whole or volume < error**3:
        return None
    hull = Hull.of(solid.points, THINNED**2 * error)
    if hull.volume > volume + LAYER * error * solid.surface.area:
        return None
    return None if cut.too_far(hull, cut.shell(error)) else hull


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex hull: corners (k, 3), and its triangles."""

    points: FloatArray
    facets: Facets

    @classmethod
    def of(cls, points: FloatArray, least: float = LEAST) -> Hull:
        """Take the hull of points but for those that lie outside of it by no more than `least`.

        Where rounding would decide, as with points in a plane, they are moved by next to nothing.
        """
        rng, moved = np.random.default_rng(0), points
        for far in MOVED:
            along = np.einsum("wk,kn->wn", WAYS, np.ascontiguousarray(moved.T))
            first = moved[np.unique([along.argmin(axis=1), along.argmax(axis=1)])]
            hull = _grown_hull(_grown_hull(None, first, LEAST), moved, least)
            if hull is not None:
                return hull
            moved = points + rng.normal(0.0, far, points.shape)
        raise AssertionError("points that are moved have a hull")

    def with_points(self, points: FloatArray) -> Hull:
        """Return the hull that holds points (q, 3) as well, itself where it does."""
        return _grown_hull(self, points, LEAST) or Hull.of(np.concatenate([self.points, points]))

    @property
    def planes(self) -> FloatArray:
        """Planes (f, 4) of its triangles, outward."""
        return self.facets.planes

    @property
    def faces(self) -> Index:
        """Its triangles, turned outward."""
        return self.facets.corners

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner of its box."""
        return extent(self.points)

    @property
    def volume(self) -> float:
        """What it encloses."""
        return enclosed_volume(self.points, self.faces)

    @cached_property
    def places(self) -> FloatArray:
        """Places all over it."""
        parts = pieces_of(self.points[self.faces], ON_HULL)
        sides = 0.5 * (parts + np.roll(parts, 1, axis=1))
        return np.concatenate([parts.mean(axis=1), sides.reshape(-1, 3)])

    def would_hold(self, places: FloatArray, points: FloatArray) -> bool:
        """Tell whether it would hold a place (q, 3) if it grew to one of points (p, 3).

        That place comes to the front of places: the next points are likely to meet it as well.
        """
        from medialis.robots._hull_kernels import lies_between

        return bool(lies_between(places, points, self.planes))

    def rows(self, places: FloatArray, slack: float = 0.0, most: int | None = None) -> Index:
        """Return the rows of places (q, 3) that lie in it, or outside by no more than `slack`.

        With `most` the first ones alone.
        """
        from medialis.robots._hull_kernels import list_within

        rows = np.empty(len(places) if most is None else most, np.int64)
        given = np.ascontiguousarray(places), self.points, self.planes, slack, rows
        return rows[: list_within(*given)]


def _grown_hull(begun: Hull | None, points: FloatArray, least: float) -> Hull | None:
    """Grow a hull over points, itself if it need not; None where rounding would decide."""
    from medialis.robots._hull_kernels import Facets, grow_hull

    held = 0 if begun is None else len(begun.points)
    every = points if begun is None else np.concatenate([begun.points, points])
    room, rows = 2 * len(every), np.empty(len(every), np.int64)
    corners, across = np.empty((room, 3), np.int64), np.empty((room, 3), np.int64)
    facets = Facets(corners, across, np.empty((room, 4)), np.empty(room, np.int64))
    for new, old in zip(facets, () if begun is None else begun.facets, strict=False):
        new[: len(old)] = old
    count = grow_hull(np.ascontiguousarray(every), held, least, facets, rows)
    if held and count > 0 and rows[count - 1] < held:
        return begun
    end = 2 * count - 4
    used = Facets(corners[:end], across[:end], facets.planes[:end], facets.seen_by[:end])
    return Hull(every[rows[:count]], used) if count else None


@dataclass(eq=False)
class _Group:
    """Small triangles that are merged together: their rows, and how often they were halved."""

    cut: _Cut
    rows: Index
    leaf: int = -1
    depth: int = 0

    @cached_property
    def hull(self) -> Hull:
        """The hull of its triangles and feet, but for a share of the error."""
        return Hull.of(self.cut.corners[self.rows].reshape(-1, 3), THINNED * self.cut.error)

    @cached_property
    def middle(self) -> FloatArray:
        """The mean of its triangles."""
        return self.cut.middles[self.rows].mean(axis=0)

    @cached_property
    def halves(self) -> list[_Group]:
        """Both sides of the middle of its longest axis; none where all is at one place."""
        feet = self.cut.corners[self.rows, 3]
        away = feet - feet.mean(axis=0)
        along = away @ np.linalg.eigh(away.T @ away)[1][:, -1]
        first = along < 0.5 * (along.min() + along.max())
        if first.all() or not first.any():
            return []
        sides = (self.rows[first], self.rows[~first])
        return [_Group(self.cut, rows, self.leaf, self.depth + 1) for rows in sides]


@dataclass(eq=False)
class _Cut:
    """A solid of diagonal 1 whose surface is cut into small triangles.

    `corners` (t, 4, 3) has the triangles, each with its foot, which is its middle before
    `group`; `middles` (t, 3), `normals` (t, 3). `walls` are the triangles before they were cut, but
    for those of closed holes. `owners` (t,) has the group of each triangle. `shells` are those that
    were asked for. Faces that enclose nothing are sheets, with two triangles at each place, one on
    either side; they are `sheet_share` of the area, and all of it is one with `is_sheet`. With
    `is_simple` each triangle has the inside beneath and the outside above.
    """

    solid: Solid
    walls: NearestTree
    error: float
    corners: FloatArray
    middles: FloatArray
    normals: FloatArray
    groups: list[_Group]
    neighbours: list[set[int]]
    owners: Index
    is_simple: bool = False
    is_sheet: bool = False
    sheet_share: float = 0.0
    shells: dict[float, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, solid: Solid, given: int, error: float) -> _Cut:
        """Cut the surface; the feet of triangles are their middles, and there are no groups.

        Faces from row `given` on close holes. Where a hole is a ring they fill what it goes round
        as well, twice: of their small triangles those count that have the inside beneath alone.

        Raises
        ------
        InvalidShapeError
            If nothing is inside.
        """
        side, closing_side = _sides(error)
        walls = solid.points[solid.faces[:given]]
        triangles, share = pieces_of(walls, side), 0.0
        few = triangles[:: max(1, len(triangles) // TESTED)] if solid.whole else triangles
        below, above = _inside_beside(solid, few, few.mean(axis=1)[:, None])
        is_simple = bool((below & ~above).all())
        if not is_simple:
            triangles, sheets = _sorted_out(solid, triangles)
            if not len(triangles):
                raise InvalidShapeError("Nothing of the shape is inside it: it encloses nothing.")
            areas = [float(np.linalg.norm(_area_vectors(some), axis=1).sum())
                     for some in (triangles, sheets)]  # fmt: skip
            share = areas[1] / sum(areas)
            walls = triangles = np.concatenate([triangles, sheets, sheets[:, ::-1]])
        if given < len(solid.faces):
            closing = pieces_of(solid.points[solid.faces[given:]], closing_side)
            below, above = _inside_beside(solid, closing, closing.mean(axis=1)[:, None])
            closing = closing[(below & ~above)[:, 0]]
            walls, triangles = (np.concatenate([some, closing]) for some in (walls, triangles))
        cut = cls._of_triangles(solid, error, walls, triangles)
        cut.is_simple, cut.sheet_share = is_simple, share
        return cut

    @classmethod
    def of_sheet(cls, solid: Solid, error: float) -> _Cut:
        """Cut a sheet that has each face from both sides."""
        walls = solid.points[solid.faces]
        cut = cls._of_triangles(solid, error, walls, pieces_of(walls, _sides(error)[0]))
        cut.is_sheet = True
        return cut

    @classmethod
    def _of_triangles(
        cls, solid: Solid, error: float, walls: FloatArray, triangles: FloatArray
    ) -> _Cut:
        middles, normals = triangles.mean(axis=1), _normals(triangles)
        corners = np.concatenate([triangles, middles[:, None]], axis=1)
        rows = np.arange(3 * len(walls), dtype=np.int32).reshape(-1, 3)
        tree = NearestTree.of_triangles(walls.reshape(-1, 3), rows)
        return cls(solid, tree, error, corners, middles, normals, [], [], np.empty(0, np.int64))

    def group(self, progress: Progress) -> None:
        """Take feet, and groups whose hulls stick out by no more than the error."""
        cloud = Shape(self.middles, self.normals)
        radii = shrink_balls.of(cloud, ShrinkOptions(), progress.still).radii
        feet = self.middles - np.nan_to_num(radii, posinf=0.0)[:, None] * self.normals
        beside = ~self.solid.contains(feet)
        feet[beside] = (self.middles - THINNED * self.error * self.normals)[beside]
        self.corners[:, 3] = feet
        waiting = [_Group(self, np.arange(len(feet)))]
        shell = self.shell(self.error)
        while waiting:
            group = waiting.pop()
            halved = group.depth < HALVINGS and group.halves
            if halved and len(group.hull.rows(shell, most=1)):
                waiting += group.halves
                continue
            self.groups.append(_Group(self, group.rows, len(self.groups)))
            progress.update(len(self.groups) / (len(self.groups) + len(waiting)))
        self.owners = np.empty(len(feet), np.int64)
        for group in self.groups:
            self.owners[group.rows] = group.leaf
        self.neighbours = _neighbours(self)

    @cached_property
    def places(self) -> FloatArray:
        """The middle of each group."""
        return np.array([group.middle for group in self.groups])

    def left(self, covered: Mask) -> Index:
        """Return how many triangles of each group are not covered."""
        return np.bincount(self.owners[~covered], minlength=len(self.groups))

    def shell(self, error: float) -> FloatArray:
        """Return places that lie outside, about as far away as hulls may stick out."""
        if error not in self.shells:
            self.shells[error] = self._shell(error)
        return self.shells[error]

    def _shell(self, error: float) -> FloatArray:
        """Compute them."""
        far = LEVEL * error
        on = np.concatenate([self.middles[:, None], self.corners[:, :3]], axis=1)
        places = (on + far * self.normals[:, None]).reshape(-1, 3)
        cells = np.floor(places / (APART * min(SIDE, FINER * self.error**0.5))).astype(np.int64)
        keys = (cells - cells.min(axis=0)) @ np.array([1 << 40, 1 << 20, 1])
        places = places[np.unique(keys, return_index=True)[1]]
        places = places[self.walls.distances(places)[0] > far * (1.0 - 1e-3)]
        if not self.is_simple:
            places = places[~self.solid.contains(places)]
        grid, least = self.grid
        grid = grid[least < error + 2.0 * GRID]
        away = self.walls.distances(grid)[0]
        return np.concatenate([places, grid[(away > error) & (away < error + 2.0 * GRID)]])

    @cached_property
    def grid(self) -> tuple[FloatArray, FloatArray]:
        """Places of a grid outside of the solid, and how far away they are, at least."""
        grid, least = self._whole_grid
        outside = ~self.solid.contains(grid)
        return grid[outside], least[outside]

    def outside_grid(self, certain: bool) -> FloatArray:
        """Return the grid outside of the solid; with `certain` also what is inside in doubt."""
        if not certain:
            return self.grid[0]
        grid = self._whole_grid[0]
        return grid[~self.solid.certainly_contains(grid)]

    @cached_property
    def _whole_grid(self) -> tuple[FloatArray, FloatArray]:
        """Places of a grid, inside as well, and a lower bound of their distance to the surface."""
        from scipy.ndimage import distance_transform_edt

        low, high = extent(self.solid.points)
        steps = [np.arange(a + 0.5 * GRID, b, GRID) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        size = np.array([max(len(axis), 1) for axis in steps])
        cells = ((self.corners[:, :3].reshape(-1, 3) - low) / GRID).astype(np.int64)
        free = np.ones(size, bool)
        free[tuple(np.minimum(cells, size - 1).T)] = False
        # A wall is no farther from a corner of its small triangles, and that from its cell's place.
        least = distance_transform_edt(free, GRID).ravel() - (SIDE / 3**0.5 + 3**0.5 * GRID)
        return grid, least[: len(grid)]

    def too_far(self, hull: Hull, shell: FloatArray) -> bool:
        """Tell whether a hull sticks out by more than the error."""
        return bool(len(hull.rows(shell, most=1)) or len(self.beyond(hull, self.error)))

    def beyond(self, hull: Hull, error: float) -> FloatArray:
        """Return places of a hull that stick out by more than an error."""
        places = hull.places
        places = places[self.walls.distances(places, enough=error)[0] > error]
        return places[~self.solid.contains(places)]


def _sides(error: float) -> tuple[float, float]:
    """Return the sides of small triangles, in diagonals, and of those that close holes."""
    side = min(SIDE, FINER * error**0.5)
    return side, min(side, max(error, RIM))


def _sorted_out(solid: Solid, triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the small triangles that bound the solid, turned outward, and those of sheets, once.

    Both sides of a triangle are tested at its middle and near its corners, since it may be partly
    inside of another part of the shape. Those that are inside as a whole are left out.
    """
    middles = triangles.mean(axis=1)
    near = np.concatenate([middles[:, None], 0.1 * middles[:, None] + 0.9 * triangles], axis=1)
    below, above = _inside_beside(solid, triangles, near)
    outward = (below & ~above).any(axis=1)
    inward = (above & ~below).any(axis=1) & ~outward
    sheet = ~(below | above).any(axis=1)
    once = np.unique(np.round(middles[sheet] / ROUNDING), axis=0, return_index=True)[1]
    bounding = np.concatenate([triangles[outward], triangles[inward][:, ::-1]])
    return bounding, triangles[sheet][np.sort(once)]


def _inside_beside(solid: Solid, triangles: FloatArray, places: FloatArray) -> tuple[Mask, Mask]:
    """Return whether it is inside just below and above places (t, k, 3) of triangles, (t, k)."""
    beside = BESIDE * _normals(triangles)[:, None]
    below, above = (solid.contains((places + way * beside).reshape(-1, 3)) for way in (-1.0, 1.0))
    return below.reshape(places.shape[:2]), above.reshape(places.shape[:2])


def _area_vectors(triangles: FloatArray) -> FloatArray:
    """Return the normals of triangles, twice as long as their area."""
    sides = triangles[:, 1:] - triangles[:, :1]
    return np.cross(sides[:, 0], sides[:, 1])


def _normals(triangles: FloatArray) -> FloatArray:
    """Return the unit normals of triangles, 0 where they have no area."""
    return unit_rows(_area_vectors(triangles))


def _neighbours(cut: _Cut) -> list[set[int]]:
    """Return the groups that have a corner in common with each."""
    x, y, z = np.round(cut.corners[:, :3].reshape(-1, 3) / ROUNDING).astype(np.int64).T
    column = np.unique(x << 32 | (y & 0xFFFFFFFF), return_inverse=True)[1]
    vertex = np.unique(column << 32 | (z & 0xFFFFFFFF), return_inverse=True)[1]
    pairs = distinct(vertex * len(cut.groups) + np.repeat(cut.owners, 3))
    vertex, owner = np.divmod(pairs, len(cut.groups))
    result: list[set[int]] = [set() for _ in cut.groups]
    starts = np.flatnonzero(np.diff(vertex, prepend=-1, append=-1))
    several = np.diff(starts) > 1
    for first, end in zip(starts[:-1][several].tolist(), starts[1:][several].tolist(), strict=True):
        around = owner[first:end].tolist()
        for one in around:
            result[one].update(around)
    return result


def _few(cut: _Cut, options: ConvexPiecesOptions, progress: Progress) -> list[Hull]:
    """Return at most so many hulls, with the error wanted or the least that was tried."""
    error = options.error
    while error < 1.0:
        hulls = []
        for hull, share in _grown(cut, error):
            hulls.append(hull)
            progress.update(share)
            if len(hulls) > options.pieces:
                break
        else:
            break
        error *= LOOSER if options.pieces > 1 else np.inf
    else:
        hulls = [Hull.of(cut.corners.reshape(-1, 3), THINNED * cut.error)]
    if error > options.error:
        text = (
            f"More than {counted(options.pieces, 'piece')} would be needed for an error of "
            f"{100 * options.error:.3g} % of the size: pieces stick out farther."
        )
        progress.warn(text, "more_pieces", pieces=options.pieces)
    return hulls


def _grown(cut: _Cut, error: float) -> Iterator[tuple[Hull, float]]:
    """Yield hulls that stick out by no more than an error, and what share is covered by now."""
    shell, covered = cut.shell(error), np.zeros(len(cut.corners), bool)
    everything = cut.corners.reshape(-1, 3)
    while not covered.all():
        start = _start(cut, covered)
        group = _Group(cut, start.rows[~covered[start.rows]], start.leaf)
        for _ in range(AGAIN):
            grown = _piece(cut, group, covered, shell)
            hull = Hull.of(grown.points, THINNED**2 * error)  # about half its corners
            beyond = cut.beyond(hull, error)
            if not len(beyond):
                break
            shell = np.concatenate([shell, beyond])
            if group.halves and len(group.hull.rows(beyond, ROUNDING, 1)):
                group = group.halves[0]
        inside = np.zeros(len(everything), bool)
        inside[hull.rows(everything, THINNED * error)] = True
        covered |= inside.reshape(-1, 4).all(axis=1)
        covered[group.rows] = True
        yield hull, float(covered.mean())


def _start(cut: _Cut, covered: Mask) -> _Group:
    """Return the group that is not covered whose neighbours are most; at first an outer one."""
    if not covered.any():
        return max(cut.groups, key=lambda group: float(np.linalg.norm(group.middle)))
    done = cut.left(covered) == 0
    share = [float(done[list(around)].mean()) if around else 1.0 for around in cut.neighbours]
    return cut.groups[max(np.flatnonzero(~done).tolist(), key=lambda row: share[row])]


def _piece(cut: _Cut, start: _Group, covered: Mask, shell: FloatArray) -> Hull:
    """Let a hull grow from a group over those that are not covered, the nearest first."""
    hull, count, met = start.hull, itertools.count(), shell[:0]
    waiting: list[tuple[float, int, _Group]] = []
    seen: set[int] = set()
    left = cut.left(covered).tolist()
    away = np.linalg.norm(cut.places - start.middle, axis=1).tolist()

    def wait_round(leaf: int) -> None:
        for other in sorted((cut.neighbours[leaf] | {leaf}) - seen):
            seen.add(other)
            heapq.heappush(waiting, (away[other], next(count), cut.groups[other]))

    wait_round(start.leaf)
    while waiting:
        group = heapq.heappop(waiting)[2]
        whole = group is cut.groups[group.leaf]
        free = left[group.leaf] if whole else np.count_nonzero(~covered[group.rows])
        finer = group.depth < TRIED_HALVINGS and len(group.rows) >= FEWEST
        if free == 0:
            wait_round(group.leaf)
            continue
        if not (finer and free < len(group.rows)) and not hull.would_hold(met, group.hull.points):
            larger = hull.with_points(group.hull.points)
            hit = shell[larger.rows(shell, ROUNDING, 1)] if larger is not hull else shell[:0]
            if not len(hit):
                hull = larger
                wait_round(group.leaf)
                continue
            met = np.concatenate([hit, met[: MET - 1]])
        for half in group.halves if finer else ():
            far = math.dist(half.middle, start.middle)
            heapq.heappush(waiting, (far, next(count), half))
    return hull


def _measured(cut: _Cut, hulls: list[Hull], middle: FloatArray, scale: float) -> ConvexPieces:
    """Put pieces in order and measure how near they are."""
    hulls = sorted(hulls, key=lambda hull: -hull.volume)
    counts, triangles = [len(hull.points) for hull in hulls], [len(hull.faces) for hull in hulls]
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    points = np.concatenate([hull.points for hull in hulls])
    faces = np.concatenate([hull.faces + begin for hull, begin in zip(hulls, first, strict=True)])
    faces = faces.astype(np.int32)
    numbers = np.arange(len(hulls), dtype=np.int32)
    free = cut.corners[:, :3].reshape(-1, 3)
    for hull in hulls:
        free = np.delete(free, hull.rows(free, ROUNDING), axis=0)
    gaps = NearestTree.of_triangles(points, faces).distances(free)[0]
    return ConvexPieces(
        scale * points + middle,
        faces,
        np.repeat(numbers, counts),
        np.repeat(numbers, triangles),
        scale * _sticking_out(cut, hulls),
        scale * float(gaps.max(initial=0.0)),
        math.nan if cut.is_sheet else _volume_ratio(cut, hulls),
    )


def _sticking_out(cut: _Cut, hulls: list[Hull], certain: bool = False) -> float:
    """Return how far hulls stick out of the solid at places on them, and of a grid in them.

    With `certain` places count as inside only where that is certain.
    """
    grid = cut.outside_grid(certain)
    inside = distinct(np.concatenate([hull.rows(grid) for hull in hulls]))
    places = np.concatenate([hull.places for hull in hulls])
    contains = cut.solid.certainly_contains if certain else cut.solid.contains
    places = np.concatenate([places[~contains(places)], grid[inside]])
    far = 0.0
    for some in (places[::STRIDE], places):  # most are nearer than the farthest of some
        far = max(far, cut.walls.distances(some, enough=far)[0].max(initial=0.0))
    return float(far)


def _volume_ratio(cut: _Cut, hulls: list[Hull]) -> float:
    """Return the volume of the union of hulls over that of the solid, both at the same places."""
    low = np.min([hull.bounds[0] for hull in hulls], axis=0)
    high = np.max([hull.bounds[1] for hull in hulls], axis=0)
    steps = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])
    places = low + (np.arange(1, IN_UNION + 1)[:, None] * steps % 1.0) * (high - low)
    held = np.zeros(IN_UNION, bool)
    for hull in hulls:
        held[hull.rows(places)] = True
    inside = np.count_nonzero(cut.solid.contains(places))
    return float(np.count_nonzero(held) / inside) if inside else math.nan
