"""How bones are turned about themselves, and what rigs call them.

Bones bend about their own x axis (`roll_axes`). Names are those that rigs have: thigh.L as in
Rigify, LeftUpLeg as in Mixamo.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import unit_rows
from medialis.base.validation import FloatArray, IntArray
from medialis.rigging.bones import Bones

BENT = 0.1
"""Sine of the bends of a limb, added up as vectors, from which on they say how it bends."""

ALONG = 0.9
"""Cosine of the angle to the axis across the body from which on a straight limb points along it."""

UP = np.array([0.0, 0.0, 1.0])

LEG, ARM = ("thigh", "shin", "foot", "toe"), ("upper_arm", "forearm", "hand")

LONG_LIMB = 0.5  # halved 62 %, doubled 89 %
"""Share of the longest pair of limbs that arms and legs have at least; shorter ones may be ears."""

GROUND = 0.25  # halved 0 %, doubled 22 %
"""Share of the height within which all legs end."""

SUFFIX = {1: ".L", 0: "", -1: ".R"}

MIXAMO_LEG, MIXAMO_ARM = ("UpLeg", "Leg", "Foot", "ToeBase"), ("Shoulder", "Arm", "ForeArm", "Hand")
MIXAMO_SIDE = {1: "Left", 0: "", -1: "Right"}
MIXAMO = "mixamorig:"
"""What all names of Mixamo's figures begin with."""


def roll_axes(rig: Bones) -> FloatArray:
    """Return the z axis of each bone, (b, 3): unit, at right angles to the bone.

    All bones of a limb bend about the same axis, their x axis: that about which the limb is bent
    already. A straight limb bends about the axis across the body, or about the vertical where it
    points across the body itself. The axes of mirrored bones are mirror images, as the mirrored
    poses of Blender want it.

    Examples
    --------
    >>> import medialis
    >>> nodes, edges = [[0, 0, 0], [4, 0, 0], [4, 4, 0]], [[0, 1], [1, 2]]
    >>> elbow = medialis.CurveSkeleton.of(nodes, edges, [1, 1, 1])
    >>> roll_axes(medialis.bones(elbow)).round(6).tolist()
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    """
    along = unit_rows(rig.tails - rig.heads)
    across = _across(rig)
    axes = np.zeros((rig.count, 3))
    for limb in range(int(rig.limbs.max(initial=-1)) + 1):
        rows = np.flatnonzero(rig.limbs == limb)
        if rig.sides[rows[0]] >= 0:
            inside = rig.parents[rows[0]] >= 0
            axes[rows] = _limb_axes(along[rows], across, inside)
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


def _limb_axes(along: FloatArray, across: FloatArray | None, inside: bool) -> FloatArray:
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
    elif abs(whole @ UP) < ALONG:
        axis = UP
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


@dataclass(frozen=True)
class Figure:
    """Which bones are what; of paired limbs the left ones.

    Attributes
    ----------
    legs, arms : list of (k,) int32
        The hind legs first; rows from the body on.
    spine : list of int
        From the hind legs to the head.
    tail : (k,) int32
        Empty where there is none.
    others : list of (k,) int32
    """

    legs: list[IntArray]
    arms: list[IntArray]
    spine: list[int]
    tail: IntArray
    others: list[IntArray]

    @classmethod
    def of(cls, rig: Bones) -> Figure:
        """Tell the limbs of an armature apart. Up is z.

        Pairs of long limbs on the middle line that reach the ground are legs, others arms. The
        bones from the hind legs to the head are the spine, the longest other limb in the middle
        of what has legs is the tail.
        """
        numbers = range(int(rig.limbs.max(initial=-1)) + 1)
        limbs = [np.flatnonzero(rig.limbs == k).astype(np.int32) for k in numbers]
        head = _head(rig, limbs)
        legs, arms = _legs_and_arms(rig, limbs)
        place = rig.tails[head] if head >= 0 else np.zeros(3)
        legs.sort(key=lambda rows: -float(np.linalg.norm(rig.heads[rows[0]] - place)))
        up = _chain(rig, head)[::-1]
        hind = _chain(rig, int(rig.parents[legs[0][0]])) if legs else []
        spine = [*(bone for bone in hind if bone not in up), *up]
        known = {int(rows[0]) for rows in (*legs, *arms)} | set(spine)
        rest = [rows for rows in limbs if rig.sides[rows[0]] == 0 and int(rows[0]) not in known]
        tail = np.empty(0, np.int32)
        if rest and legs:
            tail = max(rest, key=lambda rows: _length(rig, rows))
        taken = np.array([*known, *tail, *(b for rows in (*legs, *arms) for b in rows)], int)
        left = (rows[(rig.sides[rows] >= 0) & ~np.isin(rows, taken)] for rows in limbs)
        others = [rows for rows in left if len(rows)]
        return cls(legs, arms, spine, tail, others)


