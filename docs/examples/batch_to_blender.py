"""The skeletons of all shapes of a folder, in one .blend file.

python batch_to_blender.py FOLDER OUTPUT

Needs `pip install bpy "medialis[dask]"`. The batch runs in processes of its own; only its results
are imported here. (With the extension in Blender itself, see the operators on the Blender page.)
"""

import sys
from pathlib import Path

import medialis


def main(folder: str, output: str) -> None:
    """Run the batch, then import the skeletons, one object each, and save."""
    rows = medialis.batch("surface_skeleton", [folder], output)
    # Not at the top: worker processes import this file, and need no Blender.
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True)
    for row in rows:
        if row.status == "failed":
            print(row.file, row.sentence)
            continue
        skeleton = Path(output, row.name, row.operation, "surface_skeleton.ply").resolve()
        bpy.ops.wm.ply_import(filepath=str(skeleton))
        bpy.context.active_object.name = row.name
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(output, "skeletons.blend").resolve()))
    print(len(bpy.data.objects), "objects")


if __name__ == "__main__":
    main(*sys.argv[1:])
