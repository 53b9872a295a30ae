"""Bones for rigging along the branches of a curve skeleton."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.armature import Bones
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.options import Options, algorithm, length, number
from medialis.progress import Progress
from medialis.rigging.joints import joint_rows, sample_shares
from medialis.rigging.limbs import Limb, find_limbs, hang_limbs
from medialis.rigging.symmetry import mirrored_limbs
from medialis.threads import run_patiently
from medialis.validation import FloatArray


@dataclass(frozen=True, kw_only=True)
class BonesOptions(Options):
    """Options of `bones`."""

    bend: float = number(
        0.4,
        "Bend",
        "Joints are where a straight bone would leave the middle of its limb by more than this "
        "times the radius, or where the thickness changes.",
        low=0.05,
        high=10.0,
    )
    bone_length: float = length(
        1.0,
        "Bone length",
        "Longer bones are split into equal ones, none longer than this share of the size.",
        low=0.001,
    )
    blend: float = number(
        1.0,
        "Blend",
        "How far from a joint the weights pass over from one bone to the next, times the radius "
        "there. 0 is stiff.",
        high=10.0,
    )
    shortest: float = number(
        1.0,
        "Shortest limb",
        "Branches shorter than this times the radius where they begin get no bone; between two "
        "forks half of that is enough.",
        high=10.0,
        advanced=True,
    )


@algorithm(BonesOptions)
def bones(curve: CurveSkeleton, options: BonesOptions, progress: Progress) -> Bones:
    """Lay bones along the branches of a curve skeleton.

    Each component has its root at the thickest junction (without one, at the thickest end) and
    becomes a tree of shortest paths from there; edges that close loops are cut, where both ways
    round are equally long. The first bone of the thickest limb at the root (of those without a
    mirror image, if there are any) is the root bone. The other limbs there are its children, but
    begin at its head.

    A limb has the fewest straight bones that stay in its middle and taper evenly; their joints lie
    where they fit it best, in its bends and where its thickness changes. Limbs that are mirror
    images of each other have the same joints, and bones of the same name with ``.L`` and ``.R``.

    Limbs that are too short for a bone lie inside the ball where they begin; what hangs on them
    begins where they do, so that each bone begins at an end of its parent. Where two bones meet,
    the weight passes over on both sides of the joint, at most to the middle of a bone; at forks on
    the child alone, so that no limb moves its neighbours.

    Parameters
    ----------
    curve : CurveSkeleton
        With at least one node; its `diagonal` is the unit of the bone length.

    Returns
    -------
    Bones

    Raises
    ------
    InvalidShapeError
        When the curve skeleton has no node.

    See Also
    --------
    curve_skeleton : where curve skeletons come from.
    skin_weights : what the bones move.

    Notes
    -----
    Cost: shortest paths from one node of each component. Source: none; the thesis has no rigging.

    Examples
    --------
    >>> import medialis
    >>> line = medialis.CurveSkeleton.of([[0, 0, 0], [4, 0, 0]], [[0, 1]], [1, 1])
    >>> rig = medialis.bones(line, bone_length=0.5)
    >>> rig.heads[:, 0].tolist(), rig.parents.tolist()
    ([0.0, 2.0], [-1, 0])
    """
    if len(curve.nodes) == 0:
        raise InvalidShapeError("Bones need a curve skeleton with at least one node, got none.")
    return run_patiently(lambda: _bones(curve, options), progress)


def _bones(curve: CurveSkeleton, options: BonesOptions) -> Bones:
    limbs = find_limbs(curve, options.shortest)
    pairs = mirrored_limbs(limbs)
    kept = hang_limbs(curve, limbs, {limb for pair in pairs for limb in pair})
    longest = options.bone_length * curve.diagonal or 1.0
    joints = _joints(limbs, kept, pairs, options.bend, longest)
    return _lay_bones(curve, limbs, kept, pairs, joints, options.blend)


def _joints(
    limbs: list[Limb], kept: list[int], pairs: list[tuple[int, int]], bend: float, longest: float
) -> dict[int, FloatArray]:
    """Return the joints of the limbs with bones, as shares of the length, both ends included.

    Limbs that are mirror images of each other have the same ones: those of their mean, whose
    squares are the mean of theirs.
    """
    partner = dict(pairs) | {right: left for left, right in pairs}
    joints: dict[int, FloatArray] = {}
    for here in kept:
        group = [limbs[here]] + ([limbs[partner[here]]] if here in partner else [])
        if here in joints:
            continue
        length = float(np.mean([limb.length for limb in group]))
        if length == 0:
            joints[here] = np.array([0.0, 1.0])
            continue
        shares = sample_shares(length, np.concatenate([limb.points[:, 3] for limb in group]))
        rough = shares[joint_rows([limb.at(shares) for limb in group], bend)]
        corners = np.stack([limb.at(rough)[:, :3] for limb in group])
        chords = np.linalg.norm(np.diff(corners, axis=1), axis=2).max(axis=0)
        # The margin lets a limb of exactly two lengths have two bones.
        counts = np.maximum(np.ceil(chords / longest * (1 - 1e-9)), 1)
        pieces = [
            np.linspace(low, high, int(count) + 1)[1:]
            for low, high, count in zip(rough[:-1], rough[1:], counts, strict=True)
        ]
        for one in (here, partner.get(here, here)):
            joints[one] = np.concatenate([[0.0], *pieces])
    return joints


def _lay_bones(
    curve: CurveSkeleton,
    limbs: list[Limb],
    kept: list[int],
    pairs: list[tuple[int, int]],
    joints: dict[int, FloatArray],
    blend: float,
) -> Bones:
    """Lay bones from joint to joint, and say where on them every edge and node lies."""
    table: dict[str, Any] = {}
    parents: list[int] = []
    of_limb: list[int] = []
    for rank, here in enumerate(kept):
        limb = limbs[here]
        row, along = _joint_table(limb, joints[here])
        count, first = len(along) - 1, len(parents)
        limb.bones = range(first, first + count)
        above, place = limb.start
        above_bones = limbs[above].bones
        parent = -1 if above == here else above_bones[-1 if place > 0 else 0]
        parents += [parent, *range(first, first + count - 1)]
        of_limb += [rank] * count
        before, after = _windows(row[:-1, 3], along, blend)
        for name, values in (
            ("heads", row[:-1, :3]), ("tails", row[1:, :3]),
            ("head_radii", row[:-1, 3]), ("tail_radii", row[1:, 3]),
            ("starts", along[:-1]), ("ends", along[1:]), ("before", before), ("after", after),
        ):  # fmt: skip
            table.setdefault(name, []).append(values)
    mirrors = np.full(len(parents), -1, np.int32)
    sides = np.zeros(len(parents), np.int32)
    for left, right in pairs:
        mirrors[limbs[left].bones], mirrors[limbs[right].bones] = (
            limbs[right].bones,
            limbs[left].bones,
        )
        sides[limbs[left].bones], sides[limbs[right].bones] = 1, -1
    joined: dict[str, Any] = {name: np.concatenate(parts) for name, parts in table.items()}
    return Bones(
        curve=curve,
        parents=np.array(parents),
        limbs=np.array(of_limb),
        mirrors=mirrors,
        sides=sides,
        **joined,
        **_places(curve, limbs, {number: rank for rank, number in enumerate(kept)}),
    )


def _joint_table(limb: Limb, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return position and radius (j, 4) of the joints of a limb, and their places along it."""
    if len(limb.nodes) == 1:  # a round part has no direction: its bone points up
        size = limb.points[0, 3] or 1.0
        return np.vstack([limb.points, limb.points[0] + [0, 0, size, 0]]), np.array([0.0, size])
    return limb.at(shares), shares * limb.length


