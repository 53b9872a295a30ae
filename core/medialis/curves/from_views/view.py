"""Views of a shape: silhouettes and depth ranges, seen by orthographic cameras (thesis 3.7.4).

`OrthographicCamera` and `View` are what a `ViewSource` takes and gives; `camera_pairs` places the
cameras round a shape; `Rasterizer` is the core's own source, for meshes and clouds (3.7.4.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, IntArray, as_number, as_whole_number, frozen
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.shape import Shape

MAX_SIZE = 8192


@dataclass(frozen=True, eq=False, repr=False)
class OrthographicCamera(Described):
    """A camera with parallel rays and a square picture.

    Pixel (row r, column c) has its center at (c + 0.5, r + 0.5); row 0 is the top.

    Attributes
    ----------
    center : (3,) float64
        The point in the middle of the picture, at depth 0.
    axes : (3, 3) float64
        Rows: unit right, up and forward (the viewing direction v of the thesis), at right angles.
    extent : float
        Width and height of the picture in the caller's units.
    size : int
        Width and height in pixels, 8..8192.

    Raises
    ------
    InvalidOptionError
        When the axes are not at right angles and of unit length, or a number is out of range.

    Examples
    --------
    >>> camera = OrthographicCamera([0, 0, 0], [[1, 0, 0], [0, 1, 0], [0, 0, -1]], 2.0, 100)
    >>> camera.to_pixels([[0, 0, 0], [1, 1, 1]]).tolist()
    [[50.0, 50.0, 0.0], [100.0, 0.0, -1.0]]
    """

    center: FloatArray
    axes: FloatArray
    extent: float
    size: int

    def __post_init__(self) -> None:
        for name, shape in (("center", (3,)), ("axes", (3, 3))):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise InvalidOptionError(f"{name} must be {shape} finite numbers, got {value!r}.")
            object.__setattr__(self, name, frozen(value, np.float64))
        if not np.allclose(self.axes @ self.axes.T, np.eye(3), rtol=0, atol=1e-6):
            raise InvalidOptionError("axes must be three unit vectors at right angles.")
        object.__setattr__(self, "extent", as_number(self.extent, "extent", low=0, open_low=True))
        size = as_whole_number(self.size, "size", low=8, high=MAX_SIZE)
        object.__setattr__(self, "size", size)

    @property
    def pixel(self) -> float:
        """Edge of a pixel in the caller's units."""
        return self.extent / self.size

    def to_pixels(self, points: ArrayLike) -> FloatArray:
        """Return column, row and depth of points (n, 3); the depth is in the caller's units."""
        seen = np.einsum("ij,kj->ik", np.asarray(points, np.float64) - self.center, self.axes)
        seen[:, 0] = self.size / 2 + seen[:, 0] / self.pixel
        seen[:, 1] = self.size / 2 - seen[:, 1] / self.pixel
        return seen


