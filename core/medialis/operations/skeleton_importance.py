"""Operation: surface skeleton with geodesic importance, simplified by one number (thesis 3.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.geodesic_paths import PathStatus
from medialis.model.shape import Shape
from medialis.operations.common import (
    REFINE,
    TOLERANCE,
    cloud_arrays,
    cloud_layer,
    maximal_balls,
    refined,
    samples_layer,
    summary,
)
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.result import Outcome
from medialis.progress import Progress
from medialis.regularization.connectivity import connected_importance
from medialis.regularization.geodesics import DEFAULT_DIRECTIONS
from medialis.regularization.importance import (
    geodesic_importance,
    important_points,
    local_measures,
)
from medialis.shape.cloud_surface import surface_of_cloud

SHARES = (0.005, 0.01, 0.02, 0.05)

DIRECTIONS = Parameter(
    "directions",
    Kind.INT,
    DEFAULT_DIRECTIONS,
    "Directions",
    "Directions in which each geodesic is tried. More find shorter paths in strongly folded places "
    "and take longer.",
    low=2,
    high=1000,
    advanced=True,
)


def run(shape: Shape, parameters: Mapping[str, Any], progress: Progress) -> Outcome:
    """Shrink balls, trace a geodesic for each, keep the important points."""
    if shape.faces is None:
        if not parameters["reconstruct"]:
            raise InvalidShapeError(
                "Geodesic importance needs a surface, and this shape is a point cloud. Use "
                "surface_skeleton, which gives spoke angle and radius, or reconstruct = True."
            )
        with progress.stage("surface", 0.0, 0.05):
            shape = surface_of_cloud(shape)
        progress.note("A surface was built through the points of the cloud: look at samples.ply.")
    fine = refined(shape, parameters["refine"], progress)
    with progress.stage("skeleton", 0.1, 0.2):
        cloud = maximal_balls(fine, parameters["tolerance"], progress)
    with progress.stage("importance", 0.2, 0.95):
        paths = geodesic_importance(
            fine, cloud, directions=parameters["directions"], progress=progress
        )
        importance = paths.length
        if parameters["connected"]:
            importance = connected_importance(fine, cloud, importance)
    mask = important_points(fine, importance, parameters["threshold"])
    if not mask.any():
        largest = float(np.nanmax(importance)) / fine.diagonal
        raise InvalidShapeError(
            f"No skeleton point has an importance of {parameters['threshold']:g} of the size or "
            f"more; the largest is {largest:.3g}. Lower the threshold."
        )
    unreached = int(np.isinf(paths.length).sum())
    if unreached:
        infinite = int(np.isinf(importance).sum())  # connecting pieces changes some
        progress.note(
            f"{unreached} skeleton points lie between different parts of the shape: no geodesic "
            f"joins their feature points. {infinite} points have an infinite importance and are "
            "kept by any threshold."
        )
    around = int((paths.status == PathStatus.EDGES).sum())
    if around:
        progress.note(
            f"{around} geodesics were measured along the edges, slightly too long: holes or "
            "non-manifold edges stop every plane cut."
        )
    shown = cloud.subset(mask)
    measures = local_measures(fine, cloud)
    own = {
        "importance": importance[mask],
        "feature_radius": measures["feature_radius"][mask],
        "radius_ratio": measures["radius_ratio"][mask],
    }
    layer = cloud_layer("skeleton_importance", shown, own)
    return Outcome(
        shape=fine,
        layers=(layer, samples_layer(fine)),
        values={
            "samples": fine.point_count,
            "skeleton_points": len(shown),
            "points_above_percent": {
                f"{100 * share:g}": int(important_points(fine, importance, share).sum())
                for share in SHARES
            },
            **summary(importance[mask], "importance"),
            **summary(shown.radii, "radius"),
            "between_parts": unreached,
            "along_edges": around,
            "diagonal": fine.diagonal,
        },
        arrays={
            **cloud_arrays(fine, cloud),
            **measures,
            "importance": importance,
            "geodesic_length": paths.length,
            "start_tangent": paths.start_tangent,
            "end_tangent": paths.end_tangent,
            "path_status": paths.status,
            "selected": mask,
        },
    )


OPERATION = Operation(
    name="skeleton_importance",
    filter_name="generate_surface_skeleton_with_importance",
    label="Skeleton with importance",
    group="Skeleton",
    help="Compute the surface skeleton with geodesic importance, and simplify it by one number.\n\n"
    "The importance of a skeleton point is the length of the shortest path over the surface "
    "between its two feature points. It grows from the border of the skeleton inwards, so a "
    "threshold removes what bumps and noise made and leaves the rest in one piece. Spoke angle, "
    "radius, feature radius and radius ratio come along for comparison. Needs a mesh.",
    source="thesis 3.3",
    parameters=(
        Parameter(
            "threshold",
            Kind.LENGTH,
            0.0,
            "Importance",
            "Keep the points whose importance is at least this fraction of the size. 0 keeps all; "
            "0.01 to 0.05 removes noise and small details.",
            low=0.0,
            high=10.0,
        ),
        Parameter(
            "connected",
            Kind.BOOL,
            True,
            "In one piece",
            "Keep the skeleton in one piece at every threshold: small islands go, bridges to large "
            "ones stay.",
        ),
        Parameter(
            "reconstruct",
            Kind.BOOL,
            False,
            "Surface for clouds",
            "Build a surface through the points of a point cloud first; it should be closed and "
            "dense.",
        ),
        TOLERANCE,
        REFINE,
        DIRECTIONS,
    ),
    run=run,
)
