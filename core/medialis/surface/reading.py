"""From a file or from arrays to a Shape: read, diagnose, repair, complete the normals."""

from __future__ import annotations

import logging
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from medialis.errors import InvalidShapeError
from medialis.files.meshes import read_mesh
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.surface.cloud_normals import as_viewpoints, estimate_normals
from medialis.surface.diagnosis import examine
from medialis.surface.far_points import far_points
from medialis.surface.normals import vertex_normals
from medialis.surface.repair import repaired
from medialis.threads import run_patiently
from medialis.units import as_unit
from medialis.validation import as_faces, as_normals, as_points


def read_shape(
    path: str | os.PathLike[str],
    *,
    unit: str | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Shape:
    """Read a mesh or point cloud, repair it without moving a vertex, and complete its normals.

    Parameters
    ----------
    path : path
        PLY, OBJ, OFF, STL or plain text points; glTF, 3MF, Collada and others with the extra `io`;
        STEP with the extra `cad`, whose faces become the `patches` of the shape.
    unit : str, optional
        What one unit of the file is: "mm", "cm", "m", "in", "ft", ... Else what the format says:
        glTF, 3MF, Collada and STEP do, the others do not.
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
        When the unit is none.

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
        progress.note(text, "other_unit", level=logging.WARNING, file=mesh.unit, taken=unit)
    normals = None if mesh.faces is not None else mesh.normals
    with progress.stage("prepare", 0.5, 1.0):
        try:
            return make_shape(
                mesh.points,
                mesh.faces,
                normals,
                repair=True,
                viewpoints=None if normals is not None else mesh.viewpoints,
                unit=unit or mesh.unit,
                patches=mesh.patches,
                progress=progress,
            )
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
    progress = Progress.of(progress)
    extra: dict[str, Any] = {"unit": as_unit(unit)}
    known = None
    views = None if viewpoints is None else as_viewpoints(viewpoints, len(np.asarray(points)))
    if repair:
        given = points, faces, normals
        diagnosis, examined = run_patiently(lambda: examine(*given[:2]), progress)
        fixed, known = run_patiently(lambda: repaired(*given, examined), progress)
        del examined  # as large as the shape
        progress.record(*fixed.messages)
        extra |= {"diagnosis": diagnosis, "vertex_map": fixed.vertex_map}
        points, faces, normals = fixed.points, fixed.faces, fixed.normals
        if views is not None:
            first = np.unique(fixed.vertex_map, return_index=True)
            views = views[first[1][first[0] >= 0]]
        if fixed.faces is not None and len(fixed.faces):
            extra["face_map"] = fixed.face_map
            if patches is not None:
                patches = np.asarray(patches)[fixed.face_map]
    if patches is not None:
        extra["patches"] = np.asarray(patches)
    vertices = as_points(points)
    triangles = None if faces is None else as_faces(faces, len(vertices))
    if triangles is not None and len(triangles) == 0:
        triangles = None
    directions = None if normals is None else as_normals(normals, len(vertices))
    if triangles is not None:
        if directions is None:
            directions = run_patiently(lambda: vertex_normals(vertices, triangles), progress)
    elif directions is None or not directions.any():  # programs write zeros for "none"
        lack = "has no normals" if directions is None else "has zero normals only"
        code = "normals_missing" if directions is None else "normals_zero"
        directions = estimate_normals(vertices, viewpoints=views, progress=progress)
        progress.note(f"The point cloud {lack}; they were estimated and oriented.", code)
    shape = run_patiently(lambda: Shape(vertices, directions, triangles, **extra), progress)
    if known is not None:
        shape.adopt(known)
    if repair and (far := run_patiently(lambda: far_points(shape), progress)) is not None:
        progress.record(far)
    return shape
