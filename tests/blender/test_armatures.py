"""Armatures in Blender: bones, weights as vertex groups, posing moves the right limb."""

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import medialis
from blender_scenes import add_mesh, add_object, counts, evaluated, groups_of, read_back


@pytest.fixture(scope="module")
def creature():
    """The generated shape as Blender holds it, and what the core finds in it."""
    made = medialis.organic_shape(72)
    points = made.points.astype(np.float32).astype(float)
    shape = medialis.make_shape(points, made.faces, repair=True)
    result = medialis.run("armature", shape)
    bones = shape.on_input_points(result.extras["skin"].bones, -1)  # repair merges two vertices
    weights = shape.on_input_points(result.extras["skin"].weights, 0.0)
    return (
        points,
        made.faces,
        replace(result, extras={**result.extras, "skin": medialis.SkinWeights(bones, weights)}),
    )


def seen(chosen):
    """Return the points of an object in the world, as Blender shows it."""
    shown = evaluated(chosen)
    mesh = shown.to_mesh()
    points = read_back(mesh, "position").astype(float)
    shown.to_mesh_clear()
    matrix = np.array(shown.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def weights_of(chosen, count):
    found = np.zeros((len(chosen.data.vertices), count))
    names = [group.name for group in chosen.vertex_groups if group.name != "mine"]
    for vertex in chosen.data.vertices:
        for entry in vertex.groups:
            name = chosen.vertex_groups[entry.group].name
            if name != "mine":
                found[vertex.index, names.index(name)] = entry.weight
    return found


def expected_weights(result):
    return np.stack(
        [result.extras["skin"].of_bone(bone) for bone in range(result.extras["bones"].count)],
        axis=1,
    )


def test_bones_and_weights_are_those_of_the_core(creature, scene, tmp_path):
    """Also after saving and loading the file."""
    points, faces, result = creature
    chosen = add_mesh("creature", points, faces)
    chosen.vertex_groups.new(name="mine").add([3, 4], 0.5, "REPLACE")
    assert bpy.ops.medialis.armature() == {"FINISHED"}
    assert bpy.context.active_object.type == "ARMATURE" and bpy.context.mode == "OBJECT"
    path = str(tmp_path / "file.blend")
    for _ in range(2):
        armature, chosen = bpy.data.objects["creature armature"], bpy.data.objects["creature"]
        rig, bones = result.extras["bones"], armature.data.bones
        assert [bone.name for bone in bones] == list(rig.names)
        for number, bone in enumerate(bones):
            assert np.allclose(bone.head_local, rig.heads[number], atol=1e-5)
            assert np.allclose(bone.tail_local, rig.tails[number], atol=1e-5)
            above = -1 if bone.parent is None else rig.names.index(bone.parent.name)
            assert above == rig.parents[number] and bone.use_connect == rig.connected[number]
        # Blender keeps weights in single precision.
        assert np.abs(weights_of(chosen, rig.count) - expected_weights(result)).max() < 1e-6
        assert groups_of(chosen)["mine"] == [3, 4]
        assert armature.parent == chosen and list(chosen.modifiers.keys()) == ["Medialis look"]
        assert (read_back(chosen.data, "bone") == result.extras["skin"].bones[:, 0]).all()
        bpy.ops.wm.save_as_mainfile(filepath=path, check_existing=False)
        bpy.ops.wm.open_mainfile(filepath=path)


def test_again_from_the_result_replaces_the_groups(creature, scene):
    points, faces, result = creature
    chosen = add_mesh("creature", points, faces)
    bpy.ops.medialis.armature(bone_length=5.0, figures=False)
    many = len(chosen.vertex_groups)
    bpy.ops.medialis.armature()  # the active armature stands for its source
    assert len(chosen.vertex_groups) == result.extras["bones"].count < many
    assert bpy.data.armatures.keys() == ["creature armature"]


@pytest.mark.parametrize("with_parent", [False, True])
def test_posing_a_bone_moves_its_limb_only(with_parent, creature, scene):
    """On a turned, mirrored, scaled object; binding itself moves nothing."""
    points, faces, _ = creature
    place = {"location": (5, -2, 1), "rotation_euler": (0.3, 0.2, 1.0), "scale": (2, -1.5, 1)}
    chosen = add_mesh("creature", points, faces, **place)
    if with_parent:
        above = add_object("above", None, location=(1, 2, 3), scale=(1, 2, 0.5))
        chosen.parent = above
        bpy.context.view_layer.objects.active = chosen
    before = seen(chosen)
    assert bpy.ops.medialis.armature(bind=True) == {"FINISHED"}
    armature = bpy.context.active_object
    assert chosen.parent == armature and chosen.modifiers[0].object == armature
    assert armature.parent == (above if with_parent else None)
    assert np.abs(seen(chosen) - before).max() < 1e-5  # of coordinates below 10, in float32
    bone = armature.pose.bones[-1]
    bone.rotation_mode = "XYZ"
    bone.rotation_euler = (0.6, 0.0, 0.0)
    moved = np.linalg.norm(seen(chosen) - before, axis=1)
    weight = weights_of(chosen, len(armature.data.bones))[:, -1]
    assert (moved[weight == 0] < 1e-5).all()
    tail = np.array(armature.matrix_world @ bone.bone.tail_local)
    tip = np.argmin(np.linalg.norm(before - tail, axis=1))
    assert weight[tip] > 0.9 and moved[tip] > 0.1 * bone.bone.length
    armature.location.x += 3  # and all of it follows the armature
    bone.rotation_euler = (0, 0, 0)
    assert np.allclose(seen(chosen) - before, seen(chosen)[0] - before[0], atol=1e-4)
    assert np.linalg.norm(seen(chosen)[0] - before[0]) == pytest.approx(3, abs=1e-4)


def test_undo_and_redo(creature, scene):
    points, faces, result = creature
    add_mesh("creature", points, faces)
    bpy.ops.ed.undo_push(message="before")
    before = counts()
    bpy.ops.medialis.armature("EXEC_DEFAULT", True, bind=True)
    after = counts()
    bpy.ops.ed.undo()
    chosen = bpy.data.objects["creature"]
    assert counts() == before and not chosen.vertex_groups and not chosen.modifiers
    assert chosen.parent is None
    bpy.ops.ed.redo()
    chosen = bpy.data.objects["creature"]
    assert counts() == after and len(chosen.vertex_groups) == result.extras["bones"].count
    assert (
        chosen.parent.type == "ARMATURE"
        and len(chosen.parent.data.bones) == result.extras["bones"].count
    )


def test_failures_change_nothing(creature, scene, monkeypatch):
    from blender_addon import armatures

    points, faces, _ = creature
    chosen = add_mesh("creature", points, faces)
    chosen.vertex_groups.new(name="bone 000").add([1], 1.0, "REPLACE")

    def broken(*_, **__):
        raise medialis.InvalidShapeError("It broke.")

    for name in ("write_weights", "bind", "_add_bones"):
        before = counts()
        with monkeypatch.context() as patch:
            patch.setattr(armatures, name, broken)
            with pytest.raises(RuntimeError, match="It broke"):
                bpy.ops.medialis.armature(bind=True)
        chosen = bpy.data.objects["creature"]
        assert counts() == before and groups_of(chosen) == {"bone 000": [1]}
        assert chosen.parent is None and not chosen.modifiers
        assert bpy.context.view_layer.objects.active == chosen and bpy.context.mode == "OBJECT"
    own = add_object("own", bpy.data.armatures.new("own"))
    bpy.context.view_layer.objects.active = chosen
    chosen.modifiers.new("mine", "ARMATURE").object = own
    before = counts()
    with pytest.raises(RuntimeError, match="is moved by the armature of its modifier mine"):
        bpy.ops.medialis.armature(bind=True)
    assert counts() == before and chosen.modifiers["mine"].object == own


def bend(armature):
    bone = armature.pose.bones[-1]
    bone.rotation_mode = "XYZ"
    bone.rotation_euler = (0.6, 0.0, 0.0)


@pytest.mark.parametrize("with_parent", [False, True])
def test_binding_again_replaces_the_armature(with_parent, creature, scene, monkeypatch):
    """Also below a parent and posed: new bones lie in the shape at rest, as the first did."""
    points, faces, _ = creature
    place = {"location": (5, -2, 1), "rotation_euler": (0.3, 0.2, 1.0), "scale": (2, -1.5, 1)}
    chosen = add_mesh("creature", points, faces, **place)
    above = None
    if with_parent:
        above = add_object("above", None, location=(1, 2, 3), scale=(1, 2, 0.5))
        chosen.parent = above
        bpy.context.view_layer.objects.active = chosen
    before = seen(chosen)
    heads = None
    for _ in range(3):
        bpy.ops.medialis.armature(bind=True)
        armature = bpy.context.active_object
        assert bpy.data.armatures.keys() == ["creature armature"] and chosen.parent == armature
        assert list(chosen.modifiers.keys()) == ["Medialis armature", "Medialis look"]
        assert chosen.modifiers[0].object == armature and armature.parent == above
        found = np.array([bone.head_local for bone in armature.data.bones])
        heads = found if heads is None else heads
        if not with_parent:  # a matrix of other last digits may add a bone
            assert np.abs(found - heads).max() < 1e-4
        assert np.abs(seen(chosen) - before).max() < 1e-5
        bend(armature)
        assert np.abs(seen(chosen) - before).max() > 0.01
    posed, total = seen(chosen), counts()

    def broken(*_):
        raise medialis.InvalidShapeError("It broke.")

    with monkeypatch.context() as patch:  # after binding
        patch.setattr("blender_addon.looks.show_with", broken)
        with pytest.raises(RuntimeError, match="It broke"):
            bpy.ops.medialis.armature(bind=True)
    assert counts() == total and chosen.parent == armature and armature.parent == above
    assert np.abs(seen(chosen) - posed).max() < 1e-5
    bpy.ops.medialis.armature(bind=True)
    bpy.ops.medialis.remove_result()
    assert not bpy.data.armatures and not chosen.modifiers and chosen.parent == above
    assert np.abs(seen(chosen) - before).max() < 1e-5


def test_below_modifiers_the_object_itself_is_rigged(creature, scene):
    """The vertices that are seen are others: the object's own get their weights."""
    points, faces, _ = creature
    chosen = add_mesh("creature", np.add(points, [0.0, 2.0, 0.0]), faces)
    chosen.modifiers.new("mirror", "MIRROR").use_axis = (False, True, False)
    chosen.modifiers.new("smooth", "SUBSURF").levels = 1
    before = seen(chosen)
    assert bpy.ops.medialis.armature(bind=True) == {"FINISHED"}
    names = ["mirror", "Medialis armature", "smooth", "Medialis look"]
    assert list(chosen.modifiers.keys()) == names and not chosen.hide_render
    armature = chosen.parent
    weights = weights_of(chosen, len(armature.data.bones))
    assert np.allclose(weights.sum(axis=1), 1, atol=1e-5)
    assert np.abs(seen(chosen) - before).max() < 1e-5  # binding moves nothing
    armature.pose.bones[-1].rotation_mode = "XYZ"
    armature.pose.bones[-1].rotation_euler = (0.6, 0.0, 0.0)
    assert np.abs(seen(chosen) - before).max() > 0.01


def test_bones_are_turned_as_the_core_says(creature, scene):
    """Their z axes are those of the core; so equal turns about x bend both sides alike."""
    from medialis.rigging.naming import roll_axes

    points, faces, result = creature
    add_mesh("creature", points, faces)
    bpy.ops.medialis.armature()
    bones = bpy.context.active_object.data.bones
    for bone, axis in zip(bones, roll_axes(result.extras["bones"]), strict=True):
        assert np.allclose(np.array(bone.matrix_local)[:3, 2], axis, atol=1e-3)


def test_names_of_rigify(creature, scene):
    """Bones and vertex groups have them; another run with numbers takes the groups along."""
    points, faces, result = creature
    chosen = add_mesh("creature", points, faces)
    bpy.ops.medialis.armature(naming="rigify")
    names = [bone.name for bone in bpy.context.active_object.data.bones]
    assert {"spine", "thigh.L", "thigh.R", "front_shin.L", "tail"} <= set(names)
    assert [group.name for group in chosen.vertex_groups] == names
    bpy.ops.medialis.armature()
    assert [group.name for group in chosen.vertex_groups] == list(result.extras["bones"].names)
