"""What hosts show of a layer and what they hide."""

import numpy as np

import medialis
from medialis.hosts import FilterUnit, Layer, hidden_apart, shown
from medialis.show.colors import label_colors, map_colors

POINTS = np.eye(3)


def test_colors_are_those_of_the_map_and_its_limits():
    values = np.array([0.0, 1.0, np.nan])
    layer = Layer("x", POINTS, attributes={"v": values}, color_by="v", color_limits=(0.0, 2.0))
    found = shown(layer)
    assert found.rgba_bytes.dtype == np.uint8 and (found.rgba_bytes[:, 3] == 255).all()
    np.testing.assert_array_equal(found.rgb, map_colors(values, "sequential", 0.0, 2.0))
    np.testing.assert_array_equal(found.rgba_bytes[:, :3], np.rint(255 * found.rgb))


def test_colors_of_labels_are_distinct():
    labels = np.array([0, 1, -1], np.int32)
    layer = Layer("x", POINTS, attributes={"part": labels}, color_by="part", labels=("part",))
    np.testing.assert_array_equal(shown(layer).rgb, label_colors(labels))


def test_nothing_to_color_by_is_no_color():
    assert shown(Layer("x", POINTS)) is None
    assert shown(Layer("x", POINTS, attributes={"v": POINTS}, color_by="v")) is None


def test_attributes_of_faces_are_shown_on_faces():
    face = np.array([[0, 1, 2]], np.int32)
    layer = Layer("x", POINTS, face, face_attributes={"v": np.array([2.0])}, color_by="v")
    assert shown(layer).on_faces and len(shown(layer).values) == 1
    assert shown(layer, face_attributes={}) is None


def test_finite_values_stand_for_none_and_infinity():
    values = np.array([np.nan, 1.0, np.inf, 2.0, -np.inf])
    layer = Layer("x", np.zeros((5, 3)), attributes={"v": values}, color_by="v")
    assert shown(layer).finite.tolist() == [1.0, 1.0, 2.0, 2.0, 1.0]


def test_hidden_points_are_apart_and_none_is_lost():
    values = np.array([0.1, 3.0, np.inf])
    layer = Layer(
        "x", POINTS, attributes={"v": values}, color_by="v", filter_by="v",
        filter_unit=FilterUnit.length(2.0), filter_default=0.5,
    )  # fmt: skip
    first, second = hidden_apart(layer)
    assert (first.name, second.name, second.role) == ("x", "x_hidden", "hidden")
    assert second.points.tolist() == POINTS[:1].tolist() and len(first.points) == 2
    colors = shown(layer).rgb
    np.testing.assert_array_equal(np.vstack([shown(second).rgb, shown(first).rgb]), colors)
    assert hidden_apart(first) == (first,) and not first.hidden.any()


def test_a_layer_that_hides_nothing_is_whole():
    layer = medialis.run("surface_skeleton", medialis.organic_shape(56), threshold=0.0).layers[0]
    assert hidden_apart(layer) == (layer,)
