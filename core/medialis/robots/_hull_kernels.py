"""Kernels of convex hulls: they grow by points, and tell which places lie in one.

A hull is a list of facets, triangles that know what lies across each side. It grows as by Barber,
Dobkin and Huhdanpaa (1996): the point that is farthest outside takes the place of the facets that
it sees, by new ones from their outline to it. A point is outside of one facet at a time, since one
that no new facet has outside of it is inside of all. Only numbers that rounding cannot change are
decided on: where a facet would be as good as a line, or would bend inward, the caller is told.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel

SEEN = 1e-12
"""Diagonals: a facet is seen from places farther outside than this, which is more than rounding."""

FLAT = 1e-9
"""Diagonals: what is thinner has no inside."""

INWARD = 1e-10
"""Diagonals: corners may lie so far outside of facets, by rounding of long thin ones."""


class Facets(NamedTuple):
    """Facets of a hull, with room for more.

    Attributes
    ----------
    corners : (f, 3) int64
        Rows of points, turned outward.
    across : (f, 3) int64
        The facet across the side from corner k to the next one.
    planes : (f, 4) float64
        Unit outward normal, and what makes it 0 on the facet.
    seen_by : (f,) int64
        The point that saw it; -1 while it is one of the hull.
    """

    corners: NDArray[np.int64]
    across: NDArray[np.int64]
    planes: NDArray[np.float64]
    seen_by: NDArray[np.int64]


@kernel
def list_within(places, corners, planes, slack, out_rows):
    """List the rows of places (q, 3) that lie in a hull, or outside by no more than `slack`.

    It has corners (k, 3) and outward planes (f, 4); `out_rows` (r,) receives the first r of the
    rows, ascending. Returns how many there are, r at most.
    """
    low, high = np.empty(3), np.empty(3)
    for k in range(3):
        low[k], high[k] = corners[0, k], corners[0, k]
        for v in range(1, len(corners)):
            low[k], high[k] = min(low[k], corners[v, k]), max(high[k], corners[v, k])
        low[k], high[k] = low[k] - slack, high[k] + slack
    count = 0
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        if x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]:
            continue
        inside = True
        for f in range(len(planes)):
            height = x * planes[f, 0] + y * planes[f, 1] + z * planes[f, 2] + planes[f, 3]
            if height > slack:
                inside = False
                break
        if inside:
            out_rows[count] = i
            count += 1
            if count == len(out_rows):
                break
    return count


@kernel
def lies_between(places, points, planes):
    """Tell whether a place (q, 3) lies between a point (p, 3) and a hull of planes (f, 4).

    It does where the line from the point goes on into the hull, or ends in it. That place is moved
    to the front of places.
    """
    for i in range(len(places)):
        for j in range(len(points)):
            least, most = 0.0, np.inf
            for f in range(len(planes)):
                height, rise = planes[f, 3], 0.0
                for k in range(3):
                    height += planes[f, k] * places[i, k]
                    rise += planes[f, k] * (places[i, k] - points[j, k])
                if rise > 0.0:
                    most = min(most, -height / rise)
                elif rise < 0.0:
                    least = max(least, -height / rise)
                elif height > 0.0:
                    most = -1.0
                if least > most:
                    break
            if least <= most:
                for k in range(3):
                    place = places[i, k]
                    for before in range(i, 0, -1):
                        places[before, k] = places[before - 1, k]
                    places[0, k] = place
                return True
    return False


@kernel
def _height(facets, facet, points, row):
    """Return how far a point lies outside of a facet."""
    return (
        points[row, 0] * facets.planes[facet, 0]
        + points[row, 1] * facets.planes[facet, 1]
        + points[row, 2] * facets.planes[facet, 2]
        + facets.planes[facet, 3]
    )


@kernel
def _set_facet(points, facets, facet, a, b, c):
    """Write a facet of the hull with its plane; tell whether it has an area."""
    ux, uy, uz = (
        points[b, 0] - points[a, 0],
        points[b, 1] - points[a, 1],
        points[b, 2] - points[a, 2],
    )
    vx, vy, vz = (
        points[c, 0] - points[a, 0],
        points[c, 1] - points[a, 1],
        points[c, 2] - points[a, 2],
    )
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    twice = math.sqrt(x * x + y * y + z * z)
    facets.corners[facet, 0], facets.corners[facet, 1], facets.corners[facet, 2] = a, b, c
    facets.seen_by[facet] = -1
    if twice == 0.0:
        return False
    x, y, z = x / twice, y / twice, z / twice
    facets.planes[facet, 0], facets.planes[facet, 1], facets.planes[facet, 2] = x, y, z
    # From the middle of the corners: the plane leaves each of them out by as little.
    facets.planes[facet, 3] = (
        -(
            x * (points[a, 0] + points[b, 0] + points[c, 0])
            + y * (points[a, 1] + points[b, 1] + points[c, 1])
            + z * (points[a, 2] + points[b, 2] + points[c, 2])
        )
        / 3.0
    )
    return True


@kernel
def _begin(points, facets):
    """Write the four facets of a tetrahedron that is as thick as may be; tell whether it is."""
    away, row = np.zeros(len(points)), np.zeros(4, np.int64)
    for k in range(3):
        low, high = points[:, k].argmin(), points[:, k].argmax()
        if k == 0 or points[high, k] - points[low, k] > away[0]:
            row[0], row[1], away[0] = low, high, points[high, k] - points[low, k]
    a, along = points[row[0]], points[row[1]] - points[row[0]]
    length = math.sqrt((along**2).sum())
    if length < FLAT:
        return False
    along /= length
    for i in range(len(points)):
        off = points[i] - a
        share = (off * along).sum()
        away[i] = ((off - share * along) ** 2).sum()
    row[2] = away.argmax()
    if math.sqrt(away[row[2]]) < FLAT or not _set_facet(points, facets, 0, row[0], row[1], row[2]):
        return False
    for i in range(len(points)):
        away[i] = abs(_height(facets, 0, points, i))
    row[3] = away.argmax()
    if away[row[3]] < FLAT:
        return False
    if _height(facets, 0, points, row[3]) > 0.0:
        row[0], row[1] = row[1], row[0]
    right = _set_facet(points, facets, 0, row[0], row[1], row[2])
    facets.across[0, 0], facets.across[0, 1], facets.across[0, 2] = 1, 2, 3
    for k in range(3):
        right &= _set_facet(points, facets, 1 + k, row[(k + 1) % 3], row[k], row[3])
        facets.across[1 + k, 0] = 0
        facets.across[1 + k, 1], facets.across[1 + k, 2] = 1 + (k + 2) % 3, 1 + (k + 1) % 3
    return right


@kernel
def _see(points, facets, apex, facet, gone):
    """List the facets that a point sees, from one of them on; return how many they are."""
    gone[0], count, done = facet, 1, 0
    facets.seen_by[facet] = apex
    while done < count:
        for k in range(3):
            other = facets.across[gone[done], k]
            if facets.seen_by[other] != apex and _height(facets, other, points, apex) > SEEN:
                facets.seen_by[other] = apex
                gone[count] = other
                count += 1
        done += 1
    return count


@kernel
def _side(facets, facet, corner):
    """Return the side of a facet that begins at a corner."""
    for k in range(2):
        if facets.corners[facet, k] == corner:
            return k
    return 2


@kernel
def _bends_outward(points, facets, facet):
    """Tell whether no neighbour of a facet rises above it."""
    for k in range(3):
        other = facets.across[facet, k]
        side = _side(facets, other, facets.corners[facet, (k + 1) % 3])
        opposite = facets.corners[other, (side + 2) % 3]
        if _height(facets, facet, points, opposite) > INWARD:
            return False
    return True


@kernel
def grow_hull(points, held, least, facets, rows):
    """Take into a hull what lies outside of it by more than `least`, the farthest first.

    Parameters
    ----------
    points : (n, 3) float64
        The first `held` are the corners of the hull, or there is none and `held` is 0.
    held : int
    least : float
    facets : Facets
        Those of the hull come first, 2 held - 4; room for 2 n. Changed: corners are rows of `rows`.
    rows : (n,) int64
        Receives the rows of points that are corners, ascending.

    Returns
    -------
    int
        How many corners it has; 0 where rounding could decide.
    """
    n, size = len(points), 2 * held - 4
    if held == 0:
        size = 4
        if not _begin(points, facets):
            return 0
    owner, away = np.full(n, -1), np.zeros(n)
    begins, fresh = np.full(n, -1), np.empty(2 * n, np.int64)
    gone, free, spare = np.empty(2 * n, np.int64), np.empty(2 * n, np.int64), 0
    edges = np.empty((2 * n, 3), np.int64)
    outer, left = np.empty(n, np.int64), 0
    for row in range(held, n):
        away[row] = least
        for facet in range(size):
            height = _height(facets, facet, points, row)
            if height > away[row]:
                owner[row], away[row] = facet, height
        if owner[row] >= 0:
            outer[left] = row
            left += 1
    while left > 0:
        apex = outer[0]
        for i in range(1, left):
            if away[outer[i]] > away[apex]:
                apex = outer[i]
        lost = _see(points, facets, apex, owner[apex], gone)
        count = 0
        for i in range(lost):
            for k in range(3):
                other = facets.across[gone[i], k]
                if facets.seen_by[other] != apex:
                    edges[count, 0] = facets.corners[gone[i], k]
                    edges[count, 1] = facets.corners[gone[i], (k + 1) % 3]
                    edges[count, 2] = other
                    count += 1
        if count < 3 or count > lost + 2:
            return 0
        for i in range(left):
            if facets.seen_by[owner[outer[i]]] == apex:
                owner[outer[i]] = -1
        for i in range(lost):
            free[spare] = gone[i]
            spare += 1
        for i in range(count):
            if spare > 0:
                spare -= 1
                fresh[i] = free[spare]
            else:
                fresh[i] = size
                size += 1
            begins[edges[i, 0]] = i
            if not _set_facet(points, facets, fresh[i], edges[i, 0], edges[i, 1], apex):
                return 0
        for i in range(count):
            after = begins[edges[i, 1]]
            if after < 0 or after >= count or edges[after, 0] != edges[i, 1]:
                return 0
            facet, other = fresh[i], edges[i, 2]
            facets.across[facet, 0], facets.across[facet, 1] = other, fresh[after]
            facets.across[fresh[after], 2] = facet
            facets.across[other, _side(facets, other, edges[i, 1])] = facet
        for i in range(count):
            if begins[edges[i, 0]] != i or not _bends_outward(points, facets, fresh[i]):
                return 0
        before, left = left, 0
        for k in range(before):
            row = outer[k]
            if owner[row] < 0:
                away[row] = least
                for i in range(count):
                    height = _height(facets, fresh[i], points, row)
                    if height > away[row]:
                        owner[row], away[row] = fresh[i], height
            if owner[row] >= 0:
                outer[left] = row
                left += 1
    return _packed(facets, size, rows)


@kernel
def _packed(facets, size, rows):
    """Leave out facets that were seen, and list the corners of the others; return their number."""
    number, place, left = np.full(len(rows), -1), np.full(size, -1), 0
    for facet in range(size):
        if facets.seen_by[facet] < 0:
            place[facet] = left
            left += 1
            for k in range(3):
                number[facets.corners[facet, k]] = 0
    count = 0
    for row in range(len(rows)):
        if number[row] == 0:
            number[row], rows[count] = count, row
            count += 1
    for facet in range(size):
        to = place[facet]
        if to >= 0:
            facets.seen_by[to] = -1
            for k in range(3):
                facets.corners[to, k] = number[facets.corners[facet, k]]
                facets.across[to, k] = place[facets.across[facet, k]]
            facets.planes[to] = facets.planes[facet]
    return count
