"""Balls that cover a surface altogether: what robots keep clear of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.base.box_tree import NearestTree
from medialis.base.errors import InvalidShapeError
from medialis.base.validation import FloatArray
from medialis.medial_meshes.mesh import BallCover, MedialMesh
from medialis.medial_meshes.sampling import Solid
from medialis.shape.shape import Shape

PIECE = 0.01
"""Longest side of a piece of the surface, in diagonals: each piece lies in one ball."""

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
    scale = shape.diagonal or 1.0
    pieces = _pieces(shape.points[shape.faces], PIECE * scale)
    centers, radii = np.array(mesh.centers), np.array(mesh.radii)
    found, best = (centers, radii), np.inf
    for _ in range(ROUNDS):
        owner, need = _given(pieces, centers, radii)
        centers, radii = _shrunk(pieces, owner, need, centers)
        volume = float((radii**3).sum())
        if volume < best:
            best, found = volume, (centers, radii)
    centers, radii = found
    used = radii > 0
    centers, radii = centers[used], radii[used] + ROUNDING * scale
    return BallCover(centers, radii, _excess(Solid(shape.points, shape.faces), centers, radii))


def _pieces(triangles: FloatArray, longest: float) -> FloatArray:
    """Cut triangles (m, 3, 3) into similar ones with sides of up to a length."""
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    counts = np.maximum(np.ceil(sides / longest), 1).astype(np.int64)
    parts = []
    for count in np.unique(counts):
        shares = _split(int(count))
        chosen = triangles[counts == count]
        parts.append(np.einsum("pkc,mcd->mpkd", shares, chosen).reshape(-1, 3, 3))
    return np.concatenate(parts)


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


def _given(
    pieces: FloatArray, centers: FloatArray, radii: FloatArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the ball of each piece, that which has to grow least, and the radius it needs.

    The ball nearest to the middle of a piece bounds how much one has to grow, and so the balls that
    may have to grow less; pieces with the same nearest ball look at theirs together.
    """
    from scipy.spatial.distance import cdist

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
    pieces: FloatArray, owner: NDArray[np.int64], need: FloatArray, centers: FloatArray
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


def _excess(solid: Solid, centers: FloatArray, radii: FloatArray) -> float:
    """Return the volume of balls outside of a solid as a share of its volume."""
    low, high = (centers - radii[:, None]).min(axis=0), (centers + radii[:, None]).max(axis=0)
    i = np.arange(1, LOOKED_AT + 1)[:, None]
    steps = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])
    places = low + (i * steps % 1.0) * (high - low)  # evenly spread, by irrational steps
    held = NearestTree.of_balls(centers, radii).distances(places)[0] <= 0
    outside = float((~solid.contains(places[held])).sum()) / LOOKED_AT
    whole = np.einsum("ij,ij->", solid.points[solid.faces[:, 0]], solid.surface.face_vectors)
    volume = abs(float(whole)) / 6
    return outside * float(np.prod(high - low)) / volume if volume > 0 else float("inf")
