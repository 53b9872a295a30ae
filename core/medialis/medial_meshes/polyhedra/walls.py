"""The exact places of the medial axis of a polyhedron that is not convex: sheets, seams, junctions.

Flat faces that meet at a reflex edge, which goes inwards, are one smooth wall as seen from inside:
where a ball rolls on from a face over such an edge to the next face, nothing meets. So the sheet
between that wall and another is one, flat beside faces and parabolic beside edges; seams are where
three walls are equally near, junctions where four are.

1. `Facets`: the flat faces of a mesh, their borders, and which of them are smooth together.
2. The fine complex of samples that know their face (`fine_complex`): only what parts samples of
   different walls stays of it.
3. `Facets.placed`: each ball moves to the nearest place that is as far from all its walls.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from medialis.base.arrays import Index, Mask, kd_tree
from medialis.base.validation import FloatArray
from medialis.medial_meshes.roofs import FLAT, facets_of
from medialis.medial_meshes.sampling import Solid
from medialis.shape.surface import piece_labels

STEPS = 8
"""Of Newton's, at most; each is no longer than the radius."""

EXACT = 1e-9
"""Diagonals: balls as near to all their walls are placed."""

OUT = 1e-6
"""Diagonals: balls that reach so far beyond a face touch that, too."""

MENDED = 3
"""How often such faces join."""


