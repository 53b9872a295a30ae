"""Meshes as text, and STL: OFF, OBJ, STL. Lists of points are read by `point_texts`.

Each parser takes the bytes of a file. Lines of OBJ are told apart by their first characters in
numpy, the bytes of all lines of one kind are joined, and each kind is parsed as one block of
numbers. STL gives three new vertices for each facet; `medialis.shape.repair` welds them.
"""

from __future__ import annotations

import os
import re

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import corner_vectors, sums_of, unit_rows
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.progress import Message
from medialis.formats.files import (
    Drawn,
    ParsedMesh,
    blocks,
    complete_file,
    numbers,
    numbers_by_line,
    places_of,
    ragged_rows,
    replaced,
    rows_of,
    unix_lines,
    whole,
    without_comments,
    write_lines,
)

KEYWORD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF")


def parse_off(data: bytes) -> ParsedMesh:
    """Parse vertices, normals and polygons; colours and texture coordinates are ignored.

    Raises
    ------
    InvalidShapeError
        When the file is binary, four-dimensional, damaged or cut short.
    """
    text = without_comments(unix_lines(data))
    keyword = KEYWORD.match(text)
    has_normals = False
    if keyword:
        if keyword[4] or keyword[5]:
            raise InvalidShapeError("the OFF file is not three-dimensional (4OFF or nOFF).")
        has_normals = bool(keyword[3])
        text = text[keyword.end() :]
        if re.match(rb"\s*BINARY", text):
            raise InvalidShapeError("binary OFF is not supported; save it as text OFF or PLY.")
    values, words = numbers_by_line(text, "OFF data")
    if len(words) == 0 or words[0] < 2:
        raise InvalidShapeError("the OFF file does not start with its vertex and face counts.")
    n, m = (int(v) for v in whole(values[:2], "OFF counts"))
    if n < 0 or m < 0:
        raise InvalidShapeError(f"the OFF file announces {n} vertices and {m} faces.")
    starts = np.cumsum(words) - words
    found = len(words) - 1
    if found < n + m:
        raise InvalidShapeError(
            f"the file is cut short: the OFF header announces {n} vertices and {m} faces, only "
            f"{min(found, n)} vertices and {max(found - n, 0)} faces were found."
        )
    width, of_vertex, of_face = 6 if has_normals else 3, words[1 : n + 1], words[n + 1 :][:m] - 1
    if (of_vertex < width).any():
        row = int((of_vertex < width).argmax())
        raise InvalidShapeError(
            f"expected at least {width} numbers for each OFF vertex, vertex {row} has "
            f"{of_vertex[row]}."
        )
    rows = rows_of(values[words[0] :][: of_vertex.sum()], of_vertex, width)
    first = starts[n + 1 :][:m]
    counts = whole(values[first], "OFF face sizes")
    bad = (counts < 0) | (counts > of_face)
    if bad.any():
        row = int(bad.argmax())
        raise InvalidShapeError(
            f"OFF face {row} announces {counts[row]} corners, its line has {of_face[row]} numbers."
        )
    corners = whole(values[ragged_rows(first + 1, counts)], "OFF faces")
    normals = rows[:, 3:6] if has_normals else None
    return ParsedMesh(rows[:, :3], counts, corners, normals)


def parse_obj(data: bytes) -> ParsedMesh:
    """Parse v, vn and f lines; colours, weights, lines, points and materials are ignored.

    Raises
    ------
    InvalidShapeError
        When there are no vertices or a line cannot be understood.
    """
    text = _plain_lines(data)
    lines = _Lines(text)
    points = _triples(lines.block(lines.vertex), "OBJ vertices (v)")
    if len(points) == 0:
        raise InvalidShapeError("the OBJ file has no vertices (no line 'v x y z').")
    vectors = _triples(lines.block(lines.normal), "OBJ normals (vn)")
    block = lines.block(lines.face)
    corners_only = replaced(rb"/[^\s]*", b"", block) if b"/" in block else block
    values, counts = numbers_by_line(corners_only, "OBJ faces (f)", keep_empty=True)
    counts = counts[:-1]  # the block ends with a line end
    defined = np.cumsum(lines.vertex)[lines.face]
    corners = _from_obj_index(values, np.repeat(defined, counts), "OBJ faces (f)")
    normals = None
    if len(vectors):
        seen = np.cumsum(lines.normal)[lines.face]
        normals = _vertex_normals(block, corners, np.repeat(seen, counts), vectors, len(points))
    return ParsedMesh(points, counts, corners, normals)


def _plain_lines(data: bytes) -> bytes:
    text = without_comments(unix_lines(data))
    if b"\\" in text:
        text = re.sub(rb"\\[ \t]*\n", b" ", text)
    if any(re.search(rb"(?m)^[ \t]+\S", block) for block in blocks(text)):
        text = replaced(rb"(?m)^[ \t]+", b"", text)
    return text.replace(b"\t", b" ") + b"\n   "


