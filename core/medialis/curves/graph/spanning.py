"""A surface that a loop spans, and how often links cross it (thesis 3.6.3).

A closed path is linked with a loop as often as it crosses any surface with that border. This one is
a binary tree of triangles: from both ends of a piece of the loop to its middle, and so on for the
two halves. Most triangles are as small as the steps of the loop, and boxes round pieces
tell which of them are near a ball.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.curves.graph.ground import BallLinks
from medialis.kept import Described
from medialis.threads import run_chunks
from medialis.validation import FloatArray

BALLS_A_CHUNK = 4096

SLACK = 1e-9
"""Share of the largest coordinate by which boxes and planes are wider than they are: rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class SpanningSurface(Described):
    """Triangles whose border is a loop.

    Attributes
    ----------
    points : (l, 3) float64
        Those of the loop.
    corners : (l - 1, 3) int64
        Of each triangle, in the order of the loop; the first one has no area.
    children : (l - 1, 2) int64
        Triangles that lie at its first and second side, -1 for none.
    boxes : (l - 1, 6) float64
        Lowest and highest corner round a triangle and all below it.
    planes : (l - 1, 4) float64
        Unit normal and offset.
    """

    points: FloatArray
    corners: NDArray[np.int64]
    children: NDArray[np.int64]
    boxes: FloatArray
    planes: FloatArray

    @classmethod
    def of(cls, points: FloatArray) -> SpanningSurface:
        """Span a loop of points (l, 3), each given once."""
        from medialis.curves.graph._crossing_kernels import fill_boxes

        spans, children = _halved(len(points))
        corners = np.insert(spans, 1, spans.sum(axis=1) // 2, axis=1) % len(points)
        boxes, planes = np.empty((len(spans), 6)), np.empty((len(spans), 4))
        points = np.ascontiguousarray(points)
        fill_boxes(points, corners, children, boxes, planes)
        return cls(points, corners, children, boxes, planes)

    @property
    def bounds(self) -> FloatArray:
        """The lowest and the highest corner of its box, (2, 3)."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    def count_crossings(
        self, links: BallLinks, rows: NDArray[np.int64], reach: FloatArray, turns: NDArray[np.int64]
    ) -> None:
        """Count how often links cross the surface against its normals, into ``turns``.

        Parameters
        ----------
        links : BallLinks
            Only those between balls that overlap are followed.
        rows : (r,) int
            Balls.
        reach : (k,) float64
            Length of the longest such link of each ball.
        turns : (links,) int64
            Comes with 0.

        Notes
        -----
        Cost: rows times the triangles near each, of which there are some tens at most as a rule.
        """
        from medialis.curves.graph._crossing_kernels import cross_links

        slack = SLACK * float(np.abs(self.points).max(initial=0.0))

        def work(begin: int, end: int) -> None:
            cross_links(
                begin, end, rows, reach, links.centers, links.radii, links.offsets,
                links.neighbours, links.length, self.points, self.corners, self.children,
                self.boxes, self.planes, slack, turns,
            )  # fmt: skip

        run_chunks(work, len(rows), BALLS_A_CHUNK)


def _halved(count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last point of each piece of a loop of more than one step, and its two halves."""
    level = np.array([[0, count]], np.int64)
    spans, children, known = [], [], 0
    while len(level):
        middle = level.sum(axis=1) // 2
        halves = np.stack([level[:, 0], middle, middle, level[:, 1]], axis=1).reshape(-1, 2)
        whole = halves[:, 1] - halves[:, 0] > 1
        number = known + len(level) + np.cumsum(whole) - 1
        spans.append(level)
        children.append(np.where(whole, number, -1).reshape(-1, 2))
        known, level = known + len(level), halves[whole]
    return np.concatenate(spans), np.concatenate(children)
