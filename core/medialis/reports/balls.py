"""The balls that a result shows: what its quality is measured by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import BallStatus
from medialis.operations.result import Result
from medialis.validation import FloatArray

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
    if result.graph is not None and len(result.graph.nodes):
        centers, radii = along(result.graph, result.shape.spacing)
        inner = np.ones(len(radii), bool)
        return ShownBalls("balls along the curve skeleton", centers, radii, inner, False)
    first = result.layers[0] if result.layers else None
    if first is not None and "feature_1" in first.attributes and len(first.points):
        radii = np.asarray(first.attributes["radius"])
        side = np.asarray(first.attributes.get("side", np.ones(len(radii))))
        return ShownBalls("balls shown", first.points, radii, side > 0, True)
    if "radii" in result.arrays:
        good = result.arrays["status"] == BallStatus.OK
        if good.any():
            arrays = {name: result.arrays[name][good] for name in ("centers", "radii", "side")}
            inner = arrays["side"] > 0
            return ShownBalls(
                "balls of all samples", arrays["centers"], arrays["radii"], inner, True
            )
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
