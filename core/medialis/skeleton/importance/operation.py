"""Operation: surface skeleton with geodesic importance, simplified by one number (thesis 3.3).

Operation: shortest geodesics between vertices, with their polylines (thesis 3.3.2).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import changed, file, flag, whole
from medialis.base.progress import Progress, counted
from medialis.formats.files import number_lines
from medialis.operations.declaration import Operation
from medialis.operations.positions import numbers
from medialis.operations.result import FilterUnit, Layer, Outcome
from medialis.shape.reading import surface_of_cloud
from medialis.shape.shape import Shape
from medialis.skeleton.importance.geodesics import (
    Geodesic,
    GeodesicOptions,
    PathStatus,
    geodesics,
)
from medialis.skeleton.importance.importance import (
    ImportanceOptions,
    ThresholdOptions,
    connected_importance,
    geodesic_importance,
    important_points,
    local_measures,
)
from medialis.skeleton.layers import cloud_arrays, cloud_layer, samples_layer, summary
from medialis.skeleton.surface_skeleton import Preparation, surface_skeleton

SHARES = (0.005, 0.01, 0.02, 0.05)


@dataclass(frozen=True, kw_only=True)
class SkeletonImportanceRun(Preparation, ImportanceOptions):
    """Options of the operation `skeleton_importance`."""

    threshold: float = changed(ThresholdOptions, "threshold")
    connected: bool = flag(
        True,
        "In one piece",
        "Keep the skeleton in one piece at every threshold: small islands go, bridges"
        " to large ones stay.",
    )
    reconstruct: bool = flag(
        False,
        "Surface for clouds",
        "Build a surface through the points of a point cloud first; it should be closed and dense.",
    )


def run_skeleton_importance(
    shape: Shape, options: SkeletonImportanceRun, progress: Progress
) -> Outcome:
    """Shrink balls, trace a geodesic for each, keep the important points."""
    if shape.faces is None:
        if not options.reconstruct:
            raise InvalidShapeError(
                "Geodesic importance needs a surface, and this shape is a point cloud. Use "
                "surface_skeleton, which gives spoke angle and radius, or reconstruct = True."
            )
        with progress.stage("surface", 0.0, 0.05):
            given = shape
            shape = kept(surface_of_cloud, given, None, lambda: surface_of_cloud(given), progress)
        progress.note(
            "A surface was built through the points of the cloud. Check it in the layer samples.",
            "surface_built",
        )
    with progress.stage("skeleton", 0.0, 0.2):
        cloud = surface_skeleton.of(shape, options, progress)
    fine = cloud.surface
    with progress.stage("importance", 0.2, 0.95):
        paths = geodesic_importance.of(cloud, options, progress)
        chosen = connected_importance.of(paths, options, progress) if options.connected else paths
    importance = chosen.length
    mask = important_points.of(chosen, options, progress)
    if not mask.any():
        largest = float(np.nanmax(importance)) / fine.diagonal
        raise InvalidShapeError(
            f"No skeleton point has an importance of {options.threshold:g} of the size or "
            f"more; the largest is {largest:.3g}. Lower the threshold."
        )
    unreached = int(np.isinf(paths.length).sum())
    if unreached:
        infinite = int(np.isinf(importance).sum())  # connecting pieces changes some
        progress.note(
            f"{counted(unreached, 'skeleton point', verbs=('lies', 'lie'))} between separate parts "
            "of the shape, so that no path joins the two feature points. "
            f"{counted(infinite, 'point', verbs=('has', 'have'))} infinite importance; every "
            "threshold keeps them.",
            "between_parts",
            points=unreached,
            infinite=infinite,
        )
    around = int((paths.status == PathStatus.EDGES).sum())
    if around:
        progress.note(
            f"{counted(around, 'path', verbs=('was', 'were'))} measured along the edges, which is "
            "slightly too long: holes or non-manifold edges stop every plane cut.",
            "along_edges",
            paths=around,
        )
    shown, measures = cloud.subset(mask), local_measures(cloud)
    own = {
        "importance": importance[mask],
        "feature_radius": measures["feature_radius"][mask],
        "radius_ratio": measures["radius_ratio"][mask],
    }
    unit = FilterUnit.length(fine.diagonal, "threshold")
    layer = cloud_layer("skeleton_importance", shown, own, unit=unit)
    return Outcome(
        shape=fine,
        layers=(layer, samples_layer(fine)),
        values={
            "samples": fine.point_count,
            "skeleton_points": len(shown),
            "points_above_percent": {
                f"{100 * share:g}": int(important_points(chosen, threshold=share).sum())
                for share in SHARES
            },
            **summary(importance[mask], "importance"),
            **summary(shown.radii, "radius"),
            "between_parts": unreached,
            "along_edges": around,
            "diagonal": fine.diagonal,
        },
        arrays={
            **cloud_arrays(cloud),
            **measures,
            "importance": importance,
            "geodesic_length": paths.length,
            "start_tangent": numbers(paths.start_tangent),
            "end_tangent": numbers(paths.end_tangent),
            "path_status": paths.status,
            "selected": mask,
        },
    )


SKELETON_IMPORTANCE = Operation(
    name="skeleton_importance",
    filter_name="generate_surface_skeleton_with_importance",
    label="Skeleton with importance",
    group="Skeleton",
    help="Compute the surface skeleton with geodesic importance, and simplify it by one number.\n\n"
    "The importance of a skeleton point is the length of the shortest path over the surface "
    "between its two feature points. It grows from the border of the skeleton inwards, so a "
    "threshold removes what bumps and noise made and leaves the rest in one piece. Spoke angle, "
    "radius, feature radius and radius ratio come along for comparison. Needs a mesh.",
    source="thesis 3.3",
    examples=(("creature.ply --threshold 2%", "only what is more important than 2 % of the size"),),
    layers={
        "skeleton_importance": "centers of the medial balls with their importance",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=SkeletonImportanceRun,
    run=run_skeleton_importance,
    order=20,
)

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


def run_geodesic_path(shape: Shape, options: GeodesicPathRun, progress: Progress) -> Outcome:
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


GEODESIC_PATH = Operation(
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
    run=run_geodesic_path,
    needs_faces=True,
    thin_lines=True,
    lies_on_shape=True,
    order=50,
)
