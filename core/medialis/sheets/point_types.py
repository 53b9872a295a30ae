"""Types of medial points: rim, sheet or Y-curve (thesis 6.2.1.2), and the A3 filter (6.2.1.3)."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from medialis.balls.surface_skeleton import as_cloud
from medialis.model.medial_cloud import MedialCloud
from medialis.options import Options, algorithm
from medialis.progress import Progress
from medialis.sheets.extended_features import extended_feature_transform
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


@algorithm(Options, keep=False, door=as_cloud)
def point_types(cloud: MedialCloud, options: Options, progress: Progress) -> IntArray:
    """Classify medial points by the number of places where their balls touch the surface.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.

    Returns
    -------
    (k,) int32
        A `PointType`: 0 for masked balls, 1 for A3, 2 for A1^2, m for A1^m.

    See Also
    --------
    extended_feature_transform : the samples that each ball touches.

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
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> types = medialis.point_types(cloud)
    >>> regular = cloud.subset(types > medialis.PointType.A3)
    >>> 0 < len(regular) < len(cloud)
    True
    """
    sets = extended_feature_transform.of(cloud, options, progress)
    return frozen(np.where(sets.closed, PointType.SHEET, sets.counts), np.int32)
