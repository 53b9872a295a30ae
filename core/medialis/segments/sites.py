"""Even sites on a surface that do not depend on its mesh, and what the surface is like round them.

The sites lie on lines along the principal axes, so that they turn with the surface, and copies with
other triangles have the same. Each quantity is a mean over the surface round a site, in a cap that
overlaps with those of other sites; all caps together weigh every sample the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Bound
from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.model.surface import Surface
from medialis.surface.surface_graph import surface_graph
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray

SITES = 500
"""Each stands for 0.2 % of the surface, a fifth of the smallest part by default."""

CANDIDATES = 10
"""Places to choose a site from."""

SHORTEST_STEP = 1e-4
"""Diagonals that the lines are apart at least: a needle would have millions of them."""

APART = 0.835
"""Spacings that sites are apart at least. Places taken one by one at random, as long as there is
room, then hold 0.547 of the plane with discs of this diameter: one site in each square spacing."""

GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])
"""1 / g and 1 / g^2 with g^3 = g + 1."""

PLACEMENTS = 4
"""What is measured is the mean over so many placements of the sites, the lines turned each time."""

TURN = 1.0
"""Radians between the lines of two placements, about the sum of the principal axes."""

CAP = 1.3
"""Radius of a cap in spacings of the sites, the root of the area that each stands for. No place of
a surface is much farther than `APART` from its nearest site, along edges a little more."""

ACROSS = 0.5
"""Spacings that opposite normals count as apart, halved: both walls of a thin plate get sites."""

CHUNK = 64
FACES_A_CHUNK = 4096


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
    from scipy.spatial import cKDTree

    surface = _unit_surface(cloud)
    if not surface.area > 0.0:
        return []
    frame, used = principal_axes(surface), np.flatnonzero(surface.used_points)
    side = ACROSS * np.sqrt(surface.area / count)
    samples = np.concatenate([surface.points, side * cloud.surface.normals], axis=1)
    tree = cKDTree(samples[used])
    placed = []
    for placement in range(placements):
        places, normals = even_places(surface, count, placement, frame)
        if len(places):
            near = tree.query(np.concatenate([places, side * normals], axis=1))[1]
            placed.append(_sites(cloud, surface, places, used[near].astype(np.int32)))
    return placed


def _sites(cloud: MedialCloud, surface: Surface, places: FloatArray, starts: IntArray) -> Sites:
    """Measure the surface, of diagonal 1, round places with these nearest samples."""
    from scipy.sparse import csr_array, diags_array

    spacing = float(np.sqrt(surface.area / len(places)))
    gaps = np.linalg.norm(surface.points[starts] - places, axis=1)
    caps = _caps(surface, surface_graph(cloud.surface), starts, gaps, CAP * spacing)
    total = np.asarray(caps.sum(axis=1)).reshape(-1)
    shares = csr_array(diags_array(1.0 / np.where(total > 0, total, 1.0)) @ caps)
    area, every = surface.point_areas, np.arange(surface.point_count)
    areas = np.maximum(shares.T @ area, 1e-9 * surface.area)
    mean_places = shares.T @ (area[:, None] * surface.points) / areas[:, None]
    normal = shares.T @ (area[:, None] * cloud.surface.normals)
    length = np.linalg.norm(normal, axis=1)[:, None]
    radii, across = _balls(cloud, surface, shares)
    return Sites(
        shares=shares,
        areas=areas,
        places=mean_places,
        normals=np.divide(normal, length, out=np.zeros_like(normal), where=length > 0),
        radii=np.maximum(radii, 1e-3 * spacing),
        overlaps=in_common(shares, shares, every, every, area),
        across=across,
        components=cloud.surface.components[starts],
    )


def in_common(
    own: Any, other: Any, rows: NDArray[Any], others: NDArray[Any], weights: FloatArray
) -> FloatArray:
    """Return own[rows].T @ diag(weights) @ other[others], of sparse shares of sites in samples."""
    from medialis.segments._site_kernels import add_in_common

    found = np.zeros((own.shape[1], other.shape[1]))
    pairs = rows.astype(np.int32), others.astype(np.int32), np.array(weights)
    add_in_common(
        *pairs, own.indptr, own.indices, own.data, other.indptr, other.indices, other.data, found
    )
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
    from medialis.segments._site_kernels import choose_apart

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
    apart = np.concatenate([places, ACROSS * spacing * (normals @ axes)], axis=1)
    order = _in_turn(places, np.repeat(np.arange(3), [len(one) for one, _ in crossed]), step)
    chosen = np.empty(len(places), np.int64)
    used = choose_apart(apart[order], APART * spacing, chosen)
    rows = order[chosen[:used]]
    return places[rows] @ axes.T + middle, normals[rows]


def _turned(placement: int) -> FloatArray:
    """Return the rotation of the lines for one of several placements, (3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(placement * TURN * np.ones(3) / 3**0.5).as_matrix())


