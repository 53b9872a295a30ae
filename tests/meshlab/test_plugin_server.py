"""The plugin in the real MeshLab 2020.09: every operation, by meshlabserver."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.formats.ply_attributes import read_ply_attributes, write_ply
from medialis.hosts import filters, host_layers, shown
from plates import tee
from real_meshlab import MeshLab, filter_named, make_meshlab, x_server

pytestmark = pytest.mark.slow

FLOAT = 2e-7  # MeshLab 2020.09 holds single precision


@pytest.fixture(scope="module")
def meshlab(tmp_path_factory) -> MeshLab:
    with x_server() as display:
        yield make_meshlab(tmp_path_factory.mktemp("meshlab") / "with space ä", display)


@pytest.fixture(scope="module")
def creature(tmp_path_factory) -> Path:
    shape = medialis.organic_shape(56)
    path = tmp_path_factory.mktemp("shapes") / "Käfer mit Leerzeichen.ply"
    # As MeshLab will hold it, so that both sides compute on the same bits.
    write_ply(path, shape.points.astype(np.float32).astype(np.float64), faces=shape.faces)
    return path


def nothing_left(meshlab: MeshLab) -> bool:
    return not any((meshlab.folder / "temporary").iterdir())


IN_MENU = [entry for entry in filters() if not entry.operation.makes_images]


@pytest.mark.parametrize("entry", IN_MENU, ids=lambda entry: entry.name)
def test_every_filter_adds_its_layers(meshlab, creature, tmp_path, entry):
    """The last layer is saved with scalars and colours; without a new one it is the shape."""
    out = tmp_path / "out.ply"
    if entry.operation.sample != "creature":
        creature = tmp_path / "tee.ply"
        points, faces = tee()
        write_ply(creature, points / 64, faces)
    printed = meshlab.run([creature], entry, more=["-o", str(out), "-l", "x", "-m", "vq", "vc"])
    assert "Problem with filter" not in printed, printed
    shape = medialis.read_shape(creature)
    result = medialis.run(entry.operation.name, shape, **entry.defaults)
    layers = host_layers(result, shape, entry, draw_solid=True)
    layer = ([x for x in layers if not x.on_input and x.role != "hidden"] or layers)[-1]
    found = read_ply_attributes(out)
    np.testing.assert_allclose(found.points, layer.points, rtol=0, atol=FLOAT)
    if not layer.on_input:
        faces = 0 if layer.faces is None else len(layer.faces)
        assert (0 if found.faces is None else len(found.faces)) == faces
    if layer.color_by in layer.attributes:
        expected = np.asarray(layer.attributes[layer.color_by], np.float32)
        np.testing.assert_array_equal(found.attributes["quality"], expected)
        colors = [found.attributes[name] for name in ("red", "green", "blue", "alpha")]
        np.testing.assert_array_equal(np.stack(colors, axis=1), shown(layer).rgba_bytes)
    for name, value in ({} if entry.selects else result.values).items():
        if isinstance(value, int | float) and np.isfinite(value):
            assert f"{name}: " in printed
    assert nothing_left(meshlab)


def test_values_are_logged_and_parameters_reach_the_core(meshlab, creature, tmp_path):
    """Lengths of MeshLab are absolute, those of the core fractions; choices go by number."""
    values = {"tolerance": 0.001, "side": "both", "subsample": 0.01}
    printed = meshlab.run([creature], filter_named("surface_skeleton"), values)
    result = medialis.run("surface_skeleton", medialis.read_shape(creature), **values)
    assert f"skeleton_points: {result.values['skeleton_points']}" in printed
    for message in result.messages:
        assert message in printed


@pytest.mark.parametrize("size", [100.0, 0.3])
def test_lengths_of_a_script_are_shares_of_the_size_it_was_made_on(meshlab, creature, size):
    """5 of 100, as pymeshlab saves it, and what a script of a smaller shape holds, are 5 %."""
    entry = filter_named("compute_selection_by_medial_thickness_per_vertex")
    printed = meshlab.run([creature], entry, {"threshold": 0.05}, size=size)
    shape = medialis.read_shape(creature)
    layer = medialis.run("thickness", shape, threshold=0.05).layers[0]
    thickness = layer.attributes["wall_thickness"]
    assert f"selected: {(thickness < 0.05 * shape.diagonal).sum()}\n" in printed


def test_fields_lie_on_the_given_layer(meshlab, creature, tmp_path):
    out = tmp_path / "out.ply"
    meshlab.run(
        [creature], filter_named("thickness"), more=["-o", str(out), "-l", "c", "-m", "vq", "vc"]
    )
    layer = medialis.run("thickness", medialis.read_shape(creature)).layers[0]
    found = read_ply_attributes(out)
    assert layer.on_input and len(found.faces) == len(layer.faces)
    expected = layer.attributes["wall_thickness"].astype(np.float32)
    np.testing.assert_array_equal(found.attributes["quality"], expected)
    colors = [found.attributes[name] for name in ("red", "green", "blue", "alpha")]
    np.testing.assert_array_equal(np.stack(colors, axis=1), shown(layer).rgba_bytes)


def test_quality_is_finite_where_importance_is_not(meshlab, tmp_path):
    """Between overlapping parts importance is infinite; MeshLab's scale of quality was too."""
    ball = forms.icosphere(2)
    shape, out = tmp_path / "three.ply", tmp_path / "out.ply"
    # Each maximal ball of two that overlap touches both; the third one is apart.
    moves = np.array([[0.0, 0.0, 0.0], [0.9, 0.2, 0.1], [0.0, 5.0, 0.0]])
    points = np.vstack([ball.points + move for move in moves]).astype(np.float32)
    faces = np.vstack([ball.faces + k * ball.point_count for k in range(3)])
    write_ply(shape, points.astype(np.float64), faces=faces)
    values, more = {"connected": False}, ["-o", str(out), "-l", "x", "-m", "vq"]
    meshlab.run([shape], filter_named("skeleton_importance"), values, more=more)
    result = medialis.run("skeleton_importance", medialis.read_shape(shape), **values)
    importance = result.layers[0].attributes["importance"]
    assert np.isinf(importance).any() and np.isfinite(importance).any()
    expected = np.where(np.isinf(importance), result.values["importance_max"], importance)
    found = read_ply_attributes(out).attributes["quality"]
    np.testing.assert_array_equal(found, expected.astype(np.float32))


