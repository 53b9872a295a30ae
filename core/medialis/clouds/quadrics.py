"""Clouds without their scatter, and with their volume: points on quadrics through those round them.

Planes shrink what is round: the mean of a cap lies below its top. A quadric bends with it. It is
fitted to some fifty points, of a cloud that is thinned first where so many lie within the scatter,
so that it always sees a disc several times as wide as the scatter. Where it begins is told by the
planes of `smoothing.py`, which tell surfaces that cross; each fit leaves out what lies off the one
before.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.progress import Progress
from medialis.base.threads import nearest_rows, run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.clouds.smoothing import (
    AROUND,
    FARTHER,
    SCATTERS_APART,
    neighbours_of,
    without_jitter,
)
from medialis.skeleton.surface_skeleton import points_apart

NEIGHBOURS = 70
"""Points of a quadric: they leave a third of the scatter."""

WIDE = 5.0
"""Radius of its disc at least, in units of the scatter."""

BANDS = 3.5, 6.0
"""Scatters by which a point may lie off a surface that it names, and that it is moved onto."""

PLANE = 16
"""Places without scatter that tell the normal."""

SURFACES = 3
"""Places of the thinned cloud whose surface a point may lie on: that whose plane is nearest."""

SAMPLES = 1000
"""Neighbourhoods that tell how dense the cloud is."""

TAIL = 3.2
"""Scatters off the surface of the others up to which a point is of it: of its own 0.14 % are not,
0.2 % where the scatter is measured 4 % too low. With 3.0 up to 0.4 % of clean points went."""

CHUNK = 512


def on_quadrics(
    points: FloatArray, scatter: float, progress: Progress, queries: FloatArray | None = None
) -> FloatArray:
    """Move points onto the surface that they scatter about, or others onto theirs.

    Parameters
    ----------
    points : (n, 3) float64
        All different.
    scatter : float
        Standard deviation in the units of the points, above 0.
    progress : Progress
    queries : (q, 3) float64, optional
        Moved instead of the points.

    Returns
    -------
    (n, 3) or (q, 3) float64
        Points that no surface passes within six times the scatter stay.

    Notes
    -----
    Cost O(n log n). Not in the thesis.
    """
    from medialis.clouds._quadric_kernels import move_onto_quadrics

    given = points if queries is None else queries
    moved, count = given.copy(), len(given)
    if len(points) <= PLANE or count == 0:
        return moved
    places, normals, chosen = _planes(points, scatter, progress)
    tree = run_patiently(lambda: kd_tree(points[chosen]), progress)
    beside = nearest_rows(tree, given, min(SURFACES, len(chosen)), progress).reshape(count, -1)
    heights = np.einsum("ijk,ijk->ij", places[beside] - given[:, None], normals[beside])
    nearest = np.abs(heights).argmin(axis=1)
    each = np.arange(count)
    own, height = beside[each, nearest], heights[each, nearest]
    starts = np.column_stack([given, normals[own], height])
    fewer = _thinned(points, scatter, progress)
    tree = run_patiently(lambda: kd_tree(fewer), progress)
    near = nearest_rows(tree, given, min(NEIGHBOURS, len(fewer)), progress)
    near = np.ascontiguousarray(near.reshape(count, -1), np.int32)
    known = fewer, near, starts, scatter, BANDS, moved
    run_chunks(move_onto_quadrics, count, CHUNK, *known, progress=progress)
    return moved


def within_scatter(points: FloatArray, noise: Mask, scatter: float, progress: Progress) -> Mask:
    """Tell which points of noise scatter about the surface of the others, no farther than these.

    Patches of a scattering surface lose its tails. A point beyond a border lies on a quadric, too:
    where it would be on the surface others must lie as close as they do there.

    Parameters
    ----------
    points : (n, 3) float64
    noise : (n,) bool
    scatter : float
        Standard deviation in the units of the points, above 0.
    progress : Progress

    Returns
    -------
    (n,) bool
        A part of `noise`.
    """
    others, rest = np.unique(points[~noise], axis=0), np.flatnonzero(noise)
    result = np.zeros(len(points), bool)
    if len(others) <= AROUND:
        return result
    places = on_quadrics(others, scatter, progress, points[rest])
    off = np.linalg.norm(places - points[rest], axis=1)
    near = (off > 0.0) & (off < TAIL * scatter)
    rest, places = rest[near], places[near]
    if len(rest) == 0:
        return result
    tree = run_patiently(lambda: kd_tree(others), progress)
    beside = nearest_rows(tree, places, AROUND, progress)
    last = np.linalg.norm(others[beside[:, -1]] - places, axis=1)
    asked, row = np.unique(beside, return_inverse=True)
    far = others[nearest_rows(tree, others[asked], AROUND + 1, progress)[:, -1]]
    usual = np.linalg.norm(far - others[asked], axis=1)[row.reshape(beside.shape)]
    result[rest] = last <= FARTHER * np.median(usual, axis=1)
    return result


def _planes(
    points: FloatArray, scatter: float, progress: Progress
) -> tuple[FloatArray, FloatArray, Index]:
    """Return places without scatter, the normals there, and the points that they stand for."""
    order = _from_the_middle(points)
    chosen = np.flatnonzero(
        run_patiently(lambda: points_apart(points, order, SCATTERS_APART * scatter), progress)
    )
    if len(chosen) <= PLANE:
        chosen = np.arange(len(points))
    places = without_jitter(points, chosen, scatter, progress)
    tree = run_patiently(lambda: kd_tree(places), progress)
    near = nearest_rows(tree, places, PLANE, progress)
    spokes = places[near] - places[near].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("rki,rkj->rij", spokes, spokes))[1][:, :, 0]
    return places, np.ascontiguousarray(normals), chosen


def _thinned(points: FloatArray, scatter: float, progress: Progress) -> FloatArray:
    """Leave so few points that a neighbourhood is wider than the scatter is deep."""
    order = _from_the_middle(points)
    rows = order[np.linspace(0, len(points) - 1, min(SAMPLES, len(points))).astype(np.int64)]
    count = min(NEIGHBOURS, len(points) - 1)
    near: IntArray = neighbours_of(points, points[rows], count, progress)
    radius = float(np.median(np.linalg.norm(points[near[:, -1]] - points[rows], axis=1)))
    # Denser than they scatter, points fill a layer: their number grows with the cube at first.
    one_in = max(1, int((WIDE * scatter / radius) ** 2))
    return points[np.sort(order[::one_in])]


def _from_the_middle(points: FloatArray) -> Index:
    """Order points by their distance to the middle: the same however the cloud is turned."""
    return np.argsort(np.linalg.norm(points - points.mean(axis=0), axis=1), kind="stable")
