"""What notebooks show of a thing by its name alone: short texts, and questions for wrong words."""

import json

import pytest

import closed_forms as forms
import medialis
from medialis.rigging.bones import NAMES_TOLD


def test_results_tell_operation_unit_and_sizes():
    result = medialis.run("thickness", medialis.make_shape(*plain(), unit="mm"))
    assert repr(result).startswith("Result(thickness, in mm, thickness (162 points, 320 triangles)")
    assert (
        repr(result.layers[0])
        == "Layer(thickness, 162 points, 320 triangles: "
        + ", ".join(result.layers[0].attributes)
        + ")"
    )
    unknown = medialis.run("thickness", forms.icosphere(2))
    assert "unit unknown" in repr(unknown)


def plain():
    ball = forms.icosphere(2)
    return ball.points, ball.faces


def test_shapes_tell_their_unit():
    assert repr(medialis.make_shape(*plain(), unit="mm")).endswith("mm)")


def test_thin_spots_show_where_they_are():
    spot = medialis.thin_spots(medialis.surface_skeleton(medialis.organic_shape(56)))[0]
    x, y, z = spot.position
    assert f"position ({x:.6g}, {y:.6g}, {z:.6g})" in repr(spot)


def test_bones_show_their_names():
    line = medialis.CurveSkeleton.of([[0, 0, 0], [4, 0, 0]], [[0, 1]], [1, 1])
    assert repr(medialis.bones(line)) == "Bones(1 bone: bone 000)"
    long = [[x, x % 2, 0] for x in range(NAMES_TOLD + 3)]
    bent = medialis.CurveSkeleton.of(
        long, [[x, x + 1] for x in range(len(long) - 1)], [0.1] * len(long)
    )
    assert repr(medialis.bones(bent)).endswith(f"bone {NAMES_TOLD - 1:03d}, ...)")


def test_what_was_written_is_told_in_a_line(tmp_path):
    result = medialis.run("thickness", forms.icosphere(2))
    written = medialis.write_result(result, tmp_path, pictures=medialis.Pictures(main=False))
    assert repr(written) == f"Manifest(thickness: {len(written['files'])} files in {tmp_path})"
    assert json.loads((tmp_path / "manifest.json").read_text())["files"] == written["files"]


def test_wrong_words_are_answered_with_the_nearest():
    shape = forms.icosphere(1)
    with pytest.raises(medialis.InvalidOptionError, match=r"thresold; did you mean threshold\?"):
        medialis.run("thickness", shape, thresold=1)
    with pytest.raises(medialis.InvalidOptionError, match=r"'thicknes'; did you mean thickness\?"):
        medialis.run("thicknes", shape)
    with pytest.raises(TypeError, match=r"min_spoke; did you mean min_spoke_angle\?"):
        medialis.wall_thickness(shape, min_spoke=1)
