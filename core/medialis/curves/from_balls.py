"""The curve skeleton of a mesh from its surface skeleton, as a graph (thesis 3.6).

Shapes whose limbs are hundreds of times as long as thick get theirs from level sets instead
(`from_level_sets.py`): lengths that are fractions of the whole size lose such limbs.

A limb has samples as close as it is thin, whatever its triangles (`limb_sampling.py`). A branch is
left out when less than a square with the threshold as its side hangs on it at its base; others run
to their tips (deviation from thesis 3.6.3, which ends them where less hangs on them).

Steps: candidates and their importance (`candidates.py`), links between balls, loops round handles,
and growth along the links (`curves/growth.py`); then each node gets its distance to the surface and
its importance, and each sample its node. What does not depend on the threshold is kept (`_Ground`).

A loop runs along balls round a handle. Where the handle, or the hole in it, is thinner than the
samples are apart, no balls go round it: its samples lie on creases alone, or far apart. There
`curve_skeleton` refines the mesh and computes everything again (thesis 3.6.3), where it was given a
shape. Given balls stay as they are.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound, kept
from medialis.base.options import AUTO, Options, algorithm, changed, choice, length, number
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.curves.candidates import (
    HALF_ROUND,
    CandidateMeasure,
    candidate_measure,
    smooth_importance,
)
from medialis.curves.curve_skeleton import CurveEvidence, CurveSkeleton
from medialis.curves.finishing import SimplifyOptions, finish_graph, simplify_branches
from medialis.curves.from_level_sets import level_ground, level_set_skeleton
from medialis.curves.growth import (
    NEIGHBOURS,
    Handles,
    Links,
    Turns,
    find_handles,
    grow_graph,
    link_balls,
)
from medialis.curves.limb_sampling import with_limbs_sampled
from medialis.curves.persistence import measured_persistence
from medialis.shape.refinement import refine_where
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import DEFAULT_TOLERANCE, MedialCloud, ShrinkOptions, shrink
from medialis.skeleton.preparation import InvariantPreparation
from medialis.skeleton.surface_skeleton import (
    Preparation,
    SurfaceSkeletonOptions,
    prepared,
    shape_or_cloud,
    surface_skeleton,
)

if TYPE_CHECKING:
    from medialis.curves._kernels import BallLinks


SHARPEST = 1.5 * np.pi  # halved 0 %, doubled 45 %
"""Squares of the radius that hang on a point of a limb at least. A ball in a cone that tapers by 60
degrees parts cos^2 30 / sin 30 pi r^2 of it from the rest, the middle of a half ball 2 pi r^2, a
ball in the corner of a cube 3 r^2."""

SLENDER = 1000.0
"""Length of all limbs over their radius from which level sets are used: balls would take more
samples than there may be. Bodies of animals, hands and machine parts have 20 to 125, a spider 570,
neurons 9,000."""

ACROSS = np.radians(120.0)
"""Spoke angle of balls that touch both sides of a tube at least."""

THIN, FEW = 1.5, 0.15
"""Level sets are also used where more than `FEW` of the total limb length is thinner than `THIN`
times the thinnest limb with candidates. Animals and machine parts have a fraction of up to 0.11;
trees of 59 limbs, of which balls miss 5 to 17, have 0.19 to 0.25."""

ROUGHLY, MANY_FACES = 0.2, 10_000
"""Above this number of faces the fraction of thin limbs is first estimated from balls; level sets
are computed only if the estimate is at least `ROUGHLY`."""

Method = Literal["auto", "balls", "level_sets"]

ATTEMPTS = 3  # halved 0 %, doubled 0 %
"""To find loops that are missing, each on a finer mesh than the one before."""

EDGES_A_RADIUS = 1.0  # halved 5 %, doubled 63 %
"""Edges to the radius of the largest balls, inside and outside, at a handle, in the first attempt;
twice as many in each that follows."""

NEARBY_RADII = 4.0  # halved 17 %, doubled 26 %
"""Radii up to which the surroundings of a loop round or along a handle are refined: what is round
the handle there is as far as two."""

MOST_SAMPLES = 100_000  # halved 0 %, doubled 0 %
"""That there may be after all attempts: 30 handles with a thickness of 1 % of the size take
95,000."""

NEAREST = 16
"""Samples beside one without a node that are asked first."""

MOST_GROWTH = 8  # halved 0 %, doubled 0 %
"""Times as many samples as before there may be, if that is more."""


def put_in_surface(
    cloud: MedialCloud, graph: CurveSkeleton, node_of_sample: Index, progress: Progress
) -> CurveSkeleton:
    """Give nodes their distance to the nearest sample, and each sample its node and branch."""
    radii = run_patiently(lambda: cloud.surface.tree.query(graph.nodes)[0], progress)
    missing = node_of_sample < 0
    if missing.any():
        work = functools.partial(run_patiently, lambda: _nearest(cloud.surface, missing), progress)
        nearest = kept(_nearest, cloud, missing.tobytes(), work, progress)
        node_of_sample[missing] = np.where(nearest < 0, -1, node_of_sample[nearest])
    return CurveSkeleton.of(
        graph.nodes, graph.edges, radii, vertex_node=node_of_sample, cloud=cloud
    )


def _nearest(surface: Shape, missing: Mask) -> Index:
    """Return the nearest sample of the same component that is not missing for those that are.

    Few are missing, so one of the nearest samples is nearly always known.
    """
    lost, part = np.flatnonzero(missing), surface.components
    near = np.asarray(surface.tree.query(surface.points[lost], NEAREST)[1])
    usable = near < surface.point_count
    usable &= ~missing[near * usable] & (part[near * usable] == part[lost, None])
    result = near[np.arange(len(lost)), usable.argmax(axis=1)]
    rest = np.flatnonzero(~usable.any(axis=1))
    result[rest] = -1
    for one in np.unique(part[lost[rest]]).tolist():
        known = np.flatnonzero((part == one) & ~missing)
        here = rest[part[lost[rest]] == one]
        if len(known):
            near = kd_tree(surface.points[known]).query(surface.points[lost[here]])[1]
            result[here] = known[near]
    return result


def node_importance(
    cloud: MedialCloud, graph: CurveSkeleton, candidates: Index, importance: FloatArray
) -> FloatArray:
    """Return the importance of the nearest candidate of the same part of the shape for each node.

    On a single node hangs the whole area of its part, and so it does in a part without candidates.
    """
    surface, node = cloud.surface, np.asarray(graph.vertex_node)
    whole = np.bincount(surface.components, surface.point_areas)
    part = np.full(graph.component_count, -1)
    part[graph.components[node[node >= 0]]] = surface.components[node >= 0]
    of_node, of_candidate = part[graph.components], surface.components[candidates]
    result = np.where(of_node >= 0, whole[of_node], np.nan)
    for one in np.intersect1d(of_node, of_candidate).tolist():
        nodes, rows = np.flatnonzero(of_node == one), np.flatnonzero(of_candidate == one)
        tree = kd_tree(cloud.centers[candidates[rows]])
        result[nodes] = importance[rows[tree.query(graph.nodes[nodes])[1]]]
    alone = (graph.degrees == 0) & (of_node >= 0)
    result[alone] = whole[of_node[alone]]
    return result


@dataclass(frozen=True, kw_only=True)
class CurveSkeletonOptions(InvariantPreparation):
    """Options of `curve_skeleton`; on hand, fertility, horse the defaults give what one draws."""

    threshold: float = length(
        AUTO,
        "Importance",
        "Limbs with less surface than a square get no branch; the side of the square is this "
        "share of the size. Larger values leave out more limbs. auto: 2 % of a size that does not "
        "change when the shape is turned.",
        auto=0.02,
    )
    smoothing: float = number(
        0.7,
        "Smoothing",
        "Bends shorter than this times the radius are smoothed. 0 leaves the zigzag of the "
        "samples.",
        high=10.0,
    )
    simplify: float = changed(SimplifyOptions, "simplify", default=0.0)
    skeleton_method: Method = choice(
        "auto",
        "Method",
        "What the skeleton is made from.",
        {
            "auto": "From level sets where limbs are hundreds of times as long as thick, else from "
            "balls.",
            "balls": "From the balls of the surface skeleton, as in the thesis: best centered in "
            "bodies that are not round.",
            "level_sets": "From level sets of the distance along the surface: finds limbs however "
            "thin they are; takes holes and crossing surfaces.",
        },
        advanced=True,
    )
    candidates: float = length(
        AUTO,
        "Candidates",
        "A point of the surface skeleton may lie on the curve where shortest paths round its limb "
        "are at least this long, as a share of the size. Smaller values find thinner limbs, and "
        "more noise. auto: 0.5 % of a size that does not change when the shape is turned.",
        low=0.0001,
        advanced=True,
        auto=0.005,
    )

    def auto_values(
        self, data: Any, starts: Mapping[str, float], progress: Progress
    ) -> dict[str, float]:
        """Choose automatic lengths; none is needed for level sets."""
        if isinstance(data, Shape) and by_level_sets(data, self, progress):
            return {}
        return super().auto_values(data, starts, progress)

    def unused_options(self, data: Any) -> frozenset[str]:
        """Return the options that do not matter for balls."""
        own = {"skeleton_method"} if isinstance(data, MedialCloud) else set()
        return super().unused_options(data) | own


def by_level_sets(shape: Shape, options: CurveSkeletonOptions, progress: Progress) -> bool:
    """Whether the skeleton of a shape is made from level sets: where most limbs are slender.

    A length of candidates that was given is for balls.
    """
    if shape.faces is None or options.skeleton_method == "balls":
        return False
    if options.skeleton_method == "level_sets":
        return True
    if options.candidates != AUTO:
        return False
    scale = options.size_scale(shape) * shape.diagonal
    thinnest = THIN * options.auto_starts()["candidates"] * scale / (HALF_ROUND * np.pi)
    if shape.face_count > MANY_FACES:
        slender, thin = kept(
            _rough_slenderness,
            shape,
            thinnest,
            lambda: _rough_slenderness(shape, thinnest, progress),
            progress,
        )
        if slender < SLENDER and thin < ROUGHLY:
            return False
    web = level_ground(shape, progress)
    return web.slenderness >= SLENDER or web.share_below(thinnest) > FEW


def _rough_slenderness(shape: Shape, thinnest: float, progress: Progress) -> tuple[float, float]:
    """Estimate the slenderness as if the shape were of tubes alone, and the share that is thin.

    Balls that touch on both sides measure tubes; others belong to edges and noise.
    """
    balls, _ = shrink(shape, ShrinkOptions(), progress.still)
    rows = np.flatnonzero(balls.valid & (balls.spoke_angles > ACROSS) & (balls.radii > 0.0))
    radii, area = balls.radii[rows], shape.point_areas[balls.source[rows]]
    length = area / (2.0 * np.pi * radii)
    total = float(length.sum())
    if total <= 0.0:
        return 0.0, 0.0
    mean = float(np.exp(length @ np.log(radii) / total))
    return total / mean, float(length[radii < thinnest].sum()) / total


@dataclass(frozen=True, eq=False, repr=False)
class _Ground(Bound):
    """What a graph grows on: the same for every threshold, smoothing and simplification.

    Rows of `candidates` are those of `importance`; all others are one a ball.
    """

    measured: CandidateMeasure
    candidates: Index
    importance: FloatArray
    links: BallLinks
    strength: FloatArray
    components: IntArray
    handles: dict[int, Handles] = field(default_factory=dict)


@algorithm(CurveSkeletonOptions, door=shape_or_cloud)
def curve_skeleton(
    shape: Shape | MedialCloud, options: CurveSkeletonOptions, progress: Progress
) -> CurveSkeleton:
    """Compute the curve skeleton of a mesh as a graph.

    The graph has one component for each component of the surface and one loop for each handle. It
    runs along the points of the surface skeleton from which geodesics start to all sides; gaps
    between them are closed along the surface skeleton. Limbs whose triangles are too large get more
    samples first, and so do handles without a loop afterwards.

    Parameters
    ----------
    shape : Shape or MedialCloud
        A mesh. Or ``surface_skeleton(shape)`` of a mesh, all n inner balls, row i of sample i:
        these balls are used as they are, and nothing is sampled more densely.

    Returns
    -------
    CurveSkeleton
        With the node and the branch of each sample of ``cloud.surface``, and what it was made of
        (``evidence``). Its importance is mu; a part that is a single node has its whole area.

    Raises
    ------
    InvalidShapeError
        When the surface has no faces, or a cloud is not its whole inner cloud.
    InvalidOptionError
        When options that prepare a shape are given with a cloud.

    See Also
    --------
    view_curve_skeleton : from pictures; also of point clouds and of meshes that are not clean.
    candidate_measure, area_importance : the two measures that it rests on.
    bones : an armature along it.
    simplify_branches : fewer nodes later.

    Notes
    -----
    Shapes with limbs far thinner than the whole are cut along level sets of the distance on the
    surface instead (`skeleton_method`): the radius of a node is then that of a circle with the area
    of the section, `evidence` has no candidates, and importance is the area that hangs on a node.

    Cost O(n log n): 4 s for 194,000 vertices after the geodesics. Another threshold, smoothing or
    simplification of the same cloud only grows the graph anew. Source: thesis 3.6. Deviates: the
    linking. The thesis connects candidates within a radius, which leaves gaps and does not know the
    genus. See `growth.py` for branches and loops.

    Examples
    --------
    >>> import medialis
    >>> medialis.curve_skeleton(medialis.organic_shape(100)).branch_count
    11
    """
    if isinstance(shape, MedialCloud):
        return _from_balls(shape, options, progress)
    return _from_shape(shape, options, progress)


def _from_balls(
    cloud: MedialCloud, options: CurveSkeletonOptions, progress: Progress
) -> CurveSkeleton:
    """Compute the curve skeleton of balls as they are."""
    _require_whole_cloud(cloud)
    cloud = cloud.own
    surface = cloud.surface
    share = options.candidates
    ground = kept(_ground, cloud, share, lambda: _ground(cloud, share, progress), progress)
    with progress.stage("reconstruct", 0.8, 1.0):
        radii = cloud.radii[ground.candidates]
        smallest = (options.threshold * surface.diagonal) ** 2
        enough = _enough(ground, SHARPEST * radii**2, smallest)
        wanted, targets = np.zeros((2, len(cloud)), bool)
        importance = np.zeros(len(cloud))
        importance[ground.candidates] = ground.importance
        targets[ground.candidates] = True
        wanted[ground.candidates[enough]] = True

        def keep(stages: tuple[int, ...], compute: Callable[[], Any]) -> Any:
            work = functools.partial(run_patiently, compute, progress)
            return kept(grow_graph, ground, stages, work, progress)

        balls = ground.links, ground.components, ground.strength, wanted, ground.handles
        edges, loops = grow_graph(*balls, keep, progress, targets)
        progress.update(0.5)
        given = ground.links, edges, options.smoothing, importance
        graph, node_of_sample = run_patiently(
            lambda: finish_graph(*given, surface.point_areas, smallest), progress
        )
        graph = put_in_surface(cloud, graph, node_of_sample, progress)
        known = ground.measured, ground.candidates, smallest
        sure = run_patiently(lambda: measured_persistence(graph, *known), progress)
        graph = replace(graph, persistence=sure)
        if options.simplify > 0:
            graph = simplify_branches.of(graph, options, progress)
    handles = ground.handles
    candidates, stay = frozen(ground.candidates, np.int32), frozen(enough, np.bool_)
    genus = {number: one.genus for number, one in handles.items()}
    closed = {number: len(turns) for number, turns in loops.items()}
    doubts = (sum(getattr(one, name) for one in handles.values()) for name in ("seams", "unclear"))
    topology = genus, closed, _missing(handles, loops), *doubts
    evidence = CurveEvidence(ground.measured, candidates, ground.importance, stay, *topology)
    of_nodes = run_patiently(
        lambda: node_importance(cloud, graph, ground.candidates, ground.importance), progress
    )
    return replace(graph, importance=of_nodes, evidence=evidence)


def _enough(ground: _Ground, least: FloatArray, smallest: float) -> Mask:
    """Tell the candidates that a graph must reach, in parts of the shape that are large enough."""
    enough = ground.importance >= least
    part = ground.components[ground.candidates]
    large = np.zeros(int(part.max(initial=-1)) + 2, bool)
    large[part[enough & (ground.importance >= smallest)]] = True
    large[-1] = False
    return np.asarray(enough & large[part])


def _missing(handles: dict[int, Handles], loops: Turns) -> tuple[FloatArray, ...]:
    """Return closed lines round the handles that no loop goes round; all where sums hide which."""
    lines: list[FloatArray] = []
    for part, one in handles.items():
        turns = loops.get(part, np.zeros((0, len(one.loops)), np.int64))
        if len(turns) < one.genus:
            alone = np.flatnonzero(~turns.any(axis=0))
            chosen = alone if len(alone) else np.arange(len(one.loops))
            lines += [frozen(one.points[one.loops[place]], np.float64) for place in chosen]
    return tuple(lines)


def _require_whole_cloud(cloud: MedialCloud) -> None:
    if cloud.surface.faces is None:
        raise InvalidShapeError(
            "A curve skeleton from balls needs a mesh, got a point cloud: build a surface with "
            "surface_of_cloud first, or use view_curve_skeleton."
        )
    if not cloud.whole:
        raise InvalidShapeError(
            "A curve skeleton needs the whole inner cloud of its surface, "
            f"{cloud.surface.point_count} rows in their order; got {len(cloud)} rows."
        )
    if not cloud.valid.any():
        raise InvalidShapeError("A curve skeleton needs a ball with two feature points, got none.")


def _ground(cloud: MedialCloud, share: float, progress: Progress) -> _Ground:
    """Find and measure the candidates, link the balls, find the handles."""
    surface = cloud.surface
    level = share * surface.diagonal
    with progress.stage("detect", 0.0, 0.6):
        measured = candidate_measure.of(cloud, Options(), progress)
        candidates = np.flatnonzero(measured.on_curve(level))
    with progress.stage("regularize", 0.6, 0.8):
        importance = smooth_importance(measured, candidates, progress)
    near = _near_balls(measured, candidates, progress)
    links = run_patiently(lambda: _linked(measured, near, level), progress)
    strength = np.where(cloud.valid, np.nan_to_num(measured.measure), -np.inf)
    strength += 1e-9 * links.radii  # without any measure: the largest ball
    components = np.where(cloud.valid & surface.used_points, surface.components, -1)
    handles = run_patiently(lambda: find_handles(surface), progress)
    return _Ground(measured, candidates, importance, links, strength, components, handles)


def _near_balls(measured: CandidateMeasure, candidates: Index, progress: Progress) -> list[Links]:
    """List the nearest others of all balls, and those of candidates among themselves.

    Balls at creases have no measure, and are too small for others to lie in them. Where balls
    between parts have none, all are asked anew.
    """
    from medialis.base.box_tree import nearest_others

    cloud, lists = measured.cloud, [candidates]
    alone = cloud.valid & np.isnan(measured.measure)
    known = [(np.arange(len(cloud)), measured.near)]
    if (cloud.features[alone, 0] != cloud.features[alone, 1]).any():
        known, lists = [], [np.flatnonzero(cloud.valid), candidates]
    found = [nearest_others(cloud.centers[rows], NEIGHBOURS, progress.still)[0] for rows in lists]
    return known + [(rows, rows[near]) for rows, near in zip(lists, found, strict=True)]


def _linked(measured: CandidateMeasure, near: list[Links], level: float) -> BallLinks:
    """Link near balls, and those of neighbouring samples, within each component."""
    cloud, surface = measured.cloud, measured.cloud.surface
    across = _across_creases(cloud)
    needed = [
        (ends[:, 0], ends[:, 1:]) for ends in (surface.edges, cloud.features[cloud.valid], across)
    ]
    closeness = np.maximum(2 * np.nan_to_num(measured.spread) - 1, 0)
    closeness *= np.minimum(1.0, np.nan_to_num(measured.measure) / level)
    balls = np.nan_to_num(cloud.centers), np.nan_to_num(cloud.radii), closeness
    groups, spacing = np.where(cloud.valid, surface.components, -1), surface.spacing
    return link_balls(*balls, near, needed, spacing=spacing, widths=measured.widths, groups=groups)


def _across_creases(cloud: MedialCloud) -> Index:
    """Pair the balls on both sides of convex creases (p, 2).

    A sample on a crease has the ball at its edge, which lies at the surface. Where prisms follow
    each other all that joins two of them may be such samples: the largest ball beside stands for
    each of them, or a graph goes along the surface.
    """
    off = cloud.valid & (cloud.features[:, 0] != cloud.features[:, 1])
    edges = cloud.surface.edges
    edges = edges[~(off[edges[:, 0]] & off[edges[:, 1]])]
    both = np.concatenate([edges, edges[:, ::-1]])
    stands, radii = np.where(off, np.arange(len(cloud)), -1), np.nan_to_num(cloud.radii)
    while True:
        here, there = both[(stands[both[:, 0]] < 0) & (stands[both[:, 1]] >= 0)].T
        if len(here) == 0:
            break
        order = np.argsort(radii[stands[there]], kind="stable")
        stands[here[order]] = stands[there[order]]  # the largest one is the last
    pairs = stands[edges]
    return pairs[(pairs != edges).any(axis=1) & (pairs[:, 0] != pairs[:, 1]) & (pairs[:, 0] >= 0)]


def limb_balls(shape: Shape, options: Preparation, progress: Progress) -> MedialCloud:
    """Return the balls of a mesh whose limbs have enough samples; no option is "auto"."""
    sampled = functools.partial(with_limbs_sampled, progress=progress)
    return _balls(prepared(shape, options, progress, sampled), options, progress)


def _from_shape(shape: Shape, options: CurveSkeletonOptions, progress: Progress) -> CurveSkeleton:
    """Compute the curve skeleton of a mesh, refined where handles have no loop.

    Of several attempts the first one with all loops is returned, else that with the most.
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "A curve skeleton needs a surface with faces, got a point cloud: reconstruct a surface "
            "first, or use view_curve_skeleton, which takes point clouds."
        )
    if by_level_sets(shape, options, progress):
        return _from_level_sets(shape, options, progress)
    with progress.stage("skeleton", 0.0, 0.2):
        cloud = limb_balls(shape, options, progress)
        surface = cloud.surface
    with progress.stage("curve skeleton", 0.2, 0.7):
        best = curve_skeleton.of(cloud, options, progress)
    most = max(MOST_SAMPLES, MOST_GROWTH * cloud.surface.point_count)
    with progress.stage("handles", 0.7, 1.0):
        for attempt in range(ATTEMPTS):
            if not (missing := _evidence(best).missing):
                break
            finer = _finer(surface, missing, EDGES_A_RADIUS * 2**attempt, most, progress)
            if finer is surface:
                break
            surface = finer
            again = curve_skeleton.of(_balls(surface, options, progress.still), options, progress)
            best = max(best, again, key=_closed)
    if best.surface is not None and best.surface is not cloud.surface:
        more = best.surface.point_count - cloud.surface.point_count
        was = counted(more, "sample", verbs=("was", "were"))
        text = f"{was} added where handles are thin, to find their loops."
        progress.note(text, "handles_refined", samples=more)
    return best


