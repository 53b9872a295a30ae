"""Kernel of the feature transform: values of balls gathered at the samples they touch."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel

MINIMUM, MAXIMUM, SUM = 0, 1, 2


@kernel
def gather_at_features(features, values, how, out_values, out_counts):
    """Reduce the values of all balls at their feature points; NaN values and index -1 are left out.

    One pass over the k balls in their order: 2 ms for 194k balls (sorting by sample takes 19), so
    one thread is enough, and sums are the same bits on any number of them.
    """
    for i in range(len(features)):
        value = values[i]
        if np.isnan(value):
            continue
        for j in range(2):
            at = features[i, j]
            if at < 0:
                continue
            if out_counts[at] == 0:
                out_values[at] = value
            elif how == MINIMUM:
                out_values[at] = min(out_values[at], value)
            elif how == MAXIMUM:
                out_values[at] = max(out_values[at], value)
            else:
                out_values[at] += value
            out_counts[at] += 1
