"""Geodesic importance of skeleton points, thresholding, and local measures (thesis 3.3)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.geodesics.geodesics import DEFAULT_DIRECTIONS, geodesic_lengths
from medialis.geodesics.relaxation import relax
from medialis.model.geodesic_paths import GeodesicPaths, Importance
from medialis.model.medial_cloud import Balls, MedialCloud
from medialis.model.shape import Shape
from medialis.options import Options, algorithm, whole
from medialis.progress import Progress
from medialis.validation import FloatArray, as_field, as_number


@dataclass(frozen=True, kw_only=True)
class ImportanceOptions(Options):
    """Options of `geodesic_importance`."""

    directions: int = whole(
        DEFAULT_DIRECTIONS,
        "Directions",
        "Directions in which each geodesic is tried. More find shorter paths in strongly folded "
        "places and take longer.",
        low=2,
        high=1000,
        advanced=True,
    )


@algorithm(ImportanceOptions)
def geodesic_importance(
    cloud: MedialCloud, options: ImportanceOptions, progress: Progress
) -> Importance:
    """Compute the importance of each skeleton point: the geodesic between its feature points.

    It grows from the boundary of the skeleton inwards, so thresholding it (`important_points`)
    removes what small bumps and noise made, and keeps the rest in one piece.

    Parameters
    ----------
    cloud : MedialCloud
        k skeleton points of a mesh.
    directions : int
        As in `medialis.geodesic_lengths`.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Importance
        One path for each ball. Its ``length`` (k,) is the importance, in the units of the shape:
        NaN for a masked ball, +inf where the feature points lie in different components (such a
        point is always kept).

    Raises
    ------
    InvalidShapeError
        When the shape is a point cloud: use `local_measures`, which need no surface.
    InvalidOptionError
        When `directions` is out of its range.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    Source: thesis 3.3.1-3.3.2; see `medialis.geodesic_lengths`. Deviates: where the way through the
    feature points of neighbouring balls is shorter, it is taken (status NEIGHBOUR).

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(100))
    >>> importance = medialis.geodesic_importance(cloud)
    >>> simple = cloud.subset(importance.length >= 0.05 * cloud.surface.diagonal)
    >>> 0 < len(simple) < len(cloud)
    True
    """
    pairs = np.where(cloud.valid[:, None], cloud.features, -1)
    paths = geodesic_lengths(cloud.surface, pairs, directions=options.directions, progress=progress)
    known = vars(relax(cloud.surface, cloud, paths))
    return Importance(**{f.name: known[f.name] for f in fields(GeodesicPaths)}, cloud=cloud)


def important_points(shape: Shape, importance: ArrayLike, threshold: float) -> NDArray[np.bool_]:
    """Select the skeleton points whose importance reaches a threshold.

    Parameters
    ----------
    shape : Shape
        Gives the unit of the threshold.
    importance : (k,) float
        ``geodesic_importance(...).length``. NaN is dropped, +inf kept.
    threshold : float
        Fraction of the bounding-box diagonal, 0 to 10.

    Returns
    -------
    (k,) bool
        For ``cloud.subset(mask)``; any threshold, without recomputation.

    Raises
    ------
    InvalidOptionError
        When the threshold is out of its range.
    InvalidShapeError
        When the importance is not one number for each point.
    """
    threshold = as_number(threshold, "threshold", low=0.0, high=10.0)
    values = as_field(importance, np.size(importance), "importance")
    return np.asarray(values >= threshold * shape.diagonal)


def local_measures(shape: Shape, cloud: MedialCloud) -> dict[str, FloatArray]:
    """Compute the importance measures that need no surface, for comparison.

    They are not monotone: thresholding them can tear the skeleton apart (thesis 3.3).

    Parameters
    ----------
    shape : Shape
        The shape that the cloud was computed from.
    cloud : MedialCloud
        k skeleton points.

    Returns
    -------
    dict of (k,) float64
        ``spoke_angle``: radians (theta-SMA). ``radius``: of the ball. ``feature_radius``: half the
        distance of the feature points, the radius of the smallest ball that holds both (the
        lambda medial axis). ``radius_ratio``: feature_radius / radius, 0..1. NaN where masked.

    Notes
    -----
    Cost O(k). Source: thesis 3.2 and 3.3 (theta-SMA), 2.3.4 for the others.
    """
    return measures_of_points(shape.points, cloud)


def measures_of_points(points: FloatArray, cloud: Balls) -> dict[str, FloatArray]:
    """Compute `local_measures` from the samples (n, 3) alone."""
    valid = cloud.valid
    half = np.full(len(cloud), np.nan)
    ends = points[cloud.features[valid]]
    half[valid] = 0.5 * np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    radius = np.where(valid, cloud.radii, np.nan)
    return {
        "spoke_angle": np.where(valid, cloud.spoke_angles, np.nan),
        "radius": radius,
        "feature_radius": half,
        "radius_ratio": np.minimum(half / radius, 1.0),
    }
