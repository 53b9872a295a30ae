"""Read PCD files of the Point Cloud Library: ascii, binary and binary_compressed.

The header names the fields of a point, their types and the number of points. The body holds the
points as text, as packed records, or as one LZF-compressed block of columns. Counts in the header
are compared with the size of the body before memory is allocated for them.

Source: https://pointclouds.org/documentation/tutorials/pcd_file_format.html (version 0.7).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Message
from medialis.base.validation import FloatArray
from medialis.formats.files import ParsedMesh, no_polygons, numbers, shown
from medialis.formats.ply import for_each_point

MARK = re.compile(
    rb"(?:[ \t]*#[^\r\n]*[\r\n]+)*[ \t]*(?:VERSION[ \t]+[.\d]+[ \t]*[\r\n]+)?FIELDS[ \t]"
)
"""The first lines of a PCD file: comments, the version, the names of the fields."""

MAX_HEADER_BYTES = 100_000

MAX_LZF_RATIO = 88
"""LZF encodes at most 264 bytes in 3."""

_KINDS = {"F": "f", "I": "i", "U": "u"}
_POSITION, _NORMAL = ("x", "y", "z"), ("normal_x", "normal_y", "normal_z")


@dataclass(frozen=True)
class _Header:
    """Header of a PCD file.

    `record` is the packed dtype of one point, `points` the number of points, `encoding` the kind of
    the body, which starts at byte `body`; `viewpoint` is the sensor position (3,).
    """

    record: np.dtype[Any]
    points: int
    encoding: str
    body: int
    viewpoint: FloatArray


def parse_pcd(data: bytes) -> ParsedMesh:
    """Parse the points of a PCD file, with normals and the viewpoint where it stores them.

    Other fields are ignored. A viewpoint at the origin is the default of the format and counts as
    unknown.

    Raises
    ------
    InvalidShapeError
        If the file is damaged, truncated, or lacks one of the fields x, y, z.
    """
    header = _read_header(data)
    columns = _COLUMNS[header.encoding](data[header.body :], header)
    points = _stacked(columns, _POSITION)
    if points is None:
        names = shown(", ".join(header.record.names or ()).encode("latin-1", "replace"), 100)
        raise InvalidShapeError(f"the PCD file lacks one of the fields x, y, z; it has {names}.")
    place = header.viewpoint[None] if header.viewpoint.any() else np.empty((0, 3))
    viewpoints, messages = for_each_point(points, place)
    ignored = [name for name in columns if name not in (*_POSITION, *_NORMAL) and name[0] != "_"]
    if ignored:
        text = (
            f"Ignored the PCD fields {shown(', '.join(ignored).encode('latin-1', 'replace'), 100)}."
        )
        messages += (Message(text, "columns_ignored", columns=len(ignored)),)
    return ParsedMesh(points, *no_polygons(), _stacked(columns, _NORMAL), messages, viewpoints)


def _read_header(data: bytes) -> _Header:
    """Read the header lines, up to DATA.

    Raises
    ------
    InvalidShapeError
        If a line is missing or cannot be understood.
    """
    end = re.search(
        rb"(?:^|[\r\n])[ \t]*DATA[ \t]+(\w+)[ \t]*(\r\n|\n|\r)", data[:MAX_HEADER_BYTES]
    )
    if end is None:
        raise InvalidShapeError(
            "the PCD header has no line DATA (ascii, binary, binary_compressed)."
        )
    encoding = end[1].decode("latin-1").lower()
    if encoding not in _COLUMNS:
        raise InvalidShapeError(
            f"the PCD file stores its points as {shown(end[1])}; ascii, binary and "
            "binary_compressed can be read."
        )
    entries: dict[str, list[str]] = {}
    for line in re.split(rb"[\r\n]+", data[: end.start()]):
        words = line.decode("latin-1").split()
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
    fields = entries.get("FIELDS", entries.get("COLUMNS", []))
    try:
        sizes = [int(word) for word in entries["SIZE"]]
        kinds = [_KINDS[word.upper()] for word in entries["TYPE"]]
        repeats = [int(word) for word in entries.get("COUNT", ["1"] * len(fields))]
        width, height = int(entries["WIDTH"][0]), int(entries.get("HEIGHT", ["1"])[0])
        points = int(entries["POINTS"][0]) if "POINTS" in entries else width * height
        place = np.array([float(word) for word in entries.get("VIEWPOINT", ["0", "0", "0"])[:3]])
        if not len(fields) == len(sizes) == len(kinds) == len(repeats) or min(repeats) < 1:
            raise ValueError
        if not 0 <= points < 2**63 or max(repeats) >= 2**16 or place.shape != (3,):
            raise ValueError
        types = [np.dtype(f"<{kind}{size}") for kind, size in zip(kinds, sizes, strict=True)]
    except (KeyError, ValueError, IndexError, TypeError):
        raise InvalidShapeError(
            "the PCD header is incomplete or inconsistent: FIELDS, SIZE, TYPE and COUNT need one "
            "entry for each field, WIDTH and HEIGHT (or POINTS) the number of points."
        ) from None
    if not np.isfinite(place).all():
        place = np.zeros(3)
    names = [name if name != "_" else f"_{row}" for row, name in enumerate(fields)]
    if len(set(names)) < len(names):
        raise InvalidShapeError("the PCD header names a field twice.")
    triples = zip(names, types, repeats, strict=True)
    record = np.dtype([(name, kind, (count,)) for name, kind, count in triples])
    return _Header(record, points, encoding, end.end(), place)


def _stacked(columns: dict[str, NDArray[Any]], names: tuple[str, ...]) -> FloatArray | None:
    """Return three fields as the columns of an (n, 3) array; None if one is missing."""
    if not all(name in columns for name in names):
        return None
    with np.errstate(invalid="ignore"):  # signalling NaN in a damaged file
        return np.stack([columns[name][:, 0].astype(np.float64) for name in names], axis=1)


def _ascii_columns(body: bytes, header: _Header) -> dict[str, NDArray[Any]]:
    """Return the fields of points written as text."""
    values = numbers(body, "PCD data")
    widths = [header.record[name].shape[0] for name in header.record.names or ()]
    if len(values) != header.points * sum(widths):
        raise InvalidShapeError(
            f"the PCD header announces {header.points} points of {sum(widths)} numbers, but "
            f"{len(values)} numbers follow."
        )
    rows = values.reshape(header.points, sum(widths))
    parts = np.split(rows, np.cumsum(widths)[:-1], axis=1)
    return dict(zip(header.record.names or (), parts, strict=True))


def _binary_columns(body: bytes, header: _Header) -> dict[str, NDArray[Any]]:
    """Return the fields of points written as packed records."""
    _check_size(len(body), header)
    rows = np.frombuffer(body, header.record, header.points)
    return {name: rows[name] for name in header.record.names or ()}


def _compressed_columns(body: bytes, header: _Header) -> dict[str, NDArray[Any]]:
    """Return the fields of points written as one compressed block, field after field."""
    if len(body) < 8:
        raise InvalidShapeError("the PCD file is truncated: its compressed block is missing.")
    packed_size, size = np.frombuffer(body[:8], "<u4").tolist()
    if len(body) - 8 < packed_size or size > MAX_LZF_RATIO * packed_size:
        raise InvalidShapeError(
            f"the PCD file is truncated or damaged: its compressed block has {len(body) - 8} of "
            f"{packed_size} bytes, for {size} bytes of points."
        )
    _check_size(size, header)
    block, columns, start = _unpacked(body[8 : 8 + packed_size], size), {}, 0
    for name in header.record.names or ():
        kind, (repeats,) = header.record[name].subdtype or (header.record[name], (1,))
        column = np.frombuffer(block, kind, header.points * repeats, start)
        columns[name] = column.reshape(header.points, repeats)
        start += column.nbytes
    return columns


def _check_size(size: int, header: _Header) -> None:
    """Refuse a body that is smaller than the announced points need."""
    needed = header.points * header.record.itemsize
    if size < needed:
        raise InvalidShapeError(
            f"the PCD file is truncated: its header announces {header.points} points, which need "
            f"{needed} bytes, but it has {size}."
        )


_COLUMNS = {
    "ascii": _ascii_columns,
    "binary": _binary_columns,
    "binary_compressed": _compressed_columns,
}


def _unpacked(packed: bytes, size: int) -> NDArray[np.uint8]:
    """Return the `size` bytes of a block that was compressed by LZF.

    Raises
    ------
    InvalidShapeError
        If the block is damaged.
    """
    from medialis.base._lzf_kernels import unpack_lzf

    block = np.empty(size, np.uint8)
    if unpack_lzf(np.frombuffer(packed, np.uint8), block) != size:
        raise InvalidShapeError("the PCD file is damaged: its compressed block cannot be unpacked.")
    return block
