"""Meshes of the zero level of a signed function, for shapes made by code."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np
from numpy.typing import NDArray

from medialis.base.validation import FloatArray
from medialis.shape.normals import ring_normals
from medialis.shape.shape import Shape

SignedDistance = Callable[[FloatArray], FloatArray]
"""Values (n,) at points (n, 3): below zero inside."""

FLIP_ROUNDS = 20
"""After so many rounds of changing signs grid values are only made inside."""


def implicit_shape(
    distance: SignedDistance, low: FloatArray, high: FloatArray, resolution: int
) -> Shape:
    """Mesh the zero level of a smooth function in a box with `resolution` cells along its length.

    The result is a closed manifold; its vertices lie on the surface up to a tiny part of a cell.
    """
    cell = float((high - low).max()) / resolution
    axes = [np.arange(lower, upper + cell, cell) for lower, upper in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = distance(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    make_unambiguous(values)
    points, faces = surface_nets(values, low, cell)
    for _ in range(3):  # Newton steps onto the surface along the gradient
        gradient = _gradient(distance, points, 0.01 * cell)
        square = np.einsum("ij,ij->i", gradient, gradient)
        points = points - (distance(points) / square)[:, None] * gradient
    return Shape(points, ring_normals(points, faces), faces)


def _gradient(distance: SignedDistance, points: FloatArray, step: float) -> FloatArray:
    offsets = step * np.eye(3)
    return np.stack(
        [(distance(points + o) - distance(points - o)) / (2 * step) for o in offsets], axis=1
    )


def make_unambiguous(values: NDArray[np.float64]) -> None:
    """Change the sign of grid values nearest to zero until the net is a manifold, in place.

    Surface nets pinch where the corners of a grid square are inside and outside crosswise, or where
    only two opposite corners of a cube are on one side. Where changes undo each other the surface
    is filled, which comes to an end.
    """
    tiny = 1e-9 * float(np.abs(values).max())
    shifts = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    squares = [shifts[shifts[:, axis] == 0][[0, 1, 3, 2]] for axis in range(3)]  # in ring order
    diagonals = [np.array([a, 1 - a]) for a in shifts[:4]]
    for attempt in count(1):
        flips = []
        inside = values < 0
        fill = attempt > FLIP_ROUNDS
        sizes = np.where(inside, np.inf, values) if fill else np.abs(values)
        for ring in squares:
            corner = _corners(inside, ring)
            crossed = (corner[0] == corner[2]) & (corner[1] == corner[3]) & (corner[0] != corner[1])
            flips.append(_nearest_to_zero(sizes, crossed, ring))
        cube = _corners(inside, shifts)
        corners = sum(c.astype(np.int8) for c in cube)
        for pair in diagonals:
            first, second = _corners(inside, pair)
            lonely = ((corners == 2) & first & second) | ((corners == 6) & ~first & ~second)
            flips.append(_nearest_to_zero(sizes, lonely, shifts if fill else pair))
        places = np.unique(np.concatenate(flips), axis=0)
        if len(places) == 0:
            return
        at = tuple(places.T)
        values[at] = np.where(inside[at], tiny, -tiny)


def _corners(grid: NDArray[np.bool_], offsets: NDArray[np.int64]) -> list[NDArray[np.bool_]]:
    """Return views of a grid shifted by each offset (0 or 1 an axis), all of the same shape."""
    ends = np.array(grid.shape) - offsets.max(axis=0)
    return [
        grid[tuple(slice(o, o + e) for o, e in zip(offset, ends, strict=True))]
        for offset in offsets
    ]


def _nearest_to_zero(
    sizes: NDArray[np.float64], found: NDArray[np.bool_], offsets: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Of the corners at `offsets` of each found cell, the grid place with the smallest size."""
    base = np.argwhere(found)
    places = base[:, None, :] + offsets[None, :, :]
    size = sizes[tuple(np.moveaxis(places, -1, 0))]
    return places[np.arange(len(base)), size.argmin(axis=1)] if len(base) else base


def surface_nets(
    values: NDArray[np.float64], low: NDArray[np.float64], cell: float
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Mesh the zero level: one vertex in each cell it crosses, one quadrangle for each grid edge.

    Naive surface nets (Gibson 1998): the vertex is the mean of the crossings on the cell's edges.
    """
    inside = values < 0
    size = np.array(values.shape)
    total, count = np.zeros((*(size - 1), 3)), np.zeros(size - 1)
    corners = [(i, j) for i in (0, 1) for j in (0, 1)]
    crossings = []
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        here = np.moveaxis(values, axis, 0)
        flips = inside.take(range(size[axis] - 1), axis) != inside.take(range(1, size[axis]), axis)
        at = np.argwhere(flips)
        first = here[at[:, axis], at[:, others[0]], at[:, others[1]]]
        second = here[at[:, axis] + 1, at[:, others[0]], at[:, others[1]]]
        place = at.astype(float)
        place[:, axis] += first / (first - second)
        crossings.append((axis, at, first < 0))
        for i, j in corners:  # the four cells around the grid edge
            index = at.copy()
            index[:, others[0]] -= i
            index[:, others[1]] -= j
            np.add.at(total, tuple(index.T), place)
            np.add.at(count, tuple(index.T), 1)
    used = count > 0
    number = np.full(used.shape, -1, np.int32)
    number[used] = np.arange(used.sum(), dtype=np.int32)
    points = low + cell * total[used] / count[used][:, None]

    faces = []
    for axis, at, starts_inside in crossings:
        u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        ring = [number[tuple((at - offset).T)] for offset in (0 * u, u, u + v, v)]
        quad = np.stack(ring, axis=1)
        quad[~starts_inside] = quad[~starts_inside, ::-1]
        faces.append(quad)
    quads = np.concatenate(faces)
    p = points[quads]
    short = np.linalg.norm(p[:, 0] - p[:, 2], axis=1) <= np.linalg.norm(p[:, 1] - p[:, 3], axis=1)
    triangles = np.where(
        short[:, None, None], quads[:, [[0, 1, 2], [0, 2, 3]]], quads[:, [[1, 2, 3], [1, 3, 0]]]
    )
    return points, triangles.reshape(-1, 3).astype(np.int32)
