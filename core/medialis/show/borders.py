"""Triangles cut where what they show changes, so that borders are lines and no saw-teeth.

Labels and limits belong to vertices; what lies between is decided along each edge: the border
between two labels crosses it where both are as near, counted over a few rings of neighbours, the
limit where the value between the two ends reaches it. Neighbouring triangles share the cuts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.validation import FloatArray, IntArray

ROUNDS = 6
"""Rings of neighbours over which the border between two labels is smoothed."""
LEAST = 0.08
"""A cut keeps this share of an edge away from its ends: no slivers."""

JUMP = 0.5
"""Share of a limit by which a value may change along one edge and still be even there."""

CORNERS = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]])


class Pieces(NamedTuple):
    """Triangles after the cut.

    Attributes
    ----------
    points : (p, 3) float64
        The given points first.
    faces : (t, 3) int32
    shares : (p - n, 3) float64
        Of each new point: its two ends, as whole numbers, and the share of the second.
    side : (t,) int32
        The label of each piece; of levels, how many lie below it.
    """

    points: FloatArray
    faces: IntArray
    shares: FloatArray
    side: IntArray


def cut_by_labels(points: FloatArray, faces: IntArray, labels: NDArray[np.integer]) -> Pieces:
    """Cut triangles along the borders between the labels (n,) of their vertices.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    >>> cut = cut_by_labels(square, np.array([[0, 1, 2], [0, 2, 3]]), np.array([0, 1, 1, 0]))
    >>> len(cut.faces), sorted(set(cut.side.tolist()))
    (6, [0, 1])
    """
    near = _nearness(len(points), faces, labels)

    def share(first: IntArray, second: IntArray) -> FloatArray:
        return _balanced(near, labels, first, second)

    return _cut(points, faces, labels.astype(np.int32), share)


def _balanced(
    near: Any, labels: NDArray[np.integer], first: IntArray, second: IntArray
) -> FloatArray:
    """Return where two vertices of different labels are equally near to both, as a share."""
    ours, theirs = labels[first], labels[second]
    at_first = near(first, ours) - near(first, theirs)
    total = at_first + near(second, theirs) - near(second, ours)
    return np.divide(at_first, total, out=np.full(len(first), 0.5), where=total > 0)


def cut_at_levels(
    points: FloatArray, faces: IntArray, values: FloatArray, levels: Sequence[float]
) -> tuple[Pieces, FloatArray]:
    """Cut triangles where the values (n,) of their vertices reach levels, ascending.

    Where a value jumps by more than `JUMP` of the level from one vertex to the next, as at the foot
    of a rib, it has no values between: there the cut is that of labels, and each side keeps its
    own.

    Returns
    -------
    pieces : Pieces
    corners : (t, 3) float64
        Values at the corners of the pieces, those of its side at a cut.

    Examples
    --------
    >>> given = np.array([0.0, 1.0, 1.0])
    >>> cut, corners = cut_at_levels(np.eye(3), np.array([[0, 1, 2]]), given, [4.0])
    >>> len(cut.faces), corners.tolist()
    (1, [[0.0, 1.0, 1.0]])
    """
    bounds = np.array([-np.inf, *levels, np.inf])
    side = np.searchsorted(bounds[1:-1], values, side="right").astype(np.int32)
    near = _nearness(len(points), faces, side)

    def is_even(first: IntArray, second: IntArray) -> NDArray[np.bool_]:
        level = bounds[np.maximum(side[first], side[second])]
        jumps = np.abs(values[second] - values[first]) > JUMP * level
        return np.asarray(~jumps & (np.abs(side[second] - side[first]) == 1))

    def share(first: IntArray, second: IntArray) -> FloatArray:
        level = bounds[np.maximum(side[first], side[second])]
        reached = (level - values[first]) / (values[second] - values[first])
        balanced = _balanced(near, side, first, second)
        return np.where(is_even(first, second), reached, balanced)

    cut = _cut(points, faces, side, share)
    first, second = cut.shares[:, 0].astype(np.int32), cut.shares[:, 1].astype(np.int32)
    level, even = bounds[np.maximum(side[first], side[second])], is_even(first, second)
    ends = (pick(values[first], values[second]) for pick in (np.minimum, np.maximum))
    low, high = (np.concatenate([values, np.where(even, level, one)])[cut.faces] for one in ends)
    least, most = bounds[cut.side][:, None], bounds[cut.side + 1][:, None]
    own = np.where((high >= least) & (high < most), high, low)
    return cut, np.clip(own, least, np.nextafter(most, -np.inf))


def _nearness(count: int, faces: IntArray, labels: NDArray[np.integer]) -> Any:
    """Return a function of vertices and labels: the share of their surroundings of that label."""
    from scipy import sparse

    known, numbers = np.unique(labels, return_inverse=True)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1], np.repeat(np.arange(count)[:, None], 2, axis=1)])
    near = sparse.csr_matrix((np.ones(len(ends)), ends.T), (count, count))
    near.data[:] = 1.0
    near = sparse.diags_array(1.0 / np.asarray(near.sum(axis=1)).ravel()) @ near
    shares = sparse.csr_matrix((np.ones(count), (np.arange(count), numbers)), (count, len(known)))
    for _ in range(ROUNDS):
        shares = near @ shares

    def share(vertices: IntArray, wanted: NDArray[np.integer]) -> FloatArray:
        columns = np.searchsorted(known, wanted)
        return np.asarray(shares[vertices, columns]).ravel() if len(vertices) else np.zeros(0)

    return share


def _cut(points: FloatArray, faces: IntArray, side: IntArray, share: Any) -> Pieces:
    faces = np.asarray(faces, np.int64)
    of = side[faces]
    mixed = ~((of[:, 0] == of[:, 1]) & (of[:, 1] == of[:, 2]))
    whole, cut, of = faces[~mixed], faces[mixed], of[mixed]
    ends = np.sort(np.concatenate([cut[:, [0, 1]], cut[:, [1, 2]], cut[:, [2, 0]]]), axis=1)
    ends = np.unique(ends[side[ends[:, 0]] != side[ends[:, 1]]], axis=0)
    at = np.clip(share(ends[:, 0], ends[:, 1]), LEAST, 1 - LEAST)
    keys = ends[:, 0] * len(points) + ends[:, 1]

    def middle(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
        key = np.minimum(a, b) * len(points) + np.maximum(a, b)
        return len(points) + np.searchsorted(keys, key)

    new, sides = [whole], [side[whole[:, 0]]]
    same = of[:, CORNERS[:, 1]] == of[:, CORNERS[:, 2]]  # the two others are of one side
    three = ~same.any(axis=1)
    turned = CORNERS[np.argmax(same[~three], axis=1)]
    a, b, c = np.take_along_axis(cut[~three], turned, axis=1).T
    p, q = middle(a, b), middle(a, c)
    new += [np.stack(one, axis=1) for one in ((a, p, q), (p, b, c), (p, c, q))]
    sides += [side[a], side[b], side[b]]
    more = points[ends[:, 0]] * (1 - at[:, None]) + points[ends[:, 1]] * at[:, None]
    shares = np.column_stack([ends, at])
    corners = cut[three]
    if len(corners):
        first = len(points) + len(more)
        hub = first + np.arange(len(corners))
        edges = [middle(corners[:, k], corners[:, (k + 1) % 3]) for k in range(3)]
        for k in range(3):
            tip, left, right = corners[:, k], edges[k - 1], edges[k]
            new += [np.stack([tip, right, hub], axis=1), np.stack([tip, hub, left], axis=1)]
            sides += [side[tip], side[tip]]
        more = np.concatenate([more, points[corners].mean(axis=1)])
        shares = np.concatenate([shares, np.column_stack([corners[:, :2], np.full(len(hub), 0.5)])])
    return Pieces(
        np.concatenate([points, more]),
        np.concatenate(new).astype(np.int32),
        shares,
        np.concatenate(sides).astype(np.int32),
    )
