"""Parts of a shape: as people see them, its limbs, or its sheets (thesis 6.3.3).

As people see them (method auto): clusters of sites (`sites.py`), whose borders are then drawn into
the valleys of the surface. Labels diffuse over it for a while, implicitly: each part has a share f
of every sample, and the shares minimise the integral of (f - p)^2 + d^2 g |grad f|^2, with p = 1
where the sample was given to the part and 0 elsewhere. The conductance g is small across a valley,
so f drops from 1 to 0 within it; elsewhere it drops where a part is thinnest. Each sample goes to
the part with the largest share. One system of equations, with one factor, serves all parts. Along
an edge the way counts as longer by `LONGER_BENT * d` for each radian that the surface bends
inwards. As that adds up along a way, finer triangles change nothing.

Limbs: told apart from bodies on the curve skeleton. A core is the stretch of it within the ball of
a body: that of a junction, or of a thick place beside a neck. What lies between the cores and
beyond them are arms. Arms that do not stick out belong to their core, arms and cores as thick as it
go on as its trunk, and the others are limbs.

Sheets: each sample belongs to the sheet of its ball.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import algorithm, changed, choice, number, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.from_balls import CurveSkeletonOptions, curve_skeleton
from medialis.segments.sites import (
    SITES,
    SITES_APART,
    Sites,
    all_placements,
    divide_sites,
    edge_walk,
    join_tree,
    members_of,
    share_together,
)
from medialis.shape.graph import dissected, surface_graph
from medialis.shape.labels import (
    Segmentation,
    completed,
    connected_labels,
    diffused_labels,
    fill_components,
    merge_small,
    spread_labels,
    tell_pieces,
)
from medialis.shape.shape import Shape
from medialis.shape.surface import piece_labels
from medialis.sheets.sheets import MedialSheetOptions, medial_sheets
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.preparation import SheetPreparation
from medialis.skeleton.surface_skeleton import balls_of, shape_or_cloud

MOST_JOINED = 2000
"""Parts of which a tree of joins is made: it costs their number squared. More parts than that are
pieces of the surface, which have nothing in common."""

CORE = 0.92  # halved 100 %, doubled 100 %
"""Share of the width of a body up to which its core goes: there a limb 0.4 times as wide comes out
of its ball."""

NECK = 0.6  # halved 50 %, doubled 100 %
"""A place is a body when the branch just outside its ball is less than this share as wide."""

TRUNK = 0.75  # halved 100 %, doubled 100 %
"""Share of its width: a core goes on into arms at least as wide as this, and into another core when
neither is narrower where they meet. Limbs of real shapes are 0.1 to 0.7 as wide as their body, what
goes on in a trunk is 0.85 or more."""

LEAST_LIMB = 1.5  # halved 100 %, doubled 75 %
"""Widths of the core by which the end of a limb is away from its border. The corners of a cube are
1.1 long, a half ball is 1."""


LONGER_BENT = 5.0  # halved 2 %, doubled 0.8 %
"""Distances for a radian: as 0.2 of it let 1 / e of the heat pass between sites."""

SMOOTH_NORMALS = 0.2  # halved 1.0 %, doubled 0.8 %
"""Distances over which normals are averaged, so that noise is no valley."""

GRADIENT_ROUNDS = 50  # halved 0 %, doubled 0 %
"""Of conjugate gradients, for normals: where triangles are slivers they need not be exact."""

BORDER_BAND = 2.0  # halved 1.0 %, doubled 1 %
"""Distances from a border beyond which samples keep their part."""

DIFFUSION = 5  # halved 4 %, doubled 4 %
"""Steps of diffusion in a round."""

USUAL_ROUNDS = 4  # halved 6 %, doubled 11 %
"""Of smoothing, in which heat spreads as far as sites are apart."""

MOST_SURE = 1e9
"""Persistence of a part that nothing could join to another one: hosts show no infinity."""

MOST_LIMBS = 64  # halved 40 %, doubled 0 %
"""Before borders are smoothed. Where noise has more limbs, those of less than this part of the
surface are merged first: every sample would have a share of hundreds."""


def node_widths(skeleton: CurveSkeleton) -> FloatArray:
    """Return how far the surface is from each node, (v,): the mean over the samples round it.

    The samples are those of all nodes in its ball. At least the radius; much larger in flat places
    such as the palm of a hand.
    """
    v, nodes, radii = len(skeleton.nodes), skeleton.nodes, skeleton.radii
    surface, of_sample = skeleton.surface, skeleton.vertex_node
    assert surface is not None and of_sample is not None
    rows = np.flatnonzero(of_sample >= 0)
    node, area = of_sample[rows], surface.point_areas[rows]
    distance = np.linalg.norm(surface.points[rows] - nodes[node], axis=1)
    weight = np.bincount(node, area, minlength=v)
    total = np.bincount(node, area * distance, minlength=v)
    inside = kd_tree(nodes).query_ball_point(nodes, radii, return_sorted=True)
    ball = np.repeat(np.arange(v), [len(one) for one in inside])
    member = np.concatenate([np.asarray(one, np.int64) for one in inside])
    same = skeleton.components[ball] == skeleton.components[member]
    ball, member = ball[same], member[same]
    around = np.bincount(ball, weight[member], minlength=v)
    width = radii.copy()
    np.divide(np.bincount(ball, total[member], minlength=v), around, out=width, where=around > 0)
    return np.maximum(width, radii)


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
    core_of = _cores(graph, width)
    uncut = core_of[graph.edges[:, 0]] == core_of[graph.edges[:, 1]]
    piece = piece_labels(len(core_of), graph.edges[uncut])
    is_core = np.zeros(int(piece.max(initial=-1)) + 1, bool)
    is_core[piece[core_of >= 0]] = True  # the graph is cut round its cores
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
    near, places = graph.neighbours, graph.nodes.tolist()
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


def _stretch(
    places: list[list[float]], near: Sequence[Sequence[int]], start: int, radius: float
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


def _sticks_out(graph: CurveSkeleton, width: FloatArray, core: Mask, arm: Mask) -> bool:
    """Tell whether an arm with a free end is long for its width; one that returns is."""
    a, b = graph.edges.T
    feet = np.concatenate([a[arm[a] & core[b]], b[arm[b] & core[a]]])
    if len(feet) != 1:
        return True
    away = np.linalg.norm(graph.nodes[arm] - graph.nodes[feet[0]], axis=1) + graph.radii[arm]
    return bool(away.max() >= LEAST_LIMB * width[feet[0]])


def into_valleys(surface: Shape, labels: IntArray, distance: float) -> IntArray:
    """Return labels whose borders lie in valleys up to about a distance away.

    Parameters
    ----------
    surface : Shape
        n samples and faces.
    labels : (n,) int32
        -1 takes no part.
    distance : float
        In units of the points.

    Returns
    -------
    (n,) int32
    """
    from scipy.sparse import triu

    near = np.isfinite(_from_borders(surface, labels, BORDER_BAND * distance))
    rows = np.flatnonzero(near & (labels >= 0))
    if len(rows) == 0:
        return labels
    links = triu(surface.cotangent_weights, 1).tocoo()
    ends = links.row, links.col
    flow = np.maximum(links.data, 0.0)
    step = surface.points[ends[1]] - surface.points[ends[0]]
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-6 * distance)
    heat = _Diffusion(surface, rows, ends)
    smooth = heat.spread((SMOOTH_NORMALS * distance) ** 2 * flow, surface.normals, near=True)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1), 1e-300)[:, None]
    turn = ((smooth[ends[1]] - smooth[ends[0]]) * step).sum(axis=1) / length
    longer = length + LONGER_BENT * distance * np.maximum(-turn, 0.0)
    used = np.unique(labels[labels >= 0])
    given = (labels[:, None] == used[None, :]).astype(np.float64)
    share = heat.spread(distance**2 * flow * length / longer, given)
    result = labels.copy()
    result[rows] = used[share[rows].argmax(axis=1)]
    return result


def without_strips(surface: Shape, labels: IntArray, distance: float) -> IntArray:
    """Merge parts that are nowhere farther than a distance from their border with a neighbour.

    Such as the ring where a shaft meets its head. The neighbour is as in `merge_small`.
    """
    away = _from_borders(surface, labels, distance)
    farthest = np.zeros(int(labels.max(initial=-1)) + 1)
    known = labels >= 0
    np.maximum.at(farthest, labels[known], away[known])
    weight = np.where(known & (farthest[labels] < distance), 0.5 / len(labels), 1.0)
    return merge_small(labels, weight, surface_graph(surface), 1.0)


def _from_borders(surface: Shape, labels: IntArray, limit: float) -> FloatArray:
    """Return how far each sample is from an edge between two parts, along edges; inf: farther."""
    from medialis.segments._kernels import far_from

    i, j = surface.edges.T
    border = (labels[i] != labels[j]) & (labels[i] >= 0) & (labels[j] >= 0)
    ends, away = np.zeros(len(labels), bool), np.full(len(labels), np.inf)
    ends[i[border]] = ends[j[border]] = True
    if ends.any():
        walk = edge_walk(surface.points, surface_graph(surface))
        far_from(np.flatnonzero(ends).astype(np.int32), walk, limit, away)
    return away


class _Diffusion:
    """Systems of equations on the samples near borders; the others keep their values."""

    def __init__(self, surface: Shape, rows: Index, ends: tuple[Any, Any]) -> None:
        self.area = surface.point_areas
        place = np.full(surface.point_count, -1)
        place[rows] = np.arange(len(rows))
        inside = (place[ends[0]] >= 0) & (place[ends[1]] >= 0)
        pairs = np.stack([place[end[inside]] for end in ends], axis=1)
        self.rows = rows[dissected(surface.points[rows], pairs)]
        place[self.rows] = np.arange(len(rows))
        self.ends = place[ends[0]], place[ends[1]], ends[0], ends[1]

    def spread(self, flow: FloatArray, values: FloatArray, *, near: bool = False) -> FloatArray:
        """Return f with area (f - values) = the flow into each sample.

        Near: heat goes no farther than some samples; a few rounds of conjugate gradients do.
        """
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        one, two, first, second = self.ends
        k, inside = len(self.rows), (one >= 0) & (two >= 0)
        area = np.maximum(self.area[self.rows], 1e-12 * self.area.max())
        total = area + np.bincount(one[one >= 0], flow[one >= 0], k)
        total += np.bincount(two[two >= 0], flow[two >= 0], k)
        diagonal = np.arange(k)
        here, there, between = one[inside], two[inside], -flow[inside]
        ends = np.r_[diagonal, here, there], np.r_[diagonal, there, here]
        matrix = csc_array((np.r_[total, between, between], ends), shape=(k, k))
        held = area[:, None] * values[self.rows]
        for here, there in ((one, second), (two, first)):
            edge = (here >= 0) & ~inside
            np.add.at(held, here[edge], flow[edge, None] * values[there[edge]])
        if near:
            found = _conjugate_gradients(matrix, total[:, None], held, values[self.rows])
        else:
            found = splu(
                matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            ).solve(held)
        result = values.copy()
        result[self.rows] = found
        return result


def _conjugate_gradients(
    matrix: Any, scale: FloatArray, held: FloatArray, start: FloatArray
) -> FloatArray:
    """Solve systems of equations with one matrix for all columns at once, to 1 / 1000."""
    found = start.copy()
    left = held - matrix @ found
    way = left / scale
    size = enough = (left * way).sum()
    for _ in range(GRADIENT_ROUNDS):
        if not size > 1e-6 * enough:
            break
        across = matrix @ way
        step = size / (way * across).sum()
        found += step * way
        left -= step * across
        across = left / scale
        before, size = size, (left * across).sum()
        way = across + size / before * way
    return found


@dataclass(frozen=True, kw_only=True)
class PartsOptions(SheetPreparation):
    """Options of `parts`.

    horse, cow and fertility have 17, 22 and 23 sheets of 1 % of the surface, two to four times as
    many without a limit. Borders wander by the sample or two by which second feature points do.
    """

    method: str = choice(
        "auto",
        "Method",
        "What parts are; point clouds have sheets in any case.",
        {
            "auto": "Parts as people see them, cut where a shape bends inwards or gets thinner.",
            "limbs": "Parts are cut where limbs leave a body, by the curve skeleton.",
            "sheets": "There is one part for each sheet of the skeleton.",
        },
    )
    level: float = number(
        0.5,
        "Level",
        "Places are in one part where at least this share of people is expected to put them there: "
        "more makes more parts. For the method auto.",
        low=0.02,
        high=0.98,
    )
    count: int = whole(
        0,
        "Number of parts",
        "Divide into so many parts instead, where as many are larger than the smallest part; 0: "
        "as the level says. For the method auto.",
        high=100,
    )
    smallest: float = number(
        0.01,
        "Smallest part",
        "A part that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )
    smoothing: int = whole(
        4,
        "Smoothing",
        "Rounds in which the borders of the parts are straightened.",
        high=100,
    )
    sheet_threshold: float = changed(MedialSheetOptions, "sheet_threshold", advanced=True)
    creases: float = changed(MedialSheetOptions, "creases")

    def size_scale(self, shape: Shape) -> float:
        """Return the size that automatic lengths are fractions of, in diagonals of the shape."""
        return extent_share(shape) if self.method == "auto" and shape.faces is not None else 1.0


@algorithm(PartsOptions, door=shape_or_cloud, prepare=balls_of)
def parts(cloud: MedialCloud, options: PartsOptions, progress: Progress) -> Segmentation:
    """Divide a shape into parts: as people see them, by its limbs, or by its sheets.

    Parameters
    ----------
    cloud : MedialCloud
        All k balls; outer ones take no part.

    Returns
    -------
    Segmentation
        Its ``method`` tells the method that was taken, "auto", "limbs" or "sheets". That of "auto"
        has ``joins``, by which its parts make fewer, and ``persistence``, how many times over each
        is what a part must be (`part_persistence`). Samples without a ball, or a node, have the
        part of the nearest sample along the surface that has one; -1 only in components of the
        surface where no sample has.

    Raises
    ------
    InvalidShapeError
        When limbs are wanted of a point cloud or of a thinned medial cloud.

    See Also
    --------
    curve_skeleton, medial_sheets : what the parts rest on.
    patches : faces between edges instead of limbs.

    Notes
    -----
    Sheets: each sample belongs to the sheet of its own ball, so the borders are the projected
    Y-curves. A limb that goes over into a body without a Y-curve, as fingers do into a flat hand,
    is one part with it, and large bodies have several sheets.

    Limbs need a mesh and its whole inner cloud; each sample belongs to the part of its node. See
    `segments/parts.py`.

    The method "auto" needs the same. It spreads 500 sites over the surface, four times
    (`segments/sites.py`), says for each two how many people would put them into one part
    (`segments/sites.py`), and joins them (`segments/sites.py`): at level 0.5 to the division
    with which most people are expected to agree. Samples have the part with which the sites round
    them have most in common, and borders are drawn into valleys (`segments/parts.py`).

    A round of smoothing is five steps of diffusion of the labels, near the borders; that of "auto"
    is by lengths. Limbs are connected. A sheet may have its two walls in two pieces of the surface:
    a message says so.

    Source: thesis 6.3.3. Deviates: small parts are merged and borders smoothed; the thesis knows
    sheets only, and names cuts round the junctions of curve skeletons as what others do.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> found = medialis.parts(cloud)
    >>> found.count > 4, found.method
    (True, 'auto')
    """
    inner = cloud.inner.own
    if options.method == "limbs":
        return _by_limbs(inner, options, progress)
    if options.method == "auto":
        sites = _sites(inner, progress) if _has_curves(inner) else None
        if sites is not None:
            return as_seen(inner.surface, sites, options, progress)
        text = (
            "Divided by medial sheets (method sheets): other parts need a mesh with an area and "
            "all its inner balls."
        )
        progress.note(text, "divided_by_sheets", reason="no_mesh")
    return _sheet_parts(inner, options, progress)


class SeenSites(NamedTuple):
    """Sites on a surface, and the share of people who put each two into one part."""

    sites: Sites
    shares: FloatArray


def _sites(inner: MedialCloud, progress: Progress) -> SeenSites | None:
    """Spread sites over the surface of a cloud; None where there is no place for any."""

    def spread() -> SeenSites | None:
        with progress.stage("sites", 0.0, 0.3):
            placed = run_patiently(lambda: all_placements(inner), progress)
        if not placed:
            return None
        with progress.stage("pairs", 0.3, 0.8):
            area = inner.surface.point_areas / inner.surface.area
            shares = run_patiently(lambda: share_together(placed, area), progress)
        return SeenSites(placed[0], shares)

    return kept(all_placements, inner, None, spread, progress)


def as_seen(
    surface: Shape, seen: SeenSites, options: PartsOptions, progress: Progress
) -> Segmentation:
    """Divide a surface by its sites."""
    (sites, shares), given = seen, (seen, options)

    def divide() -> Segmentation:
        cluster = divide_sites(shares, sites.areas, options.level, options.count)
        labels = _of_samples(sites, shares, cluster)
        found = _with_tree(_in_valleys(sites, surface, labels, options), *given)
        if options.count > 0:
            return _with_tree(found.joined(options.count), *given)
        assert found.join_levels is not None
        # Sites know what their caps hold; parts have come to belong together since, perhaps.
        turns = int((found.join_levels >= options.level).sum())
        if turns == 0:
            return found
        joined = connected_labels(found.joined(found.count - turns).labels, surface_graph(surface))
        return _with_tree(completed(surface, joined, options.smallest, method="auto"), *given)

    with progress.stage("clusters", 0.8, 1.0):
        return run_patiently(divide, progress)


def _in_valleys(
    sites: Sites, surface: Shape, labels: IntArray, options: PartsOptions
) -> Segmentation:
    """Merge small parts, and draw the borders into valleys."""
    spacing, graph = sites.spacing * surface.diagonal, surface_graph(surface)
    distance = spacing * np.sqrt(options.smoothing / USUAL_ROUNDS)
    labels = connected_labels(labels, graph)
    if surface.components.max(initial=-1) >= SITES:  # too many for each to have a site
        labels = fill_components(surface.components, labels, np.ones(len(labels), np.bool_))
    if options.count == 0 and options.smallest > 0:
        labels = without_strips(surface, labels, SITES_APART * sites.spacing * surface.diagonal)
    found = completed(surface, labels, options.smallest, method="auto")
    if options.smoothing == 0 or found.count < 2:
        return found
    drawn = connected_labels(into_valleys(surface, found.labels, distance), graph)
    return completed(surface, drawn, options.smallest, method="auto")


def _of_samples(sites: Sites, shares: FloatArray, cluster: IntArray) -> IntArray:
    """Give each sample the cluster that the sites round it have most in common with."""
    members = members_of(cluster, sites.areas)
    common = sites.shares @ (shares @ members / members.sum(axis=0))
    known = np.diff(sites.shares.indptr) > 0
    return np.where(known, common.argmax(axis=1), -1).astype(np.int32)


def _with_tree(found: Segmentation, seen: SeenSites, options: PartsOptions) -> Segmentation:
    """Add how sure parts are, and the tree by which they are joined to fewer.

    Very many are joined to none, and nothing is known of them.
    """
    from scipy.sparse import csr_array

    if found.count > MOST_JOINED:
        return replace(found, joins=np.empty((0, 2), np.int32), join_levels=np.empty(0))
    known = np.flatnonzero(found.labels >= 0)
    entries = found.surface.point_areas[known], (known, found.labels[known])
    members = csr_array(entries, shape=(len(found.labels), found.count))
    held = (seen.sites.shares.T @ members).toarray()
    total = held.sum(axis=0)
    between = held.T @ seen.shares @ held
    between /= np.maximum(total[:, None] * total[None, :], 1e-300)
    between = np.clip(between, 0.0, 1.0)
    joins, levels = join_tree(between, np.maximum(total, 1e-300))
    sure = part_persistence(between, found.areas / found.areas.sum(), options)
    return replace(found, joins=joins, join_levels=levels, persistence=sure)


def part_persistence(between: FloatArray, areas: FloatArray, options: PartsOptions) -> FloatArray:
    """Return how sure it is that each part is one of its own.

    A part is none where as many people as the level would put it together with its nearest
    neighbour, and where it is smaller than the smallest part. The number is how many times over it
    is neither: the odds of the level over those of the share of people who would, and the root of
    the areas, as of lengths; the lower of the two. At 1 the part is at the limit.

    Parameters
    ----------
    between : (p, p) float64
        Mean share of people who put places of two parts into one.
    areas : (p,) float64
        Shares of the surface.
    options : PartsOptions
        The level, and the smallest part.

    Returns
    -------
    (p,) float64
        Without a unit, above 0, at most a billion.
    """
    others = between.copy()
    np.fill_diagonal(others, 0.0)
    share = np.clip(others.max(axis=1, initial=0.0), 1.0 / MOST_SURE, 1.0)
    apart = options.level / (1.0 - options.level) * (1.0 - share) / share
    large = np.sqrt(areas / max(options.smallest, 1.0 / MOST_SURE**2))
    return frozen(np.clip(np.minimum(apart, large), 1.0 / MOST_SURE, MOST_SURE), np.float64)


def _by_limbs(inner: MedialCloud, options: PartsOptions, progress: Progress) -> Segmentation:
    """Divide a mesh by its limbs."""
    limbs = kept(_limbs, inner, None, lambda: _limbs(inner, progress), progress)
    surface = inner.surface
    labels = _main_limbs(surface, limbs, progress)

    def straightened() -> Segmentation:
        graph = surface_graph(surface)
        smooth = diffused_labels(labels, graph, DIFFUSION * options.smoothing)
        connected = connected_labels(smooth, graph)
        return completed(surface, connected, options.smallest, method="limbs")

    return run_patiently(straightened, progress)


def _sheet_parts(cloud: MedialCloud, options: PartsOptions, progress: Progress) -> Segmentation:
    """Give each sample the sheet of its ball."""
    sheets = medial_sheets.of(cloud, options, progress)

    def divide() -> Segmentation:
        labels = np.full(cloud.surface.point_count, -1, np.int32)
        labels[cloud.source] = sheets.labels
        steps = DIFFUSION * options.smoothing
        return completed(cloud.surface, labels, options.smallest, method="sheets", steps=steps)

    found = run_patiently(divide, progress)
    tell_pieces(found, progress)
    return found


def _limbs(cloud: MedialCloud, progress: Progress) -> IntArray:
    """Limb or body of each sample of a mesh, before smoothing and merging."""
    surface = cloud.surface
    if not _has_curves(cloud):
        raise InvalidShapeError(
            "Limbs need a mesh with its whole inner cloud; got "
            f"{surface.face_count} faces and {len(cloud)} balls for {surface.point_count} samples. "
            "Use method = sheets."
        )
    share, starts = run_patiently(lambda: extent_share(surface), progress), CurveSkeletonOptions()
    of_extent: dict[str, Any] = {
        name: min(share * starts.auto_starts()[name], 1.0) for name in ("threshold", "candidates")
    }
    skeleton = curve_skeleton.of(cloud, CurveSkeletonOptions(**of_extent), progress)
    node = skeleton.vertex_node
    assert node is not None

    def divide() -> IntArray:
        of_node = find_limbs(skeleton, node_widths(skeleton))
        labels: IntArray = np.where(node < 0, -1, of_node[node]).astype(np.int32)
        return frozen(spread_labels(surface.points, surface_graph(surface), labels), np.int32)

    return run_patiently(divide, progress)


def _main_limbs(surface: Shape, labels: IntArray, progress: Progress) -> IntArray:
    """Merge the smallest limbs where there are very many, and say so."""
    count = len(np.unique(labels[labels >= 0]))
    if count <= MOST_LIMBS:
        return labels
    graph, smallest = surface_graph(surface), surface.area / MOST_LIMBS
    merged = merge_small(labels, surface.point_areas, graph, smallest)
    left = len(np.unique(merged[merged >= 0]))
    if left < count:  # else each is a component of the surface
        text = (
            f"The curve skeleton has {count} limbs, as noise and crossing faces make them; those "
            f"of less than {100 / MOST_LIMBS:.2g} % of the surface were merged: {left} are left."
        )
        progress.note(text, "limbs_merged", limbs=count, left=left)
    return merged


def _has_curves(cloud: MedialCloud) -> bool:
    """Tell whether a curve skeleton can be computed."""
    return cloud.surface.faces is not None and cloud.whole and bool(cloud.valid.any())


def extent_share(shape: Shape) -> float:
    """Return the diagonal of the box along the principal axes of a surface, in its own diagonals.

    The box along the coordinate axes changes by a fifth when a shape is turned.
    """
    area = shape.point_areas
    if not area.sum() > 0.0 or not shape.diagonal > 0.0:
        return 1.0
    points = (shape.points - shape.bounds[0]) / shape.diagonal
    away = points - area @ points / area.sum()
    axes = np.linalg.eigh((away.T * (area / area.sum())) @ away)[1]
    return float(np.linalg.norm(np.ptp(away @ axes, axis=0)))
