"""Kernels of the candidate measure of curve-skeleton points (thesis 3.6.1; see candidates.py)."""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

TINY = 1e-12
SAME_PLACE = 0.3  # radii: centers this close belong to one ball as far as its contacts go
HOPS = 8  # balls that are followed from contact to contact
WIDEST_GAP = 5.0 * math.pi / 6.0


@kernel
def project_tangents(
    begin, stop, points, features, rows, starts, ends, out_tangent, out_feature
):  # fmt: skip
    """Tangent t and unit feature vector F of the balls rows[begin..stop] (Eq. 3.2).

    Both tangents of the geodesic are taken pointing away from the ball: t_s as it leaves f1, and
    -t_e, the way back from f2. Their sum without its part along F points to where the geodesic
    runs; it is zero where they cancel.
    """
    for i in range(begin, stop):
        row = rows[i]
        a, b = features[row, 0], features[row, 1]
        size = 0.0
        for k in range(3):
            out_feature[i, k] = points[a, k] - points[b, k]
            size += out_feature[i, k] ** 2
        size = math.sqrt(size)
        along = 0.0
        for k in range(3):
            out_feature[i, k] = out_feature[i, k] / size if size > 0.0 else 0.0
            out_tangent[i, k] = starts[row, k] - ends[row, k]
            along += out_feature[i, k] * out_tangent[i, k]
        size = 0.0
        for k in range(3):
            out_tangent[i, k] -= along * out_feature[i, k]
            size += out_tangent[i, k] ** 2
        size = math.sqrt(size)
        for k in range(3):
            out_tangent[i, k] = out_tangent[i, k] / size if size > TINY else 0.0


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
def measure_spread(
    begin, stop, near, distance, length, tangent, feature, smallest, out_spread
):  # fmt: skip
    """How far tangents turn: (1 - cos) / 2 of the second largest angle to those of the neighbours.

    0 where all point the same way, 1 where two neighbours' point the opposite way. A neighbour with
    a tangent counts as far as its line of contacts is parallel and its geodesic as long.
    """
    reach = np.empty(near.shape[1])
    for i in range(begin, stop):
        for c in range(len(reach)):
            reach[c] = distance[i, c]
        sigma = max(median_of(reach), smallest)
        largest, out_spread[i] = 0.0, 0.0
        for c in range(near.shape[1]):
            j = near[i, c]
            same, ahead, side = 0.0, 0.0, 0.0
            for k in range(3):
                same += feature[i, k] * feature[j, k]
                ahead += tangent[i, k] * tangent[j, k]
                side += abs(tangent[j, k])
            if side == 0.0 or abs(length[i] - length[j]) > 2.0 * distance[i, c] + sigma:
                continue
            value = abs(same) * (1.0 - ahead) / 2.0
            if value > largest:
                largest, out_spread[i] = value, largest
            elif value > out_spread[i]:
                out_spread[i] = value


@kernel
def _add_spokes(row, centers, points, features, spokes, names, count):
    """Append the unit directions from a ball to both its contacts, and their samples."""
    for side in range(2):
        names[count] = features[row, side]
        size = 0.0
        for k in range(3):
            spokes[count, k] = points[names[count], k] - centers[row, k]
            size += spokes[count, k] ** 2
        size = max(math.sqrt(size), 1e-300)
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
def find_rings(
    begin, stop, near, distance, rows, ball_of, centers, radii, points, features, out_ring,
    out_opposite, out_tangent,
):  # fmt: skip
    """Balls that touch the surface all round: gaps between contacts stay below 150 degrees.

    The contacts are those of the ball and of others at the same place: its neighbours, and the
    ball of its second contact, that of the second contact of that one, and so on (`ball_of` has the
    ball of each sample, or -1). Each is seen from its own ball. `out_opposite` receives the contact
    farthest from f1, `out_tangent` a direction across, both for rings only.
    """
    most = 2 * (near.shape[1] + 1 + HOPS)
    spokes, names = np.empty((most, 3)), np.empty(most, np.int64)
    angles, across = np.empty(most), np.empty(3)
    for i in range(begin, stop):
        out_ring[i] = False
        count, reach, row = 0, SAME_PLACE * radii[rows[i]], rows[i]
        for _ in range(1 + HOPS):
            count = _add_spokes(row, centers, points, features, spokes, names, count)
            row = ball_of[features[row, 1]]
            if row < 0 or not _is_near(centers, row, rows[i], reach):
                break
        for c in range(near.shape[1]):
            if distance[i, c] <= reach:
                row = rows[near[i, c]]
                count = _add_spokes(row, centers, points, features, spokes, names, count)
        if count < 6:
            continue
        best, best_size, lowest = 0, 0.0, 2.0
        for c in range(1, count):
            along = _dot3(spokes[c], spokes[0])
            if 1.0 - along * along > best_size:
                best, best_size = c, 1.0 - along * along
            if along < lowest:
                lowest = along
                out_opposite[i] = names[c]
        if best_size < 0.25:
            continue
        along = _dot3(spokes[best], spokes[0])
        for k in range(3):
            across[k] = (spokes[best, k] - along * spokes[0, k]) / math.sqrt(best_size)
        used = 0
        for c in range(count):
            x, y = _dot3(spokes[c], spokes[0]), _dot3(spokes[c], across)
            if x * x + y * y > 0.25:
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
def _dot3(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
