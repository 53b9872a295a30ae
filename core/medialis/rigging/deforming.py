"""Which bones of a rig deform a surface, and the segments that they act along.

Rigs have bones that move nothing: end markers (`HeadTop_End`, `Toe0Nub`), a root on
the ground, helpers of inverse kinematics. `deforming` finds them by their names and places.
`segments_of` gives the lines along which the others act.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from medialis.base.arrays import Mask
from medialis.base.validation import FloatArray, IntArray
from medialis.rigging.armature import Armature
from medialis.rigging.bones import Bones

ENDS = frozenset({"end", "nub", "endsite", "effector"})
"""Last words of the names of end markers."""

TIPS = frozenset({"tip", "leaf"})
"""Words in the names of last bones of a chain that only give its direction."""

TIP = 0.5
"""Fraction of the length of such a bone from which on it deforms the skin: artists give the skin at
its joint to its parent."""

SIDES = frozenset({"l", "r", "left", "right", "c", "m"})
"""Words for sides, which may follow the last word."""

HELPERS = frozenset({"ik", "mch", "org", "ctrl", "wgt", "pole"})
"""First words of the names of helpers that deform nothing."""

ROOTS = frozenset({"root", "armature", "master", "reference", "world", "origin", "skeleton"})
"""Names of bones without a parent that stand for the whole figure."""

FINGERTIP = re.compile(r"Hand(Thumb|Index|Middle|Ring|Pinky)4$")
"""End markers of fingers in Mixamo's rigs."""

EYELESS = frozenset({"brow", "eyebrow", "lid", "eyelid", "lash", "eyelash", "corner"})
"""Words in the names of bones that deform the skin around eyes."""

SAME = 1e-5
"""Fraction of the extent of a rig within which a joint is at the end of a bone."""


def words_of(name: str) -> list[str]:
    """Return the lower-case words of the name of a bone, without the numbers.

    Examples
    --------
    >>> words_of("mixamorig:LeftToe_End"), words_of("ball_leaf_l"), words_of("Bip01 L Toe0Nub")
    (['left', 'toe', 'end'], ['ball', 'leaf', 'l'], ['bip', 'l', 'toe', 'nub'])
    """
    local = name.rsplit(":", 1)[-1]
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", local)]


def is_end_marker(name: str) -> bool:
    """Return whether a bone without children is an end marker by its name.

    Examples
    --------
    >>> [is_end_marker(name) for name in ("HeadTop_End", "tail_end.L", "LeftHandIndex4", "Head")]
    [True, True, True, False]
    """
    words = words_of(name)
    while words and words[-1] in SIDES:
        words.pop()
    return bool(words and words[-1] in ENDS) or FINGERTIP.search(name) is not None


def is_eye(name: str) -> bool:
    """Return whether a bone turns an eyeball by its name.

    Examples
    --------
    >>> [is_eye(name) for name in ("mixamorig:LeftEye", "eye.R", "J_Adj_L_FaceEye", "eyelid.L")]
    [True, True, True, False]
    """
    words = set(words_of(name))
    return bool(words & {"eye", "eyeball"}) and not words & EYELESS


def deforming(rig: Bones | Armature) -> Mask:
    """Return which bones deform the surface, (b,) bool; all if no other bone would.

    Examples
    --------
    >>> heads = [[0, 0, 0], [0, 0, 1], [0, 0, 2]]
    >>> rig = Armature(heads, [[0, 0, 1], [0, 0, 2], [0, 0, 3]], [-1, 0, 1],
    ...                ("root", "spine", "spine_end"))
    >>> deforming(rig).tolist()
    [False, True, False]
    """
    leaf = np.ones(rig.count, np.bool_)
    leaf[rig.parents[rig.parents >= 0]] = False
    moves = np.ones(rig.count, np.bool_)
    deform_only = any(name.startswith("DEF-") for name in rig.names)
    for bone, name in enumerate(rig.names):
        words = words_of(name)
        helper = bool(words) and words[0] in HELPERS
        top = rig.parents[bone] < 0 and bool(words) and words[-1] in ROOTS and not leaf[bone]
        marker = bool(leaf[bone]) and rig.parents[bone] >= 0 and is_end_marker(name)
        moves[bone] = not (helper or top or marker) and (not deform_only or name.startswith("DEF-"))
    return moves if moves.any() else np.ones(rig.count, np.bool_)


@dataclass(frozen=True, eq=False)
class Segments:
    """Lines along which bones act.

    Attributes
    ----------
    heads, tails : (s, 3) float64
    bone : (s,) int32
        Ascending.
    joint : (s,) bool
        Whether another bone of the rig begins at the tail.
    """

    heads: FloatArray
    tails: FloatArray
    bone: IntArray
    joint: Mask


def segments_of(rig: Bones | Armature, moves: Mask) -> Segments:
    """Return the segments of the bones that deform, (b,) bool.

    The last bone of a chain acts from its middle on if its name has a word of `TIPS`.
    """
    reach = SAME * float(np.ptp(np.concatenate([rig.heads, rig.tails]), axis=0).max())
    joint = np.zeros(rig.count, np.bool_)
    child = np.flatnonzero(rig.parents >= 0)
    above = rig.parents[child]
    meets = np.linalg.norm(rig.heads[child] - rig.tails[above], axis=1) <= reach
    joint[above[meets]] = True
    last = ~np.isin(np.arange(rig.count), above)
    tip = last & np.array([not TIPS.isdisjoint(words_of(name)) for name in rig.names])
    begin = rig.heads + TIP * tip[:, None] * (rig.tails - rig.heads)
    rows = np.flatnonzero(moves)
    return Segments(begin[rows], rig.tails[rows], rows.astype(np.int32), joint[rows])
