"""The surface skeleton of a shape: one preparation and one set of balls for everything after it.

1. `prepared`: a mesh is smoothed where it is noisy, and refined where its faces are too large to
   hold samples.
2. `maximal_balls`: each sample gets its maximal ball (thesis 3.2), which samples and triangles
   constrain. Ball shrinking sees samples and a tolerance, so a ball may pass a thin wall in two
   ways: its other side looks like relief, or the ball slips between the samples there. Such balls
   get a lower tolerance (deviation from thesis 3.2).
3. `with_fans`: at a sharp concave edge balls with any normal between those of the two faces are
   tangent. The balls of the samples have one each; the sheet that belongs to the edge lies between.

`uniform_subsample` thins a cloud to points a distance apart (thesis 3.2.1, Figure 3.3). Every
operation takes its balls from here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.arrays import Index, Mask
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import AUTO, Options, algorithm, angle, changed, choice, flag
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, as_field, as_number
from medialis.shape.creases import Creases, find_creases
from medialis.shape.noise import noise_above, smooth_noise
from medialis.shape.normals import CREASE_ANGLE
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.refinement import (
    RefineOptions,
    affordable_edge,
    on_smooth_surface,
    refine,
    with_refined_parts,
)
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import (
    COLUMNS,
    DEFAULT_TOLERANCE,
    THINNEST,
    MedialCloud,
    ShrinkOptions,
    hidden_walls,
    note_outcome,
    overwritten,
    sample_tree,
    shrink,
    shrink_options,
)
from medialis.skeleton.triangle_balls import Walls, between_samples, with_edge_balls

if TYPE_CHECKING:
    from medialis.base._box_tree_kernels import BoxTree

MOST_BALLS_OF_FAN = 32  # halved 0 %, doubled 0 %
"""Balls of a fan at a sample, at most."""

LEAST_SMOOTHNESS = 0.94  # halved 3 %, doubled 8 %
"""Cosine: where faces lean from the normals of their sectors by 20 degrees, as in folds and rough
surfaces, normals between those of the sides mean nothing."""

FOLDED = 3.0  # halved 8 %, doubled 0 %
"""Radians: faces that bend by more lie on each other; nothing lies between their normals."""

MAX_TOLERANCE = 0.1
"""Fraction of the diagonal."""

FLAT_SHARE = 1e-9  # halved 0 %, doubled 0 %
"""Of the largest spread of points: where the least is below, the shape is flat to rounding."""


NOISY_FROM = 0.04  # halved 0 %, doubled 0 %
"""Spacings: deviation of noise from which on a surface is smoothed. It tilts normals by 5 degrees.
Of 21 real meshes only one has more, a noisy scan with 0.043."""

TOO_LONG_SHARE = 0.02  # halved 0 %, doubled 0 %
"""Share of the area. A dense mesh with so few faces of too long edges, none twice too long, is not
refined: it keeps its samples, and all operations on it share their balls. 0.13 % more samples
(horse2, refine = 0.01) would cost as much as computing everything a second time."""


def uniform_subsample(
    cloud: MedialCloud, distance: float, *, priority: ArrayLike | None = None
) -> Mask:
    """Select valid skeleton points at least `distance` apart that cover all others.

    Points are taken by falling priority; each one kept removes all points closer to it than
    `distance`. Inner and outer points are thinned together.

    Parameters
    ----------
    cloud : MedialCloud
        k skeleton points; those that are not valid are never selected.
    distance : float
        Fraction of the bounding-box diagonal of the surface, >= 0. 0 selects every valid point.
    priority : (k,) array, optional
        Larger is kept first; ties go to the lowest index. Default: the spoke angle, so that points
        with well separated feature points survive.

    Returns
    -------
    (k,) bool
        For ``cloud.subset(mask)``.

    Raises
    ------
    InvalidOptionError
        When the distance is negative or not finite.
    InvalidShapeError
        When the priority has not k rows.

    See Also
    --------
    important_points : selects points by their importance.

    Notes
    -----
    Cost O(k). Source: thesis 3.2.1. Deviates: the order, which the thesis leaves open, is stated.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> mask = medialis.uniform_subsample(cloud, 0.01)
    >>> 100 < len(cloud.subset(mask)) < len(cloud)
    True
    """
    distance = as_number(distance, "distance", low=0.0) * cloud.surface.diagonal
    if priority is None:
        priority = cloud.spoke_angles
    rank = as_field(priority, len(cloud), "priority")
    rows = np.flatnonzero(cloud.valid)
    if distance == 0.0 or len(rows) == 0:
        return cloud.valid.copy()
    order = np.argsort(-rank[rows], kind="stable")
    selected = np.zeros(len(cloud), np.bool_)
    selected[rows[points_apart(cloud.centers[rows], order, distance)]] = True
    return selected


def points_apart(points: FloatArray, order: Index, distance: float) -> Mask:
    """Select points at least a distance > 0 apart that cover all others, in the given order.

    Parameters
    ----------
    points : (n, 3) float64
    order : (n,) int64
        Which are taken first.
    distance : float

    Returns
    -------
    (n,) bool
    """
    from medialis.skeleton._ball_kernels import Grid, keep_apart

    points = points - points.min(axis=0)
    # Cells smaller than a millionth of the extent would overflow the cell number; larger cells
    # than `distance` are still right.
    cell = max(distance, float(points.max()) * 1e-6)
    cells = np.floor(points.max(axis=0) / cell).astype(np.int64) + 2
    slots = 1 << int(2 * len(points)).bit_length()
    keys, heads, chain = (np.full(count, -1, np.int64) for count in (slots, slots, len(points)))
    keep = np.zeros(len(points), np.bool_)
    keep_apart(points, order, distance, Grid(cell, cells, keys, heads, chain), keep)
    return keep


@dataclass(frozen=True, kw_only=True)
class BallOptions(ShrinkOptions):
    """Options of `maximal_balls`."""

    creases: float = angle(
        CREASE_ANGLE,
        "Creases",
        "Edges that bend by more than this are sharp, and what bends less is a smooth surface "
        "through the vertices. 0: every edge is sharp, the mesh is an exact polyhedron; 180: none "
        "is.",
        advanced=True,
    )


def maximal_balls(
    shape: Shape, options: BallOptions, progress: Progress, out_walls: list[Walls] | None = None
) -> MedialCloud:
    """Shrink balls to what samples, triangles and thin walls leave room for.

    Triangles constrain the balls of a mesh as well as its samples (`Walls`). Inner balls that the
    tolerance lets through a wall get the largest of tolerance / 10, tolerance / 100, ... that does
    not; only those balls are computed again, on the same tree. A sample on
    a convex crease gets the ball that fits into the crease just beside it.

    Inner balls lie in the body of their sample: bodies that touch or nearly touch
    (`Surface.bodies`) do not constrain each other's balls. Outer balls are constrained by all.
    `out_walls` gets the walls of a mesh, for `with_fans`: those of each `_ball_sets`.
    """
    sets, found, cured = _ball_sets(shape, options, progress), [], Cured()
    for k, one in enumerate(sets):
        with progress.stage("bodies", k / len(sets), (k + 1) / len(sets)):
            cloud, walls = _balls_together(one, progress, cured)
        found.append(cloud)
        if out_walls is not None and walls is not None:
            out_walls.append(walls)
    cloud = _put_together(shape, sets, found)
    cured.note(options.tolerance, shape.point_count, progress)
    note_outcome(cloud, options.tolerance, progress)
    if shape.part_count > 1 and options.side != "outer":
        _note_contacts(shape, progress)
    return cloud


def _note_contacts(shape: Shape, progress: Progress) -> None:
    """Report bodies that touch."""
    contacts = shape.body_contacts.contacts
    if not contacts:
        return
    bodies = len({number for contact in contacts for number in contact.bodies})
    overlap = max(0.0, *(-contact.gap for contact in contacts))
    area = sum(contact.area for contact in contacts)
    text = (
        f"{bodies:,} bodies touch in {counted(len(contacts), 'contact')}: each has balls of its "
        "own, as if it were alone."
    )
    data: dict[str, Any] = {
        "contacts": len(contacts),
        "bodies": bodies,
        "area": area,
        "overlap": overlap,
    }
    progress.note(text, "contacts", **data)


@dataclass(frozen=True, eq=False)
class _BallSet:
    """Samples whose balls are computed together, and on which sides.

    Attributes
    ----------
    shape : Shape
        The whole shape, or bodies of it that are not near each other.
    options : BallOptions
        With lengths as fractions of the diagonal of that shape.
    samples, faces : (k,) and (f,) int64, or None
        Its rows in the whole shape; None for the whole.
    """

    shape: Shape
    options: BallOptions
    samples: Index | None = None
    faces: Index | None = None

    def to_whole(self, cloud: MedialCloud, whole: Shape) -> MedialCloud:
        """Return balls of this set as balls of the whole shape."""
        if self.samples is None or self.faces is None:
            return cloud
        samples, faces = (
            np.append(rows, -1).astype(np.int32) for rows in (self.samples, self.faces)
        )
        columns: dict[str, Any] = {name: getattr(cloud, name) for name in COLUMNS}
        columns["source"] = samples[cloud.source]
        columns["features"] = samples[cloud.features]
        columns["contact_faces"] = faces[cloud.contact_faces]
        return MedialCloud(**columns, surface=whole)

    def of_whole(self, cloud: MedialCloud) -> MedialCloud:
        """Return the balls of the samples of this set on its sides, as balls of its shape."""
        sides = {"inner": (1,), "outer": (-1,), "both": (1, -1)}[self.options.side]
        n, mine = cloud.surface.point_count, np.isin(cloud.side, sides)
        if self.samples is None or self.faces is None:
            return cloud if mine.all() else cloud.subset(mine)
        place, face = (
            np.full(n + 1, -1, np.int32),
            np.full(cloud.surface.face_count + 1, -1, np.int32),
        )
        place[self.samples] = np.arange(len(self.samples))
        face[self.faces] = np.arange(len(self.faces))
        rows = np.flatnonzero(mine & (place[cloud.source] >= 0))
        columns: dict[str, Any] = {name: getattr(cloud, name)[rows] for name in COLUMNS}
        for name, number in (("source", place), ("features", place), ("contact_faces", face)):
            columns[name] = number[columns[name]]
        return MedialCloud(**columns, surface=self.shape)


def _ball_sets(shape: Shape, options: BallOptions, progress: Progress) -> list[_BallSet]:
    """Return what balls are computed together: the whole shape where no bodies touch.

    Where tolerances by body were chosen (`Options.by_body`), each body that is near others is a
    set of its own, as if it were alone. Else the tolerance is a length, and bodies that are not
    near each other form a set (`Bodies.turns`).
    """
    if shape.faces is None or options.side == "outer":
        return [_BallSet(shape, options)]
    bodies = run_patiently(lambda: shape.body_contacts, progress)
    tolerances = _of_bodies(shape, options, "tolerance")
    alone = _lone_bodies(shape) if tolerances else None
    turn = bodies.turns if alone is None else alone
    if turn.max(initial=0) == 0:
        return [_BallSet(shape, options)]
    sets = []
    for number in np.unique(turn):
        part, samples, faces = shape.some_bodies(turn[bodies.label] == number)
        share = shape.diagonal / part.diagonal
        tolerance = options.tolerance * share if alone is None else tolerances[number]
        own = replace(options, side="inner", tolerance=min(tolerance, MAX_TOLERANCE), by_body=())
        sets.append(_BallSet(part, own, samples, faces))
    if options.side == "both":
        sets.append(_BallSet(shape, replace(options, side="outer")))
    return sets


def _put_together(shape: Shape, sets: list[_BallSet], found: list[MedialCloud]) -> MedialCloud:
    """Return the balls of all sets, inner ones in the order of the samples, then outer ones."""
    if len(sets) == 1:
        return found[0]
    balls = [one.to_whole(cloud, shape) for one, cloud in zip(sets, found, strict=True)]
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(cloud, name) for cloud in balls]) for name in COLUMNS
    }
    order = np.lexsort((columns["source"], -columns["side"]))
    return MedialCloud(**{name: rows[order] for name, rows in columns.items()}, surface=shape)


@dataclass
class Cured:
    """Samples that got a lower tolerance, and the lowest one as a fraction of the diagonal."""

    samples: int = 0
    lowest: float = math.inf

    def note(self, tolerance: float, of: int, progress: Progress) -> None:
        """Report how many there are."""
        if self.samples:
            verbs = "lies", "lie"
            text = (
                f"{counted(self.samples, 'sample', of=of, verbs=verbs)} where the shape is finer "
                f"than the tolerance of {100 * tolerance:.3g} % of the diagonal; one of down to "
                f"{100 * self.lowest:.3g} % was taken there."
            )
            data: dict[str, Any] = {"samples": self.samples, "of": of, "tolerance": self.lowest}
            progress.note(text, "thin_walls", **data)


def _balls_together(
    given: _BallSet, progress: Progress, cured: Cured
) -> tuple[MedialCloud, Walls | None]:
    """Shrink the balls of one set; return them with the walls of a mesh."""
    shape, options = given.shape, given.options
    with progress.stage("samples", 0.0, 0.45):
        cloud, tree = shrink(shape, options, progress)
    if shape.faces is None:
        return _with_lower_tolerance(cloud, tree, None, options, progress, cured), None
    with progress.stage("triangles", 0.45, 1.0):
        walls = run_patiently(
            lambda: Walls.of(find_creases(shape, options.creases), tree), progress
        )
        cloud = walls.constrain(cloud, options.tolerance, progress)
    cloud = _with_lower_tolerance(cloud, tree, walls, options, progress, cured)
    return with_edge_balls(cloud, walls, options.tolerance), walls


def _with_lower_tolerance(
    cloud: MedialCloud,
    tree: BoxTree,
    walls: Walls | None,
    options: BallOptions,
    progress: Progress,
    cured: Cured,
) -> MedialCloud:
    """Give the balls that the tolerance lets through a wall a lower one: `overwritten`."""
    shape, tolerance = cloud.surface, options.tolerance

    def went_through(balls: MedialCloud) -> Mask:
        return run_patiently(lambda: hidden_walls(balls, tolerance), progress)

    def shrink_again(rows: Index, finer: float) -> MedialCloud:
        lengths = shrink_options(shape.diagonal, finer, options.largest_radius)
        given = shape, tree, rows, place[rows], shape.normals[rows]
        balls = lengths.shrink(*given, 1, progress.still)
        return balls if walls is None else walls.constrain(balls, finer, progress)

    hidden = np.flatnonzero(went_through(cloud))
    if len(hidden) == 0:
        return cloud
    place = tree.place if walls is None else walls.place
    hidden = hidden[np.argsort(place[hidden])]  # neighbours share what they find
    exact = shrink_again(hidden, 0.0)
    curable = ~went_through(exact)  # others have another reason
    hidden, exact, finer = hidden[curable], exact.subset(curable), tolerance
    count, rows, again = len(hidden), [], []
    while len(hidden):
        finer = finer / 10 if finer > THINNEST else 0.0
        balls = shrink_again(hidden, finer) if finer > 0 else exact
        seen = ~went_through(balls)
        rows.append(hidden[seen])
        again.append(balls.subset(seen))
        hidden, exact = hidden[~seen], exact.subset(~seen)
    if count:
        columns = {n: np.concatenate([getattr(one, n) for one in again]) for n in COLUMNS}
        cloud = overwritten(cloud, np.concatenate(rows), **columns)
        cured.samples += count
        cured.lowest = min(cured.lowest, finer)
    return cloud


def with_fans(
    cloud: MedialCloud, options: BallOptions, progress: Progress, walls: Sequence[Walls] = ()
) -> MedialCloud:
    """Append balls at creases between those of the samples.

    Creases that are concave on their side get fans, as close as the samples are apart; convex ones
    balls between the samples (`between_samples`).

    Parameters
    ----------
    cloud : MedialCloud
        The balls of all samples of a mesh, with these options.
    options : BallOptions
    progress : Progress
    walls : sequence of Walls
        What constrained these balls, where that is known; found again where it is empty.

    Returns
    -------
    MedialCloud
        The rows given, then those of fans, then those between samples: `source` tells the sample at
        the crease. The cloud itself where there is no crease.
    """
    shape, parts = cloud.surface, [cloud]
    if shape.faces is None:
        return cloud
    sets = _ball_sets(shape, options, progress)
    for k, one in enumerate(sets):
        mine, known = one.of_whole(cloud), walls[k] if walls else None
        found = _fans_together(mine, one.options, progress, known)
        parts += [one.to_whole(balls, shape) for balls in found]
    if sum(map(len, parts)) == len(cloud):
        return cloud
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS
    }
    result = replace(cloud, **columns)
    result.__dict__["own"] = cloud  # the same cloud, so that what is kept of it serves both
    return result


def _fans_together(
    cloud: MedialCloud, options: BallOptions, progress: Progress, walls: Walls | None
) -> list[MedialCloud]:
    """Return the balls of fans and those between samples of one set."""
    shape = cloud.surface
    creases = walls.creases if walls else None
    if creases is None:
        creases = run_patiently(lambda: find_creases(shape, options.creases), progress)
    if len(creases.half_edges) == 0:
        return []
    if walls is None:
        tree = sample_tree(shape, progress)
        walls = run_patiently(lambda: Walls.of(creases, tree), progress)
    signs = [s for s in np.unique(cloud.side).tolist() if (creases.concave == (s > 0)).any()]
    fans = [_balls(walls, *_directions(cloud, creases, s), s, options, progress) for s in signs]
    return [*fans, between_samples(cloud, walls, options.tolerance)]


def _directions(cloud: MedialCloud, creases: Creases, sign: int) -> tuple[IntArray, FloatArray]:
    """Return samples at creases concave on a side, and outward directions between the faces."""
    surface = cloud.surface
    pairs = creases.pairs[creases.concave == (sign > 0)]
    vertex = creases.vertices[pairs[:, 0]]
    first, second = creases.normals[pairs[:, 0]], creases.normals[pairs[:, 1]]
    bend = np.arccos(np.clip(np.einsum("ij,ij->i", first, second), -1.0, 1.0))
    radius = np.zeros(surface.point_count)
    own = cloud.valid & (cloud.side == sign)
    radius[cloud.source[own]] = cloud.radii[own]
    usable = first.any(axis=1) & second.any(axis=1) & (radius[vertex] > 0) & (bend < FOLDED)
    usable &= creases.smoothness[vertex] > LEAST_SMOOTHNESS
    vertex, first, second, bend = vertex[usable], first[usable], second[usable], bend[usable]
    with np.errstate(over="ignore"):
        steps = np.ceil(bend * radius[vertex] / max(surface.spacing, 1e-300))
    steps = np.clip(steps, 1, MOST_BALLS_OF_FAN).astype(np.int64)
    pair = np.repeat(np.arange(len(vertex)), steps + 1)
    turn = np.arange(len(pair)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    part, angle = turn / steps[pair], bend[pair]
    weights = np.sin((1.0 - part) * angle)[:, None], np.sin(part * angle)[:, None]
    directions = (weights[0] * first[pair] + weights[1] * second[pair]) / np.sin(angle)[:, None]
    return vertex[pair], directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _balls(
    walls: Walls,
    sources: IntArray,
    directions: FloatArray,
    sign: int,
    options: ShrinkOptions,
    progress: Progress,
) -> MedialCloud:
    """Return the balls of some samples with outward normals of their own."""
    shape = walls.shape
    order = np.argsort(walls.place[sources], kind="stable")  # neighbours share what they find
    sources, directions = sources[order], directions[order]
    lengths = shrink_options(shape.diagonal, options.tolerance, options.largest_radius)
    places = walls.place[sources]
    balls = lengths.shrink(shape, walls.tree, sources, places, directions, sign, progress)
    balls = walls.constrain(balls, options.tolerance, progress, directions=sign * directions)
    at_own = balls.radii <= options.tolerance * shape.diagonal
    outside = ((balls.contacts - balls.centers) * balls.contact_normals).sum(axis=1) * sign < 0
    return balls.subset(balls.valid & ~at_own & ~outside)  # in folds a direction may look outward


@dataclass(frozen=True, kw_only=True)
class Preparation(Options):
    """Options of what comes before everything that rests on balls."""

    denoise: str = choice(
        "auto",
        "Noise",
        "Whether a noisy surface is smoothed for the computation.",
        {
            "auto": "The noise of the surface is measured, and a smoothed copy computed on where "
            "it disturbs the normals; clean surfaces stay as they are, also with sharp edges.",
            "off": "Surfaces are computed on as they are.",
        },
    )
    tolerance: float = changed(
        ShrinkOptions,
        "tolerance",
        default=AUTO,
        auto=DEFAULT_TOLERANCE,
        help="Relief of the surface lower than this share of the size does not shrink a ball; no "
        "sample lies deeper than this inside one. 0 gives the exact maximal balls, larger values "
        "suppress noise. auto: 0.03 %, and more where noise is left after smoothing.",
    )
    refine: float = changed(
        RefineOptions,
        "longest_edge",
        default=AUTO,
        auto=0.02,
        help="Split edges longer than this share of the size for the computation, so that flat "
        "faces get samples; flat faces stay the same, on rounded ones new samples lie on the "
        "smooth surface. 0 computes with the given vertices only. auto: 2 %, or more where that "
        "would make too many samples.",
    )
    creases: float = changed(BallOptions, "creases")

    def size_scale(self, shape: Shape) -> float:
        """Return the size that automatic lengths are fractions of, in diagonals of the shape."""
        return 1.0

    def with_auto_resolved(self, data: Any, progress: Progress) -> Self:
        """Replace "auto" by numbers; where bodies touch, choose numbers for each of them."""
        starts = self.auto_starts()
        if isinstance(data, Shape) and {"tolerance", "refine"} & set(starts):
            by_body = self._by_body(data, starts, progress)
            return replace(super().with_auto_resolved(data, progress), by_body=by_body)
        return super().with_auto_resolved(data, progress)

    def _by_body(
        self, shape: Shape, starts: Mapping[str, float], progress: Progress
    ) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Choose lengths for each group of `_lone_bodies`; none where there are no groups."""
        number = run_patiently(lambda: _lone_bodies(shape), progress)
        if number is None or _without_noise(shape, self.denoise, progress)[0] is not shape:
            return ()
        chosen: dict[str, list[float]] = {n: [] for n in ("tolerance", "refine") if n in starts}
        for group in range(int(number.max()) + 1):
            mine = number[shape.bodies] == group
            part = shape.some_bodies(mine)[0] if mine.any() else shape
            scale = run_patiently(partial(self.size_scale, part), progress)
            if "tolerance" in chosen:
                chosen["tolerance"].append(min(scale * starts["tolerance"], MAX_TOLERANCE))
            if "refine" in chosen:
                edge = partial(auto_longest_edge, part, min(scale * starts["refine"], 1.0))
                chosen["refine"].append(run_patiently(edge, progress))
        return tuple((name, tuple(values)) for name, values in chosen.items())

    def auto_values(
        self, data: Any, starts: Mapping[str, float], progress: Progress
    ) -> dict[str, float]:
        """Choose tolerance and longest edge; balls that are given have theirs already.

        The tolerance is at least the noise that smoothing leaves. The longest edge grows until the
        number of samples is in proportion to the mesh (`affordable_edge`); a dense mesh keeps its
        vertices, and a point cloud is not refined. Where bodies touch, each has lengths of its own,
        as if it were alone (`Options.by_body`); the largest ones are reported.
        """
        if not isinstance(data, Shape) or not {"tolerance", "refine"} & set(starts):
            return {}
        scale = run_patiently(lambda: self.size_scale(data), progress)
        clean, _, left = _without_noise(data, self.denoise, progress)
        if by_body := self._by_body(data, starts, progress):
            return {name: max(values) for name, values in by_body}
        chosen = {}
        if "tolerance" in starts:
            noise = 0.0 if clean is data else left / data.diagonal
            chosen["tolerance"] = min(max(scale * starts["tolerance"], noise), MAX_TOLERANCE)
        if "refine" in starts and clean.faces is not None:
            start = min(scale * starts["refine"], 1.0)
            chosen["refine"] = run_patiently(lambda: auto_longest_edge(clean, start), progress)
        return chosen

    def unused_options(self, data: Any) -> frozenset[str]:
        """Return the options that only prepare shapes, where balls are given."""
        prepares = frozenset({"denoise", "tolerance", "refine", "side"})
        return prepares if isinstance(data, MedialCloud) else frozenset()

    def ball_options(self) -> SurfaceSkeletonOptions:
        """Return the options of the balls that the algorithm works on."""
        return SurfaceSkeletonOptions.taken_from(self)