class _Lines:
    """The lines of a text by kind: boolean (lines,) masks, and the bytes of a kind."""

    def __init__(self, text: bytes) -> None:
        self.bytes = np.frombuffer(text, np.uint8)
        ends = np.flatnonzero(self.bytes == 10)
        self.start = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else np.array([0])
        self.length = np.diff(np.append(self.start, len(text) - 3))
        # The padding of three blanks at the end keeps start + 2 in range.
        first, second, third = (self.bytes[self.start + i] for i in range(3))
        blank = second <= 32
        self.vertex = (first == ord("v")) & blank
        self.normal = (first == ord("v")) & (second == ord("n")) & (third <= 32)
        self.face = (first == ord("f")) & blank

    def block(self, kind: NDArray[np.bool_]) -> bytes:
        """Return the lines of a kind with their keyword blanked out."""
        keep = np.repeat(kind, self.length)
        text = self.bytes[: len(keep)].copy()
        text[self.start[kind]] = 32
        named = self.start[kind & self.normal]
        text[named + 1] = 32
        return text[keep].tobytes()


def _triples(block: bytes, what: str) -> NDArray[np.float64]:
    values, counts = numbers_by_line(block, what)
    if (counts < 3).any():
        row = int((counts < 3).argmax())
        raise InvalidShapeError(
            f"expected at least 3 numbers in the {what}, found {counts[row]} in number {row + 1}."
        )
    return rows_of(values, counts, 3)


def _from_obj_index(
    values: NDArray[np.float64], defined: NDArray[np.int64], what: str
) -> NDArray[np.int64]:
    """Return indices from 0: OBJ counts from 1, and negative ones back from the last defined."""
    index = whole(values, what)
    if (index == 0).any():
        raise InvalidShapeError(f"the {what} name vertex 0, but OBJ files count from 1.")
    if (index < 0).any():
        index = np.where(index < 0, index + defined, index - 1)
        if (index < 0).any():
            raise InvalidShapeError(f"the {what} count back beyond the first vertex.")
        return index
    return index - 1


def _vertex_normals(
    block: bytes,
    corners: NDArray[np.int64],
    seen: NDArray[np.int64],
    vectors: NDArray[np.float64],
    n: int,
) -> NDArray[np.float64] | None:
    """Return the sum of the normals that a vertex has at its corners (several at a sharp edge)."""
    if len(corners) == 0:
        return vectors if len(vectors) == n else None
    # From the start of a word, and no part takes a slash: a word of many slashes costs no more.
    words = places_of(rb"(?<!\S)[^\s/]+/[^\s/]*/([-+]?\d+)(?=\s)", block)
    if len(words) != len(corners):
        return None
    index = _from_obj_index(numbers(b" ".join(words), "OBJ normal indices"), seen, "OBJ normals")
    if (corners >= n).any() or (index >= len(vectors)).any():
        return None
    with np.errstate(all="ignore"):
        return sums_of(corners, vectors[index], n)


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


def _rows(mark: str, rows: NDArray[np.generic]) -> list[str]:
    """Lines of numbers, each with all its digits, behind a mark."""
    return [mark + " ".join(map(repr, row)) for row in rows.tolist()]


def write_obj(path: str | os.PathLike[str], layer: Drawn, *, unit: str | None = None) -> None:
    """Write points, triangles and edges as OBJ, with all digits; a comment says the unit.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    lines = [f"# lengths in {unit}"] if unit else []
    lines += _rows("v ", layer.points)
    for mark, rows in (("f ", layer.faces), ("l ", layer.edges)):
        lines += [] if rows is None else _rows(mark, rows + 1)
    write_lines(path, lines)


def write_off(path: str | os.PathLike[str], layer: Drawn) -> None:
    """Write points and triangles as OFF, as `write_obj`."""
    faces = np.empty((0, 3), np.int32) if layer.faces is None else layer.faces
    counts = f"{len(layer.points)} {len(faces)} 0"
    write_lines(path, ["OFF", counts, *_rows("", layer.points), *_rows("3 ", faces)])


def write_stl(path: str | os.PathLike[str], layer: Drawn) -> None:
    """Write triangles as binary STL.

    Raises
    ------
    InvalidOptionError
        When there are none.
    FileError
        When the file cannot be written.
    """
    if layer.faces is None:
        raise InvalidOptionError("STL holds triangles only; write points as PLY, OBJ or OFF.")
    table = np.zeros(len(layer.faces), _FACET)
    table["normal"] = unit_rows(corner_vectors(layer.points, layer.faces))
    table["corners"] = layer.points[layer.faces]
    head = b"medialis".ljust(80) + np.uint32(len(table)).tobytes()
    with complete_file(path) as stream:
        stream.write(head + table.tobytes())
