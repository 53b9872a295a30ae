"""MedialCloud: maximal balls with their two feature points (thesis 3.2.1, 3.5.1)."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.arrays import Mask, Ragged
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.validation import FloatArray, IntArray, Measures, Positions, frozen, hold
from medialis.shape.shape import Shape


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
        hold(
            self,
            centers=(np.float64, k, 3),
            radii=(np.float64, k),
            features=(np.int32, k, 2),
            source=(np.int32, k),
            status=(np.int8, k),
            spoke_angles=(np.float64, k),
            side=(np.int8, k),
            contact_faces=(np.int32, k),
            contact_weights=(np.float64, k, 3),
        )

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

    def with_rows(self, rows: NDArray[Any], **columns: NDArray[Any]) -> Self:
        """Return these balls with other values of some columns in some rows."""
        changed = {name: np.array(getattr(self, name)) for name in columns}
        for name, values in columns.items():
            changed[name][rows] = values
        return replace(self, **changed)


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
        first, second = (self.surface.normals[self.features[rows, j]] for j in (0, 1))
        cosine = np.clip(np.einsum("ij,ij->i", first, second), -1.0, 1.0)
        known = first.any(axis=1) & second.any(axis=1)
        angles[rows] = np.where(known, np.minimum(angles[rows], np.arccos(cosine)), 0.0)
        return frozen(angles, np.float64)

    @cached_property
    def inverse_features(self) -> Ragged:
        """For each sample the valid skeleton points that touch it (thesis 3.5.1)."""
        features = np.where(self.valid[:, None], self.features, -1)
        touching = Ragged.group(features.ravel(), self.surface.point_count)
        return Ragged(touching.offsets, touching.indices // 2)
