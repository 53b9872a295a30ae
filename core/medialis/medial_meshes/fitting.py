"""Balls fitted to a surface: the largest distance of surface and envelope made small.

Levenberg-Marquardt on all centers and radii. A sample of the surface gives the signed distance to
its nearest cone or slab; a place of the complex whose ball sticks out of the surface gives by how
much. Weights that grow with a power of the distance lead from least squares to the least maximum.

`Fit` is one fit, `Target` what it looks at, `Bounds` the surface that balls must not stick out of,
and `Equations` the normal equations, by the balls and edges of the complex, and their solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from medialis.base.arrays import Index, Mask
from medialis.base.progress import Progress
from medialis.base.threads import run_together
from medialis.base.validation import FloatArray, frozen
from medialis.medial_meshes.envelope import Envelope, box_tree, primitives_of
from medialis.medial_meshes.mesh import Complex

if TYPE_CHECKING:
    from medialis.medial_meshes._envelope_kernels import Nearest, Overshoot, Tree
    from medialis.medial_meshes._fit_kernels import Sums

Found = TypeVar("Found")

FARTHEST = 0.5
"""Diagonals from the middle of the shape: no ball inside of it lies farther away or is larger."""

SMALLEST_RADIUS = 1e-5

LISTED, MOST_LISTED = 6, 24  # halved 13 %, doubled 0 %; halved 0 %, doubled 0 %
"""Primitives that a place keeps in its list: of many balls more are near."""

BALLS_A_LISTED = 160  # halved 0 %, doubled 0 %
"""Balls for each of a list between these."""

PLACES_A_CHUNK = 512

BEYOND = 0.05  # halved 100 %, doubled 0 %
"""Balls with a center this far outside, in diagonals, are found however small they are."""

SPARSE, MARGIN = 0.02, 0.003  # halved 70 %, doubled 18 %; halved 0 %, doubled 0 %
"""Diagonals: no point of the surface is farther from others than half of the first; the list of
points of a ball reaches farther than the ball by the second."""

NEXT_TO = 0.005
"""Diagonals from the surface up to which it is looked up on which side a center is."""

LISTED_POINTS = 12  # halved 21 %, doubled 100 %
"""Points of the surface that a ball keeps in its list."""

LATTICE = 3000  # halved 84 %, doubled 57 %
"""Places of all primitives at which balls are looked at, about, before shared ones are one."""

FEWEST_STEPS, MOST_STEPS = 2, 16  # halved 0 %, doubled 42 %; halved 0 %, doubled 0 %
"""Steps of the lattice along the sides of triangles; edges have twice as many."""

DAMPING, LEAST_DAMPING = 1e-2, 1e-5  # halved 79 %, doubled 81 %; halved 0 %, doubled 0 %
"""Of the first step with a power, and of all, at least; relative to the equations' diagonal."""

LESS, MORE = 0.3, 6.0  # halved 87 %, doubled 88 %; halved 38 %, doubled 53 %
"""Factors of the damping where the first try lowers the sum, and where a try does not."""

SLOW = 1e-3  # halved 3 %, doubled 0.5 %
"""A step that lowers the sum by less than this share, times the power, gets nowhere: two end it."""

TRIES = 7  # halved 29 %, doubled 0 %
"""Of a step, each with more damping."""

EVEN = 10.0  # halved 81 %, doubled 88 %
"""Share of the mean diagonal in the damping: balls that few samples tell about hold still."""

FOR_LONG_ONES, FINER, SHORTEST = 1.5, 0.85, 1e-2
"""How many times the fewest there are where that is more, so that long ones have theirs; the
steps in which their spacing is sought, and its smallest part of the longest."""

WHOLE = 1_441_440
"""Of which each number of steps, and twice as many, is a divisor: equal shares are equal."""

SIDES = ((0, 1), (0, 2), (1, 2))

ON_DIAGONAL = (0, 4, 7, 9)
"""Where the diagonal is among the ten numbers of a symmetric block."""


