"""Growing a graph along linked balls: loops first, then branch after branch (thesis 3.6.3).

Every branch is the cheapest path from a candidate to the graph so far, so it runs along the curve
skeleton where there is one, crosses gaps along the surface skeleton, and joins the graph where it
comes near it. One loop is closed for each handle, by the cheapest link that goes round it. So the
graph has one component by construction, and no loop more than were asked for.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.curves.graph.handles import Handles, extra_turns
from medialis.model.polylines import follow
from medialis.model.ragged import Ragged
from medialis.progress import Progress
from medialis.validation import FloatArray

STICKS_OUT = 0.5
"""Share of the radius at the start of a branch by which the ball at its end reaches out of it."""

APART = 0.85
"""Share of the larger radius by which the centers are apart: else the balls are nearly one."""

SHORTEST = 3.0
"""Spacings: shorter branches are steps between neighbouring balls."""

LARGE, KEPT_BRANCHES = 0.25, 4
"""Share of all balls from which on a component counts as large, and branches of it that are kept:
the first ones, whose search visits nearly all its balls."""

MOST_CLOSING, LINKS_AT_ONCE = 1 << 20, 256
PRIME = 1_000_003
"""Turns are compared modulo this prime; they are far smaller."""


class Growth:
    """A graph on linked balls that grows by cheapest paths.

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

    def copy(self) -> Growth:
        """Return the same graph, to grow on by itself."""
        other = Growth(self.links)
        other.edges = list(self.edges)
        for name in ("spent", "path", "parent", "base"):
            getattr(other, name)[:] = getattr(self, name)
        return other

    def add(self, balls: list[int]) -> None:
        """Make balls nodes of the graph, and find the paths of the others to it anew."""
        from medialis.curves.graph._growth_kernels import spread_from_tree

        room = len(self.links.neighbours) + len(balls)
        spread_from_tree(
            np.array(balls, np.int32), self.links.offsets, self.links.neighbours,
            self.links.length, self.links.cost, np.empty(room), np.empty(room, np.int32),
            self.spent, self.parent, self.path, self.base,
        )  # fmt: skip

    def join(self, ball: int) -> list[int]:
        """Take the cheapest path of a ball into the list of edges; return its new balls."""
        path = follow(self.parent, ball)
        self.edges.append(_pairs(path[:-1], path[1:]))
        return path[:-1]

    def close_loops(
        self,
        theta: FloatArray,
        extra: tuple[NDArray[np.int64], NDArray[np.int64]],
        rows: NDArray[np.int64],
        most: int,
    ) -> NDArray[np.int64]:
        """Close up to `most` loops round handles, cheapest first.

        Parameters
        ----------
        theta : (k, c) float64
            Angles of `Handles.angles`.
        extra : (l,) int64, (q, c) int64
            Turns of links, `extra_turns`.
        rows : (r,) int
            Balls of the component.
        most : int

        Returns
        -------
        (l, c) int64
            How often each loop goes round each handle, up to sums of loops: independent rows.
        """
        from medialis.curves.graph._growth_kernels import count_turns, find_closing_links

        turns, anchor = np.zeros(theta.shape, np.int64), np.full(len(theta), -1, np.int64)
        starts = np.repeat(np.arange(len(self.links)), np.diff(self.links.offsets))
        known = np.zeros((0, theta.shape[1]), np.int64)
        closing = np.empty(MOST_CLOSING, np.int64)
        for _ in range(most):
            order = rows[np.argsort(self.spent[rows], kind="stable")]
            count_turns(
                order, self.parent, self.links.radii, self.links.offsets, self.links.neighbours,
                self.links.length, theta, *extra, turns, anchor,
            )  # fmt: skip
            count = find_closing_links(
                rows, self.links.radii, self.links.offsets, self.links.neighbours,
                self.links.length, self.spent, theta, *extra, turns, anchor, closing,
            )  # fmt: skip
            link = closing[: min(count, len(closing))]
            a, b = starts[link], self.links.neighbours[link]
            spent = self.spent[a] + self.links.cost[link] + self.spent[b]
            cheapest = link[np.argsort(spent, kind="stable")]
            for few in np.split(cheapest, np.arange(LINKS_AT_ONCE, len(link), LINKS_AT_ONCE)):
                a, b = starts[few], self.links.neighbours[few]
                turn = turns[a] - turns[b] + np.rint(theta[b] - theta[a]).astype(np.int64)
                more = extra[0][few] >= 0
                turn[more] += extra[1][extra[0][few[more]]]
                turn %= PRIME
                new = np.flatnonzero(_reduce(turn, known).any(axis=1))
                if len(new):
                    break
            else:
                break
            best = int(new[0])
            known = _extend(known, turn[best])
            # Both may run side by side, as through the stem of an eyelet: one stretch for both.
            first, second = self.join(int(a[best])), follow(self.parent, int(b[best]))
            second = self._apart(second, [*first, int(self.base[a[best]])])
            self.edges += [_pairs(second[:-1], second[1:]), _pairs(a[[best]], b[[best]])]
            self.add([*first, *second])
        return known

    def _apart(self, path: list[int], other: list[int]) -> list[int]:
        """Cut the end of a path off where it runs in the balls of another; it then ends on that."""
        from scipy.spatial import cKDTree

        centers, radii = self.links.centers, self.links.radii
        gap, place = cKDTree(centers[other]).query(centers[path])
        beside = np.asarray(other)[place]
        alone = np.flatnonzero(gap >= np.minimum(radii[path], radii[beside]))
        last = alone[-1] + 1 if len(alone) else len(path)
        if last >= len(path):
            return path
        return [*path[:last], *dict.fromkeys([path[last], int(beside[last])])]

    def next_tip(self, candidates: NDArray[np.int64]) -> int | None:
        """Return the candidate that sticks out of the graph most; None when there is none."""
        radii = self.links.radii
        # Short ways go first: in the end nearly all are, and a noisy shape takes a thousand turns.
        far = self.path[candidates] >= SHORTEST * self.links.spacing
        reached = candidates[far & (self.base[candidates] >= 0)]
        base = self.base[reached]
        gap = np.linalg.norm(self.links.centers[reached] - self.links.centers[base], axis=1)
        distance = np.maximum(gap, self.path[reached] / 2)
        out = sticks_out(distance, radii[reached], radii[base], self.links.widths[reached])
        if not out.any():
            return None
        beyond = np.where(out, self.path[reached] + radii[reached] - radii[base], -np.inf)
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


