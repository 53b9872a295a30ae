"""Sites on a surface, how likely people put two of them into one part, and their clusters.

Sites: even places that do not depend on the mesh. They lie on lines along the principal axes, so
that they turn with the surface, and copies with other triangles have the same. Each quantity is a
mean over the surface round a site, in a cap that overlaps with those of other sites; all caps
together weigh every sample the same.

Shares: for each pair of sites a few quantities say how the surface leads from one to the other: how
much the radius changes on the way, how much the surface bends inwards, and how heat spreads between
them, over the surface as it is and over one that hardly lets it pass where it bends inwards. A
weighted sum of these gives the share of people who see one part. Heat also jumps between the two
places that a ball touches, as often as it would walk so far: the two walls of a cup are as one, and
both sides of a limb are closer than the way round it. Quantities are means over several placements
of the sites, so that it matters little where they lie.

Clusters: those with the largest mean share are joined first, which makes a tree: a level of it is a
division of the surface. Then sites move to the cluster with which they have most in common, as long
as more people agree with that. Several levels of the tree are tried: what most people agree with is
then the same on copies of a surface that differ a little, where a single start would lead to one
place or another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Ragged, kd_tree, unit_rows
from medialis.base.kept import Bound
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray, require_rows
from medialis.shape.graph import nearest_seeds, surface_graph
from medialis.shape.surface import Surface
from medialis.skeleton.medial_cloud import MedialCloud

if TYPE_CHECKING:
    from medialis.segments._kernels import Graph

SITES = 500  # halved 60 %, doubled 31 %
"""Each stands for 0.2 % of the surface, a fifth of the smallest part by default."""

MOST_SITES, WIDER = 3, 1.25
"""More than so many times the sites asked for come where a surface lies in pieces with space
between them: they are chosen farther apart then, by so much. What follows costs their number cubed.
"""

CANDIDATES = 10  # halved 37 %, doubled 17 %
"""Places to choose a site from."""

SHORTEST_STEP = 1e-4  # halved 0 %, doubled 0 %
"""Diagonals that the lines are apart at least: a needle would have millions of them."""

SITES_APART = 0.835  # halved 100 %, doubled 100 %
"""Spacings that sites are apart at least. Places taken one by one at random, as long as there is
room, then hold 0.547 of the plane with discs of this diameter: one site in each square spacing."""

GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])
"""1 / g and 1 / g^2 with g^3 = g + 1."""

PLACEMENTS = 4
"""What is measured is the mean over so many placements of the sites, the lines turned each time."""

TURN = 1.0  # halved 25 %, doubled 11 %
"""Radians between the lines of two placements, about the sum of the principal axes."""

CAP = 1.3  # halved 100 %, doubled 100 %
"""Radius of a cap in spacings of the sites, the root of the area that each stands for. No place of
a surface is much farther than `SITES_APART` from its nearest site, along edges a little more."""

APART_ACROSS = 0.5  # halved 30 %, doubled 10 %
"""Spacings that opposite normals count as apart, halved: both walls of a thin plate get sites."""

COMMON_SHARE = 0.02  # halved 21 %, doubled 29 %
"""Caps are neighbours when they have more than this share of their area in common."""

HEAT = (1 / 100, 1 / 25, 1 / 8)
"""Times at which heat is looked at: it has spread over about this share of the surface."""

HEAT_GONE = 10.0  # halved 29 %, doubled 0 %
"""Modes of which less than exp(-10) is left at a time are left out: a tenth is enough for most."""

PASSING_BEND = 0.2  # halved 100 %, doubled 100 %
"""Bend in radians from one site to the next that lets 1 / e of the heat pass. A crease of 90
degrees lets 1 / 1000 pass."""

ACROSS_SHARE = 0.1  # halved 4 %, doubled 12 %
"""Share of a cap from which the caps across its balls are neighbours of its ball."""

JUMP_BEND = 0.02  # halved 33 %, doubled 29 %
"""Radians that a jump across a ball counts as at least: two spacings of the way."""

SHORTEST_JUMP = 0.2  # halved 0 %, doubled 0 %
"""Spacings: across anything thinner heat jumps as often as this."""

LARGEST_COST = 9.0  # halved 0 %, doubled 0 %
"""Of what cannot be reached; the largest that quantities have elsewhere."""

LEAST_IN_CAP = 0.1  # halved 7 %, doubled 33 %
"""Root of the weight of a site at the rim of its cap: no sample in it counts for nothing."""

LEAST_RESISTANCE = 0.1  # halved 33 %, doubled 54 %
"""Added to resistances of which the logarithm is taken: that of places next to each other."""

LEAST_STEP = 1e-3  # halved 0 %, doubled 0 %
"""Spacings between two sites at least: of those at one place nothing can be said."""

WALKED = 0.01  # halved 54 %, doubled 46 %
"""Radians that a way of one spacing counts as where the surface is flat."""

BEND_SCALE = 3.0  # halved 66 %, doubled 50 %
"""Times the bends of which the logarithm is taken: bends of a third of a radian are few."""

NAMES = (
    "radius", "bends",
    "heat_early", "heat", "heat_late", "resistance",
    "held_early", "held", "held_late", "held_resistance",
)  # fmt: skip
"""Quantities of two sites."""

OFFSET = -1.175
WEIGHTS = (
    -0.943, 3.365,
    -1.989, -3.245, -6.693, 7.069,
    0.348, 2.720, 7.468, -9.239,
)  # fmt: skip
"""Chosen by logistic regression on what people did with 76 models of 19 classes and on 32 generated
bodies whose parts are beyond doubt, all with the same weight, and so that turned, split, decimated
and noisy copies of a model have the same sums; `benchmarks/parts.py left_out` chooses them anew,
and measures classes that are left out."""

MOVES = 20  # halved 3 %, doubled 18 %
"""Rounds in which sites move, each one half of them. Few need more than ten."""

STARTS = (0.0, -0.4, 0.4, -0.85, 0.85)
"""Levels of the tree to begin with, as differences of the logarithm of level / (1 - level): about
0.5, 0.4, 0.6, 0.3 and 0.7. Thirteen between 0.2 and 0.8 lead to the same on nearly all shapes."""

ROUNDING = 1e-12  # halved 0 %, doubled 0 %
"""Differences of agreement that count for nothing."""

SITES_A_CHUNK, FACES_A_CHUNK = 64, 4096


@dataclass(frozen=True, eq=False, repr=False)
class Sites(Bound):
    """Places spread evenly over a surface, and means over the caps round them.

    Lengths are in diagonals of the surface.

    Attributes
    ----------
    shares : (n, s) sparse float64
        Share of each site in each sample; the rows add up to 1, to 0 where no site is near.
    areas : (s,) float64
    places, normals : (s, 3) float64
        Mean place, unit mean normal.
    radii : (s,) float64
        Mean radius of the balls of the samples.
    overlaps : (s, s) float64
        Area that two caps have in common.
    across : (s, s) float64
        Area of samples in one cap whose ball touches the surface in the other as well.
    components : (s,) int32
        Of the surface.
    """

    shares: Any
    areas: FloatArray
    places: FloatArray
    normals: FloatArray
    radii: FloatArray
    overlaps: FloatArray
    across: FloatArray
    components: IntArray

    def __len__(self) -> int:
        return len(self.areas)

    @property
    def spacing(self) -> float:
        """Root of the area that each site stands for in the mean."""
        return float(np.sqrt(self.areas.sum() / len(self)))


def all_placements(
    cloud: MedialCloud, count: int = SITES, placements: int = PLACEMENTS
) -> list[Sites]:
    """Spread about `count` sites over the surface of a mesh several times; none without area."""
    surface = _unit_surface(cloud)
    if not surface.area > 0.0:
        return []
    frame, used = principal_axes(surface), np.flatnonzero(surface.used_points)
    side = APART_ACROSS * np.sqrt(surface.area / count)
    samples = np.concatenate([surface.points, side * cloud.surface.normals], axis=1)
    tree, walk = kd_tree(samples[used]), edge_walk(surface.points, surface_graph(cloud.surface))
    placed = []
    for placement in range(placements):
        places, normals = even_places(surface, count, placement, frame)
        if len(places):
            near = tree.query(np.concatenate([places, side * normals], axis=1))[1]
            starts = used[near].astype(np.int32)
            placed.append(_sites(cloud, surface, walk, places, starts))
    return placed


def edge_walk(points: FloatArray, graph: Ragged) -> Graph:
    """Return a graph of n vertices with the lengths of its links."""
    from medialis.segments._kernels import Graph, measure_links

    walk = Graph(graph.offsets, graph.indices, np.empty(len(graph.indices)))
    run_chunks(measure_links, len(points), FACES_A_CHUNK, points, walk)
    return walk


def _sites(
    cloud: MedialCloud, surface: Surface, walk: Graph, places: FloatArray, starts: IntArray
) -> Sites:
    """Measure the surface, of diagonal 1, round places with these nearest samples."""
    from scipy.sparse import csr_array, diags_array

    spacing = float(np.sqrt(surface.area / len(places)))
    gaps = np.linalg.norm(surface.points[starts] - places, axis=1)
    caps = _caps(surface, walk, starts, gaps, CAP * spacing)
    total = np.asarray(caps.sum(axis=1)).reshape(-1)
    shares = csr_array(diags_array(1.0 / np.where(total > 0, total, 1.0)) @ caps)
    area, every = surface.point_areas, np.arange(surface.point_count)
    areas = np.maximum(shares.T @ area, 1e-9 * surface.area)
    radii, across = _balls(cloud, surface, shares)
    return Sites(
        shares=shares,
        areas=areas,
        places=shares.T @ (area[:, None] * surface.points) / areas[:, None],
        normals=unit_rows(shares.T @ (area[:, None] * cloud.surface.normals)),
        radii=np.maximum(radii, LEAST_STEP * spacing),
        overlaps=in_common(shares, shares, every, every, area),
        across=across,
        components=cloud.surface.components[starts],
    )


def in_common(
    own: Any, other: Any, rows: NDArray[Any], others: NDArray[Any], weights: FloatArray
) -> FloatArray:
    """Return own[rows].T @ diag(weights) @ other[others], of sparse shares of sites in samples."""
    from medialis.segments._kernels import Caps, add_in_common

    require_rows(rows, own.shape[0], "samples of sites")
    require_rows(others, other.shape[0], "samples across sites")
    found = np.zeros((own.shape[1], other.shape[1]))
    pairs = rows.astype(np.int32), others.astype(np.int32), np.array(weights)
    caps = (Caps(shares.indptr, shares.indices, shares.data) for shares in (own, other))
    add_in_common(*pairs, *caps, found)
    return found


def even_places(
    surface: Surface,
    count: int,
    placement: int = 0,
    frame: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return places that lie evenly on a surface, (s, 3), and the normals of their faces.

    About `count`, on lines along the axes of a frame, else of `principal_axes`. They do not depend
    on how the surface is divided into triangles, and turn with it where its principal axes differ
    in length.
    """
    from medialis.segments._kernels import choose_apart

    assert surface.faces is not None
    middle, axes = frame or principal_axes(surface)
    axes = axes @ _turned(placement)
    points = np.ascontiguousarray((surface.points - middle) @ axes)
    # Lines along three axes cross a unit of area 1.5 times in the mean, for one line in each unit.
    step = float(np.sqrt(1.5 * surface.area / (CANDIDATES * count)))
    step = max(step, SHORTEST_STEP * surface.diagonal)
    crossed = _crossings(points, surface.faces, step)
    places = np.concatenate([places for places, _ in crossed])
    face = np.concatenate([faces for _, faces in crossed])
    if len(places) == 0:
        return np.empty((0, 3)), np.empty((0, 3))
    normals = surface.face_normals[face]
    spacing = np.sqrt(surface.area / count)
    apart = np.concatenate([places, APART_ACROSS * spacing * (normals @ axes)], axis=1)
    order = _in_turn(places, np.repeat(np.arange(3), [len(one) for one, _ in crossed]), step)
    chosen, distance = np.empty(len(places), np.int64), SITES_APART * spacing
    while (used := choose_apart(apart[order], distance, chosen)) > MOST_SITES * count:
        distance *= WIDER
    rows = order[chosen[:used]]
    return places[rows] @ axes.T + middle, normals[rows]


