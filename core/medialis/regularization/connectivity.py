"""Connected importance: thresholding that never leaves islands (thesis 3.3).

The thesis notes that the geodesic importance is monotone in practice, not by construction: a foot
that is wider than its leg stays when the leg has gone. Islands of that kind are lowered to the
importance at which they join the larger piece.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from medialis.errors import InvalidShapeError
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.validation import FloatArray, as_field, as_number, frozen

DEFAULT_LINK = 0.02
"""Fraction of the diagonal: neighbours whose centers are further apart are not linked."""


def connected_importance(
    shape: Shape, cloud: MedialCloud, importance: ArrayLike, *, link: float = DEFAULT_LINK
) -> FloatArray:
    """Lower the importance of what a threshold would cut off from the larger rest.

    Two skeleton points are linked when their samples share an edge of the mesh, or one is the
    second feature point of the other, and their centers are at most `link` apart. Above every
    threshold the points of the result are linked in one piece for each piece of the shape; a piece
    that no link reaches gets importance 0.

    Parameters
    ----------
    shape : Shape
        The mesh that the cloud was computed from, n vertices.
    cloud : MedialCloud
        All n inner balls: row i belongs to vertex i.
    importance : (n,) float
        ``geodesic_importance(...).length``.
    link : float
        Fraction of the bounding-box diagonal, above 0 to 1.

    Returns
    -------
    (n,) float64
        At most the given importance; NaN where that is NaN.

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, or the cloud is not the whole inner cloud of the shape.
    InvalidOptionError
        When `link` is out of its range.

    Notes
    -----
    Cost O(n log n). Of two pieces the one with fewer points is the island. Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(100)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> plain = medialis.geodesic_importance(shape, cloud).length
    >>> connected = medialis.connected_importance(shape, cloud, plain)
    >>> bool((connected[cloud.valid] <= plain[cloud.valid]).all())
    True
    """
    from medialis.regularization._connectivity_kernels import lower_islands

    link = as_number(link, "link", low=0.0, high=1.0, open_low=True)
    n = shape.point_count
    if shape.faces is None:
        raise InvalidShapeError("Connected importance needs a mesh: this shape has no faces.")
    if len(cloud) != n or (cloud.side < 0).any() or (cloud.source != np.arange(n)).any():
        raise InvalidShapeError(
            f"Connected importance needs the whole inner cloud of the shape, {n} rows in their "
            f"order; got {len(cloud)} rows."
        )
    values = np.array(as_field(importance, n, "importance"))
    links = np.concatenate([shape.edges, cloud.features[cloud.valid]])
    usable = (links[:, 0] != links[:, 1]) & (cloud.valid & ~np.isnan(values))[links].all(axis=1)
    links = links[usable].astype(np.int64)
    reach = np.linalg.norm(cloud.centers[links[:, 0]] - cloud.centers[links[:, 1]], axis=1)
    strength = np.minimum(values[links[:, 0]], values[links[:, 1]])
    # Neighbours that are too far apart join only at importance 0.
    strength[reach > link * shape.diagonal] = 0.0
    falling = np.argsort(-strength, kind="stable")
    lower_islands(np.ascontiguousarray(links[falling]), strength[falling], values)
    return frozen(values, np.float64)
