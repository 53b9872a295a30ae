"""The curve skeleton of a thin, branching mesh from its level sets (`level_sets.py`).

Each contour is a node in the middle of its section. Branches that do not stick out of the limb at
their base are left out; an end is the center of the largest ball that touches the tip. Pieces of
the surface that touch are joined by an edge, others have a graph of their own.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree, perpendicular, unit_rows, weighted_graph
from medialis.base.box_tree import NearestTree
from medialis.base.kept import Bound, kept
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.curves.curve_skeleton import CurveEvidence, CurveSkeleton
from medialis.curves.finishing import smooth_nodes
from medialis.curves.level_sets import LevelSets, level_sets
from medialis.curves.persistence import node_persistence
from medialis.shape.shape import Shape
from medialis.shape.surface import link_matrix, solid_boundary
from medialis.skeleton.medial_cloud import MedialCloud

NONE = np.empty((0, 2), np.int64)

HIGH, LONG = 2.0, 6.5
"""A limb sticks out by two radii of its base, or by 6.5 of its own radii where that is less: a
finger is longer than thick, a spine longer than wide, and a bump is neither. Two neurons with 619
and 657 ends get 631 and 716 and keep 98.1 and 98.4 % of their length; with six radii 638 and 727,
with eight 604 and 687, of the first one 97.7 %."""

DEEP = 0.8
"""Share of its radius: a tip that is so far inside of another limb does not stick out."""

FROM_TIP = 1.5
"""Radii from a tip up to which contours tilt towards it."""

CENTERINGS, SMOOTHINGS = 2, 4
"""Times that contours are centered, and that their middles are smoothed to find the limb's way."""

FLAT = 1e-6
"""Area over the square of the perimeter up to which a section has no middle."""

FEW_NEIGHBOURS = 8
"""Nearest points that are looked at first for one of another piece."""


@dataclass(frozen=True, eq=False)
class Web:
    """The graph of contours and bands: v nodes, contours first.

    Attributes
    ----------
    nodes : (v, 3) float64
    radii : (v,) float64
        Distance to the surface.
    widths : (v,) float64
        Radius of the circle with the area of the contour; of bands the second largest one beside:
        at a fork that of the limb that goes on.
    edges : (e, 2) int64
    tips : (v, 3) float64
        The place on the surface where a band ends; NaN elsewhere.
    node_of_point : (p,) int64
        -1 for points without faces.
    inside_of : (v,) int64
        The node whose ball, smaller by a share, a tip is deepest in; -1 for none, and for others.
    """

    nodes: FloatArray
    radii: FloatArray
    widths: FloatArray
    edges: Index
    tips: FloatArray
    node_of_point: Index
    inside_of: Index


def web_of(levels: LevelSets) -> Web:
    """Return the graph of contours and bands of level sets."""
    count, bands = len(levels.centers), levels.band_count
    widest, degree = _widest(levels)
    centers, sizes = centered(levels, widest) if count else (np.zeros((1, 3)), np.zeros(1))
    nodes = np.concatenate([centers[:count], centers[widest].mean(axis=1)])
    widths = np.concatenate([sizes[:count], sizes[widest[:, 1]]])
    ends, alone = count + np.flatnonzero(degree == 1), count + np.flatnonzero(degree == 0)
    tips = np.full_like(nodes, np.nan)
    tips[ends], nodes[alone] = _end_points(levels, degree)
    nodes[ends] = tips[ends]
    points, faces = levels.boundary.points, levels.boundary.faces
    radii, _ = NearestTree.of_triangles(points, faces).distances(nodes)
    widths[alone] = radii[alone]
    row = np.arange(count)
    edges = np.concatenate([np.column_stack([row, count + one]) for one in levels.bands.T])
    node_of_point = np.where(levels.band_of_point >= 0, count + levels.band_of_point, -1)
    inside_of = np.full(count + bands, -1)
    depth, ball = NearestTree.of_balls(nodes, DEEP * widths).distances(tips[ends])
    inside_of[ends] = np.where(depth < 0.0, ball, -1)
    return Web(nodes, radii, widths, edges, tips, node_of_point, inside_of)


