"""Kernel of the nearest others of points among themselves (see neighbours.py)."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.box_tree_kernels import FAN, LEAF
from medialis._kernels.jit import kernel


@kernel
def nearest_in_tree(
    first, last, points, order, blocks, bounds, child, depth, out_distance, out_near
):  # fmt: skip
    """Find the nearest others of the points in leaves first..last of a box tree, nearest first.

    Points, blocks and bounds (float64) are in tree order, the rows of the answer and its indices in
    the given one. Each search begins in the leaf of its point: what it finds there is nearly always
    as near as the answer, so that few other boxes come near enough to be opened.
    """
    n, count = len(points), out_near.shape[1]
    stack, least = np.empty(8 * 12 + 8, np.int64), np.empty(8 * 12 + 8)
    box, turn, square = np.empty(FAN), np.empty(FAN, np.int64), np.empty(LEAF)
    best, names = np.empty(count), np.empty(count, np.int64)
    for leaf in range(first, last):
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            best[:] = np.inf
            _take_leaf(x, y, z, i, leaf, n, depth, blocks, square, best, names)
            stack[0], least[0] = 0, 0.0
            top = 1
            while top > 0:
                top -= 1
                if least[top] >= best[count - 1]:
                    continue
                node = stack[top]
                base = child[node]
                _measure_boxes(bounds[node], x, y, z, box)
                hits = _sort_hits(box, best[count - 1], turn)
                if base >= 0:
                    for at in range(hits - 1, -1, -1):  # the nearest comes last, and is next
                        stack[top], least[top] = base + turn[at], box[turn[at]]
                        top += 1
                    continue
                for at in range(hits):
                    if ~base + turn[at] != leaf and box[turn[at]] < best[count - 1]:
                        other = ~base + turn[at]
                        _take_leaf(x, y, z, i, other, n, depth, blocks, square, best, names)
            row = order[i]
            for k in range(count):
                out_distance[row, k], out_near[row, k] = math.sqrt(best[k]), order[names[k]]


@kernel
def _measure_boxes(bound, x, y, z, out):
    """Squared distances to the boxes of eight children; infinite where there is none."""
    for j in range(FAN):
        ax, bx = bound[0, j] - x, x - bound[3, j]
        ay, by = bound[1, j] - y, y - bound[4, j]
        az, bz = bound[2, j] - z, z - bound[5, j]
        # Conditional expressions, not max(): max() treats NaN apart and is not vectorised.
        dx = ax if ax > bx else bx
        dy = ay if ay > by else by
        dz = az if az > bz else bz
        dx = dx if dx > 0.0 else 0.0
        dy = dy if dy > 0.0 else 0.0
        dz = dz if dz > 0.0 else 0.0
        out[j] = dx * dx + dy * dy + dz * dz


@kernel
def _sort_hits(box, reach, out_turn):
    """List the children nearer than `reach`, the nearest first; return how many."""
    hits = 0
    for j in range(FAN):
        if box[j] >= reach:
            continue
        at = hits
        while at > 0 and box[out_turn[at - 1]] > box[j]:
            out_turn[at] = out_turn[at - 1]
            at -= 1
        out_turn[at] = j
        hits += 1
    return hits


@kernel
def _take_leaf(x, y, z, i, leaf, n, depth, blocks, square, best, names):
    """Enter the points of a leaf, but point i, into the sorted list of the nearest so far."""
    begin, count = (n * leaf) >> depth, len(best)
    for slot in range(LEAF):
        dx, dy, dz = blocks[leaf, 0, slot] - x, blocks[leaf, 1, slot] - y, blocks[leaf, 2, slot] - z
        square[slot] = dx * dx + dy * dy + dz * dz
    for slot in range(((n * (leaf + 1)) >> depth) - begin):
        value = square[slot]
        if value >= best[count - 1] or begin + slot == i:
            continue
        k = count - 1
        while k > 0 and best[k - 1] > value:
            best[k], names[k] = best[k - 1], names[k - 1]
            k -= 1
        best[k], names[k] = value, begin + slot
