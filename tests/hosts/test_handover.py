"""What hosts that read files get: layers in colours, and fields on their own vertices."""

import json

import numpy as np
import pytest

import medialis
from medialis.cli.commands import main
from medialis.formats.ply_attributes import read_ply_attributes, write_ply
from medialis.hosts import filters, host_layers, on_input, write_for_host
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import Layer
from plates import tee
from shapes_to_repair import damaged


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


def test_hidden_points_are_a_layer_of_their_own(default_run, tmp_path):
    result = default_run("surface_skeleton")
    shape = result.shape
    manifest = write_for_host(result, shape, tmp_path / "out")
    assert [(about["name"], about["role"]) for about in manifest["layers"]] == [
        ("surface_skeleton", ""),
        ("surface_skeleton_hidden", "hidden"),
    ]
    files = [read_ply_attributes(tmp_path / "out" / about["file"]) for about in manifest["layers"]]
    hidden = result.layers[0].hidden
    assert [len(file.points) for file in files] == [(~hidden).sum(), hidden.sum()]


@pytest.mark.slow
@pytest.mark.parametrize("entry", OPERATIONS, ids=lambda entry: entry.name)
def test_every_operation_is_handed_over_whole(entry, tmp_path):
    """Layers and attributes equal those of the Python call; fields lie on the file's vertices."""
    points, faces = damaged() if entry.sample == "creature" else tee()
    write_ply(tmp_path / "in.ply", points, faces)
    name = entry.name.replace("_", "-")
    assert main([name, str(tmp_path / "in.ply"), "-o", str(tmp_path / "out"), "--host"]) == 0
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    shape = medialis.read_shape(tmp_path / "in.ply")
    result = medialis.run(entry.name, shape)
    chosen = next(f for f in filters() if f.name == entry.filter_name)
    layers = host_layers(result, shape, chosen)
    assert [about["name"] for about in manifest["layers"]] == [layer.name for layer in layers]
    files = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert files == sorted(["manifest.json", *(about["file"] for about in manifest["layers"])])
    for about, layer in zip(manifest["layers"], layers, strict=True):
        ply = read_ply_attributes(tmp_path / "out" / about["file"])
        attributes = dict(layer.attributes)
        if layer.on_input:
            assert len(ply.points) == len(points)
            attributes = on_input(layer, shape).attributes
        else:
            np.testing.assert_array_equal(ply.points, layer.points)
        for key, values in attributes.items():
            np.testing.assert_array_equal(ply.attributes[key], values)
        if layer.color_by in layer.attributes:
            assert {"red", "green", "blue", "alpha"} <= set(ply.attributes)


def test_auxiliary_layers_come_on_request_and_failure_leaves_nothing(tmp_path, monkeypatch):
    shape = medialis.organic_shape(56)
    result = medialis.run("surface_skeleton", shape, threshold=0.0)
    manifest = write_for_host(result, shape, tmp_path / "out", auxiliary=True)
    assert [about["name"] for about in manifest["layers"]] == ["surface_skeleton", "samples"]

    def fail(*arguments, **options):
        raise medialis.FileError("Cannot write: disk full.")

    monkeypatch.setattr("medialis.hosts.menu.write_json", fail)
    with pytest.raises(medialis.FileError):
        write_for_host(result, shape, tmp_path / "other")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.slow
def test_a_selection_has_defaults_of_its_own_and_is_all_that_is_written(tmp_path):
    """Without a threshold nothing would be thin: the selection has one."""
    shape = medialis.organic_shape(56)
    write_ply(tmp_path / "in.ply", shape.points, shape.faces)
    for more, share in ([], 0.02), (["--threshold=5%"], 0.05):
        command = ["thickness", str(tmp_path / "in.ply"), "-o", str(tmp_path / "out")]
        assert main([*command, "--host", "--select", *more]) == 0
        manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
        (about,) = manifest["layers"]
        assert about["role"] == "selection" and about["on_input"]
        chosen = read_ply_attributes(tmp_path / "out" / about["file"]).attributes["selected"]
        read = medialis.read_shape(tmp_path / "in.ply")
        thickness = medialis.run("thickness", read, threshold=share).layers[0]
        expected = thickness.attributes["wall_thickness"] < share * shape.diagonal
        np.testing.assert_array_equal(chosen == 1, expected)
        assert manifest["values"] == {"selected": expected.sum()} and expected.any()


def test_generated_layers_leave_the_colours_of_the_input(default_run, tmp_path):
    """The branch of each vertex is a field; nothing tells a host to colour by it."""
    shape = medialis.organic_shape(56)
    result = default_run("curve_skeleton")
    manifest = write_for_host(result, shape, tmp_path / "out", draw_solid=True)
    parts = next(about for about in manifest["layers"] if about["on_input"])
    ply = read_ply_attributes(tmp_path / "out" / parts["file"])
    assert parts["color_by"] is None and set(ply.attributes) == {"branch", "node", "left_out"}
    curve = next(about for about in manifest["layers"] if not about["on_input"])
    assert curve["edges"] == 0 and curve["faces"] > 0
