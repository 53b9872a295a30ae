"""Branches of a grown graph that are no limbs (thesis 3.6.3).

A spur does not stick out of the ball at its start. A branch beside another one ends at a ball that
lies on the way of a thicker limb, or on a loop: more of the surface hangs on that ball than on the
whole branch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.curves.graph.growth import sticks_out
from medialis.curves.graph.tree import GraphTree
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.validation import FloatArray

SURPLUS = 1.5
"""Times the area of the samples next to a branch that may hang on its end: importance is estimated
from half ellipsoids. Chosen by five real shapes, not derived: true ends had at most 0.4 (one 1.24),
branches beside limbs and on loops 1.02 to 10."""


def prune(
    links: BallLinks,
    graph: CurveSkeleton,
    balls: NDArray[np.int64],
    importance: FloatArray | None = None,
    areas: FloatArray | None = None,
) -> NDArray[np.bool_]:
    """Choose the nodes that stay when spurs and branches beside others go.

    Parameters
    ----------
    links : BallLinks
        k balls.
    graph : CurveSkeleton
        v nodes.
    balls : (v,) int
        The ball of each node.
    importance, areas : (k,) float64, optional
        Area that hangs on each ball, 0 where it is not known, and of its sample. Without them only
        spurs go.

    Returns
    -------
    (v,) bool
    """
    stays = np.ones(len(balls), bool)
    while True:
        rows = np.flatnonzero(stays)
        rows = rows[prune_spurs(graph.subset(stays), links.widths[balls[rows]])]
        stays = np.isin(np.arange(len(balls)), rows)
        if importance is None or areas is None:
            return stays
        beside = _beside(graph.subset(stays), links, balls[rows], importance, areas)
        if not beside.any():
            return stays
        stays[rows[beside]] = False


def prune_spurs(graph: CurveSkeleton, widths: FloatArray | None = None) -> NDArray[np.bool_]:
    """Choose the nodes that stay when spurs go: the shortest first, each seen in what is left.

    A spur is a branch with a free end that does not stick out of the ball at its other end
    (`sticks_out`, with the width at each node). A branch with two free ends stays.

    Returns
    -------
    (v,) bool
    """
    stays = np.ones(len(graph.nodes), bool)
    widths = np.full(len(stays), np.inf) if widths is None else widths
    while True:
        left, width, spurs = graph.subset(stays), widths[stays], []
        for branch, row in _limbs(left):
            base, tip = int(row[0]), row[-1]
            gap = np.linalg.norm(left.nodes[tip] - left.nodes[base])
            distance = np.maximum(gap, left.branch_lengths[branch] / 2)
            if not sticks_out(distance, left.radii[tip], left.radii[base], width[tip]):
                spurs.append((float(left.branch_lengths[branch]), branch, base))
        if not spurs:
            return stays
        _, branch, base = min(spurs)
        gone = left.branches[branch]
        stays[np.flatnonzero(stays)[gone[gone != base]]] = False


def _limbs(graph: CurveSkeleton) -> list[tuple[int, NDArray[np.int32]]]:
    """Branches with one free end: their number, and their nodes up to that end."""
    limbs = []
    for branch, row in enumerate(graph.branches):
        free = graph.degrees[row[[0, -1]]] == 1
        if free.sum() == 1:
            limbs.append((branch, row[::-1] if free[0] else row))
    return limbs


def _beside(
    graph: CurveSkeleton,
    links: BallLinks,
    balls: NDArray[np.int64],
    importance: FloatArray,
    areas: FloatArray,
) -> NDArray[np.bool_]:
    """Nodes of limbs on whose end more hangs than on the limb: on the samples next to its nodes."""
    nearest = nearest_on_graph(links, balls)
    area = np.bincount(nearest[nearest >= 0], areas[nearest >= 0], len(links))[balls]
    beside = np.zeros(len(balls), bool)
    for _, row in _limbs(graph):
        if importance[balls[row[-1]]] > SURPLUS * area[row[1:]].sum():
            beside[row[1:]] = True
    return beside


def nearest_on_graph(links: BallLinks, balls: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return the ball of a graph that is nearest to each ball along the links; -1 for none."""
    growth = GraphTree(replace(links, cost=links.length))
    growth.add(balls.tolist())
    return growth.base
