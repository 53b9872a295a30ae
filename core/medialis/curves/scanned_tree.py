"""Cylinders of a scanned tree: a quantitative structure model of a cloud of points.

1. `_limbs`: from the root up, a limb is fitted to the points of its sections (`limb_fit.py`).
   Sections beside it that are inside of it, or too short to be limbs, are its own; the others
   begin limbs that grow from it.
2. `_judge`: a radius is measured if a circle fits and its section has about as many points as
   others nearby have for such a radius: scattered points have circles that fit, but too large ones.
3. `_hidden_sides`: a scanner sees one side. What grows from the hidden side has no link to the limb
   that it grows from, so where the radius is known the hidden side is filled with points, and
   sections are computed again. Those points join parts and measure nothing.
4. `_set_radii`: radii that cannot be measured follow the pipe model (Shinozaki et al. 1964): the
   area of a section is proportional to the length of all that grows from it. The factor is the
   median of the measured ones. Radii never grow along a limb, nor from one to the next.
5. `_cylinders`: limbs are cut into cylinders; a branch begins at the surface of its parent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from medialis.base.arrays import (
    Index,
    Mask,
    kd_tree,
    perpendicular,
    places_along,
    rows_at,
    unit_rows,
)
from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray, frozen
from medialis.curves.ground import Ground, find_ground
from medialis.curves.limb_fit import LimbFit, falling, fit_limb, onto, smoothed, weighted_median
from medialis.curves.point_tree import (
    SPACING_RANK,
    WIDTH,
    Directions,
    PointGraph,
    Sections,
    lowest,
    neighbour_graph,
    thinned,
)
from medialis.curves.tree_cylinders import LEAVING, TreeCylinders

MAX_POINTS = 100_000
"""Points beyond which a cloud is thinned: radii of 1,000 limbs with 100 points each."""

EXACT = 1e-6
"""Residuals below this fraction of the size are rounding, not noise."""

MIN_POINTS = 20
"""A tree of fewer points has no section to fit."""

MIN_LENGTH = 1.0
"""Minimum length of a limb beyond the surface of its parent, in widths of a section."""

INSIDE = 2.0, 0.5
"""Distance beyond the surface up to which points belong to a limb: in standard deviations of its
residuals, and in spacings."""

LIMB_POINTS = 3
"""Minimum number of points of a limb without branches: as many as a circle needs."""

AGAIN_POINTS = 50
"""A limb of so many points is fitted again from its new axis though no sections were added."""

APART = 8.0
"""Maximum mean distance of points along a limb without branches, in spacings: strays are farther
apart. So a limb is seen if its radius is more than 1/16 of the spacing."""

DENSE_POINTS, DENSE_WINDOWS = 30, 8
"""Windows with so many points say how dense points are; the nearest ones tell what is usual."""

SPARSE = 4.0
"""Factor by which points may be less dense than usual: what hides a limb also takes points."""

DISTINCT = 16
"""Pieces of axes near a point that are examined for a limb that has the point inside."""

NOISE_POINTS = 15
"""Windows with so many points say what the noise is."""

NOISE_QUANTILE = 0.25
"""The noise is this quantile of the residuals: the others have bark, forks and leaves."""

PIPE = 0.5
"""Exponent of the radius over the length of all that grows from a section (pipe model)."""

FEW = 6
"""Minimum number of measured windows that the factor of the pipe model is taken from."""

EXPLAINED = 3.0, 1.0
"""Distance from the surface of a cylinder up to which a point is explained by it: in standard
deviations of the noise, and in spacings."""


@dataclass(eq=False)
class _Limb:
    """A limb, the limb that it grows from, where on its axis, and its rows of points.

    Of its windows: radii of the limb alone, which ones are measured, the largest radii that the
    number of points allows, the radii of the model, and their relative errors.
    """

    fit: LimbFit
    parent: int
    place: float
    rows: Index
    inner: FloatArray
    known: Mask = field(default_factory=lambda: np.empty(0, bool))
    most: FloatArray = field(default_factory=lambda: np.empty(0))
    radii: FloatArray = field(default_factory=lambda: np.empty(0))
    errors: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def length(self) -> float:
        return max(self.fit.extent[1], 0.0) - min(self.fit.extent[0], 0.0)


@dataclass(frozen=True, eq=False)
class ScannedTree:
    """The model of a scan, and how well it explains its points.

    Attributes
    ----------
    cylinders : TreeCylinders
    points : int
        Number of points that were used, after thinning.
    on_ground : int
        Number of points on the ground, which were left out; 0 without a ground.
    spacing : float
        Median distance of a point to its sixth neighbour.
    noise : float
        Standard deviation of points about well measured sections.
    explained : float
        Fraction of the points that are near the surface of a cylinder.
    measured : float
        Fraction of the length whose radius was measured; the rest follows the pipe model.
    volume_error : float
        Relative error of the volume, were all radii too large or all too small by theirs.
    """

    cylinders: TreeCylinders
    points: int
    on_ground: int
    spacing: float
    noise: float
    explained: float
    measured: float
    volume_error: float


def scanned_tree(
    points: FloatArray, *, up: int = 2, root: FloatArray | None = None, length: float = 3.0
) -> ScannedTree:
    """Fit cylinders to a cloud of points of one tree.

    Parameters
    ----------
    points : (n, 3) float64
        Near the origin. More than 100,000 are thinned.
    up : int
        The axis that points up: the tree begins at its lowest points.
    root : (3,) float64, optional
        Where the tree begins instead.
    length : float
        Length of a cylinder in radii.

    Raises
    ------
    InvalidShapeError
        When the points are too few or have no extent.

    Notes
    -----
    Cost: O(n log n) for n points up to 100,000.
    Source: not in the thesis. Level sets of the geodesic distance: Xu, Gossett and Chen 2007;
    cylinders from robust fits with a taper: TreeQSM (Raumonen et al. 2013).
    """
    points = np.unique(points, axis=0)
    size = float(np.ptp(points, axis=0).max(initial=0.0))
    if len(points) < MIN_POINTS or size == 0.0:
        raise InvalidShapeError(
            f"Cylinders of a tree need at least {MIN_POINTS} distinct points, got {len(points)}."
        )
    count = len(points)
    points, ground = _without_ground(points, up)
    on_ground = count - len(points)
    points = points[thinned(points, MAX_POINTS)]
    floor, real = EXACT * size, np.ones(len(points), bool)
    graph = neighbour_graph(points)
    spacing = float(np.median(graph.spacing))
    limbs = _limbs(graph, _base(graph, up, root), real, spacing, floor)
    noise = _noise(limbs, floor)
    _judge(limbs, noise)
    hidden = _hidden_sides(limbs, points, spacing)
    real = np.concatenate([real, np.zeros(len(hidden), bool)])
    every = np.concatenate([points, hidden])
    graph = neighbour_graph(every, _directions(limbs, every))
    limbs = _limbs(graph, _base(graph, up, root), real, spacing, floor)
    noise = _noise(limbs, floor)
    limbs = _distinct(limbs, points, noise, spacing)
    _judge(limbs, noise)
    measured = _set_radii(limbs, WIDTH * spacing, noise)
    if ground is not None and root is None:
        _grounded(limbs[0], ground)
    explained = _explained(limbs, points, EXPLAINED[0] * noise + EXPLAINED[1] * spacing)
    cylinders = _cylinders(limbs, length, WIDTH * spacing)
    quality = noise, explained, measured, _volume_error(limbs)
    return ScannedTree(cylinders, len(points), on_ground, spacing, *quality)


def _without_ground(points: FloatArray, up: int) -> tuple[FloatArray, Ground | None]:
    """Return the points above the ground, and the ground; all and None without one."""
    coarse = points[thinned(points, MAX_POINTS)]
    away = kd_tree(coarse).query(coarse, k=min(SPACING_RANK + 1, len(coarse)))[0][:, -1]
    ground = find_ground(coarse, up, float(np.median(away)))
    if ground is None:
        return points, None
    above = points[np.logical_not(ground.holds(points))]
    above = above[np.logical_not(ground.low_parts(above))]
    if len(above) < MIN_POINTS:
        raise InvalidShapeError("The cloud has a ground, and less than 20 points above it.")
    return above, ground


def _grounded(trunk: _Limb, ground: Ground) -> None:
    """Let the trunk go down to the ground."""
    fit = trunk.fit
    foot = fit.axis[:1]
    gap = float(foot[0, ground.up] - ground.under(foot)[0])
    way = unit_rows(fit.axis[-1:] - foot)[0]
    down = gap / max(abs(float(way[ground.up])), 0.5)
    trunk.fit = replace(fit, extent=(min(fit.extent[0], -max(down, 0.0)), fit.extent[1]))


def _base(graph: PointGraph, up: int, root: FloatArray | None) -> Index:
    spacing = float(np.median(graph.spacing))
    if root is None:
        return np.flatnonzero(lowest(graph.points, up, spacing))
    away = np.linalg.norm(graph.points - root, axis=1)
    return np.flatnonzero(away <= away.min() + 2.0 * spacing)


def _limbs(graph: PointGraph, base: Index, real: Mask, spacing: float, floor: float) -> list[_Limb]:
    """Return the limbs, each after the one that it grows from."""
    sections = Sections.of(graph, base, WIDTH * spacing)
    limbs: list[_Limb] = []
    waiting: list[tuple[int, int, float, FloatArray]] = [
        (sections.root(), -1, 0.0, np.empty((0, 3)))
    ]
    while len(limbs) < len(waiting):
        section, parent, place, start = waiting[len(limbs)]
        limb, others = _limb(graph, sections, section, start, real, spacing, floor)
        limb.parent, limb.place = parent, place
        waiting += [(c, len(limbs), *_leaves(limb, sections.centers[c])) for c in others]
        limbs.append(limb)
    return limbs


def _leaves(limb: _Limb, center: FloatArray) -> tuple[float, FloatArray]:
    """Return where on a limb another one begins whose first section has a center (3,)."""
    fit = limb.fit
    place = float(np.clip(onto(center[None], fit.axis)[0][0], 0.0, fit.along[-1]))
    foot = rows_at(place, fit.along, fit.axis)
    away, radius = float(np.linalg.norm(center - foot)), np.interp(place, fit.at, limb.inner)
    outside = [foot + (center - foot) * radius / away] if away > radius else []
    return place, np.array(outside).reshape(-1, 3)


def _limb(
    graph: PointGraph,
    sections: Sections,
    section: int,
    start: FloatArray,
    real: Mask,
    spacing: float,
    floor: float,
) -> tuple[_Limb, list[int]]:
    """Return the limb that begins with a section, and the sections that begin others."""
    path, width = sections.path(section), sections.width
    axis = np.concatenate([start, sections.centers[path]])
    if len(axis) == 1:
        away = graph.points[sections.rows[section]] - axis
        way = np.linalg.svd(away, full_matrices=False)[2][0]
        axis = axis + np.outer([-0.5 * width, 0.5 * width], way)
    axis = smoothed(axis, np.full(len(axis), width))
    following = sorted({c for s in path for c in sections.children[s]} - set(path))
    own: list[int] = []
    others: list[int] = []
    for _ in range(2):
        rows = sections.rows.joined([*path, *own])
        fitted = rows[real[rows]]
        fit = fit_limb(graph.points[fitted if len(fitted) else rows], axis, width, floor)
        inner = fit.profile()
        own, others = _taken(graph, sections, following, fit, inner, spacing)
        if not own and len(fitted) < AGAIN_POINTS:
            break
        axis = fit.axis
    return _Limb(fit, -1, 0.0, fitted.astype(np.int64), inner), others


def _taken(
    graph: PointGraph,
    sections: Sections,
    following: list[int],
    fit: LimbFit,
    inner: FloatArray,
    spacing: float,
) -> tuple[list[int], list[int]]:
    """Return the sections beside a limb that belong to it, and those that begin others."""
    noise = fit.noise[np.isfinite(fit.noise)]
    margin = max(INSIDE[0] * float(np.median(noise)) if len(noise) else 0.0, INSIDE[1] * spacing)
    taken, others = [], []
    while following:
        rows = sections.rows.joined(following)
        place, away = onto(graph.points[rows], fit.axis)
        beyond = np.maximum(np.maximum(place - fit.along[-1], -place), 0.0)
        over = np.hypot(away, beyond) - np.interp(place, fit.at, inner)
        cuts = np.cumsum(sections.rows.lengths[following])[:-1]
        after: list[int] = []
        for s, part in zip(following, np.split(over, cuts), strict=True):
            height = max(float(np.median(part)), 0.0)
            short = sections.reach[s] - sections.begin[s] + height < MIN_LENGTH * sections.width
            if short or height <= margin:
                taken.append(s)
                after += sections.children[s]
            else:
                others.append(s)
        following = after
    return taken, sorted(others, key=lambda s: float(sections.begin[s]))


def _noise(limbs: list[_Limb], floor: float) -> float:
    """Return the standard deviation of points about well measured sections."""
    found = [
        limb.fit.noise[(limb.fit.inliers >= NOISE_POINTS) & (limb.fit.errors < 0.1)]
        for limb in limbs
    ]
    every = np.concatenate(found)
    return float(np.quantile(every, NOISE_QUANTILE)) if len(every) else floor


def _judge(limbs: list[_Limb], noise: float) -> None:
    """Set which radii are measured, and the maximum radii that the number of points allows.

    A section that is seen has points in proportion to its radius and its length. A circle through
    a few scattered points may fit them well, but it would have many more.
    """
    places, usual = _dense_windows(limbs, noise)
    tree = kd_tree(places) if len(places) >= DENSE_WINDOWS else None
    for limb in limbs:
        fit = limb.fit
        limb.most = np.full(len(fit.at), np.inf)
        if tree is not None:
            rows = tree.query(fit.middles(), k=DENSE_WINDOWS)[1]
            lengths = np.maximum(fit.lengths, 1e-300)
            limb.most = SPARSE * fit.points / (lengths * np.median(usual[rows], axis=1))
        limb.known = fit.measured(noise) & (np.nan_to_num(fit.radii) <= limb.most)


def _dense_windows(limbs: list[_Limb], noise: float) -> tuple[FloatArray, FloatArray]:
    """Return where windows of many points are, (m, 3), and their points per radius and length."""
    places, densities = [np.empty((0, 3))], [np.empty(0)]
    for limb in limbs:
        fit = limb.fit
        dense = fit.measured(noise) & (fit.inliers >= DENSE_POINTS)
        places.append(fit.middles()[dense])
        densities.append(fit.inliers[dense] / (fit.radii[dense] * fit.lengths[dense]))
    return np.concatenate(places), np.concatenate(densities)


def _hidden_sides(limbs: list[_Limb], points: FloatArray, spacing: float) -> FloatArray:
    """Return points on the sides of measured limbs that no scanner saw, (k, 3)."""
    rings = [np.empty((0, 3))]
    for limb in limbs:
        fit = limb.fit
        thick = limb.known & (fit.radii > spacing)
        bounds = np.concatenate([fit.at[:1], 0.5 * (fit.at[1:] + fit.at[:-1]), fit.at[-1:]])
        for k in np.flatnonzero(thick).tolist():
            low, high = np.clip(bounds[k : k + 2], 0.0, fit.along[-1])
            places = np.linspace(low, high, 1 + max(1, math.ceil((high - low) / spacing)))
            middle = rows_at(places, fit.along, fit.axis)
            way = unit_rows(middle[-1] - middle[0])
            u = perpendicular(way)
            turn = np.linspace(0.0, 2.0 * np.pi, math.ceil(2.0 * np.pi * fit.radii[k] / spacing))
            ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * np.cross(way, u)
            rings.append((middle[:, None] + fit.radii[k] * ring).reshape(-1, 3))
    every = np.concatenate(rings)
    away = kd_tree(points).query(every)[0] if len(every) else np.empty(0)
    return every[away > spacing]


def _distinct(limbs: list[_Limb], points: FloatArray, noise: float, spacing: float) -> list[_Limb]:
    """Return the limbs without tips that are strays, or mostly inside of another limb."""
    middles = [0.5 * (limb.fit.axis[1:] + limb.fit.axis[:-1]) for limb in limbs]
    along = [0.5 * (limb.fit.along[1:] + limb.fit.along[:-1]) for limb in limbs]
    radii = np.concatenate([
        np.interp(at, limb.fit.at, limb.inner) for at, limb in zip(along, limbs, strict=True)
    ])  # fmt: skip
    number = np.repeat(np.arange(len(limbs)), [len(one) for one in middles])
    tree, margin = kd_tree(np.concatenate(middles)), INSIDE[0] * noise + INSIDE[1] * spacing
    kept = np.ones(len(limbs), bool)
    carrying = np.zeros(len(limbs), bool)
    for k in range(len(limbs) - 1, 0, -1):
        limb = limbs[k]
        if not carrying[k]:
            inside = len(limb.rows) < max(LIMB_POINTS, limb.length / (APART * spacing))
            if not inside:
                away, rows = tree.query(points[limb.rows], k=min(DISTINCT, len(radii)))
                other = (number[rows] != k) & (away <= radii[rows] + margin)
                inside = float(other.any(axis=1).mean()) > 0.5
            kept[k] = not inside
        carrying[limb.parent] |= kept[k]
    new = np.cumsum(kept) - 1
    for limb in limbs[1:]:
        limb.parent = int(new[limb.parent])
    return [limb for limb, one in zip(limbs, kept, strict=True) if one]


def _directions(limbs: list[_Limb], points: FloatArray) -> Directions:
    """Return direction and radius of the limb that each point is nearest to."""
    middles, ways, radii = [], [], []
    for limb in limbs:
        fit = limb.fit
        middles.append(0.5 * (fit.axis[1:] + fit.axis[:-1]))
        ways.append(unit_rows(np.diff(fit.axis, axis=0)))
        measured = np.where(limb.known, fit.radii, np.minimum(fit.distance, limb.inner))
        radii.append(np.interp(0.5 * (fit.along[1:] + fit.along[:-1]), fit.at, measured))
    every = np.concatenate(radii)
    away, rows = kd_tree(np.concatenate(middles)).query(points, k=min(4, len(every)))
    rows = rows.reshape(len(points), -1)
    surface = np.abs(away.reshape(rows.shape) - every[rows])
    nearest = rows[np.arange(len(points)), surface.argmin(axis=1)]
    return Directions(np.concatenate(ways)[nearest], every[nearest])


def _set_radii(limbs: list[_Limb], width: float, noise: float) -> float:
    """Set the radii of all limbs at their windows; return the measured fraction of the length."""
    carried = _carried(limbs, width)
    measured = [limb.known for limb in limbs]
    weights = [limb.fit.weights(noise) for limb in limbs]
    level, scatter = _pipe_model(
        np.concatenate([limb.fit.radii[m] for limb, m in zip(limbs, measured, strict=True)]),
        np.concatenate([one[m] for one, m in zip(carried, measured, strict=True)]),
        np.concatenate([one[m] for one, m in zip(weights, measured, strict=True)]),
        0.5 * width,
    )
    shares = []
    for limb, known, above, weight in zip(limbs, measured, carried, weights, strict=True):
        model = np.minimum(np.exp(level + PIPE * np.log(above)), limb.most)
        radii = falling(
            np.where(known, limb.fit.radii, model), np.where(known, weight, scatter**-2.0)
        )
        if limb.parent >= 0:
            parent = limbs[limb.parent]
            radii = np.minimum(radii, np.interp(limb.place, parent.fit.at, parent.radii))
        limb.radii = radii
        limb.errors = np.where(known, np.hypot(limb.fit.errors, limb.fit.noise / radii), scatter)
        shares.append((limb.length, float(known.mean())))
    total, part = np.array(shares).T
    return float(total @ part / total.sum())


def _volume_error(limbs: list[_Limb]) -> float:
    """Return the relative error of the volume, were all radii too large or all too small."""
    radii = np.concatenate([limb.radii for limb in limbs])
    errors = np.concatenate([limb.errors for limb in limbs])
    volumes = radii**2 * np.concatenate([limb.fit.lengths for limb in limbs])
    return float(2.0 * errors @ volumes / volumes.sum())


def _carried(limbs: list[_Limb], width: float) -> list[FloatArray]:
    """Return the length of all that grows from each window of each limb, and the limb's own."""
    total = np.array([limb.length for limb in limbs])
    result: list[FloatArray] = [np.empty(0)] * len(limbs)
    growing: list[list[int]] = [[] for _ in limbs]
    for number in range(len(limbs) - 1, -1, -1):
        limb = limbs[number]
        places = np.array([limbs[c].place for c in growing[number]])
        lengths = np.array([total[c] for c in growing[number]])
        beyond = places[None, :] >= limb.fit.at[:, None]
        own = limb.fit.extent[1] - limb.fit.at
        result[number] = np.maximum(own + beyond @ lengths, 0.5 * width)
        total[number] += lengths.sum()
        if limb.parent >= 0:
            growing[limb.parent].append(number)
    return result


