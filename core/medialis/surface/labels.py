"""Labels on the samples of a surface: spreading, merging, numbering (thesis 6.2.2, 6.3)."""

from __future__ import annotations

import heapq
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.ragged import Ragged
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.model.topology import piece_labels
from medialis.surface.surface_graph import nearest_seeds, surface_graph
from medialis.validation import FloatArray, IntArray

ISLAND = 0.1
"""A piece is an island where it is lighter than this part of the heaviest one of its label. The two
walls of a sheet are about equally large."""

FULL, MOST_FULL = 0.06, 20_000_000
"""Part of the shares that are not zero from which on all are stored, as a step then costs less, and
how many that may be."""


def spread_labels(points: FloatArray, graph: Ragged, labels: IntArray) -> IntArray:
    """Give points with label -1 the label of the nearest labelled one along the graph.

    Returns
    -------
    (n,) int32
        -1 where no labelled point can be reached.
    """
    seed = nearest_seeds(points, graph, labels >= 0)[0]
    seed[labels >= 0] = np.flatnonzero(labels >= 0)  # in one place with another one, perhaps
    return np.where(seed < 0, -1, labels[seed]).astype(np.int32)


def fill_components(components: IntArray, labels: IntArray, usable: NDArray[np.bool_]) -> IntArray:
    """Give each component (n,) in which nothing is labelled a label of its own."""
    count = int(components.max(initial=-1)) + 1
    empty = np.bincount(components[labels >= 0], minlength=count) == 0
    new = np.cumsum(empty) - 1 + labels.max(initial=-1) + 1
    rows = empty[components] & usable
    return np.where(rows, new[components], labels).astype(np.int32)


def merge_small(labels: IntArray, weight: FloatArray, graph: Ragged, smallest: float) -> IntArray:
    """Merge segments lighter than `smallest`, lightest first, into a neighbouring segment.

    The neighbour is the one with which a segment shares the most links of the graph (ties: the
    lowest label). A segment without a neighbour stays.

    Parameters
    ----------
    labels : (n,) int32
        -1 takes no part.
    weight : (n,) float
        Of each sample, such as its area.
    graph : Ragged
        n rows.
    smallest : float
        In the units of the weights.

    Returns
    -------
    (n,) int32
        The labels left keep their numbers.
    """
    count = int(labels.max(initial=-1)) + 1
    total = np.bincount(labels[labels >= 0], weight[labels >= 0], minlength=count)
    borders = _borders(labels, graph, count)
    target = np.arange(count)
    waiting = [(float(total[a]), a) for a in range(count) if total[a] < smallest]
    heapq.heapify(waiting)
    while waiting:
        size, a = heapq.heappop(waiting)
        if target[a] != a or size != total[a] or not borders[a]:
            continue  # merged, or grown since
        b = min(borders[a], key=lambda other: (-borders[a][other], other))
        target[a] = b
        total[b] += total[a]
        for other, links in borders[a].items():
            del borders[other][a]
            if other != b:
                borders[b][other] = borders[b].get(other, 0) + links
                borders[other][b] = borders[b][other]
        if total[b] < smallest:
            heapq.heappush(waiting, (float(total[b]), b))
    for _ in range(count.bit_length() + 1):  # pointer jumping: halves every chain
        target = target[target]
    return np.where(labels < 0, -1, target[labels]).astype(np.int32)


