"""Growing a graph along linked balls (thesis 3.6.3).

Links. A link between two balls stays inside the shape when each center lies in the other ball, or
at least when the balls overlap. So a graph of such links leads along the surface skeleton only.
`link_balls` makes the links and their costs; `GraphTree` is a graph that grows on them, with the
cheapest path of every other ball to it.

Growth: loops first, then branch after branch. Every branch is the cheapest path from a candidate to
the graph so far, so it runs along the curve skeleton where there is one, crosses gaps along the
surface skeleton, and joins the graph where it comes near it. One loop is closed for each handle, by
the cheapest link that goes round it. So the graph has one component by construction, and no loop
more than were asked for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Ragged, follow
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.curves.loops import Handles, close_loops, link_turns

if TYPE_CHECKING:
    from medialis.curves._kernels import BallLinks

NEIGHBOURS = 10
"""Of each point, as in the thesis."""

OFF_CURVE = 20.0
"""Times what a link costs on the curve skeleton that one far from it costs."""

STICKS_OUT = 0.5
"""Share of the radius at the start of a branch by which the ball at its end reaches out of it."""

APART = 0.85
"""Share of the larger radius by which the centers are apart: else the balls are nearly one."""

SHORTEST_BRANCH = 3.0
"""Spacings: shorter branches are steps between neighbouring balls."""

LARGE_COMPONENT = 0.25
"""Share of all balls from which on a component counts as large."""

KEPT_BRANCHES = 4
"""Branches of a large component that are kept: the first ones, whose search visits nearly all of
its balls."""

BALLS_A_CHUNK = 4096

Links = tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]]]
"""Balls (m,) and (m, c) others that each may be linked to."""

Turns = dict[int, NDArray[np.int64]]

Keep = Callable[[tuple[int, ...], Callable[[], Any]], Any]
"""Returns what a function computes, or what it returned before for the same numbers."""


def link_balls(
    centers: FloatArray,
    radii: FloatArray,
    closeness: FloatArray,
    near: Sequence[Links],
    needed: Sequence[Links],
    *,
    spacing: float,
    widths: FloatArray | None = None,
    groups: IntArray | None = None,
) -> BallLinks:
    """Link balls and give each link a cost.

    Parameters
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    closeness : (k,) float64
        1 on the curve skeleton, 0 far from it.
    near : sequence of Links
        That may be linked: used where each center lies in the other ball.
    needed : sequence of Links
        That are linked in any case, for the graph to hang together.
    spacing : float
        Typical distance of neighbouring balls; a link longer than this, and than a share of the
        smaller radius, costs more for its length.
    widths : (k,) float64, optional
        As in `BallLinks`.
    groups : (k,) int, optional
        Balls of the same group are linked only; -1: with none.

    Returns
    -------
    BallLinks
    """
    from medialis.curves._kernels import BallLinks, list_links, sort_links, weigh_links

    k = len(radii)
    groups = np.zeros(k, np.int32) if groups is None else groups
    given = [
        (np.ascontiguousarray(ends, np.int32), np.ascontiguousarray(others, np.int32), kind)
        for kind, lists in enumerate((near, needed))
        for ends, others in lists
    ]
    none, counts = np.empty(0, np.int32), np.zeros(k, np.int64)
    for ends, others, kind in given:
        list_links(ends, others, kind == 1, groups, centers, radii, counts, none)
    starts = np.concatenate([[0], np.cumsum(counts)])
    listed, places = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for ends, others, kind in given:
        list_links(ends, others, kind == 1, groups, centers, radii, places, listed)
    offsets, neighbours = np.empty(k + 1, np.int64), np.empty(len(listed), np.int32)
    neighbours = neighbours[: sort_links(starts, listed, offsets, neighbours)].copy()
    links = BallLinks(
        frozen(centers, np.float64), frozen(radii, np.float64), frozen(offsets, np.int64),
        frozen(neighbours, np.int32), np.empty(len(neighbours)), np.empty(len(neighbours)),
        spacing, frozen(np.full(k, np.inf) if widths is None else widths, np.float64),
    )  # fmt: skip
    dearness = 1 / (1 / OFF_CURVE + closeness)
    run_chunks(lambda begin, end: weigh_links(begin, end, links, dearness), k, BALLS_A_CHUNK)
    length, cost = frozen(links.length, np.float64), frozen(links.cost, np.float64)
    return links._replace(length=length, cost=cost)


class GraphTree:
    """A graph on linked balls, and the cheapest path of every other ball to it.

    Parameters
    ----------
    links : BallLinks
        k balls.

    Attributes
    ----------
    edges : list of (e, 2) int64
        Of the graph so far, between balls: those of each branch.
    spent : (k,) float64
        Cost of the cheapest path of each ball to the graph; inf where there is none.
    path : (k,) float64
        Its length.
    parent : (k,) int32
        The next ball on it; -1 for balls of the graph, and where there is none.
    base : (k,) int32
        Ball of the graph in which it ends; -1 where there is none.
    """

    def __init__(self, links: BallLinks) -> None:
        k, self.links = len(links.radii), links
        self.edges: list[NDArray[np.int64]] = []
        self.spent, self.path = np.full(k, np.inf), np.full(k, np.inf)
        self.parent, self.base = np.full(k, -1, np.int32), np.full(k, -1, np.int32)

    def copy(self) -> GraphTree:
        """Return the same graph, to grow on by itself."""
        other = GraphTree(self.links)
        other.edges = list(self.edges)
        for name in ("spent", "path", "parent", "base"):
            getattr(other, name)[:] = getattr(self, name)
        return other

    def add(self, balls: list[int]) -> None:
        """Make balls nodes of the graph, and find the paths of the others to it anew."""
        from medialis.curves._kernels import spread_from_tree

        sources = np.array(balls, np.int32)
        spread_from_tree(sources, self.links, self.spent, self.path, self.parent, self.base)

    def join(self, ball: int) -> list[int]:
        """Take the cheapest path of a ball into the list of edges; return its new balls."""
        path = follow(self.parent, ball)
        self.take(path)
        return path[:-1]

    def take(self, path: Sequence[int]) -> None:
        """Take the steps of a path into the list of edges."""
        self.edges.append(np.array([path[:-1], path[1:]], np.int64).T)


def grow_graph(
    links: BallLinks,
    components: NDArray[np.int32],
    strength: FloatArray,
    candidates: NDArray[np.bool_],
    handles: Mapping[int, Handles] | None = None,
    keep: Keep = lambda _, compute: compute(),
    progress: Progress | None = None,
) -> tuple[NDArray[np.int64], Turns]:
    """Grow a graph in each component of a set of balls.

    Parameters
    ----------
    links : BallLinks
        k balls.
    components : (k,) int
        Component of each ball; -1: not to be used.
    strength : (k,) float64
        The strongest candidate is where the graph of its component starts; without candidates it
        starts at the largest ball.
    candidates : (k,) bool
        Balls that the graph must reach where they stick out of it.
    handles : dict, optional
        Loops to close, by component.
    keep : callable, optional
        Keeps the first stages, so that other candidates which lead to them go on from there.
    progress : Progress, optional

    Returns
    -------
    (e, 2) int64
        Edges between balls, each once; a row (i, i) is a graph of ball i alone.
    dict
        Turns of the loops that were closed (`close_loops`), by the number of the component,
        where handles were given.
    """
    groups = Ragged.group(components, int(components.max(initial=-1)) + 1)
    balls = {number: rows.astype(np.int64) for number, rows in enumerate(groups) if len(rows)}
    wanted = {number: rows[candidates[rows]] for number, rows in balls.items()}
    roots = {}
    for number, pool in wanted.items():
        # Where no candidate is kept the measure is noise: the middle of the thickest place stays.
        pool, worth = (pool, strength) if len(pool) else (balls[number], links.radii)
        roots[number] = int(pool[np.nan_to_num(worth[pool], nan=-np.inf).argmax()])
    stages = tuple(roots.values())
    graph, loops = keep(stages, lambda: _rooted(links, balls, roots, handles or {}))
    mine = False
    for number in sorted(balls, key=lambda number: len(balls[number]), reverse=True):
        large, turn = len(balls[number]) >= LARGE_COMPONENT * len(links.radii), 0
        while (tip := next_tip(graph, wanted[number])) is not None:
            if progress is not None:
                progress.update(0.0)
            stages = (*stages, tip)
            if large and turn < KEPT_BRANCHES:
                graph, mine = keep(stages, functools.partial(_branched, graph, tip)), False
            else:
                graph, mine = graph if mine else graph.copy(), True
                graph.add(graph.join(tip))
            turn += 1
    joined = np.concatenate([np.empty((0, 2), np.int64), *graph.edges])
    alone = np.setdiff1d(stages[: len(roots)], joined)
    edges = np.sort(np.concatenate([joined, np.stack([alone, alone], axis=1)]), axis=1)
    return np.unique(edges, axis=0), loops


def _rooted(
    links: BallLinks,
    balls: Mapping[int, NDArray[np.int64]],
    roots: Mapping[int, int],
    handles: Mapping[int, Handles],
) -> tuple[GraphTree, Turns]:
    """Start a graph in each component: its root, and the loops round its handles."""
    graph, loops = GraphTree(links), {}
    graph.add(list(roots.values()))
    for number in handles.keys() & roots.keys():
        one = handles[number]
        loops[number] = np.zeros((0, len(one.loops)), np.int64)
        if one.loops:
            turns = link_turns(links, one, balls[number])
            loops[number] = close_loops(graph, turns, balls[number], roots[number], one.genus)
    return graph, loops


def _branched(graph: GraphTree, tip: int) -> GraphTree:
    """Return a copy of a graph with one more branch."""
    copy = graph.copy()
    copy.add(copy.join(tip))
    return copy


def next_tip(graph: GraphTree, candidates: NDArray[np.int64]) -> int | None:
    """Return the candidate that sticks out of the graph most; None when there is none."""
    radii = graph.links.radii
    # Short ways go first: in the end nearly all are, and a noisy shape takes a thousand turns.
    far = graph.path[candidates] >= SHORTEST_BRANCH * graph.links.spacing
    reached = candidates[far & (graph.base[candidates] >= 0)]
    base = graph.base[reached]
    gap = np.linalg.norm(graph.links.centers[reached] - graph.links.centers[base], axis=1)
    distance = np.maximum(gap, graph.path[reached] / 2)
    out = sticks_out(distance, radii[reached], radii[base], graph.links.widths[reached])
    if not out.any():
        return None
    beyond = np.where(out, graph.path[reached] + radii[reached] - radii[base], -np.inf)
    return int(reached[beyond.argmax()])


def sticks_out(
    distance: FloatArray, tip: FloatArray, base: FloatArray, width: FloatArray
) -> NDArray[np.bool_]:
    """Tell branches from spurs.

    The ball at the end of a branch reaches out of the ball where it starts by half of its radius,
    or by half the width of the branch if that is less: a half ball on a wall reaches out as far.
    Neither center lies deep in the other ball.

    Parameters
    ----------
    distance : (b,) float64
        Of the ends.
    tip, base : (b,) float64
        Radius at the free end and at the other one.
    width : (b,) float64
        Half the width at the free end; inf where it is not known.
    """
    out = distance + tip > base + np.minimum(STICKS_OUT * base, width)
    return np.asarray(out & (distance > APART * np.maximum(tip, base)))
