"""Handles of a shape: functions that tell how often a way inside it goes round each (thesis 3.6).

A closed surface of genus g bounds a solid with g independent loops. The surface itself has 2 g: a
tree of vertices and a tree of faces leave 2 g sides, each of which closes a loop over the surface.
A closed way inside is contractible in homology exactly when it is linked with none of these loops.
The solid angle of a loop, seen from a point that moves once along a closed way, changes by whole
turns, and their number is the linking number. So one angle a point and loop is all that is needed
to count turns along any way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.model.shape import Shape
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray, frozen

POINTS_A_CHUNK = 64
MOST_HANDLES = 2048


@dataclass(frozen=True, eq=False)
class Handles:
    """Loops over one component of a surface.

    Attributes
    ----------
    genus : int
        Number of independent loops inside.
    loops : list of (l,) int64
        2 genus closed polylines: indices into `points`.
    points : (n, 3) float64
        Vertices of the shape, and one in the middle of each hole that was closed.
    """

    genus: int
    loops: list[NDArray[np.int64]]
    points: FloatArray

    def angles(self, centers: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
        """Solid angle of each loop seen from ``centers[rows]``, in turns, (k, 2 genus).

        Rows that are not asked for are 0. Cost: rows times the length of all loops, 60 ns each.
        """
        from medialis.curves.graph._growth_kernels import solid_angles

        theta = np.zeros((len(centers), len(self.loops)))
        if not self.loops:
            return theta
        offsets = np.concatenate([[0], np.cumsum([len(loop) for loop in self.loops])])
        flat = np.concatenate(self.loops)

        def work(begin: int, end: int) -> None:
            solid_angles(begin, end, rows, centers, offsets, flat, self.points, theta)

        run_chunks(work, len(rows), POINTS_A_CHUNK)
        return frozen(theta, np.float64)


def find_handles(shape: Shape) -> dict[int, Handles]:
    """Find the loops over each component of a surface.

    Parameters
    ----------
    shape : Shape
        A mesh. Holes are closed by a fan of triangles first.

    Returns
    -------
    dict
        Handles by the number of the component (`Shape.components`). Components with non-manifold
        edges are missing: they enclose no solid with a definite genus. So are those with more than
        2048 handles: angles of all balls to all of them would not fit into memory.
    """
    from medialis.curves.graph._growth_kernels import cut_open

    closed = shape if shape.faces is None else _without_holes(shape, shape.faces)
    if closed.faces is None:
        return {}
    corners, twins = np.ascontiguousarray(closed.faces.ravel()), closed.edge_twins
    component = closed.components
    of_face = component[closed.faces[:, 0]]
    torn = set(np.unique(of_face[(twins.reshape(-1, 3) < 0).any(axis=1)]).tolist())
    offsets, neighbours = _vertex_graph(closed)
    n = closed.point_count
    seen, used = np.zeros(n, bool), np.zeros(closed.face_count, bool)
    parent, sides = np.full(n, -1, np.int64), np.empty(2 * MOST_HANDLES, np.int64)
    result = {}
    numbers, first_face = np.unique(of_face, return_index=True)
    for number, face in zip(numbers.tolist(), first_face.tolist(), strict=True):
        if number in torn:
            continue
        start = int(corners[3 * face])
        count = cut_open(
            corners, twins, offsets, neighbours, start, face, seen, used, parent, sides
        )
        if count % 2 or count > len(sides):
            continue
        loops = [_loop(corners, int(h), parent) for h in sides[:count]]
        # Parts that touch in a vertex have the component of the shape, so its number is right.
        result[int(shape.components[start])] = Handles(count // 2, loops, closed.points)
    return result


def _loop(corners: NDArray[np.int32], h: int, parent: NDArray[np.int64]) -> NDArray[np.int64]:
    """Side h and the ways of both its ends up the tree, as far as they differ."""
    ways = []
    for v in (int(corners[h]), int(corners[h - 2 if h % 3 == 2 else h + 1])):
        way = [v]
        while parent[way[-1]] >= 0:
            way.append(int(parent[way[-1]]))
        ways.append(way)
    a, b = ways
    while len(a) > 1 and len(b) > 1 and a[-2] == b[-2]:
        a.pop()
        b.pop()
    loop = [*a, *b[-2::-1]]
    return np.array([*loop, loop[0]], np.int64)


def _vertex_graph(shape: Shape) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    ends = np.concatenate([shape.edges, shape.edges[:, ::-1]])
    order = np.argsort(ends[:, 0], kind="stable")
    count = np.bincount(ends[:, 0], minlength=shape.point_count)
    return np.concatenate([[0], np.cumsum(count)]), np.ascontiguousarray(ends[order, 1])


def _without_holes(shape: Shape, given: IntArray) -> Shape:
    """Close each hole by a fan of triangles round the mean of its border."""
    half = given[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = np.sort(half, axis=1).astype(np.int64).T
    _, place, count_of = np.unique(
        low * shape.point_count + high, return_inverse=True, return_counts=True
    )
    single = count_of[place.reshape(-1)] == 1
    border = half[single]
    if len(border) == 0:
        return shape
    after: dict[int, list[int]] = {}
    for a, b in border.tolist():
        after.setdefault(b, []).append(a)  # the fan runs the other way
    points, faces = [shape.points], [given]
    count = shape.point_count
    while after:
        start = next(iter(after))
        ring, here = [], start
        while after.get(here):
            ring.append(here)
            following = after[here].pop()
            if not after[here]:
                del after[here]
            here = following
        if here != start:  # the border runs into itself: leave it open
            continue
        points.append(shape.points[ring].mean(axis=0, keepdims=True))
        faces.append(np.stack([ring, np.roll(ring, -1), np.full(len(ring), count)], axis=1))
        count += 1
    every = np.concatenate(points)
    return Shape(every, np.zeros_like(every), np.concatenate(faces).astype(np.int32))
