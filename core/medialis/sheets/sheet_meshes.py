"""Medial sheets as triangle meshes, with their measures (thesis 6.2.2.3)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import Bound
from medialis.model.medial_sheets import MedialSheets
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.options import Options, algorithm
from medialis.progress import Progress
from medialis.sheets.y_network import LONGEST_JUMP, smoothed_curves
from medialis.surface.surface_graph import local_spacing
from medialis.threads import run_patiently
from medialis.validation import FloatArray, IntArray, frozen, hold


@dataclass(frozen=True, eq=False, repr=False)
class SheetMeshes(Bound):
    """All sheets as one mesh, in which each sheet has its own points and triangles.

    Attributes
    ----------
    mesh : SkeletonMesh
        p points, sheet by sheet; t triangles in the order of the surface, of which those at a
        border end in the other sheet.
    point_sheet, face_sheet : (p,) and (t,) int32
        Sheet of each point and of each triangle.
    areas : (count,) float64
        Of each sheet; 0 where a sheet has no triangle.
    boundaries : (count,) float64
        Length of the edges that belong to one triangle of a sheet only, its rim and its Y-curves,
        smoothed: they zigzag from sample to sample.
    mean_radii : (count,) float64
        Mean radius of the balls of each sheet, by area; NaN without a triangle.
    sheets : MedialSheets
        The sheets.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    mesh: SkeletonMesh
    point_sheet: IntArray
    face_sheet: IntArray
    areas: FloatArray
    boundaries: FloatArray
    mean_radii: FloatArray
    sheets: MedialSheets = field(kw_only=True)

    def __post_init__(self) -> None:
        count = self.sheets.count
        hold(
            self,
            point_sheet=(np.int32, len(self.mesh.points)),
            face_sheet=(np.int32, len(self.mesh.faces)),
            areas=(np.float64, count),
            boundaries=(np.float64, count),
            mean_radii=(np.float64, count),
        )

    def sheet(self, number: int) -> SkeletonMesh:
        """Return one sheet as a mesh of its own.

        Raises
        ------
        InvalidShapeError
            When there is no such sheet.
        """
        if not 0 <= number < self.sheets.count:
            raise InvalidShapeError(f"There are sheets 0..{self.sheets.count - 1}, got {number}.")
        chosen = self.face_sheet == number
        return SkeletonMesh.of_rows(
            self.sheets.cloud,
            self.mesh.rows[self.mesh.faces[chosen]],
            self.mesh.face_origin[chosen],
            self.sheets.labels == number,
        )

    def __repr__(self) -> str:
        return f"SheetMeshes({self.sheets.count} sheets, {len(self.mesh.faces)} faces)"


@algorithm(Options)
def sheet_meshes(sheets: MedialSheets, options: Options, progress: Progress) -> SheetMeshes:
    """Connect the points of each medial sheet to triangles.

    Parameters
    ----------
    sheets : MedialSheets
        Sheets of all balls of a mesh.

    Returns
    -------
    SheetMeshes

    Raises
    ------
    InvalidShapeError
        When the surface has no faces.

    See Also
    --------
    skeleton_mesh : one mesh of the whole skeleton, in which sheets are connected.

    Notes
    -----
    The triangles on the front of a sheet (`MedialSheets.front`) are moved to the centers of the
    balls of their corners. A triangle belongs to a sheet when two of its corners or more are on its
    front, so areas are good to half a sample spacing along the border. Triangles longer than four
    spacings between different sheets (jumps at concave edges) are left out.

    Source: thesis 6.2.2.3, Eq. 6.6-6.7. Deviates: the sides are told apart by pieces linked along
    the surface and partners across the sheet, not by geodesics to a reference point.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> sheets = medialis.medial_sheets(cloud)
    >>> meshes = medialis.sheet_meshes(sheets)
    >>> len(meshes.areas) == sheets.count, bool(meshes.areas.sum() > 0)
    (True, True)
    """
    cloud = sheets.cloud
    if cloud.surface.faces is None:
        raise InvalidShapeError(
            "Sheet meshes need a surface with faces, got a point cloud: reconstruct a surface "
            "first, or show the sheets as points."
        )
    with progress.stage("sheet meshes", 0.0, 1.0):
        return run_patiently(lambda: _meshed(sheets), progress)


def _meshed(sheets: MedialSheets) -> SheetMeshes:
    """Lift the triangles of both sides, and measure each sheet."""
    cloud = sheets.cloud
    parts = [_lifted(sheets, sign) for sign in (1, -1)]
    triangles, face_sheet, origin = (np.concatenate(part) for part in zip(*parts, strict=True))
    # Each sheet has its own points: those of sheet s and row r come in the order of s k + r.
    own, place = np.unique(face_sheet[:, None] * len(cloud) + triangles, return_inverse=True)
    point_sheet, rows = np.divmod(own, len(cloud)) if len(own) else (own, own)
    mesh = SkeletonMesh(
        cloud.centers[rows],
        frozen(place.reshape(-1, 3), np.int32),
        frozen(rows, np.int32),
        frozen(origin, np.int32),
        cloud=cloud,
        selected=sheets.labels >= 0,
    )
    areas = np.bincount(face_sheet, mesh.face_areas, sheets.count).astype(np.float64)
    mean, radius = np.full(sheets.count, np.nan), cloud.radii[triangles].mean(axis=1)
    total = np.bincount(face_sheet, mesh.face_areas * radius, sheets.count)
    np.divide(total, areas, out=mean, where=areas > 0)
    around = _boundaries(mesh, point_sheet, sheets.count)
    points, faces = frozen(point_sheet, np.int32), frozen(face_sheet, np.int32)
    return SheetMeshes(mesh, points, faces, areas, around, mean, sheets=sheets)


def _lifted(
    sheets: MedialSheets, sign: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the cloud, sheet and origin of each triangle on the front of a sheet."""
    cloud, shape = sheets.cloud, sheets.cloud.surface
    rows = np.flatnonzero(cloud.valid & (cloud.side == sign))
    row_of = np.full(shape.point_count, -1, np.int64)
    row_of[cloud.source[rows]] = rows
    faces = np.asarray(shape.faces)
    corners = row_of[faces]
    known = (corners >= 0).all(axis=1)
    labels = sheets.labels[corners]
    key = np.where(sheets.front[corners] & (corners >= 0), labels, -1)
    low, middle, high = np.sort(key, axis=1).T
    chosen = known & (middle >= 0) & ((low == middle) | (middle == high))
    # Between sheets, a triangle may not be longer than a border is wide.
    limit = LONGEST_JUMP * local_spacing(shape)[faces].max(axis=1)
    a, b, c = (cloud.centers[corners[:, j]] for j in range(3))
    longest = np.max([np.linalg.norm(v, axis=1) for v in (a - b, b - c, c - a)], axis=0)
    chosen &= (labels[:, :1] == labels).all(axis=1) | (longest <= limit)
    corner = corners[chosen]
    spread = (corner != corner[:, [1, 2, 0]]).all(axis=1)
    return corner[spread], middle[chosen][spread].astype(np.int64), np.flatnonzero(chosen)[spread]


def _boundaries(
    mesh: SkeletonMesh, point_sheet: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """Length of the edges with one triangle, for each sheet, without their zigzag."""
    table = mesh.edge_table
    links = np.stack([table.low, table.high], axis=1)[table.counts == 1]
    points = smoothed_curves(mesh.points, links)
    length = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    return np.bincount(point_sheet[links[:, 0]], length, count).astype(np.float64)
