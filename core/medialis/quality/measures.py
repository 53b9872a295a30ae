"""Everything that the report of a run measures, as plain data."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import BallStatus
from medialis.model.shape import Shape
from medialis.operations.result import Layer, Result
from medialis.quality.distances import reconstruction_error
from medialis.shape.diagnosis import diagnose
from medialis.validation import FloatArray
from medialis.version import package_version

HISTOGRAMS = ("radius", "importance", "thickness", "spoke_angle")
BINS = 40
FOUND = ("components", "expected_loops", "loops", "pieces", "sheets", "parts", "patches")
"""Values of results that say something about topology or parts."""


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
        ``input`` (the diagnosis before repair, and of the shape as computed on), ``parameters``,
        ``reconstruction`` and ``emptiness`` (per cent of the diagonal), ``centredness`` (share of
        the radius), ``topology``, ``histograms``, ``thin_spots``, ``messages``, ``seconds``,
        ``versions``.
    """
    shape = result.shape
    before = None if shape.diagnosis is None else shape.diagnosis.as_dict()
    after = diagnose(shape.points, shape.faces)
    balls = _balls(result)
    return {
        "operation": result.operation,
        "source": source,
        "input": {"as_read": before, "as_computed": after.as_dict()},
        "parameters": dict(result.parameters),
        "values": {k: v for k, v in result.values.items() if not isinstance(v, list | dict)},
        "reconstruction": None if balls is None else _reconstruction(shape, *balls),
        "emptiness": None if balls is None else _emptiness(shape, *balls),
        "centredness": _centredness(result),
        "topology": {
            "components": after.components,
            "genus": after.genus,
            "found": {name: result.values[name] for name in FOUND if name in result.values},
        },
        "histograms": _histograms(result.layers),
        "thin_spots": result.values.get("spots"),
        "messages": list(result.messages),
        "seconds": dict(result.seconds),
        "versions": {
            "medialis": package_version(),
            **{name: version(name) for name in ("numpy", "scipy", "numba")},
            "python": platform.python_version(),
            "platform": platform.platform(),
        },
    }


def _balls(result: Result) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Balls of the result: those it shows, else all valid ones of its arrays."""
    first = result.layers[0] if result.layers else None
    if first is not None and "feature_1" in first.attributes:
        return first.points, np.asarray(first.attributes["radius"])
    if "radii" in result.arrays:
        good = result.arrays["status"] == BallStatus.OK
        return result.arrays["centers"][good], result.arrays["radii"][good]
    return None


def _reconstruction(
    shape: Shape, centers: NDArray[np.float64], radii: NDArray[np.float64]
) -> dict[str, float]:
    error = reconstruction_error(shape, centers, radii)
    per_cent = 100 / shape.diagonal
    return {
        "surface_to_balls_max": per_cent * error.surface_to_balls_max,
        "surface_to_balls_mean": per_cent * error.surface_to_balls_mean,
        "balls_to_surface_max": per_cent * error.balls_to_surface_max,
        "balls_to_surface_mean": per_cent * error.balls_to_surface_mean,
        "hausdorff": per_cent * error.hausdorff,
    }


def _emptiness(
    shape: Shape, centers: NDArray[np.float64], radii: NDArray[np.float64]
) -> dict[str, float]:
    """How deep the samples lie in the balls, per cent of the diagonal; 0 is empty."""
    from scipy.spatial import cKDTree

    nearest, _ = cKDTree(shape.points).query(centers, workers=-1)
    depth = np.maximum(radii - nearest, 0.0) * 100 / shape.diagonal
    return {"deepest": float(depth.max()), "deep_95_percent": float(np.percentile(depth, 95))}


def _centredness(result: Result) -> dict[str, float] | None:
    """Distance to the surface over the radius, of the points of curves; 1 is centred."""
    from medialis.quality.distances import distance_to_surface

    curves = [x for x in result.layers if x.edges is not None and "radius" in x.attributes]
    if not curves or not len(curves[0].points):
        return None
    radius = np.asarray(curves[0].attributes["radius"])
    share = distance_to_surface(curves[0].points, result.shape) / np.maximum(radius, 1e-300)
    return {"median": float(np.median(share)), "lowest": float(share.min())}


def _histogram(values: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Count finite values in bins; values that are equal but for rounding get a narrow range."""
    low, high = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
    room = 1e-9 * max(abs(low), abs(high))
    if len(values) == 0 or high - low > room or room == 0:
        return np.histogram(values, BINS)
    return np.histogram(values, BINS, (low - room, high + room))


def _histograms(layers: tuple[Layer, ...]) -> dict[str, dict[str, list[float]]]:
    found: dict[str, dict[str, list[float]]] = {}
    for layer in (layer for layer in layers if not layer.auxiliary):
        for name in HISTOGRAMS:
            if name in found or name not in layer.attributes:
                continue
            values = np.asarray(layer.attributes[name], float)
            counts, edges = _histogram(values[np.isfinite(values)])
            found[name] = {"counts": counts.tolist(), "edges": edges.tolist()}
    return found
