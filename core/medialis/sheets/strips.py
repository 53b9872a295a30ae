"""Strips of triangles between the balls of fans along creases (for thesis 6.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import MedialCloud
from medialis.model.ragged import Ragged
from medialis.surface.creases import Creases
from medialis.validation import FloatArray, IntArray

Index = NDArray[np.int64]

SAME_NORMAL = 1e-6
"""Radians: what rounding turns the normal of a ball of a fan, with room."""


@dataclass(frozen=True)
class Fans:
    """The balls of fans between the sectors of a vertex.

    Attributes
    ----------
    keys : (p,) int64
        First sector times the number of sectors, plus the second, of each pair of sectors with a
        fan between; ascending.
    first : (p + 1,) int64
        Where the balls of each pair start.
    rows : (b,) int64
        Their rows in the cloud, pair after pair, from the first sector to the second.
    turns : (b,) float64
        Where the normal of each lies between those of the sectors, above 0 and below 1.
    sectors : (b,) int64
        The first sector.
    ends : (e, 2) int64
        Sectors, and the row of the ball that has the normal of one.
    """

    keys: Index
    first: Index
    rows: Index
    turns: FloatArray
    sectors: Index
    ends: Index

    @classmethod
    def of(cls, cloud: MedialCloud, creases: Creases, pairs: IntArray, rows: Index) -> Self:
        """Sort the rows of fans into pairs of sectors (p, 2)."""
        pairs = pairs.astype(np.int64)
        at_vertex = Ragged.group(cloud.source[rows], cloud.surface.point_count)
        vertex = creases.vertices[pairs[:, 0]]
        counts = at_vertex.lengths[vertex]
        pair = np.repeat(np.arange(len(pairs)), counts)
        turn = np.arange(len(pair)) - np.repeat(np.cumsum(counts) - counts, counts)
        row = rows[at_vertex.indices[at_vertex.offsets[vertex[pair]] + turn]]
        away = cloud.surface.points[cloud.source[row]] - cloud.centers[row]
        away = away * cloud.side[row][:, None]
        one, other = (creases.normals[pairs[pair, j]] for j in range(2))
        left, right, whole = _angle(one, away), _angle(away, other), _angle(one, other)
        between = left + right < whole + SAME_NORMAL
        at_end = np.stack([left < SAME_NORMAL, right < SAME_NORMAL], axis=1)
        ends = [np.stack([pairs[pair, j], row], axis=1)[at_end[:, j]] for j in range(2)]
        inside = between & ~at_end.any(axis=1)
        pair, row, part = pair[inside], row[inside], (left / whole)[inside]
        order = np.lexsort((part, pair))
        pair = pair[order]
        return cls(
            pairs[:, 0] * len(creases.vertices) + pairs[:, 1],
            np.searchsorted(pair, np.arange(len(pairs) + 1)),
            row[order],
            part[order],
            pairs[pair, 0],
            np.concatenate(ends),
        )


def strips(
    creases: Creases, fans: Fans, corner: Index, first: int, sign: int
) -> tuple[Index, Index]:
    """Return the triangles that join the two sides of creases, (t, 3), and a face beside each.

    Parameters
    ----------
    creases : Creases
    fans : Fans
    corner : (3m,) int64
        Node of each corner of the faces; n + s for sector s.
    first : int
        Node of the first ball of the fans.
    sign : int
        +1 for balls inside, -1 for those outside.
    """
    there, back = creases.half_edges[creases.inward == (sign > 0)].T
    # From the face of the first half-edge to that of the second, at its start and at its end.
    sides = [(corner[there], corner[_next(back)]), (corner[_next(there)], corner[back])]
    steps = [_steps(fans, start, end, first, len(creases.vertices)) for start, end in sides]
    edge = np.concatenate([step[0] for step in steps])
    which = np.repeat([0, 1], [len(step[0]) for step in steps])
    middle, old, new = (np.concatenate([s[j] for s in steps]) for j in (1, 2, 3))
    order = np.lexsort((which, middle, edge))
    edge, which, old, new = edge[order], which[order], old[order], new[order]
    if len(edge) == 0:
        return np.empty((0, 3), np.int64), edge
    # Each step of one side makes a triangle with where the other side is by then.
    begin = np.searchsorted(edge, np.arange(len(there)))
    done = np.stack([np.cumsum(which == side) for side in (0, 1)], axis=1)
    tip = np.empty(len(edge), np.int64)
    for side in (0, 1):
        mine = which != side  # steps whose tip is on this side
        before = np.where(begin > 0, done[begin - 1, side], 0)[edge[mine]]
        taken = done[mine, side]
        path = new[which == side]
        start = sides[side][0][edge[mine]]
        last = path[np.maximum(taken - 1, 0)] if len(path) else start
        tip[mine] = np.where(taken > before, last, start)
    triangles = np.stack([old, new, tip], axis=1)
    return triangles, there[edge] // 3


def _steps(
    fans: Fans, start: Index, end: Index, first: int, sectors: int
) -> tuple[Index, FloatArray, Index, Index]:
    """Edge, turn in the middle, node before and node after of each step from start to end."""
    base = first - sectors
    low, high = np.minimum(start, end) - base, np.maximum(start, end) - base
    bends = np.flatnonzero(low != high)  # at the end of a crease both are the same sector
    key = low[bends] * sectors + high[bends]
    pair = np.minimum(np.searchsorted(fans.keys, key), max(len(fans.keys) - 1, 0))
    # Two sectors that meet along creases of both kinds have a fan on one side only.
    count = np.where(fans.keys[pair] == key, fans.first[pair + 1] - fans.first[pair], 0)
    edge = np.repeat(bends, count)
    place = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    place += np.repeat(fans.first[pair], count)
    turned = (start > end)[edge]
    turn = np.where(turned, 1.0 - fans.turns[place], fans.turns[place])
    edges = np.concatenate([bends, edge, bends])
    nodes = np.concatenate([start[bends], first + place, end[bends]])
    turns = np.concatenate([np.zeros(len(bends)), turn, np.ones(len(bends))])
    order = np.lexsort((turns, edges))
    edges, nodes, turns = edges[order], nodes[order], turns[order]
    step = np.flatnonzero(edges[1:] == edges[:-1])
    return edges[step], (turns[step] + turns[step + 1]) / 2, nodes[step], nodes[step + 1]


def _next(half_edges: Index) -> Index:
    return half_edges - half_edges % 3 + (half_edges + 1) % 3


def _angle(one: FloatArray, other: FloatArray) -> FloatArray:
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.asarray(np.arctan2(across, np.einsum("ij,ij->i", one, other)))
