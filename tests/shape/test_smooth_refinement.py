"""Refined samples on the smooth surface that a mesh stands for."""

from dataclasses import replace

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.shape.creases import find_creases
from medialis.shape.refinement import on_smooth_surface, refine


def refined(shape, longest=0.02, angle=30.0):
    shape = medialis.make_shape(shape.points, shape.faces)  # not a refined one itself
    fine = refine(shape, longest_edge=longest)
    return fine, on_smooth_surface(shape, fine, find_creases(shape, angle))


def test_samples_of_a_sphere_lie_on_it():
    """A quadratic bulge over a chord of angle a misses a circle by some a^4 / 128 of the radius."""
    ball = forms.icosphere(2)
    shape = medialis.make_shape(ball.points, ball.faces)
    fine, smooth = refined(shape)
    n, angle = shape.point_count, shape.edge_lengths.max()
    facets = 1 - np.linalg.norm(fine.points, axis=1)
    off = np.abs(1 - np.linalg.norm(smooth.points, axis=1))
    assert np.array_equal(smooth.points[:n], shape.points)
    assert facets.max() > 0.01 and off.max() < angle**4 / 32 < 0.1 * facets.max()
    away = np.linalg.norm(smooth.normals - smooth.points, axis=1)
    assert away.max() < angle**2 / 8


def test_flat_faces_and_straight_creases_stay_as_they_are():
    for shape in (forms.cube(), forms.prism(forms.disc_outline(corners=6), longest_edge=1.0)):
        fine, smooth = refined(shape, 0.05)
        assert np.abs(smooth.points - fine.points).max() < 1e-14
        assert np.abs(smooth.normals - fine.normals).max() < 1e-12


def test_exact_polyhedra_stay_as_they_are():
    ball = forms.icosphere(2)
    fine, smooth = refined(medialis.make_shape(ball.points, ball.faces), angle=0.0)
    assert np.abs(smooth.points - fine.points).max() < 1e-14


def test_the_rim_of_a_cylinder_is_round_and_its_ends_are_flat():
    """The crease moves along the end: where the surfaces of both sides meet."""
    shape = forms.prism(forms.disc_outline(corners=32), height=1.0, longest_edge=0.3)
    fine, smooth = refined(shape, 0.03)
    top = np.abs(np.abs(fine.points[:, 2]) - 0.5) < 1e-12
    assert np.abs(smooth.points[top, 2]) == pytest.approx(0.5, abs=1e-12)
    rim = np.intersect1d(np.flatnonzero(top), fine.faces[np.abs(fine.face_normals[:, 2]) < 0.5])
    before = 1 - np.linalg.norm(fine.points[rim, :2], axis=1).min()
    after = np.abs(1 - np.linalg.norm(smooth.points[rim, :2], axis=1)).max()
    assert before > 0.004 and after < 0.1 * before


def test_thin_rings_do_not_fold():
    """Bulges as large as the ring is thick turned faces over: there samples stay on the facets."""
    ring = forms.torus_mesh(around=24, across=6, major=1.0, minor=0.012)
    fine, smooth = refined(ring)
    turned = np.einsum("ij,ij->i", fine.face_normals, smooth.face_normals)
    assert turned[fine.face_areas > 0].min() > np.cos(np.radians(30)) - 1e-12


def test_default_balls_of_a_coarse_torus_are_on_its_axis():
    """Samples on facets made the balls those of a polyhedron: 3 % of the radius off in the mean."""
    shape = forms.torus_mesh(around=64, across=24, major=1.0, minor=0.3)
    cloud = medialis.surface_skeleton(medialis.make_shape(shape.points, shape.faces))
    assert cloud.surface.point_count > shape.point_count
    radial = np.linalg.norm(cloud.centers[:, :2], axis=1)
    off = np.hypot(radial - 1, cloud.centers[:, 2]) / 0.3
    assert off.mean() < 0.01 and np.quantile(off, 0.99) < 0.05


def test_inputs_stay_and_turning_turns():
    shape = forms.torus_mesh(around=24, across=12, major=1.0, minor=0.3)
    q = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    q *= np.sign(np.linalg.det(q))
    shape = medialis.make_shape(shape.points, shape.faces)
    before = shape.points.copy()
    fine, one = refined(shape, 0.05)
    turned = medialis.make_shape(shape.points @ q.T, shape.faces)
    fine = replace(fine, points=fine.points @ q.T, normals=fine.normals @ q.T)
    other = on_smooth_surface(turned, fine, find_creases(turned, 30.0))
    assert np.array_equal(shape.points, before)
    assert other.points == pytest.approx(one.points @ q.T, abs=1e-9)
