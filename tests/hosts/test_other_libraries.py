"""Results as objects of other libraries, and meshes as files."""

import dataclasses
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import medialis


@pytest.fixture(scope="module")
def result():
    return medialis.run("thickness", medialis.organic_shape(56))


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


class Frame(dict):
    """What is used of a table of pandas."""

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


def test_real_pandas(result):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    assert isinstance(medialis.to_pandas(result), pandas.DataFrame)


@pytest.mark.parametrize("name", ["networkx", "trimesh", "pyvista", "pandas"])
def test_a_missing_library_is_named(name, result, curve, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    thing = curve if name == "networkx" else result
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


def test_attributes_go_to_ply_only(tmp_path, result, curve):
    shape = medialis.organic_shape(56)
    medialis.write_mesh(tmp_path / "a.ply", shape, attributes={"height": shape.points[:, 2]})
    assert b"height" in (tmp_path / "a.ply").read_bytes()[:500]
    with pytest.raises(medialis.InvalidOptionError, match="Only PLY"):
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
