r"""Screenshot of the panel in a real window: Debian's Blender 3.4.1, which is only a stand-in here.

The adapter needs Blender 4.2; what 3.4 lacks (point cloud objects by nodes, fast positions) is
replaced by plain meshes. It needs a display, xdotool and imagemagick, and numba for Python 3.11:

    Xvfb :81 -screen 0 1200x900x24 +extension GLX &
    DISPLAY=:81 LIBGL_ALWAYS_SOFTWARE=1 MEDIALIS_PACKAGES=.venv/lib/python3.11/site-packages \
        blender --factory-startup --window-geometry 0 0 1200 900 -P docs/make_blender_screenshot.py
    DISPLAY=:81 xdotool mousemove 978 250 click 1       # the tab, as soon as the sidebar is there
    DISPLAY=:81 import -window root -crop 992x880+0+30 docs/pictures/blender_panel.png
"""

import os
import sys
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "core"), os.environ.get("MEDIALIS_PACKAGES", "")]

import blender_addon  # noqa: E402
import numpy as np  # noqa: E402

import medialis  # noqa: E402

blender_addon.register()

from blender_addon import layers, reading, warmup  # noqa: E402


def plain_object(plan, scene, changes, curves=False):
    """Add the points of a layer as a mesh."""
    mesh = bpy.data.meshes.new(plan.title)
    mesh.from_pydata(plan.points.tolist(), [], [])
    made = bpy.data.objects.new(plan.title, mesh)
    scene.collection.objects.link(made)
    return made


def positions(mesh):
    """Read the points of a mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


layers.make_object, reading._positions = plain_object, positions
bpy.app.timers.unregister(warmup.start)
for old in list(bpy.data.objects):
    bpy.data.objects.remove(old)
shape = medialis.organic_shape(80)
mesh = bpy.data.meshes.new("creature")
mesh.from_pydata(shape.points.tolist(), [], shape.faces.tolist())
for polygon in mesh.polygons:
    polygon.use_smooth = True
creature = bpy.data.objects.new("creature", mesh)
bpy.context.scene.collection.objects.link(creature)
bpy.context.view_layer.objects.active = creature
creature.select_set(True)
bpy.context.scene.medialis.of_thickness.unfolded = True


def in_view(function):
    """Call a function with the 3D view in the context."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                region = next(r for r in area.regions if r.type == "WINDOW")
                with bpy.context.temp_override(window=window, area=area, region=region):
                    function(area.spaces[0])


def frame(space):
    """Open the sidebar and look at the shape."""
    space.show_region_ui = True
    space.shading.color_type = "VERTEX"
    bpy.ops.view3d.view_axis(type="FRONT")
    bpy.ops.view3d.view_selected()


def start(space):
    """Run an operation as its button does."""
    bpy.ops.medialis.thickness("INVOKE_DEFAULT")


bpy.app.timers.register(lambda: in_view(frame), first_interval=2.0)
bpy.app.timers.register(lambda: in_view(start), first_interval=10.0)
