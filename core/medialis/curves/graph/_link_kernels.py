"""Kernels that link balls (thesis 3.6.3; see ground.py)."""

from __future__ import annotations

import math

from medialis._kernels.jit import kernel


@kernel
def _apart(centers, a, b):
    x, y, z = (
        centers[a, 0] - centers[b, 0],
        centers[a, 1] - centers[b, 1],
        centers[a, 2] - centers[b, 2],
    )
    return math.sqrt(x * x + y * y + z * z)


@kernel
def list_links(ends, others, needed, groups, centers, radii, places, out_neighbours):
    """List links from both their ends, at the places of each ball, which then move on.

    Row i of `others` are balls that ball ``ends[i]`` may be linked to: of the same group, and where
    the link is not needed, each within the other. Without room in `out_neighbours` they are only
    counted.
    """
    for i in range(len(ends)):
        a = ends[i]
        for j in range(others.shape[1]):
            b = others[i, j]
            if a == b or groups[a] != groups[b] or groups[a] < 0:
                continue
            if not needed and not _apart(centers, a, b) < min(radii[a], radii[b]):
                continue
            if len(out_neighbours) > 0:
                out_neighbours[places[a]], out_neighbours[places[b]] = b, a
            places[a] += 1
            places[b] += 1


@kernel
def sort_links(offsets, neighbours, out_offsets, out_neighbours):
    """Write links that are listed from both ends in ascending order, each once; return how many.

    Passing on the lists of each ball in turn to the other ends sorts those.
    """
    k = len(offsets) - 1
    last = offsets[:-1].copy()
    for v in range(k):
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            if last[w] == offsets[w] or out_neighbours[last[w] - 1] != v:
                out_neighbours[last[w]] = v
                last[w] += 1
    count = 0
    for v in range(k):
        out_offsets[v] = count
        for at in range(offsets[v], last[v]):
            out_neighbours[count] = out_neighbours[at]
            count += 1
    out_offsets[k] = count
    return count


@kernel
def weigh_links(
    begin, end, offsets, neighbours, centers, radii, density, spacing, short, overlap_only, apart,
    out_length, out_cost,
):  # fmt: skip
    """Length and cost of the links of the balls begin..end (see `link_balls`)."""
    for v in range(begin, end):
        for at in range(offsets[v], offsets[v + 1]):
            w = neighbours[at]
            distance, smaller = _apart(centers, v, w), min(radii[v], radii[w])
            long = 1.0 + distance / max(short * smaller, spacing)
            cost = distance * long * (density[v] + density[w]) / 2.0
            if distance >= radii[v] + radii[w]:
                cost *= apart
            elif distance >= smaller:
                cost *= overlap_only
            # Coincident centers: the path with fewer links.
            out_length[at], out_cost[at] = distance, cost + 1e-9 * spacing
