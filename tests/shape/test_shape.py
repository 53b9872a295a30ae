"""Shape: checked arrays, measures and connectivity."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import closed_forms as forms
import medialis
from medialis.base.errors import InvalidShapeError
from medialis.shape.shape import Shape
from oracles import component_labels, edge_uses, face_neighbours

SOME = np.random.default_rng(0).normal(size=(6, 3))


@pytest.mark.slow
@settings(max_examples=100, deadline=None, derandomize=True)
@given(faces=st.lists(st.lists(st.integers(0, 7), min_size=3, max_size=3), max_size=14))
def test_connectivity_of_any_faces(faces):
    """Faces that name a vertex twice were their own neighbours, at an edge of no length (fixed)."""
    points = np.random.default_rng(1).normal(size=(8, 3))
    shape = Shape(points, points, np.array(faces).reshape(-1, 3))
    pairs = sorted(pair for pair in edge_uses(faces) if pair[0] != pair[1])
    assert shape.edges.tolist() == [list(pair) for pair in pairs]
    assert shape.face_count == len(faces)
    if not faces:
        assert shape.faces is None and (shape.components == 0).all()
        return
    assert shape.face_adjacency.tolist() == face_neighbours(faces).tolist()
    assert shape.components.tolist() == component_labels(8, faces).tolist()
    if pairs:
        lengths = [math.dist(points[a], points[b]) for a, b in pairs]
        assert shape.spacing == pytest.approx(np.mean(lengths), rel=1e-14)


def test_known_connectivity():
    for shape, euler in ((forms.cube(), 2), (forms.icosphere(1), 2), (forms.torus_mesh(6, 5), 0)):
        n, m, e = shape.point_count, shape.face_count, len(shape.edges)
        assert n - e + m == euler and 2 * e == 3 * m
        across = shape.face_adjacency
        assert (across >= 0).all()
        for f in range(m):
            assert all(f in across[g] for g in across[f])
        assert (shape.components == 0).all()


def test_measures_of_the_cube():
    cube = forms.cube()
    assert cube.diagonal == pytest.approx(math.sqrt(12), rel=1e-15)
    assert [c.tolist() for c in cube.bounds] == [[-1, -1, -1], [1, 1, 1]]
    assert cube.spacing == pytest.approx((12 * 2 + 6 * math.sqrt(8)) / 18, rel=1e-15)


@pytest.mark.parametrize("scale", [1e-300, 1e-200, 1e-6, 1e6, 1e150])
def test_diagonal_of_tiny_and_huge_shapes(scale):
    """Squares left the range: 0 at 1e-200, infinity at 1e200 (fixed; 1e200 is refused now)."""
    assert Shape(SOME * scale, SOME).diagonal == pytest.approx(Shape(SOME, SOME).diagonal * scale)


def test_spacing_of_clouds():
    line = np.outer([0, 1, 3, 7.0], [0, 0, 1])
    assert Shape(line, line).spacing == (1 + 1 + 2 + 4) / 4
    assert Shape(np.ones((3, 3)), np.ones((3, 3))).spacing == 0
    assert Shape([[1, 2, 3]], [[0, 0, 1]]).spacing == 0
    assert Shape([[1, 2, 3]], [[0, 0, 1]]).diagonal == 0


def test_cloud_has_no_edges_and_one_part():
    cloud = Shape(SOME, SOME)
    assert cloud.edges.shape == (0, 2) and cloud.face_adjacency.shape == (0, 3)
    assert cloud.components.tolist() == [0] * 6 and cloud.face_count == 0


def test_arrays_are_read_only_and_the_given_ones_are_left_alone():
    """The cached bounds could be changed by whoever asked for them (fixed)."""
    points, normals, faces = SOME.copy(), 3 * SOME, np.array([[0, 1, 2], [2, 1, 5]])
    before = points.copy(), normals.copy(), faces.copy()
    shape = Shape(points, normals, faces)
    arrays = [shape.points, shape.normals, shape.faces, shape.edges, shape.face_adjacency]
    for array in [*arrays, shape.components, *shape.bounds]:
        assert not array.flags.writeable and array.flags.c_contiguous
    for given_array, copy in zip((points, normals, faces), before, strict=True):
        assert given_array.flags.writeable and (given_array == copy).all()
    with pytest.raises(dataclasses.FrozenInstanceError):
        shape.points = SOME


def test_normals_become_unit_or_zero():
    normals = [[0, 0, 9], [1e-300, 0, 0], [0, 1e300, 1e300], [0, 0, 0], [math.nan, 0, 1], [3, 4, 0]]
    half = math.sqrt(0.5)
    expected = [[0, 0, 1], [1, 0, 0], [0, half, half], [0, 0, 0], [0, 0, 0], [0.6, 0.8, 0]]
    assert Shape(SOME, normals).normals == pytest.approx(np.array(expected), abs=1e-15)


def test_lists_and_other_number_types_are_taken():
    shape = Shape([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.ones((3, 3), np.float32), [[0.0, 1.0, 2.0]])
    assert shape.points.dtype == shape.normals.dtype == np.float64
    assert shape.faces.dtype == np.int32 and shape.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    "arrays",
    [
        {"points": np.zeros((0, 3))},
        {"points": np.zeros((4, 2))},
        {"points": np.full((6, 3), np.nan)},
        {"points": [["a", "b", "c"]] * 6},
        {"points": [[0, 0], [1, 2, 3]]},
        {"normals": SOME[:5]},
        {"normals": SOME.astype(complex)},
        {"faces": [[0, 1, 6]]},
        {"faces": [[0, 1, -1]]},
        {"faces": [[0, 1, 2, 3]]},
        {"faces": [[0, 1, 1.5]]},
        {"faces": [[0, 1, math.nan]]},
        {"origin": np.arange(5)},
        {"face_origin": [0]},
        {"face_map": [0, 1], "faces": [[0, 1, 2]]},
        {"vertex_map": np.zeros((2, 2))},
    ],
)
def test_bad_arrays(arrays):
    with pytest.raises(InvalidShapeError):
        Shape(**{"points": SOME, "normals": SOME, **arrays})


def test_values_go_back_to_the_input_before_repair():
    """Merged vertices share a value, dropped ones and dropped faces get the missing one."""
    points = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0.0]]
    faces = [[1, 3, 2], [1, 2, 4], [2, 2, 3], [2, 3, 4], [5, 4, 3]]
    shape = medialis.make_shape(points, faces, repair=True)
    assert shape.point_count == 4 and shape.face_count == 4
    back = shape.on_input_points(shape.points, np.nan)
    assert np.isnan(back[0]).all() and (back[1:] == np.array(points)[1:]).all()
    corners = np.sort(shape.points[shape.faces].reshape(4, 9), axis=1)
    known = shape.on_input_faces(corners, 5, -1.0)
    assert (known[2] == -1).all()
    given = np.sort(np.array(points)[np.array(faces)].reshape(5, 9), axis=1)
    assert (known[[0, 1, 3, 4]] == given[[0, 1, 3, 4]]).all()


def test_values_of_an_unrepaired_shape_are_the_input_s_own():
    shape = medialis.organic_shape(56)
    values = np.arange(shape.point_count)
    assert (shape.on_input_points(values, -1) == values).all()
    assert (shape.on_input_faces(shape.faces, shape.face_count, -1) == shape.faces).all()
