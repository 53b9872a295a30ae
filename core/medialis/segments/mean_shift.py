"""Mean shift: clusters of a cloud about its densest places, and segments by them (thesis 5.3).

`mean_shift` (5.3.2): seeds move to the mean of the points about them until they stay; what they
pass votes for where they end. `mean_shift_segments`: convex bumps of a surface, such as teeth.
Bumps gather the balls of their samples, creases spread them: the dense places of the medial cloud
are found, and the two feature points of each ball bring its segment to the surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described, Index, Mask, extent, kd_tree
from medialis.base.device import UNMEASURED, on_gpu
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import Options, algorithm, changed, choice, flag, length, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, as_points, frozen
from medialis.shape.graph import surface_graph
from medialis.shape.labels import (
    Segmentation,
    diffused_labels,
    numbered_by_weight,
    spread_labels,
    tell_pieces,
    without_islands,
)
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import (
    Preparation,
    balls_of,
    shape_or_cloud,
    uniform_subsample,
)

if TYPE_CHECKING:
    from medialis.base.gpu import Session
    from medialis.segments._kernels import Grid

Kernel = Literal["gaussian", "flat"]

SIGMA = 0.5  # halved 40 %, doubled 30 %
"""Width of the Gaussian in search radii: its weight has fallen to 0.14 where it is cut."""

MOST_STEPS = 300  # halved 0.4 %, doubled 0 %
"""Of a seed."""

CELL = 0.5  # halved 6 %, doubled 6 %
"""Width of the cells of the grid in search radii: 1 reads 1.7 times as many points."""

MOST_CELLS = 128  # halved 0 %, doubled 0 %
"""Cells of the grid along the longest side."""

BUMP_RADIUS = 0.3  # halved 0 %, doubled 0 %
"""Share of the balls, smallest first, that may be seeds ("low distance to the surface")."""

BUMP_ANGLE = math.radians(90.0)  # halved 4 %, doubled 88 %
"""Least spoke angle of a seed ("large spoke angle"): smaller ones are balls of noise and edges."""

DIFFUSION = 20  # halved 17 %, doubled 27 %
"""Steps by which borders are straightened: they move by about four samples at most."""

SEED_SPACING = 0.15  # halved 7 %, doubled 17 %
"""Distance of seeds in search radii: several in each segment."""

SEEDS_A_CHUNK, POINTS_A_CHUNK = 16, 256

SEEDS_A_LAUNCH, PLACES_A_LAUNCH = 1 << 16, 1 << 18
"""Maximum numbers per GPU launch; the paths of 65,536 seeds take 470 MB."""

KERNELS = "segments._kernels"

Seeds = Literal["spread", "bumps", "all", "none"]


@dataclass(frozen=True, eq=False, repr=False)
class MeanShift(Described):
    """Clusters of a cloud.

    Attributes
    ----------
    centers : (c, 3) float64
        Where the seeds of each cluster converged; the densest comes first.
    labels : (n,) int32
        Cluster of each point; -1 where no path came near.
    seed_labels : (s,) int32
        Cluster of each seed.
    shares : (n,) float64
        Part of the votes that the cluster of the point got, 0 to 1.
    """

    centers: FloatArray
    labels: IntArray
    seed_labels: IntArray
    shares: FloatArray


@dataclass(frozen=True, kw_only=True)
class SeedShiftOptions(Options):
    """How seeds are shifted, and what they vote for."""

    search_radius: float = length(
        0.05,
        "Search radius",
        "Points up to this distance shift a seed: about the half width of a bump (thesis: about "
        "5 %).",
        low=0.001,
    )
    kernel: Kernel = choice(
        "gaussian",
        "Kernel",
        "Weights of points by their distance.",
        {
            "gaussian": "Weights fall to 0.14 at the search radius.",
            "flat": "All points up to the search radius weigh the same.",
        },
        advanced=True,
    )
    last_steps: int = whole(
        0,
        "Last steps",
        "Only this many last steps of each path count, so that samples far from the dense "
        "places get no segment; use 20 for dental casts. 0 counts the whole path.",
        high=MOST_STEPS,
    )
    merge: float = length(
        0.0,
        "Merge",
        "Dense places closer together than this are one segment. 0: closer than the search radius.",
        advanced=True,
    )


@dataclass(frozen=True, kw_only=True)
class MeanShiftOptions(SeedShiftOptions):
    """Options of `mean_shift`; `seeds` (s, 3) are the places where to start."""

    seeds: ArrayLike | None = field(default=None, compare=False, repr=False)


@algorithm(MeanShiftOptions, keep=False)
def mean_shift(points: ArrayLike, options: MeanShiftOptions, progress: Progress) -> MeanShift:
    """Cluster a cloud by shifting seeds to the densest places (Eq. 5.1, 5.2).

    Parameters
    ----------
    points : (n, 3) float
    seeds : (s, 3) float, optional
        Where to start; all points when missing.

    Returns
    -------
    MeanShift
        Each point has the cluster that got most votes: every step m of a path gives its cluster
        K(|y - m|) at the points y within the search radius.

    Raises
    ------
    InvalidShapeError
        When points or seeds are not (., 3) finite numbers.

    See Also
    --------
    mean_shift_segments : the same for the balls of a shape, brought to its surface.

    Notes
    -----
    Cost: for each step of each seed, the points within the search radius, epsilon. At most 300
    steps. The Gaussian weights are exp(-d^2 / (2 sigma^2)) with sigma half the search radius. The
    diagonal is that of the points.

    Source: thesis 5.3.2, Eq. 5.1, 5.2. Deviates: the densest centers absorb those within `merge`,
    whatever the order of the seeds; the thesis merges as they come, so chains could grow. The
    seeds vote and are voted on like all others.

    Examples
    --------
    >>> import medialis
    >>> import numpy as np
    >>> blobs = np.random.default_rng(0).normal(size=(2, 500, 3)) + [[[0, 0, 0]], [[9, 0, 0]]]
    >>> found = medialis.mean_shift(blobs.reshape(-1, 3), search_radius=0.15)
    >>> len(found.centers), np.bincount(found.labels).tolist()
    (2, [500, 500])
    """
    cloud = as_points(points)
    seeds = cloud if options.seeds is None else as_points(options.seeds, "seeds")
    low, high = extent(cloud)
    # Where all points coincide any radius does.
    return shift_seeds(cloud, seeds, math.hypot(*(high - low)) or 1.0, options, progress)


def shift_seeds(
    points: FloatArray,
    seeds: FloatArray,
    diagonal: float,
    options: SeedShiftOptions,
    progress: Progress,
) -> MeanShift:
    """Cluster points by shifting seeds; lengths are fractions of the diagonal that is given."""
    radius, merge = options.search_radius * diagonal, options.merge * diagonal
    # Lengths in search radii, so that squares of tiny and huge ones stay in range.
    low, high = extent(points)
    origin = 0.5 * low + 0.5 * high
    places, starts = (points - origin) / radius, (seeds - origin) / radius
    scaled = SIGMA if options.kernel == "gaussian" else 0.0
    with progress.stage("shift", 0.0, 0.5):
        grid, _ = _grid(places, scaled)
        steps, lengths = _paths(grid, starts, options.last_steps, progress)
        ends = steps[np.cumsum(lengths) - 1]
        density = _densities(grid, ends, progress)
        merge_ends = partial(_merged, ends, density, (merge or radius) / radius)
        centers, cluster = run_patiently(merge_ends, progress)
    with progress.stage("votes", 0.5, 1.0):
        grid, order = _grid(steps, scaled)
        owner = np.repeat(cluster, lengths)[order]
        labels, shares = _votes(grid, owner, len(centers), places, progress)
    wholes = frozen(labels, np.int32), frozen(cluster, np.int32)
    places = frozen(centers * radius + origin, np.float64)
    return MeanShift(places, *wholes, frozen(shares, np.float64))


def _grid(points: FloatArray, sigma: float) -> tuple[Grid, Index]:
    """Sort points into a grid; returns their order as well. Lengths are in search radii."""
    from medialis.segments._kernels import Grid

    low, high = extent(points)
    width = max(CELL, float((high - low).max()) / MOST_CELLS)
    cell = np.floor((points - low) / width).astype(np.int64)
    shape = cell.max(axis=0) + 1
    key = np.ravel_multi_index(tuple(cell.T), tuple(shape))
    order = np.argsort(key, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(key, minlength=int(shape.prod())))])
    return Grid(np.ascontiguousarray(points[order]), starts, low, width, shape, sigma), order


def _paths(
    grid: Grid, seeds: FloatArray, last: int, progress: Progress
) -> tuple[FloatArray, Index]:
    """Return the concatenated last steps of all paths, and the number of steps of each path."""
    from medialis.segments._kernels import follow_seeds, pack_paths

    most = last or MOST_STEPS
    parts: list[Any] = [None] * -(-len(seeds) // SEEDS_A_CHUNK)

    def shift_there(session: Session) -> list[Any]:
        there, found = session.put(grid), []
        room = session.room() // (2 * MOST_STEPS * 3 * 8)
        for begin in range(0, len(seeds), step := max(min(room, SEEDS_A_LAUNCH), 1)):
            progress.update(begin / len(seeds))
            some = session.put(seeds[begin : begin + step])
            paths = session.empty((len(some), MOST_STEPS, 3), np.float64)
            counts = session.empty(len(some), np.int64)
            session.launch(f"{KERNELS}:shift_seed", len(some), there, some, paths, counts)
            lengths = np.minimum(session.get(counts), most)
            offsets = session.put(np.append(0, np.cumsum(lengths)))
            steps = session.empty((int(lengths.sum()), 3), np.float64)
            session.launch(f"{KERNELS}:pack_path", len(some), paths, counts, offsets, steps)
            found.append((session.get(steps), lengths))
            session.free(some, paths, counts, offsets, steps)
        return found

    def work(begin: int, end: int) -> None:
        paths, counts = np.empty((end - begin, MOST_STEPS, 3)), np.empty(end - begin, np.int64)
        follow_seeds(grid, seeds[begin:end], paths, counts)
        lengths = np.minimum(counts, most)
        steps = np.empty((lengths.sum(), 3))
        pack_paths(paths, counts, np.append(0, np.cumsum(lengths)), steps)
        parts[begin // SEEDS_A_CHUNK] = steps, lengths

    found = on_gpu(shift_there, len(seeds), UNMEASURED, progress)
    if found is None:
        run_chunks(work, len(seeds), SEEDS_A_CHUNK, progress=progress)
    steps, lengths = zip(*(found or parts), strict=True)
    return np.concatenate(steps), np.concatenate(lengths)


def _densities(grid: Grid, places: FloatArray, progress: Progress) -> FloatArray:
    """Return the density at each position: the sum of the weights of the points around it."""
    from medialis.segments._kernels import weigh_places

    def weigh_there(session: Session) -> FloatArray:
        out = session.empty(len(places), np.float64)
        given = session.put(grid), session.put(places), out
        session.launch(f"{KERNELS}:weigh_place", len(places), *given)
        return session.get(out)

    found = on_gpu(weigh_there, len(places), UNMEASURED, progress)
    if found is None:
        found = np.empty(len(places))
        weigh = partial(weigh_places, grid, places)
        run_chunks(weigh, len(places), POINTS_A_CHUNK, found, progress=progress.still)
    return found


def _merged(ends: FloatArray, density: FloatArray, merge: float) -> tuple[FloatArray, Index]:
    """Return the centers, densest first, and the center of each end."""
    cluster = np.full(len(ends), -1, np.int64)
    centers: list[FloatArray] = []
    # Ties by place: the order of the seeds does not matter.
    left = np.lexsort((*-ends.T[::-1], -density))
    while len(left):
        near = np.linalg.norm(ends[left] - ends[left[0]], axis=1) <= merge
        near[0] = True
        cluster[left[near]] = len(centers)
        centers.append(ends[left[0]])
        left = left[~near]
    return np.array(centers), cluster


def _votes(
    grid: Grid, owner: Index, clusters: int, places: FloatArray, progress: Progress
) -> tuple[Index, FloatArray]:
    """Return the cluster with most votes at each position, and its fraction of the votes."""
    from medialis.segments._kernels import count_votes

    labels, shares = np.empty(len(places), np.int64), np.empty(len(places))

    def vote_there(session: Session) -> tuple[Index, FloatArray]:
        steps = session.put(grid), session.put(owner)
        found = session.empty(labels.shape, np.int64), session.empty(labels.shape, np.float64)
        given = session.put(places), *found
        rows = max(min(session.room() // (16 * clusters), PLACES_A_LAUNCH, len(places)), 1)
        votes = session.zeros((rows, clusters), np.float64)
        touched = session.empty((rows, clusters), np.int64)
        for begin in range(0, len(places), rows):
            progress.update(begin / len(places))
            points, out, share = (array[begin : begin + rows] for array in given)
            some = *steps, points, votes, touched, out, share
            session.launch(f"{KERNELS}:vote", len(points), *some)
        return session.get(found[0]), session.get(found[1])

    found = on_gpu(vote_there, len(places), UNMEASURED, progress)
    if found is None:
        vote = partial(count_votes, grid, owner, clusters, places)
        run_chunks(vote, len(places), POINTS_A_CHUNK, labels, shares, progress=progress)
    return found or (labels, shares)


@dataclass(frozen=True, kw_only=True)
class MeanShiftSegmentsOptions(SeedShiftOptions, Preparation):
    """Options of `mean_shift_segments`; `add` and `remove` are samples that a user picked."""

    search_radius: float = changed(SeedShiftOptions, "search_radius")
    seeds: Seeds = choice(
        "spread",
        "Seeds",
        "Which balls are shifted.",
        {
            "spread": "Some balls all over the shape are shifted.",
            "bumps": "Some of the smallest 30 % are shifted, those of bumps such as teeth.",
            "all": "All balls are shifted, which is slow.",
            "none": "Only the seeds that are added are shifted.",
        },
    )
    fill: bool = flag(
        True,
        "Whole surface",
        "Samples without a segment take the nearest one along the surface. Off for dental casts.",
    )
    add: Sequence[int] | NDArray[np.integer] = ()
    remove: Sequence[int] | NDArray[np.integer] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("add", "remove"):
            picks = np.asarray(getattr(self, name)).reshape(-1)
            if picks.size and (picks.dtype.kind not in "iu" or picks.min() < 0):
                raise InvalidOptionError(
                    f"Picked samples must be whole numbers of 0 or more, got {picks.min()}."
                )
            object.__setattr__(self, name, tuple(picks.tolist()))


@algorithm(MeanShiftSegmentsOptions, door=shape_or_cloud, prepare=balls_of)
def mean_shift_segments(
    cloud: MedialCloud, options: MeanShiftSegmentsOptions, progress: Progress
) -> Segmentation:
    """Segment a surface by the density of its medial cloud.

    Parameters
    ----------
    cloud : MedialCloud
        k balls; inner ones are used. A `subset` of important ones will do.
    add, remove : (a,), (r,) int
        Samples that a user picked: the ball of one added is a seed as well; seeds within the search
        radius of the ball of one removed are none. A ball must touch each.

    Returns
    -------
    Segmentation
        -1: components of the surface without a vote and, without `fill`, what no vote reaches.

    Raises
    ------
    InvalidShapeError
        When the cloud has no valid inner ball.

    See Also
    --------
    mean_shift : clusters of any points.
    parts, patches : segments by limbs, sheets and edges.

    Notes
    -----
    Seeds have a spoke angle of 90 degrees or more. Cost: that of `mean_shift`, and a Dijkstra
    search. Source: thesis 5.3. Deviates: where balls of
    several segments touch a sample, the one with the clearest vote counts, not the last one.
    Without `fill`, samples whose balls got no vote stay without a segment.

    Examples
    --------
    >>> import medialis
    >>> shape, teeth = medialis.dental_arch(resolution=100)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> found = medialis.mean_shift_segments(cloud, seeds="bumps", last_steps=20, fill=False)
    >>> 14 <= found.count <= 28
    True
    """
    surface, usable = cloud.surface, cloud.valid & (cloud.side > 0)
    if not usable.any() or surface.diagonal == 0.0:
        raise InvalidShapeError(
            "No valid inner ball to segment by: the shape has to enclose a volume, partly at least."
        )

    def work() -> MeanShift:
        rows = run_patiently(lambda: _seed_rows(cloud, usable, options), progress)
        places = cloud.centers[usable], cloud.centers[rows]
        return shift_seeds(*places, surface.diagonal, options, progress)

    with progress.stage("mean shift", 0.0, 0.9):
        clusters = kept(shift_seeds, cloud, replace(options, fill=True), work, progress)
    with progress.stage("transfer", 0.9, 1.0):
        transfer = partial(_on_surface, cloud.subset(usable), clusters, options.fill)
        found = run_patiently(transfer, progress)
        tell_pieces(found, progress)
        return found


def seed_points(cloud: MedialCloud, search_radius: float, share: float = BUMP_RADIUS) -> Index:
    """Choose balls of low radius and large spoke angle, spread over the cloud (thesis 5.3.3).

    Parameters
    ----------
    cloud : MedialCloud
        k balls.
    search_radius : float
        Of the mean shift, a fraction of the diagonal; seeds are 0.15 of it apart.
    share : float
        Share of the balls, smallest first, that may be seeds; 1: any radius.

    Returns
    -------
    (s,) int64
        Rows of the cloud, ascending: small balls with a spoke angle of at least 90 degrees; all
        where there is none.
    """
    wanted = cloud.valid
    if not wanted.any():
        return np.empty(0, np.int64)
    small = cloud.radii <= np.quantile(cloud.radii[wanted], share)
    chosen = wanted & small & (cloud.spoke_angles >= BUMP_ANGLE)
    rows = np.flatnonzero(chosen if chosen.any() else wanted)
    return rows[uniform_subsample(cloud.subset(rows), SEED_SPACING * search_radius)]


def _seed_rows(cloud: MedialCloud, usable: Mask, options: MeanShiftSegmentsOptions) -> Index:
    """Rows of the seeds: the automatic ones, those added, without those removed."""
    rows = np.flatnonzero(usable & (options.seeds != "none"))
    if options.seeds in ("spread", "bumps"):
        share = BUMP_RADIUS if options.seeds == "bumps" else 1.0
        rows = rows[seed_points(cloud.subset(usable), options.search_radius, share)]
    rows = np.union1d(rows, _balls_of(cloud, usable, options.add))
    if len(options.remove) and len(rows):
        gone = cloud.centers[_balls_of(cloud, usable, options.remove)]
        away = kd_tree(gone).query(cloud.centers[rows])[0]
        rows = rows[away > options.search_radius * cloud.surface.diagonal]
    if len(rows) == 0:
        raise InvalidOptionError(
            "No seed is left: add samples, remove fewer, or choose seeds other than none."
        )
    return rows


def _balls_of(
    cloud: MedialCloud, usable: Mask, picked: Sequence[int] | NDArray[np.integer]
) -> Index:
    """Rows of the balls of picked samples; the smallest that touches one without a ball of its own.

    Later writes win: touching balls from the largest to the smallest, then the own ones.
    """
    picks, n = np.asarray(picked, np.int64), cloud.surface.point_count
    if picks.max(initial=-1) >= n:
        raise InvalidOptionError(f"Picked samples must be below {n}, got {picks.max()}.")
    rows = np.flatnonzero(usable)
    falling = rows[np.argsort(-cloud.radii[rows], kind="stable")]
    ball = np.full(n, -1, np.int64)
    ball[cloud.features[falling].reshape(-1)] = np.repeat(falling, 2)
    ball[cloud.source[rows]] = rows
    lost = picks[ball[picks] < 0]
    if len(lost):
        raise InvalidOptionError(f"No ball touches sample {lost[0]}: pick another one.")
    return ball[picks]


def _on_surface(cloud: MedialCloud, clusters: MeanShift, fill: bool) -> Segmentation:
    """Bring the clusters of balls to the samples they touch, and on along the surface.

    Borders are straightened, and islands joined with what is round them.
    """
    surface: Shape = cloud.surface
    sample = cloud.features.reshape(-1)
    cluster, share = np.repeat(clusters.labels, 2), np.repeat(clusters.shares, 2)
    # The clearest vote comes last and stays; ties: the lowest cluster.
    order = np.lexsort((-cluster, share))
    label = np.full(surface.point_count, -2, np.int64)
    label[sample[order]] = cluster[order]
    if fill:
        label[label == -1] = -2
    # Noise (-1) is passed on as well; only -2 takes the label of the nearest other sample.
    graph, area = surface_graph(surface), surface.point_areas
    known = spread_labels(surface.points, graph, (label + 1).astype(np.int32))
    known = diffused_labels(known, graph, DIFFUSION)
    joined = without_islands(surface.points, known, area, graph)
    labels = np.maximum(np.where(known == 0, 0, joined) - 1, -1).astype(np.int32)
    return Segmentation(numbered_by_weight(labels, area), surface=surface)
