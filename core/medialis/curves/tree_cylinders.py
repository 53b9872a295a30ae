"""Cylinders of a tree: trunk, branches and twigs along a curve skeleton, each with its parent.

1. `rooted`: loops are cut at their thinnest edge, and the graph hangs from its root: the end
   nearest to a place, or the lowest thick one.
2. `_limbs`: from the root up. At a fork the thickest branch goes on, of those that are about as
   thick the straightest; the others are limbs of the next order. Thick is what a branch is beyond
   the ball of the fork.
3. `_Limb.squares`: seen from the axis, samples say the area of a section: r^2 is the mean of rho^2
   over the angle that they cover. So a hole where a branch leaves matters little, nor does an axis
   that is off the middle.
4. `tree_cylinders`: limbs are cut in cylinders as long as so many of their radii. A branch begins
   at the surface of what it stands on. An end goes on as far as the volume beyond its last node
   says: all of it at a flat base, two thirds of a radius at a round tip.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from medialis.base.arrays import Described, places_along, rows_at, unit_rows, weighted_graph
from medialis.base.errors import InvalidShapeError
from medialis.base.validation import Directions, FloatArray, IntArray, Positions, frozen
from medialis.curves.curve_skeleton import CurveSkeleton

THICK = 0.5  # halved 0 %, doubled 80 %
"""Ends with so much of the radius of the thickest one may be the root: the lowest of them is."""

BEYOND = 2.0, 4.0
"""Radii of the ball at a fork between which branches that leave it are compared."""

ALIKE = 0.85  # halved 75 %, doubled 100 %
"""Branches at a fork with so much of the radius of the thickest are about as thick."""

BESIDE = 1.0  # halved 75 %, doubled 0 %
"""Radii of a limb from its begin up to which another one stands on the same, not on this."""

LEAVING = 1.0, 5.0
"""Radii beyond its begin between which a limb has the direction in which it leaves another: nearer
a curve skeleton cuts the corner. Angles of 25 generated limbs are off by 1.1 degrees; from 0 by 5
degrees."""

CAP = 0.5  # halved 25 %, doubled 34 %
"""Squared cosine to the axis from which on a normal is that of an end, not of a side."""

OTHERS = 1.5  # halved 83 %, doubled 64 %
"""Samples farther from the axis than so many times the median belong to a branch."""

FEWEST = 6  # halved 9 %, doubled 26 %
"""Samples that tell the radius of a cylinder; with fewer it lies between those beside it."""


@dataclass(frozen=True, eq=False, repr=False)
class TreeCylinders(Described):
    """The cylinders of a tree, a limb after the other, from the root to the tips.

    Attributes
    ----------
    starts, ends : (c, 3) float64
        Middles of both ends.
    radii : (c,) float64
        Falling along each limb where that was asked for.
    measured : (c,) float64
        Radii as measured.
    parents : (c,) int32
        Row of the cylinder that it grows from; -1: the root.
    branches : (c,) int32
        Number of its limb: 0 the trunk, others after those that they grow from.
    orders : (c,) int32
        Forks at which its limb, or one that this grows from, has left another: 0 the trunk.
    leaving : (b, 3) float64
        Direction in which each limb leaves what it grows from, a unit vector.
    cut : int
        Edges that closed loops.
    """

    starts: Positions
    ends: Positions
    radii: FloatArray
    measured: FloatArray
    parents: IntArray
    branches: IntArray
    orders: IntArray
    leaving: Directions
    cut: int

    def __len__(self) -> int:
        return len(self.radii)

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each cylinder, (c,)."""
        return frozen(np.linalg.norm(self.ends - self.starts, axis=1), np.float64)

    @cached_property
    def axes(self) -> FloatArray:
        """Direction of each cylinder away from the root, (c, 3), unit vectors."""
        return frozen(unit_rows(self.ends - self.starts), np.float64)

    @cached_property
    def volumes(self) -> FloatArray:
        """Volume of each cylinder, (c,)."""
        return frozen(math.pi * self.radii**2 * self.lengths, np.float64)

    @cached_property
    def first(self) -> IntArray:
        """Row of the first cylinder of each limb, (b,)."""
        return frozen(np.unique(self.branches, return_index=True)[1], np.int32)

    @cached_property
    def positions(self) -> IntArray:
        """Place of each cylinder in its limb, from 0, (c,)."""
        return frozen(np.arange(len(self)) - self.first[self.branches], np.int32)

    @cached_property
    def angles(self) -> FloatArray:
        """Angle in radians between each limb and the cylinder that it grows from, (b,).

        NaN for the trunk.
        """
        parents = self.parents[self.first]
        cosines = np.einsum("ba,ba->b", self.leaving, self.axes[parents])
        return frozen(np.where(parents < 0, np.nan, np.arccos(np.clip(cosines, -1, 1))), np.float64)


