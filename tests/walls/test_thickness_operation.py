"""The operation `thickness`: original vertices, thin spots, picture, command line."""

import json

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.cli.commands import main
from medialis.formats.ply_attributes import write_ply
from medialis.operations.declaration import Kind, Parameter
from medialis.show.colors import color_table


@pytest.fixture(scope="module")
def plate():
    """12 triangles, 0.3 high."""
    return forms.box_mesh((2.0, 1.5, 0.3), 10.0)


@pytest.mark.slow
def test_values_come_back_to_the_vertices_of_the_input(plate):
    """The refined plate is 0.3 thick everywhere, up to the lateral offset of the contacts."""
    result = medialis.run("thickness", plate)
    layer = result.layers[0]
    assert layer.name == "thickness" and (layer.points == plate.points).all()
    h = 0.01 * plate.diagonal
    assert (np.abs(layer.attributes["wall_thickness"] - 0.3) < h**2 / 0.3 + 1e-3).all()
    assert layer.attributes["thin_spot"].dtype == np.int32
    names = [layer.name for layer in result.layers]
    assert names == ["thickness", "thin_spots", "samples"]
    assert len(result.layers[2].points) == result.values["samples"] > 1000
    spot = result.values["spots"][0]
    assert spot["vertices"] == result.values["samples"] and result.values["thin_spots"] == 1
    told = {message.code: message.data for message in result.messages}
    assert told["thin_spots"]["spots"] == 1
    assert told["thin_spots"]["thinnest"] == pytest.approx(0.3, rel=0.01)
    assert medialis.draw_result(result, width=200, height=150).shape == (150, 200, 3)
    half = medialis.run("thickness", plate, kind="radius")
    assert half.values["wall_thickness_min"] == result.values["wall_thickness_min"] / 2


@pytest.mark.slow
def test_threshold_and_angle(plate):
    none = medialis.run("thickness", plate, threshold=0.05)
    assert none.values["spots"] == [] and [x.name for x in none.layers] == ["thickness", "samples"]
    assert "no_thin_spot" in [message.code for message in none.messages]
    assert medialis.draw_result(none, width=200, height=150).shape == (150, 200, 3)
    every = medialis.run("thickness", plate, min_spoke_angle=0)
    assert every.values["wall_thickness_min"] < 0.1
    with pytest.raises(medialis.InvalidOptionError, match="min_spoke_angle"):
        medialis.run("thickness", plate, min_spoke_angle=181)


def test_walls_thinner_than_the_sampling_are_announced():
    """Two staggered grids 0.2 steps apart: no ball of a wall is seen."""
    x, y = (g.ravel() for g in np.meshgrid(np.arange(30.0), np.arange(30.0)))
    top = np.stack([x, y, 0 * x], axis=1)
    points = np.concatenate([top, top + np.array([0.5, 0.5, -0.2])])
    normals = np.repeat([[0, 0, 1.0], [0, 0, -1.0]], len(top), axis=0)
    result = medialis.run("thickness", medialis.Shape(points, normals))
    assert "unresolved_walls" in [message.code for message in result.messages]


def test_clouds_have_thickness_without_area():
    form = forms.sphere(800)
    result = medialis.run("thickness", form.shape)
    assert abs(result.values["thickness_median"] - 2) < 0.01
    assert "area" not in result.layers[1].attributes
    assert [spot["area"] for spot in result.values["spots"]] == [None]


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1.0, 1.0, 1e-4), (1e4, 1.0, 1.0)])
def test_walls_thinner_than_the_tolerance_are_found(size):
    """A plate of 1e-4 was 0.027 thick, and a bar of 1 : 10000 was 267 thick: the tolerance of 3e-4
    took the other side for relief, and the few balls left ended at the far rim."""
    result = medialis.run("thickness", forms.box_mesh(size, 2e4))
    assert "thin_walls" in [message.code for message in result.messages]
    # Balls stop up to 3/4 of the tolerance behind the other side, here a tenth of the default.
    slack = 0.75 * 3e-5 * result.shape.diagonal
    values = result.layers[0].attributes["wall_thickness"]
    assert (np.abs(values - min(size)) < slack).all()