@dataclass(frozen=True, kw_only=True)
class SurfaceSkeletonOptions(ShrinkOptions, Preparation):
    """Options of `surface_skeleton`."""

    tolerance: float = changed(Preparation, "tolerance")
    fans: bool = flag(
        False,
        "Fans",
        "Add balls at sharp edges: at concave ones with normals between those of the two faces, so "
        "that the skeleton has no gap there, at convex ones small balls between the samples, so "
        "that the union of the balls has none.",
        advanced=True,
    )


@algorithm(SurfaceSkeletonOptions, door=as_shape)
def surface_skeleton(
    shape: Shape, options: SurfaceSkeletonOptions, progress: Progress
) -> MedialCloud:
    """Compute the surface skeleton (medial axis) of a shape as a cloud of maximal balls.

    Every sample of the surface gets the largest ball that touches the surface there and lies inside
    the shape, constrained by the triangles of a mesh as well as by its samples. A noisy mesh is
    smoothed first, a coarse one refined. Creases, where the mesh bends by more than `creases`, are
    sharp edges; what bends less stands for a smooth surface through the vertices.

    Parameters
    ----------
    shape : Shape
        n samples with unit outward normals; samples without a normal get no ball.

    Returns
    -------
    MedialCloud
        One row for each sample of ``cloud.surface``, the surface as computed on, whose first n
        points are those of the shape; for both sides, twice as many rows. With `fans`, their rows
        come last.

    Raises
    ------
    InvalidShapeError
        When all points coincide, no sample has a normal, or no ball meets a second sample; the
        sentence says why.

    See Also
    --------
    shrink_balls : the balls of exactly the samples given, constrained by samples alone.
    geodesic_importance : tells what matters in a skeleton from what bumps and noise made.
    thickness, curve_skeleton, medial_sheets, parts : what rests on the balls.

    Notes
    -----
    Cost: O(n log n), about 400 bytes a sample. Source: thesis 3.2.1-3.2.2, Algorithm 1; see
    `shrink_balls`, `medialis.skeleton.triangle_balls` and the top of this module for where it
    deviates.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> len(cloud) == cloud.surface.point_count, bool(cloud.valid.mean() > 0.99)
    (True, True)
    """
    fine = prepared(shape, options, progress)
    shrinking = BallOptions.taken_from(options)

    walls: list[Walls] = []

    def shrink() -> MedialCloud:
        cloud = maximal_balls(fine, shrinking, progress, walls)
        _require_balls(cloud)
        return cloud

    with progress.stage("balls", 0.1, 1.0):
        # Another refine or denoise that leads to the same surface finds the same balls.
        cloud = kept(maximal_balls, fine, shrinking, shrink, progress)
    if not options.fans:
        return cloud
    return kept(
        with_fans, cloud, shrinking, lambda: with_fans(cloud, shrinking, progress, walls), progress
    )


