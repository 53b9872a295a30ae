"""Closing one loop for each handle while a graph grows (thesis 3.6.3).

How often a closed path goes round each handle is a vector of whole numbers, its turns. A loop is
new when its turns are no sum of those of the loops before. To tell this for every link at once,
turns are weighed by random numbers whose sums over all loops so far are 0: a loop that weighs
something is new, and what each path weighs takes one number a ball, not one for each handle.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.curves.graph.handles import Handles
from medialis.curves.graph.spanning import SpanningSurface
from medialis.curves.graph.tree import GraphTree, pairs
from medialis.model.polylines import follow

Index = NDArray[np.int64]

PRIME = 2**31 - 1
"""Turns and weights are compared modulo this prime; turns are far smaller. A new loop weighs 0 by
chance once in so many."""


@dataclass(frozen=True, eq=False)
class LinkTurns:
    """Turns along links, only those that are not 0.

    Attributes
    ----------
    link, loop, count : (q,) int64
        The link, in ascending order, crosses the surface that a loop spans so many times against
        its normals.
    loops : int
        How many there are.
    """

    link: Index
    loop: Index
    count: Index
    loops: int

    @cached_property
    def _groups(self) -> tuple[Index, Index]:
        return np.unique(self.link, return_index=True)

    def weigh(self, weight: Index, links: int) -> Index:
        """Return the sum of weighed turns of each link, modulo the prime, (links,)."""
        result = np.zeros(links, np.int64)
        if len(self.link):
            each, first = self._groups
            result[each] = np.add.reduceat(self.count * weight[self.loop], first) % PRIME
        return result

    def along(self, link: int) -> Index:
        """Return the turns of one link, (loops,)."""
        result = np.zeros(self.loops, np.int64)
        rows = slice(*np.searchsorted(self.link, (link, link + 1)))
        result[self.loop[rows]] = self.count[rows]
        return result


def link_turns(links: BallLinks, one: Handles, rows: Index) -> LinkTurns:
    """Count the turns along links between balls that overlap.

    A turn is a crossing of the surface that a loop spans, which lies within the hull of the loop:
    only balls with links that come there are asked.

    Parameters
    ----------
    links : BallLinks
    one : Handles
    rows : (r,) int
        Balls of the component.
    """
    from medialis.curves.graph._crossing_kernels import take_turns
    from medialis.curves.graph._growth_kernels import farthest_ends

    reach, turns = np.zeros(len(links)), np.zeros(len(links.length), np.int64)
    farthest_ends(rows, links.radii, links.offsets, links.neighbours, links.length, reach)
    centers, found = links.centers[rows], np.empty((2, len(turns)), np.int64)
    lists = [np.empty((3, 0), np.int64)]
    for number, loop in enumerate(one.loops):
        spanned = SpanningSurface.of(one.points[loop[:-1]])
        low, high = spanned.bounds
        away = np.maximum(np.maximum(low - centers, centers - high), 0.0).max(axis=1)
        there = rows[away <= reach[rows]]
        spanned.count_crossings(links, there, reach, turns)
        link, turn = found[:, : take_turns(there, links.offsets, turns, *found)]
        lists.append(np.stack([link, np.full(len(link), number), turn]))
    every = np.concatenate(lists, axis=1)
    every = every[:, np.argsort(every[0], kind="stable")]
    return LinkTurns(every[0], every[1], every[2], len(one.loops))


def close_loops(graph: GraphTree, turns: LinkTurns, rows: Index, root: int, most: int) -> Index:
    """Close up to `most` loops round handles, cheapest first.

    Parameters
    ----------
    graph : GraphTree
        Grows by the loops.
    turns : LinkTurns
    rows : (r,) int
        Balls of the component.
    root : int
        The one that is a node of the graph.
    most : int

    Returns
    -------
    (l, c) int64
        How often each loop goes round each handle, up to sums of loops: independent rows.
    """
    from medialis.curves.graph._growth_kernels import cheapest_closing_link, weigh_paths

    links, random = graph.links, np.random.default_rng(0)
    net = (links.radii, links.offsets, links.neighbours, links.length)
    anchor, path = np.full(len(links), -1, np.int64), np.zeros(len(links), np.int64)
    known, nodes = np.zeros((0, turns.loops), np.int64), {root: np.zeros(turns.loops, np.int64)}
    for _ in range(most):
        weight = _weights(known, random.integers(1, PRIME, turns.loops))
        path[list(nodes)] = np.stack(list(nodes.values())) @ weight % PRIME
        of_link = turns.weigh(weight, len(links.length))
        order = rows[np.argsort(graph.spent[rows], kind="stable")]
        weigh_paths(order, graph.parent, *net, of_link, PRIME, path, anchor)
        link = cheapest_closing_link(
            rows, *net, links.cost, graph.spent, of_link, PRIME, path, anchor
        )
        if link < 0:
            break
        a = int(np.searchsorted(links.offsets, link, side="right")) - 1
        b = int(links.neighbours[link])
        for end in (a, b):
            _follow_turns(graph, turns, end, nodes)
        known = _extend(known, nodes[a] + turns.along(link) - nodes[b])
        # Both may run side by side, as through the stem of an eyelet: one stretch for both.
        first, second = graph.join(a), follow(graph.parent, b)
        second = _apart(links, second, [*first, int(graph.base[a])])
        graph.edges += [pairs(second[:-1], second[1:]), pairs([a], [b])]
        new = {*first, *second}
        nodes = {v: turn for v, turn in nodes.items() if graph.parent[v] < 0 or v in new}
        graph.add([*first, *second])
    return known


def _follow_turns(graph: GraphTree, turns: LinkTurns, ball: int, nodes: dict[int, Index]) -> None:
    """Add the turns of the path from the graph to a ball, at each ball on it."""
    links = graph.links
    path = follow(graph.parent, ball)[::-1]
    for before, here in itertools.pairwise(path):
        begin, end = links.offsets[before], links.offsets[before + 1]
        link = begin + int((links.neighbours[begin:end] == here).argmax())
        nodes[here] = nodes[before] + turns.along(link)


def _apart(links: BallLinks, path: list[int], other: list[int]) -> list[int]:
    """Cut the end of a path off where it runs in the balls of another; it then ends on that."""
    from scipy.spatial import cKDTree

    centers, radii = links.centers, links.radii
    gap, place = cKDTree(centers[other]).query(centers[path])
    beside = np.asarray(other)[place]
    alone = np.flatnonzero(gap >= np.minimum(radii[path], radii[beside]))
    last = alone[-1] + 1 if len(alone) else len(path)
    if last >= len(path):
        return path
    return [*path[:last], *dict.fromkeys([path[last], int(beside[last])])]


def _weights(known: Index, free: Index) -> Index:
    """Change random weights where loops lead, so that each known loop weighs nothing."""
    weight = free.copy()
    leads = (known != 0).argmax(axis=1)
    weight[leads] = 0
    for row, lead in zip(known[::-1], leads[::-1], strict=True):
        weight[lead] = -int((row * weight % PRIME).sum()) % PRIME
    return weight


def _reduce(row: Index, known: Index) -> Index:
    """Remainder of a row after elimination by known ones (each with a leading 1)."""
    row = row % PRIME
    for basis in known:
        row = (row - row[(basis != 0).argmax()] * basis) % PRIME
    return row


def _extend(known: Index, row: Index) -> Index:
    rest = _reduce(row, known)
    lead = int(rest[(rest != 0).argmax()])
    return np.vstack([known, rest * pow(lead, -1, PRIME) % PRIME])
