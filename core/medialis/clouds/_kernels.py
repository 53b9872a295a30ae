"""Kernels of clouds: lines of scans, scatter and smoothing, triangles of manifolds (thesis 4.2).

Lines of scans (manifolds.py): neighbourhoods that lie evenly about their points, and patches that
are strips along two lines.

Planes (smoothing.py): the scatter of a cloud about its surfaces, and positions without it. Both
look for the plane of a neighbourhood among those through three of its points: that finds one of
several crossing planes, and outliers do not count. The triples are drawn once, in Python, as ranks
of neighbours (0 is the point itself), so they are the same for every point.

Stars (manifolds.py): triangles round each point from the Voronoi cell in its tangent plane.
"""

from __future__ import annotations

import math

import numpy as np

from medialis.base.jit import kernel

SLIMMEST = 0.25
"""Sine of the angle of a triangle at the point, below which its normal is mostly noise."""

FARTHEST_APART = 0.28
"""Near a scanner the next line is many points away: of many neighbours those are chosen that are
this share of the largest distance apart. 15 to 25 of them lie in a disc."""

STRIP_WIDTH = 0.05
"""Width of a line of a scan for its length."""

FLAT_SINE = 0.1
"""Sine of the smallest angle of a triple at its first point; slimmer ones name no plane."""

FITS = 3
"""Times that the best plane of a position is fitted again to what is near it."""

ROOM = 4.0
"""Half the square that a Voronoi cell is cut out of, in units of the largest circle."""


@kernel
def find_lines(points, near, k, out_line):
    """Find points most of whose triangles with two of k neighbours are slim: all lie on a line.

    Slim: the sine of the angle at the point is below `SLIMMEST`. Of points on a line about half the
    pairs lie on both sides; an outlier sees all of a surface on one side.
    """
    for i in range(len(near)):
        slim, opposite = 0, 0
        for a in range(k):
            ax = points[near[i, a], 0] - points[i, 0]
            ay = points[near[i, a], 1] - points[i, 1]
            az = points[near[i, a], 2] - points[i, 2]
            for b in range(a):
                bx = points[near[i, b], 0] - points[i, 0]
                by = points[near[i, b], 1] - points[i, 1]
                bz = points[near[i, b], 2] - points[i, 2]
                x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                sides = (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)
                if x * x + y * y + z * z <= SLIMMEST * SLIMMEST * sides:
                    slim += 1
                    opposite += ax * bx + ay * by + az * bz < 0.0
        out_line[i] = 4 * slim > k * (k - 1) and 4 * opposite > slim


@kernel
def spread_neighbours(points, rows, wide, out_near):
    """Choose neighbours that lie evenly about a point from many that lie on lines.

    Nearest first, at least `FARTHEST_APART` times the distance to the last one from the point and
    from each other. `out_near` (rows, k) keeps what it has where there are not so many.
    """
    k = out_near.shape[1]
    chosen = np.empty(k, np.int32)
    for row in range(len(rows)):
        i, last, count = rows[row], wide[row, -1], 0
        least = 0.0
        for c in range(3):
            least += (FARTHEST_APART * (points[last, c] - points[i, c])) ** 2
        for j in wide[row]:
            free = count < k
            for q in range(-1, count):
                other = i if q < 0 else chosen[q]
                square = 0.0
                for c in range(3):
                    square += (points[j, c] - points[other, c]) ** 2
                free = free and square >= least
            if free:
                chosen[count] = j
                count += 1
        if count == k:
            out_near[row] = chosen


@kernel
def _square_off(x, y, z, a, b, c):
    """Square of the distance of a place from the line through 0 and (x, y, z); of 0 from itself."""
    square = x * x + y * y + z * z
    if square == 0.0:
        return a * a + b * b + c * c
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    return (u * u + v * v + w * w) / square


@kernel
def _is_strip(sides, count, rest):
    """Whether places lie on two lines or fewer, one of them through 0 and one of the places."""
    for m in range(count):
        x, y, z = sides[m, 0], sides[m, 1], sides[m, 2]
        left = 0
        for j in range(count):
            a, b, c = sides[j, 0], sides[j, 1], sides[j, 2]
            if _square_off(x, y, z, a, b, c) > STRIP_WIDTH * STRIP_WIDTH * (a * a + b * b + c * c):
                for axis in range(3):
                    rest[left, axis] = sides[j, axis] - (rest[0, axis] if left else 0.0)
                left += 1
        longest, farthest = 0.0, 0
        for j in range(1, left):
            length = rest[j, 0] ** 2 + rest[j, 1] ** 2 + rest[j, 2] ** 2
            if length > longest:
                longest, farthest = length, j
        off = 0.0
        for j in range(1, left if longest > 0.0 else 0):
            x, y, z = rest[farthest, 0], rest[farthest, 1], rest[farthest, 2]
            off = max(off, _square_off(x, y, z, rest[j, 0], rest[j, 1], rest[j, 2]))
        if off <= STRIP_WIDTH * STRIP_WIDTH * longest:
            return True
    return False


@kernel
def find_strips(points, patches, out_strip):
    """Find patches all of whose places lie on two lines: any two lines side by side have a plane.

    Two lines of a scan, one on each side of an edge, make a chamfer that is on no surface.
    """
    near, size, bits = patches.near, patches.sizes, patches.corners
    k, slots = near.shape[1], len(size) // len(near)
    sides, rest = np.empty((k, 3)), np.empty((k, 3))
    for slot in range(len(size)):
        count, i = 0, slot // slots
        for m in range(k):
            if size[slot] > 0 and (bits[slot] >> np.uint64(m)) & np.uint64(1) != 0:
                for axis in range(3):
                    sides[count, axis] = points[near[i, m], axis] - points[i, axis]
                count += 1
        out_strip[slot] = count > 0 and _is_strip(sides, count, rest)


