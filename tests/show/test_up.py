"""Up is up: the axis of the file's format, else as asked, else as the shape stands."""

import json

import numpy as np
import pytest

import medialis
import plates
from medialis.batches.jobs import plan
from medialis.cli.commands import main
from medialis.formats.meshes import UP, _collada_up
from medialis.formats.ply_attributes import write_ply
from medialis.shape.upright import up_of_cloud
from medialis.show.camera import Camera, default_view, shape_view

SIZES = {"standing": (1.0, 2.0, 4.0), "lying": (4.0, 2.0, 0.1), "cube": (1.0, 1.0, 1.0)}


def corners(size):
    return np.stack(np.meshgrid(*[(0.0, one) for one in size]), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_what_is_given_points_up(size, order, axis):
    """And is seen from above, so that something of the top is visible."""
    direction, up = default_view(corners(size)[:, order], axis)
    assert up.tolist() == np.eye(3)["xyz".index(axis)].tolist()
    height = float(direction @ up)
    assert np.isclose(height, np.sin(np.radians(20))) or np.isclose(height, np.sin(np.radians(50)))
    camera = Camera.framing(corners(size)[:, order], up=axis)
    assert np.allclose(camera.up, up) and np.allclose(camera.axes[1] @ direction, 0, atol=1e-9)
    assert camera.axes[1] @ up > 0.6  # upwards in the picture


def test_a_plate_on_the_ground_shows_its_top():
    """A printed part of an STL file was seen from its edge by a rule that knew the axis alone."""
    direction, _ = default_view(corners(SIZES["lying"]), "z")
    assert direction[2] > 0.7 and abs(direction[1]) > abs(direction[0])  # its long side across


def test_formats_say_it(tmp_path):
    for name in ("a.ply", "a.stl"):
        medialis.write_mesh(tmp_path / name, medialis.organic_shape(56))
    assert medialis.read_shape(tmp_path / "a.ply").up is None
    assert medialis.read_shape(tmp_path / "a.stl").up == UP["stl"] == "z"
    assert medialis.read_shape(tmp_path / "a.stl", up="x").up == "x"
    with pytest.raises(medialis.InvalidOptionError, match="up must be one of x, y, z"):
        medialis.read_shape(tmp_path / "a.ply", up="up")


@pytest.mark.parametrize("count", [300, 3000])
def test_clouds_stand_on_z_unless_they_clearly_stand_on_y(tmp_path, count):
    """Scans of trees lay on their side in pictures (fixed): a tree stands on no feet."""
    rng = np.random.default_rng(count)
    height = 10 * rng.random(count) ** 0.5
    turn, away = 2 * np.pi * rng.random(count), 0.2 + 0.6 * np.maximum(height - 3, 0)
    tree = np.column_stack([away * np.cos(turn), away * np.sin(turn), height])
    standing = np.column_stack([4 * rng.random((count, 2)), np.zeros(count)])  # on a wide base
    bust = np.concatenate([standing, rng.random((count, 3)) + np.array([2, 2, 0])])
    for points, axis in ((tree, "z"), (bust, "z"), (bust[:, [0, 2, 1]], "y")):
        path = tmp_path / "a.xyz"
        np.savetxt(path, points)
        shape = medialis.read_shape(path)
        assert shape.up == axis
        bare = medialis.Shape(points, np.zeros_like(points))
        assert shape_view(bare)[1].tolist() == np.eye(3)["xyz".index(axis)].tolist()


def test_up_of_few_and_of_huge_points():
    for points in (np.zeros((3, 3)), np.array([[np.nan, 0, 0], [1, 2, 3]]), 1e308 * np.eye(3)):
        assert up_of_cloud(points) in "yz"


def test_the_command_line_has_it_and_results_keep_it(tmp_path, capsys):
    shape = medialis.organic_shape(56)
    write_ply(tmp_path / "a.ply", shape.points, shape.faces)
    words = ["point-types", str(tmp_path / "a.ply"), "--up", "x", "-o", str(tmp_path / "out")]
    assert main(words) == 0
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["up"] == "x"
    assert medialis.read_result(tmp_path / "out").shape.up == "x"
    assert main([*words[:2], "--up", "z", *words[4:]]) == 2
    assert "holds a result with another axis up. Name" in capsys.readouterr().err
    assert main([*words[:2], "--up", "w"]) == 2
    assert "--up" in capsys.readouterr().err


def test_the_view_does_not_depend_on_the_triangles():
    """A bracket of 32 vertices was seen from its back, refined from its front (fixed)."""
    coarse = plates.shape_of(plates.bracket())
    fine = medialis.refine(coarse, longest_edge=0.02)
    views = [shape_view(shape) for shape in (coarse, fine)]
    assert fine.point_count > 20 * coarse.point_count
    assert views[0][1].tolist() == views[1][1].tolist()
    assert np.degrees(np.arccos(views[0][0] @ views[1][0])) < 3


@pytest.mark.parametrize(("said", "axis"), [("Z_UP", "z"), ("X_UP", "x"), (None, "y")])
def test_collada_files_say_it_themselves(said, axis):
    text = f"<asset><up_axis> {said} </up_axis></asset>" if said else "<asset/>"
    assert _collada_up(text.encode()) == axis


def test_batches_have_it_too(tmp_path):
    shape = medialis.organic_shape(56)
    write_ply(tmp_path / "a.ply", shape.points, shape.faces)
    reading = {"read_shape": {"up": "x"}}
    options = {"parameters": reading, "workers": 1, "picture": False}
    (row,) = medialis.batch("point_types", [tmp_path / "a.ply"], tmp_path / "out", **options)
    assert row.status == "done"
    assert medialis.read_result(tmp_path / "out" / "a" / "point_types").shape.up == "x"
    with pytest.raises(medialis.InvalidOptionError, match="up must be one of x, y, z"):
        plan(
            ["point_types"], [tmp_path / "a.ply"], tmp_path, parameters={"read_shape": {"up": "w"}}
        )
