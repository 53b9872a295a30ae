"""The envelope of a medial mesh: the union of its balls, cones and slabs.

1. `primitives_of`: what triangles, edges and lone balls a complex has.
2. `Envelope.distances`: signed distances to it in closed form, by a tree of boxes.
3. `envelope_surface`: the envelope as a closed triangle mesh. A grid of cells, each cut into six
   tetrahedra, meets the signed distance; the surface where it changes sign is a closed manifold by
   construction (marching tetrahedra).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index
from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, length
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.medial_meshes.mesh import Complex, MedialMesh
from medialis.shape.surface import Surface

if TYPE_CHECKING:
    from medialis.medial_meshes._envelope_kernels import Primitives, Tree


LEAF = 4  # halved < 0.1 %, doubled < 0.1 %
"""Items of a leaf of a tree of boxes, at most."""

PLACES_A_CHUNK = 1024

BLOCK = 8  # halved 0 %, doubled 0 %
"""Cells of a block: far from the envelope whole blocks are left out."""

THREAD = 0.867  # halved 0 %, doubled 0.1 %
"""Cells: places this near to a line are corners of cells that hang together, however it lies."""

MOVED, FAR = (0.25, -0.25, 0.5, -0.5), (0.75, -0.75)
"""Cells that a surface moves, one after the other, which closes slits or opens what touches.

