"""Kernels that make triangles of sheets even: edges flipped, balls moved along what they lie on.

The complex hangs on the lists of `_collapse_kernels`. Q of a triangle is 6 / sqrt(3) times its area
by its longest side and half its perimeter: 1 where it is equilateral, 0 where it is flat.
"""

from __future__ import annotations

import numpy as np

from medialis.base.jit import kernel
from medialis.medial_meshes._collapse_kernels import _link, _rank, _unlink, normal_of

GAIN = 1.02
"""An edge is flipped where the worse one of its triangles gets better by this factor."""

LOST = 0.1
"""Part of the bound of flips up to which balls on rims and seams may stick out where they move."""

GOOD = 0.9
"""Q of triangles that need not be better."""


@kernel
def _quality(balls, a, b, c, out):
    """Q of a triangle of three vertices; its normal is filled."""
    return normal_of(balls[a], balls[b], balls[c], out)


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _apart(balls, a, b, c, d):
    """How far, as balls, edges a b and c d are apart where their centers are nearest."""
    uu, vv, uv, uw, vw = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        u, v = balls[b, k] - balls[a, k], balls[d, k] - balls[c, k]
        w = balls[a, k] - balls[c, k]
        uu += u * u
        vv += v * v
        uv += u * v
        uw += u * w
        vw += v * w
    bottom = uu * vv - uv * uv
    if bottom <= 1e-12 * uu * vv:
        return np.inf
    s, t = (uv * vw - vv * uw) / bottom, (uu * vw - uv * uw) / bottom
    if not (0.0 < s < 1.0 and 0.0 < t < 1.0):
        return np.inf
    square = 0.0
    for k in range(4):
        way = (1 - s) * balls[a, k] + s * balls[b, k] - (1 - t) * balls[c, k] - t * balls[d, k]
        square += way * way
    return np.sqrt(square)


@kernel
def _beside(a, b, faces, out):
    """Triangles at edge a b, the first two in out (2,); returns how many."""
    count = 0
    end = faces.heads[a]
    while end >= 0:
        t, k = end // 3, end % 3
        if faces.rows[t, (k + 1) % 3] == b or faces.rows[t, (k + 2) % 3] == b:
            if count < 2:
                out[count] = t
            count += 1
        end = faces.after[end]
    return count


@kernel
def _joined(a, b, edges):
    """Tell whether an edge joins two vertices."""
    end = edges.heads[a]
    while end >= 0:
        if edges.rows[end >> 1, 1 - (end & 1)] == b:
            return True
        end = edges.after[end]
    return False


@kernel
def _rehang(row, k, old, new, lists):
    """Let end k of a row be at another vertex."""
    width = lists.rows.shape[1]
    _unlink(width * row + k, old, lists)
    lists.rows[row, k] = new
    _link(width * row + k, new, lists)


@kernel
def _replace(row, old, new, lists):
    """Put a vertex in the place of another one in a row."""
    for k in range(lists.rows.shape[1]):
        if lists.rows[row, k] == old:
            _rehang(row, k, old, new, lists)
            return


@kernel
def flip(balls, edges, faces, off):
    """Flip edges of two triangles where the worse one gets better; returns how many.

    The new edge is no farther than `off` from the old one, and new to the complex: the topology
    stays.
    """
    two = np.empty(2, np.int64)
    first, second, other = np.empty(3), np.empty(3), np.empty(3)
    flipped = 0
    for e in range(len(edges.rows)):
        a, b = edges.rows[e, 0], edges.rows[e, 1]
        if not edges.live[e] or _beside(a, b, faces, two) != 2:
            continue
        s, t = two[0], two[1]
        c = faces.rows[s, 0] + faces.rows[s, 1] + faces.rows[s, 2] - a - b
        d = faces.rows[t, 0] + faces.rows[t, 1] + faces.rows[t, 2] - a - b
        before = min(_quality(balls, a, b, c, first), _quality(balls, b, a, d, second))
        if before > GOOD or _dot(first, second) < 0.0:
            continue
        for k in range(3):
            first[k] += second[k]
        after = min(_quality(balls, c, a, d, second), _quality(balls, d, b, c, other))
        if after < GAIN * before + 1e-6 or _joined(c, d, edges):
            continue
        if _apart(balls, a, b, c, d) > off:
            continue
        if _dot(first, second) <= 0.0 or _dot(first, other) <= 0.0:
            continue
        _rehang(e, 0, a, c, edges)
        _rehang(e, 1, b, d, edges)
        _replace(s, b, d, faces)
        _replace(t, a, c, faces)
        flipped += 1
    return flipped


