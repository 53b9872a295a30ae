"""Meshes out, in the formats that other programs read."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError
from medialis.exchange.libraries import Drawable, Drawn
from medialis.formats.files import complete_file
from medialis.formats.ply_attributes import write_ply
from medialis.formats.shells import write_inp, write_msh
from medialis.formats.vtk import write_vtp, write_vtu

WITH_VALUES = {
    **{".ply": write_ply, ".vtp": write_vtp, ".vtu": write_vtu, ".msh": write_msh},
    ".inp": write_inp,
}
"""Formats that hold attributes."""

FORMATS = (*WITH_VALUES, ".obj", ".off", ".stl")


def write_mesh(
    path: str | os.PathLike[str],
    thing: Drawable,
    *,
    attributes: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write points, triangles and edges in the format that the extension names.

    Parameters
    ----------
    path : path
        ``.ply`` keeps everything without loss, and so do ``.vtp`` and ``.vtu`` for ParaView and
        VTK. ``.msh`` (Gmsh), ``.inp`` (Abaqus) and ``.ccx.inp`` (CalculiX) hold triangles as shell
        elements: `thickness` of points becomes sections, `sheet` of faces groups. ``.obj``
        and ``.off`` keep points and triangles, and OBJ edges, with 17 digits. ``.stl`` keeps
        triangles in single precision.
    thing : Shape, SkeletonMesh, Layer, MedialCloud, CurveSkeleton, Result, or what stands for one
        A result gives its first layer.
    attributes : dict of (n,) or (n, d) arrays, optional
        More values of the points; not for OBJ, OFF and STL.

    Raises
    ------
    InvalidOptionError
        When the format is unknown, cannot hold attributes, or holds triangles only and there are
        none.
    InvalidShapeError
        When there are no points, or no triangles for STL.
    FileError
        When the file cannot be written.

    See Also
    --------
    read_shape : reads it again.
    write_result : all files of a result.
    write_curve_skeleton : graph formats.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_mesh(f"{folder}/organic.obj", shape)
    ...     medialis.read_shape(f"{folder}/organic.obj").face_count == shape.face_count
    True
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise InvalidOptionError(
            f"Meshes are written as {', '.join(FORMATS)}; got {os.fspath(path)!r}."
        )
    drawn = Drawn.of(thing)
    if write := WITH_VALUES.get(ending):
        values = {**drawn.attributes, **(attributes or {})}
        write(path, drawn.points, drawn.faces, drawn.edges, values, drawn.face_attributes)
        return
    if attributes:
        names = ", ".join(WITH_VALUES)
        raise InvalidOptionError(f"Only {names} hold attributes; got {os.fspath(path)!r}.")
    data = {".obj": _obj, ".off": _off, ".stl": _stl}[ending](drawn)
    with complete_file(path) as stream:
        stream.write(data)


def _rows(mark: str, rows: NDArray[np.generic]) -> list[str]:
    """Lines of numbers, each with all its digits, behind a mark."""
    return [mark + " ".join(map(repr, row)) for row in rows.tolist()]


def _obj(drawn: Drawn) -> bytes:
    lines = _rows("v ", drawn.points)
    for mark, rows in (("f ", drawn.faces), ("l ", drawn.edges)):
        lines += [] if rows is None else _rows(mark, rows + 1)
    return ("\n".join(lines) + "\n").encode()


def _off(drawn: Drawn) -> bytes:
    faces = np.empty((0, 3), np.int32) if drawn.faces is None else drawn.faces
    counts = f"{len(drawn.points)} {len(faces)} 0"
    lines = ["OFF", counts, *_rows("", drawn.points), *_rows("3 ", faces)]
    return ("\n".join(lines) + "\n").encode()


def _stl(drawn: Drawn) -> bytes:
    if drawn.faces is None:
        raise InvalidOptionError("STL holds triangles only; write points as PLY, OBJ or OFF.")
    corners = drawn.points[drawn.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    np.divide(normals, lengths, out=normals, where=lengths > 0)
    table = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
    table["normal"], table["corners"] = normals, corners
    return b"medialis".ljust(80) + np.uint32(len(table)).tobytes() + table.tobytes()
