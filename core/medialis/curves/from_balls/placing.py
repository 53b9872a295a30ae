"""A graph in its surface: radius and importance of its nodes, the node of each sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.kept import kept
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress
from medialis.threads import run_patiently
from medialis.validation import FloatArray


def put_in_surface(
    cloud: MedialCloud, graph: CurveSkeleton, node_of_sample: NDArray[np.int64], progress: Progress
) -> CurveSkeleton:
    """Give nodes their distance to the nearest sample, and each sample its node and branch."""
    radii = run_patiently(lambda: cloud.surface.tree.query(graph.nodes)[0], progress)
    missing = node_of_sample < 0
    if missing.any():
        key = missing.tobytes()
        nearest = kept(
            _nearest,
            cloud,
            key,
            lambda: run_patiently(lambda: _nearest(cloud.surface, missing), progress),
            progress,
        )
        node_of_sample[missing] = np.where(nearest < 0, -1, node_of_sample[nearest])
    return CurveSkeleton.of(
        graph.nodes, graph.edges, radii, vertex_node=node_of_sample, cloud=cloud
    )


def _nearest(surface: Shape, missing: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the nearest sample of the same component that is not missing for those that are."""
    from scipy.spatial import cKDTree

    result = np.full(surface.point_count, -1)
    for part in np.unique(surface.components[missing]).tolist():
        rows = np.flatnonzero(surface.components == part)
        known, lost = rows[~missing[rows]], rows[missing[rows]]
        if len(known):
            near = cKDTree(surface.points[known]).query(surface.points[lost])[1]
            result[lost] = known[near]
    return result[missing]


def node_importance(
    cloud: MedialCloud, graph: CurveSkeleton, candidates: NDArray[np.int64], importance: FloatArray
) -> FloatArray:
    """Return the importance of the nearest candidate of the same part of the shape for each node.

    On a single node hangs the whole area of its part, and so it does in a part without candidates.
    """
    from scipy.spatial import cKDTree

    surface, node = cloud.surface, np.asarray(graph.vertex_node)
    whole = np.bincount(surface.components, surface.point_areas)
    part = np.full(graph.component_count, -1)
    part[graph.components[node[node >= 0]]] = surface.components[node >= 0]
    of_node, of_candidate = part[graph.components], surface.components[candidates]
    result = np.where(of_node >= 0, whole[of_node], np.nan)
    for one in np.intersect1d(of_node, of_candidate).tolist():
        nodes, rows = np.flatnonzero(of_node == one), np.flatnonzero(of_candidate == one)
        tree = cKDTree(cloud.centers[candidates[rows]])
        result[nodes] = importance[rows[tree.query(graph.nodes[nodes])[1]]]
    alone = (graph.degrees == 0) & (of_node >= 0)
    result[alone] = whole[of_node[alone]]
    return result
