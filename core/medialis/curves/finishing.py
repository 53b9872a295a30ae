"""Finishing a grown graph: pruning, even nodes, smoothing, fewer nodes (thesis 3.6.3).

Pruning: a spur does not stick out of the ball at its start. A branch beside another one ends at a
ball that lies on the way of a thicker limb, or on a loop: more of the surface hangs on that ball
than on the whole branch, by more than importance is estimated too large. Sheets have places in
their middle that look like ends, here or there as the samples lie: a branch to one of them is wider
than long, leads where no candidates are, or ends where the sheet goes on.

Finishing: the nodes of a grown graph are balls, so it zigzags from sample to sample. Close
junctions become one, branches are sampled evenly (by their radius) and smoothed. A node moves
within the ball that it comes from, so it stays inside the shape; edges are shorter than the radii
at their ends.

`simplify_branches` leaves out nodes later; `point_graph` takes all steps for any points.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Index, Mask, kd_tree, places_along
from medialis.base.options import Options, algorithm, length
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray, as_field, as_number, as_points
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.growth import APART, GraphTree, Handles, grow_graph, link_balls, sticks_out
from medialis.shape.surface import piece_labels

if TYPE_CHECKING:
    from medialis.curves._kernels import BallLinks

STEP = 0.3  # halved 51 %, doubled 54 %
"""Distance of nodes: share of the radius."""

SHORTEST_STEP = 0.25  # halved 28 %, doubled 36 %
"""Distance of nodes at least: share of the sample spacing."""

END_WEIGHT = 1e6  # halved < 0.1 %, doubled < 0.1 %
"""Weight of free ends in smoothing: they stay."""

ROOM = 0.7  # halved 0.2 %, doubled < 0.1 %
"""Share of the room inside its ball that smoothing may use."""

NEAR_CANDIDATE = 0.5  # halved 100 %, doubled 61 %
"""Radii from a candidate up to which a branch is sure."""

LEAST_SURE = 0.2  # halved 61 %, doubled 100 %
"""Share of a limb that is sure at least. Of ends of eleven shapes that stay when these are noisy,
finer and coarser 1 of 318 has less, of those that go 8 of 29; with 0.1 none and 3, with 0.4 some 8
and 13."""

LARGEST_CAP = 30.0  # halved 0 %, doubled 0 %
"""Squares of half the width that hang on the end of a limb at most: half a ball is 6, a cap as long
as wide 13. Of ends of 23 shapes that stay 1 of 545 has more, of those that go 29 of 73; with 20 it
is 2 and 33, with 50 none and 22."""

INSIDE = 0.9
"""Share of its radius by which simplifying may move a branch away from a node."""


def prune(
    links: BallLinks,
    graph: CurveSkeleton,
    balls: Index,
    importance: FloatArray | None = None,
    areas: FloatArray | None = None,
    smallest: float = 0.0,
) -> tuple[Mask, IntArray]:
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
    smallest : float
        Area below which a limb goes: that of the samples next to it, outside the ball at its base.

    Returns
    -------
    (v,) bool
    (k,) int32
        The ball of the graph that stays which is nearest to each ball along the links; -1 for none.
    """
    stays = np.ones(len(balls), bool)
    growth, known = GraphTree(links._replace(cost=links.length)), np.zeros(len(balls), bool)
    while True:
        rows = np.flatnonzero(stays)
        rows = rows[prune_spurs(graph.subset(stays), links.widths[balls[rows]])]
        stays = np.isin(np.arange(len(balls)), rows)
        if known.any():
            growth.drop(balls[known & ~stays])
        else:
            growth.add(balls[rows].tolist())
        known, nearest = stays.copy(), growth.base
        if importance is None or areas is None:
            return stays, nearest
        area = np.bincount(nearest[nearest >= 0], areas[nearest >= 0], len(links.radii))
        left = graph.subset(stays)
        gone = _beside(left, links.radii, balls[rows], importance, area)
        if not gone.any():
            gone = _no_limbs(left, links, balls[rows], importance, area)
        if not gone.any():
            gone = _small(left, balls[rows], area, smallest)
        if not gone.any():
            return stays, nearest
        stays[rows[gone]] = False


def prune_spurs(graph: CurveSkeleton, widths: FloatArray | None = None) -> Mask:
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


def _limbs(graph: CurveSkeleton) -> Iterator[tuple[int, IntArray]]:
    """Yield branches with one free end: their number, and their nodes up to that end."""
    for branch, row in enumerate(graph.branches):
        free = graph.degrees[row[[0, -1]]] == 1
        if free.sum() == 1:
            yield branch, row[::-1] if free[0] else row


def _beside(
    graph: CurveSkeleton,
    radii: FloatArray,
    balls: Index,
    importance: FloatArray,
    area: NDArray[Any],
) -> Mask:
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


