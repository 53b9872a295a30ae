"""From a point cloud near a curve skeleton to a graph with its branches and loops (thesis 3.7.6).

Strategy. The cloud is thinned to one node a cell; near nodes whose balls overlap are joined. Paths
of least cost through dense parts, from the furthest node that no path has come near to the paths so
far, make a tree (the idea of TEASAR, Sato et al. 2000): limbs get one path each, and what lies
within the balls of a path gets none, so there are few spurs to prune. A tree has no loops: where
two near nodes hang on places that are far apart along the tree, the path through them closes a
loop, and it stays unless a disc inside the shape spans it.
"""

from __future__ import annotations

import itertools

import numpy as np

from medialis.curves.from_views.cloud_nodes import (
    LINK,
    Measure,
    Nodes,
    join_pieces,
    merge_to,
    pieces_of,
    thin_points,
    without_crumbs,
)
from medialis.curves.graph.finishing import smooth_nodes
from medialis.curves.graph.pruning import prune_spurs
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.polylines import follow
from medialis.validation import FloatArray, IntArray

COVER = 1.0
"""A path accounts for what lies within this many radii of it, plus `LINK` cells."""
MOST_NODES = 40_000
SMOOTHING = 0.7
"""Bends as short as this times the radius are smoothed, as by `medialis.curve_skeleton`."""


def link_points(
    points: FloatArray,
    weights: FloatArray,
    cell: float,
    measure: Measure,
    *,
    most: int = MOST_NODES,
) -> CurveSkeleton:
    """Return the curve skeleton that a cloud of points near it shows.

    Parameters
    ----------
    points : (k, 3) float64
        Points on and near the curve skeleton, many on each place of it.
    weights : (k,) float64
        How many points each one stands for.
    cell : float
        Finest detail, in the units of the points: about the scatter of the cloud.
    measure : callable
        Radius of the ball round each of (j, 3) points; 0 for a point outside the shape.
    most : int
        The detail is coarser where the cloud has points in more cells than that.

    Returns
    -------
    CurveSkeleton
        One component for each part of the shape that the cloud covers; one node for a part without
        length. Importance is NaN.

    Notes
    -----
    Source: thesis 3.7.6, which leaves the reconstruction of lines to other methods. A loop stays
    when no disc inside the shape spans it.
    """
    cell = merge_to(points, weights, cell, most)[2]
    nodes = thin_points(points, weights, cell, measure)
    nodes = join_pieces(without_crumbs(nodes), cell, measure)
    if len(nodes.points) == 0:
        return CurveSkeleton.of(np.empty((0, 3)), np.empty((0, 2)), np.empty(0))
    edges = _tree(nodes, cell)
    edges = _close_loops(nodes, edges, cell, measure)
    return _as_skeleton(nodes, edges, measure)


def _tree(nodes: Nodes, cell: float) -> list[tuple[int, int]]:
    """Return the edges of the paths of each piece; a piece without length has none."""
    piece = pieces_of(nodes)
    edges: list[tuple[int, int]] = []
    for number in range(int(piece.max()) + 1):
        edges += _piece_paths(nodes, np.flatnonzero(piece == number).astype(np.int32), cell)
    return edges


def _piece_paths(nodes: Nodes, rows: IntArray, cell: float) -> list[tuple[int, int]]:
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    lengths, costs = nodes.graph(nodes.lengths), nodes.graph(nodes.costs)
    tree = cKDTree(nodes.points[rows])
    covered = COVER * nodes.radii + LINK * cell
    open_ = np.zeros(len(nodes.points), bool)
    open_[rows] = True

    def cover(path: list[int]) -> None:
        for near in tree.query_ball_point(nodes.points[path], covered[path]):
            open_[rows[near]] = False

    start = int(rows[nodes.density[rows].argmax()])
    cover([start])
    if not open_[rows].any():
        return []  # all within one ball: a point
    away = dijkstra(lengths, directed=False, indices=start)
    root = int(rows[np.where(np.isfinite(away[rows]), away[rows], -1).argmax()])
    away = dijkstra(lengths, directed=False, indices=root)
    open_[rows] = True
    on_tree = np.zeros(len(nodes.points), bool)
    on_tree[root] = True
    cover([root])
    edges: list[tuple[int, int]] = []
    while open_[rows].any():
        left = rows[open_[rows]]
        tip = int(left[away[left].argmax()])
        _, before, _ = dijkstra(
            costs, directed=False, indices=np.flatnonzero(on_tree), min_only=True,
            return_predecessors=True,
        )  # fmt: skip
        path = follow(before, tip)
        edges += list(itertools.pairwise(path))
        on_tree[path] = True
        cover(path)
    return edges


