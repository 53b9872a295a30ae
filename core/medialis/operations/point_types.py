"""Operation: types of medial points, and the skeleton without its rim (thesis 6.2.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from medialis.balls.ball_shrinking import ShrinkOptions, Side
from medialis.balls.surface_skeleton import Preparation
from medialis.errors import InvalidShapeError
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays, cloud_layer, samples_layer
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import computed
from medialis.options import changed, flag
from medialis.progress import Progress
from medialis.sheets.point_types import PointType, point_types


@dataclass(frozen=True, kw_only=True)
class PointTypesRun(Preparation):
    """Options of the operation `point_types`."""

    filter_rim: bool = flag(
        False,
        "Leave out the rim",
        "Leave out points of type 1 (A3).",
    )
    side: Side = changed(ShrinkOptions, "side")


def run(shape: Shape, options: PointTypesRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, count contacts, drop the rim on request."""
    cloud = computed(shape, options, progress)
    fine = cloud.surface
    with progress.stage("point types", 0.4, 1.0):
        types = point_types.of(cloud, options, progress)
    keep = types > (PointType.A3 if options.filter_rim else PointType.NONE)
    if not keep.any():
        raise InvalidShapeError(
            "All points of the skeleton are on its rim (A3): the shape is too coarse, or smooth "
            "all round. Use a smaller refine, or filter_rim = False."
        )
    layer = cloud_layer("point_types", cloud.subset(keep), {"type": types[keep]})
    layer = replace(layer, color_limits=(float(PointType.A3), float(PointType.Y_CURVE)))
    return Outcome(
        shape=fine,
        layers=(layer, samples_layer(fine)),
        values={
            "skeleton_points": int(keep.sum()),
            "a3_points": int((types == PointType.A3).sum()),
            "sheet_points": int((types == PointType.SHEET).sum()),
            "y_points": int((types >= PointType.Y_CURVE).sum()),
            "contacts": {str(k): int(n) for k, n in enumerate(np.bincount(types)) if n},
            "samples": fine.point_count,
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(cloud), "type": types, "selected": keep},
    )


OPERATION = Operation(
    name="point_types",
    filter_name="generate_medial_point_types",
    label="Types of medial points",
    group="Skeleton",
    help="Classify the points of the surface skeleton: rim, sheet, or Y-curve.\n\n"
    "The type is the number of places where the ball of a point touches the surface: 1 on the rim "
    "of the skeleton (behind edges), 2 inside a sheet, 3 or more where sheets meet. Leaving out "
    "the rim cleans a skeleton quickly without tearing it.",
    source="thesis 6.2.1",
    examples=(("creature.ply", "rim, sheet or Y-curve, for every point of the skeleton"),),
    layers={
        "point_types": "centers of the medial balls with their type",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=PointTypesRun,
    run=run,
    order=100,
)