def _widest(levels: LevelSets) -> tuple[Index, Index]:
    """Return the two longest contours of each band, twice the same where there is but one.

    And how many contours each band has.
    """
    bands = levels.band_count
    sides = levels.bands.T.ravel()
    contour = np.tile(np.arange(len(levels.centers)), 2)
    degree = np.bincount(sides, minlength=bands)
    order = np.lexsort((-levels.perimeters[contour], sides))
    first = np.searchsorted(sides[order], np.arange(bands))
    widest = np.zeros((bands, 2), np.int64)
    some, two = degree > 0, degree > 1
    widest[some] = contour[order[first[some]]][:, None]
    widest[two, 1] = contour[order[first[two] + 1]]
    return widest, degree


def _end_points(levels: LevelSets, degree: Index) -> tuple[FloatArray, FloatArray]:
    """Return the ends of bands with one contour, and the middles of bands without any."""
    bands, points = levels.band_count, levels.boundary.points
    known = np.flatnonzero(levels.band_of_point >= 0)
    of_point = levels.band_of_point[known]
    order = known[np.lexsort((levels.distance[known], of_point))]
    begin = np.searchsorted(levels.band_of_point[order], np.arange(bands + 1))
    starts = np.bincount(levels.bands[:, 0], minlength=bands) > 0  # the contour is behind it
    ends = np.flatnonzero(degree == 1)
    place = np.where(starts[ends], begin[ends], begin[ends + 1] - 1)
    alone = np.flatnonzero(degree == 0)
    middles = [points[order[begin[one] : begin[one + 1]]].mean(axis=0) for one in alone.tolist()]
    return points[order[place]], np.array(middles, np.float64).reshape(-1, 3)


def centered(levels: LevelSets, widest: Index) -> tuple[FloatArray, FloatArray]:
    """Return the middle of the section that each contour encloses, and its radius.

    Seen along the limb, a contour round a cylinder is its outline, however it tilts or bends: its
    centroid by area lies on the axis. Along the limb the place is that of the centroid by length.

    Parameters
    ----------
    levels : LevelSets
        c contours.
    widest : (b, 2) int64
        The two longest contours of each band, twice the same where there is but one.
    """
    count, centers = len(levels.centers), levels.centers
    first, second = levels.segments[:, 0], levels.segments[:, 1]
    widths = np.zeros(count)
    for _ in range(CENTERINGS):
        smooth = centers
        for _ in range(SMOOTHINGS):
            middle = smooth[widest].mean(axis=1)
            smooth = middle[levels.bands].mean(axis=1)
        way = unit_rows(np.diff(middle[levels.bands], axis=1)[:, 0])
        across = perpendicular(way)
        frames = np.stack([across, np.cross(way, across)], axis=1)
        frame, middle_of = frames[levels.contour], centers[levels.contour]
        ax, ay = np.einsum("sij,sj->is", frame, first - middle_of)
        bx, by = np.einsum("sij,sj->is", frame, second - middle_of)
        turn = ax * by - bx * ay
        area = np.bincount(levels.contour, turn, count) / 2.0
        moment = [
            np.bincount(levels.contour, turn * one, count) / 6.0 for one in (ax + bx, ay + by)
        ]
        widths = np.sqrt(np.abs(area) / np.pi)
        flat = np.abs(area) <= FLAT * levels.perimeters**2
        shift = np.stack(moment, axis=1) / np.where(flat, 1.0, area)[:, None]
        shift[flat] = 0.0
        size = np.linalg.norm(shift, axis=1)
        shift *= np.divide(widths, size, out=np.ones(count), where=size > widths)[:, None]
        centers = centers + np.einsum("ci,cij->cj", shift, frames)
    return centers, widths


