"""Operation: parts of a shape, one for each sheet of its skeleton (thesis 6.3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from medialis.applications.parts import DEFAULT_SMALLEST, DEFAULT_SMOOTHING, parts
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.result import Outcome
from medialis.operations.segments import (
    FINE,
    SEGMENT_TOLERANCE,
    TAU,
    computed,
    segmentation_outcome,
    smallest_segment,
)
from medialis.progress import Progress


def run(shape: Shape, parameters: Mapping[str, Any], progress: Progress) -> Outcome:
    """Refine, shrink balls, separate sheets, project them."""
    fine, cloud = computed(shape, parameters, progress, side="inner")
    with progress.stage("parts", 0.4, 1.0):
        found = parts(
            fine,
            cloud,
            tau=parameters["tau"],
            smallest=parameters["smallest"],
            smoothing=parameters["smoothing"],
            progress=progress,
        )
    return segmentation_outcome(
        "parts", shape, fine, found, progress, cloud_arrays(fine, cloud), {}
    )


OPERATION = Operation(
    name="parts",
    filter_name="compute_segmentation_into_parts",
    label="Parts",
    group="Segment",
    help="Divide a shape into parts, one for each sheet of its skeleton.\n\n"
    "Every vertex belongs to the sheet of the medial surface that its ball lies on. Small parts "
    "are merged and borders smoothed.",
    source="thesis 6.3.3",
    parameters=(
        smallest_segment(DEFAULT_SMALLEST, "part"),
        Parameter(
            "smoothing",
            Kind.INT,
            DEFAULT_SMOOTHING,
            "Smoothing",
            "Rounds in which every vertex takes the most common label around it.",
            low=0,
            high=100,
        ),
        TAU,
        SEGMENT_TOLERANCE,
        FINE,
    ),
    run=run,
)
