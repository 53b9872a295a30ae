"""What stands for a shape: paths, arrays, and meshes of other libraries, by what they have."""

from types import SimpleNamespace

import numpy as np
import pytest

import medialis
from medialis.shape.reading import as_shape

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]], float)
TRIANGLES = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
"""A pyramid; its floor is two triangles, or one quad."""

QUAD_AND_SIDES = [4, 0, 3, 2, 1, 3, 0, 1, 4, 3, 1, 2, 4, 3, 2, 3, 4, 3, 3, 0, 4]
OF_THREE = np.column_stack([np.full(6, 3), TRIANGLES]).ravel()


class Rows:
    """Like the vectors of Open3D: an array only when numpy asks for one."""

    def __init__(self, values):
        self.values = np.asarray(values)

    def __array__(self, dtype=None, copy=None):
        return np.array(self.values, dtype)


def open3d_mesh():
    return SimpleNamespace(vertices=Rows(CORNERS), triangles=Rows(TRIANGLES))


LIKE = {
    "pair": (CORNERS, TRIANGLES),
    "lists": (CORNERS.tolist(), TRIANGLES.tolist()),
    "trimesh": SimpleNamespace(vertices=CORNERS, faces=TRIANGLES),
    "trimesh scene": SimpleNamespace(
        to_mesh=lambda: SimpleNamespace(vertices=CORNERS, faces=TRIANGLES)
    ),
    "open3d": open3d_mesh(),
    "open3d tensors": SimpleNamespace(to_legacy=open3d_mesh),
    "pyvista": SimpleNamespace(points=CORNERS, faces=OF_THREE, extract_surface=None),
    "pyvista polygons": SimpleNamespace(points=CORNERS, faces=np.array(QUAD_AND_SIDES)),
    "pyvista grid": SimpleNamespace(
        points=CORNERS, extract_surface=lambda: SimpleNamespace(points=CORNERS, faces=OF_THREE)
    ),
    "meshio": SimpleNamespace(
        points=CORNERS, cells_dict={"quad": [[0, 3, 2, 1]], "triangle": TRIANGLES[2:]}
    ),
    "pymeshlab": SimpleNamespace(vertex_matrix=lambda: CORNERS, face_matrix=lambda: TRIANGLES),
}


@pytest.mark.parametrize("given", LIKE.values(), ids=LIKE)
def test_meshes_of_other_libraries_are_the_same_solid(given):
    shape = as_shape(given)
    assert shape.point_count == 5 and shape.face_count == 6
    corners = shape.points[shape.faces]
    # A pyramid of base 1 and height 1, its faces turned outward: a third.
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(1 / 3, abs=1e-15)


def test_a_shape_is_taken_as_it_is():
    shape = medialis.organic_shape(56)
    assert as_shape(shape) is shape


def test_clouds_have_no_faces():
    shape = medialis.organic_shape(56)
    open3d = SimpleNamespace(points=Rows(shape.points), normals=Rows(shape.normals))
    without = SimpleNamespace(vertices=shape.points, faces=np.empty((0, 3), int))
    assert as_shape(np.array(shape.points)).faces is None
    assert as_shape(without).faces is None
    assert np.allclose(as_shape(open3d).normals, shape.normals, atol=1e-15)


def test_tables_are_clouds_by_the_names_of_their_columns():
    class Table(dict):
        columns = property(dict.keys)

    shape = medialis.organic_shape(56)
    axes = dict(zip("xyz", shape.points.T, strict=True))
    bare = as_shape(Table(axes))
    assert bare.faces is None and np.array_equal(bare.points, shape.points)
    normals = {f"normal_{axis}": row for axis, row in zip("xyz", shape.normals.T, strict=True)}
    assert np.allclose(as_shape(Table(axes | normals)).normals, shape.normals, atol=1e-15)


@pytest.mark.slow
def test_real_libraries_give_the_same_thickness():
    trimesh = pytest.importorskip("trimesh")
    shape = medialis.organic_shape(56)
    mesh = trimesh.Trimesh(shape.points, shape.faces, process=False)
    expected = medialis.thickness(shape)
    assert np.array_equal(medialis.thickness(mesh), expected)
    assert np.array_equal(medialis.thickness(trimesh.Scene(mesh)), expected)


@pytest.mark.slow
def test_every_door_takes_a_path(tmp_path):
    path = tmp_path / "organic.ply"
    medialis.write_mesh(path, medialis.organic_shape(56))
    shape = medialis.read_shape(path)
    assert medialis.noise_level(path) == medialis.noise_level(shape)
    assert medialis.refine(str(path), longest_edge=0.02).face_count > shape.face_count
    assert medialis.geodesic(path, 0, 9).length == medialis.geodesic(shape, 0, 9).length
    assert len(medialis.shrink_balls(path)) == shape.point_count
    assert medialis.run("thickness", path).shape.point_count >= shape.point_count
    assert medialis.curve_skeleton(path).component_count == 1


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (None, "got None (NoneType)"),
        (7, "got 7 (int)"),
        ({"points": CORNERS}, "got an object of dict"),
        (SimpleNamespace(columns=3), "got namespace(columns=3)"),
        ((CORNERS, TRIANGLES, CORNERS), "got a tuple of 3"),
        (CORNERS[:, :2], "got shape (5, 2)"),
        (SimpleNamespace(points=CORNERS, faces=np.array([3, 0, 1])), "ends within a polygon"),
        (SimpleNamespace(points=CORNERS, cells_dict={"tetra": [[0, 1, 2, 4]]}), "got cells tetra"),
    ],
)
def test_anything_else_is_named(given, said):
    with pytest.raises(medialis.InvalidShapeError) as caught:
        medialis.surface_skeleton(given)
    assert said in str(caught.value)


def test_a_missing_file_is_a_missing_file():
    with pytest.raises(medialis.FileError, match="nowhere"):
        medialis.thickness("nowhere.ply")