Finer: TypeAlias = Callable[[Shape], Shape]

CloudLike: TypeAlias = MedialCloud | ShapeLike


def shape_or_cloud(given: CloudLike, progress: Progress) -> Shape | MedialCloud:
    """Return a cloud as it is, and a shape of whatever stands for one.

    Raises
    ------
    InvalidShapeError
        When it is neither; the sentence says what came.
    """
    return given if isinstance(given, MedialCloud) else as_shape(given, progress)


def balls_of(data: Shape | MedialCloud, options: Options, progress: Progress) -> MedialCloud:
    """Return a cloud as it is, and the balls of a shape as the options of an algorithm want them.

    Functions and operations of one name get their balls here, so that they agree.
    """
    if isinstance(data, MedialCloud):
        return data
    own = options.ball_options() if isinstance(options, Preparation) else SurfaceSkeletonOptions()
    return surface_skeleton.of(data, own, progress)


def as_cloud(given: CloudLike, progress: Progress) -> MedialCloud:
    """Return a cloud as it is, and the surface skeleton of whatever stands for a shape.

    Raises
    ------
    InvalidShapeError
        When it is neither; the sentence says what came.
    """
    return balls_of(shape_or_cloud(given, progress), Options(), progress)


def prepared(
    shape: Shape, options: Preparation, progress: Progress, finer: Finer | None = None
) -> Shape:
    """Return the surface to compute on; report what was done.

    Tolerance and longest edge in `options` are numbers, not "auto". `finer` may split edges of
    the refined mesh further, and return it as it is where none are.
    """
    clean, level, _ = _without_noise(shape, options.denoise, progress)
    if clean is not shape:
        noise = level / shape.diagonal
        progress.note(_smoothed(noise), "denoised", noise=noise, tolerance=options.tolerance)
    return _refined(clean, options, progress, finer)


