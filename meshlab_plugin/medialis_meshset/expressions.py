# SPDX-License-Identifier: GPL-3.0-or-later
"""Quality and colour as expressions over a custom attribute, in the language of MeshLab's filters.

An expression may have at most 5000 characters. A colour map is cut into straight pieces, found by a
tree of comparisons: within one step of 255 of the map itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from medialis.hosts import MISSING, Shown, color_table, palette, value_range
from medialis_meshset.attributes import FloatArray

TOLERANCE = 0.5
"""How far a straight piece may be from the colour map, in steps of 255."""


def quality_expression(shown: Shown, name: str) -> str:
    """Return the quality of `Shown.finite` as an expression over the attribute `name`."""
    low, high = value_range(shown.values)
    return f"({name}=={name}?min(max({name},{low!r}),{high!r}):{low!r})"


def color_expressions(shown: Shown, name: str) -> tuple[str, str, str]:
    """Return red, green and blue (0..255) as expressions over the attribute `name`."""
    missing = [f"{round(255 * share)}" for share in MISSING]
    if shown.is_label:
        colors = np.rint(255 * palette()).astype(int)
        # rint rounds half to even: the shift makes it the floor, for any number of labels.
        count = len(colors)
        row = f"({name}-{count}*rint({name}/{count}-0.4999))"
        if shown.values.max(initial=0) < count:
            row = name
        limits = [f"{i - 0.5}" for i in range(1, count)]
        trees = [_tree(row, limits, [f"{c}" for c in colors[:, k]]) for k in range(3)]
        return _each(f"{name}<0", missing, trees)
    low, high = shown.limits
    table = 255 * color_table(shown.color_map)
    trees = []
    for k in range(3):
        first, last = f"{table[0, k] + 0.5:.4f}", f"{table[-1, k] + 0.5:.4f}"
        inside = _ramp(table[:, k], low, high, name)
        trees.append(f"({name}<{low!r}?{first}:({name}>{high!r}?{last}:{inside}))")
    # NaN is the value that is not equal to itself.
    return _each(f"{name}!={name}", missing, trees)


def _ramp(channel: FloatArray, low: float, high: float, name: str) -> str:
    """Return one channel of a colour map between its limits; its middle where they are equal.

    Pieces are halved at the row that is furthest from a straight line, until all are straight.
    """
    values = np.linspace(low, high, len(channel))

    def piece(first: int, last: int) -> str:
        slope = (channel[last] - channel[first]) / (values[last] - values[first])
        line = channel[first] + slope * (values[first : last + 1] - values[first])
        error = np.abs(line - channel[first : last + 1])
        if error.max() <= TOLERANCE or last - first < 2:
            # Half a step more, because MeshLab rounds down.
            return f"{channel[first] + 0.5:.4f}+{slope:.6g}*({name}-({float(values[first])!r}))"
        split = first + 1 + int(error[1:-1].argmax())
        left, right = piece(first, split), piece(split, last)
        return f"({name}<{float(values[split])!r}?{left}:{right})"

    if not (np.diff(values) > 0).all():
        return f"{channel[len(channel) // 2] + 0.5:.4f}"
    return piece(0, len(channel) - 1)


def _tree(variable: str, limits: Sequence[str], leaves: Sequence[str]) -> str:
    """Return nested comparisons that choose the leaf between the limits around the variable."""
    if len(leaves) == 1:
        return leaves[0]
    middle = len(leaves) // 2
    left = _tree(variable, limits[: middle - 1], leaves[:middle])
    right = _tree(variable, limits[middle:], leaves[middle:])
    return f"({variable}<{limits[middle - 1]}?{left}:{right})"


def _each(condition: str, first: Sequence[str], others: Sequence[str]) -> tuple[str, str, str]:
    red, green, blue = (f"({condition}?{a}:{b})" for a, b in zip(first, others, strict=True))
    return red, green, blue
