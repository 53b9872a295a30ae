"""Feature transform and its inverse: fields from the skeleton to the surface and back (3.5.1).

Every valid ball touches two samples (the feature transform); a sample is touched by any number of
balls, at least by its own (the inverse, `MedialCloud.inverse_features`). So a value of each ball
becomes a field on the surface by reducing over the balls that touch a sample, and a field on the
surface becomes a value of each ball by reducing over its two feature points.

Thickness (thesis 3.5.1, Figure 3.11): the diameter of the largest inscribed ball that touches or
contains a sample. It falls to zero towards a sharp convex edge.

Wall thickness: the same where the ball lies between two walls, as a caliper measures. Near a convex
edge or on a bump the largest ball is small because of the edge, not because the wall is thin: its
two feature points are on the same side, and its spoke angle is small. These samples take the
thickness of the wall around them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from medialis.base.arrays import Described, Index, Mask, next_side, sums_of, unit_rows
from medialis.base.box_tree import ROUNDING, NearestTree
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import kept
from medialis.base.options import algorithm, angle, changed, choice
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, as_choice, as_field, frozen
from medialis.shape.bodies import nearest_in_body
from medialis.shape.creases import find_creases
from medialis.shape.normals import CREASE_ANGLE
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import THINNEST, MedialCloud, sample_tree
from medialis.skeleton.preparation import InvariantPreparation
from medialis.skeleton.surface_skeleton import Preparation, balls_of, shape_or_cloud
from medialis.skeleton.triangle_balls import Walls
from medialis.walls.completion import CompletedField, complete, complete_again

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
    thickness : diameter of the largest ball at each sample.

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


COVERED, FACETED, CHORDAL = 3e-4, 3e-3, 2e-2
"""Relative to its radius: a ball contains samples up to this far outside of it; on refined facets
of round surfaces up to the height of the facet, but not more than the second number; on facets that
were not refined up to their height by the normals, but not more than the third. Facets keep balls
off the smooth surface, and narrow balls between neighbouring facets are far too small. Of two
merged spheres of 48 x 24 facets, 41 % of the samples are off by more than 1 % with the first number
alone, 5 % with all. On a cone of 64 facets 35 % of the samples become more than 2 % too thick."""

SMOOTH = math.cos(math.radians(40.0))
"""Least cosine of the normals at the ends of an edge of a round surface, and of its two faces."""

TOUCHED = 1e-3
"""Relative to its radius: the distance of a ball's surface from the sample that it touches."""

DEPTH = 5e-3
"""Relative to its radius: balls that triangles cut deeper are reduced. The tolerance lets the rims
of a plate into the balls beside them, which were 2.5 % thicker than the plate; facets of a torus of
32 x 32 sides cut its balls by up to 0.5 %."""

QUERIES_A_CHUNK = 512


@dataclass(frozen=True, kw_only=True)
class WallPreparation(InvariantPreparation):
    """Preparation of what measures walls."""

    refine: float = changed(
        Preparation,
        "refine",
        auto=0.01,
        help="Split edges longer than this share of the size for the computation, so that flat "
        "faces get samples; flat faces stay the same. 0 computes with the given vertices only. A "
        "wall is seen where the samples are closer together than it is thick. auto: 1 %, or more "
        "where that would make too many samples.",
    )


@dataclass(frozen=True, kw_only=True)
class ThicknessOptions(WallPreparation):
    """Options of `thickness`."""

    kind: ThicknessKind = choice(
        "diameter",
        "Measure",
        "What is measured of the ball.",
        {
            "diameter": "The diameter of the ball, as a caliper measures a wall.",
            "radius": "The radius of the ball, half of that.",
        },
    )

    @property
    def share(self) -> float:
        """Measured length as a fraction of the diameter."""
        return 1.0 if self.kind == "diameter" else 0.5


@dataclass(frozen=True, kw_only=True)
class WallThicknessOptions(ThicknessOptions):
    """Options of `wall_thickness`."""

    min_spoke_angle: float = angle(
        WALL_ANGLE,
        "Wall angle",
        "Balls whose two feature points are closer together than this, seen from the center, "
        "belong to edges and bumps, not to walls, and are left out. 0 uses all balls.",
        advanced=True,
    )


