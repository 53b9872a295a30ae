"""Branches of a grown graph that are no limbs (thesis 3.6.3).

A spur does not stick out of the ball at its start. A branch beside another one ends at a ball that
lies on the way of a thicker limb, or on a loop: more of the surface hangs on that ball than on the
whole branch, by more than importance is estimated too large.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.curves.graph.growth import sticks_out
from medialis.curves.graph.tree import GraphTree
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.validation import FloatArray


def prune(
    links: BallLinks,
    graph: CurveSkeleton,
    balls: NDArray[np.int64],
    importance: FloatArray | None = None,
    areas: FloatArray | None = None,
) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
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
    (k,) int32
        The ball of the graph that stays which is nearest to each ball along the links; -1 for none.
    """
    stays = np.ones(len(balls), bool)
    while True:
        rows = np.flatnonzero(stays)
        rows = rows[prune_spurs(graph.subset(stays), links.widths[balls[rows]])]
        stays = np.isin(np.arange(len(balls)), rows)
        nearest = _nearest_on_graph(links, balls[rows])
        if importance is None or areas is None:
            return stays, nearest
        area = np.bincount(nearest[nearest >= 0], areas[nearest >= 0], len(links))
        beside = _beside(graph.subset(stays), links.radii, balls[rows], importance, area)
        if not beside.any():
            return stays, nearest
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
    radii: FloatArray,
    balls: NDArray[np.int64],
    importance: FloatArray,
    area: NDArray[Any],
) -> NDArray[np.bool_]:
    """Nodes of limbs on whose end more hangs than on the limb: on the samples next to its nodes.

    Balls and their area are numbered among all.
    """
    beside = np.zeros(len(balls), bool)
    for _, row in _limbs(graph):
        tip = balls[row[-1]]
        hangs = importance[tip] / overestimate(importance[tip], radii[tip])
        if hangs > area[balls[row[1:]]].sum():
            beside[row[1:]] = True
    return beside


def overestimate(importance: float, radius: float) -> float:
    """Return how many times too large the importance of the end of a limb is estimated.

    It is that of half a spheroid, of radius a across and c along, of which the half perimeter p is
    measured: c is taken as 2 p / pi - a. That is right for balls; for flat ends p tends to 2 c, not
    to pi c / 2, so that importance is up to (4 / pi)^2 times too large.
    """
    long = np.geomspace(1.0, 1e4, 400)  # true c, for a = 1
    perimeter = np.pi / 2 * (3 * (1 + long) - np.sqrt((3 + long) * (1 + 3 * long)))  # Ramanujan
    taken, true = (_half_spheroid(c) for c in (2 * perimeter / np.pi - 1, long))
    size = importance / max(np.pi * radius**2, 1e-300)
    return float(np.interp(size, taken, taken / true))


def _half_spheroid(long: FloatArray) -> FloatArray:
    """Area of half an oblate spheroid of radii 1 and c, in units of pi."""
    flat = np.sqrt(np.maximum(1 - 1 / long**2, 0.0))
    stretch = np.where(flat > 1e-4, np.arctanh(flat) / np.maximum(flat, 1e-4), 1.0)
    return np.asarray(long**2 + stretch)


def _nearest_on_graph(links: BallLinks, balls: NDArray[np.int64]) -> NDArray[np.int32]:
    growth = GraphTree(replace(links, cost=links.length))
    growth.add(balls.tolist())
    return growth.base
