"""Every operation on plain objects, and some on odd ones: a result or a sentence, nothing left."""

import subprocess
import sys

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import QUICK, add_mesh, add_object, counts
from medialis.operations.registry import OPERATIONS

pytestmark = pytest.mark.slow

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def cube():
    return add_mesh("cube", CUBE, QUADS)


def suzanne():
    bpy.ops.mesh.primitive_monkey_add()
    return bpy.context.active_object


def character():
    """Suzanne's left half, mirrored, moved by an armature, smoothed."""
    made = suzanne()
    mirror = made.modifiers.new("mirror", "MIRROR")
    mirror.use_bisect_axis[0] = True
    bones = bpy.data.armatures.new("rig")
    rig = add_object("rig", bones)
    bpy.ops.object.mode_set(mode="EDIT")
    bone = bones.edit_bones.new("head")
    bone.head, bone.tail = (0, 0, -1), (0, 0, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    made.modifiers.new("armature", "ARMATURE").object = rig
    made.modifiers.new("smooth", "SUBSURF").levels = 1
    made.vertex_groups.new(name="head").add(range(len(made.data.vertices)), 1.0, "REPLACE")
    made.parent = rig
    select(made)
    return made


def select(chosen):
    for other in bpy.context.scene.objects:
        other.select_set(other == chosen)
    bpy.context.view_layer.objects.active = chosen


def run(name, chosen, **given):
    """Run an operation; return its sentence where it has no result. Nothing else may be left."""
    select(chosen)
    before = counts()
    try:
        assert getattr(bpy.ops.medialis, name)(**given) == {"FINISHED"}
    except RuntimeError as error:
        text = str(error)
        assert "Traceback" not in text and counts() == before, text
        return text
    assert bpy.ops.medialis.remove_result() == {"FINISHED"}
    if chosen.mode == "OBJECT" or chosen.type == "MESH":
        assert counts() == before
    return None


@pytest.mark.parametrize("make", [cube, suzanne, character])
def test_every_operation(make, scene):
    """Also undo and redo; an armature cannot bind what another one moves."""
    make()
    names = {}
    for operation in OPERATIONS:
        chosen = bpy.data.objects[{"cube": "cube"}.get(make.__name__, "Suzanne")]
        given = dict(QUICK.get(operation.name, {}))
        if operation.name == "geodesic_path":
            ear = max(chosen.data.polygons, key=lambda face: face.center.x)
            given["start"], _, given["end"] = list(ear.vertices)[:3]
        looks = sorted(modifier.name for modifier in chosen.modifiers)
        attributes = sorted(chosen.data.attributes.keys())
        names[operation.name] = run(operation.name, chosen, **given)
        chosen = bpy.data.objects[chosen.name]
        assert sorted(modifier.name for modifier in chosen.modifiers) == looks
        assert sorted(chosen.data.attributes.keys()) == attributes
        assert not chosen.hide_render
    refused = {name: text for name, text in names.items() if text}
    assert "no midsurface" in refused.pop("midsurface", "no midsurface")  # where there are no walls
    few = ["centerline", "tree_cylinders"]  # no limbs
    assert list(refused) == (few if make is cube else []), refused


@pytest.mark.parametrize("name", ["thickness", "surface_skeleton", "armature"])
def test_undo_and_redo(name, scene):
    character()
    bpy.ops.ed.undo_push(message="before")
    before = counts()
    getattr(bpy.ops.medialis, name)("EXEC_DEFAULT", True)
    after = counts()
    bpy.ops.ed.undo()
    suzanne_before = bpy.data.objects["Suzanne"]
    assert counts() == before and "Medialis look" not in suzanne_before.modifiers
    assert not [key for key in suzanne_before.keys() if "medialis" in key]  # noqa: SIM118
    bpy.ops.ed.redo()
    assert counts() == after and "Medialis look" in bpy.data.objects["Suzanne"].modifiers


CHECK = """
import bpy, sys
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
graph = bpy.context.evaluated_depsgraph_get()
for made in bpy.data.objects:
    shown = made.evaluated_get(graph)
    if made.type == "MESH":
        assert len(shown.data.polygons) > 0 and shown.data.materials[0] is not None, made.name
    if made.type == "POINTCLOUD":
        assert 0 < len(shown.data.points) and shown.data.materials[0] is not None
assert not hasattr(bpy.types, "MEDIALIS_OT_thickness")
print("SEEN", len(bpy.data.objects))
"""


def test_files_open_without_the_extension(scene, tmp_path):
    """Everything shown is ordinary data: another Blender shows the same."""
    suzanne()
    for name in ("thickness", "surface_skeleton", "curve_skeleton"):
        getattr(bpy.ops.medialis, name)()
    path = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)
    count = len(bpy.data.objects)
    done = subprocess.run([sys.executable, "-c", CHECK, str(path)], capture_output=True, text=True,
                          timeout=100, check=False)  # fmt: skip
    assert f"SEEN {count}" in done.stdout, done.stderr


def text():
    curve = bpy.data.curves.new("text", "FONT")
    curve.body, curve.extrude = "Ab", 0.2
    return add_object("text", curve)


def flat_text():
    return add_object("text", bpy.data.curves.new("text", "FONT"))


def metaball():
    bpy.ops.object.metaball_add()
    return bpy.context.active_object


def nurbs_surface():
    bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    return bpy.context.active_object


def wire_curve():
    bpy.ops.curve.primitive_bezier_circle_add()
    return bpy.context.active_object


def thick_curve():
    made = wire_curve()
    made.data.bevel_depth = 0.2
    return made