def _pipe_model(
    radii: FloatArray, carried: FloatArray, weights: FloatArray, guess: float
) -> tuple[float, float]:
    """Return the logarithm of the factor of the pipe model, and the scatter of radii about it.

    Thin sections are measured only where they are thicker than others, so those count alone whose
    radius by the model is twice the smallest ones that could be measured.
    """
    if len(radii) < FEW:
        known = float(np.median(np.log(radii) - PIPE * np.log(carried))) if len(radii) else None
        return (math.log(guess) if known is None else known), 1.0
    factors, counted = np.log(radii) - PIPE * np.log(carried), np.ones(len(radii), bool)
    least = 2.0 * float(np.quantile(radii, 0.05))
    for _ in range(10):
        level = weighted_median(factors[counted], weights[counted])
        thick = math.exp(level) * carried**PIPE > least
        if thick.sum() < FEW or np.array_equal(thick, counted):
            break
        counted = thick
    scatter = 1.4826 * float(np.median(np.abs(factors[counted] - level)))
    return level, max(scatter, 0.05)


def _explained(limbs: list[_Limb], points: FloatArray, margin: float) -> float:
    """Return the fraction of points that are near the surface of a limb, or inside of one."""
    explained = np.zeros(len(points), bool)
    for limb in limbs:
        rows = limb.rows
        place, away = onto(points[rows], limb.fit.axis)
        explained[rows] |= away <= np.interp(place, limb.fit.at, limb.radii) + margin
    return float(explained.mean())


