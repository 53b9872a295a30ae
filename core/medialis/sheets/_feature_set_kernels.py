"""Kernels of the extended feature transform (thesis 6.2.1; see extended_features.py).

Strategy. All samples in the ball of radius r + tau round a center are found by one walk down the
box tree that ball shrinking uses. They are clustered by the graph of the surface: each found sample
stamps itself and its neighbours, and is joined (union-find) with whoever has stamped them before,
so a set of s samples costs O(s), not O(s^2). Each chunk of balls grows a list of its own, which
`place_sets` moves to the rows of the result.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.box_tree_kernels import LEAF, lowest_bit, test_children
from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import find_root

MOST = 1024
"""Samples of one set at most. A flat contact holds about 0.6 r / h of them (tau = 0.1 h), so only a
ball that touches a piece of a sphere or a tube with thousands of samples has more."""


@kernel
def _scan_leaf(block, begin, size, x, y, z, limit, order, count, found):
    """Append the samples of a leaf within the squared distance `limit`; return the new count."""
    inside = 0
    for slot in range(LEAF):
        dx, dy, dz = x - block[0, slot], y - block[1, slot], z - block[2, slot]
        inside += dx * dx + dy * dy + dz * dz <= limit
    if inside == 0:
        return count
    for slot in range(size):  # behind them, the last sample is repeated
        dx, dy, dz = x - block[0, slot], y - block[1, slot], z - block[2, slot]
        if dx * dx + dy * dy + dz * dz <= limit:
            if count == MOST:
                return MOST + 1
            found[count] = order[begin + slot]
            count += 1
    return count


@kernel
def _find_in_ball(
    x, y, z, reach, margin, n, order, blocks, bounds, child, depth, stack, found
):  # fmt: skip
    """List the samples within `reach` of a point; return how many, MOST + 1 if more than MOST."""
    count = 0
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        base = child[node]
        bits = test_children(bounds[node], x, y, z, reach + margin)
        while bits > 0:
            j = lowest_bit(bits)
            bits &= bits - 1
            if base >= 0:
                stack[top] = base + j
                top += 1
                continue
            leaf = ~base + j
            begin, end = (n * leaf) >> depth, (n * (leaf + 1)) >> depth
            count = _scan_leaf(
                blocks[leaf], begin, end - begin, x, y, z, reach * reach, order, count, found
            )
            if count > MOST:
                return count
    return count


@kernel
def _cluster(found, count, offsets, neighbours, stamp, parent, out_cluster):
    """Find the clusters of the listed samples, numbered in their order; return how many.

    `stamp` holds -1 everywhere on entry and on return.
    """
    for a in range(count):
        parent[a] = a
    for a in range(count):
        i = found[a]
        for at in range(offsets[i] - 1, offsets[i + 1]):
            near = i if at < offsets[i] else neighbours[at]
            b = stamp[near]
            if b < 0:
                stamp[near] = a
                continue
            p, q = find_root(parent, a), find_root(parent, b)
            if p != q:
                parent[max(p, q)] = min(p, q)
    clusters = 0
    for a in range(count):
        root = find_root(parent, a)
        if root == a:
            out_cluster[a] = clusters
            clusters += 1
        else:
            out_cluster[a] = out_cluster[root]
        stamp[found[a]] = -1
        for at in range(offsets[found[a]], offsets[found[a] + 1]):
            stamp[neighbours[at]] = -1
    return clusters


@kernel
def _mean_normal(found, count, normals):
    """Length of the mean of the normals at the found samples, without those that have none."""
    x, y, z, known = 0.0, 0.0, 0.0, 0
    for a in range(count):
        i = found[a]
        x += normals[i, 0]
        y += normals[i, 1]
        z += normals[i, 2]
        known += normals[i, 0] != 0.0 or normals[i, 1] != 0.0 or normals[i, 2] != 0.0
    return math.sqrt(x * x + y * y + z * z) / known if known > 0 else 1.0


@kernel
def _put_first(found, count, sample, place):
    """Move a sample to a place of the list; one that rounding left out is added."""
    at = place
    while at < count and found[at] != sample:
        at += 1
    if at == count:
        if count > MOST:
            return count
        count += 1
    found[at] = found[place]
    found[place] = sample
    return count


@kernel
def find_sets(
    begin, end, rows, normals, centers, radii, features, taus, margin,
    order, blocks, bounds, child, depth, offsets, neighbours,
    out_size, out_clusters, out_agreement,
):  # fmt: skip
    """Feature sets of the balls rows[begin:end]: samples and clusters, one after the other.

    Coordinates are relative to the middle of the tree. The first two samples of a set are the
    feature points of the ball. A set of more than MOST samples is cut to these two, in one cluster
    with an agreement of 0: it goes round the ball.
    """
    n = len(normals)
    stack = np.empty(8 * 12 + 8, np.int64)  # 8 children on each of at most 11 wide levels
    found, cluster = np.empty(MOST + 2, np.int32), np.empty(MOST + 2, np.int16)
    parent, stamp = np.empty(MOST + 2, np.int32), np.full(n, -1, np.int32)
    samples, labels = np.empty(32 * (end - begin), np.int32), np.empty(32 * (end - begin), np.int16)
    filled = 0
    for turn in range(begin, end):
        row = rows[turn]
        x, y, z = centers[row, 0], centers[row, 1], centers[row, 2]
        count = _find_in_ball(
            x, y, z, radii[row] + taus[row], margin, n, order, blocks, bounds, child, depth,
            stack, found,
        )  # fmt: skip
        if count > MOST:
            found[0], found[1] = features[row, 0], features[row, 1]
            cluster[0] = cluster[1] = 0
            count, clusters, agreement = 2, 1, 0.0
        else:
            count = _put_first(found, count, features[row, 0], 0)
            count = _put_first(found, count, features[row, 1], 1)
            clusters = _cluster(found, count, offsets, neighbours, stamp, parent, cluster)
            agreement = _mean_normal(found, count, normals)
        if filled + count > len(samples):
            room = 2 * (filled + count)
            wider, wider_labels = np.empty(room, np.int32), np.empty(room, np.int16)
            wider[:filled], wider_labels[:filled] = samples[:filled], labels[:filled]
            samples, labels = wider, wider_labels
        samples[filled : filled + count] = found[:count]
        labels[filled : filled + count] = cluster[:count]
        filled += count
        out_size[row], out_clusters[row], out_agreement[row] = count, clusters, agreement
    return samples[:filled].copy(), labels[:filled].copy()


@kernel
def place_sets(rows, offsets, samples, labels, out_samples, out_labels):
    """Move the sets of consecutive rows of a chunk to their places in the result."""
    at = 0
    for turn in range(len(rows)):
        row = rows[turn]
        for place in range(offsets[row], offsets[row + 1]):
            out_samples[place], out_labels[place] = samples[at], labels[at]
            at += 1


@kernel
def smallest_at_samples(wanted, radii, turns, offsets, samples, out_radius, out_turn):
    """Smallest radius and largest turn of the wanted balls at each sample of their sets."""
    for row in range(len(wanted)):
        if not wanted[row]:
            continue
        for at in range(offsets[row], offsets[row + 1]):
            i = samples[at]
            out_radius[i] = min(out_radius[i], radii[row])
            out_turn[i] = max(out_turn[i], turns[row])
