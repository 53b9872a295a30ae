"""How bones are turned about themselves, and what the bones of figures are called elsewhere.

Bones bend about their own x axis (`roll_axes`, `rolls`). Names of the bones of a biped or quadruped
(`figure_bones.py`) are translated into those of Rigify, Mixamo, Unreal and VRM by tables, word by
word: other names are one more entry of `TARGETS` and a choice of the operation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import unit_rows
from medialis.base.validation import FloatArray
from medialis.rigging.bones import Bones

BENT = 0.1
"""Sine of the bends of a limb, added up as vectors, from which on they say how it bends."""

ALONG = 0.9
"""Cosine of the angle to the axis across the body from which on a straight limb points along it."""


def roll_axes(rig: Bones) -> FloatArray:
    """Return the z axis of each bone, (b, 3): unit, at right angles to the bone.

    All bones of a limb bend about the same axis, their x axis: that about which the limb is bent
    already. A straight limb bends about the axis across the body, or about the vertical (z, of a
    figure its own) where it points across the body itself. The axes of mirrored bones are mirror
    images, as the mirrored poses of Blender want it.

    Examples
    --------
    >>> import medialis
    >>> nodes, edges = [[0, 0, 0], [4, 0, 0], [4, 4, 0]], [[0, 1], [1, 2]]
    >>> elbow = medialis.CurveSkeleton.of(nodes, edges, [1, 1, 1])
    >>> roll_axes(medialis.bones(elbow)).round(6).tolist()
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    """
    along = unit_rows(rig.tails - rig.heads)
    across = _across(rig) if rig.frame is None else rig.frame[0]
    up = np.array([0.0, 0.0, 1.0]) if rig.frame is None else rig.frame[2]
    axes = np.zeros((rig.count, 3))
    for limb in range(int(rig.limbs.max(initial=-1)) + 1):
        rows = np.flatnonzero(rig.limbs == limb)
        if rig.sides[rows[0]] >= 0:
            inside = rig.parents[rows[0]] >= 0
            axes[rows] = _limb_axes(along[rows], across, up, inside)
    if across is not None:
        right = np.flatnonzero(rig.sides < 0)
        seen = axes[rig.mirrors[right]]
        image = seen - 2 * (seen @ across)[:, None] * across
        # Limbs are mirror images up to their own irregularities.
        axes[right] = unit_rows(image - (image * along[right]).sum(axis=1)[:, None] * along[right])
    return axes


def _across(rig: Bones) -> FloatArray | None:
    """Return the axis from the right to the left side, None without mirrored bones."""
    left = np.flatnonzero(rig.sides > 0)
    if len(left) == 0:
        return None
    apart = (rig.tails[left] - rig.tails[rig.mirrors[left]]).sum(axis=0)
    return np.asarray(apart / np.linalg.norm(apart)) if apart.any() else None


def _limb_axes(
    along: FloatArray, across: FloatArray | None, up: FloatArray, inside: bool
) -> FloatArray:
    """Return the z axes of the bones of a limb, whose directions are (k, 3).

    The first one may lie inside what the limb hangs on: its bend is that of the hip.
    """
    outside = along[1:] if inside else along
    bend = np.cross(outside[:-1], outside[1:]).sum(axis=0)
    whole = unit_rows(along.sum(axis=0)) if along.sum(axis=0).any() else along[0]
    if np.linalg.norm(bend) >= BENT:
        axis = bend
    elif across is not None and abs(whole @ across) < ALONG:
        axis = across
    elif abs(whole @ up) < ALONG:
        axis = up
    else:
        axis = np.array([1.0, 0.0, 0.0])
    found = np.empty_like(along)
    for row, direction in enumerate(along):
        x = axis - (axis @ direction) * direction
        if np.linalg.norm(x) < 1e-6:  # this bone points along the axis: it keeps the last one
            x = np.cross(direction, found[row - 1]) if row else np.roll(direction, 1)
            x = x - (x @ direction) * direction
        found[row] = np.cross(x / np.linalg.norm(x), direction)
    return found


def rolls(rig: Bones) -> FloatArray:
    """Return the roll of each bone as Blender has it, (b,) radians, where z is up.

    That of a bone whose z axis is the one of `roll_axes`: the angle from the axis that the shortest
    turn of y to the bone gives.

    Examples
    --------
    >>> import medialis
    >>> line = medialis.CurveSkeleton.of([[0, 0, 0], [0, 4, 0]], [[0, 1]], [1, 1])
    >>> rolls(medialis.bones(line)).round(6).tolist()
    [-1.570796]
    """
    along, wanted = unit_rows(rig.tails - rig.heads), roll_axes(rig)
    found = np.zeros(rig.count)
    for bone, (x, y, z) in enumerate(along.tolist()):
        # The shortest turn of y to the bone takes z there; a bone along -y is turned about z.
        if 1.0 + y < 1e-9:
            rest = np.array([0.0, 0.0, 1.0])
        else:
            rest = np.array([-x * z / (1.0 + y), -z, 1.0 - z * z / (1.0 + y)])
        sine = along[bone] @ np.cross(rest, wanted[bone])
        found[bone] = np.arctan2(sine, rest @ wanted[bone])
    return found


RIGIFY = {"hips": "spine", "spine": "spine.001", "chest": "spine.003", "neck": "spine.004",
          "head": "spine.006"}  # fmt: skip
"""Rigify's human has more bones in its spine; these are those of the same places."""