def smooth_copy(shape: Shape, denoise: str, least: float, progress: Progress) -> Shape:
    """Return a mesh smoothed, and say so, where its noise is above a least share of its diagonal.

    Others stay as they are, and so do all with "off".
    """
    smooth, level, _ = _without_noise(shape, denoise, progress)
    if smooth is shape or level <= least * shape.diagonal:
        return shape
    noise = level / shape.diagonal
    progress.note(_smoothed(noise), "denoised", noise=noise)
    return smooth


def _smoothed(level: float) -> str:
    return (
        f"The surface is noisy, by {100 * level:.2g} % of the diagonal: a smoothed copy was "
        "used (denoise = off turns this off)."
    )


def _without_noise(shape: Shape, denoise: str, progress: Progress) -> tuple[Shape, float, float]:
    """Return a smooth copy of a noisy shape, the noise before, and what is left of it."""
    if denoise == "off" or shape.faces is None or shape.diagonal == 0.0:
        return shape, 0.0, 0.0

    def find() -> tuple[Shape, float, float]:
        least = NOISY_FROM * shape.spacing
        level = noise_above(shape, least)
        if level == 0.0 or level < least:
            return shape, level, 0.0
        smooth, left = smooth_noise(shape, level)
        return (smooth, level, left) if smooth.diagonal > 0 else (shape, level, 0.0)

    work = partial(run_patiently, find, progress)
    return kept(_without_noise, shape, None, work, progress)


