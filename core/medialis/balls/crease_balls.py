"""Small balls in convex creases: the ends of the sheets that come out of them (thesis 3.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.balls.triangle_balls import Walls
from medialis.model.medial_cloud import BallStatus, MedialCloud
from medialis.surface.creases import STEEPER, Creases
from medialis.validation import FloatArray

EDGE = 1e-6
"""Fraction of the diagonal: how far the ball at a crease lies from it, at least."""

GAP, MOST_BETWEEN = 1e-3, 3
"""Fraction of the diagonal: no place of a convex crease is farther than this from a ball; and how
many balls there are between two samples for that, at most: enough for edges of 0.8 %."""

DEEP, FITS = 0.55, 0.9
"""How deep balls between samples lie, in lengths of their edge: in a right angle half-way to where
the balls of the next samples begin. And the share of the radius that two walls would allow that
they have at least, or they lie where those of the samples do: other walls are near."""


def with_edge_balls(cloud: MedialCloud, creases: Creases, tolerance: float) -> MedialCloud:
    """Give samples on convex creases the ball that fits into the crease beside them.

    A ball tangent at such a sample cuts a face whatever its normal: its radius is 0. The ball whose
    center lies the tolerance deep, on the line of the mean normal, touches the faces next to the
    sample instead: the end of the sheet that comes out of the crease. Both of its feature points
    are the sample; its spoke angle is that of the crease.
    """
    surface = cloud.surface
    depth = _depth(cloud, tolerance)
    cut = np.zeros((surface.point_count, 2), np.bool_)
    for column, sign in enumerate((1, -1)):
        cut[creases.cut_vertices(sign), column] = True
    rows = np.flatnonzero(cut[cloud.source, (cloud.side < 0).astype(np.int64)])
    lowest = np.ones(surface.point_count)
    cosines = np.einsum("ij,ij->i", creases.normals, surface.normals[creases.vertices])
    np.minimum.at(lowest, creases.vertices, cosines)
    source = cloud.source[rows]
    rows = rows[(lowest[source] > 0) & (lowest[source] < 1 - STEEPER)]
    source = cloud.source[rows]
    inward = -surface.normals[source] * cloud.side[rows, None]
    return cloud.with_rows(
        rows,
        centers=surface.points[source] + depth * inward,
        radii=depth * lowest[source],
        features=np.stack([source, source], axis=1),
        status=np.full(len(rows), BallStatus.OK),
        spoke_angles=2.0 * np.arccos(lowest[source]),
        contact_faces=np.full(len(rows), -1),
        contact_weights=np.zeros((len(rows), 3)),
    )


def between_samples(cloud: MedialCloud, walls: Walls, tolerance: float) -> MedialCloud:
    """Return balls of convex creases between the samples there, and one beside each sample.

    Without them the union of the balls lacks the crease between any two samples. Each lies where
    the sheet comes out of the crease, and has the distance of the surface as its radius; its
    feature points are the sample nearest to its contact, the place of the crease below it.
    """
    surface, creases = cloud.surface, walls.creases
    parts = [
        _on_edges(cloud, creases, sign)
        for sign in (1, -1)
        if surface.faces is not None and (cloud.side == sign).any()
    ]
    first, second, sign, part = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if len(first) == 0:
        return cloud.subset(first)
    face, side = np.divmod(first, 3)
    corners = np.asarray(surface.faces)[face]
    rows = np.arange(len(face))
    weights = np.zeros((len(face), 3))
    weights[rows, side], weights[rows, (side + 1) % 3] = 1.0 - part, part
    source = corners[rows, np.where(part < 0.5, side, (side + 1) % 3)]
    one, other = surface.face_normals[face], surface.face_normals[second // 3]
    middle = one + other
    length = np.linalg.norm(middle, axis=1, keepdims=True)
    middle = np.divide(middle, length, out=np.zeros_like(middle), where=length > STEEPER)
    cosine = np.clip(np.einsum("ij,ij->i", middle, one), 0.0, 1.0)
    place = np.einsum("ij,ijk->ik", weights, surface.points[corners])
    ends = surface.points[corners[rows, side]] - surface.points[corners[rows, (side + 1) % 3]]
    small = _depth(cloud, tolerance)
    depth = np.minimum(
        DEEP * np.linalg.norm(ends, axis=1),
        GAP * surface.diagonal / np.maximum(1.0 - cosine, STEEPER),
    )
    depth = np.maximum(depth, small)
    # They lie `depth` off a place of the surface, which is no nearer than that.
    radii = walls.room(place - (depth * sign)[:, None] * middle, depth)
    fits = radii >= FITS * depth * cosine
    depth, radii = np.where(fits, depth, small), np.where(fits, radii, small * cosine)
    balls = MedialCloud(
        place - (depth * sign)[:, None] * middle,
        radii,
        np.stack([source, source], axis=1),
        source,
        np.full(len(face), BallStatus.OK),
        2.0 * np.arccos(cosine),
        sign,
        face,
        weights,
        surface=surface,
    )
    return balls.subset(fits | (part > 0))  # the sample itself has the small one


def _depth(cloud: MedialCloud, tolerance: float) -> float:
    return max(tolerance, EDGE) * cloud.surface.diagonal


def _on_edges(
    cloud: MedialCloud, creases: Creases, sign: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int8], FloatArray]:
    """Return half-edges of creases convex on a side, their twins, the side, and shares of them."""
    surface = cloud.surface
    mine = cloud.valid & (cloud.side == sign) & (cloud.features[:, 0] == cloud.features[:, 1])
    has_ball = np.zeros(surface.point_count, np.bool_)
    has_ball[cloud.source[mine]] = True
    first, second = creases.half_edges[creases.inward == (sign < 0)].T
    corners = np.asarray(surface.faces)
    start, end = corners[first // 3, first % 3], corners[first // 3, (first + 1) % 3]
    both = has_ball[start] & has_ball[end]
    first, second, start, end = first[both], second[both], start[both], end[both]
    length = np.linalg.norm(surface.points[end] - surface.points[start], axis=1)
    count = np.ceil(length / (2 * GAP * surface.diagonal)).astype(np.int64)
    count = np.where(count > 1, np.minimum(count, 1 + MOST_BETWEEN), 0)
    edge = np.repeat(np.arange(len(first)), count)
    turn = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    part = turn / count[edge]
    return first[edge], second[edge], np.full(len(edge), sign, np.int8), part
