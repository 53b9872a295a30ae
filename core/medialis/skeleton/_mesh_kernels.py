"""Kernels of the surface-skeleton mesh (thesis 3.4.1; see skeleton_mesh.py for the argument).

Strategy. A *row* is a ball of the cloud. `test_faces` decides for each surface triangle whether the
triangle of its three centers is part of the skeleton. A sheet is reached from both of its sides, so
`join_sides` colours the rows: the same colour along a side, the other colour across the sheet; it
is a union-find with one bit of parity, and a contradiction (a one-sided sheet, noise) is ignored,
which leaves a seam. `lift_faces` replaces the rows of the second colour by their partners across
the sheet and keeps what still spans a triangle and is not covered twice.

Only `test_faces` has enough work to run in chunks; the others take some ten milliseconds for 200k
samples and depend on the order of their items, so they run on one thread.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel
from medialis.skeleton.importance._walk_kernels import distance

SAME_SHEET = 0.7
"""Cosine: chords less than 45 degrees apart belong to one sheet. Where three sheets meet under
equal angles, as at a corner of a box, their chords are 60 degrees apart."""

CERTAIN = 0.9
"""Cosine: chords that agree this well are joined first, so that a contradiction falls where the
sheet is least certain."""

SEGMENT = 1e-12
"""Squared height of a triangle, in squared lengths of its side: to rounding it is a segment."""


class SheetBalls(NamedTuple):
    """The k balls of n samples.

    Attributes
    ----------
    points : (n, 3) float64
    source : (k,) int32
        Sample of each ball.
    centers, radii : (k, 3) and (k,) float64
    chords : (k, 3) float64
        Unit vectors from the second to the first feature point: the normal of the sheet.
    slopes : (k,) float64
        Cosines of half the spoke angles.
    """

    points: NDArray[np.float64]
    source: NDArray[np.int32]
    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    chords: NDArray[np.float64]
    slopes: NDArray[np.float64]


@kernel
def _agreement(chords, i, j):
    return chords[i, 0] * chords[j, 0] + chords[i, 1] * chords[j, 1] + chords[i, 2] * chords[j, 2]


@kernel
def in_balls(la, lb, lc, ra, rb, rc):
    """Tell whether three balls that meet in pairs cover the triangle of their centers.

    la is the side opposite a. Two balls cover the segment between their centers when they meet. If
    each side is covered and a hole remains inside, the point that has the same power to all three
    balls lies in it, so the power is positive there. With a at the origin and b on the x-axis it is
    x = (lc^2 + ra^2 - rb^2) / (2 lc), y = (lb^2 + ra^2 - rc^2 - 2 x cx) / (2 cy).
    """
    if la > rb + rc or lb > rc + ra or lc > ra + rb:
        return False
    if lc <= 0.0:
        return True
    cx = (lb * lb + lc * lc - la * la) / (2.0 * lc)
    cy2 = lb * lb - cx * cx
    if cy2 <= SEGMENT * lc * lc:
        return True
    cy = math.sqrt(cy2)
    x = (lc * lc + ra * ra - rb * rb) / (2.0 * lc)
    y = (lb * lb + ra * ra - rc * rc - 2.0 * x * cx) / (2.0 * cy)
    if x * x + y * y <= ra * ra:
        return True
    # A positive power outside the triangle says nothing: the sides are covered, so all of it is.
    v = y / cy
    u = (x - v * cx) / lc
    return u < 0.0 or v < 0.0 or u + v > 1.0


@kernel
def bridge_gaps(faces, points, source, row_near, out_row_near):
    """One round: a sample without a row takes the row of a neighbour, of the nearest source."""
    for f in range(len(faces)):
        for j in range(6):
            s, t = faces[f, j % 3], faces[f, (j + 1 + j // 3) % 3]
            row = row_near[t]
            if row_near[s] >= 0 or row < 0:
                continue
            old = out_row_near[s]
            if old >= 0:
                gain = distance(points, s, source[old]) - distance(points, s, source[row])
                if gain < 0.0 or (gain == 0.0 and old <= row):
                    continue
            out_row_near[s] = row


@kernel
def _inside(rows, sampled, balls):
    """Tell whether the balls of three rows cover the triangle of their centers.

    They are larger by the longest side of the surface triangle of the rows `sampled`, the sample
    spacing there.
    """
    points, source, centers, radii = balls.points, balls.source, balls.centers, balls.radii
    a, b, c = source[sampled[0]], source[sampled[1]], source[sampled[2]]
    reach = max(distance(points, a, b), distance(points, b, c), distance(points, c, a))
    a, b, c = rows[0], rows[1], rows[2]
    return in_balls(
        distance(centers, b, c), distance(centers, c, a), distance(centers, a, b),
        radii[a] + reach, radii[b] + reach, radii[c] + reach,
    )  # fmt: skip


@kernel
def test_faces(begin, end, slack, faces, row_near, balls, out_rows, out_ok):
    """Rows of the corners, and whether the centers of faces begin..end form a skeleton triangle."""
    for f in range(begin, end):
        for j in range(3):
            out_rows[f, j] = row_near[faces[f, j]]
        a, b, c = out_rows[f, 0], out_rows[f, 1], out_rows[f, 2]
        if min(a, b, c) < 0 or a == b or b == c or c == a:
            continue
        good = True
        for j in range(3):
            i, k = out_rows[f, j], out_rows[f, (j + 1) % 3]
            rise = abs(balls.radii[i] - balls.radii[k])
            run = distance(balls.centers, i, k)
            step = distance(balls.points, balls.source[i], balls.source[k])
            good &= rise <= 0.5 * (balls.slopes[i] + balls.slopes[k]) * run + slack * step
        out_ok[f] = good and _inside(out_rows[f], out_rows[f], balls)


@kernel
def longest_edges(rows, ok, centers, out_longest):
    """Longest side of the good lifted triangles at each row."""
    for f in range(len(rows)):
        if ok[f]:
            for j in range(3):
                i, k = rows[f, j], rows[f, (j + 1) % 3]
                length = distance(centers, i, k)
                out_longest[i] = max(out_longest[i], length)
                out_longest[k] = max(out_longest[k], length)


@kernel
def find_partners(usable, across, balls, longest, out_partner):
    """Row of the second feature point, where it holds nearly the same ball seen from there; -1.

    The true contact lies within one sample spacing of the second feature point, so the two centers
    are no further apart than the centers of neighbours there.
    """
    for i in range(len(usable)):
        j = across[i]
        if not (usable[i] and j >= 0 and usable[j]):
            continue
        if distance(balls.centers, i, j) <= longest[j] and _agreement(balls.chords, i, j) < 0.0:
            out_partner[i] = j


@kernel
def _root(parent, parity, i):
    """Root of i and the parity of i against it, with path halving."""
    turn = 0
    while parent[i] != i:
        up = parent[i]
        parity[i] ^= parity[up]
        parent[i] = parent[up]
        turn ^= parity[i]
        i = parent[i]
    return i, turn


@kernel
def _join(parent, parity, i, j, differ):
    a, pa = _root(parent, parity, i)
    b, pb = _root(parent, parity, j)
    if a == b:
        return
    if a > b:
        a, b = b, a
    parent[b] = a
    parity[b] = pa ^ pb ^ differ


@kernel
def join_sides(rows, ok, partner, chords, parent, parity, out_second):
    """Set out_second where a row belongs to the side of its sheet that is to be replaced.

    Of the two sides that one is replaced from which more rows have a partner.
    """
    for limit in (CERTAIN, SAME_SHEET):
        for i in range(len(partner)):
            if partner[i] >= 0 and _agreement(chords, i, partner[i]) < -limit:
                _join(parent, parity, i, partner[i], 1)
        for f in range(len(rows)):
            if ok[f]:
                for j in range(3):
                    i, k = rows[f, j], rows[f, (j + 1) % 3]
                    cosine = _agreement(chords, i, k)
                    if abs(cosine) > limit:
                        _join(parent, parity, i, k, np.int8(cosine < 0.0))
    votes = np.zeros(len(partner), np.int64)
    for i in range(len(partner)):
        if partner[i] >= 0:
            root, side = _root(parent, parity, i)
            votes[root] += 1 if side else -1
    for i in range(len(partner)):
        root, side = _root(parent, parity, i)
        out_second[i] = (side == 1) == (votes[root] >= 0)


@kernel
def lift_faces(rows, ok, partner, second, balls, out_rows, out_keep):
    """Lift faces with the second side replaced; keep those that are not covered from the first.

    A face whose corners all stand for themselves is kept. One with a replaced corner lies on the
    first side's triangles, unless its corners belong to several sheets (where sheets meet) or to
    both sides (a seam): there it closes the gap.
    """
    chords = balls.chords
    for f in range(len(rows)):
        if not ok[f]:
            continue
        replaced = False
        for j in range(3):
            i = rows[f, j]
            if second[i] and partner[i] >= 0 and not second[partner[i]]:
                i = partner[i]
                replaced = True
            out_rows[f, j] = i
        a, b, c = out_rows[f, 0], out_rows[f, 1], out_rows[f, 2]
        if a == b or b == c or c == a:
            continue
        if not replaced:
            out_keep[f] = True
            continue
        covered = (
            _agreement(chords, a, b) > SAME_SHEET
            and _agreement(chords, b, c) > SAME_SHEET
            and _agreement(chords, c, a) > SAME_SHEET
        )
        out_keep[f] = not covered and _inside(out_rows[f], rows[f], balls)
