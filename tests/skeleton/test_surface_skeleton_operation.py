"""The first click: a skeleton whose unimportant points are hidden, and all of them in the data."""

from dataclasses import replace

import numpy as np
import pytest

import medialis


@pytest.fixture(scope="module")
def result():
    return medialis.run("surface_skeleton", medialis.organic_shape(100))


@pytest.mark.slow
def test_it_has_the_importance_of_its_detailed_sister(result):
    sister = medialis.run("skeleton_importance", medialis.organic_shape(100))
    samples = result.shape.point_count  # the rows of fans come behind
    importance = result.arrays["importance"][:samples]
    np.testing.assert_array_equal(importance, sister.arrays["importance"])
    layer = result.layers[0]
    np.testing.assert_array_equal(
        layer.attributes["importance"], result.arrays["importance"][result.arrays["selected"]]
    )
    assert layer.filter_by == layer.color_by == "importance"


@pytest.mark.slow
def test_points_below_the_threshold_are_hidden_and_counted(result):
    layer = result.layers[0]
    assert 0 < layer.filter_default <= 0.03
    limit = layer.filter_default * result.shape.diagonal
    np.testing.assert_array_equal(layer.hidden, layer.attributes["importance"] < limit)
    (note,) = [message for message in result.messages if message.code == "hidden_points"]
    assert 0 < note.data["hidden"] == result.values["hidden_points"] == layer.hidden.sum()
    assert note.data["points"] == len(layer.points) == result.values["skeleton_points"]


@pytest.mark.slow
def test_thin_limbs_stay_shown_by_default():
    """Most of a spider's legs were hidden: half their girth was below the default (mended)."""
    thin = medialis.run("surface_skeleton", tube(0.004, length=1.0))
    layer = thin.layers[0]
    assert layer.filter_default * thin.shape.diagonal < np.pi * 0.004
    limb = layer.attributes["importance"] >= 2.8 * layer.attributes["radius"]
    area = thin.shape.point_areas[layer.attributes["source"]]
    assert area[limb & layer.hidden].sum() <= 0.1 * area[limb].sum()
    assert area[limb].sum() > 0.9 * area.sum()
    own = medialis.run("surface_skeleton", tube(0.004, length=1.0), threshold=0.0131).layers[0]
    assert own.filter_default in (0.0131, 0.0)


def tube(radius, length):
    """A closed tube along z with round sections of 24 corners."""
    around = np.linspace(0, 2 * np.pi, 25)[:-1]
    along = np.linspace(0, length, int(length / radius) + 1)
    ring = np.stack([radius * np.cos(around), radius * np.sin(around), 0 * around], axis=1)
    points = np.concatenate([ring + np.array([0, 0, z]) for z in along])
    points = np.concatenate([points, [[0, 0, 0], [0, 0, length]]])
    k, rows = np.arange(24), len(along)
    after = (k + 1) % 24
    faces = [np.stack([after, k, 0 * k + len(points) - 2], axis=1)]
    for row in 24 * np.arange(rows - 1):
        faces.append(np.stack([row + k, row + after, row + 24 + after], axis=1))
        faces.append(np.stack([row + k, row + 24 + after, row + 24 + k], axis=1))
    last = 24 * (rows - 1)
    faces.append(np.stack([last + k, last + after, 0 * k + len(points) - 1], axis=1))
    return medialis.make_shape(points, np.concatenate(faces))


@pytest.mark.slow
def test_a_threshold_of_zero_hides_nothing(result):
    every = medialis.run("surface_skeleton", medialis.organic_shape(100), threshold=0.0)
    assert not every.layers[0].hidden.any() and every.values["hidden_points"] == 0
    assert "hidden_points" not in [message.code for message in every.messages]
    np.testing.assert_array_equal(every.layers[0].points, result.layers[0].points)


def test_where_all_points_are_unimportant_none_is_hidden():
    shape = medialis.organic_shape(56)
    found = medialis.run("surface_skeleton", shape, threshold=10.0)
    assert not found.layers[0].hidden.any()


@pytest.mark.slow
def test_clouds_other_sides_and_a_plain_request_have_no_importance(result):
    shape = medialis.organic_shape(56)
    cloud = medialis.Shape(shape.points, shape.normals)
    for found in (
        medialis.run("surface_skeleton", cloud),
        medialis.run("surface_skeleton", shape, side="both"),
        medialis.run("surface_skeleton", shape, importance=False),
    ):
        layer = found.layers[0]
        assert layer.filter_by == "spoke_angle" and layer.color_by == "radius"
        assert "importance" not in found.arrays and not layer.hidden.any()


@pytest.mark.slow
def test_pictures_leave_hidden_points_out():
    """A picture with hidden points is that of a result that has only the others."""
    shape = medialis.organic_shape(56)
    found = medialis.run("surface_skeleton", shape, threshold=0.1)
    layer = found.layers[0]
    assert layer.hidden.any() and not layer.hidden.all()
    kept = medialis.Layer(
        layer.name,
        layer.points[~layer.hidden],
        attributes={name: values[~layer.hidden] for name, values in layer.attributes.items()},
        color_by="importance",
    )
    size = {"width": 200, "height": 150, "style": medialis.Style(legend=False)}
    kept = replace(kept, color_limits=layer.color_limits)
    alone = medialis.Result(found.shape, (kept,), operation="surface_skeleton")
    camera = medialis.show.camera.Camera.framing(shape.points, width=200, height=150)
    pictures = [medialis.draw_result(r, camera=camera, **size) for r in (found, alone)]
    np.testing.assert_array_equal(*pictures)
