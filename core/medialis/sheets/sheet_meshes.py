"""Medial sheets as triangle meshes, with their measures (thesis 6.2.2.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.model.medial_cloud import MedialCloud
from medialis.model.medial_sheets import MedialSheets
from medialis.model.shape import Shape
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.sheets.extended_features import check_cloud
from medialis.sheets.y_network import LONGEST_JUMP, smoothed_curves
from medialis.surface.surface_graph import local_spacing
from medialis.validation import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class SheetMeshes:
    """All sheets as one mesh, each triangle in one sheet.

    Attributes
    ----------
    mesh : SkeletonMesh
        p points, t triangles; triangles at a border reach into the other sheet.
    face_sheet : (t,) int32
        Sheet of each triangle.
    areas : (count,) float64
        Of each sheet; 0 where a sheet has no triangle.
    boundaries : (count,) float64
        Length of the edges that belong to one triangle of a sheet only, its rim and its Y-curves,
        smoothed: they zigzag from sample to sample.
    mean_radii : (count,) float64
        Mean radius of the balls of each sheet, by area; NaN without a triangle.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    mesh: SkeletonMesh
    face_sheet: IntArray
    areas: FloatArray
    boundaries: FloatArray
    mean_radii: FloatArray

    def __post_init__(self) -> None:
        count, t = np.size(self.areas), len(self.mesh.faces)
        for name, dtype, rows in (
            ("face_sheet", np.int32, t),
            ("areas", np.float64, count),
            ("boundaries", np.float64, count),
            ("mean_radii", np.float64, count),
        ):
            value = np.asarray(getattr(self, name))
            if value.shape != (rows,):
                raise InvalidShapeError(f"{name} must have shape ({rows},), got {value.shape}.")
            object.__setattr__(self, name, frozen(value, dtype))

    def sheet(self, number: int) -> SkeletonMesh:
        """Return one sheet as a mesh of its own.

        Raises
        ------
        InvalidShapeError
            When there is no such sheet.
        """
        if not 0 <= number < len(self.areas):
            raise InvalidShapeError(f"There are sheets 0..{len(self.areas) - 1}, got {number}.")
        rows = np.flatnonzero(self.face_sheet == number)
        used, place = np.unique(self.mesh.faces[rows], return_inverse=True)
        return SkeletonMesh(
            self.mesh.points[used],
            frozen(place.reshape(-1, 3), np.int32),
            self.mesh.rows[used],
            self.mesh.face_origin[rows],
        )


