"""The graph of the samples, and what follows from neighbours and places (thesis 6.2, 6.3).

`surface_graph` tells along which neighbours a surface is followed, `nearest_seeds` searches along
it, `dissected` orders the vertices so that a system on a surface is solved soon (nested
dissection), and `Enclosure` counts how often a surface is wound round a place: twice where parts
overlap (for thesis 3.5.1).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Ragged
from medialis.base.kept import kept
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray, frozen
from medialis.shape.shape import Shape
from medialis.shape.surface import link_matrix

CLOUD_NEIGHBOURS = 8  # halved 26 %, doubled 36 %
"""Nearest samples that are neighbours in a cloud; about as many as a vertex of a mesh has."""

OPPOSITE = -0.5  # halved < 0.1 %, doubled < 0.1 %
"""Cosine between normals below which near samples of a cloud lie on two sides of a thin wall."""


def surface_graph(shape: Shape) -> Ragged:
    """Return the neighbours of every sample; they are kept with the shape.

    Parameters
    ----------
    shape : Shape
        n samples.

    Returns
    -------
    Ragged
        n rows: the samples that share an edge with a sample; in a cloud its 8 nearest ones and
        those that it is one of the nearest of, without those whose normal is opposite. Every link
        is listed from both ends.
    """

    def work() -> Ragged:
        if shape.faces is None:
            return _cloud_graph(shape)
        return mesh_graph(shape.faces, np.ones(shape.point_count, np.bool_))

    return kept(surface_graph, shape, None, work, Progress())


def mesh_graph(faces: IntArray, wanted: NDArray[np.bool_]) -> Ragged:
    """Return the neighbours of n vertices along the faces with a wanted corner, n rows."""
    from medialis.shape._kernels import count_corners, drop_repeats, list_neighbours

    offsets = np.zeros(len(wanted) + 1, np.int64)
    count_corners(faces, wanted, offsets)
    neighbours = np.empty(offsets[-1], np.int32)
    list_neighbours(faces, wanted, offsets.copy(), neighbours)
    return Ragged(offsets, neighbours[: drop_repeats(offsets, neighbours)])


def _cloud_graph(shape: Shape) -> Ragged:
    n, k = shape.point_count, min(CLOUD_NEIGHBOURS + 1, shape.point_count)
    near = shape.tree.query(shape.points, k=k)[1].reshape(n, k)
    a, b = np.repeat(np.arange(n), k), near.ravel()
    cosine = np.einsum("ij,ij->i", shape.normals[a], shape.normals[b])
    kept = (a != b) & (cosine > OPPOSITE)
    graph = link_matrix(n, np.stack([a[kept], b[kept]], axis=1))
    return Ragged(graph.indptr, graph.indices)


def nearest_seeds(
    points: FloatArray, graph: Ragged, seeds: NDArray[np.bool_]
) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the nearest of the points that are seeds, along the graph, and its distance, (n,).

    Ties go to the lowest index; -1 and inf where no seed can be reached. The third array lists the
    points that are no seed and that one reaches, the nearest first.
    """
    from medialis.shape._kernels import spread_from_seeds

    n = len(points)
    seed = np.where(seeds, np.arange(n), -1).astype(np.int32)
    distance = np.where(seeds, 0.0, np.inf)
    order = np.empty(n, np.int32)
    count = spread_from_seeds(points, graph.offsets, graph.indices, distance, seed, order)
    return seed, distance, order[:count]


def local_spacing(shape: Shape) -> FloatArray:
    """Return the mean distance of each sample to its neighbours, (n,); `shape.spacing` without."""

    def work() -> FloatArray:
        graph = surface_graph(shape)
        count = graph.lengths
        sample = np.repeat(np.arange(len(graph)), count)
        length = np.linalg.norm(shape.points[sample] - shape.points[graph.indices], axis=1)
        total = np.bincount(sample, length, minlength=len(graph))
        mean = np.where(count > 0, total / np.maximum(count, 1), shape.spacing)
        return frozen(mean, np.float64)

    return kept(local_spacing, shape, None, work, Progress())


LEAF = 64
"""Vertices that are no longer divided."""


