"""PLY with named attributes out and back without loss.

Any viewer reads these files; header comments let `read_ply_attributes` restore types and shapes:

- float64, float32, int8/16/32, uint8/16/32 are stored as they are; bool as ``uchar``.
- int64 and uint64, which PLY lacks, are stored as ``int`` when all values fit, else as ``double``
  when all lie within +-2^53; other values are refused (NPZ holds them).
- An (n, a, b) attribute is stored as the scalars ``name_0`` .. ``name_(ab-1)``, row by row.
- Header line of each attribute: ``comment medialis NAME DTYPE SHAPE``; SHAPE is ``scalar`` for an
  (n,) array, else the sizes after n joined by ``x``. Attributes of faces say ``medialis_face``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.validation import FloatArray, IntArray, as_faces, frozen
from medialis.formats.files import complete_file, file_bytes, reading, shown, whole
from medialis.formats.meshes import triangulate
from medialis.formats.ply import PlyHeader, PlyList, PlyTable, ply_columns, read_ply_elements

_PLY_NAMES = {
    **{"f8": "double", "f4": "float", "i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort"},
    **{"i4": "int", "u4": "uint"},
}
_EXACT_DOUBLE = 2**53
_TAG = "medialis"
_FACE_TAG = "medialis_face"


@dataclass(frozen=True, eq=False)
class PlyData:
    """What `read_ply_attributes` returns.

    Attributes
    ----------
    points : (n, 3) float64
        May hold NaN, such as the centers of balls that do not exist.
    faces : (m, 3) int32 or None
    edges : (e, 2) int32 or None
    attributes : dict of name -> array (n, ...)
    face_attributes : dict of name -> array (m, ...)
        Empty when the file has polygons: their triangles would not match.
    """

    points: FloatArray
    faces: IntArray | None
    edges: IntArray | None
    attributes: dict[str, NDArray[Any]]
    face_attributes: dict[str, NDArray[Any]]


def write_ply(
    path: str | os.PathLike[str],
    points: ArrayLike,
    faces: ArrayLike | None = None,
    edges: ArrayLike | None = None,
    attributes: Mapping[str, ArrayLike] | None = None,
    face_attributes: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write points with attributes, triangles and edges as binary little-endian PLY, losslessly.

    Parameters
    ----------
    path : path
        The file; an existing one is replaced when the new one is complete.
    points : (n, 3) array of numbers, n >= 0
        Stored as double; NaN and infinity are kept bit by bit.
    faces : (m, 3) integers, optional
    edges : (e, 2) integers, optional
    attributes : mapping of name -> (n, ...) array, optional
        See the top of `medialis.formats.ply_attributes` for the types and how they are stored.
    face_attributes : mapping of name -> (m, ...) array, optional
        The same for faces.

    Raises
    ------
    InvalidShapeError
        When points, faces or edges have a wrong shape or name points that are not there.
    InvalidOptionError
        When an attribute has a wrong length, a type or values that cannot be stored without loss,
        or a name that PLY cannot hold or that is taken.
    FileError
        When the file cannot be written.
    """
    xyz = np.asarray(points)
    if xyz.ndim != 2 or xyz.shape[1] != 3 or xyz.dtype.kind not in "fiub":
        raise InvalidShapeError(f"points must be an (n, 3) array of numbers, got {xyz.shape}.")
    header = ["ply", "format binary_little_endian 1.0", f"comment {_TAG} 1"]
    columns: list[tuple[str, NDArray[Any]]] = [
        (name, xyz[:, i].astype(np.float64, copy=False)) for i, name in enumerate("xyz")
    ]
    columns += _columns(_TAG, attributes or {}, len(xyz), "points", header)
    triangles = as_faces([] if faces is None else faces, len(xyz))
    face_columns = _columns(_FACE_TAG, face_attributes or {}, len(triangles), "faces", header)
    header.append(f"element vertex {len(xyz)}")
    body = [_table(columns, header)]
    if faces is not None:
        header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
        body.append(_table(face_columns, header, np.full(len(triangles), 3, np.uint8), triangles))
    if edges is not None:
        ends = _as_edges(edges, len(xyz))
        header.append(f"element edge {len(ends)}")
        body.append(_table([("vertex1", ends[:, 0]), ("vertex2", ends[:, 1])], header))
    header.append("end_header\n")
    with complete_file(path) as stream:
        stream.write("\n".join(header).encode("ascii"))
        stream.writelines(body)


def write_layer_ply(path: str | os.PathLike[str], layer: Any) -> None:
    """Write a layer, or a `Drawn`, by `write_ply`, with its errors."""
    write_ply(path, layer.points, layer.faces, layer.edges, layer.attributes, layer.face_attributes)


def _columns(
    tag: str, attributes: Mapping[str, ArrayLike], n: int, rows: str, header: list[str]
) -> list[tuple[str, NDArray[Any]]]:
    """Return the scalar columns of attributes with n rows, and announce them in the header."""
    columns: list[tuple[str, NDArray[Any]]] = []
    for name, values in attributes.items():
        array = np.asarray(values)
        header.append(_attribute_comment(tag, name, array, n, rows))
        flat = _storable(name, array).reshape(n, math.prod(array.shape[1:]))
        names = [name] if array.ndim == 1 else [f"{name}_{i}" for i in range(flat.shape[1])]
        columns += zip(names, flat.T, strict=True)
    return columns


