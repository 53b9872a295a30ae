"""Zero levels of distance functions as meshes, and two shapes made so: a creature, a dental arch.

The creature is that of the README. The arch comes with the tooth of every vertex. `surface_nets`
makes a mesh of values on a grid; `make_unambiguous` sees to it that it is a manifold.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import kd_tree, places_along, rows_at
from medialis.base.validation import FloatArray, IntArray, as_whole_number, frozen
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


Point = tuple[float, float, float]
Cone = tuple[Point, Point, float, float]
"""Ends (x, y, z) and their radii."""

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
    sample_shape : others, by name.
    read_shape : from a file.

    Examples
    --------
    >>> import medialis
    >>> medialis.organic_shape(56).faces is not None
    True
    """
    resolution = as_whole_number(resolution, "resolution", low=56, high=600)
    return implicit_shape(_creature, _LOW, _HIGH, resolution)


def _creature(points: FloatArray) -> FloatArray:
    """Round cones that flow into each other, pressed flat."""
    cones: list[Cone] = [*_BODY]
    for a, b, ra, rb in _MIRRORED:
        cones.append((a, b, ra, rb))
        cones.append(((a[0], -a[1], a[2]), (b[0], -b[1], b[2]), ra, rb))
    return blended(points * [1.0, _FLAT, 1.0], cones, _BLEND)


def blended(points: FloatArray, cones: Sequence[Cone], blend: float) -> FloatArray:
    """Return a smooth minimum of the signed distances to round cones, (n,).

    Parts flow into each other over the length `blend`.
    """
    # Part after part: a table of all distances at once would need 20 times the memory. The term of
    # a far part is exp(-60) and does not matter.
    total = np.zeros(len(points))
    for a, b, ra, rb in cones:
        start, along = np.array(a), np.array(b) - np.array(a)
        share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
        away = np.linalg.norm(points - start - share[:, None] * along, axis=1)
        total += np.exp(np.clip(-(away - ra - share * (rb - ra)) / blend, -60.0, 60.0))
    return -blend * np.log(total)


# Half an ellipse in the plane z = 0, the front at +y; units of the width of the arch.
_HALF_WIDTH, _DEPTH = 0.5, 0.62
_GUM_HALF_WIDTH, _GUM_HALF_HEIGHT, _GUM_ROUND = 0.075, 0.07, 0.05
_ARCH_BLEND = 0.006  # length over which teeth and gum flow into each other
# From the middle to the side: incisors are narrow and thin, molars wide and thick, canines high.
_WIDTHS = (1.0, 0.85, 0.95, 0.95, 1.0, 1.35, 1.3, 1.15)
_DEPTHS = (0.75, 0.7, 0.85, 0.95, 1.0, 1.2, 1.2, 1.1)
_HEIGHTS = (1.1, 1.05, 1.2, 1.0, 0.95, 0.85, 0.85, 0.8)
_CURVE_POINTS = 400


@dataclass(frozen=True, eq=False)
class _Teeth:
    """Ellipsoids: centers (t, 3), axes (t, 3, 3) as rows, half lengths (t, 3)."""

    centers: FloatArray
    axes: FloatArray
    sizes: FloatArray
    curve: FloatArray

    def distances(self, points: FloatArray) -> NDArray[np.float64]:
        """Distance to the gum, then to each tooth (to first order), (t + 1, n)."""
        result = np.empty((len(self.centers) + 1, len(points)))
        result[0] = _gum_distance(points, self.curve)
        teeth = zip(self.centers, self.axes, self.sizes, strict=True)
        for t, (center, axes, size) in enumerate(teeth):
            local = (points - center) @ axes.T
            level = np.linalg.norm(local / size, axis=1)
            steep = np.linalg.norm(local / size**2, axis=1)
            result[t + 1] = level * (level - 1) / np.maximum(steep, 1e-9)
        return result

    def blended(self, points: FloatArray) -> NDArray[np.float64]:
        """Smooth minimum of all distances."""
        values = self.distances(points)
        least = values.min(axis=0)
        return least - _ARCH_BLEND * np.log(np.exp(-(values - least) / _ARCH_BLEND).sum(axis=0))


