"""The surface skeleton of a shape: one preparation and one set of balls for everything after it.

A mesh is smoothed where it is noisy and refined where its faces are too large to hold samples; then
each sample gets its maximal ball (thesis 3.2). Every operation takes its balls from here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from medialis.balls.ball_shrinking import ShrinkOptions
from medialis.balls.fans import with_fans
from medialis.balls.thin_walls import BallOptions, maximal_balls
from medialis.balls.triangle_balls import Walls
from medialis.errors import InvalidShapeError
from medialis.kept import kept
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.options import Options, algorithm, changed, choice, flag
from medialis.progress import Progress
from medialis.surface.creases import find_creases
from medialis.surface.given_shapes import ShapeLike, as_shape
from medialis.surface.noise import noise_above, smooth_noise
from medialis.surface.refinement import RefineOptions, affordable_edge, refine
from medialis.surface.smooth_refinement import on_smooth_surface
from medialis.threads import run_patiently

DENOISE = ("auto", "off")

NOISY = 0.04
"""Spacings: deviation of noise from which on a surface is smoothed. It tilts normals by 5 degrees.
Of 21 real meshes only one has more, a noisy scan with 0.043."""

FEW = 0.02
"""Share of the area. A dense mesh with so few faces of too long edges, none twice too long, is not
refined: it keeps its samples, and all operations on it share their balls. 0.13 % more samples
(horse2, refine = 0.01) would cost as much as computing everything a second time."""


@dataclass(frozen=True, kw_only=True)
class Preparation(Options):
    """Options of what comes before everything that rests on balls."""

    denoise: str = choice(
        "auto",
        "Noise",
        "auto: measure the noise of the surface and compute on a smoothed copy where it disturbs "
        "the normals; clean surfaces stay as they are, also with sharp edges. off: never.",
        DENOISE,
    )
    tolerance: float = changed(ShrinkOptions, "tolerance")
    refine: float = changed(
        RefineOptions,
        "longest_edge",
        help="Split edges longer than this share of the size for the computation, so that flat "
        "faces get samples; flat faces stay the same, on rounded ones new samples lie on the "
        "smooth surface. 0 computes with the given vertices only.",
    )
    creases: float = changed(BallOptions, "creases")


@dataclass(frozen=True, kw_only=True)
class SurfaceSkeletonOptions(ShrinkOptions, Preparation):
    """Options of `surface_skeleton`."""

    fans: bool = flag(
        False,
        "Fans",
        "Add balls at sharp edges: at concave ones with normals between those of the two faces, so "
        "that the skeleton has no gap there, at convex ones small balls between the samples, so "
        "that the union of the balls has none.",
        advanced=True,
    )


@algorithm(SurfaceSkeletonOptions, door=as_shape)
def surface_skeleton(
    shape: Shape, options: SurfaceSkeletonOptions, progress: Progress
) -> MedialCloud:
    """Compute the surface skeleton (medial axis) of a shape as a cloud of maximal balls.

    Every sample of the surface gets the largest ball that touches the surface there and lies inside
    the shape, constrained by the triangles of a mesh as well as by its samples. A noisy mesh is
    smoothed first, a coarse one refined. Creases, where the mesh bends by more than `creases`, are
    sharp edges; what bends less stands for a smooth surface through the vertices.

    Parameters
    ----------
    shape : Shape
        n samples with unit outward normals; samples without a normal get no ball.

    Returns
    -------
    MedialCloud
        One row for each sample of ``cloud.surface``, the surface as computed on, whose first n
        points are those of the shape; for both sides, twice as many rows. With `fans`, their rows
        come last.

    Raises
    ------
    InvalidShapeError
        When all points coincide, no sample has a normal, or no ball meets a second sample; the
        sentence says why.

    See Also
    --------
    shrink_balls : the balls of exactly the samples given, constrained by samples alone.
    geodesic_importance : tells what matters in a skeleton from what bumps and noise made.
    thickness, curve_skeleton, medial_sheets, parts : what rests on the balls.

    Notes
    -----
    Cost: O(n log n), about 400 bytes a sample. Source: thesis 3.2.1-3.2.2, Algorithm 1; see
    `shrink_balls`, `medialis.balls.triangle_balls` and `medialis.balls.thin_walls` for where it
    deviates.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> len(cloud) == cloud.surface.point_count, bool(cloud.valid.mean() > 0.99)
    (True, True)
    """
    fine, tolerance = prepared(shape, options, progress)
    shrinking = BallOptions.taken_from(options, tolerance=tolerance)

    walls: list[Walls] = []

    def shrink() -> MedialCloud:
        cloud = maximal_balls(fine, shrinking, progress, walls)
        _require_balls(cloud)
        return cloud

    with progress.stage("balls", 0.1, 1.0):
        # Another refine or denoise that leads to the same surface finds the same balls.
        cloud = kept(maximal_balls, fine, shrinking, shrink, progress)
    if not options.fans:
        return cloud
    return kept(
        with_fans, cloud, shrinking, lambda: with_fans(cloud, shrinking, progress, walls), progress
    )


CloudLike: TypeAlias = MedialCloud | ShapeLike


def as_cloud(given: CloudLike, progress: Progress) -> MedialCloud:
    """Return a cloud as it is, and the surface skeleton of whatever stands for a shape.

    Raises
    ------
    InvalidShapeError
        When it is neither; the sentence says what came.
    """
    if isinstance(given, MedialCloud):
        return given
    return surface_skeleton.of(as_shape(given, progress), SurfaceSkeletonOptions(), progress)


def prepared(shape: Shape, options: Preparation, progress: Progress) -> tuple[Shape, float]:
    """Return the surface to compute on, and the tolerance that it needs; say what was done."""
    clean, tolerance = _denoised(shape, options, progress)
    return _refined(clean, options, progress), tolerance


def _denoised(shape: Shape, options: Preparation, progress: Progress) -> tuple[Shape, float]:
    """Smooth a noisy mesh, and raise the tolerance to what noise is left."""
    tolerance = options.tolerance
    if options.denoise == "off" or shape.faces is None or shape.diagonal == 0.0:
        return shape, tolerance
    smooth, level, left = kept(
        _without_noise,
        shape,
        None,
        lambda: run_patiently(lambda: _without_noise(shape), progress),
        progress,
    )
    if smooth is shape:
        return shape, tolerance
    highest = next(p.high for p in Preparation.parameters() if p.name == "tolerance")
    raised = min(max(tolerance, left / shape.diagonal), highest)
    text = f", with a tolerance of {100 * raised:.3f} %" if raised > tolerance else ""
    progress.note(
        f"The surface is noisy: its vertices lie {100 * level / shape.diagonal:.2g} % of the "
        f"diagonal off a smooth surface ({level / shape.spacing:.2g} of the spacing). A smoothed "
        f"copy was used{text} (denoise = off turns this off).",
        "denoised",
        noise=level / shape.diagonal,
        tolerance=raised,
    )
    return smooth, raised


def _without_noise(shape: Shape) -> tuple[Shape, float, float]:
    """Return a smooth copy of a noisy shape, the noise before, and what is left of it."""
    least = NOISY * shape.spacing
    level = noise_above(shape, least)
    if level == 0.0 or level < least:
        return shape, level, 0.0
    smooth, left = smooth_noise(shape, level)
    return (smooth, level, left) if smooth.diagonal > 0 else (shape, level, 0.0)


def _refined(shape: Shape, options: Preparation, progress: Progress) -> Shape:
    """Refine a coarse mesh and say so."""
    fraction = options.refine
    if fraction == 0.0 or shape.faces is None:
        return shape
    if run_patiently(lambda: _dense(shape, fraction * shape.diagonal), progress):
        return shape
    asked, fraction = fraction, affordable_edge(shape, fraction)
    with progress.stage("refine", 0.0, 0.1):
        fine = refine.of(shape, RefineOptions(longest_edge=fraction), progress)
    if fine is not shape:
        if shape.face_origin is None:
            fine = run_patiently(
                lambda: on_smooth_surface(shape, fine, find_creases(shape, options.creases)),
                progress,
            )
        instead = (
            ""
            if fraction == asked
            else (
                f", not {100 * asked:g} %, which would make many more samples than so small a mesh "
                f"needs (refine below {100 * RefineOptions().longest_edge:g} % makes more)"
            )
        )
        progress.note(
            f"The mesh was refined for the computation: {shape.point_count:,} vertices became "
            f"{fine.point_count:,} samples. Edges longer than {100 * fraction:.3g} % of the "
            f"diagonal were split{instead}; flat faces are unchanged, on rounded ones new samples "
            "lie on the smooth surface through the vertices (refine = 0 turns this off).",
            "refined",
            vertices=shape.point_count,
            samples=fine.point_count,
            longest_edge=fraction,
        )
    return fine


def _dense(shape: Shape, longest: float) -> bool:
    """Tell whether edges longer than `longest` are few and not much longer."""
    lengths = shape.edge_lengths
    if lengths.max(initial=0.0) <= longest:
        return True
    if lengths.max() > 2 * longest:
        return False
    ends = np.zeros(shape.point_count, np.bool_)
    ends[shape.edges[lengths > longest]] = True
    faces = np.flatnonzero(ends[shape.faces].sum(axis=1) > 1)
    corners = shape.points[np.asarray(shape.faces)[faces]]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    coarse = faces[sides > longest]
    return bool(shape.face_areas[coarse].sum() <= FEW * shape.area)


def _require_balls(cloud: MedialCloud) -> None:
    """Raise a sentence that says why there is no skeleton, when there is none."""
    if cloud.valid.any():
        return
    shape = cloud.surface
    spread = np.linalg.svd(shape.points - shape.points.mean(axis=0), compute_uv=False)
    flat = spread[-1] <= 1e-9 * spread[0]
    why = "the shape is flat" if flat else "nothing faces them on this side"
    if not flat and shape.faces is None:
        why += " (if the normals of this cloud point inward, turn them or leave them out)"
    raise InvalidShapeError(
        f"No ball of the {shape.point_count} samples meets a second sample: {why}. A skeleton "
        "needs a surface that encloses a volume, at least partly."
    )
