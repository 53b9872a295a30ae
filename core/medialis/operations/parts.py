"""Operation: parts of a shape, its limbs or the sheets of its skeleton (thesis 6.3.3)."""

from __future__ import annotations

from dataclasses import dataclass

from medialis.balls.surface_skeleton import Preparation
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import (
    computed,
    segmentation_outcome,
)
from medialis.options import changed, choice, number, whole
from medialis.progress import Progress
from medialis.segments.parts import (
    divide_into_parts,
)
from medialis.sheets.sheets import MedialSheetOptions


@dataclass(frozen=True, kw_only=True)
class PartsRun(Preparation):
    """Options of the operation `parts`."""

    method: str = choice(
        "auto",
        "Method",
        "limbs: cut where limbs leave a body, for animals, people, tubes. sheets: one"
        " part for each sheet of the skeleton, for flat and blocky shapes. auto: "
        "limbs if some stick out of their base, else sheets.",
        ("auto", "limbs", "sheets"),
    )
    smallest: float = number(
        0.01,
        "Smallest part",
        "A part that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )
    smoothing: int = whole(
        4,
        "Smoothing",
        "Rounds in which the borders of the parts are straightened.",
        high=100,
    )
    sheet_threshold: float = changed(MedialSheetOptions, "sheet_threshold")
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


def run(shape: Shape, options: PartsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, find limbs or sheets, project them."""
    fine, cloud = computed(shape, options, progress)
    with progress.stage("parts", 0.4, 1.0):
        found, method = divide_into_parts(
            fine,
            cloud,
            method=options.method,
            sheet_threshold=options.sheet_threshold,
            smallest=options.smallest,
            smoothing=options.smoothing,
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
    options=PartsRun,
    run=run,
    order=140,
)
