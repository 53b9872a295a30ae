"""Operation: shortest straightest geodesic between two vertices (thesis 3.3.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from medialis.errors import InvalidOptionError
from medialis.model.shape import Shape
from medialis.operations.declaration import Kind, Operation, Parameter
from medialis.operations.result import Layer, Outcome
from medialis.operations.skeleton_importance import DIRECTIONS
from medialis.progress import Progress
from medialis.regularization.geodesics import geodesic

LARGEST_INDEX = 2_147_483_647


def run(shape: Shape, parameters: Mapping[str, Any], progress: Progress) -> Outcome:
    """Trace the path between two vertices of the input."""
    ends = [_vertex(shape, parameters[name], name) for name in ("start", "end")]
    with progress.stage("geodesic", 0.0, 1.0):
        path = geodesic(shape, *ends, directions=parameters["directions"])
    count = len(path.points)
    steps = np.linalg.norm(np.diff(path.points, axis=0), axis=1)
    layer = Layer(
        "geodesic_path",
        path.points,
        edges=np.stack([np.arange(count - 1), np.arange(1, count)], axis=1).astype(np.int32),
        attributes={"distance": np.concatenate([[0.0], np.cumsum(steps)])},
        color_by="distance",
    )
    straight = float(np.linalg.norm(path.points[-1] - path.points[0]))
    return Outcome(
        shape=shape,
        layers=(layer,),
        values={
            "length": path.length,
            "straight_distance": straight,
            "found": path.status.name.lower(),
            "path_points": count,
        },
        arrays={"path": path.points},
    )


def _vertex(shape: Shape, index: int, name: str) -> int:
    """Index in the repaired shape of a vertex of the input."""
    known = shape.point_count if shape.vertex_map is None else len(shape.vertex_map)
    if index >= known:
        raise InvalidOptionError(f"{name} must be a vertex 0..{known - 1}, got {index}.")
    mapped = index if shape.vertex_map is None else int(shape.vertex_map[index])
    if mapped < 0:
        raise InvalidOptionError(f"{name} is vertex {index}, which no face uses: choose another.")
    return mapped


OPERATION = Operation(
    name="geodesic_path",
    filter_name="generate_geodesic_path",
    label="Geodesic path",
    group="Inspect",
    help="Measure and draw the shortest straightest geodesic between two vertices.\n\n"
    "The path runs over the surface: of many planes through the two vertices, the one that cuts "
    "the surface in the shortest curve wins. Typical error against exact geodesics: 0.001 %.",
    source="thesis 3.3.2",
    parameters=(
        Parameter(
            "start",
            Kind.INT,
            0,
            "Start vertex",
            "Number of the vertex, from 0.",
            high=LARGEST_INDEX,
        ),
        Parameter(
            "end", Kind.INT, 1, "End vertex", "Number of the vertex, from 0.", high=LARGEST_INDEX
        ),
        DIRECTIONS,
    ),
    run=run,
)