@kernel
def _nearest_in(balls, a, b, c, place, out):
    """Shares (3,) of the place of a triangle nearest to a place; returns its squared distance."""
    # Ericson: which side or corner a place is next to follows from six products.
    d1, d2, d3, d4, d5, d6 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        u, v = balls[b, k] - balls[a, k], balls[c, k] - balls[a, k]
        p = place[k] - balls[a, k]
        d1 += u * p
        d2 += v * p
        p = place[k] - balls[b, k]
        d3 += u * p
        d4 += v * p
        p = place[k] - balls[c, k]
        d5 += u * p
        d6 += v * p
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        out[0], out[1], out[2] = 1.0, 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        out[0], out[1], out[2] = 0.0, 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        out[0], out[1], out[2] = 0.0, 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        s = d1 / (d1 - d3 + 1e-300)
        out[0], out[1], out[2] = 1 - s, s, 0.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        s = d2 / (d2 - d6 + 1e-300)
        out[0], out[1], out[2] = 1 - s, 0.0, s
    elif va <= 0 and d4 >= d3 and d5 >= d6:
        s = (d4 - d3) / ((d4 - d3) + (d5 - d6) + 1e-300)
        out[0], out[1], out[2] = 0.0, 1 - s, s
    else:
        total = va + vb + vc + 1e-300
        out[0], out[1], out[2] = va / total, vb / total, vc / total
    square = 0.0
    for k in range(3):
        way = out[0] * balls[a, k] + out[1] * balls[b, k] + out[2] * balls[c, k] - place[k]
        square += way * way
    return square


@kernel
def _worst_at(v, balls, faces, normals, turned):
    """Sum of the squared lacks of Q of the triangles at a vertex; inf where one is turned over.

    `normals` (m, 3) are those before, if `turned`, else they are filled.
    """
    total, count = 0.0, 0
    now = np.empty(3)
    end = faces.heads[v]
    while end >= 0 and count < len(normals):
        t, k = end // 3, end % 3
        a, b = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
        total += (1.0 - _quality(balls, v, a, b, now)) ** 2
        if turned:
            if _dot(now, normals[count]) <= 0.0:
                return np.inf
        else:
            for d in range(3):
                normals[count, d] = now[d]
        count += 1
        end = faces.after[end]
    return total


@kernel
def _wanted_within(v, balls, edges, faces, place, best):
    """Ball (4,) of the star of a vertex next to the middle of its neighbours."""
    count = 0
    place[:] = 0.0
    end = edges.heads[v]
    while end >= 0:
        w = edges.rows[end >> 1, 1 - (end & 1)]
        for d in range(3):
            place[d] += balls[w, d]
        count += 1
        end = edges.after[end]
    for d in range(3):
        place[d] /= count
    shares = np.empty(3)
    nearest = np.inf
    end = faces.heads[v]
    while end >= 0:
        t, k = end // 3, end % 3
        a, b = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
        square = _nearest_in(balls, v, a, b, place, shares)
        if square < nearest:
            nearest = square
            for d in range(4):
                best[d] = (
                    shares[0] * balls[v, d] + shares[1] * balls[a, d] + shares[2] * balls[b, d]
                )
        end = faces.after[end]


@kernel
def _sticks_out(balls, v, a, b):
    """How far a ball sticks out of that on the cone of two others which is next to its center."""
    along, length, square = 0.0, 0.0, 0.0
    for d in range(3):
        way = balls[b, d] - balls[a, d]
        along += (balls[v, d] - balls[a, d]) * way
        length += way * way
    share = min(max(along / (length + 1e-300), 0.0), 1.0)
    for d in range(3):
        square += ((1 - share) * balls[a, d] + share * balls[b, d] - balls[v, d]) ** 2
    return np.sqrt(square) + balls[v, 3] - (1 - share) * balls[a, 3] - share * balls[b, 3]


@kernel
def _wanted_along(v, balls, edges, seam, off, best):
    """Ball (4,) of the two edges of a rim or seam at a vertex, half as long as both from an end.

    Where more than `off` would be lost, as at corners, it is the ball that is there.
    """
    a, b = -1, -1
    end = edges.heads[v]
    while end >= 0:
        w = edges.rows[end >> 1, 1 - (end & 1)]
        if seam[w] > 0:
            if a < 0:
                a = w
            else:
                b = w
        end = edges.after[end]
    for d in range(4):
        best[d] = balls[v, d]
    if _sticks_out(balls, v, a, b) > LOST * off:
        return
    x, y = 0.0, 0.0
    for d in range(3):
        x += (balls[v, d] - balls[a, d]) ** 2
        y += (balls[v, d] - balls[b, d]) ** 2
    x, y = np.sqrt(x), np.sqrt(y)
    if x < y:
        a, x, y = b, y, x
    share = 0.5 * (x - y) / (x + 1e-300)  # towards the farther end
    for d in range(4):
        best[d] = (1 - share) * balls[v, d] + share * balls[a, d]


@kernel
def even(balls, edges, faces, off, scratch, rounds):
    """Move balls along sheets, seams and rims to where triangles are better, in place.

    `scratch` (2, n). Returns the number of moves.
    """
    place, ball, before = np.empty(3), np.empty(4), np.empty(4)
    normals = np.empty((256, 3))
    moved = 0
    for _ in range(rounds):
        for v in range(len(balls)):
            if faces.heads[v] < 0:
                continue
            rank = _rank(v, edges, faces, scratch[0], scratch[1])
            if rank == 2:
                continue
            if rank == 0:
                _wanted_within(v, balls, edges, faces, place, ball)
            else:
                _wanted_along(v, balls, edges, scratch[1], off, ball)
            now = _worst_at(v, balls, faces, normals, False)
            for d in range(4):
                before[d] = balls[v, d]
            for _ in range(3):
                for d in range(4):
                    balls[v, d] = ball[d]
                if _worst_at(v, balls, faces, normals, True) < now:
                    moved += 1
                    break
                for d in range(4):
                    balls[v, d] = before[d]
                    ball[d] = 0.5 * (ball[d] + before[d])
    return moved
