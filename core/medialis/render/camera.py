"""Cameras: orthographic and perspective, framing, turntables, a sensible first view."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from medialis.errors import InvalidOptionError
from medialis.kept import Described
from medialis.render.framing import (
    default_view,
    orthographic_fit,
    perspective_fit,
    swept,
    unit_direction,
    view_axes,
)
from medialis.validation import (
    FloatArray,
    as_choice,
    as_number,
    as_points,
    as_whole_number,
    frozen,
)

MAX_PIXELS = 16384


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Described):
    """A camera: where it is, where it looks, and how much it sees.

    Pixel (row r, column c) has its center at (c + 0.5, r + 0.5); row 0 is the top.

    Attributes
    ----------
    eye, target, up : (3,) float64
        Camera position, the point it looks at, and a direction shown upwards (not along the view).
    extent : float
        Visible height, in the caller's units, in the plane through the target.
    width, height : int
        Picture size in pixels, 1..16384.
    perspective : bool
        False for an orthographic camera (it clips nothing). A perspective one sees what is further
        than a ten-thousandth of the distance to the target.

    Raises
    ------
    InvalidOptionError
        When a number is out of range, or eye and target or the view and up coincide.

    Examples
    --------
    >>> camera = Camera([0, 0, 5], [0, 0, 0], [0, 1, 0], extent=2.0, width=200, height=100)
    >>> pixels, depth = camera.project([[0, 0, 0], [1, 1, 1]])
    >>> pixels.tolist(), depth.tolist()
    ([[100.0, 50.0], [150.0, 0.0]], [5.0, 4.0])
    """

    eye: FloatArray
    target: FloatArray
    up: FloatArray
    extent: float
    width: int = 1000
    height: int = 750
    perspective: bool = False

    def __post_init__(self) -> None:
        for name in ("eye", "target"):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != (3,) or not np.isfinite(value).all():
                raise InvalidOptionError(f"{name} must be three finite numbers, got {value!r}.")
            object.__setattr__(self, name, frozen(value.copy(), np.float64))
        object.__setattr__(self, "up", frozen(unit_direction(self.up, "up"), np.float64))
        object.__setattr__(self, "extent", as_number(self.extent, "extent", low=0, open_low=True))
        for name in ("width", "height"):
            pixels = as_whole_number(getattr(self, name), name, low=1, high=MAX_PIXELS)
            object.__setattr__(self, name, pixels)
        if not self.distance > 0:
            raise InvalidOptionError("eye and target must be different points.")
        if np.linalg.norm(np.cross(self.target - self.eye, self.up)) < 1e-9 * self.distance:
            raise InvalidOptionError("up must not be parallel to the view from eye to target.")

    @cached_property
    def distance(self) -> float:
        """Distance from the eye to the target."""
        return float(np.linalg.norm(self.target - self.eye))

    @cached_property
    def axes(self) -> FloatArray:
        """Rows: unit right, up and forward in world coordinates, (3, 3)."""
        return frozen(view_axes(self.eye - self.target, self.up), np.float64)

    @property
    def scale(self) -> float:
        """Pixels per unit of length (perspective: in the plane through the target)."""
        return self.height / self.extent

    @property
    def near(self) -> float:
        """Smallest visible depth: -inf for an orthographic camera."""
        return 1e-4 * self.distance if self.perspective else -math.inf

    def to_view(self, points: ArrayLike) -> FloatArray:
        """Return points (n, 3) as right, up, depth from the eye, (n, 3)."""
        return np.einsum("ij,kj->ik", np.asarray(points, np.float64) - self.eye, self.axes)

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return pixel positions (n, 2) as (column, row) and depths (n,) along the viewing axis.

        Positions are NaN where a perspective camera cannot see (depth below `near`).

        Raises
        ------
        InvalidShapeError
            When the points are not (n, 3) finite numbers.
        """
        view = self.to_view(as_points(points))
        depth = view[:, 2]
        scale = np.full(len(view), self.scale)
        if self.perspective:
            seen = depth > self.near
            np.divide(self.scale * self.distance, depth, out=scale, where=seen)
            scale[~seen] = math.nan
        columns = self.width / 2 + scale * view[:, 0]
        return np.stack([columns, self.height / 2 - scale * view[:, 1]], axis=1), depth

    def resized(self, width: int, height: int) -> Camera:
        """Return the same view for another picture size; the visible height stays."""
        return replace(self, width=width, height=height)

    @classmethod
    def framing(
        cls,
        points: ArrayLike,
        *,
        direction: ArrayLike | None = None,
        up: ArrayLike | None = None,
        width: int = 1000,
        height: int = 750,
        margin: float = 0.05,
        perspective: bool = False,
        fit: str = "tight",
    ) -> Camera:
        """Return a camera that shows all points, as large as the picture allows.

        Parameters
        ----------
        points : (n, 3) float
            What must be visible, for instance the points of a shape or its two bounding corners.
        direction : (3,) float, optional
            From the shape to the camera; `default_view` when missing.
        up : (3,) float, optional
            Upward direction; `default_view` when missing.
        width, height : int
            Picture size in pixels.
        margin : float
            Free border on each side, a fraction 0..0.45 of the picture.
        perspective : bool
            A perspective camera with a vertical field of view of 30 degrees.
        fit : {"tight", "turntable", "sphere"}
            "turntable" frames what the points sweep when they turn about the up-axis through the
            middle of their box, so that nothing leaves the picture in a `turntable`; "sphere"
            frames the sphere round their box, for any turn.

        Raises
        ------
        InvalidShapeError, InvalidOptionError
            When the points or an option cannot be used.
        """
        data = as_points(points)
        size = np.zeros(len(data))
        margin = as_number(margin, "margin", low=0, high=0.45)
        as_choice(fit, "fit", ("tight", "turntable", "sphere"))
        width = as_whole_number(width, "width", low=1, high=MAX_PIXELS)
        height = as_whole_number(height, "height", low=1, high=MAX_PIXELS)
        if direction is None or up is None:
            suggested = default_view(data)
            direction = suggested[0] if direction is None else direction
            up = suggested[1] if up is None else up
        toward, upward = unit_direction(direction, "direction"), unit_direction(up, "up")
        if np.linalg.norm(np.cross(toward, upward)) < 1e-6:  # looking straight along up
            upward = np.roll(upward, 1)
        low, high = data.min(axis=0), data.max(axis=0)
        middle = (low + high) / 2
        half_diagonal = float(np.linalg.norm(high - low)) / 2
        if not half_diagonal > 0:
            half_diagonal = max(1e-3 * float(np.abs(middle).max()), 0.5)
            data, size = middle[None], np.array([half_diagonal])
        if fit == "sphere":
            data, size = middle[None], np.array([half_diagonal])
        elif fit == "turntable":
            data, size = swept(data, size, middle, upward)
        view = np.einsum("ij,kj->ik", data - middle, view_axes(toward, upward))
        place = perspective_fit if perspective else orthographic_fit
        shift, distance, extent = place(view, size, width / height, 1 - 2 * margin, half_diagonal)
        target = middle + shift @ view_axes(toward, upward)
        eye = target + distance * toward
        level = toward - upward * float(toward @ upward)
        if fit == "turntable" and float(level @ level) > 1e-6:
            # The target moves along the view onto the axis that the camera will turn about.
            along = float((eye - middle) @ level) / float(toward @ level)
            extent = extent * along / distance if perspective else extent
            target = eye - along * toward
        return cls(eye, target, upward, extent, width, height, perspective)


def turntable(camera: Camera, count: int) -> list[Camera]:
    """Return `count` cameras at equal steps round the up-axis through the target.

    Frame the first one with ``fit="turntable"`` and nothing leaves the picture.

    Raises
    ------
    InvalidOptionError
        When count is not a whole number from 1 to 10000.
    """
    count = as_whole_number(count, "count", low=1, high=10000)
    arm, axis = camera.eye - camera.target, camera.up
    cameras = []
    for angle in 2 * math.pi * np.arange(count) / count:
        turned = (  # Rodrigues' rotation formula
            arm * math.cos(angle)
            + np.cross(axis, arm) * math.sin(angle)
            + axis * float(axis @ arm) * (1 - math.cos(angle))
        )
        cameras.append(replace(camera, eye=camera.target + turned))
    return cameras
