"""Kernels of no feature: a heap, union-find, small systems, rows, sides of faces, polygons.

The heap holds (key, name) pairs in two arrays. Each entry has four children: the heap is half as
deep as a binary one, and those four lie side by side in memory, which makes searches along graphs
1.6 to 1.9 times as fast.
"""

from __future__ import annotations

import numpy as np

from medialis.base.jit import kernel


@kernel
def next_side(h):
    """Return the half-edge after h in its face; `arrays.next_side` does it for rows of them."""
    return h - 2 if h % 3 == 2 else h + 1


@kernel
def previous_side(h):
    """Return the half-edge before h in its face."""
    return h + 2 if h % 3 == 0 else h - 1


@kernel
def _before(key, name, other_key, other_name):
    return key < other_key or (key == other_key and name < other_name)


@kernel
def push(keys, names, size, key, name):
    """Enter one pair; return the new size. Equal keys leave in the order of their names."""
    child = size
    while child > 0:
        parent = (child - 1) >> 2
        if not _before(key, name, keys[parent], names[parent]):
            break
        keys[child], names[child] = keys[parent], names[parent]
        child = parent
    keys[child], names[child] = key, name
    return size + 1


@kernel
def pop(keys, names, size):
    """Move the smallest entry to the end of the heap, which loses it; return the new size."""
    size -= 1
    first_key, first_name = keys[0], names[0]
    key, name = keys[size], names[size]
    parent = 0
    while 4 * parent + 1 < size:
        best = 4 * parent + 1
        for child in range(best + 1, min(best + 4, size)):
            if _before(keys[child], names[child], keys[best], names[best]):
                best = child
        if not _before(keys[best], names[best], key, name):
            break
        keys[parent], names[parent] = keys[best], names[best]
        parent = best
    keys[parent], names[parent] = key, name
    keys[size], names[size] = first_key, first_name
    return size


