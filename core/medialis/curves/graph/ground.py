"""What a curve skeleton grows along: links between balls, and loops round handles (thesis 3.6.3).

A link between two balls stays inside the shape when each center lies in the other ball, or at least
when the balls overlap. So a graph of such links leads along the surface skeleton only.

A closed surface of genus g bounds a solid with g independent loops. The surface itself has 2 g: a
tree of vertices and a tree of faces leave 2 g sides, each of which closes a loop over the surface.
A closed path inside is contractible in homology exactly when it is linked with none of these loops.
The solid angle of a loop, seen from a point that moves once along a closed path, changes by whole
turns, and their number is the linking number. So one angle a point and loop is all that is needed
to count turns along any path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from medialis.kept import Described
from medialis.model.polylines import follow
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.threads import run_chunks, thread_count
from medialis.validation import FloatArray, IntArray, frozen

NEIGHBOURS = 10
"""Of each point, as in the thesis."""

JITTER = 1e-9
"""Fraction of the diagonal by which points move for the search of neighbours only: exactly equal
ones, as the centers of a sphere, could not be split by a tree, and every search would visit all."""

OFF_CURVE = 20.0
"""Times what a link costs on the curve skeleton that one far from it costs."""

SHORT = 0.3
"""Share of the smaller radius up to which a link counts as short: the distance of the nodes in the
end. In a thick body centers are many spacings apart; a path through it must not cost more than one
along thin balls below its surface."""

OVERLAP_ONLY, APART = 10.0, 1000.0
"""Factors of the cost where a center lies outside the other ball, and where the balls are apart:
last resorts that keep the graph in one piece."""

POINTS_A_CHUNK = 64
MOST_HANDLES = 2048


def nearest_neighbours(
    points: NDArray[np.float64], size: float, count: int = NEIGHBOURS
) -> tuple[NDArray[np.int32], FloatArray]:
    """Find the nearest other points of each point, (k, count) indices and distances.

    With fewer than count + 1 points there are fewer columns.
    """
    from scipy.spatial import cKDTree

    k = len(points)
    count = min(count, k - 1)
    if count <= 0:
        return np.empty((k, 0), np.int32), np.empty((k, 0))
    moved = points + JITTER * size * np.random.default_rng(0).uniform(-1, 1, points.shape)
    distance, near = cKDTree(moved).query(moved, k=count + 1, workers=thread_count())
    return np.ascontiguousarray(near[:, 1:], np.int32), np.ascontiguousarray(distance[:, 1:])


@dataclass(frozen=True, eq=False)
class BallLinks:
    """Balls and the links between them; row i of any array belongs to ball i.

    Attributes
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    offsets : (k + 1,) int64
        Links of ball i are numbers offsets[i] to offsets[i + 1]; each is listed from both ends.
    neighbours : (l,) int32
        The other end.
    length : (l,) float64
        Distance of the centers.
    cost : (l,) float64
        What a path along the link costs: low near the curve skeleton.
    spacing : float
        Typical distance of neighbouring balls.
    """

    centers: FloatArray
    radii: FloatArray
    offsets: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    length: FloatArray
    cost: FloatArray
    spacing: float

    def __len__(self) -> int:
        return len(self.radii)


def link_balls(
    centers: FloatArray,
    radii: FloatArray,
    closeness: FloatArray,
    near: NDArray[np.int64],
    needed: NDArray[np.int64],
    *,
    spacing: float,
) -> BallLinks:
    """Link balls and give each link a cost.

    Parameters
    ----------
    centers : (k, 3) float64
    radii : (k,) float64
    closeness : (k,) float64
        1 on the curve skeleton, 0 far from it.
    near : (a, 2) int
        Pairs that may be linked: used where each center lies in the other ball.
    needed : (b, 2) int
        Pairs that are linked in any case, for the graph to hang together.
    spacing : float
        Typical distance of neighbouring balls; a link longer than this, and than a share of the
        smaller radius, costs more for its length.

    Returns
    -------
    BallLinks
    """
    k = len(radii)
    pairs = np.sort(np.concatenate([near, needed]).astype(np.int64), axis=1)
    wanted = np.arange(len(pairs)) >= len(near)
    key = pairs[:, 0] * k + pairs[:, 1]
    distance, smaller, both = _measure(centers, radii, pairs)
    use = (pairs[:, 0] != pairs[:, 1]) & (wanted | (distance < smaller))
    key = np.sort(key[use])
    key = key[np.r_[True, key[1:] != key[:-1]][: len(key)]]
    low, high = np.divmod(key, k)
    distance, smaller, both = _measure(centers, radii, np.stack([low, high], axis=1))
    density = 1 / (1 / OFF_CURVE + closeness)
    long = 1 + distance / np.maximum(SHORT * smaller, spacing)
    cost = distance * long * (density[low] + density[high]) / 2
    cost *= np.where(distance < smaller, 1.0, np.where(distance < both, OVERLAP_ONLY, APART))
    cost += 1e-9 * spacing  # coincident centers: the path with fewer links
    start = np.concatenate([low, high])
    order = np.argsort(start, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(start, minlength=k))])
    return BallLinks(
        centers,
        radii,
        offsets,
        np.concatenate([high, low])[order].astype(np.int32),
        frozen(np.concatenate([distance, distance])[order], np.float64),
        frozen(np.concatenate([cost, cost])[order], np.float64),
        spacing,
    )


def _measure(
    centers: FloatArray, radii: FloatArray, pairs: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance of each pair, its smaller radius, the sum of its radii."""
    a, b = pairs.T
    distance = np.linalg.norm(centers[a] - centers[b], axis=1)
    return distance, np.minimum(radii[a], radii[b]), radii[a] + radii[b]


@dataclass(frozen=True, eq=False, repr=False)
class Handles(Described):
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
    n, ends = closed.point_count, np.concatenate([closed.edges, closed.edges[:, ::-1]])
    near = Ragged.group(ends[:, 0], n)
    offsets, neighbours = near.offsets, np.ascontiguousarray(ends[near.indices, 1])
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
