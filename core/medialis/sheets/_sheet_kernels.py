"""Kernels of medial sheets: which balls are linked (thesis 6.2.2.1, Eq. 6.4-6.5; see sheets.py)."""

from __future__ import annotations

import math

from medialis._kernels.jit import kernel
from medialis._kernels.union_find_kernels import find_root

SAME_SIDE = 0.7
"""Cosine between normals on one side of a wall: less than 45 degrees apart."""


@kernel
def _distance(points, i, j):
    dx = points[i, 0] - points[j, 0]
    dy = points[i, 1] - points[j, 1]
    dz = points[i, 2] - points[j, 2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def _cluster_of(sample, row, offsets, samples, clusters):
    """Cluster of a sample in the feature set of a ball; -1 when it is not in the set."""
    for at in range(offsets[row], offsets[row + 1]):
        if samples[at] == sample:
            return clusters[at]
    return -1


@kernel
def _agree(normals, a, b):
    cosine = 0.0
    for axis in range(3):
        cosine += normals[a, axis] * normals[b, axis]
    return cosine > SAME_SIDE


@kernel
def _matches(
    i, j, a, b, points, normals, centers, radii, spacing, closed, wall, tau, turn,
    offsets, samples, clusters,
):  # fmt: skip
    """Tell whether sample b (a contact of ball j) is what sample a is for ball i.

    They are when b is close to a, nearer than tau spacings, and seen from the center under a small
    angle (the chord is `turn` radii at most). In walls thinner than the samples are apart, that
    angle says nothing: there the normals must agree. They are also when the normals agree and b
    lies in the cluster of a. Of balls that touch all round, contacts are arbitrary: two are the
    same when they nearly coincide.
    """
    reach = tau * max(spacing[a], spacing[b])
    if closed[i] and closed[j]:
        return _distance(centers, i, j) + abs(radii[i] - radii[j]) <= reach
    gap = _distance(points, a, b)
    if gap <= reach and gap <= turn * min(radii[i], radii[j]):
        return True
    if not _agree(normals, a, b):
        return False
    if gap <= reach and wall[i] and wall[j]:
        return True
    mine = _cluster_of(a, i, offsets, samples, clusters)
    return mine >= 0 and mine == _cluster_of(b, i, offsets, samples, clusters)


@kernel
def link_neighbours(
    begin, end, row_of, graph_offsets, graph, points, normals, features, centers, radii, spacing,
    closed, clear, wall, tau, turn, offsets, samples, clusters, out_links,
):  # fmt: skip
    """Set out_links where the balls of two neighbouring samples lie on one sheet.

    The first feature points are neighbours already; the second ones must match, seen from one ball
    at least (single linkage).
    """
    for s in range(begin, end):
        i = row_of[s]
        if i < 0 or not clear[i]:
            continue
        for at in range(graph_offsets[s], graph_offsets[s + 1]):
            j = row_of[graph[at]]
            if j < 0 or not clear[j]:
                continue
            a, b = features[i, 1], features[j, 1]
            out_links[at] = _matches(
                i, j, a, b, points, normals, centers, radii, spacing, closed, wall,
                tau, turn, offsets, samples, clusters,
            ) or _matches(
                j, i, b, a, points, normals, centers, radii, spacing, closed, wall,
                tau, turn, offsets, samples, clusters,
            )  # fmt: skip


@kernel
def link_across(
    begin, end, row_of, points, normals, features, centers, radii, spacing, closed, clear, wall,
    tau, turn, offsets, samples, clusters, out_partner,
):  # fmt: skip
    """Row of the ball of the second feature point, where it is the same ball seen from there; -1.

    Its second feature point must match the first one of this ball.
    """
    for s in range(begin, end):
        i = row_of[s]
        if i < 0 or not clear[i]:
            continue
        j = row_of[features[i, 1]]
        if j >= 0 and clear[j] and _matches(
            i, j, s, features[j, 1], points, normals, centers, radii, spacing, closed, wall,
            tau, turn, offsets, samples, clusters,
        ):  # fmt: skip
            out_partner[i] = j


@kernel
def join_links(row_of, graph_offsets, graph, links, partner, parent):
    """Union-find over the links; the root of a piece is its lowest row."""
    for s in range(len(row_of)):
        i = row_of[s]
        if i < 0:
            continue
        for at in range(graph_offsets[s], graph_offsets[s + 1]):
            if links[at]:
                a, b = find_root(parent, i), find_root(parent, row_of[graph[at]])
                if a != b:
                    parent[max(a, b)] = min(a, b)
        if partner[i] >= 0:
            a, b = find_root(parent, i), find_root(parent, partner[i])
            if a != b:
                parent[max(a, b)] = min(a, b)
    for i in range(len(parent)):
        parent[i] = find_root(parent, i)
