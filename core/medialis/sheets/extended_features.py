"""Extended feature transform: all samples that a ball touches (thesis 6.2.1.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import as_cloud
from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.options import Options, algorithm, number
from medialis.progress import Progress
from medialis.surface.surface_graph import local_spacing, surface_graph
from medialis.threads import run_chunks, run_patiently

FLOAT32_MARGIN = 2e-6
"""Fraction of the diagonal: what the float32 bounds of the tree may be off, with room."""

BALLS_A_CHUNK = 1024


@dataclass(frozen=True, kw_only=True)
class FeatureSetOptions(Options):
    """Options of `extended_feature_transform`."""

    contact_gap: float = number(
        0.1,
        "Contact gap",
        "A sample belongs to a ball when it lies no more than this many sample spacings outside.",
        low=1e-9,
        high=10.0,
    )
    """The thesis's epsilon. A ball of radius r gathers the samples of a flat contact up to the
    distance sqrt(0.2 r h) from it: half a spacing h for r = 1.25 h, so that no contact is missed
    but by the smallest balls."""


@algorithm(FeatureSetOptions, door=as_cloud)
def extended_feature_transform(
    cloud: MedialCloud, options: FeatureSetOptions, progress: Progress
) -> FeatureSets:
    """Find all samples that each ball touches, and their clusters.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.

    Returns
    -------
    FeatureSets
        Samples that are neighbours along the surface or share a neighbour, directly or through
        others of the same set, are one cluster.

    See Also
    --------
    point_types, medial_sheets, soft_edges, patches : what rests on the feature sets.

    Notes
    -----
    A set is cut to the two feature points when it has more than 1024 samples, which only a tube or
    a sphere with thousands of samples round one ball has. So memory is linear: at most 6 kB a ball,
    on organic meshes about 200 bytes.

    Source: thesis 6.2.1.1, Eq. 6.1. Deviates: clusters follow the edges of the mesh (in a cloud,
    nearest neighbours) instead of a single linkage cut at the local spacing. Both join samples that
    lie next to each other; edges need no length, so that long triangles do not tear a cluster and
    the two sides of a thin wall do not merge. Two edges are allowed, not one: the two samples that
    a small ball touches beside an edge of the shape often have one between them.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> sets = medialis.extended_feature_transform(cloud)
    >>> bool((sets.samples[7][:2] == cloud.features[7]).all()), bool(sets.counts.max() > 2)
    (True, True)
    """
    rows = np.flatnonzero(cloud.valid).astype(np.int32)
    spacing = run_patiently(lambda: local_spacing(cloud.surface), progress)
    gaps = np.zeros(len(cloud))
    gaps[rows] = options.contact_gap * spacing[cloud.features[rows]].mean(axis=1)
    with progress.stage("feature sets", 0.0, 1.0):
        return _find(cloud, rows, gaps, progress)


def _mean_face_normals(shape: Shape) -> NDArray[np.float64]:
    """Mean of the unit normals of the faces at each sample, by area, (n, 3); shorter on a crease.

    The normal of the sample itself where it has no face. Faces are turned to agree with those.
    """
    if shape.faces is None:
        return shape.normals
    normals, corners = shape.face_vectors.copy(), np.asarray(shape.faces)
    outward = np.einsum("ij,ij->i", normals, shape.normals[corners].sum(axis=1))
    normals[outward < 0] *= -1.0
    area = np.repeat(2 * shape.face_areas, 3)
    n, corner = shape.point_count, corners.ravel()
    total = np.bincount(corner, area, minlength=n)
    mean = np.stack(
        [np.bincount(corner, np.repeat(normals[:, j], 3), minlength=n) for j in range(3)], axis=1
    )
    np.divide(mean, total[:, None], out=mean, where=total[:, None] > 0)
    return np.where(total[:, None] > 0, mean, shape.normals)


def _find(
    cloud: MedialCloud, rows: NDArray[np.int32], gaps: NDArray[np.float64], progress: Progress
) -> FeatureSets:
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis._kernels.box_tree import build_box_tree
    from medialis.sheets._feature_set_kernels import find_sets, place_sets

    k, shape = len(cloud), cloud.surface
    size, counts, agreement = np.zeros(k, np.int64), np.zeros(k, np.int32), np.full(k, np.nan)
    chunks: dict[int, tuple[NDArray[np.int32], NDArray[np.int16]]] = {}
    if len(rows):
        # Dividing by a power of two changes no digit and keeps float32 bounds in range.
        unit = math.ldexp(1.0, math.frexp(shape.diagonal)[1] - 1)
        tree = run_patiently(lambda: build_box_tree(shape.points / unit, shape.normals), progress)
        rows = rows[np.argsort(tree.place[cloud.source[rows]], kind="stable")]
        centers = cloud.centers / unit - tree.center
        normals = run_patiently(lambda: _mean_face_normals(shape), progress)
        balls = normals, centers, cloud.radii / unit, cloud.features, gaps / unit
        nodes = tree.order, tree.blocks, tree.bounds, tree.child, tree.depth
        margin = FLOAT32_MARGIN * shape.diagonal / unit
        graph = run_patiently(lambda: surface_graph(shape), progress)
        links = graph.offsets, graph.indices

        def work(begin: int, end: int) -> None:
            chunks[begin] = find_sets(
                begin, end, rows, *balls, margin, *nodes, *links, size, counts, agreement
            )

        run_chunks(work, len(rows), BALLS_A_CHUNK, progress=progress)
    offsets = np.concatenate([[0], np.cumsum(size)])
    samples, clusters = np.empty(offsets[-1], np.int32), np.empty(offsets[-1], np.int16)
    for begin, (touched, labels) in chunks.items():
        progress.update(1.0)
        part = rows[begin : begin + BALLS_A_CHUNK]
        place_sets(part, offsets, touched, labels, samples, clusters)
    return FeatureSets(Ragged(offsets, samples), clusters, counts, agreement, cloud=cloud)
