"""Geodesic polylines: closed forms, exact upper bounds, invariants, borders."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import closed_forms as forms
import medialis
from medialis.skeleton.importance.geodesics import PathStatus


def grid(n):
    """Flat square of n x n vertices."""
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + n, i + n + 1], 1), np.stack([i, i + n + 1, i + 1], 1)])
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), faces


def bumpy_torus():
    """Torus without any symmetry: no path is as short as another by construction."""
    regular = forms.torus_mesh()
    jitter = np.random.default_rng(8).normal(size=regular.points.shape) * 0.01
    return medialis.make_shape(regular.points + jitter, regular.faces)


def pairs_of(n, count, seed=0):
    return np.random.default_rng(seed).integers(0, n, (count, 2))


def nearest(shape, place):
    return int(np.argmin(np.linalg.norm(shape.points - place, axis=1)))


def lengths_of(paths):
    return np.array([path.length for path in paths])


def over_edges(shape, pairs, inner=0):
    """Oracle: shortest paths over the faces through `inner` evenly spaced points of every edge.

    Each one is a real path, so no exact geodesic is longer.
    """
    n, faces = shape.point_count, shape.faces
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, of_side = np.unique(sides, axis=0, return_inverse=True)
    share = np.arange(1, inner + 1) / (inner + 1)
    a, b = shape.points[edges].transpose(1, 0, 2)
    between = a[:, None] + share[:, None] * (b - a)[:, None]
    points = np.vstack([shape.points, between.reshape(-1, 3)])
    on_sides = n + of_side.reshape(-1, 3, 1) * inner + np.arange(inner)
    nodes = np.hstack([faces, on_sides.reshape(len(faces), -1)])
    i, j = np.triu_indices(nodes.shape[1], 1)
    links = np.unique(np.sort(np.stack([nodes[:, i].ravel(), nodes[:, j].ravel()], 1), 1), axis=0)
    weight = np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    graph = coo_array((weight, tuple(links.T.astype(np.int32))), shape=(len(points),) * 2).tocsr()
    starts, row = np.unique(pairs[:, 0], return_inverse=True)
    return dijkstra(graph, directed=False, indices=starts)[row, pairs[:, 1]]


def assert_on_surface(shape, path):
    """Both ends of every step lie in the plane and between the corners of one face."""
    corners = shape.points[shape.faces]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    inverse = np.linalg.pinv(np.stack([e1, e2], axis=2))
    inside = []
    for point in path.points:
        away = point - corners[:, 0]
        u = np.einsum("fij,fj->fi", inverse, away)
        off = away - u[:, :1] * e1 - u[:, 1:] * e2
        low = np.minimum(u.min(axis=1), 1 - u.sum(axis=1))
        inside.append((np.linalg.norm(off, axis=1) < 1e-9 * shape.diagonal) & (low > -1e-9))
    assert all((a & b).any() for a, b in itertools.pairwise(inside))


@pytest.mark.parametrize("turned", [False, True])
def test_corner_to_corner_of_a_box(turned):
    """Unfolded over an edge: the square root of a^2 + (b + c)^2, a the longest side."""
    shape = forms.box_mesh((1.0, 0.8, 0.6))
    ends = [nearest(shape, shape.bounds[0]), nearest(shape, shape.bounds[1])]
    if turned:
        q = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
        shape = medialis.Shape(shape.points @ q.T, shape.normals @ q.T, shape.faces)
    path = medialis.geodesic(shape, *ends)
    assert path.length == pytest.approx(math.hypot(1.0, 0.8 + 0.6), rel=1e-12)
    assert_on_surface(shape, path)


def test_helices_of_a_prism():
    """Unrolled, a prism is a rectangle: every geodesic is a line there."""
    sides, rows, height = 24, 7, 2.0
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    z = np.repeat(np.linspace(0, height, rows), sides)
    faces = []
    for r in range(rows - 1):
        for i in range(sides):
            a, b = r * sides + i, r * sides + (i + 1) % sides
            faces += [(a, b, b + sides), (a, b + sides, a + sides)]
    shape = medialis.make_shape(np.column_stack([np.tile(ring, (rows, 1)), z]), faces)
    pairs = pairs_of(sides * rows, 100)
    apart = np.abs(pairs[:, 0] - pairs[:, 1]) % sides
    along = 2 * math.sin(math.pi / sides) * np.minimum(apart, sides - apart)
    expected = np.hypot(along, z[pairs[:, 0]] - z[pairs[:, 1]])
    found = lengths_of(medialis.geodesics(shape, pairs))
    assert np.allclose(found, expected, rtol=1e-12, atol=1e-15)


def test_great_circles_of_a_sphere():
    """Faces lie at most the sagitta of the largest one below the sphere; chords are below arcs."""
    shape = forms.icosphere(3)
    ends = shape.points[shape.edges]
    h = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max()
    pairs = pairs_of(shape.point_count, 100)
    a, b = shape.points[pairs].transpose(1, 0, 2)
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
    found = lengths_of(medialis.geodesics(shape, pairs))
    assert (found >= math.sqrt(1 - h**2 / 3) * angle - 1e-12).all()
    assert (found <= angle + 1e-12).all()


def test_flat_paths_are_straight_lines():
    points, faces = grid(9)
    pairs = pairs_of(81, 100)
    found = lengths_of(medialis.geodesics(medialis.make_shape(points, faces), pairs))
    straight = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    assert np.allclose(found, straight, rtol=1e-12, atol=1e-15)


def test_a_path_goes_round_a_hole():
    """A taut string round a square hole bends at two of its corners only."""
    points, faces = grid(13)
    hole = (np.abs(points[faces].mean(axis=1)[:, :2] - 0.5) < 0.25).all(axis=1)
    shape = medialis.make_shape(points, faces[~hole], repair=True)
    path = medialis.geodesic(shape, nearest(shape, [0, 0.5, 0]), nearest(shape, [1, 0.5, 0]))
    assert path.length == pytest.approx(2 * math.hypot(0.25, 0.25) + 0.5, rel=1e-12)
    assert path.status == PathStatus.EDGES
    assert_on_surface(shape, path)


def test_a_path_meets_a_non_manifold_edge_at_its_vertices():
    """Three half planes on the line x = 0.5: no strip crosses it, a vertex of it is passed."""
    points, faces = grid(5)
    wing = points * [0.5, 1, 0] + [0.5, 0, 0]
    wing[:, 2], wing[:, 0] = wing[:, 0] - 0.5, 0.5
    shape = medialis.make_shape(
        np.vstack([points, wing]), np.vstack([faces, faces + 25]), repair=True
    )
    start = nearest(shape, [0, 0.25, 0])
    for goal, expected in (
        ([1, 0.75, 0], math.hypot(1, 0.5)),
        ([1, 0.5, 0], 0.5 + math.hypot(0.5, 0.25)),
        ([0.5, 0.75, 0.5], math.hypot(1, 0.5)),
    ):
        path = medialis.geodesic(shape, start, nearest(shape, goal))
        assert path.length == pytest.approx(expected, rel=1e-12)
        assert_on_surface(shape, path)


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: medialis.organic_shape(56), bumpy_torus, forms.box_mesh])
def test_against_points_on_all_edges(make):
    """Nine in ten paths are no longer than the best through four points of every edge.

    Those are real paths, so an exact geodesic is no longer. The others run another way round, where
    they are shortest in their neighbourhood.
    """
    shape = make()
    pairs = pairs_of(shape.point_count, 20, seed=1)
    bound = over_edges(shape, pairs, 4)
    found = lengths_of(medialis.geodesics(shape, pairs))
    assert (found <= bound * (1 + 1e-12)).mean() >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: medialis.organic_shape(56), bumpy_torus])
def test_never_longer_than_a_plane_cut_or_the_edges(make):
    shape = make()
    pairs = pairs_of(shape.point_count, 100, seed=2)
    paths = medialis.geodesics(shape, pairs)
    found = lengths_of(paths)
    assert (found <= medialis.geodesic_lengths(shape, pairs).length * (1 + 1e-12)).all()
    assert (found <= over_edges(shape, pairs) * (1 + 1e-12)).all()
    for path, ends in zip(paths[:10], pairs, strict=False):
        assert (path.points[[0, -1]] == shape.points[ends]).all()
        assert_on_surface(shape, path)


@pytest.mark.slow
def test_paths_on_a_folded_shape_are_shorter_than_the_edges():
    """From the nose to a hind foot plane cuts are a detour, to the tail none arrives."""
    shape = medialis.organic_shape(100)
    foremost, lowest, last = (
        int(np.argmax(shape.points @ d)) for d in ((1, 0.1, -0.2), (-0.4, 0.5, -1), (-1, 0, 0.2))
    )
    pairs = np.array([[foremost, lowest], [foremost, last]])
    cut = medialis.geodesic_lengths(shape, pairs[:1]).length
    edges = over_edges(shape, pairs)
    assert cut[0] > edges[0]
    assert (lengths_of(medialis.geodesics(shape, pairs)) < edges).all()


def test_back_is_the_same_path():
    shape = bumpy_torus()
    pairs = pairs_of(shape.point_count, 50, seed=3)
    there, back = medialis.geodesics(shape, pairs), medialis.geodesics(shape, pairs[:, ::-1])
    for a, b in zip(there, back, strict=True):
        assert a.length == b.length and (a.points == b.points[::-1]).all()


def test_turned_and_scaled_paths_have_turned_and_scaled_lengths():
    shape = bumpy_torus()
    pairs = pairs_of(shape.point_count, 50, seed=4)
    found = lengths_of(medialis.geodesics(shape, pairs))
    q = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    q *= np.sign(np.linalg.det(q))
    for scale in (1e-25, 1e3, 1e25):
        turned = medialis.make_shape(scale * shape.points @ q.T, shape.faces)
        moved = lengths_of(medialis.geodesics(turned, pairs)) / scale
        assert np.allclose(moved, found, rtol=1e-8, atol=1e-12)


def test_threads_and_orientation_change_nothing():
    shape = bumpy_torus()
    faces = np.array(shape.faces)
    faces[::3] = faces[::3, ::-1]
    mixed = medialis.Shape(shape.points, shape.normals, faces)
    pairs = pairs_of(shape.point_count, 30, seed=6)
    found = []
    for threads, given in ((1, shape), (2, shape), (2, mixed)):
        with medialis.thread_limit(threads):
            found.append(lengths_of(medialis.geodesics(given, pairs)))
    assert (found[0] == found[1]).all()
    assert np.allclose(found[0], found[2], rtol=1e-12)


def test_masked_pairs_and_other_components_have_no_path():
    cube = forms.cube()
    shape = medialis.make_shape(
        np.vstack([cube.points, cube.points + 10]), np.vstack([cube.faces, cube.faces + 8])
    )
    assert medialis.geodesics(shape, [[0, 8], [0, -1], [-1, -1]]) == [None, None, None]
    same = medialis.geodesic(shape, 3, 3)
    assert same.length == 0 and (same.points == shape.points[[3, 3]]).all()


def test_cancelling():
    shape = forms.icosphere(3)
    pairs = pairs_of(shape.point_count, 100)
    with pytest.raises(medialis.Cancelled):
        medialis.geodesics(shape, pairs, progress=lambda f, t: f < 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["horse", "spider", "bunny"])
def test_real_shapes(name, real_shapes):
    """Closed, non-manifold and of many parts, with holes: end to end along the axes."""
    shape = medialis.read_shape(real_shapes / f"{name}.ply")
    pairs = np.stack([shape.points.argmin(axis=0), shape.points.argmax(axis=0)], axis=1)
    pairs = pairs[shape.components[pairs[:, 0]] == shape.components[pairs[:, 1]]]
    found = lengths_of(medialis.geodesics(shape, pairs))
    assert (found <= medialis.geodesic_lengths(shape, pairs).length * (1 + 1e-12)).all()
    assert (found <= over_edges(shape, pairs) * (1 + 1e-12)).all()
    straight = np.linalg.norm(shape.points[pairs[:, 0]] - shape.points[pairs[:, 1]], axis=1)
    assert (found >= straight * (1 - 1e-12)).all()
