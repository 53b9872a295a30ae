"""Operation: patches of a surface between its sharp or soft edges (thesis 6.3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from medialis.balls.surface_skeleton import Preparation, SurfaceSkeletonOptions
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import (
    computed,
    segmentation_outcome,
)
from medialis.operations.soft_edges import SIDE_OF_EDGES
from medialis.options import angle, changed, choice, number
from medialis.progress import Progress
from medialis.segments.patches import patches


@dataclass(frozen=True, kw_only=True)
class PatchesRun(Preparation):
    """Options of the operation `patches`."""

    min_angle: float = angle(
        30.0,
        "Minimum angle",
        "Edges across which the surface turns by less do not separate patches.",
    )
    smallest: float = number(
        0.002,
        "Smallest patch",
        "A patch that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )
    edges: str = choice(
        "both",
        "Edges",
        "Convex edges, concave ones, or both (takes twice as long as one).",
        ("convex", "concave", "both"),
    )
    tolerance: float = changed(Preparation, "tolerance", advanced=True)
    refine: float = changed(
        Preparation,
        "refine",
        default=0.01,
        help="Split edges longer than this fraction of the size for the computation, so "
        "that flat faces get samples; the surface stays the same. 0 computes with the"
        " given vertices only. Sheets and edges need several samples across every "
        "face.",
    )


def run(shape: Shape, options: PatchesRun, progress: Progress) -> Outcome:
    """Refine, shrink balls on both sides, find edges, divide along them."""
    side = SIDE_OF_EDGES[options.edges]
    fine, cloud = computed(shape, SurfaceSkeletonOptions.taken_from(options, side=side), progress)
    with progress.stage("patches", 0.4, 1.0):
        found = patches(
            fine,
            cloud,
            min_angle=math.radians(options.min_angle),
            smallest=options.smallest,
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
    options=PatchesRun,
    run=run,
    order=130,
)