Turns = dict[int, NDArray[np.int64]]

Keep = Callable[[tuple[int, ...], Callable[[], Any]], Any]
"""Returns what a function computes, or what it returned before for the same numbers."""


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
        Turns of the loops that were closed (`Growth.close_loops`), by the number of the component,
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
        large, turn = len(balls[number]) >= LARGE * len(links), 0
        while (tip := graph.next_tip(wanted[number])) is not None:
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
    edges = np.sort(np.concatenate([joined, _pairs(alone, alone)]), axis=1)
    return np.unique(edges, axis=0), loops


def _rooted(
    links: BallLinks,
    balls: Mapping[int, NDArray[np.int64]],
    roots: Mapping[int, int],
    handles: Mapping[int, Handles],
) -> tuple[Growth, Turns]:
    """Start a graph in each component: its root, and the loops round its handles."""
    graph, loops = Growth(links), {}
    graph.add(list(roots.values()))
    for number in handles.keys() & roots.keys():
        one = handles[number]
        loops[number] = np.zeros((0, len(one.loops)), np.int64)
        if one.loops:
            theta = one.angles(links.centers, balls[number])
            extra = extra_turns(links, one, theta, balls[number])
            loops[number] = graph.close_loops(theta, extra, balls[number], one.genus)
    return graph, loops


def _branched(graph: Growth, tip: int) -> Growth:
    """Return a copy of a graph with one more branch."""
    copy = graph.copy()
    copy.add(copy.join(tip))
    return copy


def _pairs(a: ArrayLike, b: ArrayLike) -> NDArray[np.int64]:
    return np.stack([np.asarray(a, np.int64), np.asarray(b, np.int64)], axis=1)


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
