"""Points and parts far from the rest are announced, in any unit; ordinary shapes are not."""

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.shape.shape import FAR, far_points


def joined(*shapes):
    """One mesh of several."""
    counts = np.cumsum([0, *(shape.point_count for shape in shapes[:-1])])
    return medialis.make_shape(
        np.concatenate([shape.points for shape in shapes]),
        np.concatenate([shape.faces + first for shape, first in zip(shapes, counts, strict=True)]),
    )


def moved(shape, step, size=1.0):
    return medialis.make_shape(size * shape.points + np.asarray(step), shape.faces)


@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e20])
def test_a_stray_point_of_a_cloud_and_a_stray_triangle(unit):
    ball = forms.icosphere(2)
    cloud = medialis.Shape(
        unit * np.vstack([ball.points, [1e6, 0, 0]]), np.zeros((ball.point_count + 1, 3))
    )
    told = far_points(cloud)
    assert told.code == "far_points"
    assert told.data["points"] == 1 and told.data["of"] == ball.point_count + 1
    assert f"{1e6 * unit:.6g}, 0, 0" in told
    triangle = medialis.make_shape(np.eye(3) * 0.01, [[0, 1, 2]])
    mesh = joined(moved(ball, 0, unit), moved(triangle, [0, 1e6 * unit, 0], unit))
    told = far_points(mesh)
    assert told.data["points"] == 3 and told.data["of"] == mesh.point_count


def test_equal_parts_far_apart_and_at_an_ordinary_distance():
    ball = forms.icosphere(1)
    size = ball.diagonal
    told = far_points(joined(ball, moved(ball, [2 * FAR * size, 0, 0])))
    assert told.code == "far_parts" and told.data["parts"] == 2
    assert far_points(joined(ball, moved(ball, [FAR / 2 * size, 0, 0]))) is None


@pytest.mark.parametrize("size", [(1, 1, 1), (1e6, 1, 1), (1, 1, 1e-6)])
def test_long_and_flat_shapes_are_no_strays(size):
    assert far_points(forms.box_mesh(size, 0.3e6 if max(size) > 1 else 0.3)) is None
    assert far_points(medialis.organic_shape(56)) is None


def test_reading_tells_it_and_building_without_repair_does_not():
    ball = forms.icosphere(1)
    points = np.vstack([ball.points, ball.points[:3] + 1e5])
    faces = np.vstack([ball.faces, [[ball.point_count + i for i in range(3)]]])
    for repair in (True, False):
        progress = medialis.Progress()
        medialis.make_shape(points, faces, repair=repair, progress=progress)
        assert ("far_points" in [told.code for told in progress.messages]) == repair
