"""Samples on limbs: as close as a limb is thin, however coarse its triangles are.

A limb is found by its balls, and its balls by samples all round it: of a prism with six long sides
they touch the edges alone. How thick the shape is below a face is told by a ray from its middle
inwards, how wide across by rays from the middle of that one. Where both are alike there is a limb,
and its edges are split until they are a share of its radius; below sheets and edges of bodies one
of the two is far longer, and nothing is split.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import kd_tree, unit_rows
from medialis.base.box_tree import NearestTree
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray
from medialis.shape.refinement import refine_by
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface

EDGES_A_RADIUS = 2.0
"""Edges to the radius of a limb at least."""

WIDEST = 3.0
"""Times its thickness that a limb is wide: beyond it is a sheet."""

THINNEST = 0.0005
"""Share of the diagonal below which a thickness is none: the surface touches itself there."""

NARROWEST = 1e-4
"""Share of the diagonal: the normal of a face that is less wide follows the last digits of its
corners, and so does what a ray along it meets. Faces of the thinnest limb are wider."""

MOST_SAMPLES = 60_000
"""That there may be for limbs, besides twice those given."""

NEAREST, EQUAL = 6, 0.1
"""Vertices that may be the nearest to the middle of an edge, and by which share they may differ. On
grids four are: the ends of a diagonal and the corners beside it."""

FACES_A_CHUNK = 256


def with_limbs_sampled(shape: Shape, progress: Progress) -> Shape:
    """Split edges on limbs that are longer than a share of the radius there.

    Parameters
    ----------
    shape : Shape
        A mesh.
    progress : Progress

    Returns
    -------
    Shape
        As `refine` returns it; the same object when nothing is to do.
    """
    if shape.faces is None or shape.diagonal == 0.0:
        return shape
    radius = limb_radii(shape, progress)
    if not np.isfinite(radius).any():
        return shape
    most = MOST_SAMPLES + 2 * shape.point_count
    allowed = radius / EDGES_A_RADIUS
    return run_patiently(lambda: _halved(shape, _affordable(shape, allowed, most), most), progress)


def _halved(shape: Shape, allowed: FloatArray, most: int) -> Shape:
    """Split edges longer than what is allowed at the vertices nearest to their middles.

    Those are both ends as a rule: the least of them counts.
    """
    tree = kd_tree(shape.points)

    def bound(middles: FloatArray) -> FloatArray:
        distance, near = tree.query(middles, k=min(NEAREST, shape.point_count))
        equal = distance <= (1.0 + EQUAL) * distance[:, :1]
        return np.where(equal, allowed[near], np.inf).min(axis=1)

    return refine_by(shape, bound, most)


def limb_radii(shape: Shape, progress: Progress) -> FloatArray:
    """Return half the thickness at each vertex of a limb that has long edges; inf elsewhere.

    Parameters
    ----------
    shape : Shape
        A mesh of n vertices.
    progress : Progress

    Returns
    -------
    (n,) float64
    """
    from medialis.curves._limb_kernels import measure_sections

    faces = np.asarray(shape.faces)
    surface = Surface.of_checked(shape.points, faces).adopt(shape.topology)
    corners = shape.points[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    ways = unit_rows(sides.reshape(-1, 3)).reshape(-1, 9)
    tree = run_patiently(lambda: NearestTree.of_triangles(shape.points, faces), progress)
    starts = corners.mean(axis=1) - tree.tree.center
    matters = EDGES_A_RADIUS * longest
    rows = np.column_stack([starts, -surface.face_normals, ways, matters])
    sections = np.empty((len(faces), 2))
    given = rows, tree.tree, tree.items.corners, sections
    run_chunks(measure_sections, len(faces), FACES_A_CHUNK, *given, progress=progress.still)
    low, high = sections.min(axis=1), sections.max(axis=1)
    limb = (high < WIDEST * low) & (low > THINNEST * shape.diagonal)
    limb &= 2.0 * shape.face_areas > NARROWEST * shape.diagonal * longest
    result = np.full(shape.point_count, np.inf)
    for corner in faces[limb].T:
        np.minimum.at(result, corner, low[limb] / 2)
    return result


def _affordable(shape: Shape, allowed: FloatArray, most: int) -> FloatArray:
    """Make edges longer where there would be too many samples."""
    faces = np.asarray(shape.faces)
    length = allowed[faces].min(axis=1)
    area = shape.face_areas
    while True:
        # A vertex has two triangles; those of edges that are halved have two thirds of the length.
        count = (np.maximum(area / (0.25 * length**2), 1.0)).sum() / 2
        if count <= most:
            return allowed
        allowed, length = 2.0**0.25 * allowed, 2.0**0.25 * length
