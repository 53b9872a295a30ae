"""The balls between two walls, and what they tell of places of the thickness (thesis 3.5.1)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from medialis.fields.calipers import Caliper, PatchRoom, close_caliper
from medialis.fields.enclosure import TWICE, Enclosure
from medialis.fields.low_places import LowPlace, PlaceGraph, low_places
from medialis.fields.thickness import wall_balls
from medialis.model.medial_cloud import MedialCloud
from medialis.validation import FloatArray, IntArray

PROMINENCE = 0.25
"""Share of its value that one climbs from a minimum before it is a place of its own. Places at 0.1,
0.25, 0.5 and 1: hand 5, 5, 5, 4 (its five fingers), bunny 7, 6, 4, 3, scapula 23, 12, 11, 6."""

FEWEST, FEWEST_BELOW_SPACING = 6, 15
"""Samples of a place without a threshold: three on each side of a wall; where it is thinner than
the samples are apart, more than a sample and its six neighbours on each side. Fewer that are far
below all around them are a flaw of the mesh (folds on horse2 and spider have 1 to 11), unless they
are all of a component."""

FEWEST_CRUMPLED, THIN, CRUMPLED = 38, 2.0, math.cos(math.radians(120.0))
"""The same where a wall thinner than two spacings has faces that bend by more than 120 degrees: a
sample and its two rings of neighbours on each side (crumples on horse2 have 20 to 28)."""

FEWEST_BALLS, FEWEST_THICK_BALLS = 3, 2
"""Balls between two walls of a place without a threshold, and of one thicker than two spacings: one
alone, among samples whose values are those of others, is a flaw. In a noisy limb there are few."""

STARTS, APART = 6, 4.0
"""Balls of a place that its thinnest place is looked for from, and how many spacings they are
apart, at least: a long wall has several low places."""


class _EnclosedOnce:
    """How often a surface is wound round places, each of which is asked for again and again."""

    def __init__(self, enclosure: Enclosure) -> None:
        self._enclosure, self._known = enclosure, dict[bytes, float]()

    def times(self, place: FloatArray) -> float:
        """Return how often the surface is wound round a place (3,)."""
        key = place.tobytes()
        if key not in self._known:
            self._known[key] = float(self._enclosure.times(place[None])[0])
        return self._known[key]


class WallBalls:
    """The balls between two walls, and what they tell of places.

    Parameters
    ----------
    cloud : MedialCloud
    share : float
        Of a diameter, in the field that the places are those of: 1, or 1/2 for radii.
    with_threshold : bool
        Whether places are regions below a threshold: then specks are places, too.
    """

    def __init__(self, cloud: MedialCloud, *, share: float, with_threshold: bool) -> None:
        self.balls, self.surface = cloud.subset(wall_balls(cloud)), cloud.surface
        self.share, self.with_threshold = share, with_threshold
        self._enclosed = _EnclosedOnce(Enclosure(self.surface))
        self.marked = np.zeros(self.surface.point_count, np.bool_)

    @cached_property
    def _patches(self) -> PatchRoom:
        return PatchRoom(self.surface)

    @cached_property
    def _graph(self) -> PlaceGraph:
        return PlaceGraph(self.surface, self.balls.features)

    def leave_out(self, samples: NDArray[np.bool_]) -> bool:
        """Forget the balls of some samples; tell whether there were any."""
        gone = samples[self.balls.source]
        if not gone.any():
            return False
        self._graph.take_out(self.balls.features[gone])
        self.balls = self.balls.subset(~gone)
        return True

    def low_places(self, values: FloatArray, **how: float) -> Iterator[LowPlace]:
        """Go through the low places of a field; balls join the two sides of walls."""
        return low_places(self._graph, values, **how)

    def grown(self, samples: NDArray[np.bool_], rings: int) -> NDArray[np.bool_]:
        """Return some samples of a mesh with so many rings of neighbours, (n,)."""
        result, border = samples.copy(), np.flatnonzero(samples)
        for _ in range(rings):
            around = self._around(border)
            border = around[~result[around]]
            result[border] = True
        return result

    def _around(self, vertices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the vertices of the faces at some vertices, ascending."""
        surface = self.surface
        if surface.faces is None or len(vertices) == 0:
            return np.empty(0, np.int64)
        return np.unique(surface.faces[surface.fans.joined(vertices) // 3])

    def kind(self, place: LowPlace) -> Literal["wall", "overlap", "speck"]:
        """Tell what a place is: a speck has too few samples or balls, and is no whole component.

        The smallest ball of an overlap lies inside of two parts of a mesh.
        """
        surface, vertices = self.surface, place.vertices
        if surface.faces is None:
            return "wall"
        spacings = place.value / (self.share * surface.spacing)
        rows = self._rows_in(vertices)
        few = len(vertices) < (FEWEST_BELOW_SPACING if spacings < 1.0 else FEWEST)
        few |= len(rows) < (FEWEST_BALLS if spacings < THIN else FEWEST_THICK_BALLS)
        twice = len(rows) and self._enclosed.times(self.balls.centers[rows[0]]) >= TWICE
        if not few and not twice and spacings < THIN and len(vertices) < FEWEST_CRUMPLED:
            few = self._crumpled(vertices)
        if few and not self.with_threshold:
            mine = np.unique(surface.components[vertices])
            if len(vertices) < np.bincount(surface.components)[mine].sum():
                return "speck"
        return "overlap" if twice else "wall"

    def _crumpled(self, vertices: IntArray) -> bool:
        """Tell whether faces at some samples bend back."""
        surface = self.surface
        faces = np.unique(surface.fans.joined(vertices) // 3)
        across, normals = surface.face_adjacency[faces], surface.face_normals
        bent = np.einsum("fa,fja->fj", normals[faces], normals[across]) < CRUMPLED
        return bool((bent & (across >= 0)).any())

    def touches(self, place: LowPlace, samples: NDArray[np.bool_]) -> bool:
        """Tell whether a place is next to some samples: it is the rest of their place."""
        return bool(samples[self._around(place.vertices.astype(np.int64))].any())

    def thinnest(self, place: LowPlace) -> tuple[FloatArray, FloatArray, float]:
        """Return both ends of the shortest line across the wall at a place, and the value there."""
        rows, surface = self._rows_in(place.vertices), self.surface
        own = rows[self.balls.source[rows] == place.vertex]
        nearest = (own if len(own) else rows)[:1]
        position, value = surface.points[place.vertex], place.value
        opposite = self.balls.contacts[nearest[0]] if len(nearest) else np.full(3, np.nan)
        if surface.faces is None:
            return position, opposite, value
        # What is much thinner is a speck, as in the field.
        least = 0.0 if self.with_threshold else value / (1.0 + PROMINENCE)
        for start in self._apart(rows[2.0 * self.share * self.balls.radii[rows] >= least]):
            caliper = close_caliper(self._patches, self._caliper(start))
            if caliper is not None and least <= self.share * caliper.length <= value:
                position, opposite = caliper.ends
                value = self.share * caliper.length
        return position, opposite, value

    def _rows_in(self, vertices: IntArray) -> NDArray[np.int64]:
        """Return the balls of some samples, by rising radius."""
        self.marked[vertices] = True
        rows = np.flatnonzero(self.marked[self.balls.source])
        self.marked[vertices] = False
        return rows[np.argsort(self.balls.radii[rows], kind="stable")]

    def _apart(self, rows: NDArray[np.int64]) -> Iterator[int]:
        """Go through the smallest of some balls, by rising radius, that are apart."""
        points, chosen = self.surface.points[self.balls.source[rows]], 0
        while len(rows) and chosen < STARTS:
            yield int(rows[0])
            chosen += 1
            far = np.linalg.norm(points - points[0], axis=1) > APART * self.surface.spacing
            rows, points = rows[far], points[far]

    def _caliper(self, row: int) -> Caliper:
        """Return the two contacts of a ball."""
        balls, fans = self.balls, self.surface.fans
        first, second = balls.features[row]
        face = balls.contact_faces[row]
        own, other = (fans[v].astype(np.int64) // 3 for v in (first, second))
        if face >= 0:
            other = np.array([face], np.int64)
        ends = np.stack([self.surface.points[first], balls.contacts[row]])
        diameter = 2.0 * float(balls.radii[row])
        return Caliper(ends, (np.unique(own), np.unique(other)), diameter)