class Equations:
    """Symmetric equations whose blocks belong to the vertices and edges of a complex.

    Which blocks of the factor there are, and the order of the vertices that makes them few, is the
    same for all values.

    Attributes
    ----------
    row_edges : (s, 3) int64
        The edges of each primitive, -1 for none.
    """

    def __init__(self, count: int, edges: Index, rows: Index) -> None:
        from medialis.medial_meshes._fit_kernels import Sums

        self.row_edges = _edges_of(rows, edges, count)
        self.sums = Sums(np.zeros((count, 10)), np.zeros((len(edges), 10)), np.zeros((count, 4)))
        self._place, self._starts, self._rows = _factor_of(count, edges)
        self._order = np.argsort(self._place)
        ends = np.sort(self._place[edges], axis=1)
        columns = np.repeat(np.arange(count), np.diff(self._starts))
        self._slots = np.searchsorted(columns * count + self._rows, ends @ [count, 1])

    def cleared(self) -> Sums:
        """Return the sums, all zero."""
        for array in self.sums:
            array[:] = 0.0
        return self.sums

    def solve(self, damping: float) -> FloatArray:
        """Return the step (n, 4) of the damped equations."""
        from medialis.medial_meshes._fit_kernels import solve

        damped, step = self.sums.diagonal[self._order], self.sums.gradient[self._order]
        main = damped[:, ON_DIAGONAL]
        damped[:, ON_DIAGONAL] += damping * (main + EVEN * main.mean()) + 1e-6 * main.max()
        factors = np.empty((len(self._rows), 4, 4))
        solve(damped, self.sums.blocks, self._slots, self._starts, self._rows, step, factors)
        return np.asarray(step[self._place])


def _factor_of(count: int, edges: Index) -> tuple[Index, Index, Index]:
    """Return the places of vertices in the factor, and its columns: where they start, their rows.

    Those are read off the factor of the Laplacian with a little on its diagonal, whose entries
    neither cancel nor get too small.
    """
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    vertices = np.arange(count)
    i, j = (np.concatenate([vertices, edges[:, k], edges[:, 1 - k]]) for k in (0, 1))
    degrees = np.bincount(edges.ravel(), minlength=count) + 1.0 / count
    values = np.concatenate([degrees, np.full(2 * len(edges), -1.0)])
    found = splu(
        csc_array((values, (i, j)), shape=(count, count)), permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0, options={"SymmetricMode": True},
    )  # fmt: skip
    lower = found.L
    lower.sort_indices()
    place, starts, rows = found.perm_c, lower.indptr, lower.indices
    return place.astype(np.int64), starts.astype(np.int64), rows.astype(np.int64)


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
    starts = ((one, begin) for one in lookups for begin in range(0, one.count, PLACES_A_CHUNK))
    run_together(*(partial(one.work, a, min(a + PLACES_A_CHUNK, one.count)) for one, a in starts))


class Bounds:
    """Points of a surface, (c, 3), with normals: what balls must not stick out of.

    They are in the order of their tree: what is near in space is near in memory. `contains`, where
    given, tells exactly which places are inside.
    """

    def __init__(
        self,
        points: FloatArray,
        normals: FloatArray,
        contains: Callable[[FloatArray], Mask] | None = None,
    ) -> None:
        from medialis.medial_meshes._envelope_kernels import SurfacePoints

        self._contains = contains
        self._order, bounds, depth = box_tree(points[:, None])
        self._place = np.argsort(self._order)
        self.points = frozen(points[self._order], np.float64)
        normals = frozen(normals[self._order], np.float64)
        self._surface = SurfacePoints(self.points, normals, bounds, depth)

    def nearest(self, places: FloatArray) -> tuple[FloatArray, Index]:
        """Return how far places (q, 3) are from the nearest point as given, and its row."""
        from medialis.medial_meshes._envelope_kernels import nearest_points

        near, far = np.empty((len(places), 1), np.int64), np.empty((len(places), 1))
        given = frozen(places, np.float64), self._surface, near, far
        look_up(Lookup(lambda begin, end: nearest_points(begin, end, *given), len(places), near))
        return far[:, 0], self._order[near[:, 0]]

    def out_of(
        self, balls: FloatArray, found: Overshoot, checked: Index
    ) -> tuple[Index, FloatArray, FloatArray]:
        """Return which balls stick out, by how much, and the places of the surface, (o, 3).

        Next to the surface the nearest point is beside the nearest place, and there, and at folds,
        its normal may be wrong on which side a center is. The place is in its plane, where that is
        on the right side, else it is the point. Of `checked` balls none is lost outside.
        """
        rows, near = np.flatnonzero(found.over < 0), found.near
        over, places = found.over[rows], self.points[near[rows]]
        if self._contains is None:
            return rows, over, places
        unsure = np.flatnonzero(over + balls[rows, 3] < NEXT_TO)
        lost = checked[found.over[checked] >= 0]
        looked_up = np.concatenate([rows[unsure], lost])
        inside = self._contains(balls[looked_up, :3])
        centers, normals = balls[rows[unsure], :3], self._surface.normals[near[rows[unsure]]]
        sign = np.where(inside[: len(unsure)], 1.0, -1.0)
        height = np.einsum("ij,ij->i", places[unsure] - centers, normals)
        plain = (height * sign > 0) & (np.abs(height) < NEXT_TO)
        far = np.abs(over[unsure] + balls[rows[unsure], 3])
        far = np.where(plain, height, sign * far)
        over[unsure] = np.minimum(far - balls[rows[unsure], 3], 0.0)
        places[unsure[plain]] = (centers + height[:, None] * normals)[plain]
        lost = lost[~inside[len(unsure) :]]
        far, near = self.nearest(balls[lost, :3])
        rows = np.concatenate([rows, lost])
        over = np.concatenate([over, -far - balls[lost, 3]])
        return rows, over, np.concatenate([places, self.points[self._place[near]]])

    def overshoot(self, balls: FloatArray, known: Overshoot | None = None) -> Lookup[Overshoot]:
        """Look up by how much balls (q, 4) stick out; `known` was found before they moved.

        A ball that has moved little since has its nearest point among those that were found then.
        """
        from medialis.medial_meshes._envelope_kernels import Overshoot, find_overshoot

        count = len(balls)
        if known is None:
            far, others = np.zeros((count, LISTED_POINTS)), np.full(count, -1.0)
            none = np.full(count, -1), np.full(far.shape, -1)
            found = Overshoot(np.zeros(count), *none, far, others, np.zeros((count, 3)))
        else:
            found = Overshoot._make(x.copy() for x in known)
        given = frozen(balls, np.float64), self._surface, BEYOND, SPARSE, MARGIN, found
        return Lookup(lambda begin, end: find_overshoot(begin, end, *given), count, found)