Between balls it gets in up to twice as deep: far in halved cells, and in others if all else fails.
"""

VARIANTS = 2 * (2 + len(MOVED)) + 2 * len(FAR)
"""Of a surface, at most."""

MOST_CELLS = 1_000_000  # halved 0 %, doubled 0 %
"""Cells that the surface goes through, about, at most."""

COARSEST = 1 / 32  # halved 0 %, doubled 0 %
"""Diagonals: the cells that a count begins with."""

CUBE = np.array(list(itertools.product((0, 1), repeat=3)))
"""Corners of a cell, (8, 3); corner 4 x + 2 y + z."""


def box_tree(corners: FloatArray, radii: FloatArray | None = None, axes: int = 3) -> Tree:
    """Return a tree over items with these corners (n, k, 3), each with its largest radius.

    Boxes are halved along the first `axes` only: of two, for lines along the third.
    """
    from medialis.medial_meshes._envelope_kernels import split_items

    n = len(corners)
    depth = 0
    while (n - 1) >> depth >= LEAF:
        depth += 1
    order, middles = np.arange(n), 0.5 * (corners.min(axis=1) + corners.max(axis=1))
    middles[:, axes:] = 0.0
    split_items(middles, depth, order, np.empty(n))
    return _bounded(order, depth, corners, np.zeros(n) if radii is None else radii)


def _bounded(order: Index, depth: int, corners: FloatArray, radii: FloatArray) -> Tree:
    """Return a tree of this order; less good when the items have moved far since it was made."""
    from medialis.medial_meshes._envelope_kernels import Tree, bound_nodes

    order, bounds = frozen(order, np.int64), np.empty((2 << depth, 7))
    bound_nodes(frozen(corners, np.float64), radii, order, depth, bounds)
    return Tree(order, frozen(bounds, np.float64), depth)


def primitives_of(given: Complex) -> Index:
    """Return triangles, edges of no triangle and lone balls, (s, 3), -1 where there are fewer."""
    n, faces, edges = len(given), given.faces, given.edges
    sides = np.sort(faces, axis=1)[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2)
    low_first = np.sort(edges, axis=1)
    bare = edges[~np.isin(low_first @ [n, 1], sides @ [n, 1])]
    used = np.zeros(n, bool)
    used[edges] = True
    alone = np.flatnonzero(~used)
    rows = np.full((len(faces) + len(bare) + len(alone), 3), -1)
    rows[: len(faces)] = faces
    rows[len(faces) : len(faces) + len(bare), :2] = bare
    rows[len(faces) + len(bare) :, 0] = alone
    return rows


@dataclass(frozen=True, eq=False)
class Envelope:
    """Balls, cones and slabs.

    Attributes
    ----------
    balls : (n, 4) float64
    rows : (s, 3) int64
        See `primitives_of`.
    before : Tree or None
        The tree of an envelope of the same rows whose balls were near these.
    """

    balls: FloatArray
    rows: Index
    before: Tree | None = None

    @classmethod
    def of(cls, given: Complex) -> Envelope:
        """Take the balls, cones and slabs of a complex."""
        return cls(given.balls, primitives_of(given))

    @cached_property
    def tree(self) -> Tree:
        """The tree of the primitives."""
        own = self.balls[np.where(self.rows < 0, self.rows[:, :1], self.rows)]
        items = own[:, :, :3], own[:, :, 3].max(axis=1)
        before = self.before
        return _bounded(before.order, before.depth, *items) if before else box_tree(*items)

    @cached_property
    def primitives(self) -> Primitives:
        """What distances to the primitives need of them."""
        from medialis.medial_meshes._envelope_kernels import WIDTH, Primitives, prepare

        table = np.empty((len(self.rows), WIDTH))
        prepare(frozen(self.balls, np.float64), self.rows, table)
        return Primitives(self.rows, table, self.tree)

    def distances(
        self, places: FloatArray, enough: float = -np.inf
    ) -> tuple[FloatArray, Index, FloatArray]:
        """Return signed distances of places (q, 3), the primitives that decide them, and shares.

        Exact outside; inside minus the depth in the deepest primitive. Where `enough` is given, the
        first primitive nearer than that ends the search, and without any the distance is `enough`.
        Shares (q, 3) are those of the balls.
        """
        from medialis.medial_meshes._envelope_kernels import Nearest, nearest_primitive

        count = len(places)
        found = Nearest(np.empty(count), np.empty(count, np.int64), np.empty((count, 3)))
        given = frozen(places, np.float64), self.primitives, enough, found
        run_chunks(nearest_primitive, count, PLACES_A_CHUNK, *given)
        return found


def _tetrahedra() -> Index:
    """Six tetrahedra from corner 0 to corner 7 of a cell, all positive, (6, 4)."""
    rows = []
    for order in itertools.permutations(range(3)):
        corners = [0]
        for axis in order:
            corners.append(corners[-1] + (4 >> axis))
        a, b, c, d = (CUBE[i] for i in corners)
        if np.linalg.det(np.stack([b - a, c - a, d - a])) < 0:
            corners[1], corners[2] = corners[2], corners[1]
        rows.append(corners)
    return np.array(rows)


def _cuts() -> tuple[Index, Index]:
    """Count triangles for each mask of inside corners; each corner lies on an edge (in, out)."""
    counts, cuts = np.zeros(16, np.int64), np.zeros((16, 2, 3, 2), np.int64)
    place = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    for mask in range(16):
        inside = [i for i in range(4) if mask >> i & 1]
        outside = [i for i in range(4) if not mask >> i & 1]
        if len(inside) == 2:
            (i, j), (k, m) = inside, outside
            found = [((i, k), (i, m), (j, m)), ((i, k), (j, m), (j, k))]
        else:
            edges = tuple((i, k) for i in inside for k in outside)
            found = [edges] if len(edges) == 3 else []
        counts[mask] = len(found)
        for k, triangle in enumerate(found):
            cuts[mask, k] = _outward(triangle, inside, outside, place)
    return counts, cuts


def _outward(
    triangle: tuple[tuple[int, int], ...], inside: list[int], outside: list[int], place: FloatArray
) -> tuple[tuple[int, int], ...]:
    """Turn a triangle so that its normal points from the inside corners to the outside ones."""
    a, b, c = (0.5 * (place[i] + place[k]) for i, k in triangle)
    way = place[outside].mean(axis=0) - place[inside].mean(axis=0)
    return triangle if np.cross(b - a, c - a) @ way > 0 else triangle[::-1]


TETRAHEDRA, CUTS = _tetrahedra(), _cuts()

MASKS: NDArray[np.uint8] = (
    (np.arange(256)[:, None, None] >> 7 - TETRAHEDRA & 1) @ [1, 2, 4, 8]
).astype(np.uint8)
"""Masks (256, 6) of the tetrahedra of a cell, by the signs of its corners, first one highest."""

WAYS = 15
"""Ways from a corner along the edges of tetrahedra, and the corner itself: numbers of corners of a
cell differ by -7 to 7, in the order of the corners of the grid."""


@dataclass(frozen=True, kw_only=True)
class EnvelopeSurfaceOptions(Options):
    """Options of `envelope_surface`."""

    cell: float = length(
        0.01,
        "Cell",
        "Width of the cells that the surface of the envelope is made of; halved where its topology "
        "needs that.",
        low=0.0005,
        high=0.2,
    )


@algorithm(EnvelopeSurfaceOptions)
def envelope_surface(
    mesh: MedialMesh, options: EnvelopeSurfaceOptions, progress: Progress
) -> Surface:
    """Return the envelope of a medial mesh as a closed, outward triangle mesh.

    Parameters
    ----------
    mesh : MedialMesh
        Lengths are fractions of the diagonal of its envelope's bounding box.

    Returns
    -------
    Surface
        Every edge has two faces. A message says where its parts, handles and cavities are not
        those of the mesh: the union of balls may close a loop or leave a hollow.

    Raises
    ------
    InvalidShapeError
        When all balls have radius 0.

    See Also
    --------
    medial_mesh : makes such meshes.
    envelope_distance : how far they are from a surface.

    Notes
    -----
    Vertices lie on the envelope up to a part of the square of the cells. Where its topology is not
    that of the mesh, radii of less than 0.87 cells are that large, else the surface moves by up to
    half a cell, else the cells are halved. Cost: O(a log n) for an area of a cells.

    Examples
    --------
    >>> import medialis
    >>> ball = medialis.MedialMesh([[0, 0, 0]], [1.0], [], [])
    >>> surface = medialis.envelope_surface(ball, cell=0.05)
    >>> surface.border_edges, bool(abs(surface.area - 12.57) < 0.2)
    (0, True)
    """
    if not (mesh.radii > 0).any():
        raise InvalidShapeError("All balls of the medial mesh have radius 0: it has no envelope.")
    envelope = Envelope.of(mesh.complex)
    low = (mesh.centers - mesh.radii[:, None]).min(axis=0)
    high = (mesh.centers + mesh.radii[:, None]).max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    cell, finest, crossed = _cells(envelope, low, high, options.cell * diagonal)
    if cell > options.cell * diagonal:
        text = (
            f"Cells of {options.cell:g} diagonals would be more than {MOST_CELLS:,}: they are "
            f"{cell / diagonal:.2g} diagonals wide instead."
        )
        progress.note(text, "cell_enlarged", wanted=options.cell, cell=cell / diagonal)
    parts, handles = mesh.betti[0] + mesh.betti[2], mesh.betti[1]
    best, off = None, math.inf
    for k, found in enumerate(_variants(envelope, low, high, cell, finest, crossed)):
        progress.update(k / VARIANTS)
        if found.least_off(parts, handles) < off and found.off(parts, handles) < off:
            best, off = found, found.off(parts, handles)
        if off == 0:
            break
    assert best is not None
    if off:
        progress.warn(
            f"The envelope has {best.parts} pieces and {best.handles} handles, the medial mesh "
            f"{parts} and {handles}: balls that no edge joins touch.",
            "envelope_topology",
            pieces=best.parts,
            handles=best.handles,
        )
    return best.surface


def _variants(
    envelope: Envelope,
    low: FloatArray,
    high: FloatArray,
    cell: float,
    finest: float,
    crossed: Index,
) -> Iterator[_Cut]:
    """Yield the surface of an envelope, then with its threads thickened, then moved out and in.

    Then the same with cells of half the width, unless that is less than `finest`.
    """
    box = low, high

    def thickened(width: float) -> _Cut:
        balls = envelope.balls.copy()
        balls[:, 3] = np.maximum(balls[:, 3], THREAD * width)
        return _Field.of(Envelope(balls, envelope.rows), *box, width).cut(0.0)

    yield _Field.within(envelope, *_grid_of(*box, cell), crossed).cut(0.0)
    yield thickened(cell)
    yield from _Field.of(envelope, *box, cell, max(MOVED)).moved(MOVED, cell)
    if (width := 0.5 * cell) >= finest:
        field = _Field.of(envelope, *box, width, max(FAR))
        yield field.cut(0.0)
        yield thickened(width)
        yield from field.moved(MOVED + FAR, width)
    yield from _Field.of(envelope, *box, cell, max(FAR)).moved(FAR, cell)


def _cells(
    envelope: Envelope, low: FloatArray, high: FloatArray, wanted: float
) -> tuple[float, float, Index]:
    """Return the width of cells, the least there may be, and those that the surface goes through.

    The width is the wanted one if there are not too many. They are counted, wider at first: halved,
    they are four times as many.
    """
    cell = max(wanted, COARSEST * float(np.linalg.norm(high - low)))
    while True:
        found = _crossed(envelope, *_grid_of(low, high, cell))
        finest = cell * math.sqrt(len(found) / MOST_CELLS)
        if cell <= wanted or finest >= 0.5 * cell:
            break
        cell = max(wanted, 0.5 * cell)
    width = max(wanted, finest)
    if width != cell:
        found = _crossed(envelope, *_grid_of(low, high, width))
    return width, finest, found


def _grid_of(low: FloatArray, high: FloatArray, cell: float) -> tuple[FloatArray, float, Index]:
    """Return first corner, width and number of the cells of a grid round a box."""
    # Off the balls by an irrational part of a cell: no corner lies on an axis of the shape.
    origin = low - cell * np.array([2.618, 2.414, 2.732])
    return origin, cell, np.ceil((high - origin) / cell).astype(np.int64) + 3


@dataclass(frozen=True, eq=False)
class _Field:
    """Signed distances at the corners of the cells near an envelope.

    Attributes
    ----------
    grid : (g, 3) float64
    values : (g,) float64
    cells : (c, 8) int64
        Rows of the grid.
    """

    grid: FloatArray
    values: FloatArray
    cells: Index

    @classmethod
    def of(
        cls, envelope: Envelope, low: FloatArray, high: FloatArray, cell: float, moved: float = 0.0
    ) -> _Field:
        """Measure the distances where the envelope, moved by so many cells, may cross cells."""
        grid = _grid_of(low, high, cell)
        return cls.within(envelope, *grid, _crossed(envelope, *grid, moved))

    @classmethod
    def within(
        cls, envelope: Envelope, origin: FloatArray, cell: float, count: Index, cells: Index
    ) -> _Field:
        """Measure the distances at the corners of some cells (c, 3) of a grid."""
        sizes = -(-count // BLOCK) * BLOCK + 1
        steps = np.array([sizes[1] * sizes[2], sizes[2], 1])
        unique, where = _numbered(((cells @ steps)[:, None] + CUBE @ steps).ravel())
        x, rest = np.divmod(unique, steps[0])
        y, z = np.divmod(rest, steps[1])
        grid = origin + cell * np.stack([x, y, z], axis=1)
        return cls(grid, envelope.distances(grid)[0], where.reshape(-1, 8))

    def cut(self, level: float) -> _Cut:
        """March through the cells that this distance to the envelope crosses.

        It is that of the envelope whose radii are all larger by so much.
        """
        return _Cut.of(self.grid, self.values - level, self.cells)

    def moved(self, moves: tuple[float, ...], cell: float) -> Iterator[_Cut]:
        """Yield surfaces that are moved by cells of this width."""
        return (self.cut(move * cell) for move in moves)


@dataclass(frozen=True, eq=False)
class _Cut:
    """The surface where values at the corners of cells change sign: it is made when it is wanted.

    A vertex is named by its inside corner and the way to the outside one, of which there are
    `WAYS`: a table of all corners numbers them in order, without sorting.

    Attributes
    ----------
    grid, values : (g, 3), (g,) float64
    across : (WAYS * g,) int32
        The outside corner of each vertex, -1 where there is none.
    keys : (m, 3) int32
        The vertices of triangles, by their names.
    count : int
        How many vertices there are.
    """

    grid: FloatArray
    values: FloatArray
    across: IntArray
    keys: IntArray
    count: int

    @classmethod
    def of(cls, grid: FloatArray, values: FloatArray, cells: Index) -> _Cut:
        """Go through the cells (c, 8)."""
        from medialis.medial_meshes._sampling_kernels import Cuts, count_masks, cut_cells

        cuts, found = Cuts(MASKS, TETRAHEDRA, *CUTS), np.zeros(len(CUTS[0]), np.int64)
        count_masks(values, cells, cuts, found)
        counts = found[:, None] * (np.arange(2) < cuts.counts[:, None])
        starts = (np.cumsum(counts) - counts.ravel()).reshape(counts.shape)
        across = np.full(WAYS * len(values), -1, np.int32)
        keys = np.empty((counts.sum(), 3), np.int32)
        return cls(grid, values, across, keys, cut_cells(values, cells, cuts, starts, across, keys))

    def least_off(self, parts: int, handles: int) -> int:
        """How far the topology is from that of so many parts and handles, at least."""
        return abs((self.count - len(self.keys) // 2) // 2 - (parts - handles))

    def off(self, parts: int, handles: int) -> int:
        """How far it is."""
        return abs(self.parts - parts) + abs(self.handles - handles)

    @property
    def handles(self) -> int:
        """Handles, over all pieces: every edge has two faces."""
        return self.parts - (self.count - len(self.keys) // 2) // 2

    @cached_property
    def parts(self) -> int:
        """Pieces of the surface."""
        from medialis.shape._kernels import label_components

        label = np.empty(self.count, np.int32)
        label_components(self._faces, np.arange(self.count, dtype=np.int32), label)
        return int(label.max(initial=-1)) + 1

    @cached_property
    def _vertices(self) -> Index:
        return np.flatnonzero(self.across >= 0)

    @cached_property
    def _faces(self) -> IntArray:
        number = np.empty(len(self.across), np.int32)
        number[self._vertices] = np.arange(self.count)
        return number[self.keys]

    @property
    def surface(self) -> Surface:
        """The surface."""
        a, b = self._vertices // WAYS, self.across[self._vertices]
        share = self.values[a] / (self.values[a] - self.values[b])
        points = self.grid[a] + share[:, None] * (self.grid[b] - self.grid[a])
        return Surface.of_checked(points, self._faces)


def _crossed(
    envelope: Envelope, origin: FloatArray, cell: float, count: Index, moved: float = 0.0
) -> Index:
    """Return the cells (c, 3) that the envelope may cross.

    The distance changes no faster than its place does, so it is 0 in a block only if it is at most
    half the diagonal in the middle, and a surface that moves is as much farther. Blocks are halved
    down to cells.
    """
    width = BLOCK
    blocks = np.stack(
        np.meshgrid(*(np.arange(-(-n // width)) for n in count), indexing="ij"), axis=-1
    ).reshape(-1, 3)
    while True:
        middles = origin + cell * width * (blocks + 0.5)
        near = np.abs(envelope.distances(middles)[0]) <= (0.8661 * width + moved) * cell
        blocks = blocks[near]
        if width == 1:
            return blocks
        blocks = (2 * blocks[:, None] + CUBE).reshape(-1, 3)
        width //= 2


def _numbered(keys: Index) -> tuple[Index, Index]:
    """Return what `np.unique` does with its inverse, sorting only keys that differ."""
    from medialis.medial_meshes._sampling_kernels import number_keys

    first, number = np.empty(len(keys), np.int64), np.empty(len(keys), np.int64)
    table = np.full(1 << len(keys).bit_length(), -1, np.int32)
    unique = keys[first[: number_keys(keys, table, first, number)]]
    order = np.argsort(unique)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return unique[order], place[number]
