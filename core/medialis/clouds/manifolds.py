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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.clouds.places import classified_places
from medialis.clouds.smoothing import nearest_points, neighbours_of
from medialis.kept import kept
from medialis.model.manifold_set import ManifoldSet
from medialis.model.ragged import Ragged
from medialis.model.surface import Surface
from medialis.options import Options, algorithm, angle, flag, whole
from medialis.progress import Progress
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray, IntArray, as_points

LEAST_TRIANGLES, LEAST_NEIGHBOURS = 6, 4
"""A patch has at least four neighbours, which make six triangles with the point: three points are
in a plane with any fourth by chance far more often than two more are."""

BENT = 1.5
"""Neighbours of a bent patch for each of a flat one: a quadric has 6 coefficients, a plane 3."""

WIDE, APART = 10, 0.28
"""Near a scanner the next line is many points away. Of so many times the neighbours those are
chosen that are this share of the largest distance apart: 15 to 25 of them lie in a disc."""

SLIMMEST = 0.25
"""Sine of the angle of a triangle at the point, below which its normal is mostly noise."""

THIN = 0.05
"""Width of a line of a scan for its length."""

CLAIMS = 3
"""Patches of a manifold with a point as a corner that make it a point of the manifold: those of its
neighbours tell where a manifold goes on through an intersection, where its own are not clear."""

CHUNK = 1024


@dataclass(frozen=True, kw_only=True)
class ManifoldsOptions(Options):
    """Options of `manifolds`."""

    neighbours: int = whole(
        10, "Neighbours", "Nearest points that tell whether a point is flat.", low=4, high=20
    )
    max_bend: float = angle(
        8.59,
        "Largest bend",
        "Triangles of a flat patch differ by at most this angle. Larger ones allow more curvature.",
        low=0.1,
        high=90.0,
    )
    max_turn: float = angle(
        5.73,
        "Largest turn",
        "Patches of neighbouring points are joined up to this angle. Larger ones give fewer "
        "manifolds.",
        low=0.1,
        high=90.0,
    )
    min_points: int = whole(
        20,
        "Smallest manifold",
        "Manifolds with fewer flat points than this are noise.",
        low=1,
        high=1_000_000,
    )
    smooth: bool = flag(
        True,
        "Smooth if noisy",
        "Classify a cloud that scatters about its surfaces by smoothed positions. Points stay "
        "where they are.",
        advanced=True,
    )


@algorithm(ManifoldsOptions)
def manifolds(
    cloud: Surface | ArrayLike, options: ManifoldsOptions, progress: Progress
) -> ManifoldSet:
    """Divide a noisy cloud into smooth surfaces, which may intersect and be open, and noise.

    Parameters
    ----------
    cloud : (n, 3) float, or Shape or Surface
        Any points; no normals are needed and no faces are used. Repeated points count once.
        Results are kept with a shape or surface, not with an array.

    Returns
    -------
    ManifoldSet
        Row i is point i. A cloud that is all noise has no manifolds: fewer than 5 different
        points, all on a line, or a volume.

    Raises
    ------
    InvalidShapeError
        When the points are not (n, 3) finite numbers.

    See Also
    --------
    manifold_surfaces : triangles through the points of each manifold.

    Notes
    -----
    Cost O(n (log n + neighbours^4)); 2 s of processor time for 194,000 points. The result does not
    depend on the order of the points.

    Source: thesis 4.2.3, Eq. 4.1, 4.2: `max_bend` is d_max, `max_turn` delta_max there.

    Deviates: patches need four neighbours, or every neighbourhood with an outlier would be an
    intersection. Patches are compared by their mean normals: the closest of all normals (Eq. 4.2)
    join whatever is rough. Floods stay on patches from the start: flat points on both sides of an
    intersection are neighbours, and a flood over points would take them for one segment. Where the
    cloud scatters, positions are smoothed first (`smoothing`).

    Examples
    --------
    >>> import numpy as np, medialis
    >>> flat = np.random.default_rng(0).uniform(-1, 1, (4000, 3)) * [1, 1, 0]
    >>> crossing = np.concatenate([flat, flat[:, [2, 0, 1]] + [0.01, 0, 0]])
    >>> result = medialis.manifolds(crossing, max_turn=6.0)
    >>> result.count, bool((result.sizes > 3900).all())
    (2, True)
    """
    points = cloud.points if isinstance(cloud, Surface) else as_points(cloud)
    with progress.stage("smoothing", 0.0, 0.5):
        places, speakers = kept(
            classified_places,
            cloud,
            options.smooth,
            lambda: classified_places(points, LEAST_NEIGHBOURS + 1, options.smooth, progress),
            progress,
        )
    if len(places) <= LEAST_NEIGHBOURS:
        none = Ragged(np.zeros(len(points) + 1, np.int64), np.empty(0, np.int32))
        return ManifoldSet(none, 0, np.zeros(len(points), np.int32), points=points)
    with progress.stage("patches", 0.5, 1.0):
        key = options.smooth, options.neighbours, options.max_bend
        patches = kept(
            Patches, cloud, key, lambda: _find_patches(places, options, progress), progress
        )
        found = run_patiently(lambda: _segment(places, patches, options), progress)
        rows = run_patiently(lambda: speakers.rows(found), progress)
        return replace(found.at(rows), points=points)


