"""A tree of boxes over segments, triangles or balls: what rays and distances walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.validation import FloatArray

LEAF = 4
"""Items of a leaf, at most."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """A tree over n items; see `_box_kernels.py` for its form.

    Attributes
    ----------
    order : (n,) int64
        The items in tree order.
    bounds : (2 << depth, 7) float64
        Box of the centers below each node, and their largest radius.
    depth : int
    """

    order: NDArray[np.int64]
    bounds: FloatArray
    depth: int

    @classmethod
    def over(cls, corners: FloatArray, radii: FloatArray | None = None) -> Boxes:
        """Build the tree over items with these corners (n, k, 3), each with its largest radius."""
        from medialis.medial_meshes._box_kernels import split_items

        n = len(corners)
        depth = 0
        while (n - 1) >> depth >= LEAF:
            depth += 1
        order, bounds = np.arange(n), np.empty((2 << depth, 7))
        middles = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
        split_items(middles, depth, order, np.empty(n))
        return cls(order, bounds, depth).over_moved(
            corners, np.zeros(n) if radii is None else radii
        )

    def over_moved(self, corners: FloatArray, radii: FloatArray) -> Boxes:
        """Return the same tree over items that have moved; less good when they moved far."""
        from medialis.medial_meshes._box_kernels import bound_nodes

        bounds = np.empty_like(self.bounds)
        bound_nodes(np.ascontiguousarray(corners), radii, self.order, self.depth, bounds)
        return Boxes(self.order, bounds, self.depth)
