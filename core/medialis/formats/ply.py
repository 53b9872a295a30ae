"""PLY in: ascii and binary, any element, any property, lists of any length; viewpoints of scans.

Strategy: both encodings are seen as one flat stream - of bytes, or of numbers for ascii - through
which elements are walked by the same code. An element whose lists all have the length of its first
row (a triangle mesh) is one numpy view; otherwise one light pass over the rows finds where each
list starts, and everything is gathered at once. Counts in the header are never trusted with
memory: they are held against what the stream can contain first.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Message, counted
from medialis.formats.files import ParsedMesh, no_polygons, numbers, ragged_rows, shown, whole

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8"},
    **{"float32": "f4", "float64": "f8"},
}
_FRACTIONS = ("float", "double", "float32", "float64")


@dataclass
class PlyProperty:
    """A property of an element: a scalar, or a list when `count` is given."""

    name: str
    dtype: np.dtype[Any]
    count: np.dtype[Any] | None = None

    def stored(self, encoding: str) -> PlyProperty:
        """Return it in the order of bytes of a file; in a text all numbers are read as doubles."""
        if encoding == "ascii":
            double = np.dtype(np.float64)
            return PlyProperty(self.name, double, self.count and double)
        order: Literal["<", ">"] = ">" if encoding == "binary_big_endian" else "<"
        count = self.count and self.count.newbyteorder(order)
        return PlyProperty(self.name, self.dtype.newbyteorder(order), count)


@dataclass
class PlyElement:
    """An element of the header."""

    name: str
    rows: int
    by_name: dict[str, PlyProperty] = field(default_factory=dict)


@dataclass
class PlyHeader:
    """The header: encoding, comments, elements, and where the body starts."""

    encoding: str
    comments: list[str]
    body: int
    by_name: dict[str, PlyElement] = field(default_factory=dict)


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
        text = line.decode("latin-1")
        try:
            match text.split():
                case [] | ["obj_info", *_]:
                    pass
                case ["comment", *_]:
                    header.comments.append(text.strip().removeprefix("comment").strip())
                case ["format", encoding, *_]:
                    header.encoding = encoding
                case ["element", name, rows, *_] if name not in header.by_name:
                    element = header.by_name[name] = PlyElement(name, int(rows))
                case ["property", kind, name] if element and name not in element.by_name:
                    element.by_name[name] = PlyProperty(name, np.dtype(_TYPES[kind]))
                case ["property", "list", count, kind, name] if element and (
                    name not in element.by_name and count not in _FRACTIONS
                ):
                    types = np.dtype(_TYPES[kind]), np.dtype(_TYPES[count])
                    element.by_name[name] = PlyProperty(name, *types)
                case _:
                    raise ValueError
            if element and not 0 <= element.rows < 2**63:
                raise ValueError
        except (ValueError, KeyError):
            raise InvalidShapeError(
                f"the PLY header line {shown(line)} cannot be understood."
            ) from None
    if header.encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise InvalidShapeError(
            f"the PLY format is {shown(header.encoding.encode('latin-1'))}; ascii, "
            "binary_little_endian and binary_big_endian are supported."
        )
    return header


_SAID = re.compile(r"(?i)^\W*(?:viewpoint|(?:scanner|sensor)[ _](?:position|origin))\b[\s:=]*(.*)$")


def said_viewpoints(comments: Iterable[str]) -> NDArray[np.float64]:
    """Return the positions in comments such as `VIEWPOINT x y z`, (v, 3).

    What follows x y z, a direction in files of the Point Cloud Library, is passed over.

    Examples
    --------
    >>> said_viewpoints(["VIEWPOINT 0 1.5 2 1 0 0 0", "scanner position: 4 5 6", "viewpoint lost"])
    array([[0. , 1.5, 2. ],
           [4. , 5. , 6. ]])
    """
    places = []
    for comment in comments:
        if said := _SAID.match(comment):
            try:
                place = [float(word) for word in re.split(r"[\s,;]+", said[1].strip())[:3]]
            except ValueError:
                continue
            if len(place) == 3 and np.isfinite(place).all():
                places.append(place)
    return np.array(places).reshape(-1, 3)


def for_each_point(
    points: NDArray[np.float64], places: NDArray[np.float64]
) -> tuple[NDArray[np.float64] | None, tuple[Message, ...]]:
    """Return the viewpoint of each point, the nearest of several, and what to tell."""
    if len(places) == 0:
        return None, ()
    nearest, least = np.zeros(len(points), np.intp), np.full(len(points), np.inf)
    for i, place in enumerate(places):
        with np.errstate(all="ignore"):  # points may be NaN or huge
            distance = np.abs(points - place).max(axis=1)
        closer = distance < least
        nearest[closer], least[closer] = i, distance[closer]
    text = f"The file names {counted(len(places), 'viewpoint')}."
    if len(places) > 1:
        text += " Each point is taken as seen from the nearest one."
    return places[nearest], (Message(text, "viewpoints", viewpoints=len(places)),)


@dataclass(eq=False)
class PlyList:
    """A list property: `counts` items for each row, all `items` one after another."""

    counts: NDArray[np.int64]
    items: NDArray[Any]


PlyTable = dict[str, "NDArray[Any] | PlyList"]


def parse_ply(data: bytes) -> ParsedMesh:
    """Parse a PLY file's vertices, normals, polygons and viewpoints; the rest is passed over.

    Viewpoints are the vertex properties vp_x, vp_y, vp_z, comments such as `VIEWPOINT x y z`, or
    the element `camera`, which the Point Cloud Library writes with zeros when it has none.

    Raises
    ------
    InvalidShapeError
        When the file is damaged, cut short, or has no vertices.
    """
    header, tables = read_ply_elements(data)
    vertices = tables.get("vertex")
    if vertices is None:
        raise InvalidShapeError("the PLY header has no element 'vertex'.")
    points = ply_columns(vertices, ("x", "y", "z"))
    if points is None:
        raise InvalidShapeError("the PLY vertices lack one of the properties x, y, z.")
    if "tristrips" in tables:
        raise InvalidShapeError(
            "the PLY file stores triangle strips, which are not supported; save it with faces."
        )
    counts, corners = _polygons(tables.get("face", {}))
    told: tuple[Message, ...] = ()
    viewpoints = ply_columns(vertices, ("vp_x", "vp_y", "vp_z"))
    if viewpoints is None:
        places = said_viewpoints(header.comments)
        camera = ply_columns(tables.get("camera", {}), ("view_px", "view_py", "view_pz"))
        if len(places) == 0 and camera is not None:
            places = camera[camera.any(axis=1) & np.isfinite(camera).all(axis=1)]
        viewpoints, told = for_each_point(points, places)
    normals = ply_columns(vertices, ("nx", "ny", "nz"))
    return ParsedMesh(points, counts, corners, normals, told, viewpoints)


def ply_columns(table: PlyTable, names: tuple[str, ...]) -> NDArray[np.float64] | None:
    """Return scalar properties side by side, (rows, names) float64; None when one is missing."""
    columns = [table.get(name) for name in names]
    if any(column is None or isinstance(column, PlyList) for column in columns):
        return None
    result = np.empty((len(columns[0]), len(names)))  # type: ignore[arg-type]
    with np.errstate(invalid="ignore"):  # signalling NaN in a damaged file
        for i, column in enumerate(columns):
            result[:, i] = column  # type: ignore[assignment]
    return result


def _polygons(table: PlyTable) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    for name in ("vertex_indices", "vertex_index"):
        polygons = table.get(name)
        if isinstance(polygons, PlyList):
            return polygons.counts, whole(polygons.items, "PLY face indices")
    if any(len(t.counts if isinstance(t, PlyList) else t) for t in table.values()):
        raise InvalidShapeError("the PLY faces lack the list property 'vertex_indices'.")
    return no_polygons()


def read_ply_elements(data: bytes) -> tuple[PlyHeader, dict[str, PlyTable]]:
    """Read all elements: for each element name, each property's column or list.

    Raises
    ------
    InvalidShapeError
        When the header makes no sense or the body is cut short.
    """
    header = read_ply_header(data)
    stream: NDArray[Any]
    if header.encoding == "ascii":
        stream = numbers(data[header.body :], "PLY data")
    else:
        stream = np.frombuffer(data, np.uint8, offset=header.body)
    tables: dict[str, PlyTable] = {}
    at = 0
    for element in header.by_name.values():
        stored = [one.stored(header.encoding) for one in element.by_name.values()]
        tables[element.name], at = _read_element(stream, at, element, stored)
    if header.encoding == "ascii" and at != len(stream):
        raise InvalidShapeError(
            f"the PLY header announces {at} numbers, but {len(stream)} follow it."
        )
    return header, tables


def _read_element(
    stream: NDArray[Any], at: int, element: PlyElement, stored: list[PlyProperty]
) -> tuple[PlyTable, int]:
    """Read the rows of one element from position `at`; return its columns and where it ends."""
    if not stored:
        return {}, at
    lists = [one for one in stored if one.count]
    least = sum((one.count or one.dtype).itemsize for one in stored) // stream.itemsize
    room = (len(stream) - at) // least
    if room < element.rows and not lists:
        raise _cut_short(element, room)
    lengths = _first_lengths(stream, at, stored) if element.rows else [0] * len(lists)
    if lengths is not None:
        # As if all lists were as long as in the first row.
        parts = _row_parts(stored, lengths)
        size = sum(kind.itemsize * width for _, kind, (width,) in parts) // stream.itemsize
        end = at + element.rows * size
        if end <= len(stream):
            rows = stream[at:end].view(np.dtype(parts))
            if all((rows[_count(p)] == k).all() for p, k in zip(lists, lengths, strict=True)):
                return {one.name: _even_column(rows, one) for one in stored}, end
    return _read_uneven(stream, at, element, stored)


def _cut_short(element: PlyElement, found: int) -> InvalidShapeError:
    other = f"rows of {shown(element.name.encode('latin-1'))}"
    plural = {"vertex": "vertices", "face": "faces"}.get(element.name, other)
    return InvalidShapeError(
        f"the file is cut short: the PLY header announces {element.rows} {plural}, "
        f"only {found} were found."
    )


def _length(stream: NDArray[Any], at: int, kind: np.dtype[Any]) -> int | None:
    """Return the length of a list at a position, or None when the stream ends before it."""
    end = at + kind.itemsize // stream.itemsize
    if end > len(stream):
        return None
    value = stream[at:end].view(kind)[0]
    if kind.kind == "f" and value != np.rint(value):
        raise InvalidShapeError(f"a PLY list has a count of {float(value):g}.")
    if value < 0:
        raise InvalidShapeError(f"a PLY list has a count of {int(value)}.")
    return int(value) if np.isfinite(value) else None


def _first_lengths(stream: NDArray[Any], at: int, stored: list[PlyProperty]) -> list[int] | None:
    """Return the list lengths in the row at a position, or None when the stream ends in it."""
    lengths = []
    for one in stored:
        unit = one.dtype.itemsize // stream.itemsize
        if one.count:
            length = _length(stream, at, one.count)
            if length is None:
                return None
            lengths.append(length)
            at += one.count.itemsize // stream.itemsize + length * unit
        else:
            at += unit
    return lengths if at <= len(stream) else None


def _count(one: PlyProperty) -> str:
    """Return the name of the column with the lengths of a list; no property can have it."""
    return f"{one.name} count"


def _row_parts(
    stored: list[PlyProperty], lengths: list[int]
) -> list[tuple[str, np.dtype[Any], tuple[int]]]:
    """Return the columns of a row whose lists have these lengths."""
    left, parts = iter(lengths), []
    for one in stored:
        if one.count:
            parts.append((_count(one), one.count, (1,)))
        parts.append((one.name, one.dtype, (next(left) if one.count else 1,)))
    return parts


def _even_column(rows: NDArray[Any], one: PlyProperty) -> NDArray[Any] | PlyList:
    items = _native(np.ascontiguousarray(rows[one.name]).reshape(-1))
    if one.count is None:
        return items
    return PlyList(np.full(len(rows), rows.dtype[one.name].shape[0], np.int64), items)


def _native(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def _read_uneven(
    stream: NDArray[Any], at: int, element: PlyElement, stored: list[PlyProperty]
) -> tuple[PlyTable, int]:
    """Read rows whose lists differ in length: find all starts in one pass, then gather."""
    starts: list[list[int]] = [[] for _ in stored]
    counts: list[list[int]] = [[] for _ in stored]
    end, content = len(stream), stream.data
    units = [one.dtype.itemsize // stream.itemsize for one in stored]
    for row in range(element.rows):
        for i, one in enumerate(stored):
            count: int | None = 1
            if one.count is not None:
                if one.count == np.uint8 and at < end:  # as nearly all have it
                    count = content[at]
                else:
                    count = _length(stream, at, one.count)
                at += one.count.itemsize // stream.itemsize
            starts[i].append(at)
            counts[i].append(end if count is None else count)
            at += counts[i][-1] * units[i]
        if at > end:
            raise _cut_short(element, row)
    table: PlyTable = {}
    for i, one in enumerate(stored):
        lengths = np.array(counts[i], np.int64)
        taken = stream[ragged_rows(np.array(starts[i], np.int64), lengths * units[i])]
        values = _native(taken.view(one.dtype))
        table[one.name] = values if one.count is None else PlyList(lengths, values)
    return table, at
