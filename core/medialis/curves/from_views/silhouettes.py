"""Saliency skeletons of silhouettes, and the matching of two by depth (thesis 3.7.3, 3.7.4).

A silhouette skeleton is known by where the rows of the picture cross it, at sub-pixel columns
(`skeletonize`). Two views of a pair have the same rows: crossings whose depths agree are points
near the curve skeleton (`pair_points`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described
from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, number
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray
from medialis.curves.from_views.view import View


@dataclass(frozen=True, kw_only=True)
class SilhouetteOptions(Options):
    """Options of `silhouette_skeleton`."""

    saliency: float = number(
        1.0,
        "Saliency",
        "Silhouette skeletons keep places where the contour between the two nearest contour points "
        "is longer than this many times their distance. Higher values keep less.",
        high=1000.0,
        advanced=True,
    )


@dataclass(frozen=True, eq=False, repr=False)
class Crossings(Described):
    """Where the rows of a picture cross the skeleton of the silhouette in it.

    Attributes
    ----------
    begin : (h + 1,) int32
        Crossings of row r have the numbers begin[r]..begin[r + 1].
    column : (s,) float64
        Sub-pixel column, ascending within a row; pixel centers lie at halves.
    importance : (s,) float64
        Length of the contour between the two feature points, in pixels (rho).
    distance : (s,) float64
        Distance to the contour, in pixels (DT).
    """

    begin: IntArray
    column: FloatArray
    importance: FloatArray
    distance: FloatArray

    @property
    def row(self) -> IntArray:
        """Row of each crossing, (s,)."""
        return np.repeat(np.arange(len(self.begin) - 1, dtype=np.int32), np.diff(self.begin))


class Scratch:
    """Room for the silhouettes of one size, used again from view to view; one for each thread."""

    def __init__(self, size: int) -> None:
        self.offset = np.zeros((size, size), np.int32)
        self.upright = np.empty((size, size), np.int32)
        self.flat = np.empty((size, size), np.int32)
        self.rows = np.empty((6, size + 2), np.int64)
        self.down = np.empty(size, np.int32)


def check_border(near: NDArray[np.float32]) -> None:
    """Raise when a silhouette touches the border of its picture.

    Raises
    ------
    InvalidShapeError
        Then the shape may reach beyond the picture.
    """
    sides = (near[0], near[-1], near[:, 0], near[:, -1])
    if not all(np.isnan(side).all() for side in sides):
        raise InvalidShapeError(
            "A silhouette touches the border of its picture: the camera must see the whole shape "
            "with a margin of one pixel."
        )


NO_FIELD = np.empty((0, 0), np.float32)


def skeletonize(
    near: NDArray[np.float32],
    saliency: float,
    scratch: Scratch,
    field: NDArray[np.float32] = NO_FIELD,
) -> Crossings:
    """Return the crossings of a silhouette, given as a picture that is NaN outside it.

    The border of the picture must be outside. A `field` (h, w) gets the distance transform:
    negative at pixels beside the skeleton; what lies outside stays as it is.
    """
    from medialis.curves.from_views._kernels import (
        column_offsets,
        saliency_skeleton,
        trace_contours,
    )

    cracks, pixels, first, last = column_offsets(near, scratch.down, scratch.offset)
    arc, contour = np.empty(cracks), np.empty(cracks, np.int32)
    length = np.empty(cracks // 4)  # a contour has 4 cracks at least
    contours, _ = trace_contours(
        scratch.offset, first, last, scratch.upright, scratch.flat, arc, contour, length
    )
    longest = float(length[:contours].sum()) / 2
    begin = np.empty(len(near) + 1, np.int32)
    out = np.empty((3, pixels))  # at most one crossing a pixel
    count = saliency_skeleton(
        scratch.offset,
        first,
        last,
        (scratch.upright, scratch.flat, arc, contour, length, longest),
        saliency,
        scratch.rows,
        begin,
        out[0],
        out[1],
        out[2],
        field,
    )
    column, importance, distance = (values[:count].copy() for values in out)
    return Crossings(begin, column, importance, distance)


@algorithm(SilhouetteOptions, keep=False)
def silhouette_skeleton(
    mask: ArrayLike, options: SilhouetteOptions, progress: Progress
) -> Crossings:
    """Return the saliency skeleton of a binary picture where its rows cross it.

    Parameters
    ----------
    mask : (h, w) bool
        True inside.

    Returns
    -------
    Crossings
        For the crossings of the columns give the transposed picture.

    Raises
    ------
    InvalidShapeError
        When the mask is not a picture.

    See Also
    --------
    view_curve_skeleton : matches the silhouettes of many views.

    Notes
    -----
    Feature points are exact: the nearest pixels outside. The skeleton passes between two neighbours
    in a row whose feature points are far apart along the contour, where the row is as far from the
    one as from the other. Different contours count as the longest. Source: thesis 3.7.3, Eq. 3.6 to
    3.8; `saliency` is sigma_0. Deviates: importance is compared along rows only, since the pairing
    of views needs no more.

    Examples
    --------
    >>> import medialis
    >>> bar = np.zeros((40, 20))
    >>> bar[5:35, 6:13] = 1
    >>> middle = medialis.silhouette_skeleton(bar)
    >>> set(middle.column[(middle.row > 12) & (middle.row < 27)].tolist())
    {9.5}
    """
    array = np.asarray(mask)
    if array.ndim != 2 or array.dtype.kind not in "biuf" or array.size == 0:
        raise InvalidShapeError(
            f"mask must be an (h, w) picture of truth values, got shape {array.shape}."
        )
    height, width = array.shape
    edge = max(height, width) + 2
    near = np.full((edge, edge), np.nan, np.float32)
    near[1 : height + 1, 1 : width + 1][array != 0] = 0.0
    framed = skeletonize(near, options.saliency, Scratch(edge))
    return Crossings(
        framed.begin[1 : height + 2], framed.column - 1, framed.importance, framed.distance
    )


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
    from medialis.curves.from_views._kernels import pair_crossings

    a, b = first.camera, second.camera
    angle = math.atan2(-float(b.axes[0] @ a.axes[2]), float(b.axes[0] @ a.axes[0]))
    out = np.empty((len(left.column), 3))
    count = pair_crossings(
        left.begin, left.column, first.near, first.far,
        right.begin, right.column, second.near, second.far,
        a.pixel, math.cos(angle), math.sin(angle), out,
    )  # fmt: skip
    return np.einsum("ij,jk->ik", out[:count], a.axes) + a.center
