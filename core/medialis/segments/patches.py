"""Patches: the faces of a surface between its convex edges (thesis 6.3.2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.segments.soft_edges import soft_edges
from medialis.surface.labels import (
    fill_components,
    merge_small,
    numbered_by_weight,
    spread_labels,
)
from medialis.surface.surface_graph import surface_graph
from medialis.validation import FloatArray, IntArray, as_number

DEFAULT_MIN_ANGLE = math.radians(30.0)
"""Radians. At 30 degrees, gears, fandisk and rockerarm are divided along the edges that one would
draw, and the body of the horse stays one patch."""

DEFAULT_SMALLEST = 0.002
"""Fraction of the surface."""

LEAST_SAMPLES = 8
"""A piece between edges of fewer samples is no patch: it joins the nearest one."""


def patches(
    shape: Shape,
    cloud: MedialCloud,
    *,
    min_angle: float = DEFAULT_MIN_ANGLE,
    smallest: float = DEFAULT_SMALLEST,
    sets: FeatureSets | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Segmentation:
    """Divide a surface into patches along its edges, sharp or soft.

    Parameters
    ----------
    shape : Shape
        n samples, as given to `medialis.surface_skeleton`.
    cloud : MedialCloud
        k balls: inner ones for convex edges, outer ones for concave edges, or both.
    min_angle : float
        Radians, 0 to pi: edges across which the surface turns by less do not separate.
    smallest : float
        Fraction of the surface, 0 to 1: patches that cover less are merged into the neighbour with
        the longest common border.
    sets : FeatureSets, optional
        From `medialis.extended_feature_transform`; computed when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Segmentation
        Every sample has a patch; components of the surface are never joined.

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
    All samples on edges (`medialis.soft_edges`) are taken out; what stays connected is a patch. The
    samples of the edges then join the nearest patch along the surface.

    Source: thesis 6.3.2. Deviates: weak edges do not count, small pieces are merged, and with outer
    balls concave edges separate as well.

    Examples
    --------
    >>> import medialis
    >>> x = [[x, y, z] for x in (0, 4) for y in (0, 3) for z in (0, 2)]
    >>> q = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = [t for a, b, c, d in q for t in ((a, b, c), (a, c, d))]
    >>> box = medialis.refine(medialis.make_shape(x, faces), 0.2)
    >>> medialis.patches(box, medialis.surface_skeleton(box)).count
    6
    """
    smallest = as_number(smallest, "smallest", low=0.0, high=1.0)
    min_angle = as_number(min_angle, "min_angle", low=0.0, high=math.pi)
    edges = soft_edges(shape, cloud, sets=sets, progress=progress)
    graph = surface_graph(shape)
    labels = _pieces(graph, ~edges.on_edge(min_angle))
    size = np.bincount(labels[labels >= 0], minlength=1)
    labels[size[labels] < LEAST_SAMPLES] = -1
    return completed(shape, graph, labels, smallest)


def _pieces(graph: Ragged, kept: NDArray[np.bool_]) -> IntArray:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n = len(graph)
    at = np.repeat(np.arange(n), graph.lengths)
    links = kept[at] & kept[graph.indices]
    matrix = csr_array(
        (np.ones(int(links.sum()), np.int8), (at[links], graph.indices[links])), shape=(n, n)
    )
    return np.where(kept, connected_components(matrix, directed=False)[1], -1).astype(np.int32)


def completed(
    shape: Shape, graph: Ragged, labels: IntArray, smallest: float, *, fill: bool = True
) -> Segmentation:
    """Spread labels over the samples without one, merge small segments, number them by area.

    `fill`: a component of the surface without any label is a segment of its own.
    """
    area: FloatArray = shape.point_areas
    labels = spread_labels(shape, graph, labels)
    if fill:
        labels = fill_components(shape, labels, np.ones(len(labels), np.bool_))
    if smallest > 0.0:
        labels = merge_small(labels, area, graph, smallest * float(area.sum()))
    labels = numbered_by_weight(labels, area)
    count = int(labels.max(initial=-1)) + 1
    rows = labels >= 0
    total = np.bincount(labels[rows], area[rows], minlength=count)
    return Segmentation(labels, total.astype(np.float64))
