"""The operation of CONTRIBUTING.md, added to a checkout, is a button and an operator in Blender."""

import importlib.util
import shutil
import subprocess
import sys

import pytest
from code_blocks import blocks
from extended_checkout import NAME, PAGE, ROOT, extended_checkout, run_in

pytest.importorskip("bpy", reason="bpy is not installed: make hosts")

CODE = f"""
import bpy, blender_addon, medialis
assert medialis.__file__.startswith({{folder!r}}), medialis.__file__
blender_addon.register()
bpy.ops.mesh.primitive_torus_add()
assert bpy.ops.medialis.{NAME}(places=2) == {{{{"FINISHED"}}}}
print(bpy.context.active_object.name, len(bpy.context.active_object.data.points))
print(bpy.context.scene.medialis.of_{NAME}.places)
blender_addon.unregister()
"""


def make_kernels(folder):
    """Make the kernel of the page ahead, as it says: Blender's environments have no numba."""
    (line,) = [code for language, code in blocks(PAGE) if language == "text" and "|" in code]
    with (folder / "core" / "medialis" / "hosts" / "kernels.txt").open("a") as stream:
        stream.write(line)
    path = ROOT / "blender_addon" / "packaging" / "build_extension.py"
    spec = importlib.util.spec_from_file_location("build_extension_here", path)
    build = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = build  # dataclasses look their module up
    spec.loader.exec_module(build)
    library = shutil.copytree(ROOT / "core" / "kernel_library", folder / "core" / "kernel_library")
    runs = build.builder(build.this_python(), offline=True)
    subprocess.run([runs, library / "build.py", NAME], check=True)


def test_blender_has_it(tmp_path):
    folder = extended_checkout(tmp_path)
    make_kernels(folder)
    printed = run_in(folder, "-c", CODE.format(folder=str(folder))).splitlines()
    assert printed[-2:] == ["Torus widest places 2", "5"]
