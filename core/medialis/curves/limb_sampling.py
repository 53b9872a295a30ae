"""Samples on limbs: as close as a limb is thin, however coarse its triangles are.

A limb is found by its balls, and its balls by samples all round it: of a prism with six long sides
they touch the edges alone. How thick the shape is below a face is told by a ray from its middle
inwards, how wide across by rays from the middle of that one. Where both are alike there is a limb,
and its edges are split until they are a share of its radius; below sheets and edges of bodies one
of the two is far longer, and nothing is split.

Rays end where it would be too thick to matter. Where balls of the samples alone are larger than
that no ray is sent; on dense meshes that is nearly everywhere. Only faces of limbs are split, and
those beside them.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import Index, unit_rows
from medialis.base.box_tree import NearestTree
from medialis.base.progress import Progress
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray
from medialis.shape.refinement import edges_of_sides, refine_faces
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import BallStatus, ShrinkOptions, shrink

EDGES_A_RADIUS = 2.2  # halved 100 %, doubled 87 %
"""Edges to the radius of a limb at least. With 2.0 one of 117 tips of trees of 2,000 triangles is
1.27 radii short, with 1.5 three are and one is absent."""

WIDEST = 3.0  # halved 100 %, doubled 100 %
"""Times its thickness that a limb is wide: beyond it is a sheet."""

THINNEST = 0.0005  # halved 0 %, doubled 11 %
"""Share of the diagonal below which a thickness is none: the surface touches itself there."""

NARROWEST = 1e-4  # halved < 0.1 %, doubled 0.2 %
"""Share of the diagonal: the normal of a face that is less wide follows the last digits of its
corners, and so does what a ray along it meets. Faces of the thinnest limb are wider."""

TALLEST = 3.0  # halved 37 %, doubled 30 %
"""Times its thickness that a face of a limb is high, which is no wider than a limb may be. Single
spots of a mesh that are thinner have taken hundreds of samples each, and tell no limb."""

SLIPS = 1.25  # halved 99 %, doubled 0.9 %
"""Times half the thickness that balls of samples alone are large. With it 4 % of the faces of limbs
are missed on a horse (its ears) and none to 1 % on others; with 1.0 up to 13 %, with 2.0 none to
0.6 %, of twice as many faces that are measured."""

MOST_SAMPLES = 30_000  # halved 33 %, doubled 0 %
"""That there may be for limbs, besides twice those given. Of ten trees none has more than
40,000 in all."""

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
    return run_patiently(
        lambda: refine_faces(shape, _affordable(shape, allowed, most), most), progress
    )


def limb_radii(shape: Shape, progress: Progress) -> FloatArray:
    """Return half the thickness below each face of a limb that has long edges; inf elsewhere.

    A face beside one of a limb, at its tip or where it begins, has the radius of that one.

    Parameters
    ----------
    shape : Shape
        A mesh of m faces.
    progress : Progress

    Returns
    -------
    (m,) float64
    """
    radius = np.full(shape.face_count, np.inf)
    longest = run_patiently(lambda: _longest_sides(shape), progress)
    rows, others = _thin_places(shape, longest, progress)
    if len(rows) == 0:
        return radius
    low, high = _sections(shape, rows, others, longest[rows], progress).T
    double = 2.0 * shape.face_areas  # the height of a face times its longest side
    limb = (high < WIDEST * low) & (low > THINNEST * shape.diagonal)
    limb &= double[rows] > NARROWEST * shape.diagonal * longest[rows]
    limb &= double[rows] < TALLEST * low * longest[rows]
    rows, low = rows[limb], low[limb]
    radius[rows] = low / 2.0
    beside = shape.edge_twins.reshape(-1, 3)[rows] // 3
    near = (beside >= 0) & np.isinf(radius[beside])
    near &= double[beside] < TALLEST * low[:, None] * longest[beside]
    np.minimum.at(radius, beside[near], np.broadcast_to(low[:, None] / 2.0, near.shape)[near])
    return radius


def _longest_sides(shape: Shape) -> FloatArray:
    """Return the length of the longest side of each face, (m,)."""
    lengths = np.append(shape.edge_lengths, 0.0)
    return lengths[edges_of_sides(shape)].max(axis=1)


def _thin_places(shape: Shape, longest: FloatArray, progress: Progress) -> tuple[Index, Index]:
    """Return the faces that may be of limbs with long edges, and those that may face them."""
    faces = np.asarray(shape.faces)
    balls, _ = shrink(shape, ShrinkOptions(), progress.still)
    radii = np.where(balls.valid, balls.radii, np.inf)
    radii[balls.status == BallStatus.NO_NORMAL] = 0.0
    least, matters = radii[faces].min(axis=1), SLIPS * EDGES_A_RADIUS * longest
    thin = np.flatnonzero(least <= matters)
    # Across a thin place balls of each side touch the other one.
    most = np.zeros(shape.point_count)
    np.maximum.at(most, faces[thin], matters[thin, None])
    first, second = balls.features[balls.valid].T
    across = most.copy()
    np.maximum.at(across, first, most[second])
    np.maximum.at(across, second, most[first])
    return thin, np.flatnonzero(least <= across[faces].max(axis=1))


def _sections(
    shape: Shape, rows: Index, others: Index, longest: FloatArray, progress: Progress
) -> FloatArray:
    """Measure how thick and how wide it is below r faces, up to others, (r, 2)."""
    from medialis.curves._limb_kernels import LEAST, measure_sections

    faces = np.asarray(shape.faces)
    corners = shape.points[faces[rows]]
    ways = unit_rows((np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)).reshape(-1, 9)
    tree = run_patiently(lambda: NearestTree.of_triangles(shape.points, faces[others]), progress)
    starts, matters = corners.mean(axis=1) - tree.tree.center, 2.0 * EDGES_A_RADIUS * longest
    places = np.column_stack([starts, -shape.face_normals[rows], ways, matters])
    sections, least = np.empty((len(rows), 2)), LEAST * float(np.abs(tree.tree.points).max())
    given = places, tree.tree, tree.items.corners, WIDEST, least, sections
    run_chunks(measure_sections, len(rows), FACES_A_CHUNK, *given, progress=progress.still)
    return sections


def _affordable(shape: Shape, allowed: FloatArray, most: int) -> FloatArray:
    """Make edges longer where there would be too many samples."""
    area, length = shape.face_areas, allowed
    while True:
        # A vertex has two triangles; those of edges that are halved have two thirds of the length.
        count = (np.maximum(area / (0.25 * length**2), 1.0)).sum() / 2
        if count <= most:
            return length
        length = 2.0**0.25 * length