@algorithm(ThicknessOptions, door=shape_or_cloud, prepare=balls_of)
def thickness(cloud: MedialCloud, options: ThicknessOptions, progress: Progress) -> FloatArray:
    """Return the diameter of the largest inscribed ball that touches or contains each sample.

    Parameters
    ----------
    cloud : MedialCloud
        Balls on n samples; outer ones (side -1) take no part.

    Returns
    -------
    (n,) float64
        In the units of the shape, above 0, finite everywhere: one value for each sample of
        ``cloud.surface``, whose first points are those of the given shape. It falls to 0 towards
        sharp convex edges; a sample on such an edge has the value of the nearest sample.

    Raises
    ------
    InvalidShapeError
        When no inner ball is valid.

    See Also
    --------
    wall_thickness : the same for walls; edges and bumps take the value of the wall around them.
    thin_spots : the thinnest walls, one entry for each place.

    Notes
    -----
    Facets keep balls off the smooth surface: a ball contains samples up to 3e-4 of its radius
    outside of it, on coarse facets of round surfaces up to the height of the facet. A ball counts
    for samples of its own body only (`Surface.bodies`). Samples without a ball take the value of
    the nearest sample; a message counts them.

    Cost O(n log n); 0.1 s for 24,000 samples. Source: thesis 3.5.1, Figure 3.11; the definition is
    that of Hildebrand and Rueegsegger, "A new method for the model-independent assessment of
    thickness in three-dimensional images", J. Microscopy 185 (1997). Deviates: the thesis shows the
    radius of the ball that is tangent at each sample, which a leaning normal makes too small.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> values = medialis.thickness(cloud)
    >>> bool((values[cloud.source] >= 1.99 * cloud.radii)[cloud.valid].mean() > 0.99)
    True
    """
    balls = largest_balls(cloud, progress)
    if balls is None:
        raise _no_ball()
    if balls.missing:
        of = len(balls.rows)
        text = (
            f"{counted(balls.missing, 'sample', of=of, verbs=('has', 'have'))} no ball; the "
            "thickness of the nearest sample was taken."
        )
        progress.note(text, "no_ball", samples=balls.missing, of=of)
    return frozen(options.share * balls.diameters, np.float64)


@algorithm(WallThicknessOptions, door=shape_or_cloud, prepare=balls_of)
def wall_thickness(
    cloud: MedialCloud, options: WallThicknessOptions, progress: Progress
) -> FloatArray:
    """Return the thickness of the wall at every sample of the surface.

    Parameters
    ----------
    cloud : MedialCloud
        Balls on n samples; outer ones (side -1) take no part.

    Returns
    -------
    (n,) float64
        In the units of the shape, above 0, finite everywhere: one value for each sample of
        ``cloud.surface``.

    Raises
    ------
    InvalidShapeError
        When no inner ball is valid.

    See Also
    --------
    thickness : the largest ball at each sample, edges included.

    Notes
    -----
    1. A sample whose own ball is reliable (`MedialCloud.wall_angles` at least `min_spoke_angle`)
       has the diameter of that ball; else one that reliable balls of other samples touch has the
       diameter of the largest of them (the inverse feature transform).
    2. Every other sample of a mesh becomes the geometric mean of its neighbours, weighted by
       cotangents: a smooth transition between reliable values. It is raised to `thickness` where
       that is larger: a wall is never thinner than a ball that fits into it.
    3. A component without a reliable ball has the diameter of its largest ball everywhere (a cube:
       its inscribed ball); one without any ball has the values nearest in space.

    Samples without faces take the value nearest in space. A wall is seen only where the samples are
    closer together than it is thick: refine first (the operation `thickness` does).

    Cost O(n log n); 0.16 s for 194,000 vertices, of which 160,000 are filled in. Source: thesis
    3.5.1. Deviates: the thesis keeps the balls of edges and noise.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> bool((medialis.wall_thickness(cloud) >= medialis.thickness(cloud)).mean() > 0.6)
    True
    """
    field = run_patiently(lambda: thickness_field(cloud, options), progress)
    if field is None:
        raise _no_ball()
    return frozen(options.share * field.values, np.float64)


def _no_ball() -> InvalidShapeError:
    return InvalidShapeError(
        "No inner ball meets a second sample: thickness needs a surface that encloses a "
        'volume, at least partly, and a cloud with side "inner" or "both".'
    )


@dataclass(frozen=True, eq=False, repr=False)
class LargestBalls(Described):
    """The largest ball that touches or contains each of n samples.

    Attributes
    ----------
    diameters : (n,) float64
        Of samples without a ball, as those on convex creases, that of the nearest sample.
    rows : (n,) int64
        Row of the ball in the cloud.
    missing : int
        Samples without a ball that are on no convex crease.
    """

    diameters: FloatArray
    rows: Index
    missing: int


def largest_balls(cloud: MedialCloud, progress: Progress) -> LargestBalls | None:
    """Return the largest ball at each sample; None without any inner ball."""

    def work() -> LargestBalls | None:
        return _largest_balls(cloud, progress)

    return kept(largest_balls, cloud, None, work, progress)


