"""The graph of the samples: along which neighbours a surface is followed (thesis 6.2, 6.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from medialis.kept import kept
from medialis.model.ragged import Ragged
from medialis.model.shape import Shape
from medialis.progress import Progress
from medialis.validation import FloatArray, IntArray, frozen

CLOUD_NEIGHBOURS = 8
"""Nearest samples that are neighbours in a cloud; about as many as a vertex of a mesh has."""

OPPOSITE = -0.5
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
    from medialis.surface._surface_graph_kernels import (
        count_corners,
        drop_repeats,
        list_neighbours,
    )

    offsets = np.zeros(len(wanted) + 1, np.int64)
    count_corners(faces, wanted, offsets)
    neighbours = np.empty(offsets[-1], np.int32)
    list_neighbours(faces, wanted, offsets.copy(), neighbours)
    return Ragged(offsets, neighbours[: drop_repeats(offsets, neighbours)])


def _cloud_graph(shape: Shape) -> Ragged:
    from scipy.sparse import coo_array

    n, k = shape.point_count, min(CLOUD_NEIGHBOURS + 1, shape.point_count)
    near = shape.tree.query(shape.points, k=k)[1].reshape(n, k)
    a, b = np.repeat(np.arange(n), k), near.ravel()
    cosine = np.einsum("ij,ij->i", shape.normals[a], shape.normals[b])
    kept = (a != b) & (cosine > OPPOSITE)
    a, b = a[kept], b[kept]
    ends = np.concatenate([a, b]), np.concatenate([b, a])
    graph = coo_array((np.ones(len(ends[0]), np.int8), ends), shape=(n, n)).tocsr()
    return Ragged(graph.indptr, graph.indices)


def nearest_seeds(
    points: FloatArray, graph: Ragged, seeds: NDArray[np.bool_]
) -> tuple[IntArray, FloatArray]:
    """Return the nearest of the points that are seeds, along the graph, and its distance, (n,).

    Ties go to the lowest index; -1 and inf where no seed can be reached.
    """
    from medialis.surface._surface_graph_kernels import spread_from_seeds

    n = len(points)
    seed = np.where(seeds, np.arange(n), -1).astype(np.int32)
    distance = np.where(seeds, 0.0, np.inf)
    room = len(graph.indices)
    keys, names = np.empty(room), np.empty(room, np.int32)
    spread_from_seeds(points, graph.offsets, graph.indices, keys, names, distance, seed)
    return seed, distance


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
