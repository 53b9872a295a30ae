"""Operation: parts of a shape, its limbs or the sheets of its skeleton (thesis 6.3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from medialis.applications.parts import (
    DEFAULT_SMALLEST,
    DEFAULT_SMOOTHING,
    METHODS,
    divide_into_parts,
)
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
    """Refine, shrink balls, find limbs or sheets, project them."""
    fine, cloud = computed(shape, parameters, progress, side="inner")
    with progress.stage("parts", 0.4, 1.0):
        found, method = divide_into_parts(
            fine,
            cloud,
            method=parameters["method"],
            tau=parameters["tau"],
            smallest=parameters["smallest"],
            smoothing=parameters["smoothing"],
            progress=progress,
        )
    return segmentation_outcome(
        "parts", shape, fine, found, progress, cloud_arrays(fine, cloud), {"method": method}
    )


OPERATION = Operation(
    name="parts",
    filter_name="compute_segmentation_into_parts",
    label="Parts",
    group="Segment",
    help="Divide a shape into parts: limbs and bodies, or the sheets of its skeleton.\n\n"
    "Limbs are cut off where they leave the ball of a body, by the curve skeleton. Flat and blocky "
    "shapes have a part for each sheet of the medial surface instead. Small parts are merged and "
    "borders smoothed.",
    source="thesis 6.3.3",
    parameters=(
        Parameter(
            "method",
            Kind.CHOICE,
            "auto",
            "Method",
            "limbs: cut where limbs leave a body, for animals, people, tubes. sheets: one part for "
            "each sheet of the skeleton, for flat and blocky shapes. auto: limbs if some stick out "
            "of their base, else sheets.",
            choices=METHODS,
        ),
        smallest_segment(DEFAULT_SMALLEST, "part"),
        Parameter(
            "smoothing",
            Kind.INT,
            DEFAULT_SMOOTHING,
            "Smoothing",
            "Rounds in which the borders of the parts are straightened.",
            low=0,
            high=100,
        ),
        TAU,
        SEGMENT_TOLERANCE,
        FINE,
    ),
    run=run,
)
