"""The collapse of complexes by quadrics of the planes that their balls touch.

`planes_of` gathers the quadrics, `collapse` merges vertices by them, the cheapest pair first, and
`coarser` does both for a fitted complex, `evened` makes its triangles even. `hung` is how kernels
keep a complex that changes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from medialis.base.arrays import Index
from medialis.base.validation import FloatArray, require_rows
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fins import Planes
from medialis.medial_meshes.mesh import Collapse, Complex
from medialis.medial_meshes.roofs import Roof
from medialis.medial_meshes.sampling import Samples

if TYPE_CHECKING:
    from medialis.medial_meshes._collapse_kernels import Hung

HOLD = 1e-3  # halved 100 %, doubled 100 %
"""Weight of staying in place against the planes of the surface, which alone leave slack."""

EVEN_HOLD = 0.1
"""The same where sheets stay whole: balls spread evenly on them."""

TOUCHED = 0.1
"""Weight of the planes that a ball of a polyhedron touches, in those of balls in the mean."""

FLAT_HOLD = 1e-7
"""The same where the planes are those of a polyhedron: they leave slack only along sheets and
seams, and merging along these must cost less than the smallest sheet."""

RIM = 1e-4
"""Radii up to which balls of a polyhedron are on its edges and corners."""

EVEN_ROUNDS = 6
"""Of flips, and of moves after them."""

MOVES, FLIPS = 2, 5
"""In each round, at most."""

LEAST_WEIGHT = 1e-9  # halved 80 %, doubled 100 %
"""Share of the whole area that each ball counts as, so that none is free."""

LARGEST = 0.5  # halved 0 %, doubled 0 %
"""No merged ball is larger, in diagonals."""


def planes_of(
    samples: Samples,
    balls: FloatArray,
    owner: Index,
    roof: Roof | None = None,
    touched: Planes | None = None,
    hold: float = HOLD,
) -> FloatArray:
    """Return the quadric of each ball: the planes of the candidates that belong to it, (v, 15).

    Balls of a polyhedron also have its planes that they touch, and those on its edges and corners
    stay small: else they could slide along sheets, and small sheets may have no candidate at all.
    """
    from medialis.medial_meshes._collapse_kernels import add_places, add_planes

    require_rows(owner, len(balls), "samples of balls")
    quadrics = np.zeros((len(balls), 15))
    add_planes(samples.points, samples.normals, samples.areas, owner, quadrics)
    weights = np.bincount(owner, samples.areas, len(balls))
    weights += LEAST_WEIGHT * weights.sum()
    add_places(balls, (hold if roof is None else FLAT_HOLD) * weights, quadrics)
    if roof is not None:
        ball, plane = (x.copy() for x in np.nonzero(roof.touched(balls)))
        normals, feet = -roof.planes[plane, :3], -roof.planes[plane, 3:] * roof.planes[plane, :3]
        touched = Planes(ball, feet, normals)
    if touched is not None and len(touched.ball):
        ball, feet, normals = touched
        share = TOUCHED * float(weights.mean())
        add_planes(feet, normals, np.full(len(ball), share), ball, quadrics)
        rim = balls[:, 3] < RIM
        quadrics[rim, 9] += np.maximum(weights[rim], share)
    return quadrics


def hung(given: Index, count: int) -> Hung:
    """Return edges or triangles of some vertices on lists of their ends."""
    from medialis.medial_meshes._collapse_kernels import Hung, link_all

    require_rows(given, count, "edges and faces")
    rows = given.astype(np.int32)  # half as much memory is gone through in half the time
    heads, after, before = (np.empty(n, np.int32) for n in (count, rows.size, rows.size))
    result = Hung(rows, np.ones(len(rows), bool), heads, after, before)
    link_all(result)
    return result


def collapse(start: Complex, quadrics: FloatArray, target: int, *, whole: bool = False) -> Collapse:
    """Merge vertices, the cheapest pair first, until `target` are left or none may be merged.

    Sheets stay `whole`, if wanted, as long as they can.
    """
    from medialis.medial_meshes._collapse_kernels import Aim, Room, Steps
    from medialis.medial_meshes._collapse_kernels import collapse as run

    count = len(start)
    lists = [hung(given, count) for given in (start.edges, start.faces)]
    size = 2 * len(start.edges) + 1
    room = Room(np.empty(size), np.empty(size, np.int32), np.empty(size, np.int32))
    steps = Steps(np.empty(count, np.int64), np.empty(count, np.int64), np.empty((count, 4)))
    made = run(
        start.balls.copy(), quadrics.copy(), *lists, Aim(target, LARGEST, whole), room, steps
    )
    return Collapse(start, *Steps._make(values[:made].copy() for values in steps))


def coarser(samples: Samples, found: Complex, roof: Roof | None = None) -> Collapse:
    """Collapse a fitted complex further; each candidate pulls at the ball next to it."""
    envelope = Envelope.of(found)
    _, row, shares = envelope.distances(samples.points)
    nearest = envelope.rows[row, shares.argmax(axis=1)]
    return collapse(found, planes_of(samples, found.balls, nearest, roof), 1)


def evened(given: Complex, off: float) -> Complex:
    """Return a complex of as many balls, edges and triangles that are more even.

    Edges are flipped, balls move within a sheet, or along a rim or a seam; ends of these, and where
    they meet, stay: so do sheets, seams and junctions. Flipped edges are no farther than `off`
    diagonals from those before.
    """
    from medialis.medial_meshes._even_kernels import even, flip

    count = len(given)
    balls, edges, faces = given.balls.copy(), hung(given.edges, count), hung(given.faces, count)
    scratch = np.zeros((2, count), np.int64)
    for _ in range(EVEN_ROUNDS):
        for _ in range(FLIPS):
            if flip(balls, edges, faces, off) == 0:
                break
        if even(balls, edges, faces, off, scratch, MOVES) == 0:
            break
    rows = (np.sort(one.rows.astype(np.int64), axis=1) for one in (edges, faces))
    return Complex(balls, *rows)
