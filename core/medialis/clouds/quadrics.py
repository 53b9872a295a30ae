"""Clouds without their scatter, and with their volume: points on quadrics through those round them.

Planes shrink what is round: the mean of a cap lies below its top. A quadric bends with it. It is
fitted to some fifty points, of a cloud that is thinned first where so many lie within the scatter,
so that it always sees a disc several times as wide as the scatter. Where it begins is told by the
planes of `smoothing.py`, which tell surfaces that cross; each fit leaves out what lies off the one
before.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import Index, kd_tree
from medialis.base.progress import Progress
from medialis.base.threads import nearest_rows, run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.clouds.smoothing import SCATTERS_APART, neighbours_of, without_jitter
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

CHUNK = 512


def on_quadrics(points: FloatArray, scatter: float, progress: Progress) -> FloatArray:
    """Move points onto the surface that they scatter about.

    Parameters
    ----------
    points : (n, 3) float64
        All different.
    scatter : float
        Standard deviation in the units of the points, above 0.
    progress : Progress

    Returns
    -------
    (n, 3) float64
        Points that no surface passes within six times the scatter stay.

    Notes
    -----
    Cost O(n log n). Not in the thesis.
    """
    from medialis.clouds._quadric_kernels import move_onto_quadrics

    moved = points.copy()
    if len(points) <= PLANE:
        return moved
    places, normals, chosen = _planes(points, scatter, progress)
    tree = run_patiently(lambda: kd_tree(points[chosen]), progress)
    beside = nearest_rows(tree, points, min(SURFACES, len(chosen)), progress).reshape(
        len(points), -1
    )
    heights = np.einsum("ijk,ijk->ij", places[beside] - points[:, None], normals[beside])
    nearest = np.abs(heights).argmin(axis=1)
    each = np.arange(len(points))
    own, height = beside[each, nearest], heights[each, nearest]
    starts = np.column_stack([points, normals[own], height])
    fewer = _thinned(points, scatter, progress)
    tree = run_patiently(lambda: kd_tree(fewer), progress)
    near = nearest_rows(tree, points, min(NEIGHBOURS, len(fewer)), progress)
    near = np.ascontiguousarray(near.reshape(len(points), -1), np.int32)
    given = fewer, near, starts, scatter, BANDS, moved
    run_chunks(move_onto_quadrics, len(points), CHUNK, *given, progress=progress)
    return moved


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
