"""YNetwork: the curves along which medial sheets meet (thesis 6.2.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.validation import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class YNetwork:
    """Points near Y-curves, and the curves as a graph.

    Attributes
    ----------
    near : (k,) bool
        Balls with one of their nearest medial points in another sheet.
    points : (p, 3) float64
        Nodes of the curves, in the units of the shape; none for a point cloud.
    edges : (e, 2) int32
        Between nodes; each belongs to one curve.
    curve : (p,) int32
        Curve of each node.
    sheets : (c, 3) int32
        Sheets that meet along each curve, ascending; the last is -1 where only two were found.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    near: NDArray[np.bool_]
    points: FloatArray
    edges: IntArray
    curve: IntArray
    sheets: IntArray

    def __post_init__(self) -> None:
        p, e, c = len(self.points), len(self.edges), len(self.sheets)
        for name, dtype, shape in (
            ("near", np.bool_, (len(self.near),)),
            ("points", np.float64, (p, 3)),
            ("edges", np.int32, (e, 2)),
            ("curve", np.int32, (p,)),
            ("sheets", np.int32, (c, 3)),
        ):
            value = np.asarray(getattr(self, name))
            if value.shape != shape:
                raise InvalidShapeError(f"{name} must have shape {shape}, got {value.shape}.")
            object.__setattr__(self, name, frozen(value, dtype))

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each curve, (c,)."""
        a, b = self.points[self.edges[:, 0]], self.points[self.edges[:, 1]]
        curve = self.curve[self.edges[:, 0]]
        total = np.bincount(curve, np.linalg.norm(a - b, axis=1), minlength=len(self.sheets))
        return frozen(total, np.float64)