@pytest.mark.slow
@pytest.mark.parametrize("wall", [1e-3, 1e-4, 1e-5])
def test_a_thin_fin_on_a_thick_base_is_measured(wall):
    """Balls went through a fin and came to rest on the base beside it: 0.5 instead of 1e-4, and
    nothing was said."""
    x = 0.5 + np.array([-0.5, 0.5, 0.5, wall / 2, wall / 2, -wall / 2, -wall / 2, -0.5])
    outline = np.stack([x, [0, 0, 0.5, 0.5, 1, 1, 0.5, 0.5]], axis=1)
    corners = [np.insert(outline, 1, depth, axis=1) for depth in (0.0, 1.0)]
    sides = [(i, (i + 1) % 8, 8 + (i + 1) % 8, 8 + i) for i in range(8)]
    quads = [*sides, (0, 1, 2, 7), (15, 10, 9, 8), (3, 4, 5, 6), (14, 13, 12, 11)]
    front = [(2, 3, 6), (2, 6, 7), (14, 11, 10), (15, 14, 10)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))] + front
    shape = medialis.make_shape(np.concatenate(corners), faces, repair=True)
    assert shape.diagnosis.closed and shape.diagnosis.genus == 0
    result = medialis.run("thickness", shape, refine=0.02)
    values, top = result.layers[0].attributes["wall_thickness"], shape.points[:, 2] > 0.9
    # The tolerance that finds it is below the wall, and balls stop up to 3/4 of it behind.
    assert top.sum() == 4 and (np.abs(values[top] / wall - 1) < 0.75).all()
    hidden = "thin_walls" in [message.code for message in result.messages]
    assert hidden == (wall < 3e-4 * result.shape.diagonal)


def test_a_disc_whose_rim_stays_hidden_is_measured():
    """At its sharp rim some balls meet nothing with any tolerance: all others were wrong too."""
    ball = forms.icosphere(3)
    disc = medialis.make_shape(ball.points * [1, 1, 1e-6], ball.faces)
    values = medialis.run("thickness", disc, refine=0).layers[0].attributes["wall_thickness"]
    assert values.max() <= 2e-6 * (1 + 1e-6)


@pytest.mark.slow
def test_a_small_largest_radius_is_no_hidden_wall():
    cube = forms.box_mesh((1, 1, 1), 0.5)
    result = medialis.run("surface_skeleton", cube, largest_radius=0.05)
    assert result.values["open_balls"] > 0
    assert "thin_walls" not in [message.code for message in result.messages]


@pytest.mark.slow
def test_command_line_tells_where(plate, tmp_path, capsys):
    file, out = tmp_path / "plate.ply", tmp_path / "out"
    write_ply(file, plate.points, faces=plate.faces)
    arguments = ["thickness", str(file), "-o", str(out), "--min-spoke-angle", "100", "--spots", "3"]
    assert main([*arguments, "--json"]) == 0
    manifest = json.loads(capsys.readouterr().out)
    spot = manifest["values"]["spots"][0]
    assert len(spot["position"]) == 3 and spot["value"] == pytest.approx(0.3, rel=0.01)
    assert manifest["parameters"]["min_spoke_angle"] == 100
    assert {"thickness.ply", "thin_spots.ply", "samples.ply", "thickness.png"} <= {
        path.name for path in out.iterdir()
    }
    assert main([*arguments, "--no-picture"]) == 0
    assert "diameter of 0.3 at" in capsys.readouterr().out


def test_angles_and_reversed_maps():
    angle = Parameter("turn", Kind.ANGLE, 5.0, "Turn", "Help.", high=180.0)
    assert angle.check(90) == 90.0
    with pytest.raises(medialis.InvalidOptionError, match="turn"):
        angle.check("wide")
    assert (color_table("diverging_reversed") == color_table("diverging")[::-1]).all()


def test_a_turned_shape_is_as_thick():
    """The diagonal of its box turns with it by a fifth, the lengths of the run do not."""
    shape = medialis.organic_shape(56)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    other = medialis.make_shape(shape.points @ turn.T, shape.faces)
    assert abs(other.diagonal / shape.diagonal - 1) > 0.03
    runs = [medialis.run("thickness", one) for one in (shape, other)]
    assert runs[0].values["samples"] == runs[1].values["samples"]
    before, after = (run.layers[0].attributes["wall_thickness"] for run in runs)
    assert np.quantile(np.abs(after / before - 1), 0.99) < 0.01
