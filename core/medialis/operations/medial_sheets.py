"""Operation: the sheets of the surface skeleton, the curves where they meet, and their graph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.balls.ball_shrinking import ShrinkOptions, Side
from medialis.balls.surface_skeleton import Preparation
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.model.y_network import YNetwork
from medialis.operations.common import cloud_arrays, cloud_layer, samples_layer
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Outcome
from medialis.operations.segments import (
    computed,
)
from medialis.options import changed, number
from medialis.progress import Progress
from medialis.sheets.extended_features import extended_feature_transform
from medialis.sheets.point_types import PointType, point_types
from medialis.sheets.scaffold import medial_scaffold
from medialis.sheets.sheet_meshes import SheetMeshes, sheet_meshes
from medialis.sheets.sheets import medial_sheets
from medialis.sheets.y_network import y_network


@dataclass(frozen=True, kw_only=True)
class MedialSheetsRun(Preparation):
    """Options of the operation `medial_sheets`."""

    smallest: float = number(
        0.002,
        "Smallest sheet",
        "A sheet that covers less than this share of the surface is merged into the "
        "neighbour with the longest common border. 0 keeps all.",
    )
    tau: float = number(
        4.0,
        "Sheet threshold",
        "Two neighbouring points are on one sheet when their feature points are "
        "closer together than this many sample spacings. Larger values join more.",
        low=1.5,
        high=100.0,
        advanced=True,
    )
    tolerance: float = changed(Preparation, "tolerance", advanced=True)
    side: Side = changed(ShrinkOptions, "side")
    refine: float = changed(
        Preparation,
        "refine",
        default=0.01,
        help="Split edges longer than this fraction of the size for the computation, so "
        "that flat faces get samples; the surface stays the same. 0 computes with the"
        " given vertices only. Sheets and edges need several samples across every "
        "face.",
    )


def run(shape: Shape, options: MedialSheetsRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, separate sheets, mesh them, find where they meet."""
    fine, cloud = computed(shape, options, progress)
    with progress.stage("feature sets", 0.4, 0.7):
        sets = extended_feature_transform(fine, cloud, progress=progress)
        types = point_types(fine, cloud, sets=sets)
    with progress.stage("sheets", 0.7, 0.8):
        sheets = medial_sheets(fine, cloud, tau=options.tau, smallest=options.smallest, sets=sets)
    with progress.stage("y-network", 0.8, 0.9):
        network = y_network(fine, cloud, sheets)
    meshes = None
    if fine.faces is None:
        progress.note(
            "A point cloud has no connectivity: sheets and the network are given as points, "
            "without meshes and curves."
        )
    else:
        with progress.stage("sheet meshes", 0.9, 1.0):
            meshes = sheet_meshes(fine, cloud, sheets)
    scaffold = medial_scaffold(sheets, network, meshes)
    attributes = {
        "sheet": sheets.labels,
        "type": types,
        "linked": sheets.linked.astype(np.int32),
        "y_network": network.near.astype(np.int32),
    }
    layers = [_points_layer(cloud, attributes)]
    if meshes is not None and len(meshes.mesh.faces):
        layers.append(_mesh_layer(cloud, meshes))
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
            **cloud_arrays(fine, cloud),
            **attributes,
            "scaffold_links": scaffold.links,
            "y_points": network.points,
            "y_edges": network.edges,
            "y_curve": network.curve,
            "y_sheets": network.sheets,
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


def _mesh_layer(cloud: MedialCloud, meshes: SheetMeshes) -> Layer:
    """Each sheet has its own points, so that hosts can take the sheets apart."""
    mesh, count = meshes.mesh, len(meshes.mesh.points)
    corners = np.asarray(meshes.face_sheet, np.int64)[:, None] * count + mesh.faces
    used, place = np.unique(corners, return_inverse=True)
    rows = mesh.rows[used % count]
    return Layer(
        "sheet_meshes",
        cloud.centers[rows],
        place.reshape(-1, 3).astype(np.int32),
        attributes={"sheet": (used // count).astype(np.int32), "radius": cloud.radii[rows]},
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
    options=MedialSheetsRun,
    run=run,
    order=110,
)
