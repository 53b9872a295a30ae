"""Balls fitted to a surface: the largest distance of surface and envelope made small.

Levenberg-Marquardt on all centers and radii. A sample of the surface gives the signed distance to
its nearest cone or slab; a place of the complex whose ball sticks out of the surface gives by how
much. Weights that grow with a power of the distance lead from least squares to the least maximum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from medialis.medial_meshes.boxes import Boxes
from medialis.medial_meshes.envelope import Envelope, primitives_of
from medialis.medial_meshes.equations import Equations
from medialis.model.medial_mesh import Complex
from medialis.progress import Progress
from medialis.threads import run_together
from medialis.validation import FloatArray

Index = NDArray[np.int64]
Found = TypeVar("Found")

SMALLEST_RADIUS = 1e-5

LISTED, MOST_LISTED = 6, 24
"""Primitives that a place keeps in its list: of many balls more are near."""

BALLS_A_LISTED = 160
"""Balls for each of a list between these."""

PLACES_A_CHUNK = 512

BEYOND = 0.05
"""Balls with a center this far outside, in diagonals, are found however small they are."""

LIMITS = BEYOND, 0.02, 0.003
"""That, a length that no point of the surface is farther from others than half of, and how much
farther than a ball its list of points reaches; in diagonals."""

LISTED_POINTS = 12
"""Points of the surface that a ball keeps in its list."""

LATTICE = 3000
"""Places of all primitives at which balls are looked at, about, before shared ones are one."""

FEWEST_STEPS, MOST_STEPS = 2, 16
"""Steps of the lattice along the sides of triangles; edges have twice as many."""

DAMPING, LEAST_DAMPING = 1e-2, 1e-5
"""Of the first step with a power, and of all, at least; relative to the equations' diagonal."""

LESS, MORE = 0.3, 6.0
"""Factors of the damping where the first try lowers the sum, and where a try does not."""

SLOW = 1e-3
"""A step that lowers the sum by less than this share, times the power, gets nowhere: two end it."""

TRIES = 7
"""Of a step, each with more damping."""


@dataclass(frozen=True, eq=False)
class Lookup(Generic[Found]):
    """A search of many places that is still to be done; it fills its result."""

    work: Callable[[int, int], None]
    count: int
    result: Found

    def done(self) -> Found:
        """Return the result."""
        look_up(self)
        return self.result


def look_up(*lookups: Lookup[Any]) -> None:
    """Do some at the same time: a thread that is through with one goes on with the next."""
    run_together(
        *(
            partial(one.work, begin, min(begin + PLACES_A_CHUNK, one.count))
            for one in lookups
            for begin in range(0, one.count, PLACES_A_CHUNK)
        )
    )


class Bounds:
    """Points of a surface, (c, 3), with normals: what balls must not stick out of.

    They are in the order of their tree: what is near in space is near in memory.
    """

    def __init__(self, points: FloatArray, normals: FloatArray) -> None:
        self.boxes = Boxes.over(points[:, None])
        self.points, self.normals = points[self.boxes.order], normals[self.boxes.order]

    def nearest(self, places: FloatArray) -> tuple[FloatArray, Index]:
        """Return how far places (q, 3) are from the nearest point as given, and its row."""
        from medialis.medial_meshes._envelope_kernels import nearest_points

        boxes, shape = self.boxes, (len(places), 1)
        near, far = np.empty(shape, np.int64), np.empty(shape)

        def work(begin: int, end: int) -> None:
            nearest_points(begin, end, places, self.points, boxes.bounds, boxes.depth, near, far)

        look_up(Lookup(work, len(places), near))
        return far[:, 0], boxes.order[near[:, 0]]

    def overshoot(self, balls: FloatArray, known: Overshoot | None = None) -> Lookup[Overshoot]:
        """Look up by how much balls (q, 4) stick out; `known` was found before they moved.

        A ball that has moved little since has its nearest point among those that were found then.
        """
        from medialis.medial_meshes._envelope_kernels import find_overshoot

        boxes, count = self.boxes, len(balls)
        found = Overshoot.unknown(count) if known is None else known.copied()

        def work(begin: int, end: int) -> None:
            find_overshoot(
                begin, end, balls, self.points, self.normals, boxes.bounds, boxes.depth, LIMITS,
                found.over, found.near, found.lists, found.far, found.others, found.at,
            )  # fmt: skip

        return Lookup(work, count, found)