def test_a_point_cloud_is_computed_with_its_normals(meshlab, tmp_path):
    shape = medialis.organic_shape(56)
    names = dict(zip(("nx", "ny", "nz"), shape.normals.T.astype(np.float32), strict=True))
    cloud, out = tmp_path / "cloud.ply", tmp_path / "out.ply"
    write_ply(cloud, shape.points.astype(np.float32), attributes=names)
    meshlab.run([cloud], filter_named("surface_skeleton"), more=["-o", str(out), "-l", "x"])
    expected = medialis.run("surface_skeleton", medialis.read_shape(cloud)).layers[0]
    found = read_ply_attributes(out).points
    # Another rounding of the normals of MeshLab moves a center by its radius times that.
    assert found.shape == expected.points.shape
    assert np.median(np.linalg.norm(found - expected.points, axis=1)) < 1e-5


def test_the_current_layer_is_taken(meshlab, creature, tmp_path):
    other = medialis.organic_shape(64)
    path, out = tmp_path / "other.ply", tmp_path / "out.ply"
    write_ply(path, other.points.astype(np.float32), faces=other.faces)
    saved = ["-o", str(out), "-l", "x", "-m", "vq"]
    meshlab.run([path, creature], filter_named("surface_skeleton"), {"threshold": 0.0}, more=saved)
    expected = medialis.run("surface_skeleton", medialis.read_shape(creature)).layers[0]
    np.testing.assert_allclose(read_ply_attributes(out).points, expected.points, rtol=0, atol=FLOAT)


def failed(meshlab: MeshLab, shape: Path, out: Path, sentence: str, **more) -> None:
    """The filter fails with the sentence; no result, no child's file is left."""
    name = more.pop("name", "surface_skeleton")
    printed = meshlab.run([shape], filter_named(name), more.pop("values", None),
                          more=["-o", str(out)], **more)  # fmt: skip
    assert sentence in printed and "Problem with filter" in printed, printed
    assert not out.exists() and nothing_left(meshlab)


