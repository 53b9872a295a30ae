"""MedialCloud: maximal balls with their two feature points, and how samples give them.

Ball shrinking gives every surface sample its maximal ball (thesis 3.2.1, 3.5.1, Algorithm 1). The
printed algorithm searches the nearest sample again and again and bisects the radius. Here one
branch-and-bound traversal finds the same ball exactly; `_ball_kernels.py` argues why.

A tolerance keeps relief from shrinking balls, and the other side of a wall thinner than it looks
like relief. `hidden_walls` finds the balls that passed through one (deviation from thesis 3.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Index, Mask, Ragged
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.options import Options, algorithm, choice, length
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_chunks, run_patiently
from medialis.base.validation import FloatArray, IntArray, Measures, Positions, frozen, hold
from medialis.shape.reading import as_shape
from medialis.shape.shape import Shape

if TYPE_CHECKING:
    from medialis.base._box_tree_kernels import BoxTree


class BallStatus(IntEnum):
    """What became of the ball of a sample."""

    OK = 0
    """A maximal ball with two feature points."""
    OPEN = 1
    """No second contact within the largest allowed radius (open surface, or the outer side)."""
    NO_NORMAL = 2
    """The sample has no normal, so no ball can be started: center and radius are NaN."""


@dataclass(frozen=True, eq=False, repr=False)
class Balls(Bound):
    """Rows of balls: what a `MedialCloud` holds, without the surface that they touch.

    Row i keeps its place whatever became of it; use `valid` to select the true medial balls.

    Attributes
    ----------
    centers : (k, 3) float64
        Ball centers in the units of the shape. An OPEN ball has the largest allowed radius.
    radii : (k,) float64
        Ball radii, same units.
    features : (k, 2) int32
        Feature points f1, f2: samples, by their index; f2 is -1 where the status is not OK. Of a
        triangle that the ball touches between its corners, f2 is the corner nearest to that place.
    source : (k,) int32
        The sample whose ball this is (equal to f1).
    status : (k,) int8
        A `BallStatus`.
    spoke_angles : (k,) float64
        Angle f1 - center - f2 in radians, 0..pi (theta-SMA); NaN where the status is not OK. The
        place that the ball touches counts, also where it is no sample.
    side : (k,) int8
        +1 for an inner ball, -1 for an outer one.
    contact_faces : (k,) int32
        The face of the surface that the ball touches between its corners; -1 where it touches the
        sample f2 itself.
    contact_weights : (k, 3) float64
        Barycentric coordinates of that place in the face; zero where there is none.

    Raises
    ------
    InvalidShapeError
        When the arrays do not have the same number of rows.
    """

    centers: Positions
    radii: FloatArray
    features: IntArray
    source: IntArray
    status: NDArray[np.int8]
    spoke_angles: FloatArray
    side: NDArray[np.int8]
    contact_faces: IntArray = None  # type: ignore[assignment]
    contact_weights: Measures = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        k = len(self.centers)
        if self.contact_faces is None or self.contact_weights is None:
            object.__setattr__(self, "contact_faces", np.full(k, -1, np.int32))
            object.__setattr__(self, "contact_weights", np.zeros((k, 3)))
        hold(self, centers=(k, 3), radii=k, features=(k, 2), source=k, status=k)
        hold(self, spoke_angles=k, side=k, contact_faces=k, contact_weights=(k, 3))

    def __len__(self) -> int:
        return len(self.radii)

    @cached_property
    def valid(self) -> Mask:
        """True where the ball is maximal with two feature points, (k,)."""
        return frozen(self.status == BallStatus.OK, np.bool_)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self)} balls, {int(self.valid.sum())} valid)"

    def subset(self, rows: ArrayLike) -> Self:
        """Return the rows that a boolean mask or an index array selects, all arrays aligned."""
        selection = np.asarray(rows)
        if selection.size == 0:  # an empty list is an array of floats, which cannot index
            selection = selection.astype(selection.dtype if selection.dtype == bool else np.int64)
        return replace(self, **{name: getattr(self, name)[selection] for name in COLUMNS})


COLUMNS = tuple(f.name for f in fields(Balls))


@dataclass(frozen=True, eq=False, repr=False)
class MedialCloud(Balls):
    """Skeleton points: one ball for each surface sample and side (thesis 3.2).

    Its arrays are those of `Balls`.

    Attributes
    ----------
    surface : Shape
        The samples that the balls touch: the surface as computed on, smoothed and refined where
        that was needed. Features and sources index its points.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together, or touch samples that the surface does not have.
    """

    surface: Shape = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        highest = max(int(self.features.max(initial=-1)), int(self.source.max(initial=-1)))
        if highest >= self.surface.point_count:
            raise InvalidShapeError(
                f"The balls touch sample {highest}, but the surface has "
                f"{self.surface.point_count}: give the surface that they were computed from."
            )

    @cached_property
    def whole(self) -> bool:
        """True when row i is the inner ball of sample i, for all n samples.

        Inner balls of fans may follow.
        """
        n = self.surface.point_count
        own = len(self) >= n and not (self.side < 0).any()
        return own and bool((self.source[:n] == np.arange(n)).all())

    @cached_property
    def own(self) -> MedialCloud:
        """The balls of the samples without those of fans; the cloud itself when it has none."""
        count = self.surface.point_count * len(np.unique(self.side))
        return self.subset(np.arange(count)) if len(self) > count else self

    @cached_property
    def inner(self) -> MedialCloud:
        """The inner balls alone; the cloud itself when it has no others."""
        return self.subset(self.side > 0) if (self.side < 0).any() else self

    @cached_property
    def contacts(self) -> FloatArray:
        """Where each ball touches the surface again, (k, 3); NaN where the status is not OK."""
        points, on_face = self.surface.points, self.contact_faces >= 0
        result = np.where(self.valid[:, None], points[self.features[:, 1]], np.nan)
        if self.surface.faces is not None and on_face.any():
            corners = points[self.surface.faces[self.contact_faces[on_face]]]
            result[on_face] = np.einsum("ij,ija->ia", self.contact_weights[on_face], corners)
        return frozen(result, np.float64)

    @cached_property
    def contact_normals(self) -> FloatArray:
        """Normal of the surface at the second contact, (k, 3): of the sample, or of the face there.

        Zero where there is none.
        """
        result = self.surface.normals[self.features[:, 1]] * self.valid[:, None]
        on_face = self.contact_faces >= 0
        result[on_face] = self.surface.face_normals[self.contact_faces[on_face]]
        return frozen(result, np.float64)

    @cached_property
    def wall_angles(self) -> FloatArray:
        """How far apart the two feature points of each ball are, as seen from the center, (k,).

        The smaller one of the spoke angle and the angle between the normals at the two feature
        points, in radians; NaN for a masked ball, 0 for one that touches a sample without a normal:
        nothing tells what it lies between. For a ball that touches a smooth surface the two are the
        same; next to an edge, where samples are no closer together than the ball is large, the
        spoke angle alone says nothing.
        """
        angles, rows = np.array(self.spoke_angles), np.flatnonzero(self.valid)
        angles[rows] = self._wall_angles_of(rows)
        return frozen(angles, np.float64)

    def with_wall_angle(self, rows: Index, least: float) -> Index:
        """Return those of some valid rows whose wall angle is a least one, in radians, or more."""
        if "wall_angles" in self.__dict__:
            return rows[self.wall_angles[rows] >= least]
        rows = rows[self.spoke_angles[rows] >= least]  # wall angles are no larger
        return rows[self._wall_angles_of(rows) >= least]

    def _wall_angles_of(self, rows: Index) -> FloatArray:
        first, second = (self.surface.normals[self.features[rows, j]] for j in (0, 1))
        cosine = np.clip(np.einsum("ij,ij->i", first, second), -1.0, 1.0)
        known = first.any(axis=1) & second.any(axis=1)
        angles = np.minimum(self.spoke_angles[rows], np.arccos(cosine))
        return np.asarray(np.where(known, angles, 0.0))

    @cached_property
    def inverse_features(self) -> Ragged:
        """For each sample the valid skeleton points that touch it (thesis 3.5.1)."""
        features = np.where(self.valid[:, None], self.features, -1)
        touching = Ragged.group(features.ravel(), self.surface.point_count)
        return Ragged(touching.offsets, touching.indices // 2)


def overwritten(cloud: MedialCloud, rows: NDArray[Any], **columns: Any) -> MedialCloud:
    """Return a cloud with other values of some columns in some rows: arrays, or one.

    The cloud given must be one that was just made and that nobody else has: its arrays are written
    to, since copies of them all would take longer than what is written.
    """
    if len(rows) == 0:
        return cloud
    changed = {name: getattr(cloud, name) for name in columns}
    for name, values in columns.items():
        changed[name].flags.writeable = True
        changed[name][rows] = values
    return replace(cloud, **changed)


LARGEST_INSIDE = 0.5  # halved 0 %, doubled 0 %
"""Fraction of the diagonal: no ball inside a closed shape has a larger radius."""

THINNEST = 1e-7  # halved 0 %, doubled 0 %
"""Fraction of the diagonal: surfaces closer together than this lie on each other, with no wall."""

NEIGHBOURS = 32  # halved 0 %, doubled 0 %
"""Nearest samples among which the other side of a wall is looked for."""

OPPOSITE = -0.5  # halved 0 %, doubled 0 %
"""Largest cosine between the normals of two sides: walls that taper by less than 60 degrees."""

FEW_DISTANCES = 4_000_000
"""Neighbours of so many samples times all are found sooner than the tree of scipy is loaded."""


DEFAULT_TOLERANCE = 3e-4  # halved 98 %, doubled 77 %
"""Fraction of the diagonal. Exact balls cost no more, but follow every bit of relief: on horse2
(194k samples) 60 % of the exact balls touch the surface at two points less than 20 degrees apart;
with 1e-5 it is 55 %, with 1e-4 32 %, with 3e-4 13 %, with 1e-3 1 %. 3e-4 is a tenth of the sample
spacing of a mesh of 100k vertices: no shape is lost, and most of the false balls are gone."""

CLEARANCE = 0.75  # halved 73 %, doubled 77 %
"""Share of the tolerance that a sample may lie deep; the rest is left for reusing certificates.
Of 1/2, 3/4 and 1, the largest that keeps spheres fast (1: 200 times slower)."""

LARGEST_RADIUS = 1.0  # halved 0 %, doubled 0 %
"""Fraction of the diagonal. A ball inside a closed shape fits its bounding box, so its radius is at
most diagonal / (2 sqrt 3), or half a diagonal where only the corners of a box are sampled. Only
open shapes and the outer side reach this bound."""

COINCIDENT = 1e-10  # halved 0 %, doubled 0 %
"""Fraction of the diagonal. A sample nearer than this to the tangent point counts as that point: it
lies at most this deep in the ball, and its r(q) would be rounding error."""

FLOAT32_MARGIN = 2e-6  # halved 0 %, doubled 0 %
"""Fraction of the diagonal. A node test sums about ten float32 terms of at most two diagonals, each
rounded by 6e-8 of its size; see `_ball_kernels.py`."""

SAMPLES_A_CHUNK = 1024  # halved < 0.1 %, doubled < 0.1 %
"""About 2 ms of work: short enough for progress and Ctrl-C, long enough that the first ball of a
chunk, which has no warm start, does not count."""


BALLS_A_CHUNK = 1 << 15
"""Of those that are looked at once each."""


def hidden_walls(cloud: MedialCloud, tolerance: float) -> Mask:
    """Tell the inner balls that went through a wall thinner than the tolerance.

    Parameters
    ----------
    cloud : MedialCloud
        k balls.
    tolerance : float
        Fraction of the diagonal that hides walls.

    Returns
    -------
    (k,) bool
        Balls inside a closed part that meet no second sample (there always is one), and balls that
        meet none, or touch their second sample from its outside, with the other side of a wall
        close behind their own sample.

    Notes
    -----
    Cost: nothing for balls that touch as they should; 32 nearest samples for each of the others.
    """
    hidden = endless(cloud)
    without = (cloud.side > 0) & (cloud.status == BallStatus.OPEN)
    outside = touches_from_outside(cloud)
    hidden |= outside & (cloud.contact_faces >= 0) & in_closed_part(cloud.surface, cloud.source)
    odd = np.flatnonzero((without | outside) & ~hidden)
    hidden[odd] = _close_behind(cloud.surface, cloud.source[odd], tolerance)
    return hidden


def endless(cloud: MedialCloud) -> Mask:
    """Tell the inner balls in closed parts that meet no second sample, (k,); there is one."""
    shape = cloud.surface
    result = (cloud.side > 0) & (cloud.status == BallStatus.OPEN)
    # Not so where a small largest_radius ends them.
    result &= cloud.radii >= LARGEST_INSIDE * shape.diagonal
    return result & in_closed_part(shape, cloud.source) if result.any() else result


def touches_from_outside(cloud: MedialCloud) -> Mask:
    """Tell the inner balls whose center lies in front of the wall at their second contact, (k,)."""
    from medialis.skeleton._ball_kernels import Contacts, find_outside

    surface, result = cloud.surface, (cloud.side > 0) & cloud.valid
    none = np.empty((0, 3), np.int32), np.empty((0, 3))
    faces = none if surface.faces is None else (surface.faces, surface.face_normals)
    touching = cloud.centers, cloud.features, cloud.contact_faces, cloud.contact_weights
    contacts = Contacts(*touching, surface.points, surface.normals, *faces)
    run_chunks(find_outside, len(cloud), BALLS_A_CHUNK, contacts, result)
    return result


def in_closed_part(shape: Shape, samples: NDArray[Any]) -> Mask:
    """Tell the samples whose component has faces and no border."""
    return np.asarray(shape.closed_components[shape.components[samples]])


def _close_behind(shape: Shape, rows: IntArray, tolerance: float) -> Mask:
    """Tell the samples with one that faces the other way less than the tolerance behind them."""
    if len(rows) == 0:
        return np.zeros(0, np.bool_)
    near = _nearest(shape, rows, min(NEIGHBOURS, shape.point_count))
    spoke, own = shape.points[rows][:, None] - shape.points[near], shape.normals[rows]
    depth = np.einsum("ij,ikj->ik", own, spoke) / shape.diagonal
    facing = np.einsum("ij,ikj->ik", own, shape.normals[near])
    return ((depth > THINNEST) & (depth <= tolerance) & (facing < OPPOSITE)).any(axis=1)


def _nearest(shape: Shape, rows: IntArray, count: int) -> Index:
    """Return the nearest samples of some, themselves among them, (q, count)."""
    points = shape.points
    if len(rows) * len(points) > FEW_DISTANCES:
        return np.asarray(shape.tree.query(points[rows], k=np.arange(1, count + 1))[1])
    from medialis.skeleton._ball_kernels import nearest_of_all

    near = np.empty((len(rows), count), np.int64)
    nearest_of_all(points, rows, near)
    return near


Side = Literal["inner", "outer", "both"]


@dataclass(frozen=True, kw_only=True)
class ShrinkOptions(Options):
    """Options of `shrink_balls`."""

    tolerance: float = length(
        DEFAULT_TOLERANCE,
        "Tolerance",
        "Relief of the surface lower than this share of the size does not shrink a ball; no "
        "sample lies deeper than this inside one. 0 gives the exact maximal balls, larger values "
        "suppress noise.",
        high=0.1,
    )
    side: Side = choice(
        "inner",
        "Side",
        "Where the skeleton lies.",
        {
            "inner": "The skeleton inside the shape.",
            "outer": "The skeleton of the room around the shape.",
            "both": "Both skeletons, inside and outside.",
        },
    )
    largest_radius: float = length(
        LARGEST_RADIUS,
        "Largest radius",
        "A ball that meets no second sample within this share of the size is masked. Balls "
        "inside a closed shape never get this large.",
        low=1e-6,
        high=10.0,
        advanced=True,
    )


@algorithm(ShrinkOptions, door=as_shape)
def shrink_balls(shape: Shape, options: ShrinkOptions, progress: Progress) -> MedialCloud:
    """Shrink one ball for each sample, constrained by the samples alone.

    `surface_skeleton` is what most people want: it refines and denoises where needed, and sees
    walls that are thinner than the tolerance or than the samples are apart.

    Parameters
    ----------
    shape : Shape
        n samples with unit outward normals. Samples without a normal get no ball.

    Returns
    -------
    MedialCloud
        k = n rows (2n for both sides); row i belongs to sample i (n + i: its outer ball).

    Raises
    ------
    InvalidShapeError
        When all points coincide or no sample has a normal.

    See Also
    --------
    surface_skeleton : prepares the surface and cures thin walls first.

    Notes
    -----
    Cost: O(n log n) for the tree, then nearly O(n) except where large parts of the surface are
    equidistant from the center (spheres, straight tubes). About 200 bytes a sample.

    Source: thesis 3.2.1-3.2.2, Algorithm 1. Deviates: one pass instead of repeated nearest
    neighbour searches and bisection. The thesis's tau ends an iteration whose result depends on
    where it started; here the ball is the largest one in which no sample lies deeper than 3/4 of
    the tolerance, shrunk to pass through its two feature points.

    Examples
    --------
    The balls of a sphere all have its center:

    >>> import numpy as np, medialis
    >>> rng = np.random.default_rng(0)
    >>> normals = rng.normal(size=(500, 3))
    >>> normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    >>> cloud = medialis.shrink_balls(medialis.Shape(2 * normals, normals))
    >>> bool(np.abs(cloud.centers).max() < 1e-4), float(cloud.radii.mean().round(4))
    (True, 2.0)
    """
    cloud, _ = shrink(shape, options, progress)
    note_outcome(cloud, options.tolerance, progress)
    return cloud


def shrink(shape: Shape, options: ShrinkOptions, progress: Progress) -> tuple[MedialCloud, BoxTree]:
    """Shrink all balls; return the tree of the samples too."""
    if shape.diagonal == 0.0:
        raise InvalidShapeError(
            f"All {shape.point_count} points coincide: a skeleton needs a shape with an extent."
        )
    if not shape.normals.any():
        raise InvalidShapeError(
            "No sample has a normal: give normals, faces with an area, or let medialis estimate "
            "them (medialis.make_shape)."
        )
    signs = {"inner": (1,), "outer": (-1,), "both": (1, -1)}[options.side]
    lengths = shrink_options(shape.diagonal, options.tolerance, options.largest_radius)
    n = shape.point_count
    arrays = blank_balls(n * len(signs))
    with progress.stage("tree", 0.0, 0.15):
        tree = sample_tree(shape, progress)
    for turn, sign in enumerate(signs):
        share = 0.85 / len(signs)
        with progress.stage("balls", 0.15 + share * turn, 0.15 + share * (turn + 1)):
            out = tuple(values[turn * n : (turn + 1) * n] for values in arrays)
            lengths.run_all(0, n, tree, sign, out, progress)
    source = np.tile(np.arange(n, dtype=np.int32), len(signs))
    side = np.repeat(np.array(signs, np.int8), n)
    return lengths.to_cloud(shape, tree, arrays, source, side), tree


_EVERY = np.empty(0, np.int32)

Columns = tuple[NDArray[Any], ...]
"""Arrays of balls: see `blank_balls`."""


class Shrinking(NamedTuple):
    """Lengths of a run in units of the tree, and the call of the kernel; see `shrink_options`."""

    unit: float
    tolerance: float
    clearance: float
    largest: float
    near2: float
    margin: float

    def run(
        self, begin: int, end: int, tree: BoxTree, sign: int, out: Columns, tangents: Any = None
    ) -> None:
        """Shrink the balls of the samples begin..end (tree order) on one side.

        `out` is what `blank_balls` returns, in the order of the input. A range that starts at a
        multiple of SAMPLES_A_CHUNK and holds whole chunks gives the same bits whoever runs the
        others. With `tangents`, samples (tree order) and outward normals of balls, it shrinks the
        balls begin..end of these.
        """
        from medialis.skeleton import _ball_kernels as kernels

        samples, normals = (_EVERY, tree.normals) if tangents is None else tangents
        columns = kernels.Columns(*out)
        kernels.shrink_balls(begin, end, float(sign), self, tree, normals, samples, columns)

    def run_all(
        self, begin: int, end: int, tree: BoxTree, sign: int, out: Columns, progress: Progress,
        tangents: Any = None,
    ) -> None:  # fmt: skip
        """Shrink the balls begin..end by `run` on all threads, or on a GPU."""
        from medialis.skeleton.balls_on_gpu import shrink_there

        given = tree, sign, out, tangents
        if not shrink_there(self, begin, end, *given, progress):

            def work(first: int, last: int) -> None:
                self.run(begin + first, begin + last, *given)

            run_chunks(work, end - begin, SAMPLES_A_CHUNK, progress=progress)

    def shrink(
        self,
        shape: Shape,
        tree: BoxTree,
        samples: NDArray[Any],
        places: IntArray,
        normals: FloatArray,
        sign: int,
        progress: Progress,
    ) -> MedialCloud:
        """Shrink balls of some samples, of these places in the tree, with normals of their own."""
        arrays, tangents = blank_balls(len(samples)), (places, normals)
        self.run_all(0, len(samples), tree, sign, arrays, progress, tangents)
        side = np.full(len(samples), sign, np.int8)
        return self.to_cloud(shape, tree, arrays, samples.astype(np.int32), side)

    def to_input(self, tree: BoxTree, centers: FloatArray, radii: FloatArray) -> None:
        """Bring centers and radii from the units of the tree to those of the input, in place."""
        centers += tree.center
        centers *= self.unit
        radii *= self.unit

    def to_cloud(
        self, shape: Shape, tree: BoxTree, arrays: Columns, source: IntArray, side: NDArray[np.int8]
    ) -> MedialCloud:
        """Return what `run` wrote as a cloud, in the units of the input."""
        centers, radii, second, status, angles = arrays
        self.to_input(tree, centers, radii)
        features = np.stack([source, second], axis=1)
        return MedialCloud(centers, radii, features, source, status, angles, side, surface=shape)


def shrink_options(diagonal: float, tolerance: float, largest_radius: float) -> Shrinking:
    """Return the lengths of a run for a shape of this diagonal; options as fractions of it."""
    # Dividing by a power of two changes no digit, and keeps the squares of tiny or huge coordinates
    # within the range of the tree's float32 bounds.
    unit = math.ldexp(1.0, math.frexp(diagonal)[1] - 1)
    size = diagonal / unit
    clearance = CLEARANCE * tolerance * size
    near2 = max(COINCIDENT * size, clearance) ** 2
    margin = FLOAT32_MARGIN * size * (1.0 + largest_radius)
    return Shrinking(unit, tolerance * size, clearance, largest_radius * size, near2, margin)


def sample_tree(shape: Shape, progress: Progress) -> BoxTree:
    """Return the tree of the samples, in the units of `shrink_options`."""
    # Imported here: compiled code takes half a second to load, and `medialis --help` needs none.
    from medialis.base.box_tree import build_box_tree

    points, normals = shape.points, shape.normals
    unit = shrink_options(shape.diagonal, 0.0, 0.0).unit
    return run_patiently(lambda: build_box_tree(points, normals, unit=unit), progress)


def blank_balls(count: int) -> Columns:
    """Return arrays for `Shrinking.run` to fill: see `Columns`."""
    centers, radii = np.full((count, 3), np.nan), np.full(count, np.nan)
    second, status = np.full(count, -1, np.int32), np.zeros(count, np.int8)
    return centers, radii, second, status, np.full(count, np.nan)


def note_outcome(cloud: MedialCloud, tolerance: float, progress: Progress) -> None:
    """Say how many samples have no ball, and why."""
    shape = cloud.surface
    counts = np.bincount(cloud.status, minlength=3)
    if bare := int(counts[BallStatus.NO_NORMAL]):
        reason = "folded or degenerate faces meet there"
        if shape.faces is None:
            reason = "the one given is zero or no number"
        text = (
            f"{counted(bare, 'sample', of=len(cloud), verbs=('has', 'have'))} no normal and so no "
            f"ball: {reason}."
        )
        progress.warn(text, "no_normal", samples=bare, of=len(cloud))
    for sign, name in ((1, "inner"), (-1, "outer")):
        mine = cloud.side == sign
        count = int(((cloud.status == BallStatus.OPEN) & mine).sum())
        if count:
            reason = "the surface is open there" if sign > 0 else "nothing faces them"
            if sign > 0 and run_patiently(lambda: hidden_walls(cloud, tolerance), progress).any():
                reason = "walls are thinner than the tolerance there, or normals point inward"
            text = (
                f"{counted(count, f'{name} ball', of=int(mine.sum()), verbs=('meets', 'meet'))} no "
                f"second sample within the largest radius ({reason}); no skeleton point follows."
            )
            progress.note(text, "open_balls", balls=count, of=int(mine.sum()), side=name)
