"""Operation: thickness of the wall behind every point of the surface, and the thinnest places."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.fields.thickness import ThicknessKind, thickness, unresolved_walls
from medialis.fields.thin_spots import ThinSpot, thin_spots
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.operations.common import (
    cloud_arrays,
    summary,
)
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Outcome
from medialis.options import angle, changed, choice, length, whole
from medialis.progress import Progress
from medialis.validation import FloatArray, IntArray

SHOWN_SHARE = 98.0
"""Per cent of the vertices that the colours span, from the thinnest up: a few very thick places do
not make everything else look thin."""

UNRESOLVED_SHARE = 0.02
"""Share of the samples from which on walls thinner than the sampling are worth a warning."""


@dataclass(frozen=True, kw_only=True)
class ThicknessRun(Preparation):
    """Options of the operation `thickness`."""

    kind: ThicknessKind = choice(
        "diameter",
        "Measure",
        "The diameter of the ball, as a caliper measures, or its radius.",
        ("diameter", "radius"),
    )
    threshold: float = length(
        0.0,
        "Thin below",
        "Every connected region thinner than this fraction of the size is a thin "
        "spot. 0 finds the places that are thinner than all around them.",
    )
    spots: int = whole(
        10,
        "Thin spots",
        "List at most this many places, the thinnest first.",
        low=1,
        high=100000,
    )
    min_spoke_angle: float = angle(
        120.0,
        "Wall angle",
        "Balls whose two feature points are closer together than this, seen from the "
        "center, belong to edges and bumps, not to walls, and are left out. 0 uses "
        "all balls.",
        advanced=True,
    )
    refine: float = changed(
        Preparation,
        "refine",
        default=0.01,
        help="Split edges longer than this fraction of the size for the computation, so "
        "that flat faces get samples; the surface stays the same. 0 computes with the"
        " given vertices only. A wall is seen where the samples are closer together "
        "than it is thick.",
    )


def run(shape: Shape, options: ThicknessRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, measure, complete, list the thinnest places."""
    with progress.stage("skeleton", 0.0, 0.7):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    with progress.stage("thickness", 0.7, 0.85):
        angle = math.radians(options.min_spoke_angle)
        values = thickness(fine, cloud, kind=options.kind, min_spoke_angle=angle)
    with progress.stage("thin spots", 0.85, 1.0):
        threshold = options.threshold * fine.diagonal or None
        spots = thin_spots(fine, values, threshold=threshold, count=options.spots, cloud=cloud)
    _note_resolution(fine, cloud, progress)
    _note_thinnest(spots, threshold, options.kind, progress)
    labels = np.full(fine.point_count, -1, np.int32)
    for number, spot in enumerate(spots):
        labels[spot.vertices] = number
    surface = _surface_layer("thickness", shape, values, labels)
    marks = (_spots_layer(spots),) if spots else ()
    samples = () if fine is shape else (_surface_layer("samples", fine, values, labels),)
    return Outcome(
        shape=fine,
        layers=(surface, *marks, *samples),
        values={
            "samples": fine.point_count,
            **summary(values, "thickness"),
            "thin_spots": len(spots),
            "spots": [_spot_values(spot) for spot in spots],
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(fine, cloud), "thickness": values, "thin_spot": labels},
        shown=(samples or (surface,)) + marks,
    )


def _surface_layer(name: str, shape: Shape, values: FloatArray, labels: IntArray) -> Layer:
    """Layer of the first points of the refined shape: all of them, or the vertices of the input."""
    n = shape.point_count
    return Layer(
        name,
        shape.points,
        shape.faces,
        attributes={"thickness": values[:n], "thin_spot": labels[:n]},
        color_by="thickness",
        color_map="diverging_reversed",
        color_limits=(float(values.min()), float(np.percentile(values, SHOWN_SHARE))),
        labels=("thin_spot",),
        on_input=name != "samples",
        auxiliary=name == "samples",
    )


def _spots_layer(spots: tuple[ThinSpot, ...]) -> Layer:
    area = np.array([spot.area for spot in spots])
    return Layer(
        "thin_spots",
        np.array([spot.position for spot in spots]),
        attributes={
            "value": np.array([spot.value for spot in spots]),
            **({} if np.isnan(area).all() else {"area": area}),  # a cloud has no areas
            "vertices": np.array([len(spot.vertices) for spot in spots], np.int32),
        },
    )


def _spot_values(spot: ThinSpot) -> dict[str, Any]:
    return {
        "position": spot.position.tolist(),
        "value": spot.value,
        "area": spot.area,
        "vertices": len(spot.vertices),
    }


def _note_thinnest(
    spots: tuple[ThinSpot, ...], threshold: float | None, kind: str, progress: Progress
) -> None:
    if not spots:
        progress.note(f"No place is thinner than {threshold:.6g}.")
        return
    place = ", ".join(f"{x:.6g}" for x in spots[0].position)
    more = "" if threshold is None else f" below {threshold:.6g}"
    progress.note(
        f"{len(spots)} thin {'spot' if len(spots) == 1 else 'spots'}{more}; the thinnest: "
        f"{spots[0].value:.6g} ({kind}) at ({place})."
    )


def _note_resolution(shape: Shape, cloud: MedialCloud, progress: Progress) -> None:
    count = int(unresolved_walls(shape, cloud).sum())
    if count > UNRESOLVED_SHARE * shape.point_count:
        progress.note(
            f"At {count} of {shape.point_count} samples the wall may be thinner than the samples "
            "are apart, so that its thickness is not seen: try a smaller refine.",
            level=logging.WARNING,
        )


OPERATION = Operation(
    name="thickness",
    filter_name="compute_scalar_by_medial_thickness_per_vertex",
    label="Thickness",
    group="Thickness",
    help="Measure how thick a shape is at every point of its surface, and list the thinnest "
    "places.\n\n"
    "The thickness is the diameter of the largest ball that fits into the wall behind the point. "
    "Convex edges, bumps and noise do not count as thin: there, the thickness of the wall around "
    "is taken, so that every vertex has a value. Thin spots are listed with position, value, area "
    "and vertices, one entry a place.",
    source="thesis 3.5.1",
    options=ThicknessRun,
    run=run,
    order=40,
)
