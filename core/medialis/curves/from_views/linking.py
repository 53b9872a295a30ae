"""From a cloud of points near a curve skeleton to a graph with branches and loops (thesis 3.7.6).

Strategy. The cloud is thinned to one node a cell; near nodes whose balls overlap are linked. Strays
are left out, and pieces joined where the segment between them lies inside the shape. Paths of least
cost through dense parts, from the furthest node that no path has come near to the paths so far,
make a tree (the idea of TEASAR, Sato et al. 2000): limbs get one path each, and what lies within
the balls of a path gets none, so there are few spurs to prune. A tree has no loops: where two near
nodes hang on places that are far apart along the tree, the path through them closes a loop, and it
stays unless a disc inside the shape spans it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.arrays import follow, kd_tree
from medialis.base.validation import FloatArray, IntArray
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.finishing import prune_spurs, smooth_nodes
from medialis.shape.surface import piece_labels

LINK = 3.0  # halved 100 %, doubled 92 %
"""Nodes up to this many cells apart are joined."""

SPARSE = 16.0  # halved 96 %, doubled 97 %
"""Nodes with fewer points than this within two cells are strays. No share of what is usual: a part
that few views show has few points, and more views settle strays as well as they add points."""

CRUMB = 4  # halved 48 %, doubled 23 %
"""Pieces of fewer nodes are strays at once: each of the others is tried to be joined."""

COARSER = 1.25  # halved 0 %, doubled 0 %
"""Each time that a cloud has too many cells."""

SMALLEST_PIECE = 0.01  # halved 0 %, doubled 0 %
"""A piece of the cloud with a smaller share of the points is a stray, if it cannot be joined."""

COVERED = 1.0  # halved 51 %, doubled 58 %
"""A path accounts for what lies within this many radii of it, plus `LINK` cells."""

SMOOTHING = 0.7  # halved 3 %, doubled 87 %
"""Bends as short as this times the radius are smoothed, as by `medialis.curve_skeleton`."""

NEAREST = 16  # halved 0 %, doubled 0 %
"""Nodes of a piece that are tried to be joined with others."""

LEAST_CELLS = 1.8  # halved 57 %, doubled 26 %
"""Links up to this many cells long lie in the shape whatever radii say: pixels are as coarse."""

DENSE_COST = 0.2  # halved 3 %, doubled 12 %
"""A link costs at least this many times its length where points are dense."""

SPARSE_COST = 20.0  # halved 0 %, doubled 0 %
"""A link costs at most this many times its length where points are few."""

CONE_STEPS = 8  # halved 0 %, doubled 0 %
"""Places from the middle of a cycle to it at which a disc that spans it is looked at."""

FROM_ALL: dict[str, Any] = {"directed": False, "min_only": True, "return_predecessors": True}
"""Of each node the path to the nearest of some."""

Measure = Callable[[FloatArray], FloatArray]
"""Radius of the ball round each of (k, 3) points, 0 for a point outside the shape."""


@dataclass(frozen=True, eq=False)
class Nodes:
    """One node a cell: place, number of points near it, radius; and the links between them."""

    points: FloatArray
    density: FloatArray
    radii: FloatArray
    links: IntArray
    lengths: FloatArray

    @property
    def costs(self) -> FloatArray:
        """Cost of each link: its length, more where few points are."""
        usual = np.median(self.density)
        thin = np.sqrt(self.density[self.links[:, 0]] * self.density[self.links[:, 1]])
        return self.lengths * np.clip(usual / thin, DENSE_COST, SPARSE_COST)

    def graph(self, values: FloatArray):  # type: ignore[no-untyped-def]
        """Sparse matrix of the links with a value each."""
        from scipy.sparse import csr_array

        n = len(self.points)
        a, b = self.links.T
        return csr_array((np.r_[values, values], (np.r_[a, b], np.r_[b, a])), shape=(n, n))

    def subset(self, keep: np.ndarray) -> Nodes:
        """Return the chosen nodes and the links between them."""
        number = np.cumsum(keep) - 1
        stay = keep[self.links].all(axis=1)
        kept = self.points[keep], self.density[keep], self.radii[keep]
        return Nodes(*kept, number[self.links[stay]].astype(np.int32), self.lengths[stay])


def merge_cells(
    points: FloatArray, weights: FloatArray, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean point and weight of each cell of a grid that holds points, in its order."""
    if len(points) == 0:
        return np.empty((0, 3)), np.empty(0)
    keys = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    size = keys.max(axis=0) + 1
    flat = (keys[:, 0] * size[1] + keys[:, 1]) * size[2] + keys[:, 2]
    _, cell_of = np.unique(flat, return_inverse=True)
    total: FloatArray = np.bincount(cell_of, weights).astype(np.float64)
    means = [np.bincount(cell_of, weights * points[:, j]) / total for j in range(3)]
    return np.stack(means, axis=1), total


