"""Kernel of thickness: the largest ball that covers a point, by a box tree over ball centers.

A child of a node is opened only if the largest radius below it exceeds the best one so far, and if
a ball of that radius with its center in the box of the child reaches the point.
"""

from __future__ import annotations

import numpy as np

from medialis.base._box_tree_kernels import FAN, box_distance2
from medialis.base.jit import kernel


@kernel
def find_covering(begin, end, queries, tree, items, reach, out):
    """Find the largest ball of the same body that covers each of the queries begin..end.

    Parameters
    ----------
    queries : (points (q, 3), slack (q,), bodies (q,), bodies of the balls (k,))
        Points are relative to the tree's center; `slack` is how far outside of a ball they may be.
        Bodies of balls are in tree order.
    tree : BoxTree
    items : Items
        Balls in tree order.
    reach : (least, most, margin)
        Bounds of the slack, relative to the radius. `margin` is what distances to boxes may be off.
    out : (radii (q,) float64, covering (q,) int64)
        Only balls larger than the given radius count; `covering` is their index in tree order, and
        stays where there is none.
    """
    points, slack, bodies, owners = queries
    radii, covering = out
    least, most, margin = reach
    n, depth = len(tree.points), tree.depth
    stack = np.empty(8 * 12 + 8, np.int64)
    for i in range(begin, end):
        x, y, z, best = points[i, 0], points[i, 1], points[i, 2], radii[i]
        fx, fy, fz = np.float32(x), np.float32(y), np.float32(z)
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            base = tree.child[node]
            for j in range(FAN):
                largest = items.largest[node, j]
                if largest <= best:
                    continue
                far = largest + min(max(slack[i], least * largest), most * largest) + margin
                if box_distance2(tree.bounds[node], j, fx, fy, fz) > far * far:
                    continue
                if base >= 0:
                    stack[top] = base + j
                    top += 1
                    continue
                leaf = ~base + j
                for k in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                    r = items.radii[k]
                    if r <= best or owners[k] != bodies[i]:
                        continue
                    dx, dy, dz = tree.points[k, 0] - x, tree.points[k, 1] - y, tree.points[k, 2] - z
                    far = r + min(max(slack[i], least * r), most * r)
                    if dx * dx + dy * dy + dz * dz <= far * far:
                        best = r
                        covering[i] = k
        radii[i] = best
