"""From paths along balls to smooth branches of the same topology (thesis 3.6.3).

The nodes of a grown graph are balls, so it zigzags from sample to sample. Here close junctions
become one, branches are sampled evenly (by their radius) and smoothed. A node moves within the ball
that it comes from, so it stays inside the shape; edges are shorter than the radii at their ends.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.curves.graph.growth import APART
from medialis.curves.graph.pruning import prune
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.polylines import places_along
from medialis.validation import FloatArray

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