@dataclass
class _Chains:
    """Chains of nodes between forks, ends and each other, while some are left out."""

    web: Web
    rows: dict[int, list[int]]
    at: dict[int, set[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, row in self.rows.items():
            for end in (row[0], row[-1]):
                self.at.setdefault(end, set()).add(name)

    def leaf(self, name: int) -> list[int] | None:
        """Return the nodes of a chain from its fork to its free end; None without either."""
        row = self.rows[name]
        free = [len(self.at[end]) == 1 and row[0] != row[-1] for end in (row[0], row[-1])]
        if free[0] == free[1]:
            return None
        return row[::-1] if free[0] else row

    def drop(self, name: int, base: int) -> list[int]:
        """Leave a leaf out; return the chains at its base, joined where only two are left."""
        row = self.rows.pop(name)
        self.at.pop(row[0] if row[-1] == base else row[-1])
        self.at[base].discard(name)
        here = sorted(self.at[base])
        if len(here) != 2:
            return here
        first, second = (self.rows[one] for one in here)
        if first[0] == first[-1] or second[0] == second[-1]:
            return here
        first = first if first[-1] == base else first[::-1]
        second = second if second[0] == base else second[::-1]
        del self.rows[here[1]], self.at[base]
        self.rows[here[0]] = first + second[1:]
        self.at[second[-1]].discard(here[1])
        self.at[second[-1]].add(here[0])
        return [here[0]]


def _chains(web: Web, edges: Index) -> dict[int, list[int]]:
    """Return the chains of the graph, whose inner nodes have two edges."""
    branches = CurveSkeleton.of(web.nodes, edges, web.radii).branches
    return {number: row.tolist() for number, row in enumerate(branches)}


def significance(web: Web, row: list[int]) -> float:
    """Return how far a limb sticks out of the limb at its base, over what is asked."""
    base, tip = row[0], row[-1]
    if web.inside_of[tip] >= 0 and web.inside_of[tip] not in row:
        return 0.0
    place = web.tips[tip] if np.isfinite(web.tips[tip, 0]) else web.nodes[tip]
    away = np.linalg.norm(web.nodes[row] - web.nodes[base], axis=1)
    room = float(web.widths[base])
    height = float(np.linalg.norm(place - web.nodes[base])) - room
    outside = web.widths[np.asarray(row)[away >= room]]
    width = float(np.median(outside)) if len(outside) else room
    return height / max(min(HIGH * room, LONG * width), 1e-300)


def pruned(
    web: Web, edges: Index, areas: FloatArray | None = None, smallest: float = 0.0
) -> list[list[int]]:
    """Leave out limbs that do not stick out, the least significant first.

    With the area of the surface at each node (v,), those on which less hangs than `smallest` go
    as well. Returns the chains of nodes that stay.
    """
    chains = _Chains(web, _chains(web, edges))
    heap: list[tuple[float, int, int]] = []

    def value(row: list[int]) -> float:
        sure = significance(web, row)
        if areas is not None and smallest > 0.0:
            sure = min(sure, float(np.sqrt(areas[row[1:]].sum() / smallest)))
        return sure

    def ask(name: int) -> None:
        row = chains.leaf(name)
        if row is not None and (sure := value(row)) < 1.0:
            heapq.heappush(heap, (sure, name, len(row)))

    for name in chains.rows:
        ask(name)
    while heap:
        _, name, length = heapq.heappop(heap)
        if name not in chains.rows or len(chains.rows[name]) != length:
            continue
        row = chains.leaf(name)
        if row is None or value(row) >= 1.0:
            continue
        for other in chains.drop(name, row[0]):
            ask(other)
    return list(chains.rows.values())


def trimmed(web: Web, rows: list[list[int]]) -> tuple[Mask, FloatArray]:
    """Let each limb end at the center of the largest ball that touches its tip.

    Returns the nodes that stay, and the positions of all.
    """
    stays, nodes = np.zeros(len(web.nodes), bool), web.nodes.copy()
    for row in rows:
        stays[row] = True
    degree = np.bincount([end for row in rows for end in (row[0], row[-1])], minlength=len(stays))
    for row in rows:
        chain, last = np.asarray(row), len(row) - 1
        first, behind = (
            _touching(web, way) if degree[way[0]] == 1 and row[0] != row[-1] else 0
            for way in (chain, chain[::-1])
        )
        if first > last - behind:  # a ball touches both tips
            first = int(web.radii[chain].argmax())
            behind = last - first
        stays[chain[:first]] = False
        stays[chain[last - behind + 1 :]] = False
        left = chain[first : last - behind + 1]
        for way, cut in ((left, first), (left[::-1], behind)):
            if cut and len(way) > 2:
                _straighten(web, way, row[0] if way[0] == left[0] else row[-1], nodes)
    return stays, nodes


def _straighten(web: Web, way: Index, tip: int, nodes: FloatArray) -> None:
    """Put the nodes of an end on a line along the limb: contours tilt towards the tip there."""
    away = np.linalg.norm(web.nodes[way] - web.tips[tip], axis=1)
    beyond = np.flatnonzero(away > FROM_TIP * web.widths[way])[:1]
    if len(beyond) == 0 or not 0 < (k := int(beyond[0])) < len(way) - 1:
        return
    here, width = web.nodes[way[k]], web.widths[way[k]]
    steps = np.linalg.norm(web.nodes[way[k:]] - here, axis=1)
    far = web.nodes[way[k + int((steps >= width).argmax() or len(steps) - 1)]]
    ahead = (here - far) / max(float(np.linalg.norm(here - far)), 1e-300)
    reach = float((web.tips[tip] - here) @ ahead) - width
    if reach > 0.0:
        nodes[way[:k]] = here + reach * np.linspace(1.0, 0.0, k, endpoint=False)[:, None] * ahead


def _touching(web: Web, way: Index) -> int:
    """Return the place on the way from a tip of the last ball that contains this tip.

    At least it is as far from the tip as wide: coarse and pointed caps are in no ball.
    """
    away = np.linalg.norm(web.nodes[way[:-1]] - web.nodes[way[0]], axis=1)
    inside = np.flatnonzero(away <= web.widths[way[:-1]])[-1:].sum()
    return int(max(inside, np.flatnonzero(away > web.widths[way[:-1]])[:1].sum()))


def bridges(levels: LevelSets, web: Web) -> Index:
    """Return edges (b, 2) between the graphs of pieces of the surface that touch.

    Pieces touch at vertices that they share, and where their points are nearer to each other than
    neighbouring points are: they overlap or were cut apart there.
    """
    boundary, node, label = levels.boundary, web.node_of_point, levels.piece.astype(np.int64)
    used = np.flatnonzero((node >= 0) & (boundary.vertex >= 0))
    order = used[np.argsort(boundary.vertex[used], kind="stable")]
    same = boundary.vertex[order[1:]] == boundary.vertex[order[:-1]]
    pairs = np.column_stack([order[:-1][same], order[1:][same]])
    pairs = pairs[label[pairs[:, 0]] != label[pairs[:, 1]]]
    joined, found = _joined(label, pairs, node)
    while True:
        pairs = _nearest_foreign(boundary.points, joined, used)
        gap = np.linalg.norm(np.diff(boundary.points[pairs], axis=1)[:, 0], axis=1)
        near = gap <= levels.spacing[pairs].max(axis=1)
        if not near.any():
            return np.concatenate(found) if found else NONE
        order = np.argsort(gap[near], kind="stable")
        joined, more = _joined(joined, pairs[near][order], node)
        found += more


def _joined(label: Index, pairs: Index, node: Index) -> tuple[Index, list[Index]]:
    """Join pieces along pairs of points that no others join yet; return new labels and edges."""
    parent = list(range(int(label.max(initial=-1)) + 1))

    def root(one: int) -> int:
        while parent[one] != one:
            parent[one] = parent[parent[one]]
            one = parent[one]
        return one

    found = []
    for a, b in pairs.tolist():
        one, two = root(int(label[a])), root(int(label[b]))
        if one != two:
            parent[max(one, two)] = min(one, two)
            found.append(np.array([[node[a], node[b]]]))
    roots = np.array([root(one) for one in range(len(parent))], np.int64)
    return roots[label], found


def _nearest_foreign(points: FloatArray, label: Index, used: Index) -> Index:
    """Return the pair of points from each piece to the nearest other one, (k, 2).

    The k nearest of each point are asked, with k twice as large until no nearer one can be left.
    """
    _, piece = np.unique(label[used], return_inverse=True)
    count = int(piece.max(initial=-1)) + 1
    if count < 2:
        return NONE
    at = points[used]
    tree, rows, near = kd_tree(at), np.arange(len(used)), FEW_NEIGHBOURS
    largest = int(np.bincount(piece).argmax())
    rows = rows[piece != largest]  # its neighbours find it
    best, pair = np.full(count, np.inf), np.full((count, 2), -1)
    while len(rows):
        near = min(near, len(used))
        distance, index = tree.query(at[rows], near)
        foreign = piece[index] != piece[rows, None]
        has = foreign.any(axis=1)
        place = foreign.argmax(axis=1)
        line = np.flatnonzero(has)
        gap = distance[line, place[line]]
        order = np.lexsort((gap, piece[rows[line]]))[::-1]  # the nearest of each piece is last
        mine = piece[rows[line[order]]]
        nearer = gap[order] < best[mine]
        mine, chosen = mine[nearer], line[order][nearer]
        best[mine] = distance[chosen, place[chosen]]
        pair[mine] = np.column_stack([rows[chosen], index[chosen, place[chosen]]])
        if near == len(used):
            break
        rows = rows[~has & (distance[:, -1] < best[piece[rows]])]
        near *= 2
    return used[pair[pair[:, 0] >= 0]]


@dataclass(frozen=True, eq=False, repr=False)
class LevelGround(Bound):
    """The level sets of a mesh and their graph: the same for every threshold and smoothing."""

    web: Web
    contours: int
    edges: Index
    areas: FloatArray
    genus: dict[int, int]
    seams: int
    unclear: int

    @cached_property
    def pruned(self) -> list[list[int]]:
        """The chains of nodes that stay where limbs that do not stick out are left out."""
        return pruned(self.web, self.edges)

    @cached_property
    def _measured(self) -> tuple[FloatArray, FloatArray]:
        """Length and radius of the steps along all limbs."""
        rows = self.pruned
        links = np.concatenate([np.column_stack([row[:-1], row[1:]]) for row in rows] or [NONE])
        step = np.linalg.norm(np.diff(self.web.nodes[links], axis=1)[:, 0], axis=1)
        width = self.web.widths[links].mean(axis=1)
        known = (step > 0.0) & (width > 0.0)
        return step[known], width[known]

    @property
    def slenderness(self) -> float:
        """Length of all limbs over their radius, in the geometric mean by length."""
        step, width = self._measured
        total = float(step.sum())
        return total / float(np.exp(step @ np.log(width) / total)) if total > 0.0 else 0.0

    def share_below(self, radius: float) -> float:
        """Return the share of the length of all limbs that is thinner than a radius."""
        step, width = self._measured
        total = float(step.sum())
        return float(step[width < radius].sum()) / total if total > 0.0 else 0.0


def level_ground(surface: Shape, progress: Progress) -> LevelGround:
    """Return the level sets of a mesh, kept with it."""

    def work() -> LevelGround:
        return run_patiently(lambda: _ground(surface), progress)

    return kept(level_ground, surface, None, work, progress)


def _ground(surface: Shape) -> LevelGround:
    boundary = solid_boundary(surface)
    levels = level_sets(boundary)
    web = web_of(levels)
    edges = np.concatenate([web.edges, bridges(levels, web)])
    node = web.node_of_point[: surface.point_count]
    areas = _areas_of(node, surface, len(web.nodes))
    used = np.bincount(boundary.faces.ravel(), minlength=len(boundary.points)) > 0
    count = len(boundary.seams)
    points = np.bincount(boundary.component[used], minlength=count)
    faces = np.bincount(boundary.component[boundary.faces[:, 0]], minlength=count)
    first = np.unique(levels.piece[used], return_index=True)[1]
    pieces = np.bincount(boundary.component[used][first], minlength=count)
    handles = pieces - (points - faces // 2) // 2  # Euler: points - edges + faces = 2 - 2 genus
    genus = {int(one): int(handles[one]) for one in np.flatnonzero(pieces)}
    doubts = int(boundary.seams.sum()), int(boundary.unclear.sum())
    return LevelGround(web, len(levels.centers), edges, areas, genus, *doubts)


def _areas_of(node: Index, surface: Shape, count: int) -> FloatArray:
    """Return the area of the surface next to each of `count` nodes."""
    known = node >= 0
    area = np.bincount(node[known], surface.point_areas[known], count)
    return area.astype(np.float64)


def level_set_skeleton(
    cloud: MedialCloud, smoothing: float, smallest: float, progress: Progress
) -> CurveSkeleton:
    """Return the curve skeleton of a mesh from its level sets.

    Parameters
    ----------
    cloud : MedialCloud
        Balls of a mesh.
    smoothing : float
        As in `medialis.curve_skeleton`.
    smallest : float
        Area below which a limb is left out.
    progress : Progress

    Returns
    -------
    CurveSkeleton
        Its radii are those of circles with the area of the cross-section.
    """
    ground = level_ground(cloud.surface, progress)
    return run_patiently(lambda: _grown(cloud, ground, smoothing, smallest), progress)


def _grown(
    cloud: MedialCloud, ground: LevelGround, smoothing: float, smallest: float
) -> CurveSkeleton:
    web, edges, surface = ground.web, ground.edges, cloud.surface
    alone = np.bincount(edges.ravel(), minlength=len(web.nodes)) == 0
    rows = ground.pruned if smallest == 0.0 else pruned(web, edges, ground.areas, smallest)
    stays, middles = trimmed(web, rows)
    chains = [_thinned(row[stays[row]], ground.contours) for row in map(np.asarray, rows)]
    links = np.concatenate([np.column_stack([row[:-1], row[1:]]) for row in chains] or [NONE])
    shown = alone.copy()
    for row in chains:
        shown[row] = True
    number = np.cumsum(shown) - 1
    edges_shown = number[links]
    nodes = smooth_nodes(middles[shown], edges_shown, web.radii[shown], smoothing)
    near = number[_nearest_shown(web, edges, shown)]
    of_point = np.where(web.node_of_point >= 0, near[web.node_of_point], -1)
    node = of_point[: surface.point_count]
    graph = CurveSkeleton.of(nodes, edges_shown, web.widths[shown], vertex_node=node, cloud=cloud)
    areas = _areas_of(node, surface, len(nodes))
    widths = np.empty(len(nodes))
    for branch in graph.branches:
        widths[branch] = np.median(graph.radii[branch])
    sure = node_persistence(graph, widths, areas, smallest)
    counts = _by_joined_parts(graph, surface, ground.genus)
    evidence = CurveEvidence.of_level_sets(*counts, ground.seams, ground.unclear)
    hangs = hanging_areas(graph, areas)
    return replace(graph, importance=hangs, persistence=sure, evidence=evidence)


def _by_joined_parts(
    graph: CurveSkeleton, surface: Shape, genus: dict[int, int]
) -> tuple[dict[int, int], dict[int, int]]:
    """Return handles and loops by the lowest component of the surface that a graph joins."""
    node = np.asarray(graph.vertex_node)
    known = node >= 0
    part = np.full(graph.component_count, surface.point_count)
    np.minimum.at(part, graph.components[node[known]], surface.components[known])
    number = np.bincount(graph.components[graph.edges[:, 0]], minlength=len(part))
    loops = number - np.bincount(graph.components, minlength=len(part)) + 1
    joined = np.arange(int(surface.components.max(initial=0)) + 1)
    joined[surface.components[known]] = part[graph.components[node[known]]]
    handles: dict[int, int] = {}
    closed: dict[int, int] = {}
    for one, count in genus.items():
        handles[int(joined[one])] = handles.get(int(joined[one]), 0) + count
    for one, count in zip(part.tolist(), loops.tolist(), strict=True):
        closed[one] = closed.get(one, 0) + count
    return handles, closed


def hanging_areas(graph: CurveSkeleton, areas: FloatArray) -> FloatArray:
    """Return the area on the smaller side of each node, (v,): what would go with the limb there.

    By a spanning tree from the node with the largest radius of each component. `areas` (v,) are
    those of the surface next to each node.
    """
    from scipy.sparse.csgraph import breadth_first_order

    v = len(graph.nodes)
    matrix = link_matrix(v, graph.edges)
    whole = np.bincount(graph.components, areas)[graph.components]
    order = np.lexsort((-graph.radii, graph.components))
    roots = order[np.unique(graph.components[order], return_index=True)[1]]
    below = areas.copy()
    for root in roots.tolist():
        rows, before = breadth_first_order(matrix, root, directed=False)
        for row in rows[:0:-1].tolist():
            below[before[row]] += below[row]
    return np.asarray(np.where(below < whole, np.minimum(below, whole - below), whole))


def _thinned(row: Index, contours: int) -> Index:
    """Leave out the bands inside of a chain: contours are close enough."""
    if len(row) < 6:
        return row
    inner = row[1:-1]
    return np.concatenate([row[:1], inner[inner < contours], row[-1:]])


def _nearest_shown(web: Web, edges: Index, shown: Mask) -> Index:
    """Return the nearest node of the skeleton along the graph for each node, (v,)."""
    from scipy.sparse.csgraph import dijkstra

    v = len(web.nodes)
    length = np.linalg.norm(np.diff(web.nodes[edges], axis=1)[:, 0], axis=1)
    tiny = 1e-12 * max(float(length.max(initial=0.0)), 1e-300)
    both = np.concatenate([edges, edges[:, ::-1]])
    graph = weighted_graph(np.tile(length + tiny, 2), both[:, 0], both[:, 1], v)
    _, _, source = dijkstra(
        graph, indices=np.flatnonzero(shown), min_only=True, return_predecessors=True
    )
    return np.asarray(source)