def point_cloud():
    from blender_addon import point_clouds
    from blender_addon.changes import Changes

    shape = medialis.organic_shape(56)
    points = shape.points.astype(np.float32)
    with Changes() as changes:
        made = point_clouds.new_point_cloud("cloud", points, bpy.context.scene, changes)
    return made


def points_only():
    return add_mesh("points", np.random.default_rng(1).normal(size=(60, 3)), [])


def edges_only():
    mesh = bpy.data.meshes.new("edges")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1), (1, 2)], [])
    return add_object("edges", mesh)


def empty_mesh():
    return add_mesh("empty", np.empty((0, 3)), [])


def one_vertex():
    return add_mesh("vertex", [[0, 0, 0]], [])


def one_triangle():
    return add_mesh("triangle", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [(0, 1, 2)])


def open_plane():
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=12, y_subdivisions=12)
    return bpy.context.active_object


def with_nan():
    made = cube()
    made.data.vertices[0].co = (float("nan"), 0, 0)
    return made


def with_infinity():
    made = cube()
    made.data.vertices[0].co = (float("inf"), 0, 0)  # Blender makes the largest number of it
    return made


def scaled(*scale):
    made = cube()
    made.scale = scale
    return made


def shape_keys():
    made = suzanne()
    made.shape_key_add(name="Basis")
    made.shape_key_add(name="long").data[0].co.z += 2
    made.data.shape_keys.key_blocks["long"].value = 0.5
    return made


def in_mode(mode):
    made = suzanne()
    bpy.ops.object.mode_set(mode=mode)
    return made


def two_users():
    made = suzanne()
    other = bpy.data.objects.new("other", made.data)
    bpy.context.scene.collection.objects.link(other)
    return made


def two_users_smoothed():
    made = two_users()
    made.modifiers.new("smooth", "SUBSURF").levels = 1
    return made


def modified(kind, **settings):
    made = suzanne()
    modifier = made.modifiers.new(kind, kind)
    for name, value in settings.items():
        setattr(modifier, name, value)
    return made


def boolean():
    ball = cube()
    made = suzanne()
    modifier = made.modifiers.new("boolean", "BOOLEAN")
    modifier.object, modifier.operation = ball, "UNION"
    return made


def hidden():
    made = suzanne()
    made.hide_set(True)
    return made


def with_children():
    made = suzanne()
    child = cube()
    child.parent = made
    made.instance_type = "VERTS"
    return made


def long_name():
    made = cube()
    made.name = "ü" * 31
    return made


def loose_and_double():
    points = np.vstack([CUBE, CUBE[:1], [[9, 9, 9]]])
    return add_mesh("double", points, [*QUADS, QUADS[0]])


ODD = {
    "text": text, "flat text": flat_text, "metaball": metaball, "nurbs": nurbs_surface,
    "wire curve": wire_curve, "thick curve": thick_curve, "point cloud": point_cloud,
    "points": points_only, "edges": edges_only, "empty": empty_mesh, "vertex": one_vertex,
    "triangle": one_triangle, "open": open_plane, "nan": with_nan, "infinity": with_infinity,
    "no height": lambda: scaled(1, 0, 1), "mirrored": lambda: scaled(-1, 2, 1),
    "tiny": lambda: scaled(1e-9, 1e-9, 1e-9), "shape keys": shape_keys,
    "edit mode": lambda: in_mode("EDIT"), "sculpt mode": lambda: in_mode("SCULPT"),
    "weight paint": lambda: in_mode("WEIGHT_PAINT"), "two users": two_users,
    "two users smoothed": two_users_smoothed, "array": lambda: modified("ARRAY", count=3),
    "remesh": lambda: modified("REMESH", mode="VOXEL", voxel_size=0.1),
    "decimate": lambda: modified("DECIMATE", ratio=0.5),
    "bevel": lambda: modified("BEVEL", width=0.01), "solidify": lambda: modified("SOLIDIFY"),
    "boolean": boolean, "hidden": hidden, "dupli vertices": with_children,
    "long name": long_name, "loose and double": loose_and_double,
}  # fmt: skip

NO_RESULT = {"empty", "vertex", "nan", "no height", "edges"}


@pytest.mark.parametrize("kind", ODD)
def test_odd_objects(kind, scene):
    """Thickness, a skeleton and bones; after an error the mode is what it was."""
    chosen = ODD[kind]()
    mode = chosen.mode
    name = chosen.name
    for operation in ("thickness", "surface_skeleton", "armature"):
        sentence = run(operation, bpy.data.objects[name])
        if kind in NO_RESULT:
            assert sentence is not None
        if sentence is not None:
            assert bpy.data.objects[name].mode == mode or kind not in NO_RESULT
    assert not [o for o in bpy.data.objects if o.get("medialis_result")]


def test_linked_and_overridden_objects(scene, tmp_path):
    """Nothing can be added to a linked object; an override is as good as one of the file."""
    made = suzanne()
    path = str(tmp_path / "lib.blend")
    bpy.data.libraries.write(path, {made})
    bpy.data.objects.remove(made)
    with bpy.data.libraries.load(path, link=True) as (_, into):
        into.objects = ["Suzanne"]
    linked = into.objects[0]
    scene.collection.objects.link(linked)
    assert "make it local" in run("thickness", linked)
    own = linked.override_create(remap_local_usages=True)
    if own.name not in scene.collection.objects:
        scene.collection.objects.link(own)
    for operation in ("thickness", "surface_skeleton", "armature"):
        assert run(operation, own) is None