@dataclass(frozen=True, eq=False)
class Facets:
    """The flat faces of a mesh.

    Attributes
    ----------
    planes : (k, 4) float64
        Inward unit normals n and offsets b, n.x + b = 0 on each.
    ends : (s, 2, 3) float64
        Their borders, as few segments as go.
    beside : (s, 2) int64
        The faces on both sides of each.
    reflex : (s,) bool
        Whether the solid has more than half of the space there.
    """

    planes: FloatArray
    ends: FloatArray
    beside: Index
    reflex: Mask

    def __len__(self) -> int:
        return len(self.planes)

    @classmethod
    def of(cls, solid: Solid) -> Facets | None:
        """Find them; None where the mesh has too many, or faces that are not flat."""
        found = facets_of(solid)
        if found is None or not solid.whole:
            return None
        planes, label = found
        points, faces, table = solid.points, solid.faces, solid.surface.edge_table
        first, second, _ = table.pairs
        a, b = label[first // 3], label[second // 3]
        border = np.flatnonzero((a != b) & (a >= 0) & (b >= 0))
        first, second, a, b = first[border], second[border], a[border], b[border]
        far = points[faces[second // 3, (second + 2) % 3]]
        height = np.einsum("ij,ij->i", far, planes[a, :3]) + planes[a, 3]
        rows = np.stack([faces[first // 3, first % 3], faces[first // 3, (first + 1) % 3]], axis=1)
        low, high = np.minimum(a, b), np.maximum(a, b)
        ends, beside, reflex = [], [], []
        kinds, which = np.unique(
            np.stack([low, high, height < 0], axis=1), axis=0, return_inverse=True
        )
        for k, (i, j, inward) in enumerate(kinds.tolist()):
            for start, end in _merged(points[rows[which.ravel() == k]]):
                ends.append((start, end))
                beside.append((i, j))
                reflex.append(bool(inward))
        return cls(
            planes, np.array(ends).reshape(-1, 2, 3), np.array(beside).reshape(-1, 2),
            np.array(reflex, bool),
        )  # fmt: skip

    @cached_property
    def smooth(self) -> Mask:
        """Whether two faces are the same, or meet at a reflex edge, (k, k)."""
        result = np.eye(len(self), dtype=bool)
        i, j = self.beside[self.reflex].T
        result[i, j] = result[j, i] = True
        return result

    def nearest(self, places: FloatArray, face: int) -> tuple[FloatArray, FloatArray]:
        """Return how far places (q, 3) are from a face, and its nearest points (q, 3)."""
        normal, offset = self.planes[face, :3], self.planes[face, 3]
        own = self.ends[(self.beside == face).any(axis=1)]
        height = places @ normal + offset
        foot = places - height[:, None] * normal
        axis = int(np.abs(normal).argmax())
        x, y = (np.arange(3) != axis).nonzero()[0]
        a, b = own[:, 0], own[:, 1]
        py = foot[:, None, y]
        crosses = (a[:, y] > py) != (b[:, y] > py)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = a[:, x] + (py - a[:, y]) * (b[:, x] - a[:, x]) / (b[:, y] - a[:, y])
        within = (crosses & (at > foot[:, None, x])).sum(axis=1) % 2 == 1
        out = np.flatnonzero(~within)
        if len(out):
            foot[out] = _on_segments(own, places[out])
        return np.linalg.norm(places - foot, axis=1), foot

    def distances(self, places: FloatArray) -> FloatArray:
        """Return how far places are from all faces, (q, k)."""
        return np.stack([self.nearest(places, k)[0] for k in range(len(self))], axis=1)

    def walls(self, faces: Mask) -> list[Index]:
        """Sort faces (k,) into walls: the faces of each, and those that go on smoothly from it."""
        some = np.flatnonzero(faces)
        links = np.argwhere(np.triu(self.smooth[np.ix_(some, some)], 1))
        label = piece_labels(len(some), links)
        walls = [some[label == one] for one in np.unique(label)]
        reached = np.stack([self.smooth[one].any(axis=0) for one in walls])
        alone = reached & (reached.sum(axis=0) == 1)
        for k, one in enumerate(walls):
            alone[k, one] = True
        return [np.flatnonzero(row) for row in alone]

    def count_walls(self, touched: Mask) -> Index:
        """Return how many walls there are among faces, (v,)."""
        kinds, which = np.unique(touched, axis=0, return_inverse=True)
        numbers = [len(self.walls(kind)) if kind.any() else 0 for kind in kinds]
        return np.array(numbers)[which.ravel()]

    def alike(self, first: Index, second: Index) -> Mask:
        """Tell whether two pairs of faces, (q, 2), are of the same walls."""
        (a, b), (c, d), smooth = first.T, second.T, self.smooth
        return np.asarray((smooth[a, c] & smooth[b, d]) | (smooth[a, d] & smooth[b, c]))

    @cached_property
    def corners(self) -> tuple[FloatArray, Mask]:
        """The corners (c, 3) of faces, and the faces that each belongs to, (c, k)."""
        points = self.ends.reshape(-1, 3)
        links = kd_tree(points).query_pairs(2 * FLAT, output_type="ndarray")
        label = piece_labels(len(points), links)
        first = np.unique(label, return_index=True)[1]
        faces = np.zeros((len(first), len(self)), bool)
        for end in range(2):
            for side in range(2):
                faces[label[end::2], self.beside[:, side]] = True
        return points[first], faces

    def on_rim(self, places: FloatArray, touched: Mask) -> tuple[FloatArray, Mask]:
        """Move places (q, 3) to the edge of the solid, or the corner, that their walls share.

        The place next to a corner of these goes there. Returns the faces that they touch, too.
        """
        result, touched = places.copy(), touched.copy()
        walls = self.count_walls(touched)
        corners, around = self.corners
        out = ~self.reflex
        for kind in np.unique(touched, axis=0):
            rows = np.flatnonzero((touched == kind).all(axis=1))
            own = out & kind[self.beside].all(axis=1)
            shared = (around & kind).sum(axis=1) > 2
            if walls[rows[0]] > 2 and shared.any():
                near = corners[shared]
                result[rows] = near[kd_tree(near).query(places[rows])[1]]
            elif own.any():
                result[rows] = _on_segments(self.ends[own], places[rows])
        sharp = np.zeros(len(corners), np.int64)
        np.add.at(sharp, np.unique(kd_tree(corners).query(self.ends[out].reshape(-1, 3))[1]), 1)
        for k in np.flatnonzero(sharp):
            fits = np.flatnonzero((touched <= around[k]).all(axis=1))
            if len(fits):
                row = fits[np.linalg.norm(result[fits] - corners[k], axis=1).argmin()]
                result[row], touched[row] = corners[k], around[k]
        return result, touched

    def placed(
        self, centers: FloatArray, touched: Mask, mended: int = MENDED
    ) -> tuple[FloatArray, Mask]:
        """Move balls to the nearest places as far from all their walls.

        Parameters
        ----------
        centers : (v, 3) float64
        touched : (v, k) bool

        Returns
        -------
        (v, 4) float64
        (v, k) bool
            With the faces that the balls would reach beyond otherwise.
        """
        balls, touched = np.empty((len(centers), 4)), touched.copy()
        rows, now = np.arange(len(centers)), centers.copy()
        for _ in range(mended):
            balls[rows] = self._placed(now[rows], touched[rows])
            lengths = self.distances(balls[rows, :3])
            beyond = lengths < balls[rows, 3:] - OUT
            bad = beyond.any(axis=1)
            if not bad.any():
                break
            touched[rows[bad], lengths[bad].argmin(axis=1)] = True
            rows = rows[bad]
        return balls, touched

    def _placed(self, centers: FloatArray, touched: Mask) -> FloatArray:
        balls = np.column_stack([centers, np.zeros(len(centers))])
        kinds, which = np.unique(touched, axis=0, return_inverse=True)
        order = np.argsort(which.ravel(), kind="stable")
        starts = np.searchsorted(which.ravel()[order], np.arange(len(kinds) + 1))
        for k, faces in enumerate(kinds):
            rows = order[starts[k] : starts[k + 1]]
            balls[rows] = self._between(centers[rows], self.walls(faces))
        return balls

    def _between(self, centers: FloatArray, walls: list[Index]) -> FloatArray:
        """Return the balls next to places that touch all walls, by Newton's steps."""
        at = centers.copy()
        for step in range(STEPS + 1):
            far, feet = self._contacts(at, walls)
            r = far.mean(axis=1)
            if step == STEPS or np.abs(far - r[:, None]).max() < EXACT:
                break
            slope = (at[:, None] - feet) / np.maximum(far, 1e-300)[..., None]
            system = np.concatenate([slope, np.full((*far.shape, 1), -1.0)], axis=2)
            move = np.einsum("qij,qj->qi", np.linalg.pinv(system, rcond=1e-5), r[:, None] - far)
            size = np.linalg.norm(move[:, :3], axis=1)
            at += move[:, :3] * np.minimum(1.0, r / np.maximum(size, 1e-300))[:, None]
        return np.column_stack([at, far.min(axis=1)])

    def _contacts(self, at: FloatArray, walls: list[Index]) -> tuple[FloatArray, FloatArray]:
        """Return how far places (q, 3) are from walls (q, w), and where these are nearest."""
        far, feet = np.full((len(at), len(walls)), np.inf), np.empty((len(at), len(walls), 3))
        for w, faces in enumerate(walls):
            for face in faces:
                length, foot = self.nearest(at, int(face))
                nearer = length < far[:, w]
                far[nearer, w], feet[nearer, w] = length[nearer], foot[nearer]
        return far, feet


def _merged(ends: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Join segments (n, 2, 3) of one line that hang together."""
    start = ends[0, 0]
    way = ends[0, 1] - start
    way /= np.linalg.norm(way)
    along = np.sort((ends - start) @ way, axis=1)
    along = along[np.argsort(along[:, 0])]
    result: list[list[float]] = []
    for low, high in along.tolist():
        if result and low < result[-1][1] + FLAT:
            result[-1][1] = max(result[-1][1], high)
        else:
            result.append([low, high])
    return [(start + low * way, start + high * way) for low, high in result]


def _on_segments(ends: FloatArray, places: FloatArray) -> FloatArray:
    """Return the nearest points of segments (s, 2, 3) to places (q, 3)."""
    way = ends[:, 1] - ends[:, 0]
    share = np.einsum("qsk,sk->qs", places[:, None] - ends[:, 0], way)
    share = np.clip(share / np.einsum("sk,sk->s", way, way), 0.0, 1.0)
    there = ends[:, 0] + share[..., None] * way
    far = np.linalg.norm(there - places[:, None], axis=2)
    return np.asarray(there[np.arange(len(places)), far.argmin(axis=1)])
