"""Points, triangles and lines with named values as VTK's XML files, PolyData and UnstructuredGrid.

ParaView, VTK and PyVista read .vtp; solvers and their post-processors (meshio, FEniCS, Elmer) read
.vtu. The numbers stand as they are behind the text (raw, appended), so files are as small as PLY.
Attributes of any number of columns are kept, int64 and NaN as well.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError
from medialis.base.validation import as_points
from medialis.formats.files import Drawn, complete_file

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


class _File:
    """A layer as VTK's files have it: checked, with the elements that all kinds of them share.

    Attributes
    ----------
    points : (n, 3) float
    vertices, lines, triangles : (k, 1), (e, 2) and (m, 3) int64
        The cells. Points without faces and edges are vertices, so that programs draw them.
    """

    def __init__(self, layer: Drawn) -> None:
        self.points = as_points(layer.points)
        self.lines, self.triangles = cell_rows(layer.edges, 2), cell_rows(layer.faces, 3)
        own = 0 if len(self.lines) or len(self.triangles) else len(self.points)
        self.vertices = np.arange(own, dtype=np.int64)[:, None]
        n, m = len(self.points), len(self.triangles)
        self._at_points = {k: as_column(k, v, n) for k, v in layer.attributes.items()}
        self.at_cells = {
            k: self._behind_others(as_column(k, v, m)) for k, v in layer.face_attributes.items()
        }
        self._show = layer.color_by
        self._arrays: list[NDArray[Any]] = []

    def _behind_others(self, values: NDArray[Any]) -> NDArray[Any]:
        """Put rows that say nothing, those of the other cells, before those of the triangles."""
        nothing = np.nan if values.dtype.kind == "f" else 0
        others = len(self.vertices) + len(self.lines)
        return np.concatenate([np.full((others, *values.shape[1:]), nothing, values.dtype), values])

    def add(self, given: Mapping[str, NDArray[Any]]) -> list[str]:
        """Store arrays behind the text, and return the elements that name them."""
        from xml.sax.saxutils import quoteattr  # which loads half of the network

        elements = []
        for name, values in given.items():
            start = sum(8 + array.nbytes for array in self._arrays)
            array = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
            self._arrays.append(array)
            width = f' NumberOfComponents="{array.shape[1]}"' if array.ndim > 1 else ""
            elements.append(
                f'<DataArray type="{_TYPES[array.dtype.str[1:]]}" Name={quoteattr(name)}{width} '
                f'format="appended" offset="{start}"/>'
            )
        return elements

    def places(self) -> list[str]:
        """Return the elements of the points."""
        return ["<Points>", *self.add({"Points": self.points}), "</Points>"]

    def values(self) -> list[str]:
        """Return the elements of the attributes."""
        from xml.sax.saxutils import quoteattr

        given = self._at_points
        one = self._show in given and given[self._show].ndim == 1
        first = f" Scalars={quoteattr(str(self._show))}" if one else ""
        inside = [f"<PointData{first}>", *self.add(given), "</PointData>"]
        return [*inside, "<CellData>", *self.add(self.at_cells), "</CellData>"]

    def write(self, path: str | os.PathLike[str], kind: str, elements: Iterable[str]) -> None:
        """Write a file of a kind of VTK's: its elements, and the numbers behind them."""
        about = 'version="1.0" byte_order="LittleEndian" header_type="UInt64"'
        head = ('<?xml version="1.0"?>', f'<VTKFile type="{kind}" {about}>', f"<{kind}>")
        with complete_file(path) as stream:
            for line in (*head, *elements, f"</{kind}>"):
                stream.write(line.encode() + b"\n")
            stream.write(b'<AppendedData encoding="raw">\n_')
            for array in self._arrays:
                stream.write(np.uint64(array.nbytes).astype("<u8").tobytes())
                stream.write(array.tobytes())
            stream.write(b"\n</AppendedData>\n</VTKFile>\n")


