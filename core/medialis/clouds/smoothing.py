"""How far a cloud scatters about its surfaces, positions without that, and dense noise.

Manifolds are told apart by neighbourhoods, which are flat only where the scatter is small: `jitter`
measures it, `without_jitter` takes it away for the classification.

Points on no smooth patch that are no outliers either lie on tips, edges and thin parts (thesis
4.2.4). Outliers differ from a surface by the distance to their neighbours. Where all points that
the patches leave out lie as close together as those on the surface beside them, nothing tells them
from it: a clean scan keeps them (`dense_points`). Those among outliers go, as some outliers lie
near a surface.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.progress import Progress
from medialis.base.threads import nearest_rows, run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.shape.surface import piece_labels

PLANE_NEIGHBOURS = 54  # halved 93 %, doubled 100 %
"""Neighbours that fit a plane. Of 24, 36, 54, 80: the fewest at which planes, a sphere and a spiral
with a jitter of 0.5 % stay whole; 80 flattens the spiral."""

LEAST_NEIGHBOURS = 2  # halved 0 %, doubled 0 %
"""Fewer name no plane with the point itself."""

SIZES = (16, 36, 81, 182)
"""Neighbourhoods whose flatness is compared. The distance to the tangent plane grows with the
square of the size on a curved surface, in proportion to it where points are denser than they
scatter, and not at all for jitter."""

SAMPLE_STEPS = (1, 1, 2, 2)
"""Of the places measured before, one in so many is measured with each: large ones take long."""

SCATTER_GROWTH = 1.5  # halved 100 %, doubled 0 %
"""Of the size from one neighbourhood to the next."""

DISC_FLATNESS = 0.5  # halved 100 %, doubled 8 %
"""Thickness over width of a neighbourhood that tells how far points scatter about a surface."""

SURELY_DISC = 0.4
"""The same below which a cloud without scatter is believed to have none. The neighbourhoods of
squares of 20,000 points with 1 % of noise are discs in some groups only: two of six were called
clean."""

THINNED, LEAST_THINNED, FEW = 4, 2000, 200
"""One in so many points is left, of so many times so many at least; places whose neighbourhoods are
looked at before."""

GROUPS = 8  # halved 23 %, doubled 16 %
"""Of places with about the same distances between their points."""

LEAST_JITTER = 0.03  # halved 24 %, doubled 28 %
"""Scatter over size of the small neighbourhood below which a cloud is accurate enough: its
triangles then lie well within d_max."""

ROUGH_SHARE = 0.1  # halved 0 %, doubled 0 %
"""Share of neighbourhoods that must scatter so much: most do close to a scanner, far off none."""

PLANE_BAND = 2.5  # halved 100 %, doubled 100 %
"""How far a point may lie from a plane it belongs to, in units of the scatter."""

SECOND_BAND = 0.7  # halved 100 %, doubled 98 %
"""The second pass finds less scatter than the first."""

SCATTERS_APART = 2.0  # halved 84 %, doubled 95 %
"""Distance of the places that are classified, in units of the scatter: those that smooth them are
then within 4 such distances, a disc eight times as wide as it is thick."""

SURFACE_THICKNESS = 4.0  # halved 84 %, doubled 100 %
"""Thickness of a surface in units of the scatter: so far are places compared."""

MIDDLE_DENSITY = 0.5  # halved 89 %, doubled 97 %
"""A place is in the middle of its surface if at least this share of the points lies about it that
lie about others there: half of what is round the middle is so at 1.8 deviations."""

WIDER = 3.0
"""Times SURFACE_THICKNESS within which the points about a place are counted again. The number grows
with the square on surfaces and with the cube in volumes; what is between counts as the nearer one.
With 2.0 one in ten outliers among others was taken for one on a surface, by chance."""

ENOUGH = 8
"""Points within SURFACE_THICKNESS of a place that tell how their number grows."""

CORNER_DENSITY = 0.1
"""Share of what lies about places on the surface, below which a place need not be on one: at the
corner of a square it is 0.25, at 2.5 deviations off it there 0.15."""

MOST_IN_A_DISC = 1000
"""Points within `WIDER` of a place on a surface that tell whether they are a disc."""

SAMPLES = 2000  # halved 51 %, doubled 3 %
"""Neighbourhoods that tell how far a cloud scatters."""

TRIPLES = 60  # halved 35 %, doubled 100 %
"""Planes through three places that are tried in each neighbourhood."""

DENSE_NEIGHBOURS = 6  # halved 33 %, doubled 25 %
"""On a surface as many lie about a point."""

AROUND = 12  # halved 100 %, doubled 14 %
"""Points whose median tells what a place is like."""

DENSE_AROUND = 0.8  # halved 3 %, doubled 100 %
"""Share of the candidates around that must be dense too; of outliers near a surface fewer are."""

FARTHER = 1.5  # halved 100 %, doubled 33 %
"""Distance of the last neighbour, for that of surface points, from which a point is isolated. On a
surface sampled at random the distance to the sixth neighbour varies by a fifth."""

CHUNK = 512  # halved 0 %, doubled 0 %
"""Points."""


def jitter(points: FloatArray) -> float:
    """Measure how far points scatter about the surfaces they sample.

    Parameters
    ----------
    points : (n, 3) float
        All different.

    Returns
    -------
    float
        Standard deviation in the units of the points; 0 where the cloud is accurate, curved more
        than it scatters, or too small to tell.

    Notes
    -----
    Least median of squares planes of 2000 neighbourhoods of growing size, in groups of ones that
    are equally dense. Scatter does not grow with the neighbourhood, so its share of the size falls;
    the share of curvature grows, and where points are denser than they scatter neighbourhoods are
    no discs.
    """
    if len(points) <= SIZES[1] + 1:
        return 0.0
    while True:
        # By the distance to the center: the same samples however the cloud is turned.
        order = np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")
        dense = len(points) >= LEAST_THINNED * THINNED
        if not dense or _discs(points, order, DISC_FLATNESS):
            scatter = _scatter(points, order)
            if scatter > 0.0 or not dense or _discs(points, order, SURELY_DISC):
                return scatter
        # Where points are so dense that neighbourhoods lie within the scatter, fewer tell more.
        points = points[np.sort(order[::THINNED])]


def _scatter(points: FloatArray, order: Index) -> float:
    """Measure how far points scatter, at places all over their order; 0 where they do not."""
    rows = order[np.linspace(0, len(points) - 1, min(SAMPLES, len(points))).astype(np.int64)]
    near = neighbours_of(points, points[rows], SIZES[0], Progress())
    reach = np.linalg.norm(points[near[:, -1]] - points[rows], axis=1)
    groups = np.array_split(np.argsort(reach, kind="stable"), GROUPS)
    found = [_group_jitter(points, rows[group]) for group in groups if len(group)]
    scatter = np.array([one for one, _ in found if one > 0.0])
    rough = np.mean([share for _, share in found])
    some = 2 * len(scatter) > len(found) and rough > ROUGH_SHARE
    return float(np.median(scatter)) if some else 0.0


def _discs(points: FloatArray, order: Index, flatness: float) -> bool:
    """Tell whether the largest neighbourhoods are discs at most of some places."""
    rows = order[np.linspace(0, len(points) - 1, FEW).astype(np.int64)]
    near = neighbours_of(points, points[rows], SIZES[-1], Progress())
    return _disc_like(points[near], flatness)


def _group_jitter(points: FloatArray, rows: Index) -> tuple[float, float]:
    """Scatter about places that are equally dense, and how many of them it makes rough.

    Neighbourhoods grow until the scatter does so no more; 0 where it never stops.
    """
    from medialis.clouds._kernels import measure_flatness

    before, least, rough = np.inf, np.inf, 0.0
    for size, step in zip(SIZES, SAMPLE_STEPS, strict=True):
        rows = np.ascontiguousarray(rows[::step])
        if size >= len(points):
            break
        near = neighbours_of(points, points[rows], size, Progress())
        found, radius = np.empty(len(rows)), np.empty(len(rows))
        measure_flatness(points, near, rows, _triples(size), found, radius)
        # 1.48 makes a median a standard deviation; the second factor corrects small samples
        # (Rousseeuw and Leroy, Robust Regression and Outlier Detection, 1987).
        found *= 1.4826 * (1 + 5 / (size - 2))
        scatter, share = float(np.median(found)), float(np.median(found / radius))
        rough = max(rough, float(np.mean(found > LEAST_JITTER * radius)))
        ends = before < np.inf and share < least and scatter < SCATTER_GROWTH * before
        if ends and _disc_like(points[near], DISC_FLATNESS):
            return scatter, rough
        before, least = scatter, share
    return 0.0, 0.0


def _disc_like(places: FloatArray, flatness: float) -> bool:
    """Tell discs from balls and from wires, which scatter about their axis: most are flat.

    `places` (r, k, 3) are neighbourhoods.
    """
    return bool(np.median(_flatness(places)) < flatness)


def _flatness(places: FloatArray) -> FloatArray:
    """Thickness over width (r,) of neighbourhoods (r, k, 3)."""
    spokes = places - places.mean(axis=1, keepdims=True)
    return _roots(np.einsum("rki,rkj->rij", spokes, spokes))


def _roots(spread: FloatArray) -> FloatArray:
    """Thickness over width (r,) by covariances (r, 3, 3)."""
    size = np.linalg.eigvalsh(spread)
    return np.asarray(np.sqrt(np.maximum(size[:, 0], 0.0) / np.maximum(size[:, 1], 1e-300)))


def without_jitter(
    points: FloatArray, chosen: Index, scatter: float, progress: Progress
) -> FloatArray:
    """Move each chosen point onto the plane that its neighbours support best (two passes).

    Points that no plane passes within 2.5 times the scatter stay, and so do those that lie so far
    apart that the scatter does not matter.
    """
    from medialis.clouds._kernels import smooth_positions

    moved = points[chosen]
    count = min(PLANE_NEIGHBOURS, len(chosen) - 1)
    if count < LEAST_NEIGHBOURS:
        return moved
    near = neighbours_of(moved, moved, count, progress)
    last = moved[near[:, min(SIZES[0], count) - 1]]
    # Of points on a disc of radius r the rms distance is r / sqrt 2.
    radius = np.linalg.norm(last - moved, axis=1) / np.sqrt(2.0)
    rows = np.flatnonzero(scatter > LEAST_JITTER * radius)
    middle = run_patiently(lambda: _in_the_middle(points, moved, near, scatter), progress)
    for band in (PLANE_BAND * scatter, SECOND_BAND * PLANE_BAND * scatter):
        places, beside = moved[rows], moved[middle]
        fewer = min(count, len(beside) - 1)
        if fewer < LEAST_NEIGHBOURS:
            break
        near, triples = neighbours_of(beside, places, fewer, progress), _triples(fewer)
        smooth = partial(smooth_positions, beside, near, triples, band)
        run_chunks(smooth, len(rows), CHUNK, places, progress=progress)
        moved[rows] = places
    return moved


def _in_the_middle(points: FloatArray, chosen: FloatArray, near: IntArray, scatter: float) -> Mask:
    """Tell the chosen points that lie where points are dense, not at the outside of the scatter.

    Points that are chosen for being apart lie there far more often than others.
    """
    around = kd_tree(points).query_ball_point(chosen, SCATTERS_APART * scatter, return_length=True)
    close = np.linalg.norm(chosen[near] - chosen[:, None], axis=2) < SURFACE_THICKNESS * scatter
    return np.asarray(around >= MIDDLE_DENSITY * np.where(close, around[near], 0).max(axis=1))


def beside_surfaces(points: FloatArray, chosen: Index, scatter: float, progress: Progress) -> Mask:
    """Tell the chosen points that fill a volume and are few: where outliers lie close together.

    Points that are chosen for being apart are as dense on a surface as among such outliers, but
    about those on a surface lie more of all points.
    """
    tree, reach = run_patiently(lambda: kd_tree(points), progress), SURFACE_THICKNESS * scatter
    order = np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")
    rows = order[np.linspace(0, len(points) - 1, min(SAMPLES, len(points))).astype(np.int64)]

    def count(places: FloatArray, distance: float) -> Index:
        found = np.empty(len(places), np.int64)

        def search(begin: int, end: int) -> None:
            some = places[begin:end]
            found[begin:end] = tree.query_ball_point(some, distance, return_length=True)

        run_chunks(search, len(places), CHUNK, progress=progress)
        return found

    usual = float(np.median(count(points[rows], reach)))
    about = count(points[chosen], reach)
    few = np.flatnonzero((about >= ENOUGH) & (about < MIDDLE_DENSITY * usual))
    result = np.zeros(len(chosen), bool)
    if len(few) == 0:
        return result
    wide = count(points[chosen[few]], WIDER * reach)
    result[few] = wide > WIDER**2.5 * about[few]
    # In a corner of where they are outliers grow as on a surface, but they are no disc.
    doubtful = few[~result[few] & (about[few] < CORNER_DENSITY * usual)]
    fewer = points[order[:: max(1, int(WIDER**2 * usual / MOST_IN_A_DISC))]]
    places = points[chosen[doubtful]]
    flat = run_patiently(lambda: _flatness_within(fewer, places, WIDER * reach), progress)
    result[doubtful] = flat > DISC_FLATNESS
    return result


def _flatness_within(points: FloatArray, places: FloatArray, reach: float) -> FloatArray:
    """Thickness over width (p,) of the points round places; 0 where there are few."""
    tree, result = kd_tree(points), np.zeros(len(places))
    for begin in range(0, len(places), CHUNK):
        some = places[begin : begin + CHUNK]
        lists = tree.query_ball_point(some, reach)
        counts = np.array([len(one) for one in lists])
        owner = np.repeat(np.arange(len(some)), counts)
        members = np.concatenate([np.asarray(one, np.int64) for one in lists])
        spokes = (points[members] - some[owner]) / reach
        least = np.maximum(counts, 1)

        def mean(values: FloatArray, owner: Index = owner, least: Index = least) -> FloatArray:
            return np.asarray(np.bincount(owner, values, len(least)) / least)

        middle = np.stack([mean(spokes[:, k]) for k in range(3)], axis=1)
        square = np.array([[mean(spokes[:, i] * spokes[:, j]) for j in range(3)] for i in range(3)])
        spread = np.moveaxis(square, 2, 0) - middle[:, :, None] * middle[:, None]
        known = counts >= ENOUGH
        result[begin : begin + len(some)][known] = _roots(spread[known])
    return result


def neighbours_of(
    points: FloatArray, queries: FloatArray, count: int, progress: Progress
) -> IntArray:
    """Return the `count` nearest points of each query but itself, (q, count), by distance.

    The points must differ.
    """
    tree = run_patiently(lambda: kd_tree(points), progress)
    near = nearest_rows(tree, queries, count + 1, progress)
    return np.ascontiguousarray(near[:, 1:], np.int32)


def _triples(neighbours: int) -> Index:
    """Return ranks of three different places of a neighbourhood, 0 the point itself, (t, 3)."""
    rng = np.random.default_rng(0)
    ranks = [rng.choice(neighbours + 1, 3, replace=False) for _ in range(TRIPLES)]
    return np.array(ranks, np.int64)


def dense_points(points: FloatArray, noise: Mask, least: int, progress: Progress) -> Mask:
    """Tell which points of noise lie as close together as the surface beside them.

    Parameters
    ----------
    points : (n, 3) float
        A cloud.
    noise : (n,) bool
        Points in no manifold.
    least : int
        Points that hang together, with those of the surface, are as many or more.

    Returns
    -------
    (n,) bool
        A part of `noise`.
    """
    places, place = np.unique(points, axis=0, return_inverse=True)
    place, rest = place.reshape(-1), np.zeros(len(places), bool)
    rest[place[noise]] = True
    surface, candidates = np.flatnonzero(~rest), np.flatnonzero(rest)
    if len(candidates) == 0 or len(surface) <= AROUND:
        return np.zeros(len(points), bool)
    near = neighbours_of(places, places, DENSE_NEIGHBOURS, progress)
    last = np.linalg.norm(places[near[:, -1]] - places, axis=1)
    beside = neighbours_of(places[surface], places[candidates], AROUND, progress)
    dense = last[candidates] <= FARTHER * np.median(last[surface][beside], axis=1)
    if len(candidates) > AROUND:
        around = neighbours_of(places[candidates], places[candidates], AROUND, progress)
        dense &= dense[around].mean(axis=1) >= DENSE_AROUND
    good = ~rest
    good[candidates[dense]] = True
    links = np.stack([np.repeat(np.arange(len(places)), DENSE_NEIGHBOURS), near.ravel()], axis=1)
    part = piece_labels(len(places), links[good[links].all(axis=1)])
    good &= rest & (np.bincount(part[good], minlength=part.max() + 1)[part] >= least)
    return good[place]
