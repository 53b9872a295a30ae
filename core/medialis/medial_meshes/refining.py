"""Balls added to a fitted complex where it is worst: on its primitives, so the topology stays.

`Fault` are places where a complex is wrong; `faults_of` tells those that a fit sees, `Hollows` in
hollows.py those that lie deep in the solid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import Index
from medialis.base.validation import FloatArray
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fitting import Fit
from medialis.medial_meshes.mesh import Complex

PART = 0.12  # halved 35 %, doubled 43 %
"""Share of a ball from which on a place belongs to it: else it lies on the others alone."""

APART = 0.04  # halved 44 %, doubled 98 %
"""Places that get new balls at the same time are at least this far apart, in diagonals."""

NEARLY_WORST = 0.6  # halved 100 %, doubled 100 %
"""Part of the largest error from which on a place gets a ball in the same round."""

TRIED = 100  # halved 0 %, doubled 0 %
"""Faults that are looked at for each ball to be added, at most: the worst."""

AT_ONCE, AT_ONCE_APART = 200, 0.02
"""The same, and how far apart their places are, where all are looked up together."""

NEAR_RADII, NEAR = 0.5, 0.02  # halved 0 %, doubled 49 %; halved 0 %, doubled 49 %
"""Parts of its radius, and diagonals, up to which the wanted ball may lie off its place."""


def subdivided(given: Complex, row: Index, shares: FloatArray, ball: FloatArray) -> Complex:
    """Put a ball on a primitive: on its triangle, on an edge, or as a leaf at one of its balls."""
    new = len(given)
    there = row >= 0
    corners = row[there][shares[there] > PART]
    edges, faces = given.edges, given.faces
    more_edges = [(int(v), new) for v in corners]
    more_faces: list[tuple[int, ...]] = []
    if len(corners) == 2:
        a, b = (int(v) for v in corners)
        edges = edges[~((edges == a).any(axis=1) & (edges == b).any(axis=1))]
        around = (faces == a).any(axis=1) & (faces == b).any(axis=1)
        for face in faces[around]:
            c = int(face.sum()) - a - b
            more_edges.append((c, new))
            more_faces += [(a, c, new), (b, c, new)]
        faces = faces[~around]
    elif len(corners) == 3:
        a, b, c = (int(v) for v in corners)
        faces = faces[~(faces == np.sort(corners)).all(axis=1)]
        more_faces = [(a, b, new), (b, c, new), (a, c, new)]
    return Complex(
        np.vstack([given.balls, ball]),
        np.concatenate([edges, np.array(more_edges, np.int64).reshape(-1, 2)]),
        np.sort(np.concatenate([faces, np.array(more_faces, np.int64).reshape(-1, 3)]), axis=1),
    )


@dataclass(frozen=True, eq=False)
class Fault:
    """Places where a fitted complex is wrong, and the balls that would be right there.

    Attributes
    ----------
    places : (q, 3) float64
    errors : (q,) float64
    balls : (q, 4) float64
    feet : (q, 3) float64
        Where in the complex the ball belongs: near the primitive next to this place.
    """

    places: FloatArray
    errors: FloatArray
    balls: FloatArray
    feet: FloatArray

    @classmethod
    def joined(cls, faults: list[Fault]) -> Fault:
        """Put several together."""
        names = ("places", "errors", "balls", "feet")
        return cls(*(np.concatenate([getattr(one, name) for one in faults]) for name in names))


def faults_of(fit: Fit, fine: FloatArray) -> Fault:
    """Return samples off the envelope, and places of the complex whose balls stick out.

    `fine` (c, 4) are the balls of the points of the surface, the first ones of the target.
    """
    now, known = fit.now, fit.target.rows < len(fine)
    rows = fit.target.rows[known]
    places = fit.target.points[rows]
    off = Fault(places, np.abs(now.distance[: len(known)])[known], fine[rows], places)
    between = fit.between(fit.balls, now.over_at)
    shrunk = between.copy()
    shrunk[:, 3] = np.maximum(between[:, 3] + now.over, 0.0)
    out = Fault(fit.target.bounds.points[now.near], -now.over, shrunk, between[:, :3])
    return Fault.joined([off, out])


def refined(
    given: Complex, faults: Fault, most: int, apart: float = APART, share: float = NEARLY_WORST
) -> Complex:
    """Add at most this many balls to a complex, for faults of some share of the worst."""
    order = np.argsort(-faults.errors, kind="stable")[: TRIED * most]
    done: list[FloatArray] = []
    result = given
    for i in order:
        if len(done) == most or faults.errors[i] < share * faults.errors[order[0]]:
            break
        place = faults.places[i]
        if any(((place - other) ** 2).sum() < apart**2 for other in done):
            continue
        envelope = Envelope.of(result)
        _, nearest, (shares,) = envelope.distances(faults.feet[i][None])
        row = envelope.rows[nearest[0]]
        result = subdivided(result, row, shares, _new_ball(result, row, shares, faults.balls[i]))
        done.append(place)
    return result


def refined_at_once(given: Complex, faults: Fault, most: int) -> Complex:
    """Add at most this many balls, worst faults first, each where no other one is near.

    So all places can be looked up together: what is nearest to them does not change.
    """
    order = np.argsort(-faults.errors, kind="stable")[: AT_ONCE * most]
    envelope = Envelope.of(given)
    _, nearest, shares = envelope.distances(faults.feet[order])
    done: list[FloatArray] = []
    result, touched = given, np.zeros(len(given) + 1, bool)
    for k, i in enumerate(order):
        row = envelope.rows[nearest[k]]
        if len(result) == len(given) + most:
            break
        place = faults.places[i]
        near = any(((place - other) ** 2).sum() < AT_ONCE_APART**2 for other in done)
        if near or touched[row].any():
            continue
        done.append(place)
        ball = _new_ball(result, row, shares[k], faults.balls[i], 0.0)
        result = subdivided(result, row, shares[k], ball)
        touched[row[row >= 0]] = True
    return result


def _new_ball(
    given: Complex, row: Index, shares: FloatArray, wanted: FloatArray, near: float = NEAR
) -> FloatArray:
    """Return the wanted ball where it is near its place in the complex, else the one there."""
    row, shares = row[row >= 0], shares[row >= 0]
    here = shares @ given.balls[row]
    close = np.linalg.norm(wanted[:3] - here[:3]) < NEAR_RADII * here[3] + near
    return wanted if close or (shares > PART).sum() == 1 else here
