"""How far the envelope of a medial mesh and a surface are apart, both ways; balls that cover it.

Balls that cover a surface altogether are what robots keep clear of.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import Described, Index, Mask, enclosed_volume
from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray
from medialis.medial_meshes.envelope import Envelope
from medialis.medial_meshes.mesh import BallCover, MedialMesh
from medialis.medial_meshes.sampling import Solid
from medialis.shape.shape import Shape

ON_SURFACE = 60_000  # halved 11 %, doubled 6 %
"""Places of the surface that are looked at besides its vertices, about."""

ON_ENVELOPE = 150_000  # halved 17 %, doubled 4 %
"""Points of the envelope that are looked at, about, before hidden ones are taken away."""

FEWEST, MOST = 24, 200_000  # halved 85 %, doubled 100 %; halved 0 %, doubled 0 %
"""Points of one ball."""

HIDDEN = 1e-7  # halved 43 %, doubled 43 %
"""Diagonals: a point deeper in another part of the envelope is not on its boundary."""


STEPS_OUT = 30  # halved < 0.1 %, doubled < 0.1 %
"""How many parts a place may go through on the way out of the envelope."""

STEP_FALLS = 0.85  # halved 55 %, doubled 79 %
"""Factor by which the step between points falls until there are enough."""


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
    far = found.surface_to_envelope * scale, found.envelope_to_surface * scale, found.mean * scale
    return EnvelopeDistance(*far, found.place * scale + middle, found.spacing * scale)


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
    back = solid.wall_tree.distances(boundary)[0] if len(boundary) else np.zeros(1)
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


def points_on(parts: Parts, step: float) -> FloatArray:
    """Return points on all balls, cones and slabs, about so far apart, hidden ones as well."""
    return _spread(parts, np.full(sum(len(one) for one in parts), step))[0]


def _step_for(most: int, parts: Parts, which: Mask, step: float) -> float:
    """Return a step, smaller and smaller, at which some parts have this many points."""
    for _ in range(60):
        if _counts(parts, np.full(len(which), step))[which].sum() >= most:
            break
        step *= STEP_FALLS
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


PIECE = 0.01
"""Longest side of a piece of the surface, in diagonals: each piece lies in one ball."""

SLIVER = 6.0
"""A triangle is a sliver where its longest side is more than so many times its height."""

ROUNDS = 12
"""How often pieces are given to balls, and balls made as small as their pieces allow."""

STEPS = 40
"""Steps towards the smallest ball around the pieces: it is nearer than 1 / STEPS of a radius."""

PIECES_A_CHUNK = 512

LOOKED_AT = 200_000
"""Places at which the volume outside is estimated."""

ROUNDING = 1e-12
"""Added to radii, relative to the diagonal."""


def ball_cover(mesh: MedialMesh, shape: Shape) -> BallCover:
    """Cover a surface with the balls of a medial mesh, moved and enlarged as far as it takes.

    Parameters
    ----------
    mesh : MedialMesh
        Of the shape; more balls cover it more tightly.
    shape : Shape
        A closed mesh.

    Returns
    -------
    BallCover
        As many balls, or fewer. Every point of the surface is in one of them, vertices, edges and
        faces: the surface is cut into pieces, and a ball that holds the corners of a piece holds
        it. Edges and triangles of the mesh do not matter.

    Raises
    ------
    InvalidShapeError
        For a cloud.

    See Also
    --------
    medial_mesh : makes the mesh.
    write_ball_cover : writes the balls for robots.

    Notes
    -----
    Cost: O(p n) at worst for n balls and p pieces with sides of up to a hundredth of the diagonal.

    Examples
    --------
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> cover = medialis.ball_cover(medialis.medial_mesh(shape, balls=48), shape)
    >>> len(cover) <= 48, 0 < cover.excess < 2
    (True, True)
    """
    if shape.faces is None:
        raise InvalidShapeError("Balls cover a mesh, got a point cloud: reconstruct it first.")
    centers, radii = covering(mesh, shape, PIECE, ROUNDS)
    return BallCover(centers, radii, excess_of(shape, centers, radii))


def covering(
    mesh: MedialMesh, shape: Shape, longest: float, rounds: int
) -> tuple[FloatArray, FloatArray]:
    """Return centers and radii of balls that hold pieces of up to so many diagonals."""
    assert shape.faces is not None
    scale = shape.diagonal or 1.0
    pieces = pieces_of(shape.points[shape.faces], longest * scale)
    centers, radii = np.array(mesh.centers), np.array(mesh.radii)
    found, best = (centers, radii), np.inf
    for _ in range(rounds):
        owner, need = _given(pieces, centers, radii)
        centers, radii = _shrunk(pieces, owner, need, centers)
        volume = float((radii**3).sum())
        if volume < best:
            best, found = volume, (centers, radii)
    centers, radii = found
    used = radii > 0
    return centers[used], radii[used] + ROUNDING * scale


def pieces_of(triangles: FloatArray, longest: float) -> FloatArray:
    """Cut triangles (m, 3, 3) into similar ones with sides of up to a length, slivers in halves."""
    triangles = _halved(triangles, longest)
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    counts = np.maximum(np.ceil(sides / longest), 1).astype(np.int64)
    parts = []
    for count in np.unique(counts):
        shares = _split(int(count))
        chosen = triangles[counts == count]
        parts.append(np.einsum("pkc,mcd->mpkd", shares, chosen).reshape(-1, 3, 3))
    return np.concatenate(parts)


def _halved(triangles: FloatArray, longest: float) -> FloatArray:
    """Halve the longest side of slivers that are longer than a length, until none is.

    A sliver cut into similar ones makes as many pieces as a whole triangle of its length.
    """
    done = []
    while len(triangles):
        edges = np.roll(triangles, -1, axis=1) - triangles
        sides = np.linalg.norm(edges, axis=2)
        side = sides.max(axis=1)
        twice = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        sliver = (side > longest) & (side * side > SLIVER * twice)
        done.append(triangles[~sliver])
        triangles, first = triangles[sliver], sides[sliver].argmax(axis=1)
        a, b, c = (triangles[np.arange(len(first)), (first + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
    return np.concatenate(done) if done else triangles


def _split(count: int) -> FloatArray:
    """Return the corners of the count^2 triangles that sides cut in `count` make, (p, 3, 3)."""
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(count), np.arange(count)))
    up, down = i + j < count, i + j < count - 1
    corners = [
        np.stack([[i, j], [i + 1, j], [i, j + 1]], axis=0)[:, :, up],
        np.stack([[i + 1, j + 1], [i, j + 1], [i + 1, j]], axis=0)[:, :, down],
    ]
    steps = np.concatenate(corners, axis=2).transpose(2, 0, 1) / count
    return np.concatenate([1 - steps.sum(axis=2, keepdims=True), steps], axis=2)


def _given(pieces: FloatArray, centers: FloatArray, radii: FloatArray) -> tuple[Index, FloatArray]:
    """Return the ball of each piece, that which has to grow least, and the radius it needs.

    The ball nearest to the middle of a piece bounds how much one has to grow, and so the balls that
    may have to grow less; pieces with the same nearest ball look at theirs together.
    """
    from scipy.spatial.distance import cdist

    from medialis.base.box_tree import NearestTree

    middles = pieces.mean(axis=1)
    nearest = np.asarray(NearestTree.of_balls(centers, radii).distances(middles)[1], np.int64)
    growth = np.linalg.norm(pieces - centers[nearest, None], axis=2).max(axis=1) - radii[nearest]
    slack = 1e-9 * (np.abs(pieces).max() + radii.max())  # more than rounding
    order = np.argsort(nearest, kind="stable")
    owner, need = np.empty(len(pieces), np.int64), np.empty(len(pieces))
    for begin in range(0, len(pieces), PIECES_A_CHUNK):
        some = order[begin : begin + PIECES_A_CHUNK]
        middle = middles[some].mean(axis=0)
        wide = np.linalg.norm(middles[some] - middle, axis=1).max()
        least = np.linalg.norm(centers - middle, axis=1) - radii - wide
        near = np.flatnonzero(least <= growth[some].max() + slack)
        corners = pieces[some]
        far = cdist(corners.reshape(-1, 3), centers[near]).reshape(len(corners), 3, -1).max(axis=1)
        column = (far - radii[near]).argmin(axis=1)
        owner[some] = near[column]
        need[some] = np.take_along_axis(far, column[:, None], axis=1)[:, 0]
    return owner, need


def _shrunk(
    pieces: FloatArray, owner: Index, need: FloatArray, centers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move balls to where they may be smallest: step by step towards their farthest corner."""
    order = np.argsort(owner, kind="stable")
    used, starts = np.unique(owner[order], return_index=True)
    corners = pieces[order].reshape(-1, 3)
    row = np.repeat(np.searchsorted(used, owner[order]), 3)
    now = centers[used].copy()
    best_centers, best = now.copy(), np.maximum.reduceat(need[order], starts)
    for step in range(STEPS):
        far = np.linalg.norm(corners - now[row], axis=1)
        largest = np.maximum.reduceat(far, 3 * starts)
        better = largest < best
        best[better], best_centers[better] = largest[better], now[better]
        rows = np.flatnonzero(far == largest[row])
        first = rows[np.unique(row[rows], return_index=True)[1]]
        now += (corners[first] - now) / (step + 2)
    result, radii = centers.copy(), np.zeros(len(centers))
    result[used], radii[used] = best_centers, best
    return result, radii


def excess_of(
    shape: Shape, centers: FloatArray, radii: FloatArray, count: int = LOOKED_AT
) -> float:
    """Return the volume of balls outside of a solid as a share of its volume."""
    from medialis.base.box_tree import NearestTree

    assert shape.faces is not None
    solid = Solid(shape.points, shape.faces)
    low, high = (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)
    i = np.arange(1, count + 1)[:, None]
    steps = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])
    places = low + (i * steps % 1.0) * (high - low)  # evenly spread, by irrational steps
    held = NearestTree.of_balls(centers, radii).distances(places)[0] <= 0
    outside = float((~solid.contains(places[held])).sum()) / count
    volume = enclosed_volume(solid.points, solid.faces)
    return outside * float(np.prod(high - low)) / volume if volume > 0 else float("inf")
