"""Pictures of Blender's window: Debian's Blender 3.4.1, which is only a stand-in here.

The adapter needs Blender 4.2; what 3.4 lacks (point cloud objects by nodes, fast positions) is
replaced by meshes with a modifier. It needs a display, xdotool, imagemagick, and numba for Python
3.11:

    Xvfb :81 -screen 0 1200x900x24 +extension GLX &
    DISPLAY=:81 LIBGL_ALWAYS_SOFTWARE=1 MEDIALIS_PACKAGES=.venv/lib/python3.11/site-packages \
        blender --factory-startup --window-geometry 0 0 1200 900 \
        -P docs/make_blender_screenshot.py
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
sys.path[:0] = [str(ROOT), str(ROOT / "core"), os.environ.get("MEDIALIS_PACKAGES", "")]

import blender_addon  # noqa: E402
import numpy as np  # noqa: E402

import medialis  # noqa: E402

blender_addon.register()

from blender_addon import filtering, jobs, layers, operators, reading  # noqa: E402

TAB = 978, 222
"""Where the tab Medialis is, in pixels from the upper left of the view."""


def positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """Read the points of a mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def points_as_mesh(plan, scene, changes, curves=False):
    """Add the points of a layer as a mesh whose modifier hides small values and draws points."""
    mesh = bpy.data.meshes.new(plan.title)
    mesh.from_pydata(plan.points.tolist(), [], [])
    made = bpy.data.objects.new(plan.title, mesh)
    scene.collection.objects.link(made)
    name = plan.layer.filter_by
    if name is None:
        return made
    values = np.asarray(plan.layer.attributes[name], np.float32)
    mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", values)
    group = bpy.data.node_groups.new("Medialis", "GeometryNodeTree")
    group.inputs.new("NodeSocketGeometry", "Geometry")
    group.outputs.new("NodeSocketGeometry", "Geometry")
    slider = filtering.Slider.of(plan.layer, plan.limits)
    first = slider.step * slider.default
    for text, value, limit in (
        ("Threshold", first, slider.range[1]),
        ("Size", plan.size, 1.0),
    ):
        socket = group.inputs.new("NodeSocketFloatFactor", text)
        socket.default_value, socket.min_value, socket.max_value = value, 0.0, limit
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    read = group.nodes.new("GeometryNodeInputNamedAttribute")
    read.inputs["Name"].default_value = name
    value = next(o for o in read.outputs if o.name == "Attribute" and o.enabled)
    less = group.nodes.new("FunctionNodeCompare")
    less.operation = "LESS_THAN"
    scaled = group.nodes.new("ShaderNodeMath")
    scaled.operation = "MULTIPLY"
    scaled.inputs[1].default_value = slider.factor
    hide = group.nodes.new("GeometryNodeDeleteGeometry")
    ball = group.nodes.new("GeometryNodeMeshIcoSphere")
    draw = group.nodes.new("GeometryNodeInstanceOnPoints")
    real = group.nodes.new("GeometryNodeRealizeInstances")
    color = group.nodes.new("GeometryNodeSetMaterial")
    color.inputs["Material"].default_value = layers._material(plan.layer, changes)
    for output, into in (
        (value, less.inputs["A"]),
        (start.outputs["Threshold"], scaled.inputs[0]),
        (scaled.outputs["Value"], less.inputs["B"]),
        (start.outputs["Geometry"], hide.inputs["Geometry"]),
        (less.outputs["Result"], hide.inputs["Selection"]),
        (hide.outputs["Geometry"], draw.inputs["Points"]),
        (start.outputs["Size"], ball.inputs["Radius"]),
        (ball.outputs["Mesh"], draw.inputs["Instance"]),
        (draw.outputs["Instances"], real.inputs["Geometry"]),
        (real.outputs["Geometry"], color.inputs["Geometry"]),
        (color.outputs["Geometry"], end.inputs["Geometry"]),
    ):
        group.links.new(output, into)
    made.modifiers.new(filtering.MODIFIER, "NODES").node_group = group
    return made


def modifier_inputs(made: bpy.types.Object) -> dict:
    """Find the sliders of a result."""
    modifier = made.modifiers.get(filtering.MODIFIER)
    sockets = modifier.node_group.inputs[1:] if modifier else ()
    return {socket.name: (modifier, f'["{socket.identifier}"]') for socket in sockets}


def set_input(made: bpy.types.Object, name: str, value: float) -> None:
    """Move a slider of a result."""
    owner, path = modifier_inputs(made)[name]
    owner[path[2:-2]] = value
    made.update_tag()
    operators.redraw(bpy.context)


def new_creature() -> bpy.types.Object:
    """Add the built-in shape to an empty file."""
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
    return creature


def in_view(function) -> None:
    """Call a function with the 3D view in the context."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        function(area.spaces[0])


def frame(space: bpy.types.SpaceView3D) -> None:
    """Open the sidebar and look at the shape."""
    space.show_region_ui = True
    bpy.ops.view3d.view_axis(type="FRONT")
    bpy.ops.view3d.view_selected()


def click(place: tuple[int, int]) -> None:
    """Press and release the left button at a place in the 3D view."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    x, y = area.x + place[0], window.height - area.y - area.height + place[1]
    subprocess.run(["xdotool", "mousemove", str(x), str(y), "click", "1"], check=True)


def shot(name: str) -> None:
    """Write a picture of the 3D view with its sidebar, in few colours."""
    path = PICTURES / f"{name}.png"
    in_view(lambda space: bpy.ops.screen.screenshot_area(filepath=str(path)))
    few = ["-crop", "991x690+0+0", "+repage", "-colors", "256"]
    subprocess.run(["convert", str(path), *few, str(path)], check=True)


def steps() -> Iterator[float]:
    """Do one thing after the other; each yields the seconds that Blender needs for it."""
    new_creature()
    in_view(frame)
    yield 2
    click(TAB)
    yield 2
    shot("blender_tutorial_panel")
    in_view(lambda space: bpy.ops.medialis.skeleton_importance("INVOKE_DEFAULT"))
    while jobs.running is not None:
        yield 1
    yield 2
    in_view(lambda space: bpy.ops.medialis.show_colors())
    made = bpy.context.active_object
    made.select_set(False)  # its outline hides the colours
    set_input(made, "Size", 0.015)
    yield 20
    shot("blender_tutorial_skeleton")
    set_input(made, "Threshold", 6.4)
    yield 8
    shot("blender_tutorial_threshold")
    creature = made.parent
    bpy.data.objects.remove(made)
    creature.display_type = "TEXTURED"
    bpy.context.view_layer.objects.active = creature
    creature.select_set(True)
    settings = bpy.context.scene.medialis
    settings.of_thickness.unfolded, settings.unfolded_notes = True, False
    yield 1
    in_view(lambda space: bpy.ops.medialis.thickness("INVOKE_DEFAULT"))
    while jobs.running is not None:
        yield 1
    in_view(lambda space: bpy.ops.medialis.show_colors())
    yield 3
    shot("blender_panel")
    bpy.ops.wm.quit_blender()


layers.make_object, reading._positions = points_as_mesh, positions
filtering.modifier_inputs = modifier_inputs
bpy.context.preferences.view.show_splash = False  # it would take the click
plan = steps()
bpy.app.timers.register(lambda: next(plan, None), first_interval=2.0)
