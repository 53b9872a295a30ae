"""Rigify's own meta-rig on the joints of a figure, its Generate, and test poses of an armature."""

from itertools import pairwise

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: make hosts")
import addon_utils  # comes with bpy

from blender_scenes import add_armature, add_mesh, select

TRUNK = [("hips", (0, 0.02, 0.95)), ("spine", (0, 0, 1.05)), ("chest", (0, 0, 1.2)),
         ("neck", (0, 0.02, 1.42)), ("head", (0, 0, 1.52)), (None, (0, 0, 1.75))]  # fmt: skip
ARM = [("upper_arm", (0.18, 0, 1.38)), ("forearm", (0.45, 0.02, 1.36)), ("hand", (0.7, 0, 1.35)),
       (None, (0.85, 0, 1.35))]  # fmt: skip
LEG = [("thigh", (0.1, 0, 0.9)), ("shin", (0.11, -0.02, 0.5)), ("foot", (0.11, 0, 0.08)),
       ("toe", (0.11, -0.12, 0.03)), (None, (0.11, -0.2, 0.02))]  # fmt: skip
BACK = [("hips", (0, 0.6, 0.8)), ("spine", (0, 0.3, 0.82)), ("chest", (0, 0, 0.8)),
        ("neck", (0, -0.3, 0.85)), ("head", (0, -0.5, 1.1)), (None, (0, -0.75, 1.05))]  # fmt: skip
TAIL = [("tail", (0, 0.65, 0.8)), ("tail.001", (0, 0.8, 0.7)), ("tail.002", (0, 0.9, 0.6)),
        (None, (0, 1.0, 0.5))]  # fmt: skip
FRONT = [("front_thigh", (0.12, -0.2, 0.7)), ("front_shin", (0.12, -0.15, 0.45)),
         ("front_foot", (0.12, -0.17, 0.15)), ("front_toe", (0.12, -0.2, 0.05)),
         (None, (0.12, -0.27, 0.0))]  # fmt: skip
HIND = [("thigh", (0.12, 0.5, 0.7)), ("shin", (0.12, 0.42, 0.45)), ("foot", (0.12, 0.55, 0.2)),
        ("toe", (0.12, 0.5, 0.05)), (None, (0.12, 0.43, 0.0))]  # fmt: skip


def chain(joints, parent, side="", scale=1.0):
    """Return bones as `add_armature` takes them, for one side or the middle."""
    found = []
    for (name, head), (_, tail) in pairwise(joints):
        sign = -1 if side == ".R" else 1
        ends = [tuple(scale * np.array(end) * [sign, 1, 1]) for end in (head, tail)]
        found.append((name + side, *ends, parent, True))
        parent = name + side
    return found


def figure(kind, scale=1.0, tail=True):
    if kind == "biped":
        bones = chain(TRUNK, None, "", scale)
        for side in (".L", ".R"):
            start = [("shoulder", (0, 0.02, 1.42)), (None, ARM[0][1])]
            bones += chain(start, "chest", side, scale)
            bones += chain(ARM, "shoulder" + side, side, scale)
            bones += chain(LEG, "hips", side, scale)
        return bones
    bones = chain(BACK, None, "", scale) + (chain(TAIL, "hips", "", scale) if tail else [])
    for side in (".L", ".R"):
        bones += chain(FRONT, "chest", side, scale) + chain(HIND, "hips", side, scale)
    return bones


@pytest.fixture
def rigify(scene):
    """Rigify, turned on as in the preferences."""
    if addon_utils.enable("rigify", default_set=True) is None:
        pytest.skip("this Blender brings no Rigify")
    yield
    addon_utils.disable("rigify", default_set=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind, tail", [("biped", False), ("quadruped", True), ("quadruped", False)]
)
def test_generate_works_on_the_fitted_metarig(kind, tail, rigify):
    """Bones are where the joints are, also of a small figure that is turned and lies elsewhere."""
    armature = add_armature("figure", figure(kind, 0.3, tail))
    armature.location, armature.rotation_euler = (4, 1, 0), (0, 0, 0.7)
    bpy.context.view_layer.update()
    before = {b.name: (b.head_local.copy(), b.tail_local.copy()) for b in armature.data.bones}
    assert bpy.ops.medialis.rigify_metarig() == {"FINISHED"}
    made = bpy.context.active_object
    assert made.name == "figure metarig" and bpy.context.mode == "OBJECT"
    size = 0.3 * 1.75
    for name in ("thigh.L", "shin.R", "foot.L"):
        bone = made.data.bones[name]
        for own, ours in zip((bone.head_local, bone.tail_local), before[name], strict=True):
            assert (own - armature.matrix_world @ ours).length < 0.01 * size
    assert made.data.bones["thigh.L"].parent is not None
    assert bpy.ops.pose.rigify_generate() == {"FINISHED"}
    rig = bpy.context.active_object
    deform = {bone.name: bone for bone in rig.data.bones if bone.name.startswith("DEF-")}
    assert ("DEF-spine" in deform) == (tail or kind == "biped")
    knee = rig.matrix_world @ deform["DEF-shin.L"].head_local
    assert (knee - armature.matrix_world @ before["shin.L"][0]).length < 0.01 * size
    assert {b.name: (b.head_local, b.tail_local) for b in armature.data.bones} == before