@dataclass(frozen=True, eq=False)
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

    points: FloatArray
    normals: FloatArray
    rows: Index
    within: FloatArray
    bounds: Bounds

    @cached_property
    def places(self) -> FloatArray:
        """Where the residuals are measured: at the rows, then inside."""
        return np.concatenate([self.points[self.rows], self.within[:, :3]])

    def with_within(self, more: FloatArray) -> Target:
        """Return a target with more places inside."""
        return replace(self, within=np.concatenate([self.within, more]))


Watched = tuple[Index, FloatArray]
"""Primitives, and the shares of their balls: places of a complex that are looked at, too."""


class Follower:
    """Distances of fixed places to an envelope whose balls move step by step."""

    def __init__(self, places: FloatArray, balls: int) -> None:
        from medialis.medial_meshes._envelope_kernels import Listed

        self.places = frozen(places, np.float64)
        self.listed = min(max(LISTED, balls // BALLS_A_LISTED), MOST_LISTED)
        shape = len(places), self.listed
        others = np.tile([-np.inf, 0.0], (len(places), 1))
        self._lists = Listed(np.full(shape, -1), np.full(shape, np.inf), others)
        self._before: list[FloatArray] = []

    def distances(self, envelope: Envelope) -> Lookup[Nearest]:
        """Look up what `Envelope.distances` gives."""
        from medialis.medial_meshes._envelope_kernels import Nearest, follow_primitives

        balls, count = envelope.balls, len(self.places)
        self._before.append(balls)
        change = np.stack(self._before) - balls
        movement = np.sqrt((change[..., :3] ** 2).sum(axis=2)) + np.abs(change[..., 3])
        found = Nearest(np.empty(count), np.empty(count, np.int64), np.empty((count, 3)))
        given = self.places, envelope.primitives, movement, self._lists, found
        return Lookup(lambda begin, end: follow_primitives(begin, end, *given), count, found)


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
    places: FloatArray
    """(o, 3) where the surface is nearest."""

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
        watched: Watched | None = None,
    ) -> None:
        self.complex, self.target, self.balls, self.damping = given, target, given.balls, damping
        self._progress = progress or Progress()
        self.rows = primitives_of(given)
        self.lattice_row, self.lattice = _lattice(self.rows, given.balls)
        if watched is not None:
            self.lattice_row, self.lattice = (
                np.concatenate(pair)
                for pair in zip((self.lattice_row, self.lattice), watched, strict=True)
            )
        self._centers = np.flatnonzero(self.lattice.max(axis=1) == 1.0)
        self._corners = np.where(self.rows < 0, 0, self.rows)[self.lattice_row]
        self._known: Overshoot | None = None
        self._tree: Tree | None = None
        self._follower = Follower(target.places, len(given))
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
        envelope = Envelope(balls, self.rows, self._tree)
        self._tree = envelope.tree
        near = self._follower.distances(envelope)
        between = self.between(balls)
        out_of = self.target.bounds.overshoot(between, self._known)
        look_up(near, out_of)
        distance, row, shares = near.result
        found = self._known = out_of.result
        inner = distance[len(self.target.rows) :]
        within = self.target.within
        inner[:] = within[:, 4] * np.maximum(inner + within[:, 3], 0.0)
        out, over, places = self.target.bounds.out_of(between, found, self._centers)
        samples = len(self.target.rows)
        return Residuals(samples, distance, row, shares, over, out, places)

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
            moved[:, 3] = np.clip(moved[:, 3], SMALLEST_RADIUS, FARTHEST)
            moved[:, :3] = np.clip(moved[:, :3], -FARTHEST, FARTHEST)
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
        """Return the weighted sum and the weights of the samples, and of what sticks out."""
        from medialis.medial_meshes._fit_kernels import weigh

        parts = []
        each = (found.distance, self.weight), (found.over, 1.0 / len(self.lattice))
        for distances, weight in each:
            weights = np.empty(len(distances))
            parts.append((weigh(distances, weight, power, scale, weights), weights))
        return parts

    def _linearized(self, balls: FloatArray, now: Residuals, power: float, scale: float) -> float:
        """Set up the equations; return the weighted sum."""
        from medialis.medial_meshes._fit_kernels import Points, add_rows

        (first, sample_weights), (second, over_weights) = self._weighed(now, power, scale)
        target, at = self.target, now.over_at
        sample_weights[len(target.rows) :] *= target.within[:, 4]  # also in the distance
        signs = np.ones(len(now.distance))
        samples = Points(target.places, signs, now.distance, now.row, now.shares, sample_weights)
        radii = self.between(balls, at)[:, 3]
        signs = np.where(now.over + radii < 0, -1.0, 1.0)  # the nearest sample is inside, or not
        out = Points(
            now.places, signs, now.over, self.lattice_row[at], self.lattice[at], over_weights
        )
        given = frozen(balls, np.float64), self.rows, self.equations.row_edges
        sums = self.equations.cleared()
        add_rows(samples, *given, sums)
        add_rows(out, *given, sums)
        return first + second


def _lattice(rows: Index, balls: FloatArray) -> tuple[Index, FloatArray]:
    """Return places on all primitives, about `LATTICE`: their rows and the shares of the balls.

    They are about evenly spread: long primitives have more than short ones, all have a few.
    """
    kinds = (rows >= 0).sum(axis=1)
    centers = balls[np.where(rows < 0, rows[:, :1], rows), :3]
    longest = np.sqrt(np.linalg.norm(centers - np.roll(centers, 1, axis=1), axis=2).max(axis=1))
    steps = np.full(len(rows), FEWEST_STEPS)
    most = max(LATTICE, FOR_LONG_ONES * _places_on(kinds, steps))
    whole = float(longest.max(initial=0.0))
    spacing = whole / FEWEST_STEPS
    while spacing > SHORTEST * whole:
        spacing *= FINER
        more = np.clip(np.ceil(longest / spacing), FEWEST_STEPS, MOST_STEPS).astype(np.int64)
        if _places_on(kinds, more) > most:
            break
        steps = more
    parts = []
    for kind, count in np.unique(np.stack([kinds, steps], axis=1), axis=0):
        if kind == 1:
            split = [(1, 0, 0)]
        elif kind == 2:
            split = [(2 * count - i, i, 0) for i in range(2 * count + 1)]
        else:
            split = [(i, j, count - i - j) for i in range(count + 1) for j in range(count + 1 - i)]
        which = np.flatnonzero((kinds == kind) & (steps == count))
        shares = np.array(split) * (WHOLE // sum(split[0]))
        parts.append((np.repeat(which, len(shares)), np.tile(shares, (len(which), 1))))
    row, shares = (np.concatenate(part) for part in zip(*parts, strict=True))
    first = _first_of_each(np.where(shares > 0, rows[row], -1), shares)
    row, shares = row[first], shares[first]
    return row, shares / shares.sum(axis=1, keepdims=True)


def _first_of_each(corners: Index, shares: Index) -> Index:
    """Return rows of a lattice without repetition: sides and balls belong to many primitives."""
    order = np.argsort(corners, axis=1, kind="stable")
    keys = np.zeros(len(corners), np.int64)
    _, ranks = np.unique(shares, return_inverse=True)
    shares = ranks.reshape(shares.shape)
    # The third share follows from the others.
    for table, columns in ((corners + 1, 3), (shares, 2)):
        size = int(table.max(initial=0)) + 1
        for column in np.take_along_axis(table, order[:, :columns], axis=1).T:
            keys = keys * size + column
    return np.unique(keys, return_index=True)[1]


def _places_on(kinds: Index, steps: Index) -> int:
    """Places of a lattice with so many steps along the sides of each triangle."""
    each = np.stack([0 * steps, 0 * steps + 1, 2 * steps + 1, (steps + 1) * (steps + 2) // 2])
    return int(each[kinds, np.arange(len(kinds))].sum())
