"""Operation: types of medial points, and the skeleton without its rim (thesis 6.2.1).

Operation: the sheets of the surface skeleton, the curves where they meet, and their graph.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.errors import InvalidShapeError
from medialis.base.options import flag
from medialis.base.progress import Progress
from medialis.operations.declaration import Operation
from medialis.operations.positions import places
from medialis.operations.result import Layer, Outcome
from medialis.shape.shape import Shape
from medialis.sheets.feature_sets import PointType, PointTypesOptions, point_types
from medialis.sheets.scaffold import medial_scaffold
from medialis.sheets.sheets import MedialSheetOptions, medial_sheets
from medialis.skeleton.layers import (
    cloud_arrays,
    cloud_layer,
    computed,
    samples_layer,
)


@dataclass(frozen=True, kw_only=True)
class PointTypesRun(PointTypesOptions):
    """Options of the operation `point_types`."""

    filter_rim: bool = flag(
        False, "Leave out the rim", "Leave out points of type 1, those on the rim."
    )


def run_point_types(shape: Shape, options: PointTypesRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, count contacts, drop the rim on request."""
    cloud = computed(shape, options, progress)
    fine = cloud.surface
    with progress.stage("point types", 0.4, 1.0):
        types = point_types.of(cloud, options, progress)
    keep = types > (PointType.A3 if options.filter_rim else PointType.NONE)
    if not keep.any():
        raise InvalidShapeError(
            "All points of the skeleton are on its rim: the shape is too coarse, or smooth "
            "all round. Use a smaller refine, or filter_rim = False."
        )
    layer = cloud_layer("point_types", cloud.subset(keep), {"type": types[keep]})
    layer = replace(layer, color_limits=(float(PointType.A3), float(PointType.Y_CURVE)))
    return Outcome(
        shape=fine,
        layers=(layer, samples_layer(fine)),
        values={
            "skeleton_points": int(keep.sum()),
            "a3_points": int((types == PointType.A3).sum()),
            "sheet_points": int((types == PointType.SHEET).sum()),
            "y_points": int((types >= PointType.Y_CURVE).sum()),
            "contacts": {str(k): int(n) for k, n in enumerate(np.bincount(types)) if n},
            "samples": fine.point_count,
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(cloud), "type": types, "selected": keep},
    )


POINT_TYPES = Operation(
    name="point_types",
    filter_name="generate_medial_point_types",
    label="Types of medial points",
    group="Skeleton",
    help="Classify the points of the surface skeleton: rim, sheet, or Y-curve.\n\n"
    "The type is the number of places where the ball of a point touches the surface: 1 on the rim "
    "of the skeleton (behind edges), 2 inside a sheet, 3 or more where sheets meet. Leaving out "
    "the rim cleans a skeleton quickly without tearing it.",
    source="thesis 6.2.1",
    examples=(("creature.ply", "rim, sheet or Y-curve, for every point of the skeleton"),),
    layers={
        "point_types": "centers of the medial balls with their type",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=PointTypesRun,
    run=run_point_types,
    order=100,
    words=("medial axis", "edges", "junctions"),
)


def run_medial_sheets(shape: Shape, options: MedialSheetOptions, progress: Progress) -> Outcome:
    """Refine, shrink balls, separate sheets, mesh them, find where they meet."""
    cloud = computed(shape, options, progress)
    fine = cloud.surface
    with progress.stage("medial sheets", 0.4, 0.8):
        sheets = medial_sheets.of(cloud, options, progress)
        types = point_types.of(cloud, options, progress)
    with progress.stage("network and meshes", 0.8, 1.0):
        scaffold = medial_scaffold.of(sheets, options, progress)
    network, meshes = scaffold.network, scaffold.meshes
    if meshes is None:
        text = (
            "A point cloud has no triangles: sheets and the Y-network come as points, without "
            "meshes and curves."
        )
        progress.note(text, "sheets_as_points")
    attributes = {
        "sheet": sheets.labels,
        "type": types,
        "linked": sheets.linked.astype(np.int32),
        "y_network": network.near.astype(np.int32),
    }
    valid = {name: values[cloud.valid] for name, values in attributes.items()}
    points = cloud_layer("medial_sheets", cloud.subset(cloud.valid), valid)
    layers = [replace(points, labels=("sheet",), filter_by="type")]
    if meshes is not None and len(meshes.mesh.faces):
        known: dict[str, Any] = {"color_by": "sheet", "labels": ("sheet",)}
        known["attributes"] = {"sheet": meshes.point_sheet, "radius": meshes.radii}
        known["face_attributes"] = {"face_sheet": meshes.face_sheet}
        layers = [replace(layers[0], drawn_by="sheet_meshes")]
        layers.append(Layer("sheet_meshes", meshes.mesh.points, meshes.mesh.faces, **known))
    if len(network.edges):
        known = {"attributes": {"curve": network.curve}, "color_by": "curve", "labels": ("curve",)}
        layers.append(Layer("y_network", network.points, edges=network.edges, **known))
    return Outcome(
        shape=fine,
        layers=(*layers, samples_layer(fine)),
        values={
            "sheets": sheets.count,
            "a3_points": int((types == PointType.A3).sum()),
            "y_points": int((types >= PointType.Y_CURVE).sum()),
            "y_network_points": int(network.near.sum()),
            "y_curves": len(network.lengths),
            "y_length": float(network.lengths.sum()),
            "area": None if meshes is None else float(meshes.areas.sum()),
            "scaffold": scaffold.as_dict(),
            "skeleton_points": int(cloud.valid.sum()),
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={
            **cloud_arrays(cloud),
            **attributes,
            "scaffold_links": scaffold.links,
            "y_points": places(network.points),
            "y_edges": network.edges,
            "y_curve": network.curve,
            "y_sheets": network.meeting,
        },
    )


MEDIAL_SHEETS = Operation(
    name="medial_sheets",
    filter_name="generate_medial_sheets",
    label="Medial sheets",
    group="Skeleton",
    help="Separate the surface skeleton into its smooth sheets and the curves where they meet.\n\n"
    "Gives the points with the number of their sheet and their type, the sheets as meshes, the "
    "Y-network as curves, and the scaffold: a graph of which sheets meet along which curves, with "
    "areas, lengths and mean radii.",
    source="thesis 6.2.2",
    examples=(("creature.ply", "the smooth pieces of the skeleton, and where they meet"),),
    layers={
        "medial_sheets": "centers of the medial balls with their sheet",
        "sheet_meshes": "the sheets as triangles",
        "y_network": "the curves where sheets meet",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=MedialSheetOptions,
    run=run_medial_sheets,
    thin_lines=True,
    order=110,
    words=("medial axis", "separate sheets", "Y curves"),
)
