"""The core's own views of triangles, for meshes and clouds (thesis 3.7.4.2).

`Rasterizer` is a `ViewSource`. A pair of views needs less than two of them: of the first one the
whole depth range, since sharpening asks for it anywhere; of the second one its silhouette alone. So
a `Canvas` draws the first one; of the second one it walks the outlines. It is kept from view to
view: pictures made anew cost as much as what is drawn into them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from medialis.base.arrays import Described, along_space
from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.curves.from_views.views import (
    Drawn,
    OrthographicCamera,
    Picture,
    Scratch,
    View,
    runs_of,
    sphere_of,
)
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.shape import Shape

if TYPE_CHECKING:
    from medialis.curves.from_views._draw_kernels import Box, Screen

DISC_NEIGHBOUR = 12
"""The radius of the disc of a sample is the distance to its neighbour of this rank: discs overlap,
also where samples are irregular (checked on random samples of a sphere and a torus)."""

WIDEST_DISC = 4.0
"""Usual discs: an isolated sample must not become a plate."""


@dataclass(frozen=True, eq=False, repr=False)
class Rasterizer(Described):
    """Renders the views of triangles, in parallel over views.

    Attributes
    ----------
    points : (n, 3) float64
    faces : (m, 3) int32

    Notes
    -----
    Every pixel whose center a triangle covers belongs to the silhouette; depth is exact up to
    float32. Source: thesis 3.7.4.2 (depth buffers by GL_LESS and GL_GREATER); both in one pass.
    """

    points: FloatArray
    faces: IntArray

    def __call__(
        self, cameras: Sequence[OrthographicCamera], progress: Progress | None = None
    ) -> list[View]:
        """Return the view of each camera."""
        views: list[View] = [None] * len(cameras)  # type: ignore[list-item]
        canvases = Canvases(self)

        def draw(begin: int, end: int) -> None:
            for at in range(begin, end):
                with canvases.lent(cameras[at].size) as canvas:
                    near, far, _ = canvas.draw(cameras[at])
                    views[at] = View(cameras[at], near.copy(), far.copy())

        run_chunks(draw, len(cameras), 1, progress=progress)
        return views

    @cached_property
    def ordered(self) -> Rasterizer:
        """The same triangles, near ones after each other: they are drawn a sixth faster."""
        order = np.argsort(along_space(self.points), kind="stable")
        number = np.empty(len(order), np.int32)
        number[order] = np.arange(len(order), dtype=np.int32)
        faces = number[self.faces]
        faces = faces[np.argsort(faces.min(axis=1), kind="stable")]
        return Rasterizer(self.points[order], frozen(faces, np.int32))

    @cached_property
    def edges(self) -> IntArray:
        """Corners a, b of each edge, the triangle that has a -> b, and one that has b -> a or -1.

        (e, 4) int32. Where more or less than two triangles meet, or they face different ways, each
        one has an edge of its own.
        """
        corners = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        upward = corners[:, 0] < corners[:, 1]
        key = corners.min(axis=1).astype(np.int64) * len(self.points) + corners.max(axis=1)
        order = np.argsort(2 * key + upward, kind="stable")
        key, upward = key[order], upward[order]
        new = np.r_[True, key[1:] != key[:-1], True]
        two = new[:-2] & ~new[1:-1] & new[2:] & (upward[:-1] != upward[1:])  # begin such a pair
        own = np.r_[two, False] | ~(np.r_[two, False] | np.r_[False, two])
        edges = np.empty((len(order), 4), np.int32)
        edges[:, :2], edges[:, 2], edges[:, 3] = corners[order], order // 3, -1
        edges[:-1, 3][two] = order[1:][two] // 3
        return np.ascontiguousarray(edges[own])


class Canvases:
    """Canvases that threads lend: as many as draw at the same time."""

    def __init__(self, triangles: Rasterizer) -> None:
        self._triangles = triangles
        self._free: list[Canvas] = []

    @contextmanager
    def lent(self, size: int) -> Iterator[Canvas]:
        """Give a canvas of a size that nobody else draws on meanwhile."""
        try:
            canvas = self._free.pop()
        except IndexError:
            canvas = Canvas(self._triangles, size)
        if canvas.size != size:
            canvas = Canvas(self._triangles, size)
        yield canvas
        self._free.append(canvas)


class Canvas:
    """Room of one thread to draw views of triangles in, one after the other.

    Parameters
    ----------
    triangles : Rasterizer
    size : int
        Width and height of the pictures in pixels.
    """

    def __init__(self, triangles: Rasterizer, size: int) -> None:
        from medialis.curves.from_views._draw_kernels import Box

        triangles, n = triangles.ordered, len(triangles.points)
        self.size, self._triangles, self.scratch = size, triangles, Scratch(size)
        self._sphere = sphere_of(triangles.points)
        self._spots, self._depths = np.empty((n, 2), np.int32), np.empty(n)
        self._near, self._far = np.full((2, size, size), np.nan, np.float32)
        self._drawn = Box(0, 0, 0, 0)
        self.field = np.empty((size, size), np.float32)
        self._sides = np.empty(len(triangles.faces), np.int8)
        self._steps = np.zeros((size, size + 1), np.int32)

    def _see(self, camera: OrthographicCamera) -> tuple[Screen, Box]:
        """Return all points as a camera sees them, and the box of pixels that they may cover."""
        from medialis.curves.from_views import _draw_kernels as kernels

        middle, radius = self._sphere
        reach = (math.dist(camera.center, middle) + radius) / camera.pixel + camera.size
        bits = max(int(math.log2(kernels.FARTHEST / reach)), 1)
        screen = kernels.Screen(self._spots, self._depths, bits)
        seen = camera.center, camera.axes, camera.size, camera.pixel
        return screen, kernels.Box(*kernels.project_points(self._triangles.points, *seen, screen))

    def draw(self, camera: OrthographicCamera) -> tuple[Picture, Picture, Box]:
        """Return near and far depths of all pixels, and their box."""
        from medialis.curves.from_views._draw_kernels import draw_depth_range

        (screen, box), near, far, last = self._see(camera), self._near, self._far, self._drawn
        for picture in (near, far):
            picture[last.first : last.last, last.left : last.right] = np.nan
        self._drawn = box
        draw_depth_range(self._triangles.faces, screen, near, far)
        return near, far, box

    def first(self, camera: OrthographicCamera) -> Drawn:
        """Return all depths of a view."""
        near, far, box = self.draw(camera)
        runs = runs_of(near, self.scratch, box)
        return Drawn(camera, near, far, runs, self.scratch, self.field)

    def second(self, camera: OrthographicCamera) -> IntArray:
        """Return the runs of the silhouette of a view that is not drawn."""
        from medialis.curves.from_views import _draw_kernels as kernels

        screen, box = self._see(camera)
        kernels.face_sides(self._triangles.faces, screen.spots, self._sides)
        kernels.count_borders(self._triangles.edges, self._sides, screen, self._steps)
        runs = self.scratch.runs
        return runs[: kernels.silhouette_runs(box, self._steps, runs)]


def rasterizer(shape: ShapeLike) -> Rasterizer:
    """Return the view source of a shape.

    A mesh is drawn as it is. Each sample of a point cloud becomes a hexagon in its tangent plane,
    as wide as covers the gaps to its neighbours.

    Parameters
    ----------
    shape : Shape

    Raises
    ------
    InvalidShapeError
        For a point cloud without normals, or with fewer than 9 samples.

    See Also
    --------
    view_curve_skeleton : what the views are for.
    view_source : sets another renderer.

    Examples
    --------
    >>> import medialis
    >>> source = medialis.rasterizer(medialis.organic_shape(56))
    >>> callable(source)
    True
    """
    shape = as_shape(shape)
    if shape.faces is not None:
        return Rasterizer(shape.points, shape.faces)
    return _discs(shape)


def _discs(shape: Shape) -> Rasterizer:
    """Hexagons round the samples that have a normal."""
    has_normal = shape.normals.any(axis=1)
    if has_normal.sum() <= DISC_NEIGHBOUR:
        raise InvalidShapeError(
            f"Views of a point cloud need more than {DISC_NEIGHBOUR} samples with normals, got "
            f"{int(has_normal.sum())}: estimate normals first (medialis.make_shape does)."
        )
    points, normals = shape.points[has_normal], shape.normals[has_normal]
    radius = shape.tree.query(points, k=DISC_NEIGHBOUR + 1)[0][:, -1:]
    radius = np.minimum(radius, WIDEST_DISC * np.median(radius))
    across = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    across *= radius / np.linalg.norm(across, axis=1, keepdims=True)
    turns = np.pi / 3 * np.arange(6)[:, None]
    corners = points[:, None] + np.cos(turns) * across[:, None]
    corners += np.sin(turns) * np.cross(normals, across)[:, None]
    fan = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    faces = (6 * np.arange(len(points))[:, None, None] + fan).reshape(-1, 3)
    return Rasterizer(np.ascontiguousarray(corners.reshape(-1, 3)), faces.astype(np.int32))
