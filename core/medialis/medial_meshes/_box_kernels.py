"""A tree of boxes over segments, triangles or balls, without pointers.

Node i has the children 2 i and 2 i + 1, and node (1 << b) + j covers the items n j >> b up to
n (j + 1) >> b in tree order. A node knows the box of the centers below it and their largest radius.
"""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel


@kernel
def _select(keys, order, low, high, place):
    """Put the item of rank `place` there, smaller ones before it and larger ones behind it."""
    high -= 1
    while low < high:
        pivot = keys[(low + high) >> 1]
        i, j = low, high
        while i <= j:
            while keys[i] < pivot:
                i += 1
            while keys[j] > pivot:
                j -= 1
            if i <= j:
                keys[i], keys[j] = keys[j], keys[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            return


@kernel
def split_items(middles, depth, order, keys):
    """Bring items with these middles (n, 3) into tree order; `keys` (n,) is scratch."""
    n = len(middles)
    for level in range(depth):
        for j in range(1 << level):
            begin, end = (n * j) >> level, (n * (j + 1)) >> level
            axis, widest = 0, -1.0
            for d in range(3):
                low, high = np.inf, -np.inf
                for i in range(begin, end):
                    x = middles[order[i], d]
                    low, high = min(low, x), max(high, x)
                if high - low > widest:
                    axis, widest = d, high - low
            for i in range(begin, end):
                keys[i] = middles[order[i], axis]
            _select(keys, order, begin, end, (n * (2 * j + 1)) >> (level + 1))


@kernel
def bound_nodes(corners, radii, order, depth, out_boxes):
    """Bounds of all nodes, (2 << depth, 7): low, high, largest radius; corners (n, k, 3)."""
    n, leaves = len(corners), 1 << depth
    for leaf in range(leaves):
        box = out_boxes[leaves + leaf]
        box[:3], box[3:6], box[6] = np.inf, -np.inf, -np.inf
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            item = order[i]
            for k in range(corners.shape[1]):
                for d in range(3):
                    box[d] = min(box[d], corners[item, k, d])
                    box[3 + d] = max(box[3 + d], corners[item, k, d])
            box[6] = max(box[6], radii[item])
    for node in range(leaves - 1, 0, -1):
        for d in range(3):
            out_boxes[node, d] = min(out_boxes[2 * node, d], out_boxes[2 * node + 1, d])
            out_boxes[node, 3 + d] = max(out_boxes[2 * node, 3 + d], out_boxes[2 * node + 1, 3 + d])
        out_boxes[node, 6] = max(out_boxes[2 * node, 6], out_boxes[2 * node + 1, 6])
