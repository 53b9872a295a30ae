"""Segmentation: one label for every sample and face of a surface, and the borders between them.

Source: thesis 5.3, 6.2.2, 6.3. Labels are spread over samples that have none, merged where they are
small, straightened, and numbered by area (`completed`). Where vertices have labels, a border
crosses the edges between two of them. Each crossing moves along its edge to where the curve is as
short as it can be within these triangles; curves that meet in a triangle of three labels meet in a
point of it.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Ragged, sums_of
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, frozen, hold
from medialis.shape.graph import nearest_seeds, surface_graph
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface, piece_labels

STEPS = 100
"""Rounds in which crossings move towards the middle of their neighbours: they move along one edge
only, so that more change nothing that can be seen."""


def vertex_borders(surface: Surface, labels: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the borders between labels of vertices: points (p, 3) and edges (e, 2) of curves."""
    assert surface.faces is not None
    corners = labels[surface.faces]
    following = np.roll(corners, -1, axis=1)
    crossed = (corners != following) & (corners >= 0) & (following >= 0)
    kinds = crossed.sum(axis=1)
    sides = np.flatnonzero(crossed & (kinds >= 2)[:, None])
    start, end = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    ends = np.sort(np.stack([start[sides], end[sides]], axis=1), axis=1)
    cut, point = np.unique(ends, axis=0, return_inverse=True)
    point, face = point.reshape(-1), sides // 3
    two = kinds[face] == 2
    pairs = point[two].reshape(-1, 2)
    middle, place = np.unique(face[~two], return_inverse=True)
    spokes = np.stack([point[~two], len(cut) + place], axis=1)
    edges = np.concatenate([pairs, spokes])
    points = _shortened(surface.points[cut], edges, len(middle))
    return frozen(points, np.float64), frozen(edges, np.int32)


def _shortened(cut: FloatArray, edges: NDArray[np.int64], junctions: int) -> FloatArray:
    """Move crossings along their edges (c, 2, 3), and junctions, to shorten the curves."""
    count = len(cut) + junctions
    ends, other = np.concatenate([edges, edges[:, ::-1]]).T
    degree = np.maximum(np.bincount(ends, minlength=count), 1)[:, None]
    low, along = cut[:, 0], cut[:, 1] - cut[:, 0]
    size = np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)

    def middles(points: FloatArray) -> FloatArray:
        return sums_of(ends, points[other], count) / degree

    points = np.concatenate([cut.mean(axis=1), np.zeros((junctions, 3))])
    points[len(cut) :] = middles(points)[len(cut) :]
    for _ in range(STEPS):
        wanted = (points + middles(points)) / 2
        share = np.einsum("ij,ij->i", wanted[: len(cut)] - low, along) / size
        points = np.concatenate([low + np.clip(share, 0, 1)[:, None] * along, wanted[len(cut) :]])
    return points


