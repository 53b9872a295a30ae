"""The nearest triangle of a point, by a box tree."""

import time

import numpy as np

from fuzz.nasty_shapes import grid
from medialis.base.box_tree import NearestTree, nearest_on_triangles


def test_nearest_triangles_are_those_of_a_search_of_all():
    rng = np.random.default_rng(5)
    points, faces = rng.normal(size=(120, 3)), rng.integers(0, 120, size=(200, 3)).astype(np.int32)
    queries = rng.normal(size=(40, 3)) * 10.0 ** rng.integers(-1, 3, size=(40, 1))
    corners = points[np.tile(faces, (40, 1))]
    weights = nearest_on_triangles(np.repeat(queries, 200, axis=0), corners)
    places = np.einsum("ij,ijk->ik", weights, corners)
    apart = np.linalg.norm(np.repeat(queries, 200, axis=0) - places, axis=1).reshape(40, 200)
    distance, row = NearestTree.of_triangles(points, faces).distances(queries)
    np.testing.assert_allclose(distance, apart.min(axis=1), rtol=1e-9)
    np.testing.assert_allclose(apart[np.arange(40), row], apart.min(axis=1), rtol=1e-9)


def test_far_from_a_plate_few_triangles_are_looked_at():
    """Far balls over a plate of 60,000 triangles looked at a tenth of them each: two minutes."""
    points, faces = grid(170, 170)
    rng = np.random.default_rng(7)
    queries = np.column_stack([rng.random((4000, 2)), np.full(4000, 1.4)])
    tree = NearestTree.of_triangles(points, faces)
    tree.distances(queries[:10])  # compiled
    begin = time.process_time()
    distance, _ = tree.distances(queries)
    assert time.process_time() - begin < 1.5
    np.testing.assert_allclose(distance, 1.4, rtol=1e-12)
