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
from blender_addon import looks  # noqa: E402
from blender_addon.changes import Changes  # noqa: E402

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
    light_and_camera()
    bpy.context.view_layer.objects.active = creature
    return creature


def light_and_camera() -> None:
    """Add a sun, a bright world, and a camera from the side and a little above.

    Legends face the camera: it is there before the operation runs.
    """
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
    camera.data.type = "ORTHO"
    camera.rotation_euler = (math.radians(78), 0, math.radians(-18))
    for made in (sun, camera):
        scene.collection.objects.link(made)
    scene.camera = camera
    bpy.context.view_layer.update()


def frame() -> None:
    """Let the camera see everything that is rendered, and nothing else."""
    scene = bpy.context.scene
    camera, size = scene.camera, scene.render
    bpy.context.view_layer.update()
    turn = camera.matrix_world.to_quaternion()
    corners = [
        turn.inverted() @ (made.matrix_world @ Vector(corner))
        for made in scene.objects
        if made.type in ("MESH", "POINTCLOUD") and not made.hide_render
        for corner in made.bound_box
    ]
    low, high = (Vector(map(pick, zip(*corners, strict=True))) for pick in (min, max))
    wide, tall, _ = high - low
    camera.data.ortho_scale = 1.04 * max(wide, tall * size.resolution_x / size.resolution_y)
    middle = (low + high) / 2
    camera.location = turn @ Vector((middle.x, middle.y, high.z + 5))


def render(path: Path, width: int = 640, height: int = 420) -> None:
    """Render with Cycles on the processor."""
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
    frame()
    bpy.ops.render.render(write_still=True)


def skeleton() -> None:
    """Draw the surface skeleton as it is added."""
    new_scene()
    bpy.ops.medialis.surface_skeleton()
    render(PICTURES / "blender_skeleton.png")


def thickness() -> None:
    """Draw thickness as it is added."""
    new_scene()
    bpy.ops.medialis.thickness()
    render(PICTURES / "blender_thickness.png")


def curve_skeleton() -> None:
    """Draw the curve skeleton as it is added, in the shape."""
    new_scene()
    bpy.ops.medialis.curve_skeleton()
    render(PICTURES / "blender_curve_skeleton.png")


def medial_mesh() -> None:
    """Draw 30 balls, then a ball of 120 moved and enlarged, and the surface of these."""
    creature = new_scene()
    bpy.ops.medialis.medial_mesh(legend=False)
    made = bpy.context.active_object
    creature.hide_render = True
    made.medialis_level = 30
    render(PICTURES / "blender_medial_mesh.png", 420, 300)
    made.medialis_level = 120
    radius = made.data.attributes["radius"].data
    first = max(made.data.vertices, key=lambda vertex: vertex.co.x)
    first.co += Vector((0.15, 0.0, -0.1))
    radius[first.index].value *= 3.0
    made.data.update()
    render(PICTURES / "blender_medial_mesh_edited.png", 420, 300)
    bpy.ops.medialis.rebuild()
    bpy.context.active_object.hide_render = True
    for other in bpy.data.objects:
        other.hide_render |= other.name.endswith("legend")
    render(PICTURES / "blender_medial_mesh_rebuilt.png", 420, 300)


POSE = {  # bone: degrees about the axis across the body
    "front_thigh.L": -45, "front_shin.L": 60, "front_thigh.R": 20, "thigh.L": 30, "shin.L": 20,
    "thigh.R": -35, "spine.001": -25, "tail": 30, "tail.001": 30, "tail.002": 20,
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
        bpy.ops.medialis.armature(bind=True, naming="rigify", legend=False)
        rig = bpy.context.active_object
        for bone, degrees in POSE.items():
            bend(rig, bone, degrees if is_posed else 0)
        if is_posed:
            draw_bones(rig)
            with Changes() as changes:
                looks.show_with(creature, looks.SEE_THROUGH, changes)
        render(PICTURES / f"blender_armature_{name}.png")


if __name__ == "__main__":
    blender_addon.register()
    skeleton()
    thickness()
    curve_skeleton()
    medial_mesh()
    armature()
