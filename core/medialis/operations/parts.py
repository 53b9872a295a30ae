"""Operation: parts of a shape, its limbs or the sheets of its skeleton (thesis 6.3.3)."""

from __future__ import annotations

from dataclasses import dataclass

from medialis.model.shape import Shape
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import SheetPreparation, computed, segmentation_outcome
from medialis.progress import Progress
from medialis.segments.parts import PartsOptions, parts


@dataclass(frozen=True, kw_only=True)
class PartsRun(PartsOptions, SheetPreparation):
    """Options of the operation `parts`."""


def run(shape: Shape, options: PartsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, find limbs or sheets, project them."""
    cloud = computed(shape, options, progress)
    with progress.stage("parts", 0.4, 1.0):
        found = parts.of(cloud, options, progress)
    return segmentation_outcome("parts", shape, cloud, found, progress, method=found.method)


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
    examples=(("creature.ply", "body, head, limbs and tail, numbered"),),
    layers={
        "parts": "the surface with the number of the part of each vertex and face",
        "samples": "the same on the refined surface",
        "borders": "curves between the segments",
    },
    options=PartsRun,
    run=run,
    order=140,
)
