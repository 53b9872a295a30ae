"""Growing a graph along linked balls, pruning and smoothing it (thesis 3.6.3).

Growth: loops first, then branch after branch. Every branch is the cheapest path from a candidate to
the graph so far, so it runs along the curve skeleton where there is one, crosses gaps along the
surface skeleton, and joins the graph where it comes near it. One loop is closed for each handle, by
the cheapest link that goes round it. So the graph has one component by construction, and no loop
more than were asked for.

Pruning: a spur does not stick out of the ball at its start. A branch beside another one ends at a
ball that lies on the way of a thicker limb, or on a loop: more of the surface hangs on that ball
than on the whole branch, by more than importance is estimated too large.

Finishing: the nodes of a grown graph are balls, so it zigzags from sample to sample. Close
junctions become one, branches are sampled evenly (by their radius) and smoothed. A node moves
within the ball that it comes from, so it stays inside the shape; edges are shorter than the radii
at their ends.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Ragged, places_along
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, as_field, as_number, as_points
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.graph.ground import BallLinks, GraphTree, link_balls, pairs
from medialis.curves.graph.loops import Handles, close_loops, link_turns

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


STEP, SHORTEST_STEP = 0.3, 0.25
"""Distance of nodes: share of the radius, at least a share of the sample spacing."""

PINNED = 1e6
"""Weight of free ends in smoothing."""

ROOM = 0.7
"""Share of the room inside its ball that smoothing may use."""


def finish_graph(
    links: BallLinks,
    edges: NDArray[np.int64],
    smoothing: float,
    importance: FloatArray | None = None,
    areas: FloatArray | None = None,
) -> tuple[CurveSkeleton, NDArray[np.int64]]:
    """Prune spurs, merge close junctions, sample and smooth the branches of a grown graph.

    Parameters
    ----------
    links : BallLinks
        k balls.
    edges : (e, 2) int
        Of `grow_graph`.
    smoothing : float
        As in `medialis.curve_skeleton`.
    importance, areas : (k,) float64, optional
        Area that hangs on each ball, and of its sample: for `prune`.

    Returns
    -------
    CurveSkeleton
        Its radii are those of balls round the nodes that lie in the given balls.
    (k,) int64
        Node nearest to each ball along the links; -1 where none leads to the graph.
    """
    balls, inverse = np.unique(edges, return_inverse=True)
    ends = inverse.reshape(-1, 2)
    ends = ends[ends[:, 0] != ends[:, 1]]
    raw = CurveSkeleton.of(links.centers[balls], ends, links.radii[balls])
    stays, nearest = prune(links, raw, balls, importance, areas)
    raw, balls = raw.subset(stays), balls[stays]
    merged, into = merge_junctions(raw, raw.radii)
    sampled, node_of = sample_branches(merged, links.spacing)
    nodes = smooth_nodes(sampled.nodes, sampled.edges, sampled.radii, smoothing)
    node_of_ball = np.full(len(links) + 1, -1, np.int64)  # one more row: no ball
    node_of_ball[balls] = node_of[into]
    moved = np.linalg.norm(nodes - sampled.nodes, axis=1)
    radii = np.maximum(sampled.radii - moved, 0.0)
    return CurveSkeleton.of(nodes, sampled.edges, radii), node_of_ball[nearest]


def merge_junctions(
    graph: CurveSkeleton, strength: FloatArray
) -> tuple[CurveSkeleton, NDArray[np.int64]]:
    """Contract short branches between junctions, shortest first.

    Parameters
    ----------
    graph : CurveSkeleton
        v nodes, whose radii are those of balls inside the shape.
    strength : (v,) float64
        Of the nodes that become one, the strongest gives the position.

    Returns
    -------
    CurveSkeleton
        With the same components and loops.
    (v,) int64
        What became of each given node.
    """
    into = np.arange(len(graph.nodes))
    while True:
        for branch in _short_bridges(graph):
            members = graph.branches[branch]
            kept = int(members[np.nan_to_num(strength[members], nan=-np.inf).argmax()])
            name = np.arange(len(graph.nodes))
            name[members] = kept
            edges = np.sort(name[graph.edges], axis=1)
            edges = edges[edges[:, 0] != edges[:, 1]]
            # Else two edges, a loop, become one, or a second way between the ends is lost.
            lost = len(graph.edges) - len(edges) - (len(members) - 1)
            if lost == 0 and len(np.unique(edges, axis=0)) == len(edges):
                break
        else:
            return graph, into
        # Nodes that are gone are left out; the others keep their order.
        stays = name == np.arange(len(name))
        number = np.cumsum(stays) - 1
        into = number[name[into]]
        strength = strength[stays]
        graph = CurveSkeleton.of(graph.nodes[stays], number[edges], graph.radii[stays])


def _short_bridges(graph: CurveSkeleton) -> list[int]:
    """Branches that join two junctions within one ball, shortest first.

    Limbs of an X meet in one place, but samples make two of it; and a limb that starts deep inside
    the trunk hangs on the trunk, not on another limb.
    """
    ends = np.array([(row[0], row[-1]) for row in graph.branches], np.int64).reshape(-1, 2)
    between = (graph.degrees[ends] >= 3).all(axis=1) & (ends[:, 0] != ends[:, 1])
    longest = APART * graph.radii[ends].max(axis=1)
    direct = np.array([len(row) == 2 for row in graph.branches], bool)  # no ball lies between
    longest[direct] = np.maximum(longest, graph.radii[ends].min(axis=1))[direct]
    usable = np.flatnonzero(between & (graph.branch_lengths < longest))
    order = np.argsort(graph.branch_lengths[usable], kind="stable")
    return usable[order].tolist()


def sample_branches(
    graph: CurveSkeleton, spacing: float
) -> tuple[CurveSkeleton, NDArray[np.int64]]:
    """Place nodes evenly along each branch; junctions, ends and single nodes stay.

    Parameters
    ----------
    graph : CurveSkeleton
        Nodes are centers of balls inside the shape, edges lie inside it.
    spacing : float
        Of the surface samples.

    Returns
    -------
    CurveSkeleton
        Its radii tell how far each node may move and stay in the balls that it comes from.
    (v,) int64
        Nearest new node, along its branch, of each node of the graph.
    """
    fixed = np.flatnonzero(graph.degrees != 2)
    node_of = np.full(len(graph.nodes), -1, np.int64)
    node_of[fixed] = np.arange(len(fixed))
    nodes, room = [graph.nodes[fixed]], [graph.radii[fixed]]
    edges: list[NDArray[np.int64]] = []
    count = len(fixed)
    taken: set[tuple[int, int]] = set()
    for row in graph.branches:
        closed = row[0] == row[-1]
        ends = (int(min(row[0], row[-1])), int(max(row[0], row[-1])))
        least = 3 if closed else 2 if ends in taken else 1
        taken.add(ends)
        if node_of[row[0]] < 0:  # a ring: one of its nodes becomes fixed
            node_of[row[0]] = count
            nodes.append(graph.nodes[row[:1]])
            room.append(graph.radii[row[:1]])
            count += 1
        place, points, free, nearest = _sample(graph, row, spacing, least)
        inner = np.arange(count, count + len(place) - 2)
        names = np.concatenate([[node_of[row[0]]], inner, [node_of[row[-1]]]])
        node_of[row[1:-1]] = names[nearest[1:-1]]
        nodes.append(points[1:-1])
        room.append(free[1:-1])
        edges.append(np.stack([names[:-1], names[1:]], axis=1))
        count += len(inner)
    joined = np.concatenate(edges) if edges else np.empty((0, 2))
    return CurveSkeleton.of(np.concatenate(nodes), joined, np.concatenate(room)), node_of


def _sample(
    graph: CurveSkeleton, row: NDArray[np.int32], spacing: float, least: int
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int64]]:
    """Even places along one branch: arc length, position, room; nearest place of each node."""
    points, radii = graph.nodes[row], graph.radii[row]
    along, length = places_along(points), np.linalg.norm(np.diff(points, axis=0), axis=1)
    # Even in the measure ds / step, with the step of the thinner end of each piece.
    step = np.maximum(STEP * np.minimum(radii[:-1], radii[1:]), SHORTEST_STEP * spacing)
    measure = np.concatenate([[0], np.cumsum(length / step)])
    count = max(least, int(np.ceil(measure[-1])))
    rising = measure + 1e-12 * (1 + measure[-1]) * np.arange(len(measure))  # pieces of no length
    wanted = np.linspace(0, rising[-1], count + 1)
    place = np.interp(wanted, rising, along)
    piece = np.clip(np.searchsorted(rising, wanted, side="right") - 1, 0, len(length) - 1)
    share = (wanted - rising[piece]) / (rising[piece + 1] - rising[piece])
    sampled = points[piece] + share[:, None] * (points[piece + 1] - points[piece])
    # In one of the balls at the ends of its piece: the larger distance to their surfaces.
    before, behind = share * length[piece], (1 - share) * length[piece]
    free = np.maximum(radii[piece] - before, radii[piece + 1] - behind)
    middle = (place[1:] + place[:-1]) / 2
    return place, sampled, np.maximum(free, 0), np.searchsorted(middle, along)


def smooth_nodes(
    nodes: FloatArray, edges: NDArray[np.int32], room: FloatArray, strength: float
) -> FloatArray:
    """Smooth branches like splines: bends shorter than the radius go, longer ones stay.

    Minimizes the integral of ``|x - x0|^2 + (s r)^4 |x''|^2`` along the branches, x0 the given
    nodes, r the room and s the strength. A bend of wave number k keeps 1 / (1 + (s r k)^4) of its
    height. Free ends stay: a spline would shoot over them. Junctions move with their neighbours.

    Parameters
    ----------
    nodes : (v, 3) float64
    edges : (e, 2) int32
    room : (v,) float64
        Radius of the ball in which a node may move.
    strength : float
        0 changes nothing.

    Returns
    -------
    (v, 3) float64
    """
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import spsolve

    v = len(nodes)
    if strength == 0 or len(edges) == 0:
        return np.array(nodes)
    length = np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)
    tiny = 1e-9 * max(float(room.max()), float(length.max()), 1e-300)
    length = np.maximum(length, tiny)
    mass = np.bincount(edges.ravel(), np.repeat(length, 2), minlength=v) / 2
    ends = np.concatenate([edges, edges[:, ::-1]])
    order = np.argsort(ends[:, 0], kind="stable")
    degree = np.bincount(ends[:, 0], minlength=v)
    inner = np.flatnonzero(degree == 2)
    first = (np.cumsum(degree) - degree)[inner]
    a, b = ends[order[first], 1], ends[order[first + 1], 1]
    e = len(edges)
    ha, hb = length[order[first] % e], length[order[first + 1] % e]
    # x'' = 2 (x_a / ha + x_b / hb) / (ha + hb) - 2 x / (ha hb)
    scale = np.sqrt(mass[inner]) * (strength * room[inner]) ** 2
    line = np.arange(len(inner))
    rows = np.concatenate([line, line, line])
    values = np.concatenate(
        [2 * scale / (ha * (ha + hb)), 2 * scale / (hb * (ha + hb)), -2 * scale / (ha * hb)]
    )
    bend = coo_array(
        (values, (rows, np.concatenate([a, b, inner]))), shape=(max(1, len(inner)), v)
    ).tocsr()
    mass = np.maximum(mass, tiny)
    mass[degree == 1] *= PINNED
    moved = spsolve((diags_array(mass) + bend.T @ bend).tocsc(), mass[:, None] * nodes)
    shift = np.asarray(moved).reshape(v, 3) - nodes
    size = np.linalg.norm(shift, axis=1)
    allowed = np.divide(ROOM * room, size, out=np.ones(v), where=size > ROOM * room)
    return np.asarray(nodes + allowed[:, None] * shift)


def point_graph(
    points: ArrayLike,
    radii: ArrayLike,
    *,
    strength: ArrayLike | None = None,
    neighbours: int = 10,
    smoothing: float = 0.7,
    handles: Mapping[int, Handles] | None = None,
) -> CurveSkeleton:
    """Build the graph of a curve skeleton from points on it, by the same steps as for a mesh.

    Parameters
    ----------
    points : (k, 3) float
        Points on the curve skeleton, with noise.
    radii : (k,) float
        Radius of the ball round each point that lies in the shape. Points are linked when each
        lies in the other's ball, so that the graph stays inside the shape.
    strength : (k,) float, optional
        Above 0: how sure each point is. Branches prefer the sure ones. All the same when missing.
    neighbours : int
        Nearest points that each point is linked to.
    smoothing : float
        As in `medialis.curve_skeleton`.
    handles : dict, optional
        Loops to close: ``find_handles(shape)``, where points hang together in the same pieces as
        the shape. Without it the graph is a forest.

    Returns
    -------
    CurveSkeleton
        One component for each piece of points that links hold together.

    Raises
    ------
    InvalidShapeError
        When the points and radii do not fit together.
    InvalidOptionError
        When an option is out of its range.

    See Also
    --------
    curve_skeleton : of a mesh.
    view_curve_skeleton : from pictures.

    Notes
    -----
    Source: thesis 3.6.3 for the aim; see `growth.py` for the method.

    Examples
    --------
    >>> import medialis
    >>> line = np.linspace([0, 0, 0], [10, 0, 0], 200)
    >>> graph = medialis.point_graph(line, np.ones(200))
    >>> graph.branch_count, graph.end_points.size, round(graph.length, 6)
    (1, 2, 10.0)
    """
    from medialis.base.box_tree import nearest_others

    smoothing = as_number(smoothing, "smoothing", low=0.0, high=10.0)
    centers = as_points(points)
    radius = as_field(radii, len(centers), "radii")
    sure = (
        np.ones(len(centers)) if strength is None else as_field(strength, len(centers), "strength")
    )
    size = float(np.linalg.norm(np.ptp(centers, axis=0)))
    near, distance = nearest_others(centers, neighbours)
    spacing = float(np.median(distance[:, 0])) if distance.size else 0.0
    spacing = max(spacing, 1e-9 * size, 1e-300)
    closeness = np.clip(sure / max(float(np.median(sure)), 1e-300), 0.0, 1.0)
    every = np.arange(len(centers))
    links = link_balls(centers, radius, closeness, [(every, near)], [], spacing=spacing)
    # Of equally sure points the thickest one comes first.
    first = sure + 1e-9 * radius / max(float(radius.max()), 1e-300) * max(float(sure.max()), 1e-300)
    pieces = _pieces(links.offsets, links.neighbours)
    edges, _ = grow_graph(links, pieces, first, np.ones(len(centers), bool), handles)
    return finish_graph(links, edges, smoothing)[0]


def _pieces(offsets: NDArray[np.int64], neighbours: NDArray[np.int32]) -> NDArray[np.int32]:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    k = len(offsets) - 1
    ones = np.ones(len(neighbours), np.int8)
    graph = csr_array((ones, neighbours, offsets), shape=(k, k))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)
