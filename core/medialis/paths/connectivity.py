"""Connected importance: thresholding that never leaves islands (thesis 3.3).

The thesis notes that the geodesic importance is monotone in practice, not by construction: a foot
that is wider than its leg stays when the leg has gone. A small island of that kind is lowered to
the importance at which it joins the larger piece; a large one keeps its importance, and the best
path that joins the two is raised to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.geodesic_paths import Importance
from medialis.options import Options, algorithm, length
from medialis.progress import Progress
from medialis.threads import run_patiently
from medialis.validation import FloatArray, frozen

LARGE = 0.002
"""Share of the skeleton points from which an island is worth a bridge: at most 500 bridges."""


@dataclass(frozen=True, kw_only=True)
class ConnectOptions(Options):
    """Options of `connected_importance`."""

    link: float = length(
        0.02,
        "Longest link",
        "Neighbours whose centers are further apart than this share of the size come last.",
        low=1e-9,
        advanced=True,
    )


@algorithm(ConnectOptions)
def connected_importance(
    importance: Importance, options: ConnectOptions, progress: Progress
) -> Importance:
    """Change the importance so that no threshold leaves islands.

    Two skeleton points are linked when their samples share an edge of the mesh, or one is the
    second feature point of the other; and the most important of a neighbourhood across the others,
    up to three edges, since on a rough surface most balls belong to noise. Above any threshold the
    points of the result hang together by links, in one piece for each piece of the shape. Links
    longer than `link` come last: a small piece that only they reach gets importance 0.

    Parameters
    ----------
    importance : Importance
        `geodesic_importance` of the whole inner cloud of a mesh: row i belongs to vertex i.

    Returns
    -------
    Importance
        The same paths; ``length`` (n,) is lower on small islands, higher on the bridges to large
        ones, and NaN where the given one is.

    Raises
    ------
    InvalidShapeError
        When the cloud is not the whole inner cloud of its surface.

    See Also
    --------
    geodesic_importance, important_points

    Notes
    -----
    Cost O(n log n). Of two pieces the one with fewer points is the island; it is large from 0.2 %
    of the points on. A bridge is the path whose least important link is as important as can be (it
    runs in a maximum spanning tree). Not in the thesis.

    Examples
    --------
    >>> import medialis, numpy as np
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(100))
    >>> plain = medialis.geodesic_importance(cloud)
    >>> connected = medialis.connected_importance(plain)
    >>> bool(np.isclose(connected.length, plain.length).mean() > 0.9)
    True
    """
    cloud = importance.cloud
    shape, n = cloud.surface, len(cloud)
    if not cloud.whole or n > shape.point_count:
        raise InvalidShapeError(
            "Connected importance needs the whole inner cloud of the shape, "
            f"{shape.point_count} rows in their order; got {n} rows."
        )
    values = run_patiently(lambda: _connected(importance, options.link * shape.diagonal), progress)
    return replace(importance, length=values)


def _connected(importance: Importance, longest: float) -> FloatArray:
    """Return the changed lengths, (n,); links longer than `longest` come last."""
    from medialis.paths._connectivity_kernels import falling_links, join_pieces

    cloud = importance.cloud
    shape, n = cloud.surface, len(cloud)
    values = np.array(importance.length)
    links = np.concatenate([shape.edges, cloud.features[cloud.valid]])
    usable = (links[:, 0] != links[:, 1]) & (cloud.valid & ~np.isnan(values))[links].all(axis=1)
    links = links[usable]
    edges = links[: np.count_nonzero(usable[: len(shape.edges)])]
    links = np.concatenate([links, _across_noise(edges, values)])
    # A link is as strong as its weaker end, so the ranks of the points rank the links. Neighbours
    # that are too far apart join last, as if the link had no importance.
    falling = np.argsort(-values, kind="stable")
    rank = np.empty(n, np.int32)
    rank[falling] = np.arange(n)
    strength = np.append(values[falling], 0.0)
    level, order = falling_links(links, rank, cloud.centers, longest)
    tree, bridges = np.empty((n, 2), np.int64), np.empty((n, 2), np.int64)
    large = max(2.0, LARGE * np.count_nonzero(cloud.valid))
    joined, count = join_pieces(links, order, level, strength, large, values, tree, bridges)
    _raise_bridges(values, tree[:joined].astype(np.int32), bridges[:count])
    return frozen(values, np.float64)


def _across_noise(edges: NDArray[np.int32], values: NDArray[np.float64]) -> NDArray[np.int32]:
    """Link each point, and its best neighbour, to the best neighbours of its neighbours."""
    from medialis.paths._connectivity_kernels import best_neighbours

    best = best_neighbours(edges, values)
    ends = np.concatenate([edges, edges[:, ::-1]])
    links = np.concatenate([np.column_stack([ends[:, 0], best[ends[:, 1]]]), best[edges]])
    return links[links[:, 0] != links[:, 1]]


def _raise_bridges(
    values: NDArray[np.float64], tree: NDArray[np.int32], bridges: NDArray[np.int64]
) -> None:
    """Raise the path in the tree between each two peaks to the lower one of them, in place."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    n = len(values)
    graph = coo_array((np.ones(len(tree), np.int8), (tree[:, 0], tree[:, 1])), shape=(n, n)).tocsr()
    # One virtual root above one point of each part of the forest.
    heads = np.unique(connected_components(graph, directed=False)[1], return_index=True)[1]
    a = np.concatenate([tree[:, 0], np.full(len(heads), n, np.int32)])
    b = np.concatenate([tree[:, 1], heads.astype(np.int32)])
    joined = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(n + 1, n + 1)).tocsr()
    parent = breadth_first_order(joined, n, directed=False)[1]
    for first, second in bridges.tolist():
        level = min(values[first], values[second])
        climbed = [first]
        while climbed[-1] != n:
            climbed.append(int(parent[climbed[-1]]))
        place = {point: index for index, point in enumerate(climbed)}
        path = [second]
        while path[-1] not in place:
            path.append(int(parent[path[-1]]))
        path += climbed[: place[path[-1]]]
        values[path] = np.maximum(values[path], level)