def merge_to(
    points: FloatArray, weights: FloatArray, cell: float, most: int
) -> tuple[FloatArray, FloatArray, float]:
    """Merge points by the cells of a grid, of larger cells where more than `most` would be left.

    Returns
    -------
    tuple
        Mean points and weights, and the cell.
    """
    points, weights = merge_cells(points, weights, cell)
    while len(points) > most:
        cell *= COARSER
        points, weights = merge_cells(points, weights, cell)
    return points, weights, cell


def thin_points(points: FloatArray, weights: FloatArray, cell: float, measure: Measure) -> Nodes:
    """Return the mean point of each cell of a grid, without strays and points outside."""
    means, count = merge_cells(points, weights, cell)
    if len(means) == 0:
        return Nodes(means, count, count, np.empty((0, 2), np.int32), count)
    tree = kd_tree(means)
    near = tree.sparse_distance_matrix(tree, 2 * cell, output_type="coo_matrix")
    density = np.zeros(len(means))
    np.add.at(density, near.row, count[near.col])  # itself included
    radii = measure(means)
    keep = (density >= SPARSE) & (radii > 0)
    means, density, radii = means[keep], density[keep], radii[keep]
    links = kd_tree(means).query_pairs(LINK * cell, output_type="ndarray")
    links = links[np.lexsort(links.T[::-1])].astype(np.int32)
    lengths = np.linalg.norm(means[links[:, 0]] - means[links[:, 1]], axis=1)
    # Balls that overlap hold the segment between their centers.
    inside = lengths <= np.maximum(radii[links].sum(axis=1), LEAST_CELLS * cell)
    return Nodes(means, density, radii, links[inside], lengths[inside])


def pieces_of(nodes: Nodes) -> IntArray:
    """Return the number of the piece of each node: what links hold together."""
    return piece_labels(len(nodes.points), nodes.links)


def without_crumbs(nodes: Nodes) -> Nodes:
    """Drop pieces of very few nodes, but not the largest one."""
    if len(nodes.points) == 0:
        return nodes
    piece = pieces_of(nodes)
    weight = np.bincount(piece, nodes.density)
    keep = (np.bincount(piece) >= CRUMB) | (np.arange(len(weight)) == weight.argmax())
    return nodes.subset(keep[piece])


def _segments_inside(a: FloatArray, b: FloatArray, step: float, measure: Measure) -> np.ndarray:
    """Tell which segments lie inside the shape, by points along them."""
    count = max(3, int(np.ceil(np.linalg.norm(a - b, axis=1).max(initial=0.0) / step)))
    at = (np.arange(count) + 0.5)[:, None, None] / count
    samples = (a + at * (b - a)).reshape(-1, 3)
    return np.asarray((measure(samples) > 0).reshape(count, -1).all(axis=0))