@dataclass(frozen=True, eq=False)
class _Cut:
    """A limb cut into cylinders: its axis from its parent's surface on, and the bounds along it."""

    axis: FloatArray
    along: FloatArray
    bounds: FloatArray
    radii: FloatArray
    measured: FloatArray
    first: int

    def ends(self) -> FloatArray:
        """Return the axis at the bounds, straight on beyond its ends."""
        inside = np.clip(self.bounds, 0.0, self.along[-1])
        over = self.bounds - inside
        ways = unit_rows(np.stack([self.axis[1] - self.axis[0], self.axis[-1] - self.axis[-2]]))
        straight = np.where(over[:, None] < 0, ways[0], ways[1])
        return np.asarray(rows_at(inside, self.along, self.axis) + over[:, None] * straight)


def _cut(limb: _Limb, parent: _Limb | None, length: float, width: float, first: int) -> _Cut:
    """Cut a limb into cylinders as long as so many radii, and not shorter than half a section."""
    fit, axis, at = limb.fit, limb.fit.axis, limb.fit.at
    begin, end = min(fit.extent[0], 0.0), max(fit.extent[1], fit.along[-1])
    if parent is not None:
        place, away = onto(axis, parent.fit.axis)
        last = max(parent.fit.extent[1], parent.fit.along[-1])  # it ends there: no tube goes on
        over = np.maximum(away - np.interp(place, parent.fit.at, parent.radii), place - last)
        out = int(np.argmax(over > 0)) if (over > 0).any() else len(axis) // 2
        if out > 0:
            begin = float(np.interp(0.0, over[out - 1 : out + 1], fit.along[out - 1 : out + 1]))
        else:
            foot = rows_at(np.clip(place[0], 0.0, parent.fit.along[-1]), parent.fit.along,
                           parent.fit.axis)  # fmt: skip
            gap = float(np.linalg.norm(axis[0] - foot))
            added = max(gap - (away[0] - over[0]), 0.0)
            if added > 1e-9 * width:
                axis = np.concatenate([[foot + (axis[0] - foot) * (1 - added / gap)], axis])
                at, end = at + added, end + added
            begin = 0.0
    along = places_along(axis)
    end = max(end, begin + 1e-3 * width)
    fine = np.linspace(begin, end, 4 * len(axis) + 1)
    middle = 0.5 * (fine[1:] + fine[:-1])
    count = np.concatenate([[0.0], np.cumsum(
        np.diff(fine) / np.maximum(length * np.interp(middle, at, limb.radii), 0.5 * width)
    )])  # fmt: skip
    pieces = max(1, round(float(count[-1])))
    bounds = np.interp(np.linspace(0.0, count[-1], pieces + 1), count, fine)
    inner = bounds[:-1, None] + np.diff(bounds)[:, None] * np.linspace(0.05, 0.95, 10)
    radii = np.sqrt((np.interp(inner, at, limb.radii) ** 2).mean(axis=1))
    raw = np.where(np.isfinite(fit.radii), fit.radii, limb.radii)
    measured = np.interp(0.5 * (bounds[1:] + bounds[:-1]), at, raw)
    return _Cut(axis, along, bounds, radii, measured, first)


