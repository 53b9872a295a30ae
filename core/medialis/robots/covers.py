"""Covers of one link by a number of balls or capsules that stick out of it as little as possible.

1. Candidates: medial balls of the link, or capsules between the centers of a few of them.
2. For each candidate and patch of the surface, the protrusion that it needs to hold the patch
   (`fill_needs`). A cover by k candidates is a choice of k columns of this matrix, and its
   protrusion the largest of the rows' least entries.
3. Cover k + 1 is cover k, with another candidate where the protrusion is largest, after some rounds
   of Lloyd's algorithm, and after moving candidates that are needed least to there.
4. Of the cover that is used, ends are moved to better places between those of the candidates.

A candidate may stick out only so far that what it belongs to keeps clear of other links: where its
radius is at most the mean of its depth and its distance from another link, all along its axis, and
the other link's obey the same, no two touch. (For centers a and b with depths d and e, and
distances D and E from the other link: |a - b| >= D + e and >= E + d, so twice |a - b| is at least
(D + d) + (E + e), twice the sum of the radii.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Described, Index
from medialis.base.threads import run_chunks
from medialis.base.validation import FloatArray, Positions
from medialis.robots.link_solids import LinkSolid, Patches

Clearance = Callable[[FloatArray], FloatArray]
"""Distance of points (q, 3) at diagonal 1 from the links that a link must not touch, (q,)."""

BALLS_JOINED = (2, 4, 6, 9, 13, 18, 24)
"""Capsules are tried between any two balls of the covers by so many balls,"""

JOINED_PER_CAPSULE = 2
"""up to so many for each capsule that a link gets on average; by 9 at least."""

ALONG = 7
"""Points of the axis of a capsule at which its depth is measured."""

LLOYD_ROUNDS = 8
"""Rounds of giving patches to candidates and choosing the best candidate for each lot."""

SPARED = 0.5
"""Fraction of the columns of a greedy cover that are tried to be left out, at most."""

BETTER = 1e-3
"""Relative decrease of the protrusion for which a candidate is moved elsewhere."""

MOVES = 40
"""Tries to move a candidate elsewhere, for each cover,"""

MOVED = 8
"""and candidates that are tried each time: those that hold the fewest patches."""

STEPS = (1.0, 0.5, 0.25)
"""Lengths by which ends are moved, in sides of a patch,"""

STEPS_EACH = 6
"""and how often by each: balls in a row pass room on from one to the next."""

PATCHES_A_CHUNK = 128

ROUNDING = 1e-12
"""Added to radii, in diagonals."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Balls and capsules that a link may be covered by, at diagonal 1.

    Attributes
    ----------
    axes : (m, 6) float64
        Both ends; the same twice for a ball.
    depths : (m,) float64
        Smallest depth of a point of the axis inside the link.
    limits : (m,) float64
        Largest protrusion that keeps clear of other links.
    """

    axes: FloatArray
    depths: FloatArray
    limits: FloatArray

    @classmethod
    def of_axes(cls, axes: FloatArray, solid: LinkSolid, clearance: Clearance | None) -> Candidates:
        """Measure depths and limits of axes (m, 6)."""
        same = bool((axes[:, :3] == axes[:, 3:]).all())
        share = np.array([0.5]) if same else np.linspace(0.0, 1.0, ALONG)
        points = axes[:, None, :3] + share[:, None] * (axes[:, 3:] - axes[:, :3])[:, None]
        depth = solid.depths(points.reshape(-1, 3)).reshape(-1, len(share))
        depths, limits = depth.min(axis=1), np.full(len(axes), np.inf)
        if clearance is not None:
            free = clearance(points.reshape(-1, 3)).reshape(depth.shape)
            limits = 0.5 * (free + depth).min(axis=1) - depths
        return cls(axes, depths, limits)

    def subset(self, rows: Index) -> Candidates:
        """Return the candidates of some rows."""
        return Candidates(self.axes[rows], self.depths[rows], self.limits[rows])


def ball_axes(solid: LinkSolid) -> FloatArray:
    """Return the axes of balls about the centers of medial balls, (m, 6)."""
    centers = solid.medial_balls[0]
    return np.concatenate([centers, centers], axis=1)


def capsule_axes(solid: LinkSolid, balls: LinkCovers, each: float) -> FloatArray:
    """Return the axes of capsules between the balls of some covers, and of all balls, (m, 6).

    `each` is the number of capsules that a link gets on average.
    """
    centers, most = solid.medial_balls[0], max(JOINED_PER_CAPSULE * each, BALLS_JOINED[3])
    joined = [balls.columns(count) for count in BALLS_JOINED if count <= most]
    ends = np.unique(np.concatenate(joined))
    first, second = np.triu_indices(len(ends), 1)
    pairs = np.concatenate([centers[ends[first]], centers[ends[second]]], axis=1)
    return np.concatenate([ball_axes(solid), pairs])


class Needs:
    """The protrusion that each candidate needs to hold each patch.

    Attributes
    ----------
    candidates : Candidates
    values : (n, m) float32
        Infinite beyond the limit of a candidate.
    """

    def __init__(self, candidates: Candidates, values: NDArray[np.float32]) -> None:
        self.candidates, self.values = candidates, values

    @classmethod
    def of(cls, patches: Patches, candidates: Candidates) -> Needs:
        """Measure the protrusions, without limits."""
        from medialis.robots._cover_kernels import fill_needs

        values = np.empty((len(patches), len(candidates.axes)), np.float32)
        given = *patches.distinct, candidates.axes, candidates.depths
        run_chunks(fill_needs, len(patches), PATCHES_A_CHUNK, *given, values)
        return cls(candidates, values)

    def within(self, limits: FloatArray) -> Needs:
        """Return the same where candidates may stick out by limits (m,) at most."""
        return Needs(
            self.candidates, np.where(self.values <= limits, self.values, np.float32(np.inf))
        )

    def fewest(self, most: int, limits: FloatArray) -> Index | None:
        """Return columns that hold all patches within limits (m,); None where `most` do not."""
        from medialis.robots._cover_kernels import choose_columns

        n, m = self.values.shape
        room = most + int(SPARED * most)
        columns, owners = np.empty(room, np.int64), np.empty(n, np.int64)
        scratch, small = np.empty(m, np.int64), limits.astype(np.float32)
        count = choose_columns(self.values, small, room, scratch, columns, owners)
        if count <= 0:
            return None
        columns = columns[:count]
        return columns if count <= most else self.within(limits)._thinned(columns, most)

    def _thinned(self, columns: Index, most: int) -> Index | None:
        """Leave columns out, those first that hold few patches; None where more are needed."""
        columns, owners, _ = self.improved(columns)
        while len(columns) > most:
            order = np.argsort(np.bincount(owners, minlength=len(columns)), kind="stable")
            for row in order:
                fewer, held, needed = self.improved(np.delete(columns, row))
                if np.isfinite(needed.max()):
                    columns, owners = fewer, held
                    break
            else:
                return None
        return columns

    def best(self) -> Index:
        """Return the column that needs least for all patches, (1,)."""
        return np.array([self.values.max(axis=0).argmin()])

    def improved(self, columns: Index) -> tuple[Index, Index, FloatArray]:
        """Return better columns (k,), the owner of each patch (n,), the protrusion of each (k,)."""
        from medialis.robots._cover_kernels import improve_columns

        columns = np.array(columns, np.int64)
        owners, needed = np.empty(len(self.values), np.int64), np.empty(len(columns), np.float32)
        largest = np.empty((len(columns), self.values.shape[1]), np.float32)
        improve_columns(self.values, LLOYD_ROUNDS, largest, columns, owners, needed)
        return columns, owners, np.asarray(needed, np.float64)

    def with_another(self, columns: Index) -> Index:
        """Return the columns and one more: the best for the patch that sticks out farthest."""
        worst = int(self.values[:, columns].min(axis=1).argmax())
        return np.append(columns, int(self.values[worst].argmin()))

    def searched(self, columns: Index) -> tuple[Index, float]:
        """Return columns, and their protrusion, after moving those that hold few patches."""
        best, owners, needed = self.improved(columns)
        tries, moving = 0, len(best) > 1
        while moving and tries < MOVES:
            moving = False
            fewest = np.argsort(np.bincount(owners, minlength=len(best)), kind="stable")
            for row in fewest[:MOVED]:
                tries += 1
                other = self.improved(self.with_another(np.delete(best, row)))
                if other[2].max() < needed.max() * (1.0 - BETTER):
                    best, owners, needed = other
                    moving = True
                    break
        return best, float(needed.max())


class LinkCovers:
    """Covers of a link by 1, 2, 3, ... candidates, each made when it is first asked for.

    Parameters
    ----------
    solid : LinkSolid
    needs : Needs
    first : (k,) int64
        Columns of the smallest cover.
    """

    def __init__(self, solid: LinkSolid, needs: Needs, first: Index) -> None:
        self.solid, self.needs = solid, needs
        self.fewest = len(first)
        self._latest, protrusion = needs.searched(first)
        self._covers = [(self._latest, protrusion)]

    def columns(self, count: int) -> Index:
        """Return the columns of the best cover by at most `count`."""
        return self._cover(count)[0]

    def protrusion(self, count: int) -> float:
        """Return how far a cover by `count` sticks out, at diagonal 1; not less for fewer."""
        return self._cover(count)[1]

    def _cover(self, count: int) -> tuple[Index, float]:
        while len(self._covers) <= count - self.fewest:
            # Where several parts stick out equally far, only the last one of them changes it.
            found = self.needs.searched(self.needs.with_another(self._latest))
            self._latest = found[0]
            self._covers.append(min(found, self._covers[-1], key=lambda cover: cover[1]))
        return self._covers[count - self.fewest]

    def factor(self, count: int) -> float:
        """Return the logarithm of how many times thicker a cover makes the link."""
        thin = max(self.solid.thickness, MIN_THICKNESS)
        return float(np.log1p(2.0 * self.protrusion(count) / thin))


MIN_THICKNESS = 1e-3
"""Diagonals: thinner links, such as sheets, count as this thick. It moves their factor up or down,
but hardly what another ball changes."""


@dataclass(frozen=True, eq=False)
class Cover:
    """Balls or capsules that hold a surface.

    Attributes
    ----------
    axes : (k, 6) float64
        Both ends of each, in the frame of the link and in metres; the same twice for a ball.
    radii : (k,) float64
    depths : (k,) float64
        Smallest depth of a point of each axis inside the link.
    """

    axes: FloatArray
    radii: FloatArray
    depths: FloatArray

    def __len__(self) -> int:
        return len(self.radii)

    def balanced(self) -> Cover:
        """Return the cover with radii smaller by half of what each sticks out.

        Points of the surface lie outside by as much, at most, as the boundary of the balls does.
        """
        radii = np.where(self.depths < self.radii, 0.5 * (self.radii + self.depths), self.radii)
        return Cover(self.axes, radii, self.depths)


@dataclass(frozen=True, eq=False, repr=False)
class CapsuleCover(Described):
    """Capsules in one of which each point of a surface lies.

    Attributes
    ----------
    starts, ends : (n, 3) float64
        Ends of the axes; the same for a ball.
    radii : (n,) float64
    excess : float
        Volume of the capsules outside of the solid, as a fraction of its volume; an estimate.
    """

    starts: Positions
    ends: Positions
    radii: FloatArray
    excess: float

    def __len__(self) -> int:
        return len(self.radii)


def refined(
    solid: LinkSolid, candidates: Candidates, clearance: Clearance | None, floor: float
) -> Cover:
    """Move the ends of candidates that cover a link to where they stick out least.

    They keep clear of other links, or stick out by no more than `floor` (diagonals) near them.
    """
    from medialis.robots._cover_kernels import fill_radii

    patches, k = solid.patches.halved(), len(candidates.axes)
    for length in STEPS:
        before = np.inf
        for _ in range(STEPS_EACH):
            axes = _moved(candidates.axes, length * solid.patches.side)
            columns = Candidates.of_axes(axes, solid, clearance)
            needs = Needs.of(patches, columns)
            if np.isfinite(columns.limits).any():
                needs = needs.within(np.maximum(columns.limits, floor))
            best, owners, needed = needs.improved(np.arange(k))
            candidates = columns.subset(best)
            if needed.max() > before * (1.0 - BETTER):
                break
            before = needed.max()
    radii = np.full(k, -1.0)
    fill_radii(patches.corners, owners[patches.owner_of_corners], candidates.axes, radii)
    used = radii >= 0.0
    axes = candidates.axes[used] * solid.scale + np.tile(solid.middle, 2)
    radii = (radii[used] + ROUNDING) * solid.scale
    return Cover(axes, radii, candidates.depths[used] * solid.scale)


def _moved(axes: FloatArray, length: float) -> FloatArray:
    """Return axes (k, 6), and the same with ends moved along x, y and z by a length."""
    unit = np.eye(3)
    both = np.concatenate([unit, unit], axis=1)
    moves = [both, -both]
    if not (axes[:, :3] == axes[:, 3:]).all():
        none = np.zeros((3, 3))
        first, second = np.concatenate([unit, none], axis=1), np.concatenate([none, unit], axis=1)
        moves += [first, -first, second, -second]
    rows = length * np.concatenate(moves)
    return np.concatenate([axes, (axes[None] + rows[:, None]).reshape(-1, 6)])


def axis_distances(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the distance of each point (q, 3) from its axis (q, 6)."""
    along = axes[:, 3:] - axes[:, :3]
    square = np.einsum("qi,qi->q", along, along)
    away = points - axes[:, :3]
    share = np.einsum("qi,qi->q", away, along) / np.where(square > 0.0, square, 1.0)
    return np.linalg.norm(away - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1)
