"""Operation: surface skeleton by ball shrinking, with importance (thesis 3.2 and 3.3).

Operation: the surface skeleton as triangles (thesis 3.4.1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.options import changed, flag, length
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray
from medialis.operations.declaration import Operation, Selection
from medialis.operations.result import FilterUnit, Layer, Outcome, Result
from medialis.shape.shape import Shape
from medialis.skeleton.ball_shrinking import ShrinkOptions, Side
from medialis.skeleton.importance.importance import connected_importance, geodesic_importance
from medialis.skeleton.layers import cloud_arrays, cloud_layer, samples_layer, summary
from medialis.skeleton.medial_cloud import BallStatus, MedialCloud
from medialis.skeleton.skeleton_mesh import (
    SkeletonMesh,
    SkeletonMeshOptions,
    measured_importance,
    require_faces,
    skeleton_mesh,
)
from medialis.skeleton.surface_skeleton import (
    Preparation,
    SurfaceSkeletonOptions,
    surface_skeleton,
    uniform_subsample,
)

HIDDEN_BELOW = 0.03
"""Fraction of the diagonal, chosen by looking at bunny, cow, horse, hand, fandisk and armadillo:
0.02 leaves fuzz in the bunny's back and the armadillo's head, 0.05 takes the cow's horns and the
horse's feet. A limb's importance is half its girth, so thin limbs need less: see `_shown_from`."""

ROUND, LIMBS_SHOWN = 2.8, 0.9
"""A path of this many radii runs nearly half round its ball (pi), as in limbs and behind walls and
not on bumps. Of the surface behind such balls this share stays shown by default."""

SHOWN_SHARE = 99.0
"""Per cent of the points that the colours span, from the least important up."""


@dataclass(frozen=True, kw_only=True)
class SurfaceSkeletonRun(Preparation):
    """Options of the operation `surface_skeleton`."""

    side: Side = changed(ShrinkOptions, "side")
    importance: bool = flag(
        True,
        "Importance",
        "Measure the importance of each point: the length of the shortest path over the surface "
        "between its two feature points. Meshes only, and the inner side.",
    )
    threshold: float = length(
        HIDDEN_BELOW,
        "Hide below",
        "Hide the points whose importance is below this share of the size: those of bumps and "
        "noise. They stay in the data; 0 shows all. The default is lower on shapes with thin "
        "limbs.",
        high=10.0,
    )
    subsample: float = length(
        0.0,
        "Point distance",
        "Thin the skeleton so that its points are at least this share of the size "
        "apart. 0 keeps all.",
    )
    largest_radius: float = changed(ShrinkOptions, "largest_radius")
    fans: bool = changed(SurfaceSkeletonOptions, "fans", default=True)


def run_surface_skeleton(shape: Shape, options: SurfaceSkeletonRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, measure their importance, thin the cloud if asked to."""
    with progress.stage("skeleton", 0.0, 0.3):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    importance = None
    if options.importance and fine.faces is not None and options.side == "inner":
        with progress.stage("importance", 0.3, 0.95):
            importance = _importance(cloud, options, progress)
    with progress.stage("subsample", 0.95, 1.0):
        mask = uniform_subsample(cloud, options.subsample)
    shown = cloud.subset(mask)
    values: dict[str, Any] = {
        "samples": fine.point_count,
        "skeleton_points": len(shown),
        "open_balls": int((cloud.status == BallStatus.OPEN).sum()),
        "without_normal": int((cloud.status == BallStatus.NO_NORMAL).sum()),
        **summary(shown.radii, "radius"),
        **summary(shown.spoke_angles, "spoke_angle"),
        "diagonal": fine.diagonal,
        "spacing": fine.spacing,
    }
    arrays = {**cloud_arrays(cloud), "selected": mask}
    layer = cloud_layer("surface_skeleton", shown)
    if importance is not None:
        layer = _measured(shown, importance[mask], options, progress)
        values |= {
            "hidden_points": int(layer.hidden.sum()),
            **summary(importance[mask], "importance"),
        }
        arrays["importance"] = importance
    return Outcome(shape=fine, layers=(layer, samples_layer(fine)), values=values, arrays=arrays)


def _importance(cloud: MedialCloud, options: SurfaceSkeletonRun, progress: Progress) -> FloatArray:
    """Return the importance of each ball; that of fans does not change that of the samples."""
    paths = geodesic_importance.of(cloud.own, options, progress)
    lengths = connected_importance.of(paths, options, progress).length
    if len(cloud) == len(lengths):
        return lengths
    fans = cloud.subset(np.arange(len(lengths), len(cloud)))
    return np.concatenate([lengths, geodesic_importance.of(fans, options, progress).length])


