"""Every registered operation through pymeshlab on a real shape: the core's arrays, unchanged."""

import numpy as np
import pytest

import medialis
from medialis.hosts import hidden_apart, shown
from medialis.operations.registry import OPERATIONS

pymeshlab = pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")
import medialis_meshlab  # noqa: E402, F401 - adds the filters

ALL = pymeshlab.PercentageValue(0)
GIVEN = {"geodesic_path": {"start": 5, "end": 4000}}


def vertex_array(mesh, name, like):
    if np.ndim(like) == 1:
        return mesh.vertex_custom_scalar_attribute_array(name)
    return mesh.vertex_custom_point_attribute_matrix(name)


@pytest.mark.slow
@pytest.mark.parametrize("chosen", OPERATIONS, ids=lambda o: o.name)
def test_every_operation_gives_the_arrays_of_the_core(chosen, real_shapes):
    """The second of three layers is the input; the others, and the mesh itself, do not change."""
    file = real_shapes / ("hand.ply" if chosen.sample == "creature" else "fertility.ply")
    given = GIVEN.get(chosen.name, {})
    expected = medialis.run(chosen.name, medialis.read_shape(file), **given)
    ms = pymeshlab.MeshSet()
    ms.create_cube()
    ms.load_new_mesh(str(file))
    ms.create_sphere()
    ms.set_current_mesh(1)
    points, faces = ms.current_mesh().vertex_matrix(), ms.current_mesh().face_matrix()
    result = getattr(ms, chosen.filter_name)(**given, auxiliary_layers=True)

    mesh = ms.mesh(1)
    assert (mesh.vertex_matrix() == points).all() and (mesh.face_matrix() == faces).all()
    assert {key: result[key] for key in expected.values} == dict(expected.values)
    assert result["messages"] == list(expected.messages)
    assert list(result["images"]) == list(expected.images)
    for name, image in expected.images.items():
        assert (result["images"][name] == image).all()
    layers = [part for layer in expected.layers for part in hidden_apart(layer)]
    new = [layer for layer in layers if not layer.on_input]
    assert list(result["layers"]) == [layer.name for layer in new]
    assert ms.mesh_number() == 3 + len(new)
    first = result["layers"].get(new[0].name) if new else 1
    assert ms.current_mesh_id() == (first if chosen.filter_name.startswith("generate_") else 1)
    for layer in layers:
        made = mesh if layer.on_input else ms.mesh(result["layers"][layer.name])
        for name, values in layer.attributes.items():
            assert (vertex_array(made, name, values) == values).all()
        if layer.on_input:
            assert {*layer.attributes} <= {*result["attributes"]}
            continue
        assert made.label() == layer.name and (made.vertex_matrix() == layer.points).all()
        if layer.faces is not None:
            assert (made.face_matrix() == layer.faces).all()
        if layer.edges is not None:
            assert (made.edge_matrix() == layer.edges).all()
    assert [ms.mesh(i).vertex_number() for i in (0, 2)] == [8, 642]


@pytest.mark.slow
def test_auxiliary_layers_come_on_request_only(mesh_set, creature):
    assert list(mesh_set.generate_surface_skeleton(threshold=ALL)["layers"]) == ["surface_skeleton"]
    mesh_set.set_current_mesh(0)
    result = mesh_set.generate_surface_skeleton(threshold=ALL, auxiliary_layers=True)
    assert list(result["layers"]) == ["surface_skeleton", "samples"]
    samples = mesh_set.mesh(result["layers"]["samples"])
    expected = medialis.run("surface_skeleton", creature)
    assert samples.label() == "samples"
    assert (samples.face_matrix() == expected.layers[1].faces).all()
    normals = samples.vertex_custom_point_attribute_matrix("normal")
    assert (normals == expected.layers[1].attributes["normal"]).all()


@pytest.mark.slow
def test_hidden_points_are_an_invisible_layer(mesh_set, creature):
    """All points are there, in the colours of the whole; the current mesh is what is shown."""
    expected = medialis.run("surface_skeleton", creature).layers[0]
    layers = mesh_set.generate_surface_skeleton()["layers"]
    assert list(layers) == ["surface_skeleton", "surface_skeleton_hidden"]
    assert mesh_set.current_mesh_id() == layers["surface_skeleton"]
    parts = [mesh_set.mesh(number) for number in layers.values()]
    assert [part.is_visible() for part in parts] == [True, False]
    colors = shown(expected).rgba_bytes
    for part, rows in zip(parts, (~expected.hidden, expected.hidden), strict=True):
        assert (part.vertex_matrix() == expected.points[rows]).all()
        importance = part.vertex_custom_scalar_attribute_array("importance")
        assert (importance == expected.attributes["importance"][rows]).all()
        assert (np.rint(255 * part.vertex_color_matrix()) == colors[rows]).all()


