"""Shapes made by code: the organic demo shape of the README and the command line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.model.shape import Shape
from medialis.surface.normals import vertex_normals
from medialis.validation import as_whole_number

# Round cones of a four-legged creature, one row each: ends (x, y, z) and their radii. +x is ahead,
# +z up; rows of _MIRRORED appear on both sides. Everything is then pressed flat along y: the
# cross-sections are ellipses, so that the skeleton has sheets, not only curves.
_BODY = (
    ((-0.62, 0.00, 0.62), (-0.05, 0.00, 0.60), 0.24, 0.21),
    ((-0.05, 0.00, 0.60), (0.45, 0.00, 0.66), 0.21, 0.27),
    ((0.50, 0.00, 0.74), (0.92, 0.00, 1.12), 0.20, 0.11),
    ((0.92, 0.00, 1.16), (1.22, 0.00, 1.06), 0.15, 0.075),
    ((-0.82, 0.00, 0.72), (-1.15, 0.00, 0.52), 0.060, 0.045),
    ((-1.15, 0.00, 0.52), (-1.32, 0.00, 0.20), 0.045, 0.035),
)
_MIRRORED = (
    ((0.50, 0.20, 0.58), (0.46, 0.27, 0.30), 0.14, 0.085),
    ((0.46, 0.27, 0.30), (0.47, 0.27, 0.02), 0.085, 0.065),
    ((0.47, 0.27, 0.02), (0.56, 0.27, -0.01), 0.067, 0.060),
    ((-0.62, 0.20, 0.56), (-0.58, 0.28, 0.32), 0.18, 0.090),
    ((-0.58, 0.28, 0.32), (-0.70, 0.28, 0.02), 0.085, 0.065),
    ((-0.70, 0.28, 0.02), (-0.61, 0.28, -0.01), 0.067, 0.060),
    ((0.85, 0.09, 1.26), (0.76, 0.26, 1.45), 0.070, 0.030),
)
_FLAT = 1.6
_BLEND = 0.05  # length over which two parts flow into each other
_LOW, _HIGH = np.array([-1.45, -0.34, -0.16]), np.array([1.40, 0.34, 1.56])


def organic_shape(resolution: int = 128) -> Shape:
    """Make a smooth four-legged creature: closed, genus 0, with limbs, ears and a tail.

    Parameters
    ----------
    resolution : int
        Grid cells along the longest side, 56 to 600; the number of vertices grows with its square
        (128: about 12,000).

    Returns
    -------
    Shape
        A closed mesh of about 2.7 units length, outward normals.

    Raises
    ------
    InvalidOptionError
        When `resolution` is out of its range.

    See Also
    --------
    dental_arch : another one.
    read_shape : from a file.

    Examples
    --------
    >>> import medialis
    >>> medialis.organic_shape(56).faces is not None
    True
    """
    resolution = as_whole_number(resolution, "resolution", low=56, high=600)
    cell = float((_HIGH - _LOW).max()) / resolution
    axes = [np.arange(low, high + cell, cell) for low, high in zip(_LOW, _HIGH, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = _creature(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    make_unambiguous(distance)
    points, faces = surface_nets(distance, _LOW, cell)
    for _ in range(3):  # Newton steps onto the surface along the gradient
        gradient = _gradient(points, 0.01 * cell)
        square = np.einsum("ij,ij->i", gradient, gradient)
        points = points - (_creature(points) / square)[:, None] * gradient
    return Shape(points, vertex_normals(points, faces), faces)


def _creature(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smooth minimum of the signed distances to all round cones."""
    parts = [*_BODY]
    for a, b, ra, rb in _MIRRORED:
        parts.append((a, b, ra, rb))
        parts.append(((a[0], -a[1], a[2]), (b[0], -b[1], b[2]), ra, rb))
    # Part after part: a table of all distances at once would need 20 times the memory. The term of
    # a far part is exp(-60) and does not matter.
    points = points * [1.0, _FLAT, 1.0]
    total = np.zeros(len(points))
    for a, b, ra, rb in parts:
        start, along = np.array(a), np.array(b) - np.array(a)
        share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
        away = np.linalg.norm(points - start - share[:, None] * along, axis=1)
        total += np.exp(np.clip(-(away - ra - share * (rb - ra)) / _BLEND, -60.0, 60.0))
    return -_BLEND * np.log(total)


def _gradient(points: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    offsets = step * np.eye(3)
    return np.stack(
        [(_creature(points + o) - _creature(points - o)) / (2 * step) for o in offsets], axis=1
    )


def make_unambiguous(values: NDArray[np.float64]) -> None:
    """Change the sign of grid values nearest to zero until the net is a manifold, in place.

    Surface nets pinch where the corners of a grid square are inside and outside crosswise, or where
    only two opposite corners of a cube are on one side.
    """
    tiny = 1e-9 * float(np.abs(values).max())
    shifts = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    squares = [shifts[shifts[:, axis] == 0][[0, 1, 3, 2]] for axis in range(3)]  # in ring order
    diagonals = [np.array([a, 1 - a]) for a in shifts[:4]]
    while True:
        flips = []
        inside = values < 0
        for ring in squares:
            corner = _corners(inside, ring)
            crossed = (corner[0] == corner[2]) & (corner[1] == corner[3]) & (corner[0] != corner[1])
            flips.append(_nearest_to_zero(values, crossed, ring))
        cube = _corners(inside, shifts)
        count = sum(c.astype(np.int8) for c in cube)
        for pair in diagonals:
            first, second = _corners(inside, pair)
            lonely = ((count == 2) & first & second) | ((count == 6) & ~first & ~second)
            flips.append(_nearest_to_zero(values, lonely, pair))
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
    values: NDArray[np.float64], found: NDArray[np.bool_], offsets: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Of the corners at `offsets` of each found cell, the grid place with the smallest value."""
    base = np.argwhere(found)
    places = base[:, None, :] + offsets[None, :, :]
    size = np.abs(values[tuple(np.moveaxis(places, -1, 0))])
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