def _no_limbs(
    graph: CurveSkeleton,
    links: BallLinks,
    balls: Index,
    importance: FloatArray,
    area: NDArray[Any],
) -> Mask:
    """Nodes of branches that are no limbs, the shortest at each base; first those past an end.

    The end of a limb is a candidate, and so is most of the way there; others lead across a sheet.
    A limb is longer than half as wide. What is shorter than round ends with a cap: where more of
    the surface hangs on the end, something else goes on there.
    """
    known = importance[balls] > 0.0
    width = np.where(known, np.maximum(links.widths[balls], graph.radii), 0.0)
    sure = known.copy()
    if known.any():
        away = kd_tree(links.centers[importance > 0.0]).query(graph.nodes)[0]
        sure = away < NEAR_CANDIDATE * graph.radii
    gone, least = np.zeros(len(balls), bool), dict[int, tuple[float, IntArray]]()
    for branch, row in _limbs(graph):
        base, tip, long = int(row[0]), row[-1], float(graph.branch_lengths[branch])
        gone[row[1 + np.flatnonzero(known[row]).max(initial=0) :]] = True
        away = np.linalg.norm(graph.nodes[row] - graph.nodes[base], axis=1)
        out = row[away >= graph.radii[base]]
        steps = np.linalg.norm(np.diff(graph.nodes[out], axis=0), axis=1)
        doubtful = steps @ (sure[out[1:]] | sure[out[:-1]]) < LEAST_SURE * steps.sum()
        wide = long < width[out].max(initial=width[base])
        beyond = 2.0 * (long + graph.radii[tip] - graph.radii[base]) ** 2 < area[balls[out]].sum()
        beyond &= importance[balls[tip]] > LARGEST_CAP * width[tip] ** 2
        if (doubtful or wide or beyond) and long < least.get(base, (np.inf,))[0]:
            least[base] = long, row
    if not gone.any():
        for _, row in least.values():
            gone[row[1:]] = True
    return gone


def _small(graph: CurveSkeleton, balls: Index, area: NDArray[Any], smallest: float) -> Mask:
    """Nodes of limbs on which less of the surface hangs than `smallest`, the least at each base."""
    least: dict[int, tuple[float, IntArray]] = {}
    for _, row in _limbs(graph):
        base = int(row[0])
        away = np.linalg.norm(graph.nodes[row] - graph.nodes[base], axis=1)
        hangs = float(area[balls[row[away >= APART * graph.radii[base]]]].sum())
        if hangs < min(smallest, least.get(base, (np.inf,))[0]):
            least[base] = hangs, row
    small = np.zeros(len(balls), bool)
    for _, row in least.values():
        small[row[1:]] = True
    return small


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


def finish_graph(
    links: BallLinks,
    edges: Index,
    smoothing: float,
    importance: FloatArray | None = None,
    areas: FloatArray | None = None,
    smallest: float = 0.0,
) -> tuple[CurveSkeleton, Index]:
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
    smallest : float
        As in `prune`.

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
    stays, nearest = prune(links, raw, balls, importance, areas, smallest)
    raw, balls = raw.subset(stays), balls[stays]
    merged, into = merge_junctions(raw, raw.radii)
    sampled, node_of = sample_branches(merged, links.spacing)
    nodes = smooth_nodes(sampled.nodes, sampled.edges, sampled.radii, smoothing)
    node_of_ball = np.full(len(links.radii) + 1, -1, np.int64)  # one more row: no ball
    node_of_ball[balls] = node_of[into]
    moved = np.linalg.norm(nodes - sampled.nodes, axis=1)
    radii = np.maximum(sampled.radii - moved, 0.0)
    return CurveSkeleton.of(nodes, sampled.edges, radii), node_of_ball[nearest]


def merge_junctions(graph: CurveSkeleton, strength: FloatArray) -> tuple[CurveSkeleton, Index]:
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


def sample_branches(graph: CurveSkeleton, spacing: float) -> tuple[CurveSkeleton, Index]:
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
    nodes, room, count = [graph.nodes[fixed]], [graph.radii[fixed]], len(fixed)
    edges = [np.empty((0, 2), np.int64)]
    for row, least in _needed_nodes(graph):
        if node_of[row[0]] < 0:  # a ring: one of its nodes becomes fixed
            node_of[row[0]] = count
            nodes.append(graph.nodes[row[:1]])
            room.append(graph.radii[row[:1]])
            count += 1
        place, points, free, nearest = _sample(graph, row, spacing, least + 1)
        inner = np.arange(count, count + len(place) - 2)
        names = np.concatenate([[node_of[row[0]]], inner, [node_of[row[-1]]]])
        node_of[row[1:-1]] = names[nearest[1:-1]]
        nodes.append(points[1:-1])
        room.append(free[1:-1])
        edges.append(np.stack([names[:-1], names[1:]], axis=1))
        count += len(inner)
    parts = (np.concatenate(part) for part in (nodes, edges, room))
    return CurveSkeleton.of(*parts), node_of


