"""Cameras: orthographic and perspective, framing, turntables, a sensible first view."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.arrays import Described
from medialis.base.errors import InvalidOptionError
from medialis.base.validation import (
    AXES,
    FloatArray,
    as_choice,
    as_number,
    as_points,
    as_whole_number,
    frozen,
)
from medialis.shape.shape import Shape
from medialis.shape.upright import footprint, up_of_cloud

FIELD_OF_VIEW = math.radians(30.0)
"""Vertical field of view of a perspective camera that `Camera.framing` makes."""


def unit_direction(values: ArrayLike, name: str) -> FloatArray:
    """Return a direction (3,) scaled to length 1.

    Raises
    ------
    InvalidOptionError
        When it is not three finite numbers, or all are zero.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all() or not array.any():
        raise InvalidOptionError(
            f"{name} must be three finite numbers, not all zero; got {values!r}."
        )
    array = array / np.abs(array).max()
    return array / np.linalg.norm(array)


def view_axes(backward: FloatArray, up: FloatArray) -> FloatArray:
    """Return rows right, up, forward (3, 3) of a view from `backward`; not along up."""
    forward = -backward / np.linalg.norm(backward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, forward), forward])


def orthographic_fit(
    view: FloatArray, radii: FloatArray, aspect: float, share: float, half_diagonal: float
) -> tuple[FloatArray, float, float]:
    """Return shift (right, up, depth), distance and extent that show all balls.

    `view` (n, 3) is relative to the middle; `share` is the part of the picture to fill.
    """
    low, high = (view - radii[:, None]).min(axis=0), (view + radii[:, None]).max(axis=0)
    span = high - low
    extent = max(span[1], span[0] / aspect, 1e-6 * half_diagonal) / share
    return (low + high) / 2, 4.0 * half_diagonal, float(extent)


def perspective_fit(
    view: FloatArray, radii: FloatArray, aspect: float, share: float, half_diagonal: float
) -> tuple[FloatArray, float, float]:
    """Return shift (right, up, depth), distance and extent that show all balls.

    `view` (n, 3) is relative to the middle; `share` is the part of the picture to fill.
    """
    # A ball (x, z, r) lies under the upper frustum plane of slope k, from an eye at (e, -D), when
    # x - e + r sqrt(1 + k^2) <= k (z + D), and above the lower one when the mirrored inequality
    # holds. The largest left sides give e and the least D of each axis; the larger D serves both.
    half = math.tan(FIELD_OF_VIEW / 2)
    shift, distance = np.zeros(3), 0.0
    for axis, slope in ((0, half * aspect * share), (1, half * share)):
        grown = radii * math.sqrt(1 + slope * slope)
        upper = float((view[:, axis] + grown - slope * view[:, 2]).max())
        lower = float((view[:, axis] - grown + slope * view[:, 2]).min())
        shift[axis] = (upper + lower) / 2
        distance = max(distance, (upper - lower) / (2 * slope))
    front = float((view[:, 2] - radii).min())
    distance = max(distance, -front + 0.01 * half_diagonal)
    return shift, distance, 2 * half * distance


