"""Kernels: the scatter of a cloud about its surfaces, and positions without it.

Both look for the plane of a neighbourhood among those through three of its points: that finds one
of several crossing planes, and outliers do not count. The triples are drawn once, in Python, as
ranks of neighbours (0 is the point itself), so they are the same for every point.
"""

from __future__ import annotations

import math

import numpy as np

from medialis._kernels.jit import kernel

FLAT_SINE = 0.1
"""Sine of the smallest angle of a triple at its first point; slimmer ones name no plane."""


@kernel
def _plane(places, triple, out_plane):
    """Find unit normal and offset of the plane through three places; False if they are in line."""
    p, q, r = triple
    ax, ay, az = (
        places[q, 0] - places[p, 0],
        places[q, 1] - places[p, 1],
        places[q, 2] - places[p, 2],
    )
    bx, by, bz = (
        places[r, 0] - places[p, 0],
        places[r, 1] - places[p, 1],
        places[r, 2] - places[p, 2],
    )
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    square = x * x + y * y + z * z
    sides = (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)
    if square <= FLAT_SINE * FLAT_SINE * sides:
        return False
    length = math.sqrt(square)
    out_plane[0], out_plane[1], out_plane[2] = x / length, y / length, z / length
    out_plane[3] = (x * places[p, 0] + y * places[p, 1] + z * places[p, 2]) / length
    return True


@kernel
def _gather(points, neighbours, middle, places):
    """Neighbourhood about its middle, which comes first; how many places."""
    places[0, 0] = places[0, 1] = places[0, 2] = 0.0
    count = 1
    for j in neighbours:
        for c in range(3):
            places[count, c] = points[j, c] - middle[c]
        count += 1
    return count


@kernel
def _median_distance(places, count, plane, distances):
    """Median distance of the places to a plane, by sorting them in as they come."""
    for m in range(count):
        distance = abs(
            plane[0] * places[m, 0] + plane[1] * places[m, 1] + plane[2] * places[m, 2] - plane[3]
        )
        at = m
        while at > 0 and distances[at - 1] > distance:
            distances[at] = distances[at - 1]
            at -= 1
        distances[at] = distance
    return distances[count // 2]


@kernel
def measure_flatness(points, near, rows, triples, out_scatter, out_radius):
    """Least median distance to a plane through three places, and the rms distance of the places.

    Row r of `near` are the neighbours of point ``rows[r]``. Least median of squares: up to half of
    a neighbourhood may lie elsewhere.
    """
    k = near.shape[1]
    places, distances, plane = np.empty((k + 1, 3)), np.empty(k + 1), np.empty(4)
    for row in range(len(rows)):
        count = _gather(points, near[row], points[rows[row]], places)
        total = 0.0
        for m in range(1, count):
            total += places[m, 0] ** 2 + places[m, 1] ** 2 + places[m, 2] ** 2
        best = np.inf
        for t in range(len(triples)):
            if not _plane(places, triples[t], plane):
                continue
            best = min(best, _median_distance(places, count, plane, distances))
        out_scatter[row] = best
        out_radius[row] = math.sqrt(total / max(count - 1, 1))


@kernel
def _support(places, count, plane, band):
    """How many places lie near a plane, those in its middle counting most."""
    total = 0.0
    for m in range(count):
        share = (
            plane[0] * places[m, 0] + plane[1] * places[m, 1] + plane[2] * places[m, 2] - plane[3]
        ) / band
        if share * share < 1.0:
            total += 1.0 - share * share
    return total


@kernel
def _fit(places, count, plane, band):
    """Least squares plane, in place, of the places near a plane (biweight of Tukey).

    Heights over the plane are fitted by a + b u + c v: 3 equations, solved by Cramer's rule.
    """
    # Two axes across the normal: a cross product with a coordinate axis that is not along it.
    ux, uy, uz = 0.0, plane[2], -plane[1]
    if abs(plane[0]) > 0.8:
        ux, uy, uz = -plane[2], 0.0, plane[0]
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx = plane[1] * uz - plane[2] * uy
    vy = plane[2] * ux - plane[0] * uz
    vz = plane[0] * uy - plane[1] * ux
    w = wu = wv = uu = uv = vv = wh = uh = vh = 0.0
    for m in range(count):
        x, y, z = places[m, 0], places[m, 1], places[m, 2]
        height = plane[0] * x + plane[1] * y + plane[2] * z - plane[3]
        share = height / band
        if share * share >= 1.0:
            continue
        weight = (1.0 - share * share) ** 2
        u, v = ux * x + uy * y + uz * z, vx * x + vy * y + vz * z
        w += weight
        wu += weight * u
        wv += weight * v
        uu += weight * u * u
        uv += weight * u * v
        vv += weight * v * v
        wh += weight * height
        uh += weight * u * height
        vh += weight * v * height
    if w <= 0.0:
        return
    wu, wv, wh = wu / w, wv / w, wh / w
    uu, uv, vv = uu / w - wu * wu, uv / w - wu * wv, vv / w - wv * wv
    uh, vh = uh / w - wu * wh, vh / w - wv * wh
    bottom = uu * vv - uv * uv
    if bottom <= 1e-6 * uu * vv:
        return
    b, c = (uh * vv - vh * uv) / bottom, (vh * uu - uh * uv) / bottom
    a = wh - b * wu - c * wv
    x, y, z = plane[0] - b * ux - c * vx, plane[1] - b * uy - c * vy, plane[2] - b * uz - c * vz
    length = math.sqrt(x * x + y * y + z * z)
    plane[3] = (plane[3] + a) / length
    plane[0], plane[1], plane[2] = x / length, y / length, z / length


@kernel
def smooth_positions(points, near, triples, band, rounds, begin, end, positions):
    """Move the positions begin..end onto the planes with most support of the points near them.

    Row r of `near` are the neighbours of position r. Planes through three places are tried; the
    best one is fitted again `rounds` times. A position that no plane passes within `band` stays.
    """
    k = near.shape[1]
    places, plane, best = np.empty((k + 1, 3)), np.empty(4), np.empty(4)
    for row in range(begin, end):
        count = _gather(points, near[row], positions[row], places)
        most = 0.0
        for t in range(len(triples)):
            if not _plane(places, triples[t], plane):
                continue
            if abs(plane[3]) >= band:
                continue
            # Of two planes that cross here, the nearer one wins.
            support = _support(places, count, plane, band) * (1.0 - (plane[3] / band) ** 2)
            if support > most:
                most = support
                best[:] = plane
        if most == 0.0:
            continue
        for _ in range(rounds):
            _fit(places, count, best, band)
        if abs(best[3]) < band:
            for c in range(3):
                positions[row, c] += best[3] * best[c]
