"""The ground in the scan of a tree: a surface below everything, much larger than the trunk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import Index, Mask
from medialis.base.validation import FloatArray
from medialis.shape.surface import piece_labels

CELLS = 3.0, 6.0, 12.0, 24.0
"""Sizes of the cells of the height grid that are tried, in spacings: scanners see the ground at a
shallow angle, so its points are farther apart than those of the trunk."""

ROUGH = 3.0
"""Height of the ground in median steps between neighbouring cells."""

STEEPEST = 1.0
"""Maximum slope of the ground between neighbouring cells."""

LARGER = 4.0
"""The ground has at least so many times the cells of what stands on it (the trunk)."""

FEWEST_CELLS = 16
"""A smaller ground cannot be distinguished from a thick trunk."""

ABOVE = 2.0, 4.0
"""Heights above the ground, in cells, between which things stand on it."""

BELOW = 0.01
"""Maximum fraction of the points that are below the ground: strays."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights of the ground on a grid of horizontal cells.

    Attributes
    ----------
    up : int
        The axis of the heights.
    low : (2,) float64
        Corner of the grid.
    cell : float
        Size of a cell.
    cells : (g, 2) int64
        Cells of the ground.
    heights : (g,) float64
        Height of each.
    margin : float
        Height above it up to which points are on it.
    """

    up: int
    low: FloatArray
    cell: float
    cells: Index
    heights: FloatArray
    margin: float

    def under(self, points: FloatArray) -> FloatArray:
        """Return the height of the ground below each point, (n,): that of the nearest cell."""
        from medialis.base.arrays import kd_tree

        flat = (np.delete(points, self.up, axis=1) - self.low) / self.cell - 0.5
        count = min(4, len(self.cells))
        rows = kd_tree(self.cells.astype(np.float64)).query(flat, k=count)[1]
        return np.asarray(np.median(self.heights[rows.reshape(len(points), count)], axis=1))

    def holds(self, points: FloatArray) -> FloatArray:
        """Return the points (n,) on the ground or below it."""
        return np.asarray(points[:, self.up] - self.under(points) <= self.margin)

    def low_parts(self, points: FloatArray) -> Mask:
        """Return a mask (n,) of the parts that end just above the ground: grass, stones, roughness.

        Points below the upper bound of `ABOVE` are connected where their cells touch. What stands
        on the ground has points above the lower bound.
        """
        over = (points[:, self.up] - self.under(points)) / self.cell
        low = np.flatnonzero(over < ABOVE[1])
        result = np.zeros(len(points), bool)
        if len(low):
            keys, cell_of, across = _cells(np.delete(points[low], self.up, axis=1), self.cell)
            part = piece_labels(len(keys), np.column_stack(_neighbours(keys, across)))[cell_of]
            top = np.full(len(keys), -np.inf)
            np.maximum.at(top, part, over[low])
            result[low] = top[part] < ABOVE[0]
        return result


def find_ground(points: FloatArray, up: int, spacing: float) -> Ground | None:
    """Return the ground of a scan, None without one.

    Cells of a horizontal grid have the height of their lowest point. Neighbours whose heights
    differ by less than a slope of 45 degrees are connected. The largest connected part is the
    ground if hardly any points are below it and if few of its cells have something above.
    """
    found = (_ground(points, up, times * spacing, spacing) for times in CELLS)
    return next((ground for ground in found if ground is not None), None)


def _ground(points: FloatArray, up: int, cell: float, spacing: float) -> Ground | None:
    """Return the ground if it is connected in cells of one size."""
    flat, height = np.delete(points, up, axis=1), points[:, up]
    keys, cell_of, across = _cells(flat, cell)
    lowest = np.full(len(keys), np.inf)
    np.minimum.at(lowest, cell_of, height)
    a, b = _neighbours(keys, across)
    level = np.abs(lowest[a] - lowest[b]) <= STEEPEST * cell
    part = piece_labels(len(keys), np.column_stack([a[level], b[level]]))
    chosen = part == np.bincount(part).argmax()
    cells = np.flatnonzero(chosen)
    if len(cells) < FEWEST_CELLS:
        return None
    steps = np.abs(lowest[a] - lowest[b])[level & chosen[a]]
    margin = min(cell, max(2.0 * spacing, ROUGH * float(np.median(steps))))
    grid = np.stack([keys[cells] // across, keys[cells] % across], axis=1)
    ground = Ground(up, flat.min(axis=0), cell, grid, lowest[cells], margin)
    over = height - ground.under(points)
    standing = chosen[cell_of] & (over > ABOVE[0] * cell) & (over < ABOVE[1] * cell)
    occupied = len(np.unique(cell_of[standing]))
    below = float((over < -cell).mean())
    return ground if len(cells) >= LARGER * max(occupied, 1) and below < BELOW else None


def _cells(flat: FloatArray, cell: float) -> tuple[Index, Index, int]:
    """Return the sorted keys of occupied cells, the row of each point's, and the keys of a row."""
    index = np.floor((flat - flat.min(axis=0)) / cell).astype(np.int64)
    across = int(index[:, 1].max()) + 2
    keys, cell_of = np.unique(index[:, 0] * across + index[:, 1], return_inverse=True)
    return keys, cell_of, across


def _neighbours(keys: Index, across: int) -> tuple[Index, Index]:
    """Return the pairs of occupied cells that touch, given their sorted keys."""
    pairs = []
    for step in (1, across - 1, across, across + 1):
        at = np.searchsorted(keys, keys + step)
        there = np.flatnonzero(keys[np.minimum(at, len(keys) - 1)] == keys + step)
        pairs.append(np.stack([there, at[there]]))
    a, b = np.concatenate(pairs, axis=1)
    return a, b
