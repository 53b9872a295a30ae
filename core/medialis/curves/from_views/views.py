"""Views of a shape: cameras, silhouettes and their skeletons, matching (thesis 3.7.3, 3.7.4).

`OrthographicCamera` and `View` are what a `ViewSource` takes and gives; `camera_pairs` places the
cameras round a shape. The core's own source is in `drawing.py`.

A silhouette skeleton is known by where the rows of the picture cross it, at sub-pixel columns
(`skeletonize`). Two views of a pair have the same rows: crossings whose depths agree are points
near the curve skeleton (`pair_points`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Described, Mask, extent
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import Options, algorithm, number
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray, as_number, as_whole_number, frozen

if TYPE_CHECKING:
    from medialis.curves.from_views._draw_kernels import Box
    from medialis.curves.from_views._kernels import Rows
    from medialis.curves.from_views._view_kernels import PackedView

MAX_SIZE = 8192  # halved 0 %, doubled 0 %
"""Pixels along a side of a picture."""

GOLDEN = math.pi * (3 - math.sqrt(5))  # halved 91 %, doubled 92 %
"""Radians by which a spiral turns from one direction to the next, so that they are even."""

PLASTIC = 0.7548776662466927  # halved 84 %, doubled 82 %
"""Steps by this spread well, and, unlike golden ones, do not beat with the turns of the spiral."""

MARGIN = 2  # halved 50 %, doubled 93 %
"""Free pixels on each side: the border of a picture must lie outside the silhouette."""

NO_FIELD = np.empty((0, 0), np.float32)

Picture = NDArray[np.float32]
"""Where the distance field is not asked for."""


@dataclass(frozen=True, eq=False, repr=False)
class OrthographicCamera(Described):
    """A camera with parallel rays and a square picture.

    Pixel (row r, column c) has its center at (c + 0.5, r + 0.5); row 0 is the top.

    Attributes
    ----------
    center : (3,) float64
        The point in the middle of the picture, at depth 0.
    axes : (3, 3) float64
        Rows: unit right, up and forward (the viewing direction v of the thesis), at right angles.
    extent : float
        Width and height of the picture in the caller's units.
    size : int
        Width and height in pixels, 8..8192.

    Raises
    ------
    InvalidOptionError
        When the axes are not at right angles and of unit length, or a number is out of range.

    Examples
    --------
    >>> camera = OrthographicCamera([0, 0, 0], [[1, 0, 0], [0, 1, 0], [0, 0, -1]], 2.0, 100)
    >>> camera.to_pixels([[0, 0, 0], [1, 1, 1]]).tolist()
    [[50.0, 50.0, 0.0], [100.0, 0.0, -1.0]]
    """

    center: FloatArray
    axes: FloatArray
    extent: float
    size: int

    def __post_init__(self) -> None:
        for name, shape in (("center", (3,)), ("axes", (3, 3))):
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise InvalidOptionError(f"{name} must be {shape} finite numbers, got {value!r}.")
            object.__setattr__(self, name, frozen(value, np.float64))
        if np.abs(self.axes @ self.axes.T - np.eye(3)).max() > 1e-6:
            raise InvalidOptionError("axes must be three unit vectors at right angles.")
        object.__setattr__(self, "extent", as_number(self.extent, "extent", low=0, open_low=True))
        size = as_whole_number(self.size, "size", low=8, high=MAX_SIZE)
        object.__setattr__(self, "size", size)

    @property
    def pixel(self) -> float:
        """Edge of a pixel in the caller's units."""
        return self.extent / self.size

    def to_pixels(self, points: ArrayLike) -> FloatArray:
        """Return column, row and depth of points (n, 3); the depth is in the caller's units."""
        seen = np.einsum("ij,kj->ik", np.asarray(points, np.float64) - self.center, self.axes)
        seen[:, 0] = self.size / 2 + seen[:, 0] / self.pixel
        seen[:, 1] = self.size / 2 - seen[:, 1] / self.pixel
        return seen


