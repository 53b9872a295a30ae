"""Everything that the report of a run measures, as plain data (`measure`).

The balls that a result shows (`shown_balls`) are what its quality is measured by: by two-sided
distances between the surface and their union (thesis 3.4), by how deep samples lie inside, and, of
a curve skeleton, by how centred its nodes are and how many loops and parts it has.
"""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.errors import InvalidShapeError
from medialis.base.threads import thread_count
from medialis.base.validation import FloatArray, IntArray, as_field, as_points
from medialis.base.version import package_version
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.operations.result import Result
from medialis.shape.diagnosis import Diagnosis, diagnose
from medialis.shape.shape import Shape
from medialis.show.reports.page import NOUNS, verdicts
from medialis.skeleton.medial_cloud import BallStatus

if TYPE_CHECKING:
    from medialis.base.box_tree import NearestTree

PLACES_BETWEEN = 100_000
"""Places of the surface between the samples that are looked at."""

BALLS_LOOKED_AT = 20_000
"""More balls than this are thinned evenly: the far side is a measurement, not a proof."""

SPHERE_POINTS, FEWEST, MOST = 640_000, 32, 512
"""Points looked at on all spheres, and on each."""

INSIDE = 1e-9
"""Fraction of the diagonal: points deeper than this are inside a ball, not on it."""


@dataclass(frozen=True)
class ReconstructionError:
    """How far a surface and the union of balls are apart, in units of the shape.

    Attributes
    ----------
    surface_to_balls_max, surface_to_balls_mean : float
        Over the surface, the mean by area: distance to the union; inside of it, the depth in the
        deepest ball (one-sided Hausdorff distance, and its mean).
    balls_to_surface_max, balls_to_surface_mean : float or None
        Over the boundary of the union, the mean by area: distance to the surface. None when no
        point that was looked at is on the boundary.
    worst_place : (3,) float64
        Where the two-sided Hausdorff distance was found: a point of the surface or of a ball.
    deepest_sample, deep_95_percent : float
        Depth of the samples in the deepest ball around them, 0 outside: the largest, and the one
        that 95 % of the samples do not exceed. 0 is empty.
    """

    surface_to_balls_max: float
    surface_to_balls_mean: float
    balls_to_surface_max: float | None
    balls_to_surface_mean: float | None
    worst_place: FloatArray
    deepest_sample: float
    deep_95_percent: float

    @property
    def hausdorff(self) -> float:
        """Two-sided Hausdorff distance."""
        return max(self.surface_to_balls_max, self.balls_to_surface_max or 0.0)


def distance_to_balls(
    queries: ArrayLike, centers: ArrayLike, radii: ArrayLike
) -> tuple[FloatArray, IntArray]:
    """Return the signed distance of points to a union of balls, and the ball that decides it.

    Parameters
    ----------
    queries : (q, 3) float
    centers : (k, 3) float
    radii : (k,) float, >= 0

    Returns
    -------
    distance : (q,) float64
        min |x - c| - r: exact outside of the union; inside, minus the depth in the deepest ball.
    ball : (q,) int32
        Its row; the distance ties of two balls go either way, but always the same way.

    Raises
    ------
    InvalidShapeError
        For arrays of a wrong shape, or no ball.

    Notes
    -----
    Cost: about O(log k) a query for balls of a skeleton.
    """
    return _tree_of_balls(centers, radii)[0].distances(as_points(queries, "queries"))


def _tree_of_balls(
    centers: ArrayLike, radii: ArrayLike
) -> tuple[NearestTree, FloatArray, FloatArray]:
    """Return the tree of some balls, and these as arrays that were checked."""
    from medialis.base.box_tree import NearestTree

    middles = as_points(centers, "centers")
    sizes = as_field(radii, len(middles), "radii")
    if not np.isfinite(sizes).all() or (sizes < 0).any():
        raise InvalidShapeError("radii must be finite and not negative.")
    return NearestTree.of_balls(middles, sizes), middles, sizes


