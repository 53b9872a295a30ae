"""Growing a graph along linked balls, with one loop for each handle (thesis 3.6.3).

Links. A link between two balls stays inside the shape when each center lies in the other ball, or
at least when the balls overlap. So a graph of such links leads along the surface skeleton only.
`link_balls` makes the links and their costs; `GraphTree` is a graph that grows on them, with the
cheapest path of every other ball to it.

Growth: loops first, then branch after branch. Every branch is the cheapest path from a candidate to
the graph so far, so it runs along the curve skeleton where there is one, crosses gaps along the
surface skeleton, and joins the graph where it comes near it. One loop is closed for each handle, by
the cheapest link that goes round it. So the graph has one component by construction, and no loop
more than were asked for.

Handles. A closed surface of genus g bounds a solid with g independent loops. The surface itself has
2 g: a tree of vertices and a tree of faces leave 2 g sides, each of which closes a loop over the
surface (tree-cotree, Eppstein 2003). The faces are joined where loops would be longest first, so
that those which are left are the shortest through the root (Erickson and Whittlesey 2005): each
lies at its handle.

Turns. A closed path inside is contractible in homology exactly when it is linked with none of these
loops: when it crosses a surface that a loop spans as often one way as the other. Any surface with
that border will do; `SpanningSurface` is a binary tree of triangles: from both ends of a piece of
the loop to its middle, and so on for the two halves. Most triangles are as small as the steps of
the loop, and boxes round pieces tell which of them are near a ball.

Closing. How often a closed path goes round each handle is a vector of whole numbers, its turns. A
loop is new when its turns are no sum of those of the loops before. To tell this for every link at
once, turns are weighed by random numbers whose sums over all loops so far are 0: a loop that weighs
something is new, and what each path weighs takes one number a ball, not one for each handle.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Described, Index, Mask, Ragged, follow, kd_tree, next_side
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.shape import Shape
from medialis.shape.surface import SolidBoundary, piece_labels, solid_boundary

if TYPE_CHECKING:
    from medialis.curves._kernels import BallLinks, SpanningSurface

NEIGHBOURS = 10  # halved 100 %, doubled 100 %
"""Of each point, as in the thesis."""

OFF_CURVE = 20.0  # halved 74 %, doubled 62 %
"""Times what a link costs on the curve skeleton that one far from it costs."""

STICKS_OUT = 0.5  # halved 0 %, doubled 100 %
"""Share of the radius at the start of a branch by which the ball at its end reaches out of it."""

APART = 0.85  # halved 29 %, doubled 100 %
"""Share of the larger radius by which the centers are apart: else the balls are nearly one."""

SHORTEST_BRANCH = 3.0  # halved 43 %, doubled 100 %
"""Spacings: shorter branches are steps between neighbouring balls."""

LARGE_COMPONENT = 0.25  # halved 0 %, doubled 0 %
"""Share of all balls from which on a component counts as large."""

KEPT_BRANCHES = 4  # halved 0 %, doubled 0 %
"""Branches of a large component that are kept: the first ones, whose search visits nearly all of
its balls."""

BUCKETS = 2048
"""Of balls that wait for their turn in a search, by cost."""

BUCKET_WIDTH = 0.1
"""Times what a link costs in the median. Of 537,000 balls 0.4 % are visited twice with it, with 1.0
one in five; 0.1 to 0.3 take the least time."""

COSTS_ASKED = 1000
"""Links of which that median is taken."""

BALLS_A_CHUNK = 4096

Links = tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]]]
"""Balls (m,) and (m, c) others that each may be linked to."""

Turns = dict[int, Index]

Keep = Callable[[tuple[int, ...], Callable[[], Any]], Any]
"""Returns what a function computes, or what it returned before for the same numbers."""


def link_balls(
    centers: FloatArray,
    radii: FloatArray,
    closeness: FloatArray,
    near: Sequence[Links],
    needed: Sequence[Links],
    *,
    spacing: float,
    widths: FloatArray | None = None,
    groups: IntArray | None = None,
) -> BallLinks:
    """Link balls and give each link a cost.

    Parameters
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    closeness : (k,) float64
        1 on the curve skeleton, 0 far from it.
    near : sequence of Links
        That may be linked: used where each center lies in the other ball.
    needed : sequence of Links
        That are linked in any case, for the graph to hang together.
    spacing : float
        Typical distance of neighbouring balls; a link longer than this, and than a share of the
        smaller radius, costs more for its length.
    widths : (k,) float64, optional
        As in `BallLinks`.
    groups : (k,) int, optional
        Balls of the same group are linked only; -1: with none.

    Returns
    -------
    BallLinks
    """
    from medialis.curves._kernels import BallLinks, list_links, sort_links, weigh_links

    k, centers, radii = len(radii), frozen(centers, np.float64), frozen(radii, np.float64)
    groups = np.zeros(k, np.int32) if groups is None else groups
    given = [
        (*(np.ascontiguousarray(rows, np.int32) for rows in pair), kind == 1)
        for kind, lists in enumerate((near, needed))
        for pair in lists
    ]
    none, counts = np.empty(0, np.int32), np.zeros(k, np.int64)
    for pair in given:
        list_links(*pair, groups, centers, radii, counts, none)
    starts = np.concatenate([[0], np.cumsum(counts)])
    listed, places = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for pair in given:
        list_links(*pair, groups, centers, radii, places, listed)
    offsets, neighbours = np.empty(k + 1, np.int64), np.empty(len(listed), np.int32)
    neighbours = neighbours[: sort_links(starts, listed, offsets, neighbours)].copy()
    balls = centers, radii, frozen(offsets, np.int64), frozen(neighbours, np.int32)
    blank = np.empty(len(neighbours)), np.empty(len(neighbours))
    wide = frozen(np.full(k, np.inf) if widths is None else widths, np.float64)
    links = BallLinks(*balls, *blank, spacing, wide)
    dearness = 1 / (1 / OFF_CURVE + closeness)
    run_chunks(weigh_links, k, BALLS_A_CHUNK, links, dearness)
    return links._replace(length=frozen(links.length, float), cost=frozen(links.cost, float))


class GraphTree:
    """A graph on linked balls, and the cheapest path of every other ball to it.

    Parameters
    ----------
    links : BallLinks
        k balls.
    targets : (k,) bool, optional
        The only balls whose path is asked for: searches end with them. Of the others some have
        none, some not the cheapest.

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

    def __init__(self, links: BallLinks, targets: Mask | None = None) -> None:
        from medialis.curves._search_kernels import Queue

        k, self.links = len(links.radii), links
        self.targets = np.zeros(0, np.bool_) if targets is None else targets
        self.edges: list[Index] = []
        self.spent, self.path = np.full(k, np.inf), np.full(k, np.inf)
        self.parent, self.base = np.full(k, -1, np.int32), np.full(k, -1, np.int32)
        self._queue = Queue(*(np.full(size, -1, np.int32) for size in (BUCKETS + 1, k, k, k)))
        some = links.cost[:: len(links.cost) // COSTS_ASKED + 1]
        self._width = max(BUCKET_WIDTH * float(np.median(some)), 1e-300) if len(some) else 1.0

    @property
    def _found(self) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
        return self.spent, self.path, self.parent, self.base

    def copy(self) -> GraphTree:
        """Return the same graph, to grow on by itself."""
        other = GraphTree(self.links, self.targets)
        for name in ("edges", "spent", "path", "parent", "base"):
            setattr(other, name, getattr(self, name).copy())
        return other

    def add(self, balls: list[int]) -> None:
        """Make balls nodes of the graph, and find the paths of the others to it anew."""
        from medialis.curves._search_kernels import spread_from_tree

        # New nodes only shorten paths: none that costs more than all targets' so far will do.
        known = self.spent[np.flatnonzero(self.targets)]
        known = known[known < np.inf]
        most = float(known.max()) if len(known) else np.inf
        sources = np.array(balls, np.int32)
        given = self._found, self._queue, self.targets, most, self._width
        spread_from_tree(sources, self.links, *given)

    def drop(self, balls: Index) -> None:
        """Make nodes of the graph balls like others; only paths that ended there are found anew."""
        from medialis.curves._search_kernels import spread_into

        gone = np.zeros(len(self.base) + 1, bool)  # one more row: no base
        gone[balls] = True
        lost = np.flatnonzero(gone[self.base]).astype(np.int32)
        spread_into(lost, self.links, self._found, self._queue, self._width)

    def with_branch(self, tip: int) -> GraphTree:
        """Return a copy with the cheapest path of a ball as a branch."""
        other = self.copy()
        other.add(other.join(tip))
        return other

    def join(self, ball: int) -> list[int]:
        """Take the cheapest path of a ball into the list of edges; return its new balls."""
        path = follow(self.parent, ball)
        self.take(path)
        return path[:-1]

    def take(self, path: Sequence[int]) -> None:
        """Take the steps of a path into the list of edges."""
        self.edges.append(np.array([path[:-1], path[1:]], np.int64).T)


def grow_graph(
    links: BallLinks,
    components: IntArray,
    strength: FloatArray,
    candidates: Mask,
    handles: Mapping[int, Handles] | None = None,
    keep: Keep = lambda _, compute: compute(),
    progress: Progress | None = None,
    targets: Mask | None = None,
) -> tuple[Index, Turns]:
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
    targets : (k,) bool, optional
        Balls that any `candidates` for which stages are kept are of; all when missing.

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
    graph, loops = keep(stages, lambda: _rooted(links, balls, roots, handles or {}, targets))
    mine = False
    for number in sorted(balls, key=lambda number: len(balls[number]), reverse=True):
        large, turn = len(balls[number]) >= LARGE_COMPONENT * len(links.radii), 0
        while (tip := next_tip(graph, wanted[number])) is not None:
            if progress is not None:
                progress.update(0.0)
            stages = (*stages, tip)
            if large and turn < KEPT_BRANCHES:
                graph, mine = keep(stages, functools.partial(graph.with_branch, tip)), False
            else:
                graph, mine = graph if mine else graph.copy(), True
                graph.add(graph.join(tip))
            turn += 1
    joined = np.concatenate([np.empty((0, 2), np.int64), *graph.edges])
    alone = np.setdiff1d(stages[: len(roots)], joined)
    edges = np.sort(np.concatenate([joined, np.stack([alone, alone], axis=1)]), axis=1)
    return np.unique(edges, axis=0), loops


def _rooted(
    links: BallLinks,
    balls: Mapping[int, Index],
    roots: Mapping[int, int],
    handles: Mapping[int, Handles],
    targets: Mask | None,
) -> tuple[GraphTree, Turns]:
    """Start a graph in each component: its root, and the loops round its handles."""
    looped = any(handles[number].loops for number in handles.keys() & roots.keys())
    graph, loops = GraphTree(links, None if looped else targets), {}
    graph.add(list(roots.values()))
    for number in handles.keys() & roots.keys():
        one = handles[number]
        loops[number] = np.zeros((0, len(one.loops)), np.int64)
        if one.loops:
            turns = link_turns(links, one, balls[number])
            loops[number] = close_loops(graph, turns, balls[number], roots[number], one.genus)
    if targets is not None:
        graph.targets = targets
    return graph, loops


def next_tip(graph: GraphTree, candidates: Index) -> int | None:
    """Return the candidate that sticks out of the graph most; None when there is none."""
    radii = graph.links.radii
    # Short ways go first: in the end nearly all are, and a noisy shape takes a thousand turns.
    far = graph.path[candidates] >= SHORTEST_BRANCH * graph.links.spacing
    reached = candidates[far & (graph.base[candidates] >= 0)]
    base = graph.base[reached]
    gap = np.linalg.norm(graph.links.centers[reached] - graph.links.centers[base], axis=1)
    distance = np.maximum(gap, graph.path[reached] / 2)
    out = sticks_out(distance, radii[reached], radii[base], graph.links.widths[reached])
    if not out.any():
        return None
    beyond = np.where(out, graph.path[reached] + radii[reached] - radii[base], -np.inf)
    return int(reached[beyond.argmax()])


def sticks_out(distance: FloatArray, tip: FloatArray, base: FloatArray, width: FloatArray) -> Mask:
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


MOST_HANDLES = 2048  # halved 0 %, doubled 0 %
"""Of one component that get loops: more would take minutes."""

JITTER = 1e-9  # halved 0 %, doubled 0 %
"""Fraction of the diagonal by which points of loops move."""

PRIME = 2**31 - 1
"""Turns and weights are compared modulo this prime; turns are far smaller. A new loop weighs 0 by
chance once in so many."""

SLACK = 1e-9  # halved 0 %, doubled 0 %
"""Share of the largest coordinate by which boxes and planes are wider than they are: rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class Handles(Described):
    """Loops over one component of a surface.

    Attributes
    ----------
    genus : int
        Number of independent loops inside.
    loops : list of (l,) int64
        2 genus closed polylines: indices into `points`. None for more than 2048 handles, which
        would take minutes.
    points : (n, 3) float64
        Those of the boundary of the solid, which are the vertices first; moved by 1e-9 of the size,
        since centers of symmetric shapes lie in triangles that loops span.
    seams, unclear : int
        Where the surface touches itself, and where the solid is a guess (`SolidBoundary`).
    """

    genus: int
    loops: list[Index]
    points: FloatArray
    seams: int = 0
    unclear: int = 0


def find_handles(shape: Shape) -> dict[int, Handles]:
    """Find the loops over each component of a surface.

    Parameters
    ----------
    shape : Shape
        A mesh.

    Returns
    -------
    dict
        Handles of the solid (`solid_boundary`) by the number of the component
        (`Shape.components`). What touches in a vertex or an edge is one component.
    """
    if shape.faces is None or shape.face_count == 0:
        return {}
    boundary = solid_boundary(shape)
    parent, sides = _sides_left(boundary)
    corners = np.ascontiguousarray(boundary.faces.ravel())
    of_side = boundary.component[corners[sides]]
    move = np.random.default_rng(0).uniform(-1, 1, boundary.points.shape)
    points = frozen(boundary.points + JITTER * shape.diagonal * move, np.float64)
    result = {}
    for number in np.unique(shape.components[shape.faces[:, 0]]).tolist():
        mine = sides[of_side == number]
        usable = mine if len(mine) <= 2 * MOST_HANDLES else mine[:0]
        loops = [_loop(corners, int(h), parent) for h in usable]
        seams, unclear = int(boundary.seams[number]), int(boundary.unclear[number])
        result[number] = Handles(len(mine) // 2, loops, points, seams, unclear)
    return result


def _sides_left(boundary: SolidBoundary) -> tuple[Index, Index]:
    """Tree of vertices, by parents, and the sides that are in no tree of vertices nor of faces."""
    from medialis.curves._kernels import join_faces, steps_from

    twins, n = boundary.twins, len(boundary.points)
    a, b = boundary.faces.ravel(), np.roll(boundary.faces, -1, axis=1).ravel()
    steps, parent = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    once = twins > np.arange(len(twins))
    piece = piece_labels(n, np.stack([a[once], b[once]], axis=1))
    starts = np.unique(piece, return_index=True)[1]
    # Euler: as many sides are left as there are more edges than the two trees of each piece have.
    used = n - np.count_nonzero(np.bincount(a, minlength=n) == 0)
    if len(a) // 6 - used + 2 * (len(starts) - (n - used)) == 0:
        return parent, np.empty(0, np.int64)
    near, neighbours = Ragged.group(a, n), np.ascontiguousarray(b, np.int64)
    steps_from(starts, near.offsets, neighbours[near.indices], np.empty(n, np.int64), steps, parent)
    # Two edges may have the same ends: one of them is in the tree.
    down = np.flatnonzero(parent[b] == a)
    first = down[np.unique(b[down], return_index=True)[1]]
    once[first] = once[twins[first]] = False
    sides = np.flatnonzero(once)
    longest_first = np.argsort(-(steps[a[sides]] + steps[b[sides]]), kind="stable")
    sides = sides[longest_first]
    left = np.zeros(len(sides), bool)
    join_faces(sides, twins, np.arange(len(boundary.faces)), left)
    return parent, sides[left]


def _loop(corners: IntArray, h: int, parent: Index) -> Index:
    """Side h and the paths of both its ends up the tree, as far as they differ."""
    a, b = (follow(parent, int(corners[h])) for h in (h, next_side(h)))
    while len(a) > 1 and len(b) > 1 and a[-2] == b[-2]:
        a.pop()
        b.pop()
    loop = [*a, *b[-2::-1]]
    return np.array([*loop, loop[0]], np.int64)


def span_loop(points: FloatArray) -> SpanningSurface:
    """Span a loop of points (l, 3), each given once."""
    from medialis.curves._kernels import SpanningSurface, fill_boxes

    spans, children = _halved(len(points))
    corners = np.insert(spans, 1, spans.sum(axis=1) // 2, axis=1) % len(points)
    low, high, normals = (np.empty((len(spans), 3)) for _ in range(3))
    points, slack = np.ascontiguousarray(points), SLACK * float(np.abs(points).max(initial=0.0))
    levels = np.empty(len(spans))
    spanned = SpanningSurface(points, corners, children, low, high, normals, levels, slack)
    fill_boxes(spanned)
    return spanned


def count_crossings(
    spanned: SpanningSurface, links: BallLinks, rows: Index, reach: FloatArray, turns: Index
) -> None:
    """Count how often links cross a surface against its normals, into ``turns``.

    Parameters
    ----------
    spanned : SpanningSurface
    links : BallLinks
        Only those between balls that overlap are followed.
    rows : (r,) int
        Balls.
    reach : (k,) float64
        Length of the longest such link of each ball.
    turns : (links,) int64
        Comes with 0.

    Notes
    -----
    Cost: rows times the triangles near each, of which there are some tens at most as a rule.
    """
    from medialis.curves._kernels import cross_links

    run_chunks(cross_links, len(rows), BALLS_A_CHUNK, rows, reach, links, spanned, turns)


def _halved(count: int) -> tuple[Index, Index]:
    """First and last point of each piece of a loop of more than one step, and its two halves."""
    level = np.array([[0, count]], np.int64)
    spans, children, known = [], [], 0
    while len(level):
        middle = level.sum(axis=1) // 2
        halves = np.stack([level[:, 0], middle, middle, level[:, 1]], axis=1).reshape(-1, 2)
        whole = halves[:, 1] - halves[:, 0] > 1
        number = known + len(level) + np.cumsum(whole) - 1
        spans.append(level)
        children.append(np.where(whole, number, -1).reshape(-1, 2))
        known, level = known + len(level), halves[whole]
    return np.concatenate(spans), np.concatenate(children)


def link_turns(links: BallLinks, one: Handles, rows: Index) -> Any:
    """Count the turns along links between balls that overlap.

    A turn is a crossing of the surface that a loop spans, which lies within the hull of the loop:
    only balls with links that come there are asked.

    Parameters
    ----------
    links : BallLinks
    one : Handles
    rows : (r,) int
        Balls of the component.

    Returns
    -------
    (links, loops) sparse int64
        How often each link crosses the surface that each loop spans, against its normals.
    """
    from scipy.sparse import csr_array

    from medialis.curves._kernels import farthest_ends, take_turns

    reach, turns = np.zeros(len(links.radii)), np.zeros(len(links.length), np.int64)
    farthest_ends(rows, links, reach)
    centers, found = links.centers[rows], np.empty((2, len(turns)), np.int64)
    lists = [np.empty((3, 0), np.int64)]
    for number, loop in enumerate(one.loops):
        spanned = span_loop(one.points[loop[:-1]])
        low, high = spanned.lowest[0], spanned.highest[0]
        away = np.maximum(np.maximum(low - centers, centers - high), 0.0).max(axis=1)
        there = rows[away <= reach[rows]]
        count_crossings(spanned, links, there, reach, turns)
        link, turn = found[:, : take_turns(there, links.offsets, turns, *found)]
        lists.append(np.stack([link, np.full(len(link), number), turn]))
    link, number, turn = np.concatenate(lists, axis=1)
    return csr_array((turn, (link, number)), shape=(len(turns), len(one.loops)))


def close_loops(graph: GraphTree, turns: Any, rows: Index, root: int, most: int) -> Index:
    """Close up to `most` loops round handles, cheapest first.

    Parameters
    ----------
    graph : GraphTree
        Grows by the loops.
    turns : (links, loops) sparse
        Of `link_turns`.
    rows : (r,) int
        Balls of the component.
    root : int
        The one that is a node of the graph.
    most : int

    Returns
    -------
    (l, c) int64
        How often each loop goes round each handle, up to sums of loops: independent rows.
    """
    from medialis.curves._kernels import cheapest_closing_link, weigh_paths

    links, random, k = graph.links, np.random.default_rng(0), len(graph.links.radii)
    anchor, path = np.full(k, -1, np.int64), np.zeros(k, np.int64)
    count = turns.shape[1]
    known, nodes = np.zeros((0, count), np.int64), {root: np.zeros(count, np.int64)}
    for _ in range(most):
        weight = _weights(known, random.integers(1, PRIME, count))
        path[list(nodes)] = np.stack(list(nodes.values())) @ weight % PRIME
        of_link = turns @ weight % PRIME
        order = rows[np.argsort(graph.spent[rows], kind="stable")]
        weigh_paths(order, graph.parent, links, of_link, PRIME, path, anchor)
        link = cheapest_closing_link(rows, links, graph.spent, of_link, PRIME, path, anchor)
        if link < 0:
            break
        a = int(np.searchsorted(links.offsets, link, side="right")) - 1
        b = int(links.neighbours[link])
        for end in (a, b):
            _follow_turns(graph, turns, end, nodes)
        known = _extend(known, nodes[a] + _along(turns, link) - nodes[b])
        # Both may run side by side, as through the stem of an eyelet: one stretch for both.
        first, second = graph.join(a), follow(graph.parent, b)
        second = _apart(links, second, [*first, int(graph.base[a])])
        graph.take(second)
        graph.take([a, b])
        new = {*first, *second}
        nodes = {v: turn for v, turn in nodes.items() if graph.parent[v] < 0 or v in new}
        graph.add([*first, *second])
    return known


def _along(turns: Any, link: int) -> Index:
    """Return the turns of one link, (loops,)."""
    return np.asarray(turns[[link]].toarray()[0])


def _follow_turns(graph: GraphTree, turns: Any, ball: int, nodes: dict[int, Index]) -> None:
    """Add the turns of the path from the graph to a ball, at each ball on it."""
    links = graph.links
    path = follow(graph.parent, ball)[::-1]
    for before, here in itertools.pairwise(path):
        begin, end = links.offsets[before], links.offsets[before + 1]
        link = begin + int((links.neighbours[begin:end] == here).argmax())
        nodes[here] = nodes[before] + _along(turns, link)


def _apart(links: BallLinks, path: list[int], other: list[int]) -> list[int]:
    """Cut the end of a path off where it runs in the balls of another; it then ends on that."""
    centers, radii = links.centers, links.radii
    gap, place = kd_tree(centers[other]).query(centers[path])
    beside = np.asarray(other)[place]
    alone = np.flatnonzero(gap >= np.minimum(radii[path], radii[beside]))
    last = alone[-1] + 1 if len(alone) else len(path)
    if last >= len(path):
        return path
    return [*path[:last], *dict.fromkeys([path[last], int(beside[last])])]


def _weights(known: Index, free: Index) -> Index:
    """Change random weights where loops lead, so that each known loop weighs nothing."""
    weight = free.copy()
    leads = (known != 0).argmax(axis=1)
    weight[leads] = 0
    for row, lead in zip(known[::-1], leads[::-1], strict=True):
        weight[lead] = -int((row * weight % PRIME).sum()) % PRIME
    return weight


def _extend(known: Index, row: Index) -> Index:
    """Add what is left of a row after elimination by known ones, each with a leading 1."""
    rest = row % PRIME
    for basis in known:
        rest = (rest - rest[(basis != 0).argmax()] * basis) % PRIME
    lead = int(rest[(rest != 0).argmax()])
    return np.vstack([known, rest * pow(lead, -1, PRIME) % PRIME])
