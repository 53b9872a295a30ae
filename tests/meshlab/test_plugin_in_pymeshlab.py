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
from medialis.files.ply_attributes import write_ply
from medialis.hosts import shown
from medialis.operations.registry import OPERATIONS
from real_meshlab import NEW_SOURCE, PROJECT, build_plugin, medialis_program

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
found["labels"] = [mesh.label() for mesh in ms]
skeleton = ms.mesh(1)
arrays = {"points": skeleton.vertex_matrix(), "scalar": skeleton.vertex_scalar_array(),
          "colors": skeleton.vertex_color_matrix(),
          "source": skeleton.vertex_custom_scalar_attribute_array("source"),
          "normal": ms.mesh(2).vertex_custom_point_attribute_matrix("normal")}
found["thickness"] = ms.apply_filter("compute_scalar_by_medial_thickness_per_vertex")
again = ms.apply_filter("compute_scalar_by_medial_thickness_per_vertex", kind="radius")
arrays["thickness"] = ms.mesh(0).vertex_custom_scalar_attribute_array("thickness")
arrays["thickness_scalar"] = ms.mesh(0).vertex_scalar_array()
ms.set_matrix(transformmatrix=np.array([[0., -2, 0, 5], [2, 0, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]),
              freeze=False)
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
    plugin = build_plugin(NEW_SOURCE, libraries, "2025.07d", "double")
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


def test_every_operation_is_a_filter_under_its_name(run):
    assert {entry.filter_name for entry in OPERATIONS} <= set(run[1]["filters"])


def test_layers_hold_bitwise_the_arrays_of_the_core(run):
    shape, found, arrays = run
    result = medialis.run("surface_skeleton", shape, threshold=0.0)
    skeleton, samples = result.layers
    assert found["current"] == 0
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
    np.testing.assert_array_equal(arrays["thickness"], layer.attributes["thickness"])
    np.testing.assert_array_equal(arrays["thickness_scalar"], layer.attributes["thickness"])


def test_the_transform_of_a_layer_is_respected(run):
    """New layers lie on the shape as it is shown: here turned, twice as large and moved."""
    _, _, arrays = run
    x, y, z = arrays["points"].T
    expected = np.stack([5 - 2 * y, 2 * x, 2 * z], axis=1)
    # The same balls up to rounding, in the same order.
    np.testing.assert_allclose(arrays["moved"], expected, rtol=0, atol=1e-9)


def test_errors_are_our_sentences_and_add_nothing(run):
    _, found, _ = run
    assert "tolerance must be a number (from 0 to 0.1), got 0.5." in found["errors"][0]
    assert "has no points: choose another layer." in found["errors"][1]
    assert found["added"] == 0


def test_a_layer_that_was_never_saved_can_be_used(run):
    """The balls of a sphere of radius 1, as MeshLab makes it, end near its center."""
    assert run[1]["unsaved"]["radius_median"] == pytest.approx(1.0, rel=0.01)
