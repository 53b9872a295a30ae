# SPDX-License-Identifier: GPL-3.0-or-later
"""Test poses: an action that bends an armature at each main joint, and goes again without a trace.

The user's own action, and the pose, are kept with it and come back when it goes.
"""

from __future__ import annotations

import json
from typing import Any, ClassVar

import bpy
from mathutils import Matrix, Quaternion

from medialis import Armature, InvalidShapeError
from medialis.hosts import test_poses

from . import armatures, own, reading
from .own import TEST_POSES

ACTION = "medialis test poses"
BEFORE = "medialis_before"
"""Custom property of the action: the action that was there before, which keeps its user by it."""
STEP = 10
"""Frames from rest to a pose, and back."""


def armature_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """Return the active armature, or that which moves the object that is worked on."""
    active = context.active_object
    if active is not None and active.type == "ARMATURE":
        return active
    chosen = reading.target(context)
    return None if chosen is None else armatures.of_user(context, chosen)


def has_test_poses(armature: bpy.types.Object) -> bool:
    """Tell whether the action of test poses is on an armature."""
    data = armature.animation_data
    return data is not None and data.action is not None and TEST_POSES in data.action


def add_test_poses(armature: bpy.types.Object, first: int) -> int:
    """Add the action from a frame on, and return how many joints it bends.

    Raises
    ------
    InvalidShapeError
        When there is no joint, or the armature cannot be animated now.
    """
    rig = armatures.deforming(armature)
    bends = test_poses(rig)
    if not bends:
        raise InvalidShapeError(f"No bone of {armature.name} hangs on another one.")
    data = armature.animation_data
    if data is not None and data.use_tweak_mode:
        raise InvalidShapeError(
            f"A strip of {armature.name} is being edited: leave tweak mode first (Tab in the "
            "nonlinear animation)."
        )
    turned = [(rig.names[bone], bend, row)
              for bend in bends for row, bone in enumerate(bend.bones.tolist())]  # fmt: skip
    kept = {name: _rotation(armature.pose.bones[name]) for name, _, _ in turned}
    about = {"animated": data is not None, "pose": kept, "slot": _slot(data)}
    data = data or armature.animation_data_create()
    before, action = data.action, bpy.data.actions.new(ACTION)
    own.mark(action, TEST_POSES, json.dumps(about))
    if before is not None:
        action[BEFORE] = before
    data.action = action
    for name in kept:
        _key(armature.pose.bones[name], Quaternion(), first)
    for count, bend in enumerate(bends):
        begin = first + 2 * STEP * count
        for name, turn in _turns(armature, rig, bend):
            bone = armature.pose.bones[name]
            for frame, pose in ((0, Quaternion()), (STEP, turn), (2 * STEP, Quaternion())):
                _key(bone, pose, begin + frame)
    return len(bends)


def remove_test_poses(armature: bpy.types.Object) -> None:
    """Take the action away; the action, slot and pose from before are back."""
    data = armature.animation_data
    action = data.action
    about, before = json.loads(action[TEST_POSES]), action.get(BEFORE)
    data.action = before
    if before is not None and about["slot"] and hasattr(data, "action_slot"):
        data.action_slot = before.slots.get(about["slot"])
    for name, (mode, values) in about["pose"].items():
        if (bone := armature.pose.bones.get(name)) is not None and bone.rotation_mode == mode:
            setattr(bone, _path(mode), values)
    if not about["animated"] and not (data.drivers or data.nla_tracks):
        armature.animation_data_clear()
    if action.users == 0 and own.is_own(action, bpy.data.actions):
        bpy.data.actions.remove(action)
    else:  # the user has put it elsewhere, too, or made it an own one
        own.release(action)


def _turns(armature: bpy.types.Object, rig: Armature, bend: Any) -> list[tuple[str, Quaternion]]:
    """Return how the bones of a bend turn, in their own axes."""
    found = []
    for bone, turn in zip(bend.bones.tolist(), bend.turns, strict=True):
        rest = armature.data.bones[rig.names[bone]].matrix_local.to_3x3()
        local = rest.inverted() @ Matrix(turn.tolist()) @ rest
        found.append((rig.names[bone], local.to_quaternion()))
    return found


def _key(bone: bpy.types.PoseBone, turn: Quaternion, frame: int) -> None:
    """Key a rotation in the mode that the user has chosen for the bone."""
    if bone.rotation_mode == "QUATERNION":
        bone.rotation_quaternion = turn
    elif bone.rotation_mode == "AXIS_ANGLE":
        axis, angle = turn.to_axis_angle()
        bone.rotation_axis_angle = (angle, *axis)
    else:
        bone.rotation_euler = turn.to_euler(bone.rotation_mode)
    bone.keyframe_insert(_path(bone.rotation_mode), frame=frame, group=bone.name)


def _path(mode: str) -> str:
    named = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
    return named.get(mode, "rotation_euler")


def _rotation(bone: bpy.types.PoseBone) -> tuple[str, list[float]]:
    return bone.rotation_mode, list(getattr(bone, _path(bone.rotation_mode)))


def _slot(data: Any) -> str:
    """Return the slot of the action that an object uses, where Blender has slots (4.4)."""
    slot = getattr(data, "action_slot", None)
    return "" if slot is None else slot.identifier


class MEDIALIS_OT_test_poses(bpy.types.Operator):
    """Add an action that bends the armature at each main joint, or take it away again"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.test_poses"
    bl_label = "Test Poses"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for armatures that are no part of another file, and what they move."""
        armature = armature_of(context)
        if armature is None or armature.library is not None:
            cls.poll_message_set("Select an armature, or an object that one moves")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the action, or remove it; nothing else changes."""
        armature = armature_of(context)
        if has_test_poses(armature):
            remove_test_poses(armature)
            self.report({"INFO"}, "The test poses are gone.")
            return {"FINISHED"}
        try:
            count = add_test_poses(armature, context.scene.frame_start)
        except InvalidShapeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        last = context.scene.frame_start + 2 * STEP * count
        text = (
            f"{count} joints bend one after the other up to frame {last}. Run it again to undo it."
        )
        self.report({"INFO"}, text)
        return {"FINISHED"}
