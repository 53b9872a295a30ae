"""Kernels: flat patches in each neighbourhood, and the graph of patches (thesis 4.2.3.2-4.2.3.5).

Neighbourhoods are rows of `near` (n, k): the nearest other points. A patch
of point i is known by its slot ``PATCHES * i + number``; it has an axis (unoriented normal), the
number of its triangles, and its neighbours as bits of a 64-bit word: bit m is ``near[i, m]``.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import find_root

PATCHES = 4
"""Most patches of a point. Five planes through one point leave a neighbourhood of 10 with two
neighbours on each, which makes one triangle a plane: no patch."""


@kernel
def _triangle_normals(points, near, i, slimmest, out_normals, out_corners):
    """List unit normals of the triangles of point i with two neighbours; return their number.

    Triangles whose corner at i has a sine below `slimmest` say nothing about the plane.
    """
    count = 0
    k = near.shape[1]
    for a in range(k):
        ax = points[near[i, a], 0] - points[i, 0]
        ay = points[near[i, a], 1] - points[i, 1]
        az = points[near[i, a], 2] - points[i, 2]
        aa = ax * ax + ay * ay + az * az
        for b in range(a):
            bx = points[near[i, b], 0] - points[i, 0]
            by = points[near[i, b], 1] - points[i, 1]
            bz = points[near[i, b], 2] - points[i, 2]
            x = ay * bz - az * by
            y = az * bx - ax * bz
            z = ax * by - ay * bx
            square = x * x + y * y + z * z
            if square <= slimmest * slimmest * aa * (bx * bx + by * by + bz * bz):
                continue
            length = math.sqrt(square)
            out_normals[count, 0] = x / length
            out_normals[count, 1] = y / length
            out_normals[count, 2] = z / length
            out_corners[count, 0] = a
            out_corners[count, 1] = b
            count += 1
    return count


@kernel
def _complete_linkage(normals, count, least, similar, cluster, chain):
    """Clusters whose normals all have |cosine| >= `least` pairwise (Eq. 4.1).

    Agglomeration by the nearest-neighbour chain: follow the most similar cluster until two name
    each other, and merge them. Complete linkage never turns a merge into a better one elsewhere, so
    the chain stays valid and the tree is that of the greedy method, in O(count^2). Cutting the tree
    means not merging below `least`: a chain that ends there is finished. `cluster` ends as the
    lowest triangle of the cluster of each.
    """
    for a in range(count):
        cluster[a] = a
        for b in range(a):
            cosine = abs(
                normals[a, 0] * normals[b, 0]
                + normals[a, 1] * normals[b, 1]
                + normals[a, 2] * normals[b, 2]
            )
            similar[a, b] = cosine
            similar[b, a] = cosine
    for a in range(count):
        similar[a, a] = 0.0  # -1 marks a cluster that is finished
    start, size = 0, 0
    while True:
        if size == 0:
            while start < count and (cluster[start] != start or similar[start, start] < 0):
                start += 1
            if start == count:
                return
            chain[0] = start
            size = 1
        top = chain[size - 1]
        best, most = -1, least
        before = chain[size - 2] if size > 1 else -1
        if before >= 0:  # of equally similar clusters the one before: the chain must end
            best, most = before, similar[top, before]
        for other in range(count):
            if other == top or cluster[other] != other:
                continue
            if similar[top, other] > most or (best < 0 and similar[top, other] == most):
                best, most = other, similar[top, other]
        if best < 0:
            similar[top, top] = -1.0  # nothing left that may join
            size -= 1
            continue
        if best != before:
            chain[size] = best
            size += 1
            continue
        size -= 2
        keep, gone = min(top, best), max(top, best)
        for a in range(count):
            if cluster[a] == gone:
                cluster[a] = keep
            elif cluster[a] == a and a != keep:
                low = min(similar[keep, a], similar[gone, a])
                similar[keep, a] = low
                similar[a, keep] = low


@kernel
def _mean_axis(normals, cluster, name, count, out_axis):
    """Mean of the normals of a cluster, signs chosen along its first one."""
    out_axis[0] = out_axis[1] = out_axis[2] = 0.0
    for t in range(count):
        if cluster[t] != name:
            continue
        cosine = (
            normals[t, 0] * normals[name, 0]
            + normals[t, 1] * normals[name, 1]
            + normals[t, 2] * normals[name, 2]
        )
        sign = -1.0 if cosine < 0 else 1.0
        for c in range(3):
            out_axis[c] += sign * normals[t, c]
    length = math.sqrt(out_axis[0] ** 2 + out_axis[1] ** 2 + out_axis[2] ** 2)
    for c in range(3):
        out_axis[c] /= length


@kernel
def find_patches(
    points, near, begin, end, least, slimmest, triangles, neighbours, out_axes, out_size, out_bits
):
    """Patches of the points begin..end: clusters with enough triangles and enough neighbours.

    `least` is the cosine of d_max. The largest come first; ties: the one with the nearest point.
    """
    k = near.shape[1]
    most = k * (k - 1) // 2
    normals = np.empty((most, 3))
    corners = np.empty((most, 2), np.int64)
    similar = np.empty((most, most))
    cluster, chain = np.empty(most, np.int64), np.empty(most + 1, np.int64)
    sizes = np.empty(most, np.int64)
    for i in range(begin, end):
        count = _triangle_normals(points, near, i, slimmest, normals, corners)
        _complete_linkage(normals, count, least, similar, cluster, chain)
        sizes[:count] = 0
        for t in range(count):
            sizes[cluster[t]] += 1
        found = 0
        while found < PATCHES:
            largest = -1
            for t in range(count):
                if sizes[t] >= triangles and (largest < 0 or sizes[t] > sizes[largest]):
                    largest = t
            if largest < 0:
                break
            bits = np.uint64(0)
            for t in range(count):
                if cluster[t] == largest:
                    bits |= np.uint64(1) << np.uint64(corners[t, 0])
                    bits |= np.uint64(1) << np.uint64(corners[t, 1])
            members = 0
            for m in range(k):
                members += (bits >> np.uint64(m)) & np.uint64(1) != 0
            if members >= neighbours:
                slot = PATCHES * i + found
                _mean_axis(normals, cluster, largest, count, out_axes[slot])
                out_size[slot] = sizes[largest]
                out_bits[slot] = bits
                found += 1
            sizes[largest] = 0


@kernel
def join_patches(near, axes, size, bits, least, parent):
    """Join patches of neighbouring points whose axes have |cosine| >= `least` (union-find).

    Point j is compared with point i where it is a corner of the patch of i (thesis 4.2.3.5). On
    return `parent` holds the root of each slot, its lowest slot.
    """
    for slot in range(len(size)):
        if size[slot] == 0:
            continue
        i = slot // PATCHES
        for m in range(near.shape[1]):
            if (bits[slot] >> np.uint64(m)) & np.uint64(1) == 0:
                continue
            for other in range(PATCHES * near[i, m], PATCHES * near[i, m] + PATCHES):
                if size[other] == 0:
                    break
                cosine = abs(
                    axes[slot, 0] * axes[other, 0]
                    + axes[slot, 1] * axes[other, 1]
                    + axes[slot, 2] * axes[other, 2]
                )
                if cosine >= least:
                    a, b = find_root(parent, slot), find_root(parent, other)
                    parent[max(a, b)] = min(a, b)
    for slot in range(len(parent)):
        parent[slot] = find_root(parent, slot)


@kernel
def claim_corners(near, bits, label, claims, claimed, counted):
    """Add to each point the manifolds that have at least `claims` patches with it as a corner.

    `label` (n, PATCHES) is the manifold of each patch, -1 none, and becomes the manifolds of each
    point: those of its own patches first, each once. `claimed` (n, PATCHES) comes with -1 and
    `counted` with 0; a fifth manifold that claims a point is not counted.
    """
    n, k = near.shape
    for i in range(n):
        for p in range(PATCHES):
            if label[i, p] < 0:
                continue
            for m in range(k):
                if (bits[PATCHES * i + p] >> np.uint64(m)) & np.uint64(1) == 0:
                    continue
                j = near[i, m]
                for c in range(PATCHES):
                    if claimed[j, c] < 0:
                        claimed[j, c] = label[i, p]
                    if claimed[j, c] == label[i, p]:
                        counted[j, c] += 1
                        break
    for i in range(n):
        filled = 0
        for p in range(PATCHES + PATCHES):
            name = -1
            if p < PATCHES:
                name = label[i, p]
                label[i, p] = -1
            elif counted[i, p - PATCHES] >= claims:
                name = claimed[i, p - PATCHES]
            for c in range(filled):
                if label[i, c] == name:
                    name = -1
            if name >= 0 and filled < PATCHES:
                label[i, filled] = name
                filled += 1
