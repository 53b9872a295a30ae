"""Segmentation: one label for every sample and face of a surface (thesis 6.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.shape import Shape
from medialis.validation import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Partition of the samples of a surface.

    Attributes
    ----------
    labels : (n,) int32
        Segment of each sample: 0, 1, ... from the largest area to the smallest; -1: none, because
        nothing tells (see the function that made it).
    areas : (count,) float64
        Surface of each segment; number of samples in a cloud.

    Raises
    ------
    InvalidShapeError
        When there is not one area a segment.
    """

    labels: IntArray
    areas: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", frozen(np.asarray(self.labels), np.int32))
        object.__setattr__(self, "areas", frozen(np.asarray(self.areas), np.float64))
        if self.areas.shape != (self.labels.max(initial=-1) + 1,):
            raise InvalidShapeError(
                f"{self.labels.max(initial=-1) + 1} segments need as many areas, got "
                f"{self.areas.shape}."
            )

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.areas)

    def of_faces(self, shape: Shape) -> IntArray:
        """Return the segment of each face of the shape, (m,): that of most of its corners.

        Three different corners: the lowest segment, which is the largest. -1 where two corners or
        more have none.
        """
        if shape.faces is None:
            return frozen(np.empty(0), np.int32)
        corners = np.sort(self.labels[shape.faces], axis=1)
        low, middle, high = corners.T
        three = (low != middle) & (middle != high)
        # Sorted: the middle one is the majority, if there is one. -1 comes first.
        return frozen(np.where(three, np.where(low < 0, middle, low), middle), np.int32)
