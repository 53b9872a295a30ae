"""MedialSheets: to which smooth sheet of the medial surface each ball belongs (thesis 6.2.2.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.validation import IntArray, frozen


@dataclass(frozen=True, eq=False)
class MedialSheets:
    """Partition of the balls of a cloud into sheets.

    Attributes
    ----------
    labels : (k,) int32
        Sheet of each ball: 0, 1, ... from the one that covers most of the surface to the least;
        -1 for masked balls.
    linked : (k,) bool
        True where the ball itself was linked to its sheet; False where it was attached afterwards:
        on the rim of a sheet its feature points are too close together to tell.

    Raises
    ------
    InvalidShapeError
        When the arrays are not of equal length.
    """

    labels: IntArray
    linked: NDArray[np.bool_]

    def __post_init__(self) -> None:
        labels, linked = np.asarray(self.labels), np.asarray(self.linked)
        if labels.ndim != 1 or linked.shape != labels.shape:
            raise InvalidShapeError(
                f"labels and linked must be two (k,) arrays, got {labels.shape}, {linked.shape}."
            )
        object.__setattr__(self, "labels", frozen(labels, np.int32))
        object.__setattr__(self, "linked", frozen(linked, np.bool_))

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def count(self) -> int:
        """Number of sheets."""
        return int(self.labels.max(initial=-1)) + 1

    @property
    def sizes(self) -> IntArray:
        """Number of balls of each sheet, (count,)."""
        return np.bincount(self.labels[self.labels >= 0], minlength=self.count).astype(np.int32)
