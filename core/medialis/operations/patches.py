"""Operation: patches of a surface between its sharp or soft edges (thesis 6.3.2)."""

from __future__ import annotations

from dataclasses import dataclass

from medialis.model.shape import Shape
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import EdgePreparation, computed, segmentation_outcome
from medialis.progress import Progress
from medialis.segments.patches import PatchesOptions, patches


@dataclass(frozen=True, kw_only=True)
class PatchesRun(PatchesOptions, EdgePreparation):
    """Options of the operation `patches`."""


def run(shape: Shape, options: PatchesRun, progress: Progress) -> Outcome:
    """Refine, shrink balls on both sides, find edges, divide along them."""
    cloud = computed(shape, options.on_side, progress)
    with progress.stage("patches", 0.4, 1.0):
        found = patches.of(cloud, options, progress)
    return segmentation_outcome("patches", shape, cloud, found, progress)


OPERATION = Operation(
    name="patches",
    filter_name="compute_scalar_by_medial_patches_per_vertex",
    label="Patches",
    group="Segment",
    help="Divide a surface into patches along its edges, sharp or soft.\n\n"
    "Edges are where the skeleton ends. Convex edges show in the inner skeleton, concave ones in "
    "the outer one. Small patches are merged.",
    source="thesis 6.3.2",
    examples=(("creature.ply", "patches between the edges, numbered"),),
    layers={
        "patches": "the surface with the number of the patch of each vertex and face",
        "samples": "the same on the refined surface",
        "borders": "curves between the segments",
    },
    options=PatchesRun,
    run=run,
    order=130,
)