def _turned(placement: int) -> FloatArray:
    """Return the rotation of the lines for one of several placements, (3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(placement * TURN * np.ones(3) / 3**0.5).as_matrix())


def _in_turn(places: FloatArray, axis: IntArray, step: float) -> Index:
    """Return an order of the places in which near ones are far from each other.

    It follows from their lines alone, so that a surface that is moved a little keeps nearly all of
    its sites. The lines come in the order of the golden sequence of two dimensions.
    """
    turn = np.zeros(len(places))
    for one in range(3):
        rows = axis == one
        line = np.rint(places[rows][:, [(one + 1) % 3, (one + 2) % 3]] / step - 0.5)
        turn[rows] = (line @ GOLDEN + one / 3) % 1.0
    along = places[np.arange(len(places)), axis]
    return np.lexsort((along, np.round(turn, 9)))


def _crossings(points: FloatArray, faces: IntArray, step: float) -> list[tuple[FloatArray, Index]]:
    """Return where lines of a lattice along each axis cross faces, and which faces these are."""
    from medialis.segments._kernels import list_crossings, mark_crossed

    cells, crossed = np.ceil(points / step - 0.5), np.empty((len(faces), 3), np.bool_)
    run_chunks(mark_crossed, len(faces), FACES_A_CHUNK, cells, faces, crossed)
    found = []
    for axis in range(3):
        rows = np.flatnonzero(crossed[:, axis])
        places, counts = list_crossings(points, faces[rows], axis, step)
        found.append((places, np.repeat(rows, counts)))
    return found


def principal_axes(surface: Surface) -> tuple[FloatArray, FloatArray]:
    """Return the middle of a surface, (3,), and its principal axes, the columns of (3, 3).

    From the exact moments of the triangles. An axis points to where the surface lies farther out.
    """
    assert surface.faces is not None
    corners = [surface.points[surface.faces[:, k]] for k in range(3)]
    weight = surface.face_areas / surface.area
    middle = weight @ (corners[0] + corners[1] + corners[2]) / 3
    away = [corner - middle for corner in corners]
    away.append(away[0] + away[1] + away[2])
    moments = sum((one.T * weight) @ one for one in away) / 12
    axes = np.linalg.eigh(moments)[1]
    skew = weight @ (away[3] @ axes) ** 3
    return middle, axes * np.where(skew < 0, -1.0, 1.0)


def _unit_surface(cloud: MedialCloud) -> Surface:
    """Return the surface with diagonal 1 near the origin: no product is out of range."""
    surface = cloud.surface
    low, high = surface.bounds
    middle = low + (high - low) / 2
    return Surface.of_checked((surface.points - middle) / surface.diagonal, surface.faces)


def _caps(surface: Surface, walk: Graph, starts: IntArray, gaps: FloatArray, radius: float) -> Any:
    """Weight of each site in each sample, (n, s) sparse: (1 - (d / radius)^2)^2.

    A sample that no cap holds has its nearest site along the edges.
    """
    from scipy.sparse import csc_array, csr_array

    from medialis.segments._kernels import near_sites

    n, s = surface.point_count, len(starts)
    counts, rows = np.zeros(s, np.int64), np.zeros(s + 1, np.int64)
    found: list[Any] = [None] * -(-s // SITES_A_CHUNK)

    def search(begin: int, end: int) -> None:
        found[begin // SITES_A_CHUNK] = near_sites(begin, end, walk, starts, gaps, radius, counts)

    run_chunks(search, s, SITES_A_CHUNK)
    rows[1:] = np.cumsum(counts)
    samples, distance = (np.concatenate(part) for part in zip(*found, strict=True))
    weight = np.maximum(1.0 - np.minimum(distance / radius, 1.0) ** 2, LEAST_IN_CAP) ** 2
    caps = csr_array(csc_array((weight, samples, rows), shape=(n, s)))
    alone = np.diff(caps.indptr) == 0
    if not alone.any():
        return caps
    site_of = np.full(n, -1)
    site_of[starts[::-1]] = np.arange(s)[::-1]
    graph = Ragged(walk.offsets, walk.neighbours)
    seed = nearest_seeds(surface.points, graph, site_of >= 0)[0]
    rest = np.flatnonzero(alone & (seed >= 0))
    ones = (np.ones(len(rest)), (rest, site_of[seed[rest]]))
    return csr_array(caps + csr_array(ones, shape=(n, s)))


def _balls(cloud: MedialCloud, surface: Surface, shares: Any) -> tuple[FloatArray, FloatArray]:
    """Mean radius of the balls round each site, and the area of what lies across them."""
    diagonal, n = cloud.surface.diagonal, surface.point_count
    rows = np.flatnonzero(cloud.valid)
    sample, area = cloud.source[rows], np.zeros(n)
    area[sample] = surface.point_areas[sample]
    radius = np.zeros(n)
    radius[sample] = cloud.radii[rows] / diagonal
    weight = shares.T @ area
    radii = shares.T @ (area * radius) / np.where(weight > 0, weight, 1.0)
    feet = cloud.features[rows]
    other = np.where(feet[:, 0] == sample, feet[:, 1], feet[:, 0])
    linked = other >= 0
    ends = (sample[linked], other[linked])
    across = in_common(shares, shares, *ends, surface.point_areas[ends[0]])
    return radii, across + across.T


def share_together(placements: Sequence[Sites], area: FloatArray) -> FloatArray:
    """Return the share of people who are expected to see one part, for each pair of sites, (s, s).

    0 between components of the surface.

    Parameters
    ----------
    placements : sequence of Sites
        Of the same surface; the result is for the sites of the first one.
    area : (n,) float64
        Of the samples.
    """
    sites = placements[0]
    total = np.full((len(sites), len(sites)), OFFSET)
    for other in placements:
        found = np.zeros((len(other), len(other)))
        for quantity, weight in zip(pair_quantities(other), WEIGHTS, strict=True):
            found += weight * quantity
        total += _carried(sites, other, area, found) / len(placements)
    shares = 1.0 / (1.0 + np.exp(np.clip(-total, -50.0, 50.0)))
    shares = (shares + shares.T) / 2
    shares[sites.components[:, None] != sites.components[None, :]] = 0.0
    return shares


def mean_quantities(placements: Sequence[Sites], area: FloatArray) -> list[FloatArray]:
    """Return the quantities of all pairs of sites of the first placement, means over all."""
    total = [np.zeros((len(placements[0]), len(placements[0]))) for _ in NAMES]
    for other in placements:
        for mean, found in zip(total, pair_quantities(other), strict=True):
            mean += _carried(placements[0], other, area, found) / len(placements)
    return total


def _carried(sites: Sites, other: Sites, area: FloatArray, values: FloatArray) -> FloatArray:
    """Means of the values of pairs of other sites over the caps of pairs of sites."""
    from scipy.sparse import csr_array

    every = np.arange(len(area))
    common = in_common(sites.shares, other.shares, every, every, area)
    total = common.sum(axis=1)
    mean = csr_array(common / np.where(total > 0, total, 1.0)[:, None])
    return np.asarray(mean @ (mean @ values).T).T


def pair_quantities(sites: Sites) -> list[FloatArray]:
    """Return the quantities of all pairs of sites, (s, s) each, in the order of `NAMES`."""
    s, spacing = len(sites), sites.spacing
    own = np.sqrt(np.diag(sites.overlaps))
    common = sites.overlaps / np.maximum(np.outer(own, own), 1e-300)
    np.fill_diagonal(common, 0.0)
    one, two = np.nonzero(common > COMMON_SHARE)
    step = sites.places[two] - sites.places[one]
    length = np.maximum(np.linalg.norm(step, axis=1), LEAST_STEP * spacing)
    turn = ((sites.normals[two] - sites.normals[one]) * step).sum(axis=1) / length
    bend = np.maximum(-turn, 0.0)
    across = _across(sites)
    jump = np.nonzero(np.where(across > ACROSS_SHARE, across, 0.0))
    ends = np.concatenate([one, jump[0]]), np.concatenate([two, jump[1]])
    # The mean over the neighbours.
    total = np.maximum(sites.overlaps.sum(axis=1), 1e-300)
    log_radius = (sites.overlaps @ np.log(sites.radii)) / total
    way = WALKED * length / spacing
    bends = np.concatenate([bend + way, np.full(len(jump[0]), JUMP_BEND)])
    found = [
        _least(np.abs(log_radius[ends[1]] - log_radius[ends[0]]), ends, s),
        np.log1p(BEND_SCALE * _least(bends, ends, s)),
    ]
    flow = sites.overlaps[one, two]
    # The mean square of the step of a random walk in time t is 4 t.
    flow = flow * (4.0 * s * spacing**2 / (flow * length**2).sum()) if len(flow) else flow
    area = sites.areas * (s / sites.areas.sum())
    jumps, jumping = _jumps(sites)
    ends = np.concatenate([one, jumps[0]]), np.concatenate([two, jumps[1]])
    for passing in (flow, flow * np.exp(-bend / PASSING_BEND)):
        found += _heat(np.concatenate([passing, jumping]), ends, area)
    return found


def _jumps(sites: Sites) -> tuple[tuple[Any, Any], FloatArray]:
    """Pairs of sites that balls touch both of, and how much heat jumps from one to the other."""
    across = sites.across.copy()
    np.fill_diagonal(across, 0.0)
    one, two = np.nonzero(across)
    gap = np.linalg.norm(sites.places[two] - sites.places[one], axis=1)
    gap = np.maximum(gap, SHORTEST_JUMP * sites.spacing)
    # Steps of a length `gap`: their mean square in time t is 4 t as well.
    return (one, two), across[one, two] / 2 * 4.0 / gap**2


def _across(sites: Sites) -> FloatArray:
    """Share of two caps that lies across from the other, the mean of both; diagonal 0."""
    share = sites.across / sites.areas[:, None]
    share = np.minimum(1.0, 0.5 * (share + share.T))
    np.fill_diagonal(share, 0.0)
    return np.asarray(share)


def _least(cost: FloatArray, ends: tuple[Any, Any], s: int) -> FloatArray:
    """Cost of the cheapest path between all pairs, at most `LARGEST_COST`; ends both ways."""
    from medialis.segments._kernels import least_sums

    costs = np.full((s, s), np.inf, np.float32)
    np.minimum.at(costs, ends, cost)
    least_sums(costs, np.float32(LARGEST_COST))
    return np.minimum(costs, LARGEST_COST, dtype=np.float64)


def _heat(flow: FloatArray, ends: tuple[Any, Any], area: FloatArray) -> list[FloatArray]:
    """How much of the heat of two sites is common at each time, 0 to 1, and their resistance.

    The resistance is that of heat which has spread a little, as that of points only tells how many
    neighbours they have.
    """
    from scipy.linalg import eigh

    s = len(area)
    links = np.zeros((s, s))
    np.add.at(links, ends, flow)
    links = (links + links.T) / 2
    root = np.sqrt(area)
    matrix = (np.diag(links.sum(axis=1)) - links) / (root[:, None] * root[None, :])
    # Of a few modes vectors are found one by one.
    slowest = (-np.inf, HEAT_GONE / (HEAT[0] * s))
    rate, mode = eigh(matrix, driver="evr", subset_by_value=slowest, check_finite=False)
    rate, mode = np.maximum(rate, 0.0), mode / root[:, None]
    found: list[FloatArray] = []
    for share in HEAT:
        left = np.searchsorted(share * s * rate, HEAT_GONE)  # rates rise
        half = mode[:, :left] * np.exp(-share * s * rate[:left] / 2)
        heat = half @ half.T
        own = np.sqrt(np.maximum(np.diag(heat), 1e-300))
        found.append(np.clip(heat / (own[:, None] * own[None, :]), 0.0, 1.0))
    moving = rate > 1e-8
    slow = mode[:, moving] * np.exp(-HEAT[0] * s * rate[moving] / 2) / np.sqrt(rate[moving])
    inner = slow @ slow.T
    own = np.diag(inner)
    resistance = np.maximum(own[:, None] + own[None, :] - 2 * inner, 0.0)
    found.append(np.log(resistance + LEAST_RESISTANCE))
    return found


def divide_sites(shares: FloatArray, areas: FloatArray, level: float, count: int = 0) -> IntArray:
    """Return the cluster of each of s sites, (s,), numbered from 0.

    Parameters
    ----------
    shares : (s, s) float64
        Of people who put both sites in one part; 0: never.
    areas : (s,) float64
    level : float
        Clusters are joined while their mean share is at least this.
    count : int
        Join to so many clusters instead, where shares are above 0; 0: by the level.
    """
    pairs, joined = join_tree(shares, areas)
    s, weight = len(areas), areas / areas.sum()
    if count > 0:
        turns = min(max(s - count, 0), len(pairs))
        level = float(joined[turns - 1]) if turns else 1.0
        return _moved(shares, weight, _after_joins(pairs[:turns], s), level, True)
    starts = np.log(level / (1.0 - level)) + np.array(STARTS)
    best, most = np.zeros(s, np.int32), -np.inf
    tried: set[int] = set()
    for start in 1.0 / (1.0 + np.exp(-starts)):
        turns = int((joined >= start).sum())
        if turns in tried:
            continue
        tried.add(turns)
        moved = _moved(shares, weight, _after_joins(pairs[:turns], s), level, False)
        found = _joined(shares, areas, moved, level)
        agreed = _agreement(shares, weight, found, level)
        if agreed > most + ROUNDING:
            best, most = found, agreed
    return best


def members_of(cluster: IntArray, areas: FloatArray) -> FloatArray:
    """Return the area of each site in the column of its cluster, (s, c)."""
    members = np.zeros((len(areas), int(cluster.max(initial=0)) + 1))
    members[np.arange(len(areas)), cluster] = areas
    return members


def _agreement(shares: FloatArray, areas: FloatArray, cluster: IntArray, level: float) -> float:
    """Sum of share - level over the areas of all pairs in one cluster."""
    members = members_of(cluster, areas)
    return float((members * ((shares - level) @ members)).sum())


def join_tree(shares: FloatArray, areas: FloatArray) -> tuple[IntArray, FloatArray]:
    """Join clusters from s single ones on, those with the largest mean share first.

    Returns
    -------
    pairs : (j, 2) int32
        Clusters that are joined, by their lowest member; the second one becomes part of the first.
    joined : (j,) float64
        Their mean share, which never rises. j < s - 1 where shares are 0.
    """
    from medialis.segments._kernels import average_linkage

    s = len(areas)
    pairs, joined = np.empty((max(s - 1, 0), 2), np.int32), np.empty(max(s - 1, 0))
    turns = average_linkage(np.array(shares), np.array(areas), pairs, joined) if s else 0
    return pairs[:turns], np.minimum.accumulate(joined[:turns])


def _after_joins(pairs: IntArray, s: int) -> IntArray:
    """Cluster of each of s sites after these joins."""
    lowest = np.arange(s)
    for kept, dropped in pairs[::-1].tolist():  # the last ones first: their target is final
        lowest[dropped] = lowest[kept]
    return np.unique(lowest, return_inverse=True)[1].reshape(-1).astype(np.int32)


def _joined(shares: FloatArray, areas: FloatArray, cluster: IntArray, level: float) -> IntArray:
    """Join clusters whose mean share has come up to the level since sites moved."""
    members = members_of(cluster, areas)
    total = members.sum(axis=0)
    between = members.T @ shares @ members / np.outer(total, total)
    pairs, joined = join_tree(between, total)
    return _after_joins(pairs[: int((joined >= level).sum())], len(total))[cluster]


def _moved(
    shares: FloatArray, areas: FloatArray, cluster: IntArray, level: float, keep_all: bool
) -> IntArray:
    """Move sites to where the sum of share - level over the areas of a cluster is largest.

    That is the Rand index which can be expected, at level 0.5: each move raises it. Neighbours in
    the order of the sites take turns, as moves of both at once might lower it.
    """
    site, turn = np.arange(len(areas)), 0
    gains = shares - level
    np.fill_diagonal(gains, 0.0)
    moved, still = cluster.copy(), 0
    while turn < MOVES and still < 2:
        # As many columns as at first: a cluster that lost all its sites may get some again.
        members = np.zeros((len(areas), int(cluster.max(initial=0)) + 1))
        members[site, moved] = areas
        gain = gains @ members
        best = gain.argmax(axis=1)
        better = (gain[site, best] > gain[site, moved] + ROUNDING) & (site % 2 == turn % 2)
        moved[better] = best[better]
        still, turn = 0 if better.any() else still + 1, turn + 1
    used, number = np.unique(moved, return_inverse=True)
    if keep_all and len(used) <= cluster.max(initial=0):
        return cluster
    return number.reshape(-1).astype(np.int32)
