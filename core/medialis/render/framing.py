"""Where to put a camera: fitting a view to points, and choosing one for a shape."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from medialis.errors import InvalidOptionError
from medialis.validation import FloatArray, as_points

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


def _footprint(points: FloatArray, axis: int) -> float:
    """Return the bounding area of the lowest 4 % of the height over that of the whole, 0..1."""
    height = points[:, axis]
    low = height.min()
    ground = np.delete(points, axis, axis=1)
    feet = ground[height <= low + 0.04 * (height.max() - low)]
    whole = np.ptp(ground, axis=0).prod()
    return float(np.ptp(feet, axis=0).prod() / whole) if whole > 0 else 0.0


def default_view(points: ArrayLike, up: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Return (direction from the shape to the camera, up): a three-quarter view of its broad side.

    The camera faces the axis of least variance, so that most of the shape is visible, and is then
    turned 30 degrees to the side and raised by 20 degrees, so that depth shows. Up is y, unless the
    shape is thinnest along y, or stands clearly better on its lowest z than on its lowest y (feet
    spread out below): then z. A shape without a thin side is seen from the front (+z, or -y when
    up is z).

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
    if up is None:
        lying = clear and abs(thin[1]) > 0.8
        facing = clear and abs(thin[2]) > 0.8
        standing = not facing and _footprint(offsets, 2) > 1.5 * _footprint(offsets, 1) + 0.05
        up = (0.0, 0.0, 1.0) if lying or standing else (0.0, 1.0, 0.0)
    upward = unit_direction(up, "up")
    front = thin - upward * float(thin @ upward)
    if not clear or np.linalg.norm(front) < 0.3:
        front = np.roll(upward, 1) if upward[2] < 0.5 else np.array([0.0, -1.0, 0.0])
        front = front - upward * float(front @ upward)
    front /= np.linalg.norm(front)
    viewer = np.array([0.4, -1.0, 0.0] if upward[2] > 0.5 else [0.4, 0.0, 1.0])
    if front @ viewer < 0:
        front = -front
    yaw, pitch = math.radians(30.0), math.radians(20.0)
    side = np.cross(upward, front)
    level = front * math.cos(yaw) + side * math.sin(yaw)
    return unit_direction(level * math.cos(pitch) + upward * math.sin(pitch), "direction"), upward
