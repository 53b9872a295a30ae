"""Sharp edges told from thin walls, by the two places that a ball touches (for thesis 3.5.1).

Towards the edge of a wedge balls get smaller and smaller, though the shape is not a thin wall
there. The two planes that touch such a ball at its feature points meet at the edge itself: with the
directions u and v from the center c to the two places, at c + r w / |w|^2 2, w = u + v, which is as
far as the bisector goes. Where a sharp edge of the shape lies there, the ball is one of that edge.
In an even wall the planes are parallel and meet nowhere; in one that tapers by the draft of a
moulded part they meet far away.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.validation import FloatArray

LEAST_TAPER = 5.0
"""Degrees between the two sides. Moulded walls have drafts of 0.5 to 2 degrees a side: up to 4
between the sides, so that they stay walls even where they end sharp."""

SHARP = 60.0
"""Degrees between the faces of an edge at which two sides of a wall can meet: those of spoke angles
of 120 and more (`fields.thickness.WALL_ANGLE`)."""


def edge_balls(cloud: MedialCloud) -> NDArray[np.bool_]:
    """Return which balls belong to a sharp edge that their two sides run into, (k,).

    Inner balls and convex edges, or outer balls and concave ones. None in a cloud of points.
    """
    result = np.zeros(len(cloud), np.bool_)
    if cloud.surface.faces is None:
        return result
    taper = math.pi - cloud.spoke_angles
    wide = cloud.valid & (taper > math.radians(LEAST_TAPER)) & (taper < math.radians(SHARP))
    for side in (1, -1):
        rows = np.flatnonzero(wide & (cloud.side == side))
        edges = sharp_edges(cloud.surface, side)
        if len(rows) and len(edges):
            result[rows] = _near(cloud, rows, edges)
    return result


def sharp_edges(surface: Shape, side: int) -> FloatArray:
    """Return the ends (e, 2, 3) of the edges whose faces enclose less than `SHARP` on a side."""
    bends, inward = signed_bends(surface)
    first = surface.edge_table.pairs[0]
    sharp = (bends > math.radians(180.0 - SHARP)) & (inward == (side < 0))
    faces = np.asarray(surface.faces)
    half = first[sharp]
    ends = np.stack([faces.ravel()[half], faces[half // 3, (half + 1) % 3]], axis=1)
    return np.asarray(surface.points[ends])


def signed_bends(surface: Shape) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the angle between the two faces at each edge of two, and whether it bends inward."""
    first, second, _ = surface.edge_table.pairs
    faces = np.asarray(surface.faces)
    normals = surface.face_normals[first // 3]
    over = (
        surface.points[faces[second // 3, (second + 2) % 3]] - surface.points[faces.ravel()[first]]
    )
    return surface.edge_bends, np.einsum("ij,ij->i", normals, over) > 0.0


def _near(cloud: MedialCloud, rows: NDArray[np.int64], edges: FloatArray) -> NDArray[np.bool_]:
    """Tell whether the planes at the two contacts of some balls meet at one of some edges."""
    from scipy.spatial import cKDTree

    centers, radii = cloud.centers[rows], cloud.radii[rows]
    one = cloud.surface.points[cloud.features[rows, 0]] - centers
    other = cloud.contacts[rows] - centers
    ahead = (one + other) / radii[:, None]  # |u + v| = 2 cos(spoke angle / 2)
    meet = centers + 2.0 * radii[:, None] * ahead / np.einsum("ij,ij->i", ahead, ahead)[:, None]
    middles = edges.mean(axis=1)
    half = 0.5 * np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    distance, nearest = cKDTree(middles).query(meet)
    # Sides are not quite flat, and contacts lie up to a tolerance off: a radius to spare.
    return np.asarray(distance <= radii + half[nearest])
