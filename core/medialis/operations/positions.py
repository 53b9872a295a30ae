"""Positions have a type, so that a shape far from the origin is computed near it and put back.

Coordinates of a part in UTM metres leave six digits for the part itself, and each center that is
computed from them loses some of those. Differences of such coordinates are exact, so `run` moves
such a shape to its own first point, and moves every position of the outcome back. Which numbers
are positions is said where they are made, never guessed from names:

- a field of a dataclass is declared as `Positions` (n, 3), as `BallRows` (k, 4), centers with their
  radii, or as `Directions` or `Measures` where it is none of them (`base/validation.py`);
- arrays and attributes of layers are `places(...)`, `balls(...)` or `numbers(...)`;
- a single one in values, also deep in tables, is `place(...)`; a list of numbers that is none,
  `numbers(...)`.

Columns or a list of numbers that say nothing are refused at the first run, however many they are,
near the origin or far.
The marks end with `run`: results hold plain arrays and lists.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import MedialisError
from medialis.base.validation import FloatArray
from medialis.shape.shape import Shape

FAR = 16.0
"""Diagonals between a shape and the origin, along an axis, from which on it is moved. Then all its
coordinates on that axis are within a factor of two, so their differences are exact (Sterbenz), and
so is the way back."""

NO_POSITIONS = ("Directions", "Measures")
"""Types of fields with columns that stay."""

T = TypeVar("T")


class _Marked(np.ndarray):
    """An array that says what its rows are; slices say so as well, computed ones do not."""

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        plain = np.asarray(array)
        return plain[()] if return_scalar else plain


class Places(_Marked):
    """Positions, (n, 3)."""


class BallArray(_Marked):
    """Centers with their radii, (k, 4)."""


class Numbers(_Marked):
    """Rows of three or four numbers that are no positions."""


class Place(list[float]):
    """A single position among values."""


class Listed(list[float]):
    """Numbers among values that are no position."""


def places(values: ArrayLike) -> NDArray[np.float64]:
    """Mark positions (n, 3) among the arrays of an outcome or the attributes of a layer.

    Examples
    --------
    >>> type(places([[0, 0, 1]])[:1]).__name__, type(places([[0, 0, 1]]) - 1.0).__name__
    ('Places', 'ndarray')
    """
    return np.asarray(values, np.float64).view(Places)


def balls(values: ArrayLike) -> NDArray[np.float64]:
    """Mark centers with their radii (k, 4)."""
    return np.asarray(values, np.float64).view(BallArray)


def numbers(values: Any) -> Any:
    """Mark an array of several columns, or a list of numbers, as no positions."""
    return Listed(values) if isinstance(values, list | tuple) else np.asarray(values).view(Numbers)


def place(values: Iterable[float]) -> Place:
    """Mark one position among the values of an outcome, also in a table: ``place(center)``."""
    return Place(float(x) for x in values)


def of_array(value: Any) -> Any:
    """Return an array that stands among values as lists, with what it is marked as."""
    if value.ndim == 1 and isinstance(value, Places | Numbers):
        return Place(value.tolist()) if isinstance(value, Places) else Listed(value.tolist())
    if value.ndim > 1:
        return [of_array(part) for part in value]
    return value.tolist()


def offset_of(shape: Shape) -> FloatArray:
    """Return what to take from the points of a shape, (3,): 0 along axes on which it is near."""
    low, high = shape.bounds
    nearest = np.minimum(np.abs(low), np.abs(high))
    far = (np.sign(low) == np.sign(high)) & (nearest > FAR * shape.diagonal)
    return np.where(far, shape.points[0], 0.0)


def near_origin(shape: Shape) -> Shape:
    """Return a shape moved by its `offset_of`, which sentences about places add again."""
    near = moved(shape, -offset_of(shape))
    near.__dict__["offset"] = offset_of(shape)
    return near


def moved(value: T, offset: FloatArray) -> T:
    """Return an outcome, or anything that it holds, with its positions moved and no marks.

    Raises
    ------
    MedialisError
        For three columns or numbers of which nothing says whether they are positions.
    """
    mover = _Mover(offset)
    found: T = mover.moved(value, "", type(value).__name__)
    return found


class _Mover:
    """Walks through what an outcome holds; each object is moved once."""

    def __init__(self, offset: FloatArray) -> None:
        self._offset, self._far = offset, bool(offset.any())
        self._known: dict[int, tuple[Any, Any]] = {}

    def moved(self, value: Any, declared: str, place: str) -> Any:
        """Return a value moved; `declared` is the type of its field, `place` where it stands."""
        if isinstance(value, np.ndarray):
            return self._array(value, declared, place)
        if isinstance(value, list):
            return self._list(value, place)
        if not isinstance(value, Mapping | tuple) and not is_dataclass(value):
            return value
        if isinstance(value, type):
            return value
        if id(value) not in self._known:  # kept with the result, so that its number stays its own
            self._known[id(value)] = value, self._whole(value, declared, place)
        return self._known[id(value)][1]

    def _whole(self, value: Any, declared: str, place: str) -> Any:
        if isinstance(value, Mapping):
            new = {key: self.moved(part, "", f"{place} {key!r}") for key, part in value.items()}
            return new if any(new[key] is not value[key] for key in new) else value
        if isinstance(value, tuple):
            parts = [self.moved(part, declared, place) for part in value]
            if all(a is b for a, b in zip(parts, value, strict=True)):
                return value
            return value._make(parts) if hasattr(value, "_make") else tuple(parts)
        name, changed = type(value).__name__, {}
        for one in fields(value):
            part = getattr(value, one.name)
            new = self.moved(part, str(one.type), f"{one.name} of {name}")
            if new is not part:
                changed[one.name] = new
        return replace(value, **changed) if changed else value

    def _array(self, value: NDArray[Any], declared: str, place: str) -> NDArray[Any]:
        plain = value.view(np.ndarray) if isinstance(value, _Marked) else value
        if isinstance(value, Places) or "Positions" in declared:
            return plain + self._offset if self._far else plain
        if isinstance(value, BallArray) or "BallRows" in declared:
            return plain + np.append(self._offset, 0.0) if self._far else plain
        said = isinstance(value, Numbers) or any(name in declared for name in NO_POSITIONS)
        # Whatever the number of columns is this time: it may follow from the shape.
        if not said and value.ndim > 1 and value.dtype.kind == "f":
            raise MedialisError(
                f"{place} has {value.shape[-1]} columns, and nothing says whether they are "
                "positions: mark it as places(...), balls(...) or numbers(...) of "
                "medialis.operations.positions, or declare the field as Positions, BallRows, "
                "Directions or Measures."
            )
        return plain

    def _list(self, value: list[Any], place: str) -> list[Any]:
        if isinstance(value, Place):
            return [
                x + float(d) if self._far else x for x, d in zip(value, self._offset, strict=True)
            ]
        if isinstance(value, Listed):
            return list(value)
        if value and all(isinstance(x, float | np.floating) for x in value):
            raise MedialisError(
                f"{place} is a list of numbers, and nothing says whether it is a position: "
                "mark it as place(...) or numbers(...) of medialis.operations.positions."
            )
        parts = [self.moved(part, "", place) for part in value]
        return value if all(a is b for a, b in zip(parts, value, strict=True)) else parts