def distance_to_surface(queries: ArrayLike, shape: Shape) -> FloatArray:
    """Return the distance of points to the triangles of a mesh, or the samples of a cloud, (q,)."""
    from medialis.base.box_tree import NearestTree

    points = as_points(queries, "queries")
    if shape.faces is None:
        return np.asarray(shape.tree.query(points, workers=thread_count())[0])
    return NearestTree.of_triangles(shape.points, shape.faces).distances(points)[0]


def reconstruction_error(shape: Shape, centers: ArrayLike, radii: ArrayLike) -> ReconstructionError:
    """Measure how well a union of balls gives back a surface, both ways.

    Parameters
    ----------
    shape : Shape
    centers, radii : (k, 3), (k,) float
        Balls of a skeleton, perhaps a simplified one.

    Returns
    -------
    ReconstructionError

    Raises
    ------
    InvalidShapeError
        For arrays of a wrong shape, or no ball.

    Notes
    -----
    Source: thesis 3.4 measures it in images (`medialis.reconstruct_image`); here it is measured in
    space. The surface is seen at its samples and at the middles of its edges and faces (at most
    100,000 of these), the balls at 32 to 512 points on each of at most 20,000.
    """
    tree, middles, sizes = _tree_of_balls(centers, radii)
    between, areas = _between(shape)
    places = np.concatenate([shape.points, between])
    out, _ = tree.distances(places)
    inside = INSIDE * shape.diagonal
    depth = np.where(out < -inside, -out, 0.0)[: shape.point_count]
    rows = _thinned(len(sizes), BALLS_LOOKED_AT)
    spread = _sphere_points(int(np.clip(SPHERE_POINTS // len(rows), FEWEST, MOST)))
    spheres = (middles[rows, None] + sizes[rows, None, None] * spread).reshape(-1, 3)
    bare = np.flatnonzero(tree.distances(spheres, enough=-inside)[0] >= -inside)
    boundary, ball = spheres[bare], rows[bare // len(spread)]
    back = distance_to_surface(boundary, shape) if len(boundary) else None
    far = np.abs(out)
    worst = places[far.argmax()]
    if back is not None and back.max() > far.max():
        worst = boundary[back.argmax()]
    return ReconstructionError(
        float(far.max()),
        _mean_over_surface(shape, far, areas),
        None if back is None else float(back.max()),
        None if back is None else _mean(back, (sizes[ball] / max(sizes.max(), 1e-300)) ** 2),
        worst,
        float(depth.max()),
        float(np.percentile(depth, 95)),
    )


def _between(shape: Shape) -> tuple[FloatArray, FloatArray]:
    """Middles of the edges, then of the faces, thinned evenly, and areas of these faces.

    Nothing for a cloud.
    """
    if shape.faces is None:
        return np.empty((0, 3)), np.empty(0)
    edges = len(shape.edges)
    rows = _thinned(edges + shape.face_count, PLACES_BETWEEN)
    on_edges = shape.points[shape.edges[rows[rows < edges]]].mean(axis=1)
    faces = rows[rows >= edges] - edges
    on_faces = shape.points[shape.faces[faces]].mean(axis=1)
    return np.concatenate([on_edges, on_faces]), shape.face_areas[faces]


def _mean_over_surface(shape: Shape, values: FloatArray, areas: FloatArray) -> float:
    """Integrate over triangles: a quarter by their corners, the rest by their middles.

    That is exact for polynomials of degree 2. The places on edges are for the maximum only.
    """
    at_samples = _mean(values[: shape.point_count], shape.point_areas)
    if len(areas) == 0:
        return at_samples
    return 0.25 * at_samples + 0.75 * _mean(values[-len(areas) :], areas)


def _mean(values: FloatArray, weights: FloatArray) -> float:
    """Weighted mean; the plain one where no weight is positive."""
    return float(np.average(values, weights=weights if weights.any() else None))


def _thinned(count: int, most: int) -> IntArray:
    """At most this many of the numbers below count, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _sphere_points(count: int) -> FloatArray:
    """Fibonacci points on the unit sphere, (count, 3)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)


MOST_STEPS = 1000
"""Balls on one edge of a curve skeleton at most."""


@dataclass(frozen=True, eq=False)
class ShownBalls:
    """Balls of a result.

    Attributes
    ----------
    what : str
        Words for what they are.
    centers, radii : (k, 3), (k,) float64
    inner : (k,) bool
        False for balls on the outer side of the surface.
    by_shrinking : bool
        Found by ball shrinking: no sample lies deeper inside than the tolerance.
    """

    what: str
    centers: FloatArray
    radii: FloatArray
    inner: np.ndarray[tuple[int], np.dtype[np.bool_]]
    by_shrinking: bool


def shown_balls(result: Result) -> ShownBalls | None:
    """Return the balls that a result shows; None when it has none.

    They are those along its curve skeleton, else those of its first layer, else all valid ones of
    its arrays.
    """
    graph = result.extras.get("graph")
    if graph is not None and len(graph.nodes):
        centers, radii = along(graph, result.shape.spacing)
        inner = np.ones(len(radii), bool)
        return ShownBalls("balls along the curve skeleton", centers, radii, inner, False)
    first = result.layers[0] if result.layers else None
    if first is not None and "feature_1" in first.attributes and len(first.points):
        radii = np.asarray(first.attributes["radius"])
        side = np.asarray(first.attributes.get("side", np.ones(len(radii))))
        return ShownBalls("balls shown", first.points, radii, side > 0, True)
    if "radii" in result.arrays and (good := result.arrays["status"] == BallStatus.OK).any():
        centers, radii, side = (result.arrays[name][good] for name in ("centers", "radii", "side"))
        return ShownBalls("balls of all samples", centers, radii, side > 0, True)
    return None


def along(graph: CurveSkeleton, step: float) -> tuple[FloatArray, FloatArray]:
    """Return the balls of the nodes, and balls between them no further apart than a step.

    Parameters
    ----------
    graph : CurveSkeleton
    step : float
        Length; radii are interpolated between the nodes.

    Returns
    -------
    centers, radii : (k, 3), (k,) float64
    """
    balls = np.column_stack([graph.nodes, graph.radii])
    if not len(graph.edges) or not step > 0:
        return graph.nodes, graph.radii
    pieces = np.clip(np.ceil(graph.edge_lengths / step), 1, MOST_STEPS).astype(np.int64)
    edge = np.repeat(np.arange(len(pieces)), pieces - 1)
    first = np.cumsum(pieces - 1) - (pieces - 1)
    share = (np.arange(len(edge)) - first[edge] + 1) / pieces[edge]
    a, b = graph.edges[edge].T
    between = balls[a] + share[:, None] * (balls[b] - balls[a])
    full = np.concatenate([balls, between])
    return np.ascontiguousarray(full[:, :3]), np.ascontiguousarray(full[:, 3])


LENGTHS_OF_FILE = ("radius", "importance", "thickness", "wall_thickness", "checked_thickness")
HISTOGRAMS = (*LENGTHS_OF_FILE, "spoke_angle", "sharpness")
BINS = 40
LENGTHS = (
    *("surface_to_balls_max", "surface_to_balls_mean"),
    *("balls_to_surface_max", "balls_to_surface_mean", "hausdorff"),
)
"""Of a reconstruction, in per cent of the diagonal."""

SPOTS, TABLES = "spots", {"regions": "Walls to look at", "ribs": "Ribs and bosses"}
"""Values that are tables of places: thin spots, and others with their titles in a report."""


def measure(result: Result, *, source: str | None = None) -> dict[str, Any]:
    """Measure the quality of a result; the content of ``report.json``.

    Parameters
    ----------
    result : Result
        Of any operation; what it has no data for is None.
    source : str, optional
        Name of the input.

    Returns
    -------
    dict
        ``verdict`` (see `verdicts`), ``input`` (the diagnosis before repair, and of the shape as
        computed on), ``parameters``, ``automatic`` (those that were chosen), ``values``, ``balls``
        (how many samples have one, and which are measured), ``reconstruction`` and ``emptiness``
        (per cent of the diagonal), ``envelope`` (the same of a medial mesh), ``centredness`` (share
        of the radius), ``topology``, ``histograms``, ``thin_spots``, ``tables``, ``messages``,
        ``seconds``, ``versions``.
    """
    shape = result.shape
    before = None if shape.diagnosis is None else shape.diagnosis.as_dict()
    after = diagnose(shape.points, shape.faces)
    balls = shown_balls(result)
    reconstruction, emptiness = _against_the_surface(shape, balls)
    found = {
        "operation": result.operation,
        "source": source,
        "input": {"as_read": before, "as_computed": after.as_dict()},
        "unit": result.shape.unit,
        "parameters": dict(result.parameters),
        "automatic": list(result.automatic),
        "values": {
            name: value for name, value in result.values.items() if name not in (SPOTS, *TABLES)
        },
        "balls": _ball_counts(result, balls),
        "reconstruction": reconstruction,
        "emptiness": emptiness,
        "envelope": _envelope(result),
        "centredness": _centredness(result),
        "topology": _topology(result, after),
        "histograms": _histograms(result, balls),
        "thin_spots": result.values.get(SPOTS),
        "tables": {name: result.values[name] for name in TABLES if name in result.values},
        "messages": list(result.messages),
        "seconds": dict(result.seconds),
        "versions": {
            "medialis": package_version(),
            **{name: version(name) for name in ("numpy", "scipy", "numba")},
            "python": platform.python_version(),
            "platform": platform.platform(),
        },
    }
    return {**found, "verdict": verdicts(found)}


def _ball_counts(result: Result, balls: ShownBalls | None) -> dict[str, Any] | None:
    """Count the balls that are measured, and the inner ones that samples have or lack."""
    if balls is None:
        return None
    counts: dict[str, Any] = {
        "measured": len(balls.radii),
        "what": balls.what,
        "by_shrinking": balls.by_shrinking,
    }
    if "status" in result.arrays:
        status, inner = result.arrays["status"], result.arrays["side"] > 0
        status = status[inner] if inner.any() else status
        counts["started"] = len(status)
        named = ("maximal", BallStatus.OK), ("open", BallStatus.OPEN)
        for name, kind in (*named, ("without_normal", BallStatus.NO_NORMAL)):
            counts[name] = int((status == kind).sum())
    return counts


def _against_the_surface(
    shape: Shape, balls: ShownBalls | None
) -> tuple[dict[str, Any] | None, dict[str, Any] | None]:
    """Reconstruction by the inner balls and emptiness of all, in per cent of the diagonal."""
    if balls is None or not shape.diagonal > 0:
        return None, None
    per_cent, inner = 100 / shape.diagonal, balls.inner
    reconstruction: dict[str, Any] | None = None
    depth = 0.0, 0.0
    if inner.any():
        error = reconstruction_error(shape, balls.centers[inner], balls.radii[inner])
        depth = error.deepest_sample, error.deep_95_percent
        lengths = {name: getattr(error, name) for name in LENGTHS}
        reconstruction = {k: None if v is None else per_cent * v for k, v in lengths.items()}
        reconstruction["worst_place"] = error.worst_place.tolist()
    if not inner.all():
        inside = np.maximum(-distance_to_balls(shape.points, balls.centers, balls.radii)[0], 0.0)
        depth = float(inside.max()), float(np.percentile(inside, 95))
    emptiness = {"deepest": per_cent * depth[0], "deep_95_percent": per_cent * depth[1]}
    return reconstruction, emptiness


def _envelope(result: Result) -> dict[str, Any] | None:
    """Distances between the surface and the envelope of a medial mesh, in per cent."""
    values, diagonal = result.values, result.shape.diagonal
    if "surface_to_envelope" not in values or not diagonal > 0:
        return None
    names = ("surface_to_envelope", "envelope_to_surface", "mean_error", "largest_error")
    return {
        **{name: 100 / diagonal * values[name] for name in names},
        "worst_place": values["position"],
    }


def _centredness(result: Result) -> dict[str, float] | None:
    """Distance to the surface over the radius, of the nodes of a curve skeleton; 1 is centred."""
    graph = result.extras.get("graph")
    if graph is None or not (graph.radii > 0).any():
        return None
    nodes = np.flatnonzero(graph.radii > 0)
    share = distance_to_surface(graph.nodes[nodes], result.shape) / graph.radii[nodes]
    return {
        "median": float(np.median(share)),
        "lowest": float(share.min()),
        "low_5_percent": float(np.percentile(share, 5)),
        "highest": float(share.max()),
    }


def _topology(result: Result, after: Diagnosis) -> dict[str, Any]:
    """Count what the shape has, and what a curve skeleton should have and has."""
    cloud = result.shape.faces is None
    topology: dict[str, Any] = {
        "components": None if cloud else after.components,
        "genus": after.genus,
        "boundary_loops": None if cloud else after.boundary_loops,
        "found": {name: result.values[name] for name in NOUNS if name in result.values},
    }
    if "hollows" in result.values and after.closed:  # a solid has a boundary for each hollow, too
        topology |= {
            "expected_parts_and_hollows": after.components,
            "parts_and_hollows": result.values["parts"] + result.values["hollows"],
            "expected_handles": after.genus,
            "handles": result.values["loops"],
        }
    graph = result.extras.get("graph")
    if graph is not None:
        by_part = result.operation == "curve_skeleton"  # it knows the genus of each part
        expected = result.values.get("expected_loops") if by_part else after.genus
        topology |= {
            "expected_loops": expected,
            "expected_loops_certain": result.values.get("expected_loops_certain", True),
            "loops": graph.loops,
            "expected_components": topology["components"],
            "skeleton_components": graph.component_count,
        }
    return topology


def _histograms(result: Result, balls: ShownBalls | None) -> dict[str, dict[str, Any]]:
    """Histograms of the first layer that knows a quantity; of the balls where none has radii."""
    found: dict[str, ArrayLike] = {}
    for layer in sorted(result.layers, key=lambda layer: layer.on_input):  # samples go first
        for name in HISTOGRAMS:
            if name not in found and name in layer.attributes:
                found[name] = layer.attributes[name]
    if balls is not None:
        found.setdefault("radius", balls.radii)
    return {name: histogram(found[name]) for name in HISTOGRAMS if name in found}


def histogram(values: ArrayLike) -> dict[str, Any]:
    """Count the finite values in bins of equal width, and the others.

    Returns
    -------
    dict
        ``counts`` (40,) and ``edges`` (41,) of the bins, one bin where all values are equal up to
        rounding, none without finite values; ``count`` of finite values, ``min``, ``median``,
        ``max`` (None without one), ``infinite``, ``missing`` (NaN).
    """
    every = np.asarray(values, np.float64)
    finite = every[np.isfinite(every)]
    found: dict[str, Any] = {
        **{"counts": [], "edges": [], "count": len(finite)},
        **dict.fromkeys(("min", "median", "max")),
        "infinite": int(np.isinf(every).sum()),
        "missing": int(np.isnan(every).sum()),
    }
    if len(finite) == 0:
        return found
    low, high = float(finite.min()), float(finite.max())
    found |= {"min": low, "median": float(np.median(finite)), "max": high}
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        return {**found, "counts": [len(finite)], "edges": [low, high]}
    counts, edges = np.histogram(finite, BINS, (low, high))
    return {**found, "counts": counts.tolist(), "edges": edges.tolist()}
