"""Distances between a surface and the union of medial balls (thesis 3.4, two-sided)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from medialis.errors import InvalidShapeError
from medialis.model.ragged import Ragged
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray, as_field, as_points

if TYPE_CHECKING:
    from medialis.model.shape import Shape

QUERIES_A_CHUNK = 512
NEAR_VERTICES = 3

DIRECTIONS_A_BALL = 32
"""Points looked at on each sphere."""

BALLS_LOOKED_AT = 20_000
"""More balls than this are thinned evenly: the far side is a measurement, not a proof."""

INSIDE = 1e-9
"""Fraction of the diagonal: points deeper than this in a ball are not on the boundary."""


@dataclass(frozen=True)
class ReconstructionError:
    """How far a surface and the union of balls are apart, in units of the shape.

    Attributes
    ----------
    surface_to_balls_max, surface_to_balls_mean : float
        Over the samples of the surface: distance to the boundary of the union (one-sided Hausdorff
        distance, and its mean).
    balls_to_surface_max, balls_to_surface_mean : float
        Over points of the boundary of the union: distance to the surface.
    """

    surface_to_balls_max: float
    surface_to_balls_mean: float
    balls_to_surface_max: float
    balls_to_surface_mean: float

    @property
    def hausdorff(self) -> float:
        """Two-sided Hausdorff distance."""
        return max(self.surface_to_balls_max, self.balls_to_surface_max)


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
    from medialis._kernels.box_tree import build_box_tree
    from medialis.quality._distance_kernels import largest_radii, nearest_ball

    points, middles = as_points(queries, "queries"), as_points(centers, "centers")
    sizes = as_field(radii, len(middles), "radii")
    if not np.isfinite(sizes).all() or (sizes < 0).any():
        raise InvalidShapeError("radii must be finite and not negative.")
    tree = build_box_tree(middles, np.zeros_like(middles))
    ordered = sizes[tree.order]
    largest = np.zeros((len(tree.child), tree.bounds.shape[2]))
    for nodes, child_depth, fan in _levels(len(tree.child), tree.depth):
        largest_radii(ordered, child_depth, fan, 0, nodes.stop - nodes.start, largest[nodes])
    # Bounds are float32 of coordinates relative to the middle: good to 1e-7 of their size, twice.
    reach = float(np.abs(tree.points).max(initial=0.0) + np.abs(points - tree.center).max())
    distance, ball = np.empty(len(points)), np.empty(len(points), np.int64)
    shifted = points - tree.center

    def work(begin: int, end: int) -> None:
        nearest_ball(
            begin, end, shifted, tree.points, ordered, tree.bounds, tree.child, largest,
            tree.depth, 4e-7 * reach, distance, ball,
        )  # fmt: skip

    run_chunks(work, len(points), QUERIES_A_CHUNK)
    return distance, tree.order[ball]


def _levels(nodes: int, depth: int) -> list[tuple[slice, int, int]]:
    """Nodes of each wide level of a box tree, the binary level of their children, children each."""
    bits = depth % 3 if depth % 3 or depth == 0 else 3
    result, first, count, child_depth, fan = [], 0, 1, bits, 1 << bits
    while first < nodes:
        result.append((slice(first, first + count), child_depth, fan))
        first, count = first + count, 1 << child_depth
        child_depth, fan = child_depth + 3, 8
    return result


def distance_to_surface(queries: ArrayLike, shape: Shape) -> FloatArray:
    """Return the distance of points to a mesh, or to the samples of a cloud, (q,).

    The triangles round the three nearest vertices are looked at: exact near an evenly sampled
    surface, never too small.
    """
    from scipy.spatial import cKDTree

    from medialis.quality._distance_kernels import distance_to_fans

    points = as_points(queries, "queries")
    count = min(NEAR_VERTICES, shape.point_count)
    near_distance, near = cKDTree(shape.points).query(points, k=[*range(1, count + 1)], workers=-1)
    if shape.faces is None:
        return np.ascontiguousarray(near_distance[:, 0])
    incident = Ragged.group(shape.faces.ravel(), shape.point_count)
    distance = np.empty(len(points))

    def work(begin: int, end: int) -> None:
        distance_to_fans(
            begin, end, points, near.astype(np.int64), shape.points, shape.faces,
            incident.offsets, incident.indices // 3, distance,
        )  # fmt: skip

    run_chunks(work, len(points), QUERIES_A_CHUNK)
    return distance


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
    space. The surface is seen at its samples, the balls at 32 points on each of at most 20,000.
    """
    middles = as_points(centers, "centers")
    sizes = as_field(radii, len(middles), "radii")
    out, _ = distance_to_balls(shape.points, middles, sizes)
    rows = np.unique(np.linspace(0, len(sizes) - 1, min(len(sizes), BALLS_LOOKED_AT)).astype(int))
    spread = _sphere_points(DIRECTIONS_A_BALL)
    spheres = (middles[rows, None] + sizes[rows, None, None] * spread).reshape(-1, 3)
    depth, _ = distance_to_balls(spheres, middles, sizes)
    boundary = spheres[depth >= -INSIDE * shape.diagonal]
    back = distance_to_surface(boundary, shape) if len(boundary) else np.zeros(1)
    far = np.abs(out)
    return ReconstructionError(
        float(far.max()), float(far.mean()), float(back.max()), float(back.mean())
    )


def _sphere_points(count: int) -> FloatArray:
    """Fibonacci points on the unit sphere, (count, 3)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