def sheet_meshes(
    shape: Shape,
    cloud: MedialCloud,
    sheets: MedialSheets,
) -> SheetMeshes:
    """Connect the points of each medial sheet to triangles.

    Parameters
    ----------
    shape : Shape
        The mesh from which the cloud was computed.
    cloud : MedialCloud
        All k balls.
    sheets : MedialSheets
        From `medialis.medial_sheets`.

    Returns
    -------
    SheetMeshes

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, or cloud and sheets do not belong together.

    Notes
    -----
    The triangles on the front of a sheet (`MedialSheets.front`) are moved to the centers of the
    balls of their corners. A triangle belongs to a sheet when two of its corners or more are on its
    front, so areas are good to half a sample spacing along the border. Triangles longer than four
    spacings between different sheets (jumps at concave edges) are left out.

    `medialis.skeleton_mesh` makes one mesh of the whole skeleton instead, in which sheets are
    connected.

    Source: thesis 6.2.2.3, Eq. 6.6-6.7. Deviates: the sides are told apart by pieces linked along
    the surface and partners across the sheet, not by geodesics to a reference point.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> cloud = medialis.surface_skeleton(shape)
    >>> sheets = medialis.medial_sheets(shape, cloud)
    >>> meshes = medialis.sheet_meshes(shape, cloud, sheets)
    >>> len(meshes.areas) == sheets.count, bool(meshes.areas.sum() > 0)
    (True, True)
    """
    if len(sheets) != len(cloud):
        raise InvalidShapeError(
            f"There are {len(cloud)} balls, but sheets of {len(sheets)}: give the sheets of this "
            "cloud."
        )
    if shape.faces is None:
        raise InvalidShapeError(
            "Sheet meshes need a surface with faces, got a point cloud: reconstruct a surface "
            "first, or show the sheets as points."
        )
    check_cloud(shape, cloud)
    parts = []
    for sign in (1, -1):
        rows = np.flatnonzero(cloud.valid & (cloud.side == sign))
        parts.append(_lifted(shape, cloud, rows, sheets))
    corners = np.concatenate([part[0] for part in parts])
    face_sheet = np.concatenate([part[1] for part in parts])
    used, place = np.unique(corners, return_inverse=True)
    origin = np.concatenate([part[2] for part in parts])
    mesh = SkeletonMesh(
        cloud.centers[used],
        frozen(place.reshape(-1, 3), np.int32),
        frozen(used, np.int32),
        frozen(origin, np.int32),
    )
    areas = np.bincount(face_sheet, mesh.face_areas, sheets.count).astype(np.float64)
    radius = cloud.radii[corners].mean(axis=1)
    mean = np.full(sheets.count, np.nan)
    total = np.bincount(face_sheet, mesh.face_areas * radius, sheets.count)
    np.divide(total, areas, out=mean, where=areas > 0)
    boundaries = _boundaries(mesh, face_sheet, sheets.count)
    return SheetMeshes(mesh, frozen(face_sheet, np.int32), areas, boundaries, mean)


def _lifted(
    shape: Shape, cloud: MedialCloud, rows: NDArray[np.int64], sheets: MedialSheets
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the cloud, sheet and origin of each triangle on the front of a sheet."""
    row_of = np.full(shape.point_count, -1, np.int64)
    row_of[cloud.source[rows]] = rows
    faces = np.asarray(shape.faces)
    corners = row_of[faces]
    known = (corners >= 0).all(axis=1)
    front = sheets.front[corners]
    key = np.where(front & (corners >= 0), sheets.labels[corners], -1)
    low, middle, high = np.sort(key, axis=1).T
    chosen = known & (middle >= 0) & ((low == middle) | (middle == high))
    # Between sheets, a triangle may not be longer than a border is wide.
    reach = LONGEST_JUMP * local_spacing(shape)[faces].max(axis=1)
    a, b, c = (cloud.centers[corners[:, j]] for j in range(3))
    longest = np.max([np.linalg.norm(v, axis=1) for v in (a - b, b - c, c - a)], axis=0)
    labels = sheets.labels[corners]
    inside = (labels[:, :1] == labels).all(axis=1)
    chosen &= inside | (longest <= reach)
    corner = corners[chosen]
    spread = (corner != corner[:, [1, 2, 0]]).all(axis=1)
    return corner[spread], middle[chosen][spread], np.flatnonzero(chosen)[spread]


def _boundaries(
    mesh: SkeletonMesh, face_sheet: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """Length of the edges with one triangle, for each sheet, without their zigzag."""
    half = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    sheet = np.repeat(face_sheet, 3)
    order = np.lexsort((half[:, 1], half[:, 0], sheet))
    rows = np.column_stack([sheet[order], half[order]]).astype(np.int64)
    new = np.r_[True, (rows[1:] != rows[:-1]).any(axis=1)][: len(rows)]
    single = rows[new & np.r_[new[1:], True][: len(rows)]]
    # A point on the boundaries of two sheets is two nodes.
    keys = single[:, :1] * len(mesh.points) + single[:, 1:]
    known, place = np.unique(keys, return_inverse=True)
    links = place.reshape(-1, 2)
    points = smoothed_curves(mesh.points[known % max(len(mesh.points), 1)], links)
    length = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    return np.bincount(single[:, 0], length, count).astype(np.float64)
