"""Curve skeletons from views of a shape (thesis 3.7)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace

import numpy as np

from medialis.curves.from_views.cameras import CameraPair, camera_pairs, sphere_of
from medialis.curves.from_views.cloud_nodes import merge_to
from medialis.curves.from_views.linking import link_points
from medialis.curves.from_views.pairing import pair_points
from medialis.curves.from_views.silhouettes import (
    NO_FIELD,
    Crossings,
    Scratch,
    SilhouetteOptions,
    skeletonize,
)
from medialis.curves.from_views.view_batches import (
    BATCH,
    POINTS_A_CHUNK,
    GivenViews,
    PackedViews,
    ViewBatch,
    check_views,
    render_views,
)
from medialis.errors import InvalidShapeError
from medialis.kept import room
from medialis.model.curve_skeleton import CurveSkeleton, ViewPoints
from medialis.model.shape import Shape
from medialis.model.view import OrthographicCamera, View, ViewSource
from medialis.options import Options, algorithm, angle, changed, whole
from medialis.progress import Progress
from medialis.render.depth_range import Rasterizer, rasterizer
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray

PROBES = 32
"""Views that measure radii and tell inside from outside while the points are linked."""
MOST_POINTS, MOST_NODES = 250, 40
"""Points that are sharpened, and nodes that are linked, at most: so many times the view size. Real
shapes have 75 to 120 and 5 to 15; with a low saliency points fill the volume."""
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

    See Also
    --------
    view_curve_skeleton : what asks for views.
    rasterizer : the one that is used by itself.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> with medialis.view_source(medialis.rasterizer):
    ...     result = medialis.run("view_curve_skeleton", shape, pairs=2, size=64)
    >>> result.graph is not None
    True
    """
    token = _factory.set(factory)
    try:
        yield
    finally:
        _factory.reset(token)


@dataclass(frozen=True, kw_only=True)
class ViewCurveSkeletonOptions(Options):
    """Options of `view_curve_skeleton`.

    Attributes
    ----------
    source : ViewSource, optional
        Who renders the views of a shape; the core's rasterizer when missing (see `view_source`).
    """

    pairs: int = whole(
        500,
        "Pairs of views",
        "Number of directions that the shape is seen from, two views each.",
        low=1,
        high=100_000,
    )
    size: int = whole(
        1024,
        "View size",
        "Width and height of a view in pixels. Parts thinner than two pixels are lost.",
        low=32,
        high=8192,
    )
    saliency: float = changed(SilhouetteOptions, "saliency")
    angle: float = angle(
        20.0,
        "Angle of a pair",
        "Angle between the two cameras of a pair: small ones place points less exactly, large ones "
        "match wrong points.",
        low=1.0,
        high=90.0,
        advanced=True,
    )
    source: ViewSource | None = None


