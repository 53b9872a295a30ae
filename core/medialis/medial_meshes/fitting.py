"""Balls fitted to a surface: the largest distance of surface and envelope made small.

Levenberg-Marquardt on all centers and radii. A sample of the surface gives the signed distance to
its nearest cone or slab; a place of the complex whose ball sticks out of the surface gives by how
much. Weights that grow with a power of the distance lead from least squares to the least maximum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.medial_meshes.boxes import Boxes
from medialis.medial_meshes.envelope import Envelope, primitives_of
from medialis.model.medial_mesh import Complex
from medialis.progress import Progress
from medialis.threads import run_chunks
from medialis.validation import FloatArray

Index = NDArray[np.int64]

SMALLEST_RADIUS = 1e-5

LISTED = 6
"""Primitives that a place keeps in its list."""

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

EVEN = 10.0
"""Share of the mean diagonal in the damping: balls that few samples tell about hold still."""

TRIES = 7
"""Of a step, each with more damping."""

SIDES = ((0, 1), (0, 2), (1, 2))


class Bounds:
    """Points of a surface, (c, 3), with normals: what balls must not stick out of."""

    def __init__(self, points: FloatArray, normals: FloatArray) -> None:
        self._given = points, normals

    @cached_property
    def boxes(self) -> Boxes:
        """The tree of the points."""
        return Boxes.over(self._given[0][:, None])

    @cached_property
    def points(self) -> FloatArray:
        """The points, in the order of their tree: what is near in space is near in memory."""
        return self._given[0][self.boxes.order]

    @cached_property
    def normals(self) -> FloatArray:
        """Their normals, in the same order."""
        return self._given[1][self.boxes.order]

    def overshoot(self, balls: FloatArray, known: Overshoot | None = None) -> Overshoot:
        """Return by how much balls (q, 4) stick out; `known` is what was found before they moved.

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

        run_chunks(work, count, PLACES_A_CHUNK)
        return found


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
        bounds: Bounds | None = None,
    ) -> None:
        self.points, self.normals, self.rows, self.within = points, normals, rows, within
        self.places = np.concatenate([points[rows], within[:, :3]])
        self.bounds = bounds or Bounds(points, normals)

    def looking_at(self, rows: Index, within: FloatArray) -> Target:
        """Return the same surface with other residuals."""
        return Target(self.points, self.normals, rows, within, self.bounds)

    def with_within(self, more: FloatArray) -> Target:
        """Return a target with more places inside."""
        return self.looking_at(self.rows, np.concatenate([self.within, more]))


class _Follower:
    """Distances of fixed places to an envelope whose balls move step by step."""

    def __init__(self, places: FloatArray) -> None:
        self.places = places
        self._near = np.full((len(places), LISTED), -1)
        self._values = np.full((len(places), LISTED), np.inf)
        self._others = np.tile([-np.inf, 0.0], (len(places), 1))
        self._before: list[FloatArray] = []

    def distances(self, envelope: Envelope) -> tuple[FloatArray, Index, FloatArray]:
        """As `Envelope.distances`."""
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

        run_chunks(work, count, PLACES_A_CHUNK)
        return distance, row, shares


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
        self._follower = _Follower(target.places)
        self.weight = 1.0 / len(target.rows)
        self.equations = _Equations(len(given), given.edges, self.rows)

    def between(self, balls: FloatArray) -> FloatArray:
        """Return the balls at all places of the lattice."""
        return np.asarray(np.einsum("lk,lkd->ld", self.lattice, balls[self._corners]))

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
        distance, row, shares = self._follower.distances(envelope)
        between = self.between(balls)
        inner = distance[len(self.target.rows) :]
        within = self.target.within
        inner[:] = within[:, 4] * np.maximum(inner + within[:, 3], 0.0)
        found = self.target.bounds.overshoot(between, self._known)
        self._known = found
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
        radius = self.between(balls)[now.over_at, 3]
        return np.asarray(now.over + radius < 0)


class _Equations:
    """Normal equations whose blocks belong to the vertices and edges of a complex."""

    def __init__(self, count: int, edges: Index, rows: Index) -> None:
        self.count = count
        self.row_edges = _edges_of(rows, edges, count)
        self.diagonal, self.blocks = np.zeros((count, 10)), np.zeros((len(edges), 10))
        self.gradient = np.zeros((count, 4))
        a, b = np.divmod(np.arange(16), 4)
        slot = np.zeros((4, 4), np.int64)
        slot[np.triu_indices(4)] = np.arange(10)
        self._slot = np.maximum(slot, slot.T).ravel()
        vertices = np.arange(count)
        i = np.concatenate([vertices, edges[:, 0], edges[:, 1]])
        j = np.concatenate([vertices, edges[:, 1], edges[:, 0]])
        row, column = (4 * i[:, None] + a).ravel(), (4 * j[:, None] + b).ravel()
        self._order = np.lexsort((row, column))
        self._row = row[self._order].astype(np.int32)
        starts = np.searchsorted(column[self._order], np.arange(4 * count + 1))
        self._starts = starts.astype(np.int32)
        self._diagonal_slots = np.array([0, 4, 7, 9])

    def cleared(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the sums, all zero."""
        for array in (self.diagonal, self.blocks, self.gradient):
            array[:] = 0.0
        return self.diagonal, self.blocks, self.gradient

    def solve(self, damping: float) -> FloatArray:
        """Return the step (n, 4) of the damped equations."""
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        damped = self.diagonal.copy()
        main = damped[:, self._diagonal_slots]
        damped[:, self._diagonal_slots] += damping * (main + EVEN * main.mean()) + 1e-6 * main.max()
        blocks = np.concatenate([damped, self.blocks, self.blocks])[:, self._slot]
        size = 4 * self.count
        matrix = csc_array(
            (blocks.ravel()[self._order], self._row, self._starts), shape=(size, size)
        )
        factors = splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip
        return np.asarray(factors.solve(self.gradient.ravel()).reshape(-1, 4))


def _edges_of(rows: Index, edges: Index, count: int) -> Index:
    """Return the edges (s, 3) between the vertices 01, 02, 12 of primitives; -1 for none."""
    keys = np.sort(edges, axis=1) @ [count, 1]
    order = np.argsort(keys, kind="stable")
    result = np.full((len(rows), 3), -1)
    for column, (a, b) in enumerate(SIDES):
        has = rows[:, b] >= 0
        pair = np.sort(rows[has][:, [a, b]], axis=1) @ [count, 1]
        result[has, column] = order[np.searchsorted(keys[order], pair)]
    return result


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
    keys = [np.take_along_axis(table, order, axis=1) for table in (corners, shares)]
    return np.unique(np.concatenate(keys, axis=1), axis=0, return_index=True)[1]


def _places_on(kinds: Index, steps: int) -> int:
    """Places of a lattice with this many steps along the sides of triangles."""
    each = np.array([0, 1, 2 * steps + 1, (steps + 1) * (steps + 2) // 2])
    return int(each[kinds].sum())
