"""The compact medial mesh of a shape: n balls with the topology of the solid and a small error.

A fine complex with the right topology is collapsed to a few balls, fitted to the surface, and
refined where it is worst; every step keeps the homotopy type.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from medialis.base.arrays import Index
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import AUTO, Options, algorithm, changed, choice, length, whole
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_together
from medialis.base.validation import FloatArray
from medialis.medial_meshes.collapsing import EVEN_HOLD, HOLD, coarser, collapse, evened, planes_of
from medialis.medial_meshes.distances import measure
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.fine_complex import FineComplex, fine_complex
from medialis.medial_meshes.fins import (
    Planes,
    creased,
    finless,
    is_round,
    on_reflex_edges,
    trimmed,
    useful,
)
from medialis.medial_meshes.fitting import DAMPING, Bounds, Fit, Follower, Target, Watched
from medialis.medial_meshes.mesh import Collapse, Complex, LateCollapse, MedialMesh
from medialis.medial_meshes.polyhedra.parting import (
    Structure,
    facets_to_part,
    structure_of,
)
from medialis.medial_meshes.refining import (
    APART,
    NEARLY_WORST,
    Fault,
    Hollows,
    faults_of,
    refined,
    refined_at_once,
)
from medialis.medial_meshes.roofs import Roof, complex_of, roof_of
from medialis.medial_meshes.roofs import planes_of as planes_of_faces
from medialis.medial_meshes.sampling import Solid, take_samples, without_holes
from medialis.shape.shape import Shape
from medialis.skeleton.surface_skeleton import Preparation, smooth_copy

UNCLEAR = 0.4
"""Diagonals: an envelope of an open mesh that is farther from it tells nothing of the shape; one
that closes half a sphere is 0.33 off."""

ENOUGH = 0.75
"""Share of the vertices of a polyhedron's structure from which on balls are placed on that: fewer
are better placed freely."""

LEAST_SHARE = 0.01
"""The same where balls are still missing in the end, at least."""

RESIDUALS, MOST_RESIDUALS = 4000, 40_000  # halved 100 %, doubled 94 %; halved 0 %, doubled 0 %
"""Samples that a fit looks at, and at most where there are many balls."""

A_BALL = 3  # halved 0 %, doubled 0 %
"""Samples for each ball, where that is more."""

WITHIN = 1000  # halved 83 %, doubled 100 %
"""Centers of fine balls that the envelope must hold."""

STRICT = 5.0  # halved 64 %, doubled 80 %
"""Factor of their distance: they may be far inside."""

EARLY = 0.5  # halved 83 %, doubled 88 %
"""Share of the samples that the first fits look at."""

KEPT_BACK = 0.02
"""Share of many balls that is added where the first fit is worst."""

MANY = 600
"""More balls than this have whole sheets with even triangles; with fewer balls, merging across
seams leaves smaller errors."""

SPREAD = 4000
"""So many balls are spread evenly on whole sheets; fewer of these lie where the surface needs them,
which an elk of 610 balls shows: evenly they are off by 0.72 %, so by 0.23."""

CLOSELY, MORE_KEPT_BACK = 2000, 0.15
"""Up to so many of them are looked at closely; the share that is added where that is worst. More
are fitted with few steps: they are near already."""

CLOSE_ROUNDS, AT_A_TIME = 5, 0.45
"""In so many rounds, with more than `MANY` balls in as many fewer; the share of what is left that
each adds: so the last ones come where many fits have got no nearer."""

OFF = 1e-3
"""Diagonals: so far, at most, flipped edges are from those before."""

FIN = 1e-3
"""Diagonals: so far, at most, samples may be from the balls that stay where sheets are taken away.
"""

START = 0.8  # halved 100 %, doubled 88 %
"""Share of the balls that the collapse leaves; the rest is added where the fit is worst."""

ROUNDS, AGAIN = 3, 2  # halved 79 %, doubled 98 %; halved 43 %, doubled 33 %
"""In which the rest is added: at first, and when balls are moved."""

SHARES = ((0.15, 0.08), (0.2, 0.05), (0.12, 0.25), (0.03, 0.1))
"""Shares of the balls, of those that matter least: a pair is taken away at the same time, each from
the same mesh, and put where the fit is worst."""

MORE = 5  # halved 0 %, doubled 0 %
"""Pairs of shares that `best` tries after the first, one after the other."""

UNNEEDED = 0.1
"""Part of the error: what changes the envelope by less is taken from the rims."""

FEWEST, FEW = 40, 250
"""Up to the second those balls are put elsewhere; with more, finding such parts takes long. Beyond
the first no shares of the balls are tried then, which takes longer and is no nearer (bug 60 .51 %
with them and .49 without, elk 124 .45 and .40, two seeds); with 30 a bug needs them (1.30, 1.42).
"""

LAST, STALE, GAIN = 6, 2, 0.99
"""How often the last fit is made, and how often without lowering the error below this share."""

WORST = 600  # halved 43 %, doubled 43 %
"""Places beside the samples that join the fit in the end, where the error is large there."""

LOOKED_AT = 10_000  # halved 79 %, doubled 86 %
"""Points of an envelope that are looked at for hollows where balls are added, about."""

DEEP = 2.0  # halved 43 %, doubled 88 %
"""Hollows get balls of their own from this many errors at the samples on."""

PLANS = {
    "fast": ((2, 4), (4, 4), (9, 4)),
    "first": ((2, 6), (4, 6)),
    "round": ((4, 4), (9, 4)),
    "close": ((9, 8), (16, 8)),
    "last": ((16, 6), (32, 6)),
    "many": ((2, 4), (6, 4)),
    "closer": ((9, 4), (20, 6)),
    "more": ((4, 3), (9, 4)),
    "end": ((12, 4),),
}
"""Powers and steps of the fits."""


@dataclass(frozen=True, eq=False)
class Base:
    """What all numbers of balls begin with, in diagonals."""

    solid: Solid
    fine: FineComplex
    sequence: Collapse
    bounds: Bounds
    roof: Roof | None = None
    structure: Structure | None = None

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
        return Hollows(self.solid, self.fine, self.bounds)


@dataclass(frozen=True, eq=False)
class _Found:
    """Fitted balls, their error (hollows included), and what the next fit looks at."""

    mesh: Complex
    error: float
    target: Target
    damping: float


@dataclass(frozen=True, eq=False)
class _Looked:
    """Fitted balls, their error wherever one can be, and what the next fit looks at."""

    mesh: Complex
    error: float
    target: Target
    watched: Watched

    def is_as(self, other: _Looked) -> bool:
        """Tell whether the balls are the same, and what the next fit looks at."""
        pairs = (
            (self.mesh.balls, other.mesh.balls),
            (self.target.rows, other.target.rows),
            (self.target.within, other.target.within),
            *zip(self.watched, other.watched, strict=True),
        )
        return all(np.array_equal(*pair) for pair in pairs)


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
        self._early = replace(self._all, rows=few, within=within[: int(EARLY * WITHIN)])

    @cached_property
    def _everywhere(self) -> tuple[FloatArray, FloatArray]:
        """All candidates and the vertices, with normals."""
        target, solid = self._all, self.base.solid
        points = np.concatenate([target.points, solid.points[solid.corners]])
        return points, np.concatenate([target.normals, solid.vertex_normals[solid.corners]])

    def run(self, quality: str) -> Complex:
        """Return the mesh of the quality wanted."""
        roof = self.base.roof
        if roof is not None and self.balls >= len(roof):
            return roof.mesh(self.balls)
        exact = self.base.structure and self.base.structure.mesh(self.balls)
        if exact:
            return exact
        if self.balls > MANY:
            return self._closely() if self.balls <= CLOSELY else self._many()
        start, _ = self.base.sequence.level(self.balls)
        if quality == "fast":
            return self._fitted(start, self._all, "fast").mesh
        start, _ = self.base.sequence.level(int(START * self.balls))
        now = self._grown(self._fitted(start, self._early, "first"), ROUNDS).mesh
        best = self._measured(now, self._with_worst(now, self._all.within), "round")
        steps = 3 + (MORE if quality == "best" else 0)
        self.progress.update(1 / steps)
        if not FEWEST < self.balls <= FEW:
            best = self._swapped(best, SHARES[0])
        self.progress.update(2 / steps)
        found = self._settled(best.mesh)
        if quality == "best":
            for k in range(MORE):
                self.progress.update((3 + k) / steps)
                best = self._swapped(best, SHARES[k % len(SHARES)])
            found = min(found, self._settled(best.mesh), key=self.base.error)
        return found

    def _fitted(self, start: Complex, target: Target, plan: str, damping: float = DAMPING) -> Fit:
        """Fit a complex by one of the plans."""
        start = self._mended(start) if self.balls <= CLOSELY else start
        return Fit(start, target, damping, self._still).run(PLANS[plan])

    def _mended(self, start: Complex) -> Complex:
        """Return a complex with the fine balls next to them in the place of balls outside.

        Nothing pulls at a ball that is outside altogether: the samples near it are those of others.
        """
        base, balls = self.base, start.balls
        outside = np.flatnonzero(~base.solid.contains(balls[:, :3]))
        lost = outside[base.bounds.nearest(balls[outside, :3])[0] > balls[outside, 3]]
        if len(lost) == 0:
            return start
        balls = balls.copy()
        balls[lost] = base.fine.nearest(balls[lost, :3])
        return Complex(balls, start.edges, start.faces)

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
            share = NEARLY_WORST
            while left == 1 and len(now) < wanted and share > LEAST_SHARE:
                share /= 2
                now = refined(now, faults, wanted - len(now), APART, share)
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
        fewer, _ = coarser(self.base.fine.samples, best.mesh, self.base.roof).level(
            self.balls - removed
        )
        other = self._grown(self._fitted(fewer, self._early, "round"), min(AGAIN, removed))
        found = self._measured(other.mesh, best.target, "round", most=best.error)
        if found.error >= best.error:
            return best
        target = self._with_worst(found.mesh, found.target.within)
        return replace(found, target=target)

    def _settled(self, start: Complex) -> Complex:
        """Fit closely, then put the balls that the envelope does not need where it is worst."""
        best = self._last(start)
        for _ in range(AGAIN if self.balls <= FEW else 0):
            needed = trimmed(best.mesh, UNNEEDED * best.error)
            if len(needed) == len(best.mesh):
                now = self._look(Fit(needed, self._all, DAMPING, self._still))
                return needed if now.error <= best.error else best.mesh
            grown = self._grown(self._fitted(needed, self._early, "round"), 1)
            found = self._last(grown.mesh)
            if found.error >= best.error:
                break  # the same once more
            best = found
        return best.mesh

    def _closely(self) -> Complex:
        """Fit many balls; those kept back come round by round where a close look tells."""
        start, _ = self.base.sequence.level(self.balls - int(MORE_KEPT_BACK * self.balls))
        fit = self._fitted(evened(start, OFF), self._all, "many")
        rounds = max(1, round(CLOSE_ROUNDS * MANY / self.balls))
        for k in range(rounds):
            self.progress.update(0.8 * k / rounds)
            found = self._look(fit)
            again = Fit(fit.mesh, found.target, DAMPING, self._still, found.watched)
            faults = faults_of(again, self.base.own)
            places = found.target.within[len(self._all.within) :]
            faults = Fault.joined([faults, self.base.hollows.faults(places)])
            missing = self.balls - len(fit.mesh)
            share = AT_A_TIME if k < rounds - 1 else 1.0
            now = refined_at_once(fit.mesh, faults, math.ceil(share * missing))
            fit = self._fitted(now, found.target, "more" if k < 2 else "closer")
        return self._last(fit.mesh).mesh

    def _many(self) -> Complex:
        """Fit many balls; some are kept back, and come where all candidates tell that it is off."""
        start, _ = self.base.sequence.level(self.balls - int(KEPT_BACK * self.balls))
        fit = self._fitted(evened(start, OFF), self._all, "many")
        for plan, share in (("more", 0.5), ("end", 1.0)):
            self.progress.update(0.4 + 0.4 * share)
            faults, target = self._looked_at(fit.mesh, fit.target.within)
            missing = self.balls - len(fit.mesh)
            now = refined_at_once(fit.mesh, faults, math.ceil(share * missing))
            fit = self._fitted(now, target, plan)
        return fit.mesh

    def _looked_at(self, now: Complex, within: FloatArray) -> tuple[Fault, Target]:
        """Look at all candidates and for hollows; return faults, and a target that has them."""
        target = self._with_worst(now, within)
        fit = Fit(now, target, DAMPING, self._still)
        places, depth = self.base.hollows.of(now, fit.now.off)
        faults = faults_of(fit, self.base.own)
        if depth > fit.now.off:
            target = target.with_within(places)
            faults = Fault.joined([faults, self.base.hollows.faults(places)])
        return faults, target

    def _last(self, start: Complex) -> _Looked:
        """Fit what was looked at, and look again, until that gets no nearer."""
        follower = Follower(self._everywhere[0], len(start))
        best = now = self._look(Fit(start, self._all, DAMPING, self._still), follower)
        since = 0
        for k in range(max(1, min(LAST, LAST * MANY // self.balls))):
            start = self._mended(now.mesh)
            fit, before = Fit(start, now.target, DAMPING, self._still, now.watched), now
            now = self._look(fit.run(PLANS["last" if k else "close"]), follower)
            since = 0 if now.error < GAIN * best.error else since + 1
            best = min(best, now, key=lambda one: one.error)
            if since == STALE or (k and now.is_as(before)):
                break  # or what comes is the same once more
        return best

    def _look(self, fit: Fit, follower: Follower | None = None) -> _Looked:
        """Look everywhere, and for hollows: the worst places are what is fitted next.

        The follower, if any, has seen the same complex with other balls.
        """
        target, (points, normals) = self._all, self._everywhere
        envelope = Envelope.of(fit.mesh)
        if follower is None:
            outside = envelope.distances(points)[0]
        else:
            outside = follower.distances(envelope).done().distance
        own = len(target.points)
        outside[:own][self.base.fine.samples.areas == 0] = 0.0  # mirrored ones
        off = max(fit.now.off, float(np.abs(outside).max()))
        found = self.base.hollows.look(fit.mesh, off, outside[:own])
        within = np.concatenate([target.within, found.within])
        rows = np.union1d(target.rows, _largest(np.abs(outside), WORST))
        target = Target(points, normals, rows, within, target.bounds)
        return _Looked(fit.mesh, max(off, found.largest), target, found.watched)

    def _with_worst(self, now: Complex, within: FloatArray) -> Target:
        """Return a target that looks at the worst of all candidates and vertices as well."""
        target, (points, normals) = self._all, self._everywhere
        distance = np.abs(Envelope.of(now).distances(points)[0])
        distance[: len(target.points)][self.base.fine.samples.areas == 0] = 0.0  # mirrored ones
        rows = np.union1d(target.rows, _largest(distance, WORST))
        return Target(points, normals, rows, within, target.bounds)


def _largest(values: FloatArray, count: int) -> Index:
    """Return where so many of the largest values are, of equal ones the first."""
    if len(values) <= count:
        return np.arange(len(values))
    least = np.partition(values, -count)[-count]
    rows = np.concatenate([np.flatnonzero(values > least), np.flatnonzero(values == least)])
    return rows[:count]


SAMPLES_A_BALL = 4  # halved 0 %, doubled 0 %
"""Samples of the fine complex for each ball wanted, at least."""

WHOLE_SAMPLES = 16_000
"""Samples where sheets stay whole, at least: with 5,000 a hand has 100 fins that are too large to
be taken away, with these one or two."""

FEWER = 0.85
"""Share of the balls that a better fit tries to reach an error with."""

STUCK, NO_BETTER = 2, 0.9
"""Twice as many balls, this often, have to lower the error below this share of it."""


@dataclass(frozen=True, kw_only=True)
class MedialMeshOptions(Options):
    """Options of `medial_mesh`."""

    balls: int = whole(
        120,
        "Balls",
        "Number of balls; the topology of the shape may need more than very few.",
        low=1,
        high=20_000,
    )
    error: float = length(
        0.0,
        "Largest error",
        "Use as few balls as reach this distance between envelope and surface; 0 uses the number "
        "of balls.",
        high=0.5,
    )
    quality: str = choice(
        "balanced",
        "Quality",
        "How much time the fit takes.",
        {
            "balanced": "The fit takes the steps after which little is gained.",
            "fast": "The fit takes fewer steps.",
            "best": "The fit moves more balls to where they are needed.",
        },
    )
    samples: int = whole(
        AUTO,
        "Samples",
        "About how many samples the fine mesh is computed from; more where the shape is thin or "
        "its topology needs them. auto: 5,000, and more for more than 600 balls.",
        low=100,
        high=1_000_000,
        advanced=True,
        auto=5000,
    )
    relief: float = length(
        0.002,
        "Relief",
        "Bumps that stand out less than this leave no branch in the fine mesh.",
        high=0.1,
        advanced=True,
    )
    seed: int = whole(
        0, "Seed", "Another number draws other samples.", low=0, high=2**31 - 1, advanced=True
    )
    denoise: str = changed(Preparation, "denoise")


@algorithm(MedialMeshOptions)
def medial_mesh(shape: Shape, options: MedialMeshOptions, progress: Progress) -> MedialMesh:
    """Compute the medial mesh of a closed shape: few balls, connected as the solid is.

    The union of the balls, and of the cones and slabs between balls that an edge or a triangle
    joins, is near the solid, and the complex has its parts, loops and hollows.

    Parameters
    ----------
    shape : Shape
        A mesh of m faces, best closed. Holes of up to 0.15 diagonals are closed, if that closes it.
        What is inside an open one is told by how often the surface is wound round a place. A
        message says so.

    Returns
    -------
    MedialMesh
        With its levels of detail (`MedialMesh.level`).

    Raises
    ------
    InvalidShapeError
        For a cloud, a mesh that encloses nothing, and an open one where what is inside is unclear.

    See Also
    --------
    envelope_distance : how far the envelope and the surface are apart.
    envelope_surface : the envelope as a closed triangle mesh.
    write_ma : writes the mesh to a file.

    Notes
    -----
    Cost: O(m + s log s) for s samples, and a fit of O(samples + balls) a step. The thesis has no
    such mesh; its reconstruction (3.4) is of images.

    Examples
    --------
    >>> import medialis
    >>> mesh = medialis.medial_mesh(medialis.organic_shape(56), balls=12)
    >>> len(mesh), mesh.betti
    (12, (1, 0, 0))
    >>> len(mesh.level(5)), mesh.level(5).betti
    (5, (1, 0, 0))
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "A medial mesh needs a surface with faces, got a point cloud: reconstruct a surface "
            "first."
        )
    low, high = shape.bounds
    middle, scale = 0.5 * (low + high), shape.diagonal
    if scale == 0.0:
        raise InvalidShapeError("All points of the shape coincide: it encloses nothing.")
    shape = smooth_copy(shape, options.denoise, options.relief, progress)
    with progress.stage("complex", 0.0, 0.4):
        base = _base(shape, options, progress)
    with progress.stage("fit", 0.4, 1.0):
        if options.error:
            found = _smallest(base, options, progress)
        else:
            found = _useful(base, options, progress)
    if not base.solid.whole and (far := base.error(found)) > UNCLEAR:
        raise InvalidShapeError(
            "The mesh is open, and what is inside is not clear: the envelope would be off by "
            f"{100 * far:.0f} % of the diagonal. Close the holes first."
        )
    samples = base.fine.samples
    fewer = LateCollapse(lambda: coarser(samples, found, base.roof).placed(scale, middle))
    wanted, count = options.balls, len(found)
    if count != wanted and not options.error:
        why = "its topology needs them" if count > wanted else "its fine complex has no more"
        if is_round(base.solid, base.fine):
            why = "the shape is nearly a ball, and more are of no use"
        text = f"The mesh has {counted(count, 'ball')} instead of {wanted:,}: {why}."
        progress.note(text, "ball_count", balls=count, wanted=wanted)
    finer = base.sequence.placed(scale, middle)
    return MedialMesh.of(found.placed(scale, middle), finer=finer, coarser=fewer)