MIXAMO = {
    "hips": "Hips", "spine": "Spine", "chest": "Spine2", "neck": "Neck", "head": "Head",
    "shoulder": "Shoulder", "upper_arm": "Arm", "forearm": "ForeArm", "hand": "Hand",
    "thigh": "UpLeg", "shin": "Leg", "foot": "Foot", "toe": "ToeBase", "tail": "Tail",
    "front_thigh": "Arm", "front_shin": "ForeArm", "front_foot": "Hand",
    "front_toe": "HandMiddle1",
}  # fmt: skip

UNREAL = {
    "hips": "pelvis", "spine": "spine_01", "chest": "spine_03", "neck": "neck_01", "head": "head",
    "shoulder": "clavicle", "upper_arm": "upperarm", "forearm": "lowerarm", "hand": "hand",
    "thigh": "thigh", "shin": "calf", "foot": "foot", "toe": "ball", "tail": "tail",
    "front_thigh": "upperarm", "front_shin": "lowerarm", "front_foot": "hand",
    "front_toe": "front_ball",
}  # fmt: skip

VRM = {
    "hips": "hips", "spine": "spine", "chest": "chest", "neck": "neck", "head": "head",
    "shoulder": "Shoulder", "upper_arm": "UpperArm", "forearm": "LowerArm", "hand": "Hand",
    "thigh": "UpperLeg", "shin": "LowerLeg", "foot": "Foot", "toe": "Toes", "tail": "tail",
}  # fmt: skip


@dataclass(frozen=True)
class Target:
    """How a program names the bones of figures.

    Attributes
    ----------
    words : dict
        By the words of this project; others stay as they are.
    full : str
        `{left}`: what is said of the side before the word, `{word}`, `{number}`: of the bones of a
        tail, `{side}`: what is said of the side behind.
    left, side : tuple of str
        For left, none and right.
    number : str
        The number of a bone of a chain after the first, by `{k}`.
    kinds : tuple of str
        Figures that it has names for.
    """

    words: dict[str, str]
    full: str = "{left}{word}{number}{side}"
    left: tuple[str, str, str] = ("", "", "")
    side: tuple[str, str, str] = ("", "", "")
    number: str = "{k}"
    kinds: tuple[str, ...] = ("biped", "quadruped")

    def name(self, part: str) -> str:
        """Return the name for a part: "thigh.L", "tail.001"."""
        word, _, mark = part.partition(".")
        row = {"L": 0, "R": 2}.get(mark, 1)
        number = self.number.format(k=int(mark)) if mark.isdigit() else ""
        return self.full.format(left=self.left[row], word=self.words.get(word, word),
                                number=number, side=self.side[row])  # fmt: skip


DOTS = (".L", "", ".R")

TARGETS = {
    "plain": Target({}, side=DOTS, number=".{k:03d}"),
    "rigify": Target(RIGIFY, side=DOTS, number=".{k:03d}"),
    "mixamo": Target(MIXAMO, full="mixamorig:{left}{word}{number}", left=("Left", "", "Right")),
    "unreal": Target(UNREAL, side=("_l", "", "_r"), number="_{k:02d}"),
    "vrm": Target(VRM, left=("left", "", "right"), number="{k}", kinds=("biped",)),
}
"""Names by what they are like."""


def target_names(rig: Bones, target: str) -> tuple[str, ...]:
    """Return the names of the bones of a figure for a program, one for each bone.

    Parameters
    ----------
    rig : Bones
        Of a figure: `rig.kind` is not empty, its names are those of this project.
    target : {"plain", "rigify", "mixamo", "unreal", "vrm"}
        A program that has no names for figures of this kind gets the plain ones.

    Examples
    --------
    >>> TARGETS["mixamo"].name("thigh.L"), TARGETS["unreal"].name("forearm.R")
    ('mixamorig:LeftUpLeg', 'lowerarm_r')
    """
    wanted = TARGETS[target]
    if rig.kind not in wanted.kinds:
        wanted = TARGETS["plain"]
    return tuple(wanted.name(part) for part in rig.names)
