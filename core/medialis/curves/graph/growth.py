"""Growing a graph along linked balls: loops first, then branch after branch (thesis 3.6.3).

Every branch is the cheapest way from a candidate to the graph so far, so it runs along the curve
skeleton where there is one, crosses gaps along the surface skeleton, and joins the graph where it
comes near it. One loop is closed for each handle, by the cheapest link that goes round it. So the
graph has one component, and as many independent loops as were asked for, by construction.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from medialis.curves.graph.handles import Handles
from medialis.curves.graph.links import BallLinks
from medialis.validation import FloatArray

STICKS_OUT = 0.5
"""Share of the radius at the start of a branch by which the ball at its end reaches out of it."""

APART = 0.85
"""Share of the larger radius by which the centers are apart: else the balls are nearly one."""

SHORTEST = 3.0
"""Spacings: shorter branches are steps between neighbouring balls."""

MOST_CLOSING = 1 << 20
PRIME = 1_000_003
"""Turns are compared modulo this prime; they are far smaller."""


class Growth:
    """A graph on linked balls that grows by cheapest ways.

    Parameters
    ----------
    links : BallLinks
        k balls.
    spacing : float
        Typical distance of neighbouring balls.

    Attributes
    ----------
    edges : list of (int, int)
        Of the graph so far, between balls.
    nodes : list of int
        Balls of the graph so far.
    way : (k,) float64
        Length of the cheapest way of each ball to the graph; inf where there is none.
    base : (k,) int32
        Ball of the graph in which that way ends; -1 where there is none.
    """

    def __init__(self, links: BallLinks, spacing: float) -> None:
        k = len(links)
        self.links, self.spacing = links, spacing
        self.edges: list[tuple[int, int]] = []
        self.nodes: list[int] = []
        self.reach, self.way = np.full(k, np.inf), np.full(k, np.inf)
        self.parent, self.base = np.full(k, -1, np.int32), np.full(k, -1, np.int32)
        self._heap = (
            np.empty(len(links.neighbours) + k),
            np.empty(len(links.neighbours) + k, np.int32),
        )

    def add(self, balls: list[int]) -> None:
        """Make balls nodes of the graph, and find the ways of all others to it anew."""
        from medialis.curves.graph._growth_kernels import spread_from_tree

        self.nodes += balls
        spread_from_tree(
            np.array(balls, np.int32), self.links.offsets, self.links.neighbours,
            self.links.length, self.links.cost, *self._heap, self.reach, self.parent, self.way,
            self.base,
        )  # fmt: skip

    def way_of(self, ball: int) -> list[int]:
        """Balls from one to the graph along the cheapest way, both ends included."""
        way = [ball]
        while self.parent[way[-1]] >= 0:
            way.append(int(self.parent[way[-1]]))
        return way

    def join(self, ball: int) -> list[int]:
        """Take the cheapest way of a ball into the list of edges; return its new balls."""
        way = self.way_of(ball)
        self.edges += list(itertools.pairwise(way))
        return way[:-1]

    def close_loops(self, theta: FloatArray, rows: NDArray[np.int64], most: int) -> int:
        """Close up to `most` loops round handles, cheapest first; return how many there are.

        Parameters
        ----------
        theta : (k, c) float64
            Angles of `Handles.angles`.
        rows : (r,) int
            Balls of the component.
        most : int
        """
        from medialis.curves.graph._growth_kernels import count_turns, find_closing_links

        turns = np.zeros(theta.shape, np.int32)
        starts = np.repeat(np.arange(len(self.links)), np.diff(self.links.offsets))
        known = np.zeros((0, theta.shape[1]), np.int64)
        found = np.empty(MOST_CLOSING, np.int64)
        for closed in range(most):
            order = rows[np.argsort(self.reach[rows], kind="stable")]
            count_turns(order, self.parent, theta, turns)
            count = find_closing_links(
                rows, self.links.radii, self.links.offsets, self.links.neighbours,
                self.links.length, self.reach, theta, turns, found,
            )  # fmt: skip
            at = found[: min(count, len(found))]
            a, b = starts[at], self.links.neighbours[at]
            turn = (turns[a] - turns[b] + np.rint(theta[b] - theta[a]).astype(np.int64)) % PRIME
            new = _reduce(turn, known).any(axis=1)
            if not new.any():
                return closed
            at, a, b, turn = at[new], a[new], b[new], turn[new]
            best = int((self.reach[a] + self.links.cost[at] + self.reach[b]).argmin())
            known = _extend(known, turn[best])
            # Both ways may end in a common stretch, which is taken once.
            first = self.join(int(a[best]))
            taken = set(first)
            second = [ball for ball in self.way_of(int(b[best]))[:-1] if ball not in taken]
            self.edges += [(ball, int(self.parent[ball])) for ball in second]
            self.edges.append((int(a[best]), int(b[best])))
            self.add([*first, *second])
        return most

    def grow_branches(self, candidates: NDArray[np.int64]) -> None:
        """Join candidates that stick out of the graph, the one that sticks out most first."""
        if len(candidates) == 0:
            return
        radii = self.links.radii
        while True:
            reached = candidates[self.base[candidates] >= 0]
            base = self.base[reached]
            gap = np.linalg.norm(self.links.centers[reached] - self.links.centers[base], axis=1)
            out = sticks_out(np.maximum(gap, self.way[reached] / 2), radii[reached], radii[base])
            out &= self.way[reached] >= SHORTEST * self.spacing
            if not out.any():
                return
            beyond = np.where(out, self.way[reached] + radii[reached] - radii[base], -np.inf)
            self.add(self.join(int(reached[beyond.argmax()])))


def sticks_out(reach: FloatArray, tip: FloatArray, base: FloatArray) -> NDArray[np.bool_]:
    """Tell branches from spurs.

    The ball at the end of a branch reaches out of the ball where it starts by half a radius, and
    neither center lies deep in the other ball.

    Parameters
    ----------
    reach : (b,) float64
        Distance of the ends.
    tip, base : (b,) float64
        Radius at the free end and at the other one.
    """
    out = reach + tip > (1 + STICKS_OUT) * base
    return np.asarray(out & (reach > APART * np.maximum(tip, base)))


def grow_graph(
    links: BallLinks,
    components: NDArray[np.int32],
    strength: FloatArray,
    candidates: NDArray[np.bool_],
    *,
    spacing: float,
    handles: Mapping[int, Handles] | None = None,
) -> tuple[NDArray[np.int64], dict[int, int]]:
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
    spacing : float
        Typical distance of neighbouring balls.
    handles : dict, optional
        Loops to close, by component.

    Returns
    -------
    (e, 2) int64
        Edges between balls, each once; a row (i, i) is a graph of ball i alone.
    dict
        Loops closed, by the number of the component, where handles were given.
    """
    graph = Growth(links, spacing)
    alone, loops = [], {}
    for number in np.unique(components[components >= 0]).tolist():
        rows = np.flatnonzero(components == number)
        wanted = rows[candidates[rows]]
        # Where no candidate is kept the measure is noise: the middle of the thickest place stays.
        pool, worth = (wanted, strength) if len(wanted) else (rows, links.radii)
        root = int(pool[np.nan_to_num(worth[pool], nan=-np.inf).argmax()])
        before = len(graph.edges)
        graph.add([root])
        found = (handles or {}).get(number)
        if found is not None:
            theta = found.angles(links.centers, rows if found.genus else rows[:0])
            loops[number] = graph.close_loops(theta, rows, found.genus)
        graph.grow_branches(wanted)
        if len(graph.edges) == before:
            alone.append((root, root))
    edges = np.sort(np.array([*graph.edges, *alone], np.int64).reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0), loops


def _reduce(rows: NDArray[np.int64], known: NDArray[np.int64]) -> NDArray[np.int64]:
    """Remainders of rows after elimination by known ones (each with a leading 1), modulo PRIME."""
    rows = rows.copy()
    for basis in known:
        lead = int((basis != 0).argmax())
        rows = (rows - rows[:, lead, None] * basis) % PRIME
    return rows


def _extend(known: NDArray[np.int64], row: NDArray[np.int64]) -> NDArray[np.int64]:
    rest = _reduce(row[None], known)[0]
    lead = int(rest[(rest != 0).argmax()])
    return np.vstack([known, rest * pow(lead, -1, PRIME) % PRIME])
