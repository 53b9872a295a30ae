"""Layers of every kind, made by hand, as they arrive in a MeshSet; and nothing when one fails."""

import signal
import time

import numpy as np
import pytest

import medialis
from medialis.base.threads import run_chunks
from medialis.operations.positions import numbers
from medialis.operations.result import Layer
from medialis.show.colors import label_colors, map_colors

pymeshlab = pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")
import medialis_meshset.filters as filters  # noqa: E402

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0], [1, 1, 1]])
FACES = np.array([[0, 1, 2], [0, 2, 3], [1, 2, 4]])
LABELS = np.array([0, 1, -1, 50, 2], np.int32)


def stored(ms, name):
    """Scalar attribute of the vertices of the current mesh."""
    return ms.current_mesh().vertex_custom_scalar_attribute_array(name)


def same_colors(found, expected):
    """8 bits a channel: exactly the nearest."""
    return (np.rint(255 * found[:, :3]) == np.rint(255 * np.asarray(expected))).all()


def test_points_with_attributes_of_every_type(mesh_set, register):
    attributes = {
        "value": np.array([0.1, np.nan, np.inf, -np.inf, 1 / 3]),
        "label": LABELS,
        "source": np.arange(5, dtype=np.int64),
        "flag": np.array([True, False, True, True, False]),
        "single": np.float32([0.1, 0.2, 0.3, 0.4, 0.5]),
        "direction": numbers(POINTS),
        "pair": np.arange(10).reshape(5, 2),
    }
    register(Layer("made here", POINTS, attributes=attributes, color_by="value"))
    result = mesh_set.generate_made()
    mesh = mesh_set.current_mesh()
    assert mesh.id() == result["layers"]["made here"] == 1 and mesh.label() == "made here"
    assert mesh.is_point_cloud() and (mesh.vertex_matrix() == POINTS).all()
    for name in ("value", "label", "source", "flag", "single"):
        assert np.array_equal(stored(mesh_set, name), attributes[name], equal_nan=True)
    assert (mesh.vertex_custom_point_attribute_matrix("direction") == POINTS).all()
    assert (stored(mesh_set, "pair_1") == [1, 3, 5, 7, 9]).all()
    assert result["count"] == 1 and result["messages"] == ["Made by hand."]


def test_quality_is_finite_because_meshlab_crashes_on_nan(mesh_set, register):
    """pymeshlab 2025.7: get_scalar_statistics_per_vertex aborts the process on a NaN quality."""
    values = np.array([0.5, np.nan, np.inf, -np.inf, 2.0])
    register(Layer("made", POINTS, attributes={"value": values}, color_by="value"))
    mesh_set.generate_made()
    assert mesh_set.current_mesh().vertex_scalar_array().tolist() == [0.5, 0.5, 2, 0.5, 2]
    statistics = mesh_set.get_scalar_statistics_per_vertex()
    assert (statistics["min"], statistics["max"]) == (0.5, 2.0)
    expected = map_colors(values)
    assert same_colors(mesh_set.current_mesh().vertex_color_matrix(), expected)
    register(
        Layer("none", POINTS, attributes={"value": np.full(5, np.nan)}, color_by="value"),
        name="generate_none",
    )
    mesh_set.set_current_mesh(0)
    mesh_set.generate_none()
    assert np.isfinite(mesh_set.current_mesh().vertex_scalar_array()).all()


def test_curves_are_edge_meshes(mesh_set, register):
    """With radius, colours and limits; expressions over their attributes work."""
    edges = np.array([[0, 1], [1, 2], [2, 3]], np.int32)
    radius = np.array([0.5, 0.25, 0.125, 0.1, 0.3])
    register(
        Layer(
            "curve",
            POINTS,
            edges=edges,
            attributes={"radius": radius, "feature": numbers(POINTS)},
            color_by="radius",
            color_map="diverging",
            color_limits=(0.2, 0.4),
        )
    )
    mesh_set.generate_made()
    mesh = mesh_set.current_mesh()
    assert (mesh.edge_matrix() == edges).all() and mesh.face_number() == 0
    assert (mesh.vertex_scalar_array() == radius).all()
    assert same_colors(mesh.vertex_color_matrix(), map_colors(radius, "diverging", 0.2, 0.4))
    mesh_set.compute_scalar_by_function_per_vertex(q="radius*2")
    assert (mesh.vertex_scalar_array() == 2 * radius).all()