@dataclass(frozen=True, eq=False)
class _Limb:
    """A limb: its path of nodes from where it leaves another, and the samples round it.

    Samples have a place `at` along the path; seen from the axis, the area of a section is half the
    sum of `share`, the angle that they cover the sum of `share` over `square`. `caps` are the
    samples beyond its first and its last node: how far, and their part of the volume there.
    """

    points: FloatArray
    along: FloatArray
    radii: FloatArray
    tangents: FloatArray
    parent: int
    order: int
    at: FloatArray
    share: FloatArray
    square: FloatArray
    caps: tuple[FloatArray, FloatArray]

    def places(self, at: FloatArray) -> FloatArray:
        """Return the places so far along the path, straight on beyond its ends."""
        inside = np.clip(at, 0.0, self.along[-1])
        over = (at - inside)[:, None]
        ends = np.where(over < 0, self.tangents[0], self.tangents[-1])
        return np.asarray(rows_at(inside, self.along, self.points) + over * ends)

    def squares(self, bounds: FloatArray) -> FloatArray:
        """Return the squared radius between bounds (b + 1,); what too little tells lies between."""
        found = np.full(len(bounds) - 1, np.nan)
        order = np.argsort(self.at, kind="stable")
        cuts = np.searchsorted(self.at[order], bounds)
        for row, (low, high) in enumerate(itertools.pairwise(cuts.tolist())):
            rows = order[low:high]
            if len(rows) < FEWEST:
                continue
            rows = rows[self.square[rows] <= OTHERS**2 * np.median(self.square[rows])]
            found[row] = self.share[rows].sum() / (self.share[rows] / self.square[rows]).sum()
        middles, known = (bounds[1:] + bounds[:-1]) / 2.0, ~np.isnan(found)
        if not known.any():
            return np.asarray(np.interp(middles, self.along, self.radii) ** 2)
        return np.asarray(np.interp(middles, middles[known], found[known]))

    def beyond(self, end: int, square: float) -> float:
        """Return how far a cylinder goes on beyond the first (0) or the last (1) node."""
        high, flow = self.caps[end].T
        if len(high) == 0 or square <= 0:
            return 0.0
        return float(np.clip(flow.sum() / (math.pi * square), 0.0, high.max()))


@dataclass(frozen=True, eq=False)
class _Laid:
    """Cylinders of a limb: its bounds (b + 1,) along it, squared radii, and the first row."""

    bounds: FloatArray
    squares: FloatArray
    first: int


def lowest_thick_end(graph: CurveSkeleton, up: int) -> int:
    """Return the end node of the largest component that is the lowest one of the thick ones.

    Raises
    ------
    InvalidShapeError
        When the graph has no branch.
    """
    if not len(graph.edges):
        raise InvalidShapeError("The curve skeleton has no branch, so it is no tree.")
    part = np.bincount(graph.components[graph.edges[:, 0]], graph.edge_lengths).argmax()
    ends = [
        (float(graph.mean_radii[row]), float(graph.nodes[node, up]), int(node))
        for row, nodes in enumerate(graph.branches)
        for node in (nodes[0], nodes[-1])
        if graph.degrees[node] == 1 and graph.components[node] == part
    ]
    if not ends:  # loops alone
        rows = np.flatnonzero(graph.components == part)
        return int(rows[np.argmin(graph.nodes[rows, up])])
    thick = THICK * max(ends)[0]
    return min((height, node) for radius, height, node in ends if radius >= thick)[1]


def nearest_end(graph: CurveSkeleton, place: FloatArray) -> int:
    """Return the node that is nearest to a place (3,): an end, where that is about as near."""
    away = np.linalg.norm(graph.nodes - place, axis=1)
    nearest = int(np.argmin(away))
    ends = graph.end_points
    if len(ends):
        end = int(ends[np.argmin(away[ends])])
        if away[end] <= away[nearest] + 2.0 * graph.radii[nearest]:
            return end
    return nearest