def _close_loops(
    nodes: Nodes, edges: list[tuple[int, int]], cell: float, measure: Measure
) -> list[tuple[int, int]]:
    """Add the paths that close a loop round a hole, the shortest path first."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    n = len(nodes.points)
    refused: set[tuple[int, int]] = set()
    closing: list[int] | None = []
    while edges and closing is not None:
        edges = edges + list(itertools.pairwise(closing))
        pairs = np.array(edges)
        size = np.linalg.norm(nodes.points[pairs[:, 0]] - nodes.points[pairs[:, 1]], axis=1)
        skeleton = csr_array((size, (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        away, before, foot = dijkstra(
            nodes.graph(nodes.lengths), directed=False, indices=np.unique(pairs), min_only=True,
            return_predecessors=True,
        )  # fmt: skip
        a, b = nodes.links.T
        use = (foot[a] != foot[b]) & np.isfinite(away[a]) & np.isfinite(away[b])
        a, b, direct = a[use], b[use], (away[a] + away[b] + nodes.lengths)[use]
        feet, start = np.unique(foot[a], return_inverse=True)
        closing = None
        if len(feet) == 0:
            break
        along, trace = dijkstra(skeleton, directed=False, indices=feet, return_predecessors=True)
        detour = along[start, foot[b]]
        widest = np.maximum(nodes.radii[foot[a]], nodes.radii[foot[b]])
        long = np.flatnonzero(detour > np.maximum(2 * direct, 2 * widest + 4 * cell))
        for row in long[np.argsort(direct[long], kind="stable")]:
            ends = int(foot[a[row]]), int(foot[b[row]])
            if ends in refused:
                continue
            there = follow(before, int(a[row]))[::-1] + follow(before, int(b[row]))
            home = follow(trace[start[row]], ends[1])
            if not _spanned(nodes.points[there + home[1:]], measure):
                closing = there
                break
            refused |= {ends, ends[::-1]}
    return edges


def _spanned(cycle: FloatArray, measure: Measure) -> bool:
    """Tell whether the cone from the middle of a cycle to it lies inside the shape."""
    middle = cycle.mean(axis=0)
    for share in np.arange(0.0, 1.0, 0.125):
        if (measure(middle + share * (cycle - middle)) <= 0).any():
            return False
    return True


def _as_skeleton(nodes: Nodes, edges: list[tuple[int, int]], measure: Measure) -> CurveSkeleton:
    """Prune and smooth the branches, measure radii; pieces without edges are their densest node."""
    piece = pieces_of(nodes)
    pairs = np.unique(np.sort(np.array(edges, np.int64).reshape(-1, 2), axis=1), axis=0)
    bare = np.setdiff1d(piece, piece[pairs.ravel()])
    lone = [np.flatnonzero(piece == p)[nodes.density[piece == p].argmax()] for p in bare]
    used = np.unique(np.r_[pairs.ravel(), lone].astype(np.int64))
    raw = CurveSkeleton.of(nodes.points[used], np.searchsorted(used, pairs), nodes.radii[used])
    raw = raw.subset(prune_spurs(raw))
    points = smooth_nodes(raw.nodes, raw.edges, raw.radii, SMOOTHING)
    radii = measure(points)
    # Smoothing must not leave the shape.
    out = radii <= 0
    points[out], radii[out] = raw.nodes[out], raw.radii[out]
    return CurveSkeleton.of(points, raw.edges, radii)
