"""Operation: the surface skeleton as triangles (thesis 3.4.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from medialis.balls.ball_shrinking import ShrinkOptions, Side
from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.errors import InvalidShapeError
from medialis.mesh.skeleton_mesh import (
    SkeletonMeshOptions,
    measured_importance,
    require_faces,
    skeleton_mesh,
)
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.operations.common import cloud_arrays, cloud_layer, samples_layer, summary
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Outcome
from medialis.options import changed
from medialis.progress import Progress


@dataclass(frozen=True, kw_only=True)
class SkeletonMeshRun(SkeletonMeshOptions, Preparation):
    """Options of the operation `skeleton_mesh`."""

    side: Side = changed(ShrinkOptions, "side")


def run(shape: Shape, options: SkeletonMeshRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, choose the points to keep, connect them."""
    require_faces(shape)
    with progress.stage("skeleton", 0.0, 0.5):
        cloud = surface_skeleton.of(shape, options, progress)
    measured: dict[str, NDArray[np.float64]] = {}
    if options.importance > 0:
        with progress.stage("importance", 0.5, 0.8):
            measured["importance"] = measured_importance(cloud, options, progress).length
    with progress.stage("mesh", 0.8, 1.0):
        mesh = skeleton_mesh.of(cloud, options, progress)
    fine, keep = cloud.surface, mesh.selected
    if len(mesh.faces) == 0:
        wanted = f"a spoke angle of {options.min_spoke_angle:g} degrees or more"
        advice = "Lower min_spoke_angle or smallest_piece"
        if options.importance > 0:
            wanted += f" and an importance of {options.importance:g} of the size or more"
            advice = "Lower min_spoke_angle, importance or smallest_piece"
        if keep.sum() == cloud.valid.sum():
            advice = "Lower smallest_piece, or refine so that parts have more samples"
        raise InvalidShapeError(
            f"No triangle is left: {int(keep.sum())} of {int(cloud.valid.sum())} balls have "
            f"{wanted}. {advice}."
        )
    radii = cloud.radii[mesh.rows]
    return Outcome(
        shape=fine,
        layers=(mesh_layer("skeleton_mesh", cloud, mesh, measured), samples_layer(fine)),
        values={
            "points": len(mesh.points),
            "faces": len(mesh.faces),
            "area": mesh.area,
            "pieces": mesh.part_count,
            "skeleton_points": int(cloud.valid.sum()),
            "kept_points": int(keep.sum()),
            **summary(radii, "radius"),
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={
            **cloud_arrays(cloud),
            **measured,
            "selected": keep,
            "mesh_faces": mesh.faces,
            "mesh_rows": mesh.rows,
            "mesh_face_origin": mesh.face_origin,
        },
    )


def mesh_layer(
    name: str, cloud: MedialCloud, mesh: SkeletonMesh, measured: Mapping[str, NDArray[np.float64]]
) -> Layer:
    """Layer of a skeleton mesh with what its points know from the cloud and from measures on it."""
    known = cloud_layer(name, cloud.subset(np.asarray(mesh.rows)))
    extra = {key: values[mesh.rows] for key, values in measured.items()}
    return replace(
        known, points=mesh.points, faces=mesh.faces, attributes={**known.attributes, **extra}
    )


OPERATION = Operation(
    name="skeleton_mesh",
    filter_name="generate_surface_skeleton_mesh",
    label="Surface skeleton mesh",
    group="Skeleton",
    help="Compute the surface skeleton (medial axis) of a mesh as triangles.\n\n"
    "The surface's own triangles are moved to the centers of the balls at their corners; the two "
    "sides of each sheet are merged into one. Points with a small spoke angle (bumps, noise, the "
    "rims of the sheets) are left out. Each point carries the radius of its ball, the spoke angle "
    "and its feature points.",
    source="thesis 3.4.1",
    examples=(
        ("creature.ply --importance 2%", "the skeleton as triangles, without what is unimportant"),
    ),
    layers={
        "skeleton_mesh": "the skeleton as triangles, each sheet once",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=SkeletonMeshRun,
    run=run,
    needs_faces=True,
    order=60,
)