def rooted(graph: CurveSkeleton, root: int) -> tuple[list[list[int]], int]:
    """Return the nodes that follow each node on the way from the root, and how many edges were cut.

    Loops are cut at their thinnest edge: what stays is the spanning tree of the thickest.
    """
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    count, (a, b) = len(graph.nodes), graph.edges.T
    thin = 1.0 / np.maximum(np.minimum(graph.radii[a], graph.radii[b]), 1e-300)
    kept = minimum_spanning_tree(weighted_graph(thin / thin.min(), a, b, count))
    order, before = breadth_first_order(kept, root, directed=False)
    after: list[list[int]] = [[] for _ in range(count)]
    for node in order[1:].tolist():
        after[before[node]].append(node)
    there = graph.components == graph.components[root]
    return after, int(there[a].sum()) - (len(order) - 1)


def _beyond(graph: CurveSkeleton, after: list[list[int]], fork: int, child: int) -> float:
    """Return how thick a branch is beyond the ball of the fork that it leaves."""
    ball, last = float(graph.radii[fork]), 0.0
    found: list[float] = []
    waiting = [(child, float(math.dist(graph.nodes[fork], graph.nodes[child])))]
    while waiting:
        node, away = waiting.pop()
        radius = float(graph.radii[node])
        last = radius if not found else last
        if away > BEYOND[1] * ball and found:
            continue
        if away > BEYOND[0] * ball:
            found.append(radius)
        for other in after[node]:
            step = math.dist(graph.nodes[node], graph.nodes[other])
            waiting.append((other, away + step))
    return float(np.quantile(found, 0.75)) if found else last  # short: at its tip


def _paths(
    graph: CurveSkeleton, after: list[list[int]], root: int
) -> list[tuple[list[int], int, int]]:
    """Return path, parent and order of each limb, those of lower orders first."""
    found: list[tuple[list[int], int, int]] = []
    waiting = [([root], -1, 0)]
    while waiting:
        path, parent, order = waiting.pop(0)
        number = len(found)
        found.append((path, parent, order))
        while following := after[path[-1]]:
            going = following[0]
            if len(following) > 1:
                going = _goes_on(graph, after, path)
                others = [one for one in following if one != going]
                waiting += [([path[-1], one], number, order + 1) for one in others]
            path.append(going)
    return found


def _goes_on(graph: CurveSkeleton, after: list[list[int]], path: list[int]) -> int:
    """Return the node after a fork on which its limb goes on."""
    fork, following = path[-1], after[path[-1]]
    thick = np.array([_beyond(graph, after, fork, one) for one in following])
    alike = [one for one, t in zip(following, thick, strict=True) if t >= ALIKE * thick.max()]
    if len(alike) == 1:
        return alike[0]
    here, ball = graph.nodes[fork], BEYOND[1] * graph.radii[fork]
    came = here - _at_distance(graph, path[::-1], ball)
    ways = np.array([_at_distance(graph, _chain(after, one), ball) - here for one in alike])
    return alike[int(np.argmax(unit_rows(ways) @ came))]


def _chain(after: list[list[int]], node: int) -> list[int]:
    chain = [node]
    while len(after[chain[-1]]) == 1:
        chain.append(after[chain[-1]][0])
    return chain


def _at_distance(graph: CurveSkeleton, chain: list[int], distance: float) -> FloatArray:
    """Return the place so far along a chain, or its end."""
    points = graph.nodes[chain]
    return np.asarray(rows_at(distance, places_along(points), points))


