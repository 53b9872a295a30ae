"""Parts of a fitted mesh that its envelope does not need, taken away from its rims.

A triangle with a free side goes with that side, an edge with a free end with its ball, as long as
nothing that was taken away sticks out of what stays by more than a bound: the topology stays.
"""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np

from medialis.base.validation import FloatArray
from medialis.medial_meshes.distances import points_on
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.mesh import Complex

Part = tuple[int, ...]

ACROSS = 5
"""Points along the longest side of what is taken away, or its largest radius, about."""


def trimmed(given: Complex, bound: float) -> Complex:
    """Return a complex without the parts at its rims that change its envelope by at most `bound`.

    Balls that no other part needs go, too; the others keep their order.
    """
    rest = _Rest(given, bound)
    while sum(rest.without(side, part) for side, part in rest.free()):
        pass
    return rest.complex


def _sides(part: Part) -> list[Part]:
    return list(combinations(part, len(part) - 1)) if len(part) > 1 else []


class _Rest:
    """What stays of a complex, and points on what was taken away."""

    def __init__(self, given: Complex, bound: float) -> None:
        self.balls, self.bound, self.gone = given.balls, bound, np.empty((0, 3))
        self.parts: set[Part] = {(v,) for v in range(len(given))}
        for rows in (given.edges, given.faces):
            self.parts |= {tuple(row) for row in np.sort(rows, axis=1).tolist()}
        self.above = Counter(side for part in self.parts for side in _sides(part))
        self._refused: set[tuple[Part, Part]] = set()

    def free(self) -> list[tuple[Part, Part]]:
        """Return free sides with their triangles, free ends with their edges; small ones first."""
        found = [
            (side, part)
            for part in self.parts
            for side in _sides(part)
            if self._goes(side, part) and (side, part) not in self._refused
        ]
        return sorted(found, key=lambda pair: (self._length(pair[1]), pair))

    def without(self, side: Part, part: Part) -> bool:
        """Take a part and a free side of it away, where that changes little; tell whether."""
        if not self._goes(side, part):
            return False
        self._take(side, part, -1)
        tops = [one for one in self.parts if not self.above[one]]
        rest = Envelope(self.balls, np.array([(*one, -1, -1)[:3] for one in sorted(tops)]))
        points = self._points(part)
        out = rest.distances(points)[0]
        if out.max() <= self.bound and (rest.distances(self.gone)[0] <= self.bound).all():
            self.gone = np.concatenate([self.gone, points[out > -self.bound]])
            return True
        self._take(side, part, 1)
        self._refused.add((side, part))
        return False

    @property
    def complex(self) -> Complex:
        """What stays."""
        own = [sorted(one for one in self.parts if len(one) == size) for size in (1, 2, 3)]
        balls, edges, faces = (
            np.array(rows, np.int64).reshape(-1, size + 1) for size, rows in enumerate(own)
        )
        number = np.full(len(self.balls), -1)
        number[balls[:, 0]] = np.arange(len(balls))
        return Complex(self.balls[balls[:, 0]], number[edges], number[faces])

    def _goes(self, side: Part, part: Part) -> bool:
        """Tell whether a part is there, a side of no other, and one of its sides only its own."""
        return part in self.parts and not self.above[part] and self.above[side] == 1

    def _take(self, side: Part, part: Part, change: int) -> None:
        """Take two parts away, or put them back."""
        for one in (part, side):
            (self.parts.discard if change < 0 else self.parts.add)(one)
            for below in _sides(one):
                self.above[below] += change

    def _length(self, part: Part) -> float:
        """Return the longest side."""
        places = self.balls[list(part), :3]
        return float(np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1).max())

    def _points(self, part: Part) -> FloatArray:
        """Return points on the balls, cones and slab of a part."""
        rows = np.arange(len(part), dtype=np.int64)
        edges = np.array(list(combinations(rows, 2)), np.int64)
        faces = rows[None] if len(part) == 3 else np.empty((0, 3), np.int64)
        balls = self.balls[list(part)]
        step = max(self._length(part), float(balls[:, 3].max())) / ACROSS
        return points_on((balls, edges, faces), step)
