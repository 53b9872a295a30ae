"""Operations as the entries of a host's menu, and the layers that such a host adds."""

import numpy as np
import pytest
import trimesh

import medialis
from medialis.hosts import SELECTED, filters, host_layers, menu_entries, solid
from medialis.operations.registry import OPERATIONS
from medialis.operations.result import Layer


@pytest.fixture(scope="module")
def creature():
    return medialis.organic_shape(56)


def named(name):
    return next(f for f in filters() if f.name == name)


def test_every_operation_is_an_entry_and_its_parameters_are_the_dialog():
    entries = {entry["name"]: entry for entry in menu_entries()}
    for chosen in OPERATIONS:
        assert (chosen.filter_name in entries) is not chosen.makes_images
        if chosen.makes_images:
            continue
        entry = entries[chosen.filter_name]
        assert entry["command"] == chosen.name.replace("_", "-")
        rows = [(p["name"], p["kind"], p["default"]) for p in entry["parameters"]]
        kinds = ["text" if p.auto is not None else p.kind.value for p in chosen.parameters]
        known = zip(chosen.parameters, kinds, strict=True)
        assert rows == [(p.name, kind, p.default) for p, kind in known]
        for row in entry["parameters"]:
            assert row["label"].endswith(" (degrees)") == (row["kind"] == "angle")


def test_each_title_says_medial_once_and_names_begin_as_in_meshlab():
    for entry in filters():
        assert entry.title.split().count("Medial") == 1
        assert entry.name.split("_")[0] in ("generate", "compute", "get")
        family = entry.name.split("_")[:2]
        assert family[0] != "compute" or family[1] in ("scalar", "selection")


def test_help_cites_and_names_no_fraction():
    for entry in filters():
        assert "Source:" not in entry.help
        assert ("PhD thesis" in entry.help) == (entry.operation.source is not None)
        for parameter in entry.parameters:
            assert "fraction of the size" not in parameter.help


@pytest.mark.slow
@pytest.mark.parametrize("entry", filters(), ids=lambda entry: entry.name)
def test_what_an_operation_declares_is_what_its_result_has(entry, small_shape, default_run):
    creature = small_shape(entry.operation.name)
    if entry.defaults:
        result = medialis.run(entry.operation.name, creature, **entry.defaults)
    else:
        result = default_run(entry.operation.name)
    own = [layer for layer in result.layers if not layer.auxiliary]
    thin = any(layer.edges is not None or layer.number_by for layer in own)
    assert thin == entry.operation.thin_lines
    assert bool(result.images) == entry.operation.makes_images
    if entry.name.startswith("compute_scalar"):
        assert own[0].on_input
    layers = host_layers(result, creature, entry, draw_solid=True)
    assert all(layer.edges is None for layer in layers)
    colored = [layer for layer in layers if layer.on_input and layer.color_by]
    assert bool(colored) == entry.name.startswith("compute_scalar")


def test_thin_vertices_are_selected_by_their_thickness(creature):
    entry = named("compute_selection_by_medial_thickness_per_vertex")
    result = medialis.run("thickness", creature, threshold=0.05)
    (layer,) = host_layers(result, creature, entry)
    thickness = result.layers[0].attributes["wall_thickness"]
    expected = thickness < 0.05 * creature.diagonal
    assert layer.role == "selection" and 0 < expected.sum() < creature.point_count
    np.testing.assert_array_equal(layer.attributes[SELECTED] == 1, expected)


def test_important_vertices_are_those_of_the_skeleton_that_is_shown(creature):
    entry = named("compute_selection_by_medial_importance_per_vertex")
    few, many = (
        host_layers(medialis.run("surface_skeleton", creature, threshold=t), creature, entry)[0]
        for t in (0.2, 0.05)
    )
    result = medialis.run("surface_skeleton", creature, threshold=0.2).layers[0]
    above = result.attributes["importance"] >= 0.2 * creature.diagonal
    expected = {int(row) for row in result.attributes["source"][above] if row < len(few.points)}
    assert set(np.flatnonzero(few.attributes[SELECTED])) == expected
    assert (few.attributes[SELECTED] <= many.attributes[SELECTED]).all()


