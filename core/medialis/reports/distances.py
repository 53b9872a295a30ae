"""Distances between a surface and the union of medial balls (thesis 3.4, two-sided)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from medialis.threads import thread_count
from medialis.validation import FloatArray, IntArray, as_field, as_points

if TYPE_CHECKING:
    from medialis.model.shape import Shape

PLACES_BETWEEN = 100_000
"""Places of the surface between the samples that are looked at."""

BALLS_LOOKED_AT = 20_000
"""More balls than this are thinned evenly: the far side is a measurement, not a proof."""

SPHERE_POINTS, FEWEST, MOST = 640_000, 32, 512
"""Points looked at on all spheres, and on each."""

INSIDE = 1e-9
"""Fraction of the diagonal: points deeper than this are inside a ball, not on it."""


@dataclass(frozen=True)
class ReconstructionError:
    """How far a surface and the union of balls are apart, in units of the shape.

    Attributes
    ----------
    surface_to_balls_max, surface_to_balls_mean : float
        Over the surface, the mean by area: distance to the union; inside of it, the depth in the
        deepest ball (one-sided Hausdorff distance, and its mean).
    balls_to_surface_max, balls_to_surface_mean : float or None
        Over the boundary of the union, the mean by area: distance to the surface. None when no
        point that was looked at is on the boundary.
    worst_place : (3,) float64
        Where the two-sided Hausdorff distance was found: a point of the surface or of a ball.
    deepest_sample, deep_95_percent : float
        Depth of the samples in the deepest ball around them, 0 outside: the largest, and the one
        that 95 % of the samples do not exceed. 0 is empty.
    """

    surface_to_balls_max: float
    surface_to_balls_mean: float
    balls_to_surface_max: float | None
    balls_to_surface_mean: float | None
    worst_place: FloatArray
    deepest_sample: float
    deep_95_percent: float

    @property
    def hausdorff(self) -> float:
        """Two-sided Hausdorff distance."""
        return max(self.surface_to_balls_max, self.balls_to_surface_max or 0.0)


def distance_to_balls(
    queries: ArrayLike, centers: ArrayLike, radii: ArrayLike
) -> tuple[FloatArray, IntArray]:
    """Return the signed distance of points to a union of balls, and the ball that decides it.

    Parameters
    ----------
    queries : (q, 3) float
    centers : (k, 3) float
    radii : (k,) float, >= 0

    Returns
    -------
    distance : (q,) float64
        min |x - c| - r: exact outside of the union; inside, minus the depth in the deepest ball.
    ball : (q,) int32
        Its row; the distance ties of two balls go either way, but always the same way.

    Raises
    ------
    InvalidShapeError
        For arrays of a wrong shape, or no ball.

    Notes
    -----
    Cost: about O(log k) a query for balls of a skeleton.
    """
    from medialis._kernels.nearest import NearestTree

    return NearestTree.of_balls(centers, radii).distances(as_points(queries, "queries"))


def distance_to_surface(queries: ArrayLike, shape: Shape) -> FloatArray:
    """Return the distance of points to the triangles of a mesh, or the samples of a cloud, (q,)."""
    from medialis._kernels.nearest import NearestTree

    points = as_points(queries, "queries")
    if shape.faces is None:
        return np.asarray(shape.tree.query(points, workers=thread_count())[0])
    return NearestTree.of_triangles(shape.points, shape.faces).distances(points)[0]


def reconstruction_error(shape: Shape, centers: ArrayLike, radii: ArrayLike) -> ReconstructionError:
    """Measure how well a union of balls gives back a surface, both ways.

    Parameters
    ----------
    shape : Shape
    centers, radii : (k, 3), (k,) float
        Balls of a skeleton, perhaps a simplified one.

    Returns
    -------
    ReconstructionError

    Raises
    ------
    InvalidShapeError
        For arrays of a wrong shape, or no ball.

    Notes
    -----
    Source: thesis 3.4 measures it in images (`medialis.reconstruct_image`); here it is measured in
    space. The surface is seen at its samples and at the middles of its edges and faces (at most
    100,000 of these), the balls at 32 to 512 points on each of at most 20,000.
    """
    from medialis._kernels.nearest import NearestTree

    middles = as_points(centers, "centers")
    sizes = as_field(radii, len(middles), "radii")
    tree = NearestTree.of_balls(middles, sizes)
    between, areas = _between(shape)
    places = np.concatenate([shape.points, between])
    out, _ = tree.distances(places)
    inside = INSIDE * shape.diagonal
    depth = np.where(out < -inside, -out, 0.0)[: shape.point_count]
    rows = _thinned(len(sizes), BALLS_LOOKED_AT)
    spread = _sphere_points(int(np.clip(SPHERE_POINTS // len(rows), FEWEST, MOST)))
    spheres = (middles[rows, None] + sizes[rows, None, None] * spread).reshape(-1, 3)
    bare = np.flatnonzero(tree.distances(spheres, enough=-inside)[0] >= -inside)
    boundary, ball = spheres[bare], rows[bare // len(spread)]
    back = distance_to_surface(boundary, shape) if len(boundary) else None
    far = np.abs(out)
    worst = places[far.argmax()]
    if back is not None and back.max() > far.max():
        worst = boundary[back.argmax()]
    return ReconstructionError(
        float(far.max()),
        _mean_over_surface(shape, far, areas),
        None if back is None else float(back.max()),
        None if back is None else _mean(back, (sizes[ball] / max(sizes.max(), 1e-300)) ** 2),
        worst,
        float(depth.max()),
        float(np.percentile(depth, 95)),
    )


def _between(shape: Shape) -> tuple[FloatArray, FloatArray]:
    """Middles of the edges, then of the faces, thinned evenly, and areas of these faces.

    Nothing for a cloud.
    """
    if shape.faces is None:
        return np.empty((0, 3)), np.empty(0)
    edges = len(shape.edges)
    rows = _thinned(edges + shape.face_count, PLACES_BETWEEN)
    on_edges = shape.points[shape.edges[rows[rows < edges]]].mean(axis=1)
    faces = rows[rows >= edges] - edges
    on_faces = shape.points[shape.faces[faces]].mean(axis=1)
    return np.concatenate([on_edges, on_faces]), shape.face_areas[faces]


def _mean_over_surface(shape: Shape, values: FloatArray, areas: FloatArray) -> float:
    """Integrate over triangles: a quarter by their corners, the rest by their middles.

    That is exact for polynomials of degree 2. The places on edges are for the maximum only.
    """
    at_samples = _mean(values[: shape.point_count], shape.point_areas)
    if len(areas) == 0:
        return at_samples
    return 0.25 * at_samples + 0.75 * _mean(values[-len(areas) :], areas)


def _mean(values: FloatArray, weights: FloatArray) -> float:
    """Weighted mean; the plain one where no weight is positive."""
    return float(np.average(values, weights=weights if weights.any() else None))


def _thinned(count: int, most: int) -> IntArray:
    """At most this many of the numbers below count, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _sphere_points(count: int) -> FloatArray:
    """Fibonacci points on the unit sphere, (count, 3)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
