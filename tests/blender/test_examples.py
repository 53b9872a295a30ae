"""The documented script that processes a folder of files, run as its users run it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")

import medialis
from medialis.formats.meshes import read_mesh
from medialis.formats.ply_attributes import write_ply

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("name", "file", "attribute"),
    [("surface_skeleton", "b surface skeleton.ply", "radius"), ("thickness", "b.ply", "thickness")],
)
def test_a_folder_of_files(tmp_path, name, file, attribute):
    shape = medialis.organic_shape(56)
    (tmp_path / "in").mkdir()
    write_ply(tmp_path / "in" / "b.ply", shape.points, faces=shape.faces)
    write_ply(tmp_path / "in" / "flat.ply", shape.points[:3] * 0, faces=np.array([[0, 1, 2]]))
    (tmp_path / "in" / "notes.txt").write_text("no mesh")
    done = subprocess.run(
        [sys.executable, str(ROOT / "blender_addon/examples/process_folder.py"),
         str(tmp_path / "in"), str(tmp_path / "out"), "--operation", name],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "flat.ply: Error: " in done.stdout and " of b: " in done.stdout
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "b.blend"))
    assert bpy.data.objects["b"].children
    written = read_mesh(tmp_path / "out" / file)
    given = medialis.make_shape(
        shape.points.astype(np.float32).astype(float), shape.faces, repair=True
    )
    layer = medialis.run(name, given).layers[0]
    assert len(written.points) == len(layer.points)
    assert np.array_equal(written.points, layer.points.astype(np.float32))
    assert attribute.encode() in (tmp_path / "out" / file).read_bytes()[:1000]


def test_a_mesh_is_rigged(tmp_path):
    shape = medialis.organic_shape(56)
    write_ply(tmp_path / "figure.ply", shape.points, faces=shape.faces)
    script = str(ROOT / "blender_addon/examples/rig_from_curve_skeleton.py")

    def run(*arguments):
        return subprocess.run(
            [sys.executable, script, *arguments],
            capture_output=True, text=True, timeout=120, cwd=tmp_path,
        )  # fmt: skip

    done = run("figure.ply", "figure.blend", "--bone-length", "20")
    assert done.returncode == 0, done.stderr
    assert "Armature of figure" in done.stdout
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "figure.blend"))
    figure = bpy.data.objects["figure"]
    assert figure.parent.type == "ARMATURE" and figure.modifiers[0].object == figure.parent
    assert len(figure.vertex_groups) == len(figure.parent.data.bones) > 8
    (tmp_path / "bad.ply").write_text("no mesh")
    assert run("bad.ply", "bad.blend").returncode == 1
    assert not (tmp_path / "bad.blend").exists()
