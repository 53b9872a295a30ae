"""STL in: binary and ascii triangle soup; `medialis.surface.repair` welds its vertices."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.files._content import ParsedMesh, numbers_by_line, places_of, unix_lines
from medialis.progress import Message

_HEADER = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def is_binary_stl(data: bytes) -> bool:
    """Return whether the size is exactly that of the announced facets (also after "solid")."""
    return len(data) >= _HEADER and len(data) == _HEADER + _FACET.itemsize * _announced(data)


def is_ascii_stl(data: bytes) -> bool:
    """Return whether the text starts like an ascii STL and holds a facet or an end."""
    start = data[:400].lstrip().lower()
    return start.startswith(b"solid") and bool(
        re.search(rb"(?i)\bfacet\s+normal\b|\bendsolid\b", data[:100_000])
    )


def parse_stl(data: bytes) -> ParsedMesh:
    """Parse facets; their normals and attributes are ignored, three new vertices for each.

    Raises
    ------
    InvalidShapeError
        When the file is damaged, cut short or has no facets.
    """
    if not is_binary_stl(data) and is_ascii_stl(data):
        return _soup(_ascii_corners(data), ())
    return _parse_binary(data)


def _announced(data: bytes) -> int:
    return int.from_bytes(data[80:84], "little")


def _parse_binary(data: bytes) -> ParsedMesh:
    if len(data) < _HEADER:
        raise InvalidShapeError(
            f"an STL file is text that starts with 'solid' or has a header of {_HEADER} bytes; "
            f"this file has {len(data)} bytes."
        )
    announced, found = _announced(data), (len(data) - _HEADER) // _FACET.itemsize
    if found < announced:
        raise InvalidShapeError(
            f"the file is cut short: the STL header announces {announced} faces, "
            f"only {found} were found."
        )
    extra = len(data) - _HEADER - announced * _FACET.itemsize
    text = f"Ignored {extra} bytes after the last STL face."
    messages = (Message(text, "bytes_ignored", bytes=extra),) if extra else ()
    facets = np.frombuffer(data, _FACET, count=announced, offset=_HEADER)
    with np.errstate(invalid="ignore"):  # signalling NaN in a damaged file
        return _soup(facets["corners"].astype(np.float64).reshape(-1, 3), messages)


def _ascii_corners(data: bytes) -> NDArray[np.float64]:
    text = unix_lines(data)
    lines = places_of(rb"(?im)^[ \t]*vertex[ \t]([^\n]*)", text)
    facets = len(places_of(rb"(?im)^[ \t]*facet\b", text))
    values, counts = numbers_by_line(b"\n".join(lines), "STL vertices")
    if len(counts) != len(lines) or (counts != 3).any():
        raise InvalidShapeError("expected three numbers for each STL vertex.")
    if len(lines) != 3 * facets or not re.search(rb"(?i)\bendsolid\b", text[-100_000:]):
        raise InvalidShapeError(
            f"the file is cut short or damaged: {facets} STL faces with {len(lines)} vertices "
            "(three each are needed) and a last line 'endsolid' were expected."
        )
    return values.reshape(-1, 3)


def _soup(points: NDArray[np.float64], messages: tuple[Message, ...]) -> ParsedMesh:
    if len(points) == 0:
        raise InvalidShapeError("the STL file has no faces.")
    counts = np.full(len(points) // 3, 3, np.int64)
    return ParsedMesh(points, counts, np.arange(len(points)), None, messages)
