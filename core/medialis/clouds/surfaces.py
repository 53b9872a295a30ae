"""A triangle mesh of each manifold of a cloud, with its holes and borders (thesis 4.2.3.8)."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from medialis.clouds.smoothing import nearest_points
from medialis.model.manifold_set import ManifoldSet
from medialis.options import Options, algorithm
from medialis.progress import Progress
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray, IntArray, frozen

NEIGHBOURS = 32
"""Nearest points of the same manifold. Of a random plane, 2 in 1000 triangles have a corner that
is not one of 20 neighbours of another; with 32 it is fewer than 1 in 1000."""

RESTING = 20
"""The circle of a triangle is not wider than the distance to this neighbour, 2.5 mean spacings:
wider gaps are holes or the outside."""

TIE_WEIGHT = 1e-3
"""Weights of points in units of the squared spacing: on a grid, four points lie on a circle, and
their corners must agree on one of its two diagonals."""

CHUNK = 1024


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
        mesh = run_patiently(functools.partial(_surface, cloud[rows]), progress)
        meshes.append(rows[mesh])
    if not meshes:
        return frozen(np.empty((0, 3)), np.int32), frozen(np.empty(0), np.int32)
    owner = np.repeat(np.arange(manifold_set.count), [len(mesh) for mesh in meshes])
    return frozen(np.concatenate(meshes), np.int32), frozen(owner, np.int32)


def _surface(points: FloatArray) -> NDArray[np.int64]:
    """Triangles of one manifold, (m, 3); of equal points the first one stands for all."""
    places, first = np.unique(points, axis=0, return_index=True)
    return first[_triangulate(places)] if len(places) > 3 else np.empty((0, 3), np.int64)


def _triangulate(points: FloatArray) -> NDArray[np.int64]:
    """Triangles of one manifold, (m, 3)."""
    from medialis.clouds._surface_kernels import list_stars

    size = float(np.ptp(points, axis=0).max())
    places = (points - points.mean(axis=0)) / size
    n, k = len(points), min(NEIGHBOURS, len(points) - 1)
    near = nearest_points(places, k, Progress())
    sides = places[near] - places[:, None]
    spread = sides - sides.mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1]
    flat = np.ascontiguousarray(np.einsum("nki,nij->nkj", sides, axes[:, :, 1:]))
    farthest = np.linalg.norm(sides[:, min(RESTING, k) - 1], axis=1)
    weights = TIE_WEIGHT * np.median(farthest**2) / RESTING * np.random.default_rng(0).random(n)
    triangles, radii = np.full((n, k, 3), -1, np.int32), np.empty((n, k))

    def work(begin: int, end: int) -> None:
        list_stars(flat, near, weights, farthest, begin, end, triangles, radii)

    run_chunks(work, n, CHUNK)
    made = triangles[:, :, 0] >= 0
    return _agreed(triangles[made].astype(np.int64), radii[made])


def _agreed(listed: NDArray[np.int64], radii: FloatArray) -> NDArray[np.int64]:
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