@dataclass(frozen=True, eq=False)
class Overshoot:
    """By how much balls stick out of a surface.

    Attributes
    ----------
    over : (q,) float64
        Depth of the center minus radius where that is negative, else 0.
    near : (q,) int64
        The nearest points of the surface, -1 for none.
    lists, far : (q, k) int64, float64
        The nearest points of centers `at` (q, 3), and their distances; all others are at least
        `others` (q,) from those.
    """

    over: FloatArray
    near: Index
    lists: Index
    far: FloatArray
    others: FloatArray
    at: FloatArray

    @classmethod
    def unknown(cls, count: int) -> Overshoot:
        """Return what is known of balls before any search."""
        near, lists = np.full(count, -1), np.full((count, LISTED_POINTS), -1)
        far, others = np.zeros(lists.shape), np.full(count, -1.0)
        return cls(np.zeros(count), near, lists, far, others, np.zeros((count, 3)))

    def copied(self) -> Overshoot:
        """Return a copy."""
        return Overshoot(*(x.copy() for x in vars(self).values()))


class Target:
    """The surface that balls are fitted to, as points with normals.

    Parameters
    ----------
    points, normals : (c, 3) float64
    rows : (m,) int64
        The points that give residuals.
    within : (i, 5) float64
        Places inside the solid, how deep they have to be in the envelope, and the factor of what is
        missing: a residual where they are not held, so that there are no hollows.
    bounds : Bounds
        The points that tell which balls stick out.
    """

    def __init__(
        self,
        points: FloatArray,
        normals: FloatArray,
        rows: Index,
        within: FloatArray,
        bounds: Bounds,
    ) -> None:
        self.points, self.normals, self.rows, self.within = points, normals, rows, within
        self.places = np.concatenate([points[rows], within[:, :3]])
        self.bounds = bounds

    def looking_at(self, rows: Index, within: FloatArray) -> Target:
        """Return the same surface with other residuals."""
        return Target(self.points, self.normals, rows, within, self.bounds)

    def with_within(self, more: FloatArray) -> Target:
        """Return a target with more places inside."""
        return self.looking_at(self.rows, np.concatenate([self.within, more]))


