# SPDX-License-Identifier: GPL-3.0-or-later
"""Rig a mesh: a .blend file with the mesh bound to an armature along its curve skeleton.

With Blender and the extension:

    blender -b --addons bl_ext.user_default.medialis -P rig_from_curve_skeleton.py -- a.ply a.blend

or with `pip install bpy medialis`, from the folder that holds `blender_addon`:

    python blender_addon/examples/rig_from_curve_skeleton.py a.ply a.blend
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

import bpy

READERS = {".ply": "ply_import", ".obj": "obj_import", ".stl": "stl_import"}


def main() -> int:
    """Rig one file and return the exit code."""
    after = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path, help="PLY, OBJ or STL")
    parser.add_argument("output", type=Path, help=".blend file")
    parser.add_argument("--bone-length", type=float, default=100.0, help="per cent of the size")
    options = parser.parse_args(after)
    if options.mesh.suffix.lower() not in READERS:
        parser.error(f"the mesh must be a PLY, OBJ or STL file, got {options.mesh.name}")
    if not hasattr(bpy.types.Scene, "medialis"):  # not enabled as an extension
        sys.path.append(str(Path(__file__).resolve().parents[2]))
        importlib.import_module("blender_addon").register()
    bpy.ops.wm.read_homefile(use_empty=True)
    try:
        getattr(bpy.ops.wm, READERS[options.mesh.suffix.lower()])(filepath=str(options.mesh))
        bpy.ops.medialis.armature(bind=True, bone_length=options.bone_length)
    except RuntimeError as error:  # what an operator reports
        print(f"{options.mesh.name}: {' '.join(str(error).split())}")
        return 1
    armature = bpy.context.active_object
    print(armature["medialis_summary"])
    bpy.ops.wm.save_as_mainfile(filepath=str(options.output.resolve()), check_existing=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
