"""Kernels of the area importance of curve-skeleton points (thesis 3.6.2; see area.py)."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel
from medialis.paths._plane_kernels import trace_plane, way_out


@kernel
def trace_all_round(
    begin, stop, points, corners, twins, fan_offsets, fan, ends, tangent, longest, out_length
):  # fmt: skip
    """Lengths of the straightest geodesics that leave f1 in evenly spread directions.

    Direction 0 is the tangent of the ball; a plane through f1 and f2 serves two directions, half a
    turn apart. A direction whose plane cut does not arrive, or is longer than `longest`, gets inf.
    """
    half = out_length.shape[1] // 2
    first, second, axis, normal = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    nothing, last = np.empty(0, np.int64), np.empty(3)
    for i in range(begin, stop):
        start, end = ends[i, 0], ends[i, 1]
        size = 0.0
        for k in range(3):
            axis[k] = points[end, k] - points[start, k]
            size += axis[k] * axis[k]
        size = math.sqrt(size)
        out_length[i] = np.inf
        if size == 0.0:
            continue
        along = 0.0
        for k in range(3):
            axis[k] /= size
            along += axis[k] * tangent[i, k]
        size = 0.0
        for k in range(3):
            first[k] = tangent[i, k] - along * axis[k]
            size += first[k] * first[k]
        size = math.sqrt(size)
        if size < 1e-9:
            continue
        for k in range(3):
            first[k] /= size
        _cross(axis, first, second)
        for turn in range(half):
            angle = math.pi * turn / half
            for k in range(3):
                last[k] = math.cos(angle) * first[k] + math.sin(angle) * second[k]
            dx, dy, dz = last[0], last[1], last[2]
            _cross(axis, last, normal)
            offset = 0.0
            for k in range(3):
                offset += normal[k] * points[start, k]
            for at in range(fan_offsets[start], fan_offsets[start + 1]):
                across, x, y, z = way_out(points, corners, fan[at], normal, offset)
                if across < 0:
                    continue
                ux, uy, uz = x - points[start, 0], y - points[start, 1], z - points[start, 2]
                ahead = ux * dx + uy * dy + uz * dz >= 0.0
                column = turn if ahead else turn + half
                length, count = trace_plane(
                    points, corners, twins, across, x, y, z,
                    math.sqrt(ux * ux + uy * uy + uz * uz), normal, offset, start, end,
                    min(longest, out_length[i, column]), nothing, last,
                )  # fmt: skip
                if count >= 0 and length < out_length[i, column]:
                    out_length[i, column] = length


@kernel
def find_ties(
    begin, stop, points, corners, twins, fan_offsets, fan, ends, tangent, longest, slack, out_tied
):  # fmt: skip
    """Whether geodesics to both sides in the plane of the tangent are equally long.

    Both are plane cuts, so that they are comparable; what is longer than `longest` does not count.
    """
    axis, normal = np.empty(3), np.empty(3)
    nothing, last = np.empty(0, np.int64), np.empty(3)
    for i in range(begin, stop):
        start, end = ends[i, 0], ends[i, 1]
        for k in range(3):
            axis[k] = points[end, k] - points[start, k]
        _cross(axis, tangent[i], normal)
        offset = 0.0
        for k in range(3):
            offset += normal[k] * points[start, k]
        ahead, behind = longest[i], longest[i]
        for at in range(fan_offsets[start], fan_offsets[start + 1]):
            across, x, y, z = way_out(points, corners, fan[at], normal, offset)
            if across < 0:
                continue
            ux, uy, uz = x - points[start, 0], y - points[start, 1], z - points[start, 2]
            length, _ = trace_plane(
                points, corners, twins, across, x, y, z, math.sqrt(ux * ux + uy * uy + uz * uz),
                normal, offset, start, end, longest[i], nothing, last,
            )  # fmt: skip
            if ux * tangent[i, 0] + uy * tangent[i, 1] + uz * tangent[i, 2] > 0.0:
                ahead = min(ahead, length)
            else:
                behind = min(behind, length)
        longer = max(ahead, behind)
        out_tied[i] = longer < longest[i] and longer <= (1.0 + slack) * min(ahead, behind)


@kernel
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def spheroid_wedge(half_width, long_axis, angle):
    """Area of the wedge of an oblate spheroid with radii a and c >= a (Eq. 3.4)."""
    a, c = half_width, max(long_axis, half_width)
    if a < 1e-8 * c or c == 0.0:  # e is 1, its atanh infinite, and a a times it below rounding
        return angle * c * c
    e = math.sqrt(max(0.0, 1.0 - (a / c) ** 2))
    # ln((1 + e) / (1 - e)) / (2 e) = 1 + e^2/3 + ...: 1 for a sphere.
    stretch = math.atanh(e) / e if e > 1e-4 else 1.0 + e * e / 3.0
    return angle * (c * c + a * a * stretch)


@kernel
def least_half(begin, stop, length, half_width, out_area):
    """Smallest area of half a turn of wedges between geodesics (Eq. 3.5).

    Directions without a length take that of the nearest one that has; without any the area is 0.
    """
    count = length.shape[1]
    beta = 2.0 * math.pi / count
    axis, wedge = np.empty(count), np.empty(count)
    for i in range(begin, stop):
        a = half_width[i]
        for k in range(count):
            # The half perimeter of an ellipse is close to pi (a + b) / 2.
            axis[k] = max(a, 2.0 * length[i, k] / math.pi - a)
        out_area[i] = 0.0
        if _known(axis, 0, count) == np.inf:
            continue
        for k in range(count):
            b, following = _known(axis, k, count), _known(axis, (k + 1) % count, count)
            wedge[k] = spheroid_wedge(a, (b + following) / 2.0, beta)
        total = 0.0
        for k in range(count // 2):
            total += wedge[k]
        least = total
        for k in range(count):
            total += wedge[(k + count // 2) % count] - wedge[k]
            least = min(least, total)
        out_area[i] = least


@kernel
def _known(axis, k, count):
    """Value at k, else at the nearest place round the circle that has one, else inf."""
    for step in range(count // 2 + 1):
        if axis[(k + step) % count] < np.inf:
            return axis[(k + step) % count]
        if axis[(k - step) % count] < np.inf:
            return axis[(k - step) % count]
    return np.inf
