"""Vertex normals of meshes (input of thesis 3.2)."""

from __future__ import annotations

import math

import numpy as np

from medialis.model.ragged import Ragged
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray, as_faces, as_points, frozen

FACING_AWAY = 1e-6
"""Cosine beyond which a face looks away from the normal: above rounding, so that the rim of a flat
double-sided sheet, exactly at right angles to its faces, keeps its normal."""

SHARP = 30.0
"""Degrees: edges that bend by more are creases (as by default in `surface_skeleton`)."""

VERTICES_A_CHUNK = 4096


def vertex_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Compute unit vertex normals: those of the smooth surface through each vertex and its ring.

    At creases, where two edges at a vertex bend by more than 30 degrees, and at borders, it is the
    mean of the face normals, weighted by the angle of the face at the vertex. These weights depend
    on the faces only, not on how they are cut into triangles.

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

    Notes
    -----
    The surface has the second order and is found by least squares; it is exact on spheres and
    planes. On irregular meshes of smooth shapes means of face normals are 1 to 2 degrees off, four
    to six times as much: slim faces are inclined however smooth the shape is. Cost O(m), parallel.

    Examples
    --------
    >>> vertex_normals([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])[0]
    array([0., 0., 1.])
    """
    return _normals(points, faces, smooth=True)


def mean_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return the means of the face normals by angle that `vertex_normals` has at creases, (n, 3).

    For vertices on flat faces and straight edges: what refinement makes.
    """
    return _normals(points, faces, smooth=False)


def _normals(points: FloatArray, faces: IntArray, *, smooth: bool) -> FloatArray:
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis.model._surface_kernels import cross_faces
    from medialis.surface._normal_kernels import fill_normals

    points = as_points(points)
    faces = as_faces(faces, len(points))
    # Scaled to about 1, so that squared areas of tiny or huge shapes stay in range.
    size = float(np.abs(points - points[0]).max()) or 1.0
    local = (points - points[0]) / size
    units = np.empty((len(faces), 3))
    cross_faces(local, faces, units)
    length = np.sqrt(np.einsum("ij,ij->i", units, units))[:, None]
    np.divide(units, length, out=units, where=length > 0)
    fans = Ragged.group(faces.ravel(), len(points))
    normals, crease = np.zeros((len(points), 3)), math.cos(math.radians(SHARP))

    def fill(begin: int, end: int) -> None:
        fill_normals(
            begin, end, local, faces, units, fans.offsets, fans.indices, crease, FACING_AWAY,
            smooth, normals,
        )  # fmt: skip

    run_chunks(fill, len(points), VERTICES_A_CHUNK)
    return frozen(normals, np.float64)