def join_pieces(nodes: Nodes, cell: float, measure: Measure) -> Nodes:
    """Join pieces by the shortest links inside the shape; drop small ones that cannot be joined."""
    while len(nodes.points):
        piece = pieces_of(nodes)
        count = int(piece.max()) + 1
        if count == 1:
            return nodes
        # From every piece the nearest node of another piece; of equal distances the lowest one.
        nearest = []
        for number in range(count):
            own, other = np.flatnonzero(piece == number), np.flatnonzero(piece != number)
            away, near = kd_tree(nodes.points[other]).query(nodes.points[own])
            few = np.argsort(away, kind="stable")[:NEAREST]
            nearest.append(np.stack([own[few], other[near[few]]], axis=1))
        pairs = np.concatenate(nearest)
        a, b = nodes.points[pairs.T]
        pairs = pairs[_segments_inside(a, b, cell / 2, measure)]
        if len(pairs) == 0:
            break
        lengths = np.linalg.norm(nodes.points[pairs[:, 0]] - nodes.points[pairs[:, 1]], axis=1)
        joined, rows = np.arange(count), []
        for row in np.argsort(lengths, kind="stable"):
            p, q = joined[piece[pairs[row]]]
            if p != q:
                joined[joined == max(p, q)] = min(p, q)
                rows.append(row)
        links = np.concatenate([nodes.links, pairs[rows].astype(np.int32)])
        nodes = replace(nodes, links=links, lengths=np.append(nodes.lengths, lengths[rows]))
    else:
        return nodes
    share = np.bincount(piece, nodes.density) / nodes.density.sum()
    return nodes.subset((share >= SMALLEST_PIECE)[piece] | (share == share.max())[piece])


def link_points(
    points: FloatArray, weights: FloatArray, cell: float, measure: Measure, *, most: int
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
    piece, edges = pieces_of(nodes), []
    for number in range(int(piece.max()) + 1):
        edges += _piece_paths(nodes, np.flatnonzero(piece == number).astype(np.int32), cell)
    edges = _close_loops(nodes, edges, cell, measure)
    return _as_skeleton(nodes, edges, measure)


def _piece_paths(nodes: Nodes, rows: IntArray, cell: float) -> list[tuple[int, int]]:
    """Return the edges of the paths of a piece; one without length has none."""
    from scipy.sparse.csgraph import dijkstra

    lengths, costs = nodes.graph(nodes.lengths), nodes.graph(nodes.costs)
    tree = kd_tree(nodes.points[rows])
    covered = COVERED * nodes.radii + LINK * cell
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
        _, before, _ = dijkstra(costs, indices=np.flatnonzero(on_tree), **FROM_ALL)
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

    refused: set[tuple[int, int]] = set()
    closing: list[int] | None = []
    while edges and closing is not None:
        edges = edges + list(itertools.pairwise(closing))
        pairs = np.array(edges)
        size = np.linalg.norm(nodes.points[pairs[:, 0]] - nodes.points[pairs[:, 1]], axis=1)
        used, ends_in = np.unique(pairs, return_inverse=True)
        skeleton = csr_array((size, tuple(ends_in.reshape(-1, 2).T)), shape=(len(used), len(used)))
        graph = nodes.graph(nodes.lengths)
        away, before, foot = dijkstra(graph, indices=used, **FROM_ALL)
        a, b = nodes.links.T
        use = (foot[a] != foot[b]) & np.isfinite(away[a]) & np.isfinite(away[b])
        a, b, direct = a[use], b[use], (away[a] + away[b] + nodes.lengths)[use]
        feet, start = np.unique(foot[a], return_inverse=True)
        closing = None
        if len(feet) == 0:
            break
        feet, other = np.searchsorted(used, feet), np.searchsorted(used, foot[b])
        along, trace = dijkstra(skeleton, directed=False, indices=feet, return_predecessors=True)
        detour = along[start, other]
        widest = np.maximum(nodes.radii[foot[a]], nodes.radii[foot[b]])
        long = np.flatnonzero(detour > np.maximum(2 * direct, 2 * widest + 4 * cell))
        for row in long[np.argsort(direct[long], kind="stable")]:
            ends = int(foot[a[row]]), int(foot[b[row]])
            if ends in refused:
                continue
            there = follow(before, int(a[row]))[::-1] + follow(before, int(b[row]))
            home = used[follow(trace[start[row]], int(other[row]))].tolist()
            if not _spanned(nodes.points[there + home[1:]], measure):
                closing = there
                break
            refused |= {ends, ends[::-1]}
    return edges


def _spanned(cycle: FloatArray, measure: Measure) -> bool:
    """Tell whether the cone from the middle of a cycle to it lies inside the shape."""
    middle = cycle.mean(axis=0)
    shares = np.arange(CONE_STEPS) / CONE_STEPS
    return all((measure(middle + one * (cycle - middle)) > 0).all() for one in shares)


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
