"""Samples of a surface whose spacing follows the thickness, mirrored across thin walls.

Where walls are thinner than the spacing, samples on both sides lie opposite each other: then the
circumcenters of their tetrahedra lie in the middle, however thin the wall is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.medial_meshes.solid import Solid
from medialis.threads import run_together
from medialis.validation import FloatArray

CANDIDATES = 4
"""Candidates for each sample: they carry the planes that the balls are fitted to."""

PIECES = 16
"""Pieces that faces are cut into for each sample, at most, besides one for each face."""

SHORTER = 0.7
"""Sides of less than this share of the longest wait for the next round."""

FINEST = 3.0
"""The smallest spacing is this part of the largest."""

PER_THICKNESS = 0.25
"""Spacing as a share of the thickness."""

THIN = 1.0
"""Spacings: walls and gaps that are thinner get their samples in pairs."""

PAIRED = 0.6
"""Their spacing, as a share of the largest: it need not follow the thickness."""

SMOOTH = math.cos(math.radians(30.0))
"""Faces that bend less than 30 degrees are one smooth surface, as everywhere."""

JITTER = 1e-8
"""Diagonals: Delaunay tetrahedra of points exactly on planes take 20 times as long."""

FACING = 0.5
"""Cosine of the angle of two walls from which on they face each other."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Candidates on a surface, and the samples chosen among them.

    Attributes
    ----------
    points, normals : (c, 3) float64
    areas : (c,) float64
        Area of the surface that each candidate stands for; 0 for mirrored ones.
    owner : (c,) int64
        The chosen candidate that stands for each; itself where it is chosen, -1 where that was
        left out as hidden.
    spacing : float
        The largest spacing.
    """

    points: FloatArray
    normals: FloatArray
    areas: FloatArray
    owner: NDArray[np.int64]
    spacing: float

    @property
    def chosen(self) -> NDArray[np.int64]:
        """The chosen candidates."""
        return np.flatnonzero(self.owner == np.arange(len(self.owner)))

    def with_more(self, points: FloatArray, normals: FloatArray) -> Samples:
        """Return them with more samples, which stand for no area."""
        rows = len(self.points) + np.arange(len(points))
        return Samples(
            np.concatenate([self.points, points]),
            np.concatenate([self.normals, normals]),
            np.concatenate([self.areas, np.zeros(len(points))]),
            np.concatenate([self.owner, rows]),
            self.spacing,
        )


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Faces cut into pieces that are small against the spacing."""

    face: NDArray[np.int64]
    weights: FloatArray
    """(p, 3, 3): barycentric coordinates of the corners in their face."""
    areas: FloatArray


def take_samples(solid: Solid, count: int, seed: int) -> Samples:
    """Choose about `count` samples, more where the shape is thin."""
    surface = solid.surface
    area = float(surface.face_areas[solid.walls].sum())
    spacing = 0.81 * math.sqrt(area / count)
    pieces, corners, _ = run_together(
        lambda: _cut(solid, 2 * spacing, PIECES * count),
        lambda: _corner_normals(solid),
        lambda: solid.boxes,  # for the rays
    )
    middles = _places(solid, pieces.face, pieces.weights.mean(axis=1))
    normals = surface.face_normals[pieces.face]
    thickness, opposite = _thickness(solid, middles, normals, pieces.face, spacing)
    local = np.clip(PER_THICKNESS * thickness, spacing / FINEST, spacing)
    local[(thickness < THIN * spacing) & np.isfinite(opposite[:, 0])] = PAIRED * spacing
    rng = np.random.default_rng(seed)
    chosen, weights = _candidates(pieces, local, rng)
    face = pieces.face[chosen]
    points = _places(solid, face, weights)
    bent = np.einsum("cj,cjk->ck", weights, corners[face])
    bent /= np.maximum(np.linalg.norm(bent, axis=1), 1e-300)[:, None]
    areas = local[chosen] ** 2
    areas *= area / areas.sum()
    order = rng.permutation(len(points))
    points += JITTER * rng.normal(size=points.shape)
    return _thinned(solid, (points, bent, areas, face), local[chosen], order, spacing)


def _places(solid: Solid, face: NDArray[np.int64], weights: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("cj,cjk->ck", weights, solid.points[solid.faces[face]]))


def _cut(solid: Solid, longest: float, most: int) -> _Pieces:
    """Cut walls until no side is longer than `longest`, into `most` more pieces at most.

    Each is cut into 4, 16, ... equal parts. Where that makes too many, as of needles, longest sides
    are halved, the longest ones first: what is left then stays longer.
    """
    face = np.flatnonzero(solid.walls)
    corners = solid.points[solid.faces[face]]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    times = np.ceil(np.log2(np.maximum(sides / longest, 1.0)))
    pieces = _Pieces(
        face, np.broadcast_to(np.eye(3), (len(face), 3, 3)), solid.surface.face_areas[face]
    )
    if (4.0**times).sum() > most + len(face):
        return _halved(pieces, corners, longest, most + len(face))
    return _quartered(pieces, times)


