"""Kernel of convex hulls: which places lie in one."""

from __future__ import annotations

import numpy as np

from medialis.base.jit import kernel


@kernel
def list_within(places, corners, planes, slack, out_rows):
    """List the rows of places (q, 3) that lie in a hull, or outside by no more than `slack`.

    It has corners (k, 3) and outward planes (f, 4); `out_rows` (q,) receives the rows, ascending.
    Returns how many there are.
    """
    low, high = np.empty(3), np.empty(3)
    for k in range(3):
        low[k], high[k] = corners[0, k], corners[0, k]
        for v in range(1, len(corners)):
            low[k], high[k] = min(low[k], corners[v, k]), max(high[k], corners[v, k])
        low[k], high[k] = low[k] - slack, high[k] + slack
    count = 0
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        if x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]:
            continue
        inside = True
        for f in range(len(planes)):
            height = x * planes[f, 0] + y * planes[f, 1] + z * planes[f, 2] + planes[f, 3]
            if height > slack:
                inside = False
                break
        if inside:
            out_rows[count] = i
            count += 1
    return count