def write_vtp(path: str | os.PathLike[str], layer: Drawn) -> None:
    """Write a layer as a .vtp file.

    Parameters
    ----------
    path : path
        Replaced when it is there.
    layer : Drawn
        Points without faces and edges are cells of their own, so that programs draw them. Arrays of
        more than two axes become columns, row by row; bool becomes 0 and 1. The attributes of faces
        are cell data; edges beside them have NaN, or 0 in whole numbers.

    Raises
    ------
    InvalidShapeError
        When the points are none.
    InvalidOptionError
        When an attribute has another number of rows, or holds no numbers.
    FileError
        When the file cannot be written.
    """
    file = _File(layer)
    cells = {"Verts": file.vertices, "Lines": file.lines, "Polys": file.triangles}
    counts = {"Points": file.points, **cells}
    about = " ".join(f'NumberOf{name}="{len(rows)}"' for name, rows in counts.items())
    inside = [f'<Piece {about} NumberOfStrips="0">', *file.places()]
    for name, rows in cells.items():
        ends = rows.shape[1] * np.arange(1, len(rows) + 1, dtype=np.int64)
        columns = {"connectivity": rows.ravel(), "offsets": ends}
        inside += [f"<{name}>", *file.add(columns), f"</{name}>"]
    file.write(path, "PolyData", [*inside, *file.values(), "</Piece>"])


def write_lines_vtp(
    path: str | os.PathLike[str],
    layer: Drawn,
    lines: Sequence[NDArray[Any]],
    at_lines: Mapping[str, ArrayLike],
) -> None:
    """Write polylines through the points of a layer as a .vtp file.

    Parameters
    ----------
    path : path
    layer : Drawn
        Its points and their attributes.
    lines : sequence of (k,) int
        Points along each line, a cell each; k >= 2.
    at_lines : dict of (l,) or (l, d)
        Values of the cells.

    Raises
    ------
    InvalidOptionError
        When an attribute has another number of rows, or holds no numbers.
    FileError
        When the file cannot be written.
    """
    file = _File(layer)
    about = f'NumberOfPoints="{len(file.points)}" NumberOfLines="{len(lines)}"'
    none = 'NumberOfVerts="0" NumberOfStrips="0" NumberOfPolys="0"'
    columns = {
        "connectivity": np.concatenate([np.asarray(line, np.int64) for line in lines]),
        "offsets": np.cumsum([len(line) for line in lines], dtype=np.int64),
    }
    inside = [f"<Piece {about} {none}>", *file.places()]
    inside += ["<Lines>", *file.add(columns), "</Lines>"]
    file.at_cells = {name: as_column(name, v, len(lines)) for name, v in at_lines.items()}
    file.write(path, "PolyData", [*inside, *file.values(), "</Piece>"])


VERTEX, LINE, TRIANGLE = 1, 3, 5
"""VTK's numbers of the kinds of cells."""


def write_vtu(path: str | os.PathLike[str], layer: Drawn) -> None:
    """Write a layer as a .vtu file.

    Arguments and errors are those of `write_vtp`; cells are the edges, then the triangles.
    """
    file = _File(layer)
    cells = {VERTEX: file.vertices, LINE: file.lines, TRIANGLE: file.triangles}
    counts = [len(rows) for rows in cells.values()]
    kinds = np.repeat(np.array(list(cells), np.uint8), counts)
    sizes = np.repeat([rows.shape[1] for rows in cells.values()], counts)
    columns = {
        "connectivity": np.concatenate([rows.ravel() for rows in cells.values()]),
        "offsets": np.cumsum(sizes, dtype=np.int64),
        "types": kinds,
    }
    inside = [
        f'<Piece NumberOfPoints="{len(file.points)}" NumberOfCells="{len(kinds)}">',
        *file.places(),
        *("<Cells>", *file.add(columns), "</Cells>"),
    ]
    file.write(path, "UnstructuredGrid", [*inside, *file.values(), "</Piece>"])
