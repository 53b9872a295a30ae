"""Walks along graphs: from node to node, and polylines between the places where edges meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError


def follow(onward: NDArray[np.integer], start: int) -> list[int]:
    """Walk from a node to where the next one is negative, both ends included.

    Parameters
    ----------
    onward : (v,) int
        The node that comes after each one, negative: none.
    start : int

    Examples
    --------
    >>> follow(np.array([-1, 0, 1, 1]), 3)
    [3, 1, 0]
    """
    walk = [start]
    while (after := int(onward[walk[-1]])) >= 0:
        walk.append(after)
    return walk


def places_along(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the length of a polyline up to each of its points, (k,).

    Examples
    --------
    >>> places_along(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]])).tolist()
    [0.0, 5.0, 6.0]
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def polylines(edges: ArrayLike, count: int) -> list[NDArray[np.int32]]:
    """Cut a graph into polylines at its ends and branch points.

    Parameters
    ----------
    edges : (e, 2) int
        Pairs of vertices 0..count-1, each edge once.
    count : int
        Number of vertices.

    Returns
    -------
    list of (k,) int32
        Vertices along each polyline, k >= 2; every edge is in exactly one. A closed loop ends with
        the vertex that it begins with. Polylines begin at the lowest vertex that is an end or a
        branch point; loops without one come last.

    Raises
    ------
    InvalidShapeError
        When an edge names a vertex that does not exist.

    Examples
    --------
    >>> [line.tolist() for line in polylines([[0, 1], [1, 2], [1, 3], [3, 4]], 5)]
    [[0, 1], [1, 2], [1, 3, 4]]
    """
    pairs = np.asarray(edges, np.int64).reshape(-1, 2)
    if len(pairs) and (pairs.min() < 0 or pairs.max() >= count):
        raise InvalidShapeError(
            f"edges must name vertices 0..{count - 1}, got {pairs.min()}..{pairs.max()}."
        )
    ends = pairs.ravel()
    order = np.argsort(ends, kind="stable")  # half-edges by vertex; half-edge h is of edge h // 2
    first = np.searchsorted(ends[order], np.arange(count + 1))
    degree = np.diff(first)
    used = np.zeros(len(pairs), bool)
    vertex, halves, starts = ends.tolist(), order.tolist(), first.tolist()

    def line_from(half: int) -> NDArray[np.int32]:
        line = [vertex[half]]
        while True:
            used[half // 2] = True
            here = vertex[half ^ 1]
            line.append(here)
            if degree[here] != 2:
                return np.array(line, np.int32)
            a, b = halves[starts[here] : starts[here] + 2]
            half = b if a == half ^ 1 else a
            if used[half // 2]:
                return np.array(line, np.int32)

    knots = np.flatnonzero((degree > 0) & (degree != 2)).tolist()
    rest = np.flatnonzero(degree == 2).tolist()
    return [
        line_from(half)
        for knot in (*knots, *rest)
        for half in halves[starts[knot] : starts[knot + 1]]
        if not used[half // 2]
    ]
