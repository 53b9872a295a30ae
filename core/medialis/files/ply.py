"""PLY in: ascii and binary, any element, any property, lists of any length.

Strategy: both encodings are seen as one flat stream - of bytes, or of numbers for ascii - through
which elements are walked by the same code. An element whose lists all have the length of its first
row (a triangle mesh) is one numpy view; otherwise one light pass over the rows finds where each
list starts, and everything is gathered at once. Counts in the header are never trusted with
memory: they are held against what the stream can contain first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.files._content import ParsedMesh, no_polygons, numbers, ragged_rows, shown, whole
from medialis.files._ply_header import PlyElement, PlyHeader, read_ply_header
from medialis.files._viewpoints import for_each_point, said_viewpoints
from medialis.progress import Message


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
    order: Literal["<", ">"] = ">" if header.encoding == "binary_big_endian" else "<"
    tables: dict[str, PlyTable] = {}
    at = 0
    for element in header.elements:
        layout = _layout(element, order, header.encoding == "ascii")
        table, at = _read_element(stream, at, element, layout)
        tables[element.name] = table
    if header.encoding == "ascii" and at != len(stream):
        raise InvalidShapeError(
            f"the PLY header announces {at} numbers, but {len(stream)} follow it."
        )
    return header, tables


@dataclass
class _Slot:
    """Where a property lies: `unit` stream items for a value, `count_unit` for a list's count."""

    name: str
    dtype: np.dtype[Any]
    unit: int
    count: np.dtype[Any] | None
    count_unit: int


def _layout(element: PlyElement, order: Literal["<", ">"], ascii_text: bool) -> list[_Slot]:
    slots = []
    for p in element.properties:
        dtype, count = p.dtype.newbyteorder(order), p.count and p.count.newbyteorder(order)
        unit, count_unit = dtype.itemsize, count.itemsize if count else 0
        if ascii_text:
            unit, count_unit = 1, 1 if count else 0
        slots.append(_Slot(p.name, dtype, unit, count, count_unit))
    return slots


def _read_element(
    stream: NDArray[Any], at: int, element: PlyElement, layout: list[_Slot]
) -> tuple[PlyTable, int]:
    """Read the rows of one element from position `at`; return its columns and where it ends."""
    least = sum(s.count_unit if s.count else s.unit for s in layout)
    rows = element.rows if least else 0
    room = (len(stream) - at) // least if least else 0
    lists = [s for s in layout if s.count]
    if room < rows and not lists:
        raise _cut_short(element, room)
    lengths = _first_lengths(stream, at, layout) if rows else [0] * len(lists)
    if lengths is not None:
        table, size = _read_even(stream, at, rows, layout, lengths)
        if table is not None:
            return table, at + size * rows
    return _read_uneven(stream, at, element, layout)


def _cut_short(element: PlyElement, found: int) -> InvalidShapeError:
    other = f"rows of {shown(element.name.encode('latin-1'))}"
    plural = {"vertex": "vertices", "face": "faces"}.get(element.name, other)
    return InvalidShapeError(
        f"the file is cut short: the PLY header announces {element.rows} {plural}, "
        f"only {found} were found."
    )


def _value(stream: NDArray[Any], at: int, dtype: np.dtype[Any], unit: int) -> int | None:
    """Return the list count at a position, or None when the stream ends before it."""
    if at + unit > len(stream):
        return None
    value = stream[at] if unit == 1 else stream[at : at + unit].view(dtype)[0]
    if stream.dtype.kind == "f" and value != np.rint(value):
        raise InvalidShapeError(f"a PLY list has a count of {float(value):g}.")
    if stream.dtype == np.uint8 and unit == 1:
        value = stream[at : at + 1].view(dtype)[0]
    if value < 0:
        raise InvalidShapeError(f"a PLY list has a count of {int(value)}.")
    return int(value) if np.isfinite(value) else None


def _first_lengths(stream: NDArray[Any], at: int, layout: list[_Slot]) -> list[int] | None:
    """Return the list lengths in the row at a position, or None when the stream ends in it."""
    lengths = []
    for slot in layout:
        if slot.count:
            length = _value(stream, at, slot.count, slot.count_unit)
            if length is None:
                return None
            lengths.append(length)
            at += slot.count_unit + length * slot.unit
        else:
            at += slot.unit
    return lengths if at <= len(stream) else None


def _read_even(
    stream: NDArray[Any], at: int, rows: int, layout: list[_Slot], lengths: list[int]
) -> tuple[PlyTable | None, int]:
    """Read rows as if all lists were as long as in the first row; None when that is not so."""
    left = list(lengths)
    size = sum(s.count_unit + left.pop(0) * s.unit if s.count else s.unit for s in layout)
    if at + rows * size > len(stream):
        return None, size
    block = stream[at : at + rows * size].reshape(rows, size)
    table: PlyTable = {}
    place = 0
    left = list(lengths)
    for slot in layout:
        if slot.count is None:
            table[slot.name] = _cast(block[:, place : place + slot.unit], slot)[:, 0]
            place += slot.unit
            continue
        length = left.pop(0)
        end = place + slot.count_unit
        # In bytes too: a count of the same value has the same bytes.
        if rows and (block[:, place:end] != block[0, place:end]).any():
            return None, size
        items = _cast(block[:, end : end + length * slot.unit], slot).reshape(-1)
        table[slot.name] = PlyList(np.full(rows, length, np.int64), items)
        place = end + length * slot.unit
    return table, size


def _cast(block: NDArray[Any], slot: _Slot) -> NDArray[Any]:
    """Return (rows, values) of the slot's type from (rows, bytes); ascii numbers stay doubles."""
    if block.dtype != np.uint8:
        return np.ascontiguousarray(block)
    if block.shape[1] == 0:
        return np.empty((len(block), 0), slot.dtype.newbyteorder("="))
    values = np.ascontiguousarray(block).view(slot.dtype)
    return values.astype(slot.dtype.newbyteorder("="), copy=False)


def _read_uneven(
    stream: NDArray[Any], at: int, element: PlyElement, layout: list[_Slot]
) -> tuple[PlyTable, int]:
    """Read rows whose lists differ in length: find all starts in one pass, then gather."""
    starts: list[list[int]] = [[] for _ in layout]
    counts: list[list[int]] = [[] for _ in layout]
    end = len(stream)
    quick: Any = stream.tolist() if stream.dtype != np.uint8 else stream.tobytes()
    for row in range(element.rows):
        for i, slot in enumerate(layout):
            count = 1
            if slot.count is not None:
                plain = slot.count_unit == 1 and slot.count.kind == "u" and at < end
                if plain and isinstance(quick, bytes):
                    count = quick[at]
                else:
                    value = _value(stream, at, slot.count, slot.count_unit)
                    count = end if value is None else value
                at += slot.count_unit
            starts[i].append(at)
            counts[i].append(count)
            at += count * slot.unit
        if at > end:
            raise _cut_short(element, row)
    table: PlyTable = {}
    for i, slot in enumerate(layout):
        length = np.array(counts[i], np.int64)
        values = _gather(stream, np.array(starts[i], np.int64), length, slot)
        table[slot.name] = values if slot.count is None else PlyList(length, values)
    return table, at


def _gather(
    stream: NDArray[Any], starts: NDArray[np.int64], counts: NDArray[np.int64], slot: _Slot
) -> NDArray[Any]:
    taken = stream[ragged_rows(starts, counts * slot.unit)]
    if stream.dtype != np.uint8:
        return taken
    return taken.view(slot.dtype).astype(slot.dtype.newbyteorder("="), copy=False)
