"""The search for the balls of a medial mesh: fits, with balls put to where they are needed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from medialis.medial_meshes.collapse import collapse, planes_of
from medialis.medial_meshes.distances import measure
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fine_complex import FineComplex
from medialis.medial_meshes.fitting import DAMPING, Bounds, Fit, Target
from medialis.medial_meshes.hollows import Hollows
from medialis.medial_meshes.refinement import APART, Fault, faults_of, refined
from medialis.medial_meshes.sampling import Samples
from medialis.medial_meshes.solid import Solid
from medialis.model.medial_mesh import Collapse, Complex
from medialis.progress import Progress
from medialis.threads import run_together
from medialis.validation import FloatArray

Index = NDArray[np.int64]

RESIDUALS, MOST_RESIDUALS = 4000, 40_000
"""Samples that a fit looks at, and at most where there are many balls."""

A_BALL = 3
"""Samples for each ball, where that is more."""

WITHIN = 1000
"""Centers of fine balls that the envelope must hold."""

STRICT = 5.0
"""Factor of their distance: they may be far inside."""

EARLY = 0.5
"""Share of the samples that the first fits look at."""

MANY = 600
"""More balls than this are not refined, and fitted with few steps: they are near already."""

START = 0.8
"""Share of the balls that the collapse leaves; the rest is added where the fit is worst."""

ROUNDS, AGAIN = 3, 2
"""In which the rest is added: at first, and when balls are moved."""

SHARES = ((0.15, 0.08), (0.2, 0.05), (0.12, 0.25), (0.03, 0.1))
"""Shares of the balls, of those that matter least: a pair is taken away at the same time, each from
the same mesh, and put where the fit is worst."""

MORE = 5
"""Pairs of shares that `best` tries after the first, one after the other."""

LAST = 3
"""How often the last fit is made, as long as it gets nearer."""

WORST = 600
"""Places beside the samples that join the fit in the end, where the error is large there."""

LOOKED_AT = 10_000
"""Points of an envelope that are looked at for hollows where balls are added, about."""

DEEP = 2.0
"""Hollows get balls of their own from this many errors at the samples on."""

PLANS = {
    "fast": ((2, 4), (4, 4), (9, 4)),
    "first": ((2, 6), (4, 6)),
    "round": ((4, 4), (9, 4)),
    "last": ((9, 8), (16, 8)),
    "many": ((2, 4), (6, 4)),
    "closed": ((6, 4),),
}
"""Powers and steps of the fits."""


@dataclass(frozen=True, eq=False)
class Base:
    """What all numbers of balls begin with, in diagonals."""

    solid: Solid
    fine: FineComplex
    sequence: Collapse
    bounds: Bounds

    @cached_property
    def own(self) -> FloatArray:
        """The ball of each candidate, (c, 4)."""
        return self.fine.balls[self.fine.pole]

    def error(self, found: Complex) -> float:
        """Return the two-sided distance of an envelope and the surface."""
        return measure(self.solid, Envelope.of(found)).largest

    @cached_property
    def hollows(self) -> Hollows:
        """What finds hollows."""
        return Hollows(self.fine, self.bounds)


@dataclass(frozen=True, eq=False)
class _Found:
    """Fitted balls, their error (hollows included), and what the next fit looks at."""

    mesh: Complex
    error: float
    target: Target
    damping: float


class Search:
    """The search for a number of balls; the seed chooses the samples."""

    def __init__(self, base: Base, balls: int, seed: int, progress: Progress) -> None:
        self.base, self.balls, self.progress, self._still = base, balls, progress, progress.still
        samples, rng = base.fine.samples, np.random.default_rng(seed)
        own = np.flatnonzero(samples.areas > 0)
        count = min(max(RESIDUALS, A_BALL * balls), MOST_RESIDUALS, len(own))
        rows = rng.permutation(own)[:count]
        within = base.fine.balls[rng.permutation(len(base.fine.balls))[:WITHIN]]
        count = len(within)
        within = np.column_stack([within[:, :3], np.zeros(count), np.full(count, STRICT)])
        self._all = Target(samples.points, samples.normals, np.sort(rows), within, base.bounds)
        few = np.sort(rows[: int(EARLY * len(rows))])
        self._early = self._all.looking_at(few, within[: int(EARLY * WITHIN)])

    @cached_property
    def _everywhere(self) -> tuple[FloatArray, FloatArray]:
        """All candidates and the vertices, with normals."""
        target, solid = self._all, self.base.solid
        points = np.concatenate([target.points, solid.points[solid.corners]])
        return points, np.concatenate([target.normals, solid.vertex_normals[solid.corners]])

    def run(self, quality: str) -> Complex:
        """Return the mesh of the quality wanted."""
        start, _ = self.base.sequence.level(self.balls)
        if len(start) > MANY:
            return self._closed(self._measured(start, self._all, "many"))
        if quality == "fast":
            return self._fitted(start, self._all, "fast").mesh
        start, _ = self.base.sequence.level(int(START * self.balls))
        now = self._grown(self._fitted(start, self._early, "first"), ROUNDS).mesh
        best = self._measured(now, self._with_worst(now, self._all.within), "round")
        steps = 3 + (MORE if quality == "best" else 0)
        self.progress.update(1 / steps)
        best = self._swapped(best, SHARES[0])
        self.progress.update(2 / steps)
        found = self._last(best)
        if quality == "best":
            for k in range(MORE):
                self.progress.update((3 + k) / steps)
                best = self._swapped(best, SHARES[(k + 1) % len(SHARES)])
            found = min(found, self._last(best), key=self.base.error)
        return found

    def _fitted(self, start: Complex, target: Target, plan: str, damping: float = DAMPING) -> Fit:
        """Fit a complex by one of the plans."""
        return Fit(start, target, damping, self._still).run(PLANS[plan])

    def _measured(
        self,
        start: Complex,
        target: Target,
        plan: str,
        damping: float = DAMPING,
        most: float = np.inf,
    ) -> _Found:
        """Fit by a plan, and look for hollows: they join the target where they are deep.

        None are looked for where the error is `most` or more without any.
        """
        fit = self._fitted(start, target, plan, damping)
        off, depth = fit.now.off, 0.0
        if off < most:
            places, depth = self.base.hollows.of(fit.mesh, off)
        target = target.with_within(places) if depth > off else target
        return _Found(fit.mesh, max(off, depth), target, fit.damping)

    def _grown(self, fit: Fit, rounds: int) -> Fit:
        """Add the balls that are missing, round by round, where the fit is worst."""
        hollows = self.base.hollows
        for left in range(rounds, 0, -1):
            now, off = fit.mesh, fit.now.off
            places, depth = hollows.of(now, off, LOOKED_AT)
            faults = faults_of(fit, self.base.own)
            if depth > DEEP * off:
                faults = Fault.joined([faults, hollows.faults(places)])
            wanted, apart = len(now) + -(-(self.balls - len(now)) // left), APART
            while len(now) < wanted and apart > 1e-3:
                now = refined(now, faults, wanted - len(now), apart)
                apart /= 2
            fit = self._fitted(now, self._early.with_within(places), "round")
        return fit

    def _swapped(self, best: _Found, shares: tuple[float, float]) -> _Found:
        """Try two shares at the same time; return what is nearest."""
        works = (partial(self._with_moved, best, share) for share in shares)
        found = run_together(*works, progress=self._still)
        return min(best, *found, key=lambda one: one.error)

    def _with_moved(self, best: _Found, share: float) -> _Found:
        """Take balls away and put others where the fit is worst; return what is nearer."""
        removed = max(1, int(share * self.balls))
        fewer, _ = coarser(self.base.fine.samples, best.mesh).level(self.balls - removed)
        other = self._grown(self._fitted(fewer, self._early, "round"), min(AGAIN, removed))
        found = self._measured(other.mesh, best.target, "round", most=best.error)
        if found.error >= best.error:
            return best
        target = self._with_worst(found.mesh, found.target.within)
        return replace(found, target=target)

    def _last(self, best: _Found) -> Complex:
        """Fit until that gets no nearer; deep hollows join."""
        now = best
        for _ in range(LAST):
            now = self._measured(best.mesh, now.target, "last", now.damping, best.error)
            if now.error >= best.error:
                break
            best = now
        return best.mesh

    def _closed(self, found: _Found) -> Complex:
        """Fit once more where hollows are deep."""
        if len(found.target.within) == len(self._all.within):
            return found.mesh
        again = self._fitted(found.mesh, found.target, "closed")
        off = again.now.largest  # of the hollows found as well
        return again.mesh if off < found.error else found.mesh

    def _with_worst(self, now: Complex, within: FloatArray) -> Target:
        """Return a target that looks at the worst of all candidates and vertices as well."""
        target, (points, normals) = self._all, self._everywhere
        distance = np.abs(Envelope.of(now).distances(points)[0])
        distance[: len(target.points)][self.base.fine.samples.areas == 0] = 0.0  # mirrored ones
        worst = np.argsort(-distance, kind="stable")[:WORST]
        return Target(points, normals, np.union1d(target.rows, worst), within, target.bounds)


def coarser(samples: Samples, found: Complex) -> Collapse:
    """Collapse a fitted complex further; each candidate pulls at the ball next to it."""
    envelope = Envelope.of(found)
    _, row, shares = envelope.distances(samples.points)
    nearest = envelope.rows[row, shares.argmax(axis=1)]
    return collapse(found, planes_of(samples, found.balls, nearest), 1)
