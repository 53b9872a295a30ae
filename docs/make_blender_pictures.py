"""Make the pictures of docs/blender.md, rendered by Blender itself: run with `import bpy`.

python docs/make_blender_pictures.py
"""

import math
import sys
from pathlib import Path

import bpy
from mathutils import Quaternion, Vector

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

    filtering.set_input(made, "Threshold", 2.6)
    creature.hide_render = True
    render(PICTURES / "blender_skeleton.png")


def thickness() -> None:
    """Draw thickness as the material of the surface."""
    new_scene()
    bpy.ops.medialis.thickness(with_materials=True)
    render(PICTURES / "blender_thickness.png")


def see_through(chosen: bpy.types.Object) -> None:
    """Give an object a material that shows its outline only."""
    material = bpy.data.materials.new("glass")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    out = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    mix = tree.nodes.new("ShaderNodeMixShader")
    edge = tree.nodes.new("ShaderNodeLayerWeight")
    edge.inputs["Blend"].default_value = 0.35
    tree.links.new(edge.outputs["Facing"], mix.inputs[0])
    white, blue = (1, 1, 1, 1), (0.35, 0.45, 0.6, 1)
    kinds = ((1, "ShaderNodeBsdfTransparent", white), (2, "ShaderNodeBsdfDiffuse", blue))
    for socket, kind, shade in kinds:
        node = tree.nodes.new(kind)
        node.inputs["Color"].default_value = shade
        tree.links.new(node.outputs[0], mix.inputs[socket])
    tree.links.new(mix.outputs[0], out.inputs[0])
    chosen.data.materials.clear()
    chosen.data.materials.append(material)


def curve_skeleton() -> None:
    """Draw the curve skeleton as it is added, in the shape."""
    creature = new_scene()
    bpy.ops.medialis.curve_skeleton()
    see_through(creature)
    render(PICTURES / "blender_curve_skeleton.png")


POSE = {  # bone: degrees about the axis across the body
    "bone 006.L": -45, "bone 007.L": 60, "bone 002": -30, "bone 012.L": 30, "bone 013.R": 25,
    "bone 012.R": -40, "bone 017": 35, "bone 018": 35, "bone 019": 20,
}  # fmt: skip


def bend(armature: bpy.types.Object, name: str, degrees: float) -> None:
    """Turn a bone about the y axis of the world."""
    bone = armature.pose.bones[name]
    axis = bone.bone.matrix_local.to_3x3().inverted() @ Vector((0, 1, 0))
    bone.rotation_quaternion = Quaternion(axis, math.radians(degrees))


def draw_bones(armature: bpy.types.Object) -> None:
    """Add the posed bones as a mesh: Blender renders no armatures."""
    bpy.context.view_layer.update()
    points: list[Vector] = []
    faces = []
    for bone in armature.pose.bones:
        first, length = len(points), bone.length
        wide = 0.07 * length
        ring = [(wide, wide), (wide, -wide), (-wide, -wide), (-wide, wide)]
        local = [(0, 0, 0), *((x, 0.15 * length, z) for x, z in ring), (0, length, 0)]
        points += [bone.matrix @ Vector(corner) for corner in local]
        for k in range(4):
            a, b = first + 1 + k, first + 1 + (k + 1) % 4
            faces += [(first, b, a), (a, b, first + 5)]
    mesh = bpy.data.meshes.new("bones")
    mesh.from_pydata(points, [], faces)
    material = bpy.data.materials.new("bones")
    if material.node_tree is None:
        material.use_nodes = True
    shader = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (0.8, 0.25, 0.03, 1)
    mesh.materials.append(material)
    made = bpy.data.objects.new("bones", mesh)
    made.matrix_world = armature.matrix_world
    bpy.context.scene.collection.objects.link(made)


def armature() -> None:
    """Draw the shape in its rest pose and posed, with its bones and coloured by them."""
    for name, is_posed in (("rest", False), ("posed", True)):
        creature = new_scene()
        bpy.ops.medialis.armature(bind=True, with_materials=not is_posed)
        rig = bpy.context.active_object
        for bone, degrees in POSE.items():
            bend(rig, bone, degrees if is_posed else 0)
        if is_posed:
            draw_bones(rig)
            see_through(creature)
        render(PICTURES / f"blender_armature_{name}.png")


if __name__ == "__main__":
    blender_addon.register()
    skeleton()
    thickness()
    curve_skeleton()
    armature()
