"""The solid that a mesh bounds, and samples of its surface whose spacing follows the thickness.

`Solid` knows what is inside, how far it is across, and which topology it has. `take_samples` draws
candidates, mirrors them across thin walls, and keeps those that are not too near to others. Where
walls are thinner than the spacing, samples on both sides lie opposite each other: then the
circumcenters of their tetrahedra lie in the middle, however thin the wall is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Index, Mask
from medialis.base.box_tree import NearestTree
from medialis.base.threads import run_chunks, run_together
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.medial_meshes.envelope import box_tree
from medialis.shape.graph import VIEW
from medialis.shape.normals import CREASE_ANGLE
from medialis.shape.surface import Surface

if TYPE_CHECKING:
    from medialis.medial_meshes._envelope_kernels import Tree

PLACES_A_CHUNK = 2048
RAYS_A_CHUNK = 1024

INSIDE = 0.5  # halved 0 %, doubled 100 %
"""Times the surface is wound round a place, from which on it is inside."""

BESIDE = 1e-6  # halved 0 %, doubled 0 %
"""How far from a face its two sides are looked at, in diagonals."""

CANDIDATES = 4  # halved 82 %, doubled 88 %
"""Candidates for each sample: they carry the planes that the balls are fitted to."""

AS_APART = 0.81  # halved 98 %, doubled 100 %
"""Spacing of samples in roots of the area for each: about as many come as are asked for."""

PIECES = 16  # halved 0 %, doubled 0 %
"""Pieces that faces are cut into for each sample, at most, besides one for each face."""

SHORTER = 0.7
"""Sides of less than this share of the longest wait for the next round."""

FINEST = 3.0  # halved 100 %, doubled 100 %
"""The smallest spacing is this part of the largest."""

PER_THICKNESS = 0.25  # halved 100 %, doubled 100 %
"""Spacing as a share of the thickness."""

THIN = 1.0  # halved 47 %, doubled 100 %
"""Spacings: walls and gaps that are thinner get their samples in pairs."""

PAIRED = 0.6  # halved 38 %, doubled 99 %
"""Their spacing, as a share of the largest: it need not follow the thickness."""

SMOOTH = math.cos(math.radians(CREASE_ANGLE))
"""Faces that bend less are one smooth surface, as everywhere."""

JITTER = 1e-8  # halved 88 %, doubled 87 %
"""Diagonals: Delaunay tetrahedra of points exactly on planes take 20 times as long."""

SMALL_HOLE = 0.15
"""Diagonals: holes that are no larger are closed."""

MOST_BORDER = 0.02
"""Share of the half-edges that lie on borders, up to which holes are closed."""

FACING = 0.5  # halved 98 %, doubled 49 %
"""Cosine of the angle of two walls from which on they face each other."""


class Solid:
    """A mesh of diagonal about 1, and what of space it encloses.

    Parameters
    ----------
    points : (n, 3) float64
    faces : (m, 3) int32
        Outward; closed, or as good as it gets.
    """

    def __init__(self, points: FloatArray, faces: IntArray) -> None:
        self.surface = Surface.of_checked(points, faces)
        self.points, self.faces = self.surface.points, frozen(faces, np.int64)

    @cached_property
    def whole(self) -> bool:
        """True when every edge has two faces that run along it in opposite directions."""
        table = self.surface.edge_table
        return bool((table.counts == 2).all() and table.pairs[2].all())

    @cached_property
    def walls(self) -> Mask:
        """Faces that part inside from outside, (m,); all where none does."""
        if self.whole and len(self._pieces) == 1:
            return np.ones(len(self.faces), bool)
        middles, normals = self.points[self.faces].mean(axis=1), self.surface.face_normals
        within = self.contains(middles - BESIDE * normals)
        parting = within != self.contains(middles + BESIDE * normals)
        return np.asarray(parting if parting.any() else ~parting)

    @cached_property
    def wall_tree(self) -> NearestTree:
        """The same faces, for distances to them."""
        return NearestTree.of_triangles(self.points, np.asarray(self.faces[self.walls], np.int32))

    @cached_property
    def corners(self) -> Index:
        """The vertices of those."""
        return np.unique(self.faces[self.walls])

    @cached_property
    def _pieces(self) -> Index:
        return np.unique(self.surface.face_pieces).astype(np.int64)

    @cached_property
    def vertex_normals(self) -> FloatArray:
        """Unit normals of the vertices, by the areas of their faces."""
        normals = np.zeros_like(self.points)
        for corner in range(3):
            np.add.at(normals, self.faces[:, corner], self.surface.face_vectors)
        return normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]

    @cached_property
    def _seen(self) -> list[tuple[FloatArray, Tree]]:
        """The vertices seen along three directions (one if closed), with trees of their faces.

        A ray both ways meets boxes at any height; one that goes up leaves out those below.
        """
        turns = [np.roll(np.arange(3), axis) for axis in range(1 if self.whole else 3)]
        views = [(self.points @ VIEW)[:, turn] for turn in turns]
        axes = 3 if self.whole else 2
        return [(frozen(view, np.float64), box_tree(view[self.faces], axes=axes)) for view in views]

    @cached_property
    def tree(self) -> Tree:
        """The tree of the faces."""
        return box_tree(self.points[self.faces])

    def contains(self, places: FloatArray) -> Mask:
        """Tell which places (q, 3) are inside, (q,): those that the surface is wound round.

        How often is a whole number for a closed mesh, for an open one the median of six rays: where
        four of them agree, the others change nothing.
        """
        counts = self._crossings(places, slice(2))
        inside = np.asarray((counts > INSIDE).all(axis=1))
        if not self.whole:
            unsure = np.flatnonzero(~inside & (counts > INSIDE).any(axis=1))
            more = self._crossings(places[unsure], slice(2, 3))
            median = np.median(np.concatenate([counts[unsure], more], axis=1), axis=1)
            inside[unsure] = median > INSIDE
        return inside

    def certainly_contains(self, places: FloatArray) -> Mask:
        """Return which places (q, 3) are inside by each of six rays, not only by most of them."""
        if self.whole:
            return self.contains(places)
        return np.asarray((self._crossings(places, slice(3)) > INSIDE).all(axis=1))

    def _crossings(self, places: FloatArray, views: slice) -> FloatArray:
        """Return how often the surface is wound round places, by one ray a view, two if open."""
        from medialis.medial_meshes._sampling_kernels import count_crossings

        parts = []
        for axis, (view, tree) in list(enumerate(self._seen))[views]:
            turned = np.ascontiguousarray((places @ VIEW)[:, np.roll(np.arange(3), axis)])
            parts.append(np.empty((len(places), 1 if self.whole else 2)))
            given = turned, view, self.faces, tree, parts[-1]
            run_chunks(count_crossings, len(places), PLACES_A_CHUNK, *given)
        return np.concatenate(parts, axis=1)

    def free_way(
        self, origins: FloatArray, directions: FloatArray, own: Index, longest: FloatArray
    ) -> tuple[FloatArray, Index]:
        """Return how far rays from places on faces `own` go, and the face met, -1 for none.

        No ray goes farther than `longest` (q,).
        """
        from medialis.medial_meshes._sampling_kernels import Rays, ray_lengths

        count = len(origins)
        length, met = np.empty(count), np.empty(count, np.int64)
        given = Rays(origins, directions, own, longest), self.points, self.faces, self.tree
        run_chunks(ray_lengths, count, RAYS_A_CHUNK, *given, length, met)
        return length, met

    @cached_property
    def bodies(self) -> list[Solid]:
        """The solid of each outer piece of a closed mesh, with the cavities in it.

        Each is a solid for itself, also where it crosses others. Pieces that are hidden in others
        are left out. Only itself where there is just one, and where the mesh is not closed.
        """
        count = len(self._pieces)
        if not self.whole or count == 1:
            return [self]
        pieces = self.surface.face_pieces
        corner = self.points[self.faces[:, 0]] - self.points.mean(axis=0)
        volumes = np.bincount(pieces, np.einsum("ij,ij->i", corner, self.surface.face_vectors))
        seen = np.bincount(pieces, self.walls) > 0
        outer = [int(i) for i in np.flatnonzero((volumes > 0) & seen)]
        if not outer:
            return [self]
        order = np.argsort(pieces, kind="stable")
        starts = np.searchsorted(pieces[order], np.arange(count + 1))
        rows = [order[starts[i] : starts[i + 1]] for i in range(count)]
        shells = {i: self._part(rows[i]) for i in outer}
        held: dict[int, list[int]] = {i: [i] for i in outer}
        for i in np.flatnonzero((volumes < 0) & seen):
            place = self.points[self.faces[rows[i][0], :1]]
            round_it = [j for j in outer if shells[j].contains(place)[0]]
            if round_it:
                held[min(round_it, key=lambda j: volumes[j])].append(int(i))
        if len(outer) == 1 and len(held[outer[0]]) == count:
            return [self]
        return [
            shells[i] if len(own) == 1 else self._part(np.concatenate([rows[j] for j in own]))
            for i, own in held.items()
        ]

    def _part(self, rows: Index) -> Solid:
        """Return the solid of some of the faces."""
        used, faces = np.unique(self.faces[rows], return_inverse=True)
        return Solid(self.points[used], faces.reshape(-1, 3).astype(np.int32))

    @cached_property
    def _crosses_itself(self) -> bool:
        """True when some faces of a piece part inside from outside, and others do not."""
        pieces, walls = self.surface.face_pieces, self.walls
        count = np.bincount(pieces[walls], minlength=len(self._pieces))
        return bool(((count > 0) & (count < np.bincount(pieces))).any())

    @cached_property
    def betti(self) -> tuple[int, int, int] | None:
        """Parts, handles and cavities of the solid; None where the mesh is no closed manifold.

        Each piece of it that parts inside from outside counts: those with the inside within are
        parts, the others cavities, and handles add up. Parts that cross count each for itself, and
        those that touch at a vertex are apart there.
        """
        if not self.whole:
            return None
        if self.bodies != [self]:
            each = [body.betti for body in self.bodies]
            known = [one for one in each if one is not None]
            parts, handles, cavities = (sum(one[k] for one in known) for k in range(3))
            return (parts, handles, cavities) if len(known) == len(each) else None
        if self._crosses_itself:
            return None
        surface, faces = self.surface, self.faces
        pieces = surface.face_pieces
        count = int(pieces.max()) + 1
        first = np.full(count, -1)
        widest = np.argsort(surface.face_areas, kind="stable")
        first[pieces[widest]] = widest
        middle, normal = self.points[faces[first]].mean(axis=1), surface.face_normals[first]
        within = self.contains(middle - BESIDE * normal)
        beyond = self.contains(middle + BESIDE * normal)
        fans = np.unique(surface.topology.corner_fans(), return_index=True)[1]
        vertices = np.bincount(pieces[fans // 3], minlength=count)
        euler = vertices - np.bincount(pieces, minlength=count) // 2
        bounds = within != beyond
        volumes = np.bincount(
            pieces, np.einsum("ij,ij->i", self.points[faces[:, 0]], surface.face_vectors), count
        )
        cavity = bounds & (volumes < 0)
        handles = (2 - euler[bounds]) // 2
        return int((bounds & ~cavity).sum()), int(handles.sum()), int(cavity.sum())


def without_holes(
    points: FloatArray, faces: IntArray, largest: float = SMALL_HOLE, most: float = MOST_BORDER
) -> tuple[FloatArray, IntArray, int]:
    """Close holes of a mesh of diagonal about 1, if it is closed then; tell how many.

    Each gets a point in its middle and triangles round it, which come last. A mesh that is open
    otherwise, with a hole larger than `largest`, or with more than a share `most` of its half-edges
    on borders, as where faces share no vertices, is returned as it is.
    """
    ends = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    keys, back = ends @ [len(points), 1], ends[:, ::-1] @ [len(points), 1]
    if np.array_equal(np.sort(keys), np.sort(back)):  # closed: sorting tells it sooner
        return points, faces, 0
    border = ends[~np.isin(back, keys)]
    if not 0 < len(border) <= most * len(ends):
        return points, faces, 0
    after = dict(border.tolist())
    if len(after) < len(border) or set(after) != set(after.values()):
        return points, faces, 0
    middles: list[FloatArray] = []
    more: list[tuple[int, int, int]] = []
    while after:
        start, now = after.popitem()
        ring = [start]
        while now != start:
            ring.append(now)
            now = after.pop(now)
        rim = points[ring]
        if np.linalg.norm(np.ptp(rim, axis=0)) > largest:
            return points, faces, 0
        middle = len(points) + len(middles)
        middles.append(rim.mean(axis=0))
        more += [(b, a, middle) for a, b in zip(ring, ring[1:] + ring[:1], strict=True)]
    every = np.concatenate([faces, np.array(more, faces.dtype)])
    filled = np.concatenate([points, middles])
    return (filled, every, len(middles)) if Solid(filled, every).whole else (points, faces, 0)


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
    owner: Index
    spacing: float

    @property
    def chosen(self) -> Index:
        """The chosen candidates."""
        return np.flatnonzero(self.owner == np.arange(len(self.owner)))

    def with_more(self, points: FloatArray, normals: FloatArray) -> Samples:
        """Return them with more samples, which stand for no area."""
        rows = len(self.points) + np.arange(len(points))
        areas, owner = np.append(self.areas, np.zeros(len(points))), np.append(self.owner, rows)
        both = np.concatenate([self.points, points]), np.concatenate([self.normals, normals])
        return Samples(*both, areas, owner, self.spacing)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Faces cut into pieces that are small against the spacing."""

    face: Index
    weights: FloatArray
    """(p, 3, 3): barycentric coordinates of the corners in their face."""
    areas: FloatArray