def _base(shape: Shape, options: MedialMeshOptions, progress: Progress) -> Base:
    """Return the fine complex and its collapse, kept for other numbers of balls."""
    balls = 0 if options.error else options.balls
    start = options.auto_starts().get("samples")
    count = options.samples if start is None else max(int(start), SAMPLES_A_BALL * balls)
    solid, roof = _solid(shape, progress)
    if roof is not None and not options.error and balls < ENOUGH * len(roof):
        roof = None
    if roof is None and balls:
        structure = _structure(shape, solid, options, progress)
        if structure is not None and structure.mesh(balls) is not None:
            bounds = Bounds(structure.samples.points, structure.samples.normals)
            return Base(solid, structure.fine, structure.sequence, bounds, None, structure)
    whole = roof is None and balls > MANY
    if start is not None:
        count = max(count, WHOLE_SAMPLES) if whole else count
        options.with_auto_values({"samples": count}, progress)

    def work() -> tuple[FineComplex, Planes | None]:
        with progress.stage("sampling", 0.0, 0.7):
            if roof is None:
                flat = planes_of_faces(solid) is not None
                given = solid, count, options.relief, options.seed, progress
                fine = fine_complex(*given, on_reflex_edges if flat else None)
                fine = finless(fine, FIN) if whole else fine
                return creased(fine, solid) if flat else (fine, None)
            return complex_of(roof, take_samples(solid, count, options.seed), count), None

    def collapsed() -> Base:
        fine, touched = kept(_base, shape, (*given, "fine"), work, progress)
        with progress.stage("collapse", 0.7, 1.0):
            start, samples = Complex(fine.balls, fine.edges, fine.faces), fine.samples
            least = int(MANY * (1 - MORE_KEPT_BACK)) if whole and not is_round(solid, fine) else 1
            planes = planes_of(samples, fine.balls, fine.pole, roof, touched, hold)
            sequence, bounds = run_together(
                lambda: collapse(start, planes, least, whole=whole),
                lambda: Bounds(
                    samples.points, samples.normals, solid.contains
                ),  # in order for fits
            )
            return Base(solid, fine, sequence, bounds, roof)

    given = count, options.relief, options.seed, roof is not None, whole
    hold = max(HOLD, EVEN_HOLD * min(1.0, balls / SPREAD) ** 2) if whole else HOLD
    return kept(_base, shape, (*given, hold), collapsed, progress)


