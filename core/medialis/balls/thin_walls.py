"""Maximal balls where a wall is thinner than the tolerance or than the samples are apart.

Ball shrinking sees samples and a tolerance, so a ball may pass a thin wall in two ways: its other
side looks like relief, or the ball slips between the samples there (deviations from thesis 3.2).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from medialis.balls.ball_shrinking import (
    SAMPLES_A_CHUNK,
    ShrinkOptions,
    blank_balls,
    note_outcome,
    shrink,
    shrink_options,
)
from medialis.balls.crease_balls import with_edge_balls
from medialis.balls.hidden_walls import THINNEST, hidden_walls
from medialis.balls.triangle_balls import Walls
from medialis.model.medial_cloud import COLUMNS, MedialCloud
from medialis.model.shape import Shape
from medialis.options import angle
from medialis.progress import Progress, counted
from medialis.surface.creases import find_creases
from medialis.threads import run_chunks, run_patiently

if TYPE_CHECKING:
    from medialis._kernels.box_tree import BoxTree


@dataclass(frozen=True, kw_only=True)
class BallOptions(ShrinkOptions):
    """Options of `maximal_balls`."""

    creases: float = angle(
        30.0,
        "Creases",
        "Edges that bend by more than this are sharp, and what bends less is a smooth surface "
        "through the vertices. 0: every edge is sharp, the mesh is an exact polyhedron; 180: none "
        "is.",
        advanced=True,
    )


def maximal_balls(
    shape: Shape, options: BallOptions, progress: Progress, out_walls: list[Walls] | None = None
) -> MedialCloud:
    """Shrink balls to what samples, triangles and thin walls leave room for.

    Triangles constrain the balls of a mesh as well as its samples (`Walls`). Inner balls that the
    tolerance lets through a wall get the largest of tolerance / 10, tolerance / 100, ... that does
    not; only those balls are computed again, on the same tree. A sample on
    a convex crease gets the ball that fits into the crease just beside it. `out_walls` gets the
    walls of a mesh, for `with_fans`.
    """
    with progress.stage("samples", 0.0, 0.45):
        cloud, tree = shrink(shape, options, progress)
    if shape.faces is None:
        cloud = _with_lower_tolerance(cloud, tree, None, options, progress)
    else:
        with progress.stage("triangles", 0.45, 1.0):
            walls = run_patiently(lambda: _walls(shape, options.creases, tree), progress)
            cloud = walls.constrain(cloud, options.tolerance, progress)
        cloud = _with_lower_tolerance(cloud, tree, walls, options, progress)
        cloud = with_edge_balls(cloud, walls.creases, options.tolerance)
        if out_walls is not None:
            out_walls.append(walls)
    note_outcome(cloud, options.tolerance, progress)
    return cloud


def _walls(shape: Shape, angle: float, tree: BoxTree) -> Walls:
    return Walls.of(find_creases(shape, angle), tree)


def _with_lower_tolerance(
    cloud: MedialCloud,
    tree: BoxTree,
    walls: Walls | None,
    options: BallOptions,
    progress: Progress,
) -> MedialCloud:
    """Give the balls that the tolerance lets through a wall a lower one."""
    tolerance = options.tolerance

    def went_through(balls: MedialCloud) -> NDArray[np.bool_]:
        return run_patiently(lambda: hidden_walls(balls, tolerance), progress)

    def shrink_again(rows: NDArray[np.int64], finer: float) -> MedialCloud:
        balls = _shrink_again(cloud.surface, tree, rows, finer, options.largest_radius, progress)
        return balls if walls is None else walls.constrain(balls, finer, progress)

    hidden = np.flatnonzero(went_through(cloud))
    hidden = hidden[np.argsort(tree.place[hidden])]  # neighbours share what they find
    if len(hidden) == 0:
        return cloud
    exact = shrink_again(hidden, 0.0)
    curable = ~went_through(exact)  # others have another reason
    hidden, exact, finer = hidden[curable], exact.subset(curable), tolerance
    count, rows, cured = len(hidden), [], []
    while len(hidden):
        finer = finer / 10 if finer > THINNEST else 0.0
        balls = exact
        if finer > 0:
            balls = shrink_again(hidden, finer)
        seen = ~went_through(balls)
        rows.append(hidden[seen])
        cured.append(balls.subset(seen))
        hidden, exact = hidden[~seen], exact.subset(~seen)
    if count:
        columns = {n: np.concatenate([getattr(one, n) for one in cured]) for n in COLUMNS}
        cloud = cloud.with_rows(np.concatenate(rows), **columns)
        of = cloud.surface.point_count
        progress.note(
            f"{counted(count, 'sample', of=of, verbs=('lies', 'lie'))} on a wall thinner than the "
            f"tolerance of {100 * tolerance:.3g} % of the diagonal. The balls there were computed "
            f"with a tolerance of down to {100 * finer:.3g} %.",
            "thin_walls",
            level=logging.WARNING,
            samples=count,
            of=of,
            tolerance=finer,
        )
    return cloud


def _shrink_again(
    shape: Shape,
    tree: BoxTree,
    rows: NDArray[np.int64],
    tolerance: float,
    largest: float,
    progress: Progress,
) -> MedialCloud:
    """Return the inner balls of some samples, on the same tree."""
    options = shrink_options(shape.diagonal, tolerance, largest)
    arrays, tangents = blank_balls(len(rows)), (tree.place[rows], shape.normals[rows])

    def work(begin: int, end: int) -> None:
        options.run(tree, begin, end, 1, arrays, tangents)

    run_chunks(work, len(rows), SAMPLES_A_CHUNK, progress=progress.still)
    side = np.ones(len(rows), np.int8)
    return options.to_cloud(shape, tree, arrays, rows.astype(np.int32), side)