def _refined(
    shape: Shape, options: Preparation, progress: Progress, finer: Finer | None = None
) -> Shape:
    """Refine a coarse mesh and report it; see `Options.by_body`."""
    fraction = options.refine
    if fraction == 0.0 or shape.faces is None:
        return shape
    each = ""
    with progress.stage("refine", 0.0, 0.1):
        if edges := _of_bodies(shape, options, "refine"):
            each = " of each body"
            fine = _refined_bodies(shape, edges, progress)
        else:
            fine = refine.of(shape, RefineOptions(longest_edge=fraction), progress)
    if finer is not None:
        fine = finer(fine)
    if fine is not shape:
        if shape.face_origin is None:
            creases = run_patiently(lambda: find_creases(shape, options.creases), progress)
            fine = run_patiently(lambda: on_smooth_surface(shape, fine, creases), progress)
        progress.note(
            f"The mesh was refined: {shape.point_count:,} vertices became {fine.point_count:,} "
            f"samples, at most {100 * fraction:.3g} % of the diagonal{each} apart "
            "(refine = 0 turns this off).",
            "refined",
            vertices=shape.point_count,
            samples=fine.point_count,
            longest_edge=fraction,
        )
    return fine


def _refined_bodies(shape: Shape, edges: tuple[float, ...], progress: Progress) -> Shape:
    """Refine each group of bodies to edges of a fraction of its own diagonal."""
    number, parts = _lone_bodies(shape), []
    assert number is not None
    for group in np.unique(number).tolist():
        part, points, faces = shape.some_bodies(number[shape.bodies] == group)
        fine = refine.of(part, RefineOptions(longest_edge=edges[group]), progress.still)
        parts.append((fine, points, faces))
    return with_refined_parts(shape, parts)


