"""One closed surface around the pieces of a shape: characters are often modelled in many pieces.

Steps: the corners of a grid inside each piece (`piece_volumes.py`): a piece may cross itself
and others; bodies, which are pieces that overlap or touch; bridges between bodies, where one
surface is needed (`_joined`); the surface around all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import (
    Described,
    Index,
    Mask,
    kd_tree,
    rows_of_labels,
    sums_of,
    unit_rows,
    weighted_graph,
)
from medialis.base.kept import kept
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, Positions, frozen
from medialis.shape.normals import ring_normals
from medialis.shape.piece_volumes import Grid, Solids, Volume
from medialis.shape.shape import Shape

LIMB = 0.04
"""Minimum size of a loose body that is bridged, as a fraction of the diagonal. Eyes and buttons of
a figure have 0.01 to 0.03, hands 0.05 to 0.07."""

BRIDGE = 0.8
"""Radius of a bridge, as a fraction of the smaller radius of the parts that it connects."""

LONG, ROUND = 1.5, 0.5
"""Minimum ratio of the first two standard deviations of the volume of a body that is long, and
the cosine with its axis that all connections of a round body are taken to have."""

ALIKE, HELD = 0.02, 3.0
"""Maximum logarithm of the ratio of the sizes of twins, and minimum ratio of length and width of a
piece that may be held."""


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
    Cost: about a second for a grid of 4 million corners, whatever the number of pieces.
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
    solids = Solids.of(shape)
    grid = Grid.around(shape, solids)
    volume = Volume.of(solids, grid)
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
    solids = None if shape.faces is None else Solids.of(shape)
    if solids is None or np.count_nonzero(solids.outward) < 2:
        return _unchanged(shape)
    grid = Grid.around(shape, solids)
    volume = Volume.of(solids, grid)
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


def _joined(volume: Volume, body: IntArray) -> tuple[IntArray, FloatArray]:
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


def _long_axes(volume: Volume, body: IntArray, count: int) -> FloatArray:
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
    tree = minimum_spanning_tree(weighted_graph(table[:, 4], ends[:, 0], ends[:, 1], count)).tocoo()
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
