"""Relaxation of geodesic importance through neighbouring skeleton points (thesis 3.3).

Where the surface is folded or has holes, no plane cut comes near the shortest path of some pairs,
while neighbouring pairs do well. From the feature points of one ball one can go along an edge to
those of the neighbouring ball, and take its geodesic: that path is real, and where it is shorter it
is taken. It also makes the importance continuous: it changes by at most the distance between the
feature points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from medialis.model.geodesic_paths import GeodesicPaths, PathStatus
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape


def relax(shape: Shape, cloud: MedialCloud, paths: GeodesicPaths) -> GeodesicPaths:
    """Shorten paths where the way through neighbouring balls is shorter.

    Two balls are neighbours when their first feature points share an edge of the mesh, and their
    second ones share an edge or are the same vertex.

    Parameters
    ----------
    shape : Shape
        A mesh.
    cloud : MedialCloud
        k balls of the shape, all or some of them.
    paths : GeodesicPaths
        The geodesic of each ball, k rows.

    Returns
    -------
    GeodesicPaths
        Lengths at most the given ones. A shortened path has status NEIGHBOUR and the tangents of
        the path that it ends up in.

    Notes
    -----
    Cost: one Dijkstra search over the k balls with all of them as sources, O(k log k).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    links, weight = _neighbours(shape, cloud)
    k = len(cloud)
    known = np.flatnonzero(np.isfinite(paths.length))
    if len(links) == 0 or len(known) == 0:
        return paths
    # A virtual source reaches each ball at its own length; 1e-300 since a stored zero is no edge.
    rows = np.concatenate([links[:, 0], links[:, 1], np.full(len(known), k)]).astype(np.int32)
    columns = np.concatenate([links[:, 1], links[:, 0], known]).astype(np.int32)
    values = np.concatenate([weight, weight, paths.length[known] + 1e-300])
    graph = coo_array((values, (rows, columns)), shape=(k + 1, k + 1)).tocsr()
    reached, via = dijkstra(graph, indices=k, return_predecessors=True)
    # Shorter by rounding alone is not shorter.
    shorter = np.flatnonzero(reached[:k] < paths.length * (1 - 1e-9))
    length, status = np.array(paths.length), np.array(paths.status)
    start, end = np.array(paths.start_tangent), np.array(paths.end_tangent)
    length[shorter] = reached[shorter]
    status[shorter] = PathStatus.NEIGHBOUR
    for row in shorter.tolist():
        origin = row
        while via[origin] != k:
            origin = int(via[origin])
        start[row], end[row] = paths.start_tangent[origin], paths.end_tangent[origin]
    return replace(paths, length=length, start_tangent=start, end_tangent=end, status=status)


def _neighbours(shape: Shape, cloud: MedialCloud) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Pairs of rows that are neighbours, and how far their feature points are apart in all."""
    n, edges = shape.point_count, shape.edges
    edge_keys = edges[:, 0].astype(np.int64) * n + edges[:, 1]  # ascending, as the edges are
    found = [np.empty((0, 2), np.int64)]
    for side in (1, -1):
        rows = np.flatnonzero(cloud.valid & (cloud.side == side))
        row_of = np.full(n, -1, np.int64)
        row_of[cloud.source[rows]] = rows
        pairs = row_of[edges]
        pairs = pairs[(pairs >= 0).all(axis=1)]
        second = np.sort(cloud.features[pairs, 1].astype(np.int64), axis=1)
        keys = second[:, 0] * n + second[:, 1]
        place = np.minimum(np.searchsorted(edge_keys, keys), max(len(edge_keys) - 1, 0))
        near = second[:, 0] == second[:, 1]
        if len(edge_keys):
            near |= edge_keys[place] == keys
        found.append(pairs[near])
    links = np.concatenate(found)
    gaps = shape.points[cloud.features[links[:, 0]]] - shape.points[cloud.features[links[:, 1]]]
    return links, np.linalg.norm(gaps, axis=2).sum(axis=1)
