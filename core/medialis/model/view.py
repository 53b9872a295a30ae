"""View: silhouette and depth range of a shape, seen by an orthographic camera (thesis 3.7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.kept import Described
from medialis.validation import FloatArray, as_number, as_whole_number, frozen

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