def _of_bodies(shape: Shape, options: Options, name: str) -> tuple[float, ...]:
    """Return the lengths of a name for each group of `_lone_bodies`; () where they do not fit."""
    lengths = dict(options.by_body).get(name, ())
    number = _lone_bodies(shape) if lengths else None
    return lengths if number is not None and len(lengths) == number.max() + 1 else ()


def auto_longest_edge(shape: Shape, fraction: float) -> float:
    """Return the longest edge for a mesh, as a fraction of its diagonal, from a fraction on."""
    if not _dense(shape, fraction * shape.diagonal):
        return affordable_edge(shape, fraction)
    longest = float(shape.edge_lengths.max(initial=0.0))
    return max(fraction, longest / (shape.diagonal or 1.0) * (1.0 + 1e-12))


MAX_LONE_BODIES = 100
"""Bodies of an assembly that have lengths of their own, at most; each costs what it would alone."""


def _lone_bodies(shape: Shape) -> Index | None:
    """Return a number for each body, (b,); None where no bodies are near each other, or too many.

    Bodies that are near others have different numbers, above 0; all others have 0.
    """
    if shape.faces is None or shape.part_count < 2:
        return None
    bodies = shape.body_contacts
    near = np.unique(bodies.near)
    if len(near) == 0 or len(near) > MAX_LONE_BODIES:
        return None
    number = np.zeros(bodies.count, np.int64)
    number[near] = 1 + np.arange(len(near))
    return number