def dissected(points: FloatArray, edges: IntArray) -> NDArray[np.int64]:
    """Return an order of n vertices for which the factors of a matrix with these edges stay small.

    Parameters
    ----------
    points : (n, 3) float64
    edges : (e, 2) int
        Where the matrix has entries beside its diagonal.

    Returns
    -------
    (n,) int64
        Each vertex once.

    Notes
    -----
    Parts are halved across their longest side, and what the cut edges touch comes after both
    halves: of two ends the one that more of them touch, so that a hub goes and not all of its
    spokes (George 1973). On 537,000 vertices factors take 6 s; by minimum degree they took minutes.
    Cost O(n log^2 n).
    """
    n = len(points)
    levels = max(0, (n // LEAF).bit_length())
    part, level = np.zeros(n, np.int64), np.full(n, levels)
    inside = np.ones(n, np.bool_)
    a, b = edges.T.astype(np.int64)
    for depth in range(levels):
        side = _second_half(points, part, inside)
        cut = inside[a] & inside[b] & (part[a] == part[b]) & (side[a] != side[b])
        one, other = a[cut], b[cut]
        touched = np.bincount(np.concatenate([one, other]), minlength=n)
        first = touched[one] > touched[other]
        first |= (touched[one] == touched[other]) & ~side[one]
        wall = np.where(first, one, other)
        level[wall], inside[wall] = depth, False
        part[inside] = 2 * part[inside] + side[inside]
    return np.lexsort((-level, (part + 1) << (levels - level)))


def _second_half(
    points: FloatArray, part: NDArray[np.int64], inside: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Tell the vertices of the second half of each part along its longest side, (n,)."""
    result = np.zeros(len(points), np.bool_)
    rows = np.flatnonzero(inside)
    rows = rows[np.argsort(part[rows], kind="stable")]
    if len(rows) == 0:
        return result
    first = np.flatnonzero(np.diff(part[rows], prepend=-1))
    count = np.diff(np.append(first, len(rows)))
    placed = points[rows]
    sides = np.maximum.reduceat(placed, first) - np.minimum.reduceat(placed, first)
    along = placed[np.arange(len(rows)), np.repeat(sides.argmax(axis=1), count)]
    order = rows[np.lexsort((along, part[rows]))]
    rank = np.arange(len(rows)) - np.repeat(first, count)
    result[order] = rank >= np.repeat((count + 1) // 2, count)
    return result


VIEW = np.linalg.qr(np.array([[0.31, 0.83, 0.46], [0.72, -0.15, 0.67], [0.59, 0.53, -0.61]]))[0]
"""Three directions at right angles, off the axes that shapes are drawn along: rays meet no edge."""

ENCLOSED, TWICE = 0.5, 1.5
"""Times a surface is wound round a place from which on it is inside, and inside of two parts."""


class Enclosure:
    """What tells how often a surface is wound round a place.

    Parameters
    ----------
    shape : Shape
        n samples and m faces, outward.
    """

    def __init__(self, shape: Shape) -> None:
        self.shape = shape

    @cached_property
    def _seen(self) -> FloatArray:
        """The points as seen along `VIEW`, (n, 3)."""
        # A product of matrices wakes all threads, which costs more than it saves.
        return np.einsum("na,ab->nb", self.shape.points - self.shape.bounds[0], VIEW)

    @cached_property
    def _bounds(self) -> FloatArray:
        """Least and largest coordinates of faces as seen, then of blocks of them, (6, m + b)."""
        from medialis.shape._kernels import FACES, bound_faces

        assert self.shape.faces is not None
        count = self.shape.face_count
        bounds = np.empty((6, count + -(-count // FACES)))
        bound_faces(self._seen, self.shape.faces, bounds)
        return bounds

    def times(self, places: FloatArray) -> FloatArray:
        """Return how often the surface is wound round each of some places (q, 3) off it, (q,).

        Of a closed mesh a whole number: 0 outside, 1 inside, 2 where two parts of it overlap. Of an
        open mesh the median of six rays. Of a cloud its solid angle, good where places are several
        spacings off the samples.

        Cost O(q (m + n)), 1 ms for a place in a mesh of 400,000 faces.
        """
        if self.shape.faces is None:
            return _times_by_samples(self.shape, places)
        from medialis.shape._kernels import count_crossings

        counts, mesh = np.zeros((len(places), 6)), (self._seen, self.shape.faces, self._bounds)
        for row, place in zip(counts, (places - self.shape.bounds[0]) @ VIEW, strict=True):
            count_crossings(*mesh, place, row)
        return np.asarray(np.median(counts, axis=1))


def _times_by_samples(shape: Shape, places: FloatArray) -> FloatArray:
    """Sum the solid angles of samples, each as large as the disc of its nearest neighbours."""
    k = min(CLOUD_NEIGHBOURS, shape.point_count - 1)
    if k < 1:
        return np.zeros(len(places))
    area = np.pi * shape.tree.query(shape.points, k=[k + 1])[0][:, 0] ** 2 / k
    result = np.empty(len(places))
    for i, place in enumerate(places):
        away = shape.points - place
        distance = np.linalg.norm(away, axis=1)
        facing = np.einsum("ij,ij->i", away, shape.normals)
        seen = distance > 0
        result[i] = (area[seen] * facing[seen] / distance[seen] ** 3).sum() / (4 * np.pi)
    return result