@dataclass(frozen=True, eq=False, repr=False)
class View(Described):
    """Silhouette and depth range of a shape, seen by one camera.

    Attributes
    ----------
    camera : OrthographicCamera
    near, far : (h, w) float32
        Depth of the nearest and of the furthest surface along the camera's forward axis, 0 in the
        plane through its center; NaN where the shape is not. h = w = ``camera.size``.

    Raises
    ------
    InvalidShapeError
        When the pictures are not of the camera's size, are not NaN at the same pixels, or far is
        nearer than near.
    """

    camera: OrthographicCamera
    near: NDArray[np.float32]
    far: NDArray[np.float32]

    def __post_init__(self) -> None:
        wanted = (self.camera.size, self.camera.size)
        for name in ("near", "far"):
            value = np.asarray(getattr(self, name))
            if value.shape != wanted or value.dtype.kind not in "fiu":
                raise InvalidShapeError(
                    f"{name} must be {wanted} numbers, as the camera's picture, got shape "
                    f"{value.shape} of {value.dtype}."
                )
            object.__setattr__(self, name, frozen(value, np.float32))
        if not (np.isfinite(self.near) == np.isfinite(self.far)).all():
            raise InvalidShapeError("near and far must be finite at the same pixels.")
        if (self.far < self.near).any():
            raise InvalidShapeError("far must not be nearer than near at any pixel.")

    @property
    def mask(self) -> Mask:
        """Silhouette, (h, w): True where the shape is."""
        return np.isfinite(self.near)


class ViewSource(Protocol):
    """Whatever renders views: the core's rasterizer, Blender, a camera rig.

    It is called on the calling thread, with a few cameras at a time, so that a host whose
    graphics work on one thread only can serve as a source.
    """

    def __call__(self, cameras: Sequence[OrthographicCamera]) -> Sequence[View]:
        """Return one view for each camera, in their order."""


CameraPair = tuple[OrthographicCamera, OrthographicCamera]


def sphere_of(points: FloatArray) -> tuple[FloatArray, float]:
    """Return a center and a radius that hold all points: the middle of their bounding box."""
    low, high = extent(points)
    center = low / 2 + high / 2
    return center, float(np.sqrt(((points - center) ** 2).sum(axis=1).max()))


def camera_axes(count: int) -> FloatArray:
    """Return right, up and forward of cameras spread evenly over the sphere, (count, 3, 3).

    Directions lie on a Fibonacci spiral, visited so that any run of them covers the sphere; each
    camera is turned about its direction by the golden angle against the last, so that rows lie in
    all directions.
    """
    order = np.argsort(np.argsort((np.arange(count) * PLASTIC) % 1.0, kind="stable"))
    z = 1 - (2 * order + 1) / count
    turn = order * GOLDEN
    level = np.sqrt(1 - z * z)
    forward = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
    right = np.stack([-np.sin(turn), np.cos(turn), np.zeros(count)], axis=1)
    up = np.cross(right, forward)
    roll = np.arange(count) * GOLDEN
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return np.stack([c * right + s * up, c * up - s * right, forward], axis=1)


def camera_pairs(
    center: FloatArray, radius: float, *, pairs: int, angle: float, size: int
) -> list[CameraPair]:
    """Return pairs of cameras that see a sphere whole.

    Parameters
    ----------
    center : (3,) float
    radius : float
        Of the sphere; not 0.
    pairs : int
        Number of pairs.
    angle : float
        Between the viewing directions of a pair, in radians (alpha of the thesis).
    size : int
        Width and height of the pictures in pixels.

    Notes
    -----
    Source: thesis 3.7.4 (parallel up-vectors), 3.7.6.2 (uniform on a sphere). Deviates: up-vectors
    differ from pair to pair. A limb along the rows of a pair cannot be placed by it; with one
    up-vector for all, some limbs would lie along the rows of most pairs.
    """
    extent, c, s = 2 * radius * size / (size - 2 * MARGIN), math.cos(angle), math.sin(angle)

    def pair(axes: FloatArray) -> CameraPair:
        right, up, forward = axes
        turned = np.stack([c * right - s * forward, up, c * forward + s * right])
        first, second = (OrthographicCamera(center, a, extent, size) for a in (axes, turned))
        return first, second

    return [pair(axes) for axes in camera_axes(pairs)]


@dataclass(frozen=True, kw_only=True)
class SilhouetteOptions(Options):
    """Options of `silhouette_skeleton`."""

    saliency: float = number(
        1.0,
        "Saliency",
        "Silhouette skeletons keep places where the contour between the two nearest contour points "
        "is longer than this many times their distance. Higher values keep less.",
        high=1000.0,
        advanced=True,
    )


