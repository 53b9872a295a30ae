"""The nearest of many balls, cones and slabs, and by how much balls stick out of a surface."""

from __future__ import annotations

import numpy as np

from medialis._kernels.jit import kernel
from medialis.medial_meshes._primitive_kernels import is_beyond, primitive_distance

STEEP = 0.3
"""Sine of the angle with a tangent plane from which on a place is outside."""

AHEAD = 2.0
"""Primitives beside those that a place has listed move at most this many times as far."""


@kernel
def _square(p, bounds, node):
    """Square of the distance to the box of a node."""
    square = 0.0
    for d in range(3):
        e = max(bounds[node, d] - p[d], p[d] - bounds[node, 3 + d], 0.0)
        square += e * e
    return square


@kernel
def _bound(p, bounds, node):
    """Lower bound of the signed distance to what the box of a node holds."""
    return np.sqrt(_square(p, bounds, node)) - bounds[node, 6]


@kernel
def nearest_primitive(
    begin, end, places, table, order, bounds, depth, enough, out_distance, out_row, out_shares
):
    """Signed distance of places to the envelope; the primitive that decides it, and its shares.

    Any primitive nearer than `enough` ends the search, and no other counts; -inf for the nearest of
    all. That of the place before is looked at first.
    """
    n, leaves = len(table), 1 << depth
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    shares = np.empty(3)
    for q in range(begin, end):
        p, best = places[q], np.inf if enough == -np.inf else enough
        guess = out_row[q - 1] if q > begin else -1
        out_row[q] = -1
        if guess >= 0:
            found = primitive_distance(p, table, guess, shares)
            if found < best:
                best, out_row[q] = found, guess
                for k in range(3):
                    out_shares[q, k] = shares[k]
        stack[0], lows[0], size = 1, _bound(p, bounds, 1), 1
        while size > 0 and best >= enough:
            size -= 1
            node = stack[size]
            if lows[size] >= best:
                continue
            if node < leaves:
                near, far = 2 * node, 2 * node + 1
                first, second = _bound(p, bounds, near), _bound(p, bounds, far)
                if second < first:
                    near, far, first, second = far, near, second, first
                stack[size], lows[size] = far, second
                stack[size + 1], lows[size + 1] = near, first
                size += 2
                continue
            leaf = node - leaves
            for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
                row = order[i]
                if row == guess or is_beyond(p, table, row, best):
                    continue
                found = primitive_distance(p, table, row, shares)
                if found < best:
                    best = found
                    out_row[q] = row
                    for k in range(3):
                        out_shares[q, k] = shares[k]
        out_distance[q] = best


@kernel
def _moved(row, movement):
    """How far the distance to a primitive may have changed: its balls moved no farther."""
    far = movement[row[0]]
    for k in range(1, 3):
        if row[k] >= 0:
            far = max(far, movement[row[k]])
    return far


@kernel
def _best_of(p, table, rows, near, values, movement, shares, out_shares):
    """Nearest of a list of primitives, its distance, and how far that of any may have changed.

    `values` are the distances when the list was made; the balls' movement since tells which may be
    the nearest now.
    """
    best, chosen, since = np.inf, -1, 0.0
    for i in range(len(near)):
        if near[i] < 0:
            break
        far = _moved(rows[near[i]], movement)
        since = max(since, far)
        if values[i] - far >= best:
            continue
        found = primitive_distance(p, table, near[i], shares)
        if found < best:
            best, chosen = found, near[i]
            for k in range(3):
                out_shares[k] = shares[k]
    return best, chosen, since


@kernel
def _enter(row, value, near, values):
    """Put an item into a list of the nearest where it belongs, unless it is there."""
    j, length = len(near), len(near)
    if value >= values[length - 1]:
        return
    for i in range(length):
        if near[i] == row:
            return
    while j > 0 and value < values[j - 1]:
        if j < length:
            near[j], values[j] = near[j - 1], values[j - 1]
        j -= 1
    if j < length:
        near[j], values[j] = row, value


@kernel
def _list_nearest(p, table, tree, stack, lows, shares, before, near, values):
    """Fill a list with the nearest primitives; returns a lower bound of all others.

    The list as it was, copied to `before`, leaves little to search.
    """
    order, bounds, depth = tree
    n, leaves, last = len(table), 1 << depth, len(near) - 1
    before[:] = near
    near[:], values[:] = -1, np.inf
    for row in before:
        if row >= 0:
            _enter(row, primitive_distance(p, table, row, shares), near, values)
    stack[0], lows[0], size = 1, _bound(p, bounds, 1), 1
    while size > 0:
        size -= 1
        node = stack[size]
        if lows[size] >= values[last]:
            continue
        if node < leaves:
            first, second = 2 * node, 2 * node + 1
            low, high = _bound(p, bounds, first), _bound(p, bounds, second)
            if high < low:
                first, second, low, high = second, first, high, low
            stack[size], lows[size] = second, high
            stack[size + 1], lows[size + 1] = first, low
            size += 2
            continue
        leaf = node - leaves
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            row = order[i]
            if not is_beyond(p, table, row, values[last]):
                _enter(row, primitive_distance(p, table, row, shares), near, values)
    return values[last]