def face_borders(surface: Surface, labels: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the borders between labels of faces: edges of the mesh."""
    assert surface.faces is not None
    first, second, _ = surface.edge_table.pairs
    a, b = labels[first // 3], labels[second // 3]
    sides = first[(a != b) & (a >= 0) & (b >= 0)]
    start, end = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    used, edges = np.unique(np.stack([start[sides], end[sides]], axis=1), return_inverse=True)
    return surface.points[used], frozen(edges.reshape(-1, 2), np.int32)


@dataclass(frozen=True, eq=False, repr=False)
class Segmentation(Bound):
    """Partition of the samples of a surface.

    Attributes
    ----------
    labels : (n,) int32
        Segment of each sample: 0, 1, ... from the largest area to the smallest; -1: none, because
        nothing tells (see the function that made it).
    surface : Shape
        The n samples: the surface as computed on, refined where that was needed.
    method : str
        How it was divided, where a function has several methods: as "limbs" or "sheets".
    face_labels : (m,) int32 or None
        Segment of each face of the surface, where borders follow edges of the mesh.
    joins : (j, 2) int32 or None
        Where segments form a tree: which two are joined first, and so on; the second one becomes
        part of the first.
    join_levels : (j,) float64 or None
        How much belongs together what is joined, 1 at most, the largest first.
    persistence : (count,) float64 or None
        How sure each segment is, where that is known: see the function that made it.

    Raises
    ------
    InvalidShapeError
        When there is not one label a sample, or a face.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.make_shape([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    ...                             [[0, 1, 2], [0, 2, 3]])
    >>> halves = medialis.Segmentation([0, 0, 0, 1], surface=shape)
    >>> halves, halves.of_faces().tolist()
    (Segmentation(2 segments of 4 samples), [0, 0])
    """

    labels: IntArray
    surface: Shape = field(kw_only=True)
    method: str = field(default="", kw_only=True)
    face_labels: IntArray | None = field(default=None, kw_only=True)
    joins: IntArray | None = field(default=None, kw_only=True)
    join_levels: FloatArray | None = field(default=None, kw_only=True)
    persistence: FloatArray | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if np.shape(self.labels) != (self.surface.point_count,):
            raise InvalidShapeError(
                f"labels must be one number for each of the {self.surface.point_count} samples, "
                f"got {np.shape(self.labels)}."
            )
        hold(self, labels=self.surface.point_count)
        if self.face_labels is not None:
            hold(self, face_labels=self.surface.face_count)
        if self.joins is not None:
            j = len(self.joins)
            hold(self, joins=(j, 2), join_levels=j)
        if self.persistence is not None:
            hold(self, persistence=self.count)

    def __repr__(self) -> str:
        return f"Segmentation({self.count} segments of {len(self.labels)} samples)"

    @cached_property
    def areas(self) -> FloatArray:
        """Area of each segment, (count,); number of samples in a cloud."""
        labels, weight = self.labels, self.surface.point_areas
        if self.face_labels is not None:
            labels, weight = self.face_labels, self.surface.face_areas
        return frozen(np.bincount(labels[labels >= 0], weight[labels >= 0]), np.float64)

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.areas)

    @cached_property
    def borders(self) -> tuple[FloatArray, IntArray]:
        """Curves between the segments of a mesh: points (p, 3), and edges (e, 2) between them.

        Where samples were divided they cross the triangles, and are as short as they can be without
        leaving the triangles that have samples of two segments; where faces were divided they
        follow edges of the mesh.
        """
        if self.surface.faces is None:
            return frozen(np.empty((0, 3)), np.float64), frozen(np.empty((0, 2)), np.int32)
        if self.face_labels is not None:
            return face_borders(self.surface, self.face_labels)
        return vertex_borders(self.surface, self.labels)

    def of_faces(self) -> IntArray:
        """Return the segment of each face of the surface, (m,).

        Its own where faces were divided, else that of most of its corners. Three different corners:
        the lowest segment, which is the largest. -1 where two corners or more have none.
        """
        if self.face_labels is not None:
            return self.face_labels
        if self.surface.faces is None:
            return frozen(np.empty(0), np.int32)
        low, middle, high = np.sort(self.labels[self.surface.faces], axis=1).T
        three = (low != middle) & (middle != high)
        # Sorted: the middle one is the majority, if there is one. -1 comes first.
        return frozen(np.where(three, np.where(low < 0, middle, low), middle), np.int32)

    def joined(self, count: int) -> Segmentation:
        """Return the division into fewer segments, `count` at least, by the tree of `joins`.

        Each segment of it is made of whole segments of this one. More than `count` where too few of
        them can be joined; the same segments without a tree. How sure they are is not known.
        """
        if self.joins is None or self.join_levels is None:
            return self
        turns = min(max(self.count - max(count, 1), 0), len(self.joins))
        first = np.arange(self.count)
        for kept, dropped in self.joins[:turns][::-1].tolist():  # their target is final
            first[dropped] = first[kept]
        area = np.bincount(first, self.areas, minlength=self.count)
        used = np.unique(first)
        order = used[np.lexsort((used, -area[used]))]
        number = np.full(self.count + 1, -1, np.int32)  # the last one is that of -1
        number[order] = np.arange(len(order))
        number[:-1] = number[first]
        return replace(
            self,
            labels=number[self.labels],
            face_labels=None if self.face_labels is None else number[self.face_labels],
            joins=number[self.joins[turns:]],
            join_levels=self.join_levels[turns:],
            persistence=None,
        )

    def of_input_faces(self) -> IntArray:
        """Return the segment of each face before `medialis.refine`, (m_in,).

        A face that was split has the segment that covers most of it (ties: the lowest).
        """
        labels, origin = self.of_faces(), self.surface.face_origin
        if origin is None:
            return labels
        width = self.count + 1
        keys = np.asarray(origin, np.int64) * width + labels + 1
        used, place = np.unique(keys, return_inverse=True)
        total = np.bincount(place.reshape(-1), self.surface.face_areas)
        order = np.lexsort((-used, total))  # the last one of each face stays
        result = np.full(int(origin.max(initial=-1)) + 1, -1, np.int32)
        result[used[order] // width] = used[order] % width - 1
        return frozen(result, np.int32)


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
    if (labels >= 0).all():
        return labels.astype(np.int32)
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
    pairs, links = np.unique(a[crossing].astype(np.int64) * count + b[crossing], return_counts=True)
    borders: list[dict[int, int]] = [{} for _ in range(count)]
    for pair, number in zip(pairs.tolist(), links.tolist(), strict=True):
        borders[pair // count][pair % count] = number
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
    rank = np.argsort(np.lexsort((first, -total))) - (used < 0).any()
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
    if not island.any():
        return labels
    sample = np.repeat(np.arange(len(labels)), graph.lengths)
    usable = known[sample] & known[graph.indices]
    ends = np.cumsum(np.bincount(sample[usable] + 1, minlength=len(labels) + 1))
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
    one_each = csr_array((np.ones(n), (np.arange(n), column)), shape=(n, count))
    held, share = around[:, still] @ one_each[still], one_each[rows]
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


def connected_labels(labels: IntArray, graph: Ragged) -> IntArray:
    """Give each connected piece of each label a label of its own; -1 stays."""
    sample = np.repeat(np.arange(len(labels)), graph.lengths)
    same = labels[sample] == labels[graph.indices]
    links = np.stack([sample[same], graph.indices[same]], axis=1)
    return np.where(labels < 0, -1, piece_labels(len(labels), links)).astype(np.int32)


def tell_pieces(found: Segmentation, progress: Progress) -> None:
    """Say how many segments lie in several pieces of the surface, and in how many."""
    surface = found.surface
    counts = run_patiently(lambda: piece_counts(found.labels, surface_graph(surface)), progress)
    apart = counts[counts > 1].tolist()
    if apart:
        text = (
            f"{len(apart)} of {found.count} segments are not connected along the surface, as the "
            f"two walls of a sheet are not: they have {sum(apart)} pieces."
        )
        told = {"segments": found.count, "count": len(apart), "pieces": sum(apart)}
        progress.note(text, "segments_not_connected", **told)