def test_pictures_are_returned_and_nothing_is_added(mesh_set):
    result = mesh_set.get_medial_reconstruction_image(size=64)
    assert result["images"]["reconstruction"].dtype == np.uint8
    assert mesh_set.mesh_number() == 1 and result["layers"] == {}


@pytest.mark.slow
def test_thickness_becomes_attribute_quality_and_colour(mesh_set, creature):
    result = mesh_set.compute_scalar_by_medial_thickness_per_vertex()
    expected = medialis.run("thickness", creature)
    layer, mesh = expected.layers[0], mesh_set.mesh(0)
    thickness = layer.attributes["wall_thickness"]
    names = "thickness", "wall_thickness", "thin_spot"
    assert result["attributes"] == {name: name for name in names}
    assert (mesh.vertex_scalar_array() == thickness).all()
    colors = medialis_colors(thickness, layer)
    # The straight pieces of the expression are within one step of the map, rounding adds half.
    assert np.abs(255 * mesh.vertex_color_matrix()[:, :3] - 255 * colors).max() <= 1.5


def medialis_colors(values, layer):
    from medialis.show.colors import map_colors

    return map_colors(values, layer.color_map, *layer.color_limits)


def test_a_point_cloud_layer(creature):
    """With its own normals, and without, which are then estimated."""
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(creature.points, v_normals_matrix=creature.normals), "cloud")
    assert ms.current_mesh().is_point_cloud()
    result = ms.generate_surface_skeleton()
    expected = medialis.run(
        "surface_skeleton", medialis.make_shape(creature.points, None, creature.normals)
    )
    made = ms.mesh(result["layers"]["surface_skeleton"])
    assert (made.vertex_matrix() == expected.layers[0].points).all()
    ms.set_current_mesh(0)
    samples = ms.mesh(ms.generate_surface_skeleton(auxiliary_layers=True)["layers"]["samples"])
    assert (samples.vertex_normal_matrix() == expected.shape.normals).all()
    ms.add_mesh(pymeshlab.Mesh(creature.points), "bare")
    result = ms.generate_surface_skeleton()
    assert any("estimated" in message for message in result["messages"])


@pytest.mark.slow
def test_layers_are_measured_where_they_are_shown(mesh_set, creature):
    """The transform of a layer counts: twice as large is twice as thick; results lie beside it."""
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    matrix[:3, 3] = 10, -20, 5
    mesh_set.set_matrix(transformmatrix=matrix, freeze=False)
    world = creature.points @ matrix[:3, :3].T + matrix[:3, 3]
    shown = mesh_set.current_mesh().transformed_vertex_matrix()
    assert np.allclose(shown, world, rtol=0, atol=1e-13)
    expected = medialis.run("thickness", medialis.make_shape(shown, creature.faces, repair=True))
    mesh_set.compute_scalar_by_medial_thickness_per_vertex()
    mesh = mesh_set.mesh(0)
    thickness = mesh.vertex_custom_scalar_attribute_array("thickness")
    assert (thickness == expected.layers[0].attributes["thickness"]).all()
    assert (mesh.transform_matrix() == matrix).all()
    assert (mesh.vertex_matrix() == creature.points).all()
    result = mesh_set.generate_surface_skeleton(threshold=ALL)
    made = mesh_set.mesh(result["layers"]["surface_skeleton"])
    assert (made.transform_matrix() == np.eye(4)).all()
    expected = medialis.run(
        "surface_skeleton", medialis.make_shape(shown, creature.faces, repair=True)
    )
    assert (made.vertex_matrix() == expected.layers[0].points).all()
    # And for a cloud whose normals must turn with it.
    turn = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    mesh_set.add_mesh(pymeshlab.Mesh(creature.points, v_normals_matrix=creature.normals), "c")
    mesh_set.set_matrix(transformmatrix=turn, freeze=False)
    made = mesh_set.mesh(mesh_set.generate_surface_skeleton()["layers"]["surface_skeleton"])
    plain = medialis.run("surface_skeleton", medialis.Shape(creature.points, creature.normals))
    there = plain.layers[0].points @ turn[:3, :3].T
    assert np.allclose(made.vertex_matrix(), there, rtol=0, atol=1e-9)


def test_the_filters_of_pymeshlab_still_work(mesh_set):
    assert mesh_set.get_geometric_measures()["surface_area"] > 0
    assert "threshold" in mesh_set.filter_parameter_values("meshing_merge_close_vertices")
    mesh_set.apply_filter("meshing_merge_close_vertices", threshold=pymeshlab.PureValue(0))
    with pytest.raises(pymeshlab.PyMeshLabException, match="Filter does not exists"):
        mesh_set.apply_filter("generate_nothing")
    with pytest.raises(TypeError, match="incompatible function arguments"):
        mesh_set.apply_filter(3)
