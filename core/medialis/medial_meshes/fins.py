"""Sheets of a fine complex that change its envelope little are taken away, as wholes.

A sheet with a free rim goes when each of its balls sticks out of a ball that stays by less than a
bound. It is taken from its rim by elementary collapses, so the topology stays; where others are one
sheet then, they are looked at again.
"""

from __future__ import annotations

import numpy as np

from medialis.base.arrays import Index, Mask, Ragged, kd_tree
from medialis.base.validation import FloatArray
from medialis.medial_meshes.fine_complex import FineComplex
from medialis.medial_meshes.mesh import Complex, sheets_of

AROUND = 12
"""Balls that stay next to one that goes, that are looked at: the larger ones may be farther."""

ROUNDS = 8
"""In which fins are sought, at most: each makes sheets that were cut by fins one."""


def finless(fine: FineComplex, bound: float) -> FineComplex:
    """Return a fine complex without fins; candidates belong to the ball next to theirs then."""
    now, place = without_fins(Complex(fine.balls, fine.edges, fine.faces), bound)
    pole = place[fine.pole]
    lost = np.flatnonzero(pole < 0)
    if len(lost):
        pole[lost] = kd_tree(now.balls[:, :3]).query(fine.balls[fine.pole[lost], :3])[1]
    return FineComplex(now.balls, now.edges, now.faces, fine.samples, pole, fine.betti)


def without_fins(given: Complex, bound: float) -> tuple[Complex, Index]:
    """Return a complex without fins, and the row of each vertex in it, -1 where it is gone.

    `bound` is how far, at most, a ball of a fin sticks out of one that stays.
    """
    place = np.arange(len(given))
    now = Complex(given.balls, np.sort(given.edges, axis=1), np.sort(given.faces, axis=1))
    for _ in range(ROUNDS):
        low = _low_sheets(now, bound)
        if not low.any():
            break
        vertices, edges, faces = _taken(now, low)
        if vertices.all() and edges.all():
            break
        number = np.where(vertices, np.cumsum(vertices) - 1, -1)
        now = Complex(now.balls[vertices], number[now.edges[edges]], number[now.faces[faces]])
        place = np.where(place >= 0, number[place], -1)
    return now, place


def _low_sheets(now: Complex, bound: float) -> Mask:
    """Tell which triangles belong to sheets that others stand for, (f,)."""
    sheet = sheets_of(now.balls[:, :3], now.faces).of_faces
    count = int(sheet.max(initial=-1)) + 1
    order = np.argsort(np.bincount(sheet, minlength=count), kind="stable")
    within = np.full(len(now), -1)  # the sheet of vertices within one, or on its free rim
    low = np.full(len(now), count)
    high = np.full(len(now), -1)
    for corner in now.faces.T:
        np.minimum.at(low, corner, sheet)
        np.maximum.at(high, corner, sheet)
    alone = (low == high) & (high >= 0)
    within[alone] = high[alone]
    worst = np.zeros(count)
    own = np.flatnonzero(within >= 0)
    largest = order[-1] if count else -1
    own = own[within[own] != largest]
    stays = _excess(now.balls, own, within)
    np.maximum.at(worst, within[own], stays)
    fins = worst < bound
    if count:
        fins[largest] = False
    return np.asarray(fins[sheet])


def _excess(balls: FloatArray, rows: Index, sheet: Index) -> FloatArray:
    """Return by how much balls stick out of the one, of no or another sheet, that holds most."""
    if len(rows) == 0:
        return np.empty(0)
    far, near = kd_tree(balls[:, :3]).query(balls[rows, :3], k=min(AROUND * 4, len(balls)))
    excess = far + balls[rows, 3:] - balls[near, 3]
    excess[sheet[near] == sheet[rows][:, None]] = np.inf
    return np.asarray(excess.min(axis=1))


def _taken(now: Complex, low: Mask) -> tuple[Mask, Mask, Mask]:
    """Collapse triangles from free rims, and edges that they leave; tell what stays."""
    from medialis.medial_meshes._complex_kernels import Dual, Live, prune

    count = len(now)
    keys = now.edges @ np.array([count, 1])
    order = np.argsort(keys, kind="stable")
    sides = np.stack(
        [
            order[np.searchsorted(keys, now.faces[:, pair] @ [count, 1], sorter=order)]
            for pair in ([0, 1], [0, 2], [1, 2])
        ],
        axis=1,
    ).astype(np.int64)
    edges = np.full((len(now.edges), 5), -1)
    edges[:, :2] = now.edges
    by_vertex = Ragged.group(now.edges.ravel(), count)
    items = np.asarray(by_vertex.indices, np.int64) // 2
    loose = np.ones(len(edges))
    loose[sides[low].ravel()] = 0.0
    live = Live(*(np.ones(n, bool) for n in (count, len(edges), len(sides))))
    dual = Dual(edges, np.ascontiguousarray(sides), by_vertex.offsets, items)
    prune(dual, loose, np.where(low, 0.0, 1.0), 0.5, live)
    return live.vertices, live.edges, live.faces
