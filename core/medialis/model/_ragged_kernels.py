"""Kernel of rows of unequal length (ragged.py)."""

from __future__ import annotations

from medialis._kernels.jit import kernel


@kernel
def group_keys(keys, out_offsets, out_order):
    """Positions of each key, ascending: a counting sort. Negative keys are left out.

    `out_offsets` (rows + 2,) is 0 and becomes where rows start, one more than there are at the end.
    """
    for i in range(len(keys)):
        if keys[i] >= 0:
            out_offsets[keys[i] + 2] += 1
    for row in range(1, len(out_offsets)):
        out_offsets[row] += out_offsets[row - 1]
    for i in range(len(keys)):
        if keys[i] >= 0:
            out_order[out_offsets[keys[i] + 1]] = i
            out_offsets[keys[i] + 1] += 1