def test_a_numbered_rig_and_rigify_off_are_told(scene, rigify):
    add_armature("rig", [("bone 000", (0, 0, 0), (0, 0, 1), None, True)])
    count = len(bpy.data.objects)
    with pytest.raises(RuntimeError, match="not recognised as a figure"):
        bpy.ops.medialis.rigify_metarig()
    assert len(bpy.data.objects) == count
    add_armature("half", [bone for bone in figure("biped") if bone[0] != "toe.L"])
    with pytest.raises(RuntimeError, match=r"no bone toe.L"):
        bpy.ops.medialis.rigify_metarig()
    addon_utils.disable("rigify", default_set=True)
    with pytest.raises(RuntimeError, match="Turn on the add-on Rigify"):
        bpy.ops.medialis.rigify_metarig()


def posed(armature, frame):
    """Return where bones are in a frame."""
    bpy.context.scene.frame_set(frame)
    return {bone.name: np.array(bone.matrix.to_3x3()) for bone in armature.pose.bones}


def turned(one, other):
    """Return the degrees between two orientations of a bone."""
    return np.degrees(np.arccos(np.clip((np.trace(one.T @ other) - 1) / 2, -1, 1)))


@pytest.mark.parametrize("mode", ["QUATERNION", "ZXY", "AXIS_ANGLE"])
def test_test_poses_bend_each_joint_and_leave_no_trace(mode, scene):
    armature = add_armature("figure", figure("biped"))
    for bone in armature.pose.bones:
        bone.rotation_mode = mode
    rest, frame = posed(armature, 1), scene.frame_current
    actions = set(bpy.data.actions.keys())
    assert bpy.ops.medialis.test_poses() == {"FINISHED"}
    assert {*bpy.data.actions.keys()} - actions == {"medialis test poses"}
    elbows, knees = posed(armature, 11), posed(armature, 51)
    for side in (".L", ".R"):
        assert turned(rest["forearm" + side], elbows["forearm" + side]) == pytest.approx(
            80, abs=0.1
        )
        assert turned(rest["upper_arm" + side], elbows["upper_arm" + side]) < 0.1
        assert turned(rest["shin" + side], knees["shin" + side]) == pytest.approx(80, abs=0.1)
        # Forearms go ahead (-y), shins back.
        assert elbows["forearm" + side][1, 1] < -0.9 and knees["shin" + side][1, 1] > 0.9
    scene.frame_set(frame)
    assert bpy.ops.medialis.test_poses() == {"FINISHED"}
    assert set(bpy.data.actions.keys()) == actions and armature.animation_data is None
    again = posed(armature, 11)
    assert all(np.allclose(again[name], rest[name], atol=1e-6) for name in rest)


def test_the_users_action_and_pose_come_back(scene, tmp_path):
    """Also from a saved file: the test poses keep the action of the user in it."""
    armature = add_armature("figure", figure("biped"))
    head = armature.pose.bones["head"]
    head.rotation_quaternion = (0.9, 0.1, 0, 0)
    head.keyframe_insert("rotation_quaternion", frame=1)
    armature.pose.bones["forearm.L"].rotation_quaternion = (0.8, 0, 0, 0.6)
    mine = armature.animation_data.action.name
    slot = getattr(armature.animation_data, "action_slot", None)
    before = posed(armature, 1)
    assert bpy.ops.medialis.test_poses() == {"FINISHED"}
    path = str(tmp_path / "file.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, check_existing=False)
    bpy.ops.wm.open_mainfile(filepath=path)
    armature = bpy.data.objects["figure"]
    bpy.context.view_layer.objects.active = armature
    assert bpy.ops.medialis.test_poses() == {"FINISHED"}
    data = armature.animation_data
    assert data.action.name == mine and [*bpy.data.actions.keys()] == [mine]
    assert slot is None or data.action_slot.identifier.startswith("OB")
    after = posed(armature, 1)
    assert all(np.allclose(after[name], before[name], atol=1e-6) for name in before)


def test_test_poses_of_a_result_are_undone(scene):
    add_mesh("figure", np.eye(3), [[0, 1, 2]])
    select(add_armature("rig", figure("quadruped")))
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.medialis.test_poses("EXEC_DEFAULT", True)
    assert len(bpy.data.actions) == 1
    bpy.ops.ed.undo()
    assert not bpy.data.actions and bpy.data.objects["rig"].animation_data is None
