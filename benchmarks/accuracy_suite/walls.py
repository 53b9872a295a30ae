"""Thickness against truth and against rays, and the thinnest place of a shape."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

import medialis
from accuracy_suite.known import KnownShape
from accuracy_suite.poke_out import fan_normals
from medialis.show.reports.measures import distance_to_balls, distance_to_surface

CLOSE = 0.02
"""Relative error of a thickness that is right."""

OPPOSITE = np.cos(np.radians(175))
"""Cosine between the normals of walls that are opposite and parallel: facets of a tube of 96 sides
are 2 to 3 degrees off the normals of its vertices."""

RAYS_AT_ONCE = 200


def ray_thickness(shape: medialis.Shape, coarse: medialis.Shape) -> np.ndarray:
    """Return the length of the ray through the wall at each sample, (n,); NaN where it says little.

    `coarse` is a mesh of the same surface that rays meet, with fewer triangles.

    The ray starts against the normal. It counts where the sample is on no crease, the face that it
    hits is opposite and parallel (within 5 degrees), and the ball with the ray as its diameter fits
    into the wall, up to 2 %: elsewhere a rim or another wall is nearer than the opposite one.
    """
    normals, result = shape.normals, np.full(shape.point_count, np.nan)
    smooth = np.ones(shape.point_count, bool)
    corners = shape.faces.ravel()
    bent = np.abs(fan_normals(shape) - normals[corners]).max(axis=1) > 1e-6
    smooth[corners[bent]] = False
    rows = np.flatnonzero(smooth & normals.any(axis=1))
    length, face = first_hits(coarse, shape.points[rows], -normals[rows])
    hit = np.isfinite(length)
    rows, length, face = rows[hit], length[hit], face[hit]
    facing = (coarse.face_normals[face] * normals[rows]).sum(axis=1) <= OPPOSITE
    middle = shape.points[rows] - length[:, None] / 2 * normals[rows]
    room = distance_to_surface(middle, coarse)
    good = facing & (room >= (1 - CLOSE) * length / 2)
    result[rows[good]] = length[good]
    return result


def first_hits(
    shape: medialis.Shape, origins: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance along each ray to the first triangle in front of it, inf for none, and the face."""
    a, b, c = shape.points[shape.faces.T]
    u, v = b - a, c - a
    length, face = np.full(len(origins), np.inf), np.full(len(origins), -1)
    least = 1e-6 * shape.diagonal
    with np.errstate(divide="ignore", invalid="ignore"):
        for first in range(0, len(origins), RAYS_AT_ONCE):
            rows = slice(first, first + RAYS_AT_ONCE)
            o, d = origins[rows, None], directions[rows, None]
            p = np.cross(d, v)
            det = (p * u).sum(axis=2)
            away = o - a
            s = (away * p).sum(axis=2) / det
            q = np.cross(away, u)
            t = (d * q).sum(axis=2) / det
            along = (v * q).sum(axis=2) / det
            inside = (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1 + 1e-9)
            along = np.where(inside & (along > least), along, np.inf)
            face[rows] = along.argmin(axis=1)
            length[rows] = along.min(axis=1)
    return length, face


def ray_row(shape: medialis.Shape, refine: float = 0.0) -> dict[str, float]:
    """Compare thickness with rays on opposite parallel walls, where `ray_thickness` has one.

    ``judged``: samples. ``right``: per cent of them within 2 % of the ray. ``error_95``: per cent
    of the ray that 95 % of the samples do not exceed.
    """
    cloud = medialis.surface_skeleton(shape, refine=refine)
    rays = ray_thickness(cloud.surface, shape)
    known = np.isfinite(rays)
    error = np.abs(medialis.thickness(cloud)[known] / rays[known] - 1)
    return {
        "samples": cloud.surface.point_count,
        "judged": int(known.sum()),
        "right": 100 * float((error <= CLOSE).mean()),
        "error_95": 100 * float(np.percentile(error, 95)),
    }


def truth_row(shape: medialis.Shape, known: KnownShape, refine: float = 0.0) -> dict[str, float]:
    """Compare thickness with the true ball of each sample: the one it lies on, or nearest to.

    As `ray_row`; all samples are judged.
    """
    cloud = medialis.surface_skeleton(shape, refine=refine)
    truth = known.truth()
    ball = distance_to_balls(cloud.surface.points, truth.points, truth.radii)[1]
    error = np.abs(medialis.thickness(cloud) / (2 * truth.radii[ball]) - 1)
    return {
        "samples": cloud.surface.point_count,
        "judged": len(error),
        "right": 100 * float((error <= CLOSE).mean()),
        "error_95": 100 * float(np.percentile(error, 95)),
    }


def thin_row(shape: medialis.Shape, known: KnownShape) -> dict[str, float]:
    """Compare the first thin spot of the operation `thickness` at its defaults with the truth.

    ``value_error``: per cent of the true minimum. ``off``: distance of the spot from the nearest
    place of the surface that is as thin, in spacings of the samples.
    """
    result = medialis.run("thickness", shape)
    spot = result.values["spots"][0]
    value, places = known.thinnest
    away = cKDTree(places).query(np.array(spot["position"]))[0]
    return {
        "samples": result.values["samples"],
        "spots": len(result.values["spots"]),
        "value_error": 100 * (spot["value"] / value - 1),
        "off": float(away / result.values["spacing"]),
    }
