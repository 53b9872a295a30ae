"""Operation: a shape without the noise of its points, none of which goes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from medialis.clouds.smoothing import jitter, without_jitter
from medialis.model.shape import Shape
from medialis.operations.common import summary
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Outcome
from medialis.options import Options, length
from medialis.progress import Progress
from medialis.surface.noise import noise_level, smooth_noise
from medialis.threads import run_patiently
from medialis.units import with_unit
from medialis.validation import FloatArray


@dataclass(frozen=True, kw_only=True)
class SmoothRun(Options):
    """Options of the operation `smooth`."""

    noise: float = length(
        0.0,
        "Noise",
        "How far points lie off the surface: the standard deviation, along the normal. What bends "
        "no more than that is smoothed. 0 measures it.",
        high=0.1,
    )


def run(shape: Shape, options: SmoothRun, progress: Progress) -> Outcome:
    """Measure the noise, and move the points of a mesh or a cloud by what it is."""
    given = options.noise * shape.diagonal
    with progress.stage("noise", 0.0, 0.5):
        level = given or run_patiently(lambda: _measured(shape), progress)
    with progress.stage("smoothing", 0.5, 1.0):
        points = _smoothed(shape, level, progress)
    moved = np.linalg.norm(points - shape.points, axis=1)
    limit = with_unit(level, shape.unit)
    if level == 0.0:
        progress.note("No noise was found: no point is moved.", "no_noise")
    else:
        progress.note(
            f"The noise {'is taken as' if given else 'was measured as'} {limit}; points were moved "
            f"by {with_unit(math.sqrt(np.mean(moved**2)), shape.unit)} (root mean square).",
            "smoothed",
            noise=level,
        )
    return Outcome(
        shape=shape,
        layers=(
            Layer(
                "smooth",
                points,
                shape.faces,
                attributes={"moved": moved},
                color_by="moved",
                role="shape",
            ),
        ),
        values={
            "points": len(points),
            "noise": level,
            **summary(moved, "moved"),
            "diagonal": shape.diagonal,
            "spacing": shape.spacing,
        },
        arrays={"points": points, "moved": moved},
    )


def _measured(shape: Shape) -> float:
    return noise_level(shape) if shape.faces is not None else jitter(_distinct(shape)[0])


def _smoothed(shape: Shape, level: float, progress: Progress) -> FloatArray:
    """Return the points moved onto the smooth surface; where they are when there is no noise."""
    if level == 0.0:
        return shape.points
    if shape.faces is not None:
        return run_patiently(lambda: smooth_noise(shape, level)[0].points, progress)
    points, place = _distinct(shape)
    if len(points) < 4:  # no plane to move them to
        return shape.points
    return without_jitter(points, np.arange(len(points)), level, progress)[place]


def _distinct(shape: Shape) -> tuple[FloatArray, np.ndarray]:
    """Return the different points of a cloud, and which of them each point is."""
    order = np.lexsort(shape.points.T)
    new = np.ones(len(order), bool)
    new[1:] = (shape.points[order[1:]] != shape.points[order[:-1]]).any(axis=1)
    place = np.empty(len(order), np.int64)
    place[order] = np.cumsum(new) - 1
    return np.ascontiguousarray(shape.points[order[new]]), place


OPERATION = Operation(
    name="smooth",
    filter_name="generate_smooth_copy_by_noise_level",
    label="Smooth",
    group="Segment",
    help="Smooth a noisy mesh or point cloud by as much as it is noisy.\n\n"
    "The noise is measured, so that clean shapes stay as they are, and sharp edges as far as the "
    "noise allows. Points move, none goes: remove_outliers does that.",
    source=None,
    examples=(("scan.ply", "the scan with its points on the surface"),),
    layers={"smooth": "the shape with its points moved, and how far"},
    options=SmoothRun,
    run=run,
    order=165,
)
