"""What a curve skeleton grows along: links between balls (thesis 3.6.3).

A link between two balls stays inside the shape when each center lies in the other ball, or at least
when the balls overlap. So a graph of such links leads along the surface skeleton only. `link_balls`
makes the links and their costs; `GraphTree` is a graph that grows on them, with the cheapest path
of every other ball to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import follow
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray

NEIGHBOURS = 10
"""Of each point, as in the thesis."""

Links = tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]]]
"""Balls (m,) and (m, c) others that each may be linked to."""

BALLS_A_CHUNK = 4096

OFF_CURVE = 20.0
"""Times what a link costs on the curve skeleton that one far from it costs."""

SHORT = 0.3
"""Share of the smaller radius up to which a link counts as short: the distance of the nodes in the
end. In a thick body centers are many spacings apart; a path through it must not cost more than one
along thin balls below its surface."""

OVERLAP_ONLY, APART = 10.0, 1000.0
"""Factors of the cost where a center lies outside the other ball, and where the balls are apart:
last resorts that keep the graph in one piece."""


@dataclass(frozen=True, eq=False)
class BallLinks:
    """Balls and the links between them; row i of any array belongs to ball i.

    Attributes
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    offsets : (k + 1,) int64
        Links of ball i are numbers offsets[i] to offsets[i + 1]; each is listed from both ends.
    neighbours : (l,) int32
        The other end.
    length : (l,) float64
        Distance of the centers.
    cost : (l,) float64
        What a path along the link costs: low near the curve skeleton.
    spacing : float
        Typical distance of neighbouring balls.
    widths : (k,) float64
        Half the width of the shape across each ball; inf where it is not known.
    """

    centers: FloatArray
    radii: FloatArray
    offsets: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    length: FloatArray
    cost: FloatArray
    spacing: float
    widths: FloatArray

    def __len__(self) -> int:
        return len(self.radii)


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
    from medialis.curves.graph._kernels import list_links, sort_links, weigh_links

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
    length, cost = np.empty(len(neighbours)), np.empty(len(neighbours))
    density = 1 / (1 / OFF_CURVE + closeness)

    def weigh(begin: int, end: int) -> None:
        weigh_links(
            begin, end, offsets, neighbours, centers, radii, density, spacing, SHORT, OVERLAP_ONLY,
            APART, length, cost,
        )  # fmt: skip

    run_chunks(weigh, k, BALLS_A_CHUNK)
    length.flags.writeable = cost.flags.writeable = False
    every = np.full(k, np.inf) if widths is None else widths
    return BallLinks(centers, radii, offsets, neighbours, length, cost, spacing, every)


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
        k, self.links = len(links), links
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
        from medialis.curves.graph._kernels import spread_from_tree

        room = len(self.links.neighbours) + len(balls)
        spread_from_tree(
            np.array(balls, np.int32), self.links.offsets, self.links.neighbours,
            self.links.length, self.links.cost, np.empty(room), np.empty(room, np.int32),
            self.spent, self.parent, self.path, self.base,
        )  # fmt: skip

    def join(self, ball: int) -> list[int]:
        """Take the cheapest path of a ball into the list of edges; return its new balls."""
        path = follow(self.parent, ball)
        self.edges.append(pairs(path[:-1], path[1:]))
        return path[:-1]


def pairs(a: ArrayLike, b: ArrayLike) -> NDArray[np.int64]:
    """Return edges between two equally long lists of balls, (e, 2)."""
    return np.stack([np.asarray(a, np.int64), np.asarray(b, np.int64)], axis=1)
