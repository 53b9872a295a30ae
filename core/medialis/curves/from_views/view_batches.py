"""Views as the stages of thesis 3.7 take them: checked, and side by side in batches."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from medialis.curves.from_views.silhouettes import Scratch, check_border, skeletonize
from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.model.view import OrthographicCamera, View, ViewSource
from medialis.progress import Progress
from medialis.render.depth_range import Rasterizer
from medialis.threads import run_chunks
from medialis.validation import FloatArray

BATCH = 16
"""Views held at a time: a constant, so that memory and results do not depend on the threads."""
POINTS_A_CHUNK = 4096


class GivenViews:
    """The source of views that the caller has."""

    def __init__(self, pairs: Sequence[tuple[View, View]]) -> None:
        self._views = {id(view.camera): view for pair in pairs for view in pair}

    def __call__(self, cameras: Sequence[OrthographicCamera]) -> list[View]:
        """Return the given view of each camera."""
        return [self._views[id(camera)] for camera in cameras]


class PackedViews:
    """Views with their distance fields, for stages that look at them again.

    Parameters
    ----------
    room : int
        Bytes that they may take; views that do not fit are not kept.
    """

    def __init__(self, room: int) -> None:
        self._room = room
        self._views: dict[int, tuple[NDArray[np.uint8], NDArray[np.float32]]] = {}

    def keep(self, view: View, field: NDArray[np.float32]) -> None:
        """Keep a view and its field, if there is room."""
        from medialis.curves.from_views._packing_kernels import BITS, pack_view

        pixels = view.near.size - int(np.isnan(view.near).sum())
        mask = np.zeros(-(-view.near.size // BITS), np.uint8)
        size = mask.nbytes + 12 * pixels
        if size > self._room:
            return
        self._room -= size
        values = np.empty((pixels, 3), np.float32)
        pack_view(view.near, view.far, field, mask, values)
        self._views[id(view.camera)] = mask, values

    def has(self, camera: OrthographicCamera) -> bool:
        """Tell whether the view of a camera is kept."""
        return id(camera) in self._views

    def unpack(
        self,
        camera: OrthographicCamera,
        near: NDArray[np.float32],
        far: NDArray[np.float32],
        field: NDArray[np.float32],
    ) -> None:
        """Write the view of a camera into pictures (h, w); the field comes with 0."""
        from medialis.curves.from_views._packing_kernels import unpack_view

        unpack_view(*self._views[id(camera)], near, far, field)


class ViewBatch:
    """Depths and distance fields of a few views side by side, as the kernels read them."""

    def __init__(
        self,
        source: ViewSource,
        cameras: Sequence[OrthographicCamera],
        saliency: float,
        packed: PackedViews,
        progress: Progress,
    ) -> None:
        size, count = cameras[0].size, len(cameras)
        self.cameras = np.stack(
            [np.r_[camera.center, camera.axes.ravel(), camera.pixel] for camera in cameras]
        )
        self.near = np.empty((count, size, size), np.float32)
        self.far = np.empty_like(self.near)
        self.field = np.zeros_like(self.near)
        fresh = [at for at, camera in enumerate(cameras) if not packed.has(camera)]
        for begin in range(0, len(fresh), BATCH):
            rows = fresh[begin : begin + BATCH]
            views = render_views(source, [cameras[at] for at in rows], progress)
            for at, view in zip(rows, views, strict=True):
                self.near[at], self.far[at] = view.near, view.far

        def skeletons(begin: int, end: int) -> None:
            scratch = Scratch(size) if fresh else None
            for at in range(begin, end):
                pictures = self.near[at], self.far[at], self.field[at]
                if packed.has(cameras[at]):
                    packed.unpack(cameras[at], *pictures)
                else:
                    assert scratch is not None
                    skeletonize(self.near[at], saliency, scratch, self.field[at])

        run_chunks(skeletons, count, 1, progress=progress.still)

    def measure(self, points: FloatArray) -> FloatArray:
        """Return the radius of the ball round each point, 0 where a view sees it outside."""
        from medialis.curves.from_views._sharpening_kernels import measure_radii

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


def render_views(
    source: ViewSource, cameras: Sequence[OrthographicCamera], progress: Progress
) -> Sequence[View]:
    """Return the views of a source, checked: the kernels rely on them."""
    if isinstance(source, Rasterizer):
        source = functools.partial(source, progress=progress.still)
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


def check_views(views: Sequence[tuple[View, View]]) -> list[tuple[View, View]]:
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
