"""read_shape and make_shape: from a file or arrays to a Shape with normals."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.formats.ply_attributes import write_ply

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])


def test_a_file_keeps_its_points_and_gets_normals(tmp_path):
    write_ply(tmp_path / "cube.ply", CUBE, faces=FACES)
    shape = medialis.read_shape(tmp_path / "cube.ply")
    assert np.array_equal(shape.points, CUBE)
    # By symmetry the normal of a cube's corner is its diagonal, whatever the triangles.
    assert np.allclose(shape.normals, (CUBE - 0.5) / np.sqrt(0.75), atol=1e-15)
    assert shape.diagnosis.closed and shape.vertex_map.tolist() == list(range(8))
    assert shape.face_map.tolist() == list(range(12))


def test_stl_like_triangles_are_welded_and_mapped():
    soup, faces = CUBE[FACES].reshape(-1, 3), np.arange(36).reshape(-1, 3)
    progress = medialis.Progress()
    shape = medialis.make_shape(soup, faces, repair=True, progress=progress)
    assert shape.point_count == 8
    assert np.array_equal(shape.points[shape.vertex_map], soup)
    assert "welded" in [message.code for message in progress.messages]
    assert shape.diagnosis.duplicate_vertices == 28  # of the input, not of the result


def test_inward_mesh_is_turned_and_said():
    progress = medialis.Progress()
    shape = medialis.make_shape(CUBE, FACES[:, ::-1], repair=True, progress=progress)
    assert (np.einsum("ij,ij->i", shape.normals, CUBE - 0.5) > 0).all()
    assert "closed_turned" in [message.code for message in progress.messages]


def test_without_repair_nothing_is_touched():
    points = np.vstack([CUBE, CUBE[:1], [[9, 9, 9]]])
    shape = medialis.make_shape(points, FACES[:, ::-1])
    assert np.array_equal(shape.points, points) and np.array_equal(shape.faces, FACES[:, ::-1])
    assert shape.diagnosis is None and not shape.normals[8:].any()


def test_given_normals_are_used():
    normals = np.tile([0.0, 0.0, 2.0], (8, 1))
    assert np.array_equal(medialis.make_shape(CUBE, FACES, normals).normals, normals / 2)


def test_cloud_file_normals_are_used_and_missing_ones_estimated(tmp_path):
    sphere = np.random.default_rng(0).normal(size=(400, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    np.savetxt(tmp_path / "with.xyz", np.hstack([sphere, -sphere]))
    np.savetxt(tmp_path / "without.xyz", sphere)
    assert np.allclose(medialis.read_shape(tmp_path / "with.xyz").normals, -sphere, atol=1e-12)
    progress = medialis.Progress()
    estimated = medialis.read_shape(tmp_path / "without.xyz", progress=progress)
    assert (np.einsum("ij,ij->i", estimated.normals, sphere) > 0.9).all()
    assert "normals_missing" in [message.code for message in progress.messages]


def test_mesh_of_zero_area_is_refused():
    with pytest.raises(medialis.InvalidShapeError, match="area"):
        medialis.make_shape([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]], repair=True)


def test_refinement_keeps_the_map_to_the_input():
    shape = medialis.make_shape(np.vstack([CUBE[:1], CUBE]), FACES + 1, repair=True)
    fine = forms.refined(shape, 0.3)
    assert np.array_equal(fine.points[fine.vertex_map], np.vstack([CUBE[:1], CUBE]))
    assert fine.face_map.max() == 11 and len(fine.face_map) == fine.face_count


def test_cancelling_a_read(tmp_path):
    write_ply(tmp_path / "cube.ply", CUBE, faces=FACES)
    with pytest.raises(medialis.Cancelled):
        medialis.read_shape(tmp_path / "cube.ply", progress=lambda fraction, text: False)


def test_zero_normals_of_a_cloud_count_as_missing():
    """Arrays of zeros from programs that keep room for normals left a cloud without any: skeletons
    were refused with the advice to use the function that had just made the shape."""
    sphere = np.random.default_rng(0).normal(size=(400, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    progress = medialis.Progress()
    shape = medialis.make_shape(sphere, None, 0 * sphere, progress=progress)
    assert (np.einsum("ij,ij->i", shape.normals, sphere) > 0.9).all()
    assert "normals_zero" in [message.code for message in progress.messages]
    mesh = medialis.make_shape(CUBE, FACES, np.zeros((8, 3)))
    assert not mesh.normals.any()  # given with a mesh they are used as they are
