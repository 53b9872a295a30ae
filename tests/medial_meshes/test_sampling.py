"""Samples of surfaces: how many, and of what."""

import numpy as np
import pytest

import medialis
from closed_forms import torus_mesh
from medialis.medial_meshes.sampling import (
    CANDIDATES,
    FINEST,
    PIECES,
    Solid,
    _cut,
    take_samples,
    without_holes,
)


def needle(width):
    """A closed prism of length 1 and this width, of 8 faces as long as it."""
    ring = width * np.array([[0, 0], [1, 0], [0, 1]])
    points = np.concatenate([np.column_stack([ring, np.full(3, z)]) for z in (0.0, 1.0)])
    sides = [(i, (i + 1) % 3) for i in range(3)]
    faces = [(0, 2, 1), (3, 4, 5)]
    faces += [face for a, b in sides for face in ((a, b, b + 3), (a, b + 3, a + 3))]
    return Solid(points, np.array(faces, np.int32))


@pytest.mark.parametrize("width", [0.1, 1e-3, 1e-6])
def test_needles_are_cut_into_few_pieces(width):
    """Halved across their longest sides only, needles have no more pieces than samples need."""
    solid = needle(width)
    pieces = _cut(solid, 0.1 * np.sqrt(solid.surface.area), PIECES * 1000)
    assert len(pieces.face) <= len(solid.faces) + PIECES * 1000
    assert np.allclose(np.bincount(pieces.face, pieces.areas), solid.surface.face_areas)
    corners = np.einsum("pij,pjk->pik", pieces.weights, solid.points[solid.faces[pieces.face]])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.allclose(np.linalg.norm(cross, axis=1) / 2, pieces.areas, rtol=1e-6, atol=1e-18)
    samples = take_samples(solid, 1000, 0)
    most = 1.5 * CANDIDATES * 1000 * FINEST**2  # all candidates, with the smallest spacing
    assert 300 < (samples.owner == np.arange(len(samples.owner))).sum() < most


def torus_without(vertices):
    """A torus of diagonal 1 without the faces at some vertices."""
    shape = torus_mesh()
    kept = ~np.isin(shape.faces, vertices).any(axis=1)
    return shape.points / shape.diagonal, np.ascontiguousarray(shape.faces[kept])


def volume(solid):
    """By the divergence theorem."""
    corner = solid.points[solid.faces[:, 0]]
    return np.einsum("ij,ij->", corner, solid.surface.face_vectors) / 6


def test_holes_of_missing_vertices_are_closed():
    """Five of them: the mesh is closed again, with its handle, and its volume but for a bump."""
    points, faces = torus_without([3, 400, 700, 900, 1100])
    assert not Solid(points, faces).whole
    filled, every, holes = without_holes(points, faces)
    solid, whole = Solid(filled, every), Solid(*torus_without([]))
    assert holes == 5 and solid.whole and solid.betti == (1, 1, 0)
    assert np.array_equal(filled[: len(points)], points)
    assert np.array_equal(every[: len(faces)], faces)
    assert volume(solid) == pytest.approx(volume(whole), rel=0.01)


def test_other_meshes_are_left_as_they_are():
    """Closed, cut in two, without shared vertices, and with a hole that is too large."""
    points, faces = torus_without([])
    soup = points[faces].reshape(-1, 3), np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    middles = points[faces].mean(axis=1)
    half = points, np.ascontiguousarray(faces[middles[:, 0] > 0])
    wide = points, np.ascontiguousarray(faces[np.linalg.norm(middles - points[0], axis=1) > 0.12])
    for given in ((points, faces), soup, half, wide):
        found = without_holes(*given)
        assert found[2] == 0 and found[0] is given[0] and found[1] is given[1]


def test_large_holes_are_closed_where_it_is_wanted():
    """A torus that is cut in two: half its volume, by two disks whose triangles come last."""
    points, faces = torus_without([])
    half = np.ascontiguousarray(faces[points[faces].mean(axis=1)[:, 0] > 0])
    filled, every, holes = without_holes(points, half, np.inf, 0.4)
    solid = Solid(filled, every)
    assert holes == 2 and solid.whole and np.array_equal(every[: len(half)], half)
    assert volume(solid) == pytest.approx(0.5 * volume(Solid(points, faces)), rel=0.05)


@pytest.mark.slow
def test_closed_holes_are_said_and_the_loop_is_found():
    points, faces = torus_without([3, 400, 700, 900, 1100])
    shape, progress = medialis.make_shape(points, faces), medialis.Progress()
    mesh = medialis.medial_mesh(shape, balls=16, quality="fast", progress=progress)
    assert mesh.betti == (1, 1, 0)
    assert "holes_closed" in [message.code for message in progress.messages]
