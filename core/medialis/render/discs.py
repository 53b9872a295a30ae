"""Points of sheets as small discs along them: shaded like the surface they sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.model.shape import Shape
from medialis.validation import FloatArray

NEIGHBOURS = 8
"""Nearest points whose axes make the axis of a disc; the fourth of them is at its rim."""

FLAT = 0.75
"""Share of the squared axes that lies along their mean where the points are those of a sheet."""

CORNERS = 7


def sheet_discs(
    points: FloatArray, axes: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray, FloatArray]:
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
    from medialis._kernels.neighbours import nearest_others

    if len(points) < 3:
        none = np.zeros(len(points))
        return none, none.astype(bool), np.zeros((len(points), 3)), none
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    units = np.divide(axes, lengths, out=np.zeros_like(axes), where=lengths > 0)
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
    first = np.cross(axes, away)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axes, first)
    turn = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    rim = (
        first[:, None] * np.cos(turn)[None, :, None] + second[:, None] * np.sin(turn)[None, :, None]
    )
    corners = points[:, None] + radii[:, None, None] * rim
    fan = np.array([[0, k, k + 1] for k in range(1, CORNERS - 1)], np.int32)
    start = np.arange(len(points), dtype=np.int32)[:, None, None] * np.int32(CORNERS)
    return corners.reshape(-1, 3), (start + fan).reshape(-1, 3)


def lifted_faces(
    shape: Shape, source: NDArray[np.integer], points: FloatArray, longest: FloatArray
) -> NDArray[np.int32]:
    """Return the triangles of the shape whose corners are moved to their medial points.

    `source` are the vertices that the points belong to; no edge is longer than `longest` of both
    its ends, as it is where the corners belong to different sheets.
    """
    if shape.faces is None or len(points) == 0:
        return np.zeros((0, 3), np.int32)
    row = np.full(shape.point_count, -1, np.int32)
    row[source[::-1]] = np.arange(len(source) - 1, -1, -1, dtype=np.int32)
    faces = row[shape.faces]
    faces = faces[(faces >= 0).all(axis=1)]
    for k in range(3):
        a, b = faces[:, k], faces[:, k - 1]
        length = np.linalg.norm(points[a] - points[b], axis=1)
        faces = faces[length <= np.minimum(longest[a], longest[b])]
    return faces