def _needed_nodes(graph: CurveSkeleton) -> Iterator[tuple[IntArray, int]]:
    """Branches, and how many nodes each needs between its ends.

    Fewer would make a loop of one or two edges, or an edge that comes twice.
    """
    taken: set[frozenset[int]] = set()
    for row in graph.branches:
        ends = frozenset((int(row[0]), int(row[-1])))
        yield row, 2 if len(ends) == 1 else int(ends in taken)
        taken.add(ends)


def _sample(
    graph: CurveSkeleton, row: IntArray, spacing: float, least: int
) -> tuple[FloatArray, FloatArray, FloatArray, Index]:
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
    nodes: FloatArray, edges: IntArray, room: FloatArray, strength: float
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
    mass[degree == 1] *= END_WEIGHT
    moved = spsolve((diags_array(mass) + bend.T @ bend).tocsc(), mass[:, None] * nodes)
    shift = np.asarray(moved).reshape(v, 3) - nodes
    size = np.linalg.norm(shift, axis=1)
    allowed = np.divide(ROOM * room, size, out=np.ones(v), where=size > ROOM * room)
    return np.asarray(nodes + allowed[:, None] * shift)


@dataclass(frozen=True, kw_only=True)
class SimplifyOptions(Options):
    """Options of `simplify_branches`."""

    simplify: float = length(
        0.005,
        "Simplify",
        "Leave out nodes where the branch changes by less than this share of the size. 0 keeps "
        "all; the topology stays the same.",
    )


@algorithm(SimplifyOptions, keep=False)
def simplify_branches(
    graph: CurveSkeleton, options: SimplifyOptions, progress: Progress
) -> CurveSkeleton:
    """Leave out nodes of degree 2 while the branches stay where they are, up to a tolerance.

    No node that goes is farther than that from the new branch, nor than 0.9 of its radius, so that
    the branch stays inside the shape.

    Parameters
    ----------
    graph : CurveSkeleton
        v nodes.

    Returns
    -------
    CurveSkeleton
        With the same ends, junctions, components and loops. Vertices of the surface keep their
        branch; their node is the nearest one along it.

    See Also
    --------
    curve_skeleton : has the same option.

    Notes
    -----
    Douglas and Peucker's method, branch by branch. Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> line = medialis.CurveSkeleton.of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1], [1, 2]],
    ...                                  [1, 1, 1])
    >>> medialis.simplify_branches(line, simplify=0.05).nodes.tolist()
    [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    """
    tolerance = options.simplify * graph.diagonal
    stays, kept_of = graph.degrees != 2, []
    for row, least in _needed_nodes(graph):
        bound = np.minimum(tolerance, INSIDE * graph.radii[row])
        kept_of.append(_kept(graph.nodes[row], bound, least))
        stays[row[kept_of[-1]]] = True
    number = np.cumsum(stays) - 1
    edges, near = [], np.where(stays, number, -1)
    for row, kept in zip(graph.branches, kept_of, strict=True):
        names = number[row[kept]]
        edges.append(np.stack([names[:-1], names[1:]], axis=1))
        along = places_along(graph.nodes[row])
        middle = (along[kept][1:] + along[kept][:-1]) / 2
        near[row[1:-1]] = names[np.searchsorted(middle, along)][1:-1]
    joined = np.concatenate(edges) if edges else np.empty((0, 2))
    node, importance = graph.vertex_node, graph.importance[stays]
    node = None if node is None else np.where(node >= 0, near[node], -1)
    known = graph.nodes[stays], joined, graph.radii[stays]
    simple = CurveSkeleton.of(*known, importance=importance, vertex_node=node)
    # Branches are numbered by their lowest edge, and edges come branch after branch.
    changed = ("nodes", "edges", "radii", "importance", "branch", "vertex_node")
    sure = None if graph.persistence is None else graph.persistence[stays]
    return replace(graph, persistence=sure, **{name: getattr(simple, name) for name in changed})


def _kept(points: FloatArray, bound: FloatArray, least: int) -> Index:
    """Places along a polyline that stay: both ends, what is needed, and `least` more at least."""
    last = len(points) - 1
    # A closed branch has no chord to begin with, and a second branch needs a node: split evenly.
    kept = set(np.linspace(0, last, least + 2).round().astype(int).tolist())
    pieces = list(itertools.pairwise(sorted(kept)))
    while pieces:
        a, b = pieces.pop()
        chord, inner = points[b] - points[a], points[a + 1 : b] - points[a]
        share = np.clip(inner @ chord / max(float(chord @ chord), 1e-300), 0, 1)
        over = np.linalg.norm(inner - share[:, None] * chord, axis=1) - bound[a + 1 : b]
        if over.max(initial=0.0) > 0:
            middle = a + 1 + int(over.argmax())
            kept.add(middle)
            pieces += [(a, middle), (middle, b)]
    return np.array(sorted(kept), np.int64)


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
    ends = np.repeat(every, np.diff(links.offsets))
    pieces = piece_labels(len(centers), np.stack([ends, links.neighbours], axis=1))
    edges, _ = grow_graph(links, pieces, first, np.ones(len(centers), bool), handles)
    return finish_graph(links, edges, smoothing)[0]
