# SPDX-License-Identifier: GPL-3.0-or-later
"""Rig every mesh of a folder: a .blend file each, with the mesh bound to an armature.

    blender --background --python rig_folder.py -- MESHES RIGS --bone-length 20%

For MESHES/hand.ply it writes RIGS/hand.blend, and nothing else. A file that cannot be rigged is
named and the others go on. Exit status: 0 all are rigged, 1 some are not, 2 wrong arguments.
"""

import argparse
import sys
from pathlib import Path

import bpy

from medialis import MedialisError

try:
    import medialis_blender  # pip install bpy medialis-blender
except ImportError:
    from bl_ext.user_default import medialis as medialis_blender  # the extension in Blender

READERS = {
    ".ply": bpy.ops.wm.ply_import,
    ".obj": bpy.ops.wm.obj_import,
    ".stl": bpy.ops.wm.stl_import,
}


def main() -> int:
    """Rig all files and return the exit status."""
    parser = argparse.ArgumentParser("rig_folder.py", description=__doc__.partition("\n")[0])
    parser.add_argument("meshes", type=Path, help="folder with PLY, OBJ or STL files")
    parser.add_argument("rigs", type=Path, help="folder for the .blend files")
    parser.add_argument("--bone-length", default="100%", help="the longest bone, of the size")
    after = sys.argv.index("--") + 1 if "--" in sys.argv else 1
    options = parser.parse_args(sys.argv[after:])
    files = sorted(f for f in options.meshes.glob("*") if f.suffix.lower() in READERS)
    if not files:
        parser.error(f"there is no PLY, OBJ or STL file in {options.meshes}")
    medialis_blender.register()  # the slider and the panel of the results; in Blender it is done
    failed = 0
    for file in files:
        try:
            mesh = read(file)
            rig, *_ = medialis_blender.armature(mesh, bind=True, bone_length=options.bone_length)
            save(options.rigs / f"{file.stem}.blend")
        except (MedialisError, RuntimeError, OSError) as error:  # of Blender, of medialis
            print(f"{file.name}: {' '.join(str(error).split())}", file=sys.stderr)
            failed += 1
        else:
            print(f"{file.name}: {len(rig.data.bones)} bones")
    return 1 if failed else 0


def read(file: Path) -> bpy.types.Object:
    """Read a mesh into an empty scene, as one object."""
    bpy.ops.wm.read_homefile(use_empty=True)
    READERS[file.suffix.lower()](filepath=str(file))
    if not bpy.data.objects:
        raise OSError("Blender finds no mesh in it.")
    bpy.context.view_layer.objects.active = bpy.data.objects[0]
    if len(bpy.data.objects) > 1:
        bpy.ops.object.join()
    return bpy.context.view_layer.objects.active


def save(path: Path) -> None:
    """Save the scene; no copy of an earlier file, no thumbnail in the user's cache."""
    path.parent.mkdir(parents=True, exist_ok=True)
    bpy.context.preferences.filepaths.save_version = 0
    bpy.context.preferences.filepaths.file_preview_type = "NONE"
    bpy.ops.wm.save_as_mainfile(filepath=str(path.resolve()), check_existing=False)


if __name__ == "__main__":
    sys.exit(main())
