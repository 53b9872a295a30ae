"""How far the envelope of a medial mesh and a surface are apart, both ways."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Described
from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.mesh import MedialMesh
from medialis.medial_meshes.sampling import Solid
from medialis.shape.shape import Shape

Index = NDArray[np.int64]

ON_SURFACE = 60_000
"""Places of the surface that are looked at besides its vertices, about."""

ON_ENVELOPE = 150_000
"""Points of the envelope that are looked at, about, before hidden ones are taken away."""

FEWEST, MOST = 24, 200_000
"""Points of one ball."""

HIDDEN = 1e-7
"""Diagonals: a point deeper in another part of the envelope is not on its boundary."""


STEPS_OUT = 30
"""How many parts a place may go through on the way out of the envelope."""


@dataclass(frozen=True, repr=False)
class EnvelopeDistance(Described):
    """How far an envelope and a surface are apart, in units of the shape.

    Attributes
    ----------
    surface_to_envelope : float
        The largest distance of the surface to the boundary of the envelope: exact where the surface
        is outside of it, or the shortest way out of the part around it leads outside; else that to
        the nearest point looked at.
    envelope_to_surface : float
        The largest distance of a point of that boundary to the surface.
    mean : float
        Mean distance of the surface, by area.
    place : (3,) float64
        Where the larger of the two was found, on the surface or on the envelope.
    spacing : float
        How far points of the envelope that were looked at lie apart.
    """

    surface_to_envelope: float
    envelope_to_surface: float
    mean: float
    place: FloatArray
    spacing: float

    @property
    def largest(self) -> float:
        """Two-sided Hausdorff distance."""
        return max(self.surface_to_envelope, self.envelope_to_surface)


def envelope_distance(mesh: MedialMesh, shape: Shape) -> EnvelopeDistance:
    """Measure how far the envelope of a medial mesh and a surface are apart, both ways.

    Parameters
    ----------
    mesh : MedialMesh
    shape : Shape
        A mesh of triangles; those with the same on both sides, inside or outside, are left out.

    Returns
    -------
    EnvelopeDistance

    Raises
    ------
    InvalidShapeError
        For a cloud.

    See Also
    --------
    medial_mesh : makes such meshes.

    Notes
    -----
    Distances to balls, cones, slabs and triangles are exact, in closed form. The surface is seen at
    its vertices and at some 60,000 places between them, the boundary of the envelope at some
    150,000 points (`spacing`), so the largest distances are found up to that.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> mesh = medialis.medial_mesh(shape, balls=12)
    >>> distance = medialis.envelope_distance(mesh, shape)
    >>> bool(0 < distance.largest < 0.1 * shape.diagonal)
    True
    """
    if shape.faces is None:
        raise InvalidShapeError(
            "The distance of an envelope is measured to a mesh, got a point cloud."
        )
    middle, scale = 0.5 * (shape.bounds[0] + shape.bounds[1]), shape.diagonal or 1.0
    solid = Solid((shape.points - middle) / scale, shape.faces)
    envelope = Envelope.of(mesh.complex.placed(1.0, -middle).placed(1.0 / scale, np.zeros(3)))
    found = measure(solid, envelope)
    return EnvelopeDistance(
        found.surface_to_envelope * scale,
        found.envelope_to_surface * scale,
        found.mean * scale,
        found.place * scale + middle,
        found.spacing * scale,
    )


def measure(solid: Solid, envelope: Envelope) -> EnvelopeDistance:
    """Measure the distances at diagonal 1."""
    from medialis.base.box_tree import NearestTree

    places, areas = surface_places(solid)
    out, _, _ = envelope.distances(places)
    boundary, spacing = boundary_points(envelope)
    far = np.abs(out)
    within = np.flatnonzero(out < 0)
    if len(within) and len(boundary):
        points = NearestTree.of_balls(boundary, np.zeros(len(boundary)))
        nearest = points.distances(places[within])[0]
        far[within] = np.minimum(nearest, way_out(envelope, places[within]))
    tree = NearestTree.of_triangles(solid.points, np.asarray(solid.faces[solid.walls], np.int32))
    back = tree.distances(boundary)[0] if len(boundary) else np.zeros(1)
    place = places[far.argmax()]
    if back.max() > far.max():
        place = boundary[back.argmax()]
    mean = float(np.average(far, weights=areas))
    return EnvelopeDistance(float(far.max()), float(back.max()), mean, place, spacing)


def way_out(envelope: Envelope, places: FloatArray) -> FloatArray:
    """Return how far places within an envelope are from a place on its boundary, (q,).

    Each leaves the deepest part that it is in by the shortest way, and again where that leads into
    another part. It is the exact distance where the first step leads out, which it mostly does.
    """
    now, inside = places.copy(), np.arange(len(places))
    for _ in range(STEPS_OUT):
        distance, row, shares = envelope.distances(now[inside])
        deep = distance < -HIDDEN
        inside, distance, row, shares = inside[deep], distance[deep], row[deep], shares[deep]
        if len(inside) == 0:
            break
        rows = envelope.rows[row]
        centers = np.einsum("qk,qkd->qd", shares, envelope.balls[np.maximum(rows, 0), :3])
        away = now[inside] - centers
        away /= np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None]
        now[inside] -= (distance - HIDDEN)[:, None] * away
    far = np.linalg.norm(now - places, axis=1)
    far[inside] = np.inf  # no way found
    return np.asarray(far)


def surface_places(solid: Solid) -> tuple[FloatArray, FloatArray]:
    """Return vertices and places of the walls, evenly spread, and the area of each."""
    surface = solid.surface
    total = np.cumsum(surface.face_areas * solid.walls)
    draw = (np.arange(ON_SURFACE) + 0.5) * (total[-1] / ON_SURFACE)
    face = np.minimum(np.searchsorted(total, draw), len(total) - 1)
    # Two irrational steps spread places within a face whatever number of them it gets.
    i = np.arange(ON_SURFACE)
    root, along = np.sqrt((i * 0.7548776662466927) % 1.0), (i * 0.5698402909980532) % 1.0
    weights = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    between = np.einsum("pj,pjk->pk", weights, solid.points[solid.faces[face]])
    areas = np.concatenate([np.zeros(len(solid.corners)), np.full(ON_SURFACE, 1.0)])
    return np.concatenate([solid.points[solid.corners], between]), areas


def boundary_points(envelope: Envelope, wanted: int = ON_ENVELOPE) -> tuple[FloatArray, float]:
    """Return points on the boundary of an envelope, and how far they lie apart.

    A first look finds the parts that are not hidden altogether; they are looked at closely.
    """
    rows, balls = envelope.rows, envelope.balls
    faces = np.ascontiguousarray(rows[rows[:, 2] >= 0])
    bare = rows[(rows[:, 2] < 0) & (rows[:, 1] >= 0)][:, :2]
    sides = np.concatenate([faces[:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2), bare])
    edges = np.unique(np.sort(sides, axis=1), axis=0)
    parts = balls, edges, faces
    count = len(balls) + len(edges) + len(faces)
    low, high = balls[:, :3].min(axis=0), balls[:, :3].max(axis=0)
    widest = math.hypot(*(high - low)) + balls[:, 3].max() or 1.0  # of a point any step will do
    coarse = _step_for(wanted // 4, parts, np.ones(count, bool), widest)
    points, part = _spread(parts, np.full(count, coarse))
    bare_points = envelope.distances(points, enough=-HIDDEN)[0] >= -HIDDEN
    seen = np.zeros(count, bool)
    seen[part[bare_points]] = True
    fine = min(_step_for(wanted, parts, seen, coarse), coarse)
    if fine == coarse:
        return points[bare_points], float(fine)
    points, _ = _spread(parts, np.where(seen, fine, coarse))
    hidden = envelope.distances(points, enough=-HIDDEN)[0] < -HIDDEN
    return points[~hidden], float(fine)


Parts = tuple[FloatArray, Index, Index]


def _step_for(most: int, parts: Parts, which: NDArray[np.bool_], step: float) -> float:
    """Return a step, smaller and smaller, at which some parts have this many points."""
    for _ in range(60):
        if _counts(parts, np.full(len(which), step))[which].sum() >= most:
            break
        step *= 0.85
    return step


def _counts(parts: Parts, steps: FloatArray) -> Index:
    from medialis.medial_meshes._sampling_kernels import count_points

    counts = np.empty(len(steps), np.int64)
    count_points(*parts, steps, FEWEST, MOST, counts)
    return counts


def _spread(parts: Parts, steps: FloatArray) -> tuple[FloatArray, Index]:
    """Return points on all parts, and the part of each."""
    from medialis.medial_meshes._sampling_kernels import put_points

    counts = _counts(parts, steps)
    starts = np.concatenate([[0], np.cumsum(counts)])
    points = np.empty((int(starts[-1]), 3))
    put_points(*parts, steps, starts, points)
    return points, np.repeat(np.arange(len(counts)), counts)
