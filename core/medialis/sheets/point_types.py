"""Types of medial points: rim, sheet or Y-curve (thesis 6.2.1.2), and the A3 filter (6.2.1.3)."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.sheets.extended_features import check_sets, extended_feature_transform
from medialis.validation import IntArray, frozen


class PointType(IntEnum):
    """Type of a medial point; larger numbers are the number of contacts, A1^k."""

    NONE = 0
    """A masked ball."""
    A3 = 1
    """One contact, on the rim of a sheet, behind a convex edge, however soft."""
    SHEET = 2
    """Two contacts (A1^2), inside a sheet. Also balls of tubes and spheres, whose one contact goes
    all the way round."""
    Y_CURVE = 3
    """Three contacts (A1^3), near a curve where sheets meet."""


def point_types(
    shape: Shape,
    cloud: MedialCloud,
    *,
    sets: FeatureSets | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> IntArray:
    """Classify medial points by the number of places where their balls touch the surface.

    Parameters
    ----------
    shape : Shape
        n samples, as given to `medialis.surface_skeleton`.
    cloud : MedialCloud
        k balls of them.
    sets : FeatureSets, optional
        From `medialis.extended_feature_transform`; computed when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    (k,) int32
        A `PointType`: 0 for masked balls, 1 for A3, 2 for A1^2, m for A1^m.

    Raises
    ------
    InvalidShapeError
        When the cloud belongs to a larger shape.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    Near Y-curves a band about one sample wide has three types or more. Keep the points above type
    1 to regularize a skeleton (thesis 6.2.1.3): only its rim goes, one sample wide where the
    surface bends sharply, and nothing is torn.

    Source: thesis 6.2.1.2. Deviates: one cluster that goes round its ball is type 2, so that the
    filter leaves tubes alone.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> types = medialis.point_types(shape, cloud)
    >>> regular = cloud.subset(types > medialis.PointType.A3)
    >>> 0 < len(regular) < len(cloud)
    True
    """
    if sets is None:
        sets = extended_feature_transform(shape, cloud, progress=progress)
    check_sets(cloud, sets)
    return frozen(np.where(sets.closed, PointType.SHEET, sets.counts), np.int32)


def is_rim(sets: FeatureSets) -> NDArray[np.bool_]:
    """Return where a ball is of type A3, (k,)."""
    return (sets.counts == 1) & ~sets.closed
