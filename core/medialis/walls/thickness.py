"""Feature transform and its inverse: fields from the skeleton to the surface and back (3.5.1).

Every valid ball touches two samples (the feature transform); a sample is touched by any number of
balls, at least by its own (the inverse, `MedialCloud.inverse_features`). So a value of each ball
becomes a field on the surface by reducing over the balls that touch a sample, and a field on the
surface becomes a value of each ball by reducing over its two feature points.

A field that is known at some samples, continued over the rest of a surface (for thesis 3.5.1).

Every other sample of a mesh starts with the value of the nearest one along the edges. Then they
become the geometric mean of their neighbours, as far as a fixed number of steps carries. Where less
is known than before, only what took its values from there is continued anew.

Thickness of the wall behind every point of the surface (thesis 3.5.1, Figure 3.11).

Each sample touches the largest ball that fits inside the shape there. Where the ball lies between
two walls, its diameter is what a caliper measures. Near a convex edge or on a bump the largest ball
is small because of the edge, not because the shape is thin: its two feature points lie on the same
side, seen under a small spoke angle. Such balls are left out, and their samples take the thickness
of the wall that they belong to: that of the nearest reliable sample along the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.arrays import Described, Index, Mask, Ragged, kd_tree
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import Options, algorithm, angle, choice
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray, as_choice, as_field, frozen
from medialis.shape.graph import mesh_graph, nearest_seeds
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import MedialCloud
from medialis.skeleton.surface_skeleton import as_cloud

Reduce = Literal["min", "max", "mean"]
REDUCTIONS = ("min", "max", "mean")


def feature_transform(cloud: MedialCloud) -> IntArray:
    """Return the two samples that each ball touches.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.

    Returns
    -------
    (k, 2) int32
        Indices into the samples; both are -1 for a masked ball.

    See Also
    --------
    field_on_surface, field_on_skeleton : values either way.

    Notes
    -----
    The inverse is `MedialCloud.inverse_features`. Source: thesis 3.5.1.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> features = medialis.feature_transform(cloud)
    >>> touching = cloud.inverse_features
    >>> pairs = [(ball, sample) for ball in range(9) for sample in features[ball] if sample >= 0]
    >>> all(ball in touching[sample] for ball, sample in pairs)
    True
    """
    return frozen(np.where(cloud.valid[:, None], cloud.features, -1), np.int32)


def field_on_surface(
    cloud: MedialCloud, values: ArrayLike, *, reduce: Reduce = "max"
) -> FloatArray:
    """Carry a value of each ball to the samples that the balls touch.

    Parameters
    ----------
    cloud : MedialCloud
        k balls on n samples. Masked balls touch nothing.
    values : (k,) float
        One value a ball; NaN takes no part.
    reduce : {"max", "min", "mean"}
        What a sample gets that several balls touch. With the maximum, small balls of bumps near a
        sample do not hide the value of its wall.

    Returns
    -------
    (n,) float64
        NaN where no ball (with a value) touches.

    Raises
    ------
    InvalidShapeError
        When there is not one value a ball.
    InvalidOptionError
        For an unknown reduction.

    See Also
    --------
    field_on_skeleton : the other direction.
    thickness : the radii on the surface, without those of edges and bumps.

    Notes
    -----
    Cost O(k + n), 2 ms for 200,000 balls. Source: thesis 3.5.1, Figure 3.11.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> field = medialis.field_on_surface(cloud, cloud.radii)
    >>> bool((field[cloud.source] >= cloud.radii)[cloud.valid].all())
    True
    """
    from medialis.walls._kernels import MAXIMUM, MINIMUM, SUM, gather_at_features

    how = {"min": MINIMUM, "max": MAXIMUM, "mean": SUM}[as_choice(reduce, "reduce", REDUCTIONS)]
    field, count = as_field(values, len(cloud), "values"), cloud.surface.point_count
    out, counts = np.full(count, np.nan), np.zeros(count, np.int32)
    gather_at_features(feature_transform(cloud), field, how, out, counts)
    if reduce == "mean":
        out /= np.maximum(counts, 1)
    return out


def field_on_skeleton(
    cloud: MedialCloud, field: ArrayLike, *, reduce: Reduce = "mean"
) -> FloatArray:
    """Carry a field on the surface to the balls, from the two places that each touches.

    Parameters
    ----------
    cloud : MedialCloud
        k balls on n samples.
    field : (n,) float
        One value a sample of ``cloud.surface``; NaN takes no part.
    reduce : {"mean", "min", "max"}

    Returns
    -------
    (k,) float64
        NaN for masked balls and where neither contact has a value. Between the corners of a face
        the field is interpolated.

    Raises
    ------
    InvalidShapeError
        When there is not one number a sample.
    InvalidOptionError
        For an unknown reduction.

    See Also
    --------
    field_on_surface : the other direction.

    Notes
    -----
    Cost O(k). Source: thesis 3.5.1.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> height = medialis.field_on_skeleton(cloud, cloud.surface.points[:, 2])
    >>> above = abs(height - cloud.centers[:, 2])[cloud.valid]
    >>> bool((above <= cloud.radii[cloud.valid] + 1e-3 * cloud.surface.diagonal).all())
    True
    """
    reduce = as_choice(reduce, "reduce", REDUCTIONS)  # type: ignore[assignment]
    values = as_field(field, cloud.surface.point_count, "field")
    both = np.full((2, len(cloud)), np.nan)
    both[:, cloud.valid] = values[cloud.features[cloud.valid].T]
    between = cloud.valid & (cloud.contact_faces >= 0)
    if cloud.surface.faces is not None and between.any():
        corners = values[cloud.surface.faces[cloud.contact_faces[between]]]
        both[1, between] = np.einsum("ij,ij->i", cloud.contact_weights[between], corners)
    if reduce != "mean":
        return np.fmin(*both) if reduce == "min" else np.fmax(*both)
    first, second = np.where(np.isnan(both), both[::-1], both)  # one NaN: the other one alone
    return 0.5 * first + 0.5 * second  # halves: the sum of two large values would overflow


SMOOTHING_STEPS, SMOOTHING_ACCURACY = 40, 1e-3  # halved 16 %, doubled 0 %; halved 22 %, doubled 9 %
"""Steps at most, and residual relative to the start. On horse2, 40 steps (60 ms) look the same as
400; the transition is then up to 40 edges wide."""


@dataclass(frozen=True, eq=False, repr=False)
class CompletedField(Described):
    """A field with a value at each of the n samples of a surface.

    Attributes
    ----------
    surface : Shape
    known : (n,) float64
        What it was completed from, NaN elsewhere.
    values : (n,) float64
    seed : (n,) int32
        The known sample that is nearest along the edges, -1 where there is none.
    distance : (n,) float64
        Its distance along the edges.
    lent : (n,) bool
        Known samples of components that have no values of their own.
    """

    surface: Shape
    known: FloatArray
    values: FloatArray
    seed: IntArray
    distance: FloatArray
    lent: Mask


def complete(surface: Shape, other: FloatArray, known: FloatArray) -> CompletedField:
    """Give a value to every sample.

    `known` (n,) is the field, NaN where it is not known; where a component of a mesh has no known
    value, the largest of `other` (n,) there counts as known.
    """
    n, missing = surface.point_count, np.isnan(known)
    if surface.faces is None or not missing.any():
        values = known.copy()
        if missing.all():
            values[np.nanargmax(other)] = np.nanmax(other)
        _nearest_in_space(surface, values)
        every, none = np.arange(n, dtype=np.int32), np.zeros(n, np.bool_)
        return CompletedField(surface, known, values, every, np.zeros(n), none)
    graph = mesh_graph(surface.faces, missing)
    seed, distance = nearest_seeds(surface.points, graph, ~missing)
    if (seed < 0).any():
        known = _with_other_components(surface, other, known, seed)
        seed, distance = nearest_seeds(surface.points, graph, ~np.isnan(known))
    values = np.where(seed >= 0, known[seed], known)
    _smooth(np.flatnonzero(missing & (seed >= 0)), values, known, graph)
    _nearest_in_space(surface, values)
    return CompletedField(surface, known, values, seed, distance, missing & ~np.isnan(known))


def complete_again(before: CompletedField, other: FloatArray, known: FloatArray) -> CompletedField:
    """Return `complete` of a field that is known at fewer samples than before, or is lower there.

    What is more than `SMOOTHING_STEPS` edges from all samples that change keeps its value.
    """
    from medialis.shape._kernels import spread_again

    surface = before.surface
    if surface.faces is None:
        return complete(surface, other, known)
    # What was lent stays as long as it is there.
    lent = before.lent & ~np.isnan(other)
    known = np.where(lent, other, known)
    missing = np.isnan(known)
    lost = missing & ~np.isnan(before.known)
    changed = np.flatnonzero(lost | (known < before.known))
    if len(changed) == 0:
        return before
    seed, distance = before.seed.copy(), before.distance.copy()
    seed[changed] = np.where(missing[changed], seed[changed], changed)
    cut = (seed >= 0) & lost[seed]
    rows = np.flatnonzero(cut)
    near = _rings(surface, cut, missing, np.union1d(changed, rows))
    graph = mesh_graph(surface.faces, near)
    seed[rows], distance[rows] = -1, np.inf
    spread_again(rows, cut, surface.points, graph.offsets, graph.indices, distance, seed)
    if (seed[rows] < 0).any():
        return complete(surface, other, known)
    values = np.where(missing, before.values, known)
    values[rows] = known[seed[rows]]
    values[seed < 0] = np.nan
    _smooth(np.flatnonzero(near & missing), values, known, graph)
    _nearest_in_space(surface, values)
    return CompletedField(surface, known, values, seed, distance, lent)


def _rings(surface: Shape, inside: Mask, free: Mask, starts: Index) -> Mask:
    """Return what is inside, and the free samples as many edges from the starts as steps carry."""
    faces = np.asarray(surface.faces)
    result = inside.copy()
    for _ in range(SMOOTHING_STEPS):
        around = np.unique(faces[surface.fans.joined(starts) // 3])
        starts = around[free[around] & ~result[around]]
        if len(starts) == 0:
            break
        result[starts] = True
    return result


def _with_other_components(
    surface: Shape, other: FloatArray, known: FloatArray, seed: IntArray
) -> FloatArray:
    """Return what is known, and the largest other value of each component without a seed."""
    rows = np.flatnonzero((seed < 0) & ~np.isnan(other))
    part = surface.components[rows]
    order = np.lexsort((rows, -other[rows], part))  # ties: the lowest index
    first = order[np.flatnonzero(np.diff(part[order], prepend=-1))]
    result = known.copy()
    result[rows[first]] = other[rows[first]]
    return result


def _smooth(rows: Index, values: FloatArray, known: FloatArray, graph: Ragged) -> None:
    """Replace the steps between nearest values by a smooth transition, in place.

    Of logarithms: what few steps leave undone is a share of the value then, also in a thin fin on a
    thick base.
    """
    from medialis.shape._kernels import make_harmonic

    low, high = np.nanmin(known), np.nanmax(known)
    steps, accuracy = SMOOTHING_STEPS, SMOOTHING_ACCURACY
    logarithms = np.log(values / high)
    make_harmonic(rows, graph.offsets, graph.indices, steps, accuracy, logarithms)
    # What few steps may overshoot.
    values[rows] = np.clip(high * np.exp(logarithms[rows]), low, high)


def _nearest_in_space(surface: Shape, values: FloatArray) -> None:
    """Give samples without a value the nearest one in space, in place."""
    missing = np.isnan(values)
    known = np.flatnonzero(~missing)
    if len(known) < len(values):
        nearest = kd_tree(surface.points[known]).query(surface.points[missing])[1]
        values[missing] = values[known[nearest]]


ThicknessKind = Literal["diameter", "radius"]

WALL_ANGLE = 120.0  # halved 100 %, doubled 100 %
"""Degrees. The spoke angle of a ball in a wedge whose faces enclose the angle phi is pi - phi: 180
degrees between parallel walls, 150 in a blade of 30, 90 along the edges of a box. 120 lets walls
taper by 60 degrees, and leaves out every convex edge of up to 60 + 60 = 120 degrees between its
faces, those of a box with 30 degrees to spare for samples: at the distance d from a right edge, the
ball that touches the other face at the depth k d has the spoke angle 2 atan k, and the smallest of
these balls (k nearest to 1) exceeds 120 degrees only if no sample lies at depths from d / sqrt 3 to
d sqrt 3, so only closer to the edge than 0.87 sample spacings. There the normals still tell: see
`MedialCloud.wall_angles`. Measured: on the hand, the rim of the cut wrist (80 degrees) is a false
alarm of 1/9 of the wrist's thickness at 100 degrees, and gone at 120; on fandisk, all edges are.
17 % (horse2) to 61 % (scapula, a bone plate) of the balls remain."""


@dataclass(frozen=True, kw_only=True)
class ThicknessOptions(Options):
    """Options of `thickness`."""

    kind: ThicknessKind = choice(
        "diameter",
        "Measure",
        "What is measured of the ball in the wall.",
        {
            "diameter": "The diameter of the ball, as a caliper measures the wall.",
            "radius": "The radius of the ball, half of the wall.",
        },
    )
    min_spoke_angle: float = angle(
        WALL_ANGLE,
        "Wall angle",
        "Balls whose two feature points are closer together than this, seen from the center, "
        "belong to edges and bumps, not to walls, and are left out. 0 uses all balls.",
        advanced=True,
    )

    @property
    def share(self) -> float:
        """What is measured, as a share of the diameter."""
        return 1.0 if self.kind == "diameter" else 0.5


@algorithm(ThicknessOptions, door=as_cloud)
def thickness(cloud: MedialCloud, options: ThicknessOptions, progress: Progress) -> FloatArray:
    """Return the thickness of the shape at every point of its surface.

    Parameters
    ----------
    cloud : MedialCloud
        Balls on n samples; outer ones (side -1) take no part.

    Returns
    -------
    (n,) float64
        In the units of the shape, above 0, finite everywhere: one value for each sample of
        ``cloud.surface``, whose first points are those of the shape that was given.

    Raises
    ------
    InvalidShapeError
        When no inner ball is valid.

    See Also
    --------
    thin_spots : the thinnest places, one entry for each place.

    Notes
    -----
    1. A sample whose own ball is reliable (`MedialCloud.wall_angles` at least `min_spoke_angle`)
       has the size of that ball; else one that reliable balls of other samples touch has the size
       of the largest of them (the inverse feature transform).
    2. Every other sample of a mesh starts with the value of the nearest one along the edges. Then
       all of them become the geometric mean of their neighbours, as far as a fixed number of steps
       carries: a smooth transition, never below the smallest or above the largest reliable value.
    3. A component without a reliable ball has the size of its largest ball everywhere (a cube: its
       inscribed ball); one without any ball has the values nearest in space.

    Samples without faces take the value nearest in space. A wall is seen only where the samples are
    closer together than it is thick: refine first (the operation `thickness` does).

    Cost O(n log n); 0.16 s for 194,000 vertices, of which 160,000 are filled in. Source: thesis
    3.5.1, Figure 3.11. Deviates: the thesis shows the radius of every ball, edges and noise
    included.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> values = medialis.thickness(cloud)
    >>> raw = medialis.thickness(cloud, min_spoke_angle=0)
    >>> bool((raw == 2 * cloud.radii)[cloud.valid].all()), bool(values.mean() > raw.mean())
    (True, True)
    """
    field = run_patiently(lambda: thickness_field(cloud, options), progress)
    if field is None:
        raise InvalidShapeError(
            "No inner ball meets a second sample: thickness needs a surface that encloses a "
            'volume, at least partly, and a cloud with side "inner" or "both".'
        )
    return frozen(options.share * field.values, np.float64)


def thickness_field(cloud: MedialCloud, options: ThicknessOptions) -> CompletedField | None:
    """Return the diameters with what they were completed from; None where no ball is left."""
    angle = options.min_spoke_angle

    def work() -> CompletedField | None:
        none = np.zeros(cloud.surface.point_count, np.bool_)
        measured = _diameters(cloud, none, math.radians(angle))
        return None if measured is None else complete(cloud.surface, *measured)

    return kept(thickness_field, cloud, angle, work, Progress())


def thickness_without(
    cloud: MedialCloud, samples: Mask, options: ThicknessOptions, before: CompletedField
) -> CompletedField | None:
    """Return the diameters as if some samples had no ball; None where no ball is left.

    `before` is the same with fewer samples left out: only what is near the others is completed.
    """
    measured = _diameters(cloud, samples, math.radians(options.min_spoke_angle))
    return None if measured is None else complete_again(before, *measured)


def _diameters(
    cloud: MedialCloud, without: Mask, angle: float
) -> tuple[FloatArray, FloatArray] | None:
    """Diameter of the inner ball and of the wall at each sample, NaN where there is none."""
    rows = np.flatnonzero(cloud.valid & (cloud.side > 0) & ~without[cloud.source])
    if len(rows) == 0:
        return None
    own = np.full(cloud.surface.point_count, np.nan)
    own[cloud.source[rows]] = 2.0 * cloud.radii[rows]
    walls = rows[cloud.wall_angles[rows] >= angle]
    sizes = np.full(len(cloud), np.nan)
    sizes[walls] = 2.0 * cloud.radii[walls]
    values = field_on_surface(cloud, sizes, reduce="max")
    values[cloud.source[walls]] = sizes[walls]
    return own, values


def wall_balls(cloud: MedialCloud, angle: float = WALL_ANGLE) -> Index:
    """Return the rows of the inner balls between two walls, by an angle or `WALL_ANGLE` at least.

    `angle` is in degrees. Those of a rounded rim have less than is asked of walls.
    """
    return np.flatnonzero((cloud.side > 0) & (cloud.wall_angles >= least_wall_angle(angle)))


def least_wall_angle(angle: float) -> float:
    """Return the least angle between two walls in radians: that asked for in degrees, or more."""
    return math.radians(max(angle, WALL_ANGLE))


def unresolved_walls(cloud: MedialCloud) -> Mask:
    """Return whether the two feature points of each ball look like a wall that sampling blurs.

    The normals at the two points are opposite (at least `WALL_ANGLE` apart), as on the two sides of
    a wall, but the spoke angle is small, because the nearest sample on the far side is further off
    to the side than the wall is thick: the true ball is smaller. (k,) bool.
    """
    least = math.radians(WALL_ANGLE)
    result = np.zeros(len(cloud), np.bool_)
    rows = np.flatnonzero(cloud.valid & (cloud.side > 0) & (cloud.spoke_angles < least))
    first, second = (cloud.surface.normals[cloud.features[rows, j]] for j in (0, 1))
    result[rows] = np.einsum("ij,ij->i", first, second) <= math.cos(least)
    return result
