"""Operation: shortest geodesics between vertices, with their polylines (thesis 3.3.2)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.files._files import number_lines
from medialis.model.shape import Shape
from medialis.operations.common import summary
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Outcome
from medialis.options import file, whole
from medialis.paths.geodesics import GeodesicOptions
from medialis.paths.polylines import Geodesic, geodesics
from medialis.progress import Progress, counted

LARGEST_INDEX = 2_147_483_647
"""Of a vertex: indices are int32."""


@dataclass(frozen=True, kw_only=True)
class GeodesicPathRun(GeodesicOptions):
    """Options of the operation `geodesic_path`."""

    start: int = whole(0, "Start vertex", "Number of the vertex, from 0.", high=LARGEST_INDEX)
    end: int = whole(1, "End vertex", "Number of the vertex, from 0.", high=LARGEST_INDEX)
    pairs: str = file(
        "File of pairs",
        "Text file with two vertex numbers in each line; these pairs are measured instead of "
        "start and end.",
        selection="pair",
    )


def run(shape: Shape, options: GeodesicPathRun, progress: Progress) -> Outcome:
    """Trace the paths between the given vertices of the input."""
    pairs = np.array([[options.start, options.end]])
    if options.pairs:
        pairs = _read_pairs(options.pairs)
    ends = _in_shape(shape, pairs)
    with progress.stage("geodesics", 0.0, 1.0):
        paths = geodesics(shape, ends, directions=options.directions, progress=progress)
    drawn = [(row, path) for row, path in enumerate(paths) if path is not None]
    if not drawn:
        raise InvalidShapeError(
            f"No path joins the vertices {pairs[0].tolist()}"
            + (f" or those of {len(pairs) - 1} other pairs" if len(pairs) > 1 else "")
            + ": they lie in different components."
        )
    if len(drawn) < len(paths):
        progress.note(
            f"No path joins the vertices of {len(paths) - len(drawn)} of "
            f"{counted(len(paths), 'pair')}: they lie in different components.",
            "unjoined_pairs",
            pairs=len(paths) - len(drawn),
            of=len(paths),
        )
    lengths = np.array([math.inf if path is None else path.length for path in paths])
    values: dict[str, Any] = {"pairs": len(paths), **summary(lengths, "length")}
    if len(paths) == 1:
        path = drawn[0][1]
        values = {
            "length": path.length,
            "straight_distance": float(np.linalg.norm(path.points[-1] - path.points[0])),
            "found": path.status.name.lower(),
        }
    values["path_points"] = sum(len(path.points) for _, path in drawn)
    return Outcome(
        shape=shape,
        layers=(_layer(drawn),),
        values=values,
        arrays={"pairs": pairs, "length": lengths},
    )


def _layer(drawn: list[tuple[int, Geodesic]]) -> Layer:
    """All polylines, with the distance from their start, and their row in the list of pairs."""
    counts = np.array([len(path.points) for _, path in drawn])
    first = np.cumsum(counts) - counts
    index = np.arange(counts.sum())
    inside = np.delete(index, first + counts - 1)  # a last point begins no edge
    distance = [
        np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p.points, axis=0), axis=1))])
        for _, p in drawn
    ]
    return Layer(
        "geodesic_path",
        np.concatenate([path.points for _, path in drawn]),
        edges=np.stack([inside, inside + 1], axis=1).astype(np.int32),
        attributes={
            "distance": np.concatenate(distance),
            "pair": np.repeat(np.array([row for row, _ in drawn], np.int32), counts),
        },
        color_by="distance",
    )


def _read_pairs(path: str) -> NDArray[np.int64]:
    """Two vertex numbers a line, separated by blanks or a comma; # begins a comment."""
    rows = []
    for number, line, words in number_lines(path):
        if len(words) != 2 or not all(re.fullmatch("[0-9]{1,18}", word) for word in words):
            raise InvalidOptionError(
                f"Line {number} of {path} must hold two vertex numbers, got {line!r}."
            )
        rows.append([int(word) for word in words])
    if not rows:
        raise InvalidOptionError(f"{path} holds no pair of vertex numbers.")
    return np.array(rows, np.int64)


def _in_shape(shape: Shape, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers in the repaired shape of vertices of the input."""
    known = shape.point_count if shape.vertex_map is None else len(shape.vertex_map)
    if pairs.max() >= known:
        raise InvalidOptionError(f"Vertices are numbered 0..{known - 1}, got {pairs.max()}.")
    mapped = pairs if shape.vertex_map is None else shape.vertex_map[pairs].astype(np.int64)
    if (mapped < 0).any():
        raise InvalidOptionError(
            f"Vertex {pairs[mapped < 0][0]} is used by no face: no path starts or ends there."
        )
    return mapped


OPERATION = Operation(
    name="geodesic_path",
    filter_name="generate_geodesic_path",
    label="Geodesic paths",
    group="Inspect",
    help="Measure and draw shortest geodesics between vertices.\n\n"
    "The path runs over the surface: the shortest cut by a plane through the two vertices and the "
    "shortest path along the edges are shortened until they are straight everywhere; the shorter "
    "one wins. It is the shortest path in its neighbourhood.",
    source="thesis 3.3.2",
    examples=(("creature.ply --start 0 --end 500", "the shortest path between two vertices"),),
    layers={
        "geodesic_path": "the paths as polylines with the distance from their start",
    },
    options=GeodesicPathRun,
    run=run,
    needs_faces=True,
    thin_lines=True,
    lies_on_shape=True,
    order=50,
)