@dataclass(frozen=True, eq=False, repr=False)
class Crossings(Described):
    """Where the rows of a picture cross the skeleton of the silhouette in it.

    Attributes
    ----------
    begin : (h + 1,) int32
        Crossings of row r have the numbers begin[r]..begin[r + 1].
    column : (s,) float64
        Sub-pixel column, ascending within a row; pixel centers lie at halves.
    importance : (s,) float64
        Length of the contour between the two feature points, in pixels (rho).
    distance : (s,) float64
        Distance to the contour, in pixels (DT).
    """

    begin: IntArray
    column: FloatArray
    importance: FloatArray
    distance: FloatArray

    @property
    def row(self) -> IntArray:
        """Row of each crossing, (s,)."""
        return np.repeat(np.arange(len(self.begin) - 1, dtype=np.int32), np.diff(self.begin))


class Scratch:
    """Room for the silhouettes of one size, used again from view to view; one for each thread."""

    def __init__(self, size: int) -> None:
        self.offset = np.zeros((size, size), np.int32)
        self.upright = np.empty((size, size), np.int32)
        self.flat = np.empty((size, size), np.int32)
        self.runs = np.empty((size * size // 2, 3), np.int32)


def skeletonize(
    runs: IntArray, saliency: float, scratch: Scratch, field: Picture = NO_FIELD
) -> Crossings:
    """Return the crossings of a silhouette, given as the runs of its pixels (`Contours`).

    A `field` (h, w) gets the distance transform: negative at pixels beside the skeleton; what lies
    outside stays as it is.

    Raises
    ------
    InvalidShapeError
        When the silhouette touches the border of its picture: it may reach beyond it.
    """
    from medialis.curves.from_views import _kernels as kernels

    check_margin(runs, len(scratch.offset))
    tops = kernels.column_offsets(runs, 0, len(scratch.offset), scratch.offset)
    cracks = 2 * (len(runs) + tops)
    arc, contour = np.empty(cracks), np.empty(cracks, np.int32)
    length = np.empty(cracks // 4)  # a contour has 4 cracks at least
    pictures = scratch.offset, runs, scratch.upright, scratch.flat
    contours = kernels.Contours(*pictures, arc, contour, length, 0.0)
    count = kernels.trace_contours(contours)
    contours = contours._replace(longest=float(contours.length[:count].sum()) / 2)
    begin = np.empty(len(scratch.offset) + 1, np.int32)
    out = kernels.Found(*np.empty((3, pixels_in(runs))))  # at most one crossing a pixel
    count = kernels.saliency_skeleton(contours, saliency, begin, out, field)
    column, importance, distance = (values[:count].copy() for values in out)
    return Crossings(begin, column, importance, distance)


def check_margin(runs: IntArray, size: int) -> None:
    """Raise InvalidShapeError when a silhouette touches the border of its picture."""
    if len(runs) and not 0 < runs.min() <= runs.max() < size:
        raise InvalidShapeError(
            "A silhouette touches the border of its picture: the camera must see the whole shape "
            "with a margin of one pixel."
        )


def runs_of(near: Picture, scratch: Scratch, box: Box | None = None) -> IntArray:
    """Return the runs of the pixels that are not NaN, in a box of rows and columns, if given."""
    from medialis.curves.from_views._draw_kernels import Box
    from medialis.curves.from_views._kernels import find_runs

    box = box or Box(0, len(near), 0, len(near))
    return scratch.runs[: find_runs(near, box, scratch.runs)]


def pixels_in(runs: IntArray) -> int:
    """Return the number of pixels of runs."""
    return int((runs[:, 2] - runs[:, 1]).sum())


@algorithm(SilhouetteOptions, keep=False)
def silhouette_skeleton(
    mask: ArrayLike, options: SilhouetteOptions, progress: Progress
) -> Crossings:
    """Return the saliency skeleton of a binary picture where its rows cross it.

    Parameters
    ----------
    mask : (h, w) bool
        True inside.

    Returns
    -------
    Crossings
        For the crossings of the columns give the transposed picture.

    Raises
    ------
    InvalidShapeError
        When the mask is not a picture.

    See Also
    --------
    view_curve_skeleton : matches the silhouettes of many views.

    Notes
    -----
    Feature points are exact: the nearest pixels outside. The skeleton passes between two neighbours
    in a row whose feature points are far apart along the contour, where the row is as far from the
    one as from the other. Different contours count as the longest. Source: thesis 3.7.3, Eq. 3.6 to
    3.8; `saliency` is sigma_0. Deviates: importance is compared along rows only, since the pairing
    of views needs no more.

    Examples
    --------
    >>> import medialis
    >>> bar = np.zeros((40, 20))
    >>> bar[5:35, 6:13] = 1
    >>> middle = medialis.silhouette_skeleton(bar)
    >>> set(middle.column[(middle.row > 12) & (middle.row < 27)].tolist())
    {9.5}
    """
    array = np.asarray(mask)
    if array.ndim != 2 or array.dtype.kind not in "biuf" or array.size == 0:
        raise InvalidShapeError(
            f"mask must be an (h, w) picture of truth values, got shape {array.shape}."
        )
    height, width = array.shape
    edge = max(height, width) + 2
    near = np.full((edge, edge), np.nan, np.float32)
    near[1 : height + 1, 1 : width + 1][array != 0] = 0.0
    scratch = Scratch(edge)
    framed = skeletonize(runs_of(near, scratch), options.saliency, scratch)
    return Crossings(
        framed.begin[1 : height + 2], framed.column - 1, framed.importance, framed.distance
    )


class Drawn(NamedTuple):
    """A view while it is drawn: all arrays may belong to a canvas, and its next view changes them.

    Attributes
    ----------
    camera : OrthographicCamera
    near, far : (h, w) float32
        NaN outside the silhouette.
    runs : (r, 3) int32
        Runs of the pixels of the silhouette.
    scratch : Scratch
    field : (h, w) float32
        Memory for distances to the contour.
    """

    camera: OrthographicCamera
    near: Picture
    far: Picture
    runs: IntArray
    scratch: Scratch
    field: Picture


def as_drawn(view: View) -> Drawn:
    """Return a view of somebody as if it were drawn here."""
    scratch = Scratch(view.camera.size)
    runs, field = runs_of(view.near, scratch), np.empty_like(view.near)
    return Drawn(view.camera, view.near, view.far, runs, scratch, field)


def pack(drawn: Drawn) -> PackedView:
    """Return the depths of a view and the distances to its contour, packed."""
    from medialis.curves.from_views._view_kernels import BITS, PackedView, pack_view

    side, camera = len(drawn.near), drawn.camera
    words = side * -(-side // BITS)
    mask, ranks = np.zeros(words, np.uint64), np.empty(words, np.int32)
    values = np.empty((pixels_in(drawn.runs), 3), np.float32)
    pack_view(drawn.runs, drawn.near, drawn.far, drawn.field, mask, ranks, values)
    return PackedView(side, camera.center, camera.axes, camera.pixel, mask, ranks, values)


def pair_points(
    first: View | PackedView,
    second: OrthographicCamera,
    left: Crossings | Rows,
    right: Crossings | Rows,
) -> FloatArray:
    """Return the 3D points of two silhouette skeletons whose rows correspond.

    Parameters
    ----------
    first : View or PackedView
    second : OrthographicCamera
        With the same center, extent and up-axis (`check_views`).
    left, right : Crossings or Rows
        Of the one and of the other.

    Returns
    -------
    (k, 3) float64
        In the units and axes of the shape.

    Notes
    -----
    Each crossing of the first view takes the crossing in the same row of the second whose depth is
    nearest to the middle of its depth range. A point outside that range is dropped. Source: thesis
    3.7.4.2, Eq. 3.9, 3.10, with the early stop. Deviates: the depth range of the second view is not
    asked. Sharpening drops what views see outside, and it was one in 3,000 points of the horse.
    """
    from medialis.curves.from_views._kernels import Rows, pair_crossings

    a = pack(as_drawn(first)) if isinstance(first, View) else first
    cosine, sine = float(second.axes[0] @ a.axes[0]), -float(second.axes[0] @ a.axes[2])
    angle = math.atan2(sine, cosine)
    out = np.empty((len(left.column), 3))
    rows, others = (Rows(found.begin, found.column) for found in (left, right))
    count = pair_crossings(rows, a, others, math.cos(angle), math.sin(angle), out)
    return np.einsum("ij,jk->ik", out[:count], a.axes) + a.center
