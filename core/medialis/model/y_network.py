"""YNetwork: the curves along which medial sheets meet (thesis 6.2.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Bound
from medialis.model.medial_sheets import MedialSheets
from medialis.validation import FloatArray, IntArray, frozen, hold


@dataclass(frozen=True, eq=False, repr=False)
class YNetwork(Bound):
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
    meeting : (c, 3) int32
        Sheets that meet along each curve, ascending; the last is -1 where only two are known.
    sheets : MedialSheets
        The sheets of the k balls.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    near: NDArray[np.bool_]
    points: FloatArray
    edges: IntArray
    curve: IntArray
    meeting: IntArray
    sheets: MedialSheets = field(kw_only=True)

    def __post_init__(self) -> None:
        p, e, c = len(self.points), len(self.edges), len(self.meeting)
        hold(
            self,
            near=(np.bool_, len(self.sheets)),
            points=(np.float64, p, 3),
            edges=(np.int32, e, 2),
            curve=(np.int32, p),
            meeting=(np.int32, c, 3),
        )

    def __repr__(self) -> str:
        return f"YNetwork({len(self.meeting)} curves, {int(self.near.sum())} points near them)"

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each curve, (c,)."""
        a, b = self.points[self.edges[:, 0]], self.points[self.edges[:, 1]]
        curve = self.curve[self.edges[:, 0]]
        total = np.bincount(curve, np.linalg.norm(a - b, axis=1), minlength=len(self.meeting))
        return frozen(total, np.float64)
