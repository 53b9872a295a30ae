"""Curve skeletons from views of a shape (thesis 3.7)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from medialis.curve_skeletons.cameras import CameraPair, camera_pairs, sphere_of
from medialis.curve_skeletons.linking import link_points, merge_cells
from medialis.curve_skeletons.pairing import pair_points
from medialis.curve_skeletons.silhouettes import (
    DEFAULT_SALIENCY,
    Crossings,
    Scratch,
    check_border,
    skeletonize,
)
from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.shape import Shape
from medialis.model.view import OrthographicCamera, View, ViewSource
from medialis.progress import Progress, ProgressCallback
from medialis.render.depth_range import rasterizer
from medialis.threads import run_chunks
from medialis.validation import FloatArray, as_number, as_whole_number

DEFAULT_PAIRS = 500
DEFAULT_SIZE = 1024
DEFAULT_ANGLE = math.radians(20)
BATCH = 16
"""Views held at a time: a constant, so that memory and results do not depend on the threads."""
PROBES = 32
"""Views that measure radii and tell inside from outside while the points are linked."""
POINTS_A_CHUNK = 4096
CELL = 2.0
"""Cell of the linking in pixels: the scatter of sharpened points is one or two pixels."""
TRAVEL = 0.2
"""How far sharpening may move a point in all, as a share of the picture. Points also drift toward
thicker parts, along their branch: 500 steps of a pixel emptied thin bridges."""

_factory: ContextVar[Callable[[Shape], ViewSource]] = ContextVar(
    "medialis_view_source", default=rasterizer
)


@contextmanager
def view_source(factory: Callable[[Shape], ViewSource]) -> Iterator[None]:
    """Let all views inside the block come from another renderer, also those of `medialis.run`.

    Parameters
    ----------
    factory : callable
        Called with the shape; returns its `ViewSource`.
    """
    token = _factory.set(factory)
    try:
        yield
    finally:
        _factory.reset(token)


@dataclass(frozen=True, eq=False)
class ViewSkeleton:
    """A curve skeleton from views, and the cloud of points that it was linked from.

    Attributes
    ----------
    curve : CurveSkeleton
    points : (k, 3) float64
        Sharpened points, those in one pixel merged.
    weights : (k,) float64
        Number of matched pairs that each point stands for.
    """

    curve: CurveSkeleton
    points: FloatArray
    weights: FloatArray


class _GivenViews:
    """The source of views that the caller has."""

    def __init__(self, pairs: Sequence[tuple[View, View]]) -> None:
        self._views = {id(view.camera): view for pair in pairs for view in pair}

    def __call__(self, cameras: Sequence[OrthographicCamera]) -> list[View]:
        return [self._views[id(camera)] for camera in cameras]


class _Batch:
    """Depths and distance fields of a few views side by side, as the kernels read them."""

    def __init__(
        self, source: ViewSource, cameras: Sequence[OrthographicCamera], saliency: float
    ) -> None:
        size, count = cameras[0].size, len(cameras)
        self.cameras = np.stack(
            [np.r_[camera.center, camera.axes.ravel(), camera.pixel] for camera in cameras]
        )
        self.near = np.empty((count, size, size), np.float32)
        self.far = np.empty_like(self.near)
        self.field = np.zeros_like(self.near)
        for begin in range(0, count, BATCH):
            for at, view in enumerate(_render(source, cameras[begin : begin + BATCH]), begin):
                self.near[at], self.far[at] = view.near, view.far

        def skeletons(begin: int, end: int) -> None:
            scratch = Scratch(size)
            for at in range(begin, end):
                skeletonize(self.near[at], saliency, scratch, self.field[at])

        run_chunks(skeletons, count, 1)

    def measure(self, points: FloatArray) -> FloatArray:
        """Return the radius of the ball round each point, 0 where a view sees it outside."""
        from medialis.curve_skeletons._sharpening_kernels import measure_radii

        positions = np.ascontiguousarray(points)
        radii = np.full(len(positions), np.inf)
        run_chunks(
            lambda a, b: measure_radii(
                self.cameras, self.near, self.far, self.field, a, b, positions, radii
            ),
            len(positions),
            POINTS_A_CHUNK,
        )
        return radii


def _render(source: ViewSource, cameras: Sequence[OrthographicCamera]) -> Sequence[View]:
    """Return the views of a source, checked: the kernels rely on them."""
    views = source(cameras)
    if len(views) != len(cameras):
        raise InvalidShapeError(
            f"The view source must return one view a camera: {len(views)} came for {len(cameras)}."
        )
    for view, camera in zip(views, cameras, strict=True):
        if view.near.shape != (camera.size, camera.size):
            raise InvalidShapeError(
                f"The view source must return pictures of {camera.size} x {camera.size} pixels, "
                f"got {view.near.shape}."
            )
        check_border(view.near)
    return views


def _match(
    source: ViewSource, pairs: Sequence[CameraPair], saliency: float, progress: Progress
) -> tuple[FloatArray, FloatArray]:
    """Return the points of all pairs of views, those in one pixel merged, and their weights."""
    found: list[FloatArray] = []
    for begin in range(0, len(pairs), BATCH // 2):
        progress.update(begin / len(pairs))
        batch = pairs[begin : begin + BATCH // 2]
        views = _render(source, [camera for pair in batch for camera in pair])
        crossings: list[Crossings] = [None] * len(views)  # type: ignore[list-item]

        def skeletons(
            first: int, last: int, views: Sequence[View] = views, out: list[Crossings] = crossings
        ) -> None:
            scratch = Scratch(views[0].camera.size)
            for at in range(first, last):
                out[at] = skeletonize(views[at].near, saliency, scratch)

        run_chunks(skeletons, len(views), 1)
        found += [
            pair_points(views[at], views[at + 1], crossings[at], crossings[at + 1])
            for at in range(0, len(views), 2)
        ]
    points = np.concatenate(found)
    return merge_cells(points, np.ones(len(points)), max(first.pixel for first, _ in pairs))


def _sharpen(
    source: ViewSource,
    cameras: Sequence[OrthographicCamera],
    points: FloatArray,
    weights: FloatArray,
    saliency: float,
    progress: Progress,
) -> tuple[FloatArray, FloatArray]:
    """Return the points that no view sees outside, moved to the middle of what the views show."""
    from medialis.curve_skeletons._sharpening_kernels import cull_and_sharpen

    # Steps that shrink let the points settle: the last views must not have the last word.
    usual = min(0.625, TRAVEL * cameras[0].size / len(cameras))
    steps = usual * (1.6 - 1.2 * (np.arange(len(cameras)) + 0.5) / len(cameras))
    for begin in range(0, len(cameras), BATCH):
        if len(points) == 0:
            break
        progress.update(begin / len(cameras))
        batch = _Batch(source, cameras[begin : begin + BATCH], saliency)
        alive = np.ones(len(points), bool)

        def work(
            first: int, last: int, batch: _Batch = batch, at: slice = slice(begin, begin + BATCH),
            points: FloatArray = points, alive: np.ndarray = alive,
        ) -> None:  # fmt: skip
            cull_and_sharpen(
                batch.cameras, batch.near, batch.far, batch.field, steps[at], first, last,
                points, alive,
            )  # fmt: skip

        run_chunks(work, len(points), POINTS_A_CHUNK)
        points, weights = points[alive], weights[alive]
    return points, weights


def skeleton_of_views(
    source: ViewSource, pairs: Sequence[CameraPair], saliency: float, progress: Progress
) -> ViewSkeleton:
    """Run the stages of thesis 3.7 on checked input: match, cull and sharpen, link.

    Raises
    ------
    InvalidShapeError
        When no point is left.
    """
    firsts = [first for first, _ in pairs]
    with progress.stage("pairs", 0.0, 0.5):
        points, weights = _match(source, pairs, saliency, progress)
    matched = len(points)
    with progress.stage("sharpen", 0.5, 0.9):
        points, weights = _sharpen(source, firsts, points, weights, saliency, progress)
    with progress.stage("link", 0.9, 1.0):
        probes = _Batch(source, firsts[:PROBES], saliency)
        curve = link_points(points, weights, CELL * firsts[0].pixel, probes.measure)
    if len(curve.nodes) == 0:
        raise InvalidShapeError(
            f"No curve skeleton is left: {matched} places were found in pairs of views, and all of "
            "them lie outside in some view. A solid shape at least two pixels thick is needed: "
            "check that it is closed, or raise size."
        )
    return ViewSkeleton(curve, points, weights)


def view_curve_skeleton(
    shape_or_views: Shape | Sequence[tuple[View, View]],
    *,
    pairs: int = DEFAULT_PAIRS,
    size: int = DEFAULT_SIZE,
    angle: float = DEFAULT_ANGLE,
    saliency: float = DEFAULT_SALIENCY,
    source: ViewSource | None = None,
    progress: Progress | ProgressCallback | None = None,
) -> CurveSkeleton:
    """Compute a curve skeleton from silhouettes and depths of a shape.

    Parameters
    ----------
    shape_or_views : Shape, or sequence of (View, View)
        A mesh, open or closed, or a point cloud with normals. Or pairs of views: the cameras of a
        pair have the same center, extent and up-axis; `pairs`, `size` and `angle` are then theirs.
    pairs : int
        Number of pairs of views (N of the thesis), 1 to 100,000.
    size : int
        Width and height of a view in pixels (P of the thesis), 32 to 8192.
    angle : float
        Between the two cameras of a pair (alpha), in radians, from 1 to 90 degrees.
    saliency : float
        Smallest importance over distance to the contour (sigma_0) of silhouette skeletons, 0 to
        1000. Higher values give fewer branches.
    source : ViewSource, optional
        Who renders the views of a shape; the core's rasterizer when missing (see `view_source`).
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    CurveSkeleton
        Radii come from the views: distance to the nearest contour or depth that any of 32 shows.

    Raises
    ------
    InvalidShapeError
        When the shape has no size, views do not fit together, or no point is left.
    InvalidOptionError
        When an option is out of its range.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    Cost: three renderings of each pair and two silhouette skeletons; memory for 16 views at a time.
    Parts that no view shows, such as handles inside a cavity, are not found. Source: thesis 3.7.
    Deviates: saliency is a plain ratio of lengths, the steps of the sharpening shrink, and only
    views that see a point in the middle of their depth range move it (docs/view_curve_skeleton.md).

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> curve = medialis.view_curve_skeleton(shape, pairs=40, size=128)
    >>> curve.component_count, len(curve.end_points) >= 3
    (1, True)
    """
    sigma = as_number(saliency, "saliency", low=0, high=1000)
    steps = Progress.of(progress)
    if isinstance(shape_or_views, Shape):
        found = skeleton_of_shape(
            shape_or_views, pairs=pairs, size=size, angle=angle, saliency=sigma, source=source,
            progress=steps,
        )  # fmt: skip
        return found.curve
    given = _check_views(shape_or_views)
    cameras = [(first.camera, second.camera) for first, second in given]
    return skeleton_of_views(_GivenViews(given), cameras, sigma, steps).curve


def skeleton_of_shape(
    shape: Shape,
    *,
    pairs: int,
    size: int,
    angle: float,
    saliency: float,
    source: ViewSource | None,
    progress: Progress,
) -> ViewSkeleton:
    """As `view_curve_skeleton` for a shape; returns the cloud of points as well."""
    count = as_whole_number(pairs, "pairs", low=1, high=100_000)
    pixels = as_whole_number(size, "size", low=32, high=8192)
    alpha = as_number(angle, "angle", low=math.radians(1), high=math.radians(90))
    center, radius = sphere_of(shape.points)
    if not radius > 0:
        raise InvalidShapeError(
            f"All {shape.point_count} points of the shape are the same: views need a solid."
        )
    cameras = camera_pairs(center, radius, pairs=count, angle=alpha, size=pixels)
    renderer = _factory.get()(shape) if source is None else source
    return skeleton_of_views(renderer, cameras, saliency, progress)


def _check_views(views: Sequence[tuple[View, View]]) -> list[tuple[View, View]]:
    """Return the pairs, when they can be used."""
    pairs = [tuple(pair) for pair in views]
    if not pairs or any(
        len(pair) != 2 or not all(isinstance(view, View) for view in pair) for pair in pairs
    ):
        raise InvalidShapeError("A Shape or at least one pair of Views (first, second) is needed.")
    size = pairs[0][0].camera.size
    for number, (first, second) in enumerate(pairs):
        a, b = first.camera, second.camera
        fits = a.extent == b.extent and np.allclose(a.center, b.center, rtol=0, atol=a.pixel / 100)
        if not (a.size == b.size == size and fits):
            raise InvalidShapeError(
                f"Pair {number}: both cameras must have the same center and extent, and all views "
                f"the same size in pixels (the first has {size})."
            )
        if not np.allclose(a.axes[1], b.axes[1], rtol=0, atol=1e-6):
            raise InvalidShapeError(
                f"Pair {number}: the up-axes must be the same, got {a.axes[1]} and {b.axes[1]}."
            )
        between = math.acos(min(max(float(a.axes[2] @ b.axes[2]), -1.0), 1.0))
        if not math.radians(0.99) <= between <= math.radians(90.01):
            raise InvalidOptionError(
                f"Pair {number}: the cameras must be 1 to 90 degrees apart, got "
                f"{math.degrees(between):g}."
            )
    return pairs  # type: ignore[return-value]
