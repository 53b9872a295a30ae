"""Angle-weighted vertex normals."""

import math

import numpy as np
import pytest

import closed_forms as forms
from medialis.errors import InvalidShapeError
from medialis.surface.normals import vertex_normals

EPS = np.finfo(float).eps


def test_cube_corners_look_along_the_diagonals():
    """Each face has a right angle at the corner, in one or in two triangles: all weigh the same."""
    cube = forms.cube()
    expected = cube.points / math.sqrt(3)
    assert vertex_normals(cube.points, cube.faces) == pytest.approx(expected, abs=8 * EPS)


def test_splitting_faces_does_not_change_normals():
    """The angles of the pieces add up; each is rounded by a few eps, at up to 12 faces a vertex."""
    for shape in (forms.cube(), forms.torus_mesh(9, 7)):
        before = vertex_normals(shape.points, shape.faces)
        fine = forms.refined(shape, 0.2)
        after = vertex_normals(fine.points, fine.faces)[: shape.point_count]
        assert after == pytest.approx(before, abs=200 * EPS)


def test_sphere_normals_tend_to_the_radius():
    """Chords of length h tilt a face by at most h/2, with vertices of an icosphere at their middle.

    The first order cancels around a vertex up to the asymmetry of its ring, so half the face tilt
    is a safe bound of the mean.
    """
    for levels in (2, 3, 4):
        shape = forms.icosphere(levels)
        cosine = np.einsum("ij,ij->i", vertex_normals(shape.points, shape.faces), shape.points)
        longest = np.linalg.norm(np.diff(shape.points[shape.edges], axis=1), axis=2).max()
        assert cosine.min() >= math.cos(longest / 4)


@pytest.mark.parametrize("scale", [1e-200, 1e-6, 1e6, 1e150])
def test_scale_and_place_do_not_matter(scale):
    shape = forms.torus_mesh(12, 8)
    expected = vertex_normals(shape.points, shape.faces)
    assert vertex_normals(shape.points * scale, shape.faces) == pytest.approx(
        expected, abs=64 * EPS
    )
    # Coordinates at 1e3 are rounded by 1e3 eps, against edges of at least 0.1.
    moved = vertex_normals(shape.points + np.array([1e3, -1e3, 500]), shape.faces)
    assert moved == pytest.approx(expected, abs=8 * 1e3 * EPS / 0.1)


def test_rotation_turns_the_normals():
    shape = forms.torus_mesh(12, 8)
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    turned = vertex_normals(shape.points @ q.T, shape.faces)
    assert turned == pytest.approx(vertex_normals(shape.points, shape.faces) @ q.T, abs=128 * EPS)


def test_vertices_without_an_area_have_no_normal():
    points = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [5, 5, 5]]
    normals = vertex_normals(points, [[0, 1, 2], [0, 1, 3], [2, 2, 3]])
    assert normals.tolist() == [[0, 0, 1], [0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 0, 0]]
    assert not vertex_normals(points, np.empty((0, 3))).any()


def test_fold_has_no_normal():
    """A face and its reverse cancel out; a face folded back by 170 degrees looks away."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert not vertex_normals(points, [[0, 1, 2], [0, 2, 1]]).any()


def test_inputs_stay_unchanged_and_the_result_is_read_only():
    cube = forms.cube()
    points, faces = cube.points.copy(), cube.faces.copy()
    normals = vertex_normals(points, faces)
    assert (points == cube.points).all() and (faces == cube.faces).all()
    assert not normals.flags.writeable


@pytest.mark.parametrize(
    ("points", "faces"),
    [
        ([[0, 0]], [[0, 0, 0]]),
        ([[0, 0, math.nan]], [[0, 0, 0]]),
        ([[0, 0, 0]], [[0, 0, 1]]),
        ([[0, 0, 0]], [[0, 0, -1]]),
        ([[0, 0, 0]], [[0, 0]]),
        ([[0, 0, 0]], [[0, 0, 0.5]]),
    ],
)
def test_bad_input(points, faces):
    with pytest.raises(InvalidShapeError):
        vertex_normals(points, faces)