def _from_level_sets(
    shape: Shape, options: CurveSkeletonOptions, progress: Progress
) -> CurveSkeleton:
    """Compute the curve skeleton of the shape as it is, but for what was asked to be prepared."""
    asked = {
        "refine": 0.0 if options.refine == AUTO else options.refine,
        "denoise": "off" if options.denoise == "auto" else options.denoise,
    }
    balls = SurfaceSkeletonOptions.taken_from(options, **asked)
    with progress.stage("skeleton", 0.0, 0.3):
        cloud = surface_skeleton.of(shape, balls, progress.still).own
    smallest = 0.0
    if options.threshold != AUTO:
        smallest = (options.threshold * cloud.surface.diagonal) ** 2
    with progress.stage("curve skeleton", 0.3, 1.0):
        graph = level_set_skeleton(cloud, options.smoothing, smallest, progress)
    slender = level_ground(cloud.surface, progress).slenderness
    text = (
        f"All limbs together are {slender:,.0f} times as long as thick: the skeleton follows level "
        "sets, which find limbs however thin they are."
    )
    progress.note(text, "level_sets", slenderness=slender)
    return simplify_branches.of(graph, options, progress) if options.simplify > 0 else graph


def _evidence(graph: CurveSkeleton) -> CurveEvidence:
    assert graph.evidence is not None
    return graph.evidence


