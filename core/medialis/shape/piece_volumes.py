"""Volumes of the solid pieces of a mesh on a grid, and the surface around them.

`Solids` closes the holes of pieces; `Grid` chooses the cell by their thickness; `Volume` has the
corners inside each piece, by signed crossings of the lines of the grid, and the surface around
chosen pieces, by surface nets of the signed distance. `union.py` unites pieces with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree, next_side, sums_of, twice_areas
from medialis.base.box_tree import NearestTree
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.generate import make_unambiguous, surface_nets
from medialis.shape.shape import Shape
from medialis.shape.surface import piece_labels

MAX_CORNERS = 4_000_000
"""Maximum number of corners of the grid."""

MAX_POINTS = 30_000
"""Maximum number of points of the united surface, approximately."""

MIN_CELLS = 100
"""Minimum number of cells along the diagonal of the shape."""

CELLS_A_RADIUS = 2.0
"""Number of cells per radius of thin parts."""

THIN = 0.02
"""Fraction of the area that may be thinner than the radius that `CELLS_A_RADIUS` refers to."""

RADIUS_SAMPLES, RADIUS_STEPS, SHRINKING = 1000, 8, 0.95
"""Number of samples of the local radius, maximum number of iterations of the shrinking ball of
each, and the factor by which a radius falls in an iteration that is not the last one."""

OPEN = 0.12
"""Maximum area of the holes of a solid piece that no other piece covers, as a fraction of its own
area. Open cylinders of limbs have less; skirts and hair strips have more."""

WORN = 0.25
"""Minimum fraction of the volume inside an open piece that other solids fill in clothes."""

MIN_VOLUME = 4.0
"""Minimum volume of a part of the united surface, in cells: thin pieces leave specks."""

LINES_AT_ONCE = 4_000_000
"""Maximum number of pairs of a face and a line of the grid that are tested together."""

OFFSET = (0.3819660, 0.4142136, 0.2679492)
"""Position of the first corner of the grid in cells: corners are not on planes of models."""


@dataclass(frozen=True, eq=False)
class Solids:
    """The pieces of a mesh, with their holes closed.

    Attributes
    ----------
    points : (n + h, 3) float64
        The given points, then the centers of h holes.
    faces : (m, 3) int64
        The given faces, then a fan of triangles for each hole.
    piece : (m,) int64
        Piece of each face.
    given : int
        Number of given faces.
    closed : (p,) bool
        Pieces with faces that had no hole.
    outward : (p,) bool
        Pieces with faces other than the walls of cavities, which face inward.
    """

    points: FloatArray
    faces: Index
    piece: Index
    given: int
    closed: Mask
    outward: Mask

    @classmethod
    def of(cls, shape: Shape) -> Solids:
        """Close the holes of each piece by fans of triangles around the mean of their border."""
        assert shape.faces is not None
        given, label = shape.faces.astype(np.int64), shape.components.astype(np.int64)
        count = int(label.max()) + 1
        sides = shape.edge_table.single.astype(np.int64)
        start, end = given.ravel()[sides], given.ravel()[next_side(sides)]
        points, faces = np.asarray(shape.points), given
        if len(sides):
            links = np.stack([start, end], axis=1)
            ring = np.unique(piece_labels(shape.point_count, links)[start], return_inverse=True)[1]
            sizes = np.bincount(ring)
            middles = sums_of(ring, points[start], len(sizes)) / sizes[:, None]
            fans = np.stack([end, start, len(points) + ring], axis=1)
            points, faces = np.concatenate([points, middles]), np.concatenate([given, fans])
            label = np.concatenate([label, label[start[np.unique(ring, return_index=True)[1]]]])
        piece = label[faces[:, 0]]
        closed = np.zeros(count, np.bool_)
        closed[piece] = True
        closed[piece[len(given) :]] = False
        corners = points[faces] - shape.offset
        sixth = np.einsum("fa,fa->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        inward = closed & (np.bincount(piece, sixth, count) < 0)
        used = np.zeros(count, np.bool_)
        used[piece] = True
        return cls(points, faces, piece, len(given), closed, used & ~inward)

    @property
    def count(self) -> int:
        """Number of pieces p."""
        return len(self.closed)

    @cached_property
    def areas(self) -> FloatArray:
        """Area of each face, (m,)."""
        return 0.5 * twice_areas(self.points, self.faces)

    def radii(self) -> tuple[FloatArray, FloatArray]:
        """Return local radii of the pieces at samples, and the area of each sample.

        The radius is that of the largest ball inside a piece that touches a face in its middle
        (the shrinking ball algorithm of thesis 2.4.2, against the points and middles of the piece).
        """
        corners = self.points[self.faces[: self.given]]
        middles, areas = corners.mean(axis=1), self.areas[: self.given]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(2.0 * areas, 1e-300)[:, None]
        piece = self.piece[: self.given]
        some = np.unique(np.searchsorted(
            np.cumsum(areas), np.linspace(0.0, areas.sum(), RADIUS_SAMPLES, endpoint=False)
        ).clip(max=self.given - 1))  # fmt: skip
        order = np.argsort(piece, kind="stable")
        ends = np.searchsorted(piece[order], np.arange(self.count + 1))
        radii = np.empty(len(some))
        size = float(np.ptp(self.points, axis=0).max())
        for row in np.unique(piece[some]).tolist():
            own = order[ends[row] : ends[row + 1]]
            tree = kd_tree(np.concatenate([corners[own].reshape(-1, 3), middles[own]]))
            here = np.flatnonzero(piece[some] == row)
            radii[here] = _shrunk(tree, middles[some[here]], normals[some[here]], size)
        return radii, areas[some]


def _shrunk(tree: Any, places: FloatArray, normals: FloatArray, size: float) -> FloatArray:
    """Return the radii of the largest balls behind places with these normals, (k,)."""
    radii, points = np.full(len(places), size), np.asarray(tree.data)
    rows = np.arange(len(places))
    for _ in range(RADIUS_STEPS):
        here, normal = places[rows], normals[rows]
        # The middle of a ball is as far from all points: a tolerance ends the search.
        near = points[tree.query(here - radii[rows, None] * normal, eps=0.1)[1]]
        off = here - near
        square, along = (off**2).sum(axis=1), (off * normal).sum(axis=1)
        smaller = (along > 0) & (square > 0) & (square < 2.0 * SHRINKING * along * radii[rows])
        radii[rows[smaller]] = square[smaller] / (2.0 * along[smaller])
        rows = rows[smaller]
    return radii


@dataclass(frozen=True, eq=False)
class Grid:
    """Corners at `low + cell * (i, j, k)` with i, j, k less than `size`."""

    low: FloatArray
    cell: float
    size: Index

    @classmethod
    def around(cls, shape: Shape, solids: Solids) -> Grid:
        """Choose the cell by the thickness of the pieces, within what is affordable."""
        radii, areas = solids.radii()
        order = np.argsort(radii, kind="stable")
        share = np.cumsum(areas[order])
        thin = float(radii[order[np.searchsorted(share, THIN * share[-1])]])
        low, high = shape.bounds
        sides = np.maximum(high - low, 1e-3 * shape.diagonal)
        # A surface goes through about 1.5 cells for each square of the side of a cell.
        least = max(math.cbrt(sides.prod() / MAX_CORNERS), math.sqrt(1.5 * shape.area / MAX_POINTS))
        cell = max(min(thin / CELLS_A_RADIUS, shape.diagonal / MIN_CELLS), least)
        size = np.ceil((high - low) / cell).astype(np.int64) + 6
        return cls(low - cell * (2.0 + np.array(OFFSET)), cell, size)

    @property
    def total(self) -> int:
        """Number of corners."""
        return int(self.size.prod())

    def places(self, rows: Index) -> FloatArray:
        """Return the positions of corners, (k, 3)."""
        return self.low + self.cell * np.stack(np.unravel_index(rows, tuple(self.size)), axis=1)

    def rows(self, places: FloatArray) -> Index:
        """Return the corner nearest to each position, (k,)."""
        corner = np.rint((places - self.low) / self.cell).astype(np.int64)
        return np.ravel_multi_index(tuple(np.clip(corner, 0, self.size - 1).T), tuple(self.size))


def _crossings(solids: Solids, grid: Grid) -> tuple[Index, Index, FloatArray, Index]:
    """Return line, piece, height in cells, and sign of all crossings of faces and lines along z."""
    local = (solids.points - grid.low) / grid.cell
    corners = local[solids.faces]
    flat = corners[:, :, :2]
    first = np.ceil(flat.min(axis=1)).astype(np.int64)
    counts = np.maximum(np.floor(flat.max(axis=1)).astype(np.int64) - first + 1, 0)
    pairs = counts.prod(axis=1)
    rows = np.flatnonzero(pairs)
    chunks = np.cumsum(pairs[rows]) // LINES_AT_ONCE
    found = []
    for some in np.split(rows, np.flatnonzero(np.diff(chunks)) + 1):
        face = np.repeat(some, pairs[some])
        step = np.arange(len(face)) - np.repeat(np.cumsum(pairs[some]) - pairs[some], pairs[some])
        x = first[face, 0] + step // counts[face, 1]
        y = first[face, 1] + step % counts[face, 1]
        a, b, c = (corners[face, k] for k in range(3))
        u = (b[:, 0] - x) * (c[:, 1] - y) - (b[:, 1] - y) * (c[:, 0] - x)
        v = (c[:, 0] - x) * (a[:, 1] - y) - (c[:, 1] - y) * (a[:, 0] - x)
        w = (a[:, 0] - x) * (b[:, 1] - y) - (a[:, 1] - y) * (b[:, 0] - x)
        hit = ((u >= 0) & (v >= 0) & (w >= 0)) | ((u <= 0) & (v <= 0) & (w <= 0))
        whole = u + v + w
        hit &= whole != 0
        u, v, w, whole = u[hit], v[hit], w[hit], whole[hit]
        height = (u * a[hit, 2] + v * b[hit, 2] + w * c[hit, 2]) / whole
        line = x[hit] * grid.size[1] + y[hit]
        found.append((line, solids.piece[face[hit]], height, np.sign(whole).astype(np.int64)))
    if not found:
        none = np.zeros(0, np.int64)
        return none, none, np.zeros(0), none
    line, piece, height, sign = (np.concatenate(part) for part in zip(*found, strict=True))
    return line, piece, height, sign


def _cells_inside(solids: Solids, grid: Grid) -> tuple[Index, Index]:
    """Return corners of the grid that are inside pieces, and the piece of each.

    A corner is inside a piece where the signs of the crossings below it do not sum to 0. Where all
    crossings of a line do not, as beside faces that are missing, the corners between the first one
    and the last one are inside.
    """
    line, piece, height, sign = _crossings(solids, grid)
    order = np.lexsort((height, piece, line))
    line, piece, height, sign = line[order], piece[order], height[order], sign[order]
    if len(line) == 0:
        return line, piece
    begins = np.append(True, (line[1:] != line[:-1]) | (piece[1:] != piece[:-1]))
    group = np.cumsum(begins) - 1
    sums = np.cumsum(sign)
    before = (sums - sign)[begins]
    sums -= before[group]
    last = np.append(np.flatnonzero(begins)[1:], len(line)) - 1
    broken = (sums[last] != 0)[group]
    onward = np.append(~begins[1:], False)
    rows = np.flatnonzero(onward & ((sums != 0) | broken))
    low = np.ceil(height[rows]).astype(np.int64)
    counts = np.maximum(np.floor(height[rows + 1]).astype(np.int64) - low + 1, 0)
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    cells = np.repeat(line[rows] * grid.size[2] + low, counts) + step
    return cells, np.repeat(piece[rows], counts)


@dataclass(frozen=True, eq=False)
class Volume:
    """Corners of a grid inside the solid pieces.

    Attributes
    ----------
    solids : Solids
    grid : Grid
    cells, pieces : (c,) int64
        Corners inside pieces, and the piece; a corner may be inside several ones.
    """

    solids: Solids
    grid: Grid
    cells: Index
    pieces: Index

    @classmethod
    def of(cls, solids: Solids, grid: Grid) -> Volume:
        """Find the corners inside all pieces that are solid."""
        cells, pieces = _cells_inside(solids, grid)
        solid = _solid_pieces(solids, grid, cells, pieces)
        kept = solid[pieces]
        return cls(solids, grid, cells[kept], pieces[kept])

    def owners(self, chosen: Mask) -> IntArray:
        """Return a piece at each corner, (total,), -1 outside of the chosen pieces (p,)."""
        owner = np.full(self.grid.total, -1, np.int32)
        rows = chosen[self.pieces]
        owner[self.cells[rows]] = self.pieces[rows]
        return owner

    def bodies(self) -> tuple[IntArray, Index]:
        """Return the body of each piece, (p,), and the pairs of pieces that overlap or touch."""
        everything = np.ones(self.solids.count, np.bool_)
        owner = self.owners(everything)
        links = [np.stack([self.pieces, owner[self.cells]], axis=1)]
        links += [pair for _, pair in self._touching(owner)]
        pairs = _distinct_pairs(np.sort(np.concatenate(links), axis=1))
        label = piece_labels(self.solids.count, pairs)
        present = np.zeros(self.solids.count, np.bool_)
        present[self.pieces] = True
        body = np.full(self.solids.count, -1, np.int32)
        body[present] = np.unique(label[present], return_inverse=True)[1]
        return body, pairs

    def _touching(self, owner: IntArray) -> list[tuple[Index, Index]]:
        """Return corners between two pieces, and the pieces: neighbours, and with one between."""
        box, found = owner.reshape(tuple(self.grid.size)), []
        for axis in range(3):
            here = np.moveaxis(box, axis, 0)
            step = int(np.prod(self.grid.size[axis + 1 :]))
            for gap in (1, 2):
                one, other = here[:-gap], here[gap:]
                at = np.nonzero((one >= 0) & (other >= 0) & (one != other))
                pair = np.stack([one[at], other[at]], axis=1).astype(np.int64)
                first = np.moveaxis(np.array(at), 0, -1)
                first = np.insert(first[:, 1:], axis, first[:, 0], axis=1)
                rows = np.ravel_multi_index(tuple(first.T), box.shape) + (gap - 1) * step
                found.append((rows, pair))
        return found

    def filled(self, body: IntArray) -> Mask:
        """Return the corners inside pieces with a body, as a grid.

        Slits of one corner between pieces that touch, but do not overlap, are filled.
        """
        owner = self.owners(body >= 0)
        inside = owner >= 0
        overlap = np.stack([self.pieces, owner[self.cells]], axis=1)
        overlap = overlap[overlap[:, 1] >= 0]
        label = piece_labels(self.solids.count, _distinct_pairs(overlap))
        for rows, pairs in self._touching(owner):
            inside[rows[label[pairs[:, 0]] != label[pairs[:, 1]]]] = True
        return inside.reshape(tuple(self.grid.size))

    def surface(
        self, body: IntArray, bridges: FloatArray, single: bool
    ) -> tuple[FloatArray, IntArray]:
        """Return points and faces of the surface around pieces with a body, and bridges (b, 2, 4).

        Cavities are filled. If a `single` surface is wanted, the largest one is returned.
        """
        from scipy.ndimage import label

        inside = self.filled(body)
        for ends in bridges:
            self._fill_bridge(inside, ends)
        outer, _ = label(~inside)
        inside = outer != outer[0, 0, 0]
        if single:
            parts, count = label(inside)
            if count > 1:
                inside = parts == 1 + np.bincount(parts.ravel())[1:].argmax()
        values = self._distances(inside, body)
        make_unambiguous(values)
        points, faces = surface_nets(values, self.grid.low, self.grid.cell)
        return _without_specks(points, faces, self.grid.cell, single)

    def _fill_bridge(self, inside: Mask, ends: FloatArray) -> None:
        """Fill a capsule between two positions (2, 3), with its radius behind them."""
        grid = self.grid
        (a, b), radius = (ends[:, :3] - grid.low) / grid.cell, ends[0, 3] / grid.cell
        low = np.maximum(np.floor(np.minimum(a, b) - radius).astype(np.int64), 1)
        high = np.minimum(np.ceil(np.maximum(a, b) + radius).astype(np.int64), grid.size - 2)
        box = np.indices(tuple(high - low + 1)).reshape(3, -1).T + low
        way = b - a
        share = np.clip((box - a) @ way / max(float(way @ way), 1e-300), 0.0, 1.0)
        near = np.linalg.norm(box - a - share[:, None] * way, axis=1) <= radius
        inside[tuple(box[near].T)] = True

    def _distances(self, inside: Mask, body: IntArray) -> FloatArray:
        """Return distances at corners beside the surface, at most a cell; negative inside.

        Faces deep inside other pieces do not count.
        """
        from scipy.ndimage import binary_erosion

        solids, grid = self.solids, self.grid
        beside = np.zeros(inside.shape, np.bool_)
        for axis in range(3):
            here, marks = np.moveaxis(inside, axis, 0), np.moveaxis(beside, axis, 0)
            flips = here[1:] != here[:-1]
            marks[1:] |= flips
            marks[:-1] |= flips
        faces = solids.faces[(body >= 0)[solids.piece]]
        deep = binary_erosion(inside, iterations=2).ravel()
        hidden = deep[grid.rows(solids.points)][faces].all(axis=1)
        hidden &= deep[grid.rows(solids.points[faces].mean(axis=1))]
        shown = frozen(faces[~hidden] if (~hidden).any() else faces, np.int32)
        rows = np.flatnonzero(beside.ravel())
        away = NearestTree.of_triangles(solids.points, shown).distances(grid.places(rows))[0]
        values = np.where(inside, -grid.cell, grid.cell)
        near = np.clip(away, 1e-3 * grid.cell, grid.cell)
        values.ravel()[rows] *= near / grid.cell
        return values


def _without_specks(
    points: FloatArray, faces: IntArray, cell: float, single: bool
) -> tuple[FloatArray, IntArray]:
    """Return the parts of a surface that enclose `MIN_VOLUME` cells or more, or the largest one."""
    label = piece_labels(len(points), faces[:, [0, 1, 1, 2]].reshape(-1, 2))
    if len(faces) == 0 or label.max() == 0:
        return points, faces
    corners = points[faces] - points[0]
    sixth = np.einsum("fa,fa->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    volumes = np.bincount(label[faces[:, 0]], sixth)
    kept = volumes >= (volumes.max() if single else MIN_VOLUME * cell**3)
    number = np.cumsum(kept[label]) - 1
    rows = kept[label[faces[:, 0]]]
    return points[kept[label]], np.ascontiguousarray(number[faces[rows]], np.int32)


def _distinct_pairs(pairs: Index) -> Index:
    """Return each pair of different rows once."""
    pairs = pairs[pairs[:, 0] != pairs[:, 1]].astype(np.int64)
    return np.unique(pairs, axis=0) if len(pairs) else pairs


def _solid_pieces(solids: Solids, grid: Grid, cells: Index, pieces: Index) -> Mask:
    """Return which pieces are solid, (p,); see `unite`."""
    count = solids.count
    covers = np.bincount(cells, minlength=grid.total)
    by_closed = np.bincount(cells[solids.closed[pieces]], minlength=grid.total) > 0
    own = np.bincount(pieces, minlength=count)
    areas = np.bincount(solids.piece, solids.areas, count)
    # The radius of a cylinder is twice its volume over its area.
    thick = 2.0 * own * grid.cell**3 >= 0.5 * grid.cell * areas
    holes = slice(solids.given, None)
    corners, of_piece = solids.points[solids.faces[holes]], solids.piece[holes]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(2.0 * solids.areas[holes], 1e-300)[:, None]
    beyond = grid.rows(corners.mean(axis=1) + grid.cell * normals)
    inside_own = np.isin(beyond * count + of_piece, cells * count + pieces)
    free = covers[beyond] - inside_own <= 0
    hole = np.bincount(of_piece[free], solids.areas[holes][free], count)
    whole = areas - np.bincount(of_piece, solids.areas[holes], count)
    filled = np.bincount(pieces[by_closed[cells]], minlength=count)
    fits = (hole <= OPEN * whole) & (filled < WORN * np.maximum(own, 1))
    return np.asarray((own > 0) & thick & (solids.closed | fits))
