"""Ragged: rows of unequal length in two flat arrays (compressed sparse rows)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import Described
from medialis.validation import IntArray, frozen


@dataclass(frozen=True, eq=False, repr=False)
class Ragged(Described):
    """Rows of indices; row i is ``indices[offsets[i]:offsets[i + 1]]``.

    Attributes
    ----------
    offsets : (rows + 1,) int64, non-decreasing from 0
    indices : (offsets[-1],) int32

    Raises
    ------
    InvalidShapeError
        When the offsets do not describe the indices.

    Examples
    --------
    >>> rows = Ragged([0, 2, 2, 3], [5, 6, 7])
    >>> [row.tolist() for row in rows]
    [[5, 6], [], [7]]
    """

    offsets: NDArray[np.int64]
    indices: IntArray

    def __post_init__(self) -> None:
        offsets = frozen(np.asarray(self.offsets), np.int64)
        indices = frozen(np.asarray(self.indices), np.int32)
        if (
            offsets.ndim != 1
            or indices.ndim != 1
            or len(offsets) == 0
            or offsets[0] != 0
            or offsets[-1] != len(indices)
            or (np.diff(offsets) < 0).any()
        ):
            raise InvalidShapeError(
                "Ragged offsets must rise from 0 to the number of indices, "
                f"got {offsets[:3].tolist()}..{offsets[-1:].tolist()} for {indices.shape} indices."
            )
        object.__setattr__(self, "offsets", offsets)
        object.__setattr__(self, "indices", indices)

    @classmethod
    def group(cls, keys: ArrayLike, rows: int) -> Ragged:
        """Group 0..len(keys)-1 by key: row r lists the positions whose key is r, ascending.

        Negative keys are left out. Cost: O(len(keys) + rows).

        Raises
        ------
        InvalidShapeError
            When a key is not below `rows`.
        """
        from medialis.model._ragged_kernels import group_keys

        key = np.ascontiguousarray(keys, np.int64)
        if key.max(initial=-1) >= rows:
            raise InvalidShapeError(f"Keys must be below {rows} rows, got {key.max()}.")
        offsets, order = np.zeros(rows + 2, np.int64), np.empty(len(key), np.int32)
        group_keys(key, offsets, order)
        return cls(offsets[:-1], order[: offsets[-1]])

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, row: int) -> IntArray:
        if not -len(self) <= row < len(self):
            raise IndexError(f"row {row} of {len(self)}")
        row %= len(self)
        return self.indices[self.offsets[row] : self.offsets[row + 1]]

    def __iter__(self) -> Iterator[IntArray]:
        return (self[row] for row in range(len(self)))

    def joined(self, rows: ArrayLike) -> IntArray:
        """Return the indices of some rows, one row after the other.

        Examples
        --------
        >>> Ragged([0, 2, 2, 3], [5, 6, 7]).joined([2, 0]).tolist()
        [7, 5, 6]
        """
        first = self.offsets[:-1][np.asarray(rows, np.int64)]
        count = self.offsets[1:][np.asarray(rows, np.int64)] - first
        ends = np.cumsum(count)
        return self.indices[np.arange(count.sum()) + np.repeat(first - (ends - count), count)]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Number of indices in each row, (rows,)."""
        return np.diff(self.offsets)
