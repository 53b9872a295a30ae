"""Nodes of a cloud of points near a curve skeleton, and the links between them (thesis 3.7.6).

The cloud is thinned to one node a cell; near nodes whose balls overlap are linked. Strays are left
out, and pieces joined where the segment between them lies inside the shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from medialis.model.topology import piece_labels
from medialis.validation import FloatArray, IntArray

Measure = Callable[[FloatArray], FloatArray]
"""Radius of the ball round each of (k, 3) points, 0 for a point outside the shape."""

LINK = 3.0
"""Nodes up to this many cells apart are joined."""
SPARSE = 16.0
"""Nodes with fewer points than this within two cells are strays. No share of what is usual: a part
that few views show has few points, and more views settle strays as well as they add points."""
CRUMB = 4
"""Pieces of fewer nodes are strays at once: each of the others is tried to be joined."""
COARSER = 1.25
"""Each time that a cloud has too many cells."""
FEWEST = 0.01
"""A piece of the cloud with a smaller share of the points is a stray, if it cannot be joined."""


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
        return self.lengths * np.clip(usual / thin, 0.2, 20.0)

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
        return Nodes(
            self.points[keep],
            self.density[keep],
            self.radii[keep],
            number[self.links[stay]].astype(np.int32),
            self.lengths[stay],
        )


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
    from scipy.spatial import cKDTree

    means, count = merge_cells(points, weights, cell)
    if len(means) == 0:
        return Nodes(means, count, count, np.empty((0, 2), np.int32), count)
    tree = cKDTree(means)
    near = tree.sparse_distance_matrix(tree, 2 * cell, output_type="coo_matrix")
    density = np.zeros(len(means))
    np.add.at(density, near.row, count[near.col])  # itself included
    radii = measure(means)
    keep = (density >= SPARSE) & (radii > 0)
    means, density, radii = means[keep], density[keep], radii[keep]
    if len(means) == 0:
        return Nodes(means, density, radii, np.empty((0, 2), np.int32), np.empty(0))
    links = cKDTree(means).query_pairs(LINK * cell, output_type="ndarray")
    links = links[np.lexsort(links.T[::-1])].astype(np.int32)
    lengths = np.linalg.norm(means[links[:, 0]] - means[links[:, 1]], axis=1)
    # Balls that overlap hold the segment between their centers.
    inside = lengths <= np.maximum(radii[links].sum(axis=1), 1.8 * cell)
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
    from scipy.spatial import cKDTree

    while len(nodes.points):
        piece = pieces_of(nodes)
        count = int(piece.max()) + 1
        if count == 1:
            return nodes
        # From every piece the nearest node of another piece; of equal distances the lowest one.
        nearest = []
        for number in range(count):
            own, other = np.flatnonzero(piece == number), np.flatnonzero(piece != number)
            away, near = cKDTree(nodes.points[other]).query(nodes.points[own])
            few = np.argsort(away, kind="stable")[:16]
            nearest.append(np.stack([own[few], other[near[few]]], axis=1))
        pairs = np.concatenate(nearest)
        a, b = nodes.points[pairs[:, 0]], nodes.points[pairs[:, 1]]
        pairs = pairs[_segments_inside(a, b, cell / 2, measure)]
        if len(pairs) == 0:
            break
        lengths = np.linalg.norm(nodes.points[pairs[:, 0]] - nodes.points[pairs[:, 1]], axis=1)
        joined = np.arange(count)
        links, sizes = [nodes.links], [nodes.lengths]
        for row in np.argsort(lengths, kind="stable"):
            p, q = joined[piece[pairs[row]]]
            if p != q:
                joined[joined == max(p, q)] = min(p, q)
                links.append(pairs[row : row + 1].astype(np.int32))
                sizes.append(lengths[row : row + 1])
        nodes = Nodes(
            nodes.points, nodes.density, nodes.radii, np.concatenate(links), np.concatenate(sizes)
        )
    if len(nodes.points) == 0:
        return nodes
    piece = pieces_of(nodes)
    share = np.bincount(piece, nodes.density) / nodes.density.sum()
    return nodes.subset((share >= FEWEST)[piece] | (share == share.max())[piece])