def rigify_names(rig: Bones) -> tuple[str, ...]:
    """Return names as Rigify's figures have them, one for each bone.

    Up is z. Pairs of long limbs on the middle line that reach the ground are legs (thigh, shin,
    foot, toe), others arms (upper_arm, forearm, hand). Of two pairs of legs the one nearer to the
    head is the front one (front_thigh, ...). The bones from the hind legs to the head are the
    spine, the longest other limb in the middle is the tail, and whatever is left a limb.

    Parameters
    ----------
    rig : Bones

    Examples
    --------
    >>> import medialis
    >>> line = medialis.CurveSkeleton.of([[0, 0, 0], [0, 0, 4]], [[0, 1]], [1, 1])
    >>> rigify_names(medialis.bones(line, bone_length=0.5))
    ('spine', 'spine.001')
    """
    figure, named = Figure.of(rig), dict[int, str]()
    for number, rows in enumerate(figure.legs):
        front = f"front_{number:03d}_" if number > 1 else "front_" if number else ""
        _name(named, rows, [front + word for word in LEG])
    for number, rows in enumerate(figure.arms):
        _name(named, rows, [f"{word}_{number:03d}" if number else word for word in ARM])
    _name(named, figure.spine, ["spine"])
    _name(named, figure.tail, ["tail"])
    for number, rows in enumerate(figure.others):
        _name(named, rows, [f"limb_{number:03d}"])
    return _both_sides(rig, named, lambda word, side: word + SUFFIX[side])


def mixamo_names(rig: Bones) -> tuple[str, ...]:
    """Return names as Mixamo's figures have them, one for each bone.

    Limbs are told apart as for `rigify_names`. The spine is Hips, Spine, Spine1, ... up to the
    arms, then Neck and Head; legs are LeftUpLeg, LeftLeg, LeftFoot, LeftToeBase, arms LeftArm,
    LeftForeArm, LeftHand, before them LeftShoulder where there are four bones. Of animals, the
    legs nearest to the head are the arms. More pairs end in _2, _3; then there are Tail, Tail1
    and Limb01, Limb01_1.

    Parameters
    ----------
    rig : Bones

    Examples
    --------
    >>> import medialis
    >>> line = medialis.CurveSkeleton.of([[0, 0, 0], [0, 0, 4]], [[0, 1]], [1, 1])
    >>> mixamo_names(medialis.bones(line, bone_length=0.5))
    ('mixamorig:Hips', 'mixamorig:Head')
    """
    figure, named = Figure.of(rig), dict[int, str]()
    legs, arms = figure.legs, figure.arms
    if not arms and len(legs) > 1:
        legs, arms = legs[:-1], legs[-1:]
    for words, limbs in ((MIXAMO_LEG, legs), (MIXAMO_ARM, arms)):
        for number, rows in enumerate(limbs):
            own = words[1:] if words is MIXAMO_ARM and len(rows) < len(words) else words
            _name(named, rows, own, "{word}{beyond}")
            for bone in rows.tolist() if number else ():
                named[bone] += f"_{number + 1}"
    below = _below_the_arms(rig, figure.spine, arms)
    _name(named, figure.spine[:below], ["Hips", "Spine"], "{word}{beyond}")
    _name(named, figure.spine[below:-1], ["Neck"], "{word}{beyond}")
    _name(named, figure.spine[below:][-1:], ["Head"])
    _name(named, figure.tail, ["Tail"], "{word}{beyond}")
    for number, rows in enumerate(figure.others, 1):
        _name(named, rows, [f"Limb{number:02d}"], "{word}_{beyond}")
    return _both_sides(rig, named, lambda word, side: MIXAMO + MIXAMO_SIDE[side] + word)