def dental_arch(
    teeth: int = 14, *, resolution: int = 200, rng: int | np.random.Generator = 0
) -> tuple[Shape, IntArray]:
    """Make a closed surface like a dental cast: a curved gum with a row of teeth.

    Parameters
    ----------
    teeth : int
        12 to 16; an odd number has one more on one side.
    resolution : int
        Grid cells along the longest side, 100 to 500; the number of vertices grows with its square
        (200: about 50,000).
    rng : int or Generator
        Draws how each tooth differs from its kind: size, lean, place.

    Returns
    -------
    shape : Shape
        A closed mesh, 1.1 units wide, outward normals.
    labels : (n,) int32
        Tooth of each vertex, 0, 1, ... along the arch; -1 is the gum.

    Raises
    ------
    InvalidOptionError
        When an option is out of its range.

    See Also
    --------
    organic_shape : another shape to try things on.
    mean_shift_segments : finds the teeth.

    Notes
    -----
    An example with known segments for thesis 5.3; not in the thesis, which shows scans.

    Examples
    --------
    >>> import medialis
    >>> cast, tooth = medialis.dental_arch(12, resolution=100)
    >>> len(tooth) == cast.point_count, int(tooth.max()) + 1
    (True, 12)
    """
    teeth = as_whole_number(teeth, "teeth", low=12, high=16)
    resolution = as_whole_number(resolution, "resolution", low=100, high=500)
    made = _place_teeth(teeth, np.random.default_rng(rng))
    low = np.array([-_HALF_WIDTH - 0.12, -0.15, -_GUM_HALF_HEIGHT - 0.02])
    high = np.array([_HALF_WIDTH + 0.12, _DEPTH + 0.12, _GUM_HALF_HEIGHT + 0.16])
    cell = float((high - low).max()) / resolution
    axes = [np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True)]
    values = np.empty([len(a) for a in axes])
    plane = np.stack(np.meshgrid(axes[1], axes[2], indexing="ij"), axis=-1).reshape(-1, 2)
    for i, x in enumerate(axes[0]):  # a slice at a time: all distances at once need 17 times more
        slab = np.column_stack([np.full(len(plane), x), plane])
        values[i] = made.blended(slab).reshape(values.shape[1:])
    make_unambiguous(values)
    points, faces = surface_nets(values, low, cell)
    labels = made.distances(points).argmin(axis=0) - 1
    return Shape(points, ring_normals(points, faces), faces), frozen(labels, np.int32)


def _curve() -> tuple[FloatArray, FloatArray]:
    """Points of the arch from left to right, (c, 3), and their arc lengths."""
    turn = np.linspace(math.pi, 0.0, _CURVE_POINTS)
    points = np.stack([_HALF_WIDTH * np.cos(turn), _DEPTH * np.sin(turn), 0 * turn], axis=1)
    return points, places_along(points)


def _place_teeth(count: int, rng: np.random.Generator) -> _Teeth:
    """Teeth side by side along the whole curve."""
    curve, length = _curve()
    kinds = np.concatenate([np.arange(count // 2)[::-1], np.arange(count - count // 2)])
    width = np.array(_WIDTHS)[kinds] * rng.uniform(0.96, 1.04, count)
    width *= length[-1] / width.sum()
    middle = np.cumsum(width) - 0.5 * width
    centers, ahead, behind = (rows_at(middle + step, length, curve) for step in (0.0, 0.01, -0.01))
    along = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    across = np.stack([along[:, 1], -along[:, 0], 0 * middle], axis=1)
    lean = rng.normal(0.0, 0.06, count)[:, None]
    up = np.cos(lean) * np.array([0.0, 0.0, 1.0]) + np.sin(lean) * across
    across = np.cross(up, along)
    centers = centers + rng.normal(0.0, 0.004, (count, 1)) * across
    centers[:, 2] = _GUM_HALF_HEIGHT + 0.015
    typical = length[-1] / count
    depth = 0.5 * typical * np.array(_DEPTHS)[kinds]
    height = 0.085 * np.array(_HEIGHTS)[kinds] * rng.uniform(0.95, 1.05, count)
    sizes = np.stack([0.5 * width, depth, height], axis=1)
    return _Teeth(centers, np.stack([along, across, up], axis=1), sizes, curve)


def _gum_distance(points: FloatArray, curve: FloatArray) -> NDArray[np.float64]:
    """Distance to a rounded band along the curve."""
    beside = kd_tree(curve[:, :2]).query(points[:, :2])[0] - (_GUM_HALF_WIDTH - _GUM_ROUND)
    above = np.abs(points[:, 2]) - (_GUM_HALF_HEIGHT - _GUM_ROUND)
    outside = np.hypot(np.maximum(beside, 0.0), np.maximum(above, 0.0))
    return outside + np.minimum(np.maximum(beside, above), 0.0) - _GUM_ROUND
