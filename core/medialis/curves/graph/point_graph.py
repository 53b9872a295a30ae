"""Graph through a cloud of points that lie on a curve skeleton, each with its radius."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.curves.graph.finishing import finish_graph
from medialis.curves.graph.ground import link_balls
from medialis.curves.graph.growth import grow_graph
from medialis.curves.graph.handles import Handles
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.validation import as_field, as_number, as_points


def point_graph(
    points: ArrayLike,
    radii: ArrayLike,
    *,
    strength: ArrayLike | None = None,
    neighbours: int = 10,
    smoothing: float = 0.7,
    handles: Mapping[int, Handles] | None = None,
) -> CurveSkeleton:
    """Build the graph of a curve skeleton from points on it, by the same steps as for a mesh.

    Parameters
    ----------
    points : (k, 3) float
        Points on the curve skeleton, with noise.
    radii : (k,) float
        Radius of the ball round each point that lies in the shape. Points are linked when each
        lies in the other's ball, so that the graph stays inside the shape.
    strength : (k,) float, optional
        Above 0: how sure each point is. Branches prefer the sure ones. All the same when missing.
    neighbours : int
        Nearest points that each point is linked to.
    smoothing : float
        As in `medialis.curve_skeleton`.
    handles : dict, optional
        Loops to close: ``find_handles(shape)``, where points hang together in the same pieces as
        the shape. Without it the graph is a forest.

    Returns
    -------
    CurveSkeleton
        One component for each piece of points that links hold together.

    Raises
    ------
    InvalidShapeError
        When the points and radii do not fit together.
    InvalidOptionError
        When an option is out of its range.

    See Also
    --------
    curve_skeleton : of a mesh.
    view_curve_skeleton : from pictures.

    Notes
    -----
    Source: thesis 3.6.3 for the aim; see `growth.py` for the method.

    Examples
    --------
    >>> import medialis
    >>> line = np.linspace([0, 0, 0], [10, 0, 0], 200)
    >>> graph = medialis.point_graph(line, np.ones(200))
    >>> graph.branch_count, graph.end_points.size, round(graph.length, 6)
    (1, 2, 10.0)
    """
    from medialis._kernels.neighbours import nearest_others

    smoothing = as_number(smoothing, "smoothing", low=0.0, high=10.0)
    centers = as_points(points)
    radius = as_field(radii, len(centers), "radii")
    sure = (
        np.ones(len(centers)) if strength is None else as_field(strength, len(centers), "strength")
    )
    size = float(np.linalg.norm(np.ptp(centers, axis=0)))
    near, distance = nearest_others(centers, neighbours)
    spacing = float(np.median(distance[:, 0])) if distance.size else 0.0
    spacing = max(spacing, 1e-9 * size, 1e-300)
    closeness = np.clip(sure / max(float(np.median(sure)), 1e-300), 0.0, 1.0)
    every = np.arange(len(centers))
    links = link_balls(centers, radius, closeness, [(every, near)], [], spacing=spacing)
    # Of equally sure points the thickest one comes first.
    first = sure + 1e-9 * radius / max(float(radius.max()), 1e-300) * max(float(sure.max()), 1e-300)
    pieces = _pieces(links.offsets, links.neighbours)
    edges, _ = grow_graph(links, pieces, first, np.ones(len(centers), bool), handles)
    return finish_graph(links, edges, smoothing)[0]


def _pieces(offsets: NDArray[np.int64], neighbours: NDArray[np.int32]) -> NDArray[np.int32]:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    k = len(offsets) - 1
    ones = np.ones(len(neighbours), np.int8)
    graph = csr_array((ones, neighbours, offsets), shape=(k, k))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)