def _structure(
    shape: Shape, solid: Solid, options: MedialMeshOptions, progress: Progress
) -> Structure | None:
    """Return the exact medial axis of a polyhedron that is not convex, where balls can show it."""
    facets = kept(facets_to_part, shape, (), lambda: facets_to_part(solid), progress)
    if facets is None or len(facets.corners[0]) > options.balls:
        return None

    def work() -> Structure | None:
        with progress.stage("complex", 0.0, 0.5):
            return structure_of(solid, facets, options.seed)

    return kept(_structure, shape, (options.seed,), work, progress)


def _solid(shape: Shape, progress: Progress) -> tuple[Solid, Roof | None]:
    """Return the solid at diagonal 1, small holes closed, and its structure if it is convex."""

    def work() -> tuple[Solid, Roof | None]:
        low, high = shape.bounds
        assert shape.faces is not None
        given = (shape.points - 0.5 * (low + high)) / shape.diagonal
        points, faces, holes = without_holes(given, shape.faces)
        if holes:
            verb = "was" if holes == 1 else "were"
            text = f"{counted(holes, 'small hole')} of the mesh {verb} closed."
            progress.note(text, "holes_closed", holes=holes)
        solid = Solid(points, faces)
        return solid, roof_of(solid)

    return kept(_solid, shape, (), work, progress)