def test_bad_input_is_the_sentence_of_the_core(meshlab, tmp_path):
    plane = tmp_path / "fläche.ply"
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    corner = np.arange(8)[:, None] * 9 + np.arange(8)
    faces = np.stack([corner, corner + 1, corner + 10], axis=-1).reshape(-1, 3)
    write_ply(plane, points, faces=faces)
    failed(meshlab, plane, tmp_path / "out.ply", "the shape is flat")


def test_a_value_out_of_range_is_one_sentence(meshlab, creature, tmp_path):
    sentence = "tolerance must be 0 % to 10 % of the size, got 50 %"
    failed(meshlab, creature, tmp_path / "out.ply", sentence, values={"tolerance": 0.5})


def test_operations_on_faces_refuse_clouds(meshlab, tmp_path):
    cloud = tmp_path / "cloud.ply"
    write_ply(cloud, medialis.organic_shape(64).points.astype(np.float32))
    failed(meshlab, cloud, tmp_path / "out.ply", "needs a surface", name="skeleton_importance")


def test_a_missing_program_says_how_to_get_it(meshlab, creature, tmp_path):
    changed = {"MEDIALIS_PROGRAM": str(tmp_path / "none")}
    sentence = "run 'medialis meshlab-install' from the Python environment that has it"
    failed(meshlab, creature, tmp_path / "out.ply", sentence, environment=changed)
    # Neither a variable, nor a note beside the plugin, nor a program on the path.
    changed = {"MEDIALIS_PROGRAM": None, "PATH": str(tmp_path)}
    failed(meshlab, creature, tmp_path / "out.ply", sentence, environment=changed)


def test_a_python_without_medialis_says_so(meshlab, creature, tmp_path):
    python = tmp_path / "python3"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S -I "$@"\n')  # no site-packages
    python.chmod(0o755)
    changed = {"MEDIALIS_PROGRAM": str(python)}
    failed(meshlab, creature, tmp_path / "out.ply", "python3 has no medialis", environment=changed)


def test_the_note_beside_the_plugin_names_the_program(meshlab, creature, tmp_path):
    note = meshlab.folder / "plugins" / "medialis-program.txt"
    note.write_text(meshlab.environment["MEDIALIS_PROGRAM"] + "\n", encoding="utf-8")
    changed = {"MEDIALIS_PROGRAM": None, "PATH": "/nowhere"}
    try:
        printed = meshlab.run([creature], filter_named("surface_skeleton"), environment=changed)
    finally:
        note.unlink()
    assert "skeleton_points: " in printed, printed


def test_a_child_that_is_killed_or_crashes_is_one_sentence(meshlab, creature, tmp_path):
    program = tmp_path / "medialis"
    for body, sentence in (
        ("kill -9 $$", "The medialis program was ended from outside; nothing was changed."),
        ("echo 'Bad: <x>' >&2; exit 1", "The medialis program failed (exit code 1): Bad: <x>"),
        ("exit 0", "The medialis program left no result."),
    ):
        program.write_text(f"#!/bin/sh\n{body}\n")
        program.chmod(0o755)
        changed = {"MEDIALIS_PROGRAM": str(program)}
        failed(meshlab, creature, tmp_path / "out.ply", sentence, environment=changed)


def test_broken_variables_of_the_host_do_not_reach_the_child(meshlab, creature):
    changed = {
        "PYTHONHOME": "/nonexistent",
        "PYTHONPATH": "/nonexistent",
        "LD_PRELOAD": "/nonexistent.so",
    }
    printed = meshlab.run([creature], filter_named("surface_skeleton"), environment=changed)
    assert "skeleton_points: " in printed, printed


def test_a_full_disk_in_the_temporary_folder_is_one_sentence(meshlab, creature, tmp_path):
    """First too small for the layer that is handed over, then only for the result."""
    small = tmp_path / "small"
    small.mkdir()
    size = creature.stat().st_size // 1024
    for kilobytes, sentence in ((size // 2, "Cannot write the layer for medialis"),
                                (size + size // 2, "no space left on device")):  # fmt: skip
        mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(small)]
        if subprocess.run(mount, capture_output=True).returncode != 0:
            pytest.skip("needs the right to mount a small disk")
        try:
            changed = {"TMPDIR": str(small)}
            out = tmp_path / "out.ply"
            failed(meshlab, creature, out, sentence, environment=changed)
            assert list(small.iterdir()) == []
        finally:
            subprocess.run(["umount", str(small)], check=True)