class _Follower:
    """Distances of fixed places to an envelope whose balls move step by step."""

    def __init__(self, places: FloatArray, balls: int) -> None:
        self.places = places
        self.listed = min(max(LISTED, balls // BALLS_A_LISTED), MOST_LISTED)
        shape = len(places), self.listed
        self._near, self._values = np.full(shape, -1), np.full(shape, np.inf)
        self._others = np.tile([-np.inf, 0.0], (len(places), 1))
        self._before: list[FloatArray] = []

    def distances(self, envelope: Envelope) -> Lookup[tuple[FloatArray, Index, FloatArray]]:
        """Look up what `Envelope.distances` gives."""
        from medialis.medial_meshes._envelope_kernels import follow_primitives

        balls, count, boxes = envelope.balls, len(self.places), envelope.boxes
        table = envelope.table
        self._before.append(balls)
        change = np.stack(self._before) - balls
        movement = np.sqrt((change[..., :3] ** 2).sum(axis=2)) + np.abs(change[..., 3])
        distance, shares, row = np.empty(count), np.empty((count, 3)), np.empty(count, np.int64)

        def work(begin: int, end: int) -> None:
            follow_primitives(
                begin, end, self.places, table, envelope.rows, boxes.order, boxes.bounds,
                boxes.depth, movement, self._near, self._values, self._others, distance, row,
                shares,
            )  # fmt: skip

        return Lookup(work, count, (distance, row, shares))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Distances at the samples, and at the places of the complex that stick out."""

    samples: int
    """The first distances, at samples of the surface; the others are at places within."""
    distance: FloatArray
    row: Index
    shares: FloatArray
    over: FloatArray
    """(o,) depth minus radius, negative."""
    over_at: Index
    """Rows of the lattice."""
    near: Index
    """Nearest points of the surface."""

    @property
    def largest(self) -> float:
        """The largest distance."""
        return float(max(np.abs(self.distance).max(), -self.over.min(initial=0.0)))

    @property
    def off(self) -> float:
        """The largest distance at samples and of what sticks out."""
        own = np.abs(self.distance[: self.samples])
        return float(max(own.max(), -self.over.min(initial=0.0)))


class Fit:
    """The fit of one complex; its balls change, its edges and faces stay.

    Attributes
    ----------
    balls : (n, 4) float64
        The best ones so far.
    damping : float
        Of the next step.
    """

    def __init__(
        self,
        given: Complex,
        target: Target,
        damping: float = DAMPING,
        progress: Progress | None = None,
    ) -> None:
        self.complex, self.target, self.balls, self.damping = given, target, given.balls, damping
        self._progress = progress or Progress()
        self.rows = primitives_of(given)
        self.lattice_row, self.lattice = _lattice(self.rows)
        self._corners = np.where(self.rows < 0, 0, self.rows)[self.lattice_row]
        self._known: Overshoot | None = None
        self._boxes: Boxes | None = None
        self._follower = _Follower(target.places, len(given))
        self.weight = 1.0 / len(target.rows)
        self.equations = Equations(len(given), given.edges, self.rows)

    def between(self, balls: FloatArray, which: Index | slice = slice(None)) -> FloatArray:
        """Return the balls at places of the lattice."""
        shares, corners = self.lattice[which], self._corners[which]
        return np.asarray(np.einsum("lk,lkd->ld", shares, balls[corners]))

    @property
    def mesh(self) -> Complex:
        """The complex with the best balls."""
        return Complex(self.balls, self.complex.edges, self.complex.faces)

    @cached_property
    def now(self) -> Residuals:
        """Their distances."""
        return self.residuals(self.balls)

    def residuals(self, balls: FloatArray) -> Residuals:
        """Measure the distances of balls."""
        envelope = Envelope(balls, self.rows, self._boxes)
        self._boxes = envelope.boxes
        near = self._follower.distances(envelope)
        out_of = self.target.bounds.overshoot(self.between(balls), self._known)
        look_up(near, out_of)
        distance, row, shares = near.result
        found = self._known = out_of.result
        inner = distance[len(self.target.rows) :]
        within = self.target.within
        inner[:] = within[:, 4] * np.maximum(inner + within[:, 3], 0.0)
        out = np.flatnonzero(found.over < 0)
        samples = len(self.target.rows)
        return Residuals(samples, distance, row, shares, found.over[out], out, found.near[out])

    def run(self, plan: tuple[tuple[float, int], ...]) -> Fit:
        """Fit with some (power, steps) after each other."""
        balls, now = self.balls, self.now
        for power, steps in plan:
            self.damping, slow = max(self.damping, DAMPING), 0
            for _ in range(steps):
                self._progress.update(0.0)
                moved = self._step(balls, now, power)
                if moved is None:
                    break
                balls, now, gain = moved
                if now.largest < self.now.largest:
                    self.balls, self.now = balls, now
                slow = slow + 1 if gain < SLOW * power else 0
                if slow == 2:
                    break
        return self

    def _step(
        self, balls: FloatArray, now: Residuals, power: float
    ) -> tuple[FloatArray, Residuals, float] | None:
        """Make one step that lowers the weighted sum, None where there is none."""
        scale = now.largest or 1e-9
        before = self._linearized(balls, now, power, scale)
        for attempt in range(TRIES):
            change = self.equations.solve(self.damping) / np.sqrt(power - 1.0)
            moved = balls + change
            moved[:, 3] = np.maximum(moved[:, 3], SMALLEST_RADIUS)
            found = self.residuals(moved)
            after = sum(part for part, _ in self._weighed(found, power, scale))
            if after < before:
                if attempt == 0:
                    self.damping = max(LESS * self.damping, LEAST_DAMPING)
                return moved, found, 1.0 - after / before
            self.damping *= MORE
        return None

    def _weighed(
        self, found: Residuals, power: float, scale: float
    ) -> list[tuple[float, FloatArray]]:
        from medialis.medial_meshes._fit_kernels import weigh

        parts = []
        each = (
            (found.distance, self.weight),
            (found.over, 1.0 / len(self.lattice)),
        )
        for distances, weight in each:
            weights = np.empty(len(distances))
            total = weigh(distances, np.full(len(distances), weight), power, scale, weights)
            parts.append((total, weights))
        return parts

    def _linearized(self, balls: FloatArray, now: Residuals, power: float, scale: float) -> float:
        """Set up the equations; return the weighted sum."""
        from medialis.medial_meshes._fit_kernels import add_rows

        (first, sample_weights), (second, over_weights) = self._weighed(now, power, scale)
        sums = self.equations.cleared()
        ones = np.ones(len(now.distance))
        sample_weights[len(self.target.rows) :] *= self.target.within[:, 4]  # also in the distance
        rows = self.rows, self.equations.row_edges
        add_rows(
            self.target.places, ones, balls, *rows, now.distance, now.row, now.shares,
            sample_weights, *sums,
        )  # fmt: skip
        deep = self.target.bounds.points[now.near]
        sign = np.ones(len(now.over))
        sign[self._outside(balls, now)] = -1.0
        add_rows(
            deep, sign, balls, *rows, now.over, self.lattice_row[now.over_at],
            self.lattice[now.over_at], over_weights, *sums,
        )  # fmt: skip
        return first + second

    def _outside(self, balls: FloatArray, now: Residuals) -> NDArray[np.bool_]:
        """Tell which places of the complex that stick out have their center outside."""
        radius = self.between(balls, now.over_at)[:, 3]
        return np.asarray(now.over + radius < 0)


def _lattice(rows: Index) -> tuple[Index, FloatArray]:
    """Return places on all primitives, about `LATTICE`: their rows and the shares of the balls."""
    kinds = (rows >= 0).sum(axis=1)
    steps = MOST_STEPS
    while steps > FEWEST_STEPS and _places_on(kinds, steps) > LATTICE:
        steps -= 1
    edge = [(2 * steps - i, i, 0) for i in range(2 * steps + 1)]
    face = [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]
    parts = []
    for kind, split in ((1, [(1, 0, 0)]), (2, edge), (3, face)):
        which, shares = np.flatnonzero(kinds == kind), np.array(split)
        parts.append((np.repeat(which, len(shares)), np.tile(shares, (len(which), 1))))
    row, shares = (np.concatenate(part) for part in zip(*parts, strict=True))
    first = _first_of_each(np.where(shares > 0, rows[row], -1), shares)
    row, shares = row[first], shares[first]
    return row, shares / shares.sum(axis=1, keepdims=True)


def _first_of_each(corners: Index, shares: Index) -> Index:
    """Return rows of a lattice without repetition: sides and balls belong to many primitives."""
    order = np.argsort(corners, axis=1, kind="stable")
    keys = np.zeros(len(corners), np.int64)
    for table in (corners + 1, shares):
        size = int(table.max(initial=0)) + 1
        for column in np.take_along_axis(table, order, axis=1).T:
            keys = keys * size + column
    return np.unique(keys, return_index=True)[1]


def _places_on(kinds: Index, steps: int) -> int:
    """Places of a lattice with this many steps along the sides of triangles."""
    each = np.array([0, 1, 2 * steps + 1, (steps + 1) * (steps + 2) // 2])
    return int(each[kinds].sum())
