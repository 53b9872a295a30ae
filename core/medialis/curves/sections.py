"""Cross-sections of a surface by planes: the outline round a place, its area and its widths.

A plane cuts triangles in segments, each with the inside on its left where the normal of the plane
is looked against. Segments hang together where triangles share an edge; of the outlines that come
of it the one that winds once round the place is its section. The area is that of a polygon, so that
no outline has to be walked.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import perpendicular
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray
from medialis.shape.surface import Surface

DIRECTIONS = 90
"""In which a section is measured: the widest is missed by 1 - cos 1 degree, 0.02 %, at most."""

ONCE = 0.5
"""An outline that winds more often than this round a place goes round it."""

PLACES_A_CHUNK = 16

ROUNDING = 1e-12
"""Share of the largest coordinate that spheres round triangles are larger by."""


def sections(
    surface: Surface, places: FloatArray, normals: FloatArray, progress: Progress
) -> FloatArray:
    """Measure the sections of a mesh by planes through places.

    Parameters
    ----------
    surface : Surface
        With m faces, outward.
    places, normals : (k, 3) float64
        The normals are unit vectors.

    Returns
    -------
    (k, 3) float64
        Area, least and largest width between two parallels; NaN where no closed outline goes round
        the place. Of outlines round outlines the innermost counts: it is the wall of what the place
        lies in.

    Notes
    -----
    Cost O(k m / 32), and what the planes cut.
    """
    from medialis.curves._section_kernels import BLOCK, Mesh, measure_across

    assert surface.faces is not None
    table = surface.edge_table
    edge_of = table.edge_of.astype(np.int32)
    points, faces = np.array(surface.points), np.array(surface.faces)
    mesh = Mesh(points, faces, edge_of, len(table.ends), _spheres(points[faces], BLOCK))
    across = perpendicular(normals)
    frames = np.stack([across, np.cross(normals, across), normals], axis=1)
    turn = np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    ways = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    found = np.full((len(places), 3), np.nan)
    given = mesh, np.array(places), frames, ONCE, ways, found
    run_chunks(measure_across, len(places), PLACES_A_CHUNK, *given, progress=progress)
    return found


def _spheres(corners: FloatArray, size: int) -> FloatArray:
    """Return middle and radius of a sphere round each block of so many triangles (m, 3, 3)."""
    first = np.arange(0, len(corners), size)
    low = np.minimum.reduceat(corners.min(axis=1), first)
    high = np.maximum.reduceat(corners.max(axis=1), first)
    middle = (low + high) / 2.0
    radius = np.linalg.norm(high - middle, axis=1)
    return np.column_stack([middle, radius + ROUNDING * np.abs(corners).max()])