def _closed(graph: CurveSkeleton) -> int:
    return sum(_evidence(graph).closed_loops.values())


def _balls(surface: Shape, options: Preparation, progress: Progress) -> MedialCloud:
    """Return the balls of a surface as it is."""
    as_it_is = {"denoise": "off", "refine": 0.0}
    return surface_skeleton.of(
        surface, SurfaceSkeletonOptions.taken_from(options, **as_it_is), progress
    )


def _finer(
    surface: Shape, lines: tuple[FloatArray, ...], across: float, most: int, progress: Progress
) -> Shape:
    """Refine a mesh round lines to a share of the radius that is free inside and outside."""
    finest = DEFAULT_TOLERANCE * surface.diagonal
    both, _ = shrink(surface, ShrinkOptions(side="both"), progress.still)

    def work() -> Shape:
        radii = np.fmin(*np.where(both.valid, both.radii, np.nan).reshape(2, -1))
        allowed = np.full(surface.point_count, np.inf)
        away = kd_tree(np.concatenate(lines)).query(surface.points)[0]
        rows = np.flatnonzero(away <= NEARBY_RADII * radii)
        allowed[rows] = radii[rows] / across
        # Balls tell nothing of what is smaller than the tolerance.
        return refine_where(surface, np.maximum(allowed, finest), most)

    return run_patiently(work, progress)