def _borders(labels: IntArray, graph: Ragged, count: int) -> list[dict[int, int]]:
    """Count the links between each pair of segments, from either end."""
    a = np.repeat(labels, graph.lengths)
    b = labels[graph.indices]
    crossing = (a >= 0) & (b >= 0) & (a != b)
    keys, links = np.unique(
        a[crossing].astype(np.int64) * max(count, 1) + b[crossing], return_counts=True
    )
    borders: list[dict[int, int]] = [{} for _ in range(count)]
    for key, number in zip(keys.tolist(), links.tolist(), strict=True):
        borders[key // count][key % count] = number
    return borders


def completed(
    shape: Shape,
    labels: IntArray,
    smallest: float,
    *,
    fill: bool = False,
    method: str = "",
    steps: int = 0,
) -> Segmentation:
    """Spread labels over the samples without one, merge small segments, number them by area.

    Their borders are straightened, and islands joined with what is round them.

    Parameters
    ----------
    shape : Shape
        n samples.
    labels : (n,) int32
        -1: none yet.
    smallest : float
        Share of the surface below which a segment is merged; 0 merges none.
    fill : bool
        A component of the surface without any label is a segment of its own.
    method : str
        As in `Segmentation`.
    steps : int
        Of diffusion, as in `diffused_labels`.
    """
    graph, area = surface_graph(shape), shape.point_areas
    labels = spread_labels(shape.points, graph, labels)
    if fill:
        labels = fill_components(shape.components, labels, np.ones(len(labels), np.bool_))
    if smallest > 0.0:
        labels = merge_small(labels, area, graph, smallest * float(area.sum()))
    labels = diffused_labels(labels, graph, steps)
    labels = without_islands(shape.points, labels, area, graph)
    return Segmentation(numbered_by_weight(labels, area), surface=shape, method=method)


def numbered_by_weight(labels: IntArray, weight: FloatArray) -> IntArray:
    """Return labels numbered 0, 1, ... from the heaviest to the lightest; -1 stays.

    Ties go to the label whose first sample comes first.
    """
    used, first, place = np.unique(labels, return_index=True, return_inverse=True)
    place = place.reshape(-1)  # numpy 2.0 gave it another shape
    total = np.bincount(place, weight, minlength=len(used))
    total[used < 0] = np.inf
    order = np.lexsort((first, -total))
    rank = np.empty(len(used), np.int64)
    rank[order] = np.arange(len(used))
    if len(used) and used[0] < 0:
        rank -= 1
    return rank[place].astype(np.int32)


def without_islands(
    points: FloatArray, labels: IntArray, weight: FloatArray, graph: Ragged
) -> IntArray:
    """Give pieces of a label far lighter than its heaviest one to the labels beside them.

    Parameters
    ----------
    points : (n, 3) float64
    labels : (n,) int32
        -1 takes no part.
    weight : (n,) float
    graph : Ragged
        n rows.

    Returns
    -------
    (n,) int32
        Pieces without a neighbour stay.
    """
    if not (labels >= 0).any():
        return labels
    piece, known = connected_labels(labels, graph), labels >= 0
    total = np.bincount(piece[known], weight[known])
    of_piece = np.zeros(len(total), np.int64)
    of_piece[piece[known]] = labels[known]
    heaviest = np.zeros(int(labels.max()) + 1)
    np.maximum.at(heaviest, of_piece, total)
    island = known & (total < ISLAND * heaviest[of_piece])[piece]
    sample = np.repeat(np.arange(len(labels)), graph.lengths)
    usable = known[sample] & known[graph.indices]
    ends = np.concatenate([[0], np.cumsum(np.bincount(sample[usable], minlength=len(labels)))])
    within = Ragged(ends, graph.indices[usable])
    around = spread_labels(points, within, np.where(island, -1, labels))
    return np.where(island & (around >= 0), around, labels).astype(np.int32)


def piece_counts(labels: IntArray, graph: Ragged) -> NDArray[np.int64]:
    """Return the number of connected pieces of each label, (count,)."""
    known = labels >= 0
    first = np.unique(connected_labels(labels, graph)[known], return_index=True)[1]
    return np.bincount(labels[known][first], minlength=int(labels.max(initial=-1)) + 1)


def diffused_labels(labels: IntArray, graph: Ragged, steps: int) -> IntArray:
    """Straighten borders: labels spread and thin out like heat.

    Each sample has a share of each label; a step gives it the mean share of itself and its
    neighbours. At the end it takes the label with the largest share (ties: the lowest). Only
    samples near a border take part. -1 stays, and spreads nowhere.

    Parameters
    ----------
    labels : (n,) int32
    graph : Ragged
        n rows.
    steps : int
        Borders move by about the square root of this, in spacings. At most as many are made as a
        label has samples in the mean: more would leave nothing of most.

    Returns
    -------
    (n,) int32
    """
    from scipy.sparse import csr_array, diags_array, eye_array

    used = np.unique(labels[labels >= 0])  # of thousands of numbers few may be in use
    n, count = len(labels), len(used)
    if steps == 0 or count < 2:
        return labels
    column = np.searchsorted(used, labels)
    near = csr_array((np.ones(len(graph.indices)), graph.indices, graph.offsets), shape=(n, n))
    sample = np.repeat(np.arange(n), graph.lengths)
    moving = np.zeros(n, np.bool_)
    moving[sample[labels[sample] != labels[graph.indices]]] = True
    for _ in range(2 * math.isqrt(steps)):
        moving |= near @ moving.astype(np.float64) > 0
    moving &= labels >= 0
    rows, still = np.flatnonzero(moving), np.flatnonzero(~moving & (labels >= 0))
    around = near[rows]
    inner = around[:, rows] + eye_array(len(rows))
    fixed = _shares(column[still], count)
    held, share = around[:, still] @ fixed, _shares(column[rows], count)
    mean = diags_array(1.0 / (inner.sum(axis=1) + held.sum(axis=1)))
    inner, held = csr_array(mean @ inner), csr_array(mean @ held)
    size, dense = len(rows) * count, False
    for _ in range(min(steps, int((labels >= 0).sum()) // count)):
        share = inner @ share + held  # sparse: most samples have shares of a few labels
        if not dense and FULL * size < share.nnz and size <= MOST_FULL:
            share, held, dense = share.toarray(), held.toarray(), True
    result = labels.copy()
    result[rows] = used[share.argmax(axis=1)]
    return result


def _shares(column: NDArray[Any], count: int) -> Any:
    """Return the sparse shares of samples that have one label each, (n, count)."""
    from scipy.sparse import csr_array

    n = len(column)
    return csr_array((np.ones(n), (np.arange(n), column)), shape=(n, count))


def connected_labels(labels: IntArray, graph: Ragged) -> IntArray:
    """Give each connected piece of each label a label of its own; -1 stays."""
    sample = np.repeat(np.arange(len(labels)), graph.lengths)
    same = labels[sample] == labels[graph.indices]
    links = np.stack([sample[same], graph.indices[same]], axis=1)
    return np.where(labels < 0, -1, piece_labels(len(labels), links)).astype(np.int32)
