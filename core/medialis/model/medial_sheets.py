"""MedialSheets: to which smooth sheet of the medial surface each ball belongs (thesis 6.2.2.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Bound
from medialis.model.medial_cloud import MedialCloud
from medialis.model.unfolded import Unfolded
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
    node_labels, node_front : (u,) int32 and bool
        The same for the nodes of the unfolded surface: at a crease, those on its two sides are on
        the two sides of a sheet.
    unfolded : Unfolded
        The surface of the k balls, with u nodes.

    Raises
    ------
    InvalidShapeError
        When there is not one value a ball, or a node.
    """

    labels: IntArray
    linked: NDArray[np.bool_]
    front: NDArray[np.bool_]
    node_labels: IntArray
    node_front: NDArray[np.bool_]
    unfolded: Unfolded = field(kw_only=True)

    def __post_init__(self) -> None:
        k, u = len(self.cloud), len(self.unfolded)
        hold(self, labels=(np.int32, k), linked=(np.bool_, k), front=(np.bool_, k))
        hold(self, node_labels=(np.int32, u), node_front=(np.bool_, u))

    @property
    def cloud(self) -> MedialCloud:
        """The k balls."""
        return self.unfolded.cloud

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
