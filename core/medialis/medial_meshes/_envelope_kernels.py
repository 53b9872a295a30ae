"""Kernels of envelopes: a tree of boxes, and distances to balls, cones and slabs in closed form.

The tree has no pointers: node i has the children 2 i and 2 i + 1, and node (1 << b) + j covers the
items n j >> b up to n (j + 1) >> b in tree order. A node knows the box of the centers below it and
their largest radius.

Between balls (c_i, r_i) centers and radii are linear, so f(l) = |p - c(l)| - r(l) is convex: its
smallest value over a segment or a triangle is the signed distance to their cone or slab, exact
outside. Let g be the gradient of the radius in the plane of the centers. Without the borders f is
smallest where the foot of p has moved by g h / sqrt(1 - g^2), h the height of p over the plane, and
is h sqrt(1 - g^2) - r(foot) there. Where that lies beyond sides, one of those sides has the
smallest value. All but the place is prepared once for each primitive, in a row of a table.

Places that are asked for again and again while balls move little keep lists of what is near.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel

STEEP = 0.3
"""Sine of the angle with a tangent plane from which on a place is outside."""

AHEAD = 2.0
"""Primitives beside those that a place has listed move at most this many times as far."""

START, START_RADIUS, WAY, GROWTH, PER_SQUARE, SHIFT, SIDE_LEAN, SIDE = 0, 3, 4, 7, 8, 9, 10, 11
"""Columns of a side: start (3), its radius, way to the end (3), growth of the radius, 1 / length^2,
shift of the foot for each height, sqrt(1 - g^2); and how many there are. The last is 0 where one
ball holds the other: the shift then tells which, 0 or 1."""

KIND, CENTER, RADIUS, DUALS, NORMAL, GROWTHS, SHIFTS, LEAN, SIDES = 0, 1, 4, 5, 11, 14, 16, 18, 19
"""Columns of a primitive: number of balls (4: no inside of its own), first center (3), its radius,
the dual vectors of the sides from it (2 x 3), the unit normal (3), growths of the radius (2),
shifts of the foot (2), sqrt(1 - g^2), and the sides 01, 12, 02."""

ROUND = SIDES + 3 * SIDE
"""Column where the middle (3) and the radius of a ball begin that holds the primitive."""

CORNERS = ROUND + 4
"""Column where its balls begin (3 x 4), the first one in the place of those that it has not."""

WIDTH = CORNERS + 12
"""Numbers of a primitive."""

ROUNDED = 1e-12
"""More than rounding: what a plane tells to be no nearer is no nearer."""


class Tree(NamedTuple):
    """A tree of boxes over n items.

    Attributes
    ----------
    order : (n,) int64
        The items in tree order.
    bounds : (2 << depth, 7) float64
        Of each node the box of the centers below, low and high, and their largest radius.
    depth : int
    """

    order: NDArray[np.int64]
    bounds: NDArray[np.float64]
    depth: int


class Primitives(NamedTuple):
    """Balls, cones and slabs: the balls of each (s, 3) or -1, what is prepared, and their tree."""

    rows: NDArray[np.int64]
    table: NDArray[np.float64]
    tree: Tree


class Nearest(NamedTuple):
    """Of each of q places the signed distance, the primitive that decides it, and its shares."""

    distance: NDArray[np.float64]
    row: NDArray[np.int64]
    shares: NDArray[np.float64]


class Listed(NamedTuple):
    """What places know of an envelope that moves: lists of k primitives each.

    Attributes
    ----------
    near : (q, k) int64
        The nearest primitives, -1 for none.
    values : (q, k) float64
        Their distances when the list was made.
    others : (q, 2) float64
        What all that are not in it had beyond, and the time of that.
    """

    near: NDArray[np.int64]
    values: NDArray[np.float64]
    others: NDArray[np.float64]


class SurfacePoints(NamedTuple):
    """Points of a surface (c, 3) with normals, in tree order, and the bounds of their tree."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    bounds: NDArray[np.float64]
    depth: int


