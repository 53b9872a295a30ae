"""Operation: patches of a surface between its sharp or soft edges (thesis 6.3.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from medialis.applications.patches import DEFAULT_MIN_ANGLE, DEFAULT_SMALLEST, patches
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.result import Outcome
from medialis.operations.segments import (
    FINE,
    SEGMENT_TOLERANCE,
    computed,
    segmentation_outcome,
    smallest_segment,
)
from medialis.operations.soft_edges import EDGES, SIDE_OF_EDGES
from medialis.progress import Progress


def run(shape: Shape, parameters: Mapping[str, Any], progress: Progress) -> Outcome:
    """Refine, shrink balls on both sides, find edges, divide along them."""
    side = SIDE_OF_EDGES[parameters["edges"]]
    fine, cloud = computed(shape, parameters, progress, side=side)
    with progress.stage("patches", 0.4, 1.0):
        found = patches(
            fine,
            cloud,
            min_angle=math.radians(parameters["min_angle"]),
            smallest=parameters["smallest"],
            progress=progress,
        )
    return segmentation_outcome(
        "patches", shape, fine, found, progress, cloud_arrays(fine, cloud), {}
    )


OPERATION = Operation(
    name="patches",
    filter_name="compute_segmentation_into_patches",
    label="Patches",
    group="Segment",
    help="Divide a surface into patches along its edges, sharp or soft.\n\n"
    "Edges are where the skeleton ends. Convex edges show in the inner skeleton, concave ones in "
    "the outer one. Small patches are merged.",
    source="thesis 6.3.2",
    parameters=(
        Parameter(
            "min_angle",
            Kind.ANGLE,
            round(math.degrees(DEFAULT_MIN_ANGLE), 9),
            "Minimum angle",
            "Edges across which the surface turns by less do not separate patches.",
            low=0.0,
            high=180.0,
        ),
        smallest_segment(DEFAULT_SMALLEST, "patch"),
        EDGES,
        SEGMENT_TOLERANCE,
        FINE,
    ),
    run=run,
)