@dataclass(frozen=True, eq=False)
class Patches:
    """Patches of each neighbourhood; see `_patch_kernels` for their slots. No corners: none."""

    neighbours: int
    near: NDArray[np.int32]
    axes: FloatArray
    sizes: IntArray
    corners: NDArray[np.uint64]
    bent_axes: FloatArray
    bends: FloatArray
    bent_corners: NDArray[np.uint64]


def _find_patches(places: FloatArray, options: ManifoldsOptions, progress: Progress) -> Patches:
    from medialis.clouds._patch_kernels import PATCHES, find_patches

    n = len(places)
    k = min(options.neighbours, n - 1)
    near = nearest_points(places, min(round(BENT * k), n - 1), progress)
    _leave_lines(places, near, k, progress)
    slots, rows = PATCHES * n, n
    flat = np.zeros((slots, 3)), np.zeros(slots, np.int32), np.zeros(slots, np.uint64)
    bent = np.zeros((rows, 3)), np.zeros((rows, 3, 3)), np.zeros(rows, np.uint64)
    limits = (
        math.cos(math.radians(options.max_bend)),
        SLIMMEST,
        LEAST_TRIANGLES,
        LEAST_NEIGHBOURS,
    )

    def work(begin: int, end: int) -> None:
        find_patches(places, near, k, begin, end, *limits, *flat, *bent)

    run_chunks(work, n, CHUNK, progress=progress)
    return Patches(k, near, *flat, *bent)


def _leave_lines(places: FloatArray, near: NDArray[np.int32], k: int, progress: Progress) -> None:
    """Give points whose neighbours lie on one line of a scan some on the next lines."""
    from medialis.clouds._neighbour_kernels import find_lines, spread_neighbours

    line = np.zeros(len(places), bool)
    find_lines(places, near, k, SLIMMEST, line)
    wide = WIDE * near.shape[1]
    rows = np.flatnonzero(line)
    if wide >= len(places) or len(rows) == 0:
        return
    spread = near[rows]
    spread_neighbours(
        places, rows, neighbours_of(places, places[rows], wide, progress), APART, spread
    )
    near[rows] = spread


def _with_bent(places: FloatArray, patches: Patches, least: float) -> Patches:
    """Put the bent patches that their neighbours confirm in the place of the flat ones."""
    from medialis.clouds._patch_kernels import PATCHES, choose_bent

    chosen = np.zeros(len(places), bool)
    flat = patches.axes, patches.sizes, patches.corners
    bent = patches.bent_axes, patches.bends, patches.bent_corners
    choose_bent(places, patches.near, patches.neighbours, *flat, *bent, least, chosen)
    first = PATCHES * np.flatnonzero(chosen)
    axes, sizes, corners = patches.axes.copy(), patches.sizes.copy(), patches.corners.copy()
    sizes.reshape(-1, PATCHES)[chosen] = 0
    axes[first], corners[first] = patches.bent_axes[chosen], patches.bent_corners[chosen]
    sizes[first] = LEAST_TRIANGLES
    bends = np.where(chosen[:, None, None], patches.bends, 0.0)
    return replace(patches, axes=axes, sizes=sizes, corners=corners, bends=bends)


def _segment(places: FloatArray, patches: Patches, options: ManifoldsOptions) -> ManifoldSet:
    """Components of the graph of patches that have enough flat points."""
    from medialis.clouds._neighbour_kernels import find_strips
    from medialis.clouds._patch_kernels import PATCHES, claim_corners, join_patches

    turn = math.cos(math.radians(options.max_turn))
    patches = _with_bent(places, patches, turn)
    n, sizes = len(places), patches.sizes
    root, strip = np.arange(PATCHES * n), np.zeros(PATCHES * n, bool)
    find_strips(places, patches.near, PATCHES, sizes, patches.corners, THIN, strip)
    linked = patches.axes, patches.bends, sizes, patches.corners, strip
    join_patches(places, patches.near, *linked, turn, root)
    counts = (sizes.reshape(n, PATCHES) > 0).sum(axis=1)
    seeds = np.bincount(root[PATCHES * np.flatnonzero(counts == 1)], minlength=PATCHES * n)
    number = np.full(PATCHES * n, -1, np.int32)
    large = np.flatnonzero(seeds >= options.min_points)
    number[large] = np.arange(len(large))
    label = np.where(sizes > 0, number[root], -1).reshape(n, PATCHES)
    label = np.ascontiguousarray(label, np.int32)
    claimed, counted = np.full_like(label, -1), np.zeros_like(label)
    claim_corners(patches.near, patches.corners, label, CLAIMS, claimed, counted)
    size = np.bincount(label[label >= 0], minlength=len(large))
    rank = np.empty(len(large), np.int32)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(large))
    offsets = np.concatenate([[0], np.cumsum((label >= 0).sum(axis=1))])
    members = Ragged(offsets, rank[label[label >= 0]])
    return ManifoldSet(members, len(large), counts, points=places)
