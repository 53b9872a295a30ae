"""ManifoldSet: a cloud divided into manifolds that may intersect, and noise (thesis 4.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import Bound
from medialis.model.ragged import Ragged
from medialis.validation import FloatArray, IntArray, as_points, as_whole_number, frozen


class PointClass(IntEnum):
    """What a point of a cloud is."""

    NOISE = 0
    """In no manifold."""
    FLAT = 1
    """In one manifold."""
    INTERSECTION = 2
    """In several manifolds, where they cross."""


@dataclass(frozen=True, eq=False, repr=False)
class ManifoldSet(Bound):
    """Which manifolds each point of a cloud belongs to: none, one, or several.

    Attributes
    ----------
    manifolds : Ragged
        Row i: the manifolds of point i, the one with its largest patch first.
    count : int
        Number of manifolds m; manifold 0 has most points.
    patch_counts : (n,) int32
        Flat patches through each point (thesis 4.2.3.3).
    points : (n, 3) float64
        The cloud.

    Raises
    ------
    InvalidShapeError
        When the arrays have different numbers of rows or a manifold is not below `count`.

    Examples
    --------
    >>> found = ManifoldSet(Ragged([0, 1, 3, 3], [0, 1, 0]), 2, [1, 2, 0], points=np.eye(3))
    >>> found.labels().tolist(), found.point_class.tolist()
    ([0, 1, -1], [1, 2, 0])
    >>> found.membership.toarray().tolist()
    [[True, False], [True, True], [False, False]]
    """

    manifolds: Ragged
    count: int
    patch_counts: IntArray
    points: FloatArray = field(kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", as_whole_number(self.count, "count", low=0, high=2**31))
        object.__setattr__(self, "points", as_points(self.points))
        patches = frozen(np.asarray(self.patch_counts), np.int32)
        object.__setattr__(self, "patch_counts", patches)
        named = self.manifolds.indices
        if len(self.points) != len(self.manifolds):
            raise InvalidShapeError(
                f"The set of manifolds has {len(self.manifolds)} rows, the cloud "
                f"{len(self.points)} points."
            )
        if patches.shape != (len(self.manifolds),):
            raise InvalidShapeError(
                f"patch_counts must have shape ({len(self.manifolds)},), got {patches.shape}."
            )
        if len(named) and (named.min() < 0 or named.max() >= self.count):
            raise InvalidShapeError(
                f"Manifolds must be 0..{self.count - 1}, got {named.min()}..{named.max()}."
            )

    def __len__(self) -> int:
        return len(self.manifolds)

    def __repr__(self) -> str:
        return f"ManifoldSet({len(self)} points, {self.count} manifolds)"

    @cached_property
    def membership(self) -> Any:
        """Sparse boolean matrix (n, m), scipy CSR: whether point i is in manifold j."""
        from scipy.sparse import csr_array

        rows = self.manifolds
        filled = np.ones(len(rows.indices), np.bool_)
        matrix = csr_array(
            (filled, rows.indices.copy(), rows.offsets.copy()), shape=(len(self), self.count)
        )
        matrix.sort_indices()
        return matrix

    def labels(self) -> IntArray:
        """Return one manifold for each point, (n,) int32: the first of its row; -1 is noise."""
        result = np.full(len(self), -1, np.int32)
        some = self.manifolds.lengths > 0
        result[some] = self.manifolds.indices[self.manifolds.offsets[:-1][some]]
        return frozen(result, np.int32)

    @cached_property
    def point_class(self) -> NDArray[np.int8]:
        """A `PointClass` for each point, (n,)."""
        return frozen(np.minimum(self.manifolds.lengths, 2), np.int8)

    @cached_property
    def sizes(self) -> NDArray[np.int64]:
        """Points of each manifold, (m,); those in several count in each."""
        return frozen(np.bincount(self.manifolds.indices, minlength=self.count), np.int64)

    def at(self, rows: NDArray[np.int64]) -> ManifoldSet:
        """Return the set of the given points (r,), in their order; they may repeat."""
        lengths = self.manifolds.lengths[rows]
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        inside = np.arange(offsets[-1]) - np.repeat(offsets[:-1], lengths)
        taken = np.repeat(self.manifolds.offsets[:-1][rows], lengths) + inside
        chosen = Ragged(offsets, self.manifolds.indices[taken])
        counts = self.patch_counts[rows]
        return ManifoldSet(chosen, self.count, counts, points=self.points[rows])

    def points_of(self, manifold: int) -> NDArray[np.int64]:
        """Return the points of a manifold, ascending.

        Raises
        ------
        InvalidOptionError
            When there is no such manifold.
        """
        number = as_whole_number(manifold, "manifold", low=0, high=self.count - 1)
        owner = np.repeat(np.arange(len(self)), self.manifolds.lengths)
        return np.sort(owner[self.manifolds.indices == number])
