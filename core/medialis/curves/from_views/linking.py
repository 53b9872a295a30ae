"""From a point cloud near a curve skeleton to a graph with its branches and loops (thesis 3.7.6).

Strategy. The cloud is thinned to one node a cell; near nodes whose balls overlap are joined. Paths
of least cost through dense parts, from the furthest node that no path has come near to the paths so
far, make a tree (the idea of TEASAR, Sato et al. 2000): limbs get one path each, and what lies
within the balls of a path gets none, so there are few spurs to prune. A tree has no loops: where
two near nodes hang on places that are far apart along the tree, the way through them closes a loop,
and it stays unless a disc inside the shape spans it.
"""

from __future__ import annotations

import itertools

import numpy as np

from medialis.curves.from_views.cloud_nodes import (
    LINK,
    Measure,
    Nodes,
    join_pieces,
    pieces_of,
    thin_points,
    without_crumbs,
)
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.validation import FloatArray, IntArray

COVER = 1.0
"""A path accounts for what lies within this many radii of it, plus `LINK` cells."""
SPUR = 0.5
"""A branch end goes when it reaches less than this many radii out of the ball of its junction."""
SMOOTHING = 4
"""Rounds of averaging along the branches."""


def link_points(
    points: FloatArray, weights: FloatArray, cell: float, measure: Measure
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
    nodes = thin_points(points, weights, cell, measure)
    nodes = join_pieces(without_crumbs(nodes), cell, measure)
    if len(nodes.points) == 0:
        return CurveSkeleton.of(np.empty((0, 3)), np.empty((0, 2)), np.empty(0))
    edges = _tree(nodes, cell)
    edges = _close_loops(nodes, edges, cell, measure)
    edges = _prune(nodes, edges)
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
    reach = COVER * nodes.radii + LINK * cell
    open_ = np.zeros(len(nodes.points), bool)
    open_[rows] = True

    def cover(path: list[int]) -> None:
        for near in tree.query_ball_point(nodes.points[path], reach[path]):
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
        path = [tip]
        while not on_tree[path[-1]]:
            path.append(int(before[path[-1]]))
        edges += list(itertools.pairwise(path))
        on_tree[path] = True
        cover(path)
    return edges


def _close_loops(
    nodes: Nodes, edges: list[tuple[int, int]], cell: float, measure: Measure
) -> list[tuple[int, int]]:
    """Add the ways that close a loop round a hole, the shortest way first."""
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
        a, b, way = a[use], b[use], (away[a] + away[b] + nodes.lengths)[use]
        feet, at = np.unique(foot[a], return_inverse=True)
        closing = None
        if len(feet) == 0:
            break
        along, trace = dijkstra(skeleton, directed=False, indices=feet, return_predecessors=True)
        detour = along[at, foot[b]]
        widest = np.maximum(nodes.radii[foot[a]], nodes.radii[foot[b]])
        long = np.flatnonzero(detour > np.maximum(2 * way, 2 * widest + 4 * cell))
        for row in long[np.argsort(way[long], kind="stable")]:
            ends = int(foot[a[row]]), int(foot[b[row]])
            if ends in refused:
                continue
            there = _way_back(before, int(a[row]))[::-1] + _way_back(before, int(b[row]))
            home = _way_back(trace[at[row]], ends[1])
            if not _spanned(nodes.points[there + home[1:]], measure):
                closing = there
                break
            refused |= {ends, ends[::-1]}
    return edges


def _way_back(before: IntArray, node: int) -> list[int]:
    path = [node]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return path


def _spanned(cycle: FloatArray, measure: Measure) -> bool:
    """Tell whether the cone from the middle of a cycle to it lies inside the shape."""
    middle = cycle.mean(axis=0)
    for share in np.arange(0.0, 1.0, 0.125):
        if (measure(middle + share * (cycle - middle)) <= 0).any():
            return False
    return True


def _prune(nodes: Nodes, edges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Drop branch ends that hardly leave the ball of their junction, the shortest first."""
    near: dict[int, set[int]] = {}
    for a, b in edges:
        near.setdefault(a, set()).add(b)
        near.setdefault(b, set()).add(a)
    while True:
        spurs = []
        for tip in sorted(node for node, others in near.items() if len(others) == 1):
            path = [tip, *near[tip]]
            while len(near[path[-1]]) == 2:
                path += near[path[-1]] - {path[-2]}
            foot = path[-1]
            if len(near[foot]) < 3:
                continue  # the only branch of its piece
            length = float(np.linalg.norm(np.diff(nodes.points[path], axis=0), axis=1).sum())
            if length + nodes.radii[tip] < (1 + SPUR) * nodes.radii[foot]:
                spurs.append((length, path))
        if not spurs:
            return sorted({(min(a, b), max(a, b)) for a, others in near.items() for b in others})
        for a, b in itertools.pairwise(min(spurs)[1]):
            near[a].discard(b)
            near[b].discard(a)
            if not near[a]:
                del near[a]


def _as_skeleton(nodes: Nodes, edges: list[tuple[int, int]], measure: Measure) -> CurveSkeleton:
    """Smooth the branches and measure their radii; pieces without edges are their densest node."""
    piece = pieces_of(nodes)
    pairs = np.unique(np.sort(np.array(edges, np.int64).reshape(-1, 2), axis=1), axis=0)
    bare = np.setdiff1d(piece, piece[pairs.ravel()])
    lone = [np.flatnonzero(piece == p)[nodes.density[piece == p].argmax()] for p in bare]
    used = np.unique(np.r_[pairs.ravel(), lone].astype(np.int64))
    links = np.searchsorted(used, pairs).astype(np.int32)
    degree = np.bincount(links.ravel(), minlength=len(used))
    points = nodes.points[used]
    for _ in range(SMOOTHING):
        total = np.zeros_like(points)
        np.add.at(total, links[:, 0], points[links[:, 1]])
        np.add.at(total, links[:, 1], points[links[:, 0]])
        inner = degree == 2
        points[inner] = 0.5 * points[inner] + 0.25 * total[inner]
    radii = measure(points)
    # Smoothing must not leave the shape.
    out = radii <= 0
    points[out] = nodes.points[used][out]
    radii[out] = nodes.radii[used][out]
    return CurveSkeleton.of(points, links, radii)