def _largest_balls(cloud: MedialCloud, progress: Progress) -> LargestBalls | None:
    """Compute `largest_balls`: the own ball of each sample, or a larger one that covers it."""
    from medialis.walls._covering_kernels import find_covering

    surface, bodies = cloud.surface, cloud.surface.bodies
    inner = np.flatnonzero(cloud.valid & (cloud.side > 0))
    chords = chord_heights(surface)
    sizes = _inscribed_radii(cloud, inner, chords)
    inner = inner[sizes[inner] > 0.0]
    if len(inner) == 0:
        return None
    # A sample on a convex crease touches no ball; its row is a ball beside it.
    away = np.linalg.norm(surface.points[cloud.source[inner]] - cloud.centers[inner], axis=1)
    touching = away <= (1.0 + TOUCHED) * cloud.radii[inner]
    on_crease = np.zeros(surface.point_count, np.bool_)
    if touching.any():
        on_crease[cloud.source[inner[~touching]]] = True
        inner = inner[touching]
    inner = inner[np.argsort(sizes[inner], kind="stable")]  # the largest is assigned last
    rows = np.full(surface.point_count, -1, np.int64)
    rows[cloud.source[inner]] = inner
    radii = np.where(rows >= 0, sizes[rows], 0.0)
    balls = NearestTree.of_balls(cloud.centers[inner], sizes[inner])
    tree, ordered = balls.tree, inner[balls.tree.order]
    points = np.subtract(surface.points, tree.center, order="C")
    farthest = float(np.abs(points).max() + np.abs(tree.points).max())
    slack = np.maximum(
        np.minimum(facet_heights(surface), FACETED * _around(surface, radii)), chords
    )
    queries = points, slack, bodies, bodies[cloud.source[ordered]]
    given = queries, tree, balls.items
    covering = np.full(len(points), -1, np.int64)
    reach = COVERED, CHORDAL, ROUNDING * farthest
    count, out = len(points), (radii, covering)
    run_chunks(find_covering, count, QUERIES_A_CHUNK, *given, reach, out, progress=progress)
    rows = np.where(covering >= 0, ordered[covering], rows)
    missing = np.flatnonzero(rows < 0)
    if len(missing):
        known = np.flatnonzero(rows >= 0)
        rows[missing] = rows[nearest_in_body(surface, known, missing, sizes[rows])]
    diameters = frozen(2.0 * sizes[rows], np.float64)
    return LargestBalls(diameters, frozen(rows, np.int64), int((~on_crease[missing]).sum()))


def _around(surface: Shape, radii: FloatArray) -> FloatArray:
    """Return the largest radius at each sample of a mesh and its neighbours, (n,)."""
    result = radii.copy()
    if surface.faces is not None:
        a, b = surface.edges.T
        np.maximum.at(result, a, radii[b])
        np.maximum.at(result, b, radii[a])
    return result


def _inscribed_radii(cloud: MedialCloud, rows: Index, chords: FloatArray) -> FloatArray:
    """Return the radii (k,) of balls, smaller for those of `rows` that cut through triangles.

    Facets of round surfaces are cut as deep as they are high: `chords` (n,) at most.
    """
    radii, surface = cloud.radii.copy(), cloud.surface
    if surface.faces is not None and len(rows):
        high = chords[cloud.features[rows]].max(axis=1)
        bound = np.maximum((1.0 - DEPTH) * radii[rows] - high, 0.0)
        room = Room(surface).measure(cloud.centers[rows], cloud.source[rows], bound)
        radii[rows] = np.where(room < bound, room, radii[rows])
    return radii


def chord_heights(surface: Shape) -> FloatArray:
    """Return the largest height of a round surface over the edges at each sample, (n,).

    By the normals at their ends, twice that of a circular arc: normals of irregular meshes are
    rough. 0 across and along creases.
    """
    height = np.zeros(surface.point_count)
    if surface.faces is None:
        return height
    first, _, _ = surface.edge_table.pairs
    round_ones = first[surface.edge_bends < math.acos(SMOOTH)]
    corners = np.asarray(surface.faces).ravel()
    a, b = corners[round_ones], corners[next_side(round_ones)]
    step, turn = surface.points[b] - surface.points[a], surface.normals[b] - surface.normals[a]
    bulge = np.abs(np.einsum("ea,ea->e", step, turn)) / 4.0
    bulge[np.einsum("ea,ea->e", surface.normals[a], surface.normals[b]) < SMOOTH] = 0.0
    np.maximum.at(height, a, bulge)
    np.maximum.at(height, b, bulge)
    return height


