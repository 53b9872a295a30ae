"""Hollows: places on the boundary of an envelope that lie deep in the solid.

Where two slabs or cones meet, the envelope has a valley. No sample of the surface tells how deep it
is: from above the walls of the valley are nearer than its ground. So the ground is sought from
samples inwards, along the normal, and from points spread over the boundary of the envelope, which
also find what is covered by other parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from medialis.base.arrays import Index, kd_tree
from medialis.base.box_tree import NearestTree
from medialis.base.validation import FloatArray
from medialis.medial_meshes.distances import boundary_points
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fine_complex import FineComplex
from medialis.medial_meshes.fitting import Bounds, Watched
from medialis.medial_meshes.mesh import Complex
from medialis.medial_meshes.refining import Fault
from medialis.medial_meshes.sampling import Solid

HOLLOWS_LOOKED_AT = 40_000  # halved 27 %, doubled 27 %
"""Points of the envelope that are looked at by default, about."""

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
        places, _ = boundary_points(envelope, HOLLOWS_LOOKED_AT)
        far = self._walls.distances(places, enough=least)[0]
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

    @cached_property
    def _walls(self) -> NearestTree:
        """The faces of the solid."""
        faces = np.asarray(self.solid.faces[self.solid.walls], np.int32)
        return NearestTree.of_triangles(self.solid.points, faces)

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
        return places, normals[met], np.minimum(gone[met], self._walls.distances(places)[0])

    def faults(self, places: FloatArray) -> Fault:
        """Return faults at such places, each with the fine ball nearest to it."""
        points, balls = places[:, :3], self.fine.balls
        nearest = kd_tree(balls[:, :3]).query(points)[1]
        return Fault(points, self.surface.nearest(points)[0], balls[nearest], points)


def _worst(values: FloatArray, least: float) -> Index:
    """Return the largest values above a bound."""
    above = np.flatnonzero(values > least)
    return above[np.argsort(-values[above], kind="stable")[:MOST]]
