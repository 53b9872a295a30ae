"""Kernels that ask many views about points: packed views, sharpening, radii (thesis 3.7.5).

A packed view has a bit for each pixel, 64 to a word, and depths and distances of the pixels of the
shape alone, in the order of rows. Where a pixel has its numbers is the number of bits before it:
of the words before (`ranks`), and in its own. Nothing is unpacked.

Sharpening: points are dropped that a view sees outside, and moved to where views agree. Every point
is treated on its own, view by view in their order, so the threads cannot change the result.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel

BITS = 64
"""Pixels in a word of a packed mask."""

MIDDLE = 0.25
"""Share of the depth range up to which a point is in its middle: farther off a view sees it before
or behind something else."""

NEAR, FAR, FIELD = 0, 1, 2
"""Columns of the numbers of a pixel."""


class PackedView(NamedTuple):
    """Packed depths and distance field of a view.

    Attributes
    ----------
    size : int
        Rows, and columns.
    center : (3,) float64
        The point in the middle of the picture.
    axes : (3, 3) float64
        Unit right, up and forward of the camera.
    pixel : float
        Edge of a pixel in the units of the shape.
    mask : (h * words of a row,) uint64
        A bit for each pixel of the shape.
    ranks : (h * words of a row,) int32
        Pixels of the shape in the words before.
    values : (p, 3) float32
        Depth of the nearest and of the furthest surface, and the distance to the contour in pixels,
        negative beside the skeleton of the silhouette.
    """

    size: int
    center: NDArray[np.float64]
    axes: NDArray[np.float64]
    pixel: float
    mask: NDArray[np.uint64]
    ranks: NDArray[np.int32]
    values: NDArray[np.float32]

    @property
    def nbytes(self) -> int:
        """Bytes of what is packed."""
        return self.mask.nbytes + self.ranks.nbytes + self.values.nbytes


@kernel
def words_in(width):
    """Return how many words a row of pixels takes."""
    # A division, of numbers that may be negative, costs more than all else.
    return (width + 63) >> 6


@kernel
def pack_view(runs, near, far, field, out_mask, out_ranks, out_values):
    """Pack depths and distances (h, w) of the pixels of runs, as `_kernels.Contours` has them.

    `out_mask` comes with 0. `out_values` (p, 3) has a row for each such pixel.
    """
    words, count = words_in(near.shape[1]), 0
    for i in range(len(runs)):
        row = runs[i, 0]
        for col in range(runs[i, 1], runs[i, 2]):
            at = row * words + (col >> 6)
            if out_mask[at] == np.uint64(0):
                out_ranks[at] = count
            out_mask[at] |= np.uint64(1) << np.uint64(col & 63)
            out_values[count, NEAR] = near[row, col]
            out_values[count, FAR] = far[row, col]
            out_values[count, FIELD] = field[row, col]
            count += 1


@kernel
def bits_in(word):
    """Return the number of bits that are set in a word of 64."""
    word -= (word >> np.uint64(1)) & np.uint64(0x5555555555555555)
    word = (word & np.uint64(0x3333333333333333)) + (
        (word >> np.uint64(2)) & np.uint64(0x3333333333333333)
    )
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel
def numbers_of(view, row, col):
    """Return the row of `values` of a pixel, -1 where it is none of the shape."""
    at = np.uint32(row * words_in(view.size) + (col >> 6))
    word, bit = view.mask[at], np.uint64(col & 63)
    if (word >> bit) & np.uint64(1) == np.uint64(0):
        return np.int64(-1)
    before = word & ((np.uint64(1) << bit) - np.uint64(1))
    return view.ranks[at] + bits_in(before)


@kernel
def distance_to(view, row, col):
    """Return the distance of a pixel to the contour, 0 outside the shape."""
    at = numbers_of(view, row, col)
    return abs(view.values[np.uint64(at), FIELD]) if at >= 0 else np.float32(0.0)


@kernel
def is_inside(view, row, col):
    """Tell whether a pixel is one of the shape."""
    at = np.uint32(row * words_in(view.size) + (col >> 6))
    return (view.mask[at] >> np.uint64(col & 63)) & np.uint64(1) != np.uint64(0)


class Seen(NamedTuple):
    """A view's camera as numbers: where its middle is, its axes, and its pixel."""

    x: float
    y: float
    z: float
    right_x: float
    right_y: float
    right_z: float
    up_x: float
    up_y: float
    up_z: float
    on_x: float
    on_y: float
    on_z: float
    pixel: float


