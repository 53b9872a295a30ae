"""The operation of CONTRIBUTING.md, added to a checkout, is a button and an operator in Blender."""

import pytest
from extended_checkout import NAME, extended_checkout, run_in

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


def test_blender_has_it(tmp_path):
    folder = extended_checkout(tmp_path)
    printed = run_in(folder, "-c", CODE.format(folder=str(folder))).splitlines()
    assert printed[-2:] == ["Torus widest places 2", "5"]
