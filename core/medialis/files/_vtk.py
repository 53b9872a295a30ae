"""What the XML files of VTK share: numbers stand as they are behind the text (raw, appended)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidOptionError

_TYPES = {
    **{f"i{size}": f"Int{8 * size}" for size in (1, 2, 4, 8)},
    **{f"u{size}": f"UInt{8 * size}" for size in (1, 2, 4, 8)},
    **{"f4": "Float32", "f8": "Float64"},
}
"""Names of types by those of numpy, without the order of bytes."""


def cell_rows(rows: ArrayLike | None, corners: int) -> NDArray[np.int64]:
    """Return rows of corners; none for None."""
    return np.asarray([] if rows is None else rows, np.int64).reshape(-1, corners)


def as_column(name: str, values: ArrayLike, count: int) -> NDArray[Any]:
    """Return an attribute as a column or as columns of numbers that the format has.

    Raises
    ------
    InvalidOptionError
        When it has another number of rows, or other things than numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind == "b":
        array = array.astype(np.uint8)
    if array.ndim == 0 or len(array) != count:
        raise InvalidOptionError(
            f"attribute {name!r} has shape {array.shape}; {count} rows are expected."
        )
    if array.dtype.str[1:] not in _TYPES:
        raise InvalidOptionError(
            f"attribute {name!r} has type {array.dtype}; bool, whole numbers, float32 and float64 "
            "can be written."
        )
    return array if array.ndim == 1 else array.reshape(count, -1)


def behind(values: NDArray[Any], count: int) -> NDArray[Any]:
    """Put rows that say nothing before those of the triangles."""
    nothing = np.nan if values.dtype.kind == "f" else 0
    return np.concatenate([np.full((count, *values.shape[1:]), nothing, values.dtype), values])


class Appended:
    """The arrays behind the text, and where each begins."""

    def __init__(self) -> None:
        self._arrays: list[NDArray[Any]] = []
        self._end = 0

    def add(self, name: str, values: NDArray[Any]) -> str:
        """Store an array and return the element that names it."""
        array = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
        start, self._end = self._end, self._end + 8 + array.nbytes
        self._arrays.append(array)
        width = f' NumberOfComponents="{array.shape[1]}"' if array.ndim > 1 else ""
        return (
            f'<DataArray type="{_TYPES[array.dtype.str[1:]]}" Name={quoteattr(name)}{width} '
            f'format="appended" offset="{start}"/>'
        )

    def parts(self) -> Iterable[bytes]:
        """Give the bytes of each array after the number of them."""
        for array in self._arrays:
            yield np.uint64(array.nbytes).astype("<u8").tobytes()
            yield array.tobytes()


def xml_file(kind: str, inside: Iterable[str], data: Appended) -> Iterable[bytes]:
    """Give the bytes of a file of a kind of VTK's: its elements, and the numbers behind them."""
    for line in (
        '<?xml version="1.0"?>',
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        *inside,
    ):
        yield line.encode() + b"\n"
    yield b'<AppendedData encoding="raw">\n_'
    yield from data.parts()
    yield b"\n</AppendedData>\n</VTKFile>\n"
