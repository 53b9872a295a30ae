"""The steps of a midsurface, from balls to one mesh (see midsurface.py)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from medialis._kernels.nearest import NearestTree
from medialis.midsurfaces.assembly import assembled
from medialis.midsurfaces.curves import find_chains, find_curves, forget_lost, lay_curves
from medialis.midsurfaces.junctions import cut_sheets, join_steps, tidy_borders
from medialis.midsurfaces.lumps import find_lumps
from medialis.midsurfaces.remeshing import remesh
from medialis.midsurfaces.sheet_pieces import raw_sheets
from medialis.midsurfaces.walls import find_sides
from medialis.model.medial_cloud import MedialCloud
from medialis.model.midsurface import Midsurface
from medialis.progress import Progress
from medialis.threads import run_patiently


def middle_of_walls(
    balls: MedialCloud, least_angle: float, crease: float, edge: float, progress: Progress
) -> Midsurface:
    """Return the midsurface of what the balls of a mesh tell.

    Parameters
    ----------
    balls : MedialCloud
        Inner balls, row i that of sample i.
    least_angle : float
        Radians: of the spokes of balls in walls.
    crease : float
        Degrees: sides of walls end at edges that bend by more.
    edge : float
        Length of the edges of triangles, in the units of the shape.
    """
    shape = balls.surface
    progress.update(0.0)
    sides = find_sides(balls, least_angle, crease)
    raws = raw_sheets(sides)
    if not raws:
        return nothing()
    progress.update(0.3)
    sheets = cut_sheets(raws)
    surface = NearestTree.of_triangles(shape.points, np.asarray(shape.faces))
    join_steps(sheets, surface)
    tidy_borders(sheets, surface)
    forget_lost(sheets)
    chains, nodes = find_chains(sheets)
    curves = find_curves(sheets, chains, nodes, edge)
    kinds, numbers, places = lay_curves(sheets, curves, nodes)
    for s, (sheet, kind) in enumerate(zip(sheets, kinds, strict=True)):
        begin, end = (0.5 + 0.5 * (s + step) / len(sheets) for step in (0, 1))
        with progress.stage("triangles", begin, end):
            remesh(sheet.mesh, kind, sheet.raw, edge, progress)
    found = assembled(sheets, numbers, places, curves, len(nodes))
    if not shape.closed_components.all():
        return found
    lumps, share = run_patiently(lambda: find_lumps(shape, found), progress)
    return replace(found, lumps=lumps, wall_share=share)


def nothing() -> Midsurface:
    """Return a midsurface without sheets."""
    none = np.empty((0, 3))
    return Midsurface(
        none, np.empty((0, 3), np.int32), np.empty(0), np.empty(0), np.empty(0, np.int32),
        np.empty((0, 2), np.int32), np.empty(0, np.int32),
    )  # fmt: skip
