"""Parts of a shape: the sheets of its skeleton, projected on the surface (thesis 6.3.3)."""

from __future__ import annotations

import numpy as np

from medialis.applications.patches import completed
from medialis.features.labels import smoothed_labels
from medialis.features.sheets import DEFAULT_TAU, medial_sheets
from medialis.features.surface_graph import surface_graph
from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.validation import as_whole_number

DEFAULT_SMALLEST = 0.01
"""Fraction of the surface. horse, cow and fertility have 17, 22 and 23 parts with 1 %, two to four
times as many without a limit."""

DEFAULT_SMOOTHING = 4
"""Rounds. Borders wander by the sample or two by which the second feature points do."""


def parts(
    shape: Shape,
    cloud: MedialCloud,
    *,
    tau: float = DEFAULT_TAU,
    smallest: float = DEFAULT_SMALLEST,
    smoothing: int = DEFAULT_SMOOTHING,
    sets: FeatureSets | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Segmentation:
    """Divide a shape into parts, one for each sheet of its skeleton.

    Parameters
    ----------
    shape : Shape
        n samples, as given to `medialis.surface_skeleton`.
    cloud : MedialCloud
        All k balls; outer ones take no part.
    tau : float
        As in `medialis.medial_sheets`.
    smallest : float
        Fraction of the surface, 0 to 1: parts that cover less are merged into the neighbour with
        the longest common border.
    smoothing : int
        0 to 100 rounds in which every sample takes the most common label round it.
    sets : FeatureSets, optional
        From `medialis.extended_feature_transform`; computed when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Segmentation
        Samples without an inner ball have the part of the nearest sample along the surface that
        has one; -1 only in components of the surface without any inner ball.

    Raises
    ------
    InvalidShapeError
        When the cloud belongs to a larger shape.
    InvalidOptionError
        When an option is out of its range.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    Each sample belongs to the sheet of its own ball, so the borders of the parts are the projected
    Y-curves. Where a limb goes over into a body without a Y-curve, as fingers do into a flat hand,
    both are one sheet and one part.

    Source: thesis 6.3.3. Deviates: small parts are merged and borders smoothed.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> medialis.parts(shape, medialis.surface_skeleton(shape)).count > 4
    True
    """
    rounds = as_whole_number(smoothing, "smoothing", low=0, high=100)
    inner = np.flatnonzero(cloud.side > 0)
    if len(inner) < len(cloud):
        cloud, sets = cloud.subset(inner), None
    sheets = medial_sheets(shape, cloud, tau=tau, smallest=smallest, sets=sets, progress=progress)
    graph = surface_graph(shape)
    labels = np.full(shape.point_count, -1, np.int32)
    labels[cloud.source] = sheets.labels
    return completed(shape, graph, smoothed_labels(labels, graph, rounds), smallest, fill=False)
