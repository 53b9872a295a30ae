"""Operation: a cloud without the points that lie in no manifold (thesis 4.2.4.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.manifold_set import PointClass
from medialis.model.shape import Shape
from medialis.operations.declaration import Operation
from medialis.operations.manifolds import (
    MAX_BEND,
    MAX_TURN,
    MIN_POINTS,
    NEIGHBOURS,
    SMOOTH,
    manifold_arrays,
    manifold_values,
    note_mostly_noise,
    segmented,
)
from medialis.operations.result import Layer, Outcome
from medialis.progress import Progress


def run(shape: Shape, parameters: Mapping[str, Any], progress: Progress) -> Outcome:
    """Keep the points that belong to a manifold."""
    with progress.stage("manifolds", 0.0, 1.0):
        found = segmented(shape.points, parameters, progress)
    kept = found.point_class != PointClass.NOISE
    if not kept.any():
        least = parameters["min_points"]
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
    parameters=(
        NEIGHBOURS,
        replace(MAX_BEND, default=18.0),
        replace(MAX_TURN, default=12.0),
        MIN_POINTS,
        SMOOTH,
    ),
    run=run,
)
