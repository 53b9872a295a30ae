"""Operation: lines in the middle of tubes between picked places, with radius and sections."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, places_along
from medialis.base.box_tree import NearestTree
from medialis.base.errors import InvalidShapeError
from medialis.base.options import file, length, whole
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray
from medialis.curves.centerline import (
    Centerlines,
    Inlet,
    Middle,
    Tract,
    inlets,
    joined,
    nearest_balls,
    node_vertices,
    resampled,
    shortest,
    tangents_of,
    tracts,
)
from medialis.curves.from_balls import CurveSkeletonOptions, curve_skeleton, limb_balls
from medialis.curves.sections import sections
from medialis.formats.files import Drawn, complete_file
from medialis.formats.vtk import write_lines_vtp
from medialis.operations.declaration import Format, Operation
from medialis.operations.positions import place
from medialis.operations.result import Layer, Outcome, Result
from medialis.shape.shape import Shape
from medialis.skeleton.layers import samples_layer, summary, vertices_in_file
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import Preparation

MOST_PLACES = 20_000
"""Of a line."""


@dataclass(frozen=True, kw_only=True)
class CenterlineRun(Preparation):
    """Options of the operation `centerline`."""

    places: str = file(
        "Places",
        "Text file with a vertex number, or the x y z of a point near a vertex, in each line: "
        "where lines begin, then where they end. Without it open ends are taken, the widest first; "
        "of a closed shape the ends of its curve skeleton, the thickest first.",
        selection="each",
    )
    starts: int = whole(
        1,
        "Starts",
        "So many of the places, the first ones, are where lines begin; at each of the others one "
        "ends. It begins at the nearest start.",
        low=1,
        high=1000,
    )
    step: float = length(
        0.005,
        "Step",
        "Distance of the places along a line at which it is measured, as a share of the size.",
        low=0.0001,
    )


@dataclass(frozen=True, eq=False)
class _Ends:
    """Where lines end: rows of balls, and middles (k, 3) of open ends, NaN where there is none."""

    rows: Index
    middles: FloatArray
    told: str


def run(shape: Shape, options: CenterlineRun, progress: Progress) -> Outcome:
    """Shrink balls, find the ends, lay lines between them in the middle, cut and measure them."""
    if shape.faces is None:
        raise InvalidShapeError(
            "A centerline needs a surface with faces, got a point cloud: reconstruct a surface "
            "first."
        )
    picked = vertices_in_file(options.places, shape, "no line begins or ends there")
    with progress.stage("skeleton", 0.0, 0.5):
        cloud = limb_balls(shape, options, progress)
    if not cloud.valid.any():
        raise InvalidShapeError("No ball fits inside the shape, so it has no centerline.")
    with progress.stage("ends", 0.5, 0.6):
        ends = _ends(shape, cloud, picked, options, progress)
    with progress.stage("lines", 0.6, 0.85):
        found = _lines(cloud, ends, options, progress)
    pieces = tracts(found)
    with progress.stage("sections", 0.85, 1.0):
        tangents = _tangents(found)
        measured = sections(cloud.surface, found.points, tangents, progress)
    layer = _layer(found, pieces, measured)
    return Outcome(
        shape=cloud.surface,
        layers=(layer, samples_layer(cloud.surface)),
        values=_values(found, pieces, layer, ends, cloud.surface.diagonal),
        extras={"lines": (layer, found, pieces)},
    )


def _ends(
    shape: Shape, cloud: MedialCloud, picked: Index, options: CenterlineRun, progress: Progress
) -> _Ends:
    """Return the ends of lines: those that were picked, open ones, or those of limbs."""
    if len(picked):
        rows, told = nearest_balls(cloud, picked), "places"
        middles = np.full((len(rows), 3), np.nan)
    elif len(openings := inlets(cloud)) > 1:
        rows = np.array([_nearest_to_middle(cloud, one) for one in openings], np.int64)
        told = "open ends"
        middles = np.array([one.middle for one in openings])
    else:
        graph = curve_skeleton.of(cloud, CurveSkeletonOptions(), progress)
        tips = graph.end_points[np.argsort(-graph.radii[graph.end_points], kind="stable")]
        largest = np.bincount(graph.components).argmax() if len(graph.nodes) else 0
        tips = tips[graph.components[tips] == largest]
        rows = node_vertices(cloud, graph.nodes[tips], graph.radii[tips])
        told, middles = "ends of the curve skeleton", np.full((len(rows), 3), np.nan)
    _, first = np.unique(rows, return_index=True)
    chosen = np.sort(first)
    if len(chosen) <= options.starts:
        there = counted(len(chosen), "place", verbs=("was", "were"))
        raise InvalidShapeError(
            f"Lines begin at {options.starts} and end at others, but {there} found ({told}). Give "
            "places."
        )
    return _Ends(rows[chosen], middles[chosen], told)


def _nearest_to_middle(cloud: MedialCloud, opening: Inlet) -> int:
    away = np.linalg.norm(cloud.centers[opening.vertices] - opening.middle, axis=1)
    return int(opening.vertices[int(np.argmin(away))])


def _lines(
    cloud: MedialCloud, ends: _Ends, options: CenterlineRun, progress: Progress
) -> Centerlines:
    surface, begins = cloud.surface, options.starts
    assert surface.faces is not None
    rows = run_patiently(lambda: shortest(cloud, ends.rows[:begins], ends.rows[begins:]), progress)
    tree, middle = NearestTree.of_triangles(surface.points, surface.faces), Middle(cloud)
    paths = []
    for number, path in enumerate(rows):
        first = ends.middles[int(np.flatnonzero(ends.rows[:begins] == path[0])[0])]
        last = ends.middles[begins + number]
        fixed = bool(np.isfinite(first).all()), bool(np.isfinite(last).all())
        inside = [first[None]] * fixed[0] + [cloud.centers[path]] + [last[None]] * fixed[1]
        line = middle.line(np.concatenate(inside), fixed, progress.still)
        line = resampled(line, options.step * surface.diagonal, MOST_PLACES)
        paths.append(line)
        progress.update((number + 1) / len(rows))
    return joined(paths, tree)


def _tangents(found: Centerlines) -> FloatArray:
    result = np.empty_like(found.points)
    for line in reversed(found.lines):  # what lines share has the direction of the first one
        result[line] = tangents_of(found.points[line])
    return result


def _layer(found: Centerlines, pieces: list[Tract], measured: FloatArray) -> Layer:
    count = len(found.points)
    group, blanked = np.full(count, -1, np.int32), np.zeros(count, np.int32)
    distance = np.zeros(count)
    for piece in pieces:
        rows = found.lines[piece.line][piece.first : piece.last + 1]
        group[rows], blanked[rows] = piece.group, piece.blanked
    for line in found.lines:
        distance[line] = places_along(found.points[line])
    edges = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in found.lines])
    attributes: dict[str, NDArray[Any]] = {
        "radius": found.radii,
        "section_area": measured[:, 0],
        "least_diameter": measured[:, 1],
        "largest_diameter": measured[:, 2],
        "distance": distance,
        "group": group,
        "blanked": blanked,
    }
    return Layer(
        "centerline",
        found.points,
        edges=np.unique(edges, axis=0).astype(np.int32),
        attributes=attributes,
        color_by="radius",
        labels=("group",),
    )


def _values(
    found: Centerlines, pieces: list[Tract], layer: Layer, ends: _Ends, diagonal: float
) -> dict[str, Any]:
    rows = []
    for line in found.lines:
        points, radii = found.points[line], found.radii[line]
        total, chord = float(places_along(points)[-1]), math.dist(points[0], points[-1])
        rows.append(
            {
                "start": place(points[0]),
                "end": place(points[-1]),
                "length": total,
                "tortuosity": total / chord if chord > 0 else math.inf,
                "least_radius": float(radii.min()),
                "median_radius": float(np.median(radii)),
            }
        )
    return {
        "lines": len(found.lines),
        "between": ends.told,
        "groups": 1 + max(piece.group for piece in pieces),
        "forks": len({piece.group for piece in pieces if piece.blanked}),
        **summary(np.array([row["length"] for row in rows]), "length"),
        **summary(found.radii, "radius"),
        **summary(layer.attributes["section_area"], "area"),
        "diagonal": diagonal,
        "line_table": rows,
    }


def _write_vtp(path: Path, result: Result) -> None:
    """Write a cell a piece, with the names that the Vascular Modeling Toolkit gives arrays."""
    layer, found, pieces = result.extras["lines"]
    cells, numbers = [], []
    count = dict.fromkeys(range(len(found.lines)), 0)
    for piece in pieces:
        line = found.lines[piece.line]
        cells.append(line[max(piece.first - 1, 0) : piece.last + 1])  # pieces meet
        numbers.append((piece.group, piece.line, count[piece.line], int(piece.blanked)))
        count[piece.line] += 1
    whole = np.array(numbers, np.int32).reshape(-1, 4)
    names = ("GroupIds", "CenterlineIds", "TractIds", "Blanking")
    own = {
        "MaximumInscribedSphereRadius": layer.attributes["radius"],
        "CenterlineSectionArea": layer.attributes["section_area"],
        "CenterlineSectionMinSize": layer.attributes["least_diameter"],
        "CenterlineSectionMaxSize": layer.attributes["largest_diameter"],
        "Abscissas": layer.attributes["distance"],
    }
    shown = Drawn(layer.points, attributes=own, color_by="MaximumInscribedSphereRadius")
    write_lines_vtp(path, shown, cells, dict(zip(names, whole.T, strict=True)))


def _write_csv(path: Path, result: Result) -> None:
    """Write a line for each place of each centerline; lengths are in the unit of the shape."""
    layer, found, _ = result.extras["lines"]
    columns = layer.attributes
    lines = [",".join(["line", "x", "y", "z", *columns])]
    for number, rows in enumerate(found.lines):
        for row in rows.tolist():
            values = [*layer.points[row].tolist(), *(v[row].item() for v in columns.values())]
            told = (
                "" if isinstance(v, float) and not math.isfinite(v) else repr(v) for v in values
            )
            lines.append(",".join([str(number), *told]))
    with complete_file(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode("ascii"))


OPERATION = Operation(
    name="centerline",
    filter_name="generate_centerline",
    label="Centerline",
    group="Skeleton",
    help="Lay lines in the middle of tubes between places, and measure sections along them.\n\n"
    "Lines run from one place, or several, to all others: picked ones, open ends that are found, "
    "or the ends of limbs. They keep to where the shape is widest. At equal steps they have the "
    "radius of the largest ball inside, and area, least and largest diameter of the section "
    "across; branches and forks are numbered.",
    options=CenterlineRun,
    run=run,
    needs_faces=True,
    thin_lines=True,
    formats=(Format("lines.vtp", _write_vtp, "lines"), Format("csv", _write_csv, "lines")),
    examples=(
        ("creature.ply", "lines from the thickest end of a limb to all others"),
        ("creature.ply -o coarse --step 2%", "the same, with fewer sections"),
    ),
    layers={
        "centerline": "the lines with radius, sections, and the number of each piece",
        "samples": "the surface as computed on",
    },
    order=72,
    words=("centreline", "vessel", "middle line", "cross-section"),
)
