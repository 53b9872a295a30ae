"""Borders of parts drawn into the valleys of a surface.

Labels diffuse over the surface for a while, implicitly: each part has a share f of every sample,
and the shares minimise the integral of (f - p)^2 + d^2 g |grad f|^2, with p = 1 where the sample
was given to the part and 0 elsewhere. The conductance g is small across a valley, so f drops from 1
to 0 within it; elsewhere it drops where a part is thinnest. Each sample goes to the part with the
largest share. One system of equations, with one factor, serves all parts.

Along an edge the way counts as longer by `LONGER * d` for each radian that the surface bends
inwards. As that adds up along a way, finer triangles change nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.shape import Shape
from medialis.surface.dissection import dissected
from medialis.surface.labels import merge_small
from medialis.surface.surface_graph import surface_graph
from medialis.validation import FloatArray, IntArray

LONGER = 5.0
"""Distances for a radian: as 0.2 of it let 1 / e of the heat pass between sites."""

SMOOTH = 0.2
"""Distances over which normals are averaged, so that noise is no valley."""

ROUNDS = 50
"""Of conjugate gradients, for normals: where triangles are slivers they need not be exact."""

BAND = 2.0
"""Distances from a border beyond which samples keep their part."""


def into_valleys(surface: Shape, labels: IntArray, distance: float) -> IntArray:
    """Return labels whose borders lie in valleys up to about a distance away.

    Parameters
    ----------
    surface : Shape
        n samples and faces.
    labels : (n,) int32
        -1 takes no part.
    distance : float
        In units of the points.

    Returns
    -------
    (n,) int32
    """
    from scipy.sparse import triu

    near = np.isfinite(_from_borders(surface, labels, BAND * distance))
    rows = np.flatnonzero(near & (labels >= 0))
    if len(rows) == 0:
        return labels
    links = triu(surface.cotangent_weights, 1).tocoo()
    ends = links.row, links.col
    flow = np.maximum(links.data, 0.0)
    step = surface.points[ends[1]] - surface.points[ends[0]]
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-6 * distance)
    heat = _Diffusion(surface, rows, ends)
    smooth = heat.spread((SMOOTH * distance) ** 2 * flow, surface.normals, near=True)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1), 1e-300)[:, None]
    turn = ((smooth[ends[1]] - smooth[ends[0]]) * step).sum(axis=1) / length
    longer = length + LONGER * distance * np.maximum(-turn, 0.0)
    used = np.unique(labels[labels >= 0])
    given = (labels[:, None] == used[None, :]).astype(np.float64)
    share = heat.spread(distance**2 * flow * length / longer, given)
    result = labels.copy()
    result[rows] = used[share[rows].argmax(axis=1)]
    return result


def without_strips(surface: Shape, labels: IntArray, distance: float) -> IntArray:
    """Merge parts that are nowhere farther than a distance from their border with a neighbour.

    Such as the ring where a shaft meets its head. The neighbour is as in `merge_small`.
    """
    away = _from_borders(surface, labels, np.inf)
    farthest = np.zeros(int(labels.max(initial=-1)) + 1)
    known = labels >= 0
    np.maximum.at(farthest, labels[known], away[known])
    weight = np.where(known & (farthest[labels] < distance), 0.5 / len(labels), 1.0)
    return merge_small(labels, weight, surface_graph(surface), 1.0)


def _from_borders(surface: Shape, labels: IntArray, limit: float) -> FloatArray:
    """Return how far each sample is from an edge between two parts, along edges; inf: farther."""
    from scipy.sparse.csgraph import dijkstra

    i, j = surface.edges.T
    border = (labels[i] != labels[j]) & (labels[i] >= 0) & (labels[j] >= 0)
    ends = np.unique(np.concatenate([i[border], j[border]]))
    if len(ends) == 0:
        return np.full(len(labels), np.inf)
    links = surface.edge_matrix.tocoo()
    links.data = np.linalg.norm(surface.points[links.row] - surface.points[links.col], axis=1)
    return np.asarray(dijkstra(links.tocsr(), indices=ends, limit=limit, min_only=True))


class _Diffusion:
    """Systems of equations on the samples near borders; the others keep their values."""

    def __init__(self, surface: Shape, rows: NDArray[np.int64], ends: tuple[Any, Any]) -> None:
        self.area = surface.point_areas
        place = np.full(surface.point_count, -1)
        place[rows] = np.arange(len(rows))
        inside = (place[ends[0]] >= 0) & (place[ends[1]] >= 0)
        pairs = np.stack([place[end[inside]] for end in ends], axis=1)
        self.rows = rows[dissected(surface.points[rows], pairs)]
        place[self.rows] = np.arange(len(rows))
        self.ends = place[ends[0]], place[ends[1]], ends[0], ends[1]

    def spread(self, flow: FloatArray, values: FloatArray, *, near: bool = False) -> FloatArray:
        """Return f with area (f - values) = the flow into each sample.

        Near: heat goes no farther than some samples; a few rounds of conjugate gradients do.
        """
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        one, two, first, second = self.ends
        k, inside = len(self.rows), (one >= 0) & (two >= 0)
        area = np.maximum(self.area[self.rows], 1e-12 * self.area.max())
        total = area + np.bincount(one[one >= 0], flow[one >= 0], k)
        total += np.bincount(two[two >= 0], flow[two >= 0], k)
        diagonal = np.arange(k)
        matrix = csc_array(
            (
                np.concatenate([total, -flow[inside], -flow[inside]]),
                (
                    np.concatenate([diagonal, one[inside], two[inside]]),
                    np.concatenate([diagonal, two[inside], one[inside]]),
                ),
            ),
            shape=(k, k),
        )
        held = area[:, None] * values[self.rows]
        for here, there in ((one, second), (two, first)):
            edge = (here >= 0) & ~inside
            np.add.at(held, here[edge], flow[edge, None] * values[there[edge]])
        if near:
            found = _conjugate_gradients(matrix, total[:, None], held, values[self.rows])
        else:
            found = splu(
                matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            ).solve(held)
        result = values.copy()
        result[self.rows] = found
        return result


def _conjugate_gradients(
    matrix: Any, scale: FloatArray, held: FloatArray, start: FloatArray
) -> FloatArray:
    """Solve systems of equations with one matrix for all columns at once, to 1 / 1000."""
    found = start.copy()
    left = held - matrix @ found
    way = left / scale
    size = enough = (left * way).sum()
    for _ in range(ROUNDS):
        if not size > 1e-6 * enough:
            break
        across = matrix @ way
        step = size / (way * across).sum()
        found += step * way
        left -= step * across
        across = left / scale
        before, size = size, (left * across).sum()
        way = across + size / before * way
    return found
