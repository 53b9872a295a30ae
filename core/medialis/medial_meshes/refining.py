"""Balls added to a fitted complex where it is worst: on its primitives, so the topology stays.

`Fault` are places where a complex is wrong; `faults_of` tells those that a fit sees, `Hollows`
places on the boundary of the envelope that lie deep in the solid, or stick out.

Where two slabs or cones meet, the envelope has a valley. No sample of the surface tells how deep it
is: from above the walls of the valley are nearer than its ground. So the ground is sought from
samples inwards, along the normal, and from points spread over the boundary of the envelope, which
also find what is covered by other parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from medialis.base.arrays import Index
from medialis.base.validation import FloatArray
from medialis.medial_meshes.distances import boundary_points
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fine_complex import FineComplex
from medialis.medial_meshes.fitting import Bounds, Fit, Watched
from medialis.medial_meshes.mesh import Complex
from medialis.medial_meshes.sampling import Solid

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

HOLLOWS_LOOKED_AT = 40_000  # halved 27 %, doubled 27 %
"""Points of the envelope that are looked at by default, about."""

FOR_EACH_BALL = 60
"""More of them for each ball, where one looks closely: each ball, cone and slab has its fewest, and
with no others long ones are seen at their ends and in the middle."""

MOST = 600  # halved 0 %, doubled 0 %
"""Places that join a fit, at most: the deepest."""

SHALLOW = 0.3  # halved 33 %, doubled 26 %
"""Places of less than this part of the largest depth do not join."""

FROM = 0.9  # halved 34 %, doubled 51 %
"""Places join from this part of the error at the samples on."""

LEAST, MOST_HELD = 0.1, 0.5  # halved 36 %, doubled 42 %; halved 85 %, doubled 43 %
"""How deep the envelope has to hold a place, as parts of its depth."""

CLOSE = 0.7
"""The same where one looks closely."""

FROM_ABOVE, FARTHEST = 0.5, 6.0
"""Parts of that error: samples farther from the envelope are those from which the ground of valleys
is sought, so far down."""

STEPS, MET = 12, 0.02
"""Of the way down, at most; in parts of that error how near it ends."""

BACK, LEAST_LEAN = 0.1, 0.2
"""Part of the depth over which the walls of a valley are looked at; and how little they lean."""


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
    out = Fault(now.places, -now.over, shrunk, between[:, :3])
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


class Found(NamedTuple):
    """What a close look finds.

    Attributes
    ----------
    within : (i, 5) float64
        Grounds of valleys, as a `Target` takes them.
    watched : Watched
        Places of the complex that stick out.
    largest : float
        How deep, or far out, the worst is.
    """

    within: FloatArray
    watched: Watched
    largest: float


@dataclass(frozen=True)
class Hollows:
    """What finds the hollows of envelopes in a solid, which its fine complex tells."""

    solid: Solid
    fine: FineComplex
    surface: Bounds

    def of(
        self, given: Complex, off: float, points: int = HOLLOWS_LOOKED_AT
    ) -> tuple[FloatArray, float]:
        """Return places (i, 5) as a `Target` takes them, and the largest depth.

        An envelope that is nowhere farther than `off` from the surface holds a place by its depth
        less `off`. What is missing counts as the depth where the envelope ends at the place: that
        is the error then. The largest depth is told whether or not places join.
        """
        places, _ = boundary_points(Envelope.of(given), points)
        _, near = self.surface.nearest(places)
        samples = self.fine.samples
        way = samples.points[near] - places
        depth = np.maximum(np.einsum("ij,ij->i", way, samples.normals[near]), 0.0)
        deepest = float(depth.max(initial=0.0))
        worst = _worst(depth, max(SHALLOW * deepest, FROM * off))
        places, depth = places[worst], depth[worst]
        held = np.clip(depth - off, LEAST * depth, MOST_HELD * depth)
        return np.column_stack([places, held, depth / held]), deepest

    def look(self, given: Complex, off: float, outside: FloatArray) -> Found:
        """Look closely at an envelope that is off by so much at samples.

        `outside` (c,) are the signed distances of candidates to it. As the envelope grows by d at
        the ground of a valley, that gets less deep by d / lean, where its walls lean so much.
        """
        envelope, least = Envelope.of(given), CLOSE * off
        wanted = HOLLOWS_LOOKED_AT + FOR_EACH_BALL * len(given)
        places, _ = boundary_points(envelope, wanted)
        far = self.solid.wall_tree.distances(places, enough=least)[0]
        places, far = places[far > least], far[far > least]
        inside = self.solid.contains(places)
        out = np.flatnonzero(~inside)
        out = out[_worst(far[out], least)]
        _, row, shares = envelope.distances(places[out])
        above, ways, deep = self._from_above(envelope, outside, off)
        way = self.fine.samples.points[self.surface.nearest(places[inside])[1]] - places[inside]
        way /= np.linalg.norm(way, axis=1)[:, None] + 1e-12
        places, ways = np.concatenate([places[inside], above]), np.concatenate([way, ways])
        depth = np.concatenate([far[inside], deep])
        largest = max(float(far.max(initial=0.0)), float(deep.max(initial=0.0)))
        worst = _worst(depth, least)
        places, ways, depth = places[worst], ways[worst], depth[worst]
        step = BACK * depth
        lean = envelope.distances(places + step[:, None] * ways)[0] / step
        lean = np.clip(lean, LEAST_LEAN, 1.0)
        within = np.column_stack([places, depth * lean, 1.0 / lean])
        return Found(within, (row, shares), largest)

    def _from_above(
        self, envelope: Envelope, outside: FloatArray, off: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return where ways from candidates inwards meet the envelope, and how deep that is.

        A way ends in the middle of the candidate's ball: from there on other ones are nearer.
        """
        samples = self.fine.samples
        above = np.flatnonzero(outside > FROM_ABOVE * off)
        points, normals = samples.points[above], samples.normals[above]
        most = np.minimum(self.fine.balls[self.fine.pole[above], 3], FARTHEST * off)
        gone, left = outside[above].copy(), outside[above].copy()
        going = np.flatnonzero(gone < most)
        for _ in range(STEPS):
            places = points[going] - gone[going, None] * normals[going]
            left[going] = np.maximum(envelope.distances(places)[0], 0.0)
            gone[going] += left[going]
            going = going[(left[going] > 0.05 * MET * off) & (gone[going] < most[going])]
            if len(going) == 0:
                break
        met = np.flatnonzero((left < MET * off) & (gone < most) & (gone > CLOSE * off))
        places = points[met] - gone[met, None] * normals[met]
        away = self.solid.wall_tree.distances(places)[0]
        return places, normals[met], np.minimum(gone[met], away)

    def faults(self, places: FloatArray) -> Fault:
        """Return faults at such places, each with the fine ball nearest to it."""
        points = places[:, :3]
        return Fault(points, self.surface.nearest(points)[0], self.fine.nearest(points), points)


def _worst(values: FloatArray, least: float) -> Index:
    """Return the largest values above a bound."""
    above = np.flatnonzero(values > least)
    return above[np.argsort(-values[above], kind="stable")[:MOST]]