def facet_heights(surface: Shape) -> FloatArray:
    """Return the height of the facets at each sample, (n,), where these stand for a round surface.

    That is the height of the smooth surface that refinement put on a facet: 0 for flat faces, and
    for facets so small that they were not refined.
    """
    height = np.zeros(surface.point_count)
    if surface.faces is None or surface.face_origin is None:
        return height
    facet, faces = surface.face_origin, np.asarray(surface.faces)
    normal = sums_of(facet, np.asarray(surface.face_vectors), int(facet.max()) + 1)
    normal = unit_rows(normal, 1e-300)
    along = np.einsum("fja,fa->fj", surface.points[faces] - surface.bounds[0], normal[facet])
    low, high = np.full(len(normal), np.inf), np.full(len(normal), -np.inf)
    np.minimum.at(low, facet, along.min(axis=1))
    np.maximum.at(high, facet, along.max(axis=1))
    np.maximum.at(height, faces.ravel(), np.repeat((high - low)[facet], 3))
    beside = height[faces].max(axis=1)  # flat ones beside them have their samples
    np.maximum.at(height, faces.ravel(), np.repeat(beside, 3))
    return height


class Room:
    """Distances inside of bodies to the triangles of the same body.

    Parameters
    ----------
    surface : Shape
        A mesh.
    """

    def __init__(self, surface: Shape) -> None:
        bodies = surface.body_contacts
        self._turn = bodies.turns[bodies.label]
        self._walls = []
        for number in range(int(self._turn.max(initial=0)) + 1):
            part = surface
            if self._turn.any():  # bodies that touch are measured apart from each other
                part = surface.some_bodies(self._turn == number)[0]
            tree = sample_tree(part, Progress())
            self._walls.append(Walls.of(find_creases(part, CREASE_ANGLE), tree))

    def measure(self, places: FloatArray, samples: IntArray, bound: FloatArray) -> FloatArray:
        """Return the distance of places (k, 3) to the nearest triangle, but at most `bound` (k,).

        `samples` (k,) are samples of the bodies that the places are in.
        """
        result, turn = bound.copy(), self._turn[samples]
        for number, walls in enumerate(self._walls):
            rows = np.flatnonzero(turn == number)
            if len(rows):
                result[rows] = walls.room(places[rows], bound[rows])
        return result


def thickness_field(cloud: MedialCloud, options: WallThicknessOptions) -> CompletedField | None:
    """Return the wall thickness with what it was completed from; None where no ball is left."""
    angle = options.min_spoke_angle

    def work() -> CompletedField | None:
        none = np.zeros(cloud.surface.point_count, np.bool_)
        measured = _diameters(cloud, none, math.radians(angle))
        return None if measured is None else _raised(complete(cloud.surface, *measured), cloud)

    return kept(thickness_field, cloud, angle, work, Progress())


def _raised(field: CompletedField, cloud: MedialCloud) -> CompletedField:
    """Raise completed values to the largest ball at the sample."""
    largest = largest_balls(cloud, Progress())
    if largest is None:
        return field
    higher = np.isnan(field.known) & (field.values < largest.diameters)
    if not higher.any():
        return field
    return replace(field, values=np.where(higher, largest.diameters, field.values))


def thickness_without(
    cloud: MedialCloud, samples: Mask, options: WallThicknessOptions, before: CompletedField
) -> CompletedField | None:
    """Return the diameters as if some samples had no ball; None where no ball is left.

    `before` is the same with fewer samples left out: only what is near the others is completed.
    """
    cloud.wall_angles  # noqa: B018 - computed once for all that are left out in turn
    measured = _diameters(cloud, samples, math.radians(options.min_spoke_angle))
    return None if measured is None else _raised(complete_again(before, *measured), cloud)


def _diameters(
    cloud: MedialCloud, without: Mask, angle: float
) -> tuple[FloatArray, FloatArray] | None:
    """Diameter of the inner ball and of the wall at each sample, NaN where there is none."""
    rows = np.flatnonzero(cloud.valid & (cloud.side > 0) & ~without[cloud.source])
    if len(rows) == 0:
        return None
    own = np.full(cloud.surface.point_count, np.nan)
    own[cloud.source[rows]] = 2.0 * cloud.radii[rows]
    walls = _real_walls(cloud, cloud.with_wall_angle(rows, angle))
    sizes = np.full(len(cloud), np.nan)
    sizes[walls] = 2.0 * cloud.radii[walls]
    values = field_on_surface(cloud, sizes, reduce="max")
    values[cloud.source[walls]] = sizes[walls]
    return own, values


def wall_balls(cloud: MedialCloud, angle: float = WALL_ANGLE) -> Index:
    """Return the rows of the inner balls between two walls, by an angle or `WALL_ANGLE` at least.

    `angle` is in degrees. Those of a rounded rim have less than is asked of walls.
    """
    rows = np.flatnonzero((cloud.side > 0) & (cloud.wall_angles >= least_wall_angle(angle)))
    return _real_walls(cloud, rows)


def _real_walls(cloud: MedialCloud, rows: Index) -> Index:
    """Return the rows of balls that are not points: at a feather edge two sides meet."""
    return rows[2.0 * cloud.radii[rows] > THINNEST * cloud.surface.diagonal]


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
