"""Thickness of the wall behind every point of the surface (thesis 3.5.1, Figure 3.11).

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
from numpy.typing import NDArray

from medialis.balls.surface_skeleton import as_cloud
from medialis.errors import InvalidShapeError
from medialis.fields.completion import CompletedField, complete, complete_again
from medialis.fields.feature_transform import field_on_surface
from medialis.kept import kept
from medialis.model.medial_cloud import MedialCloud
from medialis.options import Options, algorithm, angle, choice
from medialis.progress import Progress
from medialis.threads import run_patiently
from medialis.validation import FloatArray, frozen

ThicknessKind = Literal["diameter", "radius"]

WALL_ANGLE = 120.0
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
        "The diameter of the ball, as a caliper measures, or its radius.",
        ("diameter", "radius"),
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
    cloud: MedialCloud,
    samples: NDArray[np.bool_],
    options: ThicknessOptions,
    before: CompletedField,
) -> CompletedField | None:
    """Return the diameters as if some samples had no ball; None where no ball is left.

    `before` is the same with fewer samples left out: only what is near the others is completed.
    """
    measured = _diameters(cloud, samples, math.radians(options.min_spoke_angle))
    return None if measured is None else complete_again(before, *measured)


def _diameters(
    cloud: MedialCloud, without: NDArray[np.bool_], angle: float
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


def wall_balls(cloud: MedialCloud) -> NDArray[np.int64]:
    """Return the rows of the inner balls between two walls (`WALL_ANGLE`)."""
    return np.flatnonzero((cloud.side > 0) & (cloud.wall_angles >= math.radians(WALL_ANGLE)))


def unresolved_walls(cloud: MedialCloud) -> NDArray[np.bool_]:
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
