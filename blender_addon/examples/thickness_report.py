# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how thick a part is: numbers and thin spots as JSON, and a picture in colours.

    blender --background --python thickness_report.py -- part.stl part.json part.png --thin 1mm

Lengths are in mm. It writes these two files and nothing else. Exit status: 0 both are written, 1
the part cannot be read or measured, 2 wrong arguments.
"""

import argparse
import json
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from medialis import MedialisError

try:
    import medialis_blender  # pip install bpy medialis-blender
except ImportError:
    from bl_ext.user_default import medialis as medialis_blender  # the extension in Blender


def main() -> int:
    """Write the report and return the exit status."""
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser("thickness_report.py", description=__doc__.partition("\n")[0])
    parser.add_argument("part", type=Path, help="an STL file, in mm")
    parser.add_argument("report", type=Path, help="JSON file")
    parser.add_argument("picture", type=Path, help="PNG file")
    parser.add_argument("--thin", default="0", help="what is thin, such as 1mm; 0: minima")
    options = parser.parse_args(given)
    medialis_blender.register()
    try:
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.context.scene.unit_settings.scale_length = 0.001
        bpy.ops.wm.stl_import(filepath=str(options.part))
        set_stage(options.picture)  # before: the legend faces the camera
        part = bpy.context.active_object
        _, *spots = medialis_blender.thickness(part, threshold=options.thin, legend_in_renders=True)
        draw()
        options.report.write_text(json.dumps(numbers(part, spots), indent=1), encoding="utf-8")
    except (MedialisError, RuntimeError, OSError) as error:  # of Blender, of medialis
        print(f"{options.part.name}: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    print(part["medialis_summary"])
    return 0


def set_stage(picture: Path) -> None:
    """Look from the front, the right and above, with a light from there; no card is needed."""
    scene, render = bpy.context.scene, bpy.context.scene.render
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.camera.data.type, scene.camera.data.clip_end = "ORTHO", 1e6
    light = bpy.data.objects.new("light", bpy.data.lights.new("light", "SUN"))
    light.data.energy = 3.0
    for made in (scene.camera, light):
        made.rotation_euler = (1.1, 0.0, 0.5)
        scene.collection.objects.link(made)
    render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 16
    render.resolution_x, render.resolution_y, render.film_transparent = 800, 600, True
    render.filepath, render.use_file_extension = str(picture.resolve()), False
    render.image_settings.file_format = "PNG"
    scene.view_settings.view_transform = "Standard"


def draw() -> None:
    """Let the camera see everything, the legend included, and write the picture."""
    bpy.context.view_layer.update()
    shown = [one for one in bpy.context.scene.objects if one.type == "MESH" and not one.hide_render]
    corners = [[*(one.matrix_world @ Vector(at))] for one in shown for at in one.bound_box]
    camera, render = bpy.context.scene.camera, bpy.context.scene.render
    axes = np.array(camera.matrix_world.to_3x3())
    seen = np.array(corners) @ axes
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide, tall, deep = high - low
    camera.data.ortho_scale = 1.05 * max(wide, tall * render.resolution_x / render.resolution_y)
    camera.location = axes @ np.array([*(low + high)[:2] / 2, high[2] + deep + 1.0])
    bpy.ops.render.render(write_still=True)


def numbers(part: bpy.types.Object, spots: list[bpy.types.Object]) -> dict[str, object]:
    """Return thickness at the vertices, thin spots, and notes."""
    values = [value.value for value in part.data.attributes["wall_thickness"].data]
    least, middle, most = np.nanquantile(values, [0, 0.5, 1]).tolist()
    rows = []
    for made in spots:
        columns = (made.data.attributes[name].data for name in ("position", "value"))
        for place, value in zip(*columns, strict=True):
            position = list(made.matrix_world @ place.vector)
            rows.append({"position": position, "thickness": value.value})
    notes = [line for line in part["medialis_summary"].splitlines() if line.startswith("!")]
    told = {"thinnest": least, "median": middle, "thickest": most}
    return {**told, "spots": rows, "notes": notes}


if __name__ == "__main__":
    sys.exit(main())
