# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute something for every mesh of a folder; save a .blend file and PLY files for each.

With Blender and the extension:

    blender -b --addons bl_ext.user_default.medialis -P process_folder.py -- meshes results

or with `pip install bpy medialis`, from the folder that holds `blender_addon`:

    python blender_addon/examples/process_folder.py meshes results --operation thickness

For meshes/hand.ply it writes results/hand.blend and a PLY file of each result, as in
results/hand surface skeleton.ply. A file that cannot be used is named and the others go on; the
exit code is then 1.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

import bpy

READERS = {".ply": "ply_import", ".obj": "obj_import", ".stl": "stl_import"}


def main() -> int:
    """Process all files and return the exit code."""
    after = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("input", type=Path, help="folder with PLY, OBJ or STL files")
    parser.add_argument("output", type=Path, help="folder for the results")
    parser.add_argument("--operation", default="surface_skeleton")
    options = parser.parse_args(after)
    if not hasattr(bpy.types.Scene, "medialis"):  # not enabled as an extension
        sys.path.append(str(Path(__file__).resolve().parents[2]))
        importlib.import_module("blender_addon").register()
    options.output.mkdir(parents=True, exist_ok=True)
    failed = 0
    for file in sorted(options.input.iterdir()):
        if file.suffix.lower() in READERS:
            try:
                process(file, options.output, options.operation)
            except RuntimeError as error:  # what an operator reports
                print(f"{file.name}: {' '.join(str(error).split())}")
                failed += 1
    return 1 if failed else 0


def process(file: Path, output: Path, name: str) -> None:
    """Read one file, run the operation, save."""
    bpy.ops.wm.read_homefile(use_empty=True)
    getattr(bpy.ops.wm, READERS[file.suffix.lower()])(filepath=str(file))
    source = bpy.context.active_object
    getattr(bpy.ops.medialis, name)()
    results = [source, *source.children]
    print(source.get("medialis_summary") or source.children[0]["medialis_summary"])
    for made in results:
        if made.get("medialis_summary"):
            write_ply(made, output / f"{made.name}.ply")
    bpy.ops.wm.save_as_mainfile(filepath=str(output / f"{file.stem}.blend"), check_existing=False)


def write_ply(made: bpy.types.Object, path: Path) -> None:
    """Write the points, faces and attributes of an object, without loss, by the core's writer."""
    import numpy as np

    from medialis.hosts import write_ply as write

    widths = {"FLOAT": 1, "INT": 1, "FLOAT_VECTOR": 3}
    keys = {"FLOAT": "value", "INT": "value", "FLOAT_VECTOR": "vector"}
    found = {}
    for attribute in made.data.attributes:
        kind = attribute.data_type
        if attribute.domain == "POINT" and kind in widths and not attribute.name.startswith("."):
            dtype = np.int32 if kind == "INT" else np.float32
            values = np.empty(len(attribute.data) * widths[kind], dtype)
            attribute.data.foreach_get(keys[kind], values)
            found[attribute.name] = values if widths[kind] == 1 else values.reshape(-1, 3)
    points, faces = found.pop("position"), None
    if made.type == "MESH" and made.data.polygons:
        made.data.calc_loop_triangles()
        faces = np.empty(3 * len(made.data.loop_triangles), np.int32)
        made.data.loop_triangles.foreach_get("vertices", faces)
        faces = faces.reshape(-1, 3)
    write(path, points.astype(float), faces=faces, attributes=found)


if __name__ == "__main__":
    sys.exit(main())
