"""Soft edges: convex edges of a surface, sharp or blunt, at every scale (thesis 6.3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.sheets.extended_features import extended_feature_transform
from medialis.validation import FloatArray, frozen


@dataclass(frozen=True, eq=False)
class SoftEdges:
    """Convex edges as fields on the surface.

    Attributes
    ----------
    radius : (n,) float64
        Radius of the smallest A3 ball that touches each sample, in the units of the shape: how
        blunt the edge is. inf where there is no edge.
    angle : (n,) float64
        Radians: by how much the surface turns across the edge, at most, over these balls; 0 where
        there is no edge.

    Raises
    ------
    InvalidShapeError
        When the arrays are not of equal length.
    """

    radius: FloatArray
    angle: FloatArray

    def __post_init__(self) -> None:
        radius, angle = np.asarray(self.radius), np.asarray(self.angle)
        if radius.ndim != 1 or angle.shape != radius.shape:
            raise InvalidShapeError(
                f"radius and angle must be two (n,) arrays, got {radius.shape}, {angle.shape}."
            )
        object.__setattr__(self, "radius", frozen(radius, np.float64))
        object.__setattr__(self, "angle", frozen(angle, np.float64))

    @property
    def sharpness(self) -> FloatArray:
        """Share of a right angle by which the surface turns across the edge, (n,), 0 to 1."""
        return np.minimum(self.angle / (np.pi / 2), 1.0)

    def on_edge(self, min_angle: float) -> NDArray[np.bool_]:
        """Return the samples on edges that turn by at least this many radians, (n,)."""
        return self.angle >= max(min_angle, np.finfo(np.float64).tiny)


def soft_edges(
    shape: Shape,
    cloud: MedialCloud,
    *,
    sets: FeatureSets | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> SoftEdges:
    """Find the convex edges of a surface, with how blunt they are and how far they turn.

    Parameters
    ----------
    shape : Shape
        n samples, as given to `medialis.surface_skeleton`.
    cloud : MedialCloud
        k balls. Inner balls find convex edges, outer ones concave edges.
    sets : FeatureSets, optional
        From `medialis.extended_feature_transform`; computed when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    SoftEdges

    Raises
    ------
    InvalidShapeError
        When the cloud belongs to a larger shape.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    The rim of the skeleton (A3 points) lies behind edges; every sample in the feature set of such a
    ball is on one. The angle across it follows from the normals: two walls that turn by 2 t have
    unit normals whose mean is cos(t) long.

    Source: thesis 6.3.1. Deviates: samples off every edge have the radius inf, not the largest
    distance; the angle is new.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> edges = medialis.soft_edges(shape, medialis.surface_skeleton(shape))
    >>> bool(edges.radius.min() < 0.03)  # the tips of ears and tail
    True
    """
    if sets is None:
        sets = extended_feature_transform(cloud, progress=progress)
    from medialis.sheets._feature_set_kernels import smallest_at_samples

    n = cloud.surface.point_count
    radius, angle = np.full(n, np.inf), np.zeros(n)
    turns = 2.0 * np.arccos(np.clip(np.nan_to_num(sets.agreement), 0.0, 1.0))
    members = sets.samples.offsets, sets.samples.indices
    smallest_at_samples(sets.rim, cloud.radii, turns, *members, radius, angle)
    return SoftEdges(radius, angle)
