"""The curve skeleton of a mesh, with finer samples where loops are missing (thesis 3.6.3).

A loop runs along balls round a handle. Where the handle, or the hole in it, is thinner than the
samples are apart, no balls go round it: its samples lie on creases alone, or far apart. There the
mesh is refined and everything computed again.
"""

from __future__ import annotations

import numpy as np

from medialis.balls.ball_shrinking import DEFAULT_TOLERANCE, ShrinkOptions, shrink
from medialis.balls.surface_skeleton import SurfaceSkeletonOptions, surface_skeleton
from medialis.curves.from_balls.curve_skeleton import curve_skeleton
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.options import Options
from medialis.progress import Progress, counted
from medialis.surface.refinement import refine_where
from medialis.threads import run_patiently
from medialis.validation import FloatArray

ATTEMPTS = 3
ACROSS = 1.0
"""Edges to the radius of the largest balls, inside and outside, at a handle, in the first attempt;
twice as many in each that follows."""

NEARBY = 4.0
"""Radii up to which the surroundings of a loop round or along a handle are refined: what is round
the handle there is as far as two."""

MOST, GROWTH = 100_000, 8
"""Samples that there may be after all attempts, or so many times those before if that is more: 30
handles with a thickness of 1 % of the size take 95,000."""


def curve_skeleton_of(shape: Shape, options: Options, progress: Progress) -> CurveSkeleton:
    """Compute the curve skeleton of a mesh, refined where handles have no loop.

    Parameters
    ----------
    shape : Shape
        A mesh.
    options : Options
        Those of `surface_skeleton` and of `curve_skeleton`.
    progress : Progress

    Returns
    -------
    CurveSkeleton
        The first one with all loops, else that with the most.
    """
    with progress.stage("skeleton", 0.0, 0.2):
        cloud = surface_skeleton.of(shape, options, progress)
    with progress.stage("curve skeleton", 0.2, 0.7):
        best = curve_skeleton.of(cloud, options, progress)
    most = max(MOST, GROWTH * cloud.surface.point_count)
    surface = cloud.surface
    with progress.stage("handles", 0.7, 1.0):
        for attempt in range(ATTEMPTS):
            if not _missing(best):
                break
            finer = _finer(surface, _missing(best), ACROSS * 2**attempt, most, progress)
            if finer is surface:
                break
            surface = finer
            again = curve_skeleton.of(_balls(surface, options, progress), options, progress)
            best = max(best, again, key=_closed)
    if best.surface is not None and best.surface is not cloud.surface:
        _note(cloud, best, progress)
    return best


def _missing(graph: CurveSkeleton) -> tuple[FloatArray, ...]:
    return () if graph.evidence is None else graph.evidence.missing


def _closed(graph: CurveSkeleton) -> int:
    return 0 if graph.evidence is None else sum(graph.evidence.closed_loops.values())


def _balls(surface: Shape, options: Options, progress: Progress) -> MedialCloud:
    """Return the balls of a surface as it is; what is said of it was said before."""
    as_it_is = SurfaceSkeletonOptions.taken_from(options, denoise="off", refine=0.0)
    return surface_skeleton.of(surface, as_it_is, progress.still)


def _finer(
    surface: Shape, lines: tuple[FloatArray, ...], across: float, most: int, progress: Progress
) -> Shape:
    """Refine a mesh round lines to a share of the radius that is free inside and outside."""
    from scipy.spatial import cKDTree

    finest = DEFAULT_TOLERANCE * surface.diagonal
    both, _ = shrink(surface, ShrinkOptions(side="both"), progress.still)

    def work() -> Shape:
        radii = np.fmin(*np.where(both.valid, both.radii, np.nan).reshape(2, -1))
        allowed = np.full(surface.point_count, np.inf)
        away = cKDTree(np.concatenate(lines)).query(surface.points)[0]
        rows = np.flatnonzero(away <= NEARBY * radii)
        allowed[rows] = radii[rows] / across
        # Balls tell nothing of what is smaller than the tolerance.
        return refine_where(surface, np.maximum(allowed, finest), most)

    return run_patiently(work, progress)


def _note(cloud: MedialCloud, graph: CurveSkeleton, progress: Progress) -> None:
    surface = graph.surface
    assert surface is not None and graph.evidence is not None
    more = surface.point_count - cloud.surface.point_count
    progress.note(
        f"{counted(more, 'sample', verbs=('was', 'were'))} added where handles are thin, to find "
        "their loops.",
        "handles_refined",
        samples=more,
    )