def _limbs(graph: CurveSkeleton, after: list[list[int]], root: int) -> list[_Limb]:
    """Return the limbs with what samples say of them."""
    paths = _paths(graph, after, root)
    cloud = graph.cloud
    assert cloud is not None and graph.vertex_node is not None
    surface, count = cloud.surface, len(graph.nodes)
    limb_of, place_of = np.full(count + 1, -1), np.zeros(count + 1, np.int64)
    for number in range(len(paths) - 1, -1, -1):  # a fork is one of the limb that goes on
        path = paths[number][0]
        limb_of[path], place_of[path] = number, np.arange(len(path))
    node = np.asarray(graph.vertex_node)
    order = np.argsort(limb_of[node], kind="stable")
    cuts = np.searchsorted(limb_of[node][order], np.arange(len(paths) + 1))
    found: list[_Limb] = []
    for number, (path, parent, depth) in enumerate(paths):
        rows = order[cuts[number] : cuts[number + 1]]
        points = np.asarray(graph.nodes[path])
        along = places_along(points)
        tangents = _tangents(points, along, graph.radii[path])
        place = place_of[node[rows]]
        away, axis = surface.points[rows] - points[place], tangents[place]
        high = np.einsum("na,na->n", away, axis)
        across = away - high[:, None] * axis
        normals = surface.normals[rows]
        share = surface.point_areas[rows] * np.einsum("na,na->n", across, normals)
        square = np.einsum("na,na->n", across, across)
        side = np.einsum("na,na->n", normals, axis) ** 2 < CAP
        side &= (share > 0) & (square > 0)
        flow = surface.point_areas[rows] * np.einsum("na,na->n", away, normals) / 3.0
        # Beyond the first and the last node: how far, and the volume.
        ends = [
            np.stack([sign * high[mine], flow[mine]], axis=1)
            for last, sign in ((0, -1.0), (len(path) - 1, 1.0))
            for mine in [(place == last) & (sign * high > 0)]
        ]
        at = along[place] + high
        path_radii = np.asarray(graph.radii[path])
        told = at[side], share[side], square[side]
        limb = points, along, path_radii, tangents, parent, depth, *told, (ends[0], ends[1])
        found.append(_Limb(*limb))
    return found