def _useful(base: Base, options: MedialMeshOptions, progress: Progress) -> Complex:
    """Return as many balls as are wanted, fewer where more are of no use."""

    def fitted(balls: int, quality: str = "fast") -> Complex:
        return Search(base, balls, options.seed, progress).run(quality)

    if base.roof is None and is_round(base.solid, base.fine):
        found = useful(fitted, base.error, options.balls)
        if found is not None:
            return found
    return fitted(options.balls, options.quality)


def _smallest(base: Base, options: MedialMeshOptions, progress: Progress) -> Complex:
    """Return the fewest balls that reach the error wanted: doubled, then halved in between.

    That is done with fast fits; better ones then try with fewer and fewer balls.
    """

    def fitted(balls: int, quality: str = "fast") -> Complex:
        return Search(base, balls, options.seed, progress).run(quality)

    low, high = 0, base.sequence.fewest if base.roof is None else len(base.roof)
    best = fitted(high)
    errors = [base.error(best)]
    while errors[-1] > options.error:
        stuck = len(errors) > STUCK and errors[-1] > NO_BETTER * errors[-1 - STUCK]
        if stuck or len(best) == len(base.sequence.start):
            text = (
                f"The error of {options.error:.2g} diagonals was not reached: with "
                f"{counted(len(best), 'ball')} it is {errors[-1]:.2g}, and more balls do not lower "
                "it. More samples may."
            )
            progress.note(text, "error_not_reached", error=errors[-1], wanted=options.error)
            return best
        low, high = high, 2 * high
        best = fitted(high)
        errors.append(base.error(best))
    while high - low > max(1, high // 16):
        middle = (low + high) // 2
        found = fitted(middle)
        if base.error(found) <= options.error:
            best, high = found, middle
        else:
            low = middle
    while options.quality != "fast" and len(best) > base.sequence.fewest:
        found = fitted(int(FEWER * len(best)), options.quality)
        if len(found) >= len(best) or base.error(found) > options.error:
            break
        best = found
    return best
