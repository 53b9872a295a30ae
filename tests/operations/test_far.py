"""Shapes far from the origin, in results that lose nothing there."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.operations.far import POSITIONS, near_origin, offset_of
from plates import with_walls

FAR = np.array([3.0e7, -5.0e6, 0.0])


def on_a_grid(shape):
    """The shape with coordinates that stay the same when it is moved far and back."""
    step = 2.0**-20
    points = np.round(shape.points / step) * step
    return medialis.make_shape(points, shape.faces)


@pytest.mark.slow
@pytest.mark.parametrize("operation", medialis.OPERATIONS, ids=lambda one: one.name)
def test_a_shape_far_away_has_the_same_result_there(operation):
    """Six digits were left of a part in metres of a map: balls lost half of them (mended)."""
    near = on_a_grid(with_walls(operation.name, medialis.organic_shape(60)))
    far = medialis.make_shape(near.points + FAR, near.faces)
    np.testing.assert_array_equal(far.points - FAR, near.points)
    options = {"pairs": 3, "size": 64} if operation.name == "view_curve_skeleton" else {}
    offset = offset_of(far)
    # The same normals: those of the far shape were made from the same differences.
    expected = medialis.run(operation.name, near_origin(far), **options)
    result = medialis.run(operation.name, far, **options)
    assert [str(m) for m in result.messages] == [str(m) for m in expected.messages]
    assert result.arrays.keys() == expected.arrays.keys()
    for name, array in result.arrays.items():
        known = expected.arrays[name]
        known = known + offset if name in POSITIONS else known
        np.testing.assert_array_equal(array, known, err_msg=name)
    low, high = far.bounds
    for layer in result.layers:
        assert (layer.points > low - 2 * far.diagonal).all(), layer.name
        assert (layer.points < high + 2 * far.diagonal).all(), layer.name
    np.testing.assert_array_equal(result.shape.points[: len(far.points)], far.points)


def test_every_place_in_values_is_moved():
    shape = on_a_grid(medialis.organic_shape(60))
    far = medialis.make_shape(shape.points + FAR, shape.faces)
    spots = medialis.run("thickness", far).values["spots"]
    bones = medialis.run("armature", far).values["bone_table"]
    places = [spot["position"] for spot in spots] + [bone["head"] for bone in bones]
    low, high = far.bounds
    assert ((np.array(places) >= low) & (np.array(places) <= high)).all()


def test_near_shapes_are_not_moved():
    assert not offset_of(medialis.organic_shape(60)).any()


def test_a_vertex_turned_inside_out_far_away_ends(monkeypatch):
    """Balls shrank for ever: their smallest change was below the rounding of the coordinates."""
    sphere = forms.sphere(400).shape if hasattr(forms, "sphere") else medialis.organic_shape(60)
    points = np.array(sphere.points)
    points[7] *= -0.5
    for away in (0.0, 3e6, 1e9):
        shape = medialis.make_shape(points + np.array([away, 0, away]), sphere.faces)
        cloud = medialis.surface_skeleton(shape, refine=0.0, denoise="off")
        assert len(cloud) == len(points)
