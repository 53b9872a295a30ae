"""Kernels of mean shift (thesis 5.3.2): paths of seeds over a cloud, and the votes along them.

Points lie in the cells of a grid, sorted by cell; what is within reach of a place lies in the cells
up to `reach / width` away. Sums run in that order.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

FLAT, GAUSSIAN = 0, 1


@kernel
def _cell(x, low, width, size):
    """Cell along one axis; far outside the grid it is held where no cell of it is near."""
    return int(min(max(math.floor((x - low) / width), -1e6), size + 1e6))


@kernel
def _shift(points, starts, low, width, shape, reach, sigma, place, out):
    """Weighted mean of the points within reach (Eq. 5.1); return the sum of the weights.

    `sigma` is the width of the Gaussian (Eq. 5.2 without its constant), 0 for equal weights.
    """
    total = x = y = z = 0.0
    a, b, c = (
        _cell(place[0], low[0], width, shape[0]),
        _cell(place[1], low[1], width, shape[1]),
        _cell(place[2], low[2], width, shape[2]),
    )
    span = math.ceil(reach / width)
    first, last = max(c - span, 0), min(c + span, shape[2] - 1)
    for i in range(max(a - span, 0), min(a + span + 1, shape[0])):
        for j in range(max(b - span, 0), min(b + span + 1, shape[1])):
            row = (i * shape[1] + j) * shape[2]
            if first > last:
                continue
            for p in range(starts[row + first], starts[row + last + 1]):
                dx = points[p, 0] - place[0]
                dy = points[p, 1] - place[1]
                dz = points[p, 2] - place[2]
                square = dx * dx + dy * dy + dz * dz
                if square > reach * reach:
                    continue
                weight = 1.0
                if sigma > 0.0:
                    weight = math.exp(-0.5 * square / (sigma * sigma))
                total += weight
                x += weight * dx
                y += weight * dy
                z += weight * dz
    if total > 0.0:
        x, y, z = x / total, y / total, z / total
    out[0], out[1], out[2] = place[0] + x, place[1] + y, place[2] + z
    return total


@kernel
def follow_seeds(
    points, starts, low, width, shape, reach, sigma, still, seeds, begin, end, out_paths, out_counts
):
    """Shift the seeds begin..end until a step is at most `still`; rows of the paths from 0.

    `out_paths` (seeds, most, 3) holds the places after each step, `out_counts` how many.
    """
    place = np.empty(3)
    for s in range(begin, end):
        place[:] = seeds[s]
        row, count = s - begin, 0
        while count < out_paths.shape[1]:
            moved = out_paths[row, count]
            _shift(points, starts, low, width, shape, reach, sigma, place, moved)
            count += 1
            step = 0.0
            for axis in range(3):
                step += (moved[axis] - place[axis]) ** 2
            place[:] = moved
            if step <= still * still:
                break
        out_counts[row] = count


@kernel
def weigh_places(points, starts, low, width, shape, reach, sigma, places, begin, end, out):
    """Sum of the weights of the points about each place: the density there."""
    moved = np.empty(3)
    for s in range(begin, end):
        out[s] = _shift(points, starts, low, width, shape, reach, sigma, places[s], moved)


@kernel
def count_votes(
    steps, owner, starts, low, width, shape, reach, sigma, clusters, points, begin, end, out, share
):
    """Cluster whose paths came nearest to each point, by the weights K(|y - m(x)|) of their steps.

    The grid holds the steps; `owner` is the cluster of each. -1 where no step is within reach;
    `share` is the part of all votes that the winner got. Ties: the lowest cluster.
    """
    span = math.ceil(reach / width)
    votes = np.zeros(clusters)
    touched = np.empty(clusters, np.int64)
    for q in range(begin, end):
        count = 0
        place = points[q]
        a, b, c = (
            _cell(place[0], low[0], width, shape[0]),
            _cell(place[1], low[1], width, shape[1]),
            _cell(place[2], low[2], width, shape[2]),
        )
        first, last = max(c - span, 0), min(c + span, shape[2] - 1)
        for i in range(max(a - span, 0), min(a + span + 1, shape[0])):
            for j in range(max(b - span, 0), min(b + span + 1, shape[1])):
                row = (i * shape[1] + j) * shape[2]
                if first > last:
                    continue
                for p in range(starts[row + first], starts[row + last + 1]):
                    square = 0.0
                    for axis in range(3):
                        square += (steps[p, axis] - place[axis]) ** 2
                    if square > reach * reach:
                        continue
                    weight = 1.0
                    if sigma > 0.0:
                        weight = math.exp(-0.5 * square / (sigma * sigma))
                    if votes[owner[p]] == 0.0:
                        touched[count] = owner[p]
                        count += 1
                    votes[owner[p]] += weight
        best, total = -1, 0.0
        for t in range(count):
            name = touched[t]
            total += votes[name]
            if (
                best < 0
                or votes[name] > votes[best]
                or (votes[name] == votes[best] and name < best)
            ):
                best = name
        out[q] = best
        share[q] = votes[best] / total if best >= 0 else 0.0
        for t in range(count):
            votes[touched[t]] = 0.0