@kernel
def find_root(parent, i):
    """Root of the piece of element i; halves the way on the way, which keeps later ways short."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def join(parent, i, j):
    """Join the pieces of two elements: the lower root wins, so it is the lowest element."""
    i, j = find_root(parent, i), find_root(parent, j)
    if i < j:
        parent[j] = i
    elif j < i:
        parent[i] = j


@kernel
def number_pieces(parent, out_label):
    """Piece of each element, (n,), numbered by their lowest elements; `parent` made by `join`."""
    count = 0
    for i in range(len(parent)):
        if parent[i] == i:
            out_label[i] = count
            count += 1
        else:
            out_label[i] = out_label[parent[i]]  # never above i


@kernel
def label_pieces(links, parent, out_label):
    """Piece of each element that links (e, 2) int64 join; `parent` is 0, 1, 2 and so on."""
    for k in range(len(links)):
        join(parent, links[k, 0], links[k, 1])
    number_pieces(parent, out_label)


@kernel
def solve(matrix, x):
    """Solve a symmetric positive system for columns x, by its factors L D L^T.

    Of `matrix` (n, n) the lower half is read and becomes the factors; `x` (n, c) becomes the
    solutions.
    """
    size = len(x)
    for i in range(size):
        for j in range(i):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k] * matrix[k, k]
            matrix[i, j] /= matrix[j, j]
        for k in range(i):
            matrix[i, i] -= matrix[i, k] * matrix[i, k] * matrix[k, k]
    for column in range(x.shape[1]):
        for i in range(size):
            for k in range(i):
                x[i, column] -= matrix[i, k] * x[k, column]
        for i in range(size):
            x[i, column] /= matrix[i, i]
        for i in range(size - 1, -1, -1):
            for k in range(i + 1, size):
                x[i, column] -= matrix[k, i] * x[k, column]


@kernel
def group_keys(keys, out_offsets, out_order):
    """Positions of each key, ascending: a counting sort. Negative keys are left out.

    `out_offsets` (rows + 2,) is 0 and becomes where rows start, one more than there are at the end.
    """
    for i in range(len(keys)):
        if keys[i] >= 0:
            out_offsets[keys[i] + 2] += 1
    for row in range(1, len(out_offsets)):
        out_offsets[row] += out_offsets[row - 1]
    for i in range(len(keys)):
        if keys[i] >= 0:
            out_order[out_offsets[keys[i] + 1]] = i
            out_offsets[keys[i] + 1] += 1


FEW = 32  # halved 0 %, doubled 0 %
"""Keys that are put in order one by one; more of them by a heap."""


@kernel
def _sift(keys, begin, size, parent):
    """Let a key of a binary heap of so many keys sink to where it belongs."""
    key = keys[begin + parent]
    while 2 * parent + 1 < size:
        child = 2 * parent + 1
        if child + 1 < size and keys[begin + child + 1] > keys[begin + child]:
            child += 1
        if keys[begin + child] <= key:
            break
        keys[begin + parent] = keys[begin + child]
        parent = child
    keys[begin + parent] = key


@kernel
def sort_keys(keys, begin, end):
    """Put the keys begin..end in ascending order, in place: mostly few, whatever their number."""
    size = end - begin
    if size <= FEW:
        for i in range(begin + 1, end):
            key, place = keys[i], i
            while place > begin and keys[place - 1] > key:
                keys[place] = keys[place - 1]
                place -= 1
            keys[place] = key
        return
    for parent in range(size // 2 - 1, -1, -1):
        _sift(keys, begin, size, parent)
    for last in range(size - 1, 0, -1):
        keys[begin], keys[begin + last] = keys[begin + last], keys[begin]
        _sift(keys, begin, last, 0)


@kernel
def group_sides(corners, count, out_order, out_first, out_ends, out_forward):
    """Half-edges by their edge, for `EdgeTable`; return how many edges there are.

    A counting sort by the lower of `count` vertices; the few of each are put in order by the higher
    one, and by themselves, which is one number.
    """
    sides = len(corners)
    place, keys = np.zeros(count + 1, np.int32), np.empty(sides, np.int64)
    for h in range(sides):
        a, b = corners[h], corners[next_side(h)]
        out_forward[h] = a < b
        place[min(a, b)] += 1
    total = 0
    for v in range(count + 1):
        total, place[v] = total + place[v], total
    for h in range(sides):
        a, b = corners[h], corners[next_side(h)]
        low = min(a, b)
        keys[place[low]] = np.int64(max(a, b)) << 32 | h
        place[low] += 1
    edges, begin = 0, 0
    for v in range(count):
        end, before = place[v], -1
        sort_keys(keys, begin, end)
        for k in range(begin, end):
            high = keys[k] >> 32
            out_order[k] = keys[k] & 0xFFFFFFFF
            if high != before:
                out_first[edges], out_ends[edges, 0], out_ends[edges, 1] = k, v, high
                edges += 1
                before = high
        begin = end
    out_first[edges] = sides
    return edges


@kernel
def pair_sides(order, first, forward, out_one, out_other, out_opposite):
    """Both half-edges of each edge with two, for `EdgeTable`; return how many edges these are."""
    filled = 0
    for e in range(len(first) - 1):
        k = first[e]
        if first[e + 1] - k == 2:
            a, b = order[k], order[k + 1]
            out_one[filled], out_other[filled] = a, b
            out_opposite[filled] = forward[a] != forward[b]
            filled += 1
    return filled


@kernel
def turn_sides(order, forward, turned, out_order, out_forward):
    """Half-edges of a table where some faces are turned over: side j of theirs is then 2 - j."""
    for k in range(len(order)):
        h = order[k]
        f = h // 3
        out_order[k] = 6 * f + 2 - h if turned[f] else h
    for f in range(len(turned)):
        for j in range(3):
            if turned[f]:
                out_forward[3 * f + j] = not forward[3 * f + 2 - j]
            else:
                out_forward[3 * f + j] = forward[3 * f + j]


@kernel
def find_equal_places(places, out_table, out_first):
    """Lowest row equal to each row of places (n, 3), (n,); return how many have an earlier one.

    `out_table` is -1 and a power of two long, more than n: rows stand in it where a hash of their
    bits points, or at the next free place.
    """
    last, repeated = np.uint64(len(out_table) - 1), 0
    bits = np.empty(3)
    words = bits.view(np.uint64)
    for i in range(len(places)):
        bits[0], bits[1], bits[2] = places[i, 0] + 0.0, places[i, 1] + 0.0, places[i, 2] + 0.0
        mixed = np.uint64(0)
        for axis in range(3):  # the splitmix64 finisher over one after the other
            mixed = (mixed + np.uint64(0x9E3779B97F4A7C15)) ^ words[axis]
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            mixed ^= mixed >> np.uint64(31)
        slot = mixed & last
        out_first[i] = i
        while out_table[slot] >= 0:
            j = out_table[slot]
            if (
                places[j, 0] == places[i, 0]
                and places[j, 1] == places[i, 1]
                and places[j, 2] == places[i, 2]
            ):
                out_first[i] = j
                repeated += 1
                break
            slot = (slot + np.uint64(1)) & last
        if out_first[i] == i:
            out_table[slot] = i
    return repeated


@kernel
def walk_chains(edges, order, starts, degrees, out_nodes):
    """Nodes along each chain; a closed one ends with its first node.

    Chain k has the edges order[starts[k]:starts[k + 1]], and its nodes get the places
    starts[k] + k to starts[k + 1] + k. It begins at its lowest node whose degree is not 2, a closed
    one without any at its lowest.
    """
    near = np.empty((len(degrees), 2), np.int32)
    for chain in range(len(starts) - 1):
        rows = order[starts[chain] : starts[chain + 1]]
        here, end = len(degrees), len(degrees)
        for e in rows:
            for j in range(2):
                v = edges[e, j]
                near[v, 0] = near[v, 1] = -1
                here = min(here, v)
                if degrees[v] != 2:
                    end = min(end, v)
        if end < len(degrees):
            here = end
        for e in rows:
            for j in range(2):
                v = edges[e, j]
                near[v, 0 if near[v, 0] < 0 else 1] = edges[e, 1 - j]
        place, before = starts[chain] + chain, -1
        out_nodes[place] = here
        for step in range(1, len(rows) + 1):
            on = near[here, 1] if near[here, 0] == before and near[here, 1] >= 0 else near[here, 0]
            before, here = here, on
            out_nodes[place + step] = here


@kernel
def _turn(ring, a, b, c):
    """Twice the signed area of the triangle of three corners."""
    ux, uy = ring[b, 0] - ring[a, 0], ring[b, 1] - ring[a, 1]
    vx, vy = ring[c, 0] - ring[a, 0], ring[c, 1] - ring[a, 1]
    return ux * vy - uy * vx


@kernel
def _same(ring, a, b):
    return ring[a, 0] == ring[b, 0] and ring[a, 1] == ring[b, 1]


@kernel
def _blocker(ring, following, before, ear):
    """Corner that lies in the triangle of an ear and at none of its corners; -1 without one."""
    a, c = before[ear], following[ear]
    k = following[c]
    while k != a:
        if (
            _turn(ring, a, ear, k) >= 0.0
            and _turn(ring, ear, c, k) >= 0.0
            and _turn(ring, c, a, k) >= 0.0
            and not (_same(ring, k, a) or _same(ring, k, ear) or _same(ring, k, c))
        ):
            return k
        k = following[k]
    return -1


@kernel
def _fatness(ring, a, b, c):
    """Area of a triangle over the square of its longest side but one, the base of the ear."""
    dx, dy = ring[c, 0] - ring[a, 0], ring[c, 1] - ring[a, 1]
    return _turn(ring, a, b, c) / max(dx * dx + dy * dy, 1e-300)


@kernel
def clip_ears(ring, out_triangles):
    """Cut off the fattest ear again and again; always ends, also where the polygon crosses itself.

    An ear that another corner lies in stays none until that corner has gone, so it is looked at
    again only then: O(corners) for a cut, besides the tests of new ears.
    """
    n = len(ring)
    following, before = np.empty(n, np.int64), np.empty(n, np.int64)
    fat, blocked = np.empty(n), np.full(n, -1, np.int64)
    for k in range(n):
        following[k], before[k] = (k + 1) % n, (k + n - 1) % n
    for k in range(n):
        fat[k] = _fatness(ring, before[k], k, following[k])
    gone = np.zeros(n, np.bool_)
    first = 0
    for step in range(n - 3):
        best = -1
        while True:
            best, k = -1, first
            for _ in range(n - step):
                free = blocked[k] < 0 or gone[blocked[k]]
                if free and fat[k] > 0.0 and (best < 0 or fat[k] > fat[best]):
                    best = k
                k = following[k]
            if best < 0:
                break
            blocked[best] = _blocker(ring, following, before, best)
            if blocked[best] < 0:
                break
        if best < 0:  # no ear: the corner with the largest area
            k, largest = first, -np.inf
            for _ in range(n - step):
                area = _turn(ring, before[k], k, following[k])
                if area > largest:
                    best, largest = k, area
                k = following[k]
        a, c = before[best], following[best]
        out_triangles[step, 0], out_triangles[step, 1], out_triangles[step, 2] = a, best, c
        gone[best] = True
        following[a], before[c] = c, a
        if best == first:
            first = c
        for k in (a, c):
            fat[k] = _fatness(ring, before[k], k, following[k])
            blocked[k] = -1
    out_triangles[n - 3, 0] = first
    out_triangles[n - 3, 1] = following[first]
    out_triangles[n - 3, 2] = following[following[first]]
