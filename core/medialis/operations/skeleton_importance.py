"""Operation: surface skeleton with geodesic importance, simplified by one number (thesis 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.errors import InvalidShapeError
from medialis.kept import kept
from medialis.model.geodesic_paths import PathStatus
from medialis.model.shape import Shape
from medialis.operations.common import (
    cloud_arrays,
    cloud_layer,
    samples_layer,
    summary,
)
from medialis.operations.declaration import Operation
from medialis.operations.result import FilterUnit, Outcome
from medialis.options import changed, flag
from medialis.paths.connectivity import connected_importance
from medialis.paths.importance import (
    ImportanceOptions,
    ThresholdOptions,
    geodesic_importance,
    important_points,
    local_measures,
)
from medialis.progress import Progress, counted
from medialis.surface.cloud_surface import surface_of_cloud

SHARES = (0.005, 0.01, 0.02, 0.05)


@dataclass(frozen=True, kw_only=True)
class SkeletonImportanceRun(Preparation, ImportanceOptions):
    """Options of the operation `skeleton_importance`."""

    threshold: float = changed(ThresholdOptions, "threshold")
    connected: bool = flag(
        True,
        "In one piece",
        "Keep the skeleton in one piece at every threshold: small islands go, bridges"
        " to large ones stay.",
    )
    reconstruct: bool = flag(
        False,
        "Surface for clouds",
        "Build a surface through the points of a point cloud first; it should be closed and dense.",
    )


def run(shape: Shape, options: SkeletonImportanceRun, progress: Progress) -> Outcome:
    """Shrink balls, trace a geodesic for each, keep the important points."""
    if shape.faces is None:
        if not options.reconstruct:
            raise InvalidShapeError(
                "Geodesic importance needs a surface, and this shape is a point cloud. Use "
                "surface_skeleton, which gives spoke angle and radius, or reconstruct = True."
            )
        with progress.stage("surface", 0.0, 0.05):
            given = shape
            shape = kept(surface_of_cloud, given, None, lambda: surface_of_cloud(given), progress)
        progress.note(
            "A surface was built through the points of the cloud. Check it in the layer samples.",
            "surface_built",
        )
    with progress.stage("skeleton", 0.0, 0.2):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    with progress.stage("importance", 0.2, 0.95):
        paths = geodesic_importance.of(cloud, options, progress)
        chosen = connected_importance.of(paths, options, progress) if options.connected else paths
    importance = chosen.length
    mask = important_points.of(chosen, options, progress)
    if not mask.any():
        largest = float(np.nanmax(importance)) / fine.diagonal
        raise InvalidShapeError(
            f"No skeleton point has an importance of {options.threshold:g} of the size or "
            f"more; the largest is {largest:.3g}. Lower the threshold."
        )
    unreached = int(np.isinf(paths.length).sum())
    if unreached:
        infinite = int(np.isinf(importance).sum())  # connecting pieces changes some
        progress.note(
            f"{counted(unreached, 'skeleton point', verbs=('lies', 'lie'))} between separate parts "
            "of the shape, so that no path joins the two feature points. "
            f"{counted(infinite, 'point', verbs=('has', 'have'))} infinite importance; every "
            "threshold keeps them.",
            "between_parts",
            points=unreached,
            infinite=infinite,
        )
    around = int((paths.status == PathStatus.EDGES).sum())
    if around:
        progress.note(
            f"{counted(around, 'path', verbs=('was', 'were'))} measured along the edges, which is "
            "slightly too long: holes or non-manifold edges stop every plane cut.",
            "along_edges",
            paths=around,
        )
    shown, measures = cloud.subset(mask), local_measures(cloud)
    own = {
        "importance": importance[mask],
        "feature_radius": measures["feature_radius"][mask],
        "radius_ratio": measures["radius_ratio"][mask],
    }
    unit = FilterUnit.length(fine.diagonal, "threshold")
    layer = cloud_layer("skeleton_importance", shown, own, unit=unit)
    return Outcome(
        shape=fine,
        layers=(layer, samples_layer(fine)),
        values={
            "samples": fine.point_count,
            "skeleton_points": len(shown),
            "points_above_percent": {
                f"{100 * share:g}": int(important_points(chosen, threshold=share).sum())
                for share in SHARES
            },
            **summary(importance[mask], "importance"),
            **summary(shown.radii, "radius"),
            "between_parts": unreached,
            "along_edges": around,
            "diagonal": fine.diagonal,
        },
        arrays={
            **cloud_arrays(cloud),
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
    examples=(("creature.ply --threshold 2%", "only what is more important than 2 % of the size"),),
    layers={
        "skeleton_importance": "centers of the medial balls with their importance",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=SkeletonImportanceRun,
    run=run,
    order=20,
)
