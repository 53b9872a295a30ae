"""Low places of a field on a surface: connected regions and prominent minima (for thesis 3.5.1).

With a threshold, a place is a connected region below it: what fails a wall check. Without one, a
place is a prominent minimum: from it one must climb to 1.25 times its value before reaching
anywhere thinner. Its region is all that is connected to it below 1.25 times its value. Such
regions never overlap: if those of two minima m1 < m2 met, both would be connected below 1.25 m2,
and m2 would reach the lower m1 without climbing that high. One or two samples that are far too low
(a fold, a bad normal) make no place there: minima are those of the third lowest value round each
sample.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.surface.surface_graph import CLOUD_NEIGHBOURS
from medialis.validation import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class LowPlace:
    """A region where a field is low.

    Attributes
    ----------
    vertex : int
        The lowest sample.
    value : float
        The field there; without a threshold, the third lowest value round it where that is a
        prominence higher.
    vertices : (v,) int32
        All samples of the region, ascending.
    """

    vertex: int
    value: float
    vertices: IntArray


def low_places(
    shape: Shape,
    field: FloatArray,
    walls: IntArray,
    *,
    level: float = 0.0,
    prominence: float = 0.25,
) -> Iterator[LowPlace]:
    """Go through the low places of a field (n,), 0 or more, the lowest first.

    `walls` (w, 2) joins the two sides of walls. `level` is the threshold, 0 for none. Ties: the
    lowest sample first. Where the field is inf, nothing is.
    """
    graph = _neighbours(shape, walls)
    order = np.argsort(field, kind="stable").astype(np.int32)
    if level > 0:
        starts = order[field[order] < level]
        levels = np.full(len(starts), level)
        return _regions(field, (starts, field[starts], levels), graph)
    ratio = 1.0 + prominence
    calm, order = _without_specks(field, order, graph)
    starts = order[_prominent(calm, order, graph, ratio)[order]]
    # A sample so much lower than those round it that it could be a place of its own is a speck.
    depth = np.where(calm[starts] < ratio * field[starts], field[starts], calm[starts])
    turn = np.argsort(depth, kind="stable")
    starts, depth = starts[turn], depth[turn]
    return _regions(calm, (starts, depth, ratio * calm[starts]), graph)


def _neighbours(shape: Shape, walls: IntArray) -> Ragged:
    """Return the graph on which places are connected: edges, and balls across a wall."""
    from scipy.sparse import coo_array

    n = shape.point_count
    edges = shape.edges if shape.faces is not None else _cloud_links(shape)
    a, b = np.concatenate([edges, walls]).T
    ends = np.concatenate([a, b]), np.concatenate([b, a])
    graph = coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(n, n)).tocsr()
    return Ragged(graph.indptr, graph.indices)


def _cloud_links(shape: Shape) -> IntArray:
    n, k = shape.point_count, min(CLOUD_NEIGHBOURS + 1, shape.point_count)
    near = shape.tree.query(shape.points, k=k)[1].reshape(n, k)
    links = np.stack([np.repeat(np.arange(n), k), near.ravel()], axis=1)
    return frozen(links[links[:, 0] != links[:, 1]], np.int32)


def _without_specks(
    field: FloatArray, order: IntArray, graph: Ragged
) -> tuple[FloatArray, IntArray]:
    """Return the third lowest value round each sample, and its order (ties: the lower sample)."""
    from medialis.surface._surface_graph_kernels import third_lowest

    calm = np.empty_like(field)
    third_lowest(field, graph.offsets, graph.indices, calm)
    return calm, order[np.argsort(calm[order], kind="stable")]


def _prominent(
    field: FloatArray, order: IntArray, graph: Ragged, ratio: float
) -> NDArray[np.bool_]:
    from medialis.surface._surface_graph_kernels import prominent_minima

    found = np.zeros(len(field), np.bool_)
    parent = np.full(len(field), -1, np.int32)
    prominent_minima(order, field, graph.offsets, graph.indices, ratio, parent, found)
    return found


def _regions(
    field: FloatArray, starts: tuple[IntArray, FloatArray, FloatArray], graph: Ragged
) -> Iterator[LowPlace]:
    """Collect what lies below its level round each start: samples, values, levels."""
    from medialis.surface._surface_graph_kernels import flood_below

    label, queue = np.full(len(field), -1, np.int32), np.empty(len(field), np.int32)
    number = 0
    for start, depth, level in zip(*(column.tolist() for column in starts), strict=True):
        if label[start] >= 0 or depth == np.inf:
            continue
        size = flood_below(start, level, field, graph.offsets, graph.indices, number, label, queue)
        number += 1
        yield LowPlace(start, depth, frozen(np.sort(queue[:size]), np.int32))