@kernel
def camera_of(view):
    """Return the camera of a view: read once for all points."""
    c, a = view.center, view.axes
    return Seen(
        c[0], c[1], c[2], a[0, 0], a[0, 1], a[0, 2], a[1, 0], a[1, 1], a[1, 2], a[2, 0], a[2, 1],
        a[2, 2], view.pixel,
    )  # fmt: skip


@kernel
def place_in(px, py, pz, camera, size):
    """Return sub-pixel column and row and depth of a point, and whether it lies in the picture."""
    x, y, z = px - camera.x, py - camera.y, pz - camera.z
    right = x * camera.right_x + y * camera.right_y + z * camera.right_z
    up = x * camera.up_x + y * camera.up_y + z * camera.up_z
    depth = x * camera.on_x + y * camera.on_y + z * camera.on_z
    column, row = 0.5 * size + right / camera.pixel, 0.5 * size - up / camera.pixel
    inside = 1.0 <= column < size - 1.0 and 1.0 <= row < size - 1.0
    return column, row, depth, inside


@kernel
def cull_and_sharpen(view, step, begin, end, points, alive):
    """Test and move the points begin..end, in place, by a view.

    A point moves parallel to the picture by `step` pixels times the gradient of the distance
    transform, unless it lies beside the skeleton of the silhouette already. A view in which it lies
    far from the middle of the depth range sees it before or behind something else: it may drop the
    point, not move it.
    """
    values, camera, pixel = view.values, camera_of(view), view.pixel
    for i in range(begin, end):
        if not alive[i]:
            continue
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        column, row, depth, inside = place_in(px, py, pz, camera, view.size)
        found = numbers_of(view, int(row), int(column)) if inside else np.int64(-1)
        if found < 0:
            alive[i] = False
            continue
        at = np.uint64(found)
        low, high = values[at, NEAR], values[at, FAR]
        if not low <= depth <= high:
            alive[i] = False
            continue
        if values[at, FIELD] < 0 or abs(depth - 0.5 * (low + high)) > MIDDLE * (high - low):
            continue
        r, c = int(row), int(column)
        before = after = np.float32(0.0)  # pixels beside it in the row have the next numbers
        if is_inside(view, r, c - 1):
            before = abs(values[np.uint64(found - 1), FIELD])
        if is_inside(view, r, c + 1):
            after = abs(values[np.uint64(found + 1), FIELD])
        gx = 0.5 * (after - before) * step * pixel
        gy = 0.5 * (distance_to(view, r - 1, c) - distance_to(view, r + 1, c)) * step * pixel
        points[i, 0] += gx * camera.right_x + gy * camera.up_x
        points[i, 1] += gx * camera.right_y + gy * camera.up_y
        points[i, 2] += gx * camera.right_z + gy * camera.up_z


@kernel
def distance_at(view, column, row):
    """Return the distance transform at a sub-pixel position, to the nearest pixel centers outside.

    Bilinear between pixel centers. The field counts to the border of those pixels, half a pixel
    less; but of many pixels along a contour some have their center right behind it.
    """
    x, y = column - 0.5, row - 0.5
    c, r = int(x), int(y)
    s, t = x - c, y - r
    above = (1 - s) * distance_to(view, r, c) + s * distance_to(view, r, c + 1)
    below = (1 - s) * distance_to(view, r + 1, c) + s * distance_to(view, r + 1, c + 1)
    return (1 - t) * above + t * below + 0.5


@kernel
def measure_radii(view, begin, end, points, out_radii):
    """Lower out_radii to the distance to the surface that a view shows; 0 where one is outside.

    A ball round a point inside the shape is seen as a disc inside the silhouette and as a depth
    within the range, so the distance to the contour and the ways to both depths are no smaller than
    its radius; over many views the smallest is near it.
    """
    camera = camera_of(view)
    for i in range(begin, end):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        column, row, depth, inside = place_in(px, py, pz, camera, view.size)
        found = numbers_of(view, int(row), int(column)) if inside else np.int64(-1)
        if found < 0:
            out_radii[i] = 0.0
            continue
        at = np.uint64(found)
        low, high = view.values[at, NEAR], view.values[at, FAR]
        if not low <= depth <= high:
            out_radii[i] = 0.0
            continue
        ways = min(depth - low, high - depth)
        away = distance_at(view, column, row) * view.pixel
        out_radii[i] = min(out_radii[i], ways, away)
