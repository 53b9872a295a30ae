"""Operations on clouds: manifolds, remove_outliers, smooth (thesis 4.2).

The manifolds of a noisy cloud; a cloud without the points that lie in no manifold (thesis 4.2.4.2);
a shape without the noise of its points, none of which goes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask
from medialis.base.kept import kept
from medialis.base.options import Options, changed, choice, flag, length, with_unit
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.clouds.lines import on_lines
from medialis.clouds.manifolds import (
    ManifoldSet,
    ManifoldsOptions,
    PointClass,
    different_rows,
    manifold_surfaces,
    manifolds,
    scatter_of,
)
from medialis.clouds.outliers import are_sparser, isolated_points
from medialis.clouds.quadrics import on_quadrics, within_scatter
from medialis.clouds.smoothing import beside_surfaces, dense_points, jitter
from medialis.operations.declaration import Operation
from medialis.operations.positions import places
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.shape.noise import noise_level, smooth_noise
from medialis.shape.shape import Shape
from medialis.shape.surface import Surface
from medialis.skeleton.layers import computed, summary
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import Preparation

BY_MANIFOLD: dict[str, Any] = {"color_by": "manifold", "labels": ("manifold",)}
"""How layers are shown."""

MOSTLY_NOISE = 0.5  # halved 0 %, doubled 0 %
"""Share of noise above which a warning doubts the sampling: the thesis adds at most 40 % of
outliers to its clouds (4.2.4.2)."""


@dataclass(frozen=True, kw_only=True)
class ManifoldsRun(ManifoldsOptions, Preparation):
    """Options of the operation `manifolds`."""

    cloud: str = choice(
        "points",
        "Cloud",
        "Which points are segmented.",
        {
            "points": "The points of the shape.",
            "skeleton": "The points of its surface skeleton.",
        },
    )
    surfaces: bool = flag(
        False,
        "Surfaces",
        "Build triangles through the points of each manifold; holes and borders stay open.",
    )


def run_manifolds(shape: Shape, options: ManifoldsRun, progress: Progress) -> Outcome:
    """Segment the points of the shape or its skeleton."""
    if options.cloud == "skeleton":
        return _of_skeleton(shape, options, progress)
    with progress.stage("manifolds", 0.0, 1.0):
        found = manifolds.of(shape, options, progress)
    note_mostly_noise(found, progress)
    fields, own = _attributes(found), (shape.points, shape.faces)
    layer = Layer("manifolds", *own, attributes=fields, on_input=True, **BY_MANIFOLD)
    return Outcome(
        shape=shape,
        layers=(layer, *_surfaces(found, options, progress)),
        values=manifold_values(found),
        arrays={"points": places(shape.points), **manifold_arrays(found)},
        shown=(layer,),
    )


def note_mostly_noise(found: ManifoldSet, progress: Progress) -> None:
    """Warn where the answer says more of the sampling than of the shape."""
    share = float((found.point_class == PointClass.NOISE).mean())
    if share > MOSTLY_NOISE:
        text = (
            f"{100 * share:.0f} % of the points are noise: they lie on no surface, or too far "
            "apart for its curvature. Refine a coarse mesh first, or try larger angles."
        )
        progress.warn(text, "mostly_noise", share=share)


def _of_skeleton(shape: Shape, options: ManifoldsRun, progress: Progress) -> Outcome:
    cloud = computed(shape, options, progress, 0.5)
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
        filter_by="radius",
        filter_unit=FilterUnit.length(fine.diagonal),
        **BY_MANIFOLD,
    )
    return Outcome(
        shape=fine,
        layers=(layer, *_surfaces(found, options, progress)),
        values={"samples": fine.point_count, **manifold_values(found)},
        arrays={"centers": places(cloud.centers), "source": cloud.source, **manifold_arrays(found)},
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
    fields: dict[str, Any] = {"attributes": {"manifold": corners[:, 0], "source": corners[:, 1]}}
    fields |= {"face_attributes": {"manifold_of_face": owner}, **BY_MANIFOLD}
    points, triangles = found.points[corners[:, 1]], place.reshape(-1, 3).astype(np.int32)
    return (Layer("manifold_surfaces", points, triangles, **fields),)


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


MANIFOLDS = Operation(
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
    run=run_manifolds,
    order=150,
    words=("segment", "separate surfaces"),
)


@dataclass(frozen=True, kw_only=True)
class RemoveOutliersRun(ManifoldsOptions):
    """Options of the operation `remove_outliers`."""

    max_bend: float = changed(ManifoldsOptions, "max_bend", default=18.0)
    max_turn: float = changed(ManifoldsOptions, "max_turn", default=12.0)


def run_remove_outliers(shape: Shape, options: RemoveOutliersRun, progress: Progress) -> Outcome:
    """Keep points on manifolds or lines; if few are on manifolds, keep all but isolated points."""
    with progress.stage("manifolds", 0.0, 0.8):
        found = manifolds.of(shape, options, progress)
    noise = found.point_class == PointClass.NOISE
    on_surfaces = float(1 - noise.mean())
    dense = tails = np.zeros(len(noise), bool)
    lines = on_lines(shape.points, noise, progress.still)
    if on_surfaces >= 1 - MOSTLY_NOISE:
        dense, tails = _thin_parts_and_tails(shape, noise, options, progress)
    kept = ~noise | dense | tails
    with progress.stage("distances", 0.9, 1.0):
        by_surfaces = on_surfaces >= 1 - MOSTLY_NOISE and (
            bool(kept.all())
            or run_patiently(lambda: are_sparser(shape.points, kept, progress.still), progress)
        )
        if not by_surfaces:
            work = partial(isolated_points, shape.points, progress.still)
            kept = ~(noise & run_patiently(work, progress))
    lines &= ~kept
    kept |= lines
    if by_surfaces:
        _note_kept_by_surfaces(found, kept, dense, tails, progress)
    else:
        reason = (
            "points off smooth surfaces are not sparser than those on them"
            if on_surfaces >= 1 - MOSTLY_NOISE
            else f"only {100 * on_surfaces:.0f} % of the points are on smooth surfaces"
        )
        text = f"Outliers were found by the distances between points: {reason}."
        progress.note(text, "by_distances", on_surfaces=on_surfaces)
        _note_removed(int((~kept).sum()), len(kept), "isolated", progress)
    if stay := int(lines.sum()):
        text = (
            f"{counted(stay, 'point', verbs=('lies', 'lie'))} on thin lines, such as wires: kept."
        )
        progress.note(text, "lines_kept", points=stay)
    source = np.flatnonzero(kept).astype(np.int32)
    fields = {"manifold": found.labels()[kept], "source": source}
    shown: dict[str, Any] = {"attributes": fields, "role": "shape", **BY_MANIFOLD}
    clean = Layer("without_outliers", shape.points[kept], **shown)
    shown = {"color_by": "noise", "labels": ("noise",), "on_input": True}
    shown["attributes"] = {"noise": np.where(kept, -1, 0).astype(np.int32)}
    noise = Layer("noise", shape.points, shape.faces, **shown)
    return Outcome(
        shape=shape,
        layers=(clean, noise),
        values={
            "points": len(kept),
            "kept_points": int(kept.sum()),
            "removed_points": int((~kept).sum()),
            "removed_percent": 100.0 * float((~kept).mean()),
            "manifolds": found.count,
        },
        arrays={"points": places(shape.points), "kept": kept, **manifold_arrays(found)},
        shown=(clean,),
    )


def _thin_parts_and_tails(
    shape: Shape, noise: Mask, options: RemoveOutliersRun, progress: Progress
) -> tuple[Mask, Mask]:
    """Return the points of noise as dense as the surface beside them, and those in its scatter."""
    dense = dense_points(shape.points, noise, options.min_points, progress)
    scatter, tails = scatter_of(shape, options, progress), np.zeros(len(noise), bool)
    with progress.stage("tails", 0.8, 0.9):
        if scatter > 0.0:
            rows = np.flatnonzero(dense)
            dense[rows] = ~beside_surfaces(shape.points, rows, scatter, progress.still)
            tails = within_scatter(shape.points, noise & ~dense, scatter, progress.still)
    return dense, tails


def _note_kept_by_surfaces(
    found: ManifoldSet, kept: Mask, dense: Mask, tails: Mask, progress: Progress
) -> None:
    """Report how many points go, and why, and how many stay although they are on no surface."""
    rough = int((~kept & (found.patch_counts == 0)).sum())
    small = int((~kept).sum()) - rough
    reason = f"{rough} on no smooth patch, {small} on pieces smaller than min_points"
    counts = {"no_patch": rough, "small_pieces": small}
    _note_removed(int((~kept).sum()), len(kept), reason, progress, **counts)
    if stay := int(dense.sum()):
        text = (
            f"{counted(stay, 'point', verbs=('is', 'are'))} on no smooth surface, but as close "
            "together as the surface beside them: kept, as thin or sharp parts of it."
        )
        progress.note(text, "dense_kept", points=stay)
    if stay := int(tails.sum()):
        text = (
            f"{counted(stay, 'point', verbs=('is', 'are'))} on no smooth patch, but no farther "
            "off a surface than others scatter about it: kept."
        )
        progress.note(text, "tails_kept", points=stay)


def _note_removed(removed: int, total: int, reason: str, progress: Progress, **counts: int) -> None:
    """Report how many points were removed, and why."""
    text = f"Removed {counted(removed, 'point', of=total)} ({100 * removed / total:.2g} %)"
    text += f": {reason}." if removed else "."
    progress.note(text, "noise_removed", points=removed, of=total, **counts)


REMOVE_OUTLIERS = Operation(
    name="remove_outliers",
    filter_name="generate_point_cloud_without_outliers",
    label="Remove outliers",
    group="Segment",
    help="Remove the outliers of a cloud: points that are on no smooth surface.\n\n"
    "Keeps what belongs to a manifold, also where surfaces cross, and thin or sharp parts that are "
    "as dense as the surface beside them, or lie on lines (wires, bars). Where most of the "
    "cloud is not on surfaces, removes the points that are isolated. No point is moved: smooth "
    "does that.",
    source="thesis 4.2.4.2",
    examples=(("scan.ply", "the scan without the points that lie on no surface"),),
    layers={
        "without_outliers": "the points that are kept",
        "noise": "all points, with those that go marked",
    },
    options=RemoveOutliersRun,
    run=run_remove_outliers,
    order=160,
    words=("denoise", "clean point cloud"),
)


@dataclass(frozen=True, kw_only=True)
class SmoothRun(Options):
    """Options of the operation `smooth`."""

    noise: float = length(
        0.0,
        "Noise",
        "How far points lie off the surface: the standard deviation, along the normal. What bends "
        "no more than that is smoothed. 0 measures it.",
        high=0.1,
    )


def run_smooth(shape: Shape, options: SmoothRun, progress: Progress) -> Outcome:
    """Measure the noise, and move the points of a mesh or a cloud by what it is."""
    given = options.noise * shape.diagonal
    with progress.stage("noise", 0.0, 0.5):
        level = given or run_patiently(lambda: _measured(shape), progress)
    with progress.stage("smoothing", 0.5, 1.0):
        points = _smoothed(shape, level, progress)
    moved = np.linalg.norm(points - shape.points, axis=1)
    limit = with_unit(level, shape.unit)
    if level == 0.0:
        progress.note("No noise was found: no point is moved.", "no_noise")
    else:
        text = (
            f"The noise {'is taken as' if given else 'was measured as'} {limit}; points were moved "
            f"by {with_unit(math.sqrt(np.mean(moved**2)), shape.unit)} (root mean square)."
        )
        progress.note(text, "smoothed", noise=level)
    shown: dict[str, Any] = {"attributes": {"moved": moved}, "color_by": "moved", "role": "shape"}
    layer = Layer("smooth", points, shape.faces, **shown)
    return Outcome(
        shape=shape,
        layers=(layer,),
        values={
            "points": len(points),
            "noise": level,
            **summary(moved, "moved"),
            "diagonal": shape.diagonal,
            "spacing": shape.spacing,
        },
        arrays={"points": places(points), "moved": moved},
    )


def _measured(shape: Shape) -> float:
    if shape.faces is not None:
        return noise_level(shape)
    return jitter(different_rows(shape.points, shape.points.T)[0])


def _smoothed(shape: Shape, level: float, progress: Progress) -> FloatArray:
    """Return the points moved onto the smooth surface; where they are when there is no noise."""
    if level == 0.0:
        return shape.points
    if shape.faces is not None:
        return run_patiently(lambda: smooth_noise(shape, level)[0].points, progress)
    points, place = different_rows(shape.points, shape.points.T)
    if len(points) < 4:  # no plane to move them to
        return shape.points
    return on_quadrics(points, level, progress)[place]


SMOOTH = Operation(
    name="smooth",
    filter_name="generate_smooth_copy_by_noise_level",
    label="Smooth",
    group="Segment",
    help="Smooth a noisy mesh or point cloud by as much as it is noisy.\n\n"
    "The noise is measured, so that clean shapes stay as they are, and sharp edges as far as the "
    "noise allows. Points move, none goes: remove_outliers does that.",
    source=None,
    examples=(("scan.ply", "the scan with its points on the surface"),),
    layers={"smooth": "the shape with its points moved, and how far"},
    options=SmoothRun,
    run=run_smooth,
    order=165,
    words=("denoise", "noise"),
)
