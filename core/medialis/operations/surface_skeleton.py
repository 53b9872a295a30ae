"""Operation: surface skeleton by ball shrinking (thesis 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

from medialis.balls.ball_shrinking import ShrinkOptions, Side
from medialis.balls.subsampling import uniform_subsample
from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.model.medial_cloud import BallStatus
from medialis.model.shape import Shape
from medialis.operations.common import (
    cloud_arrays,
    cloud_layer,
    samples_layer,
    summary,
)
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.options import changed, length
from medialis.progress import Progress


@dataclass(frozen=True, kw_only=True)
class SurfaceSkeletonRun(Preparation):
    """Options of the operation `surface_skeleton`."""

    side: Side = changed(ShrinkOptions, "side")
    subsample: float = length(
        0.0,
        "Point distance",
        "Thin the skeleton so that its points are at least this fraction of the size "
        "apart. 0 keeps all.",
    )
    largest_radius: float = length(
        1.0,
        "Largest radius",
        "A ball that meets no second sample within this fraction of the size is "
        "masked. Balls inside a closed shape never get this large.",
        low=1e-06,
        high=10.0,
        advanced=True,
    )


def run(shape: Shape, options: SurfaceSkeletonRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, thin the cloud if asked to."""
    with progress.stage("skeleton", 0.0, 0.95):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    with progress.stage("subsample", 0.95, 1.0):
        mask = uniform_subsample(cloud, options.subsample * fine.diagonal)
    shown = cloud.subset(mask)
    return Outcome(
        shape=fine,
        layers=(cloud_layer("surface_skeleton", shown), samples_layer(fine)),
        values={
            "samples": fine.point_count,
            "skeleton_points": len(shown),
            "open_balls": int((cloud.status == BallStatus.OPEN).sum()),
            "without_normal": int((cloud.status == BallStatus.NO_NORMAL).sum()),
            **summary(shown.radii, "radius"),
            **summary(shown.spoke_angles, "spoke_angle"),
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(fine, cloud), "selected": mask},
    )


OPERATION = Operation(
    name="surface_skeleton",
    filter_name="generate_surface_skeleton",
    label="Surface skeleton",
    group="Skeleton",
    help="Compute the surface skeleton (medial axis) of a shape as a cloud of maximal balls.\n\n"
    "Every sample of the surface gets the largest ball that touches the surface there and lies "
    "inside the shape. Each skeleton point carries the radius of its ball (local thickness), the "
    "spoke angle between its two feature points, and the feature points themselves. Works on "
    "meshes, also open or non-manifold ones, and on point clouds.",
    source="thesis 3.2",
    options=SurfaceSkeletonRun,
    run=run,
    order=10,
)
