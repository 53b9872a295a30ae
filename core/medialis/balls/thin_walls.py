"""Maximal balls where a wall is thinner than the tolerance or than the samples are apart.

Ball shrinking sees samples and a tolerance, so a ball may pass a thin wall in two ways: its other
side looks like relief, or the ball slips between the samples there (deviations from thesis 3.2).
"""

from __future__ import annotations

import functools
import logging
from typing import TYPE_CHECKING, Any

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
from medialis.balls.hidden_walls import THINNEST, hidden_walls
from medialis.balls.triangle_contacts import shrink_to_triangles
from medialis.model.medial_cloud import COLUMNS, MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress, counted
from medialis.threads import run_chunks, run_patiently

if TYPE_CHECKING:
    from medialis._kernels.box_tree import BoxTree


def maximal_balls(shape: Shape, options: ShrinkOptions, progress: Progress) -> MedialCloud:
    """Shrink balls, and again where balls went through a thin wall.

    Inner balls that the tolerance lets through a wall (`hidden_walls`) get the largest of tolerance
    / 10, tolerance / 100, ... that does not. Inner balls of a mesh that touch a sample from
    outside, as they slipped between those of a wall, are shrunk until its triangles touch them
    (`shrink_to_triangles`). All others stay the same bits, also those at sharp edges of a coarsely
    sampled plate that touch a sample from inside. Messages say how many balls changed.

    Only the chunks of the samples concerned are computed again, on the same tree.
    """
    cloud, tree = shrink(shape, options, progress)
    cloud = _with_lower_tolerance(cloud, tree, options, progress)
    cloud = shrink_to_triangles(cloud, options.tolerance, progress)
    note_outcome(cloud, options.tolerance, progress)
    return cloud


def _with_lower_tolerance(
    cloud: MedialCloud, tree: BoxTree, options: ShrinkOptions, progress: Progress
) -> MedialCloud:
    """Give the balls that the tolerance lets through a wall a lower one."""
    tolerance, largest = options.tolerance, options.largest_radius
    found = run_patiently(lambda: hidden_walls(cloud, tolerance), progress)
    hidden = np.flatnonzero(found)
    if len(hidden) == 0:
        return cloud
    exact = _shrink_again(cloud.surface, tree, hidden, 0.0, largest, progress)
    # Others have another reason.
    curable = ~run_patiently(lambda: hidden_walls(exact, tolerance), progress)
    hidden, exact, finer = hidden[curable], exact.subset(curable), tolerance
    count = len(hidden)
    while len(hidden):
        finer = finer / 10 if finer > THINNEST else 0.0
        balls = exact
        if finer > 0:
            balls = _shrink_again(cloud.surface, tree, hidden, finer, largest, progress)
        seen = ~run_patiently(functools.partial(hidden_walls, balls, tolerance), progress)
        new = balls.subset(seen)
        cloud = cloud.with_rows(hidden[seen], **{name: getattr(new, name) for name in COLUMNS})
        hidden, exact = hidden[~seen], exact.subset(~seen)
    if count:
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
    """Return the inner balls of some samples: the same bits as when all are computed."""
    options = shrink_options(shape.diagonal, tolerance, largest)
    n = shape.point_count
    place = np.empty(n, np.int64)
    place[tree.order] = np.arange(n)
    chunks = np.unique(place[rows] // SAMPLES_A_CHUNK)
    arrays = blank_balls(n)

    def work(begin: int, end: int) -> None:
        for chunk in chunks[begin:end]:
            first = int(chunk) * SAMPLES_A_CHUNK
            options.run(tree, first, min(first + SAMPLES_A_CHUNK, n), 1, arrays)

    run_chunks(work, len(chunks), 1, progress=progress.still)
    mine: tuple[NDArray[Any], ...] = tuple(values[rows] for values in arrays)
    return options.to_cloud(shape, tree, mine, rows.astype(np.int32), np.ones(len(rows), np.int8))
