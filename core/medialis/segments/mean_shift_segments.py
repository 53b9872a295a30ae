"""Segments of a surface where its medial cloud is dense: convex bumps, such as teeth (thesis 5.3).

Bumps gather the balls of their samples, creases spread them. Mean shift finds the dense places of
the medial cloud; the two feature points of each ball bring its segment to the surface.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.balls.subsampling import uniform_subsample
from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.model.medial_cloud import MedialCloud
from medialis.model.segmentation import Segmentation
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.segments.mean_shift import MeanShift, mean_shift
from medialis.surface.labels import spread_labels
from medialis.surface.surface_graph import surface_graph
from medialis.validation import as_choice, as_number

Seeds = Literal["spread", "bumps", "all", "none"]
SEEDS = ("spread", "bumps", "all", "none")

REACH = 0.05
"""Fraction of the diagonal (thesis: about 5 %)."""

BUMP_RADIUS = 0.3
"""Share of the balls, smallest first, that may be seeds ("low distance to the surface")."""

BUMP_ANGLE = math.radians(90.0)
"""Least spoke angle of a seed ("large spoke angle"): smaller ones are balls of noise and edges."""

SEED_SPACING = 0.15
"""Distance of seeds in units of the reach: several in each segment."""


def seed_points(
    cloud: MedialCloud,
    reach: float,
    *,
    share: float = BUMP_RADIUS,
    usable: NDArray[np.bool_] | None = None,
) -> NDArray[np.int64]:
    """Choose balls of low radius and large spoke angle, spread over the cloud (thesis 5.3.3).

    Parameters
    ----------
    cloud : MedialCloud
        k balls.
    reach : float
        Of the mean shift, absolute; seeds are 0.15 of it apart.
    share : float
        Share of the balls, smallest first, that may be seeds; 1: any radius.
    usable : (k,) bool, optional
        Balls to choose from.

    Returns
    -------
    (s,) int64
        Rows of the cloud, ascending: small balls with a spoke angle of at least 90 degrees; all
        where there is none.
    """
    wanted = cloud.valid if usable is None else usable & cloud.valid
    if not wanted.any():
        return np.empty(0, np.int64)
    small = cloud.radii <= np.quantile(cloud.radii[wanted], share)
    chosen = wanted & small & (cloud.spoke_angles >= BUMP_ANGLE)
    rows = np.flatnonzero(chosen if chosen.any() else wanted)
    return rows[
        uniform_subsample(cloud.subset(rows), SEED_SPACING * reach / cloud.surface.diagonal)
    ]


def mean_shift_segments(
    shape: Shape,
    cloud: MedialCloud,
    *,
    reach: float = REACH,
    seeds: Seeds = "spread",
    add: ArrayLike = (),
    remove: ArrayLike = (),
    last_steps: int | None = None,
    merge: float | None = None,
    fill: bool = True,
    usable: ArrayLike | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> Segmentation:
    """Segment a surface by the density of its medial cloud.

    Parameters
    ----------
    shape : Shape
        n samples.
    cloud : MedialCloud
        Of the same shape; inner balls are used.
    reach : float
        Radius of the kernel as a fraction of the diagonal, above 0 to 1.
    seeds : {"spread", "bumps", "all", "none"}
        Balls that are shifted: those with a large spoke angle; of these, the smallest 30 %; every
        one; only those added.
    add, remove : (a,), (r,) int
        Samples that a user picked: the ball of one added is a seed as well; seeds within reach of
        the ball of one removed are none.
    last_steps : int, optional
        Only so many last steps of each path vote: what is far from every dense place, such as the
        gum of a dental cast, gets no vote. Missing: all.
    merge : float, optional
        Centers closer than this fraction of the diagonal are one; the reach when missing.
    fill : bool
        Samples without a vote take the nearest segment along the surface, else none.
    usable : (k,) bool, optional
        Balls that take part, such as those above an importance; all valid ones when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Segmentation
        -1: components of the surface without a vote and, without `fill`, what no vote reaches.

    Raises
    ------
    InvalidShapeError
        When the cloud is of another shape or has no valid inner ball.
    InvalidOptionError
        When an option is out of its range, a picked sample has no ball, or no seed is left.

    Notes
    -----
    Cost: that of `mean_shift`, and a Dijkstra search. Source: thesis 5.3. Deviates: where balls of
    several segments touch a sample, the one with the clearest vote counts, not the last one.
    Without `fill`, samples whose balls got no vote stay without a segment.

    Examples
    --------
    >>> import medialis
    >>> shape, teeth = medialis.dental_arch(resolution=100)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> found = medialis.mean_shift_segments(
    ...     shape, cloud, seeds="bumps", last_steps=20, fill=False
    ... )
    >>> 14 <= found.count <= 28
    True
    """
    reach = as_number(reach, "reach", low=0.0, high=1.0, open_low=True) * shape.diagonal
    if merge is not None:
        merge = as_number(merge, "merge", low=0.0, high=1.0) * shape.diagonal
    as_choice(seeds, "seeds", SEEDS)
    if int(cloud.features.max(initial=-1)) >= shape.point_count:
        raise InvalidShapeError(
            f"The balls touch sample {cloud.features.max()}, but there are only "
            f"{shape.point_count} samples: give the shape that the cloud was computed on."
        )
    inner = cloud.valid & (cloud.side > 0)
    if usable is not None:
        inner &= _as_mask(usable, len(cloud))
    if not inner.any() or reach == 0.0:
        raise InvalidShapeError(
            "No valid inner ball to segment by: the shape has to enclose a volume, partly at least."
        )
    rows = _seed_rows(cloud, inner, reach, seeds, _as_picks(add, shape), _as_picks(remove, shape))
    progress = Progress.of(progress)
    with progress.stage("mean shift", 0.0, 0.9):
        found = mean_shift(
            cloud.centers[inner],
            cloud.centers[rows],
            reach=reach,
            last_steps=last_steps,
            merge=merge,
            progress=progress,
        )
    with progress.stage("transfer", 0.9, 1.0):
        return _on_surface(shape, cloud.subset(inner), found, fill)


def _as_mask(values: ArrayLike, count: int) -> NDArray[np.bool_]:
    mask = np.asarray(values)
    if mask.shape != (count,) or mask.dtype != bool:
        raise InvalidShapeError(
            f"usable must be a ({count},) array of bool, got {mask.dtype} of shape {mask.shape}."
        )
    return mask


def _as_picks(values: ArrayLike, shape: Shape) -> NDArray[np.int64]:
    picks = np.asarray(values).reshape(-1)
    if picks.size == 0:
        return np.empty(0, np.int64)
    if picks.dtype.kind not in "iu" or picks.min() < 0 or picks.max() >= shape.point_count:
        raise InvalidOptionError(
            f"Picked samples must be whole numbers 0..{shape.point_count - 1}, got "
            f"{picks.min()}..{picks.max()}."
        )
    return picks.astype(np.int64)


def _seed_rows(
    cloud: MedialCloud,
    inner: NDArray[np.bool_],
    reach: float,
    seeds: str,
    add: NDArray[np.int64],
    remove: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Rows of the seeds: the automatic ones, those added, without those removed."""
    rows = np.empty(0, np.int64)
    if seeds == "all":
        rows = np.flatnonzero(inner)
    elif seeds != "none":
        share = BUMP_RADIUS if seeds == "bumps" else 1.0
        rows = seed_points(cloud, reach, share=share, usable=inner)
    rows = np.union1d(rows, _balls_of(cloud, inner, add))
    if len(remove) and len(rows):
        from scipy.spatial import cKDTree

        gone = cloud.centers[_balls_of(cloud, inner, remove)]
        rows = rows[cKDTree(gone).query(cloud.centers[rows])[0] > reach]
    if len(rows) == 0:
        raise InvalidOptionError(
            "No seed is left: add samples, remove fewer, or choose seeds other than none."
        )
    return rows