def _quartered(pieces: _Pieces, times: FloatArray) -> _Pieces:
    """Cut each piece into four, as often as it says."""
    face, weights, areas = pieces.face, pieces.weights, pieces.areas
    while (large := times > 0).any():
        a, b, c = (weights[large, j] for j in range(3))
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab)]
        weights = np.concatenate([weights[~large], *(np.stack(p, axis=1) for p in parts)])
        face = np.concatenate([face[~large], np.tile(face[large], 4)])
        areas = np.concatenate([areas[~large], np.tile(areas[large] / 4, 4)])
        times = np.concatenate([times[~large], np.tile(times[large] - 1, 4)])
    return _Pieces(face, np.asarray(weights), np.asarray(areas))


def _halved(pieces: _Pieces, corners: FloatArray, longest: float, most: int) -> _Pieces:
    """Halve the longest side of pieces with these corners, up to so many pieces."""
    face, weights, areas = pieces.face, pieces.weights, pieces.areas
    while True:
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        side = sides.max(axis=1)
        large = np.flatnonzero(side > max(longest, SHORTER * side.max(initial=0.0)))
        if len(large) == 0 or len(face) + len(large) > most:
            return _Pieces(face, np.asarray(weights), np.asarray(areas))
        turn = (sides[large].argmax(axis=1)[:, None] + np.arange(3)) % 3
        kept = np.ones(len(face), bool)
        kept[large] = False
        face, areas = _joined(face, kept, face[large]), _joined(areas, kept, areas[large] / 2)
        weights, corners = (
            np.concatenate([each[kept], *_halves(each[large[:, None], turn])])
            for each in (weights, corners)
        )


def _joined(values: NDArray[Any], kept: NDArray[np.bool_], half: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([values[kept], half, half])


def _halves(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Halve triangles (n, 3, k) across their first side."""
    a, b, c = (corners[:, j] for j in range(3))
    middle = (a + b) / 2
    return np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)


def _corner_normals(solid: Solid) -> FloatArray:
    from medialis.medial_meshes._sampling_kernels import corner_normals

    fans, normals = solid.surface.fans, np.empty((len(solid.faces), 3, 3))
    corner_normals(solid.surface.face_vectors, fans.offsets, fans.indices, SMOOTH, normals)
    return normals


def _thickness(
    solid: Solid, places: FloatArray, normals: FloatArray, face: NDArray[np.int64], spacing: float
) -> tuple[FloatArray, FloatArray]:
    """Return the width of wall or gap at places, and the places opposite; NaN where none is near.

    The wall is met by a ray, and the ball that touches it and the place tells the opposite one.
    """
    width = np.full(len(places), np.inf)
    opposite = np.full((len(places), 3), np.nan)
    farthest = np.full(len(places), spacing / PER_THICKNESS)
    for side in (-1.0, 1.0):
        length, met = solid.free_way(places, side * normals, face, farthest)
        nearer = (met >= 0) & (length < width)
        width[nearer] = length[nearer]
        wall = solid.surface.face_normals[met]
        cosine = -np.einsum("ij,ij->i", wall, normals)
        facing = nearer & (cosine > FACING)
        radius = length * cosine / (1 + np.maximum(cosine, 0.0))
        there = places + (radius * side)[:, None] * (normals - wall)
        opposite[nearer] = np.nan
        opposite[facing] = there[facing]
    return width, opposite


def _candidates(
    pieces: _Pieces, local: FloatArray, rng: np.random.Generator
) -> tuple[NDArray[np.int64], FloatArray]:
    """Draw candidates, denser where the spacing is small: pieces and weights in their faces."""
    share = np.cumsum(pieces.areas / local**2)
    count = int(CANDIDATES * share[-1]) + 8
    drawn = (np.arange(count) + rng.random(count)) * (share[-1] / count)
    piece = np.minimum(np.searchsorted(share, drawn), len(share) - 1)
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    inside = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    return piece, np.einsum("cj,cjk->ck", inside, pieces.weights[piece])


def _thinned(
    solid: Solid,
    candidates: tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int64]],
    local: FloatArray,
    order: NDArray[np.int64],
    spacing: float,
) -> Samples:
    """Add the mirror images of candidates at thin walls, and choose samples among all."""
    from medialis.medial_meshes._sampling_kernels import thin_out

    points, normals, areas, face = candidates
    mirror = np.full(len(points), -1)
    flat = solid.surface.face_normals[face]
    near = np.flatnonzero(local < 0.99 * spacing)
    width, opposite = _thickness(solid, points[near], flat[near], face[near], spacing)
    paired = (width < THIN * spacing) & np.isfinite(opposite[:, 0])
    rows = near[paired]
    mirror[rows] = len(points) + np.arange(len(rows))
    everywhere = np.concatenate([points, opposite[paired]])
    facing = np.concatenate([normals, -normals[rows]])
    gaps = np.concatenate([local, local[rows]])
    slots = 1 << int(4 * len(everywhere)).bit_length()
    owner = np.full(len(everywhere), -1)
    thin_out(
        everywhere, facing, gaps, np.concatenate([mirror, np.full(len(rows), -1)]), order,
        np.full(slots, -1), np.empty(len(everywhere), np.int64), owner,
    )  # fmt: skip
    kept = owner >= 0
    number = np.cumsum(kept) - 1
    return Samples(
        everywhere[kept],
        facing[kept],
        np.concatenate([areas, np.zeros(len(rows))])[kept],
        number[owner[kept]],
        spacing,
    )
