"""Extended feature transform: all samples that a ball touches (thesis 6.2.1.1)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.feature_sets import FeatureSets
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.surface.surface_graph import local_spacing, surface_graph
from medialis.threads import run_chunks
from medialis.validation import as_number

DEFAULT_REACH = 0.1
"""The thesis's epsilon. A ball of radius r gathers the samples of a flat contact up to the distance
sqrt(0.2 r h) from it: half a spacing h for r = 1.25 h, so that no contact is missed but by the
smallest balls."""

FLOAT32_MARGIN = 2e-6
"""Fraction of the diagonal: what the float32 bounds of the tree may be off, with room."""

BALLS_A_CHUNK = 4096


def extended_feature_transform(
    shape: Shape,
    cloud: MedialCloud,
    *,
    reach: float = DEFAULT_REACH,
    graph: Ragged | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> FeatureSets:
    """Find all samples that each ball touches, and their clusters.

    Parameters
    ----------
    shape : Shape
        n samples, as given to `medialis.surface_skeleton`.
    cloud : MedialCloud
        k balls of them.
    reach : float
        Above 0 to 10, in local sample spacings: a sample belongs to a ball when it lies within its
        radius and this. The local spacing is the mean of those at the two feature points.
    graph : Ragged, optional
        The `surface_graph` of the shape, when it is known already.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    FeatureSets
        Samples that are neighbours along the surface or share a neighbour, directly or through
        others of the same set, are one cluster.

    Raises
    ------
    InvalidShapeError
        When the cloud belongs to a larger shape.
    InvalidOptionError
        When `reach` is out of its range.
    Cancelled
        When `progress` asks for it.

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
    >>> shape = medialis.organic_shape(56)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> sets = medialis.extended_feature_transform(shape, cloud)
    >>> bool((sets.samples[7][:2] == cloud.features[7]).all()), bool(sets.counts.max() > 2)
    (True, True)
    """
    reach = as_number(reach, "reach", low=0.0, high=10.0, open_low=True)
    check_cloud(shape, cloud)
    progress = Progress.of(progress)
    if graph is None:
        graph = surface_graph(shape)
    rows = np.flatnonzero(cloud.valid).astype(np.int32)
    spacing = local_spacing(shape)
    taus = np.zeros(len(cloud))
    taus[rows] = reach * spacing[cloud.features[rows]].mean(axis=1)
    with progress.stage("feature sets", 0.0, 1.0):
        return _find(shape, cloud, rows, taus, graph, progress)


def check_cloud(shape: Shape, cloud: MedialCloud) -> None:
    """Check that the samples of a cloud exist.

    Raises
    ------
    InvalidShapeError
        When one does not.
    """
    largest = int(max(cloud.source.max(initial=-1), cloud.features.max(initial=-1)))
    if largest >= shape.point_count:
        raise InvalidShapeError(
            f"The balls touch sample {largest}, but the shape has only {shape.point_count} points: "
            "give the shape that the cloud was computed on."
        )


def check_sets(cloud: MedialCloud, sets: FeatureSets) -> None:
    """Check that feature sets are those of a cloud.

    Raises
    ------
    InvalidShapeError
        When there is not one set a ball, or a set does not begin with the feature points.
    """
    rows = np.flatnonzero(cloud.valid)
    if len(sets) == len(cloud) and (sets.samples.lengths[rows] >= 2).all():
        first = sets.samples.offsets[rows]
        if (sets.samples.indices[first[:, None] + [0, 1]] == cloud.features[rows]).all():
            return
    raise InvalidShapeError(
        f"sets must be the feature sets of this cloud of {len(cloud)} balls, got others of "
        f"{len(sets)}: compute them with medialis.extended_feature_transform(shape, cloud)."
    )


def _mean_face_normals(shape: Shape) -> NDArray[np.float64]:
    """Mean of the unit normals of the faces at each sample, by area, (n, 3); shorter on a crease.

    The normal of the sample itself where it has no face. Faces are turned to agree with those.
    """
    if shape.faces is None:
        return shape.normals
    a, b, c = shape.points[shape.faces.T]
    normals = np.cross(b - a, c - a)
    corners = np.asarray(shape.faces)
    outward = np.einsum("ij,ij->i", normals, shape.normals[corners].sum(axis=1))
    normals[outward < 0] *= -1.0
    area = np.repeat(np.linalg.norm(normals, axis=1), 3)
    n, at = shape.point_count, corners.ravel()
    total = np.bincount(at, area, minlength=n)
    mean = np.stack(
        [np.bincount(at, np.repeat(normals[:, j], 3), minlength=n) for j in range(3)], axis=1
    )
    np.divide(mean, total[:, None], out=mean, where=total[:, None] > 0)
    return np.where(total[:, None] > 0, mean, shape.normals)


def _find(
    shape: Shape,
    cloud: MedialCloud,
    rows: NDArray[np.int32],
    taus: NDArray[np.float64],
    graph: Ragged,
    progress: Progress,
) -> FeatureSets:
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis._kernels.box_tree import build_box_tree
    from medialis.sheets._feature_set_kernels import find_sets, place_sets

    k = len(cloud)
    size, counts, agreement = np.zeros(k, np.int64), np.zeros(k, np.int32), np.full(k, np.nan)
    chunks: dict[int, tuple[NDArray[np.int32], NDArray[np.int16]]] = {}
    if len(rows):
        # Dividing by a power of two changes no digit and keeps float32 bounds in range.
        unit = math.ldexp(1.0, math.frexp(shape.diagonal)[1] - 1)
        tree = build_box_tree(shape.points / unit, shape.normals)
        place = np.empty(shape.point_count, np.int64)
        place[tree.order] = np.arange(shape.point_count)
        rows = rows[np.argsort(place[cloud.source[rows]], kind="stable")]
        centers = cloud.centers / unit - tree.center
        balls = _mean_face_normals(shape), centers, cloud.radii / unit, cloud.features, taus / unit
        nodes = tree.order, tree.blocks, tree.bounds, tree.child, tree.depth
        margin = FLOAT32_MARGIN * shape.diagonal / unit
        links = graph.offsets, graph.indices

        def work(begin: int, end: int) -> None:
            chunks[begin] = find_sets(
                begin, end, rows, *balls, margin, *nodes, *links, size, counts, agreement
            )

        run_chunks(work, len(rows), BALLS_A_CHUNK, progress=progress)
    offsets = np.concatenate([[0], np.cumsum(size)])
    samples, clusters = np.empty(offsets[-1], np.int32), np.empty(offsets[-1], np.int16)
    for begin, (found, labels) in chunks.items():
        part = rows[begin : begin + BALLS_A_CHUNK]
        place_sets(part, offsets, found, labels, samples, clusters)
    return FeatureSets(Ragged(offsets, samples), clusters, counts, agreement)
