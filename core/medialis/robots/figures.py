"""How good a cover of a link is: how much of the link it holds, and how far it sticks out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from medialis.base.arrays import twice_areas
from medialis.base.box_tree import NearestTree
from medialis.base.validation import FloatArray
from medialis.robots.covers import Cover, axis_distances
from medialis.robots.link_solids import LinkSolid, spread

DIRECTIONS = 100
"""Points on the ends of a capsule, and on its side, whose distance from the link is measured."""

VOLUME_POINTS = 10_000
"""Points at which volumes are estimated: up to a hundredth of the box around the cover."""

ON_BOUNDARY = 1e-6
"""Diagonals: a point deeper in another ball is not on the boundary of all."""


class CoverFigures(NamedTuple):
    """Measures of one link, lengths in metres.

    Attributes
    ----------
    gaps, area : (p,) float64
        Distance of each piece of the surface from the cover, 0 inside, and the area of the piece.
    out, size : (b,) float64
        Distance of points on the boundary of the cover from the link, 0 inside, and the area that
        each stands for.
    volume, covered : float
        Volume of the link, and of the cover.
    excess : float
        Volume of the cover outside of the link, as a fraction of that of the link; infinite for a
        sheet.
    """

    gaps: FloatArray
    area: FloatArray
    out: FloatArray
    size: FloatArray
    volume: float
    covered: float
    excess: float


def measured(cover: Cover, solid: LinkSolid) -> CoverFigures:
    """Measure the cover of a link."""
    scale = solid.scale
    axes = (cover.axes - np.tile(solid.middle, 2)) / scale
    radii = cover.radii / scale
    patches = solid.patches
    corners = np.arange(len(patches.corners)).reshape(-1, 3)
    area = twice_areas(patches.corners, corners) / 2.0
    gaps = np.maximum(_outside(patches.corners, axes, radii).reshape(-1, 3).max(axis=1), 0.0)
    places, size = boundary_points(axes, radii)
    outer = _outside(places, axes, radii) > -ON_BOUNDARY
    places, size = places[outer], size[outer]
    out = np.maximum(-solid.depths(places), 0.0)
    ends = axes.reshape(-1, 2, 3)
    low, high = (ends.min(axis=1) - radii[:, None]), (ends.max(axis=1) + radii[:, None])
    low, high = low.min(axis=0), high.max(axis=0)
    points = spread(low, high, VOLUME_POINTS)
    held, inside = _outside(points, axes, radii) <= 0.0, solid.contains(points)
    box = float(np.prod(high - low)) * scale**3
    volume = float(inside.mean()) * box
    excess = float((held & ~inside).mean()) * box / volume if volume > 0.0 else float("inf")
    out, size, area = out * scale, size * scale**2, area * scale**2
    return CoverFigures(gaps * scale, area, out, size, volume, float(held.mean()) * box, excess)


def summed(found: Sequence[CoverFigures]) -> dict[str, float]:
    """Return the figures of a robot from those of its links."""
    gaps, area, out, size = (
        np.concatenate([getattr(one, name) for one in found])
        for name in ("gaps", "area", "out", "size")
    )
    volume, covered = sum(one.volume for one in found), sum(one.covered for one in found)
    order = np.argsort(out, kind="stable")
    place = np.searchsorted(np.cumsum(size[order]), 0.95 * size.sum())
    return {
        "coverage": float(area[gaps <= 0.0].sum() / area.sum()),
        "protrusion_mean": float(size @ out / size.sum()),
        "protrusion_p95": float(out[order][min(int(place), len(out) - 1)]),
        "protrusion_max": float(out.max()),
        "surface_gap": float(area @ gaps / area.sum()),
        "largest_uncovered_gap": float(gaps.max()),
        "volume_ratio": covered / volume if volume > 0.0 else float("inf"),
    }


def _outside(points: FloatArray, axes: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the distance of points (q, 3) from all balls and capsules; negative inside."""
    if (axes[:, :3] == axes[:, 3:]).all():
        centers = np.ascontiguousarray(axes[:, :3])
        return NearestTree.of_balls(centers, radii).distances(points)[0]
    result = np.full(len(points), np.inf)
    for axis, radius in zip(axes, radii, strict=True):
        away = axis_distances(points, np.broadcast_to(axis, (len(points), 6)))
        result = np.minimum(result, away - radius)
    return result


def boundary_points(axes: FloatArray, radii: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points spread over balls and capsules, and the area that each stands for."""
    steps = np.arange(DIRECTIONS) + 0.5
    up, turn = 1.0 - 2.0 * steps / DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * steps
    flat = np.sqrt(1.0 - up**2)
    around = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)
    along = axes[:, 3:] - axes[:, :3]
    far = (along @ around.T > 0.0)[..., None]
    ends = np.where(far, axes[:, None, 3:], axes[:, None, :3])
    caps = (ends + radii[:, None, None] * around).reshape(-1, 3)
    size = np.repeat(4.0 * np.pi * radii**2 / DIRECTIONS, DIRECTIONS)
    length = np.linalg.norm(along, axis=1)
    long = length > 0.0
    if not long.any():
        return caps, size
    unit = along[long] / length[long, None]
    least = np.eye(3)[np.abs(unit).argmin(axis=1)]
    across = np.cross(unit, least)
    across /= np.linalg.norm(across, axis=1)[:, None]
    other = np.cross(unit, across)
    share = (steps / DIRECTIONS)[:, None]
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    sides = axes[long, None, :3] + share * along[long, None]
    sides = sides + radii[long, None, None] * (cosine * across[:, None] + sine * other[:, None])
    side_size = np.repeat(2.0 * np.pi * radii[long] * length[long] / DIRECTIONS, DIRECTIONS)
    return np.concatenate([caps, sides.reshape(-1, 3)]), np.concatenate([size, side_size])