@kernel
def follow_primitives(
    begin, end, places, table, rows, order, bounds, depth, movement, near, values, others,
    out_distance, out_row, out_shares,
):  # fmt: skip
    """As `nearest_primitive`, for balls that move little: each place keeps a list `near` (q, k).

    A distance changes no faster than its balls move; `movement` (s, n) is how far each is from
    where it was at each of s times, the last of which is now. Primitives off the list are taken to
    move no more than twice as far as those on it: when one of them may have come nearer the list is
    made anew. `values` (q, k) are the distances when the list was made, others (q, 2) what all that
    are not in it had beyond, and the time of that.
    """
    tree = (order, bounds, depth)
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    shares, before, now = np.empty(3), np.empty(near.shape[1], np.int64), len(movement) - 1
    for q in range(begin, end):
        p, own, known, out = places[q], near[q], values[q], out_shares[q]
        moved = movement[int(others[q, 1])]
        best, chosen, since = _best_of(p, table, rows, own, known, moved, shares, out)
        if chosen < 0 and q > begin:
            own[:] = near[q - 1]  # that of the place before, which mostly is near
        if chosen < 0 or best > others[q, 0] - AHEAD * since:
            others[q, 0] = _list_nearest(p, table, tree, stack, lows, shares, before, own, known)
            others[q, 1] = now
            best, chosen, since = _best_of(p, table, rows, own, known, movement[now], shares, out)
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
def _list_points(p, points, tree, farthest, stack, lows, before, near, far):
    """Fill a list with the nearest points up to a distance; returns a lower bound of all others.

    The list as it was, copied to `before`, leaves little to search. `far` are the distances.
    """
    bounds, depth = tree
    n, leaves, last = len(points), 1 << depth, len(near) - 1
    before[:] = near
    near[:], far[:] = -1, farthest * farthest
    for i in before:
        if i >= 0:
            _enter(i, _between(p, points[i]), near, far)
    stack[0], lows[0], size = 1, 0.0, 1
    while size > 0:
        size -= 1
        node = stack[size]
        if lows[size] >= far[last]:
            continue
        if node < leaves:
            first, second = 2 * node, 2 * node + 1
            low, high = _square(p, bounds, first), _square(p, bounds, second)
            if high < low:
                first, second, low, high = second, first, high, low
            stack[size], lows[size] = second, high
            stack[size + 1], lows[size + 1] = first, low
            size += 2
            continue
        leaf = node - leaves
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            _enter(i, _between(p, points[i]), near, far)
    for i in range(len(far)):
        far[i] = np.sqrt(far[i])
    return far[last]


@kernel
def nearest_points(begin, end, places, points, bounds, depth, out_near, out_far):
    """Nearest point of each place, out_near (q, 1), and its distance, out_far (q, 1)."""
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    before = np.empty(1, np.int64)
    for q in range(begin, end):
        near = out_near[q]
        near[0] = out_near[q - 1, 0] if q > begin else -1
        _list_points(
            places[q], points, (bounds, depth), np.inf, stack, lows, before, near, out_far[q]
        )


@kernel
def _nearest_listed(p, points, near, far, gone):
    """Nearest of listed points and its distance; -1 and infinite where there is none.

    `far` are the distances, ascending, of a place that p has `gone` from.
    """
    best, chosen = np.inf, -1
    for i in range(len(near)):
        least = far[i] - gone
        if near[i] < 0 or (least > 0.0 and least * least >= best):
            break
        square = _between(p, points[near[i]])
        if square < best:
            best, chosen = square, near[i]
    return np.sqrt(best), chosen


@kernel
def find_overshoot(
    begin, end, balls, points, normals, bounds, depth, limits, out_over, out_near, out_lists,
    out_far, out_others, out_at,
):  # fmt: skip
    """By how much balls (q, 4) stick out: depth of the center less radius; 0 where they do not.

    The depth is the distance to the nearest point of the surface, negative outside; out_near is
    that point, -1 where none is within the radius, or within the first of `limits` of a smaller
    ball. A center outside of the nearest one of its list is searched for however far it is.

    out_lists (q, k) are the nearest points of the centers out_at (q, 3), out_far (q, k) their
    distances, and out_others how far all others were from them at least; negative at first. While
    the centers move less, no other is nearer, and a ball that did not stick out does not as long as
    the nearest point was farther than it reaches now. Points, in tree order, lie no farther apart
    than half the second of `limits`, the third is how much farther than a ball reaches its list
    does.
    """
    beyond, sparse, margin = limits
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    before = np.empty(out_lists.shape[1], np.int64)
    for q in range(begin, end):
        p, guess, near, far = balls[q], out_near[q], out_lists[q], out_far[q]
        gone = np.sqrt(_between(p, out_at[q]))
        held = max(p[3], beyond)
        inside = out_others[q] >= 0.0 and out_over[q] == 0.0
        if inside and far[0] - gone >= (held if guess < 0 else max(p[3], 0.5 * sparse)):
            continue
        if guess >= 0 and _is_outside(p, points[guess], normals[guess]):
            held = max(held, np.sqrt(_between(p, points[guess])) * (1.0 + 1e-9))
        far_off, chosen = _nearest_listed(p, points, near, far, gone)
        others = out_others[q] - gone
        known = far_off <= others or (far_off > p[3] and others >= max(p[3], sparse))
        if not known:
            if near[0] < 0 and q > begin:
                near[:] = out_lists[q - 1]  # those of the ball before, which mostly is near
            out_others[q] = _list_points(
                p, points, (bounds, depth), held + margin, stack, lows, before, near, far
            )
            for d in range(3):
                out_at[q, d] = p[d]
            far_off, chosen = _nearest_listed(p, points, near, far, 0.0)
        out_near[q], out_over[q] = -1, 0.0
        if far_off < held:
            outside = _is_outside(p, points[chosen], normals[chosen])
            out_near[q] = chosen
            out_over[q] = min((-far_off if outside else far_off) - p[3], 0.0)