def _dense(shape: Shape, longest: float) -> bool:
    """Tell whether edges longer than `longest` are few and not much longer."""
    lengths = shape.edge_lengths
    if lengths.max(initial=0.0) <= longest:
        return True
    if lengths.max() > 2 * longest:
        return False
    ends = np.zeros(shape.point_count, np.bool_)
    ends[shape.edges[lengths > longest]] = True
    faces = np.flatnonzero(ends[shape.faces].sum(axis=1) > 1)
    corners = shape.points[np.asarray(shape.faces)[faces]]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    coarse = faces[sides > longest]
    return bool(shape.face_areas[coarse].sum() <= TOO_LONG_SHARE * shape.area)


def _require_balls(cloud: MedialCloud) -> None:
    """Raise a sentence that says why there is no skeleton, when there is none."""
    if cloud.valid.any():
        return
    shape = cloud.surface
    spread = np.linalg.svd(shape.points - shape.points.mean(axis=0), compute_uv=False)
    flat = spread[-1] <= FLAT_SHARE * spread[0]
    why = "the shape is flat" if flat else "nothing faces them on this side"
    if not flat and shape.faces is None:
        why += " (if the normals of this cloud point inward, turn them or leave them out)"
    raise InvalidShapeError(
        f"No ball of the {shape.point_count} samples meets a second sample: {why}. A skeleton "
        "needs a surface that encloses a volume, at least partly."
    )