def _windows(radii: FloatArray, along: FloatArray, blend: float) -> tuple[FloatArray, FloatArray]:
    """Return where the weight passes over, before and behind the head of each bone.

    Windows of one bone never overlap: each keeps to its half.
    """
    half = np.diff(along) / 2
    width = np.minimum(blend * radii, np.minimum(half, np.concatenate([half[:1], half[:-1]])))
    before, after = width.copy(), width.copy()
    before[0], after[0] = 0.0, min(2 * blend * float(radii[0]), float(half[0]))
    return before, after


def _places(curve: CurveSkeleton, limbs: list[Limb], rank: dict[int, int]) -> dict[str, Any]:
    """Return limb and place of every node and edge; twigs have those of the fork they hang on."""
    v, e = len(curve.nodes), len(curve.edges)
    number_of = {pair: i for i, pair in enumerate(map(frozenset, curve.edges.tolist()))}
    node_limbs, node_places = np.full(v, -1, np.int32), np.zeros(v)
    edge_limbs, edge_spans = np.full(e, -1, np.int32), np.zeros((e, 2))
    for limb in limbs:
        on, place = limb.end
        along = np.full(len(limb.nodes), place)
        if limb.kept:
            along = limb.places
        if limb.above < 0:
            node_limbs[limb.nodes[0]] = rank[limb.start[0]]
        # All other first nodes are the last ones of the limb above.
        node_limbs[limb.nodes[1:]], node_places[limb.nodes[1:]] = rank[on], along[1:]
        for step, pair in enumerate(itertools.pairwise(limb.nodes)):
            edge = number_of[frozenset(pair)]
            span = along[[step, step + 1]]
            edge_limbs[edge] = rank[on]
            edge_spans[edge] = span if curve.edges[edge, 0] == pair[0] else span[::-1]
    return {
        "node_limbs": node_limbs,
        "node_places": node_places,
        "edge_limbs": edge_limbs,
        "edge_spans": edge_spans,
    }
