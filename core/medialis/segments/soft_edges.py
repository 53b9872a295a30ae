"""Soft edges: convex edges of a surface, sharp or blunt, at every scale (thesis 6.3.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import as_cloud
from medialis.kept import Bound
from medialis.model.medial_cloud import MedialCloud
from medialis.options import Options, algorithm
from medialis.progress import Progress
from medialis.sheets.extended_features import extended_feature_transform
from medialis.validation import FloatArray, hold


@dataclass(frozen=True, eq=False, repr=False)
class SoftEdges(Bound):
    """Edges as fields on the n samples of a surface.

    Attributes
    ----------
    radius : (n,) float64
        Radius of the smallest A3 ball that touches each sample, in the units of the shape: how
        blunt the edge is. inf where there is no edge.
    angle : (n,) float64
        Radians: by how much the surface turns across the edge, at most, over these balls; 0 where
        there is no edge.
    rim : (k,) bool
        True for the A3 balls.
    cloud : MedialCloud
        The k balls: inner ones lie behind convex edges, outer ones behind concave edges.

    Raises
    ------
    InvalidShapeError
        When the arrays do not have one value a sample or ball.
    """

    radius: FloatArray
    angle: FloatArray
    rim: NDArray[np.bool_]
    cloud: MedialCloud = field(kw_only=True)

    def __post_init__(self) -> None:
        n, k = self.cloud.surface.point_count, len(self.cloud)
        hold(
            self,
            radius=(np.float64, n),
            angle=(np.float64, n),
            rim=(np.bool_, k),
        )

    def __repr__(self) -> str:
        count = int(np.isfinite(self.radius).sum())
        return f"SoftEdges({count} of {len(self.radius)} samples on edges)"

    @property
    def sharpness(self) -> FloatArray:
        """Share of a right angle by which the surface turns across the edge, (n,), 0 to 1."""
        return np.minimum(self.angle / (np.pi / 2), 1.0)

    def on_edge(self, min_angle: float) -> NDArray[np.bool_]:
        """Return the samples on edges that turn by at least this many degrees, (n,)."""
        return self.angle >= max(math.radians(min_angle), np.finfo(np.float64).tiny)


@dataclass(frozen=True, kw_only=True)
class SoftEdgeOptions(Options):
    """Options of `soft_edges`: none, it has no scale to choose."""


@algorithm(SoftEdgeOptions, door=as_cloud)
def soft_edges(cloud: MedialCloud, options: SoftEdgeOptions, progress: Progress) -> SoftEdges:
    """Find the edges of a surface, with how blunt they are and how far they turn.

    Parameters
    ----------
    cloud : MedialCloud
        k balls. Inner balls find convex edges, outer ones concave edges.

    Returns
    -------
    SoftEdges

    See Also
    --------
    patches : the surface divided along its edges.
    extended_feature_transform : the samples that each ball touches.

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
    >>> edges = medialis.soft_edges(medialis.surface_skeleton(medialis.organic_shape(56)))
    >>> bool(edges.radius.min() < 0.03)  # the tips of ears and tail
    True
    """
    from medialis.sheets._feature_set_kernels import smallest_at_samples

    sets = extended_feature_transform.of(cloud, options, progress)
    n = cloud.surface.point_count
    radius, angle = np.full(n, np.inf), np.zeros(n)
    turns = 2.0 * np.arccos(np.clip(np.nan_to_num(sets.agreement), 0.0, 1.0))
    members = sets.samples.offsets, sets.samples.indices
    smallest_at_samples(sets.rim, cloud.radii, turns, *members, radius, angle)
    return SoftEdges(radius, angle, sets.rim, cloud=cloud)
