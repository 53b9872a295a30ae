"""Medial points as pictures show them: sheets of triangles; what lies on none as discs and balls.

The triangles of the surface, lifted to the points of their corners, are the sheets
(`skeleton_mesh`): the same that the operation of that name gives, of the points that are shown.
Points near a sheet lie on it, so they are not drawn besides; others are the skeleton of a limb that
is a curve, of a point cloud, or of a cloud that was thinned. These are discs where their
neighbours tell that they lie on a sheet, else balls.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Mask, kd_tree, unit_rows
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray
from medialis.operations.result import Layer
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import BallStatus, MedialCloud
from medialis.skeleton.skeleton_mesh import SkeletonMesh, lifted, with_clean_rims

MEDIAL = {"feature_1", "feature_2", "radius", "source", "side", "spoke_angle"}
"""Attributes of points that are drawn as pieces of sheets."""

BRIDGE = 2
"""Edges: gaps of sheets that are closed, as `skeleton_mesh` does by default."""

ON_SHEET = 3.0
"""Sample spacings: a point no farther from a sheet is drawn by it."""

NEIGHBOURS = 8
"""Nearest points whose axes make the axis of a disc; the fourth of them is at its rim."""

FLAT = 0.75
"""Share of the squared axes that lies along their mean where the points are those of a sheet."""

CORNERS = 7


def sheet_discs(
    points: FloatArray, axes: FloatArray
) -> tuple[FloatArray, Mask, FloatArray, FloatArray]:
    """Return the radius of a disc at each point, where it lies in a sheet, its axis, and its reach.

    The reach is the distance of the last near point.

    Axes (p, 3) cross the sheet, either way round, zero where unknown; they are averaged over near
    points. Points of curves, round which the axes turn, and lone ones are in no sheet.

    Examples
    --------
    >>> x, y = (c.ravel() for c in np.mgrid[0:9, 0:9].astype(float))
    >>> flat = np.stack([x, y, 0 * x], axis=1)
    >>> radii, sheet, axes, reach = sheet_discs(flat, np.tile([0.0, 0.0, -2.0], (81, 1)))
    >>> float(radii[40]), bool(sheet.all()), np.abs(axes[40]).tolist()
    (1.0, True, [0.0, 0.0, 1.0])
    """
    from medialis.base.box_tree import nearest_others

    if len(points) < 3:
        none = np.zeros(len(points))
        return none, none.astype(bool), np.zeros((len(points), 3)), none
    units = unit_rows(axes)
    near, distances = nearest_others(np.asarray(points, np.float64), NEIGHBOURS)
    tensors = np.einsum("nki,nkj->nij", units[near], units[near])
    tensors += np.einsum("ni,nj->nij", units, units)
    sizes, directions = np.linalg.eigh(tensors)
    total = sizes.sum(axis=1)
    reach = distances[:, min(3, near.shape[1] - 1)]
    middle = float(np.median(reach))
    flat = (sizes[:, 2] >= FLAT * total) & (total > 0) & (reach <= 4 * middle)
    radii = np.clip(reach, 0.5 * middle, 1.5 * middle)
    return radii, flat, directions[:, :, 2], distances[:, -1]


def disc_mesh(
    points: FloatArray, axes: FloatArray, radii: FloatArray
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return points and triangles of one regular polygon for each point, `CORNERS` - 2 triangles.

    Triangles of disc i are the rows from i * (CORNERS - 2) on.
    """
    away = np.where(np.abs(axes[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = unit_rows(np.cross(axes, away))
    second = np.cross(axes, first)
    turn = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    rim = (
        first[:, None] * np.cos(turn)[None, :, None] + second[:, None] * np.sin(turn)[None, :, None]
    )
    corners = points[:, None] + radii[:, None, None] * rim
    fan = np.array([[0, k, k + 1] for k in range(1, CORNERS - 1)], np.int32)
    start = np.arange(len(points), dtype=np.int32)[:, None, None] * np.int32(CORNERS)
    return corners.reshape(-1, 3), (start + fan).reshape(-1, 3)


class MedialPieces(NamedTuple):
    """What stands for medial points in a picture.

    Attributes
    ----------
    sheets : (p, 3) float64 and (t, 3) int32
        Points and triangles of the sheets.
    of_sheets : (p,) int
        The medial point of each of their points.
    discs : (q, 3) float64 and (f, 3) int32
        Points and triangles of discs.
    of_discs : (f,) int
        The point of each triangle of a disc.
    centers, radii : (b, 3) and (b,) float64
        Balls, smaller than those of the points.
    of_balls : (b,) int
        The point of each.
    """

    sheets: tuple[FloatArray, NDArray[np.int32]]
    of_sheets: NDArray[np.int32]
    discs: tuple[FloatArray, NDArray[np.int32]]
    of_discs: Index
    centers: FloatArray
    radii: FloatArray
    of_balls: Index


def medial_pieces(shape: Shape, layer: Layer, rows: Index) -> MedialPieces:
    """Return what to draw for these points of a layer of medial points.

    Parameters
    ----------
    shape : Shape
        That features and sources of the points name the samples of.
    layer : Layer
        With all of `MEDIAL`.
    rows : (p,) int
        Points that are shown; the result numbers them from 0.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("surface_skeleton", medialis.organic_shape(56))
    >>> layer = result.layers[0]
    >>> drawn = medial_pieces(result.shape, layer, np.flatnonzero(~layer.hidden))
    >>> len(drawn.sheets[1]) > 1000, len(drawn.of_balls) < 100
    (True, True)
    """
    points = np.asarray(layer.points)[rows]
    mesh = _sheets(shape, layer, rows)
    alone = np.arange(len(points))
    if len(mesh.faces):
        near = kd_tree(mesh.points).query(points)[0]
        alone = np.flatnonzero(near > ON_SHEET * shape.spacing)
    first, second = (layer.attributes[f"feature_{k}"][rows[alone]] for k in (1, 2))
    axes = shape.points[first] - shape.points[second]
    radii, flat, axes, _ = sheet_discs(points[alone], axes)
    # A disc or ball stays well within the shape, as the medial ball of its point does.
    radii = np.minimum(radii, 0.5 * layer.attributes["radius"][rows[alone]])
    discs = disc_mesh(points[alone[flat]], axes[flat], radii[flat])
    of_discs, of_balls = np.repeat(alone[flat], CORNERS - 2), alone[~flat]
    sheets = mesh.points, np.asarray(mesh.faces)
    return MedialPieces(
        sheets, mesh.rows, discs, of_discs, points[of_balls], radii[~flat] / 2, of_balls
    )


def _sheets(shape: Shape, layer: Layer, rows: Index) -> SkeletonMesh:
    """Return the sheets between these points."""
    known = {name: np.asarray(layer.attributes[name])[rows] for name in MEDIAL}
    features = np.stack([known["feature_1"], known["feature_2"]], axis=1)
    status = np.full(len(rows), BallStatus.OK, np.int8)
    cloud = MedialCloud(
        np.asarray(layer.points)[rows], known["radius"], features, known["source"], status,
        known["spoke_angle"], known["side"], surface=shape,
    )  # fmt: skip
    own = np.zeros(len(rows), np.bool_)
    if shape.faces is None:
        return SkeletonMesh.of_rows(cloud, np.empty((0, 3), np.int32), np.empty(0, np.int32), own)
    # The balls of fans come behind those of the samples.
    place = 2 * known["source"].astype(np.int64) + (known["side"] > 0)
    own[np.unique(place, return_index=True)[1]] = True
    return with_clean_rims(lifted(cloud, own, BRIDGE, Progress.of(None)))
