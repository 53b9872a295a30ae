"""GeodesicPaths: lengths and end tangents of geodesics between pairs of vertices (thesis 3.3)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Bound
from medialis.model.medial_cloud import MedialCloud
from medialis.validation import FloatArray, hold


class PathStatus(IntEnum):
    """How the length of a geodesic was found."""

    NONE = 0
    """There is no path, as the ends lie in different components, or the pair is masked."""
    PLANE = 1
    """A cut of the surface by a plane through the ends, shortened to a locally shortest path (or a
    common edge)."""
    EDGES = 2
    """The shortest path along the edges, where no plane cut arrives (holes, non-manifold edges).
    For a polyline: it was shortened from the path along the edges, as that is shorter."""
    NEIGHBOUR = 3
    """Along edges to the ends of a neighbouring path, and along that; shorter than its own."""


@dataclass(frozen=True, eq=False, repr=False)
class GeodesicPaths(Bound):
    """One geodesic for each of k pairs of vertices.

    Attributes
    ----------
    length : (k,) float64
        Length of the path in the units of the shape. +inf: there is no path, the ends lie in
        different components. NaN: the pair is masked (a ball without a second feature point).
    start_tangent, end_tangent : (k, 3) float64
        Unit direction of the path as it leaves the first vertex (t_s of the thesis) and as it
        arrives at the second one (t_e); NaN where there is no path or the ends coincide.
    status : (k,) int8
        A `PathStatus`.

    Raises
    ------
    InvalidShapeError
        When the arrays do not have the same number of rows.
    """

    length: FloatArray
    start_tangent: FloatArray
    end_tangent: FloatArray
    status: NDArray[np.int8]

    def __post_init__(self) -> None:
        k = len(self.length)
        hold(
            self,
            length=(np.float64, k),
            start_tangent=(np.float64, k, 3),
            end_tangent=(np.float64, k, 3),
            status=(np.int8, k),
        )

    def __len__(self) -> int:
        return len(self.length)

    @property
    def reached(self) -> NDArray[np.bool_]:
        """True where a path was found, (k,)."""
        return self.status != PathStatus.NONE

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self)} paths, {int(self.reached.sum())} arrive)"


@dataclass(frozen=True, eq=False, repr=False)
class Importance(GeodesicPaths):
    """Geodesics between the feature points of the balls of a cloud: their lengths are importance.

    Attributes
    ----------
    cloud : MedialCloud
        The k skeleton points. After `medialis.connected_importance`, ``length`` is lower than the
        path on islands, and higher on bridges.
    """

    cloud: MedialCloud = field(kw_only=True)
