"""Vertex normals of meshes, weighted by the corner angles (input of thesis 3.2)."""

from __future__ import annotations

import numpy as np

from medialis.validation import FloatArray, IntArray, as_faces, as_points, frozen

FACING_AWAY = 1e-6
"""Cosine beyond which a face looks away from the normal: above rounding, so that the rim of a flat
double-sided sheet, exactly at right angles to its faces, keeps its normal."""


def vertex_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Compute unit vertex normals: face normals weighted by the angle of the face at the vertex.

    Angle weights depend on the surface only, not on how it is cut into triangles: splitting a face
    does not change them.

    Parameters
    ----------
    points : (n, 3) float
        Vertices.
    faces : (m, 3) int
        Triangles, counter-clockwise seen from outside.

    Returns
    -------
    (n, 3) float64
        Zero where a vertex has no face with an area, or where one of its faces looks the other way
        (a fold: its faces have no common outside, and a ball would start on the wrong side).

    Raises
    ------
    InvalidShapeError
        When an array has the wrong shape or a face index is out of range.

    See Also
    --------
    estimate_normals : of clouds.

    Examples
    --------
    >>> vertex_normals([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])[0]
    array([0., 0., 1.])
    """
    points = as_points(points)
    faces = as_faces(faces, len(points))
    # Scaled to about 1, so that squared areas of tiny or huge shapes stay in range.
    size = float(np.abs(points - points[0]).max()) or 1.0
    corners = ((points - points[0]) / size)[faces]
    sides = np.roll(corners, -1, axis=1) - corners  # side j runs from corner j to corner j + 1
    normal = np.cross(sides[:, 0], sides[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)

    total = np.zeros((len(points), 3))
    for corner in range(3):
        # Every corner spans the same parallelogram, so |u x v| is `length`.
        dot = -np.einsum("ij,ij->i", sides[:, corner], sides[:, corner - 1])
        weighted = unit * np.arctan2(length[:, 0], dot)[:, None]
        for axis in range(3):
            total[:, axis] += np.bincount(
                faces[:, corner], weights=weighted[:, axis], minlength=len(points)
            )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    # Below 1e-12 the faces of the vertex cancel out (a fin): rounding decides, so no normal.
    normals = np.divide(total, length, out=np.zeros_like(total), where=length > 1e-12)
    for corner in range(3):
        away = np.einsum("ij,ij->i", normals[faces[:, corner]], unit) < -FACING_AWAY
        normals[faces[away, corner]] = 0.0
    return frozen(normals, np.float64)