def test_surfaces_with_labels_of_faces(mesh_set, register):
    part = np.array([1, -1, 0], np.int32)
    register(
        Layer(
            "parts",
            POINTS,
            FACES,
            attributes={"height": POINTS[:, 2]},
            face_attributes={
                "part": part,
                "axis": numbers(np.eye(3)),
                "share": np.array([0.5, 1, np.nan]),
            },
            color_by="part",
            labels=("part",),
        )
    )
    mesh_set.generate_made()
    mesh = mesh_set.current_mesh()
    assert (mesh.face_matrix() == FACES).all()
    assert (mesh.face_custom_scalar_attribute_array("part") == part).all()
    assert (mesh.face_custom_point_attribute_matrix("axis") == np.eye(3)).all()
    assert (mesh.face_scalar_array() == part).all() and (stored(mesh_set, "height")[3:] == 1).all()
    assert same_colors(mesh.face_color_matrix(), label_colors(part))
    mesh_set.compute_scalar_by_function_per_face(q="part+1")
    assert (mesh.face_scalar_array() == part + 1).all()


def test_labels_of_points_have_the_colours_of_labels(mesh_set, register):
    register(
        Layer("made", POINTS, attributes={"l": LABELS}, color_by="l", labels=("l",)),
    )
    mesh_set.generate_made()
    assert same_colors(mesh_set.current_mesh().vertex_color_matrix(), label_colors(LABELS))
    assert (mesh_set.current_mesh().vertex_scalar_array() == LABELS).all()


def test_names_that_meshlab_cannot_hold(mesh_set, register):
    """Taken in another case of letters, no word: still there, under a name near it."""
    attributes = {
        "Radius": np.zeros(5),
        "radius": np.ones(5),
        "spoke angle (°)": np.arange(5.0),
        "2nd": numbers(POINTS),
    }
    register(Layer("Größe 形", POINTS, attributes=attributes, color_by="spoke angle (°)"))
    result = mesh_set.generate_made()
    assert result["layers"] == {"Größe 形": 1} and mesh_set.mesh(0).label() == "Größe 形"
    assert mesh_set.current_mesh().label() == "Größe 形(1)"  # MeshLab tells them apart
    assert (stored(mesh_set, "Radius") == 0).all() and (stored(mesh_set, "radius_2") == 1).all()
    assert (stored(mesh_set, "spoke_angle____") == np.arange(5)).all()
    assert (mesh_set.current_mesh().vertex_custom_point_attribute_matrix("_2nd") == POINTS).all()


def test_current_mesh_afterwards(mesh_set, register):
    """A generate_ filter selects its first new layer, others leave the current one."""
    layers = (
        Layer("first", POINTS),
        Layer("second", POINTS),
        Layer("third", POINTS, auxiliary=True),
    )
    register(*layers)
    register(*layers, name="compute_made")
    result = mesh_set.generate_made()
    assert result["layers"] == {"first": 1, "second": 2} and mesh_set.current_mesh_id() == 1
    mesh_set.set_current_mesh(0)
    result = mesh_set.compute_made(auxiliary_layers=True)
    assert result["layers"] == {"first": 3, "second": 4, "third": 5}
    assert mesh_set.current_mesh_id() == 0


def test_layers_beside_pictures_come_on_request(mesh_set, register):
    image = np.zeros((4, 5, 3), np.uint8)
    register(Layer("made", POINTS), images={"view": image})
    result = mesh_set.generate_made()
    assert result["layers"] == {} and result["images"]["view"] is image
    assert mesh_set.mesh_number() == 1 and mesh_set.current_mesh_id() == 0
    assert mesh_set.generate_made(auxiliary_layers=True)["layers"] == {"made": 1}


