# SPDX-License-Identifier: GPL-3.0-or-later
"""The current layer of a MeshSet as a Shape of the core, in world coordinates."""

from __future__ import annotations

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from medialis import InvalidShapeError, Progress, Shape, make_shape


def shape_of_mesh(mesh: pymeshlab.Mesh, progress: Progress) -> Shape:
    """Return a layer as `medialis.read_shape` returns a file: repaired, with normals.

    Vertices are where the layer shows them, so that lengths are what the user sees. The normals of
    a layer without faces are used when it has any; those of a mesh are computed from its faces.

    Raises
    ------
    InvalidShapeError
        When the layer is empty or the core cannot use it.
    """
    if not mesh.is_compact():
        mesh.compact()
    if mesh.vertex_number() == 0:
        raise InvalidShapeError("The current mesh has no vertices: choose another layer.")
    points, normals = mesh.vertex_matrix(), None
    matrix = mesh.transform_matrix()
    if not is_identity(matrix):
        points = mesh.transformed_vertex_matrix()
    if mesh.face_number() == 0:
        normals = _world_normals(mesh.vertex_normal_matrix(), matrix)
    faces = mesh.face_matrix() if mesh.face_number() else None
    return make_shape(points, faces, normals, repair=True, progress=progress)


def is_identity(matrix: NDArray[np.float64]) -> bool:
    """Tell whether a layer has no transform."""
    return bool((matrix == np.eye(4)).all())


def _world_normals(
    normals: NDArray[np.float64], matrix: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Turn normals by the inverse transpose; None where there are none at all."""
    if not normals.any():
        return None
    if is_identity(matrix):
        return normals
    linear = matrix[:3, :3]
    if np.linalg.det(linear) == 0.0:
        return None
    return normals @ np.linalg.inv(linear)
