"""Gaps: the room between walls that face each other, by balls outside of the shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.fields.enclosure import ENCLOSED, Enclosure
from medialis.fields.low_places import PlaceGraph, low_places
from medialis.fields.tapers import edge_balls
from medialis.kept import Described
from medialis.model.medial_cloud import MedialCloud
from medialis.validation import FloatArray, IntArray


@dataclass(frozen=True, eq=False, repr=False)
class Gap(Described):
    """A connected region of surface across from other surface that is too near.

    Attributes
    ----------
    position, opposite : (3,) float64
        Both ends at its narrowest sample.
    value : float
        How wide it is there.
    vertices : (v,) int32
        Samples on both sides, ascending.
    widths : (v,) float64
        Before each of them.
    """

    position: FloatArray
    opposite: FloatArray
    value: float
    vertices: IntArray
    widths: FloatArray


def gap_widths(cloud: MedialCloud, least_angle: float) -> tuple[FloatArray, IntArray]:
    """Return how wide the gap before each sample is, inf for none, and its ball, -1 for none.

    Outer balls count whose two contacts face each other: seen from the center at least
    `least_angle` (radians) apart, and with normals as far apart. Those of concave edges do not.
    """
    n = cloud.surface.point_count
    widths, balls = np.full(n, np.inf), np.full(n, -1, np.int32)
    chosen = cloud.valid & (cloud.side < 0) & (cloud.wall_angles >= least_angle)
    rows = np.flatnonzero(chosen & ~edge_balls(cloud))
    widths[cloud.source[rows]] = 2.0 * cloud.radii[rows]
    balls[cloud.source[rows]] = rows
    return widths, balls


def narrow_gaps(cloud: MedialCloud, least: float, least_angle: float) -> list[Gap]:
    """Return the connected regions where a gap is narrower than a length, the narrowest first.

    Inside of another part an outer ball spans no gap: parts that overlap have none there.
    """
    widths, balls = gap_widths(cloud, least_angle)
    widths = np.where(widths < least, widths, np.inf)
    used = balls[np.isfinite(widths)]
    if len(used) == 0:
        return []
    graph = PlaceGraph(cloud.surface, cloud.features[used])
    enclosure = Enclosure(cloud.surface)
    found = []
    for place in low_places(graph, widths, level=least):
        row = int(balls[place.vertex])
        if enclosure.times(cloud.centers[row][None])[0] >= ENCLOSED:
            continue
        ends = cloud.surface.points[place.vertex], cloud.contacts[row]
        found.append(Gap(*ends, place.value, place.vertices, widths[place.vertices]))
    return found
