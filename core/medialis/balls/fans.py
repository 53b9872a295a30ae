"""Fans of balls at concave creases: all balls that touch the surface there (thesis 3.2).

At a sharp concave edge balls with any normal between those of the two faces are tangent. The balls
of the samples have one each; the sheet that belongs to the edge lies between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.balls.ball_shrinking import (
    SAMPLES_A_CHUNK,
    ShrinkOptions,
    blank_balls,
    sample_tree,
    shrink_options,
)
from medialis.balls.crease_balls import between_samples
from medialis.balls.thin_walls import BallOptions
from medialis.balls.triangle_balls import Walls
from medialis.model.medial_cloud import COLUMNS, MedialCloud
from medialis.progress import Progress
from medialis.surface.creases import Creases, find_creases
from medialis.threads import run_chunks, run_patiently
from medialis.validation import FloatArray

MOST_BALLS = 32
"""Balls of a fan at a sample, at most."""

SMOOTH = 0.94
"""Cosine: where faces lean from the normals of their sectors by 20 degrees, as in folds and rough
surfaces, normals between those of the sides mean nothing."""


def with_fans(
    cloud: MedialCloud, options: BallOptions, progress: Progress, walls: Sequence[Walls] = ()
) -> MedialCloud:
    """Append balls at creases between those of the samples.

    Creases that are concave on their side get fans, as close as the samples are apart; convex ones
    balls between the samples (`between_samples`).

    Parameters
    ----------
    cloud : MedialCloud
        The balls of all samples of a mesh, with these options.
    options : BallOptions
    progress : Progress
    walls : sequence of Walls
        What constrained these balls, where that is known; found again where it is empty.

    Returns
    -------
    MedialCloud
        The rows given, then those of fans, then those between samples: `source` tells the sample at
        the crease. The cloud itself where there is no crease.
    """
    shape = cloud.surface
    if shape.faces is None:
        return cloud
    if walls:
        creases = walls[0].creases
    else:
        creases = run_patiently(lambda: find_creases(shape, options.creases), progress)
    if len(creases.half_edges) == 0:
        return cloud
    if not walls:
        tree = sample_tree(shape, progress)
        walls = [run_patiently(lambda: Walls.of(creases, tree), progress)]
    signs = [one for one in np.unique(cloud.side) if (creases.concave == (one > 0)).any()]
    parts = [cloud]
    for sign in signs:
        sources, directions = _directions(cloud, creases, int(sign))
        parts.append(_balls(walls[0], sources, directions, int(sign), options, progress))
    parts.append(between_samples(cloud, walls[0], options.tolerance))
    if sum(map(len, parts)) == len(cloud):
        return cloud
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS
    }
    result = replace(cloud, **columns)
    result.__dict__["own"] = cloud  # the same cloud, so that what is kept of it serves both
    return result


def _directions(
    cloud: MedialCloud, creases: Creases, sign: int
) -> tuple[NDArray[np.int32], FloatArray]:
    """Return samples at creases concave on a side, and outward directions between the faces."""
    surface = cloud.surface
    pairs = creases.pairs[creases.concave == (sign > 0)]
    vertex = creases.vertices[pairs[:, 0]]
    first, second = creases.normals[pairs[:, 0]], creases.normals[pairs[:, 1]]
    bend = np.arccos(np.clip(np.einsum("ij,ij->i", first, second), -1.0, 1.0))
    radius = np.zeros(surface.point_count)
    own = cloud.valid & (cloud.side == sign)
    radius[cloud.source[own]] = cloud.radii[own]
    usable = first.any(axis=1) & second.any(axis=1) & (radius[vertex] > 0) & (bend < 3.0)
    usable &= creases.smoothness[vertex] > SMOOTH
    vertex, first, second, bend = vertex[usable], first[usable], second[usable], bend[usable]
    with np.errstate(over="ignore"):
        steps = np.ceil(bend * radius[vertex] / max(surface.spacing, 1e-300))
    steps = np.clip(steps, 1, MOST_BALLS).astype(np.int64)
    pair = np.repeat(np.arange(len(vertex)), steps + 1)
    turn = np.arange(len(pair)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    part, angle = turn / steps[pair], bend[pair]
    weights = np.sin((1.0 - part) * angle)[:, None], np.sin(part * angle)[:, None]
    directions = (weights[0] * first[pair] + weights[1] * second[pair]) / np.sin(angle)[:, None]
    return vertex[pair], directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _balls(
    walls: Walls,
    sources: NDArray[np.int32],
    directions: FloatArray,
    sign: int,
    options: ShrinkOptions,
    progress: Progress,
) -> MedialCloud:
    """Return the balls of some samples with outward normals of their own."""
    shape, count = walls.shape, len(sources)
    place = walls.tree.place
    order = np.argsort(place[sources], kind="stable")  # neighbours share what they find
    sources, directions = sources[order], directions[order]
    run = shrink_options(shape.diagonal, options.tolerance, options.largest_radius)
    arrays, tangents = blank_balls(count), (place[sources], directions)

    def work(begin: int, end: int) -> None:
        run.run(walls.tree, begin, end, sign, arrays, tangents)

    run_chunks(work, count, SAMPLES_A_CHUNK, progress=progress)
    balls = run.to_cloud(shape, walls.tree, arrays, sources, np.full(count, sign, np.int8))
    balls = walls.constrain(balls, options.tolerance, progress, directions=sign * directions)
    at_own = balls.radii <= options.tolerance * shape.diagonal
    outside = ((balls.contacts - balls.centers) * balls.contact_normals).sum(axis=1) * sign < 0
    return balls.subset(balls.valid & ~at_own & ~outside)  # in folds a direction may look outward