@dataclass(frozen=True, eq=False, repr=False)
class View(Described):
    """Silhouette and depth range of a shape, seen by one camera.

    Attributes
    ----------
    camera : OrthographicCamera
    near, far : (h, w) float32
        Depth of the nearest and of the furthest surface along the camera's forward axis, 0 in the
        plane through its center; NaN where the shape is not. h = w = ``camera.size``.

    Raises
    ------
    InvalidShapeError
        When the pictures are not of the camera's size, are not NaN at the same pixels, or far is
        nearer than near.
    """

    camera: OrthographicCamera
    near: NDArray[np.float32]
    far: NDArray[np.float32]

    def __post_init__(self) -> None:
        wanted = (self.camera.size, self.camera.size)
        for name in ("near", "far"):
            value = np.asarray(getattr(self, name))
            if value.shape != wanted or value.dtype.kind not in "fiu":
                raise InvalidShapeError(
                    f"{name} must be {wanted} numbers, as the camera's picture, got shape "
                    f"{value.shape} of {value.dtype}."
                )
            object.__setattr__(self, name, frozen(value, np.float32))
        if not (np.isfinite(self.near) == np.isfinite(self.far)).all():
            raise InvalidShapeError("near and far must be finite at the same pixels.")
        if (self.far < self.near).any():
            raise InvalidShapeError("far must not be nearer than near at any pixel.")

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Silhouette, (h, w): True where the shape is."""
        return np.isfinite(self.near)


class ViewSource(Protocol):
    """Whatever renders views: the core's rasterizer, Blender, a camera rig.

    It is called on the calling thread, with a few cameras at a time, so that a host whose
    graphics work on one thread only can serve as a source.
    """

    def __call__(self, cameras: Sequence[OrthographicCamera]) -> Sequence[View]:
        """Return one view for each camera, in their order."""


GOLDEN = math.pi * (3 - math.sqrt(5))
PLASTIC = 0.7548776662466927
"""Steps by this spread well, and, unlike golden ones, do not beat with the turns of the spiral."""
MARGIN = 2
"""Free pixels on each side: the border of a picture must lie outside the silhouette."""

CameraPair = tuple[OrthographicCamera, OrthographicCamera]


def sphere_of(points: FloatArray) -> tuple[FloatArray, float]:
    """Return a center and a radius that hold all points: the middle of their bounding box."""
    center = points.min(axis=0) / 2 + points.max(axis=0) / 2
    return center, float(np.sqrt(((points - center) ** 2).sum(axis=1).max()))


def camera_axes(count: int) -> FloatArray:
    """Return right, up and forward of cameras spread evenly over the sphere, (count, 3, 3).

    Directions lie on a Fibonacci spiral, visited so that any run of them covers the sphere; each
    camera is turned about its direction by the golden angle against the last, so that rows lie in
    all directions.
    """
    order = np.argsort(np.argsort((np.arange(count) * PLASTIC) % 1.0, kind="stable"))
    z = 1 - (2 * order + 1) / count
    turn = order * GOLDEN
    level = np.sqrt(1 - z * z)
    forward = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
    right = np.stack([-np.sin(turn), np.cos(turn), np.zeros(count)], axis=1)
    up = np.cross(right, forward)
    roll = np.arange(count) * GOLDEN
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([c * right + s * up, c * up - s * right, forward], axis=1)


def camera_pairs(
    center: FloatArray, radius: float, *, pairs: int, angle: float, size: int
) -> list[CameraPair]:
    """Return pairs of cameras that see a sphere whole.

    Parameters
    ----------
    center : (3,) float
    radius : float
        Of the sphere; not 0.
    pairs : int
        Number of pairs.
    angle : float
        Between the viewing directions of a pair, in radians (alpha of the thesis).
    size : int
        Width and height of the pictures in pixels.

    Notes
    -----
    Source: thesis 3.7.4 (parallel up-vectors), 3.7.6.2 (uniform on a sphere). Deviates: up-vectors
    differ from pair to pair. A limb along the rows of a pair cannot be placed by it; with one
    up-vector for all, some limbs would lie along the rows of most pairs.
    """
    extent = 2 * radius * size / (size - 2 * MARGIN)
    result = []
    for axes in camera_axes(pairs):
        right, up, forward = axes
        c, s = math.cos(angle), math.sin(angle)
        turned = np.stack([c * right - s * forward, up, c * forward + s * right])
        first, second = (OrthographicCamera(center, a, extent, size) for a in (axes, turned))
        result.append((first, second))
    return result


DISC_NEIGHBOUR = 12
"""The radius of the disc of a sample is the distance to its neighbour of this rank: discs overlap,
also where samples are irregular (checked on random samples of a sphere and a torus)."""


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
        from medialis.curves.from_views._kernels import (
            draw_depth_range,
            mark_outside,
            project_points,
        )

        views: list[View] = [None] * len(cameras)  # type: ignore[list-item]

        def draw(begin: int, end: int) -> None:
            screen = np.empty((len(self.points), 3))
            for at in range(begin, end):
                camera = cameras[at]
                near = np.full((camera.size, camera.size), np.inf, np.float32)
                far = np.full_like(near, -np.inf)
                project_points(
                    self.points, camera.center, camera.axes, camera.size, camera.pixel, screen
                )
                draw_depth_range(self.faces, screen, near, far)
                mark_outside(near, far)
                views[at] = View(camera, near, far)

        run_chunks(draw, len(cameras), 1, progress=progress)
        return views


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
    # An isolated sample must not become a plate: no disc is larger than four usual ones.
    radius = np.minimum(radius, 4 * np.median(radius))
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    across = np.cross(normals, least)
    across *= radius / np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normals, across)
    turns = np.pi / 3 * np.arange(6)
    corners = (
        points[:, None]
        + np.cos(turns)[:, None] * across[:, None]
        + np.sin(turns)[:, None] * along[:, None]
    )
    fan = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    faces = (6 * np.arange(len(points))[:, None, None] + fan).reshape(-1, 3)
    return Rasterizer(np.ascontiguousarray(corners.reshape(-1, 3)), faces.astype(np.int32))
