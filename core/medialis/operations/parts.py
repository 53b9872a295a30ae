"""Operation: parts of a shape, as people see them, its limbs, or its sheets (thesis 6.3.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from medialis.model.shape import Shape
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import SheetPreparation, computed, segmentation_outcome
from medialis.progress import Progress
from medialis.segments.parts import PartsOptions, extent_share, parts


@dataclass(frozen=True, kw_only=True)
class PartsRun(PartsOptions, SheetPreparation):
    """Options of the operation `parts`."""


def run(shape: Shape, options: PartsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, divide."""
    cloud = computed(shape, _turning(shape, options), progress)
    with progress.stage("parts", 0.4, 1.0):
        found = parts.of(cloud, options, progress)
    outcome = segmentation_outcome("parts", shape, cloud, found, progress, method=found.method)
    if found.joins is None or found.join_levels is None:
        return outcome
    arrays = {**outcome.arrays, "joins": found.joins, "join_levels": found.join_levels}
    return replace(outcome, arrays=arrays)


def _turning(shape: Shape, options: PartsRun) -> PartsRun:
    """Measure by the box that turns with the shape, as the parts do, where no one asks for more."""
    if options.method != "auto" or shape.faces is None:
        return options
    usual, share = PartsRun(), extent_share(shape)
    if options.refine == usual.refine:
        options = replace(options, refine=min(options.refine * share, 1.0))
    if options.tolerance == usual.tolerance:
        options = replace(options, tolerance=options.tolerance * share)
    return options


OPERATION = Operation(
    name="parts",
    filter_name="compute_scalar_by_medial_parts_per_vertex",
    label="Parts",
    group="Segment",
    help="Divide a shape into parts: as people see them, by its limbs, or by its sheets.\n\n"
    "Parts are cut where a shape bends inwards or gets thinner: 500 places on the surface are put "
    "together where most people are expected to do so. Limbs are cut off where they leave the ball "
    "of a body; sheets are those of the medial surface. Small parts are merged and borders "
    "smoothed.",
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
