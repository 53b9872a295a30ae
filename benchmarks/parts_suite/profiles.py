"""Outlines of parts that are extruded or revolved: polygons whose corners are rounded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cadquery as cq
import numpy as np

Corner = tuple[float, float] | tuple[float, float, float]
"""x and y, and the radius of the fillet there, if any."""


def outline(corners: Sequence[Corner], plane: str = "XY") -> Any:
    """Return a closed wire through corners, each rounded by its radius."""
    points = [np.array(corner[:2], float) for corner in corners]
    radii = [float(corner[2]) if len(corner) > 2 else 0.0 for corner in corners]
    starts, middles, ends = [], [], []
    for k, (here, radius) in enumerate(zip(points, radii, strict=True)):
        back, ahead = points[k - 1] - here, points[(k + 1) % len(points)] - here
        back, ahead = back / np.linalg.norm(back), ahead / np.linalg.norm(ahead)
        half = math.acos(float(np.clip(back @ ahead, -1, 1))) / 2
        step = radius / math.tan(half)
        inward = (back + ahead) / np.linalg.norm(back + ahead) if radius else back
        center = here + inward * radius / math.sin(half)
        starts.append(here + step * back)
        ends.append(here + step * ahead)
        middles.append(center - radius * inward)
    work = cq.Workplane(plane).moveTo(*starts[0])
    for k in range(len(points)):
        if radii[k]:
            work = work.threePointArc(tuple(middles[k]), tuple(ends[k]))
        if k + 1 < len(points):
            work = work.lineTo(*starts[k + 1])
    return work.close()


def band(path: Sequence[tuple[float, float]], thickness: float, radius: float) -> list[Corner]:
    """Return the outline of a sheet along an open path of its middle, bent with an inner radius.

    Without a radius both sides of its bends are sharp.
    """
    points = np.array(path, float)
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    left = np.stack([-steps[:, 1], steps[:, 0]], axis=1)
    sides: list[list[Corner]] = []
    for sign in (1.0, -1.0):
        half = sign * thickness / 2
        side: list[Corner] = [tuple(points[0] + half * left[0])]
        for k in range(1, len(points) - 1):
            mitre = (left[k - 1] + left[k]) / (1.0 + left[k - 1] @ left[k])
            turn = float(np.cross(steps[k - 1], steps[k]))
            inner = turn * sign > 0
            bend = 0.0 if radius == 0 else radius if inner else radius + thickness
            side.append((*(points[k] + half * mitre), bend))
        side.append(tuple(points[-1] + half * left[-1]))
        sides.append(side)
    return sides[1] + sides[0][::-1]


def bent(path: Sequence[tuple[float, float]], radius: float) -> list[tuple[str, Any]]:
    """Return a path, bent with a radius, as ("line", p, q) and ("arc", center, radius, a, turn)."""
    points = [np.array(point, float) for point in path]
    pieces: list[tuple[str, Any]] = []
    at = points[0]
    for k in range(1, len(points) - 1):
        back, ahead = points[k - 1] - points[k], points[k + 1] - points[k]
        back, ahead = back / np.linalg.norm(back), ahead / np.linalg.norm(ahead)
        half = math.acos(float(np.clip(back @ ahead, -1, 1))) / 2
        step = radius / math.tan(half)
        first, last = points[k] + step * back, points[k] + step * ahead
        pieces.append(("line", (at, first)))
        if radius:
            center = points[k] + (back + ahead) / np.linalg.norm(back + ahead) * radius / math.sin(
                half
            )
            pieces.append(("arc", (center, radius, first, last)))
        at = last
    pieces.append(("line", (at, points[-1])))
    return pieces
