"""A surface through the points of a cloud, for operations that need one (before thesis 3.3).

Delaunay tetrahedra are told inside from outside by the oriented normals of their corners; the
surface is where the two meet. Its vertices are the samples: indices and balls stay what they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.shape import Shape
from medialis.surface.given_shapes import ShapeLike, as_shape

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
    return replace(shape, faces=triangles.astype(np.int32), face_map=None, face_origin=None)