def state(ms):
    """All that a failing filter could have changed."""
    return [
        (m.id(), m.label(), m.vertex_number(), m.vertex_scalar_array().tolist()) for m in ms
    ] + [ms.current_mesh_id(), sorted(ms.filter_parameter_values("ply"))]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, MemoryError])
def test_nothing_is_added_when_a_later_layer_fails(mesh_set, register, monkeypatch, error):
    register(Layer("first", POINTS), Layer("second", POINTS, attributes={"a": POINTS[:, 0]}))
    before = state(mesh_set)

    def fail(*_):
        raise error

    monkeypatch.setattr("medialis_meshset.layers.add_vertex_attribute", fail)
    with pytest.raises(error):
        mesh_set.generate_made()
    assert state(mesh_set) == before


def test_nothing_is_added_when_the_operation_fails(mesh_set, register):
    def run(shape, values, progress):
        raise medialis.InvalidShapeError("It is no good.")

    register(run=run)
    before = state(mesh_set)
    with pytest.raises(pymeshlab.PyMeshLabException) as caught:
        mesh_set.generate_made()
    assert str(caught.value) == "Failed to apply filter: generate_made\nDetails: It is no good."
    assert state(mesh_set) == before


def test_nothing_is_added_when_writing_on_the_input_fails(mesh_set, register, monkeypatch):
    register(Layer("first", POINTS), lambda shape: Layer("on", shape.points, on_input=True))
    before = state(mesh_set)

    def fail(*_):
        raise RuntimeError

    monkeypatch.setattr("medialis_meshset.filters.write_on_current", fail)
    with pytest.raises(RuntimeError):
        mesh_set.generate_made()
    assert state(mesh_set) == before


def test_a_layer_that_is_not_on_the_input_is_refused(mesh_set, register):
    register(Layer("on", POINTS, attributes={"a": POINTS[:, 0]}, on_input=True))
    with pytest.raises(pymeshlab.PyMeshLabException, match="it does not lie on it"):
        mesh_set.compute_made()
    assert mesh_set.mesh_number() == 1


def test_interrupt_while_computing(mesh_set, register):
    """Ctrl-C in a chunk of a kernel loop: the KeyboardInterrupt comes out, nothing has changed."""

    def work(begin, end):
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.001)  # else one thread can be through before the main thread's turn

    def run(shape, values, progress):
        run_chunks(work, 100, 1, progress=progress)
        pytest.fail("was not interrupted")

    register(run=run)
    before = state(mesh_set)
    with pytest.raises(KeyboardInterrupt):
        mesh_set.generate_made()
    assert state(mesh_set) == before
    mesh_set.generate_surface_skeleton()  # and all works as before


def test_interrupt_between_layers_takes_them_back(mesh_set, register, monkeypatch):
    """Ctrl-C while the first of two layers is added, and while the input is written."""
    register(
        Layer("first", POINTS),
        Layer("second", POINTS),
        lambda s: Layer("on", s.points, attributes={"z": s.points[:, 2]}, on_input=True),
    )
    before = state(mesh_set)
    real = filters.add_layer, filters.write_on_current

    def interrupted(function):
        def call(*arguments):
            found = function(*arguments)
            signal.raise_signal(signal.SIGINT)
            return found

        return call

    monkeypatch.setattr(filters, "add_layer", interrupted(real[0]))
    with pytest.raises(KeyboardInterrupt):
        mesh_set.generate_made()
    assert state(mesh_set) == before
    monkeypatch.setattr(filters, "add_layer", real[0])
    monkeypatch.setattr(filters, "write_on_current", interrupted(real[1]))
    with pytest.raises(KeyboardInterrupt):
        mesh_set.generate_made()
    # Attributes cannot be taken away again, so the filter is completed first.
    assert [mesh.label() for mesh in mesh_set] == [before[0][1], "first", "second"]
    assert mesh_set.current_mesh().label() == "first"
    mesh_set.set_current_mesh(0)
    assert (stored(mesh_set, "z") == mesh_set.mesh(0).vertex_matrix()[:, 2]).all()
