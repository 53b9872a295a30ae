"""Maximal balls where a wall is thinner than the tolerance or than the samples are apart.

Ball shrinking sees samples and a tolerance, so a ball may pass a thin wall in two ways: its other
side looks like relief, or the ball slips between the samples there (deviations from thesis 3.2).
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress, ProgressCallback
from medialis.surface_skeletons.ball_shrinking import (
    DEFAULT_TOLERANCE,
    LARGEST_RADIUS,
    SAMPLES_A_CHUNK,
    Side,
    blank_balls,
    note_outcome,
    shrink,
    shrink_options,
)
from medialis.surface_skeletons.hidden_walls import THINNEST, hidden_walls
from medialis.surface_skeletons.triangle_contacts import shrink_to_triangles
from medialis.threads import run_chunks

if TYPE_CHECKING:
    from medialis._kernels.box_tree import BoxTree


def maximal_balls(
    shape: Shape,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    side: Side = "inner",
    largest_radius: float = LARGEST_RADIUS,
    progress: Progress | ProgressCallback | None = None,
) -> MedialCloud:
    """Compute the surface skeleton, and again where balls went through a thin wall.

    Parameters, result, errors and cost are those of `medialis.surface_skeleton`. Inner balls that
    the tolerance lets through a wall (`hidden_walls`) get the largest of tolerance / 10,
    tolerance / 100, ... that does not. Inner balls of a mesh that touch a sample from outside, as
    they slipped between those of a wall, are shrunk until its triangles touch them
    (`shrink_to_triangles`). All others stay the same bits, also those at sharp edges of a coarsely
    sampled plate that touch a sample from inside. Messages say how many balls changed.

    Notes
    -----
    Only the chunks of the samples concerned are computed again, on the same tree.
    """
    progress = Progress.of(progress)
    cloud, tree = shrink(shape, tolerance, side, largest_radius, progress)
    cloud = _with_lower_tolerance(shape, cloud, tree, tolerance, largest_radius, progress)
    cloud = shrink_to_triangles(shape, cloud, tolerance, progress)
    note_outcome(shape, cloud, tolerance, progress)
    return cloud


def _with_lower_tolerance(
    shape: Shape,
    cloud: MedialCloud,
    tree: BoxTree,
    tolerance: float,
    largest: float,
    progress: Progress,
) -> MedialCloud:
    """Give the balls that the tolerance lets through a wall a lower one."""
    hidden = np.flatnonzero(hidden_walls(shape, cloud, tolerance))
    if len(hidden) == 0:
        return cloud
    exact = _shrink_again(shape, tree, hidden, 0.0, largest, progress)
    curable = ~hidden_walls(shape, exact, tolerance)  # others have another reason
    hidden, exact, finer = hidden[curable], exact.subset(curable), tolerance
    count = len(hidden)
    while len(hidden):
        finer = finer / 10 if finer > THINNEST else 0.0
        found = exact
        if finer > 0:
            found = _shrink_again(shape, tree, hidden, finer, largest, progress)
        seen = ~hidden_walls(shape, found, tolerance)
        cloud = _with_balls(cloud, hidden[seen], found.subset(seen))
        hidden, exact = hidden[~seen], exact.subset(~seen)
    if count:
        progress.note(
            f"At {count} of {shape.point_count} samples the wall is thinner than the tolerance of "
            f"{100 * tolerance:.3g} % of the diagonal, which hides its other side: their balls "
            f"were computed with down to {100 * finer:.3g} %.",
            level=logging.WARNING,
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

    silent = Progress(lambda fraction, text: progress.update(1.0))
    run_chunks(work, len(chunks), 1, progress=silent)
    mine: tuple[NDArray[Any], ...] = tuple(values[rows] for values in arrays)
    return options.to_cloud(tree, mine, rows.astype(np.int32), np.ones(len(rows), np.int8))


def _with_balls(cloud: MedialCloud, rows: NDArray[np.int64], balls: MedialCloud) -> MedialCloud:
    """Return a cloud with some of its rows replaced."""
    taken = {}
    for name in ("centers", "radii", "features", "status", "spoke_angles"):
        taken[name] = np.array(getattr(cloud, name))
        taken[name][rows] = getattr(balls, name)
    return replace(cloud, **taken)