def _balls_of(
    cloud: MedialCloud, inner: NDArray[np.bool_], picks: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Rows of the balls of picked samples; the smallest that touches one without a ball of its own.

    Later writes win: touching balls from the largest to the smallest, then the own ones.
    """
    if len(picks) == 0:
        return picks
    usable = np.flatnonzero(inner)
    falling = usable[np.argsort(-cloud.radii[usable], kind="stable")]
    row = np.full(1 + max(int(cloud.features.max()), int(picks.max())), -1, np.int64)
    row[cloud.features[falling].reshape(-1)] = np.repeat(falling, 2)
    row[cloud.source[usable]] = usable
    if (row[picks] < 0).any():
        raise InvalidOptionError(
            f"No ball touches sample {picks[row[picks] < 0][0]}: pick another one."
        )
    return row[picks]


def _on_surface(shape: Shape, cloud: MedialCloud, found: MeanShift, fill: bool) -> Segmentation:
    """Bring the clusters of balls to the samples they touch, and on along the surface."""
    sample = cloud.features.reshape(-1)
    cluster, share = np.repeat(found.labels, 2), np.repeat(found.shares, 2)
    # The clearest vote comes last and stays; ties: the lowest cluster.
    order = np.lexsort((-cluster, share))
    label = np.full(shape.point_count, -2, np.int64)
    label[sample[order]] = cluster[order]
    if fill:
        label[label == -1] = -2
    # Noise (-1) is passed on as well; only -2 takes the label of the nearest other sample.
    known = spread_labels(shape, surface_graph(shape), (label + 1).astype(np.int32))
    label = np.maximum(known - 1, -1)
    area = shape.point_areas
    used, place = np.unique(label[label >= 0], return_inverse=True)
    areas = np.bincount(place.reshape(-1), area[label >= 0], minlength=len(used))
    rank = np.full(len(found.centers), -1, np.int64)
    falling = np.argsort(-areas, kind="stable")
    rank[used[falling]] = np.arange(len(used))
    return Segmentation(
        np.where(label < 0, -1, rank[label]).astype(np.int32), areas[falling].astype(np.float64)
    )
