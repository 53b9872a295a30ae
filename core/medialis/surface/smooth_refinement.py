"""Samples of the smooth surface that a mesh stands for, between its vertices (thesis 3.2.1).

Refinement puts new vertices on the facets of a mesh. Facets of smooth parts are chords: samples
there lie inside the smooth surface, and their balls would be those of a polyhedron. So new vertices
move out to the smooth surface, by how far it bulges over the facets (`Creases`). Where a mesh is
flat nothing moves; on creases, samples move to where the surfaces of both sides meet.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from medialis.model.shape import Shape
from medialis.model.surface import Surface
from medialis.surface._long_edges import has_new
from medialis.surface.creases import Creases
from medialis.surface.normals import mean_normals
from medialis.validation import FloatArray

APART = 0.05
"""Share of the largest eigenvalue of the sum of n n^T over the faces at a vertex above which the
others count: the second one of two normals 26 degrees apart."""

TURN = math.cos(math.radians(30.0))
"""Cosine of the angle by which a face may turn: more would be a crease."""


def on_smooth_surface(shape: Shape, fine: Shape, creases: Creases) -> Shape:
    """Move the new vertices of a refined mesh to the smooth surface through the given ones.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    fine : Shape
        ``refine(shape)``: the n vertices first.
    creases : Creases
        Of `shape`.

    Returns
    -------
    Shape
        `fine` with other places and normals of its new vertices.

    Notes
    -----
    With the bulges h_f and normals n_f of the faces f at a new vertex, it moves by the shortest d
    with n_f.d = h_f. Cost O(n), and 1 us for each vertex on an edge.
    """
    from medialis._kernels.nearest import nearest_on_triangles

    n = shape.point_count
    assert shape.faces is not None and fine.faces is not None and fine.face_origin is not None
    vertex, face = _vertices_of_faces(fine, n)
    corners = np.asarray(shape.faces)[face]
    weights = nearest_on_triangles(fine.points[vertex], shape.points[corners])
    normals = np.einsum("ij,ijk->ik", weights, creases.corner_normals(face))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.5)
    pairs = weights * weights[:, [1, 2, 0]]
    height = np.einsum("ij,ij->i", pairs, creases.own_bulges[face])
    step, mean, on_crease = _common_steps(vertex - n, normals, height, fine.point_count - n)
    points = _unfolded(fine, n, np.concatenate([np.zeros((n, 3)), step]))
    around = mean_normals(points, np.asarray(fine.faces)[has_new(fine.faces, n)])
    directions = np.array(fine.normals)
    smooth = ~on_crease & mean.any(axis=1)
    directions[n:] = np.where(smooth[:, None], mean, around[n:])
    return replace(fine, points=points, normals=directions)


def _unfolded(fine: Shape, n: int, step: FloatArray) -> NDArray[np.float64]:
    """Return the moved points, but where a face would turn by more than what a mesh may be off.

    There, at slivers and on limbs thinner than their bulge, vertices stay on their facets.
    """
    faces = np.asarray(fine.faces)
    faces = faces[has_new(faces, n)]
    before = Surface(fine.points, faces).face_normals
    points = fine.points + step
    while True:
        turned = np.einsum("ij,ij->i", Surface(points, faces).face_normals, before) < TURN
        stay = np.unique(faces[turned & before.any(axis=1)])
        stay = stay[(points[stay] != fine.points[stay]).any(axis=1)]
        if len(stay) == 0:
            return points
        points[stay] = fine.points[stay]


def _vertices_of_faces(fine: Shape, n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the new vertices and the given faces that they lie on, each pair once."""
    flat = np.asarray(fine.faces).ravel().astype(np.int64)
    given = np.repeat(np.asarray(fine.face_origin, np.int64), 3)
    new = flat >= n
    count = int(given.max(initial=0)) + 1
    keys = np.unique(flat[new] * count + given[new])
    vertex, face = np.divmod(keys, count)
    return vertex, face


def _common_steps(
    vertex: NDArray[np.int64], normals: FloatArray, height: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return the step, the mean normal and whether sides are apart, for each vertex."""
    outer = normals[:, :, None] * normals[:, None, :]
    total = np.stack(
        [np.bincount(vertex, outer[:, i, j], count) for i in range(3) for j in range(3)]
    )
    right = np.stack([np.bincount(vertex, height * normals[:, j], count) for j in range(3)], axis=1)
    mean = np.stack([np.bincount(vertex, normals[:, j], count) for j in range(3)], axis=1)
    faces = np.bincount(vertex, minlength=count)
    step = right / np.maximum(faces, 1)[:, None]
    several = np.flatnonzero(faces > 1)
    values, axes = np.linalg.eigh(total.T.reshape(-1, 3, 3)[several])
    apart = values > APART * values[:, -1:]
    along = np.einsum("ikj,ik->ij", axes, right[several])
    along = np.divide(along, values, out=np.zeros_like(along), where=apart & (values > 0))
    step[several] = np.einsum("ikj,ij->ik", axes, along)
    on_crease = np.zeros(count, np.bool_)
    on_crease[several] = apart.sum(axis=1) > 1
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    return step, np.divide(mean, length, out=np.zeros_like(mean), where=length > 0.5), on_crease
