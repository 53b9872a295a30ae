"""One closed surface around the pieces of a shape: characters are often modelled in many pieces.

Steps: pieces that enclose a volume (`_Solids`); the corners of a grid inside each of them, by
signed crossings of the lines of the grid (`_cells_inside`), so that a piece may cross itself and
others; bodies, which are pieces that overlap or touch (`_Volume`); bridges between bodies, where
one surface is needed (`_bridged`); surface nets of the signed distance (`generate.py`).

The cell of the grid follows from the thickness of the pieces (`_cell`), so that fingers remain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import (
    Described,
    Index,
    Mask,
    kd_tree,
    next_side,
    rows_of_labels,
    sums_of,
    twice_areas,
    unit_rows,
)
from medialis.base.box_tree import NearestTree
from medialis.base.kept import kept
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, Positions, frozen
from medialis.shape.generate import make_unambiguous, surface_nets
from medialis.shape.normals import ring_normals
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

LIMB = 0.04
"""Minimum size of a loose body that is bridged, as a fraction of the diagonal. Eyes and buttons of
a figure have 0.01 to 0.03, hands 0.05 to 0.07."""

BRIDGE = 0.8
"""Radius of a bridge, as a fraction of the smaller radius of the parts that it connects."""

MIN_VOLUME = 4.0
"""Minimum volume of a part of the united surface, in cells: thin pieces leave specks."""

LONG, ROUND = 1.5, 0.5
"""Minimum ratio of the first two standard deviations of the volume of a body that is long, and
the cosine with its axis that all connections of a round body are taken to have."""

ALIKE, HELD = 0.02, 3.0
"""Maximum logarithm of the ratio of the sizes of twins, and minimum ratio of length and width of a
piece that may be held."""

LINES_AT_ONCE = 4_000_000
"""Maximum number of pairs of a face and a line of the grid that are tested together."""

OFFSET = (0.3819660, 0.4142136, 0.2679492)
"""Position of the first corner of the grid in cells: corners are not on planes of models."""


@dataclass(frozen=True, eq=False, repr=False)
class United(Described):
    """A closed surface around the pieces of a shape with n points and p pieces.

    Attributes
    ----------
    shape : Shape
        The united surface, of m points; the given shape if it has one piece only.
    nearest : (n,) int32
        Point of the united surface nearest to each given point.
    piece : (n,) int32
        Piece of each given point: its connected component.
    body : (p,) int32
        Body of each piece; pieces that overlap or touch are one body. -1: not part of the united
        surface, because the piece encloses no volume, or is loose and small.
    bridges : (b, 2, 3) float64
        Ends of the bridges between bodies.
    contacts : (c, 2) int64
        Pairs of pieces that overlap or touch.
    """

    shape: Shape
    nearest: IntArray
    piece: IntArray
    body: IntArray
    bridges: Positions
    contacts: Index

    @property
    def piece_count(self) -> int:
        """Number of pieces p."""
        return len(self.body)

    @property
    def loose(self) -> Mask:
        """Pieces that are not part of the united surface, (p,)."""
        return self.body < 0


def united(shape: Shape, progress: Progress | None = None) -> Shape:
    """Return one closed surface around all pieces of a mesh that overlap or touch.

    Each body, which is a set of such pieces, has its own component. See `unite`.

    Examples
    --------
    >>> import numpy as np
    >>> import medialis
    >>> ball = medialis.organic_shape(56)
    >>> points = np.concatenate([ball.points, ball.points + [0.3, 0, 0]])
    >>> faces = np.concatenate([ball.faces, ball.faces + ball.point_count])
    >>> united(medialis.make_shape(points, faces)).part_count
    1
    """
    return unite(shape, progress).shape


def unite(
    shape: Shape,
    progress: Progress | None = None,
    *,
    joined: bool = False,
    without: int = -1,
) -> United:
    """Unite the pieces of a mesh that overlap or touch.

    Parameters
    ----------
    shape : Shape
        With faces. A piece is solid if it is closed, or if its holes are small or covered by other
        pieces. Other pieces, such as clothes and hair strips, are left out.
    progress : Progress, optional
    joined : bool
        Whether the result is one surface: bodies that are apart are connected by bridges along the
        shortest connections, and small loose bodies (`LIMB`) are left out.
    without : int
        A piece that is left out; -1: none.

    Returns
    -------
    United
        With the given shape where it has one piece, or none that encloses a volume.

    Notes
    -----
    Cost: about a second for a grid of `MAX_CORNERS` corners, whatever the number of pieces.
    Source: none; signed crossings are the winding number along a line, and the surface is that of
    naive surface nets (Gibson 1998).

    Examples
    --------
    >>> import numpy as np
    >>> import medialis
    >>> ball = medialis.organic_shape(56)
    >>> size = float(ball.bounds[1][0] - ball.bounds[0][0])
    >>> points = np.concatenate([ball.points, ball.points + [1.1 * size, 0, 0]])
    >>> faces = np.concatenate([ball.faces, ball.faces + ball.point_count])
    >>> apart = medialis.make_shape(points, faces)
    >>> unite(apart).shape.part_count, unite(apart, joined=True).shape.part_count
    (2, 1)
    """
    still = Progress() if progress is None else progress

    def work() -> United:
        return run_patiently(lambda: _united(shape, joined, without), still)

    return kept(unite, shape, (joined, without), work, still)


def held_pieces(union: United, shape: Shape) -> list[int]:
    """Return the united pieces of a character that may be held or worn, the smallest ones first.

    Such a piece is long, touches at most one other piece, and has no twin of the same size: limbs
    have one on the other side.
    """
    assert shape.faces is not None
    areas = np.bincount(union.piece[shape.faces[:, 0]], shape.face_areas, union.piece_count)
    touches = np.bincount(union.contacts.ravel(), minlength=union.piece_count)
    sizes = np.zeros((union.piece_count, 4))
    for piece, rows in enumerate(rows_of_labels(union.piece)):
        off = shape.points[rows] - shape.points[rows].mean(axis=0)
        spread = np.sqrt(np.linalg.eigvalsh(off.T @ off / len(rows)).clip(min=0.0))
        sizes[piece] = [*spread, np.sqrt(areas[piece])]
    logs = np.log(np.maximum(sizes, 1e-9 * shape.diagonal))
    found = []
    for piece in np.flatnonzero(~union.loose & (touches <= 1) & (areas > 0)).tolist():
        alike = (np.abs(logs - logs[piece]) < ALIKE).all(axis=1)
        if alike.sum() == 1 and sizes[piece, 2] >= HELD * sizes[piece, 1]:
            found.append(piece)
    return sorted(found, key=lambda piece: float(areas[piece]))


@dataclass(frozen=True, eq=False, repr=False)
class Enclosing(Described):
    """Pieces of a shape that enclose positions.

    Attributes
    ----------
    rows, pieces : (k,) int64
        A position, and a piece that encloses the position; a position may have several ones.
    solid : (p,) bool
        Pieces that enclose a volume.
    """

    rows: Index
    pieces: Index
    solid: Mask


def enclosing_pieces(shape: Shape, places: FloatArray) -> Enclosing:
    """Return the pieces of a mesh that enclose positions (q, 3), up to a cell of the grid.

    Pieces are the components of ``shape.components``. See `unite`.

    Examples
    --------
    >>> import medialis
    >>> corners, faces = np.eye(4)[:, :3], [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
    >>> tetrahedron = medialis.make_shape(corners, faces)
    >>> found = enclosing_pieces(tetrahedron, np.array([[0.2, 0.2, 0.2], [100, 0, 0]]))
    >>> found.rows.tolist(), found.pieces.tolist(), found.solid.tolist()
    ([0], [0], [True])
    """
    assert shape.faces is not None
    solids = _Solids.of(shape)
    grid = _Grid.around(shape, solids)
    volume = _Volume.of(solids, grid)
    solid = np.zeros(solids.count, np.bool_)
    solid[volume.pieces] = True
    low, high = shape.bounds
    within = np.flatnonzero(((places >= low) & (places <= high)).all(axis=1))
    cells = grid.rows(places[within])
    near = np.isin(volume.cells, cells)
    order = np.argsort(volume.cells[near], kind="stable")
    known, pieces = volume.cells[near][order], volume.pieces[near][order]
    first, last = (np.searchsorted(known, cells, side) for side in ("left", "right"))
    counts = last - first
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return Enclosing(np.repeat(within, counts), pieces[np.repeat(first, counts) + step], solid)


def _united(shape: Shape, joined: bool, without: int = -1) -> United:
    solids = None if shape.faces is None else _Solids.of(shape)
    if solids is None or np.count_nonzero(solids.outward) < 2:
        return _unchanged(shape)
    grid = _Grid.around(shape, solids)
    volume = _Volume.of(solids, grid)
    if without >= 0:
        kept = volume.pieces != without
        volume = replace(volume, cells=volume.cells[kept], pieces=volume.pieces[kept])
    body, contacts = volume.bodies()
    if (body < 0).all():
        return _unchanged(shape)
    bridges = np.zeros((0, 2, 4))
    if joined:
        body, bridges = _joined(volume, body)
    points, faces = volume.surface(body, bridges, joined)
    if len(faces) == 0:
        return _unchanged(shape)
    made = Shape(points, ring_normals(points, faces), faces, unit=shape.unit, up=shape.up)
    nearest = kd_tree(points).query(shape.points)[1]
    return United(
        made,
        frozen(nearest, np.int32),
        shape.components,
        frozen(body, np.int32),
        frozen(bridges[:, :, :3], np.float64),
        contacts,
    )


def _unchanged(shape: Shape) -> United:
    piece = shape.components
    body = frozen(np.zeros(int(piece.max(initial=-1)) + 1), np.int32)
    rows = frozen(np.arange(shape.point_count), np.int32)
    none = np.zeros((0, 2), np.int64)
    return United(shape, rows, piece, body, frozen(np.zeros((0, 2, 3)), np.float64), none)


@dataclass(frozen=True, eq=False)
class _Solids:
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
    def of(cls, shape: Shape) -> _Solids:
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
class _Grid:
    """Corners at `low + cell * (i, j, k)` with i, j, k less than `size`."""

    low: FloatArray
    cell: float
    size: Index

    @classmethod
    def around(cls, shape: Shape, solids: _Solids) -> _Grid:
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


def _crossings(solids: _Solids, grid: _Grid) -> tuple[Index, Index, FloatArray, Index]:
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


def _cells_inside(solids: _Solids, grid: _Grid) -> tuple[Index, Index]:
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
class _Volume:
    """Corners of a grid inside the solid pieces.

    Attributes
    ----------
    solids : _Solids
    grid : _Grid
    cells, pieces : (c,) int64
        Corners inside pieces, and the piece; a corner may be inside several ones.
    """

    solids: _Solids
    grid: _Grid
    cells: Index
    pieces: Index

    @classmethod
    def of(cls, solids: _Solids, grid: _Grid) -> _Volume:
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


def _solid_pieces(solids: _Solids, grid: _Grid, cells: Index, pieces: Index) -> Mask:
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


def _joined(volume: _Volume, body: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the bodies without small loose ones, and the bridges (b, 2, 4) between the others.

    Bridges have the ends of shortest connections, moved to the middle of the parts there, and a
    radius.
    """
    from scipy.ndimage import distance_transform_edt

    grid, solids = volume.grid, volume.solids
    sizes = np.bincount(body[volume.pieces], minlength=int(body.max()) + 1)
    of_point = np.full(len(solids.points), -1, np.int64)
    of_point[solids.faces] = body[solids.piece][:, None]
    spans = np.array([
        np.linalg.norm(np.ptp(solids.points[of_point == k], axis=0)) for k in range(len(sizes))
    ])  # fmt: skip
    whole = float(np.linalg.norm(np.ptp(solids.points, axis=0)))
    chosen = spans >= LIMB * whole
    chosen[sizes.argmax()] = True
    body = np.where((body >= 0) & chosen[body], body, -1).astype(np.int32)
    if np.count_nonzero(chosen) < 2:
        return body, np.zeros((0, 2, 4))
    owner = volume.owners(body >= 0)
    label = np.where(owner >= 0, body[owner], -1).reshape(tuple(grid.size))
    depth = distance_transform_edt(label >= 0)
    bridges = []
    for ends in _shortest_links(label, _long_axes(volume, body, len(sizes))):
        tops = [_middle(depth, end) for end in ends]
        radius = max(BRIDGE * min(float(depth[tuple(top)]) for top in tops), 1.0)
        places = np.array([grid.low + grid.cell * np.array(top) for top in tops])
        bridges.append(np.column_stack([places, np.full(2, radius * grid.cell)]))
    return body, np.array(bridges).reshape(-1, 2, 4)


def _long_axes(volume: _Volume, body: IntArray, count: int) -> FloatArray:
    """Return the directions in which bodies are long, (count, 3): unit, 0 for round ones."""
    rows = body[volume.pieces]
    cells, rows = volume.cells[rows >= 0], rows[rows >= 0]
    places = np.stack(np.unravel_index(cells, tuple(volume.grid.size)), axis=1).astype(float)
    sizes = np.maximum(np.bincount(rows, minlength=count), 1)
    off = places - (sums_of(rows, places, count) / sizes[:, None])[rows]
    square = sums_of(rows, (off[:, :, None] * off[:, None]).reshape(-1, 9), count)
    spread, axes = np.linalg.eigh(square.reshape(-1, 3, 3) / sizes[:, None, None])
    long = spread[:, 2] >= LONG**2 * spread[:, 1]
    return np.asarray(axes[:, :, 2] * long[:, None])


def _shortest_links(label: NDArray[np.integer], axes: FloatArray) -> list[tuple[Index, Index]]:
    """Return the corners at the ends of the shortest connections between all bodies of a grid.

    A minimum spanning tree over the bodies that meet halfway, on a grid of twice the cell. A
    connection costs its length, and up to twice that where it leaves both bodies across their long
    axes: limbs continue at their ends.
    """
    from scipy.ndimage import distance_transform_edt
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    pad = [(0, int(n % 2)) for n in label.shape]
    even = np.pad(label, pad, constant_values=-1)
    shape = tuple(n // 2 for n in even.shape)
    coarse = even.reshape(shape[0], 2, shape[1], 2, shape[2], 2).max(axis=(1, 3, 5))
    away, near = distance_transform_edt(coarse < 0, return_indices=True)
    found = coarse[tuple(near)]
    rows = np.ravel_multi_index(tuple(near), shape)
    links: list[NDArray[Any]] = []
    for axis in range(3):
        one, other, source, target, far, beyond = (
            np.moveaxis(grid, axis, 0)[part]
            for grid in (found, rows, away)
            for part in (slice(None, -1), slice(1, None))
        )
        at = one != other
        links.append(np.stack([one[at], other[at], source[at], target[at],
                               far[at] + beyond[at] + 1.0], axis=1))  # fmt: skip
    table = np.concatenate(links)
    swap = table[:, 0] > table[:, 1]
    table[swap] = table[swap][:, [1, 0, 3, 2, 4]]
    table = table[np.lexsort((table[:, 3], table[:, 2], table[:, 4], table[:, 1], table[:, 0]))]
    first = np.append(True, (table[1:, :2] != table[:-1, :2]).any(axis=1))
    table = table[first]
    count = int(label.max()) + 1
    ends = table[:, :2].astype(np.int64)
    one, other = (np.stack(np.unravel_index(table[:, k].astype(np.int64), shape), axis=1)
                  for k in (2, 3))  # fmt: skip
    way = unit_rows((other - one).astype(np.float64))
    along = np.full(len(table), -np.inf)
    for side in (0, 1):
        axis = axes[ends[:, side]]
        cosine = np.where(axis.any(axis=1), np.abs((way * axis).sum(axis=1)), ROUND)
        along = np.maximum(along, cosine)
    table[:, 4] *= 2.0 - along
    tree = minimum_spanning_tree(coo_array((table[:, 4], ends.T), shape=(count, count))).tocoo()
    kept = np.isin(ends @ [count, 1], np.stack([tree.row, tree.col], axis=1) @ [count, 1])
    result = []
    for a, b, start, end, _ in table[kept].tolist():
        pair = []
        for number, row in ((a, start), (b, end)):
            corner = 2 * np.array(np.unravel_index(int(row), shape))
            block = corner + np.indices((2, 2, 2)).reshape(3, 8).T
            pair.append(block[int((even[tuple(block.T)] == number).argmax())])
        result.append((pair[0], pair[1]))
    return result


def _middle(depth: FloatArray, corner: Index) -> Index:
    """Climb from a corner of a grid to the nearest local maximum of the depth."""
    steps = np.indices((3, 3, 3)).reshape(3, 27).T - 1
    while True:
        around = np.clip(corner + steps, 0, np.array(depth.shape) - 1)
        best = int(depth[tuple(around.T)].argmax())
        if depth[tuple(around[best])] <= depth[tuple(corner)]:
            return corner
        corner = around[best]
