"""Limbs and bodies of a shape, told apart on its curve skeleton.

A core is the stretch of the curve skeleton within the ball of a body: that of a junction, or of a
thick place beside a neck. What lies between the cores and beyond them are arms. Arms that do not
stick out belong to their core, arms and cores as thick as it go on as its trunk, and the others are
limbs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.topology import piece_labels
from medialis.validation import FloatArray, IntArray

CORE = 0.92
"""Share of the width of a body up to which its core goes: there a limb 0.4 times as wide comes out
of its ball."""

NECK = 0.6
"""A place is a body when the branch just outside its ball is less than this share as wide."""

TRUNK = 0.75
"""Share of its width: a core goes on into arms at least as wide as this, and into another core when
neither is narrower where they meet. Limbs of real shapes are 0.1 to 0.7 as wide as their body, what
goes on in a trunk is 0.85 or more."""

LONG = 1.5
"""Widths of the core by which the end of a limb is away from its border. The corners of a cube are
1.1 long, a half ball is 1."""


def node_widths(skeleton: CurveSkeleton) -> FloatArray:
    """Return how far the surface is from each node, (v,): the mean over the samples round it.

    The samples are those of all nodes in its ball. At least the radius; much larger in flat places
    such as the palm of a hand.
    """
    from scipy.spatial import cKDTree

    v, nodes, radii = len(skeleton.nodes), skeleton.nodes, skeleton.radii
    node, area, distance = _samples_with_node(skeleton)
    weight = np.bincount(node, area, minlength=v)
    total = np.bincount(node, area * distance, minlength=v)
    inside = cKDTree(nodes).query_ball_point(nodes, radii, return_sorted=True)
    ball = np.repeat(np.arange(v), [len(one) for one in inside])
    member = np.concatenate([np.asarray(one, np.int64) for one in inside])
    same = skeleton.components[ball] == skeleton.components[member]
    ball, member = ball[same], member[same]
    around = np.bincount(ball, weight[member], minlength=v)
    width = radii.copy()
    np.divide(np.bincount(ball, total[member], minlength=v), around, out=width, where=around > 0)
    return np.maximum(width, radii)


def _samples_with_node(skeleton: CurveSkeleton) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the node of each sample that has one, the sample's area and its distance to it."""
    surface, node = skeleton.surface, skeleton.vertex_node
    assert surface is not None and node is not None
    rows = np.flatnonzero(node >= 0)
    distance = np.linalg.norm(surface.points[rows] - skeleton.nodes[node[rows]], axis=1)
    return node[rows], surface.point_areas[rows], distance


def find_limbs(graph: CurveSkeleton, width: FloatArray) -> IntArray:
    """Divide a curve skeleton into limbs and bodies.

    Parameters
    ----------
    graph : CurveSkeleton
        v nodes.
    width : (v,) float64
        Distance of the surface, as of `node_widths`.

    Returns
    -------
    (v,) int32
        Part of each node; -1 for the nodes of a core where three or more arms meet that are as
        thick as it: they belong to no arm more than to another.
    """
    piece, is_core = _pieces(graph, _cores(graph, width))
    links = _links(graph, piece, width)
    wide = _mean_widths(graph, piece, width)
    widest = np.zeros(len(is_core))
    np.maximum.at(widest, piece, width)
    into = np.arange(len(is_core))

    def join(core: int, other: int) -> None:
        into[into == into[other]] = into[core]

    shared = np.zeros(len(is_core), bool)
    for core in np.flatnonzero(is_core).tolist():
        trunk = []
        for other, passage in sorted(links[core].items()):
            if len(links[other]) == 1 and not _sticks_out(
                graph, width, piece == core, piece == other
            ):
                join(core, other)
            elif is_core[other]:
                if passage >= TRUNK * max(widest[core], widest[other]):
                    trunk.append(other)
            elif wide[other] >= TRUNK * widest[core]:
                trunk.append(other)
        shared[core] = len(trunk) > 2
        if not shared[core]:
            for other in trunk:
                join(core, other)
    return np.where(shared[piece], -1, into[piece]).astype(np.int32)


