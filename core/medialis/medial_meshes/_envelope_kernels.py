"""The nearest of many balls, cones and slabs, and by how much balls stick out of a surface."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel
from medialis.medial_meshes._primitive_kernels import primitive_distance

STEEP = 0.3
"""Sine of the angle with a tangent plane from which on a place is outside."""

AHEAD = 2.0
"""Primitives beside those that a place has listed move at most this many times as far."""


@kernel
def _bound(p, box):
    """Lower bound of the signed distance to what a box holds."""
    square = 0.0
    for d in range(3):
        e = max(box[d] - p[d], p[d] - box[3 + d], 0.0)
        square += e * e
    return np.sqrt(square) - box[6]


@kernel
def nearest_primitive(
    begin, end, places, table, order, bounds, depth, enough, out_distance, out_row, out_shares
):
    """Signed distance of places to the envelope; the primitive that decides it, and its shares.

    out_row holds a first guess, -1 for none. The search ends below `enough`.
    """
    n, leaves = len(table), 1 << depth
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    shares = np.empty(3)
    for q in range(begin, end):
        p, best, guess = places[q], np.inf, out_row[q]
        if guess >= 0:
            best = primitive_distance(p, table, guess, shares)
            out_shares[q, 0], out_shares[q, 1], out_shares[q, 2] = shares[0], shares[1], shares[2]
        stack[0], lows[0], size = 1, _bound(p, bounds[1]), 1
        while size > 0 and best >= enough:
            size -= 1
            node = stack[size]
            if lows[size] >= best:
                continue
            if node < leaves:
                near, far = 2 * node, 2 * node + 1
                first, second = _bound(p, bounds[near]), _bound(p, bounds[far])
                if second < first:
                    near, far, first, second = far, near, second, first
                stack[size], lows[size] = far, second
                stack[size + 1], lows[size + 1] = near, first
                size += 2
                continue
            leaf = node - leaves
            for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                row = order[i]
                if row == guess:
                    continue
                found = primitive_distance(p, table, row, shares)
                if found < best:
                    best = found
                    out_row[q] = row
                    for k in range(3):
                        out_shares[q, k] = shares[k]
        out_distance[q] = best


@kernel
def _best_of(p, table, near, shares, out_shares):
    """Nearest of a list of primitives and its distance; out_shares (3,)."""
    best, chosen = np.inf, -1
    for i in range(len(near)):
        if near[i] < 0:
            break
        found = primitive_distance(p, table, near[i], shares)
        if found < best:
            best, chosen = found, near[i]
            for k in range(3):
                out_shares[k] = shares[k]
    return best, chosen


@kernel
def _list_nearest(p, table, tree, stack, lows, shares, out_near, out_values):
    """Fill a list with the nearest primitives; returns a lower bound of all others."""
    order, bounds, depth = tree
    n, leaves, length = len(table), 1 << depth, len(out_near)
    out_near[:], out_values[:] = -1, np.inf
    stack[0], lows[0], size = 1, _bound(p, bounds[1]), 1
    while size > 0:
        size -= 1
        node = stack[size]
        if lows[size] >= out_values[length - 1]:
            continue
        if node < leaves:
            near, far = 2 * node, 2 * node + 1
            first, second = _bound(p, bounds[near]), _bound(p, bounds[far])
            if second < first:
                near, far, first, second = far, near, second, first
            stack[size], lows[size] = far, second
            stack[size + 1], lows[size + 1] = near, first
            size += 2
            continue
        leaf = node - leaves
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            found = primitive_distance(p, table, order[i], shares)
            j = length
            while j > 0 and found < out_values[j - 1]:
                if j < length:
                    out_near[j], out_values[j] = out_near[j - 1], out_values[j - 1]
                j -= 1
            if j < length:
                out_near[j], out_values[j] = order[i], found
    return out_values[length - 1]


@kernel
def _listed_movement(rows, near, movement):
    """Find the largest movement of the balls of listed primitives."""
    largest = 0.0
    for i in range(len(near)):
        if near[i] < 0:
            break
        for k in range(3):
            v = rows[near[i], k]
            if v >= 0 and movement[v] > largest:
                largest = movement[v]
    return largest


@kernel
def follow_primitives(
    begin,
    end,
    places,
    table,
    rows,
    order,
    bounds,
    depth,
    movement,
    near,
    others,
    out_distance,
    out_row,
    out_shares,
):
    """As `nearest_primitive`, for balls that move little: each place keeps a list `near` (q, k).

    A distance changes no faster than its balls move; `movement` (s, n) is how far each is from
    where it was at each of s times, the last of which is now. Primitives off the list are taken to
    move no more than twice as far as those on it: when one of them may have come nearer the list is
    made anew. others (q, 2) are the distance that all of them had beyond, when the list was made,
    and the time of that.
    """
    tree = (order, bounds, depth)
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    shares, values = np.empty(3), np.empty(near.shape[1])
    for q in range(begin, end):
        p = places[q]
        best, chosen = _best_of(p, table, near[q], shares, out_shares[q])
        if chosen >= 0:
            since = _listed_movement(rows, near[q], movement[int(others[q, 1])])
        if chosen < 0 or best > others[q, 0] - AHEAD * since:
            others[q, 0] = _list_nearest(p, table, tree, stack, lows, shares, near[q], values)
            others[q, 1] = len(movement) - 1
            best, chosen = _best_of(p, table, near[q], shares, out_shares[q])
        out_distance[q], out_row[q] = best, chosen


@kernel
def _between(p, x):
    """Square of the distance of two places."""
    a, b, c = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    return a * a + b * b + c * c


@kernel
def _is_outside(p, x, normal):
    """Tell whether p is outside of a surface whose nearest point is x.

    Beside edges that bend inwards p may lie in the tangent plane: that is inside.
    """
    a, b, c = p[0] - x[0], p[1] - x[1], p[2] - x[2]
    height = a * normal[0] + b * normal[1] + c * normal[2]
    return height > STEEP * np.sqrt(a * a + b * b + c * c)


@kernel
def _list_points(p, points, bounds, depth, farthest, stack, lows, out_near, out_squares):
    """Fill a list with the nearest points up to a distance; returns a lower bound of all others."""
    n, leaves, length = len(points), 1 << depth, len(out_near)
    out_near[:], out_squares[:] = -1, farthest * farthest
    stack[0], lows[0], size = 1, 0.0, 1
    while size > 0:
        size -= 1
        node = stack[size]
        if lows[size] >= out_squares[length - 1]:
            continue
        if node < leaves:
            near, far = 2 * node, 2 * node + 1
            first, second = _square(p, bounds[near]), _square(p, bounds[far])
            if second < first:
                near, far, first, second = far, near, second, first
            stack[size], lows[size] = far, second
            stack[size + 1], lows[size + 1] = near, first
            size += 2
            continue
        leaf = node - leaves
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            square = _between(p, points[i])
            if square >= out_squares[length - 1]:
                continue
            j = length - 1
            while j > 0 and square < out_squares[j - 1]:
                out_near[j], out_squares[j] = out_near[j - 1], out_squares[j - 1]
                j -= 1
            out_near[j], out_squares[j] = i, square
    return np.sqrt(out_squares[length - 1])


@kernel
def _nearest_listed(p, points, near):
    """Nearest of listed points and its distance; -1 and infinite where there is none."""
    best, chosen = np.inf, -1
    for i in range(len(near)):
        if near[i] < 0:
            break
        square = _between(p, points[near[i]])
        if square < best:
            best, chosen = square, near[i]
    return np.sqrt(best), chosen


@kernel
def find_overshoot(
    begin, end, balls, points, normals, bounds, depth, limits, out_over, out_near, out_lists,
    out_others, out_at
):  # fmt: skip
    """By how much balls (q, 4) stick out: depth of the center less radius; 0 where they do not.

    The depth is the distance to the nearest point of the surface, negative outside; out_near is
    that point, -1 where none is within the radius, or within the first of `limits` of a smaller
    ball. A center outside of the nearest one of its list is searched for however far it is.

    out_lists (q, k) are the nearest points of the centers out_at (q, 3), and out_others how far all
    others were from them at least; negative at first. While the centers move less, no other is
    nearer. Points, in tree order, lie no farther apart than half the second of `limits`, the third
    is how much farther than a ball reaches its list does.
    """
    beyond, sparse, margin = limits
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    squares = np.empty(out_lists.shape[1])
    for q in range(begin, end):
        p, guess = balls[q], out_near[q]
        held = max(p[3], beyond)
        if guess >= 0 and _is_outside(p, points[guess], normals[guess]):
            held = max(held, np.sqrt(_between(p, points[guess])) * (1.0 + 1e-9))
        far_off, chosen = _nearest_listed(p, points, out_lists[q])
        others = out_others[q] - np.sqrt(_between(p, out_at[q]))
        known = far_off <= others or (far_off > p[3] and others >= max(p[3], sparse))
        if not known:
            out_others[q] = _list_points(
                p, points, bounds, depth, held + margin, stack, lows, out_lists[q], squares
            )
            for d in range(3):
                out_at[q, d] = p[d]
            far_off, chosen = _nearest_listed(p, points, out_lists[q])
        out_near[q], out_over[q] = -1, 0.0
        if far_off < held:
            outside = _is_outside(p, points[chosen], normals[chosen])
            out_near[q] = chosen
            out_over[q] = min((-far_off if outside else far_off) - p[3], 0.0)


@kernel
def _square(p, box):
    """Square of the distance to a box."""
    square = 0.0
    for d in range(3):
        e = max(box[d] - p[d], p[d] - box[3 + d], 0.0)
        square += e * e
    return square
