"""Kernels of the ways inside a body: where a grid is crossed by a mesh, and the nearest bones.

A grid has `size` cells along each axis; cell (x, y, z) is the one of row
(x * size[1] + y) * size[2] + z. Lengths are in cells, and the center of a cell stands at (x, y, z).

1. Crossings: a ray along an axis through the centers of a column crosses triangles. Each one turns
   the count of entries from there on, and parts two neighbours.
2. Nearest bones: Dijkstra's search from all bones at once, which leaves the few cheapest of them at
   each cell. A step goes to one of 26 neighbours; it costs its length inside the body, more
   outside, and much more where a face parts the two. No step costs less than 1, so what costs
   alike, up to that, waits in a list without order: none of it makes another cheaper.
3. Smoothing within the bones that each vertex has: no bone comes, none goes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.jit import kernel


class Grid(NamedTuple):
    """Which cells are inside, and which neighbours a face parts.

    Attributes
    ----------
    size : (3,) int64
    inside : (cells,) bool
    parted : (cells,) uint8
        Bit a: a face lies between this cell and the next one along axis a.
    clear : (cells,) bool
        No face lies between any two of a cell and its 26 neighbours.
    passed : (cells,) bool
        Cells that ways lead through: those inside, and those near the surface.
    wanted : (cells,) bool
        Cells whose bones are asked for.
    """

    size: NDArray[np.int64]
    inside: NDArray[np.bool_]
    parted: NDArray[np.uint8]
    clear: NDArray[np.bool_]
    passed: NDArray[np.bool_]
    wanted: NDArray[np.bool_]


class Ways(NamedTuple):
    """The cheapest bones at each cell, k of them; in rows that lead from nowhere the bone is -1.

    Attributes
    ----------
    bones : (cells, k) int32
    costs : (cells, k) float64
    lengths : (cells, k) float64
        The part of the costs that is no fee for crossing faces.
    """

    bones: NDArray[np.int32]
    costs: NDArray[np.float64]
    lengths: NDArray[np.float64]


class Waiting(NamedTuple):
    """Lists of the ways that wait, one for each cost of a whole number, in turn; -1: the end.

    The way of cell c in column k has the name c * k + column.

    Attributes
    ----------
    firsts : (lists,) int32
        More lists than a step costs, and than a seed does.
    after, before : (cells * k,) int32
    """

    firsts: NDArray[np.int32]
    after: NDArray[np.int32]
    before: NDArray[np.int32]


class Fares(NamedTuple):
    """What steps cost, and where the search ends.

    Attributes
    ----------
    outside : float
        Times its length that a step outside costs.
    fee : float
        What a face costs.
    further : float
        How far past the last wanted cell the search goes on, as a share of the way there.
    """

    outside: float
    fee: float
    further: float


@kernel
def _side_of(ax, ay, bx, by, x, y):
    """Return on which side of a line a place lies; the line back has the same with other sign."""
    if ax < bx or (ax == bx and ay < by):
        return (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    return -((ax - bx) * (y - by) - (ay - by) * (x - bx))


@kernel
def mark_crossings(points, faces, axis, size, entries, parted):
    """Count entries, and mark parted neighbours, along one axis.

    Parameters
    ----------
    points : (n, 3) float64
        In cells.
    faces : (m, 3) int32
    axis : int
    size : (3,) int64
    entries : (cells,) int16
        Changed at the first center beyond each crossing: +1 where a ray enters the body.
    parted : (cells,) uint8
        Bit `axis` is set.
    """
    one, two = (axis + 1) % 3, (axis + 2) % 3
    strides = np.array([size[1] * size[2], size[2], 1], np.int64)
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = points[a, one], points[a, two], points[a, axis]
        bx, by, bz = points[b, one], points[b, two], points[b, axis]
        cx, cy, cz = points[c, one], points[c, two], points[c, axis]
        for x in range(
            max(0, math.ceil(min(ax, bx, cx))), min(size[one] - 1, math.floor(max(ax, bx, cx))) + 1
        ):
            for y in range(
                max(0, math.ceil(min(ay, by, cy))),
                min(size[two] - 1, math.floor(max(ay, by, cy))) + 1,
            ):
                u = _side_of(bx, by, cx, cy, x, y)
                v = _side_of(cx, cy, ax, ay, x, y)
                w = _side_of(ax, ay, bx, by, x, y)
                total = u + v + w
                if total == 0.0 or not (
                    (u >= 0 and v >= 0 and w >= 0) or (u <= 0 and v <= 0 and w <= 0)
                ):
                    continue
                height = (u * az + v * bz + w * cz) / total
                beyond = min(max(math.ceil(height), 0), size[axis])
                cell = x * strides[one] + y * strides[two] + beyond * strides[axis]
                if beyond < size[axis]:
                    entries[cell] += -1 if total > 0 else 1
                if 0 < beyond < size[axis]:
                    parted[cell - strides[axis]] |= np.uint8(1 << axis)


@kernel
def _parted_between(parted, cell, axis, step, stride):
    """Tell whether a face lies between a cell and its neighbour along an axis."""
    first = cell if step > 0 else cell - stride
    return (parted[first] >> axis) & 1 == 1


@kernel
def _is_open(parted, cell, step, strides):
    """Tell whether one of the ways along axes to a neighbour crosses no face; `step` is -1 to 1."""
    for first in range(3):
        for second in range(3):
            if second == first:
                continue
            at, crossed = cell, False
            for axis in (first, second, 3 - first - second):
                if step[axis] != 0:
                    if _parted_between(parted, at, axis, step[axis], strides[axis]):
                        crossed = True
                        break
                    at += step[axis] * strides[axis]
            if not crossed:
                return True
    return False


@kernel
def _wait(firsts, after, before, name, row):
    """Put a way into a list."""
    second = firsts[row]
    firsts[row], after[name], before[name] = name, second, -1
    if second >= 0:
        before[second] = name


@kernel
def _leave(firsts, after, before, name, row):
    """Take a way out of its list."""
    former, latter = before[name], after[name]
    if former >= 0:
        after[former] = latter
    else:
        firsts[row] = latter
    if latter >= 0:
        before[latter] = former


@kernel
def _neighbours(strides):
    """Return steps to the 26 neighbours of a cell, how far on they are in rows, and how long."""
    steps, offsets, lengths = np.empty((26, 3), np.int64), np.empty(26, np.int64), np.empty(26)
    count = 0
    for code in range(27):
        if code == 13:  # the cell itself
            continue
        offsets[count], squared = 0, 0
        for axis, step in enumerate((code // 9 - 1, code // 3 % 3 - 1, code % 3 - 1)):
            steps[count, axis] = step
            offsets[count] += step * strides[axis]
            squared += step * step
        lengths[count] = math.sqrt(squared)
        count += 1
    return steps, offsets, lengths


@kernel
def _on_grid(at, step, size):
    """Tell whether a step from a cell leads to another cell of the grid."""
    inside = True
    for axis in range(3):
        inside = inside and 0 <= at[axis] + step[axis] < size[axis]
    return inside


@kernel
def nearest_bones(grid, fares, ways, waiting):
    """Search the cheapest bones of the wanted cells, and of all that lie nearer.

    Of bones that cost the same those that come first are kept.

    Parameters
    ----------
    grid : Grid
        Cells are wanted no more once they have a bone.
    fares : Fares
    ways : Ways
        Those where the search begins; filled.
    waiting : Waiting
        Empty lists.

    Returns
    -------
    float
        The cost up to which ways are the cheapest ones, and to which the search went.
    """
    bones, costs = ways.bones, ways.costs
    firsts, after, before = waiting
    width = bones.shape[1]
    strides = np.array([grid.size[1] * grid.size[2], grid.size[2], 1], np.int64)
    steps, offsets, lengths = _neighbours(strides)
    at = np.zeros(3, np.int64)
    left, highest = 0, -1.0
    # The costliest bone of each cell: what costs more is turned away without a look at the rest.
    most = np.full(len(grid.wanted), -1.0)
    for cell in range(len(most)):
        left += grid.wanted[cell]
        for k in range(width):
            if grid.passed[cell]:
                most[cell] = max(most[cell], costs[cell, k])
            if costs[cell, k] < math.inf:
                highest = max(highest, costs[cell, k])
                _wait(firsts, after, before, cell * width + k, int(costs[cell, k]) % len(firsts))
    whole, limit, last, length_of_last = 0, math.inf, -1.0, 0.0
    while whole <= min(limit, highest):
        row = whole % len(firsts)
        name = firsts[row]
        if name < 0:
            whole += 1
            if left == 0:
                limit = last + fares.further * length_of_last
            continue
        _leave(firsts, after, before, name, row)
        cell, column = name // width, name % width
        bone, cost, length = bones[cell, column], costs[cell, column], ways.lengths[cell, column]
        if cost > limit:
            continue
        if grid.wanted[cell]:
            grid.wanted[cell] = False
            left -= 1
            nearest = costs[cell].argmin()
            if costs[cell, nearest] > last:
                last, length_of_last = costs[cell, nearest], ways.lengths[cell, nearest]
        at[0], at[1], at[2] = (
            cell // strides[0],
            cell // strides[1] % grid.size[1],
            cell % strides[1],
        )
        within = True
        for axis in range(3):
            within = within and 0 < at[axis] < grid.size[axis] - 1
        inside, clear = grid.inside[cell], grid.clear[cell]
        for code in range(26):
            if not within and not _on_grid(at, steps[code], grid.size):
                continue
            other = cell + offsets[code]
            way = lengths[code]
            if cost + way > most[other]:
                continue
            if not (inside and grid.inside[other]):
                way *= fares.outside
            further = cost + way
            if further > most[other]:
                continue
            if not clear and not _is_open(grid.parted, cell, steps[code], strides):
                further += fares.fee
            column, known = 0, -1.0
            for k in range(width):
                if bones[other, k] == bone:
                    column, known = k, costs[other, k]
                    break
                if costs[other, k] > known or (
                    costs[other, k] == known and bones[other, k] > bones[other, column]
                ):
                    column, known = k, costs[other, k]
            if known < further or (known == further and bones[other, column] <= bone):
                continue
            name = other * width + column
            if known < math.inf:
                _leave(firsts, after, before, name, int(known) % len(firsts))
            _wait(firsts, after, before, name, int(further) % len(firsts))
            bones[other, column], costs[other, column] = bone, further
            ways.lengths[other, column] = length + way
            worst = 0.0
            for k in range(width):
                worst = max(worst, costs[other, k])
            most[other], highest = worst, max(highest, further)
    return limit


class Couplings(NamedTuple):
    """How the weights of vertices pull at each other.

    Attributes
    ----------
    starts : (n + 1,) int32
    others : (e,) int32
        Neighbours of vertex v: ``others[starts[v]:starts[v + 1]]``.
    strengths : (e,) float64
    pulls : (n,) float64
        How hard a vertex is drawn to the weights that it had before.
    """

    starts: NDArray[np.int32]
    others: NDArray[np.int32]
    strengths: NDArray[np.float64]
    pulls: NDArray[np.float64]


@kernel
def smooth_within(couplings, bones, before, weights, moved):
    """Take each vertex once to the mean of its neighbours and of what it had before.

    Parameters
    ----------
    couplings : Couplings
    bones : (n, k) int32
        -1: none.
    before, weights : (n, k) float64
    moved : (n, k) float64
        Filled; rows sum to 1.
    """
    k = bones.shape[1]
    for v in range(len(bones)):
        total = 0.0
        for column in range(k):
            bone, value = bones[v, column], 0.0
            if bone >= 0:
                value = couplings.pulls[v] * before[v, column]
                for row in range(couplings.starts[v], couplings.starts[v + 1]):
                    other = couplings.others[row]
                    for there in range(k):
                        if bones[other, there] == bone:
                            value += couplings.strengths[row] * weights[other, there]
                            break
            moved[v, column] = value
            total += value
        for column in range(k):
            moved[v, column] = moved[v, column] / total if total > 0.0 else weights[v, column]
