"""Arrays that belong together: dataclasses of them, ragged rows, equal rows, edges of faces, walks.

`Described` gives a dataclass of arrays a short text. `Ragged` holds rows of unequal length in two
flat arrays (compressed sparse rows). `EdgeTable` groups half-edges by the edge that they lie on:
the one place that sorts them. `first_equal_row` finds equal rows through a hash and confirms them
exactly; `polylines` cuts a graph where edges meet. `extent`, `unit_rows`, `corner_vectors` and
`sums_of` are what points, vectors, triangles and groups of rows are asked for most.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray, IntArray, frozen


def first_equal_row(rows: NDArray[Any]) -> NDArray[np.int64]:
    """Return for each row the lowest row that is equal to it, (n,); itself when there is none.

    Parameters
    ----------
    rows : (n, 3) float64 without NaN, or integers up to 2^53
        Compared as numbers: -0.0 equals 0.0.

    Notes
    -----
    Rows are looked up by a hash of 64 bits, and compared. Cost O(n).
    """
    from medialis.base._kernels import find_equal_places

    places, first = np.ascontiguousarray(rows, np.float64), np.empty(len(rows), np.int64)
    find_equal_places(places, np.full(2 << len(rows).bit_length(), -1, np.int32), first)
    return first


def distinct(keys: NDArray[Any]) -> NDArray[Any]:
    """Return the distinct values of an array in ascending order.

    `np.unique` puts integers into a table of hashes: of 400,000 that takes 80 times as long.
    """
    keys = np.sort(keys, axis=None)
    return keys[np.concatenate([np.ones(min(len(keys), 1), np.bool_), keys[1:] != keys[:-1]])]


def extent(points: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of the box round points (n, 3), two (3,) arrays."""
    # Column by column: numpy is ten times slower along rows of three.
    low, high = ([end(column) for column in points.T] for end in (np.min, np.max))
    return np.array(low), np.array(high)


class Described:
    """A dataclass of arrays whose text is one short line: give the decorator ``repr=False``."""

    def __repr__(self) -> str:
        parts = (_described(f.name, getattr(self, f.name)) for f in fields(self) if f.repr)  # type: ignore[arg-type]
        text = f"{type(self).__name__}({', '.join(filter(None, parts))})"
        return text if len(text) < LONGEST_TEXT else text[: LONGEST_TEXT - 5] + "...)"


CELLS_ALONG_SPACE = 1024  # halved < 0.1 %, doubled 8 %
"""Along the largest side of the box, for the order of pairs."""

LONGEST_TEXT = 160
"""Characters."""


def _described(name: str, value: Any) -> str:
    """Say what a field holds: numbers of three, the size of an array, names of a mapping, or it."""
    if value is None or isinstance(value, Described):
        return ""
    if isinstance(value, np.ndarray):
        if value.shape == (3,):  # a place, a direction
            return f"{name} ({', '.join(f'{v:.6g}' for v in value.tolist())})"
        return f"{name} {' x '.join(map(str, value.shape))}"
    if isinstance(value, Mapping):
        return f"{name}: {', '.join(map(str, value))}" if value else ""
    if isinstance(value, tuple | list) and any(isinstance(v, Described) for v in value):
        return f"{len(value)} {name}"
    return f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {value!r}"


