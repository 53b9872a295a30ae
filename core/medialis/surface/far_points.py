"""Points or parts far from the rest: they make every length useless, so they are said (before 3.2).

All lengths are fractions of the diagonal of the bounding box. One stray point at a thousand times
the size of a shape makes the default lengths larger than the shape.
"""

from __future__ import annotations

import logging

import numpy as np

from medialis.model.shape import Shape
from medialis.progress import Message
from medialis.validation import FloatArray

FAR = 50.0
"""Diagonals of what is meant: at this distance the whole of it is no longer than one edge that the
default refinement leaves (2 % of the diagonal)."""

TAILS = 0.1, 0.9
"""Quantiles of each coordinate that bound the bulk of the points: fewer than a tenth are strays."""


def far_points(shape: Shape) -> Message | None:
    """Return a sentence about points, or parts of a mesh, that lie far from the rest, or None.

    Parameters
    ----------
    shape : Shape
        A cloud, or a mesh whose points are all in use.

    Returns
    -------
    Message or None
        What lies where, what it does to the lengths, and what to do.
    """
    low, high = np.quantile(shape.points, TAILS, axis=0)
    bulk = float(np.linalg.norm(high - low))
    harm = (
        f"the diagonal is {shape.diagonal:.3g}, and lengths such as tolerance and refine are "
        "fractions of it, too coarse for the"
    )
    if 0 < bulk < shape.diagonal / FAR:
        away = ((shape.points < low - bulk) | (shape.points > high + bulk)).any(axis=1)
        first = ", ".join(f"{x:.6g}" for x in shape.points[int(away.argmax())])
        count = int(away.sum())
        return Message(
            f"{count} of {shape.point_count} points lie far from the rest, which is "
            f"about {bulk:.3g} large (the first at {first}): {harm} rest. Delete the far points if "
            "they are strays.",
            "far_points",
            logging.WARNING,
            points=count,
            of=shape.point_count,
            size=bulk,
        )
    largest = _largest_part(shape)
    if 0 < largest < shape.diagonal / FAR:
        parts = int(shape.components.max()) + 1
        return Message(
            f"The {parts} parts lie far apart, the largest is {largest:.3g} large: {harm} parts. "
            "Delete parts that are strays, or run the parts one by one.",
            "far_parts",
            logging.WARNING,
            parts=parts,
            size=largest,
        )
    return None


def _largest_part(shape: Shape) -> float:
    """Return the diagonal of the largest component."""
    if not shape.components.any():
        return shape.diagonal
    order = np.argsort(shape.components, kind="stable")
    starts = np.flatnonzero(np.diff(shape.components[order], prepend=-1))
    points: FloatArray = shape.points[order]
    size = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)
    return float(np.linalg.norm(size, axis=1).max())
