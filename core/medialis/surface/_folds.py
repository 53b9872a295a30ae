"""Faces with the same three corners: which to drop so that no boundary appears.

Two faces with the same corners and opposite directions have no volume between them. Scanned meshes
hold small folds of such pairs that hang on the surface; dropping one face of a pair would open the
surface along the fold (an edge with 4 faces gets 3, one with 2 gets 1), dropping both closes it.
A whole sheet modelled with a front and a back must not vanish, so only small folds that touch other
faces are dropped; elsewhere one face of each pair stays.
"""

from __future__ import annotations

import numpy as np

from medialis.model.edge_table import EdgeTable, Mask
from medialis.model.topology import Topology, piece_labels

_SMALL_FOLD = 16
"""Most triangles of a fold that is dropped; in the Stanford dragon folds have up to 6."""


def faces_to_drop(topology: Topology) -> tuple[Mask, Mask]:
    """Return, (m,) each, the repeated faces to drop and the faces of small folds to drop."""
    faces, first = topology.faces, topology.first_equal_face
    m = len(faces)
    repeated = first != np.arange(m)
    folds = np.zeros(m, bool)
    if not repeated.any():
        return repeated, folds
    # +1 for an even permutation of the sorted corners, -1 for an odd one.
    direction = np.where((faces[:, [1, 2, 0]] > faces).sum(axis=1) == 2, 1, -1)
    net = np.bincount(first, direction, m)
    groups = np.unique(first[repeated])
    paired = np.zeros(m, bool)
    paired[groups] = net[groups] == 0
    folds = _small_folds(topology, paired[first], paired)[first]
    # Of the others the first face in the prevailing direction stays.
    fits = direction == np.where(net[first] < 0, -1, 1)
    candidates = np.flatnonzero(fits | paired[first])
    keeper = np.full(m, m)
    np.minimum.at(keeper, first[candidates], candidates)
    repeated = keeper[first] != np.arange(m)
    return repeated & ~folds, folds


def _small_folds(topology: Topology, in_pairs: Mask, leaders: Mask) -> Mask:
    """Return the leading faces (m,) of pairs that belong to small folds touching other faces."""
    faces, n = topology.faces, topology.point_count
    result = np.zeros(len(faces), bool)
    fold_faces = np.flatnonzero(leaders)
    if len(fold_faces) == 0:
        return result
    touched = np.zeros(n, bool)
    touched[faces[~in_pairs]] = True
    # Folds are pairs joined by edges: a graph of pairs and of the edges they have.
    pairs = faces[fold_faces]
    k, table = len(pairs), EdgeTable.of(pairs, n)
    links = np.stack([np.repeat(np.arange(k), 3), k + table.edge_of], axis=1)
    fold = piece_labels(k + len(table.low), links)[:k]
    count = int(fold.max()) + 1
    hangs = np.bincount(fold, touched[pairs].any(axis=1), count) > 0
    small = np.bincount(fold, minlength=count) <= _SMALL_FOLD
    result[fold_faces] = (hangs & small)[fold]
    return result
