"""Segments of a surface where its medial cloud is dense: convex bumps, such as teeth (thesis 5.3).

Bumps gather the balls of their samples, creases spread them. Mean shift finds the dense places of
the medial cloud; the two feature points of each ball bring its segment to the surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from medialis.balls.subsampling import uniform_subsample
from medialis.balls.surface_skeleton import as_cloud
from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.kept import kept
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.options import algorithm, changed, choice, flag
from medialis.progress import Progress
from medialis.segments.connected import tell_pieces
from medialis.segments.mean_shift import MeanShift, SeedShiftOptions, shift_seeds
from medialis.surface.labels import (
    diffused_labels,
    numbered_by_weight,
    spread_labels,
    without_islands,
)
from medialis.surface.surface_graph import surface_graph
from medialis.threads import run_patiently

Seeds = Literal["spread", "bumps", "all", "none"]

BUMP_RADIUS = 0.3
"""Share of the balls, smallest first, that may be seeds ("low distance to the surface")."""

BUMP_ANGLE = math.radians(90.0)
"""Least spoke angle of a seed ("large spoke angle"): smaller ones are balls of noise and edges."""

DIFFUSION = 20
"""Steps by which borders are straightened: they move by about four samples at most."""

SEED_SPACING = 0.15
"""Distance of seeds in search radii: several in each segment."""


@dataclass(frozen=True, kw_only=True)
class MeanShiftSegmentsOptions(SeedShiftOptions):
    """Options of `mean_shift_segments`; `add` and `remove` are samples that a user picked."""

    search_radius: float = changed(SeedShiftOptions, "search_radius")
    seeds: Seeds = choice(
        "spread",
        "Seeds",
        "Which balls are shifted: some all over, some of the smallest 30 % (bumps, "
        "such as teeth), all (slow), or none but those added.",
        ("spread", "bumps", "all", "none"),
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


@algorithm(MeanShiftSegmentsOptions, door=as_cloud)
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
        seeds = cloud.centers[rows]
        points = cloud.centers[usable]
        return shift_seeds(points, seeds, surface.diagonal, options, progress)

    with progress.stage("mean shift", 0.0, 0.9):
        clusters = kept(shift_seeds, cloud, replace(options, fill=True), work, progress)
    with progress.stage("transfer", 0.9, 1.0):
        found = run_patiently(
            lambda: _on_surface(cloud.subset(usable), clusters, options.fill), progress
        )
        tell_pieces(found, progress)
        return found


def seed_points(
    cloud: MedialCloud, search_radius: float, share: float = BUMP_RADIUS
) -> NDArray[np.int64]:
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


def _seed_rows(
    cloud: MedialCloud, usable: NDArray[np.bool_], options: MeanShiftSegmentsOptions
) -> NDArray[np.int64]:
    """Rows of the seeds: the automatic ones, those added, without those removed."""
    rows = np.empty(0, np.int64)
    if options.seeds == "all":
        rows = np.flatnonzero(usable)
    elif options.seeds != "none":
        share = BUMP_RADIUS if options.seeds == "bumps" else 1.0
        rows = np.flatnonzero(usable)[
            seed_points(cloud.subset(usable), options.search_radius, share)
        ]
    rows = np.union1d(rows, _balls_of(cloud, usable, options.add))
    if len(options.remove) and len(rows):
        from scipy.spatial import cKDTree

        gone = cloud.centers[_balls_of(cloud, usable, options.remove)]
        away = cKDTree(gone).query(cloud.centers[rows])[0]
        rows = rows[away > options.search_radius * cloud.surface.diagonal]
    if len(rows) == 0:
        raise InvalidOptionError(
            "No seed is left: add samples, remove fewer, or choose seeds other than none."
        )
    return rows


def _balls_of(
    cloud: MedialCloud, usable: NDArray[np.bool_], picked: Sequence[int] | NDArray[np.integer]
) -> NDArray[np.int64]:
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
    if (ball[picks] < 0).any():
        raise InvalidOptionError(
            f"No ball touches sample {picks[ball[picks] < 0][0]}: pick another one."
        )
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
