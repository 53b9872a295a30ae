"""Kernels of patches: flat and bent ones in each neighbourhood, and their graph (thesis 4.2.3).

Neighbourhoods are rows of `near` (n, k): the nearest other points. A patch of point i is known by
its slot ``PATCHES * i + number``; it has an axis (unoriented normal), the number of its triangles,
and its neighbours as bits of a 64-bit word: bit m is ``near[i, m]``.

Neighbourhoods too coarse for their curvature are bent along a quadric. Heights over a plane through
point i, h(u, v) = a + b u + c v + d u u + e u v + f v v, are fitted to its neighbours by least
squares, without the point itself: whether the surface passes through it is the question. What is
left is compared with the same angle as the triangles of a flat patch.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import find_root
from medialis.base.jit import kernel
from medialis.clouds._kernels import SLIMMEST

PATCHES = 4
"""Most patches of a point. Five planes through one point leave a neighbourhood of 10 with two
neighbours on each, which makes one triangle a plane: no patch."""

LEAST_NEIGHBOURS = 4
"""Of a patch: three points are in a plane with any fourth by chance far more often than two more
are."""

LEAST_TRIANGLES = LEAST_NEIGHBOURS * (LEAST_NEIGHBOURS - 1) // 2
"""Those that so many neighbours make with the point."""

PLANES = 2
"""Flat patches that a bent one must fit better than: a crossing or a crease. They have no more
coefficients than a quadric."""

ELSEWHERE = 5
"""One in so many neighbours may lie elsewhere before a patch is no longer all there is."""

CLAIMS = 3
"""Patches of a manifold with a point as a corner that make it a point of the manifold: those of its
neighbours tell where a manifold goes on through an intersection, where its own are not clear."""

TERMS = 6
"""Coefficients of a quadric."""

CHANCE = 2.0
"""Deviation of a corner from its quadric, in units of the largest mean deviation."""

OFF = 3.0
"""Mean deviations of the point itself beyond which it is an outlier: chance once in 370 times."""

CLOSE = 0.02
"""Mean distances by which it may be off besides. Where there is no noise the mean deviation is next
to nothing; a sphere of radius r leaves d^4 / (8 r^3) of its quadric at the distance d, which is
1.6 % of d at the steepest."""

STEEPEST = 0.7
"""Slopes of the quadric in both directions together, at the mean distance d of the neighbours. On a
sphere that is sqrt 2 d / r. Its height over the tangent plane has one value up to the distance r
only, and neighbours reach as far as 2 d: so d / r is at most a half."""

ROUNDS = 3
"""The plane is turned into the tangent plane of the quadric; its second turn is small."""


class Patches(NamedTuple):
    """Patches of the neighbourhoods of n points; bent ones stand beside the flat ones.

    Attributes
    ----------
    neighbours : int
        How many make flat patches; bent ones have all.
    near : (n, k) int32
        The nearest other points.
    axes : (4 n, 3) float64
        Unoriented normals, the slots of each point after those of another.
    sizes : (4 n,) int32
        Triangles; 0: no patch, nor in the slots of the point that follow.
    corners : (4 n,) uint64
        Neighbours as bits.
    bent_axes, bends : (n, 3), (n, 3, 3) float64
        Of the bent patch of each point: the normal at x is ``axis - bend x``.
    bent_corners : (n,) uint64
        0: there is none.
    """

    neighbours: int
    near: NDArray[np.int32]
    axes: NDArray[np.float64]
    sizes: NDArray[np.int32]
    corners: NDArray[np.uint64]
    bent_axes: NDArray[np.float64]
    bends: NDArray[np.float64]
    bent_corners: NDArray[np.uint64]


@kernel
def _frame(axis, frame):
    """Fill two unit directions across an axis."""
    m = 0
    for c in range(1, 3):
        if abs(axis[c]) < abs(axis[m]):
            m = c
    length = math.sqrt(1.0 - axis[m] * axis[m])
    for c in range(3):
        frame[0, c] = ((1.0 if c == m else 0.0) - axis[m] * axis[c]) / length
    frame[1, 0] = axis[1] * frame[0, 2] - axis[2] * frame[0, 1]
    frame[1, 1] = axis[2] * frame[0, 0] - axis[0] * frame[0, 2]
    frame[1, 2] = axis[0] * frame[0, 1] - axis[1] * frame[0, 0]


@kernel
def _terms(sides, m, frame, radius, row):
    """Terms of the quadric at a neighbour, in units of the radius."""
    u = (sides[m, 0] * frame[0, 0] + sides[m, 1] * frame[0, 1] + sides[m, 2] * frame[0, 2]) / radius
    v = (sides[m, 0] * frame[1, 0] + sides[m, 1] * frame[1, 1] + sides[m, 2] * frame[1, 2]) / radius
    row[0], row[1], row[2], row[3], row[4], row[5] = 1.0, u, v, u * u, u * v, v * v


@kernel
def _height(sides, m, axis, radius):
    return (sides[m, 0] * axis[0] + sides[m, 1] * axis[1] + sides[m, 2] * axis[2]) / radius


@kernel
def _solve(matrix, right):
    """Solve a symmetric positive definite system in place (Cholesky); False if it is singular."""
    for i in range(TERMS):
        whole = matrix[i, i]
        for j in range(i):
            whole -= matrix[i, j] * matrix[i, j]
        if whole <= 1e-9 * matrix[i, i]:
            return False
        matrix[i, i] = math.sqrt(whole)
        for k in range(i + 1, TERMS):
            value = matrix[k, i]
            for j in range(i):
                value -= matrix[k, j] * matrix[i, j]
            matrix[k, i] = value / matrix[i, i]
    for i in range(TERMS):
        for j in range(i):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    for i in range(TERMS - 1, -1, -1):
        for j in range(i + 1, TERMS):
            right[i] -= matrix[j, i] * right[j]
        right[i] /= matrix[i, i]
    return True


@kernel
def _fit(sides, used, axis, frame, radius, row, matrix, right):
    """Coefficients of the quadric of the used neighbours in `right`; False if there is none."""
    matrix[:, :] = 0.0
    right[:] = 0.0
    for m in range(len(used)):
        if not used[m]:
            continue
        _terms(sides, m, frame, radius, row)
        height = _height(sides, m, axis, radius)
        for a in range(TERMS):
            right[a] += row[a] * height
            for b in range(a + 1):
                matrix[a, b] += row[a] * row[b]
    return _solve(matrix, right)


@kernel
def _misfit(sides, used, axis, frame, radius, row, right):
    """Root mean square of what the quadric leaves, for its degrees of freedom, and the worst."""
    total, most, worst, count = 0.0, -1.0, -1, 0
    for m in range(len(used)):
        if not used[m]:
            continue
        _terms(sides, m, frame, radius, row)
        left = _height(sides, m, axis, radius)
        for a in range(TERMS):
            left -= right[a] * row[a]
        total += left * left
        count += 1
        if abs(left) > most:
            most, worst = abs(left), m
    return math.sqrt(total / max(count - TERMS, 1)), worst


@kernel
def _corners(sides, used, axis, bend, offset, flattest, radius):
    """Return the used neighbours as bits, but those farther off than chance explains."""
    bits = np.uint64(0)
    for m in range(len(used)):
        left = _height(sides, m, axis, 1.0)
        for c in range(3):
            for b in range(3):
                left -= 0.5 * sides[m, c] * bend[c, b] * sides[m, b]
        if used[m] and abs(left / radius - offset) <= CHANCE * flattest:
            bits |= np.uint64(1) << np.uint64(m)
    return bits


@kernel
def flat_misfit(sides, axes, count, drops):
    """Return what the planes of flat patches leave of the neighbours, in units of `bend_patch`.

    Each neighbour counts with the plane that is nearest to it; the `drops` farthest do not.
    """
    k = len(sides)
    heights, radius = np.empty(k), 0.0
    for m in range(k):
        radius += math.sqrt(sides[m, 0] ** 2 + sides[m, 1] ** 2 + sides[m, 2] ** 2) / k
        height = np.inf
        for p in range(count):
            height = min(height, abs(_height(sides, m, axes[p], 1.0)))
        at = m
        while at > 0 and heights[at - 1] > height:
            heights[at] = heights[at - 1]
            at -= 1
        heights[at] = height
    total = 0.0
    for m in range(k - drops):
        total += heights[m] ** 2
    return math.sqrt(total / max(k - drops - 2 * count, 1)) / radius


@kernel
def bend_patch(sides, flattest, drops, axis, out_bend):
    """Bend a patch along a quadric: turn `axis` into its normal; tell its neighbours as bits.

    `sides` (k, 3) are the neighbours from the point. What the quadric leaves, on average and at the
    point, must not exceed `flattest` times their mean distance; up to `drops` neighbours may lie
    elsewhere. No bits: there is no such patch. The normal at x is ``axis - out_bend x``.
    """
    k = len(sides)
    frame, row = np.empty((2, 3)), np.empty(TERMS)
    matrix, right = np.empty((TERMS, TERMS)), np.empty(TERMS)
    used = np.ones(k, np.bool_)
    radius = 0.0
    for m in range(k):
        radius += math.sqrt(sides[m, 0] ** 2 + sides[m, 1] ** 2 + sides[m, 2] ** 2) / k
    for drop in range(drops + 1):
        for _ in range(ROUNDS):
            _frame(axis, frame)
            if not _fit(sides, used, axis, frame, radius, row, matrix, right):
                return np.uint64(0)
            misfit, worst = _misfit(sides, used, axis, frame, radius, row, right)
            offset = right[0]
            length = math.sqrt(1.0 + right[1] ** 2 + right[2] ** 2)
            for c in range(3):
                axis[c] = (axis[c] - right[1] * frame[0, c] - right[2] * frame[1, c]) / length
                for b in range(3):
                    out_bend[c, b] = (
                        2.0 * right[3] * frame[0, c] * frame[0, b]
                        + right[4] * (frame[0, c] * frame[1, b] + frame[1, c] * frame[0, b])
                        + 2.0 * right[5] * frame[1, c] * frame[1, b]
                    ) / (radius * length)
        if misfit <= flattest:
            break
        if drop == drops:
            return np.uint64(0)
        used[worst] = False
    turn = 0.0
    for c in range(3):
        for b in range(3):
            turn += (radius * out_bend[c, b]) ** 2
    if turn > STEEPEST * STEEPEST or abs(offset) > min(flattest, OFF * misfit + CLOSE):
        return np.uint64(0)
    return _corners(sides, used, axis, out_bend, offset, flattest, radius)


@kernel
def _triangle_normals(points, near, i, k, out_normals, out_corners):
    """List unit normals of the triangles of point i with two of k neighbours; return their number.

    Triangles whose corner at i has a sine below `SLIMMEST` say nothing about the plane.
    """
    count = 0
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
            if square <= SLIMMEST * SLIMMEST * aa * (bx * bx + by * by + bz * bz):
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
def _largest_cluster(cluster, sizes, count, least):
    """Largest cluster with at least so many triangles, -1 if none; ties: the nearest point."""
    largest = -1
    for t in range(count):
        if sizes[t] >= least and (largest < 0 or sizes[t] > sizes[largest]):
            largest = t
    return largest


@kernel
def _covers(bits, k, least):
    """Whether a patch has at least so many of the first k neighbours."""
    members = 0
    for m in range(k):
        members += (bits >> np.uint64(m)) & np.uint64(1) != 0
    return members >= least


@kernel
def _is_all(patches, i):
    """Whether a flat patch is all there is about a point: most neighbours, half the triangles."""
    k, slot = patches.neighbours, PATCHES * i
    most = _covers(patches.corners[slot], k, k - k // ELSEWHERE)
    return 4 * patches.sizes[slot] >= k * (k - 1) and most


@kernel
def find_patches(points, begin, end, least, patches):
    """Fill in patches of the points begin..end: clusters with enough triangles and neighbours.

    `least` is the cosine of d_max. The largest come first; ties: the one with the nearest point.
    Where none covers most of the neighbours, a patch of all of them that is bent along a quadric
    stands beside them if it fits better and leaves no more than d_max: flat patches fit planes that
    cross as well as can be, but not a coarsely sampled curved surface.
    """
    near, k, axes = patches.near, patches.neighbours, patches.axes
    most = k * (k - 1) // 2
    normals = np.empty((most, 3))
    corners = np.empty((most, 2), np.int64)
    similar = np.empty((most, most))
    cluster, chain = np.empty(most, np.int64), np.empty(most + 1, np.int64)
    sizes = np.empty(most, np.int64)
    sides = np.empty((near.shape[1], 3))
    steepest = math.tan(0.5 * math.acos(least))
    for i in range(begin, end):
        count = _triangle_normals(points, near, i, k, normals, corners)
        _complete_linkage(normals, count, least, similar, cluster, chain)
        sizes[:count] = 0
        for t in range(count):
            sizes[cluster[t]] += 1
        start = _largest_cluster(cluster, sizes, count, 1)
        found = 0
        while found < PATCHES:
            largest = _largest_cluster(cluster, sizes, count, LEAST_TRIANGLES)
            if largest < 0:
                break
            bits = np.uint64(0)
            for t in range(count):
                if cluster[t] == largest:
                    bits |= np.uint64(1) << np.uint64(corners[t, 0])
                    bits |= np.uint64(1) << np.uint64(corners[t, 1])
            if _covers(bits, k, LEAST_NEIGHBOURS):
                slot = PATCHES * i + found
                _mean_axis(normals, cluster, largest, count, axes[slot])
                patches.sizes[slot] = sizes[largest]
                patches.corners[slot] = bits
                found += 1
            sizes[largest] = 0
        if start < 0 or _is_all(patches, i):
            continue
        for m in range(len(sides)):
            for c in range(3):
                sides[m, c] = points[near[i, m], c] - points[i, c]
        flattest, slot, drops = steepest, PATCHES * i, len(sides) // ELSEWHERE
        if found > 0:
            flat = flat_misfit(sides, axes[slot : slot + PLANES], min(found, PLANES), drops)
            flattest = min(steepest, flat)
        axis = patches.bent_axes[i]
        _mean_axis(normals, cluster, start, count, axis)
        patches.bent_corners[i] = bend_patch(sides, flattest, drops, axis, patches.bends[i])


@kernel
def _turned(points, axis, bend, i, j, out_axis):
    """Fill the normal at point j of a patch of point i."""
    square = 0.0
    for c in range(3):
        value = axis[c]
        for b in range(3):
            value -= bend[c, b] * (points[j, b] - points[i, b])
        out_axis[c] = value
        square += value * value
    length = math.sqrt(square)
    for c in range(3):
        out_axis[c] /= length


@kernel
def _cosine(a, b):
    return abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel
def choose_bent(points, patches, least, out_chosen):
    """Choose the bent patches that their neighbours confirm by the normals the quadric has there.

    Half of all neighbours must, which tells a surface from a crossing, and most of those where a
    flat patch is all there is, which tells it from the rounding of a crease between planes.
    """
    axis, near = np.empty(3), patches.near
    bent_axes, bent_corners = patches.bent_axes, patches.bent_corners
    for i in range(len(near)):
        members, agree, flat, flat_agree = 0, 0, 0, 0
        for m in range(near.shape[1]):
            if (bent_corners[i] >> np.uint64(m)) & np.uint64(1) == 0:
                continue
            j = near[i, m]
            members += 1
            _turned(points, bent_axes[i], patches.bends[i], i, j, axis)
            if bent_corners[j] != 0:
                agree += _cosine(axis, bent_axes[j]) >= least
            elif _is_all(patches, j):
                flat += 1
                flat_agree += _cosine(axis, patches.axes[PATCHES * j]) >= least
        most = flat_agree * ELSEWHERE >= flat * (ELSEWHERE - 1)
        out_chosen[i] = most and members > 0 and 2 * (agree + flat_agree) >= members


@kernel
def join_patches(points, patches, strip, least, parent):
    """Join patches of neighbouring points whose axes have |cosine| >= `least` (union-find).

    Point j is compared with point i where it is a corner of the patch of i (thesis 4.2.3.5), by the
    normal that a bent patch has there; `bends` are now those of first patches. Two patches of
    which both are a `strip` are not joined: along an edge strips turn from one side to the other.
    On return `parent` holds the root of each slot, its lowest slot.
    """
    axis, near, axes, size = np.empty(3), patches.near, patches.axes, patches.sizes
    for slot in range(len(size)):
        if size[slot] == 0:
            continue
        i = slot // PATCHES
        for m in range(near.shape[1]):
            if (patches.corners[slot] >> np.uint64(m)) & np.uint64(1) == 0:
                continue
            axis[:] = axes[slot]
            if slot % PATCHES == 0:
                _turned(points, axes[slot], patches.bends[i], i, near[i, m], axis)
            for other in range(PATCHES * near[i, m], PATCHES * near[i, m] + PATCHES):
                if size[other] == 0:
                    break
                if not (strip[slot] and strip[other]) and _cosine(axis, axes[other]) >= least:
                    a, b = find_root(parent, slot), find_root(parent, other)
                    parent[max(a, b)] = min(a, b)
    for slot in range(len(parent)):
        parent[slot] = find_root(parent, slot)


@kernel
def claim_corners(patches, label, claimed, counted):
    """Add to each point the manifolds that have at least `CLAIMS` patches with it as a corner.

    `label` (n, PATCHES) is the manifold of each patch, -1 none, and becomes the manifolds of each
    point: those of its own patches first, each once. `claimed` (n, PATCHES) comes with -1 and
    `counted` with 0; a fifth manifold that claims a point is not counted.
    """
    near = patches.near
    n, k = near.shape
    for i in range(n):
        for p in range(PATCHES):
            if label[i, p] < 0:
                continue
            for m in range(k):
                if (patches.corners[PATCHES * i + p] >> np.uint64(m)) & np.uint64(1) == 0:
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
            elif counted[i, p - PATCHES] >= CLAIMS:
                name = claimed[i, p - PATCHES]
            for c in range(filled):
                if label[i, c] == name:
                    name = -1
            if name >= 0 and filled < PATCHES:
                label[i, filled] = name
                filled += 1
