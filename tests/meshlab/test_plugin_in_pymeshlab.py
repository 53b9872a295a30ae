"""The plugin built for MeshLab 2025.07, double precision, and run by `pymeshlab.load_plugin`.

In a process of its own: a plugin cannot be unloaded, and other tests look at the list of filters.
"""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import medialis
from medialis.formats.ply_attributes import write_ply
from medialis.hosts import menu_entries, shown
from real_meshlab import PROJECT, build_plugin, medialis_program

SCRIPT = """
import json, sys
import numpy as np
import pymeshlab
plugin, shape, out = sys.argv[1:]
pymeshlab.load_plugin(plugin)
found = {"filters": [f for f in pymeshlab.filter_list()]}
ms = pymeshlab.MeshSet()
ms.load_new_mesh(shape)
ALL = pymeshlab.PercentageValue(0)
found["values"] = ms.apply_filter("generate_surface_skeleton", auxiliary_layers=True, threshold=ALL)
found["current"] = ms.current_mesh_id()
ms.set_current_mesh(0)
found["labels"] = [mesh.label() for mesh in ms]
skeleton = ms.mesh(1)
arrays = {"points": skeleton.vertex_matrix(), "scalar": skeleton.vertex_scalar_array(),
          "colors": skeleton.vertex_color_matrix(),
          "source": skeleton.vertex_custom_scalar_attribute_array("source"),
          "normal": ms.mesh(2).vertex_custom_point_attribute_matrix("normal")}
found["visible"] = ms.is_mesh_visible(0)
found["thickness"] = ms.apply_filter("compute_scalar_by_medial_thickness_per_vertex")
arrays["thickness_diameter"] = ms.mesh(0).vertex_custom_scalar_attribute_array("wall_thickness")
again = ms.apply_filter("compute_scalar_by_medial_thickness_per_vertex", kind="radius")
arrays["thickness"] = ms.mesh(0).vertex_custom_scalar_attribute_array("wall_thickness")
arrays["thickness_scalar"] = ms.mesh(0).vertex_scalar_array()
ms.set_matrix(transformmatrix=np.array([[0., -2, 0, 5], [2, 0, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]),
              freeze=False)
ms.apply_filter("generate_curve_skeleton", solid=True, hide_source=True)
found["solid"] = [ms.current_mesh().face_number(), ms.current_mesh().edge_number()]
found["hidden"] = not ms.is_mesh_visible(0)
ms.set_current_mesh(0)
arrays["quality_after"] = ms.mesh(0).vertex_scalar_array()
arrays["branch"] = ms.mesh(0).vertex_custom_scalar_attribute_array("branch")
ms.apply_filter("generate_curve_skeleton")
found["edges"] = [ms.current_mesh().face_number(), ms.current_mesh().edge_number()]
ms.set_current_mesh(0)
found["thin"] = ms.apply_filter("compute_selection_by_medial_thickness_per_vertex",
                                threshold=pymeshlab.PercentageValue(5))["selected"]
arrays["thin"] = ms.mesh(0).vertex_selection_array()
ms.compute_selection_by_condition_per_vertex(condselect="(vi==7 || vi==900)")
found["path"] = ms.apply_filter("generate_geodesic_path", use_selection=True)["length"]
ms.set_current_mesh(0)
ms.set_selection_none()
ms.apply_filter("generate_surface_skeleton", threshold=ALL)
arrays["moved"] = ms.mesh(ms.mesh_number() - 1).vertex_matrix()
ms.create_sphere(subdiv=3)  # a layer of no file
found["unsaved"] = ms.apply_filter("generate_surface_skeleton", refine=pymeshlab.PercentageValue(0))
ms.create_cube()
empty = ms.current_mesh_id()
ms.set_selection_all()
ms.meshing_remove_selected_vertices()
count = ms.mesh_number()
errors = []
for layer in (0, empty):
    ms.set_current_mesh(layer)
    try:
        ms.apply_filter("generate_surface_skeleton", tolerance=pymeshlab.PercentageValue(50))
    except pymeshlab.PyMeshLabException as error:
        errors.append(str(error))
found["errors"], found["added"] = errors, ms.mesh_number() - count
np.savez(out, **arrays)
print("FOUND", json.dumps(found))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    spec = importlib.util.find_spec("pymeshlab")
    if spec is None:
        pytest.skip("needs pymeshlab")
    libraries = Path(spec.origin).parent / "lib"
    if not (libraries / "libmeshlab-common.so").exists():
        pytest.skip("needs a pymeshlab for Linux")
    plugin = build_plugin(libraries, "2025.07d")
    folder = tmp_path_factory.mktemp("pymeshlab")
    (folder / "tmp").mkdir()
    shape = medialis.organic_shape(56)
    path, out = folder / "Käfer mit Leerzeichen.ply", folder / "out.npz"
    write_ply(path, shape.points, faces=shape.faces)
    environment = {
        **os.environ,
        "MEDIALIS_PROGRAM": str(medialis_program(folder)),
        "TMPDIR": str(folder / "tmp"),
    }
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, plugin, path, out],
        env=environment, capture_output=True, text=True, cwd=PROJECT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert not any((folder / "tmp").iterdir())
    found = json.loads(done.stdout.split("FOUND ")[1])
    return medialis.read_shape(path), found, dict(np.load(out))


def test_every_filter_is_there_under_its_name(run):
    assert {entry["name"] for entry in menu_entries()} <= set(run[1]["filters"])


def test_layers_hold_bitwise_the_arrays_of_the_core(run):
    shape, found, arrays = run
    result = medialis.run("surface_skeleton", shape, threshold=0.0)
    skeleton, samples = result.layers
    assert found["current"] == 1  # as after a filter of pymeshlab that makes a layer
    assert found["labels"][1:] == ["surface_skeleton", "samples"]
    np.testing.assert_array_equal(arrays["points"], skeleton.points)
    np.testing.assert_array_equal(arrays["scalar"], shown(skeleton).finite)
    np.testing.assert_array_equal(arrays["source"], skeleton.attributes["source"])
    np.testing.assert_array_equal(arrays["normal"], samples.attributes["normal"])
    assert np.ptp(arrays["colors"][:, :3]) > 0.5
    for name, value in found["values"].items():
        assert value == result.values[name]


def test_fields_lie_on_the_given_layer_and_a_second_run_replaces_them(run):
    shape, _, arrays = run
    layer = medialis.run("thickness", shape, kind="radius").layers[0]
    np.testing.assert_array_equal(arrays["thickness"], layer.attributes["wall_thickness"])
    np.testing.assert_array_equal(arrays["thickness_scalar"], layer.attributes["wall_thickness"])


def test_the_transform_of_a_layer_is_respected(run):
    """New layers lie on the shape as it is shown: here turned, twice as large and moved."""
    shape, _, arrays = run
    x, y, z = shape.points.T
    moved = medialis.make_shape(np.stack([5 - 2 * y, 2 * x, 2 * z], 1), shape.faces, repair=True)
    expected = medialis.run("surface_skeleton", moved, threshold=0.0).layers[0].points
    np.testing.assert_allclose(arrays["moved"], expected, rtol=0, atol=1e-9)


def test_errors_are_our_sentences_and_add_nothing(run):
    _, found, _ = run
    assert "Tolerance must be 0 % to 10 % of the diagonal (0 to " in found["errors"][0]
    assert "got 50 % (" in found["errors"][0]
    assert "has no points: choose another layer." in found["errors"][1]
    assert found["added"] == 0


def test_a_layer_that_was_never_saved_can_be_used(run):
    """The balls of a sphere of radius 1, as MeshLab makes it, end near its center."""
    assert run[1]["unsaved"]["radius_median"] == pytest.approx(1.0, rel=0.01)


def test_a_generated_layer_leaves_the_quality_of_the_given_one(run):
    """A curve skeleton adds its fields as attributes; scalar and colour stay the thickness."""
    _, _, arrays = run
    np.testing.assert_array_equal(arrays["quality_after"], arrays["thickness_scalar"])
    assert arrays["branch"].max() >= 1


def test_tubes_and_hiding_are_off_in_scripts_and_work_on_request(run):
    found = run[1]
    assert found["visible"] and found["hidden"]
    assert found["solid"][0] > 0 and found["solid"][1] == 0
    assert found["edges"][0] == 0 and found["edges"][1] > 0


def test_vertices_below_a_thickness_are_selected(run):
    """The shape is turned and twice as large there, so the share of its size is the same."""
    shape, found, arrays = run
    below = arrays["thickness_diameter"] < 0.05 * shape.diagonal
    assert found["thin"] == arrays["thin"].sum() == below.sum() > 0
    np.testing.assert_array_equal(arrays["thin"], below)


def test_the_geodesic_between_the_selected_vertices(run):
    shape, found, _ = run
    expected = medialis.run("geodesic_path", shape, start=7, end=900).values["length"]
    assert found["path"] == pytest.approx(2 * expected, rel=1e-9)