def test_a_tube_is_closed_and_as_thick_as_its_radius():
    """A straight curve: the volume of a prism of eight sides, at the radius that is drawn."""
    points = np.stack([np.linspace(0, 2, 5), np.zeros(5), np.zeros(5)], axis=1)
    line = Layer("line", points, edges=[[i, i + 1] for i in range(4)],
                 attributes={"radius": np.full(5, 0.2)}, color_by="radius")  # fmt: skip
    tube = solid(line, diagonal=2.0)
    mesh = trimesh.Trimesh(tube.points, tube.faces, process=False)
    drawn = 0.004 * 2.0 + 0.15 * 0.2
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(2.0 * 4 * np.sin(np.pi / 4) * drawn**2, rel=1e-12)
    assert (tube.attributes["radius"] == 0.2).all()


def test_tubes_stay_round_where_a_curve_bends_back():
    """Frames turn with the curve: no ring is flat, also at a turn of a whole half circle."""
    turn = np.linspace(0, 6 * np.pi, 90)
    helix = np.stack([np.cos(turn), np.sin(turn), 0.1 * turn], axis=1)
    points = np.concatenate([helix, helix[-1:] + np.array([0, 0, 1.0]), helix[-1:]])
    edges = np.stack([np.arange(91), np.arange(1, 92)], axis=1)
    tube = solid(Layer("helix", points, edges=edges), diagonal=3.0)
    rings = tube.points[: 8 * 92].reshape(92, 8, 3)
    width = np.linalg.norm(rings - points[:, None], axis=2)
    np.testing.assert_allclose(width, 0.012, rtol=1e-9)
    assert trimesh.Trimesh(tube.points, tube.faces, process=False).is_watertight


def test_marks_become_balls_with_their_values_and_a_colour_each():
    marks = Layer("spots", np.eye(3), attributes={"value": np.arange(3.0)}, number_by="value")
    balls = solid(marks, diagonal=1.0)
    mesh = trimesh.Trimesh(balls.points, balls.faces, process=False)
    assert mesh.is_watertight and len(mesh.split()) == 3
    spot = balls.attributes["spot"]
    away = np.linalg.norm(balls.points - np.eye(3)[spot], axis=1)
    np.testing.assert_allclose(away, 0.012, rtol=1e-12)
    np.testing.assert_array_equal(balls.attributes["value"], spot)
    assert balls.color_by == "spot" and "spot" in balls.labels


def test_edges_beside_faces_become_tubes_and_the_faces_stay():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 2.0]])
    mixed = Layer("mixed", points, [[0, 1, 2]], [[3, 4]], {"radius": np.arange(5.0)},
                  face_attributes={"sheet": np.array([7])})  # fmt: skip
    made = solid(mixed, diagonal=1.0)
    np.testing.assert_array_equal(made.faces[0], [0, 1, 2])
    np.testing.assert_array_equal(made.points[:5], points)
    assert made.edges is None and len(made.face_attributes["sheet"]) == len(made.faces)
    assert set(made.attributes["radius"][5:]) == {3.0, 4.0}


def test_sheets_beside_tubes_keep_their_colours_and_numbers():
    """MeshLab showed medial meshes by the sheets of their balls, mostly grey."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 2.0]])
    attributes = {"radius": np.arange(5.0), "ball_sheet": np.array([0, 0, 0, -1, -1])}
    mixed = Layer("mixed", points, [[0, 1, 2]], [[3, 4]], attributes, color_by="radius",
                  face_attributes={"sheet": np.array([0])},
                  labels=("sheet", "ball_sheet"))  # fmt: skip
    made = solid(mixed, diagonal=1.0)
    assert made.color_by == "radius"
    assert made.face_attributes["sheet"].tolist() == [0] + [-1] * (len(made.faces) - 1)
