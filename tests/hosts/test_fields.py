"""Fields and rigs on the rows that a host gave."""

import numpy as np
import pytest

import medialis
from medialis.hosts import Layer, on_input, rig_of
from shapes_to_repair import damaged


def test_fields_come_back_on_the_rows_of_the_input():
    points, faces = damaged()
    shape = medialis.make_shape(points, faces, repair=True)
    assert shape.point_count < len(points) and shape.face_count < len(faces)
    layer = Layer(
        "field",
        shape.points,
        shape.faces,
        attributes={
            "x": shape.points[:, 0],
            "row": np.arange(shape.point_count, dtype=np.int32),
            "byte": np.ones(shape.point_count, np.uint8),
            "flag": np.ones(shape.point_count, bool),
        },
        face_attributes={"side": np.arange(shape.face_count, dtype=np.int32)},
        on_input=True,
    )
    found = on_input(layer, shape)
    values, on_faces = found.attributes, found.face_attributes
    kept = shape.vertex_map >= 0
    assert not kept.all() and len(values["x"]) == len(points)
    np.testing.assert_array_equal(values["x"][kept], points[kept, 0])
    assert np.isnan(values["x"][~kept]).all()
    for name in ("row", "byte", "flag"):
        assert (values[name][~kept] == -1).all() and (values[name][kept] >= 0).all()
    assert values["row"].dtype == np.int32 and values["byte"].dtype == np.int64
    assert len(on_faces["side"]) == len(faces)
    np.testing.assert_array_equal(on_faces["side"][shape.face_map], layer.face_attributes["side"])
    dropped = np.setdiff1d(np.arange(len(faces)), shape.face_map)
    assert len(dropped) and (on_faces["side"][dropped] == -1).all()


def test_a_polygon_has_the_value_of_its_first_triangle():
    shape = medialis.organic_shape(56)
    side = np.arange(shape.face_count, dtype=np.int32)
    layer = Layer("x", shape.points, shape.faces, face_attributes={"side": side}, on_input=True)
    polygons = np.maximum(np.arange(shape.face_count) - 1, 0)  # the first two triangles are one
    count = shape.face_count + 4  # and the last five polygons have none
    found = on_input(layer, shape, polygons=polygons, polygon_count=count).face_attributes["side"]
    assert len(found) == count and found[:3].tolist() == [0, 2, 3]
    assert (found[polygons[-1] + 1 :] == -1).all()


def test_a_layer_of_other_rows_is_refused():
    shape = medialis.organic_shape(56)
    with pytest.raises(medialis.InvalidShapeError, match="has 3 points and 0 faces, the shape"):
        on_input(Layer("x", np.eye(3), on_input=True), shape)


@pytest.mark.slow
def test_a_rig_is_found_by_the_roles_of_its_layers():
    points, faces = damaged()
    shape = medialis.make_shape(points, faces, repair=True)
    result = medialis.run("armature", shape)
    rig = rig_of(result, shape)
    assert rig.bones is result.extras["bones"]
    assert (rig.layer.name, rig.skin_layer.name) == ("armature", "skin")
    kept = shape.vertex_map >= 0
    assert rig.weights.weights.shape == (len(points), 4)
    assert (rig.weights.bones[~kept] == -1).all() and (rig.weights.weights[~kept] == 0).all()
    np.testing.assert_array_equal(
        rig.weights.weights[kept], result.extras["skin"].weights[shape.vertex_map[kept]]
    )
    assert rig_of(medialis.run("thickness", shape), shape) is None
