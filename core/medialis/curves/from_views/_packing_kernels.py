"""Kernels: views as bit masks of their silhouettes, and the numbers of the pixels in these."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

BITS = 8


@kernel
def pack_view(near, far, field, out_mask, out_values):
    """Pack depths and distances (h, w) of the pixels where `near` is a number.

    `out_mask` ((h * w + 7) // 8) uint8 comes with 0. `out_values` (p, 3) has a row for each such
    pixel, in the order of rows.
    """
    width, count = near.shape[1], 0
    for row in range(len(near)):
        for col in range(width):
            if math.isnan(near[row, col]):
                continue
            at = row * width + col
            out_mask[at // BITS] |= np.uint8(1 << (at % BITS))
            out_values[count, 0] = near[row, col]
            out_values[count, 1] = far[row, col]
            out_values[count, 2] = field[row, col]
            count += 1


@kernel
def unpack_view(mask, values, out_near, out_far, out_field):
    """Unpack what `pack_view` packed; `out_field` comes with 0."""
    width, count = out_near.shape[1], 0
    for row in range(len(out_near)):
        for col in range(width):
            at = row * width + col
            if mask[at // BITS] & (1 << (at % BITS)):
                out_near[row, col] = values[count, 0]
                out_far[row, col] = values[count, 1]
                out_field[row, col] = values[count, 2]
                count += 1
            else:
                out_near[row, col] = out_far[row, col] = math.nan
