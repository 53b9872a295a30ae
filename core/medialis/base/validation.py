"""The one door for input: what a caller gives becomes arrays the core can trust, or one sentence.

Arrays that leave this module are C-contiguous, read-only, float64 or int32. Inputs are never
changed; a copy is made only where the given array is not already in that form.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError, MedialisError

FloatArray = NDArray[np.float64]
Positions = Annotated[FloatArray, "Positions"]
"""The type of a field that holds positions (n, 3): results far from the origin have them moved."""
BallRows = Annotated[FloatArray, "BallRows"]
"""The type of a field of centers with their radii (k, 4)."""
Directions = Annotated[FloatArray, "Directions"]
"""The type of a field of directions (n, 3), which are the same wherever the shape lies."""
Measures = Annotated[FloatArray, "Measures"]
"""The type of a field with several columns of other numbers."""
IntArray = NDArray[np.int32]

AXES = ("x", "y", "z")
LARGEST_COORDINATE = 1e151
"""Squares of distances between points, and of cameras around them, stay below 1.8e308."""


def frozen(array: NDArray[Any], dtype: Any) -> NDArray[Any]:
    """Return a C-contiguous read-only array of `dtype`, without a copy when it is one already.

    A writable array that belongs to the caller is viewed, not locked: the caller may still write
    to its own array, as with every numpy view.
    """
    result = np.ascontiguousarray(array, dtype=dtype)
    if result.flags.writeable:
        result = result.view()
        result.flags.writeable = False
    return result


def owned(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array that nobody can write to: itself, or a copy where somebody could."""
    base: Any = array
    while isinstance(base, np.ndarray):
        if base.flags.writeable:
            array = array.copy()
            break
        base = base.base
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


_TYPES = {"IntArray": np.int32, "Mask": np.bool_}
"""What fields hold that are declared so. Those of ``NDArray[np...]`` say it, all others floats."""


def _type_of(declared: str) -> Any:
    """Return the type of numbers in a field, by how it is declared."""
    name = declared.removesuffix(" | None")
    if name.startswith("NDArray[np."):
        return getattr(np, name[len("NDArray[np.") : -1])
    return _TYPES.get(name, np.float64)


def hold(owner: Any, **columns: int | tuple[int, ...]) -> None:
    """Make arrays of a frozen dataclass what it promises: rows, or (rows, columns), by their names.

    The types of their numbers are those that the fields are declared with.

    Raises
    ------
    InvalidShapeError
        When one has another shape.
    """
    declared = {field.name: field.type for field in fields(owner)}
    for name, size in columns.items():
        value = np.asarray(getattr(owner, name))
        shape = size if isinstance(size, tuple) else (size,)
        if value.shape != shape:
            raise InvalidShapeError(f"{name} must have shape {shape}, got {value.shape}.")
        object.__setattr__(owner, name, frozen(value, _type_of(str(declared[name]))))


def all_finite(values: NDArray[Any]) -> bool:
    """Tell whether no number of an array is NaN or infinite."""
    return bool(np.isfinite(extremes(values)).all())


def extremes(values: NDArray[Any]) -> tuple[float, float]:
    """Return the least and the largest number of an array: NaN where it has one, 0 if it is empty.

    That makes no array, so it is many times as fast as to look at each number.
    """
    with np.errstate(invalid="ignore"):  # signalling NaN in a damaged file
        return (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)


