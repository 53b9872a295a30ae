"""Operation: the curve skeleton of a mesh as a graph (thesis 3.6)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options
from medialis.base.progress import Progress, counted
from medialis.curves.curve_skeleton import CurveEvidence, CurveSkeleton
from medialis.curves.formats import GRAPH_FORMATS, node_attributes
from medialis.curves.from_balls import CurveSkeletonOptions, curve_skeleton_of
from medialis.operations.declaration import Operation
from medialis.operations.positions import numbers, places
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.shape.shape import Shape
from medialis.skeleton.layers import cloud_arrays, samples_layer
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import Preparation

FEW_SAMPLES = 100
"""Below which a shape is said to have few."""

SHEET_RADII = 4.0
"""A place of the surface belongs to a sheet where its ball reaches farther than four radii from the
curve skeleton: the cross-section is there more than four times as wide (2 4 r) as thick (2 r)."""

SHEET_SHARE = 0.2
"""Share of its area on sheets from which a shape is called sheet-like. Shoulder blade: 29 %; thin
plates: 57 %; rocker arm, a mechanical part with flat arms: 14 %; gears, screwdriver: below 6 %."""


@dataclass(frozen=True, kw_only=True)
class CurveSkeletonRun(CurveSkeletonOptions, Preparation):
    """Options of the operation `curve_skeleton`."""


def described(shape: Shape, options: Options, progress: Progress) -> tuple[CurveSkeleton, float]:
    """Return the curve skeleton of a mesh and its `sheet_share`; say what is uncertain.

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
    graph = curve_skeleton_of(shape, options, progress)
    cloud = graph.cloud
    assert cloud is not None
    sheet = sheet_share(cloud, graph)
    if graph.evidence is not None:
        _note_shape(cloud.surface, graph.evidence, progress)
    _note_result(graph, sheet, progress)
    return graph, sheet


def run(shape: Shape, options: CurveSkeletonRun, progress: Progress) -> Outcome:
    """Smooth where noisy, refine, shrink balls, trace geodesics, find the curve skeleton."""
    graph, sheet = described(shape, options, progress)
    cloud, evidence = graph.cloud, graph.evidence
    assert cloud is not None and evidence is not None
    return Outcome(
        shape=cloud.surface,
        layers=(
            Layer(
                "curve_skeleton",
                graph.nodes,
                edges=graph.edges,
                attributes=node_attributes(graph),
                color_by="radius",
                labels=("branch",),
                filter_by="importance",
                filter_unit=FilterUnit.length(cloud.surface.diagonal, "threshold", power=2.0),
            ),
            _parts_layer(shape, graph),
            *([_candidates_layer(cloud, evidence)] if len(evidence.candidates) else []),
            samples_layer(cloud.surface),
        ),
        values=_values(cloud.surface, graph, evidence, sheet),
        arrays={
            **cloud_arrays(cloud),
            "tangent": numbers(evidence.measured.tangents),
            "candidate_measure": evidence.measured.measure,
            "candidates": evidence.candidates,
            "area_importance": evidence.importance,
            "nodes": places(graph.nodes),
            "edges": graph.edges,
            "node_radius": graph.radii,
            "node_importance": graph.importance,
            "edge_branch": graph.branch,
            "vertex_node": np.asarray(graph.vertex_node),
            "vertex_branch": np.asarray(graph.vertex_branch),
        },
        extras={"graph": graph},
    )


def _parts_layer(shape: Shape, graph: CurveSkeleton) -> Layer:
    """Layer of the surface with the branch and the node of each of its points."""
    n = shape.point_count  # a refined shape has the given points first
    return Layer(
        "curve_skeleton_parts",
        shape.points,
        shape.faces,
        attributes={
            "branch": np.asarray(graph.vertex_branch)[:n],
            "node": np.asarray(graph.vertex_node)[:n],
        },
        color_by="branch",
        labels=("branch",),
        on_input=True,
    )


def _candidates_layer(cloud: MedialCloud, evidence: CurveEvidence) -> Layer:
    rows = evidence.candidates
    return Layer(
        "curve_skeleton_candidates",
        cloud.centers[rows],
        attributes={
            "measure": evidence.measured.measure[rows],
            "importance": evidence.importance,
            "kept": evidence.kept.astype(np.int32),
            "source": cloud.source[rows],
        },
        color_by="measure",
        filter_by="importance",
        filter_unit=FilterUnit.length(cloud.surface.diagonal, "threshold", power=2.0),
        auxiliary=True,
    )


