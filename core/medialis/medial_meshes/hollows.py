"""Places within a solid that an envelope leaves out, which samples of the surface do not tell.

The boundary of the envelope is looked at: where a part of it lies deep in the solid, the balls
leave a hollow, however near the surface all samples are.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from medialis.medial_meshes.distances import boundary_points
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fine_complex import FineComplex
from medialis.medial_meshes.fitting import Bounds
from medialis.medial_meshes.refinement import Fault
from medialis.model.medial_mesh import Complex
from medialis.validation import FloatArray

LOOKED_AT = 40_000
"""Points of the envelope that are looked at by default, about."""

MOST = 600
"""Places that join a fit, at most: the deepest."""

SHALLOW = 0.3
"""Places of less than this part of the largest depth do not join."""

FROM = 0.9
"""Places join from this part of the error at the samples on."""

LEAST, MOST_HELD = 0.1, 0.5
"""How deep the envelope has to hold a place, as parts of its depth."""


class Hollows:
    """What finds the hollows of envelopes in a solid, which its fine complex tells."""

    def __init__(self, fine: FineComplex, surface: Bounds) -> None:
        self.samples, self.balls, self.surface = fine.samples, fine.balls, surface

    @cached_property
    def _centers(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.balls[:, :3])

    def of(self, given: Complex, off: float, points: int = LOOKED_AT) -> tuple[FloatArray, float]:
        """Return places (i, 5) as a `Target` takes them, and the largest depth.

        An envelope that is nowhere farther than `off` from the surface holds a place by its depth
        less `off`. What is missing counts as the depth where the envelope ends at the place: that
        is the error then. The largest depth is told whether or not places join.
        """
        places, _ = boundary_points(Envelope.of(given), points)
        _, near = self.surface.nearest(places)
        way = self.samples.points[near] - places
        depth = np.maximum(np.einsum("ij,ij->i", way, self.samples.normals[near]), 0.0)
        deepest = float(depth.max(initial=0.0))
        deep = np.flatnonzero(depth > max(SHALLOW * deepest, FROM * off))
        worst = deep[np.argsort(-depth[deep], kind="stable")[:MOST]]
        places, depth = places[worst], depth[worst]
        held = np.clip(depth - off, LEAST * depth, MOST_HELD * depth)
        return np.column_stack([places, held, depth / held]), deepest

    def faults(self, places: FloatArray) -> Fault:
        """Return faults at such places, each with the fine ball nearest to it."""
        points = places[:, :3]
        depth, _ = self.surface.nearest(points)
        return Fault(points, depth, self.balls[self._centers.query(points)[1]], points)
