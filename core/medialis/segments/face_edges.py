"""How much a mesh turns between two patches of its faces (for thesis 6.3.2)."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.surface.creases import bends_inward, crease_edges
from medialis.validation import FloatArray, IntArray, frozen

SHARPER = 1.5
"""An edge bends this many times as sharply as the surface beside it, or it is none: a bore wall,
which is bent alike everywhere, has no edge of its own."""


@dataclass(frozen=True, eq=False)
class FaceEdges:
    """The e edges between two faces of a mesh.

    Attributes
    ----------
    shape : Shape
    faces : (e, 2) int32
        The two faces at each edge.
    crease : (e,) bool
        Whether it divides them.
    length : (e,) float64
    """

    shape: Shape
    faces: IntArray
    crease: NDArray[np.bool_]
    length: FloatArray

    @classmethod
    def of(cls, shape: Shape, min_angle: float, kinds: tuple[bool, bool]) -> FaceEdges:
        """Find the edges; `kinds`: whether convex creases divide, and concave ones."""
        first, second, bent = crease_edges(shape, min_angle)
        bent &= np.where(bends_inward(shape, first, second), kinds[1], kinds[0])
        corners = np.asarray(shape.faces).ravel()
        along = shape.points[corners[first]] - shape.points[corners[second]]
        faces = np.stack([first // 3, second // 3], axis=1)
        return cls(shape, faces, bent, np.linalg.norm(along, axis=1))

    def graph(self, *, creases: bool) -> Ragged:
        """Return the neighbours of each face, across creases or not, m rows."""
        ends = self.faces if creases else self.faces[~self.crease]
        both = np.concatenate([ends, ends[:, ::-1]])
        rows = Ragged.group(both[:, 0], self.shape.face_count)
        return Ragged(rows.offsets, frozen(both[rows.indices, 1], np.int32))

    def turns(self, faces: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
        """Return by how much the surface turns between pairs of faces (e, 2), and their distances.

        Radians; positive where it bends inward.
        """
        normals = self.shape.face_normals[faces]
        centers = self.shape.points[np.asarray(self.shape.faces)[faces]].mean(axis=2)
        away = centers[:, 1] - centers[:, 0]
        cross = np.linalg.norm(np.cross(normals[:, 0], normals[:, 1]), axis=1)
        turn = np.arctan2(cross, np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]))
        inward = np.einsum("ij,ij->i", away, normals[:, 0] - normals[:, 1]) > 0
        return np.where(inward, turn, -turn), np.linalg.norm(away, axis=1)


def joined_across_weak(
    edges: FaceEdges,
    labels: IntArray,
    seed: IntArray,
    free: NDArray[np.bool_],
    min_angle: float,
) -> IntArray:
    """Join patches where most of their common border is no edge.

    A border is an edge at a crease, and where the surface turns by `min_angle` between the faces
    off all edges that are nearest on both sides, more sharply than the patches themselves do.

    Parameters
    ----------
    edges : FaceEdges
    labels : (m,) int32
    seed : (m,) int32
        The nearest face off soft edges; -1: none.
    free : (m,) bool
        Faces off soft edges.
    min_angle : float
        Degrees.
    """
    ends = labels[edges.faces]
    border = (ends[:, 0] != ends[:, 1]) & ((seed[edges.faces] >= 0).all(axis=1) | edges.crease)
    rows, pair = np.flatnonzero(border), ends[border]
    turn, distance = edges.turns(seed[edges.faces[rows]])
    usual = _bend(edges, labels, free)[pair].mean(axis=1) * np.sign(turn)
    sharp = np.abs(turn) >= SHARPER * usual * distance
    edge = edges.crease[rows] | ((np.abs(turn) >= math.radians(min_angle)) & sharp)
    vote = np.where(edge, 1.0, -1.0) * edges.length[rows]
    return _joined(pair, vote, int(labels.max(initial=-1)) + 1)[labels]


def _joined(pair: NDArray[Any], vote: FloatArray, count: int) -> IntArray:
    """Join pairs with negative votes, the most negative first; the votes of joined pairs add up."""
    used, which = np.unique(np.sort(pair, axis=1), axis=0, return_inverse=True)
    total = np.bincount(which.reshape(-1), vote, minlength=len(used))
    votes: list[dict[int, float]] = [{} for _ in range(count)]
    for (a, b), value in zip(used.tolist(), total.tolist(), strict=True):
        votes[a][b] = votes[b][a] = value
    waiting = [(v, a, b) for (a, b), v in zip(used.tolist(), total.tolist(), strict=True) if v < 0]
    heapq.heapify(waiting)
    target = np.arange(count, dtype=np.int32)
    while waiting:
        value, a, b = heapq.heappop(waiting)
        if votes[a].get(b) != value:
            continue  # one of them was joined, or their border grew
        target[target == b] = a
        del votes[a][b], votes[b][a]
        for other, more in votes[b].items():
            del votes[other][b]
            total_vote = votes[a].get(other, 0.0) + more
            votes[a][other] = votes[other][a] = total_vote
            if total_vote < 0:
                heapq.heappush(waiting, (total_vote, min(a, other), max(a, other)))
        votes[b] = {}
    return target


def _bend(edges: FaceEdges, labels: IntArray, free: NDArray[np.bool_]) -> FloatArray:
    """Mean curvature of each patch off its soft edges, positive where it bends inward."""
    ends, count = labels[edges.faces], int(labels.max(initial=-1)) + 1
    inside = (ends[:, 0] == ends[:, 1]) & free[edges.faces].all(axis=1) & ~edges.crease
    turn = edges.turns(edges.faces[inside])[0] * edges.length[inside]
    area = np.bincount(labels[free], edges.shape.face_areas[free], minlength=count)
    total = np.bincount(ends[inside, 0], turn, minlength=count)
    return np.divide(total, area, out=np.zeros(count), where=area > 0)
