"""Triangles through manifolds: areas, borders, holes, crossings, and scipy's Delaunay."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

import clouds
import medialis


def area(points, faces):
    return medialis.Surface(points, faces).area


def edge_counts(faces):
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def one_manifold(points):
    rows = medialis.Ragged(np.arange(len(points) + 1), np.zeros(len(points), np.int32))
    return medialis.ManifoldSet(rows, 1, np.ones(len(points)), points=points)


@pytest.mark.slow
def test_a_plane_is_its_delaunay_triangulation():
    """Every triangle is one of scipy's, and inside almost all are there (1 circle in 10^4)."""
    points = clouds.plane(1500, np.random.default_rng(0))
    faces, owner = medialis.manifold_surfaces(one_manifold(points))
    ours = {tuple(sorted(f)) for f in faces.tolist()}
    whole = Delaunay(points[:, :2]).simplices
    inner = whole[(np.abs(points[whole]) < 0.85).all(axis=(1, 2))]
    inside = {tuple(sorted(f)) for f in inner.tolist()}
    # Weights of 1e-3 squared spacings turn the diagonals of about as many nearly round quads.
    assert len(ours - {tuple(sorted(f)) for f in whole.tolist()}) < 0.005 * len(ours)
    assert len(inside & ours) > 0.995 * len(inside)
    assert (owner == 0).all()


@pytest.mark.slow
def test_a_sphere_is_closed_and_a_hole_stays_open():
    """A sphere of 4 pi; the sagitta between samples takes h^2 / (4 R^2) = 0.1 % off."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces, _ = medialis.manifold_surfaces(one_manifold(points))
    assert area(points, faces) == pytest.approx(4 * np.pi, rel=0.02)
    assert edge_counts(faces).max() == 2 and (edge_counts(faces) == 2).mean() > 0.99
    cut = points[points[:, 2] < 0.8]  # a cap of 2 pi (1 - 0.8), ten spacings wide
    faces, _ = medialis.manifold_surfaces(one_manifold(cut))
    assert area(cut, faces) == pytest.approx(2 * np.pi * 1.8, rel=0.02)


@pytest.mark.slow
def test_crossing_planes_are_not_stitched():
    points, _ = clouds.crossing_planes(90, n=2000)
    found = medialis.manifolds(points)
    faces, owner = medialis.manifold_surfaces(found)
    for manifold in (0, 1):
        mesh = faces[owner == manifold]
        assert edge_counts(mesh).max() <= 2
        assert area(points, mesh) == pytest.approx(4.0, rel=0.05)
        assert found.membership.toarray()[mesh, manifold].all()


def test_a_grid_has_no_holes():
    """Four points of a square lie on a circle: all must agree on its diagonal."""
    u, v = np.meshgrid(np.arange(20.0), np.arange(20.0))
    points = np.stack([u.ravel(), v.ravel(), 0 * u.ravel()], axis=1)
    faces, _ = medialis.manifold_surfaces(one_manifold(points))
    assert area(points, faces) == pytest.approx(19 * 19)
    assert len(faces) == 2 * 19 * 19


def test_scale_and_duplicates():
    points = clouds.plane(300, np.random.default_rng(0))
    faces, _ = medialis.manifold_surfaces(one_manifold(points))
    twice = np.concatenate([points, points]) * 2.0**60
    again, _ = medialis.manifold_surfaces(one_manifold(twice))
    assert (again == faces).all()


def test_few_points_have_no_triangles():
    points = np.eye(3)
    assert len(medialis.manifold_surfaces(one_manifold(points))[0]) == 0
    assert len(medialis.manifold_surfaces(medialis.manifolds(points))[0]) == 0
