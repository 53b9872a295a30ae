"""Operations: the skeleton as balls, with importance, as triangles; geodesics (thesis 3.2-3.4)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.arrays import Index, Mask, places_along
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import AUTO, changed, file, flag, length, whole
from medialis.base.progress import Progress, counted
from medialis.base.validation import FloatArray
from medialis.formats.files import number_lines
from medialis.operations.declaration import Operation, Selection
from medialis.operations.positions import numbers
from medialis.operations.result import FilterUnit, Layer, Outcome, Result
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
from medialis.skeleton.layers import (
    cloud_arrays,
    cloud_layer,
    computed,
    samples_layer,
    summary,
    vertices_of_input,
)
from medialis.skeleton.medial_cloud import BallStatus, MedialCloud, ShrinkOptions, Side
from medialis.skeleton.skeleton_mesh import (
    SkeletonMesh,
    SkeletonMeshOptions,
    measured_importance,
    require_faces,
    skeleton_mesh,
)
from medialis.skeleton.surface_skeleton import (
    Preparation,
    SurfaceSkeletonOptions,
    uniform_subsample,
)

HIDDEN_BELOW = 0.03  # halved 40 %, doubled 37 %
"""Fraction of the diagonal, chosen by looking at bunny, cow, horse, hand, fandisk and armadillo:
0.02 leaves fuzz in the bunny's back and the armadillo's head, 0.05 takes the cow's horns and the
horse's feet. A limb's importance is half its girth, so thin limbs need less: see `_shown_from`."""

ROUND_LIMB = 2.8  # halved 19 %, doubled 37 %
"""Radii: a path as long runs nearly half round its ball (pi), as in limbs and behind walls and not
on bumps."""

LIMBS_SHOWN = 0.9  # halved 2 %, doubled 46 %
"""Of the surface behind the balls of limbs this share stays shown by default."""

SHOWN_SHARE = 99.0  # halved 0 %, doubled 100 %
"""Per cent of the points that the colours span, from the least important up."""

SHARES = (0.005, 0.01, 0.02, 0.05)
"""Of the size: thresholds whose points are counted."""

RIM = "rim_points", "rim_rows", "rim_weights"
"""Arrays of clean rims."""

LARGEST_INDEX = 2_147_483_647
"""Of a vertex: indices are int32."""


@dataclass(frozen=True, kw_only=True)
class SurfaceSkeletonRun(Preparation):
    """Options of the operation `surface_skeleton`."""

    side: Side = changed(ShrinkOptions, "side")
    importance: bool = flag(
        True,
        "Importance",
        "Measure the importance of each point: the length of the shortest path over the surface "
        "between its two feature points. Meshes only, and the inner side.",
    )
    threshold: float = length(
        AUTO,
        "Hide below",
        "Hide the points whose importance is below this share of the size: those of bumps and "
        "noise. They stay in the data; 0 shows all. auto: 3 %, less on shapes with thin limbs.",
        high=10.0,
        auto=HIDDEN_BELOW,
    )
    subsample: float = length(
        0.0,
        "Point distance",
        "Thin the skeleton so that its points are at least this share of the size "
        "apart. 0 keeps all.",
    )
    largest_radius: float = changed(ShrinkOptions, "largest_radius")
    fans: bool = changed(SurfaceSkeletonOptions, "fans", default=True)


def run_surface_skeleton(shape: Shape, options: SurfaceSkeletonRun, progress: Progress) -> Outcome:
    """Refine, shrink balls, measure their importance, thin the cloud if asked to."""
    cloud = computed(shape, options, progress, 0.3)
    fine = cloud.surface
    importance = None
    if options.importance and fine.faces is not None and options.side == "inner":
        with progress.stage("importance", 0.3, 0.95):
            importance = _importance(cloud, options, progress)
    with progress.stage("subsample", 0.95, 1.0):
        mask = uniform_subsample(cloud, options.subsample)
    shown = cloud.subset(mask)
    values: dict[str, Any] = {
        "samples": fine.point_count,
        "skeleton_points": len(shown),
        "open_balls": int((cloud.status == BallStatus.OPEN).sum()),
        "without_normal": int((cloud.status == BallStatus.NO_NORMAL).sum()),
        **summary(shown.radii, "radius"),
        **summary(shown.spoke_angles, "spoke_angle"),
        "diagonal": fine.diagonal,
        "spacing": fine.spacing,
    }
    arrays = {**cloud_arrays(cloud), "selected": mask}
    layer = cloud_layer("surface_skeleton", shown)
    if importance is not None:
        layer = _measured(shown, importance[mask], options, progress)
        values["hidden_points"] = int(layer.hidden.sum())
        values |= summary(importance[mask], "importance")
        arrays["importance"] = importance
    return Outcome(shape=fine, layers=(layer, samples_layer(fine)), values=values, arrays=arrays)


def _importance(cloud: MedialCloud, options: SurfaceSkeletonRun, progress: Progress) -> FloatArray:
    """Return the importance of each ball; that of fans does not change that of the samples."""
    paths = geodesic_importance.of(cloud.own, options, progress)
    lengths = connected_importance.of(paths, options, progress).length
    if len(cloud) == len(lengths):
        return lengths
    fans = cloud.subset(np.arange(len(lengths), len(cloud)))
    return np.concatenate([lengths, geodesic_importance.of(fans, options, progress).length])


def _measured(
    cloud: MedialCloud, importance: FloatArray, options: SurfaceSkeletonRun, progress: Progress
) -> Layer:
    """Layer of a cloud with importance, its unimportant points hidden; not if that were all."""
    if "threshold" in options.auto_starts():
        options = options.with_auto_values({"threshold": _shown_from(cloud, importance)}, progress)
    diagonal, threshold = cloud.surface.diagonal, options.threshold
    shown, unit = {"importance": importance}, FilterUnit.length(diagonal, "threshold")
    layer = cloud_layer("surface_skeleton", cloud, shown, unit=unit, hidden_below=threshold)
    # A few points are far more important than the rest, which would all have one colour.
    finite = importance[np.isfinite(importance)]
    if len(finite):
        layer = replace(layer, color_limits=(None, float(np.percentile(finite, SHOWN_SHARE))))
    hidden = int(layer.hidden.sum())
    if hidden == len(cloud):
        layer, hidden = replace(layer, filter_default=0.0), 0
    if hidden:
        text = (
            f"{counted(hidden, 'skeleton point', of=len(cloud), verbs=('is', 'are'))} hidden: the "
            f"importance is below {100 * threshold:.3g} % of the size, as it is for bumps and "
            "noise (threshold = 0 shows all)."
        )
        progress.note(text, "hidden_points", hidden=hidden, points=len(cloud), threshold=threshold)
    return layer


def _shown_from(cloud: MedialCloud, importance: FloatArray) -> float:
    """Return the default threshold, less where it would hide limbs: a fraction of the diagonal."""
    limbs = np.isfinite(importance) & (importance >= ROUND_LIMB * cloud.radii)
    if not limbs.any():
        return HIDDEN_BELOW
    rising = np.flatnonzero(limbs)[np.argsort(importance[limbs], kind="stable")]
    area = np.cumsum(cloud.surface.point_areas[cloud.source[rising]])
    first = rising[np.searchsorted(area, (1.0 - LIMBS_SHOWN) * area[-1])]
    return min(HIDDEN_BELOW, float(importance[first]) / cloud.surface.diagonal)


def _important(result: Result, shape: Shape) -> Mask:
    """Which vertices have a skeleton point that is shown."""
    layer = result.layers[0]
    samples = layer.attributes["source"][~layer.hidden]
    chosen = np.zeros(shape.point_count, bool)  # a refined shape has the given points first
    chosen[samples[samples < len(chosen)]] = True
    return chosen


SURFACE_SKELETON = Operation(
    name="surface_skeleton",
    filter_name="generate_surface_skeleton",
    label="Surface skeleton",
    group="Skeleton",
    help="Compute the surface skeleton (medial axis) of a shape as a cloud of maximal balls.\n\n"
    "Every sample of the surface gets the largest ball that touches the surface there and lies "
    "inside the shape. Each skeleton point carries the radius of its ball (local thickness), the "
    "spoke angle between its two feature points, and the feature points themselves. On a mesh it "
    "carries its importance as well, and what bumps and noise make is hidden. Works on meshes, "
    "also open or non-manifold ones, and on point clouds.",
    source="thesis 3.2, 3.3",
    examples=(
        ("creature.ply", "centers and radii of all medial balls"),
        ("creature.ply -o fine --threshold 0.5% --subsample 1%", "more detail, evenly thinned"),
    ),
    layers={
        "surface_skeleton": "centers of the medial balls with radius, spoke angle, feature points "
        "and importance",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=SurfaceSkeletonRun,
    run=run_surface_skeleton,
    selection=Selection(
        "compute_selection_by_medial_importance_per_vertex",
        "Select the vertices whose skeleton point is more important than a length: all but bumps "
        "and noise.",
        _important,
    ),
    order=10,
    words=("medial axis", "medial surface", "MAT"),
)


def run_skeleton_mesh(shape: Shape, options: SkeletonMeshOptions, progress: Progress) -> Outcome:
    """Refine, shrink balls, choose the points to keep, connect them."""
    require_faces(shape)
    cloud = computed(shape, options, progress, 0.5)
    measured: dict[str, FloatArray] = {}
    if options.importance > 0:
        with progress.stage("importance", 0.5, 0.8):
            measured["importance"] = measured_importance(cloud, options, progress).length
    with progress.stage("mesh", 0.8, 1.0):
        mesh = skeleton_mesh.of(cloud, options, progress)
    fine, keep = cloud.surface, mesh.selected
    if len(mesh.faces) == 0:
        wanted = f"a spoke angle of {options.min_spoke_angle:g} degrees or more"
        advice = "Lower min_spoke_angle or smallest_piece"
        if options.importance > 0:
            wanted += f" and an importance of {options.importance:g} of the size or more"
            advice = "Lower min_spoke_angle, importance or smallest_piece"
        if keep.sum() == cloud.valid.sum():
            advice = "Lower smallest_piece, or refine so that parts have more samples"
        raise InvalidShapeError(
            f"No triangle is left: {int(keep.sum())} of {int(cloud.valid.sum())} balls have "
            f"{wanted}. {advice}."
        )
    radii = mesh.at_points(cloud.radii)
    rim: dict[str, Any] = dict(zip(RIM, mesh.blend or (), strict=False))
    return Outcome(
        shape=fine,
        layers=(mesh_layer("skeleton_mesh", cloud, mesh, measured), samples_layer(fine)),
        values={
            "points": len(mesh.points),
            "faces": len(mesh.faces),
            "area": mesh.area,
            "pieces": mesh.part_count,
            "skeleton_points": int(cloud.valid.sum()),
            "kept_points": int(keep.sum()),
            **summary(radii, "radius"),
            "diagonal": fine.diagonal,
            "spacing": fine.spacing,
        },
        arrays={
            **cloud_arrays(cloud),
            **measured,
            "selected": keep,
            "mesh_faces": mesh.faces,
            "mesh_rows": mesh.rows,
            "mesh_face_origin": mesh.face_origin,
            **rim,
        },
    )


def mesh_layer(
    name: str, cloud: MedialCloud, mesh: SkeletonMesh, measured: Mapping[str, FloatArray]
) -> Layer:
    """Layer of a skeleton mesh with what its points know from the cloud and from measures on it."""
    known = cloud_layer(name, cloud.subset(np.asarray(mesh.rows)))
    measures = {"radius": cloud.radii, "spoke_angle": cloud.spoke_angles, **measured}
    extra = {key: mesh.at_points(values) for key, values in measures.items()}
    return replace(
        known, points=mesh.points, faces=mesh.faces, attributes={**known.attributes, **extra}
    )


SKELETON_MESH = Operation(
    name="skeleton_mesh",
    filter_name="generate_surface_skeleton_mesh",
    label="Surface skeleton mesh",
    group="Skeleton",
    help="Compute the surface skeleton (medial axis) of a mesh as triangles.\n\n"
    "The surface's own triangles are moved to the centers of the balls at their corners; the two "
    "sides of each sheet are merged into one. Points with a small spoke angle (bumps, noise, the "
    "rims of the sheets) are left out. Each point carries the radius of its ball, the spoke angle "
    "and its feature points.",
    source="thesis 3.4.1",
    examples=(
        ("creature.ply --importance 2%", "the skeleton as triangles, without what is unimportant"),
    ),
    layers={
        "skeleton_mesh": "the skeleton as triangles, each sheet once",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=SkeletonMeshOptions,
    run=run_skeleton_mesh,
    needs_faces=True,
    order=60,
    words=("medial axis", "medial surface mesh"),
)


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
        text = "A surface was built through the points of the cloud. Check it in the layer samples."
        progress.note(text, "surface_built")
    cloud = computed(shape, options, progress, 0.2)
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
        text = (
            f"{counted(unreached, 'skeleton point', verbs=('lies', 'lie'))} between separate parts "
            "of the shape, so that no path joins the two feature points. "
            f"{counted(infinite, 'point', verbs=('has', 'have'))} infinite importance; every "
            "threshold keeps them."
        )
        progress.note(text, "between_parts", points=unreached, infinite=infinite)
    around = int((paths.status == PathStatus.EDGES).sum())
    if around:
        progress.note(
            f"{counted(around, 'path', verbs=('was', 'were'))} measured along the edges, which is "
            "slightly too long: holes or non-manifold edges stop every plane cut.",
            "along_edges",
            paths=around,
        )
    shown, measures = cloud.subset(mask), local_measures(cloud)
    own = {"importance": importance[mask]}
    own |= {name: measures[name][mask] for name in ("feature_radius", "radius_ratio")}
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
    words=("medial axis", "prune", "simplify skeleton"),
)


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
    ends = vertices_of_input(shape, pairs, "no path starts or ends there")
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
        text = (
            f"No path joins the vertices of {len(paths) - len(drawn)} of "
            f"{counted(len(paths), 'pair')}: they lie in different components."
        )
        progress.note(text, "unjoined_pairs", pairs=len(paths) - len(drawn), of=len(paths))
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
    arrays = {"pairs": pairs, "length": lengths}
    return Outcome(shape=shape, layers=(_layer(drawn),), values=values, arrays=arrays)


def _layer(drawn: list[tuple[int, Geodesic]]) -> Layer:
    """All polylines, with the distance from their start, and their row in the list of pairs."""
    counts = np.array([len(path.points) for _, path in drawn])
    inside = np.delete(np.arange(counts.sum()), np.cumsum(counts) - 1)  # a last begins no edge
    points = np.concatenate([path.points for _, path in drawn])
    edges = np.stack([inside, inside + 1], axis=1).astype(np.int32)
    distance = np.concatenate([places_along(path.points) for _, path in drawn])
    pair = np.repeat(np.array([row for row, _ in drawn], np.int32), counts)
    known = {"distance": distance, "pair": pair}
    return Layer("geodesic_path", points, edges=edges, attributes=known, color_by="distance")


def _read_pairs(path: str) -> Index:
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
    layers={"geodesic_path": "the paths as polylines with the distance from their start"},
    options=GeodesicPathRun,
    run=run_geodesic_path,
    needs_faces=True,
    thin_lines=True,
    lies_on_shape=True,
    order=50,
    words=("shortest path", "distance on surface"),
)
