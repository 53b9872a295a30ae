"""Operation: thickness of the wall behind every point of the surface, and the thinnest places."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import Preparation, surface_skeleton
from medialis.fields.enclosure import ENCLOSED, Enclosure
from medialis.fields.thickness import thickness, unresolved_walls, wall_balls
from medialis.fields.thin_spots import ThinSpot, ThinSpotOptions, thin_spots
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.operations.common import cloud_arrays, summary
from medialis.operations.declaration import Operation, Selection
from medialis.operations.result import Layer, Outcome, Result
from medialis.options import changed
from medialis.progress import Progress, counted
from medialis.units import with_unit
from medialis.validation import FloatArray, IntArray

SHOWN_SHARE = 98.0
"""Per cent of the vertices that the colours span, from the thinnest up: a few very thick places do
not make everything else look thin."""

PLACES = 15
"""Balls that are looked at to tell whether a cloud or an open mesh encloses anything."""

MOST = 0.5
"""Share of the surface from which on a threshold that calls it thin is worth a warning."""

UNRESOLVED_SHARE = 0.02
"""Share of the samples from which on walls thinner than the sampling are worth a warning."""


@dataclass(frozen=True, kw_only=True)
class ThicknessRun(ThinSpotOptions, Preparation):
    """Options of the operation `thickness`."""

    refine: float = changed(
        Preparation,
        "refine",
        default=0.01,
        help="Split edges longer than this share of the size for the computation, so that flat "
        "faces get samples; flat faces stay the same. 0 computes with the given vertices only. A "
        "wall is seen where the samples are closer together than it is thick.",
    )


def run(shape: Shape, options: ThicknessRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, measure, complete, list the thinnest places."""
    with progress.stage("skeleton", 0.0, 0.7):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    # A length means the shape that was given; smooth refinement may bulge out of its box.
    same = options.threshold * shape.diagonal / fine.diagonal
    given, options = options, replace(options, threshold=min(same, 1.0))
    with progress.stage("thickness", 0.7, 0.85):
        values = thickness.of(cloud, options, progress)
    with progress.stage("thin spots", 0.85, 1.0):
        spots = thin_spots.of(cloud, options, progress)
    note_resolution(cloud, progress)
    note_enclosure(cloud, progress)
    _note_share(values, options, fine, progress)
    _note_thinnest(spots, given, shape, progress)
    labels = np.full(fine.point_count, -1, np.int32)
    for number, spot in enumerate(spots):
        labels[spot.vertices] = number
    surface = _surface_layer("thickness", shape, values, labels)
    marks = (_spots_layer(spots, surface),) if spots else ()
    samples = () if fine is shape else (_surface_layer("samples", fine, values, labels),)
    return Outcome(
        shape=fine,
        layers=(surface, *marks, *samples),
        values={
            "samples": fine.point_count,
            **summary(values, "thickness"),
            "thin_spots": len(spots),
            "overlaps": sum(spot.kind == "overlap" for spot in spots),
            "spots": [_spot_values(spot) for spot in spots],
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={**cloud_arrays(cloud), "thickness": values, "thin_spot": labels},
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


def _spots_layer(spots: tuple[ThinSpot, ...], surface: Layer) -> Layer:
    """Layer of the places, in the colours of the surface."""
    area = np.array([spot.area for spot in spots])
    return Layer(
        "thin_spots",
        np.array([spot.position for spot in spots]),
        attributes={
            "value": np.array([spot.value for spot in spots]),
            **({} if np.isnan(area).all() else {"area": area}),  # a cloud has no areas
            "vertices": np.array([len(spot.vertices) for spot in spots], np.int32),
            "overlap": np.array([spot.kind == "overlap" for spot in spots], np.int32),
        },
        color_by="value",
        color_map=surface.color_map,
        color_limits=surface.color_limits,
        number_by="value",
    )


def _thin(result: Result, shape: Shape) -> NDArray[np.bool_]:
    """Which vertices lie on a wall below the threshold."""
    limit = result.parameters["threshold"] * shape.diagonal
    return np.asarray(result.layers[0].attributes["thickness"]) < limit


def _spot_values(spot: ThinSpot) -> dict[str, Any]:
    return {
        "kind": spot.kind,
        "position": spot.position.tolist(),
        "opposite": None if np.isnan(spot.opposite).any() else spot.opposite.tolist(),
        "value": spot.value,
        "area": spot.area,
        "vertices": len(spot.vertices),
    }


def _note_share(
    values: FloatArray, options: ThicknessRun, surface: Shape, progress: Progress
) -> None:
    """Say so where the threshold calls most of the shape thin."""
    thin = values < options.threshold * surface.diagonal
    area = surface.point_areas if surface.faces is not None else np.ones(len(values))
    share = float(area[thin].sum() / area.sum())
    if share > MOST:
        limit = with_unit(options.threshold * surface.diagonal, surface.unit)
        median = with_unit(float(np.median(values)), surface.unit)
        progress.note(
            f"{100 * share:.0f} % of the shape is thinner than the threshold of {limit}; its "
            f"median {options.kind} is {median}. Check the unit of the threshold.",
            "mostly_thin",
            level=logging.WARNING,
            share=share,
        )


def _note_thinnest(
    spots: tuple[ThinSpot, ...], options: ThicknessRun, shape: Shape, progress: Progress
) -> None:
    below = options.threshold * shape.diagonal
    limit = with_unit(below, shape.unit)
    if not spots:
        text = f"No place is thinner than {limit}." if below else "No thin spot was found."
        progress.note(text, "no_thin_spot", threshold=below)
        return
    walls = [spot for spot in spots if spot.kind == "wall"]
    more = f" below {limit}" if below else ""
    if walls:
        place = ", ".join(f"{x:.6g}" for x in walls[0].position + shape.offset)
        progress.note(
            f"{counted(len(walls), 'thin spot', verbs=('was', 'were'))} found{more}. The thinnest "
            f"has a {options.kind} of {with_unit(walls[0].value, shape.unit)} at ({place}).",
            "thin_spots",
            spots=len(walls),
            thinnest=walls[0].value,
        )
    if len(walls) < len(spots):
        count = len(spots) - len(walls)
        progress.note(
            f"{counted(count, 'place', verbs=('is', 'are'))} thin{more} because parts of the mesh "
            "overlap there, or one part crosses itself: the values tell how deep, not how thick a "
            "wall is. They come last and have the kind overlap.",
            "overlaps",
            level=logging.WARNING,
            spots=count,
        )


def note_enclosure(cloud: MedialCloud, progress: Progress) -> None:
    """Say so where the balls of a cloud or an open mesh lie inside nothing."""
    shape = cloud.surface
    if shape.faces is not None and shape.closed_components.all():
        return
    rows = wall_balls(cloud)
    if len(rows) == 0:
        rows = np.flatnonzero(cloud.valid & (cloud.side > 0))
    rows = rows[np.linspace(0, len(rows) - 1, min(PLACES, len(rows))).astype(np.int64)]
    outside = int((Enclosure(shape).times(cloud.centers[rows]) < ENCLOSED).sum())
    if 2 * outside > len(rows):
        progress.note(
            f"The {'cloud' if shape.faces is None else 'surface'} encloses nothing at "
            f"{counted(outside, 'place', of=len(rows))} that were looked at. Thickness there is "
            "the distance to whatever lies behind the surface, not that of a wall.",
            "encloses_nothing",
            level=logging.WARNING,
            places=outside,
            of=len(rows),
        )


def note_resolution(cloud: MedialCloud, progress: Progress) -> None:
    """Say so where walls may be thinner than the samples are apart."""
    count, of = int(unresolved_walls(cloud).sum()), cloud.surface.point_count
    if count > UNRESOLVED_SHARE * of:
        progress.note(
            f"{counted(count, 'sample', of=of, verbs=('lies', 'lie'))} on a wall that may be "
            "thinner than the spacing of its samples; its thickness is uncertain. Try a smaller "
            "refine.",
            "unresolved_walls",
            level=logging.WARNING,
            samples=count,
            of=of,
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
    "is taken, so that every vertex has a value. Thin spots are listed with both ends, value, area "
    "and vertices, one entry for each place; overlaps of parts are told from walls.",
    source="thesis 3.5.1",
    examples=(
        ("creature.ply --unit mm --threshold 0.1mm", "where the wall is thinner than 0.1 mm"),
        ("creature.ply -o report --report", "the thinnest places, with a page on how sure that is"),
    ),
    layers={
        "thickness": "the surface with the thickness behind each vertex, and its thin spot",
        "thin_spots": "one point for each thin spot, the thinnest first",
        "samples": "the same on the refined surface",
    },
    options=ThicknessRun,
    run=run,
    thin_lines=True,
    selection=Selection(
        "compute_selection_by_medial_thickness_per_vertex",
        "Select the vertices where a shape is thinner than a length.",
        _thin,
        {"threshold": 0.02},
    ),
    order=40,
)
