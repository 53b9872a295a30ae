"""Depth, index and normal buffers of balls and triangles: drawing without light (thesis 3.4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError
from medialis.model.surface import Surface
from medialis.progress import Progress, ProgressCallback
from medialis.render.camera import Camera
from medialis.render.projection import BallSet, TriangleSet, lens, see_balls, see_triangles
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray, IntArray, as_faces, as_field, as_points

BAND = 32
"""Rows drawn by one kernel call: a constant, so that results do not depend on the threads."""

BALLS_A_STEP, PIXELS_A_STEP, TRIANGLES_A_STEP = 1 << 16, 1 << 23, 1 << 14
"""Drawn by one kernel call at most: some 30 ms."""

Mesh = tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Buffers:
    """What each pixel shows.

    Attributes
    ----------
    depth : (h, w) float64
        Distance along the viewing axis, in the caller's units; +inf where nothing is.
    index : (h, w) int32
        The ball, or the number of balls plus the face; -1 where nothing is.
    normals : (h, w, 3) float64
        Unit world-space normal turned to the viewer; 0 where nothing is. None when not asked for.
    """

    depth: FloatArray
    index: IntArray
    normals: FloatArray | None = None

    @property
    def mask(self) -> NDArray[np.bool_]:
        """True where something is, (h, w)."""
        return self.index >= 0


def _bands(
    first_row: NDArray[Any], last_row: NDArray[Any], height: int
) -> tuple[NDArray[np.int64], IntArray]:
    """Return, as compressed rows, the primitives that touch each band, ascending."""
    from medialis.render._splat_kernels import fill_bins

    bands = -(-height // BAND)
    first, last = first_row // BAND, last_row // BAND
    outside = last_row < first_row
    first, last = np.where(outside, 1, first), np.where(outside, 0, last)
    change = np.bincount(first[~outside], minlength=bands + 1)[: bands + 1]
    change -= np.bincount(last[~outside] + 1, minlength=bands + 1)[: bands + 1]
    offsets = np.zeros(bands + 1, np.int64)
    np.cumsum(np.cumsum(change[:bands]), out=offsets[1:])
    items = np.empty(offsets[-1], np.int32)
    fill_bins(first.astype(np.int32), last.astype(np.int32), offsets[:-1].copy(), items)
    return offsets, items


def draw_balls(
    balls: BallSet,
    numbers: FloatArray,
    depth: FloatArray,
    index: IntArray,
    progress: Progress | None = None,
) -> None:
    """Draw balls into depth and index; `numbers` is the `lens`."""
    from medialis.render._splat_kernels import splat_balls

    height = len(depth)
    offsets, items = _bands(balls.boxes[:, 0], balls.boxes[:, 1], height)

    def band(begin: int, end: int) -> Iterator[None]:
        listed = items[offsets[begin // BAND] : offsets[begin // BAND + 1]]
        for part in _steps(listed, balls.boxes, begin, end):
            splat_balls(
                part, balls.view, balls.radii, balls.boxes, numbers, begin, end, depth, index
            )
            yield

    run_chunks(band, height, BAND, progress=progress)


def _steps(listed: IntArray, boxes: IntArray, begin: int, end: int) -> Iterator[IntArray]:
    """Give the balls of a band in parts that take about as long to draw, however large they are."""
    for first in range(0, len(listed), BALLS_A_STEP):
        balls = listed[first : first + BALLS_A_STEP]
        row0, row1, column0, column1 = boxes[balls].T.astype(np.int64)
        rows = np.minimum(row1 + 1, end) - np.maximum(row0, begin)
        pixels = np.cumsum(rows * (column1 + 1 - column0))
        cuts = np.flatnonzero(np.diff(pixels // PIXELS_A_STEP)) + 1
        yield from np.split(balls, cuts)


def draw_mesh(
    triangles: TriangleSet,
    numbers: FloatArray,
    depth: FloatArray,
    index: IntArray,
    *,
    glass: NDArray[np.float32] | None = None,
    mesh: Mesh | None = None,
    progress: Progress | None = None,
) -> None:
    """Draw triangles into depth and index, or, with `glass`, add see-through layers to it."""
    from medialis.render._splat_kernels import draw_triangles, triangle_rows

    height = len(depth)
    count = len(triangles.corners)
    first, last = np.empty(count, np.int32), np.empty(count, np.int32)
    triangle_rows(triangles.screen, triangles.corners, height, depth.shape[1], first, last)
    offsets, items = _bands(first, last, height)
    layers = np.zeros((0, 0, 4), np.float32) if glass is None else glass
    known = empty_mesh() if mesh is None else mesh

    def band(begin: int, end: int) -> Iterator[None]:
        listed = items[offsets[begin // BAND] : offsets[begin // BAND + 1]]
        for place in range(0, len(listed), TRIANGLES_A_STEP):
            draw_triangles(
                listed[place : place + TRIANGLES_A_STEP],
                triangles.screen,
                triangles.corners,
                triangles.names,
                numbers,
                begin,
                end,
                glass is not None,
                known,
                depth,
                index,
                layers,
            )
            yield

    run_chunks(band, height, BAND, progress=progress)


def empty_mesh() -> Mesh:
    """Return the mesh tuple of the kernels without a face."""
    corner = np.zeros((0, 3, 3), np.float32)
    none = np.zeros((0, 3))
    return none, np.zeros((0, 3), np.int32), corner, corner, np.zeros(0, np.float32)


def as_radii(radii: ArrayLike, count: int) -> FloatArray:
    """Return radii (k,), or one number for all balls, as finite non-negative float64.

    Raises
    ------
    InvalidShapeError
        For another shape, NaN, infinity or negative radii.
    """
    values = np.full(count, radii) if np.ndim(radii) == 0 else radii
    result = as_field(values, count, "radii")
    if not (np.isfinite(result).all() and (result >= 0).all()):
        raise InvalidShapeError("radii must be finite and at least 0: leave failed balls out.")
    return result


def rasterize(
    camera: Camera,
    *,
    centers: ArrayLike | None = None,
    radii: ArrayLike | None = None,
    points: ArrayLike | None = None,
    faces: ArrayLike | None = None,
    furthest: bool = False,
    normals: bool = False,
    progress: Progress | ProgressCallback | None = None,
) -> Buffers:
    """Return what a camera sees of balls and triangles: depth, index and, if asked, normals.

    A ball has its exact sphere depth at each pixel center and covers at least the pixel of its
    center. Triangles show both sides; neighbours leave no gap and share no pixel. Equal depths go
    to the lowest index. The result does not depend on the number of threads.

    Parameters
    ----------
    camera : Camera
    centers, radii : (k, 3) and (k,) float, optional
        Balls, in the units of the camera.
    points, faces : (n, 3) float and (m, 3) int, optional
        Triangles.
    furthest : bool
        Keep the furthest instead of the nearest surface.
    normals : bool
        Also return unit normals.

    Raises
    ------
    InvalidShapeError
        When an array cannot be used.
    Cancelled
        When the progress callback asks for it.

    Notes
    -----
    Source: thesis 3.4 (billboards with a ball's height, depth test). Deviates: the height is
    evaluated at each pixel, not read from a texture, and perspective balls are exact.

    Examples
    --------
    >>> camera = Camera([0, 0, 5], [0, 0, 0], [0, 1, 0], extent=4.0, width=64, height=64)
    >>> seen = rasterize(camera, centers=[[0, 0, 0]], radii=[1.0])
    >>> round(float(seen.depth.min()), 2), int(seen.mask.sum()) == 812
    (4.0, True)
    """
    from medialis.render._splat_kernels import surface_normals

    steps = Progress.of(progress)
    sign = -1.0 if furthest else 1.0
    numbers = lens(camera, sign)
    depth = np.full((camera.height, camera.width), np.inf)
    index = np.full(depth.shape, -1, np.int32)
    balls = see_balls(camera, np.zeros((0, 3)), np.zeros(0))
    mesh = empty_mesh()
    if centers is not None:
        data = as_points(centers, "centers")
        sizes = as_radii(0.0 if radii is None else radii, len(data))
        with steps.stage("balls", 0.0, 0.5):
            balls = run_patiently(lambda: see_balls(camera, data, sizes), steps)
            draw_balls(balls, numbers, depth, index, steps)
    if points is not None:
        corners = as_points(points)
        triangles = as_faces(np.zeros((0, 3)) if faces is None else faces, len(corners))
        view, count = camera.to_view(corners), len(balls.radii)
        with steps.stage("triangles", 0.5, 0.9):
            seen = run_patiently(lambda: see_triangles(camera, view, triangles, count), steps)
            draw_mesh(seen, numbers, depth, index, progress=steps)
            normals_of = run_patiently(lambda: Surface(view, triangles).face_normals, steps)
        flat = np.repeat(normals_of[:, None], 3, axis=1).astype(np.float32)
        mesh = view, triangles, flat, flat, np.zeros(len(triangles), np.float32)
    if furthest:
        depth = np.where(index >= 0, -depth, np.inf)
    turned = None
    if normals:
        found = np.zeros((*depth.shape, 3))

        def band(begin: int, end: int) -> None:
            surface_normals(depth, index, numbers, begin, end, balls.view, balls.radii, mesh, found)

        run_chunks(band, camera.height, BAND)
        turned = np.einsum("hwk,kj->hwj", found, camera.axes)
    return Buffers(depth, index, turned)
