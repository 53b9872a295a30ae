"""Kernels of the candidates of the curve skeleton and of their importance (see candidates.py).

Candidates (thesis 3.6.1): how far the tangents of geodesics turn from ball to ball, and balls that
touch the surface all round. Importance (thesis 3.6.2): lengths of geodesics in all directions, and
the area of the smaller part that they cut off.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import cross, dot, trace_plane, way_out

SAME_PLACE = 0.3
"""Radii: centers this close belong to one ball as far as its contacts go."""

HOPS = 8
"""Balls that are followed from contact to contact."""

LEAST_SPOKES = 6
"""Contacts of a ring at least: those of three balls."""

ACROSS = 0.5
"""Sine of the angle to the axis of a ring from which on a spoke says where round it it lies."""

WIDEST_GAP = 5.0 * math.pi / 6.0
"""Radians between neighbouring contacts of a ball that touches the surface all round."""

TIE = 0.01
"""Two geodesics are equally long when they differ by less than this share. A half circle of 30
edges is 0.2 % shorter than round."""


class Balls(NamedTuple):
    """The r of k balls that have a geodesic, and their nearest others.

    Attributes
    ----------
    rows : (r,) int64
        Their numbers among all balls.
    near, distance : (r, c) int32, float64
        The others, numbered among the r.
    length : (r,) float64
        Of the geodesic.
    tangent : (r, 3) float64
        Unit direction in which it runs, zero for none.
    feature : (r, 3) float64
        Unit direction between the feature points.
    centers, radii, features : (k, 3), (k,) float64, (k, 2) int32
        All balls.
    points : (n, 3) float64
        The samples.
    ball_of : (n,) int64
        The ball of each sample, one of the r, or -1.
    """

    rows: NDArray[np.int64]
    near: NDArray[np.int32]
    distance: NDArray[np.float64]
    length: NDArray[np.float64]
    tangent: NDArray[np.float64]
    feature: NDArray[np.float64]
    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    features: NDArray[np.int32]
    points: NDArray[np.float64]
    ball_of: NDArray[np.int64]


@kernel
def median_of(values):
    """Median of a few values, which are sorted in place; 0 of none."""
    k = len(values)
    if k == 0:
        return 0.0
    for i in range(1, k):
        value = values[i]
        j = i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = value
    if k % 2:
        return values[k // 2]
    return (values[k // 2 - 1] + values[k // 2]) / 2


@kernel
def measure_spread(begin, stop, balls, smallest, out_spread):
    """How far tangents turn: (1 - cos) / 2 of the second largest angle to those of the neighbours.

    0 where all point the same way, 1 where two neighbours' point the opposite way. A neighbour with
    a tangent counts as far as its line of contacts is parallel and its geodesic as long.
    """
    near, length = balls.near, balls.length
    for i in range(begin, stop):
        sigma = max(median_of(balls.distance[i].copy()), smallest)
        largest, out_spread[i] = 0.0, 0.0
        for c in range(near.shape[1]):
            j = near[i, c]
            here, there = balls.tangent[i], balls.tangent[j]
            side = abs(there[0]) + abs(there[1]) + abs(there[2])
            if side == 0.0 or abs(length[i] - length[j]) > 2.0 * balls.distance[i, c] + sigma:
                continue
            same = abs(dot(balls.feature[i], balls.feature[j]))
            value = same * (1.0 - dot(here, there)) / 2.0
            if value > largest:
                largest, out_spread[i] = value, largest
            elif value > out_spread[i]:
                out_spread[i] = value


@kernel
def _add_spokes(row, balls, spokes, names, count):
    """Append the unit directions from a ball to both its contacts, and their samples."""
    for side in range(2):
        names[count] = balls.features[row, side]
        for k in range(3):
            spokes[count, k] = balls.points[names[count], k] - balls.centers[row, k]
        size = max(math.sqrt(dot(spokes[count], spokes[count])), 1e-300)
        for k in range(3):
            spokes[count, k] /= size
        count += 1
    return count


@kernel
def _is_near(centers, a, b, reach):
    gap = 0.0
    for k in range(3):
        gap += (centers[a, k] - centers[b, k]) ** 2
    return gap <= reach * reach


@kernel
def find_rings(begin, stop, balls, out_ring, out_opposite, out_tangent):
    """Balls that touch the surface all round: gaps between contacts stay below 150 degrees.

    The contacts are those of the ball and of others at the same place: its neighbours, and the
    ball of its second contact, that of the second contact of that one, and so on (`ball_of` has the
    ball of each sample, or -1). Each is seen from its own ball. `out_opposite` receives the contact
    farthest from f1, `out_tangent` a direction across, both for rings only.
    """
    rows, near = balls.rows, balls.near
    most = 2 * (near.shape[1] + 1 + HOPS)
    spokes, names = np.empty((most, 3)), np.empty(most, np.int64)
    angles, across = np.empty(most), np.empty(3)
    for i in range(begin, stop):
        out_ring[i] = False
        count, reach, row = 0, SAME_PLACE * balls.radii[rows[i]], rows[i]
        for _ in range(1 + HOPS):
            count = _add_spokes(row, balls, spokes, names, count)
            row = balls.ball_of[balls.features[row, 1]]
            if row < 0 or not _is_near(balls.centers, row, rows[i], reach):
                break
        for c in range(near.shape[1]):
            if balls.distance[i, c] <= reach:
                row = rows[near[i, c]]
                count = _add_spokes(row, balls, spokes, names, count)
        if count < LEAST_SPOKES:
            continue
        best, best_size, lowest = 0, 0.0, 2.0
        for c in range(1, count):
            along = dot(spokes[c], spokes[0])
            if 1.0 - along * along > best_size:
                best, best_size = c, 1.0 - along * along
            if along < lowest:
                lowest = along
                out_opposite[i] = names[c]
        if best_size < ACROSS * ACROSS:
            continue
        along = dot(spokes[best], spokes[0])
        for k in range(3):
            across[k] = (spokes[best, k] - along * spokes[0, k]) / math.sqrt(best_size)
        used = 0
        for c in range(count):
            x, y = dot(spokes[c], spokes[0]), dot(spokes[c], across)
            if x * x + y * y > ACROSS * ACROSS:
                angle = math.atan2(y, x)
                at = used
                while at > 0 and angles[at - 1] > angle:
                    angles[at] = angles[at - 1]
                    at -= 1
                angles[at] = angle
                used += 1
        gap = angles[0] + 2.0 * math.pi - angles[used - 1]
        for c in range(1, used):
            gap = max(gap, angles[c] - angles[c - 1])
        if gap < WIDEST_GAP:
            out_ring[i] = True
            for k in range(3):
                out_tangent[i, k] = across[k]


@kernel
def _leave(walk, h, start, end, direction, normal, longest, last):
    """Cut a surface by a plane through two of its points, beginning over the face of half-edge h.

    Returns the length of the cut from one to the other, inf where it does not arrive or is longer
    than `longest`, and how far it begins along a direction.
    """
    points, corners, twins, _, _ = walk
    offset = dot(normal, points[start])
    across, x, y, z = way_out(points, corners, h, normal, offset)
    if across < 0:
        return math.inf, 0.0
    ux, uy, uz = x - points[start, 0], y - points[start, 1], z - points[start, 2]
    length, count = trace_plane(
        points, corners, twins, across, x, y, z, math.sqrt(ux * ux + uy * uy + uz * uz), normal,
        offset, start, end, longest, np.empty(0, np.int64), last,
    )  # fmt: skip
    along = ux * direction[0] + uy * direction[1] + uz * direction[2]
    return length if count >= 0 else math.inf, along


@kernel
def trace_all_round(begin, stop, walk, ends, tangent, longest, out_length):
    """Lengths of the straightest geodesics that leave f1 in evenly spread directions.

    Direction 0 is the tangent of the ball; a plane through f1 and f2 serves two directions, half a
    turn apart. A direction whose plane cut does not arrive, or is longer than `longest`, gets inf.
    `walk` is that of `surface_walk`.
    """
    points, _, _, fan_offsets, fan = walk
    half = out_length.shape[1] // 2
    first, second, axis, normal = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    direction, last = np.empty(3), np.empty(3)
    for i in range(begin, stop):
        start, end = ends[i, 0], ends[i, 1]
        for k in range(3):
            axis[k] = points[end, k] - points[start, k]
        size = math.sqrt(dot(axis, axis))
        out_length[i] = np.inf
        if size == 0.0:
            continue
        for k in range(3):
            axis[k] /= size
        along = dot(axis, tangent[i])
        for k in range(3):
            first[k] = tangent[i, k] - along * axis[k]
        size = math.sqrt(dot(first, first))
        if size < 1e-9:
            continue
        for k in range(3):
            first[k] /= size
        cross(axis, first, second)
        for turn in range(half):
            angle = math.pi * turn / half
            for k in range(3):
                direction[k] = math.cos(angle) * first[k] + math.sin(angle) * second[k]
            cross(axis, direction, normal)
            for at in range(fan_offsets[start], fan_offsets[start + 1]):
                length, ahead = _leave(walk, fan[at], start, end, direction, normal, longest, last)
                column = turn if ahead >= 0.0 else turn + half
                out_length[i, column] = min(out_length[i, column], length)


@kernel
def find_ties(begin, stop, walk, ends, tangent, longest, out_tied):
    """Whether geodesics to both sides in the plane of the tangent are equally long.

    Both are plane cuts, so that they are comparable; what is longer than `longest` does not count.
    """
    points, _, _, fan_offsets, fan = walk
    axis, normal, last = np.empty(3), np.empty(3), np.empty(3)
    for i in range(begin, stop):
        start, end = ends[i, 0], ends[i, 1]
        for k in range(3):
            axis[k] = points[end, k] - points[start, k]
        cross(axis, tangent[i], normal)
        ahead, behind = longest[i], longest[i]
        for at in range(fan_offsets[start], fan_offsets[start + 1]):
            length, along = _leave(walk, fan[at], start, end, tangent[i], normal, longest[i], last)
            if along > 0.0:
                ahead = min(ahead, length)
            else:
                behind = min(behind, length)
        longer = max(ahead, behind)
        out_tied[i] = longer < longest[i] and longer <= (1.0 + TIE) * min(ahead, behind)


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
