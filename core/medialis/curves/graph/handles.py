"""Loops round the handles of a surface, and how often paths inside go round them (thesis 3.6.3).

A closed surface of genus g bounds a solid with g independent loops. The surface itself has 2 g: a
tree of vertices and a tree of faces leave 2 g sides, each of which closes a loop over the surface.
The faces are joined where loops would be longest first, so that those which are left are the
shortest through the root (Erickson and Whittlesey 2005): each lies at its handle.

A closed path inside is contractible in homology exactly when it is linked with none of these loops.
The solid angle of a loop, seen from a point that moves once along a closed path, changes by whole
turns, and their number is the linking number. So one angle a point and loop is all that is needed
to count turns along any path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.curves.graph.ground import JITTER, BallLinks
from medialis.kept import Described
from medialis.model.polylines import follow
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.threads import run_chunks
from medialis.validation import FloatArray, IntArray, frozen

POINTS_A_CHUNK = 64
MOST_HANDLES = 2048

DOUBTFUL = 0.1
"""Turns: the change of an angle along a link that is followed closely, if the link is long."""


@dataclass(frozen=True, eq=False, repr=False)
class Handles(Described):
    """Loops over one component of a surface.

    Attributes
    ----------
    genus : int
        Number of independent loops inside.
    loops : list of (l,) int64
        2 genus closed polylines: indices into `points`. None for more than 2048 handles: angles of
        all balls to all of them would not fit into memory.
    points : (n, 3) float64
        Vertices of the shape, and one in the middle of each hole that was closed; moved by 1e-9 of
        the size, since no angle is defined where a center lies on the side of a triangle.
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


def extra_turns(
    links: BallLinks, one: Handles, theta: FloatArray, rows: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Whole turns by which angles change along links, beyond the nearest change of less than half.

    Along a link shorter than both radii there are none: it lies in one ball, which no loop enters.
    Where balls only overlap, the angle is followed through a place that lies in both.

    Parameters
    ----------
    links : BallLinks
    one : Handles
    theta : (k, c) float64
        ``one.angles(links.centers, rows)``.
    rows : (r,) int
        Balls of the component.

    Returns
    -------
    (l,) int64
        Row of each link in the other array; -1 where there are no extra turns.
    (q, c) int64
    """
    mine = np.zeros(len(links), bool)
    mine[rows] = True
    start = np.repeat(np.arange(len(links)), np.diff(links.offsets))
    a, b, size = links.radii[start], links.radii[links.neighbours], links.length
    doubtful = mine[start] & (size >= np.minimum(a, b)) & (size < a + b)
    at = np.flatnonzero(doubtful)
    if len(at):
        change = theta[links.neighbours[at]] - theta[start[at]]
        at = at[(np.abs(change - np.rint(change)) > DOUBTFUL).any(axis=1)]
    begin, end = start[at], links.neighbours[at]
    # The middle of what lies in both balls.
    share = (np.maximum(size[at] - b[at], 0) + np.minimum(a[at], size[at])) / (2 * size[at])
    middle = links.centers[begin] + share[:, None] * (links.centers[end] - links.centers[begin])
    there = one.angles(middle, np.arange(len(at)))
    turns = np.rint(there - theta[begin]) + np.rint(theta[end] - there)
    extra = (turns - np.rint(theta[end] - theta[begin])).astype(np.int64)
    some = extra.any(axis=1)
    row = np.full(len(size), -1, np.int64)
    row[at[some]] = np.arange(int(some.sum()))
    return row, extra[some]


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
        edges are missing: they enclose no solid with a definite genus.
    """
    closed = shape if shape.faces is None else _without_holes(shape, shape.faces)
    if closed.faces is None:
        return {}
    corners, component = np.ascontiguousarray(closed.faces.ravel()), closed.components
    of_face = component[closed.faces[:, 0]]
    torn = np.unique(of_face[(closed.edge_twins.reshape(-1, 3) < 0).any(axis=1)])
    numbers, first_face = np.unique(of_face, return_index=True)
    starts = corners[3 * first_face].astype(np.int64)
    parent, sides = _sides_left(closed, starts)
    of_side, result = of_face[sides // 3], {}
    move = np.random.default_rng(0).uniform(-1, 1, closed.points.shape)
    points = frozen(closed.points + JITTER * shape.diagonal * move, np.float64)
    for number, start in zip(numbers.tolist(), starts.tolist(), strict=True):
        mine = sides[of_side == number]
        if number in torn or len(mine) % 2:
            continue
        usable = mine if len(mine) <= 2 * MOST_HANDLES else mine[:0]
        loops = [_loop(corners, int(h), parent) for h in usable]
        # Parts that touch in a vertex have the component of the shape, so its number is right.
        result[int(shape.components[start])] = Handles(len(mine) // 2, loops, points)
    return result


def _sides_left(
    closed: Shape, starts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sides that are in no tree of vertices nor of faces; also the tree of vertices, by parents."""
    from medialis.curves.graph._growth_kernels import join_faces, steps_from

    n, ends = closed.point_count, np.concatenate([closed.edges, closed.edges[:, ::-1]])
    near = Ragged.group(ends[:, 0], n)
    steps, parent = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    neighbours = np.ascontiguousarray(ends[near.indices, 1])
    steps_from(starts, near.offsets, neighbours, np.empty(n, np.int64), steps, parent)
    assert closed.faces is not None
    a, b = closed.faces.ravel(), np.roll(closed.faces, -1, axis=1).ravel()
    twins = closed.edge_twins
    free = (parent[a] != b) & (parent[b] != a) & (twins > np.arange(len(twins)))
    sides = np.flatnonzero(free)
    longest_first = np.argsort(-(steps[a[sides]] + steps[b[sides]]), kind="stable")
    sides = sides[longest_first]
    left = np.zeros(len(sides), bool)
    join_faces(sides, twins, np.arange(closed.face_count), left)
    return parent, sides[left]


def _loop(corners: NDArray[np.int32], h: int, parent: NDArray[np.int64]) -> NDArray[np.int64]:
    """Side h and the paths of both its ends up the tree, as far as they differ."""
    a, b = (follow(parent, int(corners[h])) for h in (h, h - 2 if h % 3 == 2 else h + 1))
    while len(a) > 1 and len(b) > 1 and a[-2] == b[-2]:
        a.pop()
        b.pop()
    loop = [*a, *b[-2::-1]]
    return np.array([*loop, loop[0]], np.int64)


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
