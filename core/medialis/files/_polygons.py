"""Polygons to triangles: same plane, same orientation, no new vertices.

Strategy: polygons are grouped by their number of corners and each group is cut at once. A quad
takes the diagonal that leaves both triangles facing the way the polygon faces, the shorter one when
both do. A larger polygon is a fan from its first corner when all triangles of the fan face that
way (always so when it is convex without straight corners); the rare others are cut ear by ear.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.progress import Message
from medialis.validation import FloatArray, IntArray


def triangulate(
    points: FloatArray, counts: NDArray[np.int64], corners: NDArray[np.int64]
) -> tuple[IntArray, tuple[Message, ...]]:
    """Cut polygons into triangles, in the order of the polygons.

    Parameters
    ----------
    points : (n, 3) float64
    counts : (p,) int64
        Corners of each polygon; polygons with fewer than three are left out.
    corners : (sum of counts,) int64
        Vertex indices.

    Returns
    -------
    faces : (m, 3) int32
    messages : tuple of Message
        What was split or left out.

    Raises
    ------
    InvalidShapeError
        When a corner is not a vertex.
    """
    _check_corners(len(points), counts, corners)
    if len(counts) == 0 or (counts == 3).all():
        return corners.reshape(-1, 3).astype(np.int32), ()
    starts = np.cumsum(counts) - counts
    made = np.maximum(counts - 2, 0)
    places = np.cumsum(made) - made
    faces = np.empty((int(made.sum()), 3), np.int32)
    for size in np.unique(counts[counts >= 3]):
        rows = np.flatnonzero(counts == size)
        polygons = corners[starts[rows, None] + np.arange(size)]
        target = places[rows, None] + np.arange(size - 2)
        faces[target] = _split(points, polygons)
    return faces, _split_messages(counts)


def _check_corners(n: int, counts: NDArray[np.int64], corners: NDArray[np.int64]) -> None:
    bad = (corners < 0) | (corners >= n)
    if not bad.any():
        return
    polygon = np.repeat(np.arange(len(counts)), counts)
    first = int(bad.argmax())
    raise InvalidShapeError(
        f"faces must name vertices 0..{n - 1} (counted from 0), but {len(np.unique(polygon[bad]))} "
        f"of {len(counts)} do not (first: face {polygon[first]} names vertex {corners[first]})."
    )


def _split_messages(counts: NDArray[np.int64]) -> tuple[Message, ...]:
    polygons = "Split {} polygon{} of five or more corners into triangles."
    kinds = (
        (counts == 4, "quads_split", "Split {} quad{} into triangles."),
        (counts > 4, "polygons_split", polygons),
        (counts < 3, "corners_missing", "Left out {} face{} with fewer than three corners."),
    )
    numbers = [(int(rows.sum()), code, text) for rows, code, text in kinds]
    return tuple(
        Message(text.format(n, "" if n == 1 else "s"), code, faces=n)
        for n, code, text in numbers
        if n
    )


def _split(points: FloatArray, polygons: NDArray[np.int64]) -> NDArray[np.int64]:
    """Cut (k, size) polygons of one size into (k, size - 2, 3) triangles."""
    size = polygons.shape[1]
    if size == 3:
        return polygons[:, None, :]
    # Scaled to about 1 so that products of very large or very small coordinates stay in range.
    with np.errstate(all="ignore"):
        local = points[polygons] - points[polygons[:, :1]]
        extent = np.abs(local).max(axis=(1, 2), keepdims=True)
        local = np.where(extent > 0, local / extent, 0.0)
        following = np.roll(local, -1, axis=1)
        normals = np.cross(local, following).sum(axis=1)  # Newell: twice the area vector
    if size == 4:
        return _split_quads(local, normals, polygons)
    fan = np.stack(np.broadcast_arrays(0, np.arange(1, size - 1), np.arange(2, size)), axis=1)
    result = polygons[:, fan]
    bad = ~(_facing(local, normals, fan) > 0).all(axis=1)
    for row in np.flatnonzero(bad):
        result[row] = polygons[row][_clip_ears(local[row], normals[row])]
    return result


def _facing(local: FloatArray, normals: FloatArray, triangles: NDArray[np.int64]) -> FloatArray:
    """Return, (k, triangles), how much each local triangle faces along its polygon's normal."""
    a, b, c = (local[:, triangles[:, i]] for i in range(3))
    with np.errstate(all="ignore"):
        return np.einsum("kti,ki->kt", np.cross(b - a, c - a), normals)


def _split_quads(
    local: FloatArray, normals: FloatArray, quads: NDArray[np.int64]
) -> NDArray[np.int64]:
    cuts = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    fits = [(_facing(local, normals, cut) > 0).all(axis=1) for cut in cuts]
    with np.errstate(all="ignore"):
        length = [np.linalg.norm(local[:, j] - local[:, i], axis=1) for i, j in ((0, 2), (1, 3))]
    second = np.where(fits[0] == fits[1], length[1] < length[0], fits[1])
    return np.where(second[:, None, None], quads[:, cuts[1]], quads[:, cuts[0]])


def _clip_ears(local: FloatArray, normal: FloatArray) -> NDArray[np.int64]:
    """Cut one polygon ear by ear, the fattest ear without another corner in it first."""
    from medialis.files._polygon_kernels import clip_ears

    drop = int(np.abs(normal).argmax())
    flat = np.delete(local, drop, axis=1)
    # Dropping y swaps the handedness of the remaining two axes.
    if (normal[drop] < 0) != (drop == 1):
        flat = flat * [-1.0, 1.0]
    triangles = np.empty((len(flat) - 2, 3), np.int64)
    clip_ears(np.ascontiguousarray(flat), triangles)
    return triangles
