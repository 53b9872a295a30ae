"""The tree of sections of a scanned tree: which points belong together, and what grows from what.

1. `neighbour_graph`: each point is linked to its nearest neighbours. Where the scan has gaps,
   components are joined by the shortest bridges (a minimum spanning tree, Boruvka 1926). So there
   is one tree whatever was hidden.
2. `Sections.of`: shortest paths from the base (Dijkstra). Points of the same range of distance
   that are linked form a section (level sets of the geodesic distance: Verroust and Lazarus 2000;
   for scanned trees Xu, Gossett and Chen 2007). The section that a path enters from is the parent.
   One root and no loops follow by construction.
3. `Sections.onward`: at a fork a limb goes on in the thickest section; among those about as thick,
   in the one with most length beyond it (pipe model: Shinozaki 1964).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import Index, Mask, Ragged, kd_tree, sums_of, unit_rows, weighted_graph
from medialis.base.validation import FloatArray
from medialis.shape.surface import piece_labels

NEIGHBOURS = 20
"""Links of a point. 6 are within its spacing, about 24 within twice its spacing on a surface."""

SPACING_RANK = 6
"""The distance to this neighbour is the spacing of a point."""

WIDTH = 1.5
"""Width of a section in spacings. A ring of points is connected from 1.2 on; wider ones merge
twigs that are close together."""

LINKED = 2.0
"""Length in spacings up to which points of a section are linked."""

BRIDGE_QUERY = 32, 128, 512
"""Neighbours that are examined for a bridge: of all points, and of those with a cheaper one."""

ASIDE = 2.0
"""A bridge costs so many times its length more for each end where it is across the limb."""

NARROW = 10.0
"""Maximum factor by which a bridge costs more that leaves a part where the part is thin."""

ALIKE = 0.85
"""Fraction of the thickness of the thickest section of a fork from which on sections are alike."""

BEYOND = 2.0, 4.0
"""Distances beyond a fork, in thicknesses of the fork, between which sections are compared."""


def thinned(points: FloatArray, most: int) -> Index:
    """Return the rows of at most `most` points: one of each cell of a cubic grid.

    The cell size is the smallest that does, within 5 %.
    """
    count = len(points)
    if count <= most:
        return np.arange(count, dtype=np.int32)
    low = points.min(axis=0)

    def first_of_cells(size: float) -> np.ndarray:
        cells = np.floor((points - low) / size).astype(np.int64)
        _, y, z = cells.max(axis=0) + 1
        keys = (cells[:, 0] * y + cells[:, 1]) * z + cells[:, 2]
        return np.unique(keys, return_index=True)[1]

    large = float(np.ptp(points, axis=0).max()) / most ** (1.0 / 3.0)  # a filled cube
    small = large / 2.0**10
    while large > 1.05 * small:
        middle = (small * large) ** 0.5
        if len(first_of_cells(middle)) > most:
            small = middle
        else:
            large = middle
    return np.sort(first_of_cells(large)).astype(np.int32)


@dataclass(frozen=True, eq=False)
class PointGraph:
    """Points (n, 3), their spacing (n,), and links: two rows (e,) each, and lengths (e,)."""

    points: FloatArray
    spacing: FloatArray
    a: Index
    b: Index
    lengths: FloatArray


@dataclass(frozen=True, eq=False)
class Directions:
    """Direction (n, 3) of the limb that each point is on, zero where unknown, and its radius."""

    ways: FloatArray
    radii: FloatArray


def neighbour_graph(points: FloatArray, known: Directions | None = None) -> PointGraph:
    """Link each point to its nearest neighbours, and components by the cheapest bridges.

    Neighbours are linked up to twice the spacing of both: what is farther is a bridge. Bridges
    along limbs are cheaper than those across, and those at the thick end of a part than others.
    """
    count = len(points)
    k = min(NEIGHBOURS + 1, count)
    tree = kd_tree(points)
    away, rows = tree.query(points, k=k)
    a, b = np.repeat(np.arange(count), k - 1), rows[:, 1:].ravel()
    keys, first = np.unique(np.minimum(a, b) * count + np.maximum(a, b), return_index=True)
    a, b, lengths = keys // count, keys % count, away[:, 1:].ravel()[first]
    spacing = away[:, min(SPACING_RANK, k - 1)]
    proper = (a != b) & (lengths <= LINKED * np.minimum(spacing[a], spacing[b]))
    bridges = _bridges(points, tree, a[proper], b[proper], known)
    a, b = np.concatenate([a[proper], bridges[0]]), np.concatenate([b[proper], bridges[1]])
    lengths = np.concatenate([lengths[proper], bridges[2]])
    return PointGraph(points, spacing, a, b, lengths)


def _bridges(
    points: FloatArray, tree: object, a: Index, b: Index, known: Directions | None
) -> tuple:
    """Return the cheapest links between components until all are joined (Boruvka)."""
    added: list[tuple] = []
    while True:
        ends = [np.concatenate([one, *(link[k] for link in added)]) for k, one in enumerate((a, b))]
        labels = piece_labels(len(points), np.column_stack(ends)).astype(np.int64)
        if labels.max() == 0:
            break
        added.append(_cheapest_to_others(points, tree, labels, known))
    if not added:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    return tuple(np.concatenate([link[k] for link in added]) for k in range(3))


def _costs(
    points: FloatArray, rows: Index, others: Index, away: FloatArray, known: Directions
) -> FloatArray:
    """Return what bridges from points (n,) to others (n, k) cost, given their lengths."""
    links = (points[others] - points[rows][:, None]) / np.maximum(away, 1e-300)[..., None]
    along = np.abs(np.einsum("nka,na->nk", links, known.ways[rows]))
    other = np.abs(np.einsum("nka,nka->nk", links, known.ways[others]))
    return np.asarray(away * (1.0 + ASIDE * (2.0 - along - other)))


def _cheapest_to_others(
    points: FloatArray, tree: object, labels: Index, known: Directions | None
) -> tuple:
    """Return the cheapest link from each component but the largest to another one."""
    number = int(labels.max()) + 1
    best, ends = np.full(number, np.inf), np.full((number, 3), -1.0)
    largest = int(np.bincount(labels).argmax())
    narrow = np.ones(len(points))
    if known is not None:
        thickest = np.zeros(number)
        np.maximum.at(thickest, labels, known.radii)
        narrow = np.clip(thickest[labels] / np.maximum(known.radii, 1e-300), 1.0, NARROW)

    def examine(waiting: Index, away: FloatArray, rows: Index) -> None:
        """Keep the cheapest links from points to their neighbours in other components."""
        cost = away if known is None else _costs(points, waiting, rows, away, known)
        cost = np.where(labels[rows] != labels[waiting][:, None], cost, np.inf)
        column, every = cost.argmin(axis=1), np.arange(len(waiting))
        cheapest = cost[every, column] * narrow[waiting]
        order = np.argsort(cheapest, kind="stable")[: int(np.isfinite(cheapest).sum())]
        of_component, first = np.unique(labels[waiting[order]], return_index=True)
        chosen = order[first]
        cheaper = cheapest[chosen] < best[of_component]
        of_component, chosen = of_component[cheaper], chosen[cheaper]
        best[of_component] = cheapest[chosen]
        link = [waiting[chosen], rows[chosen, column[chosen]], away[chosen, column[chosen]]]
        ends[of_component] = np.stack(link, axis=1)

    waiting = np.flatnonzero(labels != largest)
    for times in BRIDGE_QUERY:
        k = min(times, len(points))
        away, rows = tree.query(points[waiting], k=k)  # type: ignore[attr-defined]
        examine(waiting, away, rows)
        waiting = waiting[narrow[waiting] * away[:, -1] < best[labels[waiting]]]
        if k == len(points) or not len(waiting):
            break
    # Large parts that are far from all others: their neighbours are all their own.
    for component in np.setdiff1d(np.flatnonzero(np.isinf(best)), [largest]).tolist():
        other, inside = np.flatnonzero(labels != component), np.flatnonzero(labels == component)
        k = min(BRIDGE_QUERY[0], len(other))
        away, rows = kd_tree(points[other]).query(points[inside], k=k)
        examine(inside, away.reshape(-1, k), other[rows.reshape(-1, k)])
    joined = ends[:, 0] >= 0
    a, b = ends[joined, :2].astype(np.int64).T
    return a, b, ends[joined, 2]


@dataclass(frozen=True, eq=False)
class Sections:
    """Sections of a scanned tree.

    Attributes
    ----------
    width : float
        Range of geodesic distance that a section covers.
    label : (n,) int
        Section of each point.
    parents : (s,) int
        Section that each one grows from, -1: the root, which is one.
    centers : (s, 3) float64
        Mean of the points of each section.
    begin, reach : (s,) float64
        Geodesic distance from the base to the nearest point of each section, and to the farthest
        of all sections that grow from it.
    beyond : (s,) float64
        Length of all that grows from each section.
    thickness : (s,) float64
        Root mean square distance of its points from its axis.
    rows : Ragged
        Points of each section.
    children : list of list of int
    onward : (s,) int64
        Child in which the limb of each section goes on, -1: a tip.
    """

    width: float
    label: Index
    parents: Index
    centers: FloatArray
    begin: FloatArray
    reach: FloatArray
    beyond: FloatArray
    thickness: FloatArray
    rows: Ragged
    children: list[list[int]]
    onward: Index

    @classmethod
    def of(cls, graph: PointGraph, base: Index, width: float) -> Sections:
        """Cut a graph of points into sections by the distance from the points `base`."""
        distance, before = _distances(graph, base)
        label, parents, begin = _level_sets(graph, distance, before, width)
        count = len(parents)
        rows = Ragged.group(label, count)
        size = rows.lengths
        centers = sums_of(label, graph.points, count) / size[:, None]
        outward = np.argsort(begin, kind="stable")
        parents = _one_root(parents, centers, outward)
        reach = np.zeros(count)
        np.maximum.at(reach, label, distance)
        step = np.linalg.norm(centers - centers[parents], axis=1)
        step[parents < 0] = 0.0
        beyond = np.zeros(count)
        children: list[list[int]] = [[] for _ in range(count)]
        for s in outward[::-1].tolist():
            p = int(parents[s])
            if p >= 0:
                reach[p] = max(reach[p], reach[s])
                beyond[p] += beyond[s] + step[s]
                children[p].append(s)
        longest = np.array([max(c, key=lambda s: beyond[s] + step[s]) if c else i
                            for i, c in enumerate(children)])  # fmt: skip
        axes = unit_rows(
            centers[longest] - centers[np.where(parents < 0, np.arange(count), parents)]
        )
        away = graph.points - centers[label]
        away -= np.einsum("na,na->n", away, axes[label])[:, None] * axes[label]
        squares = np.bincount(label, np.einsum("na,na->n", away, away), minlength=count)
        thickness = np.sqrt(squares / size)
        measures = begin, reach, beyond, thickness, rows, children
        onward = _onward(width, children, longest, beyond + step, step, thickness, reach - begin)
        return cls(width, label, parents, centers, *measures, onward)

    def path(self, section: int) -> list[int]:
        """Return the sections of the limb that begins with one."""
        path = [section]
        while self.onward[path[-1]] >= 0:
            path.append(int(self.onward[path[-1]]))
        return path

    def root(self) -> int:
        """Return the section without a parent."""
        return int(np.flatnonzero(self.parents < 0)[0])


def _distances(graph: PointGraph, base: Index) -> tuple[FloatArray, Index]:
    """Return the length of the path from the base to each point, and the point before it.

    A link that is longer than the spacing costs as many times its length: paths stay on limbs.
    """
    from scipy.sparse.csgraph import dijkstra

    count = len(graph.points)
    spacing = np.minimum(graph.spacing[graph.a], graph.spacing[graph.b])
    least = 1e-12 * float(np.ptp(graph.points, axis=0).max())  # 0 is no link
    cost = graph.lengths * np.maximum(1.0, graph.lengths / np.maximum(spacing, least))
    links = weighted_graph(np.maximum(cost, least), graph.a, graph.b, count)
    given = {"directed": False, "indices": base, "min_only": True, "return_predecessors": True}
    _, before, _ = dijkstra(links, **given)
    before = np.where(before < 0, np.arange(count), before)
    length = np.linalg.norm(graph.points - graph.points[before], axis=1)
    jump = before
    while not np.array_equal(farther := jump[jump], jump):  # pointer doubling
        length = length + length[jump]
        jump = farther
    return length, before


def _level_sets(
    graph: PointGraph, distance: FloatArray, before: Index, width: float
) -> tuple[Index, Index, FloatArray]:
    """Return the section of each point, the section before each, and where each begins."""
    level = np.floor(distance / width).astype(np.int64)
    spacing = np.maximum(graph.spacing[graph.a], graph.spacing[graph.b])
    same = (level[graph.a] == level[graph.b]) & (graph.lengths <= LINKED * spacing)
    links = np.column_stack([graph.a[same], graph.b[same]])
    label = piece_labels(len(distance), links).astype(np.int64)
    order = np.lexsort((distance, label))
    nearest = order[np.searchsorted(label[order], np.arange(label.max() + 1))]
    at_base = before[nearest] == nearest
    parents = np.where(at_base, -1, label[before[nearest]])
    return label, parents, distance[nearest]


def _one_root(parents: Index, centers: FloatArray, outward: Index) -> Index:
    """Let all roots but the first grow from it: parts of a base that are not linked."""
    roots = [int(s) for s in outward if parents[s] < 0]
    parents = parents.copy()
    parents[roots[1:]] = roots[0]
    return parents


def _onward(
    width: float,
    children: list[list[int]],
    longest: Index,
    length: FloatArray,
    step: FloatArray,
    thickness: FloatArray,
    reach: FloatArray,
) -> Index:
    """Return the child in which the limb of each section goes on."""

    def thick_beyond(s: int, ball: float) -> float:
        away, found = 0.0, []
        while True:
            if away >= BEYOND[0] * ball or not children[s]:
                found.append(thickness[s])
            if away > BEYOND[1] * ball or not children[s]:
                return float(np.median(found))
            s = int(longest[s])
            away += step[s]

    onward = np.full(len(children), -1, np.int64)
    for s, following in enumerate(children):
        if len(following) <= 1:
            onward[s] = following[0] if following else -1
            continue
        long = [c for c in following if reach[c] > width] or following
        thick = np.array([thick_beyond(c, max(thickness[s], width)) for c in long])
        alike = [c for c, one in zip(long, thick, strict=True) if one >= ALIKE * thick.max()]
        onward[s] = max(alike, key=lambda c: length[c])
    return onward


def lowest(points: FloatArray, up: int, spacing: float) -> Mask:
    """Return the points of the base: those within two spacings of the lowest one in height."""
    height = points[:, up]
    return np.asarray(height < height.min() + 2.0 * spacing)
