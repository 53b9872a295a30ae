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
    """Cut one polygon ear by ear; always ends, also for polygons that cross themselves.

    Cost: O(corners) for each test, O(corners^2) tests at worst.
    """
    drop = int(np.abs(normal).argmax())
    flat = np.delete(local, drop, axis=1)
    # Dropping y swaps the handedness of the remaining two axes.
    if (normal[drop] < 0) != (drop == 1):
        flat = flat * [-1.0, 1.0]
    ring = list(range(len(flat)))
    triangles = []
    while len(ring) > 3:
        at = _find_ear(flat[ring])
        triangles.append((ring[at - 1], ring[at], ring[(at + 1) % len(ring)]))
        del ring[at]
    triangles.append((ring[0], ring[1], ring[2]))
    return np.array(triangles)


def _find_ear(ring: FloatArray) -> int:
    """Return the corner whose cut-off triangle is the fattest one without another corner inside."""
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    area = _turn(before, ring, after)
    longest = np.maximum(((after - before) ** 2).sum(axis=1), 1e-300)
    for at in np.argsort(-area / longest, kind="stable"):
        if area[at] <= 0:
            break
        a, b, c = before[at], ring[at], after[at]
        inside = (_turn(a, b, ring) >= 0) & (_turn(b, c, ring) >= 0) & (_turn(c, a, ring) >= 0)
        corner = (ring == a).all(axis=1) | (ring == b).all(axis=1) | (ring == c).all(axis=1)
        if not (inside & ~corner).any():
            return int(at)
    return int(np.argmax(area))


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return twice the signed area of the triangle a, b, c in the plane."""
    u, v = b - a, c - a
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