def _below_the_arms(rig: Bones, spine: list[int], arms: list[IntArray]) -> int:
    """Return the number of bones of the spine up to the arms; without arms all but the head."""
    most = max(len(spine) - 1, 1)
    if not arms or not spine:
        return most
    # The spine is a chain, so a bone's upper end is the lower end of the next one.
    ends = np.stack([rig.heads[spine], rig.tails[spine]], axis=1)
    meets = (ends[:-1, 1, None] == ends[1:]).all(axis=2).any(axis=1)
    upper = np.where(np.append(meets, True)[:, None], ends[:, 1], ends[:, 0])
    away = np.linalg.norm(upper - rig.heads[arms[0][0]], axis=1)
    return int(away.argmin()) + 1


def _both_sides(
    rig: Bones, named: dict[int, str], full: Callable[[str, int], str]
) -> tuple[str, ...]:
    """Return all names: right bones have the word of their mirror image."""
    for bone in np.flatnonzero(rig.sides < 0).tolist():
        named[bone] = named[int(rig.mirrors[bone])]
    return tuple(full(named[bone], int(rig.sides[bone])) for bone in range(rig.count))


def _name(
    named: dict[int, str],
    rows: Sequence[int] | IntArray,
    words: Sequence[str],
    more: str = "{word}.{beyond:03d}",
) -> None:
    """Name bones one after the other; the last word goes on with numbers."""
    for place, bone in enumerate(map(int, rows)):
        beyond = place - len(words) + 1
        word = words[min(place, len(words) - 1)]
        named[bone] = word if beyond <= 0 else more.format(word=word, beyond=beyond)


def _length(rig: Bones, rows: IntArray) -> float:
    return float(np.linalg.norm(rig.tails[rows] - rig.heads[rows], axis=1).sum())


def _legs_and_arms(rig: Bones, limbs: list[IntArray]) -> tuple[list[IntArray], list[IntArray]]:
    """Return the long left limbs that hang on the middle line: those that reach the ground."""
    pairs = [
        rows for rows in limbs
        if rig.sides[rows[0]] > 0
        and (rig.parents[rows[0]] < 0 or rig.sides[rig.parents[rows[0]]] == 0)
    ]  # fmt: skip
    longest = max((_length(rig, rows) for rows in pairs), default=0.0)
    pairs = [rows for rows in pairs if _length(rig, rows) >= LONG_LIMB * longest]
    heights = np.concatenate([rig.heads[:, 2], rig.tails[:, 2]])
    ground = min((rig.tails[rows[-1], 2] for rows in pairs), default=0.0)
    low = [rig.tails[rows[-1], 2] <= ground + GROUND * np.ptp(heights) for rows in pairs]
    split = {leg: [rows for rows, is_leg in zip(pairs, low, strict=True) if is_leg == leg]
             for leg in (True, False)}  # fmt: skip
    return split[True], split[False]


def _head(rig: Bones, limbs: list[IntArray]) -> int:
    """Return the last bone of the thickest limb in the middle that leads on to no other one."""
    above = set(rig.parents.tolist())
    ends = [rows for rows in limbs if not rig.sides[_chain(rig, int(rows[-1]))].any()]
    open_ends = [rows for rows in ends if int(rows[-1]) not in above] or ends
    if not open_ends:
        return -1
    best = max(open_ends, key=lambda rows: float(rig.tail_radii[rows].mean()))
    return int(best[-1])


def _chain(rig: Bones, bone: int) -> list[int]:
    """Return a bone and those that it hangs on, up to the root."""
    found = []
    while bone >= 0:
        found.append(bone)
        bone = int(rig.parents[bone])
    return found


NAMINGS: dict[str, Callable[[Bones], tuple[str, ...]]] = {
    "rigify": rigify_names,
    "mixamo": mixamo_names,
}
"""Names by what they are like."""