def _cylinders(limbs: list[_Limb], length: float, width: float) -> TreeCylinders:
    """Cut all limbs into cylinders."""
    cuts: list[_Cut] = []
    parents: list[Index] = []
    orders: list[int] = []
    leaving: list[FloatArray] = []
    for limb in limbs:
        parent = limbs[limb.parent] if limb.parent >= 0 else None
        first = cuts[-1].first + len(cuts[-1].radii) if cuts else 0
        cut = _cut(limb, parent, length, width, first)
        row, order = -1, 0
        if parent is not None:
            before = cuts[limb.parent]
            at = float(onto(cut.axis[:1], before.axis)[0][0])
            row = int(np.searchsorted(before.bounds, at, side="right")) - 1
            row = before.first + min(max(row, 0), len(before.radii) - 1)
            order = orders[limb.parent] + 1
        cuts.append(cut)
        orders.append(order)
        parents.append(np.concatenate([[row], first + np.arange(len(cut.radii) - 1)]))
        reach = np.maximum(np.array(LEAVING) * cut.radii[0], [0.0, width]) + cut.bounds[0]
        leaving.append(np.diff(rows_at(np.minimum(reach, cut.bounds[-1]), cut.along, cut.axis),
                               axis=0)[0])  # fmt: skip
    ends = [cut.ends() for cut in cuts]
    branches = np.repeat(np.arange(len(cuts)), [len(cut.radii) for cut in cuts])
    return TreeCylinders(
        frozen(np.concatenate([one[:-1] for one in ends]), np.float64),
        frozen(np.concatenate([one[1:] for one in ends]), np.float64),
        frozen(np.concatenate([cut.radii for cut in cuts]), np.float64),
        frozen(np.concatenate([cut.measured for cut in cuts]), np.float64),
        frozen(np.concatenate(parents), np.int32),
        frozen(branches, np.int32),
        frozen(np.array(orders)[branches], np.int32),
        frozen(unit_rows(np.array(leaving)), np.float64),
        0,
    )
