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
from numpy.typing import NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.curves.graph.handles import Handles
from medialis.curves.graph.loops import close_loops, link_turns
from medialis.curves.graph.tree import GraphTree, pairs
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
        large, turn = len(balls[number]) >= LARGE * len(links), 0
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
    edges = np.sort(np.concatenate([joined, pairs(alone, alone)]), axis=1)
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
    far = graph.path[candidates] >= SHORTEST * graph.links.spacing
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
