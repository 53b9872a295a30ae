"""FeatureSets: all samples that a ball touches, in clusters (thesis 6.2.1.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Bound
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.validation import FloatArray, IntArray, hold

ROUND = 0.4
"""Agreement below which one cluster goes round its ball: 0 for a circle or a sphere, 0.30 for 3/4
of a circle, 0.5 for a half sphere, 0.64 for half a circle."""


@dataclass(frozen=True, eq=False, repr=False)
class FeatureSets(Bound):
    """All samples that each of the k balls of a cloud touches, in clusters.

    Attributes
    ----------
    samples : Ragged
        k rows: the samples that each ball touches, first its two feature points, then the others
        in no particular order; empty for a masked ball.
    clusters : (entries,) int16
        Cluster of each entry of ``samples.indices``, 0, 1, ... within its row; the first feature
        point is in cluster 0.
    counts : (k,) int32
        Number of clusters; 0 for a masked ball.
    agreement : (k,) float64
        Length of the mean of the unit normals of the faces there, 0 to 1: 0 where they go round the
        ball or come from two opposite walls, 0.71 across a right edge, 0.9 for the quarter circle
        of a rounded one, 1 on a plane. NaN for a masked ball.
    cloud : MedialCloud
        The balls.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    samples: Ragged
    clusters: NDArray[np.int16]
    counts: IntArray
    agreement: FloatArray
    cloud: MedialCloud = field(kw_only=True)

    def __post_init__(self) -> None:
        k = len(self.cloud)
        hold(
            self,
            clusters=(np.int16, len(self.samples.indices)),
            counts=(np.int32, k),
            agreement=(np.float64, k),
        )

    def __len__(self) -> int:
        return len(self.samples)

    def __repr__(self) -> str:
        return f"FeatureSets({len(self)} balls, {len(self.samples.indices)} samples)"

    @property
    def closed(self) -> NDArray[np.bool_]:
        """True where the only cluster goes round the ball, as in a tube or a sphere, (k,)."""
        return (self.counts == 1) & (self.agreement < ROUND)

    @property
    def rim(self) -> NDArray[np.bool_]:
        """True where a ball has one contact that does not go round it: on the rim (A3), (k,)."""
        return (self.counts == 1) & ~self.closed
