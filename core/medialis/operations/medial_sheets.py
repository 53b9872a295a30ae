"""Operation: the sheets of the surface skeleton, the curves where they meet, and their graph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.balls.ball_shrinking import ShrinkOptions, Side
from medialis.balls.surface_skeleton import SurfaceSkeletonOptions
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.model.y_network import YNetwork
from medialis.operations.common import cloud_arrays, cloud_layer, samples_layer
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Outcome
from medialis.operations.segments import SheetPreparation, computed
from medialis.options import changed
from medialis.progress import Progress
from medialis.sheets.point_types import PointType, point_types
from medialis.sheets.scaffold import medial_scaffold
from medialis.sheets.sheet_meshes import SheetMeshes
from medialis.sheets.sheets import MedialSheetOptions, medial_sheets


@dataclass(frozen=True, kw_only=True)
class MedialSheetsRun(MedialSheetOptions, SheetPreparation):
    """Options of the operation `medial_sheets`."""

    side: Side = changed(ShrinkOptions, "side")

    @property
    def with_fans(self) -> SurfaceSkeletonOptions:
        """Options of the balls: sheets have no gap at concave edges."""
        return SurfaceSkeletonOptions.taken_from(self, fans=True)


def run(shape: Shape, options: MedialSheetsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, separate sheets, mesh them, find where they meet."""
    cloud = computed(shape, options.with_fans, progress)
    fine = cloud.surface
    with progress.stage("medial sheets", 0.4, 0.8):
        sheets = medial_sheets.of(cloud, options, progress)
        types = point_types.of(cloud, options, progress)
    with progress.stage("network and meshes", 0.8, 1.0):
        scaffold = medial_scaffold.of(sheets, options, progress)
    network, meshes = scaffold.network, scaffold.meshes
    if meshes is None:
        progress.note(
            "A point cloud has no triangles: sheets and the Y-network come as points, without "
            "meshes and curves.",
            "sheets_as_points",
        )
    attributes = {
        "sheet": sheets.labels,
        "type": types,
        "linked": sheets.linked.astype(np.int32),
        "y_network": network.near.astype(np.int32),
    }
    layers = [_points_layer(cloud, attributes)]
    if meshes is not None and len(meshes.mesh.faces):
        layers.append(_mesh_layer(meshes))
    if len(network.edges):
        layers.append(_curves_layer(network))
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
            "y_points": network.points,
            "y_edges": network.edges,
            "y_curve": network.curve,
            "y_sheets": network.meeting,
        },
    )


def _points_layer(cloud: MedialCloud, attributes: Mapping[str, np.ndarray[Any, Any]]) -> Layer:
    kept = cloud.valid
    known = {name: values[kept] for name, values in attributes.items()}
    layer = cloud_layer("medial_sheets", cloud.subset(kept))
    return Layer(
        layer.name,
        layer.points,
        attributes={**known, **layer.attributes},
        color_by="sheet",
        labels=("sheet",),
        filter_by="type",
    )


def _mesh_layer(meshes: SheetMeshes) -> Layer:
    mesh = meshes.mesh
    return Layer(
        "sheet_meshes",
        mesh.points,
        mesh.faces,
        attributes={"sheet": meshes.point_sheet, "radius": meshes.radii},
        face_attributes={"face_sheet": meshes.face_sheet},
        color_by="sheet",
        labels=("sheet",),
    )


def _curves_layer(network: YNetwork) -> Layer:
    return Layer(
        "y_network",
        network.points,
        edges=network.edges,
        attributes={"curve": network.curve},
        color_by="curve",
        labels=("curve",),
    )


OPERATION = Operation(
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
    options=MedialSheetsRun,
    run=run,
    thin_lines=True,
    order=110,
)