def _values(
    surface: Shape, graph: CurveSkeleton, evidence: CurveEvidence, sheet: float
) -> dict[str, Any]:
    values: dict[str, Any] = {
        "nodes": len(graph.nodes),
        "edges": len(graph.edges),
        "branches": graph.branch_count,
        "junctions": len(graph.junctions),
        "end_points": len(graph.end_points),
        "components": graph.component_count,
        "loops": graph.loops,
    }
    values["expected_loops"] = sum(evidence.genus.values())
    values["expected_loops_certain"] = evidence.unclear == 0
    samples = np.bincount(np.asarray(graph.vertex_branch) + 1, minlength=graph.branch_count + 1)[1:]
    return values | {
        "length": graph.length,
        "candidates": len(evidence.candidates),
        "kept_candidates": int(evidence.kept.sum()),
        "sheet_share": sheet,
        "samples": surface.point_count,
        "diagonal": surface.diagonal,
        "branch_table": [
            {
                "length": float(graph.branch_lengths[branch]),
                "tortuosity": float(graph.tortuosity[branch]),
                "mean_radius": float(graph.mean_radii[branch]),
                "nodes": [int(row[0]), int(row[-1])],
                "samples": int(samples[branch]),
            }
            for branch, row in enumerate(graph.branches)
        ],
    }


def sheet_share(cloud: MedialCloud, graph: CurveSkeleton) -> float:
    """Share of the area whose balls lie far from their node, in radii of the larger of both."""
    node = np.asarray(graph.vertex_node)
    rows = np.flatnonzero(cloud.valid & (node >= 0))
    if len(rows) == 0:
        return 0.0
    area = cloud.surface.point_areas[rows]
    away = np.linalg.norm(cloud.centers[rows] - graph.nodes[node[rows]], axis=1)
    far = away + cloud.radii[rows] > SHEET_RADII * np.maximum(
        cloud.radii[rows], graph.radii[node[rows]]
    )
    return float(area[far].sum() / max(area.sum(), 1e-300))


def _note_shape(surface: Shape, evidence: CurveEvidence, progress: Progress) -> None:
    """Say what about the surface makes the result less certain."""
    if surface.point_count < FEW_SAMPLES:
        progress.note(
            f"The shape has only {counted(surface.point_count, 'sample')}; a curve skeleton needs "
            f"at least about {FEW_SAMPLES}. Refine the mesh.",
            "few_samples",
            level=logging.WARNING,
            samples=surface.point_count,
        )
    parts = surface.part_count
    if parts > 1:
        progress.note(
            f"The shape has {parts} separate parts; each has a graph of its own.",
            "separate_parts",
            parts=parts,
        )
    if evidence.seams:
        progress.note(
            f"The surface touches itself at {counted(evidence.seams, 'place')}; the "
            "handles that are counted are those of the solid inside.",
            "handles_of_solid",
            seams=evidence.seams,
        )
    if evidence.unclear:
        progress.note(
            f"At {counted(evidence.unclear, 'edge')} it is not known what is inside: a wall ends "
            "there, or the surface has only one side. The number of handles is the best guess.",
            "handles_uncertain",
            level=logging.WARNING,
            edges=evidence.unclear,
        )
    if surface.border_edges > 0:
        progress.note(
            f"The shape is open: {counted(surface.border_edges, 'edge', verbs=('lies', 'lie'))} at "
            "holes. Loops are counted as if a disc closed each hole, and the skeleton near large "
            "holes is uncertain.",
            "open_shape",
            border_edges=surface.border_edges,
        )
    for number, genus in sorted(evidence.genus.items()):
        closed = evidence.closed_loops.get(number, 0)
        if closed < genus:
            progress.note(
                f"Part {number} has {counted(genus, 'handle')}, but its graph has "
                f"{counted(closed, 'loop')}: handles are thinner than the tolerance, the surface "
                "crosses itself, or there are more than 2,048 of them.",
                "loops_missing",
                level=logging.WARNING,
                part=number,
                handles=genus,
                loops=closed,
            )


def _note_result(graph: CurveSkeleton, sheet: float, progress: Progress) -> None:
    """Say where a curve skeleton says little about the shape."""
    alone = int((graph.degrees == 0).sum())
    if alone:
        progress.note(
            f"{counted(alone, 'part', of=graph.component_count, verbs=('is', 'are'))} a single "
            "node. Round shapes have no direction, small parts lie below the threshold, and thin "
            "ones need smaller candidates.",
            "single_nodes",
            parts=alone,
            of=graph.component_count,
        )
    if sheet > SHEET_SHARE:
        progress.note(
            f"{100 * sheet:.0f} % of the surface reaches more than {SHEET_RADII:g} radii off the "
            "curve skeleton. Thin sheets have no meaningful curve skeleton (use surface_skeleton), "
            "and thin limbs need smaller candidates.",
            "thin_sheets",
            level=logging.WARNING,
            share=sheet,
        )


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
    examples=(
        ("creature.ply --formats swc,graphml", "a graph for neuron and network tools"),
        ("creature.ply -o coarse --threshold 10%", "main branches only"),
    ),
    layers={
        "curve_skeleton": "the graph as lines with radius, branch and importance",
        "curve_skeleton_parts": "the surface with the branch and the node of each vertex",
        "curve_skeleton_candidates": "the balls that the graph was chosen from",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=CurveSkeletonRun,
    run=run,
    needs_faces=True,
    formats=GRAPH_FORMATS,
    thin_lines=True,
    order=70,
)
