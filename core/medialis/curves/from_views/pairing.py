"""Matching two silhouette skeletons by depth: candidates of the curve skeleton (thesis 3.7.4)."""

from __future__ import annotations

import math

import numpy as np

from medialis.curves.from_views.silhouettes import Crossings
from medialis.model.view import View
from medialis.validation import FloatArray


def pair_points(first: View, second: View, left: Crossings, right: Crossings) -> FloatArray:
    """Return the 3D points of two silhouette skeletons whose rows correspond.

    Parameters
    ----------
    first, second : View
        With the same center, extent and up-axis (`check_views`).
    left, right : Crossings
        Of the one and of the other.

    Returns
    -------
    (k, 3) float64
        In the units and axes of the shape.

    Notes
    -----
    Each crossing of the first view takes the crossing in the same row of the second whose depth is
    nearest to the middle of its depth range. A point outside the depth range of either is dropped.
    Source: thesis 3.7.4.2, Eq. 3.9, 3.10, with the early stop.
    """
    from medialis.curves.from_views._pairing_kernels import pair_crossings

    a, b = first.camera, second.camera
    angle = math.atan2(-float(b.axes[0] @ a.axes[2]), float(b.axes[0] @ a.axes[0]))
    out = np.empty((len(left.column), 3))
    count = pair_crossings(
        left.begin, left.column, first.near, first.far,
        right.begin, right.column, second.near, second.far,
        a.pixel, math.cos(angle), math.sin(angle), out,
    )  # fmt: skip
    return np.einsum("ij,jk->ik", out[:count], a.axes) + a.center