def _tangents(points: FloatArray, along: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the direction of a path (k, 3) at its nodes, over a radius to both sides."""
    ahead, behind = (rows_at(along + sign * radii, along, points) for sign in (1.0, -1.0))
    return unit_rows(ahead - behind)


def tree_cylinders(
    graph: CurveSkeleton, root: int, *, length: float = 3.0, taper: bool = False
) -> TreeCylinders:
    """Lay cylinders along the tree that a curve skeleton is.

    Parameters
    ----------
    graph : CurveSkeleton
        Of balls, so that each sample has its node; what is not joined to the root is left out.
    root : int
        Node where the tree begins.
    length : float
        Of a cylinder, in radii.
    taper : bool
        Radii never grow along a limb, nor from one to the next; the volume of a limb stays.

    Raises
    ------
    InvalidShapeError
        When the root has no edge.
    """
    after, cut = rooted(graph, root)
    if not after[root]:
        raise InvalidShapeError("The tree has no limb where it begins: give another root.")
    limbs, laid, rows = _limbs(graph, after, root), list[_Laid](), list[int]()
    for number, limb in enumerate(limbs):
        limbs[number] = limb = _standing(limb, limbs, laid)
        begin, row = 0.0, -1
        if limb.parent >= 0:
            begin, row = _leaves(limb, limbs[limb.parent], laid[limb.parent])
        rows.append(row)
        first = laid[-1].first + len(laid[-1].squares) if laid else 0
        laid.append(_laid(limb, begin, length, first))
    measured = np.sqrt(np.concatenate([one.squares for one in laid]))
    sizes = [len(one.squares) for one in laid]
    branches = np.repeat(np.arange(len(laid)), sizes)
    parents = np.arange(len(measured)) - 1
    parents[[one.first for one in laid]] = rows
    places = [limb.places(one.bounds) for limb, one in zip(limbs, laid, strict=True)]
    radii = _tapering(laid, rows) if taper else measured
    spans = [one.bounds[0] + np.sqrt(one.squares[0]) * np.array(LEAVING) for one in laid]
    leaving = [np.diff(limb.places(s), axis=0)[0] for limb, s in zip(limbs, spans, strict=True)]
    return TreeCylinders(
        frozen(np.concatenate([place[:-1] for place in places]), np.float64),
        frozen(np.concatenate([place[1:] for place in places]), np.float64),
        frozen(radii, np.float64),
        frozen(measured, np.float64),
        frozen(parents, np.int32),
        frozen(branches, np.int32),
        frozen(np.array([limb.order for limb in limbs])[branches], np.int32),
        frozen(unit_rows(np.array(leaving)), np.float64),
        cut,
    )


def _standing(limb: _Limb, limbs: list[_Limb], laid: list[_Laid]) -> _Limb:
    """Return a limb from what it really stands on.

    Two that leave a trunk side by side may meet within it, or at its surface: neither grows from
    the other.
    """
    while limb.parent >= 0:
        parent, one = limbs[limb.parent], laid[limb.parent]
        fork = int(np.argmin(np.linalg.norm(parent.points - limb.points[0], axis=1)))
        beyond = parent.along[fork] - one.bounds[0]
        if parent.parent < 0 or beyond > BESIDE * math.sqrt(one.squares[0]):
            break
        points, shift = np.concatenate([parent.points[:fork], limb.points]), parent.along[fork]
        limb = replace(
            limb,
            points=points,
            along=np.concatenate([parent.along[:fork], limb.along + shift]),
            radii=np.concatenate([parent.radii[:fork], limb.radii]),
            tangents=np.concatenate([parent.tangents[:fork], limb.tangents]),
            at=limb.at + shift,
            parent=parent.parent,
        )
    return limb if limb.parent < 0 else replace(limb, order=limbs[limb.parent].order + 1)


def _leaves(limb: _Limb, parent: _Limb, laid: _Laid) -> tuple[float, int]:
    """Return where a limb comes out of the one that it grows from, and that one's cylinder there.

    Inside of it for all its length, it begins in its middle.
    """
    starts, steps = parent.points[:-1], np.diff(parent.points, axis=0)
    away = limb.points[:, None] - starts
    lengths = np.maximum(np.einsum("sa,sa->s", steps, steps), 1e-300)
    share = np.clip(np.einsum("ksa,sa->ks", away, steps) / lengths, 0.0, 1.0)
    off = np.linalg.norm(away - share[..., None] * steps, axis=2)
    nearest, rows = off.argmin(axis=1), np.arange(len(limb.points))
    at = parent.along[nearest] + share[rows, nearest] * np.sqrt(lengths)[nearest]
    middles = (laid.bounds[1:] + laid.bounds[:-1]) / 2.0
    over = off[rows, nearest] - np.sqrt(np.interp(at, middles, laid.squares))
    out = np.flatnonzero(over > 0)
    if len(out) == 0:
        begin = 0.5 * float(limb.along[-1])
    elif (k := int(out[0])) == 0:
        begin = 0.0
    else:
        begin = float(np.interp(0.0, over[k - 1 : k + 1], limb.along[k - 1 : k + 1]))
    here = float(np.interp(begin, limb.along, at))
    row = int(np.searchsorted(laid.bounds, here, side="right")) - 1
    return begin, laid.first + min(max(row, 0), len(laid.squares) - 1)


def _laid(limb: _Limb, begin: float, length: float, first: int) -> _Laid:
    """Cut a limb, from a place on, in cylinders as long as so many of their radii."""
    end = float(limb.along[-1])
    fine = np.linspace(begin, end, 1 + max(2, len(limb.points)))
    count = np.concatenate([[0.0], np.cumsum(np.diff(fine) / np.sqrt(limb.squares(fine)))]) / length
    pieces = max(1, round(float(count[-1])))
    bounds = np.interp(np.linspace(0.0, count[-1], pieces + 1), count, fine)
    squares = limb.squares(bounds)
    if limb.parent < 0:
        bounds[0] -= limb.beyond(0, float(squares[0]))
    bounds[-1] += limb.beyond(1, float(squares[-1]))
    return _Laid(bounds, squares, first)


def _tapering(laid: list[_Laid], rows: list[int]) -> FloatArray:
    """Return radii that never grow along limbs, nor from one to the next.

    The nearest falling squares, so that what is joined keeps its volume.
    """
    result: list[float] = []
    for one, row in zip(laid, rows, strict=True):
        most = math.inf if row < 0 else result[row] ** 2
        blocks: list[tuple[float, float, int]] = []  # volume, length, cylinders
        for square, step in zip(one.squares.tolist(), np.diff(one.bounds).tolist(), strict=True):
            volume, span, count = square * step, step, 1
            while blocks and volume * blocks[-1][1] >= blocks[-1][0] * span:
                before = blocks.pop()
                volume, span, count = volume + before[0], span + before[1], count + before[2]
            blocks.append((volume, span, count))
        for volume, span, count in blocks:
            square = volume / span if span > 0 else 0.0
            result += [math.sqrt(min(square, most))] * count
    return np.array(result)