def _measured(
    cloud: MedialCloud, importance: FloatArray, options: SurfaceSkeletonRun, progress: Progress
) -> Layer:
    """Layer of a cloud with importance, its unimportant points hidden; not if that were all."""
    diagonal, threshold = cloud.surface.diagonal, options.threshold
    if threshold == HIDDEN_BELOW:  # a value of the user's own stays
        threshold = _shown_from(cloud, importance)
    layer = cloud_layer(
        "surface_skeleton",
        cloud,
        {"importance": importance},
        unit=FilterUnit.length(diagonal, "threshold"),
        hidden_below=threshold,
    )
    # A few points are far more important than the rest, which would all have one colour.
    finite = importance[np.isfinite(importance)]
    if len(finite):
        layer = replace(layer, color_limits=(None, float(np.percentile(finite, SHOWN_SHARE))))
    hidden = int(layer.hidden.sum())
    if hidden == len(cloud):
        layer, hidden = replace(layer, filter_default=0.0), 0
    if hidden:
        progress.note(
            f"{counted(hidden, 'skeleton point', of=len(cloud), verbs=('is', 'are'))} hidden: the "
            f"importance is below {100 * threshold:.3g} % of the size, as it is for bumps and "
            "noise (threshold = 0 shows all).",
            "hidden_points",
            hidden=hidden,
            points=len(cloud),
            threshold=threshold,
        )
    return layer


def _shown_from(cloud: MedialCloud, importance: FloatArray) -> float:
    """Return the default threshold, less where it would hide limbs: a fraction of the diagonal."""
    limbs = np.isfinite(importance) & (importance >= ROUND * cloud.radii)
    if not limbs.any():
        return HIDDEN_BELOW
    rising = np.flatnonzero(limbs)[np.argsort(importance[limbs], kind="stable")]
    area = np.cumsum(cloud.surface.point_areas[cloud.source[rising]])
    first = rising[np.searchsorted(area, (1.0 - LIMBS_SHOWN) * area[-1])]
    return min(HIDDEN_BELOW, float(importance[first]) / cloud.surface.diagonal)


def _important(result: Result, shape: Shape) -> NDArray[np.bool_]:
    """Which vertices have a skeleton point that is shown."""
    layer = result.layers[0]
    samples = layer.attributes["source"][~layer.hidden]
    chosen = np.zeros(shape.point_count, bool)  # a refined shape has the given points first
    chosen[samples[samples < len(chosen)]] = True
    return chosen


SURFACE_SKELETON = Operation(
    name="surface_skeleton",
    filter_name="generate_surface_skeleton",
    label="Surface skeleton",
    group="Skeleton",
    help="Compute the surface skeleton (medial axis) of a shape as a cloud of maximal balls.\n\n"
    "Every sample of the surface gets the largest ball that touches the surface there and lies "
    "inside the shape. Each skeleton point carries the radius of its ball (local thickness), the "
    "spoke angle between its two feature points, and the feature points themselves. On a mesh it "
    "carries its importance as well, and what bumps and noise make is hidden. Works on meshes, "
    "also open or non-manifold ones, and on point clouds.",
    source="thesis 3.2, 3.3",
    examples=(
        ("creature.ply", "centers and radii of all medial balls"),
        ("creature.ply -o fine --threshold 0.5% --subsample 1%", "more detail, evenly thinned"),
    ),
    layers={
        "surface_skeleton": "centers of the medial balls with radius, spoke angle, feature points "
        "and importance",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=SurfaceSkeletonRun,
    run=run_surface_skeleton,
    selection=Selection(
        "compute_selection_by_medial_importance_per_vertex",
        "Select the vertices whose skeleton point is more important than a length: all but bumps "
        "and noise.",
        _important,
    ),
    order=10,
)


@dataclass(frozen=True, kw_only=True)
class SkeletonMeshRun(SkeletonMeshOptions, Preparation):
    """Options of the operation `skeleton_mesh`."""

    side: Side = changed(ShrinkOptions, "side")


def run_skeleton_mesh(shape: Shape, options: SkeletonMeshRun, progress: Progress) -> Outcome:
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


SKELETON_MESH = Operation(
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
    run=run_skeleton_mesh,
    needs_faces=True,
    order=60,
)
