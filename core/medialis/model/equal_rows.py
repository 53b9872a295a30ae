"""Equal rows of an array, found through a hash and confirmed exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB), np.uint64(0x9E3779B97F4A7C15))


def first_equal_row(rows: NDArray[Any]) -> NDArray[np.int64]:
    """Return for each row the lowest row that is equal to it, (n,); itself when there is none.

    Parameters
    ----------
    rows : (n, k) float64 without NaN, or integers
        Compared as numbers: -0.0 equals 0.0.

    Notes
    -----
    Rows are hashed to 64 bits and only rows of equal hash are looked at. Cost: one sort of n
    integers when all rows differ.
    """
    n = len(rows)
    result = np.arange(n)
    if n < 2:
        return result
    keys = _hash(rows)
    ordered = np.sort(keys)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if len(repeated) == 0:
        return result
    at = np.searchsorted(repeated, keys)
    candidates = np.flatnonzero(repeated[np.minimum(at, len(repeated) - 1)] == keys)
    part = rows[candidates]
    order = np.lexsort((candidates, *part.T, keys[candidates]))
    part = part[order]
    fresh = np.ones(len(order), bool)
    fresh[1:] = (part[1:] != part[:-1]).any(axis=1)
    starts = np.flatnonzero(fresh)
    leader = candidates[order[starts]]
    result[candidates[order]] = np.repeat(leader, np.diff(starts, append=len(order)))
    return result


def _hash(rows: NDArray[Any]) -> NDArray[np.uint64]:
    """Return 64-bit hashes: the splitmix64 finisher over one column after the other."""
    result = np.zeros(len(rows), np.uint64)
    for column in rows.T:
        if rows.dtype.kind == "f":
            bits = (column + 0.0).view(np.uint64)  # -0.0 + 0.0 is 0.0
        else:
            bits = column.astype(np.uint64)
        result = (result + _MIX[2]) ^ bits
        result = (result ^ (result >> np.uint64(30))) * _MIX[0]
        result = (result ^ (result >> np.uint64(27))) * _MIX[1]
        result ^= result >> np.uint64(31)
    return result
