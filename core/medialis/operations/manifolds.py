"""Operation: the manifolds of a noisy cloud (thesis 4.2)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.clouds.manifolds import ManifoldsOptions, manifolds
from medialis.clouds.surfaces import manifold_surfaces
from medialis.kept import kept
from medialis.model.manifold_set import ManifoldSet, PointClass
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.model.surface import Surface
from medialis.operations.declaration import Operation
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.options import choice, flag
from medialis.progress import Progress

CLOUDS = ("points", "skeleton")

MOSTLY = 0.5
"""Share of noise above which a warning doubts the sampling: the thesis adds at most 40 % of
outliers to its clouds (4.2.4.2)."""


@dataclass(frozen=True, kw_only=True)
class ManifoldsRun(ManifoldsOptions, Preparation):
    """Options of the operation `manifolds`."""

    cloud: str = choice(
        "points",
        "Cloud",
        "The points of the shape, or the points of its surface skeleton.",
        CLOUDS,
    )
    surfaces: bool = flag(
        False,
        "Surfaces",
        "Build triangles through the points of each manifold; holes and borders stay open.",
    )


def run(shape: Shape, options: ManifoldsRun, progress: Progress) -> Outcome:
    """Segment the points of the shape or its skeleton."""
    if options.cloud == "skeleton":
        return _of_skeleton(shape, options, progress)
    with progress.stage("manifolds", 0.0, 1.0):
        found = manifolds.of(shape, options, progress)
    note_mostly_noise(found, progress)
    layer = Layer(
        "manifolds",
        shape.points,
        shape.faces,
        attributes=_attributes(found),
        color_by="manifold",
        labels=("manifold",),
        on_input=True,
    )
    return Outcome(
        shape=shape,
        layers=(layer, *_surfaces(found, options, progress)),
        values=manifold_values(found),
        arrays={"points": shape.points, **manifold_arrays(found)},
        shown=(layer,),
    )


def note_mostly_noise(found: ManifoldSet, progress: Progress) -> None:
    """Warn where the answer says more of the sampling than of the shape."""
    share = float((found.point_class == PointClass.NOISE).mean())
    if share > MOSTLY:
        progress.note(
            f"{100 * share:.0f} % of the points are noise: they lie on no surface, or too far "
            "apart for its curvature. Refine a coarse mesh first, or try larger angles.",
            "mostly_noise",
            level=logging.WARNING,
            share=share,
        )


def _of_skeleton(shape: Shape, options: ManifoldsRun, progress: Progress) -> Outcome:
    with progress.stage("skeleton", 0.0, 0.5):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    cloud, centers = kept(_skeleton_points, cloud, None, lambda: _skeleton_points(cloud), progress)
    with progress.stage("manifolds", 0.5, 1.0):
        found = manifolds.of(centers, options, progress)
    layer = Layer(
        "skeleton_manifolds",
        cloud.centers,
        attributes={
            **_attributes(found),
            "radius": cloud.radii,
            "feature_1": cloud.features[:, 0],
            "feature_2": cloud.features[:, 1],
        },
        color_by="manifold",
        labels=("manifold",),
        filter_by="radius",
        filter_unit=FilterUnit.length(fine.diagonal),
    )
    return Outcome(
        shape=fine,
        layers=(layer, *_surfaces(found, options, progress)),
        values={"samples": fine.point_count, **manifold_values(found)},
        arrays={"centers": cloud.centers, "source": cloud.source, **manifold_arrays(found)},
    )


def _skeleton_points(cloud: MedialCloud) -> tuple[MedialCloud, Surface]:
    valid = cloud.subset(cloud.valid)
    return valid, Surface(valid.centers)


def _surfaces(found: ManifoldSet, options: ManifoldsRun, progress: Progress) -> tuple[Layer, ...]:
    """Layer of the triangles of all manifolds, when wanted: points of several are repeated."""
    if not options.surfaces or found.count == 0:
        return ()
    faces, owner = manifold_surfaces.of(found, options, progress)
    corners, place = np.unique(
        np.stack([np.repeat(owner, 3), faces.reshape(-1)], axis=1), axis=0, return_inverse=True
    )
    layer = Layer(
        "manifold_surfaces",
        found.points[corners[:, 1]],
        place.reshape(-1, 3).astype(np.int32),
        attributes={"manifold": corners[:, 0], "source": corners[:, 1]},
        face_attributes={"manifold_of_face": owner},
        color_by="manifold",
        labels=("manifold",),
    )
    return (layer,)


def _attributes(found: ManifoldSet) -> dict[str, NDArray[Any]]:
    return {
        "manifold": found.labels(),
        "point_class": found.point_class,
        "patches": found.patch_counts,
    }


def manifold_values(found: ManifoldSet) -> dict[str, Any]:
    """Return the result values of a segmentation."""
    kinds = np.bincount(found.point_class, minlength=3)
    return {
        "points": len(found),
        "manifolds": found.count,
        "noise_points": int(kinds[PointClass.NOISE]),
        "intersection_points": int(kinds[PointClass.INTERSECTION]),
        "noise_percent": 100.0 * float(kinds[PointClass.NOISE]) / len(found),
        "patches": int(found.patch_counts.sum()),
        "largest": found.sizes[:10].tolist(),
    }


def manifold_arrays(found: ManifoldSet) -> dict[str, NDArray[Any]]:
    """Return the result arrays of a segmentation."""
    return {
        "membership_offsets": found.manifolds.offsets,
        "membership_manifolds": found.manifolds.indices,
        **_attributes(found),
    }


OPERATION = Operation(
    name="manifolds",
    filter_name="compute_scalar_by_medial_manifolds_per_vertex",
    label="Manifolds",
    group="Segment",
    help="Divide a point cloud into smooth surfaces, which may cross, and noise.\n\n"
    "Works on any cloud, without normals, and on the vertices or the skeleton of a mesh. Each "
    "point belongs to no surface (noise), to one, or to several where they cross.",
    source="thesis 4.2",
    examples=(("scan.ply", "which smooth surface each point of a scan lies on"),),
    layers={
        "manifolds": "the points with the number of their surface; -1 is noise",
        "skeleton_manifolds": "the skeleton with the number of the surface of each point",
        "manifold_surfaces": "the surfaces as triangles",
    },
    options=ManifoldsRun,
    run=run,
    order=150,
)