class Overshoot(NamedTuple):
    """By how much balls stick out of a surface.

    Attributes
    ----------
    over : (q,) float64
        Depth of the center minus radius where that is negative, else 0.
    near : (q,) int64
        The nearest points of the surface, -1 for none.
    lists, far : (q, k) int64, float64
        The nearest points of the centers `at`, and their distances.
    others : (q,) float64
        How far all other points were from those at least; negative at first.
    at : (q, 3) float64
    """

    over: NDArray[np.float64]
    near: NDArray[np.int64]
    lists: NDArray[np.int64]
    far: NDArray[np.float64]
    others: NDArray[np.float64]
    at: NDArray[np.float64]


@kernel
def _select(keys, order, low, high, place):
    """Put the item of rank `place` there, smaller ones before it and larger ones behind it."""
    high -= 1
    while low < high:
        pivot = keys[(low + high) >> 1]
        i, j = low, high
        while i <= j:
            while keys[i] < pivot:
                i += 1
            while keys[j] > pivot:
                j -= 1
            if i <= j:
                keys[i], keys[j] = keys[j], keys[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            return


@kernel
def split_items(middles, depth, order, keys):
    """Bring items with these middles (n, 3) into tree order; `keys` (n,) is scratch."""
    n = len(middles)
    for level in range(depth):
        for j in range(1 << level):
            begin, end = (n * j) >> level, (n * (j + 1)) >> level
            axis, widest = 0, -1.0
            for d in range(3):
                low, high = np.inf, -np.inf
                for i in range(begin, end):
                    x = middles[order[i], d]
                    low, high = min(low, x), max(high, x)
                if high - low > widest:
                    axis, widest = d, high - low
            for i in range(begin, end):
                keys[i] = middles[order[i], axis]
            _select(keys, order, begin, end, (n * (2 * j + 1)) >> (level + 1))


@kernel
def bound_nodes(corners, radii, order, depth, out_boxes):
    """Bounds of all nodes, (2 << depth, 7): low, high, largest radius; corners (n, k, 3)."""
    n, leaves = len(corners), 1 << depth
    for leaf in range(leaves):
        box = out_boxes[leaves + leaf]
        box[:3], box[3:6], box[6] = np.inf, -np.inf, -np.inf
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            item = order[i]
            for k in range(corners.shape[1]):
                for d in range(3):
                    box[d] = min(box[d], corners[item, k, d])
                    box[3 + d] = max(box[3 + d], corners[item, k, d])
            box[6] = max(box[6], radii[item])
    for node in range(leaves - 1, 0, -1):
        for d in range(3):
            out_boxes[node, d] = min(out_boxes[2 * node, d], out_boxes[2 * node + 1, d])
            out_boxes[node, 3 + d] = max(out_boxes[2 * node, 3 + d], out_boxes[2 * node + 1, 3 + d])
        out_boxes[node, 6] = max(out_boxes[2 * node, 6], out_boxes[2 * node + 1, 6])


@kernel
def _prepare_side(balls, i, j, out):
    square = 0.0
    for d in range(3):
        out[START + d] = balls[i, d]
        out[WAY + d] = balls[j, d] - balls[i, d]
        square += out[WAY + d] * out[WAY + d]
    grows = balls[j, 3] - balls[i, 3]
    out[START_RADIUS], out[GROWTH] = balls[i, 3], grows
    if square <= grows * grows * (1.0 + 1e-12) or square < 1e-24:
        out[PER_SQUARE], out[SHIFT], out[SIDE_LEAN] = 0.0, 1.0 if grows > 0.0 else 0.0, 0.0
    else:
        lean = np.sqrt(1.0 - grows * grows / square)
        out[PER_SQUARE], out[SHIFT] = 1.0 / square, grows / (square * lean)
        out[SIDE_LEAN] = lean


@kernel
def _prepare_inside(balls, i, j, k, out):
    """Fill the columns before the sides; False where a slab has no inside of its own."""
    a, b = balls[j, :3] - balls[i, :3], balls[k, :3] - balls[i, :3]
    ar, br = balls[j, 3] - balls[i, 3], balls[k, 3] - balls[i, 3]
    aa, ab, bb = (a * a).sum(), (a * b).sum(), (b * b).sum()
    area = aa * bb - ab * ab
    if area <= 1e-10 * aa * bb:
        return False
    ga, gb = (ar * bb - br * ab) / area, (br * aa - ar * ab) / area
    steep = ga * ar + gb * br
    if steep >= 1.0:
        return False
    lean = np.sqrt(1.0 - steep)
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        out[DUALS + d] = (bb * a[d] - ab * b[d]) / area
        out[DUALS + 3 + d] = (aa * b[d] - ab * a[d]) / area
        out[NORMAL + d] = (a[e] * b[f] - a[f] * b[e]) / np.sqrt(area)
    out[GROWTHS], out[GROWTHS + 1] = ar, br
    out[SHIFTS], out[SHIFTS + 1], out[LEAN] = ga / lean, gb / lean, lean
    return True


@kernel
def _prepare_round(balls, row, out):
    count = 0
    out[:] = 0.0
    for k in range(3):
        if row[k] >= 0:
            count += 1
            for d in range(3):
                out[d] += balls[row[k], d]
    for d in range(3):
        out[d] /= count
    for k in range(3):
        own = row[k] if row[k] >= 0 else row[0]
        square, first = 0.0, CORNERS - ROUND + 4 * k
        for d in range(3):
            square += (balls[own, d] - out[d]) ** 2
        out[3] = max(out[3], np.sqrt(square) + balls[own, 3])
        for d in range(4):
            out[first + d] = balls[own, d]


@kernel
def is_beyond(p, table, s, limit):
    """Tell that primitive s is no nearer than `limit`, if the ball round it says so, or a plane.

    The plane stands upright on the way from the middle to the place. Where it has all balls behind
    it, none nearer than the limit, it has what is between them.
    """
    x, y, z = p[0] - table[s, ROUND], p[1] - table[s, ROUND + 1], p[2] - table[s, ROUND + 2]
    reach, square = limit + table[s, ROUND + 3], x * x + y * y + z * z
    if reach <= 0.0 or square >= reach * reach:
        return True
    length = np.sqrt(square)
    limit += ROUNDED * (length + table[s, ROUND + 3])
    for k in range(CORNERS, WIDTH, 4):
        along = x * (p[0] - table[s, k]) + y * (p[1] - table[s, k + 1])
        along += z * (p[2] - table[s, k + 2])
        if not along > (limit + table[s, k + 3]) * length:  # nor where a limit is infinite
            return False
    return True


@kernel
def prepare(balls, rows, out):
    """Fill the table, out (s, WIDTH)."""
    for s in range(len(rows)):
        i, j, k = rows[s]
        for d in range(4):
            out[s, CENTER + d] = balls[i, d]
        _prepare_round(balls, rows[s], out[s, ROUND:])
        out[s, KIND] = 1.0
        if j >= 0:
            out[s, KIND] = 2.0
            _prepare_side(balls, i, j, out[s, SIDES : SIDES + SIDE])
        if k >= 0:
            out[s, KIND] = 3.0 if _prepare_inside(balls, i, j, k, out[s]) else 4.0
            _prepare_side(balls, j, k, out[s, SIDES + SIDE : SIDES + 2 * SIDE])
            _prepare_side(balls, i, k, out[s, SIDES + 2 * SIDE : ROUND])


@kernel
def _along(x, y, z, table, s, first):
    """Product of a vector with the one that begins in a column of primitive s."""
    return x * table[s, first] + y * table[s, first + 1] + z * table[s, first + 2]


@kernel
def _side_distance(px, py, pz, table, s, first):
    """Signed distance to a cone, and the share of its second ball."""
    x, y, z = px - table[s, first], py - table[s, first + 1], pz - table[s, first + 2]
    way = first + WAY
    dx, dy, dz = table[s, way], table[s, way + 1], table[s, way + 2]
    lean, share = table[s, first + SIDE_LEAN], table[s, first + SHIFT]
    if lean > 0.0:
        foot = (x * dx + y * dy + z * dz) * table[s, first + PER_SQUARE]
        hx, hy, hz = x - foot * dx, y - foot * dy, z - foot * dz
        height = np.sqrt(hx * hx + hy * hy + hz * hz)
        share = foot + height * share
        if 0.0 < share < 1.0:
            return height * lean - table[s, first + 3] - foot * table[s, first + 7], share
        share = 0.0 if share <= 0.0 else 1.0
    x, y, z = x - share * dx, y - share * dy, z - share * dz
    far = np.sqrt(x * x + y * y + z * z)
    return far - table[s, first + START_RADIUS] - share * table[s, first + GROWTH], share


@kernel
def primitive_distance(p, table, s, out):
    """Signed distance to primitive s; out (3,): shares of its balls where the distance is met."""
    px, py, pz, kind = p[0], p[1], p[2], table[s, KIND]
    out[0], out[1], out[2] = 1.0, 0.0, 0.0
    x, y, z = px - table[s, CENTER], py - table[s, CENTER + 1], pz - table[s, CENTER + 2]
    if kind == 1.0:
        return np.sqrt(x * x + y * y + z * z) - table[s, RADIUS]
    if kind == 2.0:
        best, share = _side_distance(px, py, pz, table, s, SIDES)
        out[0], out[1] = 1.0 - share, share
        return best
    u, v, w = -1.0, -1.0, -1.0
    if kind == 3.0:
        height = abs(_along(x, y, z, table, s, NORMAL))
        foot_u = _along(x, y, z, table, s, DUALS)
        foot_v = _along(x, y, z, table, s, DUALS + 3)
        u, v = foot_u + height * table[s, SHIFTS], foot_v + height * table[s, SHIFTS + 1]
        w = 1.0 - u - v
        if u >= 0.0 and v >= 0.0 and w >= 0.0:
            out[0], out[1], out[2] = w, u, v
            radius = table[s, RADIUS] + foot_u * table[s, GROWTHS] + foot_v * table[s, GROWTHS + 1]
            return height * table[s, LEAN] - radius
    best = np.inf
    if v < 0.0:
        best, share = _side_distance(px, py, pz, table, s, SIDES)
        out[0], out[1] = 1.0 - share, share
    if w < 0.0:
        found, share = _side_distance(px, py, pz, table, s, SIDES + SIDE)
        if found < best:
            best = found
            out[0], out[1], out[2] = 0.0, 1.0 - share, share
    if u < 0.0:
        found, share = _side_distance(px, py, pz, table, s, SIDES + 2 * SIDE)
        if found < best:
            best = found
            out[0], out[1], out[2] = 1.0 - share, 0.0, share
    return best


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
def _open(p, bounds, node, squared, stack, lows, size):
    """Put the children of a node on the stack, the nearer one on top; returns its new size.

    With the lower bounds of what they hold, or squares of how far their boxes are away.
    """
    near, far = 2 * node, 2 * node + 1
    if squared:
        first, second = _square(p, bounds, near), _square(p, bounds, far)
    else:
        first, second = _bound(p, bounds, near), _bound(p, bounds, far)
    if second < first:
        near, far, first, second = far, near, second, first
    stack[size], lows[size] = far, second
    stack[size + 1], lows[size + 1] = near, first
    return size + 2


@kernel
def nearest_primitive(begin, end, places, primitives, enough, out):
    """Signed distance of places to the envelope; the primitive that decides it, and its shares.

    Any primitive nearer than `enough` ends the search, and no other counts; -inf for the nearest of
    all. That of the place before is looked at first.
    """
    out_distance, out_row, out_shares = out
    table, (order, bounds, depth) = primitives.table, primitives.tree
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
                size = _open(p, bounds, node, False, stack, lows, size)
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
def _is_in(near, row):
    found = False
    for i in range(len(near)):
        found = found or near[i] == row
    return found


@kernel
def _enter(row, value, near, values):
    """Put an item into a list of the nearest where it belongs, unless it is there."""
    j, length = len(near), len(near)
    if value >= values[length - 1] or _is_in(near, row):
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
            size = _open(p, bounds, node, False, stack, lows, size)
            continue
        leaf = node - leaves
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            row = order[i]
            if not is_beyond(p, table, row, values[last]) and not _is_in(near, row):
                _enter(row, primitive_distance(p, table, row, shares), near, values)
    return values[last]


@kernel
def follow_primitives(begin, end, places, primitives, movement, listed, out):
    """As `nearest_primitive`, for balls that move little: each place keeps a list of the nearest.

    A distance changes no faster than its balls move; `movement` (s, n) is how far each is from
    where it was at each of s times, the last of which is now. Primitives off the list are taken to
    move no more than twice as far as those on it: when one of them may have come nearer the list is
    made anew.
    """
    rows, table, tree = primitives
    near, values, others = listed
    stack, lows = np.empty(2 * tree.depth + 2, np.int64), np.empty(2 * tree.depth + 2)
    shares, before, now = np.empty(3), np.empty(near.shape[1], np.int64), len(movement) - 1
    for q in range(begin, end):
        p, own, known, shown = places[q], near[q], values[q], out.shares[q]
        moved = movement[int(others[q, 1])]
        best, chosen, since = _best_of(p, table, rows, own, known, moved, shares, shown)
        if chosen < 0 and q > begin:
            own[:] = near[q - 1]  # that of the place before, which mostly is near
        if chosen < 0 or best > others[q, 0] - AHEAD * since:
            others[q, 0] = _list_nearest(p, table, tree, stack, lows, shares, before, own, known)
            others[q, 1] = now
            best, chosen, since = _best_of(p, table, rows, own, known, movement[now], shares, shown)
        out.distance[q], out.row[q] = best, chosen


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
def _list_points(p, surface, farthest, stack, lows, before, near, far):
    """Fill a list with the nearest points up to a distance; returns a lower bound of all others.

    The list as it was, copied to `before`, leaves little to search. `far` are the distances.
    """
    points, _, bounds, depth = surface
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
            size = _open(p, bounds, node, True, stack, lows, size)
            continue
        leaf = node - leaves
        for i in range((n * leaf) >> depth, (n * (leaf + 1)) >> depth):
            _enter(i, _between(p, points[i]), near, far)
    for i in range(len(far)):
        far[i] = np.sqrt(far[i])
    return far[last]


@kernel
def nearest_points(begin, end, places, surface, out_near, out_far):
    """Nearest point of each place, out_near (q, 1), and its distance, out_far (q, 1)."""
    depth = surface.depth
    stack, lows = np.empty(2 * depth + 2, np.int64), np.empty(2 * depth + 2)
    before = np.empty(1, np.int64)
    for q in range(begin, end):
        near = out_near[q]
        near[0] = out_near[q - 1, 0] if q > begin else -1
        _list_points(places[q], surface, np.inf, stack, lows, before, near, out_far[q])


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
def find_overshoot(begin, end, balls, surface, beyond, sparse, margin, out):
    """By how much balls (q, 4) stick out: depth of the center less radius; 0 where they do not.

    The depth is the distance to the nearest point of the surface, negative outside. None is near
    that is not within the radius, or within `beyond` of a smaller ball. A center outside of the
    nearest point of its list is searched for however far it is.

    While the centers move less than the points that are not listed were off, none of those is
    nearer, and a ball that did not stick out does not as long as the nearest point was farther than
    it reaches now. Points lie no farther apart than half of `sparse`; `margin` is how much farther
    than a ball reaches its list does.
    """
    points, normals, _, depth = surface
    out_over, out_near, out_lists, out_far, out_others, out_at = out
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
            out_others[q] = _list_points(p, surface, held + margin, stack, lows, before, near, far)
            for d in range(3):
                out_at[q, d] = p[d]
            far_off, chosen = _nearest_listed(p, points, near, far, 0.0)
        out_near[q], out_over[q] = -1, 0.0
        if far_off < held:
            outside = _is_outside(p, points[chosen], normals[chosen])
            out_near[q] = chosen
            out_over[q] = min((-far_off if outside else far_off) - p[3], 0.0)
