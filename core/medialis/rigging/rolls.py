"""How bones are turned about themselves: so that they bend about their own x axis."""

from __future__ import annotations

import numpy as np

from medialis.model.armature import Bones
from medialis.validation import FloatArray

BENT = 0.1
"""Sine of the bends of a limb, added up as vectors, from which on they say how it bends."""
ACROSS = 0.9
"""Cosine of the angle to the axis across the body from which on a straight limb points along it."""
UP = np.array([0.0, 0.0, 1.0])


def roll_axes(rig: Bones) -> FloatArray:
    """Return the z axis of each bone, (b, 3): unit, at right angles to the bone.

    All bones of a limb bend about the same axis, their x axis: that about which the limb is bent
    already. A straight limb bends about the axis across the body, or about the vertical where it
    points across the body itself. The axes of mirrored bones are mirror images, as the mirrored
    poses of Blender want it.

    Examples
    --------
    >>> import medialis
    >>> nodes, edges = [[0, 0, 0], [4, 0, 0], [4, 4, 0]], [[0, 1], [1, 2]]
    >>> elbow = medialis.CurveSkeleton.of(nodes, edges, [1, 1, 1])
    >>> roll_axes(medialis.bones(elbow)).round(6).tolist()
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    """
    along = _unit(rig.tails - rig.heads)
    across = _across(rig)
    axes = np.zeros((rig.count, 3))
    for limb in range(int(rig.limbs.max(initial=-1)) + 1):
        rows = np.flatnonzero(rig.limbs == limb)
        if rig.sides[rows[0]] >= 0:
            inside = rig.parents[rows[0]] >= 0
            axes[rows] = _limb_axes(along[rows], across, inside)
    if across is not None:
        right = np.flatnonzero(rig.sides < 0)
        seen = axes[rig.mirrors[right]]
        image = seen - 2 * (seen @ across)[:, None] * across
        # Limbs are mirror images up to their own irregularities.
        axes[right] = _unit(image - (image * along[right]).sum(axis=1)[:, None] * along[right])
    return axes


def _across(rig: Bones) -> FloatArray | None:
    """Return the axis from the right to the left side, None without mirrored bones."""
    left = np.flatnonzero(rig.sides > 0)
    if len(left) == 0:
        return None
    apart = (rig.tails[left] - rig.tails[rig.mirrors[left]]).sum(axis=0)
    return np.asarray(apart / np.linalg.norm(apart)) if apart.any() else None


def _limb_axes(along: FloatArray, across: FloatArray | None, inside: bool) -> FloatArray:
    """Return the z axes of the bones of a limb, whose directions are (k, 3).

    The first one may lie inside what the limb hangs on: its bend is that of the hip.
    """
    outside = along[1:] if inside else along
    bend = np.cross(outside[:-1], outside[1:]).sum(axis=0)
    whole = _unit(along.sum(axis=0)[None])[0] if along.sum(axis=0).any() else along[0]
    if np.linalg.norm(bend) >= BENT:
        axis = bend
    elif across is not None and abs(whole @ across) < ACROSS:
        axis = across
    elif abs(whole @ UP) < ACROSS:
        axis = UP
    else:
        axis = np.array([1.0, 0.0, 0.0])
    found = np.empty_like(along)
    for row, direction in enumerate(along):
        x = axis - (axis @ direction) * direction
        if np.linalg.norm(x) < 1e-6:  # this bone points along the axis: it keeps the last one
            x = np.cross(direction, found[row - 1]) if row else np.roll(direction, 1)
            x = x - (x @ direction) * direction
        found[row] = np.cross(x / np.linalg.norm(x), direction)
    return found


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
