"""New balls where a fitted complex is worst, by stellar subdivision, which keeps the topology."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fitting import Fit
from medialis.model.medial_mesh import Complex
from medialis.validation import FloatArray

Index = NDArray[np.int64]

PART = 0.12
"""Share of a ball from which on a place belongs to it: else it lies on the others alone."""

APART = 0.04
"""Places that get new balls at the same time are at least this far apart, in diagonals."""

NEARLY_WORST = 0.6
"""Part of the largest error from which on a place gets a ball in the same round."""


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

    `fine` (c, 4) are the balls of all points of the surface.
    """
    now, rows = fit.now, fit.target.rows
    places = fit.target.points[rows]
    off = Fault(places, np.abs(now.distance[: len(rows)]), fine[rows], places)
    between = fit.between(fit.balls, now.over_at)
    shrunk = between.copy()
    shrunk[:, 3] = np.maximum(between[:, 3] + now.over, 0.0)
    out = Fault(fit.target.bounds.points[now.near], -now.over, shrunk, between[:, :3])
    return Fault.joined([off, out])


def refined(given: Complex, faults: Fault, most: int, apart: float = APART) -> Complex:
    """Add at most this many balls to a complex, where the faults are worst."""
    order = np.argsort(-faults.errors, kind="stable")[: 100 * most]
    done: list[FloatArray] = []
    result = given
    for i in order:
        if len(done) == most or faults.errors[i] < NEARLY_WORST * faults.errors[order[0]]:
            break
        place = faults.places[i]
        if any(((place - other) ** 2).sum() < apart**2 for other in done):
            continue
        row, shares = _foot(result, faults.feet[i])
        result = subdivided(result, row, shares, _new_ball(result, row, shares, faults.balls[i]))
        done.append(place)
    return result


def _foot(given: Complex, place: FloatArray) -> tuple[Index, FloatArray]:
    """Return the primitive nearest to a place, and the shares of its balls there."""
    envelope = Envelope.of(given)
    _, row, shares = envelope.distances(place[None])
    return envelope.rows[row[0]], shares[0]


def _new_ball(given: Complex, row: Index, shares: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the wanted ball where it is near its place in the complex, else the one there."""
    there = row >= 0
    here = shares[there] @ given.balls[row[there]]
    near = np.linalg.norm(wanted[:3] - here[:3]) < 0.5 * here[3] + 0.02
    leaf = (shares[there] > PART).sum() == 1
    return wanted if near or leaf else here
