"""Pairs of cameras round a shape (thesis 3.7.4)."""

from __future__ import annotations

import math

import numpy as np

from medialis.model.view import OrthographicCamera
from medialis.validation import FloatArray

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