def _in_turn(places: FloatArray, axis: IntArray, step: float) -> NDArray[np.int64]:
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


def _crossings(
    points: FloatArray, faces: IntArray, step: float
) -> list[tuple[FloatArray, NDArray[np.int64]]]:
    """Return where lines of a lattice along each axis cross faces, and which faces these are."""
    from medialis.segments._site_kernels import count_crossings, list_crossings, mark_crossed

    cells, crossed = np.ceil(points / step - 0.5), np.empty((len(faces), 3), np.bool_)
    run_chunks(
        lambda begin, end: mark_crossed(begin, end, cells, faces, crossed),
        len(faces),
        FACES_A_CHUNK,
    )
    found = []
    for axis in range(3):
        rows = np.flatnonzero(crossed[:, axis])
        few, m = faces[rows], len(rows)
        counts, offsets = np.zeros(m, np.int64), np.zeros(m + 1, np.int64)
        count_crossings(0, m, points, few, axis, step, counts)
        offsets[1:] = np.cumsum(counts)
        places = np.empty((offsets[-1], 3))
        if len(places):
            list_crossings(0, m, points, few, axis, step, offsets, places)
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
    return Surface((surface.points - middle) / surface.diagonal, surface.faces)


def _caps(
    surface: Surface, graph: Ragged, starts: IntArray, gaps: FloatArray, radius: float
) -> Any:
    """Weight of each site in each sample, (n, s) sparse: (1 - (d / radius)^2)^2.

    A sample that no cap holds has its nearest site along the edges.
    """
    from scipy.sparse import csc_array, csr_array

    from medialis.segments._site_kernels import near_sites
    from medialis.surface._surface_graph_kernels import spread_from_seeds

    n, s = surface.point_count, len(starts)
    counts, rows = np.zeros(s, np.int64), np.zeros(s + 1, np.int64)
    found: list[Any] = [None] * -(-s // CHUNK)

    def search(begin: int, end: int) -> None:
        found[begin // CHUNK] = near_sites(
            begin, end, surface.points, graph.offsets, graph.indices, starts, gaps, radius, counts
        )

    run_chunks(search, s, CHUNK)
    rows[1:] = np.cumsum(counts)
    samples, distance = (np.concatenate(part) for part in zip(*found, strict=True))
    weight = np.maximum(1.0 - np.minimum(distance / radius, 1.0) ** 2, 0.1) ** 2
    caps = csr_array(csc_array((weight, samples, rows), shape=(n, s)))
    alone = np.diff(caps.indptr) == 0
    if not alone.any():
        return caps
    seed, away = np.full(n, -1, np.int32), np.full(n, np.inf)
    seed[starts], away[starts] = starts, 0.0
    room = len(graph.indices) + 1
    spread_from_seeds(
        surface.points, graph.offsets, graph.indices, np.empty(room), np.empty(room, np.int32),
        away, seed,
    )  # fmt: skip
    site_of = np.full(n, -1)
    site_of[starts[::-1]] = np.arange(s)[::-1]
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
