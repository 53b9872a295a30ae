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


class PlaceGraph:
    """The graph on which places are connected: edges, or near samples, and balls across a wall.

    Parameters
    ----------
    shape : Shape
        n samples.
    walls : (w, 2) int
        Samples on both sides of walls.
    """

    def __init__(self, shape: Shape, walls: IntArray) -> None:
        from scipy.sparse import coo_array

        n = shape.point_count
        edges = shape.edges if shape.faces is not None else _cloud_links(shape)
        a, b = np.concatenate([edges, walls]).T
        ends = np.concatenate([a, b]), np.concatenate([b, a])
        graph = coo_array((np.ones(len(ends[0]), np.int32), ends), shape=(n, n)).tocsr()
        self._times, self._neighbours = graph.data, graph.indices
        self._first, self._last = graph.indptr[:-1], graph.indptr[1:].copy()

    def __len__(self) -> int:
        return len(self._first)

    @property
    def links(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
        """First and last place of the neighbours of each sample, and the neighbours."""
        return self._first, self._last, self._neighbours

    def take_out(self, walls: IntArray) -> None:
        """Take some walls out again."""
        from medialis.fields._place_kernels import take_out

        take_out(walls, self._times, *self.links)


def low_places(
    graph: PlaceGraph, field: FloatArray, *, level: float = 0.0, prominence: float = 0.25
) -> Iterator[LowPlace]:
    """Go through the low places of a field (n,), 0 or more, the lowest first.

    `level` is the threshold, 0 for none. Ties: the lowest sample first. Where the field is inf,
    nothing is.
    """
    if level > 0:
        rows = np.flatnonzero(field < level)
        starts = rows[np.argsort(field[rows], kind="stable")]
        return _regions(field, (starts, field[starts], np.full(len(starts), level)), graph)
    ratio = 1.0 + prominence
    calm = _without_specks(field, graph)
    rows = np.flatnonzero(_prominent(calm, field, graph, ratio))
    # A sample so much lower than those round it that it could be a place of its own is a speck.
    depth = np.where(calm[rows] < ratio * field[rows], field[rows], calm[rows])
    turn = np.lexsort((rows, field[rows], calm[rows], depth))
    return _regions(calm, (rows[turn], depth[turn], ratio * calm[rows[turn]]), graph)


def _cloud_links(shape: Shape) -> IntArray:
    n, k = shape.point_count, min(CLOUD_NEIGHBOURS + 1, shape.point_count)
    near = shape.tree.query(shape.points, k=k)[1].reshape(n, k)
    links = np.stack([np.repeat(np.arange(n), k), near.ravel()], axis=1)
    return frozen(links[links[:, 0] != links[:, 1]], np.int32)


def _without_specks(field: FloatArray, graph: PlaceGraph) -> FloatArray:
    """Return the third lowest value round each sample."""
    from medialis.fields._place_kernels import third_lowest

    calm = np.empty_like(field)
    third_lowest(field, *graph.links, calm)
    return calm


def _prominent(
    calm: FloatArray, field: FloatArray, graph: PlaceGraph, ratio: float
) -> NDArray[np.bool_]:
    from medialis.fields._place_kernels import find_basins, list_passes, prominent_minima

    basin, found = np.empty(len(field), np.int32), np.zeros(len(field), np.bool_)
    find_basins(calm, field, *graph.links, basin)
    passes = np.empty((len(graph.links[2]), 2), np.int32)
    passes = passes[: list_passes(basin, calm, field, *graph.links, passes)]
    passes = passes[np.argsort(calm[passes[:, 0]], kind="stable")]
    prominent_minima(passes, basin, calm, field, ratio, found)
    return found


def _regions(
    field: FloatArray,
    starts: tuple[NDArray[np.int64], FloatArray, FloatArray],
    graph: PlaceGraph,
) -> Iterator[LowPlace]:
    """Collect what lies below its level round each start: samples, values, levels."""
    from medialis.fields._place_kernels import flood_below

    label, queue = np.full(len(field), -1, np.int32), np.empty(len(field), np.int32)
    number = 0
    for start, depth, level in zip(*(column.tolist() for column in starts), strict=True):
        if label[start] >= 0 or depth == np.inf:
            continue
        size = flood_below(start, level, field, *graph.links, number, label, queue)
        number += 1
        yield LowPlace(start, depth, frozen(np.sort(queue[:size]), np.int32))
