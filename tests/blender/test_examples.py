"""The documented scripts, run as `blender --background --python script.py -- ...` runs them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")

import medialis
from medialis.formats.ply_attributes import write_ply

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder that has the add-on as its package is called."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "medialis_blender").symlink_to(ROOT / "blender_addon")
    return folder


@pytest.fixture
def run(site, tmp_path):
    def run(name, *arguments):
        path = os.pathsep.join([str(site), str(ROOT / "core")])
        script = ROOT / "blender_addon" / "examples" / name
        return subprocess.run(
            [sys.executable, str(script), "--", *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=300,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": path},
        )

    return run


@pytest.fixture
def meshes(tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    shape = medialis.organic_shape(56)
    write_ply(folder / "figure.ply", shape.points, faces=shape.faces)
    (folder / "bad.ply").write_text("no mesh")
    (folder / "notes.txt").write_text("no mesh")
    return folder


def files_in(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_a_folder_of_meshes_is_rigged(run, meshes, tmp_path):
    done = run("rig_folder.py", meshes, tmp_path / "rigs", "--bone-length", "20%")
    assert done.returncode == 1 and "bad.ply: " in done.stderr, done.stderr
    assert "figure.ply: " in done.stdout and files_in(tmp_path / "rigs") == {"figure.blend"}
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "rigs" / "figure.blend"))
    figure = bpy.data.objects["figure"]
    assert figure.parent.type == "ARMATURE" and figure.modifiers[0].object == figure.parent
    assert len(figure.vertex_groups) == len(figure.parent.data.bones) > 8


def test_silhouettes_are_black_on_white_and_of_one_scale(run, meshes, tmp_path):
    (meshes / "bad.ply").unlink()
    done = run("silhouettes.py", meshes, "pictures", "--views", 3, "--size", 64)
    assert done.returncode == 0, done.stderr
    names = {f"figure_{number}.png" for number in range(3)}
    assert files_in(tmp_path / "pictures") == names
    for name in names:
        image = bpy.data.images.load(str(tmp_path / "pictures" / name))
        pixels = np.array(image.pixels[:]).reshape(64, 64, 4)
        assert set(np.unique(pixels[..., 0])) == {0.0, 1.0} and pixels[..., 3].all()
        assert 0.03 < (pixels[..., 0] == 0.0).mean() < 0.5


def test_a_part_gets_a_report_and_a_picture(run, tmp_path):
    corners, faces = plate(30.0, 20.0, 0.8)
    write_stl(tmp_path / "part.stl", corners, faces)
    before = files_in(tmp_path)
    done = run("thickness_report.py", "part.stl", "part.json", "part.png", "--thin", "1mm")
    assert done.returncode == 0, done.stderr
    assert files_in(tmp_path) - before == {"part.json", "part.png"}
    report = json.loads((tmp_path / "part.json").read_text())
    assert report["median"] == pytest.approx(0.8, rel=1e-3) and report["spots"]
    image = bpy.data.images.load(str(tmp_path / "part.png"))
    pixels = np.array(image.pixels[:]).reshape(600, 800, 4)
    assert 0.05 < (pixels[..., 3] > 0.5).mean() < 0.95


def test_wrong_arguments_and_missing_files_are_told(run, tmp_path):
    assert run("rig_folder.py", tmp_path, tmp_path / "rigs").returncode == 2
    assert run("silhouettes.py", tmp_path).returncode == 2
    done = run("thickness_report.py", "none.stl", "a.json", "a.png")
    assert done.returncode == 1 and "none.stl: " in done.stderr
    assert files_in(tmp_path) == set()


def plate(*size):
    """Corners and triangles of a box with this size."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * size
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)]
    return corners.tolist(), faces


def write_stl(path, corners, faces):
    lines = ["solid part"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in (corners[i] for i in face)]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid part"]))