def sealed(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array that nobody else has, read-only from now on: `owned` needs no copy of it."""
    array.flags.writeable = False
    return array


def _numeric(values: ArrayLike, name: str, wanted: str) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InvalidShapeError(f"{name} must be {wanted}; rows of unequal length came.") from error
    if array.size and array.dtype.kind not in "fiub":
        raise InvalidShapeError(f"{name} must be {wanted}, got {array.dtype} values.")
    return array


def as_points(values: ArrayLike, name: str = "points") -> FloatArray:
    """Return points (n, 3) float64 with finite coordinates up to 1e151, n >= 1.

    Raises
    ------
    InvalidShapeError
        For another array shape, no rows, text or objects, NaN, infinity or beyond 1e151.
    """
    wanted = "an (n, 3) array of numbers"
    array = _numeric(values, name, wanted)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidShapeError(f"{name} must be {wanted}, got shape {array.shape}.")
    if len(array) == 0:
        raise InvalidShapeError(f"{name} is empty: at least one row is needed.")
    if len(array) > np.iinfo(np.int32).max:
        raise InvalidShapeError(f"{name} has {len(array)} rows; at most 2147483647 are supported.")
    result = frozen(array, np.float64)
    low, high = extremes(result)
    if low >= -LARGEST_COORDINATE and high <= LARGEST_COORDINATE:
        return result
    if not np.isfinite(result).all():
        bad = ~np.isfinite(result).all(axis=1)
        raise InvalidShapeError(
            f"{name} must be finite: {int(bad.sum())} of {len(result)} rows hold NaN or infinity "
            f"(first at row {int(bad.argmax())}). Remove these points or repair the file."
        )
    check_range(result, name)
    return result


def check_range(values: FloatArray, name: str) -> None:
    """Refuse coordinates and lengths whose squares are no numbers; NaN passes.

    Raises
    ------
    InvalidShapeError
        When one lies beyond 1e151.
    """
    largest = float(np.fmax.reduce(np.abs(values), axis=None, initial=0.0))
    if largest > LARGEST_COORDINATE:
        raise InvalidShapeError(
            f"{name} must lie within {LARGEST_COORDINATE:g} of the origin, got {largest:g}: "
            "squared distances would leave the range of numbers. Scale the shape down."
        )


def as_normals(values: ArrayLike, count: int, name: str = "normals") -> FloatArray:
    """Return normals (n, 3) float64, unit where defined; zero or NaN rows mean "none" (zero).

    Raises
    ------
    InvalidShapeError
        For another shape than (count, 3) or values that are not numbers.
    """
    wanted = f"a ({count}, 3) array of numbers, one row a point"
    array = _numeric(values, name, wanted)
    if array.shape != (count, 3):
        raise InvalidShapeError(f"{name} must be {wanted}, got shape {array.shape}.")
    with np.errstate(over="ignore", invalid="ignore"):
        square = np.einsum("ij,ij->i", array, array, dtype=np.float64, casting="unsafe")
        # A row that is unit to rounding stays as it is: normals must not drift each time a shape is
        # rebuilt.
        other = np.flatnonzero(~(np.abs(square - 1.0) <= 8 * np.finfo(np.float64).eps))
    normals = np.array(array, np.float64, order="C")
    rest = normals[other]
    rest[~np.isfinite(rest).all(axis=1)] = 0.0
    # Dividing by the largest component first keeps lengths of 1e-300 or 1e300 in range.
    largest = np.abs(rest).max(axis=1, keepdims=True)
    np.divide(rest, largest, out=rest, where=largest > 0)
    length = np.sqrt(np.einsum("ij,ij->i", rest, rest))[:, None]
    normals[other] = np.divide(rest, length, out=rest, where=length > 0)
    return sealed(normals)


def as_faces(values: ArrayLike, count: int, name: str = "faces") -> IntArray:
    """Return triangles (m, 3) int32 with indices in 0..count-1, m >= 0.

    Raises
    ------
    InvalidShapeError
        For another shape, fractional or out-of-range indices.
    """
    wanted = "an (m, 3) array of vertex indices"
    array = _numeric(values, name, wanted)
    if array.size == 0:
        return frozen(np.empty((0, 3)), np.int32)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidShapeError(f"{name} must be {wanted}, got shape {array.shape}.")
    if array.dtype.kind == "f" and not (np.isfinite(array).all() and (array % 1 == 0).all()):
        raise InvalidShapeError(f"{name} must be whole numbers; fractional or NaN indices came.")
    low, high = array.min(), array.max()
    if low < 0 or high >= count:
        bad = ((array < 0) | (array >= count)).any(axis=1)
        raise InvalidShapeError(
            f"{name} must name vertices 0..{count - 1}: {int(bad.sum())} of {len(array)} faces do "
            f"not (first: face {int(bad.argmax())} = {array[bad.argmax()].tolist()})."
        )
    return frozen(array, np.int32)


def as_field(values: ArrayLike, count: int, name: str) -> FloatArray:
    """Return a scalar field (count,) float64; NaN and infinity are allowed.

    Raises
    ------
    InvalidShapeError
        For another shape or values that are not numbers.
    """
    wanted = f"a ({count},) array of numbers"
    array = _numeric(values, name, wanted)
    if array.shape != (count,):
        raise InvalidShapeError(f"{name} must be {wanted}, got shape {array.shape}.")
    return frozen(array, np.float64)


def as_number(
    value: Any, name: str, *, low: float = -math.inf, high: float = math.inf, open_low: bool = False
) -> float:
    """Return a finite float within low..high (`open_low`: above low).

    Raises
    ------
    InvalidOptionError
        When it is not a number or not in the range.
    """
    range_text = f"{'above' if open_low else 'from'} {low:g} to {high:g}"
    if low == -math.inf and high == math.inf:
        range_text = "finite"
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidOptionError(
            f"{name} must be a number ({range_text}), got {value!r}."
        ) from error
    too_low = number <= low if open_low else number < low
    if (
        isinstance(value, (bool, np.bool_, str, bytes))
        or not math.isfinite(number)
        or too_low
        or number > high
    ):
        raise InvalidOptionError(f"{name} must be a number ({range_text}), got {value!r}.")
    return number


def require_rows(rows: NDArray[Any], count: int, what: str) -> None:
    """Check indices that were computed, at the door of a kernel, which would write where they lead.

    Raises
    ------
    MedialisError
        When one is none of `count` rows: a fault of this project.
    """
    if rows.size and not 0 <= rows.min() <= rows.max() < count:
        raise MedialisError(
            f"This is a fault of medialis, please report it: {what} name {rows.min()} to "
            f"{rows.max()}, of {count} that are there."
        )


def as_whole_number(value: Any, name: str, *, low: int, high: int) -> int:
    """Return an int within low..high.

    Raises
    ------
    InvalidOptionError
        When it is not a whole number or not in the range.
    """
    number = as_number(value, name, low=low, high=high)
    if number != int(number):
        raise InvalidOptionError(f"{name} must be a whole number, got {value!r}.")
    return int(number)


def as_choice(value: Any, name: str, choices: Sequence[str]) -> str:
    """Return one of `choices`.

    Raises
    ------
    InvalidOptionError
        When it is none of them; the sentence lists them.
    """
    if not isinstance(value, str) or value not in choices:
        raise InvalidOptionError(f"{name} must be one of {', '.join(choices)}, got {value!r}.")
    return str(value)
