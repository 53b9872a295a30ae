"""A bounding tree over samples, and what is found by it: nearest balls, triangles and neighbours.

Ball shrinking walks the tree (thesis 3.2); `NearestTree` finds the nearest of many balls or
triangles exactly, `nearest_others` the nearest points of a set to each of its points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import extent
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray

if TYPE_CHECKING:
    from medialis.base._box_tree_kernels import BoxTree, Items, Leaves

SERIAL_LEVELS = 3  # the top levels are split one by one; below, 8 subtrees go to the threads
NODES_A_CHUNK = 64
LEAVES_A_CHUNK = 1024
ROWS_A_BLOCK = 1 << 20  # what is copied at a time, so that mapped input needs no second copy

Allocate = Callable[[str, tuple[int, ...], Any], NDArray[Any]]


def build_box_tree(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    *,
    unit: float = 1.0,
    allocate: Allocate = lambda name, shape, dtype: np.empty(shape, dtype),
) -> BoxTree:
    """Build the tree; deterministic, O(n log n), parallel below the top levels.

    Parameters
    ----------
    points, normals : (n, 3) float64
    unit : float
        A power of two that coordinates are divided by, which changes no digit.
    allocate : callable
        Gives an array for (name, shape, dtype): in memory, or mapped from a file.
    """
    from medialis.base import _box_tree_kernels as kernels

    n = len(points)
    low, high = extent(points)
    center = 0.5 * (low / unit + high / unit)
    rows = allocate("rows", (n, 4), np.float64)
    for begin in range(0, n, ROWS_A_BLOCK):
        here = slice(begin, begin + ROWS_A_BLOCK)
        for axis in range(3):
            np.subtract(points[here, axis] / unit, center[axis], out=rows[here, axis])
        rows[here, 3] = np.arange(begin, begin + len(rows[here]))
    depth = max(0, int(np.ceil(np.log2(n / kernels.LEAF)))) if n > kernels.LEAF else 0
    while -(-n // (1 << depth)) > kernels.LEAF:
        depth += 1

    top = min(SERIAL_LEVELS, depth)
    for level in range(top):
        run_chunks(partial(kernels.split_nodes, rows, level, level + 1), 1 << level, 1)
    run_chunks(partial(kernels.split_nodes, rows, top, depth), 1 << top, 1)

    levels, leaves = wide_levels(depth), 1 << depth
    nodes = levels[-1][0].stop
    samples = (
        allocate("points", (n, 3), np.float64),
        allocate("normals", (n, 3), np.float64),
        allocate("order", (n,), np.int32),
        allocate("blocks", (leaves, 3, kernels.LEAF), np.float64),
    )
    run_chunks(partial(kernels.fill_leaves, rows, normals, depth), leaves, LEAVES_A_CHUNK, samples)
    bounds = allocate("bounds", (nodes, kernels.BOUND_ROWS, kernels.FAN), np.float32)
    tree = kernels.BoxTree(center, *samples, bounds, allocate("child", (nodes,), np.int64), depth)
    for here, _, fan in levels:
        children = fan * np.arange(here.stop - here.start)
        tree.child[here] = ~children if here.stop == nodes else here.stop + children
    first = (n * np.arange(leaves + 1)) >> depth
    fill_bounds(tree.bounds, depth, kernels.Leaves(tree.points, first, tree.normals, first))
    return tree


def fill_bounds(bounds: NDArray[Any], depth: int, leaves: Leaves) -> None:
    """Fill the bounds of a tree of some binary levels with those of what lies in its leaves."""
    from medialis.base._box_tree_kernels import bound_nodes

    bounds[:, :3], bounds[:, 3:6], bounds[:, 6:9], bounds[:, 9:] = np.inf, -np.inf, 0.0, np.inf
    for here, child_depth, fan in wide_levels(depth):
        bound = partial(bound_nodes, leaves, 1 << (depth - child_depth), fan)
        run_chunks(bound, here.stop - here.start, NODES_A_CHUNK, bounds[here])


def wide_levels(depth: int) -> list[tuple[slice, int, int]]:
    """Return nodes of each wide level, the binary level of their children, and children each.

    The root takes what is left over when the depth is no multiple of 3.
    """
    bits = depth % 3 if depth % 3 or depth == 0 else 3
    result, first, count, child_depth, fan = [], 0, 1, bits, 1 << bits
    while child_depth <= depth:
        result.append((slice(first, first + count), child_depth, fan))
        first, count = first + count, 1 << child_depth
        child_depth, fan = child_depth + 3, 8
    return result


QUERIES_A_CHUNK = 512

NO_CORNERS = np.empty((0, 3, 3))

ROUNDING = 4e-7
"""Part of the largest coordinates that distances to boxes may be off: these are float32 of
coordinates relative to the middle, good to 1e-7 of their size, twice."""


@dataclass(frozen=True, eq=False)
class NearestTree:
    """A box tree over the centers of k balls, or of balls round k triangles."""

    tree: BoxTree
    items: Items

    @classmethod
    def of_triangles(cls, points: FloatArray, faces: IntArray) -> NearestTree:
        """Build the tree of the triangles of a mesh."""
        corners = points[faces]
        middles = corners.mean(axis=1)
        sizes = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
        return cls.of_balls(middles, sizes, corners)

    @classmethod
    def of_balls(
        cls, middles: FloatArray, sizes: FloatArray, corners: FloatArray = NO_CORNERS
    ) -> NearestTree:
        """Build the tree of balls, round triangles with these corners (k, 3, 3) if there are."""
        from medialis.base import _box_tree_kernels as kernels

        tree = build_box_tree(middles, np.zeros_like(middles))
        ordered, largest = sizes[tree.order], np.zeros((len(tree.child), kernels.FAN))
        placed = corners[tree.order] - tree.center if len(corners) else corners
        low, high = placed.min(axis=1), placed.max(axis=1)
        for nodes, child_depth, fan in wide_levels(tree.depth):
            if len(corners):
                _bound_corners(tree, low, high, nodes, child_depth, fan)
                continue
            count = nodes.stop - nodes.start
            kernels.largest_radii(ordered, child_depth, fan, 0, count, largest[nodes])
        return cls(tree, kernels.Items(ordered, largest, placed))

    @cached_property
    def _reach(self) -> float:
        """Largest coordinate of the items, from the middle of the tree."""
        return float(np.abs(self.tree.points).max(initial=0.0))

    def distances(
        self,
        queries: FloatArray,
        *,
        enough: float = -np.inf,
    ) -> tuple[FloatArray, IntArray]:
        """Return the distance of points to the nearest item, and its row.

        Parameters
        ----------
        queries : (q, 3) float
        enough : float
            The search of a point ends at the first item that is nearer than this.

        Returns
        -------
        distance : (q,) float64
            To balls |x - c| - r, negative inside; to triangles >= 0.
        row : (q,) int32
            Ties go either way, but always the same way. (inf, any row) where nothing counts.

        Notes
        -----
        Cost: about O(log k) a point near the items; more far inside a hollow shape, where many
        items are equally far.
        """
        from medialis.base import _box_tree_kernels as kernels

        tree, count = self.tree, len(queries)
        shifted = np.subtract(queries, tree.center, order="C")
        reach = self._reach + float(np.abs(shifted).max(initial=0.0))
        out = distance, row = np.empty(count), np.empty(count, np.int64)
        margin = ROUNDING * reach
        with_these = shifted, tree, self.items, margin, enough, out
        run_chunks(kernels.nearest_item, count, QUERIES_A_CHUNK, *with_these)
        return distance, tree.order[row]


def nearest_on_triangles(queries: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the barycentric coordinates of the place of one triangle nearest to each point.

    Parameters
    ----------
    queries : (q, 3) float64
    corners : (q, 3, 3) float64

    Returns
    -------
    (q, 3) float64
        Not negative, sum 1; exactly 0 for the corners that an edge or a corner does not have.
    """
    from medialis.base import _box_tree_kernels as kernels

    places = np.empty((len(queries), 2))
    kernels.nearest_places(queries, corners, places)
    first = np.where(places.sum(axis=1) >= 1.0, 0.0, 1.0 - places.sum(axis=1))
    return np.column_stack([first, places])


