"""What makes a curve skeleton less certain, or a poor description, in sentences (thesis 3.6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.curves.from_balls.curve_skeleton import CurveSkeletonResult
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.progress import Progress

FEW_SAMPLES = 100

FAR, SHEET_SHARE = 3.0, 0.2
"""A place of the surface belongs to a sheet where its ball lies more than three radii off the curve
skeleton: the cross-section is there more than four times as wide (2 (3 + 1) r) as thick (2 r). A
shape is called sheet-like where that is a fifth of its area. Shoulder blade: 29 %; thin plates: 57
%; rocker arm, a mechanical part with flat arms: 14 %; gears, a screwdriver: below 6 %."""


def present(values: NDArray[np.int32] | None) -> NDArray[np.int32]:
    """Return an array, empty for None."""
    return np.empty(0, np.int32) if values is None else values


def part_count(shape: Shape) -> int:
    """Count the components that have faces."""
    return 0 if shape.faces is None else len(np.unique(shape.components[shape.faces[:, 0]]))


def sheet_share(shape: Shape, cloud: MedialCloud, graph: CurveSkeleton) -> float:
    """Share of the area whose balls lie far from their node, in radii of the larger of both."""
    node = present(graph.vertex_node)
    rows = np.flatnonzero(cloud.valid & (node >= 0))
    if len(rows) == 0:
        return 0.0
    area = shape.point_areas
    away = np.linalg.norm(cloud.centers[rows] - graph.nodes[node[rows]], axis=1)
    far = away > FAR * np.maximum(cloud.radii[rows], graph.radii[node[rows]])
    return float(area[rows[far]].sum() / max(area[rows].sum(), 1e-300))


def note_shape(shape: Shape, found: CurveSkeletonResult, progress: Progress) -> None:
    """Say what about the shape makes the result less certain."""
    if shape.point_count < FEW_SAMPLES:
        progress.note(
            f"Only {shape.point_count} samples: a curve skeleton needs some {FEW_SAMPLES} at least "
            "to be more than a guess. Refine the mesh."
        )
    parts = part_count(shape)
    if parts > 1:
        progress.note(f"The shape has {parts} separate parts: each gets a graph of its own.")
    border = shape.edges.shape[0] * 2 - 3 * shape.face_count
    unclear = parts - len(found.genus)
    if unclear:
        progress.note(
            f"{unclear} of {parts} parts have edges with three or more faces, or touch themselves "
            "in a vertex: their number of handles is not defined, so their graphs have no loops."
        )
    elif border > 0:
        progress.note(
            f"The shape is open, with {border} edges at holes: loops are counted as if each hole "
            "were closed by a disc, and the skeleton near large holes is a guess."
        )
    for number, genus in sorted(found.genus.items()):
        closed = found.loops.get(number, 0)
        if closed < genus:
            progress.note(
                f"Part {number} has {genus} handles, only {closed} loops were found: handles "
                "thinner than the sampling, or parts of the surface that cross each other."
            )


def note_result(graph: CurveSkeleton, sheet: float, progress: Progress) -> None:
    """Say where a curve skeleton says little about the shape."""
    alone = int((graph.degrees == 0).sum())
    if alone:
        progress.note(
            f"{alone} of {graph.component_count} parts are a single node: round shapes have no "
            "direction, small parts fall below the threshold, and thin ones need lower candidates."
        )
    if sheet > SHEET_SHARE:
        progress.note(
            f"{100 * sheet:.0f} % of the surface lies more than {FAR:g} radii off the curve "
            "skeleton: thin sheets have no meaningful one (surface_skeleton describes them), and "
            "thin limbs need lower candidates."
        )
