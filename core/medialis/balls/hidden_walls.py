"""Balls that passed through a wall thinner than the tolerance (deviation from thesis 3.2).

A tolerance keeps relief from shrinking balls, and the other side of a thin wall looks like relief.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import BallStatus, MedialCloud
from medialis.model.shape import Shape
from medialis.validation import frozen

HALF = 0.5
"""Fraction of the diagonal: no ball inside a closed shape has a larger radius."""

THINNEST = 1e-7
"""Fraction of the diagonal: surfaces closer together than this lie on each other, with no wall."""

NEIGHBOURS, OPPOSITE = 32, -0.5
"""Nearest samples among which the other side is looked for, and the largest cosine between the
normals of two sides: walls that taper by less than 60 degrees."""

FEW = 8
"""Samples whose neighbours are found among all others sooner than a tree of these is built."""


def hidden_walls(cloud: MedialCloud, tolerance: float) -> NDArray[np.bool_]:
    """Tell the inner balls that went through a wall thinner than the tolerance.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.
    tolerance : float
        Fraction of the diagonal that hides walls.

    Returns
    -------
    (k,) bool
        Balls inside a closed part that meet no second sample (there always is one), and balls that
        meet none, or touch their second sample from its outside, with the other side of a wall
        close behind their own sample.

    Notes
    -----
    Cost: nothing for balls that touch as they should; 32 nearest samples for each of the others.
    """
    hidden = endless(cloud)
    without = (cloud.side > 0) & (cloud.status == BallStatus.OPEN)
    outside = touches_from_outside(cloud)
    hidden |= outside & (cloud.contact_faces >= 0) & in_closed_part(cloud.surface, cloud.source)
    odd = np.flatnonzero((without | outside) & ~hidden)
    hidden[odd] = _close_behind(cloud.surface, cloud.source[odd], tolerance)
    return hidden


def endless(cloud: MedialCloud) -> NDArray[np.bool_]:
    """Tell the inner balls in closed parts that meet no second sample, (k,); there is one."""
    shape = cloud.surface
    result = (cloud.side > 0) & (cloud.status == BallStatus.OPEN)
    result &= cloud.radii >= HALF * shape.diagonal  # not so where a small largest_radius ends them
    return result & in_closed_part(shape, cloud.source) if result.any() else result


def touches_from_outside(cloud: MedialCloud) -> NDArray[np.bool_]:
    """Tell the inner balls whose center lies in front of the wall at their second contact, (k,)."""
    from medialis.balls._contact_kernels import touch_from_outside

    surface, result = cloud.surface, np.zeros(len(cloud), np.bool_)
    cloudy = surface.faces is None
    touch_from_outside(
        np.flatnonzero((cloud.side > 0) & cloud.valid), cloud.centers, cloud.features,
        cloud.contact_faces, cloud.contact_weights, surface.points, surface.normals,
        frozen(np.empty((0, 3)), np.int32) if cloudy else surface.faces,
        frozen(np.empty((0, 3)), np.float64) if cloudy else surface.face_normals, result,
    )  # fmt: skip
    return result


def in_closed_part(shape: Shape, samples: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell the samples whose component has faces and no border."""
    return np.asarray(shape.closed_components[shape.components[samples]])


def _close_behind(shape: Shape, rows: NDArray[np.int32], tolerance: float) -> NDArray[np.bool_]:
    """Tell the samples with one that faces the other way less than the tolerance behind them."""
    if len(rows) == 0:
        return np.zeros(0, np.bool_)
    near = _nearest(shape, rows, min(NEIGHBOURS, shape.point_count))
    spoke, own = shape.points[rows][:, None] - shape.points[near], shape.normals[rows]
    depth = np.einsum("ij,ikj->ik", own, spoke) / shape.diagonal
    facing = np.einsum("ij,ikj->ik", own, shape.normals[near])
    return ((depth > THINNEST) & (depth <= tolerance) & (facing < OPPOSITE)).any(axis=1)


def _nearest(shape: Shape, rows: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    """Return the nearest samples of some, themselves among them, (q, count)."""
    points = shape.points
    if len(rows) > FEW:
        return np.asarray(shape.tree.query(points[rows], k=np.arange(1, count + 1))[1])
    near = np.empty((len(rows), count), np.int64)
    for at, row in enumerate(rows):
        away = ((points - points[row]) ** 2).sum(axis=1)
        near[at] = np.argpartition(away, count - 1)[:count]
    return near
