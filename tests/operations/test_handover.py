"""What hosts that read files get: layers in colours, and fields on their own vertices."""

import json

import numpy as np
import pytest

import medialis
from medialis.cli.commands import main
from medialis.files.ply_attributes import read_ply_attributes, write_ply
from medialis.hosts.handover import layer_colors, on_input_attributes, write_for_host
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import Layer
from medialis.render.colors import label_colors, map_colors

POINTS = np.eye(3)


def test_colors_are_those_of_the_map_and_its_limits():
    values = np.array([0.0, 1.0, np.nan])
    layer = Layer("x", POINTS, attributes={"v": values}, color_by="v", color_limits=(0.0, 2.0))
    colors = layer_colors(layer)
    assert colors.dtype == np.uint8 and (colors[:, 3] == 255).all()
    np.testing.assert_array_equal(
        colors[:, :3], np.rint(255 * map_colors(values, "sequential", 0.0, 2.0))
    )


def test_colors_of_labels_are_distinct():
    labels = np.array([0, 1, -1], np.int32)
    layer = Layer("x", POINTS, attributes={"part": labels}, color_by="part", labels=("part",))
    np.testing.assert_array_equal(layer_colors(layer)[:, :3], np.rint(255 * label_colors(labels)))


def test_nothing_to_color_by_is_no_color():
    assert layer_colors(Layer("x", POINTS)) is None
    assert layer_colors(Layer("x", POINTS, attributes={"v": POINTS}, color_by="v")) is None


def damaged() -> tuple[np.ndarray, np.ndarray]:
    """A shape with an unused vertex in row 5, a twin of the first at the end and a double face."""
    shape = medialis.organic_shape(56)
    points = np.insert(shape.points, 5, 9.0, axis=0)
    faces = shape.faces + (shape.faces >= 5)
    return np.concatenate([points, points[:1]]), np.concatenate([faces, faces[:1]])


def test_fields_come_back_on_the_rows_of_the_input(tmp_path):
    points, faces = damaged()
    shape = medialis.make_shape(points, faces, repair=True)
    assert shape.point_count < len(points) and shape.face_count < len(faces)
    layer = Layer(
        "field",
        shape.points,
        shape.faces,
        attributes={"x": shape.points[:, 0], "row": np.arange(shape.point_count, dtype=np.int32)},
        face_attributes={"side": np.arange(shape.face_count, dtype=np.int32)},
        on_input=True,
    )
    values, on_faces = on_input_attributes(layer, shape)
    kept = shape.vertex_map >= 0
    assert not kept.all() and len(values["x"]) == len(points)
    np.testing.assert_array_equal(values["x"][kept], points[kept, 0])
    assert np.isnan(values["x"][~kept]).all() and (values["row"][~kept] == -1).all()
    assert len(on_faces["side"]) == len(faces)
    np.testing.assert_array_equal(on_faces["side"][shape.face_map], layer.face_attributes["side"])
    dropped = np.setdiff1d(np.arange(len(faces)), shape.face_map)
    assert len(dropped) and (on_faces["side"][dropped] == -1).all()


def test_a_layer_of_other_rows_is_refused():
    shape = medialis.organic_shape(56)
    with pytest.raises(medialis.InvalidShapeError, match="has 3 points, the shape"):
        on_input_attributes(Layer("x", POINTS, on_input=True), shape)


def test_face_fields_of_the_input_are_written_with_their_colors(tmp_path):
    points, faces = damaged()
    shape = medialis.make_shape(points, faces, repair=True)
    parts = (np.arange(shape.face_count) % 3).astype(np.int32)
    layer = Layer(
        "parts", shape.points, shape.faces, face_attributes={"part": parts},
        labels=("part",), color_by="part", on_input=True,
    )  # fmt: skip
    result = medialis.Result(shape, (layer,), operation="parts")
    manifest = write_for_host(result, shape, tmp_path / "out")
    ply = read_ply_attributes(tmp_path / "out" / manifest["layers"][0]["file"])
    assert len(ply.points) == len(points)
    assert list(ply.face_attributes) == ["part", "red", "green", "blue", "alpha"]
    np.testing.assert_array_equal(ply.face_attributes["part"][shape.face_map], parts)


@pytest.mark.parametrize("entry", OPERATIONS, ids=lambda entry: entry.name)
def test_every_operation_is_handed_over_whole(entry, tmp_path):
    """Layers and attributes equal those of the Python call; fields lie on the file's vertices."""
    points, faces = damaged()
    write_ply(tmp_path / "in.ply", points, faces)
    name = entry.name.replace("_", "-")
    assert main([name, str(tmp_path / "in.ply"), "-o", str(tmp_path / "out"), "--host"]) == 0
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    shape = medialis.read_shape(tmp_path / "in.ply")
    result = medialis.run(entry.name, shape)
    layers = [layer for layer in result.layers if not layer.auxiliary]
    assert [about["name"] for about in manifest["layers"]] == [layer.name for layer in layers]
    files = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert files == sorted(["manifest.json", *(about["file"] for about in manifest["layers"])])
    for about, layer in zip(manifest["layers"], layers, strict=True):
        ply = read_ply_attributes(tmp_path / "out" / about["file"])
        attributes = dict(layer.attributes)
        if layer.on_input:
            assert len(ply.points) == len(points)
            attributes = on_input_attributes(layer, shape)[0]
        else:
            np.testing.assert_array_equal(ply.points, layer.points)
        for key, values in attributes.items():
            np.testing.assert_array_equal(ply.attributes[key], values)
        if layer.color_by in layer.attributes:
            assert {"red", "green", "blue", "alpha"} <= set(ply.attributes)


def test_auxiliary_layers_come_on_request_and_failure_leaves_nothing(tmp_path, monkeypatch):
    shape = medialis.organic_shape(56)
    result = medialis.run("surface_skeleton", shape)
    manifest = write_for_host(result, shape, tmp_path / "out", auxiliary=True)
    assert [about["name"] for about in manifest["layers"]] == ["surface_skeleton", "samples"]

    def fail(*arguments, **options):
        raise medialis.FileError("Cannot write: disk full.")

    monkeypatch.setattr("medialis.hosts.handover.write_json", fail)
    with pytest.raises(medialis.FileError):
        write_for_host(result, shape, tmp_path / "other")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
