"""Medial sheets as triangle meshes, with their measures (thesis 6.2.2.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.medial_cloud import MedialCloud
from medialis.model.medial_sheets import MedialSheets
from medialis.model.shape import Shape
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.progress import Progress, ProgressCallback
from medialis.surface_skeletons.skeleton_mesh import skeleton_mesh
from medialis.validation import FloatArray, IntArray, frozen


@dataclass(frozen=True, eq=False)
class SheetMeshes:
    """All sheets as one mesh, each triangle in one sheet.

    Attributes
    ----------
    mesh : SkeletonMesh
        p points, t triangles; sheets share points where they meet.
    face_sheet : (t,) int32
        Sheet of each triangle.
    areas : (count,) float64
        Of each sheet; 0 where a sheet has no triangle.
    boundaries : (count,) float64
        Length of the edges that belong to one triangle of a sheet only: its rim and its Y-curves.
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
            place.reshape(-1, 3),
            self.mesh.rows[used],
            self.mesh.face_origin[rows],
        )


def sheet_meshes(
    shape: Shape,
    cloud: MedialCloud,
    sheets: MedialSheets,
    *,
    progress: Progress | ProgressCallback | None = None,
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
    progress : callable, optional
        Called with (fraction, text); returning False cancels.

    Returns
    -------
    SheetMeshes

    Raises
    ------
    InvalidShapeError
        When the shape has no faces, or cloud and sheets do not belong together.
    Cancelled
        When `progress` asks for it.

    Notes
    -----
    `medialis.skeleton_mesh` copies the triangles of one side of each sheet. A triangle belongs to
    the sheet of most of its corners (of three different ones: the lowest, which is the largest). A
    triangle across a Y-curve goes to one of its sheets, so areas are good to half a sample spacing
    along it.

    Source: thesis 6.2.2.3, Eq. 6.6-6.7. Deviates: both sides are aligned by signs that are carried
    over the mesh, not by geodesics to a reference point.

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
    mesh = skeleton_mesh(shape, cloud, progress=progress)
    low, middle, high = np.sort(sheets.labels[mesh.rows][mesh.faces], axis=1).T
    face_sheet = np.where((low != middle) & (middle != high), low, middle)
    areas = np.bincount(face_sheet, mesh.face_areas, sheets.count)
    radius = cloud.radii[mesh.rows][mesh.faces].mean(axis=1)
    mean = np.full(sheets.count, np.nan)
    total = np.bincount(face_sheet, mesh.face_areas * radius, sheets.count)
    np.divide(total, areas, out=mean, where=areas > 0)
    return SheetMeshes(mesh, face_sheet, areas, _boundaries(mesh, face_sheet, sheets.count), mean)


def _boundaries(mesh: SkeletonMesh, face_sheet: IntArray, count: int) -> FloatArray:
    """Length of the edges with one triangle, for each sheet."""
    half = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    sheet = np.repeat(face_sheet, 3)
    order = np.lexsort((half[:, 1], half[:, 0], sheet))
    rows = np.column_stack([sheet[order], half[order]])
    new = np.r_[True, (rows[1:] != rows[:-1]).any(axis=1)][: len(rows)]
    single = new & np.r_[new[1:], True][: len(rows)]
    a, b = mesh.points[rows[single, 1]], mesh.points[rows[single, 2]]
    return np.bincount(rows[single, 0], np.linalg.norm(a - b, axis=1), count)