def _table(
    columns: list[tuple[str, NDArray[Any]]], header: list[str], *lists: NDArray[Any]
) -> bytes:
    """Return rows as they are in the file: announced list parts first, then named columns."""
    names = [name for name, _ in columns]
    taken = {name for name in names if names.count(name) > 1}
    if taken:
        raise InvalidOptionError(
            f"the attribute name {min(taken)!r} is taken twice in the PLY file."
        )
    parts = [(f"list {i}", values) for i, values in enumerate(lists)] + columns
    types = np.dtype([(n, c.dtype.newbyteorder("<"), c.shape[1:]) for n, c in parts])
    table = np.empty(len(parts[0][1]), types)
    for name, column in parts:
        table[name] = column
    header += [f"property {_PLY_NAMES[types[n].str[1:]]} {n}" for n, _ in columns]
    return table.tobytes()


def _attribute_comment(tag: str, name: Any, array: NDArray[Any], n: int, rows: str) -> str:
    if not isinstance(name, str) or not name.isascii() or not name.isprintable() or " " in name:
        raise InvalidOptionError(f"an attribute name must be one ASCII word, got {name!r}.")
    if not name:
        raise InvalidOptionError("an attribute name must not be empty.")
    if array.ndim == 0 or len(array) != n:
        raise InvalidOptionError(
            f"attribute {name!r} must have one row for each of the {n} {rows}, got shape "
            f"{array.shape}."
        )
    shape = "x".join(map(str, array.shape[1:])) or "scalar"
    return f"comment {tag} {name} {array.dtype.newbyteorder('=').name} {shape}"


def _storable(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """Return values in a type that PLY has."""
    if array.dtype.kind == "b":
        return array.astype(np.uint8)
    if array.dtype.kind in "iu" and array.dtype.itemsize == 8:
        low, high = (int(array.min()), int(array.max())) if array.size else (0, 0)
        if low >= -(2**31) and high < 2**31:
            return array.astype(np.int32)
        if max(-low, high) <= _EXACT_DOUBLE:
            return array.astype(np.float64)
        raise InvalidOptionError(
            f"attribute {name!r} holds whole numbers beyond 2^53, which PLY cannot hold without "
            "loss; write it as NPZ."
        )
    if array.dtype.str[1:] not in _PLY_NAMES:
        raise InvalidOptionError(
            f"attribute {name!r} has type {array.dtype}; bool, whole numbers, float32 and float64 "
            "can be written as PLY."
        )
    return array


def _as_edges(values: ArrayLike, n: int) -> IntArray:
    edges = np.asarray(values)
    if edges.size == 0:
        return frozen(np.empty((0, 2)), np.int32)
    if edges.ndim != 2 or edges.shape[1] != 2 or edges.dtype.kind not in "iu":
        raise InvalidShapeError(f"edges must be (e, 2) point indices, got {edges.shape}.")
    if edges.min() < 0 or edges.max() >= n:
        raise InvalidShapeError(
            f"edges must name points 0..{n - 1}, got {edges.min()}..{edges.max()}."
        )
    return frozen(edges, np.int32)


def read_ply_attributes(path: str | os.PathLike[str]) -> PlyData:
    """Read a PLY file with all attributes; one written by `write_ply` comes back bit by bit.

    From files of other programs every scalar vertex property is an attribute of its own.

    Raises
    ------
    FileError
        When the file is missing or cannot be read.
    InvalidShapeError
        When it is damaged, cut short or no PLY file.
    """
    name = os.fspath(path)
    data = file_bytes(name)
    with reading(name):
        if not data.startswith(b"ply"):
            raise InvalidShapeError("it is not a PLY file.")
        header, tables = read_ply_elements(data)
        vertices = tables.get("vertex", {})
        points = ply_columns(vertices, ("x", "y", "z"))
        if points is None:
            raise InvalidShapeError("the PLY vertices lack one of the properties x, y, z.")
        faces = tables.get("face", {}).get("vertex_indices")
        triangles, face_attributes = None, {}
        if isinstance(faces, PlyList):
            corners = whole(faces.items, "PLY face indices")
            triangles = frozen(triangulate(points, faces.counts, corners)[0], np.int32)
            if len(faces.counts) == len(triangles):
                face_attributes = _attributes(_FACE_TAG, header, tables["face"], len(triangles))
        ends = ply_columns(tables.get("edge", {}), ("vertex1", "vertex2"))
        edges = None if ends is None else _as_edges(whole(ends, "PLY edges"), len(points))
        attributes = _attributes(_TAG, header, vertices, len(points))
    return PlyData(frozen(points, np.float64), triangles, edges, attributes, face_attributes)


def _attributes(tag: str, header: PlyHeader, table: PlyTable, n: int) -> dict[str, NDArray[Any]]:
    scalars = {name: c for name, c in table.items() if not isinstance(c, PlyList)}
    result: dict[str, NDArray[Any]] = {}
    used = {"x", "y", "z"} if tag == _TAG else set()
    for comment in header.comments:
        words = comment.split()
        if len(words) != 4 or words[0] != tag:
            continue
        _, name, kind, shape_text = words
        try:
            shape = () if shape_text == "scalar" else tuple(map(int, shape_text.split("x")))
            if min(shape, default=0) < 0 or math.prod(shape) > len(scalars):
                raise ValueError
            parts = [name] if not shape_text[0].isdigit() else None
            parts = parts or [f"{name}_{i}" for i in range(math.prod(shape))]
            columns = [scalars[part] for part in parts]
            stacked = np.stack(columns, axis=1) if columns else np.empty((n, 0))
            dtype = np.dtype(kind)
            if dtype.kind not in "biuf":
                raise ValueError
            with np.errstate(invalid="ignore"):  # NaN where whole numbers are announced
                result[name] = stacked.astype(dtype).reshape(n, *shape)
        except (TypeError, ValueError, KeyError):
            raise InvalidShapeError(
                f"the PLY comment {shown(comment.encode('latin-1'))} cannot be understood."
            ) from None
        used.update(parts)
    return result | {name: c for name, c in scalars.items() if name not in used}
