"""Manifolds of a noisy cloud: smooth surfaces that may cross, and noise (thesis 4.2.3).

Steps: each place of the cloud once, without scatter, no denser than it is (`classified_places`);
patches of each neighbourhood (`_find_patches`); their graph, and what it connects (`_segment`).

The seeds of the thesis are flat points; a flood over the patch graph starts at each, and points
that the same seeds reach form a manifold. The graph is undirected, so the patches that a seed
reaches are its connected component, and every patch of a component is reached by the same seeds.
Different seed sets are therefore different components, and one union-find replaces all floods.
This bounds their number: a manifold needs `min_points` flat points, each in one component only, so
there are at most n / min_points, at any angle of intersection; a point is in 4 at most.

`manifold_surfaces` makes a triangle mesh of each manifold, with its holes and borders (4.2.3.8).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Index, Ragged, extent, kd_tree
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound, kept
from medialis.base.options import Options, algorithm, angle, flag, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, as_points, as_whole_number, frozen, hold
from medialis.clouds.smoothing import (
    SCATTERS_APART,
    beside_surfaces,
    jitter,
    neighbours_of,
    without_jitter,
)
from medialis.shape.surface import Surface
from medialis.skeleton.surface_skeleton import points_apart

if TYPE_CHECKING:
    from medialis.clouds._patch_kernels import Patches

FEWEST_PLACES = 5  # halved 0 %, doubled 0 %
"""A patch has a point and four neighbours (`LEAST_NEIGHBOURS` of `_patch_kernels`)."""

BENT = 1.5  # halved 100 %, doubled 70 %
"""Neighbours of a bent patch for each of a flat one: a quadric has 6 coefficients, a plane 3."""

WIDE = 10  # halved 0 %, doubled 0 %
"""Times the neighbours of a patch among which points on one line of a scan look for others."""

STAR_NEIGHBOURS = 32
"""Nearest points of the same manifold. Of a random plane, 2 in 1000 triangles have a corner that
is not one of 20 neighbours of another; with 32 it is fewer than 1 in 1000."""

RESTING = 20
"""The circle of a triangle is not wider than the distance to this neighbour, 2.5 mean spacings:
wider gaps are holes or the outside."""

TIE_WEIGHT = 1e-3
"""Weights of points in units of the squared spacing: on a grid, four points lie on a circle, and
their corners must agree on one of its two diagonals."""

ROUNDED = 1.01  # halved 36 %, doubled 39 %
"""Times farther than it must have been that a place which was left out may find the one that speaks
for it: rounding must leave none without."""

CHUNK = 1024  # halved 0 %, doubled 0 %
"""Points."""


class PointClass(IntEnum):
    """What a point of a cloud is."""

    NOISE = 0
    """In no manifold."""
    FLAT = 1
    """In one manifold."""
    INTERSECTION = 2
    """In several manifolds, where they cross."""


@dataclass(frozen=True, eq=False, repr=False)
class ManifoldSet(Bound):
    """Which manifolds each point of a cloud belongs to: none, one, or several.

    Attributes
    ----------
    manifolds : Ragged
        Row i: the manifolds of point i, the one with its largest patch first.
    count : int
        Number of manifolds m; manifold 0 has most points.
    patch_counts : (n,) int32
        Flat patches through each point (thesis 4.2.3.3).
    points : (n, 3) float64
        The cloud.

    Raises
    ------
    InvalidShapeError
        When the arrays have different numbers of rows or a manifold is not below `count`.

    Examples
    --------
    >>> found = ManifoldSet(Ragged([0, 1, 3, 3], [0, 1, 0]), 2, [1, 2, 0], points=np.eye(3))
    >>> found.labels().tolist(), found.point_class.tolist()
    ([0, 1, -1], [1, 2, 0])
    >>> found.membership.toarray().tolist()
    [[True, False], [True, True], [False, False]]
    """

    manifolds: Ragged
    count: int
    patch_counts: IntArray
    points: FloatArray = field(kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", as_whole_number(self.count, "count", low=0, high=2**31))
        n, named = len(self.manifolds), self.manifolds.indices
        if len(self.points) != n:
            raise InvalidShapeError(
                f"The set of manifolds has {n} rows, the cloud {len(self.points)} points."
            )
        hold(self, points=(n, 3), patch_counts=n)
        if len(named) and (named.min() < 0 or named.max() >= self.count):
            raise InvalidShapeError(
                f"Manifolds must be 0..{self.count - 1}, got {named.min()}..{named.max()}."
            )

    def __len__(self) -> int:
        return len(self.manifolds)

    def __repr__(self) -> str:
        return f"ManifoldSet({len(self)} points, {self.count} manifolds)"

    @cached_property
    def membership(self) -> Any:
        """Sparse boolean matrix (n, m), scipy CSR: whether point i is in manifold j."""
        from scipy.sparse import csr_array

        rows = self.manifolds
        arrays = np.ones(len(rows.indices), bool), rows.indices.copy(), rows.offsets.copy()
        matrix = csr_array(arrays, shape=(len(self), self.count))
        matrix.sort_indices()
        return matrix

    def labels(self) -> IntArray:
        """Return one manifold for each point, (n,) int32: the first of its row; -1 is noise."""
        result, some = np.full(len(self), -1, np.int32), self.manifolds.lengths > 0
        result[some] = self.manifolds.indices[self.manifolds.offsets[:-1][some]]
        return frozen(result, np.int32)

    @cached_property
    def point_class(self) -> NDArray[np.int8]:
        """A `PointClass` for each point, (n,)."""
        return frozen(np.minimum(self.manifolds.lengths, 2), np.int8)

    @cached_property
    def sizes(self) -> Index:
        """Points of each manifold, (m,); those in several count in each."""
        return frozen(np.bincount(self.manifolds.indices, minlength=self.count), np.int64)

    def at(self, rows: Index) -> ManifoldSet:
        """Return the set of the given points (r,), in their order; they may repeat.

        -1 is one in no manifold, wherever it lies.
        """
        known = rows >= 0
        lengths = np.where(known, self.manifolds.lengths[rows], 0)
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        chosen = Ragged(offsets, self.manifolds.joined(rows[known]))
        counts = np.where(known, self.patch_counts[rows], 0).astype(np.int32)
        return ManifoldSet(chosen, self.count, counts, points=self.points[rows])

    def points_of(self, manifold: int) -> Index:
        """Return the points of a manifold, ascending.

        Raises
        ------
        InvalidOptionError
            When there is no such manifold.
        """
        number = as_whole_number(manifold, "manifold", low=0, high=self.count - 1)
        owner = np.repeat(np.arange(len(self)), self.manifolds.lengths)
        return np.sort(owner[self.manifolds.indices == number])


@dataclass(frozen=True, eq=False)
class Speakers:
    """Which of the classified places speaks for each point.

    Attributes
    ----------
    place : (n,) int64
        The place of each point.
    places : (p, 3) float64
        Different places.
    chosen : (k,) int64
        Those that are classified.
    apart : float
        Places nearer to a chosen one than this may be left out.
    """

    place: NDArray[np.int64]
    places: FloatArray
    chosen: NDArray[np.int64]
    apart: float

    def rows(self, found: ManifoldSet) -> Index:
        """Return the row of each point in a set of the chosen places, (n,).

        A place that was left out has that of the nearest chosen one in a manifold, if there is one
        as near as it must have been; -1 where there is none.
        """
        row = np.full(len(self.places), -1)
        row[self.chosen] = np.arange(len(self.chosen))
        left = np.flatnonzero(row < 0)
        if len(left):
            good = np.flatnonzero(found.manifolds.lengths > 0)
            for rows in (np.arange(len(self.chosen)), good):
                tree = kd_tree(self.places[self.chosen[rows]])
                reach = ROUNDED * self.apart
                near = tree.query(self.places[left], distance_upper_bound=reach)[1]
                some = near < len(rows)
                row[left[some]] = rows[near[some]]
        return np.asarray(row[self.place])


def classified_places(
    points: FloatArray, smooth: bool, progress: Progress
) -> tuple[FloatArray, Speakers]:
    """Return each place once, in units of the size and without scatter, and who speaks for whom.

    Places are in the order of coordinates: ties then do not depend on the given order. None are
    returned for points that all coincide. Where they are denser than they scatter, no
    neighbourhood of theirs is flat: some are chosen that are far enough apart.
    """
    low, high = extent(points)
    size = math.hypot(*(high - low))
    if size == 0.0:
        nowhere = np.zeros(len(points), np.int64)
        return np.empty((0, 3)), Speakers(nowhere, np.empty((0, 3)), nowhere[:0], 0.0)
    places, place = run_patiently(lambda: different_rows(points, points.T[::-1]), progress)
    places = (places - 0.5 * (low + high)) / size
    every = np.arange(len(places))
    scatter = 0.0
    if smooth and len(places) >= FEWEST_PLACES:
        scatter = run_patiently(lambda: jitter(places), progress)
    if scatter == 0.0:
        return places, Speakers(place, places, every, 0.0)
    text = (
        f"The points scatter by {100 * scatter:.2g} % of the size about their surfaces. They were "
        "classified by smoothed positions (smooth = off turns this off)."
    )
    progress.note(text, "scattered", scatter=scatter)
    apart = SCATTERS_APART * scatter
    chosen = np.flatnonzero(points_apart(places, every, apart))
    chosen = chosen[~beside_surfaces(places, chosen, scatter, progress.still)]
    moved = without_jitter(places, chosen, scatter, progress)
    return moved, Speakers(place, places, chosen, apart)


def _classified(
    cloud: Any, points: FloatArray, smooth: bool, progress: Progress
) -> tuple[FloatArray, Speakers]:
    work = partial(classified_places, points, smooth, progress)
    return kept(classified_places, cloud, smooth, work, progress)


def scatter_of(cloud: Surface, options: ManifoldsOptions, progress: Progress) -> float:
    """Return how far points scatter about their surfaces, as `manifolds` has measured it.

    The standard deviation in the units of the points; 0 where they do not, or it was not asked.
    """
    _, speakers = _classified(cloud, cloud.points, options.smooth, progress.still)
    size = math.hypot(*np.ptp(cloud.points, axis=0))
    return size * speakers.apart / SCATTERS_APART


def different_rows(points: FloatArray, keys: FloatArray) -> tuple[FloatArray, Index]:
    """Return the different rows, and which of them each point is.

    As `numpy.unique`, which lets no other thread run while it sorts rows. They are sorted by keys,
    which are their columns in any order; the last one counts most.
    """
    order = np.lexsort(keys)
    rising = points[order]
    fresh = np.ones(len(points), bool)
    fresh[1:] = (rising[1:] != rising[:-1]).any(axis=1)
    place = np.empty(len(points), np.int64)
    place[order] = np.cumsum(fresh) - 1
    return rising[fresh], place


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
        places, speakers = _classified(cloud, points, options.smooth, progress)
    places = frozen(places, np.float64)  # kernels are compiled for read-only ones alone
    if len(places) < FEWEST_PLACES:
        none = Ragged(np.zeros(len(points) + 1, np.int64), np.empty(0, np.int32))
        return ManifoldSet(none, 0, np.zeros(len(points), np.int32), points=points)
    with progress.stage("patches", 0.5, 1.0):
        key = options.smooth, options.neighbours, options.max_bend
        find = partial(_find_patches, places, options, progress)
        patches = kept(_find_patches, cloud, key, find, progress)
        found = run_patiently(lambda: _segment(places, patches, options), progress)
        rows = run_patiently(lambda: speakers.rows(found), progress)
        return replace(found.at(rows), points=points)


def _find_patches(places: FloatArray, options: ManifoldsOptions, progress: Progress) -> Patches:
    """Find patches of each neighbourhood; those on one line of a scan have some on the next."""
    from medialis.clouds._kernels import find_lines, spread_neighbours
    from medialis.clouds._patch_kernels import PATCHES, Patches, find_patches

    n = len(places)
    k = min(options.neighbours, n - 1)
    near = neighbours_of(places, places, min(max(round(BENT * k), k), n - 1), progress)
    line = np.zeros(n, bool)
    find_lines(places, near, k, line)
    rows, wide = np.flatnonzero(line), WIDE * near.shape[1]
    if wide < n and len(rows):
        spread = near[rows]
        spread_neighbours(places, rows, neighbours_of(places, places[rows], wide, progress), spread)
        near[rows] = spread
    slots = PATCHES * n
    patches = Patches(
        k, near, np.zeros((slots, 3)), np.zeros(slots, np.int32), np.zeros(slots, np.uint64),
        np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n, np.uint64),
    )  # fmt: skip
    least = math.cos(math.radians(options.max_bend))
    run_chunks(partial(find_patches, places), n, CHUNK, least, patches, progress=progress)
    return _frozen(patches)


def _frozen(patches: Patches) -> Patches:
    """Kernels that read patches are compiled for read-only ones, as kept ones are."""
    return type(patches)(patches[0], *(frozen(array, array.dtype) for array in patches[1:]))


def _with_bent(places: FloatArray, patches: Patches, least: float) -> Patches:
    """Put the bent patches that their neighbours confirm in the place of the flat ones."""
    from medialis.clouds._patch_kernels import LEAST_TRIANGLES, PATCHES, choose_bent

    chosen = np.zeros(len(places), bool)
    choose_bent(places, patches, least, chosen)
    first = PATCHES * np.flatnonzero(chosen)
    axes, sizes, corners = patches.axes.copy(), patches.sizes.copy(), patches.corners.copy()
    sizes.reshape(-1, PATCHES)[chosen] = 0
    axes[first], corners[first] = patches.bent_axes[chosen], patches.bent_corners[chosen]
    sizes[first] = LEAST_TRIANGLES
    bends = np.where(chosen[:, None, None], patches.bends, 0.0)
    return _frozen(patches._replace(axes=axes, sizes=sizes, corners=corners, bends=bends))


def _segment(places: FloatArray, patches: Patches, options: ManifoldsOptions) -> ManifoldSet:
    """Components of the graph of patches that have enough flat points."""
    from medialis.clouds._kernels import find_strips
    from medialis.clouds._patch_kernels import PATCHES, claim_corners, join_patches

    turn = math.cos(math.radians(options.max_turn))
    patches = _with_bent(places, patches, turn)
    n, sizes = len(places), patches.sizes
    root, strip = np.arange(PATCHES * n), np.zeros(PATCHES * n, bool)
    find_strips(places, patches, strip)
    join_patches(places, patches, strip, turn, root)
    counts = (sizes.reshape(n, PATCHES) > 0).sum(axis=1)
    seeds = np.bincount(root[PATCHES * np.flatnonzero(counts == 1)], minlength=PATCHES * n)
    number = np.full(PATCHES * n, -1, np.int32)
    large = np.flatnonzero(seeds >= options.min_points)
    number[large] = np.arange(len(large))
    label = np.where(sizes > 0, number[root], -1).reshape(n, PATCHES)
    label = np.ascontiguousarray(label, np.int32)
    claimed, counted = np.full_like(label, -1), np.zeros_like(label)
    claim_corners(patches, label, claimed, counted)
    size = np.bincount(label[label >= 0], minlength=len(large))
    rank = np.empty(len(large), np.int32)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(large))
    offsets = np.concatenate([[0], np.cumsum((label >= 0).sum(axis=1))])
    members = Ragged(offsets, rank[label[label >= 0]])
    return ManifoldSet(members, len(large), counts, points=places)


@algorithm(Options)
def manifold_surfaces(
    manifold_set: ManifoldSet, options: Options, progress: Progress
) -> tuple[IntArray, IntArray]:
    """Triangulate each manifold of a cloud.

    Parameters
    ----------
    manifold_set : ManifoldSet
        The manifolds of n points.

    Returns
    -------
    faces : (m, 3) int32
        Corners are points of one manifold; no edge of a manifold has more than two triangles.
        Neighbouring triangles may face opposite sides: a manifold need not have sides.
    owner : (m,) int32
        Manifold of each face.

    See Also
    --------
    manifolds : divides a cloud.

    Notes
    -----
    Cost O(n k^2) and a sort. Source: thesis 4.2.3.8. Deviates: instead of ball pivoting, the
    Delaunay triangles in the tangent plane of each point that at least two of their corners agree
    on. Like a pivoting ball it stays open at borders and at holes wider than the sampling; unlike
    one it needs no radius, no oriented normals and no library.

    Examples
    --------
    >>> import numpy as np, medialis
    >>> flat = np.random.default_rng(0).uniform(-1, 1, (2000, 3)) * [1, 1, 0]
    >>> faces, owner = medialis.manifold_surfaces(medialis.manifolds(flat))
    >>> bool(3.7 < medialis.Surface(flat, faces).area < 4.0)
    True
    """
    cloud = manifold_set.points
    meshes = []
    for manifold in range(manifold_set.count):
        progress.update(manifold / manifold_set.count)
        rows = manifold_set.points_of(manifold)
        mesh = run_patiently(partial(_surface, cloud[rows]), progress)
        meshes.append(rows[mesh])
    if not meshes:
        return frozen(np.empty((0, 3)), np.int32), frozen(np.empty(0), np.int32)
    owner = np.repeat(np.arange(manifold_set.count), [len(mesh) for mesh in meshes])
    return frozen(np.concatenate(meshes), np.int32), frozen(owner, np.int32)


def _surface(points: FloatArray) -> Index:
    """Triangles of one manifold, (m, 3); of equal points the first one stands for all."""
    places, first = np.unique(points, axis=0, return_index=True)
    return first[_triangulate(places)] if len(places) > 3 else np.empty((0, 3), np.int64)


def _triangulate(points: FloatArray) -> Index:
    """Triangles of one manifold, (m, 3)."""
    from medialis.clouds._kernels import list_stars

    size = float(np.ptp(points, axis=0).max())
    places = (points - points.mean(axis=0)) / size
    n, k = len(points), min(STAR_NEIGHBOURS, len(points) - 1)
    near = neighbours_of(places, places, k, Progress())
    sides = places[near] - places[:, None]
    spread = sides - sides.mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1]
    flat = np.ascontiguousarray(np.einsum("nki,nij->nkj", sides, axes[:, :, 1:]))
    farthest = np.linalg.norm(sides[:, min(RESTING, k) - 1], axis=1)
    weights = TIE_WEIGHT * np.median(farthest**2) / RESTING * np.random.default_rng(0).random(n)
    triangles, radii = np.full((n, k, 3), -1, np.int32), np.empty((n, k))
    run_chunks(partial(list_stars, flat, near, weights, farthest), n, CHUNK, triangles, radii)
    made = triangles[:, :, 0] >= 0
    return _agreed(triangles[made].astype(np.int64), radii[made])


def _agreed(listed: Index, radii: FloatArray) -> Index:
    """Triangles listed by two corners or three, at most two at an edge.

    Those of three corners come first, then those with small circles.
    """
    order = np.sort(listed, axis=1)
    rows, first, place, votes = np.unique(
        order, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    widest = np.zeros(len(rows))
    np.maximum.at(widest, place.reshape(-1), radii)
    kept = np.lexsort((widest, -votes))
    kept = kept[votes[kept] >= 2]
    used: dict[tuple[int, int], int] = {}
    chosen = []
    for row in kept.tolist():
        a, b, c = rows[row].tolist()
        edges = ((a, b), (b, c), (a, c))
        if all(used.get(edge, 0) < 2 for edge in edges):
            chosen.append(row)
            for edge in edges:
                used[edge] = used.get(edge, 0) + 1
    return listed[first[np.sort(np.array(chosen, np.int64))]]
