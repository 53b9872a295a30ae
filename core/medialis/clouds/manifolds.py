"""Manifolds of a noisy cloud: patches, their graph, and what it connects (thesis 4.2.3).

The seeds of the thesis are flat points; a flood over the patch graph starts at each, and points
that the same seeds reach form a manifold. The graph is undirected, so the patches that a seed
reaches are its connected component, and every patch of a component is reached by the same seeds.
Different seed sets are therefore different components, and one union-find replaces all floods.
This bounds their number: a manifold needs `min_points` flat points, each in one component only, so
there are at most n / min_points, at any angle of intersection; a point is in 4 at most.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from medialis.clouds.smoothing import jitter, nearest_points, without_jitter
from medialis.model.manifold_set import ManifoldSet
from medialis.model.ragged import Ragged
from medialis.progress import Progress, ProgressCallback
from medialis.threads import run_chunks
from medialis.validation import FloatArray, as_number, as_points, as_whole_number

LEAST_TRIANGLES, LEAST_NEIGHBOURS = 6, 4
"""A patch has at least four neighbours, which make six triangles with the point: three points are
in a plane with any fourth by chance far more often than two more are."""

SLIMMEST = 0.25
"""Sine of the angle of a triangle at the point, below which its normal is mostly noise."""

CLAIMS = 3
"""Patches of a manifold with a point as a corner that make it a point of the manifold: those of its
neighbours tell where a manifold goes on through an intersection, where its own are not clear."""

CHUNK = 1024


def manifolds(
    points: ArrayLike,
    *,
    neighbours: int = 10,
    max_bend: float = 0.15,
    max_turn: float = 0.1,
    min_points: int = 20,
    scatter: float | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> ManifoldSet:
    """Divide a noisy cloud into smooth surfaces, which may intersect and be open, and noise.

    Parameters
    ----------
    points : (n, 3) float
        Any cloud; no normals are needed. Repeated points count once.
    neighbours : int
        Nearest points that make the patches of a point, 4 to 20 (thesis: 7 to 10).
    max_bend : float
        d_max: largest angle between the normals of one patch in radians, above 0 to pi/2.
    max_turn : float
        delta_max: largest angle between joined patches of neighbouring points, the same range.
    min_points : int
        Flat points that a manifold needs, 1 or more; smaller ones are noise.
    scatter : float, optional
        How far points lie off their surfaces (standard deviation, absolute). Where it is above 0,
        positions are smoothed before they are classified. Missing: measured; 0: never smooth.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    ManifoldSet
        Row i is point i. A cloud that is all noise has no manifolds: fewer than 5 different
        points, all on a line, or a volume.

    Raises
    ------
    InvalidShapeError
        When the points are not (n, 3) finite numbers.
    InvalidOptionError
        When an option is out of its range.

    Notes
    -----
    Cost O(n (log n + neighbours^4)); 2 s of processor time for 194,000 points. The result does not
    depend on the order of the points.

    Source: thesis 4.2.3, Eq. 4.1, 4.2.

    Deviates: patches need four neighbours, or every neighbourhood with an outlier would be an
    intersection. Patches are compared by their mean normals: the closest of all normals (Eq. 4.2)
    join whatever is rough. Floods stay on patches from the start: flat points on both sides of an
    intersection are neighbours, and a flood over points would take them for one segment. Where the
    cloud scatters, positions are smoothed first (`smoothing`).

    Examples
    --------
    >>> import numpy as np, medialis
    >>> flat = np.random.default_rng(0).uniform(-1, 1, (4000, 3)) * [1, 1, 0]
    >>> found = medialis.manifolds(np.concatenate([flat, flat[:, [2, 0, 1]] + [0.01, 0, 0]]))
    >>> found.count, bool((found.sizes > 3900).all())
    (2, True)
    """
    cloud = as_points(points)
    neighbours = as_whole_number(neighbours, "neighbours", low=4, high=20)
    bend = as_number(max_bend, "max_bend", low=0.0, high=math.pi / 2, open_low=True)
    turn = as_number(max_turn, "max_turn", low=0.0, high=math.pi / 2, open_low=True)
    least = as_whole_number(min_points, "min_points", low=1, high=2**31 - 1)
    if scatter is not None:
        scatter = as_number(scatter, "scatter", low=0.0)
    progress = Progress.of(progress)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    size = math.hypot(*(high - low))
    # Each place once, in the order of coordinates: ties then do not depend on the given order.
    places, place = np.unique(cloud, axis=0, return_inverse=True)
    place = place.reshape(-1)
    if len(places) <= LEAST_NEIGHBOURS or size == 0.0:
        none = Ragged(np.zeros(len(cloud) + 1, np.int64), np.empty(0, np.int32))
        return ManifoldSet(none, 0, np.zeros(len(cloud), np.int32))
    places = (places - 0.5 * (low + high)) / size
    with progress.stage("smoothing", 0.0, 0.5):
        places = _smoothed(places, scatter, size, progress)
    with progress.stage("patches", 0.5, 1.0):
        found = _segment(places, neighbours, bend, turn, least, progress)
    return found.at(place)


def _smoothed(
    places: FloatArray, scatter: float | None, size: float, progress: Progress
) -> FloatArray:
    """Return positions (in units of the size) without the given or measured scatter."""
    amount = jitter(places) if scatter is None else scatter / size
    if amount == 0.0 or len(places) <= LEAST_NEIGHBOURS:
        return places
    progress.note(
        f"The points scatter by {100 * amount:.2g} % of the size about their surfaces: they were "
        "classified by smoothed positions (smooth off, or scatter = 0 in Python, prevents this)."
    )
    return without_jitter(places, amount, progress)


def _segment(
    places: FloatArray, neighbours: int, bend: float, turn: float, least: int, progress: Progress
) -> ManifoldSet:
    """Patches, components of their graph, and those with enough flat points."""
    from medialis.clouds._patch_kernels import (
        PATCHES,
        claim_corners,
        find_patches,
        join_patches,
    )

    n = len(places)
    near = nearest_points(places, min(neighbours, n - 1), progress)
    axes, sizes = np.zeros((PATCHES * n, 3)), np.zeros(PATCHES * n, np.int32)
    corners = np.zeros(PATCHES * n, np.uint64)
    limits = math.cos(bend), SLIMMEST, LEAST_TRIANGLES, LEAST_NEIGHBOURS

    def work(begin: int, end: int) -> None:
        find_patches(places, near, begin, end, *limits, axes, sizes, corners)

    run_chunks(work, n, CHUNK, progress=progress)
    root = np.arange(PATCHES * n)
    join_patches(near, axes, sizes, corners, math.cos(turn), root)
    counts = (sizes.reshape(n, PATCHES) > 0).sum(axis=1)
    seeds = np.bincount(root[PATCHES * np.flatnonzero(counts == 1)], minlength=PATCHES * n)
    number = np.full(PATCHES * n, -1, np.int32)
    large = np.flatnonzero(seeds >= least)
    number[large] = np.arange(len(large))
    label = np.where(sizes > 0, number[root], -1).reshape(n, PATCHES)
    label = np.ascontiguousarray(label, np.int32)
    claimed, counted = np.full_like(label, -1), np.zeros_like(label)
    claim_corners(near, corners, label, CLAIMS, claimed, counted)
    size = np.bincount(label[label >= 0], minlength=len(large))
    rank = np.empty(len(large), np.int32)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(large))
    offsets = np.concatenate([[0], np.cumsum((label >= 0).sum(axis=1))])
    return ManifoldSet(Ragged(offsets, rank[label[label >= 0]]), len(large), counts)
