"""The header of PLY files: encoding, comments, and the elements with their properties."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.files._content import shown

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8"},
    **{"float32": "f4", "float64": "f8"},
}


@dataclass
class PlyProperty:
    """A property of an element: a scalar, or a list when `count` is given."""

    name: str
    dtype: np.dtype[Any]
    count: np.dtype[Any] | None = None


@dataclass
class PlyElement:
    """An element of the header."""

    name: str
    rows: int
    by_name: dict[str, PlyProperty] = field(default_factory=dict)

    @property
    def properties(self) -> list[PlyProperty]:
        """Its properties in their order."""
        return list(self.by_name.values())


@dataclass
class PlyHeader:
    """The header: encoding, comments, elements, and where the body starts."""

    encoding: str
    comments: list[str]
    body: int
    by_name: dict[str, PlyElement] = field(default_factory=dict)

    @property
    def elements(self) -> list[PlyElement]:
        """Its elements in their order."""
        return list(self.by_name.values())


def read_ply_header(data: bytes) -> PlyHeader:
    """Read the header lines.

    Raises
    ------
    InvalidShapeError
        When a line makes no sense or the header does not end.
    """
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\n|\r)", data)
    if not end:
        raise InvalidShapeError("the PLY header does not end with a line 'end_header'.")
    header = PlyHeader("", [], end.end())
    element: PlyElement | None = None
    for line in re.split(rb"[\r\n]+", data[: end.start()])[1:]:
        try:
            element = _header_line(header, element, line.decode("latin-1"))
        except (ValueError, KeyError, IndexError):
            raise InvalidShapeError(
                f"the PLY header line {shown(line)} cannot be understood."
            ) from None
    if header.encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise InvalidShapeError(
            f"the PLY format is {shown(header.encoding.encode('latin-1'))}; ascii, "
            "binary_little_endian and binary_big_endian are supported."
        )
    return header


def _header_line(header: PlyHeader, element: PlyElement | None, line: str) -> PlyElement | None:
    """Take in a line; return the element that the properties after it belong to."""
    words = line.split()
    if not words or words[0] == "obj_info":
        return element
    if words[0] == "comment":
        header.comments.append(line.strip()[len("comment") :].strip())
    elif words[0] == "format":
        header.encoding = words[1]
    elif words[0] == "element":
        rows = int(words[2])
        if not 0 <= rows < 2**63 or words[1] in header.by_name:
            raise ValueError
        element = header.by_name[words[1]] = PlyElement(words[1], rows)
    elif words[0] == "property":
        new = PlyProperty(words[-1], np.dtype(_TYPES[words[-2]]))
        if words[1] == "list":
            new.count = np.dtype(_TYPES[words[2]])
            if len(words) != 5 or new.count.kind == "f":
                raise ValueError
        elif len(words) != 3:
            raise ValueError
        if element is None or new.name in element.by_name:
            raise ValueError
        element.by_name[new.name] = new
    else:
        raise ValueError
    return element
