"""Make the pictures of docs/blender.md, rendered by Blender itself: run with `import bpy`.

python docs/make_blender_pictures.py
"""

import math
import sys
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "core")]

import blender_addon  # noqa: E402

import medialis  # noqa: E402

PICTURES = ROOT / "docs" / "pictures"


def new_scene() -> bpy.types.Object:
    """Empty the file and add the built-in shape."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    shape = medialis.organic_shape(160)
    mesh = bpy.data.meshes.new("creature")
    mesh.from_pydata(shape.points.tolist(), [], shape.faces.tolist())
    mesh.shade_smooth()
    creature = bpy.data.objects.new("creature", mesh)
    bpy.context.scene.collection.objects.link(creature)
    bpy.context.view_layer.objects.active = creature
    return creature


def light_and_camera() -> None:
    """Add a sun, a bright world, and a camera from the side and a little above."""
    scene = bpy.context.scene
    world = bpy.data.worlds.new("world")
    scene.world = world
    if world.node_tree is None:
        world.use_nodes = True
    background = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = 0.9
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy = 2.0
    sun.rotation_euler = (math.radians(40), math.radians(-20), 0)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 2.9
    camera.rotation_euler = (math.radians(78), 0, math.radians(-18))
    for made in (sun, camera):
        scene.collection.objects.link(made)
    scene.camera = camera
    bpy.context.view_layer.update()
    target = bpy.data.objects["creature"]
    corners = [target.matrix_world @ type(target.location)(c) for c in target.bound_box]
    middle = sum(corners, start=type(target.location)()) / 8
    back = camera.matrix_world.to_quaternion() @ type(target.location)((0, 0, 6))
    camera.location = middle + back


def render(path: Path, width: int = 640, height: int = 420) -> None:
    """Render with Cycles on the processor."""
    light_and_camera()
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 24, False
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = False
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_depth = "8"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def skeleton() -> None:
    """Draw the surface skeleton with importance as it is added, in the colours of its material."""
    creature = new_scene()
    bpy.ops.medialis.skeleton_importance()
    made = bpy.context.active_object
    from blender_addon import filtering

    filtering.set_input(made, "Threshold", 0.08)
    creature.hide_render = True
    render(PICTURES / "blender_skeleton.png")


def thickness() -> None:
    """Draw thickness as the material of the surface."""
    new_scene()
    bpy.ops.medialis.thickness(with_materials=True)
    render(PICTURES / "blender_thickness.png")


if __name__ == "__main__":
    blender_addon.register()
    skeleton()
    thickness()
