"""Uniform subsampling of a medial cloud at a distance delta (thesis 3.2.1, Figure 3.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.model.medial_cloud import MedialCloud
from medialis.validation import FloatArray, as_field, as_number


def uniform_subsample(
    cloud: MedialCloud, distance: float, *, priority: ArrayLike | None = None
) -> NDArray[np.bool_]:
    """Select valid skeleton points at least `distance` apart that cover all others.

    Points are taken by falling priority; each one kept removes all points closer to it than
    `distance`. Inner and outer points are thinned together.

    Parameters
    ----------
    cloud : MedialCloud
        k skeleton points; those that are not valid are never selected.
    distance : float
        Fraction of the bounding-box diagonal of the surface, >= 0. 0 selects every valid point.
    priority : (k,) array, optional
        Larger is kept first; ties go to the lowest index. Default: the spoke angle, so that points
        with well separated feature points survive.

    Returns
    -------
    (k,) bool
        For ``cloud.subset(mask)``.

    Raises
    ------
    InvalidOptionError
        When the distance is negative or not finite.
    InvalidShapeError
        When the priority has not k rows.

    See Also
    --------
    important_points : selects points by their importance.

    Notes
    -----
    Cost O(k). Source: thesis 3.2.1. Deviates: the order, which the thesis leaves open, is stated.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> mask = medialis.uniform_subsample(cloud, 0.01)
    >>> 100 < len(cloud.subset(mask)) < len(cloud)
    True
    """
    distance = as_number(distance, "distance", low=0.0) * cloud.surface.diagonal
    if priority is None:
        priority = cloud.spoke_angles
    rank = as_field(priority, len(cloud), "priority")
    rows = np.flatnonzero(cloud.valid)
    if distance == 0.0 or len(rows) == 0:
        return cloud.valid.copy()
    order = np.argsort(-rank[rows], kind="stable")
    selected = np.zeros(len(cloud), np.bool_)
    selected[rows[points_apart(cloud.centers[rows], order, distance)]] = True
    return selected


def points_apart(
    points: FloatArray, order: NDArray[np.int64], distance: float
) -> NDArray[np.bool_]:
    """Select points at least a distance > 0 apart that cover all others, in the given order.

    Parameters
    ----------
    points : (n, 3) float64
    order : (n,) int64
        Which are taken first.
    distance : float

    Returns
    -------
    (n,) bool
    """
    from medialis.balls._subsample_kernels import keep_apart

    points = points - points.min(axis=0)
    # Cells smaller than a millionth of the extent would overflow the cell number; larger cells
    # than `distance` are still right.
    cell = max(distance, float(points.max()) * 1e-6)
    cells = np.floor(points.max(axis=0) / cell).astype(np.int64) + 2
    slots = 1 << int(2 * len(points)).bit_length()
    table_key, table_head = np.full(slots, -1, np.int64), np.full(slots, -1, np.int64)
    chain, keep = np.full(len(points), -1, np.int64), np.zeros(len(points), np.bool_)
    keep_apart(points, order, distance, cell, cells, table_key, table_head, chain, keep)
    return keep
