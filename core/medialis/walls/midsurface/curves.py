"""The curves of sheets: rims, and welds, whose vertices all sheets that meet there share."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, kd_tree, places_along, rows_at, rows_of_labels
from medialis.base.box_tree import NearestTree
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.surface import piece_labels
from medialis.walls.midsurface._kernels import FIXED, FREE, SLIDING
from medialis.walls.midsurface.junctions import NEAR, CutSheet

SAME = 0.25  # halved 2 %, doubled 4 %
"""Half thicknesses: so near to each other the ends of curves of several sheets are one."""

CORNER = math.cos(math.radians(30.0))  # halved 4 %, doubled 100 %
"""Cosine of the turn from which on a curve has a corner."""

ONTO = 4
"""Times that places of a weld are moved to one of its sheets after the other: where these meet at
right angles the second one ends there, at 60 degrees each is four times as near."""

AT_END = 0.05  # halved 0 %, doubled 0 %
"""Share of an edge: a place so near to its end is its vertex, which makes no needle."""


@dataclass(eq=False)
class Chain:
    """A piece of a curve as one sheet has it.

    Attributes
    ----------
    sheet : int
    vertices : list of int
        Of the mesh of the sheet, in order; a loop ends where it begins.
    partners : frozenset of int
        The other sheets that meet there; none: a rim.
    nodes : (int, int)
        Numbers of its ends, the same in all sheets.
    """

    sheet: int
    vertices: list[int]
    partners: frozenset[int]
    nodes: tuple[int, int] = (-1, -1)


@dataclass(eq=False)
class Curve:
    """A curve with its new vertices, and the chains that become it.

    Attributes
    ----------
    places : (k, 3) float64
        With both ends.
    chains : list of (Chain, bool)
        And whether they run the same way.
    """

    places: FloatArray
    nodes: tuple[int, int]
    chains: list[tuple[Chain, bool]] = field(default_factory=list)

    @property
    def sheets(self) -> list[int]:
        """The sheets that it belongs to, ascending."""
        return sorted({chain.sheet for chain, _ in self.chains})


def feature_edges(sheet: CutSheet) -> tuple[Index, Index, list[frozenset[int]]]:
    """Return the edges of all curves of a sheet: their ends, and the other sheets there."""
    mesh = sheet.mesh
    h, a, b = mesh.half_edges()
    rows = (mesh.marks[h] != 0) | (mesh.twins[h] < 0)
    return a[rows], b[rows], [sheet.partners[mark] for mark in mesh.marks[h[rows]].tolist()]


def forget_lost(sheets: list[CutSheet]) -> None:
    """Take the marks off edges beside which nothing is left of the other sheet."""
    trees: dict[int, NearestTree] = {}
    for number, sheet in enumerate(sheets):
        mesh = sheet.mesh
        if mesh.face_count:
            trees[number] = NearestTree.of_triangles(
                mesh.points[: mesh.vertex_count], mesh.faces[: mesh.face_count].astype(np.int32)
            )
    for sheet in sheets:
        mesh = sheet.mesh
        h, a, b = mesh.half_edges()
        rows = np.flatnonzero(mesh.marks[h] != 0)
        if len(rows) == 0:
            continue
        middle = (mesh.points[a[rows]] + mesh.points[b[rows]]) / 2
        of_edge = [set(sheet.partners[m]) for m in mesh.marks[h[rows]].tolist()]
        for other in set().union(*of_edge):
            limit = 2 * NEAR * float(sheet.raw.half.max())
            if other in trees:
                far = trees[other].distances(middle)[0] > limit
            else:
                far = np.ones(len(rows), np.bool_)
            for i in np.flatnonzero(far).tolist():
                of_edge[i].discard(other)
        for edge, kept in zip(h[rows].tolist(), of_edge, strict=True):
            wanted = frozenset(kept)
            if wanted not in sheet.partners:
                sheet.partners.append(wanted)
            mesh.mark(edge, sheet.partners.index(wanted))


def find_chains(sheets: list[CutSheet]) -> tuple[list[Chain], FloatArray]:
    """Return the pieces of curves between nodes, and the places of the nodes (k, 3).

    Nodes are where curves end, meet, or have a corner; those of several sheets that lie together
    are one, and every curve that passes by is parted there.
    """
    graphs = [_Graph(sheet) for sheet in sheets]
    owners = [(s, v) for s, graph in enumerate(graphs) for v in graph.nodes()]
    places = np.array([sheets[s].mesh.points[v] for s, v in owners]).reshape(-1, 3)
    limits = np.array([SAME * float(sheets[s].raw.half.min()) for s, _ in owners])
    number, middles = _together(places, limits)
    node = {owner: int(number[i]) for i, owner in enumerate(owners)}
    middles = _part_passing(sheets, graphs, node, middles)
    return [
        chain for s, graph in enumerate(graphs) for chain in graph.chains(s, node, middles)
    ], np.array(middles).reshape(-1, 3)


def _together(places: FloatArray, limits: FloatArray) -> tuple[IntArray, list[FloatArray]]:
    """Give places nearer to each other than a limit one number; return the middles."""
    if len(places) == 0:
        return np.empty(0, np.int32), []
    pairs = kd_tree(places).query_pairs(float(limits.max()), output_type="ndarray")
    away = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    pairs = pairs[away <= np.minimum(limits[pairs[:, 0]], limits[pairs[:, 1]])]
    number = np.unique(piece_labels(len(places), pairs), return_inverse=True)[1].astype(np.int32)
    return number, [places[number == k].mean(axis=0) for k in range(int(number.max()) + 1)]


class _Graph:
    """The curves of one sheet as a graph of its vertices."""

    def __init__(self, sheet: CutSheet) -> None:
        self.sheet = sheet
        self.next: dict[int, dict[int, frozenset[int]]] = {}
        for a, b, partners in zip(*feature_edges(sheet), strict=True):
            self.join(int(a), int(b), partners)

    def join(self, a: int, b: int, partners: frozenset[int]) -> None:
        self.next.setdefault(a, {})[b] = partners
        self.next.setdefault(b, {})[a] = partners

    def nodes(self) -> list[int]:
        """Return the vertices where curves end, meet, or turn by a corner."""
        return sorted(v for v in self.next if self._is_node(v))

    def _is_node(self, v: int) -> bool:
        ends = list(self.next[v])
        if len(ends) != 2 or self.next[v][ends[0]] != self.next[v][ends[1]]:
            return True
        points = self.sheet.mesh.points
        one, two = points[v] - points[ends[0]], points[ends[1]] - points[v]
        size = float(np.linalg.norm(one) * np.linalg.norm(two))
        return bool(one @ two < CORNER * size)

    def passed(self, numbers: list[int], places: list[FloatArray], limit: float) -> list[int]:
        """Return the numbers of places that may lie within a limit of an edge, in their order.

        Such a place is no farther from an end of the edge than that and half of its length.
        """
        ends = np.array([(a, b) for a, others in self.next.items() for b in others], np.int64)
        if len(ends) == 0 or len(numbers) == 0:
            return []
        one, two = (self.sheet.mesh.points[v] for v in ends.T)
        farthest = limit + 0.5 * float(np.linalg.norm(two - one, axis=1).max())
        tree = kd_tree(self.sheet.mesh.points[np.unique(ends)])
        away = tree.query(np.array([places[number] for number in numbers]))[0]
        return [numbers[i] for i in np.flatnonzero(away <= 1.001 * farthest)]

    def chains(
        self, s: int, node: dict[tuple[int, int], int], middles: list[FloatArray]
    ) -> list[Chain]:
        """Return all pieces between nodes; a loop without one gets a node where it begins."""
        seen: set[tuple[int, int]] = set()
        result = []
        mine = sorted(v for t, v in node if t == s)
        loops = sorted(set(self.next) - set(mine))
        for start in [*mine, *loops]:
            if (s, start) not in node:
                if any((start, other) in seen for other in self.next[start]):
                    continue
                node[s, start] = len(middles)
                middles.append(np.array(self.sheet.mesh.points[start]))
            for first in sorted(self.next[start]):
                if (start, first) in seen:
                    continue
                walk, last, here = [start, first], start, first
                partners = self.next[start][first]
                seen |= {(start, first), (first, start)}
                while (s, here) not in node:
                    after = next(v for v in self.next[here] if v != last)
                    seen |= {(here, after), (after, here)}
                    last, here = here, after
                    walk.append(here)
                result.append(Chain(s, walk, partners, (node[s, start], node[s, here])))
        return result


def _part_passing(
    sheets: list[CutSheet],
    graphs: list[_Graph],
    node: dict[tuple[int, int], int],
    middles: list[FloatArray],
) -> list[FloatArray]:
    """Make nodes of other sheets nodes of the welds that pass there."""
    of_node: dict[int, set[int]] = {}
    for (s, _), number in node.items():
        of_node.setdefault(number, set()).add(s)
    _nodes_on_loops(graphs, node, middles, of_node)
    for s, graph in enumerate(graphs):
        wanted = [k for k, owners in of_node.items() if s not in owners]
        limit = SAME * float(sheets[s].raw.half.min())
        for number in graph.passed(wanted, middles, limit):
            owners = of_node[number]
            edges = [
                (a, b)
                for a, ends in graph.next.items()
                for b, partners in ends.items()
                if a < b and partners & owners
            ]
            if not edges:
                continue
            found = _nearest_edge(sheets[s].mesh.points, edges, middles[number])
            if found[0] > limit:
                continue
            v = _vertex_on(sheets[s], graph, *found[1:])
            if (s, v) not in node:
                node[s, v] = number
                owners.add(s)
    return middles


def _nodes_on_loops(
    graphs: list[_Graph],
    node: dict[tuple[int, int], int],
    middles: list[FloatArray],
    of_node: dict[int, set[int]],
) -> None:
    """Give each weld that is a loop without nodes one, at its first vertex."""
    for s, graph in enumerate(graphs):
        vertices = np.array(sorted(graph.next), np.int64)
        links = [(a, b) for a, ends in graph.next.items() for b in ends]
        label = piece_labels(len(vertices), np.searchsorted(vertices, links))
        for piece in rows_of_labels(label):
            start = int(vertices[piece[0]])
            partners = next(iter(graph.next[start].values()))
            lonely = not any((s, v) in node for v in vertices[piece].tolist())
            if lonely and partners and min(partners) > s:
                node[s, start] = len(middles)
                of_node[len(middles)] = {s}
                middles.append(np.array(graph.sheet.mesh.points[start]))


def _nearest_edge(
    points: FloatArray, edges: list[tuple[int, int]], place: FloatArray
) -> tuple[float, tuple[int, int], float]:
    """Return the distance of the nearest edge, the edge, and the share of it."""
    ends = np.array(edges)
    a, along = points[ends[:, 0]], points[ends[:, 1]] - points[ends[:, 0]]
    size = np.maximum(np.einsum("ea,ea->e", along, along), 1e-300)
    share = np.clip(np.einsum("ea,ea->e", place - a, along) / size, 0.0, 1.0)
    away = np.linalg.norm(a + share[:, None] * along - place, axis=1)
    best = int(away.argmin())
    return float(away[best]), edges[best], float(share[best])


def _vertex_on(sheet: CutSheet, graph: _Graph, edge: tuple[int, int], share: float) -> int:
    """Return the vertex of a curve at a place of one of its edges, made where there is none."""
    a, b = edge
    if share < AT_END or share > 1 - AT_END:
        return a if share < 0.5 else b
    mesh, partners = sheet.mesh, graph.next[a][b]
    v = mesh.split(a, b, mesh.points[a] + share * (mesh.points[b] - mesh.points[a]))
    del graph.next[a][b], graph.next[b][a]
    graph.join(a, v, partners)
    graph.join(v, b, partners)
    return v


def find_curves(
    sheets: list[CutSheet], chains: list[Chain], nodes: FloatArray, edge: float
) -> list[Curve]:
    """Put the chains of several sheets that run together into curves with even vertices."""
    curves: list[Curve] = []
    by_ends: dict[tuple[int, int], list[Curve]] = {}
    for chain in chains:
        points = sheets[chain.sheet].mesh.points[chain.vertices].copy()
        points[0], points[-1] = nodes[chain.nodes[0]], nodes[chain.nodes[1]]
        ends = (min(chain.nodes), max(chain.nodes))
        if chain.partners:
            limit = max(edge / 4, SAME * 2 * float(sheets[chain.sheet].raw.half.max()))
            known = [
                curve
                for curve in by_ends.get(ends, [])
                if chain.sheet not in curve.sheets and _runs_along(points, curve.places, limit)
            ]
            if known:
                known[0].chains.append((chain, _same_way(points, chain, known[0])))
                continue
        curve = Curve(_even(points, edge), chain.nodes, [(chain, True)])
        curves.append(curve)
        if chain.partners:
            by_ends.setdefault(ends, []).append(curve)
    for curve in curves:
        _lay_on_sheets(sheets, curve)
    return curves


def _lay_on_sheets(sheets: list[CutSheet], curve: Curve) -> None:
    """Move the places of a curve to the smooth sheets that it lies in: it was one of chords."""
    before = curve.places[1:-1]
    places, raws = before, [sheets[s].raw for s in curve.sheets]
    if len(before) == 0:
        return
    for _ in range(ONTO if len(raws) > 1 else 1):
        for raw in raws:
            places = raw.at(places)[0]
    near = np.linalg.norm(places - before, axis=1) < SAME * min(float(r.half.min()) for r in raws)
    curve.places[1:-1][near] = places[near]


def _runs_along(points: FloatArray, places: FloatArray, limit: float) -> bool:
    middle = _even(points, 0.0, pieces=2)[1]
    edges = [(i, i + 1) for i in range(len(places) - 1)]
    return _nearest_edge(places, edges, middle)[0] <= limit


def _same_way(points: FloatArray, chain: Chain, curve: Curve) -> bool:
    if chain.nodes[0] != chain.nodes[1]:
        return chain.nodes == curve.nodes
    quarter = _even(points, 0.0, pieces=4)
    there = _even(curve.places, 0.0, pieces=4)
    return bool(np.linalg.norm(quarter[1] - there[1]) <= np.linalg.norm(quarter[1] - there[3]))


def _even(points: FloatArray, edge: float, *, pieces: int = 0) -> FloatArray:
    """Return places along a polyline at even distances of about `edge`, with both ends."""
    at = places_along(points)
    if not pieces:
        closed = bool((points[0] == points[-1]).all())
        pieces = max(3 if closed else 1, round(float(at[-1]) / edge))
    wanted = np.linspace(0.0, at[-1], pieces + 1)
    result = rows_at(wanted, at, points)
    result[0], result[-1] = points[0], points[-1]
    return result


def lay_curves(
    sheets: list[CutSheet], curves: list[Curve], nodes: FloatArray
) -> tuple[list[NDArray[np.int8]], list[dict[int, int]], FloatArray]:
    """Move, add and free vertices so that each sheet has the vertices of its curves.

    Returns
    -------
    kinds : list of (n,) int8
        For each sheet what its vertices may do.
    numbers : list of dict
        For each sheet the number of each vertex that is one of a curve.
    places : (k, 3) float64
        Of the numbers: nodes come first.
    """
    numbers: list[dict[int, int]] = [{} for _ in sheets]
    sliding: list[set[int]] = [set() for _ in sheets]
    places, count = [nodes], len(nodes)
    for curve in curves:
        inner = curve.places[1:-1]
        own = np.arange(count, count + len(inner))
        for chain, same in curve.chains:
            way = slice(None) if same else slice(None, None, -1)
            s = chain.sheet
            _lay(sheets[s], chain, inner[way], own[way], numbers[s], sliding[s], nodes)
        places.append(inner)
        count += len(inner)
    kinds = []
    for sheet, known, loose in zip(sheets, numbers, sliding, strict=True):
        kind = np.full(sheet.mesh.vertex_count, FREE, np.int8)
        kind[list(loose)] = SLIDING
        kind[list(known)] = FIXED
        kinds.append(kind)
    return kinds, numbers, np.concatenate(places)


def _lay(
    sheet: CutSheet,
    chain: Chain,
    places: FloatArray,
    own: Index,
    numbers: dict[int, int],
    sliding: set[int],
    nodes: FloatArray,
) -> None:
    """Give one chain the vertices of its curve."""
    mesh = sheet.mesh
    at = places_along(mesh.points[chain.vertices])
    at = at / max(float(at[-1]), 1e-300)
    wanted = (1 + np.arange(len(places))) / (len(places) + 1)
    line = list(zip(at.tolist(), chain.vertices, strict=True))
    for end, number in ((0, chain.nodes[0]), (-1, chain.nodes[1])):
        mesh.points[chain.vertices[end]] = nodes[number]
        numbers[chain.vertices[end]] = number
    taken, k = {0, len(line) - 1}, 0
    close = 0.25 / (len(places) + 1)
    for target, place, number in zip(wanted.tolist(), places, own.tolist(), strict=True):
        while k < len(line) - 2 and line[k + 1][0] <= target:
            k += 1
        best = min((k, k + 1), key=lambda i: abs(line[i][0] - target))
        v = line[best][1]
        near = best not in taken and abs(line[best][0] - target) < close
        if not (near and mesh.may_move(v, place)):
            u, w = line[k][1], line[k + 1][1]
            v = mesh.split(u, w, place)
            line.insert(k + 1, (target, v))
            taken = {i if i <= k else i + 1 for i in taken}
            best = k + 1
        taken.add(best)
        mesh.points[v] = place
        numbers[v] = number
    sliding.update(v for i, (_, v) in enumerate(line) if i not in taken)
