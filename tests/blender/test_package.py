"""The add-on as a package, `pip install medialis-blender`: the script in its README runs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "blender_addon" / "README.md"

CLEAN_PROCESS = """
import pathlib, site, sys
sys.path.insert(0, {site!r})
site.addsitedir({site!r})  # as Python reads its own folder: .pth files would be run
exec(compile(pathlib.Path({script!r}).read_text(), "script.py", "exec"))
assert medialis_blender.__file__.startswith({site!r})
assert not dir(bpy.ops.medialis) and not hasattr(bpy.types.Scene, "medialis")
medialis_blender.register()
assert "surface_skeleton" in dir(bpy.ops.medialis)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder with the wheel as pip installs it; core and numpy are those of the host."""
    folder = tmp_path_factory.mktemp("package")
    command = [sys.executable, str(ROOT / "blender_addon/packaging/build_package.py")]
    subprocess.run([*command, "--output", str(folder)], check=True)
    (wheel,) = folder.glob("*.whl")
    assert wheel.name.startswith("medialis_blender-")
    site = folder / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", str(site), str(wheel)], check=True)
    return site


def test_the_script_of_the_readme_runs(installed, tmp_path):
    pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
    (script,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert len([line for line in script.splitlines() if line]) <= 11
    (tmp_path / "script.py").write_text(script)
    code = CLEAN_PROCESS.format(site=str(installed), script=str(tmp_path / "script.py"))
    run = subprocess.run(
        [sys.executable, "-W", "error::ResourceWarning", "-c", code],
        cwd=tmp_path, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert (run.returncode, run.stderr) == (0, "")
    assert "points" in run.stdout and (tmp_path / "skeleton.blend").stat().st_size > 1000


def test_the_wheel_has_the_add_on_and_its_licence(installed):
    names = {path.relative_to(installed).as_posix() for path in installed.rglob("*")}
    assert {"medialis_blender/__init__.py", "medialis_blender/operators.py"} <= names
    assert not any(name.endswith(".pth") for name in names)
    assert not any("packaging" in name or "examples" in name for name in names)
    (about,) = installed.glob("*.dist-info/METADATA")
    assert "License-Expression: GPL-3.0-or-later" in about.read_text()
    assert any(name.endswith("LICENSE") for name in names)


def test_functions_return_objects(scene):
    import blender_addon
    import bpy

    import medialis

    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.active_object
    (made,) = blender_addon.surface_skeleton(cube, threshold="1%", subsample=0.02)
    assert made.parent == cube and "radius" in made.data.attributes
    assert blender_addon.thickness(cube)[0] == cube
    assert len(blender_addon.run("surface_skeleton", cube, add_samples=True)) == 2
    with pytest.raises(medialis.InvalidOptionError):
        blender_addon.thickness(cube, nonsense=1)
    with pytest.raises(AttributeError, match="no operation"):
        _ = blender_addon.nonsense
