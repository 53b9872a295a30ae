"""Image-based surface reconstruction: the union of medial balls as a surface (thesis 3.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import unit_rows
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.progress import Progress, ProgressCallback
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, as_field
from medialis.shape.shape import Shape
from medialis.show.camera import Camera, shape_view
from medialis.show.colors import map_colors
from medialis.show.picture import Balls, Surface, draw
from medialis.show.raster import Buffers, rasterize
from medialis.skeleton.medial_cloud import MedialCloud

Image = NDArray[np.uint8]
SHARES = (0.01, 0.05, 0.2, 1.0)
_SURFACE = (0.72, 0.75, 0.80)
_ONLY_SURFACE = (0.79, 0.17, 0.17)
_ONLY_BALLS = (0.13, 0.40, 0.80)


@dataclass(frozen=True, eq=False)
class Comparison:
    """How well balls reproduce a surface, over all pixels of one or more views.

    Attributes
    ----------
    ball_images, surface_images, difference_images : tuple of (h, w, 3) uint8
        One a view. In a difference image the colour is the absolute depth difference (violet: none,
        yellow: 1 % of the diagonal or more), red where only the surface is seen, blue where only
        the balls are.
    only_one_share : float
        Pixels that only one of the two covers, relative to those that either covers, 0..1.
    median_difference, difference_95 : float
        Median and 95th percentile of the absolute depth difference where both are seen, in percent
        of the bounding-box diagonal; NaN when they share no pixel.
    ball_count : int
        Balls drawn.
    """

    ball_images: tuple[Image, ...]
    surface_images: tuple[Image, ...]
    difference_images: tuple[Image, ...]
    only_one_share: float
    median_difference: float
    difference_95: float
    ball_count: int


def inner_balls(cloud: MedialCloud) -> IntArray:
    """Return the rows of the maximal inner balls, ascending.

    Raises
    ------
    InvalidShapeError
        When there is none.
    """
    rows = np.flatnonzero(cloud.valid & (cloud.side > 0))
    if len(rows) == 0:
        raise InvalidShapeError(
            f"None of the {len(cloud)} balls is a maximal inner ball: there is nothing to draw. "
            "Check that the normals point outwards."
        )
    return rows.astype(np.int32)


def _cameras(shape: Shape, camera: Camera | Sequence[Camera] | None) -> list[Camera]:
    if camera is None:
        direction, up = shape_view(shape)
        return [Camera.framing(shape.points, direction=direction, up=up)]
    cameras = [camera] if isinstance(camera, Camera) else list(camera)
    if not cameras:
        raise InvalidOptionError("camera must be a camera or at least one of them, got none.")
    return cameras


def sample_discs(shape: Shape) -> tuple[FloatArray, IntArray]:
    """Return a hexagon on the tangent plane of each sample: the visible surface of a point cloud.

    Its inscribed circle has the radius 1.5 spacings, so that neighbours overlap. Samples without a
    normal are left out.
    """
    rows = np.flatnonzero(shape.normals.any(axis=1))
    normals = shape.normals[rows]
    # Any direction across the normal: the cross product with the axis it is least aligned with.
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = unit_rows(np.cross(normals, axis))
    second = np.cross(normals, first)
    angle = np.pi / 3 * np.arange(6)[:, None, None]
    radius = 1.5 * shape.spacing / math.cos(math.pi / 6)
    rim = shape.points[rows] + radius * (np.cos(angle) * first + np.sin(angle) * second)
    points = np.concatenate([shape.points[rows], rim.reshape(-1, 3)])
    count = len(rows)
    center = np.arange(count)
    faces = [
        np.stack([center, center + count * (1 + k), center + count * (1 + (k + 1) % 6)], axis=1)
        for k in range(6)
    ]
    return points, np.concatenate(faces).astype(np.int32)


def _difference(balls: Buffers, surface: Buffers, diagonal: float) -> tuple[Image, FloatArray]:
    """Return the difference image and the differences, in % of the diagonal, where both cover."""
    both = balls.mask & surface.mask
    percent = 100 * np.abs(balls.depth[both] - surface.depth[both]) / diagonal
    colors = np.ones((*both.shape, 3))
    colors[both] = map_colors(percent, "sequential", 0.0, 1.0)
    colors[surface.mask & ~balls.mask] = _ONLY_SURFACE
    colors[balls.mask & ~surface.mask] = _ONLY_BALLS
    return np.rint(255 * colors).astype(np.uint8), percent


def reconstruct_image(
    cloud: MedialCloud,
    camera: Camera | Sequence[Camera] | None = None,
    *,
    progress: Progress | ProgressCallback | None = None,
) -> Comparison:
    """Render the union of the medial balls and the surface alike, and measure how they differ.

    Parameters
    ----------
    cloud : MedialCloud
        Only maximal inner balls are drawn, beside ``cloud.surface``. Where that has no faces, a
        small disc at each sample stands for it.
    camera : Camera or sequence of Camera, optional
        One view, several (their pixels count together), or one automatic view.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    Comparison

    Raises
    ------
    InvalidShapeError
        When the cloud has no maximal inner ball.
    InvalidOptionError
        When the sequence of cameras is empty.
    Cancelled
        When the progress callback asks for it.

    See Also
    --------
    progressive : with growing shares of the balls.

    Notes
    -----
    Source: thesis 3.4, Fig. 3.7. Cost: each ball touches the pixels it covers; 190 000 balls of
    a horse at 1024 x 1024 take about a second.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> medialis.reconstruct_image(cloud).only_one_share < 0.1
    True
    """
    shape = cloud.surface
    steps = Progress.of(progress)
    rows = inner_balls(cloud)
    cameras = _cameras(shape, camera)
    centers, radii = cloud.centers[rows], cloud.radii[rows]
    points, faces = shape.points, shape.faces
    if faces is None:
        points, faces = run_patiently(lambda: sample_discs(shape), steps)
    drawn = Surface(points, faces, color=_SURFACE, smooth=shape.faces is not None)
    images: list[tuple[Image, Image, Image]] = []
    differences: list[FloatArray] = []
    either = only = 0
    for number, view in enumerate(cameras):
        with steps.stage("views", number / len(cameras), (number + 1) / len(cameras)):
            with steps.stage("depth", 0.0, 0.3):
                union = rasterize(view, centers=centers, radii=radii, progress=steps)
            with steps.stage("light", 0.3, 0.9):
                shaded = draw([Balls(centers, radii, color=_SURFACE)], view, progress=steps)
            with steps.stage("surface", 0.9, 1.0):
                there = rasterize(view, points=points, faces=faces, progress=steps)
                surface = draw([drawn], view, progress=steps)
            image, percent = _difference(union, there, shape.diagonal)
            images.append((shaded, surface, image))
            differences.append(percent)
            either += int((union.mask | there.mask).sum())
            only += int((union.mask ^ there.mask).sum())
    pooled, median, high = np.concatenate(differences), math.nan, math.nan
    if len(pooled):
        median, high = float(np.median(pooled)), float(np.percentile(pooled, 95))
    # Ball, surface and difference images.
    first, second, third = zip(*images, strict=True)
    share = only / either if either else math.nan
    return Comparison(first, second, third, share, median, high, len(rows))


def progressive(
    cloud: MedialCloud,
    order_values: ArrayLike | None = None,
    shares: Sequence[float] = SHARES,
    camera: Camera | None = None,
    *,
    progress: Progress | ProgressCallback | None = None,
) -> list[Comparison]:
    """Reconstruct with the first balls only, for growing shares of them.

    Parameters
    ----------
    cloud : MedialCloud
        As in `reconstruct_image`.
    order_values : (k,) float, optional
        Balls are drawn in descending order of this, for instance their importance; NaN comes last
        and ties keep their order. The radius when missing.
    shares : sequence of float
        Shares of the balls, each above 0 and at most 1; at least one ball is drawn.
    camera : Camera, optional
        One automatic view when missing.
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    list of Comparison
        One for each share, in the given order.

    Raises
    ------
    InvalidShapeError
        When the cloud has no maximal inner ball, or the order does not fit the cloud.
    InvalidOptionError
        When a share is not above 0 and at most 1.

    See Also
    --------
    reconstruct_image : with all balls.

    Notes
    -----
    Source: thesis 3.4, progressive rendering.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> pictures = medialis.progressive(cloud, shares=(0.1, 1.0))
    >>> len(pictures)
    2
    """
    steps = Progress.of(progress)
    rows = inner_balls(cloud)
    order = cloud.radii if order_values is None else as_field(order_values, len(cloud), "order")
    descending = np.where(np.isnan(order[rows]), np.inf, -order[rows])
    ranked = rows[np.argsort(descending, kind="stable")]
    for share in shares:
        if not 0 < share <= 1:
            raise InvalidOptionError(f"shares must be above 0 and at most 1, got {share!r}.")
    views = _cameras(cloud.surface, camera)
    results = []
    for number, share in enumerate(shares):
        with steps.stage("progressive", number / len(shares), (number + 1) / len(shares)):
            count = max(1, round(share * len(ranked)))
            part = cloud.subset(ranked[:count])
            results.append(reconstruct_image(part, views, progress=steps))
    return results
