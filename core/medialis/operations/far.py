"""Shapes far from the origin: computed near it, and the result put back where the shape is.

Coordinates of a part in UTM metres leave six digits for the part itself, and each center that is
computed from them loses some of those. Differences of such coordinates are exact, so an operation
runs on the shape moved to its own first point, and loses nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from medialis.model.shape import Shape
from medialis.validation import FloatArray

FAR = 16.0
"""Diagonals between a shape and the origin, along an axis, from which on it is moved. Then all its
coordinates on that axis are within a factor of two, so their differences are exact (Sterbenz), and
so is the way back."""

POSITIONS = frozenset(
    {"points", "centers", "nodes", "heads", "tails", "y_points", "view_points", "midsurface_points"}
)
"""Names of all arrays of positions, in results and in what they hold."""

BALLS = frozenset({"balls", "after"})
"""Names of all arrays of centers with their radii."""

PLACES = frozenset({"position", "opposite", "head", "tail"})
"""Names of single positions in the values of results."""


def offset_of(shape: Shape) -> FloatArray:
    """Return what to take from the points of a shape, (3,): 0 along axes on which it is near."""
    low, high = shape.bounds
    nearest = np.minimum(np.abs(low), np.abs(high))
    far = (np.sign(low) == np.sign(high)) & (nearest > FAR * shape.diagonal)
    return np.where(far, shape.points[0], 0.0)


def near_origin(shape: Shape) -> Shape:
    """Return a shape moved by its `offset_of`, which sentences about places add again."""
    near: Shape = moved(shape, -offset_of(shape))
    near.__dict__["offset"] = offset_of(shape)
    return near


def moved(value: Any, offset: FloatArray) -> Any:
    """Return a result, or anything that it holds, with all its positions moved."""
    return _moved(value, "", offset, {})


def _moved(value: Any, name: str, offset: FloatArray, known: dict[int, Any]) -> Any:
    if isinstance(value, np.ndarray):
        if value.ndim != 2 or value.shape[1:] not in ((3,), (4,)):
            return value
        if name in POSITIONS and value.shape[1] == 3:
            return value + offset
        return value + np.append(offset, 0.0) if name in BALLS and value.shape[1] == 4 else value
    if name in PLACES and isinstance(value, list):
        return [x + float(d) for x, d in zip(value, offset, strict=True)]
    if id(value) in known:
        return known[id(value)]
    result = value
    if is_dataclass(value) and not isinstance(value, type):
        parts = {one.name: getattr(value, one.name) for one in fields(value)}
        new = {key: _moved(part, key, offset, known) for key, part in parts.items()}
        changed = {key: part for key, part in new.items() if part is not parts[key]}
        result = replace(value, **changed) if changed else value
    elif isinstance(value, Mapping):
        result = {key: _moved(part, key, offset, known) for key, part in value.items()}
    elif isinstance(value, tuple | list):
        result = type(value)(_moved(part, name, offset, known) for part in value)
    known[id(value)] = result
    return result
