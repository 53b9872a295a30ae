"""Operation: convex and concave edges of a surface, sharp or soft, as fields (thesis 6.3.1)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from medialis.applications.soft_edges import soft_edges
from medialis.features.extended_features import extended_feature_transform
from medialis.features.point_types import is_rim
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays, summary
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.result import Outcome
from medialis.operations.segments import FINE, SEGMENT_TOLERANCE, computed, surface_layers
from medialis.progress import Progress
from medialis.surface_skeletons.ball_shrinking import Side

SIDE_OF_EDGES: dict[str, Side] = {"convex": "inner", "concave": "outer", "both": "both"}
EDGES = Parameter(
    "edges",
    Kind.CHOICE,
    "both",
    "Edges",
    "Convex edges, concave ones, or both (takes twice as long as one).",
    choices=tuple(SIDE_OF_EDGES),
)


def run(shape: Shape, parameters: Mapping[str, Any], progress: Progress) -> Outcome:
    """Refine, shrink balls, find the rim of the skeleton, bring it back to the surface."""
    side = SIDE_OF_EDGES[parameters["edges"]]
    fine, cloud = computed(shape, parameters, progress, side=side)
    with progress.stage("soft edges", 0.4, 1.0):
        sets = extended_feature_transform(fine, cloud, progress=progress)
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
            "a3_points": int(is_rim(sets).sum()),
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
    parameters=(EDGES, SEGMENT_TOLERANCE, FINE),
    run=run,
)
