"""Operation: convex and concave edges of a surface, sharp or soft, as fields (thesis 6.3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.balls.ball_shrinking import Side
from medialis.balls.surface_skeleton import Preparation, SurfaceSkeletonOptions
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays, summary
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.result import Outcome
from medialis.operations.segments import computed, surface_layers
from medialis.options import changed, choice
from medialis.progress import Progress
from medialis.segments.soft_edges import soft_edges
from medialis.sheets.extended_features import extended_feature_transform

SIDE_OF_EDGES: dict[str, Side] = {"convex": "inner", "concave": "outer", "both": "both"}
EDGES = Parameter(
    "edges",
    Kind.CHOICE,
    "both",
    "Edges",
    "Convex edges, concave ones, or both (takes twice as long as one).",
    choices=tuple(SIDE_OF_EDGES),
)


@dataclass(frozen=True, kw_only=True)
class SoftEdgesRun(Preparation):
    """Options of the operation `soft_edges`."""

    edges: str = choice(
        "both",
        "Edges",
        "Convex edges, concave ones, or both (takes twice as long as one).",
        ("convex", "concave", "both"),
    )
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


def run(shape: Shape, options: SoftEdgesRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, find the rim of the skeleton, bring it back to the surface."""
    side = SIDE_OF_EDGES[options.edges]
    fine, cloud = computed(shape, SurfaceSkeletonOptions.taken_from(options, side=side), progress)
    with progress.stage("soft edges", 0.4, 1.0):
        sets = extended_feature_transform.of(cloud, options, progress)
        edges = soft_edges(fine, cloud, sets=sets)
    found = np.isfinite(edges.radius)
    if not found.any():
        progress.note("No edge was found: the surface is smooth at the scale of its samples.")
    fields = {
        "sharpness": edges.sharpness,
        "edge_angle": edges.angle,
        # The largest radius stands for "no edge": hosts cannot show infinity.
        "edge_radius": np.where(found, edges.radius, edges.radius[found].max(initial=0.0)),
    }
    layers = surface_layers(
        "soft_edges", shape, fine, fields, color_by="sharpness", color_limits=(0.0, 1.0)
    )
    return Outcome(
        shape=fine,
        layers=layers,
        values={
            "a3_points": int(sets.rim.sum()),
            "edge_samples": int(found.sum()),
            "samples": fine.point_count,
            **summary(edges.radius, "edge_radius"),
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={
            **cloud_arrays(fine, cloud),
            "edge_radius": edges.radius,
            "edge_angle": edges.angle,
        },
        shown=layers[-1:],
    )


OPERATION = Operation(
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
    options=SoftEdgesRun,
    run=run,
    order=120,
)
