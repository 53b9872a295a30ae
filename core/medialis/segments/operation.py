"""Operation: convex and concave edges of a surface, sharp or soft, as fields (thesis 6.3.1).

Operation: patches of a surface between its sharp or soft edges (thesis 6.3.2).

Operation: parts of a shape, as people see them, its limbs, or its sheets (thesis 6.3.3).

Operation: segments of a surface by mean shift of its medial cloud (thesis 5.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, file
from medialis.base.progress import Progress
from medialis.operations.declaration import Operation
from medialis.operations.positions import numbers
from medialis.operations.result import Outcome
from medialis.segments.mean_shift import MeanShiftSegmentsOptions, mean_shift_segments
from medialis.segments.parts import PartsOptions, parts
from medialis.segments.patches import PatchesOptions, SoftEdgeOptions, patches, soft_edges
from medialis.shape.shape import Shape
from medialis.skeleton.layers import (
    border_layer,
    cloud_arrays,
    computed,
    layers_of_segments,
    note_unseen,
    segmentation_outcome,
    summary,
    surface_layers,
    vertices_in_file,
)


def run_soft_edges(shape: Shape, options: SoftEdgeOptions, progress: Progress) -> Outcome:
    """Refine, shrink balls, find the rim of the skeleton, bring it back to the surface."""
    cloud = computed(shape, options, progress)
    with progress.stage("soft edges", 0.4, 1.0):
        edges = soft_edges.of(cloud, options, progress)
    on_edge = np.isfinite(edges.radius)
    if not on_edge.any():
        text = "No edge was found: the surface is smooth at the scale of its samples."
        progress.note(text, "no_edges")
    fields = {
        "sharpness": edges.sharpness,
        "edge_angle": edges.angle,
        # The largest radius stands for "no edge": hosts cannot show infinity.
        "edge_radius": np.where(on_edge, edges.radius, edges.radius[on_edge].max(initial=0.0)),
    }
    fine = cloud.surface
    layers = surface_layers(
        "soft_edges", shape, fine, fields, color_by="sharpness", color_limits=(0.0, 1.0)
    )
    return Outcome(
        shape=fine,
        layers=layers,
        values={
            "a3_points": int(edges.rim.sum()),
            "edge_samples": int(on_edge.sum()),
            "samples": fine.point_count,
            **summary(edges.radius, "edge_radius"),
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(cloud), "edge_radius": edges.radius, "edge_angle": edges.angle},
        shown=layers[-1:],
    )


SOFT_EDGES = Operation(
    name="soft_edges",
    filter_name="compute_scalar_by_medial_edge_sharpness_per_vertex",
    label="Soft edges",
    group="Segment",
    help="Find the edges of a surface, sharp or blunt, with no scale to choose.\n\n"
    "Edges are where the skeleton ends. Each vertex on an edge has the radius of the smallest ball "
    "there (how blunt the edge is), the angle by which the surface turns across it, and the "
    "sharpness: this angle as a share of a right angle. Vertices off all edges have the sharpness "
    "0 and the largest radius.",
    source="thesis 6.3.1",
    examples=(("creature.ply", "radius and angle of every edge, sharp or blunt"),),
    layers={
        "soft_edges": "the surface with the sharpness of its edges",
        "samples": "the same on the refined surface",
    },
    options=SoftEdgeOptions,
    run=run_soft_edges,
    order=120,
    words=("sharp edges", "creases", "ridges"),
)


def run_patches(shape: Shape, options: PatchesOptions, progress: Progress) -> Outcome:
    """Refine, shrink balls on both sides, find edges, divide along them."""
    cloud = computed(shape, options, progress)
    with progress.stage("patches", 0.4, 1.0):
        found = patches.of(cloud, options, progress)
    return segmentation_outcome("patches", shape, cloud, found, progress)


PATCHES = Operation(
    name="patches",
    filter_name="compute_scalar_by_medial_patches_per_vertex",
    label="Patches",
    group="Segment",
    help="Divide a surface into patches along its edges, sharp or soft.\n\n"
    "Edges are where the skeleton ends. Convex edges show in the inner skeleton, concave ones in "
    "the outer one. Small patches are merged.",
    source="thesis 6.3.2",
    examples=(("creature.ply", "patches between the edges, numbered"),),
    layers=layers_of_segments("patches", "patch of each vertex and face"),
    options=PatchesOptions,
    run=run_patches,
    order=130,
    words=("segment", "faces between edges"),
)


def run_parts(shape: Shape, options: PartsOptions, progress: Progress) -> Outcome:
    """Refine, shrink balls, divide."""
    cloud = computed(shape, options, progress)
    with progress.stage("parts", 0.4, 1.0):
        found = parts.of(cloud, options, progress)
    outcome = segmentation_outcome("parts", shape, cloud, found, progress, method=found.method)
    if found.joins is None or found.join_levels is None:
        return outcome
    arrays = {**outcome.arrays, "joins": found.joins, "join_levels": found.join_levels}
    return replace(outcome, arrays=arrays)


PARTS = Operation(
    name="parts",
    filter_name="compute_scalar_by_medial_parts_per_vertex",
    label="Parts",
    group="Segment",
    help="Divide a shape into parts: as people see them, by its limbs, or by its sheets.\n\n"
    "Parts are cut where a shape bends inwards or gets thinner: 500 places on the surface are put "
    "together where most people are expected to do so. Limbs are cut off where they leave the ball "
    "of a body; sheets are those of the medial surface. Small parts are merged and borders "
    "smoothed.",
    source="thesis 6.3.3",
    examples=(("creature.ply", "body, head, limbs and tail, numbered"),),
    layers=layers_of_segments("parts", "part of each vertex and face"),
    options=PartsOptions,
    run=run_parts,
    order=140,
    words=("segment", "split into parts", "limbs"),
)

_LINES = "Text file with a vertex number, or the x y z of a point near a vertex, in each line: "


@dataclass(frozen=True, kw_only=True)
class SeedFiles(Options):
    """Files of points that a user picked."""

    add_seeds: str = file("Add seeds", _LINES + "each is a seed.", selection="each")
    remove_seeds: str = file(
        "Remove seeds", _LINES + "seeds within the search radius of it are none."
    )


@dataclass(frozen=True, kw_only=True)
class MeanShiftSegmentsRun(MeanShiftSegmentsOptions, SeedFiles):
    """Options of the operation `mean_shift_segments`."""


def run_mean_shift_segments(
    shape: Shape, options: MeanShiftSegmentsRun, progress: Progress
) -> Outcome:
    """Refine, shrink balls, shift seeds, carry the clusters to the surface."""
    add, remove = (
        vertices_in_file(path, shape, "no seed")
        for path in (options.add_seeds, options.remove_seeds)
    )
    picked = MeanShiftSegmentsOptions.taken_from(options, add=add, remove=remove)
    cloud = computed(shape, options, progress)
    with progress.stage("segments", 0.4, 1.0):
        segments = mean_shift_segments.of(cloud, picked, progress)
    if segments.count == 0:
        raise InvalidShapeError(
            "No sample got a segment: try a larger search radius or more last steps."
        )
    fine, fields = cloud.surface, {"segment": segments.labels}
    shown: dict[str, Any] = {"color_by": "segment", "labels": ("segment",)}
    layers = surface_layers("mean_shift_segments", shape, fine, fields, **shown)
    note_unseen(layers[0], "segment", segments.count, progress)
    return Outcome(
        shape=fine,
        layers=(*layers, *border_layer(segments)),
        values={
            "samples": fine.point_count,
            "segments": segments.count,
            "unassigned_samples": int((segments.labels < 0).sum()),
            "areas": numbers(segments.areas.tolist()),
        },
        arrays={**cloud_arrays(cloud), **fields},
        shown=layers[-1:],
    )


MEAN_SHIFT_SEGMENTS = Operation(
    name="mean_shift_segments",
    filter_name="compute_scalar_by_medial_bumps_per_vertex",
    label="Bump segments",
    group="Segment",
    help="Segment a surface into its convex bumps, such as the teeth of a dental cast.\n\n"
    "Bumps are where the medial cloud is dense: seeds are shifted to the densest places, and "
    "the samples along their path are their segment.",
    source="thesis 5.3",
    examples=(("teeth.ply --search-radius 5%", "one segment for each tooth"),),
    layers=layers_of_segments("mean_shift_segments", "segment of each vertex"),
    options=MeanShiftSegmentsRun,
    run=run_mean_shift_segments,
    order=170,
    words=("segment", "teeth", "bumps"),
)
