"""How far a skeleton and the true medial axis are apart, and balls and surface."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

import medialis
from accuracy_suite.known import Truth
from accuracy_suite.poke_out import poke_out
from medialis.show.reports.measures import reconstruction_error


def axis_distances(cloud: medialis.MedialCloud, truth: Truth) -> dict[str, float]:
    """Measure the distance between the centers of a skeleton and the true axis, both ways.

    Returns
    -------
    dict
        Per cent of the diagonal. ``to_axis_max``, ``to_axis_mean``: of the centers of all inner
        balls from the axis, every ball as much. ``from_axis_max``, ``from_axis_mean``: of the axis
        from the nearest center, so at least half the spacing of the centers; the mean is by area
        (by length on a curve).
    """
    inner = cloud.subset(cloud.valid & (cloud.side > 0))
    per_cent = 100 / cloud.surface.diagonal
    there = per_cent * truth.distances(inner.centers)
    back = per_cent * cKDTree(inner.centers).query(truth.points)[0]
    return {
        "to_axis_max": float(there.max()),
        "to_axis_mean": float(there.mean()),
        "from_axis_max": float(back.max()),
        "from_axis_mean": float(back.mean()),
    }


def skeleton_row(shape: medialis.Shape, truth: Truth, refine: float) -> dict[str, float]:
    """Measure the skeleton of a mesh: samples, their spacing, the axis, and what pokes out."""
    cloud = medialis.surface_skeleton(shape, refine=refine, fans=True)
    surface = cloud.surface
    found = poke_out(cloud)
    return {
        "samples": surface.point_count,
        "spacing": 100 * surface.spacing / surface.diagonal,
        **axis_distances(cloud, truth),
        "poke_out": found.share,
        "poke_out_creases": found.share_at_creases,
    }


def union_row(shape: medialis.Shape, refine: float = 0.005) -> dict[str, float]:
    """Measure the union of the balls against the surface, per cent of the diagonal.

    ``out``: of the surface from the union (also the depth below it), ``back``: of the boundary of
    the union from the surface; maxima, and means by area. See
    `medialis.show.reports.measures.reconstruction_error`.
    """
    cloud = medialis.surface_skeleton(shape, refine=refine, fans=True)
    inner = cloud.subset(cloud.valid & (cloud.side > 0))
    error = reconstruction_error(cloud.surface, inner.centers, inner.radii)
    per_cent = 100 / cloud.surface.diagonal
    return {
        "samples": cloud.surface.point_count,
        "out_max": per_cent * error.surface_to_balls_max,
        "out_mean": per_cent * error.surface_to_balls_mean,
        "back_max": per_cent * float(error.balls_to_surface_max or 0.0),
        "back_mean": per_cent * float(error.balls_to_surface_mean or 0.0),
    }


def sheet_row(shape: medialis.Shape, known: dict[str, object]) -> dict[str, float]:
    """Measure number and areas of sheets and the length of the Y-curves, on the mesh as it is.

    ``sheets`` and ``true_sheets``; in per cent of the true value ``area_error`` (all sheets
    together), ``worst_sheet`` (the largest error of one sheet, sorted by area; None where the
    number is wrong) and ``y_error`` (None where there is no Y-curve).
    """
    cloud = medialis.surface_skeleton(shape, refine=0, fans=True)
    sheets = medialis.medial_sheets(cloud, smallest=0.0)
    areas = np.sort(medialis.sheet_meshes(sheets).areas)
    length = float(medialis.y_network(sheets).lengths.sum())
    true, true_length = np.asarray(known["areas"]), float(known["y_length"])
    same = len(areas) == len(true)
    return {
        "samples": cloud.surface.point_count,
        "sheets": sheets.count,
        "true_sheets": len(true),
        "area_error": 100 * float(areas.sum() / true.sum() - 1),
        "worst_sheet": 100 * float(np.abs(areas / true - 1).max()) if same else None,
        "y_error": 100 * (length / true_length - 1) if true_length > 0 else None,
    }
