"""The bounding tree over surface samples that ball shrinking walks (thesis 3.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis._kernels.box_tree_kernels import (
    BOUND_ROWS,
    FAN,
    LEAF,
    bound_nodes,
    fill_leaves,
    split_nodes,
)
from medialis.threads import run_chunks

SERIAL_LEVELS = 3  # the top levels are split one by one; below, 8 subtrees go to the threads
NODES_A_CHUNK = 64
LEAVES_A_CHUNK = 1024
ROWS_A_BLOCK = 1 << 20  # what is copied at a time, so that mapped input needs no second copy

Allocate = Callable[[str, tuple[int, ...], Any], NDArray[Any]]


def _in_memory(name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    return np.empty(shape, dtype)


@dataclass(frozen=True, eq=False)
class BoxTree:
    """Samples in tree order with a box and a slab for every node.

    Coordinates are relative to `center`, so that float32 bounds are good to 1e-7 of the diagonal
    wherever the shape lies.

    Attributes
    ----------
    center : (3,) float64
        Middle of the bounding box, subtracted from all coordinates below.
    points, normals : (n, 3) float64
        Samples in tree order.
    order : (n,) int32
        Original index of each sample in tree order.
    blocks : (leaves, 3, LEAF) float64
        Leaf coordinates side by side; a short leaf repeats its last sample.
    bounds : (nodes, 11, 8) float32
        For the 8 children of a node: box low, box high, slab direction, slab low, slab high. A slab
        is the range of offsets of the samples along their mean normal: thinner than the box where
        the surface is nearly flat. Unused children have an empty box.
    child : (nodes,) int64
        First child: a node number, or ~leaf where the children are leaves.
    depth : int
        Binary levels: leaf j covers samples (n*j >> depth) .. (n*(j+1) >> depth).
    """

    center: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    order: NDArray[np.int32]
    blocks: NDArray[np.float64]
    bounds: NDArray[np.float32]
    child: NDArray[np.int64]
    depth: int

    @cached_property
    def place(self) -> NDArray[np.int32]:
        """Where each sample lies in tree order, (n,)."""
        place = np.empty(len(self.order), np.int32)
        place[self.order] = np.arange(len(place), dtype=np.int32)
        return place


def build_box_tree(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    *,
    unit: float = 1.0,
    allocate: Allocate = _in_memory,
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
    n = len(points)
    center = 0.5 * (points.min(axis=0) / unit + points.max(axis=0) / unit)
    rows = allocate("rows", (n, 4), np.float64)
    for begin in range(0, n, ROWS_A_BLOCK):
        here = slice(begin, begin + ROWS_A_BLOCK)
        np.subtract(points[here] / unit, center, out=rows[here, :3])
        rows[here, 3] = np.arange(begin, begin + len(rows[here]))
    depth = max(0, int(np.ceil(np.log2(n / LEAF)))) if n > LEAF else 0
    while -(-n // (1 << depth)) > LEAF:
        depth += 1

    top = min(SERIAL_LEVELS, depth)
    for level in range(top):
        run_chunks(lambda a, b, lv=level: split_nodes(rows, lv, lv + 1, a, b), 1 << level, 1)
    run_chunks(lambda a, b: split_nodes(rows, top, depth, a, b), 1 << top, 1)

    leaves = 1 << depth
    tree_points = allocate("points", (n, 3), np.float64)
    tree_normals = allocate("normals", (n, 3), np.float64)
    order = allocate("order", (n,), np.int32)
    blocks = allocate("blocks", (leaves, 3, LEAF), np.float64)
    run_chunks(
        lambda a, b: fill_leaves(
            rows, normals, depth, a, b, tree_points, tree_normals, order, blocks
        ),
        leaves,
        LEAVES_A_CHUNK,
    )

    # Wide levels: the root takes what is left over when the depth is no multiple of 3.
    root_bits = depth % 3 if depth % 3 or depth == 0 else 3
    child_depths = list(range(root_bits, depth + 1, 3))
    counts = [1] + [1 << d for d in child_depths[:-1]]
    first = np.concatenate([[0], np.cumsum(counts)])
    bounds = allocate("bounds", (int(first[-1]), BOUND_ROWS, FAN), np.float32)
    bounds[:, :3], bounds[:, 9:] = np.inf, np.inf
    bounds[:, 3:6] = -np.inf
    bounds[:, 6:9] = 0.0
    child = allocate("child", (int(first[-1]),), np.int64)
    for level, (count, child_depth) in enumerate(zip(counts, child_depths, strict=True)):
        begin, fan = int(first[level]), 1 << (root_bits if level == 0 else 3)
        here = slice(begin, begin + count)
        last = level == len(counts) - 1
        children = fan * np.arange(count)
        child[here] = ~children if last else int(first[level + 1]) + children
        run_chunks(
            lambda a, b, d=child_depth, f=fan, s=here: bound_nodes(
                tree_points, tree_normals, d, f, a, b, bounds[s]
            ),
            count,
            NODES_A_CHUNK,
        )
    return BoxTree(center, tree_points, tree_normals, order, blocks, bounds, child, depth)


def wide_levels(nodes: int, depth: int) -> list[tuple[slice, int, int]]:
    """Return nodes of each wide level, the binary level of their children, and children each."""
    bits = depth % 3 if depth % 3 or depth == 0 else 3
    result, first, count, child_depth, fan = [], 0, 1, bits, 1 << bits
    while first < nodes:
        result.append((slice(first, first + count), child_depth, fan))
        first, count = first + count, 1 << child_depth
        child_depth, fan = child_depth + 3, 8
    return result
