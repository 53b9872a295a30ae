"""Operation: a cloud without the points that lie in no manifold (thesis 4.2.4.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.manifold_set import PointClass
from medialis.model.shape import Shape
from medialis.operations.declaration import Operation
from medialis.operations.manifolds import (
    manifold_arrays,
    manifold_values,
    note_mostly_noise,
    segmented,
)
from medialis.operations.result import Layer, Outcome
from medialis.options import Options, angle, flag, whole
from medialis.progress import Progress


@dataclass(frozen=True, kw_only=True)
class DenoiseRun(Options):
    """Options of the operation `denoise`."""

    neighbours: int = whole(
        10,
        "Neighbours",
        "Nearest points that tell whether a point is flat.",
        low=4,
        high=20,
    )
    max_bend: float = angle(
        18.0,
        "Largest bend",
        "Triangles of a flat patch differ by at most this angle. Larger ones allow more curvature.",
        low=0.1,
        high=90.0,
    )
    max_turn: float = angle(
        12.0,
        "Largest turn",
        "Patches of neighbouring points are joined up to this angle. Larger ones give"
        " fewer manifolds.",
        low=0.1,
        high=90.0,
    )
    min_points: int = whole(
        20,
        "Smallest manifold",
        "What has fewer flat points is noise.",
        low=1,
        high=1000000,
    )
    smooth: bool = flag(
        True,
        "Smooth if noisy",
        "Classify a cloud that scatters about its surfaces by smoothed positions. "
        "Points stay where they are.",
        advanced=True,
    )


def run(shape: Shape, options: DenoiseRun, progress: Progress) -> Outcome:
    """Keep the points that belong to a manifold."""
    with progress.stage("manifolds", 0.0, 1.0):
        found = segmented(shape.points, options, progress)
    kept = found.point_class != PointClass.NOISE
    if not kept.any():
        least = options.min_points
        advice = "Try larger angles or more neighbours."
        if shape.point_count < least:
            advice = f"A surface needs {least} points or more (min_points): give more, or lower it."
        raise InvalidShapeError(
            f"None of the {shape.point_count} points lies on a smooth surface: nothing is left. "
            + advice
        )
    progress.note(f"{int((~kept).sum())} of {len(kept)} points are noise.")
    note_mostly_noise(found, progress)
    clean = Layer(
        "denoised",
        shape.points[kept],
        attributes={
            "manifold": found.labels()[kept],
            "source": np.flatnonzero(kept).astype(np.int32),
        },
        color_by="manifold",
        labels=("manifold",),
    )
    noise = Layer(
        "noise",
        shape.points,
        shape.faces,
        attributes={"noise": np.where(kept, -1, 0).astype(np.int32)},
        color_by="noise",
        labels=("noise",),
        on_input=True,
    )
    return Outcome(
        shape=shape,
        layers=(clean, noise),
        values={"kept_points": int(kept.sum()), **manifold_values(found)},
        arrays={"points": shape.points, "kept": kept, **manifold_arrays(found)},
        shown=(clean,),
    )


OPERATION = Operation(
    name="denoise",
    filter_name="generate_denoised_point_cloud_by_manifolds",
    label="Denoise",
    group="Segment",
    help="Remove the points of a cloud that lie on no smooth surface.\n\n"
    "Keeps what belongs to a manifold, also where surfaces cross. No point is moved.",
    source="thesis 4.2.4.2",
    options=DenoiseRun,
    run=run,
    order=160,
)
