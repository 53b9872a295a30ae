"""Read VTK's XML PolyData (.vtp): points, polygons and triangle strips.

Arrays may be text, base64 or raw, inline or appended, and compressed by zlib or LZMA. Sizes in the
file are compared with what it contains before memory is allocated for them. This runs in the child
process that `foreign.py` starts.

Source: VTK File Formats (https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html).
"""

from __future__ import annotations

import base64
import binascii
import lzma
import re
import zlib
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Message, counted
from medialis.base.validation import FloatArray
from medialis.formats.files import ParsedMesh, numbers, whole

MARK = re.compile(rb"\s*(?:<\?xml[^>]*>\s*)?(?:<!--.*?-->\s*)*<VTKFile\b([^>]*)>", re.DOTALL)
"""The beginning of a VTK XML file, with the attributes of its first element."""

_RAW = re.compile(rb"<AppendedData\b[^>]*\bencoding\s*=\s*[\"']raw[\"'][^>]*>\s*_")

_TYPES = {f"{kind}{8 * size}": f"{code}{size}" for kind, code in (("Int", "i"), ("UInt", "u"))
          for size in (1, 2, 4, 8)} | {"Float32": "f4", "Float64": "f8"}  # fmt: skip

_COMPRESSORS = {"vtkZLibDataCompressor": "zlib", "vtkLZMADataCompressor": "lzma"}

MAX_RATIO = {"zlib": 1100, "lzma": 10_000}
"""Bytes that one compressed byte can stand for, at most."""

_CELLS = ("Lines", "Strips", "Polys")


@dataclass
class _Array:
    """A DataArray element: its attributes, and its text where the numbers are inline."""

    about: dict[str, str]
    text: list[str] = field(default_factory=list)


@dataclass
class _Piece:
    """A piece: its arrays by section (Points, Polys, ...) and name, and its attributes."""

    about: dict[str, str]
    arrays: dict[tuple[str, str], _Array] = field(default_factory=dict)
    normals: str = ""


