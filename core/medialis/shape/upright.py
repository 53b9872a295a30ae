"""The axis that points up in a point cloud, where its file does not say it."""

from __future__ import annotations

import numpy as np

from medialis.base.validation import FloatArray


def footprint(points: FloatArray, axis: int) -> float:
    """Return the bounding area of the lowest 4 % of the height over that of the whole, 0..1."""
    height = points[:, axis]
    low = height.min()
    ground = np.delete(points, axis, axis=1)
    feet = ground[height <= low + 0.04 * (height.max() - low)]
    whole = np.ptp(ground, axis=0).prod()
    return float(np.ptp(feet, axis=0).prod() / whole) if whole > 0 else 0.0


def up_of_cloud(points: FloatArray) -> str:
    """Return the axis that points up in a cloud (n, 3) whose file does not say it.

    It is z, as scanners have it, unless the cloud stands clearly better on its lowest y: clouds
    that were sampled from models for animation are so.
    """
    finite = points[np.isfinite(points).all(axis=1)]
    low, high = 0.5 * finite.min(axis=0), 0.5 * finite.max(axis=0)  # halved: no overflow
    size = float((high - low).max())
    if size == 0.0:
        return "z"
    offsets = (0.5 * finite - low) / size
    return "y" if footprint(offsets, 1) > 1.5 * footprint(offsets, 2) + 0.05 else "z"
