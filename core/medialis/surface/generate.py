"""The organic shape of the README and the command line, made by code."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from medialis.model.shape import Shape
from medialis.surface.surface_nets import implicit_shape
from medialis.validation import FloatArray, as_whole_number

Point = tuple[float, float, float]
Cone = tuple[Point, Point, float, float]
"""Ends (x, y, z) and their radii."""

# Round cones of a four-legged creature, one row each: ends (x, y, z) and their radii. +x is ahead,
# +z up; rows of _MIRRORED appear on both sides. Everything is then pressed flat along y: the
# cross-sections are ellipses, so that the skeleton has sheets, not only curves.
_BODY = (
    ((-0.62, 0.00, 0.62), (-0.05, 0.00, 0.60), 0.24, 0.21),
    ((-0.05, 0.00, 0.60), (0.45, 0.00, 0.66), 0.21, 0.27),
    ((0.50, 0.00, 0.74), (0.92, 0.00, 1.12), 0.20, 0.11),
    ((0.92, 0.00, 1.16), (1.22, 0.00, 1.06), 0.15, 0.075),
    ((-0.82, 0.00, 0.72), (-1.15, 0.00, 0.52), 0.060, 0.045),
    ((-1.15, 0.00, 0.52), (-1.32, 0.00, 0.20), 0.045, 0.035),
)
_MIRRORED = (
    ((0.50, 0.20, 0.58), (0.46, 0.27, 0.30), 0.14, 0.085),
    ((0.46, 0.27, 0.30), (0.47, 0.27, 0.02), 0.085, 0.065),
    ((0.47, 0.27, 0.02), (0.56, 0.27, -0.01), 0.067, 0.060),
    ((-0.62, 0.20, 0.56), (-0.58, 0.28, 0.32), 0.18, 0.090),
    ((-0.58, 0.28, 0.32), (-0.70, 0.28, 0.02), 0.085, 0.065),
    ((-0.70, 0.28, 0.02), (-0.61, 0.28, -0.01), 0.067, 0.060),
    ((0.85, 0.09, 1.26), (0.76, 0.26, 1.45), 0.070, 0.030),
)
_FLAT = 1.6
_BLEND = 0.05  # length over which two parts flow into each other
_LOW, _HIGH = np.array([-1.45, -0.34, -0.16]), np.array([1.40, 0.34, 1.56])


def organic_shape(resolution: int = 128) -> Shape:
    """Make a smooth four-legged creature: closed, genus 0, with limbs, ears and a tail.

    Parameters
    ----------
    resolution : int
        Grid cells along the longest side, 56 to 600; the number of vertices grows with its square
        (128: about 12,000).

    Returns
    -------
    Shape
        A closed mesh of about 2.7 units length, outward normals.

    Raises
    ------
    InvalidOptionError
        When `resolution` is out of its range.

    See Also
    --------
    sample_shape : others, by name.
    read_shape : from a file.

    Examples
    --------
    >>> import medialis
    >>> medialis.organic_shape(56).faces is not None
    True
    """
    resolution = as_whole_number(resolution, "resolution", low=56, high=600)
    return implicit_shape(_creature, _LOW, _HIGH, resolution)


def _creature(points: FloatArray) -> FloatArray:
    """Round cones that flow into each other, pressed flat."""
    cones: list[Cone] = [*_BODY]
    for a, b, ra, rb in _MIRRORED:
        cones.append((a, b, ra, rb))
        cones.append(((a[0], -a[1], a[2]), (b[0], -b[1], b[2]), ra, rb))
    return blended(points * [1.0, _FLAT, 1.0], cones, _BLEND)


def blended(points: FloatArray, cones: Sequence[Cone], blend: float) -> FloatArray:
    """Return a smooth minimum of the signed distances to round cones, (n,).

    Parts flow into each other over the length `blend`.
    """
    # Part after part: a table of all distances at once would need 20 times the memory. The term of
    # a far part is exp(-60) and does not matter.
    total = np.zeros(len(points))
    for a, b, ra, rb in cones:
        start, along = np.array(a), np.array(b) - np.array(a)
        share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
        away = np.linalg.norm(points - start - share[:, None] * along, axis=1)
        total += np.exp(np.clip(-(away - ra - share * (rb - ra)) / blend, -60.0, 60.0))
    return -blend * np.log(total)
