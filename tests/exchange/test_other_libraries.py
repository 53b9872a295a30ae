"""Results as objects of other libraries, and meshes as files."""

import dataclasses
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import medialis
from medialis.shape.reading import as_shape


@pytest.fixture(scope="module")
def result(default_run):
    return default_run("thickness")


@pytest.fixture(scope="module")
def curve():
    """A ring of four nodes with a tail of two."""
    nodes = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [3, 0, 0]]
    edges = [[0, 1], [1, 2], [2, 3], [3, 0], [1, 4], [4, 5]]
    return medialis.CurveSkeleton.of(nodes, edges, np.linspace(1, 2, 6))


def test_networkx_has_the_same_graph(curve):
    networkx = pytest.importorskip("networkx")
    graph = medialis.to_networkx(curve)
    assert networkx.number_connected_components(graph) == curve.component_count
    assert graph.number_of_edges() - graph.number_of_nodes() + 1 == curve.loops == 1
    assert networkx.shortest_path_length(graph, 0, 5, weight="length") == pytest.approx(3)
    assert graph.nodes[5] == {"position": (3.0, 0.0, 0.0), "radius": 2.0, **importance(curve, 5)}
    assert {data["branch"] for _, _, data in graph.edges(data=True)} == {0, 1}


def importance(curve, node):
    return {"importance": pytest.approx(curve.importance[node], nan_ok=True)}


@pytest.mark.slow
def test_networkx_wants_a_graph(result):
    with pytest.raises(medialis.InvalidShapeError, match="got Result"):
        medialis.to_networkx(result)


def test_trimesh_has_the_same_mesh_and_values(result):
    pytest.importorskip("trimesh")
    mesh, layer = medialis.to_trimesh(result), result.layers[0]
    assert np.array_equal(mesh.vertices, layer.points) and np.array_equal(mesh.faces, layer.faces)
    assert np.array_equal(mesh.vertex_attributes["thickness"], layer.attributes["thickness"])
    mesh.vertices[0] += 1.0  # a copy: what is kept stays as it is
    assert not np.array_equal(mesh.vertices, layer.points)


def test_balls_become_a_cloud():
    pytest.importorskip("trimesh")
    cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    points = medialis.to_trimesh(cloud)
    assert np.array_equal(points.vertices, cloud.centers[cloud.valid])
    assert np.array_equal(points.metadata["radius"], cloud.radii[cloud.valid])


class PolyData(SimpleNamespace):
    """What is used of PyVista's class."""

    def __init__(self, points, **cells):
        super().__init__(points=points, point_data={}, cell_data={}, **cells)


