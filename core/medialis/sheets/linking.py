"""Which balls of the unfolded surface lie on one sheet (thesis 6.2.2.1; see sheets.py)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.model.feature_sets import FeatureSets
from medialis.model.unfolded import Unfolded
from medialis.surface.surface_graph import local_spacing
from medialis.threads import run_chunks
from medialis.validation import IntArray

CLEARLY_APART = 2.0
"""Sample spacings between the two feature points from which a ball can be linked. A box of sides 2,
1.5 and 1 has 13 sheets at spacings from 0.03 to 0.17 (six samples across its smallest side) with
2, and fewer at 0.17 with 3, because too few balls are left."""

LARGEST_TURN = 0.75
"""Radii: the chord by which a feature point may move from ball to ball, an angle of 44 degrees.
Near the corner of a box the feature points of two sheets come as close as one likes, but stay 90
degrees apart as seen from the center."""

WALL = -0.5
"""Cosine between the normals at the two feature points of a ball in a wall: 120 degrees or more."""

NODES_A_CHUNK = 8192


def clear_balls(
    sets: FeatureSets, unfolded: Unfolded
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which balls can be linked, and which lie in walls or at creases; two (u,) arrays.

    A ball can be linked when its contacts are clearly apart, or on the two sides of a wall or of a
    crease.
    """
    rows, parted = unfolded.rows, unfolded.parted
    spacing = local_spacing(unfolded.cloud.surface)[unfolded.cloud.features[rows]].max(axis=1)
    gap = np.linalg.norm(unfolded.points - unfolded.contacts, axis=1)
    cosine = np.einsum("ij,ij->i", unfolded.normals, unfolded.contact_normals)
    wall = cosine < WALL
    clear = ((gap >= CLEARLY_APART * spacing) | wall) & ~sets.rim[rows]
    return clear | parted, wall | parted


def pieces(
    sets: FeatureSets,
    unfolded: Unfolded,
    clear: NDArray[np.bool_],
    wall: NDArray[np.bool_],
    threshold: float,
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the lowest node that each node is linked to, directly or through others, (u,).

    Also the same for links along the surface alone, and the partner of each ball across its sheet.
    """
    from medialis.sheets._sheet_kernels import join_links, link_across, link_neighbours

    graph, u, rows = unfolded.graph, len(unfolded), unfolded.rows
    touched = unfolded.cloud.features[rows].T.ravel()
    contacts = (
        np.concatenate([unfolded.points, unfolded.contacts]),
        np.concatenate([unfolded.normals, unfolded.contact_normals]),
        touched,
        unfolded.regions.T.ravel(),
        local_spacing(unfolded.cloud.surface)[touched],
    )
    closed = sets.closed[rows] & ~unfolded.parted
    balls = rows, unfolded.centers, unfolded.radii, closed, wall
    members = sets.samples.offsets, sets.samples.indices, sets.clusters
    rules = *contacts, *balls, threshold - 1.0, LARGEST_TURN, *members
    links, partner = np.zeros(len(graph.indices), np.bool_), np.full(u, -1, np.int32)

    def work(begin: int, end: int) -> None:
        link_neighbours(begin, end, graph.offsets, graph.indices, clear, *rules, links)
        link_across(begin, end, unfolded.across, clear, *rules, partner)

    run_chunks(work, u, NODES_A_CHUNK)
    piece, region = np.arange(u, dtype=np.int32), np.arange(u, dtype=np.int32)
    join_links(graph.offsets, graph.indices, links, partner, piece)
    join_links(graph.offsets, graph.indices, links, np.full_like(partner, -1), region)
    return piece, region, partner
