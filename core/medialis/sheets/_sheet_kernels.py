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
    i, j, a, b, places, normals, touched, regions, spacing, rows, centers, radii, closed, wall,
    tau, turn, offsets, samples, clusters,
):  # fmt: skip
    """Tell whether contact b (of the ball of node j) is what contact a is for node i.

    Never, where a crease lies between them. They are when b is close to a, nearer than tau
    spacings, and seen from the center under a small angle (the chord is `turn` radii at most). In
    walls thinner than the samples are apart, and at creases, that angle says nothing: there the
    normals must agree. They are also when the normals agree and b lies in the cluster of a. Of
    balls that touch all round, contacts are arbitrary: two are the same when they nearly coincide.
    """
    reach = tau * max(spacing[a], spacing[b])
    if closed[i] and closed[j]:
        return _distance(centers, i, j) + abs(radii[i] - radii[j]) <= reach
    if regions[a] != regions[b]:
        return False
    gap = _distance(places, a, b)
    if gap <= reach and gap <= turn * min(radii[i], radii[j]):
        return True
    if not _agree(normals, a, b):
        return False
    if gap <= reach and wall[i] and wall[j]:
        return True
    mine = _cluster_of(touched[a], rows[i], offsets, samples, clusters)
    return mine >= 0 and mine == _cluster_of(touched[b], rows[i], offsets, samples, clusters)


@kernel
def link_neighbours(
    begin, end, graph_offsets, graph, clear, places, normals, touched, regions, spacing, rows,
    centers, radii, closed, wall, tau, turn, offsets, samples, clusters, out_links,
):  # fmt: skip
    """Set out_links where the balls of two neighbouring nodes lie on one sheet.

    Contacts 0..u - 1 are the first ones of the nodes, u..2 u - 1 the second ones. The first ones
    are neighbours already; the second ones must match, seen from one ball at least (single
    linkage).
    """
    u = len(rows)
    for i in range(begin, end):
        if not clear[i]:
            continue
        for at in range(graph_offsets[i], graph_offsets[i + 1]):
            j = graph[at]
            if clear[j]:
                out_links[at] = _matches(
                    i, j, u + i, u + j, places, normals, touched, regions, spacing, rows, centers,
                    radii, closed, wall, tau, turn, offsets, samples, clusters,
                ) or _matches(
                    j, i, u + j, u + i, places, normals, touched, regions, spacing, rows, centers,
                    radii, closed, wall, tau, turn, offsets, samples, clusters,
                )  # fmt: skip


@kernel
def link_across(
    begin, end, across, clear, places, normals, touched, regions, spacing, rows,
    centers, radii, closed, wall, tau, turn, offsets, samples, clusters, out_partner,
):  # fmt: skip
    """Node at the second contact, where its ball is the same ball seen from there; -1.

    Its second contact must match the first one of this ball.
    """
    u = len(rows)
    for i in range(begin, end):
        j = across[i]
        if clear[i] and j >= 0 and clear[j] and _matches(
            i, j, i, u + j, places, normals, touched, regions, spacing, rows, centers, radii,
            closed, wall, tau, turn, offsets, samples, clusters,
        ):  # fmt: skip
            out_partner[i] = j


@kernel
def join_links(graph_offsets, graph, links, partner, parent):
    """Union-find over the links; the root of a piece is its lowest node."""
    for i in range(len(parent)):
        for at in range(graph_offsets[i], graph_offsets[i + 1]):
            if links[at]:
                a, b = find_root(parent, i), find_root(parent, graph[at])
                if a != b:
                    parent[max(a, b)] = min(a, b)
        if partner[i] >= 0:
            a, b = find_root(parent, i), find_root(parent, partner[i])
            if a != b:
                parent[max(a, b)] = min(a, b)
    for i in range(len(parent)):
        parent[i] = find_root(parent, i)