@dataclass(frozen=True, eq=False, repr=False)
class Ragged(Described):
    """Rows of indices; row i is ``indices[offsets[i]:offsets[i + 1]]``.

    Attributes
    ----------
    offsets : (rows + 1,) int64, non-decreasing from 0
    indices : (offsets[-1],) int32

    Raises
    ------
    InvalidShapeError
        When the offsets do not describe the indices.

    Examples
    --------
    >>> rows = Ragged([0, 2, 2, 3], [5, 6, 7])
    >>> [row.tolist() for row in rows]
    [[5, 6], [], [7]]
    """

    offsets: NDArray[np.int64]
    indices: IntArray

    def __post_init__(self) -> None:
        offsets = frozen(np.asarray(self.offsets), np.int64)
        indices = frozen(np.asarray(self.indices), np.int32)
        if (
            offsets.ndim != 1
            or indices.ndim != 1
            or len(offsets) == 0
            or offsets[0] != 0
            or offsets[-1] != len(indices)
            or (np.diff(offsets) < 0).any()
        ):
            raise InvalidShapeError(
                "Ragged offsets must rise from 0 to the number of indices, "
                f"got {offsets[:3].tolist()}..{offsets[-1:].tolist()} for {indices.shape} indices."
            )
        object.__setattr__(self, "offsets", offsets)
        object.__setattr__(self, "indices", indices)

    @classmethod
    def group(cls, keys: ArrayLike, rows: int) -> Ragged:
        """Group 0..len(keys)-1 by key: row r lists the positions whose key is r, ascending.

        Negative keys are left out. Cost: O(len(keys) + rows).

        Raises
        ------
        InvalidShapeError
            When a key is not below `rows`.
        """
        from medialis.base._kernels import group_keys

        key = np.ascontiguousarray(keys)
        if key.dtype != np.int32:
            key = key.astype(np.int64)
        if key.max(initial=-1) >= rows:
            raise InvalidShapeError(f"Keys must be below {rows} rows, got {key.max()}.")
        offsets, order = np.zeros(rows + 2, np.int64), np.empty(len(key), np.int32)
        group_keys(key, offsets, order)
        return cls(offsets[:-1], order[: offsets[-1]])

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, row: int) -> IntArray:
        if not -len(self) <= row < len(self):
            raise IndexError(f"row {row} of {len(self)}")
        row %= len(self)
        return self.indices[self.offsets[row] : self.offsets[row + 1]]

    def __iter__(self) -> Iterator[IntArray]:
        return (self[row] for row in range(len(self)))

    def joined(self, rows: ArrayLike) -> IntArray:
        """Return the indices of some rows, one row after the other.

        Examples
        --------
        >>> Ragged([0, 2, 2, 3], [5, 6, 7]).joined([2, 0]).tolist()
        [7, 5, 6]
        """
        first = self.offsets[:-1][np.asarray(rows, np.int64)]
        count = self.offsets[1:][np.asarray(rows, np.int64)] - first
        ends = np.cumsum(count)
        return self.indices[np.arange(count.sum()) + np.repeat(first - (ends - count), count)]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Number of indices in each row, (rows,)."""
        return np.diff(self.offsets)


Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Half-edges grouped by the undirected edge they lie on.

    Half-edge h = 3 f + j runs from corner j of face f to the next corner. The edges are in
    ascending order of their vertices; one of them joins a vertex with itself where a face names a
    vertex twice.

    Attributes
    ----------
    order : (3m,) int32
        Half-edges, edge after edge, ascending within an edge.
    first : (e + 1,) int32
        Where the half-edges of each edge start in `order`.
    ends : (e, 2) int32
        Lower and higher vertex of each edge.
    forward : (3m,) bool
        Whether a half-edge runs from its lower to its higher vertex.
    """

    order: IntArray
    first: IntArray
    ends: IntArray
    forward: Mask

    @classmethod
    def of(cls, faces: IntArray, n: int) -> EdgeTable:
        """Group the half-edges of faces (m, 3) over n vertices."""
        from medialis.base._kernels import group_sides

        corners = np.ascontiguousarray(faces, np.int32).ravel()
        sides = len(corners)
        if n > 4 * sides + 4:  # few of many vertices
            used, named = np.unique(corners, return_inverse=True)
            table = cls.of(named.reshape(-1, 3).astype(np.int32), len(used))
            return cls(table.order, table.first, used[table.ends], table.forward)
        order, first = np.empty(sides, np.int32), np.empty(sides + 1, np.int32)
        ends, forward = np.empty((sides, 2), np.int32), np.empty(sides, np.bool_)
        edges = group_sides(corners, n, order, first, ends, forward)
        return cls(order, first[: edges + 1].copy(), ends[:edges].copy(), forward)

    def turned(self, faces: Mask) -> EdgeTable:
        """Return the table where some faces (m,) have their second and third corner exchanged.

        Their side j is then side 2 - j, and runs the other way. No face names a vertex twice.
        """
        from medialis.base._kernels import turn_sides

        order, forward = np.empty_like(self.order), np.empty_like(self.forward)
        turn_sides(self.order, self.forward, faces, order, forward)
        return EdgeTable(order, self.first, self.ends, forward)

    @property
    def low(self) -> IntArray:
        """Lower vertex of each edge, (e,)."""
        return self.ends[:, 0]

    @property
    def high(self) -> IntArray:
        """Higher vertex of each edge, (e,)."""
        return self.ends[:, 1]

    @cached_property
    def counts(self) -> IntArray:
        """Number of half-edges on each edge, (e,)."""
        return np.diff(self.first)

    @property
    def edge_of(self) -> Index:
        """Row of the edge that each half-edge lies on, (3m,)."""
        result = np.empty(len(self.order), np.int64)
        result[self.order] = np.repeat(np.arange(len(self.low)), self.counts)
        return result

    @cached_property
    def pairs(self) -> tuple[IntArray, IntArray, Mask]:
        """Both half-edges of each edge with exactly two, and whether they run opposite ways."""
        from medialis.base._kernels import pair_sides

        one, other = np.empty((2, len(self.order) // 2), np.int32)
        opposite = np.empty(len(one), np.bool_)
        count = pair_sides(self.order, self.first, self.forward, one, other, opposite)
        return one[:count], other[:count], opposite[:count]

    @property
    def single(self) -> IntArray:
        """The half-edges of boundary edges."""
        return self.order[self.first[:-1][self.counts == 1]]


def kd_tree(points: FloatArray, *, near: bool = True) -> Any:
    """Return the kd-tree of some points; scipy is loaded when the first one is asked for.

    Where few of the places asked for are `near` to a point, boxes that are not shrunk to the points
    take a half to a fifth of the time; else they take 10 % more. What is found is the same.
    """
    from scipy.spatial import cKDTree

    return cKDTree(points, compact_nodes=near)


def unit_rows(vectors: FloatArray, least: float = 0.0, instead: Any = 0.0) -> FloatArray:
    """Return vectors (..., 3) with the length 1; `instead` where they are not above `least`."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    out = np.array(np.broadcast_to(instead, vectors.shape), np.float64)
    return np.divide(vectors, length, out=out, where=length > least)


def perpendicular(ways: FloatArray) -> FloatArray:
    """Return unit vectors at right angles to vectors (..., 3); zero for zero vectors."""
    return unit_rows(np.cross(ways, np.eye(3)[np.argmin(np.abs(ways), axis=-1)]))


def corner_vectors(points: FloatArray, faces: NDArray[np.integer]) -> FloatArray:
    """Return the normal of each triangle times twice its area, (m, 3)."""
    a, b, c = (points[faces[:, j]] for j in range(3))
    return np.cross(b - a, c - a)


def enclosed_volume(points: FloatArray, faces: NDArray[np.integer]) -> float:
    """Return the volume inside of triangles, roughly where they are not closed."""
    corners = points[faces] - points.mean(axis=0)
    return abs(float(np.linalg.det(corners).sum())) / 6


def twice_areas(points: FloatArray, faces: NDArray[np.integer]) -> FloatArray:
    """Return twice the area of each triangle, (m,)."""
    return np.asarray(np.linalg.norm(corner_vectors(points, faces), axis=1))


def weighted_graph(weights: FloatArray, a: Index, b: Index, count: int) -> Any:
    """Return links a -> b (e,) with weights as a sparse (count, count) array for scipy's csgraph.

    Its functions take 32-bit indices alone in older versions of scipy.
    """
    from scipy.sparse import coo_array

    ends = np.asarray(a, np.int32), np.asarray(b, np.int32)
    matrix = coo_array((weights, ends), shape=(count, count)).tocsr()
    matrix.indices, matrix.indptr = (
        part.astype(np.int32, copy=False) for part in (matrix.indices, matrix.indptr)
    )
    return matrix


def sums_of(rows: NDArray[np.integer], values: FloatArray, count: int) -> FloatArray:
    """Return the sums (count, k) of the values (n, k) that belong to each of so many rows."""
    return np.stack([np.bincount(rows, one, minlength=count) for one in values.T], axis=1)


def rows_of_labels(label: NDArray[np.integer]) -> list[NDArray[np.int64]]:
    """Return the places of each label that occurs, ascending, by rising label."""
    order, sizes = np.argsort(label, kind="stable"), np.bincount(label)
    return np.split(order, np.cumsum(sizes[sizes > 0])[:-1]) if len(label) else []


def next_side(sides: Any) -> Any:
    """Return the half-edge after each in its face; corner or half-edge 3 f + k is the kth of f."""
    return sides + 1 - 3 * (sides % 3 == 2)


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


def rows_at(
    at: ArrayLike, places: NDArray[np.float64], rows: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what rows (k, d) at places (k,), rising, are in between, (..., d).

    Examples
    --------
    >>> rows = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]])
    >>> rows_at([0.0, 2.5], places_along(rows), rows).tolist()
    [[0.0, 0.0], [1.5, 2.0]]
    """
    wanted = np.asarray(at, np.float64)
    return np.stack([np.interp(wanted, places, column) for column in rows.T], axis=-1)


def along_space(points: FloatArray) -> IntArray:
    """Return the places of points along a Z-curve: those of points close together are close."""
    low, high = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
    scale = CELLS_ALONG_SPACE / max(float((high - low).max(initial=0.0)), 1e-300)
    code = np.zeros(len(points), np.int32)
    for axis in range(3):
        cell = (points[:, axis] - low[axis]) * scale
        part = np.minimum(cell, CELLS_ALONG_SPACE - 1).astype(np.int32)
        for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
            part = (part | part << shift) & mask
        code |= part << axis
    return code


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
