"""Operation: convex and concave edges of a surface, sharp or soft, as fields (thesis 6.3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays, summary
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome
from medialis.operations.segments import EdgePreparation, computed, surface_layers
from medialis.progress import Progress
from medialis.segments.soft_edges import SoftEdgeOptions, soft_edges


@dataclass(frozen=True, kw_only=True)
class SoftEdgesRun(SoftEdgeOptions, EdgePreparation):
    """Options of the operation `soft_edges`."""


def run(shape: Shape, options: SoftEdgesRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, find the rim of the skeleton, bring it back to the surface."""
    cloud = computed(shape, options.on_side, progress)
    with progress.stage("soft edges", 0.4, 1.0):
        edges = soft_edges.of(cloud, options, progress)
    on_edge = np.isfinite(edges.radius)
    if not on_edge.any():
        progress.note(
            "No edge was found: the surface is smooth at the scale of its samples.", "no_edges"
        )
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
        arrays={
            **cloud_arrays(cloud),
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
    examples=(("creature.ply", "radius and angle of every edge, sharp or blunt"),),
    layers={
        "soft_edges": "the surface with the sharpness of its edges",
        "samples": "the same on the refined surface",
    },
    options=SoftEdgesRun,
    run=run,
    order=120,
)