def _bound_corners(
    tree: BoxTree, low: FloatArray, high: FloatArray, nodes: slice, child_depth: int, fan: int
) -> None:
    """Let the boxes of some nodes hold triangles from `low` to `high` (k, 3), not their middles.

    Far from a flat surface, boxes of middles that are widened by the size of triangles leave
    thousands of triangles that may be the nearest.
    """
    n, count = len(low), nodes.stop - nodes.start
    first = (n * np.arange(count * fan)) >> child_depth
    for rows, ufunc, ends in (
        (slice(0, 3), np.minimum, low),
        (slice(3, 6), np.maximum, high),
    ):
        boxes = ufunc.reduceat(ends, first, axis=0).reshape(count, fan, 3)
        tree.bounds[nodes, rows, :fan] = boxes.transpose(0, 2, 1)


NEIGHBOUR_LEAVES_A_CHUNK = 128


def nearest_others(
    points: NDArray[np.float64], count: int, progress: Progress | None = None
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Find the nearest other points of each point: indices and distances, nearest first.

    Parameters
    ----------
    points : (n, 3) float64
    count : int
    progress : Progress, optional

    Returns
    -------
    (n, count) int32
        Equally near ones in either order. With fewer than count + 1 points there are fewer columns.
    (n, count) float64

    Notes
    -----
    Cost O(n log n); a third of a kd-tree of scipy for 10 neighbours.

    Examples
    --------
    >>> near, distance = nearest_others(np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]]), 1)
    >>> near.ravel().tolist(), distance.ravel().tolist()
    ([1, 0, 1], [1.0, 1.0, 2.0])
    """
    from medialis.base import _box_tree_kernels as kernels

    still = Progress() if progress is None else progress
    n, columns = len(points), max(min(count, len(points) - 1), 0)
    near, distance = np.empty((n, columns), np.int32), np.empty((n, columns))
    if columns == 0:
        return near, distance
    tree = run_patiently(lambda: exact_box_tree(points), still)
    chunks = len(tree.blocks), NEIGHBOUR_LEAVES_A_CHUNK
    run_chunks(kernels.nearest_in_tree, *chunks, tree, distance, near, progress=progress)
    return near, distance


def exact_box_tree(points: NDArray[np.float64]) -> BoxTree:
    """Build a tree without normals, for points closer than bounds in single precision tell."""
    return build_box_tree(points, np.zeros_like(points), allocate=_exactly)


def _exactly(name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Give an array; bounds in double precision."""
    return np.empty(shape, np.float64 if name == "bounds" else dtype)