def test_pyvista_gets_counts_before_corners(result, curve, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", SimpleNamespace(PolyData=PolyData))
    mesh = medialis.to_pyvista(result)
    rows = mesh.faces.reshape(-1, 4)
    assert (rows[:, 0] == 3).all() and np.array_equal(rows[:, 1:], result.layers[0].faces)
    assert "thickness" in mesh.point_data
    lines = medialis.to_pyvista(curve).lines.reshape(-1, 3)
    assert (lines[:, 0] == 2).all() and np.array_equal(lines[:, 1:], curve.edges)


def test_real_pyvista(result):
    pytest.importorskip("pyvista", reason="PyVista is not installed")
    mesh = medialis.to_pyvista(result)
    again = medialis.run("thickness", mesh)
    assert again.values["thickness_min"] == result.values["thickness_min"]


class Tensor(np.ndarray):
    """What is used of Open3D's tensors."""

    def __new__(cls, values):
        return np.array(values).view(cls)


def geometry(rows, *others):
    """Return a class of Open3D's tensor geometry, with tables of such names."""

    class Geometry:
        def __init__(self, points, corners=None):
            self.given = points, corners
            for name in (rows, *others):
                setattr(self, name, {})

    return Geometry


def test_open3d_gets_tensors_with_columns(result, curve, monkeypatch):
    kinds = {"TriangleMesh": geometry("vertex", "triangle"), "LineSet": geometry("point", "line")}
    kinds["PointCloud"] = geometry("point")
    shapes = SimpleNamespace(geometry=SimpleNamespace(**kinds))
    module = SimpleNamespace(core=SimpleNamespace(Tensor=Tensor), t=shapes)
    monkeypatch.setitem(sys.modules, "open3d", module)
    mesh, layer = medialis.to_open3d(result), result.layers[0]
    assert isinstance(mesh, kinds["TriangleMesh"])
    assert np.array_equal(mesh.given[0], layer.points) and np.array_equal(
        mesh.given[1], layer.faces
    )
    assert np.array_equal(mesh.vertex["thickness"], layer.attributes["thickness"][:, None])
    lines = medialis.to_open3d(curve)
    assert isinstance(lines, kinds["LineSet"]) and np.array_equal(lines.given[1], curve.edges)
    cloud = medialis.to_open3d(medialis.Shape(curve.nodes, np.tile([0, 0, 1.0], (6, 1))))
    assert isinstance(cloud, kinds["PointCloud"]) and cloud.point["normals"].shape == (6, 3)


def test_meshio_gets_cells_by_their_kind(result, curve, monkeypatch):
    def mesh(points, cells, **data):
        return SimpleNamespace(points=points, cells_dict=dict(cells), **data)

    monkeypatch.setitem(sys.modules, "meshio", SimpleNamespace(Mesh=mesh))
    made, layer = medialis.to_meshio(result), result.layers[0]
    assert np.array_equal(made.cells_dict["triangle"], layer.faces)
    assert np.array_equal(made.point_data["thickness"], layer.attributes["thickness"])
    assert np.array_equal(as_shape(made).points, layer.points)
    assert list(medialis.to_meshio(curve).cells_dict) == ["line"]
    cloud = medialis.to_meshio(medialis.Shape(np.eye(3), np.eye(3)))
    assert cloud.cells_dict["vertex"].tolist() == [[0], [1], [2]]


class Frame(dict):
    """What is used of a table of pandas."""

    columns = property(dict.keys)

    def __init__(self, data):
        rows = {k: [row[k] for row in data] for k in data[0]} if isinstance(data, list) else data
        super().__init__(rows)


def test_tables_have_one_column_a_number(result, curve, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=Frame))
    table = medialis.to_pandas(result)
    assert list(table)[:3] == ["x", "y", "z"]
    assert np.array_equal(table["thickness"], result.layers[0].attributes["thickness"])
    branches = medialis.to_pandas(curve)
    assert branches["length"].sum() == pytest.approx(curve.length)
    spots = medialis.thin_spots(medialis.surface_skeleton(medialis.organic_shape(56)))
    assert medialis.to_pandas(spots)["position_x"] == [spot.position[0] for spot in spots]


def test_neurons_are_trees_and_come_back(curve, monkeypatch):
    def neuron(table, units):
        return SimpleNamespace(nodes=table, units=units)

    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=Frame))
    monkeypatch.setitem(sys.modules, "navis", SimpleNamespace(TreeNeuron=neuron))
    made = medialis.to_navis(curve, units="1 mm")
    table = made.nodes
    assert made.units == "1 mm" and list(table["node_id"]) == [1, 2, 3, 4, 5, 6]
    assert all(parent < number for number, parent in enumerate(table["parent_id"], 1))
    again = medialis.as_curve_skeleton(made)
    assert again.loops == 0 and len(again.edges) == 5 and again.component_count == 1
    assert np.array_equal(np.sort(again.radii), np.sort(curve.radii))
    swc = SimpleNamespace(swc=table)  # as skeletor has it
    assert np.array_equal(medialis.as_curve_skeleton(swc).nodes, again.nodes)
    table["parent_id"][3] = 9
    with pytest.raises(medialis.InvalidShapeError, match="Node 9 is named as a parent"):
        medialis.as_curve_skeleton(made)


