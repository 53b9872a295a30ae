"""Importance of curve-skeleton candidates: the area of the surface they part (thesis 3.6.2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from medialis.curves.from_balls.candidates import CandidateMeasure, nearest_neighbours
from medialis.geodesics.geodesics import surface_walk
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_chunks
from medialis.validation import FloatArray, frozen

DIRECTIONS = 50
"""The thesis's P."""

LONGEST = 2.0
"""Diagonals: a plane cut that is longer does not lead to the other feature point."""

POINTS_A_CHUNK = 64


def area_importance(
    shape: Shape,
    cloud: MedialCloud,
    measured: CandidateMeasure,
    rows: ArrayLike,
    *,
    progress: Progress | ProgressCallback | None = None,
) -> FloatArray:
    """Estimate how much of the surface hangs on each candidate: the importance mu.

    The geodesics of a candidate and of its neighbour on the other side of the curve skeleton
    enclose two parts of the surface; mu is the area of the smaller one.

    Parameters
    ----------
    shape : Shape
        The mesh that the cloud was computed from.
    cloud : MedialCloud
        k skeleton points.
    measured : CandidateMeasure
        Of the cloud.
    rows : (c,) int
        The candidates: rows of the cloud that have a measure.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    (c,) float64
        Areas. 0 where no neighbour has a geodesic on the other side.

    Raises
    ------
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    Cost: 50 plane cuts a candidate, none of which can end early. Source: thesis 3.6.2, Eq. 3.3 to
    3.5. Deviates: b = (2 gamma - pi a) / pi, from the half perimeter pi (a + b) / 2 of an ellipse
    (the thesis divides by 2, which does not give a circle for a sphere); the angle between the
    tangents is taken with its sign, and the wedge in which it ends is shared. A cut that does not
    arrive takes the length of the nearest direction that does.
    """
    from medialis.curves.from_balls._area_kernels import add_wedges, find_opposite, trace_all_round

    progress = Progress.of(progress)
    at = np.asarray(rows, np.int64)
    if len(at) < 2:
        return frozen(np.zeros(len(at)), np.float64)
    near, distance = nearest_neighbours(cloud.centers[at], shape.diagonal)
    tangent, measure = np.ascontiguousarray(measured.tangents[at]), measured.measure[at]
    opposite = np.empty(len(at), np.int64)
    smallest = 1e-12 * shape.diagonal
    find_opposite(0, len(at), near, distance, measure, tangent, smallest, opposite)
    ends = np.ascontiguousarray(measured.ends[at])
    length = np.empty((len(at), DIRECTIONS))
    walk, longest = surface_walk(shape), LONGEST * shape.diagonal

    def trace(begin: int, end: int) -> None:
        trace_all_round(begin, end, *walk, ends, tangent, longest, length)

    run_chunks(trace, len(at), POINTS_A_CHUNK, progress=progress)
    feature = shape.points[ends[:, 1]] - shape.points[ends[:, 0]]
    half = np.linalg.norm(feature, axis=1) / 2
    axis = feature / np.maximum(2 * half, 1e-300)[:, None]
    other = tangent[opposite]
    across = np.einsum("ij,ij->i", np.cross(axis, tangent), other)
    ahead = np.einsum("ij,ij->i", tangent, other)
    opening = np.mod(np.arctan2(across, ahead), 2 * math.pi)
    opening[measured.tied[at]] = math.pi  # the second geodesic is its own
    area = np.empty(len(at))
    add_wedges(0, len(at), length, half, opening, area)
    return frozen(area, np.float64)
