"""Kernels of searches along links between balls: the cheapest path of each to a graph (growth.py).

Dijkstra's search, with buckets of costs in the place of a heap: balls of one bucket are visited in
any order, and again where one of them serves another better, which is rare in narrow buckets. Costs
and paths are those of a heap, but for paths that cost the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel


class Queue(NamedTuple):
    """Balls in buckets by the cost of their paths, each bucket a list; none is in two of them.

    Attributes
    ----------
    heads : (buckets + 1,) int32
        The first ball of each bucket, -1 for none; the last one has all that is dearer.
    after, before : (k,) int32
        The balls beside each in its list.
    places : (k,) int32
        The bucket of each ball; -1: it does not wait.
    """

    heads: NDArray[np.int32]
    after: NDArray[np.int32]
    before: NDArray[np.int32]
    places: NDArray[np.int32]


@kernel
def _bucket(cost, width):
    """Return the number of the bucket of a cost, from 0 on; sums of costs may be 1e18 widths."""
    return np.int64(min(cost / width, 4e18))


@kernel
def _wait(queue, v, number):
    """Move a ball to a bucket; it may be there, or nowhere."""
    heads, after, before, places = queue
    number = min(number, len(heads) - 1)
    if places[v] == number:
        return
    if places[v] >= 0:
        a, b = before[v], after[v]
        if a >= 0:
            after[a] = b
        else:
            heads[places[v]] = b
        if b >= 0:
            before[b] = a
    head = heads[number]
    after[v], before[v], places[v] = head, -1, number
    if head >= 0:
        before[head] = v
    heads[number] = v


@kernel
def _open_dearest(queue, spent, width):
    """Share out the balls of the last bucket, when all others are empty; returns the first cost.

    The buckets begin there.
    """
    heads, after, _, places = queue
    last, low = len(heads) - 1, np.inf
    v = heads[last]
    while v >= 0:
        low = min(low, spent[v])
        v = after[v]
    first, v = _bucket(low, width), heads[last]
    heads[last] = -1
    while v >= 0:
        following = after[v]
        places[v] = -1
        _wait(queue, v, _bucket(spent[v], width) - first)
        v = following
    return first


@kernel
def _spread(links, found, queue, targets, most, width):
    """Find the cheapest paths from the balls that wait in the last bucket, which have their costs.

    When all other buckets are empty, the last one is shared out among them. Where they are so
    narrow for the costs that come that this takes longest, they get wider.
    """
    offsets, neighbours, heads = links.offsets, links.neighbours, queue.heads
    spent, path, parent, base = found
    last, left, done = len(heads) - 1, len(spent) + 1, 0
    missing = np.zeros(0, np.bool_)
    if len(targets) > 0 and most == np.inf:
        missing, left = targets.copy(), np.sum(targets)
    while heads[last] >= 0 and left > 0:
        waiting, v = 0, heads[last]
        while v >= 0:
            waiting += 1
            v = queue.after[v]
        if 4 * done < waiting:
            width *= 2.0
        first, done = _open_dearest(queue, spent, width), 0
        for number in range(last):
            while heads[number] >= 0:
                v = heads[number]
                heads[number] = -1
                while v >= 0:
                    following, here = queue.after[v], spent[v]
                    queue.places[v] = -1
                    done += 1
                    if len(missing) > 0 and missing[v]:
                        missing[v] = False
                        left -= 1
                    for link in range(offsets[v], offsets[v + 1]):
                        w = neighbours[link]
                        there = here + links.cost[link]
                        if there < spent[w] and there <= most:
                            spent[w], path[w] = there, path[v] + links.length[link]
                            parent[w], base[w] = v, base[v]
                            _wait(queue, w, _bucket(there, width) - first)
                    v = following
            if left == 0:
                break
    for number in range(last + 1):
        v = heads[number]
        heads[number] = -1
        while v >= 0:
            queue.places[v] = -1
            v = queue.after[v]


@kernel
def spread_from_tree(sources, links, found, queue, targets, most, width):
    """Search from new sources: the cheapest path of each ball to the tree so far.

    `found` is the cost of that path, its length, the next ball on it, and where it ends. They come
    with the answer for the sources before (inf and -1 at first), so that only balls that the new
    sources serve better are visited. Where there are `targets` (k,) only their paths are sure, and
    nothing that costs more than `most` is looked for. `queue` comes empty and is left empty;
    `width` is that of a bucket.
    """
    spent, path, parent, base = found
    for v in sources:
        spent[v], path[v], parent[v], base[v] = 0.0, 0.0, -1, v
        _wait(queue, v, len(queue.heads))
    _spread(links, found, queue, targets, most, width)


@kernel
def spread_into(lost, links, found, queue, width):
    """Find anew the cheapest paths of balls that lost theirs, as `spread_from_tree` has them.

    All others keep their path. The search begins at those beside lost ones.
    """
    spent, path, parent, base = found
    for v in lost:
        spent[v], path[v], parent[v], base[v] = np.inf, np.inf, -1, -1
    for v in lost:
        for link in range(links.offsets[v], links.offsets[v + 1]):
            w = links.neighbours[link]
            if spent[w] < np.inf:
                _wait(queue, w, len(queue.heads))
    _spread(links, found, queue, np.zeros(0, np.bool_), np.inf, width)
