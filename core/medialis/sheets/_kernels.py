"""Kernels of feature sets and of the links of medial sheets (thesis 6.2.1 and 6.2.2.1).

**Feature sets** (see feature_sets.py). All samples in the ball of radius r + tau round a center are
found by one walk down the box tree that ball shrinking uses. They are clustered by the graph of the
surface: each found sample stamps itself and its neighbours, and is joined (union-find) with whoever
has stamped them before, so a set of s samples costs O(s), not O(s^2). Each chunk of balls grows a
list of its own, which `place_sets` moves to the rows of the result.

**Links** (Eq. 6.4-6.5; see sheets.py): which balls lie on one sheet.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._box_tree_kernels import LEAF, is_certain, lowest_bit, test_children
from medialis.base._kernels import find_root, join
from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import distance

MOST_SAMPLES = 1024
"""Samples of one set at most. A flat contact holds about 0.6 r / h of them (tau = 0.1 h), so only a
ball that touches a piece of a sphere or a tube with thousands of samples has more."""

KNOWN = 64
"""Balls with too many samples that are kept: on a tube, the rings that neighbours lie on."""

MARKS = MOST_SAMPLES + 2
"""Numbers that the samples of one set are marked with: those of the last set are less."""

SURE = 1e-12
"""Length in units of the tree: more than rounding makes of distances."""

SAME_SIDE = 0.7
"""Cosine between normals on one side of a wall: less than 45 degrees apart."""


class TouchingBalls(NamedTuple):
    """Balls whose samples are looked for, in units of the tree and relative to its middle.

    Attributes
    ----------
    centers : (k, 3) float64
    reach : (k,) float64
        Radius and gap.
    gaps : (k,) float64
        How far outside a sample may lie.
    features : (k, 2) int32
        Two samples that are in the set.
    margin : float
        What the bounds of the tree may be off.
    """

    centers: NDArray[np.float64]
    reach: NDArray[np.float64]
    gaps: NDArray[np.float64]
    features: NDArray[np.int32]
    margin: float


class SetColumns(NamedTuple):
    """What is found of each ball: samples in its set, clusters of them, agreement; (k,) each."""

    size: NDArray[np.int64]
    clusters: NDArray[np.int32]
    agreement: NDArray[np.float64]


class Links(NamedTuple):
    """Rows of indices: those of row i are indices[offsets[i]:offsets[i + 1]], as in `Ragged`."""

    offsets: NDArray[np.int64]
    indices: NDArray[np.int32]


class Contacts(NamedTuple):
    """The balls of u nodes of an unfolded surface, and their contacts, as links see them.

    Contacts 0..u - 1 are the first ones of the nodes, u..2 u - 1 the second ones.

    Attributes
    ----------
    places, normals : (2u, 3) float64
    touched, regions : (2u,) int32
        The sample, and the region of the surface, of each contact.
    spacing : (2u,) float64
        Of the samples there.
    rows : (u,) int32
        Of the ball in the feature sets.
    centers, radii : (u, 3) and (u,) float64
    clear, closed, wall : (u,) bool
        Balls that can be linked, that touch all round, and that lie in walls or at creases.
    tau : float
        Spacings up to which contacts are close.
    turn : float
        Radii: the longest chord between contacts that are the same.
    sets, clusters : Links and (entries,) int16
        The feature sets.
    """

    places: NDArray[np.float64]
    normals: NDArray[np.float64]
    touched: NDArray[np.int32]
    regions: NDArray[np.int32]
    spacing: NDArray[np.float64]
    rows: NDArray[np.int32]
    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    clear: NDArray[np.bool_]
    closed: NDArray[np.bool_]
    wall: NDArray[np.bool_]
    tau: float
    turn: float
    sets: Links
    clusters: NDArray[np.int16]


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
            if count == MOST_SAMPLES:
                return MOST_SAMPLES + 1
            found[count] = order[begin + slot]
            count += 1
    return count


@kernel
def _find_in_ball(x, y, z, reach, margin, tree, stack, found):
    """List the samples within `reach` of a point; return how many, MOST_SAMPLES + 1 if more."""
    _, points, _, order, blocks, bounds, child, depth = tree
    n = len(points)
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
            if count > MOST_SAMPLES:
                return count
    return count


@kernel
def _cluster(found, count, graph, stamp, mark, parent, out_cluster):
    """Find the clusters of the listed samples, numbered in their order; return how many.

    `stamp` holds less than `mark` everywhere on entry, less than `mark` + MARKS on return.
    """
    offsets, neighbours = graph
    for a in range(count):
        parent[a] = a
    for a in range(count):
        i = found[a]
        for at in range(offsets[i] - 1, offsets[i + 1]):
            near = i if at < offsets[i] else neighbours[at]
            b = stamp[near] - mark
            if b < 0:
                stamp[near] = mark + a
            elif parent[a] != parent[b]:
                join(parent, a, b)
    clusters = 0
    for a in range(count):
        root = find_root(parent, a)
        if root == a:
            out_cluster[a] = clusters
            clusters += 1
        else:
            out_cluster[a] = out_cluster[root]
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
        if count > MOST_SAMPLES:
            return count
        count += 1
    found[at] = found[place]
    found[place] = sample
    return count


@kernel
def find_sets(begin, end, rows, balls, normals, tree, graph, out):
    """Feature sets of the balls rows[begin:end]: samples and clusters, one after the other.

    The first two samples of a set are the feature points of the ball. A set of more than
    MOST_SAMPLES is cut to these two, in one cluster with an agreement of 0: it goes round the ball.
    Balls in the middle of a tube are nearly the same all round: what holds one that has so many
    within half of its gap is cut without a walk.
    """
    centers, reach, gaps, features, margin = balls
    n = len(normals)
    stack = np.empty(8 * 12 + 8, np.int64)  # 8 children on each of at most 11 wide levels
    found, cluster = np.empty(MOST_SAMPLES + 2, np.int32), np.empty(MOST_SAMPLES + 2, np.int16)
    parent, stamp = np.empty(MOST_SAMPLES + 2, np.int32), np.full(n, -1, np.int32)
    samples, labels = np.empty(32 * (end - begin), np.int32), np.empty(32 * (end - begin), np.int16)
    known, oldest = np.full((4, KNOWN), np.inf), 0
    filled = 0
    for turn in range(begin, end):
        row = rows[turn]
        x, y, z = centers[row, 0], centers[row, 1], centers[row, 2]
        count = MOST_SAMPLES + 1
        if not is_certain(known, x, y, z, reach[row]):
            count = _find_in_ball(x, y, z, reach[row], margin, tree, stack, found)
            less = reach[row] - 0.5 * gaps[row]
            if count > MOST_SAMPLES < _find_in_ball(x, y, z, less, margin, tree, stack, found):
                known[0, oldest], known[1, oldest], known[2, oldest] = x, y, z
                known[3, oldest] = less + SURE
                oldest = (oldest + 1) % KNOWN
        if count > MOST_SAMPLES:
            found[0], found[1] = features[row, 0], features[row, 1]
            cluster[0] = cluster[1] = 0
            count, clusters, agreement = 2, 1, 0.0
        else:
            count = _put_first(found, count, features[row, 0], 0)
            count = _put_first(found, count, features[row, 1], 1)
            mark = (turn - begin) * MARKS
            clusters = _cluster(found, count, graph, stamp, mark, parent, cluster)
            agreement = _mean_normal(found, count, normals)
        if filled + count > len(samples):
            room = 2 * (filled + count)
            wider, wider_labels = np.empty(room, np.int32), np.empty(room, np.int16)
            wider[:filled], wider_labels[:filled] = samples[:filled], labels[:filled]
            samples, labels = wider, wider_labels
        samples[filled : filled + count] = found[:count]
        labels[filled : filled + count] = cluster[:count]
        filled += count
        out.size[row], out.clusters[row], out.agreement[row] = count, clusters, agreement
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


@kernel
def _cluster_of(sample, row, contacts):
    """Cluster of a sample in the feature set of a ball; -1 when it is not in the set."""
    offsets, samples = contacts.sets
    for at in range(offsets[row], offsets[row + 1]):
        if samples[at] == sample:
            return contacts.clusters[at]
    return -1


@kernel
def _agree(normals, a, b):
    cosine = 0.0
    for axis in range(3):
        cosine += normals[a, axis] * normals[b, axis]
    return cosine > SAME_SIDE


@kernel
def _matches(i, j, a, b, contacts):
    """Tell whether contact b (of the ball of node j) is what contact a is for node i.

    Never, where a crease lies between them. They are when b is close to a, nearer than tau
    spacings, and seen from the center under a small angle (the chord is `turn` radii at most). In
    walls thinner than the samples are apart, and at creases, that angle says nothing: there the
    normals must agree. They are also when the normals agree and b lies in the cluster of a. Of
    balls that touch all round, contacts are arbitrary: two are the same when they nearly coincide.
    """
    spacing, radii, wall = contacts.spacing, contacts.radii, contacts.wall
    reach = contacts.tau * max(spacing[a], spacing[b])
    if contacts.closed[i] and contacts.closed[j]:
        return distance(contacts.centers, i, j) + abs(radii[i] - radii[j]) <= reach
    if contacts.regions[a] != contacts.regions[b]:
        return False
    gap = distance(contacts.places, a, b)
    if gap <= reach and gap <= contacts.turn * min(radii[i], radii[j]):
        return True
    if not _agree(contacts.normals, a, b):
        return False
    if gap <= reach and wall[i] and wall[j]:
        return True
    row, touched = contacts.rows[i], contacts.touched
    mine = _cluster_of(touched[a], row, contacts)
    return mine >= 0 and mine == _cluster_of(touched[b], row, contacts)


@kernel
def link_nodes(begin, end, graph, across, contacts, out_links, out_partner):
    """Set out_links where the balls of two neighbouring nodes lie on one sheet, and out_partner.

    The first contacts are neighbours already; the second ones must match, seen from one ball at
    least (single linkage). The partner is the node at the second contact, where its ball is the
    same ball seen from there: its second contact must match the first one of this ball.
    """
    u, clear = len(contacts.rows), contacts.clear
    for i in range(begin, end):
        if not clear[i]:
            continue
        for at in range(graph.offsets[i], graph.offsets[i + 1]):
            j = graph.indices[at]
            if clear[j]:
                found = _matches(i, j, u + i, u + j, contacts)
                out_links[at] = found or _matches(j, i, u + j, u + i, contacts)
        j = across[i]
        if j >= 0 and clear[j] and _matches(i, j, i, u + j, contacts):
            out_partner[i] = j


@kernel
def join_links(graph, links, partner, parent):
    """Union-find over the links; the root of a piece is its lowest node."""
    for i in range(len(parent)):
        for at in range(graph.offsets[i], graph.offsets[i + 1]):
            if links[at]:
                join(parent, i, graph.indices[at])
        if partner[i] >= 0:
            join(parent, i, partner[i])
    for i in range(len(parent)):
        parent[i] = find_root(parent, i)
