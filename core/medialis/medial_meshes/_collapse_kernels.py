"""Kernels of the collapse of a complex, edge by edge, under a condition that keeps its topology.

Let L be what the links of u and v share: a graph on the common neighbours, with an edge w x where
u w x and v w x are both triangles. Edge u v may be contracted when each component of L is a tree
with exactly one w whose triangle u v w exists. Then the stars of u and v meet in the star of u v
with contractible pieces hung on it, so their union is contractible, as is its image, the star of
the merged vertex; the rest of the complex is glued to both along the same part.

Around each vertex, edges and triangles hang on doubly linked lists of their ends: end 2 e + k of
edge e, end 3 t + k of triangle t. Ends of v move to u as a whole.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base._kernels import pop, push
from medialis.base.jit import kernel
from medialis.medial_meshes._fit_kernels import factor, fill

LAZY = 0.97
"""Edges that must not be contracted are looked at again when this share of the vertices is left."""

UNFOLDED = 0.2
"""Cosine of the turn of a triangle up to which it is no fold."""

FLAT = 0.2
"""Q of triangles that are not made where all are better."""

FOLDED, FLATTENED = 1e4, 10.0
"""Merging costs so many times as much where triangles fold, or get flat by it."""


class Hung(NamedTuple):
    """Edges or triangles, and the lists of their ends at each of n vertices; -1 ends a list.

    Attributes
    ----------
    rows : (m, 2) or (m, 3) int32
    live : (m,) bool
    heads : (n,) int32
        The first end at each vertex.
    after, before : (2 m,) or (3 m,) int32
        The next end at the same vertex, and the one before.
    """

    rows: NDArray[np.int32]
    live: NDArray[np.bool_]
    heads: NDArray[np.int32]
    after: NDArray[np.int32]
    before: NDArray[np.int32]


class Room(NamedTuple):
    """Scratch for e edges: a heap of 2 e + 1 costs and edges, and as many that wait."""

    keys: NDArray[np.float64]
    names: NDArray[np.int32]
    waiting: NDArray[np.int32]


class Aim(NamedTuple):
    """How far to go.

    Vertices to be left, the largest radius of a merged ball, and whether sheets and seams stay as
    long as they can.
    """

    target: int
    largest: float
    whole: bool


class Steps(NamedTuple):
    """Step s merged vertex removed[s] into into[s], which became the ball after[s], (4,)."""

    removed: NDArray[np.int64]
    into: NDArray[np.int64]
    after: NDArray[np.float64]


@kernel
def _link(end, vertex, lists):
    """Hang an end on the list of a vertex."""
    first = lists.heads[vertex]
    lists.after[end], lists.before[end] = first, -1
    if first >= 0:
        lists.before[first] = end
    lists.heads[vertex] = end


@kernel
def _unlink(end, vertex, lists):
    """Take an end off the list of its vertex."""
    after, before = lists.after[end], lists.before[end]
    if before >= 0:
        lists.after[before] = after
    else:
        lists.heads[vertex] = after
    if after >= 0:
        lists.before[after] = before


@kernel
def link_all(lists):
    """Hang all ends on their vertices."""
    width = lists.rows.shape[1]
    lists.heads[:] = -1
    for i in range(len(lists.rows)):
        for k in range(width):
            _link(width * i + k, lists.rows[i, k], lists)


@kernel
def _drop(row, lists):
    """Take an edge or a triangle out of the complex."""
    width = lists.rows.shape[1]
    lists.live[row] = False
    for k in range(width):
        _unlink(width * row + k, lists.rows[row, k], lists)


@kernel
def _mark_around(u, edges, mark, value):
    """Mark the neighbours of a vertex."""
    end = edges.heads[u]
    while end >= 0:
        mark[edges.rows[end >> 1, 1 - (end & 1)]] = value
        end = edges.after[end]


@kernel
def _triangle_of(u, a, b, faces):
    """Triangle u a b, -1 where there is none."""
    end = faces.heads[u]
    while end >= 0:
        t, k = end // 3, end % 3
        x, y = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
        if (x == a and y == b) or (x == b and y == a):
            return t
        end = faces.after[end]
    return -1


@kernel
def _root(forest, w):
    while forest[w] != w:
        w = forest[w]
    return w


@kernel
def may_contract(u, v, edges, faces, mark, forest, flag):
    """Tell whether contracting edge u v keeps the homotopy type; see the top of this file.

    `mark` (n,) is 0 and is so again afterwards, `forest` and `flag` (n,) are scratch.
    """
    _mark_around(u, edges, mark, 1)
    components, flagged = 0, 0
    end = edges.heads[v]
    while end >= 0:
        w = edges.rows[end >> 1, 1 - (end & 1)]
        if mark[w] == 1:
            forest[w], flag[w] = w, 0
            mark[w] = 2
            components += 1
        end = edges.after[end]
    end = faces.heads[v]
    while end >= 0:
        t, k = end // 3, end % 3
        a, b = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
        if a == u or b == u:
            flag[a + b - u] = 1
            flagged += 1
        end = faces.after[end]
    good = True
    end = faces.heads[v]
    while end >= 0 and good:
        t, k = end // 3, end % 3
        a, b = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
        common = a != u and b != u and mark[a] == 2 and mark[b] == 2
        if common and _triangle_of(u, a, b, faces) >= 0:
            a, b = _root(forest, a), _root(forest, b)
            if a == b or flag[a] + flag[b] > 1:
                good = False
            else:
                forest[b] = a
                flag[a] += flag[b]
                components -= 1
        end = faces.after[end]
    _mark_around(u, edges, mark, 0)
    return good and components == flagged


@kernel
def _rank(u, edges, faces, count, seam):
    """Tell where a vertex is: 0 within a sheet, 1 on a rim or a seam, 2 where those end or meet.

    Marks `seam` (n,) of the neighbours along rims and seams, by the number of triangles there; a
    fourth and more count as three. `count` (n,) is scratch.
    """
    end = edges.heads[u]
    while end >= 0:
        count[edges.rows[end >> 1, 1 - (end & 1)]] = 0
        end = edges.after[end]
    end = faces.heads[u]
    while end >= 0:
        t, k = end // 3, end % 3
        count[faces.rows[t, (k + 1) % 3]] += 1
        count[faces.rows[t, (k + 2) % 3]] += 1
        end = faces.after[end]
    number, first, same = 0, -1, True
    end = edges.heads[u]
    while end >= 0:
        w = edges.rows[end >> 1, 1 - (end & 1)]
        seam[w] = 0 if count[w] == 2 else 1 + min(count[w], 3)
        if seam[w] > 0:
            same = same and (number == 0 or seam[w] == first)
            number += 1
            first = seam[w]
        end = edges.after[end]
    if number == 0:
        return 0
    return 1 if number == 2 and same else 2


@kernel
def keeps_sheets(u, v, edges, faces, mark, scratch):
    """Tell whether contracting edge u v keeps sheets, seams and rims as they are.

    The links of u and v share those of u v alone, in the complex and along its seams and rims; two
    vertices of these are only merged along one, and never two of its ends.
    `mark` (n,) is 0 and is so again afterwards, `scratch` (3, n) is not kept.
    """
    own, other = scratch[1], scratch[2]
    first = _rank(u, edges, faces, scratch[0], own)
    second = _rank(v, edges, faces, scratch[0], other)
    if first == 2 and second == 2:
        return False
    along = own[v] > 0
    if first > 0 and second > 0 and not along:
        return False
    _mark_around(u, edges, mark, 1)
    common, shared, good = 0, 0, True
    end = edges.heads[v]
    while end >= 0:
        w = edges.rows[end >> 1, 1 - (end & 1)]
        if mark[w] == 1:
            common += 1
            good = good and not (along and own[w] > 0 and other[w] > 0)
        end = edges.after[end]
    end = faces.heads[v]
    while end >= 0 and good:
        t, k = end // 3, end % 3
        a, b = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
        if a == u or b == u:
            shared += 1
        elif mark[a] == 1 and mark[b] == 1 and _triangle_of(u, a, b, faces) >= 0:
            good = False
        end = faces.after[end]
    _mark_around(u, edges, mark, 0)
    return good and common == shared


@kernel
def normal_of(a, b, c, out):
    """Fill twice the area of a triangle of balls times its normal; return its Q.

    That is 6 / sqrt(3) times the area by the longest side and half the perimeter: 1 where it is
    equilateral, 0 where it is flat.
    """
    x, y, z, square = 0.0, 0.0, 0.0, 0.0
    for d in range(3):
        i, j = (d + 1) % 3, (d + 2) % 3
        out[d] = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i])
        square += out[d] * out[d]
        x += (b[d] - a[d]) ** 2
        y += (c[d] - b[d]) ** 2
        z += (a[d] - c[d]) ** 2
    around = np.sqrt(x) + np.sqrt(y) + np.sqrt(z)
    return 6.0 / np.sqrt(3.0) * np.sqrt(square) / (np.sqrt(max(x, y, z)) * around + 1e-300)


@kernel
def spoils(u, v, ball, balls, faces):
    """How many times dearer merging u and v into a ball is, for triangles that fold or get flat.

    They fold where they turn by more than 78 degrees, and are flat where Q is below 0.2 and that of
    the worst one before.
    """
    before, after = np.empty(3), np.empty(3)
    worst, best = 1.0, 1.0
    for w, other in ((u, v), (v, u)):
        end = faces.heads[w]
        while end >= 0:
            t, k = end // 3, end % 3
            a, b = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
            worst = min(worst, normal_of(balls[w], balls[a], balls[b], before))
            if a != other and b != other:
                best = min(best, normal_of(ball, balls[a], balls[b], after))
                same, x, y = 0.0, 0.0, 0.0
                for d in range(3):
                    same += before[d] * after[d]
                    x += before[d] * before[d]
                    y += after[d] * after[d]
                if same < UNFOLDED * np.sqrt(x * y):
                    return FOLDED
            end = faces.after[end]
    return FLATTENED if best < min(FLAT, worst) else 1.0


@kernel
def contract(u, v, edges, faces, mark):
    """Move all that hangs on v to u; what becomes a point, or is there twice, goes.

    `mark` (n,) int64 is 0 and is so again afterwards.
    """
    end = faces.heads[v]
    while end >= 0:
        t, k, following = end // 3, end % 3, faces.after[end]
        a, b = faces.rows[t, (k + 1) % 3], faces.rows[t, (k + 2) % 3]
        if a == u or b == u or _triangle_of(u, a, b, faces) >= 0:
            _drop(t, faces)
        else:
            _unlink(end, v, faces)
            faces.rows[t, k] = u
            _link(end, u, faces)
        end = following
    _mark_around(u, edges, mark, 1)
    end = edges.heads[v]
    while end >= 0:
        e, k, following = end >> 1, end & 1, edges.after[end]
        w = edges.rows[e, 1 - k]
        if w == u or mark[w] == 1:
            _drop(e, edges)
        else:
            _unlink(end, v, edges)
            edges.rows[e, k] = u
            _link(end, u, edges)
        end = following
    mark[v] = 0
    _mark_around(u, edges, mark, 0)


@kernel
def add_planes(points, normals, weights, vertex, out):
    """Add (n.c + r - n.p)^2 of each candidate to the quadric (15,) of its vertex.

    A quadric is x A x - 2 b x + c of a ball x = (c, r): ten numbers of A, four of b, one of c.
    """
    m = np.empty(4)
    for i in range(len(points)):
        q, w = out[vertex[i]], weights[i]
        d = 0.0
        for k in range(3):
            m[k] = normals[i, k]
            d += m[k] * points[i, k]
        m[3] = 1.0
        slot = 0
        for a in range(4):
            for b in range(a, 4):
                q[slot] += w * m[a] * m[b]
                slot += 1
            q[10 + a] += w * m[a] * d
        q[14] += w * d * d


@kernel
def add_places(balls, weights, out):
    """Add w |x - ball|^2 of each vertex to its quadric."""
    for v in range(len(balls)):
        slot = 0
        for a in range(4):
            out[v, slot] += weights[v]
            slot += 4 - a
            out[v, 10 + a] += weights[v] * balls[v, a]
            out[v, 14] += weights[v] * balls[v, a] * balls[v, a]


@kernel
def _value(q, x):
    total, slot = q[14], 0
    for a in range(4):
        total -= 2.0 * q[10 + a] * x[a]
        for b in range(a, 4):
            total += (1.0 if a == b else 2.0) * q[slot] * x[a] * x[b]
            slot += 1
    return total


@kernel
def _smallest(q, factors, x):
    """Ball x (4,) with the smallest value of a quadric, by Cholesky factors."""
    fill(q, factors)
    factor(factors, 1e-18)
    for i in range(4):
        s = q[10 + i]
        for k in range(i):
            s -= factors[i, k] * x[k]
        x[i] = s / factors[i, i]
    for i in range(3, -1, -1):
        s = x[i]
        for k in range(i + 1, 4):
            s -= factors[k, i] * x[k]
        x[i] = s / factors[i, i]


@kernel
def _merged(u, v, balls, quadrics, largest, scratch, factors, out):
    """Cost of merging u and v, and the ball that they become: the best one, or one of them.

    Tells whether it is the best one, too: then the cost never falls as quadrics are added.
    """
    for k in range(15):
        scratch[k] = quadrics[u, k] + quadrics[v, k]
    _smallest(scratch, factors, out)
    cost, best = np.inf, 0.0 <= out[3] <= largest
    if best:
        cost = _value(scratch, out)
    for w in (u, v):
        other = _value(scratch, balls[w])
        if other < cost:
            cost = other
            for k in range(4):
                out[k] = balls[w, k]
    return max(cost, 0.0), best


@kernel
def collapse(balls, quadrics, edges, faces, aim, room, out):
    """Contract the cheapest edges until `target` vertices are left; returns the steps made.

    Each edge is on the heap of `room`, or waits: all at first, later those that must not be
    contracted, until one of their ends changes or 3 % of the vertices are gone. Where an end
    changes and the cost can only grow, it is computed anew when it is the lowest. There is room for
    two entries an edge, on the heap for some that hold no more. Where sheets shall stay `whole`,
    that holds until no edge is left that lets them, and edges that spoil triangles wait for dearer
    ones.
    """
    keys, names, waiting = room
    target, largest, whole = aim
    live = edges.live
    n, total = len(balls), len(edges.rows)
    mark, forest, flag = np.zeros(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    scratch = np.zeros((3, n), np.int64)
    ball = np.empty(4)
    given = (balls, quadrics, largest, np.empty(15), np.empty((4, 4)), ball)
    changed, known = np.zeros(n, np.int64), np.zeros(total, np.int64)  # steps
    cost, grows = np.zeros(total), np.ones(total, np.bool_)
    waits, dearer = np.ones(total, np.bool_), np.zeros(total, np.bool_)
    for e in range(total):
        waiting[e] = e
    left, looked_at, size, last, steps = n, n + 1, 0, total, 0
    while left > target:
        if size == 0 or last == len(waiting) or (last > 0 and left < LAZY * looked_at):
            if size == 0 and looked_at == left:
                if not whole:
                    break
                whole = False
            for i in range(last):
                e = waiting[i]
                if live[e] and waits[e]:
                    waits[e], dearer[e], known[e] = False, False, steps
                    cost[e], grows[e] = _merged(edges.rows[e, 0], edges.rows[e, 1], *given)
                    size = push(keys, names, size, cost[e], e)
            last, looked_at = 0, left
            if size == 0:
                break
            continue
        size = pop(keys, names, size)
        e = names[size]
        if not live[e] or keys[size] != cost[e]:
            continue
        u, v = edges.rows[e, 0], edges.rows[e, 1]
        if known[e] < max(changed[u], changed[v]):
            dearer[e], known[e] = False, steps
            cost[e], grows[e] = _merged(u, v, *given)
            size = push(keys, names, size, cost[e], e)
            continue
        _merged(u, v, *given)
        if whole:
            good = keeps_sheets(u, v, edges, faces, mark, scratch)
            factor = spoils(u, v, ball, balls, faces) if good and not dearer[e] else 1.0
            if factor > 1.0:
                dearer[e] = True
                cost[e] = factor * cost[e] + 1e-300
                size = push(keys, names, size, cost[e], e)
                continue
        else:
            good = may_contract(u, v, edges, faces, mark, forest, flag)
        if not good:
            waiting[last], waits[e] = e, True
            last += 1
            continue
        contract(u, v, edges, faces, mark)
        for k in range(15):
            quadrics[u, k] += quadrics[v, k]
        for k in range(4):
            balls[u, k] = ball[k]
            out.after[steps, k] = ball[k]
        out.removed[steps], out.into[steps] = v, u
        steps += 1
        left -= 1
        changed[u] = steps
        end = edges.heads[u]
        while end >= 0:
            e = end >> 1
            if waits[e] or not grows[e]:
                now, best = _merged(edges.rows[e, 0], edges.rows[e, 1], *given)
                if (waits[e] or now < cost[e]) and size < len(keys):
                    waits[e], cost[e], grows[e], known[e] = False, now, best, steps
                    dearer[e] = False
                    size = push(keys, names, size, now, e)
            end = edges.after[end]
    return steps
