"""From what callers give to a `Shape`: read, diagnose, repair, complete the normals.

Other libraries are known by what their objects have, so none of them is imported:

- trimesh: `vertices` and `faces`; a scene joins its meshes with `to_mesh()`.
- Open3D: `vertices` and `triangles`, or `points` and `normals`; tensor geometry has `to_legacy()`.
- PyVista: `points` and `faces`, the count before the corners of each; grids `extract_surface()`.
- meshio: `points` and `cells_dict`. pymeshlab: `vertex_matrix()` and `face_matrix()`.
- pandas: columns `x`, `y`, `z`, and `normal_x`, ... where there are any.

For operations that need triangles, `surface_of_cloud` finds a surface through the points of a cloud
(before thesis 3.3): Delaunay tetrahedra are told inside from outside by the oriented normals of
their corners, and the surface is where the two meet. Its vertices are the samples: indices and
balls stay what they are.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.options import as_unit
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_patiently
from medialis.base.validation import as_faces, as_normals, as_points
from medialis.formats.meshes import read_mesh, triangulate
from medialis.shape.diagnosis import examine
from medialis.shape.normals import (
    SHARP,
    as_viewpoints,
    estimate_normals,
    part_normals,
    ring_normals,
)
from medialis.shape.planes import find_planes
from medialis.shape.repair import repaired
from medialis.shape.shape import Shape, far_points
from medialis.shape.surface import Surface
from medialis.shape.upright import up_of_cloud


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
    return triangulate(points, flat[is_count], flat[~is_count])[0]


def _triangles_of_cells(cells: Any, points: NDArray[Any]) -> NDArray[Any] | None:
    """Triangles of a dictionary of cells by their kind; volumes and lines have none here."""
    found = []
    for kind, corners in cells.items():
        if kind == "triangle":
            found.append(np.asarray(corners, np.int32))
        elif kind in ("quad", "polygon"):
            counts = np.full(len(corners), np.shape(corners)[1], np.int64)
            flat = np.asarray(corners, np.int64).ravel()
            found.append(triangulate(np.asarray(points, np.float64), counts, flat)[0])
    if not found and any(kind not in ("vertex", "line") for kind in cells):
        raise InvalidShapeError(f"Expected triangles or quads; got cells {', '.join(cells)}.")
    return np.concatenate(found) if found else None


def _said(given: Any) -> str:
    """Say what came in few words."""
    kind = type(given)
    name = f"{kind.__module__}.{kind.__qualname__}".removeprefix("builtins.")
    text = repr(given)
    return f"{text} ({name})" if len(text) <= 40 else f"an object of {name}"


def read_shape(
    path: str | os.PathLike[str],
    *,
    unit: str | None = None,
    up: str | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Shape:
    """Read a mesh or point cloud, repair it without moving a vertex, and complete its normals.

    Parameters
    ----------
    path : path
        PLY, OBJ, OFF, STL, 3MF, VTP, PCD or plain text points; glTF, Collada and others with the
        extra `io`; LAS, LAZ and E57 with `scans`; STEP with `cad`, whose faces become the
        `patches` of the shape.
    unit : str, optional
        What one unit of the file is: "mm", "cm", "m", "in", "ft", ... Else what the format says:
        glTF, 3MF, Collada, STEP and E57 do, LAS may, the others do not.
    up : {"x", "y", "z"}, optional
        The axis that points up in pictures. Else that of the format: y in glTF, z in STL, 3MF,
        STEP, LAS and E57, what a Collada file says; of others it is derived from the shape, z for
        clouds that do not clearly stand on their lowest y.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Shape
        With ``.diagnosis`` of the file as it was, and ``.vertex_map``/``.face_map`` to it. Mesh
        normals come from the faces; normals in the file are used for point clouds only. Where it
        has none, the places that the points were seen from orient them, if it has those.

    Raises
    ------
    FileError, InvalidShapeError
        One sentence that names the file and what is wrong with it.
    InvalidOptionError
        When the unit or the axis is none.

    See Also
    --------
    make_shape : from arrays.
    run : what to do with it.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import medialis
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "tetrahedron.off"
    ...     lines = "OFF;4 4 0;0 0 0;1 0 0;0 1 0;0 0 1;3 0 2 1;3 0 1 3;3 1 2 3;3 0 3 2".split(";")
    ...     _ = path.write_text(chr(10).join(lines))
    ...     medialis.read_shape(path)
    Shape(4 points, 4 faces, diagonal 1.73205)
    """
    progress, unit = Progress.of(progress), as_unit(unit)
    with progress.stage("read", 0.0, 0.5):
        mesh = run_patiently(lambda: read_mesh(path), progress)
    progress.record(*mesh.messages)
    if unit and mesh.unit and unit != mesh.unit:
        text = f"The file says that its unit is {mesh.unit}; it is taken as {unit}, as asked."
        progress.warn(text, "other_unit", file=mesh.unit, taken=unit)
    # Those of a file are for clouds, but for a CAD model, which has those of its surfaces.
    model = mesh.planes is not None
    normals = mesh.normals if model or mesh.faces is None else None
    views = None if normals is not None else mesh.viewpoints
    up = up or mesh.up or (up_of_cloud(mesh.points) if mesh.faces is None else None)
    of_faces = mesh.patches, mesh.planes, mesh.bodies
    told = _Told(views, unit or mesh.unit, *of_faces, up)
    with progress.stage("prepare", 0.5, 1.0):
        try:
            return _made(mesh.points, mesh.faces, normals, told, True, progress)
        except InvalidShapeError as error:
            raise InvalidShapeError(f"Cannot use {os.fspath(path)}: {error}") from None


def make_shape(
    points: ArrayLike,
    faces: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    *,
    repair: bool = False,
    viewpoints: ArrayLike | None = None,
    unit: str | None = None,
    patches: ArrayLike | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Shape:
    """Build a Shape from arrays, with the normals it lacks.

    Parameters
    ----------
    points : (n, 3) float
        Vertices or samples, any unit.
    faces : (m, 3) int, optional
        Triangles, counter-clockwise seen from outside.
    normals : (n, 3) float, optional
        Outward normals. Missing ones are computed from the faces (`vertex_normals`), or estimated
        and oriented for a point cloud, also when all of its normals are zero.
    repair : bool
        Diagnose and repair first, as `read_shape` does (weld, drop what is degenerate or unused,
        orient). Without it the shape has exactly these points and faces.
    viewpoints : (3,) or (n, 3) float, optional
        Where the points of a cloud were seen from: `estimate_normals` orients by them.
    unit : str, optional
        What one unit of the points is: "mm", "cm", "m", "in", "ft", ... Options may then be lengths
        such as "1mm", and results say it.
    patches : (m,) int, optional
        The patch that each face lies on, such as a face of a CAD model.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Raises
    ------
    InvalidShapeError
        When an array cannot be used, or nothing with an area is left.
    InvalidOptionError
        When the unit is none.

    See Also
    --------
    read_shape : from a file.
    repair : what it can do first.

    Examples
    --------
    >>> import medialis
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> medialis.make_shape(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    Shape(4 points, 4 faces, diagonal 1.73205)
    """
    told = _Told(viewpoints, as_unit(unit), patches)
    return _made(points, faces, normals, told, repair, Progress.of(progress))


@dataclass(frozen=True)
class _Told:
    """What is known of a shape besides: see `make_shape` and `Shape.planes`."""

    viewpoints: ArrayLike | None = None
    unit: str | None = None
    patches: ArrayLike | None = None
    planes: ArrayLike | None = None
    bodies: ArrayLike | None = None
    up: str | None = None

    def of_faces(self, kept: NDArray[Any] | slice) -> dict[str, Any]:
        """Return what is known of those faces that are kept."""
        named = {"patches": self.patches, "planes": self.planes}
        return {name: np.asarray(rows)[kept] for name, rows in named.items() if rows is not None}


def _made(
    points: ArrayLike,
    faces: ArrayLike | None,
    normals: ArrayLike | None,
    told: _Told,
    repair: bool,
    progress: Progress,
) -> Shape:
    """Build a shape as `make_shape` does; normals of a mesh that are zero are computed."""
    extra: dict[str, Any] = {"unit": told.unit, "up": told.up, **told.of_faces(slice(None))}
    known, views = None, None
    if told.viewpoints is not None:
        views = as_viewpoints(told.viewpoints, len(np.asarray(points)))
    if repair:
        given = points, faces, normals
        examined = run_patiently(lambda: examine(*given[:2], told.bodies), progress)
        fixed, known = run_patiently(lambda: repaired(*given, examined, told.bodies), progress)
        extra |= {"diagnosis": examined.diagnosis, "vertex_map": fixed.vertex_map}
        del examined  # as large as the shape
        progress.record(*fixed.messages)
        points, faces, normals = fixed.points, fixed.faces, fixed.normals
        if views is not None:
            first = np.unique(fixed.vertex_map, return_index=True)
            views = views[first[1][first[0] >= 0]]
        if fixed.faces is not None and len(fixed.faces):
            extra |= {"face_map": fixed.face_map, **told.of_faces(fixed.face_map)}
    vertices = as_points(points)
    measured: Surface | None = None
    triangles = None if faces is None else as_faces(faces, len(vertices))
    if triangles is not None and len(triangles) == 0:
        triangles = None
    directions = None if normals is None else as_normals(normals, len(vertices))
    if triangles is not None:
        if directions is None or told.planes is not None:
            surface = Surface.of_checked(vertices, triangles)
            if known is not None:
                surface.adopt_measures(known)
                del known
            planes = extra.get("planes")
            if planes is None:
                planes = run_patiently(lambda: find_planes(surface, SHARP), progress)
            rings = run_patiently(lambda: ring_normals(vertices, triangles), progress)
            found = run_patiently(lambda: part_normals(rings, surface, planes), progress)
            computed, cylinders = found
            if directions is not None:  # a model has none where its faces meet in an edge
                told_there = np.asarray(directions).any(axis=1, keepdims=True)
                computed = np.where(told_there, directions, computed)
            directions = computed
            extra |= {"planes": planes, "cylinders": cylinders}
            measured = surface
            measured.__dict__.pop("face_vectors", None)  # as large as the shape
            measured.topology.__dict__.pop("first_equal_face", None)
    elif directions is None or not directions.any():  # programs write zeros for "none"
        lack = "has no normals" if directions is None else "has zero normals only"
        code = "normals_missing" if directions is None else "normals_zero"
        directions = estimate_normals(vertices, viewpoints=views, progress=progress)
        progress.note(f"The point cloud {lack}; they were estimated and oriented.", code)
    shape = run_patiently(lambda: Shape(vertices, directions, triangles, **extra), progress)
    if measured is not None:
        shape.adopt_measures(measured)
    elif known is not None:
        shape.adopt(known.topology)
    if repair and (far := run_patiently(lambda: far_points(shape), progress)) is not None:
        progress.record(far)
    return shape


_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # face j is opposite corner j


def surface_of_cloud(shape: ShapeLike) -> Shape:
    """Triangulate a closed point cloud with oriented normals.

    Parameters
    ----------
    shape : Shape
        n samples with outward normals, dense enough that opposite sides of the surface are further
        apart than neighbouring samples. Faces it may have are replaced.

    Returns
    -------
    Shape
        The same points and normals with triangles, counter-clockwise seen from outside. Samples
        that no triangle uses stay.

    Raises
    ------
    InvalidShapeError
        When the points are flat or no part of space counts as inside.

    See Also
    --------
    estimate_normals : what it needs.
    manifold_surfaces : of clouds of several surfaces.

    Notes
    -----
    Cost: one 3D Delaunay triangulation (scipy's Qhull). A tetrahedron is inside when its
    circumcenter lies behind most of the tangent planes of its corners. The result is closed; where
    the cloud is open or noisy it can be wrong or non-manifold, so look at it. Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> medialis.surface_of_cloud(medialis.Shape(shape.points, shape.normals)).faces is not None
    True
    """
    shape = as_shape(shape)
    from scipy.spatial import Delaunay, QhullError

    points = (shape.points - shape.points.mean(axis=0)) / (shape.diagonal or 1.0)
    try:
        found = Delaunay(points)
    except QhullError:
        raise InvalidShapeError(
            "No surface can be built through these points: they are flat or too few."
        ) from None
    corners = found.simplices
    origin = points[corners[:, 0]]
    sides = points[corners[:, 1:]] - origin[:, None]
    volume = np.linalg.det(sides)
    # The circumcenter is equally far from the corners: 2 sides . (center - origin) = |side|^2.
    usable = np.abs(volume) > 1e-15
    center = np.full(origin.shape, np.nan)
    square = 0.5 * np.einsum("tij,tij->ti", sides, sides)
    center[usable] = (
        origin[usable] + np.linalg.solve(sides[usable], square[usable, :, None])[..., 0]
    )
    away = center[:, None] - points[corners]
    height = np.einsum("tij,tij->ti", away, shape.normals[corners])
    inside = np.nan_to_num(np.sign(height)).sum(axis=1) < 0
    if not inside.any():
        raise InvalidShapeError(
            "No part of space lies inside this cloud: its normals may point inward, or it is open."
        )
    neighbour_inside = np.where(found.neighbors >= 0, inside[found.neighbors], False)
    tetrahedron, face = np.nonzero(inside[:, None] & ~neighbour_inside)
    triangles = corners[tetrahedron[:, None], _FACES[face]]
    flipped = volume[tetrahedron] < 0
    triangles[flipped] = triangles[flipped][:, [0, 2, 1]]
    return shape.remade(
        faces=triangles.astype(np.int32), face_map=None, face_origin=None, planes=None
    )
