"""MedialSheets: to which smooth sheet of the medial surface each ball belongs (thesis 6.2.2.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Bound
from medialis.model.medial_cloud import MedialCloud
from medialis.validation import IntArray, hold


@dataclass(frozen=True, eq=False, repr=False)
class MedialSheets(Bound):
    """Partition of the balls of a cloud into sheets.

    Attributes
    ----------
    labels : (k,) int32
        Sheet of each ball: 0, 1, ... from the one that covers most of the surface to the least;
        -1 for masked balls.
    linked : (k,) bool
        True where the ball itself was linked to its sheet; False where it was attached afterwards:
        on the rim of a sheet its feature points are too close together to tell.
    front : (k,) bool
        True on one of the two sides of each sheet: the samples of these balls cover it once (those
        of a tube, which has no two sides, all around).
    cloud : MedialCloud
        The k balls.

    Raises
    ------
    InvalidShapeError
        When there is not one value a ball.
    """

    labels: IntArray
    linked: NDArray[np.bool_]
    front: NDArray[np.bool_]
    cloud: MedialCloud = field(kw_only=True)

    def __post_init__(self) -> None:
        k = len(self.cloud)
        hold(self, labels=(np.int32, k), linked=(np.bool_, k), front=(np.bool_, k))

    def __len__(self) -> int:
        return len(self.labels)

    def __repr__(self) -> str:
        return f"MedialSheets({self.count} sheets, {len(self)} balls)"

    @property
    def count(self) -> int:
        """Number of sheets."""
        return int(self.labels.max(initial=-1)) + 1

    @property
    def sizes(self) -> IntArray:
        """Number of balls of each sheet, (count,)."""
        return np.bincount(self.labels[self.labels >= 0], minlength=self.count).astype(np.int32)