def take_samples(solid: Solid, count: int, seed: int) -> Samples:
    """Choose about `count` samples, more where the shape is thin."""
    surface = solid.surface
    area = float(surface.face_areas[solid.walls].sum())
    spacing = AS_APART * math.sqrt(area / count)
    pieces, corners, _ = run_together(
        lambda: _cut(solid, 2 * spacing, PIECES * count),
        lambda: _corner_normals(solid),
        lambda: solid.tree,  # for the rays
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


def _places(solid: Solid, face: Index, weights: FloatArray) -> FloatArray:
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


def _joined(values: NDArray[Any], kept: Mask, half: NDArray[Any]) -> NDArray[Any]:
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
    solid: Solid, places: FloatArray, normals: FloatArray, face: Index, spacing: float
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
) -> tuple[Index, FloatArray]:
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
    candidates: tuple[FloatArray, FloatArray, FloatArray, Index],
    local: FloatArray,
    order: Index,
    spacing: float,
) -> Samples:
    """Add the mirror images of candidates at thin walls, and choose samples among all."""
    from medialis.medial_meshes._sampling_kernels import Candidates, thin_out

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
    local, mirror = np.append(local, local[rows]), np.append(mirror, np.full(len(rows), -1))
    given = Candidates(everywhere, facing, local, mirror)
    heads = np.full(1 << int(4 * len(everywhere)).bit_length(), -1)
    owner = np.full(len(everywhere), -1)
    thin_out(given, order, heads, np.empty(len(everywhere), np.int64), owner)
    kept = owner >= 0
    number = np.cumsum(kept) - 1
    areas, owner = np.append(areas, np.zeros(len(rows)))[kept], number[owner[kept]]
    return Samples(everywhere[kept], facing[kept], areas, owner, spacing)
