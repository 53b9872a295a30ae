"""Operation: the curve skeleton of a mesh as a graph (thesis 3.6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.curves.from_balls.curve_skeleton import (
    CurveSkeletonResult,
    trace_curve_skeleton,
)
from medialis.errors import InvalidShapeError
from medialis.files.curve_graphs import node_attributes
from medialis.geodesics.importance import geodesic_importance
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.operations.common import (
    cloud_arrays,
    samples_layer,
)
from medialis.operations.curve_doubts import (
    note_result,
    note_shape,
    part_count,
    present,
    sheet_share,
)
from medialis.operations.declaration import Operation
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.options import length, number
from medialis.progress import Progress


@dataclass(frozen=True, kw_only=True)
class CurveSkeletonRun(Preparation):
    """Options of the operation `curve_skeleton`."""

    threshold: float = length(
        0.04,
        "Importance",
        "Branches end where the surface that hangs on them is smaller than a square "
        "with this fraction of the size as its side. Larger values remove small "
        "details.",
    )
    smoothing: float = number(
        0.7,
        "Smoothing",
        "Bends shorter than this times the radius are smoothed. 0 leaves the zigzag "
        "of the samples.",
        high=10.0,
    )
    simplify: float = length(
        0.0,
        "Simplify",
        "Leave out nodes where the branch changes by less than this fraction of the "
        "size. 0 keeps all; the topology stays the same.",
    )
    candidates: float = length(
        0.015,
        "Candidates",
        "Skeleton points are candidates when geodesics of this fraction of the size "
        "start from them to opposite sides. Smaller values find thinner limbs, and "
        "more noise.",
        low=0.0001,
        advanced=True,
    )


def traced(
    shape: Shape, options: CurveSkeletonRun, progress: Progress
) -> tuple[Shape, MedialCloud, CurveSkeletonResult]:
    """Return the shape as computed on, its balls and its curve skeleton; say what is uncertain.

    Raises
    ------
    InvalidShapeError
        For a point cloud, and for a shape without balls.
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "A curve skeleton needs a surface with faces, got a point cloud: reconstruct a surface "
            "first, or use view_curve_skeleton, which takes point clouds."
        )
    with progress.stage("skeleton", 0.0, 0.25):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    with progress.stage("importance", 0.25, 0.6):
        paths = geodesic_importance.of(cloud, options, progress)
    with progress.stage("curve skeleton", 0.6, 1.0):
        found = trace_curve_skeleton(
            fine,
            cloud,
            paths,
            threshold=options.threshold,
            candidates=options.candidates,
            smoothing=options.smoothing,
            simplify=options.simplify,
            progress=progress,
        )
    note_shape(fine, found, progress)
    note_result(found.skeleton, sheet_share(fine, cloud, found.skeleton), progress)
    return fine, cloud, found


def run(shape: Shape, options: CurveSkeletonRun, progress: Progress) -> Outcome:
    """Smooth where noisy, refine, shrink balls, trace geodesics, find the curve skeleton."""
    fine, cloud, found = traced(shape, options, progress)
    graph = found.skeleton
    sheet = sheet_share(fine, cloud, graph)
    layers = [
        Layer(
            "curve_skeleton",
            graph.nodes,
            edges=graph.edges,
            attributes=node_attributes(graph),
            color_by="radius",
            labels=("branch",),
            filter_by="importance",
            filter_unit=FilterUnit.length(fine.diagonal, "threshold", power=2.0),
        ),
        _parts_layer("curve_skeleton_parts", shape, graph),
    ]
    if len(found.candidates):
        layers.append(_candidates_layer(cloud, found))
    layers.append(samples_layer(fine))
    return Outcome(
        shape=fine,
        layers=tuple(layers),
        values=_values(fine, found, sheet),
        arrays={
            **cloud_arrays(fine, cloud),
            "tangent": found.measured.tangents,
            "candidate_measure": found.measured.measure,
            "candidates": found.candidates,
            "area_importance": found.importance,
            "nodes": graph.nodes,
            "edges": graph.edges,
            "node_radius": graph.radii,
            "node_importance": graph.importance,
            "edge_branch": graph.branch,
            "vertex_node": present(graph.vertex_node),
            "vertex_branch": present(graph.vertex_branch),
        },
        graph=graph,
    )


def _parts_layer(name: str, shape: Shape, graph: CurveSkeleton) -> Layer:
    """Layer of the surface with the branch and the node of each of its points."""
    n = shape.point_count  # a refined shape has the given points first
    branch, node = present(graph.vertex_branch)[:n], present(graph.vertex_node)[:n]
    return Layer(
        name,
        shape.points,
        shape.faces,
        attributes={"branch": branch, "node": node},
        color_by="branch",
        labels=("branch",),
        on_input=True,
    )


def _candidates_layer(cloud: MedialCloud, found: CurveSkeletonResult) -> Layer:
    rows = found.candidates
    return Layer(
        "curve_skeleton_candidates",
        cloud.centers[rows],
        attributes={
            "measure": found.measured.measure[rows],
            "importance": found.importance,
            "kept": found.kept.astype(np.int32),
            "source": cloud.source[rows],
        },
        color_by="measure",
        filter_by="importance",
        filter_unit=FilterUnit.length(cloud.surface.diagonal, "threshold", power=2.0),
        auxiliary=True,
    )


def _values(shape: Shape, found: CurveSkeletonResult, sheet: float) -> dict[str, Any]:
    graph = found.skeleton
    values: dict[str, Any] = {
        "nodes": len(graph.nodes),
        "edges": len(graph.edges),
        "branches": graph.branch_count,
        "junctions": len(graph.junctions),
        "end_points": len(graph.end_points),
        "components": graph.component_count,
        "loops": graph.loops,
    }
    if len(found.genus) == part_count(shape):
        values["expected_loops"] = sum(found.genus.values())
    values |= {
        "length": graph.length,
        "candidates": len(found.candidates),
        "kept_candidates": int(found.kept.sum()),
        "sheet_share": sheet,
        "samples": shape.point_count,
        "diagonal": shape.diagonal,
        "branch_table": [
            {
                "length": float(graph.branch_lengths[branch]),
                "tortuosity": float(graph.tortuosity[branch]),
                "mean_radius": float(graph.mean_radii[branch]),
                "nodes": [int(row[0]), int(row[-1])],
                "samples": len(graph.surface_part(branch)),
            }
            for branch, row in enumerate(graph.branches)
        ],
    }
    return values


OPERATION = Operation(
    name="curve_skeleton",
    filter_name="generate_curve_skeleton",
    label="Curve skeleton",
    group="Skeleton",
    help="Compute the curve skeleton of a mesh: a graph along the middle of its parts.\n\n"
    "It runs along the points of the surface skeleton from which geodesics start to all sides. The "
    "graph has one component for each part of the shape and one loop for each handle; it lies "
    "inside the shape. Each node has its radius, each point of the surface its branch. Needs a "
    "mesh; thin sheets have no meaningful curve skeleton.",
    source="thesis 3.6",
    options=CurveSkeletonRun,
    run=run,
    needs_faces=True,
    makes_graph=True,
    order=70,
)