@kernel
def _plane(places, triple, out_plane):
    """Find unit normal and offset of the plane through three places; False if they are in line."""
    p, q, r = triple
    x, y, z = places[p, 0], places[p, 1], places[p, 2]
    ax, ay, az = places[q, 0] - x, places[q, 1] - y, places[q, 2] - z
    bx, by, bz = places[r, 0] - x, places[r, 1] - y, places[r, 2] - z
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
def _height(places, m, plane):
    """Height of a place over a plane: unit normal and offset."""
    x, y, z = places[m, 0], places[m, 1], places[m, 2]
    return plane[0] * x + plane[1] * y + plane[2] * z - plane[3]


@kernel
def _median_distance(places, count, plane, most, distances):
    """Median distance of the places to a plane, or `most` where it is not less.

    Mostly it is not, which counting tells; else the lower half is sorted in as it comes.
    """
    near, half = 0, count // 2
    for m in range(count):
        distances[m] = abs(_height(places, m, plane))
        near += distances[m] < most
    if near <= half:
        return most
    sorted_in = 0
    for m in range(count):
        distance = distances[m]
        if sorted_in > half and distance >= distances[half]:
            continue
        at = min(sorted_in, half)
        while at > 0 and distances[at - 1] > distance:
            distances[at] = distances[at - 1]
            at -= 1
        distances[at] = distance
        sorted_in += 1
    return distances[half]


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
            best = _median_distance(places, count, plane, best, distances)
        out_scatter[row] = best
        out_radius[row] = math.sqrt(total / max(count - 1, 1))


@kernel
def _support(places, count, plane, band):
    """How many places lie near a plane, those in its middle counting most."""
    total = 0.0
    for m in range(count):
        share = _height(places, m, plane) / band
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
        height = _height(places, m, plane)
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
def smooth_positions(points, near, triples, band, begin, end, positions):
    """Move the positions begin..end onto the planes with most support of the points near them.

    Row r of `near` are the neighbours of position r. Planes through three places are tried; the
    best one is fitted again `FITS` times. A position that no plane passes within `band` stays.
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
        for _ in range(FITS):
            _fit(places, count, best, band)
        if abs(best[3]) < band:
            for c in range(3):
                positions[row, c] += best[3] * best[c]


@kernel
def _clip(cell, spare, count, x, y, heavier, name):
    """Cut a convex polygon by the half plane nearer to the origin than to (x, y).

    `heavier` is the weight of the origin less that of (x, y): squared distances count less by it.
    `cell` holds the corners, and the owner of the edge from each to the next one; so does `spare`,
    as room. Returns the corners left.
    """
    (corners, owners), (spare_corners, spare_owners) = cell, spare
    limit = 0.5 * (x * x + y * y + heavier)
    filled = 0
    for e in range(count):
        ahead = (e + 1) % count
        here = corners[e, 0] * x + corners[e, 1] * y - limit
        there = corners[ahead, 0] * x + corners[ahead, 1] * y - limit
        if here <= 0.0:
            spare_corners[filled], spare_owners[filled] = corners[e], owners[e]
            filled += 1
        if (here <= 0.0) != (there <= 0.0):
            share = here / (here - there)
            for axis in range(2):
                step = corners[ahead, axis] - corners[e, axis]
                spare_corners[filled, axis] = corners[e, axis] + share * step
            # Going out, the cut begins here; coming in, the rest of this edge does.
            spare_owners[filled] = name if here <= 0.0 else owners[e]
            filled += 1
    corners[:filled] = spare_corners[:filled]
    owners[:filled] = spare_owners[:filled]
    return filled


@kernel
def list_stars(flat, near, weights, farthest, begin, end, out_triangles, out_radii):
    """Delaunay triangles (i, a, b) of each point among its neighbours in the tangent plane.

    `flat` (n, k, 2) are the neighbours there, the point at the origin. Two neighbouring edges of
    the Voronoi cell of the point belong to two corners of a triangle, and the corner between them
    is the center of its circle. Circles with a radius above `farthest` are left out: a hole or the
    border. Small weights, the same for all cells, decide between the two diagonals of four points
    on a circle. `out_triangles` (n, k, 3) comes filled with -1.
    """
    k = near.shape[1]
    room = k + 8  # each cut adds one corner at most to the four of the square
    corners, owners = np.empty((room, 2)), np.empty(room, np.int64)
    spare = np.empty((room, 2)), np.empty(room, np.int64)
    for i in range(begin, end):
        half = ROOM * farthest[i]
        for e in range(4):
            corners[e, 0] = half if e in (0, 3) else -half
            corners[e, 1] = half if e in (0, 1) else -half
            owners[e] = -1
        count = 4
        for m in range(k):
            x, y = flat[i, m, 0], flat[i, m, 1]
            heavier = weights[i] - weights[near[i, m]]
            count = _clip((corners, owners), spare, count, x, y, heavier, m)
        filled = 0
        for e in range(count):
            a, b = owners[e - 1 if e > 0 else count - 1], owners[e]
            radius = math.hypot(corners[e, 0], corners[e, 1])
            if a < 0 or b < 0 or a == b or radius > farthest[i] or filled == k:
                continue
            out_triangles[i, filled, 0] = i
            out_triangles[i, filled, 1] = near[i, a]
            out_triangles[i, filled, 2] = near[i, b]
            out_radii[i, filled] = radius
            filled += 1
