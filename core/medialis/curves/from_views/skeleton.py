"""Curve skeletons from views of a shape (thesis 3.7).

Steps: views in pairs, their silhouette skeletons matched to points (`_match`, 3.7.3 and 3.7.4);
points that some view sees outside dropped and the others moved to where views agree (`_sharpen`,
3.7.5); points linked to a graph (`linking.py`, 3.7.6). A few views are held at a time; those
that are needed again are packed (`PackedViews`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import along_space
from medialis.base.device import UNMEASURED, on_gpu
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.kept import room
from medialis.base.options import Options, algorithm, angle, changed, whole
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.curves.curve_skeleton import CurveSkeleton, ViewPoints
from medialis.curves.from_views.drawing import Canvases, Rasterizer, rasterizer
from medialis.curves.from_views.linking import link_points, merge_to
from medialis.curves.from_views.on_gpu import sharpened, silhouette_skeletons
from medialis.curves.from_views.views import (
    NO_FIELD,
    CameraPair,
    Drawn,
    OrthographicCamera,
    Picture,
    Scratch,
    SilhouetteOptions,
    View,
    ViewSource,
    as_drawn,
    camera_pairs,
    pack,
    pair_points,
    skeletonize,
    sphere_of,
)
from medialis.shape.shape import Shape

if TYPE_CHECKING:
    from medialis.base.gpu import Session
    from medialis.curves.from_views._view_kernels import PackedView

PROBES = 32  # halved 61 %, doubled 91 %
"""Views that measure radii and tell inside from outside while the points are linked."""

MOST_POINTS = 250  # halved 0 %, doubled 0 %
"""Points that are sharpened at most: so many times the view size. Real shapes have 75 to 120; with
a low saliency points fill the volume."""

MOST_NODES = 40  # halved 45 %, doubled 0 %
"""Nodes that are linked at most: so many times the view size. Real shapes have 5 to 15."""

CELL = 2.0  # halved 94 %, doubled 89 %
"""Cell of the linking in pixels: the scatter of sharpened points is one or two pixels."""

TRAVEL = 0.2  # halved 92 %, doubled 0 %
"""How far sharpening may move a point in all, as a share of the picture. Points also drift toward
thicker parts, along their branch: 500 steps of a pixel emptied thin bridges."""

LONGEST_STEP = 0.625  # halved 88 %, doubled 70 %
"""Pixels, the mean of all views: 1 in the first ones."""

FIRST_STEP = 1.6  # halved 97 %, doubled 97 %
"""Times the mean step that the first view takes. Steps that shrink let the points settle: the last
views must not have the last word."""

FALL = 1.2  # halved 67 %, doubled 94 %
"""By which the last view takes less than the first, so that the mean stays."""

BATCH = 16  # halved 0 %, doubled 0 %
"""Views held at a time: a constant, so that memory and results do not depend on the threads."""

GPU_PIXELS = 1 << 26
"""Maximum number of pixels of the first views in one batch on a GPU."""

POINTS_A_CHUNK = 4096


class GivenViews:
    """The source of views that the caller has."""

    def __init__(self, pairs: Sequence[tuple[View, View]]) -> None:
        self._views = {id(view.camera): view for pair in pairs for view in pair}

    def __call__(self, cameras: Sequence[OrthographicCamera]) -> list[View]:
        """Return the given view of each camera."""
        return [self._views[id(camera)] for camera in cameras]


class PackedViews:
    """Views of a source with their distance fields; those that are needed again are packed.

    Parameters
    ----------
    source : ViewSource
    saliency : float
        Of the skeletons of the silhouettes.
    room : int
        Bytes that packed views may take; those that do not fit are not kept.
    """

    def __init__(self, source: ViewSource, saliency: float, room: int) -> None:
        self.source, self._saliency, self._room = source, saliency, room
        self._canvases = Canvases(source) if isinstance(source, Rasterizer) else None
        self._packed: dict[int, PackedView] = {}
        """Packed views by the identity of their cameras."""

    def match(
        self, pairs: Sequence[CameraPair], progress: Progress, session: Session | None = None
    ) -> list[FloatArray]:
        """Return the points of some pairs of views; the first views are packed.

        With a session the GPU computes the skeletons after all silhouettes are drawn.
        """
        from medialis.curves.from_views._view_kernels import FIELD

        places: list[FloatArray] = [NOWHERE] * len(pairs)
        firsts, lefts, rights, distances = (list[Any](pairs) for _ in range(4))

        def draw(at: int, last: int, begin: int, views: Sequence[View | None]) -> None:
            camera, other = pairs[begin + at]
            with self._drawn(camera, views[2 * at]) as drawn:
                lefts[begin + at] = self._skeleton(session, *drawn[3:])
                firsts[begin + at] = pack(drawn)
            with self._outlined(other, views[2 * at + 1]) as outlined:
                rights[begin + at] = self._skeleton(session, *outlined)
            if session is None:  # now, while the depths are in the cache of the processor
                pair(begin + at)

        def pair(at: int, last: int = 0) -> None:
            if session is not None:
                firsts[at].values[:, FIELD] = distances[at]
            places[at] = pair_points(firsts[at], pairs[at][1], lefts[at], rights[at])

        for begin in range(0, len(pairs), BATCH // 2):
            some = pairs[begin : begin + BATCH // 2]
            views = self._given([camera for both in some for camera in both], progress)
            run_chunks(draw, len(some), 1, begin, views, progress=progress.still)
        if session is not None:
            size = pairs[0][0].size
            lefts, distances = silhouette_skeletons(session, lefts, size, self._saliency, True)
            rights, _ = silhouette_skeletons(session, rights, size, self._saliency, False)
            run_chunks(pair, len(pairs), 1, progress=progress.still)
        for (camera, _), view in zip(pairs, firsts, strict=True):
            if id(camera) not in self._packed and view.nbytes <= self._room:
                self._room -= view.nbytes
                self._packed[id(camera)] = view
        return places

    def _skeleton(
        self, session: Session | None, runs: IntArray, scratch: Scratch, field: Picture = NO_FIELD
    ) -> Any:
        """Return the crossings of a silhouette; a copy of its runs, when the GPU computes them."""
        if session is not None:
            return runs.copy()
        return skeletonize(runs, self._saliency, scratch, field)

    def look(self, cameras: Sequence[OrthographicCamera], progress: Progress) -> list[PackedView]:
        """Return depths and distance fields of a few cameras: packed ones as far as they go."""
        packed: list[Any] = [self._packed.get(id(camera)) for camera in cameras]
        fresh = [at for at, view in enumerate(packed) if view is None]
        for begin in range(0, len(fresh), BATCH):
            rows = fresh[begin : begin + BATCH]
            views = self._given([cameras[at] for at in rows], progress)

            def work(begin: int, end: int) -> None:
                for at, view in zip(rows[begin:end], views[begin:end], strict=True):  # noqa: B023
                    with self._drawn(cameras[at], view) as drawn:
                        skeletonize(drawn.runs, self._saliency, drawn.scratch, drawn.field)
                        packed[at] = pack(drawn)

            run_chunks(work, len(rows), 1, progress=progress.still)
        return packed

    def _given(
        self, cameras: Sequence[OrthographicCamera], progress: Progress
    ) -> Sequence[View | None]:
        """Return the views of a few cameras; None where a canvas draws them."""
        if self._canvases is not None:
            return [None] * len(cameras)
        return render_views(self.source, cameras, progress)

    @contextmanager
    def _drawn(self, camera: OrthographicCamera, view: View | None) -> Iterator[Drawn]:
        """Give a view, drawn here where nobody gave it."""
        if view is not None:
            yield as_drawn(view)
            return
        assert self._canvases is not None
        with self._canvases.lent(camera.size) as canvas:
            yield canvas.first(camera)

    @contextmanager
    def _outlined(
        self, camera: OrthographicCamera, view: View | None
    ) -> Iterator[tuple[IntArray, Scratch]]:
        """Give the runs of the silhouette of a view, and scratch memory for its skeleton."""
        if view is not None:
            drawn = as_drawn(view)
            yield drawn.runs, drawn.scratch
            return
        assert self._canvases is not None
        with self._canvases.lent(camera.size) as canvas:
            yield canvas.second(camera), canvas.scratch


NOWHERE = np.empty((0, 3))


def radii_in(views: Sequence[PackedView], points: FloatArray) -> FloatArray:
    """Return the radius of the ball round each point, 0 where a view sees it outside."""
    from medialis.curves.from_views._view_kernels import measure_radii

    positions = np.ascontiguousarray(points)
    radii = np.full(len(positions), np.inf)

    def work(begin: int, end: int) -> None:
        for view in views:  # all points of a range by one view: its pixels stay in the cache
            measure_radii(view, begin, end, positions, radii)

    run_chunks(work, len(positions), POINTS_A_CHUNK)
    return radii


def render_views(
    source: ViewSource, cameras: Sequence[OrthographicCamera], progress: Progress
) -> Sequence[View]:
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
    return views


def check_views(views: Sequence[tuple[View, View]]) -> list[tuple[View, View]]:
    """Return the pairs, when they can be used."""
    pairs = [tuple(pair) for pair in views]
    if not pairs or any(
        len(pair) != 2 or not all(isinstance(view, View) for view in pair) for pair in pairs
    ):
        raise InvalidShapeError("A Shape or at least one pair of Views (first, second) is needed.")
    size = pairs[0][0].camera.size
    for number, (a, b) in enumerate((first.camera, second.camera) for first, second in pairs):
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
        100,
        "Pairs of views",
        "Number of directions that the shape is seen from, two views each. 500 with a view size of "
        "1024, as in the thesis, is finer and ten times slower.",
        low=1,
        high=100_000,
    )
    size: int = whole(
        512,
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
    packed: PackedViews, pairs: Sequence[CameraPair], progress: Progress
) -> tuple[FloatArray, FloatArray]:
    """Return the points of all pairs of views, those in one pixel merged, and their weights.

    The first views of the pairs are packed for the next stages.
    """
    size, places = pairs[0][0].size, functools.partial(_places, packed, pairs, progress)
    large = functools.partial(places, max(GPU_PIXELS // size**2, BATCH // 2))
    found = on_gpu(large, len(pairs), UNMEASURED, progress)
    points = np.concatenate(found or places(BATCH // 2))
    pixel, most = max(first.pixel for first, _ in pairs), MOST_POINTS * size
    merged = run_patiently(lambda: merge_to(points, np.ones(len(points)), pixel, most), progress)
    return merged[:2]


def _places(
    packed: PackedViews, pairs: Sequence[CameraPair], progress: Progress, at_once: int,
    session: Session | None = None,
) -> list[FloatArray]:  # fmt: skip
    """Return the points of all pairs of views, computed in batches of `at_once` pairs."""
    places: list[FloatArray] = []
    for begin in range(0, len(pairs), at_once):
        progress.update(begin / len(pairs))
        places += packed.match(pairs[begin : begin + at_once], progress, session)
    return places


def _sharpen(
    packed: PackedViews, cameras: Sequence[OrthographicCamera], points: FloatArray,
    weights: FloatArray, progress: Progress,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return the points that no view sees outside, moved to the middle of what the views show."""
    from medialis.curves.from_views._view_kernels import cull_and_sharpen

    usual = min(LONGEST_STEP, TRAVEL * cameras[0].size / len(cameras))
    steps = usual * (FIRST_STEP - FALL * (np.arange(len(cameras)) + 0.5) / len(cameras))
    if len(points) == 0:
        return points, weights
    # So that the pixels of a view that are looked at are near, too.
    rows = np.argsort(along_space(points), kind="stable")
    points, weights = points[rows], weights[rows]
    for first in range(0, len(cameras), BATCH):
        progress.update(first / len(cameras))
        some, alive = slice(first, first + BATCH), np.ones(len(points), bool)
        seen = list(zip(packed.look(cameras[some], progress), steps[some], strict=True))

        def work(begin: int, end: int, *arrays: NDArray[Any]) -> None:
            for view, step in seen:  # noqa: B023 - called before the next views are seen
                cull_and_sharpen(view, step, begin, end, *arrays)

        sharpen = functools.partial(sharpened, seen, points)
        if moved := on_gpu(sharpen, len(points), UNMEASURED, progress):
            points, alive = moved
        else:
            run_chunks(work, len(points), POINTS_A_CHUNK, points, alive, progress=progress.still)
        points, weights, rows = points[alive], weights[alive], rows[alive]
    order = np.argsort(rows)
    return points[order], weights[order]


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
    packed, firsts = PackedViews(source, options.saliency, room()), [first for first, _ in pairs]
    with progress.stage("pairs", 0.0, 0.5):
        points, weights = _match(packed, pairs, progress)
    matched = len(points)
    with progress.stage("sharpen", 0.5, 0.9):
        points, weights = _sharpen(packed, firsts, points, weights, progress)
    with progress.stage("link", 0.9, 1.0):
        measure = functools.partial(radii_in, packed.look(firsts[:PROBES], progress))
        cell, most = CELL * firsts[0].pixel, MOST_NODES * firsts[0].size
        link = functools.partial(link_points, points, weights, cell, measure, most=most)
        curve = run_patiently(link, progress)
    if len(curve.nodes) == 0:
        why = "no place was found in any pair of views"
        if matched:
            why = f"{matched} places were found in pairs of views, all outside in some other view"
        raise InvalidShapeError(
            f"No curve skeleton is left: {why}. The shape must be closed and two pixels thick: "
            "raise size, or use surface_skeleton for thin sheets."
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
    count, size, angle = options.pairs, options.size, math.radians(options.angle)
    return renderer, camera_pairs(center, radius, pairs=count, angle=angle, size=size)