def swept(
    points: FloatArray, radii: FloatArray, middle: FloatArray, up: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return balls that enclose the points at every turn about the up-axis through the middle.

    The axis is cut into 32 slices; each gives rings at its lowest and highest point with the
    largest distance from the axis, as regular 64-gons round that circle.
    """
    offset = points - middle
    height = offset @ up
    away = np.linalg.norm(offset - height[:, None] * up, axis=1)
    low, span = height.min(), max(float(np.ptp(height)), 1e-300)
    slices = np.minimum((32 * ((height - low) / span)).astype(np.int64), 31)
    first = np.cross(up, np.roll(up, 1) + np.array([0.1, 0.2, 0.3]))
    first /= np.linalg.norm(first)
    angle = 2 * math.pi * np.arange(64)[:, None] / 64
    circle = (np.cos(angle) * first + np.sin(angle) * np.cross(up, first)) / math.cos(math.pi / 64)
    rings, sizes = [], []
    for number in np.unique(slices):
        inside = slices == number
        for level in (height[inside].min(), height[inside].max()):
            rings.append(middle + level * up + away[inside].max() * circle)
            sizes.append(np.full(64, radii[inside].max()))
    return np.concatenate(rings), np.concatenate(sizes)


def default_view(points: ArrayLike, up: str | None = None) -> tuple[FloatArray, FloatArray]:
    """Return (direction from the shape to the camera, up): a three-quarter view of its broad side.

    The camera faces the axis of least variance, so that most of the shape is visible, and is then
    turned 30 degrees to the side and raised by 20 degrees, so that depth shows. Up is y, unless the
    shape is thinnest along y, or stands clearly better on its lowest z than on its lowest y (feet
    spread out below): then z. A shape without a thin side is seen from the front (+z, or -y when
    up is z). One that lies flat, with `up` across it, is seen from 50 degrees above.

    Parameters
    ----------
    points : (n, 3) float
    up : {"x", "y", "z"}, optional
        The axis that points up, where it is known.

    Raises
    ------
    InvalidShapeError
        When the points are not (n, 3) finite numbers.

    Examples
    --------
    >>> direction, up = default_view([[0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0.1]])
    >>> up.tolist(), bool(direction[2] > 0.8)
    ([0.0, 1.0, 0.0], True)
    """
    data = as_points(points)
    span = np.abs(data).max()
    offsets = (data - data.mean(axis=0)) / (span if span > 0 else 1.0)
    variances, vectors = np.linalg.eigh(offsets.T @ offsets / len(data))
    thin = vectors[:, 0]
    clear = variances[0] < 0.8 * variances[1]
    lying = clear and abs(thin[1]) > 0.8
    facing = clear and abs(thin[2]) > 0.8
    standing = not facing and footprint(offsets, 2) > 1.5 * footprint(offsets, 1) + 0.05
    upward = np.eye(3)[AXES.index(up) if up else 2 if lying or standing else 1]
    front = thin - upward * float(thin @ upward)
    lies = clear and np.linalg.norm(front) < 0.6  # with what is given as up
    if lies and variances[1] < 0.8 * variances[2]:
        front = vectors[:, 1] - upward * float(vectors[:, 1] @ upward)
    elif lies or not clear:
        front = np.roll(upward, 1) if upward[2] < 0.5 else np.array([0.0, -1.0, 0.0])
        front = front - upward * float(front @ upward)
    front /= np.linalg.norm(front)
    viewer = np.array([0.4, -1.0, 0.0] if upward[2] > 0.5 else [0.4, 0.0, 1.0])
    if front @ viewer < 0:
        front = -front
    is_flat = lies and variances[0] < 0.25 * variances[1]
    yaw, pitch = math.radians(30.0), math.radians(50.0 if is_flat else 20.0)
    side = np.cross(upward, front)
    level = front * math.cos(yaw) + side * math.sin(yaw)
    return unit_direction(level * math.cos(pitch) + upward * math.sin(pitch), "direction"), upward


SPREAD = 4096
"""Places that a surface is judged by: its vertices may be anywhere."""


def shape_view(shape: Shape) -> tuple[FloatArray, FloatArray]:
    """Return `default_view` of a surface: the same however finely it is divided into triangles.

    It is judged by places that are spread evenly over its area; a cloud by its points.

    Examples
    --------
    >>> import medialis
    >>> direction, up = shape_view(medialis.organic_shape(56))
    >>> up.tolist()
    [0.0, 0.0, 1.0]
    """
    if shape.faces is None or not shape.face_areas.sum() > 0:
        return default_view(shape.points, shape.up or up_of_cloud(shape.points))
    reached = np.cumsum(shape.face_areas)
    row = np.arange(SPREAD)
    face = np.searchsorted(reached, (row + 0.5) / SPREAD * reached[-1])
    # An additive sequence in a square, folded into a triangle, is even and always the same.
    u, v = (np.outer([0.7548776662466927, 0.5698402909980532], row) + 0.5) % 1.0
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u), np.where(outside, 1.0 - v, v)
    a, b, c = (shape.points[shape.faces[face, k]] for k in range(3))
    return default_view(a + u[:, None] * (b - a) + v[:, None] * (c - a), shape.up)


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

    @classmethod
    def framing(
        cls,
        points: ArrayLike,
        *,
        direction: ArrayLike | None = None,
        up: ArrayLike | str | None = None,
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
        up : (3,) float or {"x", "y", "z"}, optional
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
        axis = as_choice(up, "up", AXES) if isinstance(up, str) else None
        if direction is None or up is None or axis:
            usual, above = default_view(data, axis)
            direction = usual if direction is None else direction
            up = above if up is None or axis else up
        toward, upward = unit_direction(direction, "direction"), unit_direction(up, "up")
        if np.linalg.norm(np.cross(toward, upward)) < 1e-6:  # looking straight along up
            upward = np.roll(upward, 1)
        low, high = data.min(axis=0), data.max(axis=0)
        middle = (low + high) / 2
        half_diagonal = float(np.linalg.norm(high - low)) / 2
        point = not half_diagonal > 0
        if point:
            half_diagonal = max(1e-3 * float(np.abs(middle).max()), 0.5)
        if point or fit == "sphere":
            data, size = middle[None], np.array([half_diagonal])
        if fit == "turntable":
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
