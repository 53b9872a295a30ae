"""What callers give as a shape: a path, arrays, or the mesh of another library.

Other libraries are known by what their objects have, so none of them is imported:

- trimesh: `vertices` and `faces`; a scene joins its meshes with `to_mesh()`.
- Open3D: `vertices` and `triangles`, or `points` and `normals`; tensor geometry has `to_legacy()`.
- PyVista: `points` and `faces`, the count before the corners of each; grids `extract_surface()`.
- meshio: `points` and `cells_dict`. pymeshlab: `vertex_matrix()` and `face_matrix()`.
- pandas: columns `x`, `y`, `z`, and `normal_x`, ... where there are any.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.shape import Shape
from medialis.progress import Progress


class HasVertices(Protocol):
    """A mesh as trimesh and Open3D have it."""

    @property
    def vertices(self) -> Any:
        """Its vertices (n, 3)."""


class HasPoints(Protocol):
    """A mesh or cloud as PyVista, meshio and Open3D have it."""

    @property
    def points(self) -> Any:
        """Its points (n, 3)."""


ShapeLike: TypeAlias = (
    Shape
    | str
    | os.PathLike[str]
    | tuple[Any, Any]
    | list[Any]
    | NDArray[Any]
    | HasVertices
    | HasPoints
)
"""What `as_shape` takes."""

WANTED = (
    "a Shape, a path, (vertices, faces), an (n, 3) array of points, or a mesh of trimesh, PyVista, "
    "Open3D, meshio or pymeshlab, or a table with x, y and z"
)


def as_shape(given: ShapeLike, progress: Progress | None = None) -> Shape:
    """Return what was given as a shape: read or repaired first, unless it is one.

    Parameters
    ----------
    given : Shape, path, (vertices, faces), (n, 3) array, or mesh of another library
    progress : Progress, optional

    Raises
    ------
    InvalidShapeError
        When it is none of these; the sentence says what came.
    FileError
        When the file cannot be read.

    Examples
    --------
    >>> as_shape(([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ...           [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    Shape(4 points, 4 faces, diagonal 1.73205)
    """
    if isinstance(given, Shape):
        return given
    from medialis.surface.reading import make_shape, read_shape  # help needs no parsers of files

    progress = Progress.of(progress)
    if isinstance(given, str | os.PathLike):
        return read_shape(given, progress=progress)
    points, faces, normals = _parts(given)
    return make_shape(points, faces, normals, repair=True, progress=progress)


Parts: TypeAlias = tuple[Any, Any, Any]


def _parts(given: Any) -> Parts:
    """Vertices, triangles or None, normals or None."""
    if isinstance(given, tuple):
        if len(given) != 2:
            raise InvalidShapeError(f"Expected {WANTED}; got a tuple of {len(given)}.")
        return given[0], given[1], None
    if isinstance(given, list | np.ndarray):
        return given, None, None
    names = getattr(given, "columns", None)
    if isinstance(names, Iterable) and {"x", "y", "z"} <= set(names):
        of_normals = [f"normal_{axis}" for axis in "xyz"]
        directions = _columns(given, of_normals) if of_normals[0] in names else None
        return _columns(given, "xyz"), None, directions
    # What has faces is a surface already: PyVista's have `extract_surface` as well.
    for method in () if hasattr(given, "faces") else ("to_legacy", "to_mesh", "extract_surface"):
        if callable(convert := getattr(given, method, None)):
            return _parts(convert())
    if callable(matrix := getattr(given, "vertex_matrix", None)):
        return _with_faces(matrix(), given.face_matrix(), None)
    if (vertices := getattr(given, "vertices", None)) is not None:
        corners = getattr(given, "faces", getattr(given, "triangles", None))
        return _with_faces(vertices, corners, None)
    if (points := getattr(given, "points", None)) is not None:
        normals = getattr(given, "normals", None)
        cells = getattr(given, "cells_dict", None)
        if cells is not None:
            return points, _triangles_of_cells(cells, np.asarray(points)), None
        faces = getattr(given, "faces", None)
        if faces is not None and np.ndim(faces) == 1:
            faces = _split_polygons(np.asarray(faces, np.int64), np.asarray(points, np.float64))
        return _with_faces(points, faces, normals)
    raise InvalidShapeError(f"Expected {WANTED}; got {_said(given)}.")


def _columns(table: Any, names: Sequence[str]) -> Any:
    return np.column_stack([np.asarray(table[name]) for name in names])


def _with_faces(points: Any, faces: Any, normals: Any) -> Parts:
    """Leave out what is empty: libraries have empty arrays for none."""
    triangles = None if faces is None else np.asarray(faces)
    if triangles is not None and triangles.size:
        return np.asarray(points), triangles, None
    directions = None if normals is None else np.asarray(normals)
    if directions is not None and directions.shape != np.shape(points):
        directions = None
    return np.asarray(points), None, directions


def _split_polygons(flat: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[Any]:
    """Triangles of polygons in a row, each with the count of its corners before them."""
    starts, at = [], 0
    if len(flat) % 4 == 0 and (flat[::4] == 3).all():
        return flat.reshape(-1, 4)[:, 1:]
    while at < len(flat):
        starts.append(at)
        at += int(flat[at]) + 1
    if at != len(flat):
        raise InvalidShapeError("The row of faces ends within a polygon.")
    is_count = np.zeros(len(flat), bool)
    is_count[starts] = True
    return _triangles(points, flat[is_count], flat[~is_count])


def _triangles_of_cells(cells: Any, points: NDArray[Any]) -> NDArray[Any] | None:
    """Triangles of a dictionary of cells by their kind; volumes and lines have none here."""
    found = []
    for kind, corners in cells.items():
        if kind == "triangle":
            found.append(np.asarray(corners, np.int32))
        elif kind in ("quad", "polygon"):
            counts = np.full(len(corners), np.shape(corners)[1], np.int64)
            flat = np.asarray(corners, np.int64).ravel()
            found.append(_triangles(np.asarray(points, np.float64), counts, flat))
    if not found and any(kind not in ("vertex", "line") for kind in cells):
        raise InvalidShapeError(f"Expected triangles or quads; got cells {', '.join(cells)}.")
    return np.concatenate(found) if found else None


def _said(given: Any) -> str:
    """Say what came in few words."""
    kind = type(given)
    name = f"{kind.__module__}.{kind.__qualname__}".removeprefix("builtins.")
    text = repr(given)
    return f"{text} ({name})" if len(text) <= 40 else f"an object of {name}"


def _triangles(points: Any, counts: Any, corners: Any) -> NDArray[Any]:
    """Return polygons as triangles."""
    from medialis.files._polygons import triangulate

    return triangulate(points, counts, corners)[0]
