"""Operation: curve skeleton from silhouettes and depths of many views (thesis 3.7).

The defaults take a tenth of the time of the 500 pairs of 1024 pixels of the thesis (3.7.6.2). On
hand, horse and fertility both find the same loops.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from medialis.base.arrays import kd_tree
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.curves.curve_skeleton import CurveSkeleton, ViewPoints
from medialis.curves.from_views.skeleton import ViewCurveSkeletonOptions, view_curve_skeleton
from medialis.curves.operation import GRAPH_FORMATS, branch_rows, node_attributes
from medialis.operations.declaration import Operation
from medialis.operations.positions import places
from medialis.operations.result import Layer, Outcome
from medialis.shape.shape import Shape
from medialis.skeleton.layers import summary

FAR_RADII = 2.5  # halved 0 %, doubled 0 %
"""A place of the surface further than this many radii from the skeleton lies on a sheet."""

SHEET_SHARE = 0.2  # halved 0 %, doubled 0 %
"""Share of such places from which on a curve is a poor description."""


def run(shape: Shape, options: ViewCurveSkeletonOptions, progress: Progress) -> Outcome:
    """Render, match, sharpen, link, and say where a curve is a poor description."""
    curve = view_curve_skeleton.of(shape, options, progress)
    points = curve.view_points or ViewPoints(np.empty((0, 3)), np.empty(0))
    own = {k: v for k, v in node_attributes(curve).items() if k != "importance"}
    known: dict[str, Any] = {"attributes": own, "color_by": "radius", "labels": ("branch",)}
    by_pairs: dict[str, Any] = {"color_by": "pairs", "filter_by": "pairs", "auxiliary": True}
    _note_doubts(shape, curve, progress)
    return Outcome(
        shape=shape,
        layers=(
            Layer("view_curve_skeleton", curve.nodes, edges=curve.edges, **known),
            Layer("view_points", points.points, attributes={"pairs": points.weights}, **by_pairs),
        ),
        values={
            "nodes": len(curve.nodes),
            "branches": curve.branch_count,
            "junctions": len(curve.junctions),
            "end_points": len(curve.end_points),
            "loops": curve.loops,
            "components": curve.component_count,
            "length": curve.length,
            **summary(curve.radii, "radius"),
            "points": len(points.points),
            "diagonal": shape.diagonal,
            "branch_table": branch_rows(curve),
        },
        arrays={
            "nodes": places(curve.nodes),
            "edges": curve.edges,
            "node_radius": curve.radii,
            "edge_branch": curve.branch,
            "view_points": places(points.points),
            "view_weights": points.weights,
        },
        extras={"graph": curve},
    )


def _note_doubts(shape: Shape, curve: CurveSkeleton, progress: Progress) -> None:
    """Warn of sheets, and of parts that no branch was found for."""
    away, node = run_patiently(lambda: kd_tree(curve.nodes).query(shape.points), progress)
    share = float((away > FAR_RADII * curve.radii[node]).mean())
    if share > SHEET_SHARE:
        text = (
            f"{100 * share:.0f} % of the surface lies further than {FAR_RADII:g} radii from the "
            "curve skeleton: it is a sheet, or hidden. Use surface_skeleton for sheets."
        )
        progress.warn(text, "thin_sheets", share=share)
    parts = int(shape.components.max()) + 1
    if curve.component_count != parts and shape.faces is not None:
        text = (
            f"The shape has {counted(parts, 'connected part')}, the curve skeleton "
            f"{curve.component_count}. Parts that touch are joined, those thinner than two pixels "
            "are lost (raise size)."
        )
        progress.note(text, "parts_differ", parts=parts, components=curve.component_count)


OPERATION = Operation(
    name="view_curve_skeleton",
    filter_name="generate_curve_skeleton_from_views",
    label="Curve skeleton from views",
    group="Skeleton",
    help="Compute the curve skeleton of a mesh or point cloud from pictures of it.\n\n"
    "Silhouettes and depths are rendered from many directions, in pairs; their 2D skeletons are "
    "matched to points in space, which all views test and move to where they agree; the points are "
    "linked to a graph with branches and loops. It needs no clean mesh: holes, overlaps and "
    "wrong orientations do not matter. Parts that no view shows are not found.",
    source="thesis 3.7",
    examples=(("creature.ply --pairs 40 --size 128", "fewer and smaller views: a quick look"),),
    layers={
        "view_curve_skeleton": "the graph as lines with radius and branch",
        "view_points": "the points that the views gave, from which the graph was made",
    },
    options=ViewCurveSkeletonOptions,
    formats=GRAPH_FORMATS,
    run=run,
    thin_lines=True,
    order=80,
    words=("centerline", "silhouettes"),
)
