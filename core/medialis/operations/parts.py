"""Operation: parts of a shape, its limbs or the sheets of its skeleton (thesis 6.3.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import SheetPreparation, computed, segmentation_outcome
from medialis.progress import Progress
from medialis.segments.parts import PartsOptions, better_method, parts

FINER = 2
"""Times the samples of a curve skeleton: from there on these say first whether limbs are wanted."""


@dataclass(frozen=True, kw_only=True)
class PartsRun(PartsOptions, SheetPreparation):
    """Options of the operation `parts`."""


def run(shape: Shape, options: PartsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, find limbs or sheets, project them."""
    cloud = computed(shape, options, progress)
    with progress.stage("method", 0.4, 0.5):
        options = _decided(shape, cloud, options, progress)
    with progress.stage("parts", 0.5, 1.0):
        found = parts.of(cloud, options, progress)
    return segmentation_outcome("parts", shape, cloud, found, progress, method=found.method)


def _decided(shape: Shape, cloud: MedialCloud, options: PartsRun, progress: Progress) -> PartsRun:
    """Choose the method by the samples that a curve skeleton needs, where sheets have many more."""
    usual = Preparation().refine
    many = cloud.surface.point_count >= FINER * shape.point_count
    if options.method != "auto" or shape.faces is None or not many or options.refine >= usual:
        return options
    coarse = surface_skeleton.of(shape, replace(options, refine=usual), progress.still)
    few = FINER * coarse.surface.point_count <= cloud.surface.point_count
    if not few or not coarse.valid.any():
        return options
    return replace(options, method=better_method(coarse, options, progress))


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