def _cores(graph: CurveSkeleton, width: FloatArray) -> IntArray:
    """Core of each node, -1 for arms: those that overlap are one."""
    near, places = _neighbours(graph), graph.nodes.tolist()
    core = np.full(len(graph.nodes), -1, np.int32)
    for node in np.lexsort((np.arange(len(width)), -width)).tolist():
        junction = graph.degrees[node] >= 3
        if core[node] >= 0 and not junction:
            continue
        radius = float(width[node])
        if not junction:
            rim = _stretch(places, near, node, radius)[1]
            if not any(core[b] < 0 and width[b] < NECK * radius for b in rim):
                continue
        inside = _stretch(places, near, node, CORE * radius)[0]
        old = np.unique(core[inside])
        core[np.isin(core, old[old >= 0])] = node
        core[inside] = node
    return core


def _neighbours(graph: CurveSkeleton) -> list[list[int]]:
    near: list[list[int]] = [[] for _ in range(len(graph.nodes))]
    for a, b in graph.edges.tolist():
        near[a].append(b)
        near[b].append(a)
    return near


def _stretch(
    places: list[list[float]], near: list[list[int]], start: int, radius: float
) -> tuple[list[int], list[int]]:
    """Nodes of the stretch round a node that lies in a ball, and the first ones outside."""
    stretch, rim, waiting = {start}, set(), [start]
    while waiting:
        for b in near[waiting.pop()]:
            if b in stretch or b in rim:
                continue
            if math.dist(places[b], places[start]) > radius:
                rim.add(b)
            else:
                stretch.add(b)
                waiting.append(b)
    return sorted(stretch), sorted(rim)


def _pieces(graph: CurveSkeleton, core: IntArray) -> tuple[IntArray, NDArray[np.bool_]]:
    """Cut the graph round its cores: piece of each node, and which pieces are cores."""
    uncut = core[graph.edges[:, 0]] == core[graph.edges[:, 1]]
    piece = piece_labels(len(graph.nodes), graph.edges[uncut])
    is_core = np.zeros(int(piece.max(initial=-1)) + 1, bool)
    is_core[piece[core >= 0]] = True
    return piece, is_core


def _links(graph: CurveSkeleton, piece: IntArray, width: FloatArray) -> list[dict[int, float]]:
    """Neighbours of each piece, and how wide the passage to each is."""
    links: list[dict[int, float]] = [{} for _ in range(int(piece.max(initial=-1)) + 1)]
    passage = width[graph.edges].min(axis=1).tolist()
    for (a, b), wide in zip(piece[graph.edges].tolist(), passage, strict=True):
        if a != b:
            links[a][b] = links[b][a] = max(wide, links[a].get(b, 0.0))
    return links


def _mean_widths(graph: CurveSkeleton, piece: IntArray, width: FloatArray) -> FloatArray:
    """Mean width of each piece along its length."""
    share = np.full(len(width), 1e-12 * (graph.length or 1.0))  # pieces of no length
    share += np.bincount(graph.edges.ravel(), graph.edge_lengths.repeat(2), minlength=len(width))
    return np.asarray(np.bincount(piece, share * width) / np.bincount(piece, share))


def _sticks_out(
    graph: CurveSkeleton, width: FloatArray, core: NDArray[np.bool_], arm: NDArray[np.bool_]
) -> bool:
    """Tell whether an arm with a free end is long for its width; one that returns is."""
    a, b = graph.edges.T
    feet = np.concatenate([a[arm[a] & core[b]], b[arm[b] & core[a]]])
    if len(feet) != 1:
        return True
    away = np.linalg.norm(graph.nodes[arm] - graph.nodes[feet[0]], axis=1) + graph.radii[arm]
    return bool(away.max() >= LONG * width[feet[0]])
