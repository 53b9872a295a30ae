"""Everything that the report of a run measures, as plain data."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from medialis.model.diagnosis import Diagnosis
from medialis.model.medial_cloud import BallStatus
from medialis.model.shape import Shape
from medialis.operations.result import Result
from medialis.reports.balls import ShownBalls, shown_balls
from medialis.reports.distances import (
    distance_to_balls,
    distance_to_surface,
    reconstruction_error,
)
from medialis.reports.verdicts import NOUNS, verdicts
from medialis.surface.diagnosis import diagnose
from medialis.version import package_version

HISTOGRAMS = ("radius", "importance", "thickness", "spoke_angle", "sharpness")
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
        computed on), ``parameters``, ``values``, ``balls`` (how many samples have one, and which
        are measured), ``reconstruction`` and ``emptiness`` (per cent of the diagonal),
        ``envelope`` (the same of a medial mesh), ``centredness`` (share of the radius),
        ``topology``, ``histograms``, ``thin_spots``, ``tables``, ``messages``, ``seconds``,
        ``versions``.
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
        status = result.arrays["status"]
        side = result.arrays["side"]
        status = status[side > 0] if (side > 0).any() else status
        counts |= {
            "started": len(status),
            "maximal": int((status == BallStatus.OK).sum()),
            "open": int((status == BallStatus.OPEN).sum()),
            "without_normal": int((status == BallStatus.NO_NORMAL).sum()),
        }
    return counts


def _against_the_surface(
    shape: Shape, balls: ShownBalls | None
) -> tuple[dict[str, Any] | None, dict[str, Any] | None]:
    """Reconstruction by the inner balls and emptiness of all, in per cent of the diagonal."""
    if balls is None or not shape.diagonal > 0:
        return None, None
    per_cent, inner = 100 / shape.diagonal, balls.inner
    error, depth = None, (0.0, 0.0)
    if inner.any():
        error = reconstruction_error(shape, balls.centers[inner], balls.radii[inner])
        depth = error.deepest_sample, error.deep_95_percent
    if not inner.all():
        inside = -distance_to_balls(shape.points, balls.centers, balls.radii)[0]
        inside = np.maximum(inside, 0.0)
        depth = float(inside.max()), float(np.percentile(inside, 95))
    reconstruction: dict[str, Any] | None = None
    if error is not None:
        lengths = {name: getattr(error, name) for name in LENGTHS}
        reconstruction = {k: None if v is None else per_cent * v for k, v in lengths.items()}
        reconstruction["worst_place"] = error.worst_place.tolist()
    emptiness = {
        "deepest": per_cent * depth[0],
        "deep_95_percent": per_cent * depth[1],
    }
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
    graph = result.graph
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
    if result.graph is not None:
        by_part = result.operation == "curve_skeleton"  # it knows the genus of each part
        expected = result.values.get("expected_loops") if by_part else after.genus
        topology |= {
            "expected_loops": expected,
            "expected_loops_certain": result.values.get("expected_loops_certain", True),
            "loops": result.graph.loops,
            "expected_components": topology["components"],
            "skeleton_components": result.graph.component_count,
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
        "counts": [],
        "edges": [],
        "count": len(finite),
        "min": None,
        "median": None,
        "max": None,
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
