# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigify's own meta-rig, fitted to the joints of a figure, so that its Generate button works.

Rigify brings "Basic Human" and "Basic Quadruped". Bones that we have joints for go there; those
that only Rigify has (pelvis, breast, heel, the shoulders of quadrupeds) keep their place beside
one of the others, turned and scaled as the figure is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from medialis import Armature, InvalidShapeError
from medialis.hosts import FigureParts, figure_parts

from . import armatures, placing, trying, writing

Points = NDArray[np.float64]

ADDON = "rigify"
SIDES = (".L", ".R")
LEG = ("thigh", "shin", "foot", "toe")
ARM = ("upper_arm", "forearm", "hand")
PAW = ("front_thigh", "front_shin", "front_foot", "front_toe")
KINDS: dict[str, dict[str, Any]] = {
    "biped": {
        "operator": "armature_basic_human_metarig_add",
        "limbs": (LEG, ARM),
        "spine": ("spine", "spine.001", "spine.002", "spine.003"),
        "neck": ("spine.004", "spine.005"),
        "head": "spine.006",
        "tail": (),
        "beside": {"pelvis": "spine", "breast": "spine.003"},
        "bend": {"thigh": 1.0, "upper_arm": -1.0},
    },
    "quadruped": {
        "operator": "armature_basic_quadruped_metarig_add",
        "limbs": (LEG, PAW),
        "spine": ("spine.004", "spine.005", "spine.006", "spine.007", "spine.008"),
        "neck": ("spine.009", "spine.010"),
        "head": "spine.011",
        "tail": ("spine.003", "spine.002", "spine.001", "spine"),
        "beside": {"pelvis": "spine.005", "breast": "spine.008", "shoulder": "front_thigh"},
        "bend": {"thigh": 1.0, "front_thigh": -1.0},
    },
}
"""Operators that add meta-rigs, and their bones by what they are; `bend`: whether the middle joint
of a limb goes ahead or back."""

LEAST_BEND = 0.01
"""How far the middle joint of a limb is off the straight line, of its length: Rigify finds the
axis of a knee by its bend."""

SHOULDER = (0.1, 0.87)
"""Where a collar bone begins and ends, between the foot of the neck and the upper arm."""

HEEL_BACK, HEEL_WIDE = 0.17, 0.23
"""Rigify's heel: how far behind the ankle, and half as wide, of the length of the foot."""


@dataclass(frozen=True)
class Fitted:
    """Where bones of a meta-rig go: head and tail by name, and those that go away."""

    ends: dict[str, tuple[Points, Points]]
    unused: tuple[str, ...]


def enabled(context: bpy.types.Context) -> bool:
    """Tell whether Rigify is on."""
    return ADDON in context.preferences.addons


def missing(rig: Armature, parts: FigureParts | None) -> str:
    """Say why a rig is not that of a figure with all bones; "" where it is."""
    if parts is None:
        return "Its bones have no names of a figure: run Armature with figures on, not numbered."
    trunk = ("hips", "spine", "chest", "neck", "head")
    limbs = KINDS[parts.kind]["limbs"]
    wanted = [*trunk, *(word + side for limb in limbs for word in limb for side in SIDES)]
    lacking = [name for name in wanted if name not in parts.rows]
    return f"It has no bone {lacking[0]}, which Rigify's meta-rig needs." if lacking else ""


def resampled(joints: Points, shares: Sequence[float]) -> Points:
    """Return places at shares of the length of a line of joints, (k, 3)."""
    steps = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.asarray(shares) * along[-1]
    return np.stack([np.interp(wanted, along, column) for column in joints.T], axis=1)


def fitted(rig: Armature, parts: FigureParts, given: dict[str, tuple[Points, Points]]) -> Fitted:
    """Return where the bones of a meta-rig go.

    Parameters
    ----------
    rig : Armature
        Of a figure, all bones of which `parts` knows.
    parts : FigureParts
    given : dict
        Head and tail of each bone of the meta-rig, which looks along -y and has z up.
    """
    kind, rows = KINDS[parts.kind], parts.rows
    trunk = [rows[name] for name in ("hips", "spine", "chest", "neck", "head")]
    joints = np.array([*rig.heads[trunk], rig.tails[trunk[-1]]])
    ends: dict[str, tuple[Points, Points]] = {}
    ends.update(_chain(kind["spine"], joints[:4], given))
    ends.update(_chain(kind["neck"], joints[3:5], given))
    ends[kind["head"]] = joints[4], joints[5]
    tail = [rows[name] for name in ("tail", "tail.001", "tail.002") if name in rows]
    if kind["tail"] and tail:
        # Rigify wants it to begin where the spine does.
        line = np.array([joints[0], *rig.heads[tail], rig.tails[tail[-1]]])
        ends.update(_chain(kind["tail"], line, given))
    for side in SIDES:
        for limb in kind["limbs"]:
            ends.update(_limb(rig, parts, limb, side, kind["bend"]))
        if parts.kind == "biped":
            neck, arm = joints[3], ends[f"upper_arm{side}"][0]
            ends[f"shoulder{side}"] = tuple(neck + share * (arm - neck) for share in SHOULDER)
            ends[f"heel.02{side}"] = _heel(ends, parts, side)
    frame = np.stack([parts.left, -parts.ahead, parts.up], axis=1)
    first, last = kind["spine"][0], kind["spine"][-1]
    size = np.linalg.norm(ends[last][1] - ends[first][0])
    scale = size / np.linalg.norm(given[last][1] - given[first][0])
    for word, anchor in kind["beside"].items():
        for side in SIDES:
            own = anchor if anchor in ends else anchor + side
            start = ends[own][0]
            ends[word + side] = tuple(
                start + scale * frame @ (end - given[own][0]) for end in given[word + side]
            )
    return Fitted(ends, () if tail else kind["tail"])


