"""Kernel of convex hulls: which places lie in one."""

from __future__ import annotations

from medialis.base.jit import kernel


@kernel
def list_within(places, planes, box, slack, out_rows):
    """List the rows of places (q, 3) that no plane (f, 4) leaves outside by more than `slack`.

    `box` (2, 3) are the low and the high corner of a box round the hull; `out_rows` (q,) receives
    the rows, ascending. Returns how many there are.
    """
    count = 0
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        if (
            x < box[0, 0] - slack
            or y < box[0, 1] - slack
            or z < box[0, 2] - slack
            or x > box[1, 0] + slack
            or y > box[1, 1] + slack
            or z > box[1, 2] + slack
        ):
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