def test_graphs_come_back_whatever_their_nodes_are_called(curve):
    networkx = pytest.importorskip("networkx")
    again = medialis.as_curve_skeleton(medialis.to_networkx(curve))
    assert np.array_equal(again.nodes, curve.nodes) and again.loops == 1
    assert np.array_equal(again.radii, curve.radii)
    named = networkx.DiGraph()
    named.add_node("a", x=0, y=0, z=0)
    named.add_node("b", x=1, y=0, z=0, radius=2)
    named.add_edges_from([("a", "b"), ("b", "a"), ("b", "b")])
    found = medialis.as_curve_skeleton(named)
    assert found.edges.tolist() == [[0, 1]] and found.radii.tolist() == [0, 2]
    named.add_node("c", x=1, y=0)
    with pytest.raises(medialis.InvalidShapeError, match="'c' has no position"):
        medialis.as_curve_skeleton(named)


def test_what_is_no_graph_is_told(result, tmp_path):
    for given, said in ((7, "got int"), (result, "got Result"), (result.shape, "got Shape")):
        with pytest.raises(medialis.InvalidShapeError, match=said):
            medialis.as_curve_skeleton(given)
    with pytest.raises(medialis.FileError):
        medialis.as_curve_skeleton(tmp_path / "nowhere.swc")


def test_real_pandas(result):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    assert isinstance(medialis.to_pandas(result), pandas.DataFrame)


@pytest.mark.parametrize(
    "name", ["networkx", "navis", "trimesh", "pyvista", "open3d", "meshio", "pandas"]
)
def test_a_missing_library_is_named(name, result, curve, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    thing = curve if name in ("networkx", "navis") else result
    with pytest.raises(medialis.InvalidOptionError, match=f"pip install {name}"):
        getattr(medialis, f"to_{name}")(thing)


@pytest.mark.parametrize("ending", [".ply", ".obj", ".off"])
def test_files_hold_the_same_mesh(tmp_path, ending):
    shape = medialis.organic_shape(56)
    medialis.write_mesh(tmp_path / f"a{ending}", shape)
    again = medialis.read_shape(tmp_path / f"a{ending}")
    assert np.array_equal(again.points, shape.points) and np.array_equal(again.faces, shape.faces)


def test_stl_is_single_precision(tmp_path):
    shape = medialis.organic_shape(56)
    medialis.write_mesh(tmp_path / "a.stl", shape)
    again = medialis.read_shape(tmp_path / "a.stl")
    assert again.face_count == shape.face_count
    wanted = shape.points[shape.faces].astype(np.float32)
    assert np.array_equal(again.points[again.faces], wanted)


def test_attributes_go_to_formats_that_hold_them(tmp_path, result, curve):
    shape = medialis.organic_shape(56)
    medialis.write_mesh(tmp_path / "a.ply", shape, attributes={"height": shape.points[:, 2]})
    assert b"height" in (tmp_path / "a.ply").read_bytes()[:500]
    with pytest.raises(medialis.InvalidOptionError, match=r"Only \.ply, \.vtp"):
        medialis.write_mesh(tmp_path / "a.off", shape, attributes={"height": shape.points[:, 2]})
    with pytest.raises(medialis.InvalidOptionError, match=r"\.xyz"):
        medialis.write_mesh(tmp_path / "a.xyz", shape)
    with pytest.raises(medialis.InvalidOptionError, match="triangles only"):
        medialis.write_mesh(tmp_path / "b.stl", curve)
    medialis.write_mesh(tmp_path / "c.obj", curve)
    assert b"\nl 1 2\n" in (tmp_path / "c.obj").read_bytes()


def test_notebooks_show_a_picture_and_the_values(result):
    text = result._repr_html_()
    assert 'src="data:image/png;base64,' in text and "thickness: " in text and ", median " in text
    hostile = dataclasses.replace(result, operation="<script>alert(1)</script>")
    assert "<script>" not in hostile._repr_html_()