def _chain(
    names: Sequence[str], joints: Points, given: dict[str, tuple[Points, Points]]
) -> Iterator[tuple[str, tuple[Points, Points]]]:
    """Lay bones along joints, in the shares that they have of their own length."""
    lengths = [float(np.linalg.norm(given[name][1] - given[name][0])) for name in names]
    shares = np.concatenate([[0.0], np.cumsum(lengths) / sum(lengths)])
    places = resampled(joints, shares)
    return zip(names, pairwise(places), strict=True)


def _limb(
    rig: Armature, parts: FigureParts, words: Sequence[str], side: str, bends: dict[str, float]
) -> Iterator[tuple[str, tuple[Points, Points]]]:
    """Lay a limb on its joints; a straight one is bent a bit, the way its kind is."""
    bones = [parts.rows[word + side] for word in words]
    joints = np.array([*rig.heads[bones], rig.tails[bones[-1]]])
    whole = joints[2] - joints[0]
    length = float(np.linalg.norm(whole))
    along = whole / length
    off = joints[1] - joints[0]
    off = off - (off @ along) * along
    if np.linalg.norm(off) < LEAST_BEND * length:
        way = bends[words[0]] * parts.ahead
        way = way - (way @ along) * along
        if np.linalg.norm(way) > 0.1:
            joints[1] += LEAST_BEND * length * way / np.linalg.norm(way) - off
    names = [word + side for word in words]
    return zip(names, pairwise(joints), strict=True)


def _heel(
    ends: dict[str, tuple[Points, Points]], parts: FigureParts, side: str
) -> tuple[Points, Points]:
    """Return the heel: on the floor, behind the ankle, from the inner to the outer side."""
    ankle, toe = ends[f"foot{side}"][0], ends[f"toe{side}"][1]
    foot = toe - ankle
    floor = min(0.0, float(foot @ parts.up))
    flat = foot - (foot @ parts.up) * parts.up
    middle = ankle + floor * parts.up - HEEL_BACK * flat
    half = HEEL_WIDE * float(np.linalg.norm(flat)) * parts.left * (1 if side == ".L" else -1)
    return middle - half, middle + half


def add_metarig(context: bpy.types.Context, armature: bpy.types.Object) -> bpy.types.Object:
    """Add Rigify's meta-rig on the joints of an armature; it is active then.

    Raises
    ------
    InvalidShapeError
        When the armature is not that of a figure.
    """
    rig = armatures.in_world(armature)
    parts = figure_parts(rig)
    if told := missing(rig, parts):
        raise InvalidShapeError(f"{armature.name} is not recognised as a figure. {told}")
    assert parts is not None
    writing.leave_edit_mode(context, context.active_object)
    getattr(bpy.ops.object, KINDS[parts.kind]["operator"])()
    made = context.active_object
    made.matrix_world.identity()
    made.name = made.data.name = f"{armature.name} metarig"
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        _move(made.data.edit_bones, rig, parts)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
    placing.make_active(context, made)
    return made


def _move(bones: Any, rig: Armature, parts: FigureParts) -> None:
    """Move the bones of a meta-rig in edit mode, and turn them about themselves as they were."""
    given = {bone.name: (np.array(bone.head), np.array(bone.tail)) for bone in bones}
    sides = {bone.name: np.array(bone.z_axis) for bone in bones}
    wanted = fitted(rig, parts, given)
    frame = np.stack([parts.left, -parts.ahead, parts.up], axis=1)
    for name in wanted.unused:
        bones.remove(bones[name])
    for name, (head, tail) in wanted.ends.items():
        bones[name].head, bones[name].tail = head.tolist(), tail.tolist()
    for name, (head, tail) in wanted.ends.items():
        before = Vector((frame @ (given[name][1] - given[name][0])).tolist())
        turn = before.rotation_difference(Vector((tail - head).tolist()))
        bones[name].align_roll(turn @ Vector((frame @ sides[name]).tolist()))


class MEDIALIS_OT_rigify_metarig(bpy.types.Operator):
    """Fit Rigify's own meta-rig to the joints of a figure; its Generate button makes the rig"""  # noqa: D400 - a tooltip

    bl_idname = "medialis.rigify_metarig"
    bl_label = "Make a Rigify Meta-Rig"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Allow it for armatures, and what they move, where Rigify is on."""
        if trying.armature_of(context) is None:
            cls.poll_message_set("Select an armature, or an object that one moves")
            return False
        if not enabled(context):
            cls.poll_message_set("Turn on the add-on Rigify in the preferences first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the meta-rig."""
        try:
            made = add_metarig(context, trying.armature_of(context))
        except InvalidShapeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        text = f"{made.name} is fitted: press Generate Rig in its armature properties."
        self.report({"INFO"}, text)
        return {"FINISHED"}


_classes = (trying.MEDIALIS_OT_test_poses, MEDIALIS_OT_rigify_metarig)


def register() -> None:
    """Add the operators for armatures."""
    for made in _classes:
        bpy.utils.register_class(made)


def unregister() -> None:
    """Remove them."""
    for made in reversed(_classes):
        bpy.utils.unregister_class(made)
