"""Medial sheets as triangle meshes, with their measures (thesis 6.2.2.3)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.kept import Bound
from medialis.model.medial_sheets import MedialSheets
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.options import Options, algorithm
from medialis.progress import Progress
from medialis.sheets.borders import Borders, find_borders
from medialis.sheets.y_network import smoothed_curves
from medialis.threads import run_patiently
from medialis.validation import FloatArray, IntArray, frozen, hold

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False, repr=False)
class SheetMeshes(Bound):
    """All sheets as one mesh, in which each sheet has its own points and triangles.

    Attributes
    ----------
    mesh : SkeletonMesh
        p points, sheet by sheet, those on the Y-curves included; t triangles.
    point_sheet, face_sheet : (p,) and (t,) int32
        Sheet of each point and of each triangle.
    radii : (p,) float64
        Radius of the ball at each point. (``mesh.rows`` of a point between two balls is one of
        them.)
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
    radii: FloatArray
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
            radii=(np.float64, len(self.mesh.points)),
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
        used, place = np.unique(self.mesh.faces[self.face_sheet == number], return_inverse=True)
        return SkeletonMesh(
            self.mesh.points[used],
            frozen(place.reshape(-1, 3), np.int32),
            self.mesh.rows[used],
            self.mesh.face_origin[self.face_sheet == number],
            cloud=self.sheets.cloud,
            selected=self.sheets.labels == number,
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
    balls of their corners. Where sheets meet, triangles are cut along the Y-curve, so that each
    piece belongs to one sheet; `SkeletonMesh.rows` of a point there is the ball of a corner beside.
    Sheets that end at a crease end on it. Triangles longer than four spacings between different
    sheets (jumps at concave edges without fans) are left out.

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
    """Lift and cut the triangles on the fronts of the sheets, and measure each sheet."""
    cloud, unfolded = sheets.cloud, sheets.unfolded
    borders = find_borders(sheets)
    pieces = _pieces(sheets, borders)
    points = np.concatenate([unfolded.centers, borders.points, borders.middles])
    radii = np.concatenate([unfolded.radii, borders.radii, borders.middle_radii])
    # Each sheet has its own points: those of sheet s and place p come in the order of s n + p.
    key = pieces.sheet[:, None] * len(points) + pieces.triangles
    own, first, place = np.unique(key, return_index=True, return_inverse=True)
    point_sheet, places = np.divmod(own, len(points)) if len(own) else (own, own)
    mesh = SkeletonMesh(
        points[places],
        frozen(place.reshape(-1, 3), np.int32),
        frozen(unfolded.rows[pieces.beside.ravel()[first]], np.int32),
        frozen(pieces.origin, np.int32),
        cloud=cloud,
        selected=sheets.labels >= 0,
    )
    areas = np.bincount(pieces.sheet, mesh.face_areas, sheets.count).astype(np.float64)
    mean, radius = np.full(sheets.count, np.nan), radii[pieces.triangles].mean(axis=1)
    total = np.bincount(pieces.sheet, mesh.face_areas * radius, sheets.count)
    np.divide(total, areas, out=mean, where=areas > 0)
    around = _boundaries(mesh, point_sheet, sheets.count)
    of_points, of_faces = frozen(point_sheet, np.int32), frozen(pieces.sheet, np.int32)
    return SheetMeshes(mesh, of_points, of_faces, radii[places], areas, around, mean, sheets=sheets)


class _Pieces(NamedTuple):
    """Triangles between nodes, borders (b) and triple points, each in one sheet.

    Node i is place i, border i is place u + i, the place where three meet u + b + i.
    """

    triangles: Index
    sheet: Index
    origin: Index
    beside: Index
    """For each corner of the triangles, a node of the same sheet there or beside it."""


def _pieces(sheets: MedialSheets, borders: Borders) -> _Pieces:
    """Cut the triangles between sheets, and take what lies on the fronts."""
    unfolded, labels, front = sheets.unfolded, sheets.node_labels, sheets.node_front
    faces, sides = np.asarray(unfolded.faces).astype(np.int64), borders.sides
    u, crossed = len(unfolded), (sides >= 0).sum(axis=1)
    clear = (sides != -2).all(axis=1)
    whole, double = (np.flatnonzero(clear & (crossed == c)) for c in (0, 2))
    corners = faces[whole]
    mostly = front[corners].sum(axis=1) >= 2
    parts = [(corners[mostly], corners[mostly], whole[mostly])]
    # The corner on a sheet of its own comes first: the side across from it is the one not crossed.
    turn = ((sides[double].argmin(axis=1) + 2)[:, None] + np.arange(3)) % 3
    c, a, b = np.take_along_axis(faces[double], turn, axis=1).T
    ca, _, bc = u + np.take_along_axis(sides[double], turn, axis=1).T
    both = front[a] & front[b]
    parts.append(_piece((c, ca, bc), (c, c, c), double, front[c]))
    parts.append(_piece((a, b, bc), (a, b, b), double, both))
    parts.append(_piece((a, bc, ca), (a, b, a), double, both))
    triple = borders.triple
    tip = u + len(borders.ends) + np.arange(len(triple))
    for j in range(3):
        c, after, before = faces[triple, j], sides[triple, j] + u, sides[triple, j - 1] + u
        parts.append(_piece((c, after, tip), (c, c, c), triple, front[c]))
        parts.append(_piece((c, tip, before), (c, c, c), triple, front[c]))
    triangles, beside, which = (np.concatenate(part) for part in zip(*parts, strict=True))
    known = labels[beside[:, 0]] >= 0
    triangles, beside, which = triangles[known], beside[known], which[known]
    sheet, origin = labels[beside[:, 0]].astype(np.int64), np.asarray(unfolded.face_origin)[which]
    return _Pieces(triangles, sheet, origin, beside)


def _piece(
    places: tuple[Index, Index, Index],
    beside: tuple[Index, Index, Index],
    which: Index,
    chosen: NDArray[np.bool_],
) -> tuple[Index, Index, Index]:
    """Stack the corners of triangles, and take some of them."""
    return np.stack(places, axis=1)[chosen], np.stack(beside, axis=1)[chosen], which[chosen]


def _boundaries(mesh: SkeletonMesh, point_sheet: Index, count: int) -> NDArray[np.float64]:
    """Length of the edges with one triangle, for each sheet, without the zigzag between samples."""
    table = mesh.edge_table
    links = np.stack([table.low, table.high], axis=1)[table.counts == 1]
    points = smoothed_curves(mesh.points, links)
    length = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    return np.bincount(point_sheet[links[:, 0]], length, count).astype(np.float64)