def _match(
    source: ViewSource,
    pairs: Sequence[CameraPair],
    saliency: float,
    packed: PackedViews,
    progress: Progress,
) -> tuple[FloatArray, FloatArray]:
    """Return the points of all pairs of views, those in one pixel merged, and their weights.

    The first views of the pairs are packed for the next stages.
    """
    places: list[FloatArray] = []
    for begin in range(0, len(pairs), BATCH // 2):
        progress.update(begin / len(pairs))
        batch = pairs[begin : begin + BATCH // 2]
        views = render_views(source, [camera for pair in batch for camera in pair], progress)
        crossings: list[Crossings] = [None] * len(views)  # type: ignore[list-item]

        def skeletons(
            first: int, last: int, views: Sequence[View] = views, out: list[Crossings] = crossings
        ) -> None:
            scratch = Scratch(views[0].camera.size)
            for at in range(first, last):
                field = NO_FIELD if at % 2 else np.zeros_like(views[at].near)
                out[at] = skeletonize(views[at].near, saliency, scratch, field)
                if at % 2 == 0:
                    packed.keep(views[at], field)

        run_chunks(skeletons, len(views), 1, progress=progress.still)
        places += [
            pair_points(views[at], views[at + 1], crossings[at], crossings[at + 1])
            for at in range(0, len(views), 2)
        ]
    points = np.concatenate(places)
    pixel, most = max(first.pixel for first, _ in pairs), MOST_POINTS * pairs[0][0].size
    merged = run_patiently(lambda: merge_to(points, np.ones(len(points)), pixel, most), progress)
    return merged[:2]


def _sharpen(
    source: ViewSource,
    cameras: Sequence[OrthographicCamera],
    points: FloatArray,
    weights: FloatArray,
    saliency: float,
    packed: PackedViews,
    progress: Progress,
) -> tuple[FloatArray, FloatArray]:
    """Return the points that no view sees outside, moved to the middle of what the views show."""
    from medialis.curves.from_views._sharpening_kernels import cull_and_sharpen

    # Steps that shrink let the points settle: the last views must not have the last word.
    usual = min(0.625, TRAVEL * cameras[0].size / len(cameras))
    steps = usual * (1.6 - 1.2 * (np.arange(len(cameras)) + 0.5) / len(cameras))
    for begin in range(0, len(cameras), BATCH):
        if len(points) == 0:
            break
        progress.update(begin / len(cameras))
        batch = ViewBatch(source, cameras[begin : begin + BATCH], saliency, packed, progress)
        alive = np.ones(len(points), bool)

        def work(
            first: int, last: int, batch: ViewBatch = batch,
            at: slice = slice(begin, begin + BATCH), points: FloatArray = points,
            alive: np.ndarray = alive,
        ) -> None:  # fmt: skip
            cull_and_sharpen(
                batch.cameras, batch.near, batch.far, batch.field, steps[at], first, last,
                points, alive,
            )  # fmt: skip

        run_chunks(work, len(points), POINTS_A_CHUNK, progress=progress.still)
        points, weights = points[alive], weights[alive]
    return points, weights


@algorithm(ViewCurveSkeletonOptions, keep=False)
def view_curve_skeleton(
    shape_or_views: Shape | Sequence[tuple[View, View]],
    options: ViewCurveSkeletonOptions,
    progress: Progress,
) -> CurveSkeleton:
    """Compute a curve skeleton from silhouettes and depths of a shape.

    Parameters
    ----------
    shape_or_views : Shape, or sequence of (View, View)
        A mesh, open or closed, or a point cloud with normals. Or pairs of views: the cameras of a
        pair have the same center, extent and up-axis; `pairs`, `size` and `angle` are then theirs.
    source : ViewSource, optional
        Who renders the views of a shape; the core's rasterizer when missing (see `view_source`).

    Returns
    -------
    CurveSkeleton
        With its ``view_points``. Radii come from the views: distance to the nearest contour or
        depth that any of 32 shows.

    Raises
    ------
    InvalidShapeError
        When the shape has no size, views do not fit together, or no point is left.

    See Also
    --------
    curve_skeleton : from the surface skeleton; with the node of each sample of the surface.
    silhouette_skeleton : the skeleton of one silhouette.

    Notes
    -----
    Cost: two renderings of each pair and two silhouette skeletons; memory for 16 views at a time,
    and for the first views of all pairs, packed, as far as `memory_limit` allows (1 GiB): others
    are drawn again.
    Parts that no view shows, such as handles inside a cavity, are not found. Source: thesis 3.7,
    with N pairs of P x P pixels, alpha apart. Deviates: saliency is a plain ratio of lengths, the
    steps of the sharpening shrink, and only views that see a point in the middle of their depth
    range move it (docs/view_curve_skeleton.md).

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> curve = medialis.view_curve_skeleton(shape, pairs=40, size=128)
    >>> curve.component_count, len(curve.end_points) >= 3
    (1, True)
    """
    source, pairs = _source_and_cameras(shape_or_views, options)
    saliency, firsts = options.saliency, [first for first, _ in pairs]
    packed = PackedViews(room())
    with progress.stage("pairs", 0.0, 0.5):
        points, weights = _match(source, pairs, saliency, packed, progress)
    matched = len(points)
    with progress.stage("sharpen", 0.5, 0.9):
        points, weights = _sharpen(source, firsts, points, weights, saliency, packed, progress)
    with progress.stage("link", 0.9, 1.0):
        probes = ViewBatch(source, firsts[:PROBES], saliency, packed, progress)
        cell = CELL * firsts[0].pixel
        most = MOST_NODES * firsts[0].size
        curve = run_patiently(
            lambda: link_points(points, weights, cell, probes.measure, most=most), progress
        )
    if len(curve.nodes) == 0:
        why = "no place was found in any pair of views"
        if matched:
            why = f"{matched} places were found in pairs of views, all outside in some other view"
        raise InvalidShapeError(
            f"No curve skeleton is left: {why}. A solid shape at least two pixels thick is needed: "
            "check that it is closed, raise size, or use surface_skeleton, which finds thin sheets."
        )
    return replace(curve, view_points=ViewPoints(points, weights))


def _source_and_cameras(
    shape_or_views: Shape | Sequence[tuple[View, View]], options: ViewCurveSkeletonOptions
) -> tuple[ViewSource, list[CameraPair]]:
    """Return who draws the views, and the cameras in pairs."""
    if not isinstance(shape_or_views, Shape):
        given = check_views(shape_or_views)
        return GivenViews(given), [(first.camera, second.camera) for first, second in given]
    shape = shape_or_views
    center, radius = sphere_of(shape.points)
    if not radius > 0:
        raise InvalidShapeError(
            f"All {shape.point_count} points of the shape are the same: views need a solid."
        )
    renderer = _factory.get()(shape) if options.source is None else options.source
    if shape.faces is None:  # whoever draws them, the discs of a cloud reach beyond its samples
        discs = renderer if isinstance(renderer, Rasterizer) else rasterizer(shape)
        center, radius = sphere_of(discs.points)
    between = math.radians(options.angle)
    return renderer, camera_pairs(
        center, radius, pairs=options.pairs, angle=between, size=options.size
    )