class _Reader:
    """Collects the pieces of a file, and decodes their arrays."""

    def __init__(self, data: bytes) -> None:
        self.pieces: list[_Piece] = []
        self.about: dict[str, str] = {}
        self._section = ""
        self._array: _Array | None = None
        self._inner = 0  # elements within a DataArray, such as InformationKey
        self._appended: list[str] | None = None
        self._raw: bytes | None = None
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = _refuse_doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._take_text
        try:
            if raw := _RAW.search(data):
                self._raw = data[raw.end() :]
                parser.Parse(data[: raw.start()], False)  # what follows is not XML
            else:
                parser.Parse(data, True)
        except expat.ExpatError as error:
            raise InvalidShapeError(f"its XML is damaged or truncated ({error}).") from None
        appended = "".join(self._appended or ()).strip().removeprefix("_")
        self._appended_text = "".join(appended.split()).encode("ascii", "replace")
        kind = self.about.get("type", "")
        if kind != "PolyData":
            raise InvalidShapeError(
                f"it stores VTK's {kind[:40] or 'nothing'}, not PolyData: save its surface as .vtp."
            )
        compressor = self.about.get("compressor", "")
        if compressor and compressor not in _COMPRESSORS:
            raise InvalidShapeError(
                f"it is compressed by {compressor[:40]}; zlib and LZMA can be read: save it so."
            )
        self._compression = _COMPRESSORS.get(compressor, "")
        self._order = ">" if self.about.get("byte_order") == "BigEndian" else "<"
        size = "8" if self.about.get("header_type") == "UInt64" else "4"
        self._header = np.dtype(f"{self._order}u{size}")

    def _start(self, name: str, about: dict[str, str]) -> None:
        if self._array is not None:
            self._inner += 1
        elif name == "VTKFile":
            self.about = about
        elif name == "Piece":
            self.pieces.append(_Piece(about))
        elif name in ("Points", "PointData", *_CELLS):
            self._section = name
            if name == "PointData" and self.pieces:
                self.pieces[-1].normals = about.get("Normals", "")
        elif name == "DataArray" and self._section and self.pieces:
            self._array = _Array(about)
            key = "" if self._section == "Points" else about.get("Name", "")
            self.pieces[-1].arrays[self._section, key] = self._array
        elif name == "AppendedData":
            self._appended = []

    def _end(self, name: str) -> None:
        if self._inner:
            self._inner -= 1
        elif name == self._section:
            self._section = ""
        elif name == "DataArray":
            self._array = None

    def _take_text(self, text: str) -> None:
        if self._array is not None:
            if self._inner:
                return
            if self._section != "PointData" or self._is_normals():
                self._array.text.append(text)
        elif self._appended is not None:
            self._appended.append(text)

    def _is_normals(self) -> bool:
        return (self._array.about.get("Name") if self._array else None) == self.pieces[-1].normals

    def array(self, piece: _Piece, section: str, name: str = "") -> NDArray[Any] | None:
        """Return the numbers of an array, flat; None if the piece lacks it.

        Raises
        ------
        InvalidShapeError
            If its type is unknown, or its data are damaged or truncated.
        """
        found = piece.arrays.get((section, name))
        if found is None:
            return None
        kind = _TYPES.get(found.about.get("type", ""))
        if kind is None:
            raise InvalidShapeError(
                f"an array has the type {found.about.get('type', 'none')[:40]!r}, which is no type "
                "of numbers."
            )
        layout = found.about.get("format", "ascii")
        if layout == "ascii":
            return numbers("".join(found.text).encode("latin-1", "replace"), f"VTK {section} array")
        dtype = np.dtype(f"{self._order}{kind}")
        try:
            content = self._content(found, layout)
        except (binascii.Error, zlib.error, lzma.LZMAError, ValueError, IndexError):
            raise InvalidShapeError(
                f"the data of its {section} are damaged or truncated."
            ) from None
        return np.frombuffer(content, dtype, len(content) // dtype.itemsize)

    def _content(self, found: _Array, layout: str) -> bytes:
        """Return the bytes of an array, decoded and decompressed; ValueError if truncated."""
        stream = self._stream(found, layout)
        word = self._header.itemsize
        if not self._compression:
            return stream.sized(self._header)
        blocks = int(np.frombuffer(stream.peek(word), self._header)[0])
        if blocks == 0:
            return b""
        head = np.frombuffer(stream.read((3 + blocks) * word), self._header).tolist()
        block_size, last, sizes = head[1], head[2], head[3:]
        packed, parts, at = stream.read(sum(sizes)), [], 0
        for row, size in enumerate(sizes):
            wanted = last if last and row == blocks - 1 else block_size
            parts.append(_unpacked(packed[at : at + size], wanted, self._compression))
            at += size
        return b"".join(parts)

    def _stream(self, found: _Array, layout: str) -> _Stream:
        if layout == "binary":
            return _Stream(
                "".join("".join(found.text).split()).encode("ascii", "replace"), 0, encoded=True
            )
        start = int(found.about["offset"]) if "offset" in found.about else -1
        if layout != "appended" or start < 0:
            raise ValueError
        if self._raw is not None:
            return _Stream(self._raw, start, encoded=False)
        return _Stream(self._appended_text, start, encoded=True)


@dataclass
class _Stream:
    """Bytes of a file from position `at` on, as they are or encoded as base64."""

    content: bytes
    at: int
    encoded: bool

    def peek(self, size: int) -> bytes:
        """Return the next `size` bytes; ValueError if there are fewer."""
        if not self.encoded:
            found = self.content[self.at : self.at + size]
        else:
            text = self.content[self.at : self.at + 4 * -(-size // 3)]
            found = base64.b64decode(text, validate=True)[:size]
        if len(found) < size:
            raise ValueError
        return found

    def read(self, size: int) -> bytes:
        """Return the next `size` bytes, a base64 segment of their own, and move behind them."""
        found = self.peek(size)
        self.at += 4 * -(-size // 3) if self.encoded else size
        return found

    def sized(self, header: np.dtype[Any]) -> bytes:
        """Return bytes that their number precedes, in the same base64 segment or in one before."""
        word = header.itemsize
        head = self.content[self.at : self.at + 4 * -(-word // 3)]
        size = int(np.frombuffer(self.peek(word), header)[0])
        if self.encoded and b"=" in head and size:
            self.read(word)
            return self.read(size)
        return self.read(word + size)[word:]


def _unpacked(packed: bytes, size: int, how: str) -> bytes:
    """Return the `size` bytes of a compressed block; ValueError if it holds another number."""
    if size > MAX_RATIO[how] * len(packed):
        raise ValueError
    if how == "zlib":
        found = zlib.decompressobj().decompress(packed, size)
    else:
        found = lzma.LZMADecompressor().decompress(packed, size)
    if len(found) != size:
        raise ValueError
    return found


def _refuse_doctype(*_: object) -> None:
    raise InvalidShapeError("its XML defines a document type, which VTK files do not have.")


def parse_vtp(data: bytes) -> ParsedMesh:
    """Parse the points, polygons and triangle strips of a .vtp file, and normals of points.

    A file without polygons and strips, such as a centerline, is a point cloud.

    Raises
    ------
    InvalidShapeError
        If the file is damaged or truncated, is compressed by LZ4, or stores other VTK data.
    """
    reader = _Reader(data)
    points, normals, start, lines = [np.empty((0, 3))], [], 0, 0
    counts, corners = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for piece in reader.pieces:
        given = reader.array(piece, "Points")
        own = np.empty((0, 3)) if given is None else _rows_of_three(given, "points")
        announced = piece.about.get("NumberOfPoints", "0")
        if announced != str(len(own)):
            raise InvalidShapeError(
                f"it is damaged or truncated: it announces {announced[:20]} points, but has "
                f"{len(own)}."
            )
        for section, split in (("Polys", _as_given), ("Strips", _strip_triangles)):
            sizes, rows = split(*_cells(reader, piece, section, len(own)))
            counts.append(sizes)
            corners.append(rows + start)
        lines += len(_cells(reader, piece, "Lines", len(own))[0])
        own_normals = reader.array(piece, "PointData", piece.normals) if piece.normals else None
        if own_normals is not None and len(own_normals) == 3 * len(own):
            normals.append(_rows_of_three(own_normals, "normals"))
        points.append(own)
        start += len(own)
    messages: tuple[Message, ...] = ()
    if lines:
        text = f"Ignored {counted(lines, 'line')} of the VTK file; their points are kept."
        messages = (Message(text, "lines_ignored", lines=lines),)
    whole_normals = np.concatenate(normals) if normals else np.empty((0, 3))
    return ParsedMesh(
        np.concatenate(points), np.concatenate(counts), np.concatenate(corners),
        whole_normals if len(whole_normals) == start and start else None, messages,
    )  # fmt: skip


def _rows_of_three(values: NDArray[Any], what: str) -> FloatArray:
    if len(values) % 3:
        raise InvalidShapeError(f"its {what} are damaged: {len(values)} is no multiple of 3.")
    with np.errstate(invalid="ignore"):
        return values.reshape(-1, 3).astype(np.float64)


def _cells(
    reader: _Reader, piece: _Piece, section: str, count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of corners of each cell, and all corners.

    Raises
    ------
    InvalidShapeError
        If offsets decrease or exceed the corners, or a corner is not one of the `count` points.
    """
    ends = reader.array(piece, section, "offsets")
    corners = reader.array(piece, section, "connectivity")
    if ends is None or corners is None or not len(ends):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    ends = whole(ends, f"VTK {section} offsets").astype(np.int64)
    corners = whole(corners, f"VTK {section}").astype(np.int64)
    sizes = np.diff(ends, prepend=0)
    if (sizes < 0).any() or ends[-1] != len(corners):
        raise InvalidShapeError(
            f"the offsets of its {section} do not fit their {len(corners)} corners."
        )
    if len(corners) and not 0 <= corners.min() <= corners.max() < count:
        raise InvalidShapeError(f"its {section} name points beyond the {count} of their piece.")
    return sizes, corners


def _as_given(
    sizes: NDArray[np.int64], corners: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return sizes, corners


def _strip_triangles(
    sizes: NDArray[np.int64], corners: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles of strips: each corner from the third on makes one with the two before.

    Every second triangle is reversed, so that all face the same side.
    """
    made = np.maximum(sizes - 2, 0)
    step = np.arange(int(made.sum())) - np.repeat(np.cumsum(made) - made, made)
    first = np.repeat(np.cumsum(sizes) - sizes, made) + step
    rows = first[:, None] + np.arange(3)
    odd = step % 2 == 1
    rows[odd] = rows[odd][:, [1, 0, 2]]
    return np.full(len(rows), 3, np.int64), corners[rows].ravel()
