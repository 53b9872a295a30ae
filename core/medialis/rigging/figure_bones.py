"""The bones of a biped or quadruped: names, parents, joints, and where on them its curve lies.

`figure_bones` finds which limb is what (`figures.py`), where its joints are (`anatomy.py`), which
way the figure looks, and lays bones that end in `.L` on its own left. Of a shape that is its own
mirror image, joints are mirror images and the spine lies in the plane.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.arrays import kd_tree, places_along, unit_rows
from medialis.base.validation import FloatArray
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.rigging import anatomy
from medialis.rigging.anatomy import Strand
from medialis.rigging.bones import Bones
from medialis.rigging.figures import (
    EAR_ASIDE,
    EARS_ALIKE,
    Figure,
    find_figure,
    with_round_parts,
)
from medialis.rigging.limbs import Plane

FACING = 0.04  # halved 0 %, doubled 0 %
"""How much farther feet go ahead than back, of the length of a leg, for a biped to look there."""

UPRIGHT = 0.8  # halved 0 %, doubled 0 %
"""Cosine of the angle between the trunk of a quadruped and the vertical from which on it may be a
biped that sits, with arms and legs ahead."""

APART = 0.63
"""Distance of a pair of legs, of the length of the trunk, from which on a quadruped may be a biped
that sits with legs spread, where the vertical is not known: 34 animals have 0.22 to 0.45, a teddy
that sits has 0.88."""

NECK_UP = 0.3
"""Height of the foot of the neck over the shoulders, of half their distance."""

HIPS_UP = 0.15
"""Height of the lower end of the spine over the hips, of their distance."""

BESIDE_LEGS = 0.22  # halved 0.7 %, doubled 1 %
"""How far the trunk of a quadruped goes on behind and ahead of its legs, in its radii."""

HEAD_DOWN = 1.15
"""Distance of the joint of the head from its middle, in its radii."""

FRONT = 0.1
"""Share of its length that is the front of a head."""

BALL = 0.64  # halved 0 %, doubled 0 %
"""Share of the foot up to the toes."""

LEAST_FINGERS, FINGER_BONES = 3, 2
"""Fingers of a hand, so that they are no thumb and mitten; bones of each."""

TAIL_BONES = 3  # halved 15 %, doubled 18 %
"""Bones of a tail."""

ARMS = ("upper_arm", "forearm", "hand")
LEGS = ("thigh", "shin", "foot", "toe")
FRONT_LEGS = ("front_thigh", "front_shin", "front_foot", "front_toe")


@dataclass(frozen=True)
class Chain:
    """Bones one after the other: names of k of them, k + 1 joints, the nodes that they lie along.

    The first bone hangs on `parent`, a name; the chain's nodes begin at a node of its chain.
    """

    names: tuple[str, ...]
    joints: FloatArray
    nodes: list[int]
    parent: str = ""


@dataclass(frozen=True)
class _Pose:
    """The directions of a figure, unit, and its plane of symmetry, if the shape has one."""

    up: FloatArray
    left: FloatArray
    ahead: FloatArray
    plane: Plane | None


def figure_bones(
    curve: CurveSkeleton, blend: float, up: str | None = None
) -> tuple[Bones | None, str]:
    """Return the bones of the biped or quadruped along a curve skeleton.

    Parameters
    ----------
    curve : CurveSkeleton
    blend : float
        As of `bones`.
    up : {"x", "y", "z"}, optional
        The axis that points up, where it is known: a quadruped does not stand upright.

    Returns
    -------
    Bones or None
        With the names of the figure's parts; None where it is not clearly one.
    str
        What is not clear, as a sentence; empty where it is no figure at all.
    """
    curve = with_round_parts(curve)
    figure, doubt = find_figure(curve)
    if figure is None:
        return None, doubt
    pose = _pose(curve, figure)
    if pose is not None and figure.kind == "quadruped" and up is not None:
        upright = abs(float(pose.ahead["xyz".index(up)]))
        if upright > UPRIGHT:
            return None, "Whether the figure has arms or front legs is not clear: it sits or rears."
    if figure.kind == "quadruped" and up is None:
        parts = figure.parts
        if np.linalg.norm(parts.across) > APART * np.linalg.norm(parts.trunk):
            return None, (
                "Whether the figure is a quadruped, or a biped that sits, is not clear without the "
                "axis that points up (--up)."
            )
    if pose is None:
        return (
            None,
            "Which way the figure looks is not clear: its feet are as long behind as ahead.",
        )
    return _lay(curve, _chains(curve, figure, pose), figure.kind, blend, pose), ""


def _pose(curve: CurveSkeleton, figure: Figure) -> _Pose | None:
    """Return which way a figure looks; None where its feet do not tell."""
    parts = figure.parts
    across = unit_rows(parts.across)
    trunk = unit_rows(parts.trunk)
    middle = float(sum(parts.middles) @ across) / 2
    surface = curve.surface
    plane = None
    if surface is not None:
        plane = anatomy.mirror_plane(surface.points, across, middle)
    if plane is not None:
        across = plane.normal
    if figure.kind == "quadruped":
        ahead = unit_rows(trunk - (trunk @ across) * across)
        up = np.cross(ahead, across)
        up = up * np.sign(-(up @ parts.down))
    else:
        up = unit_rows(trunk - (trunk @ across) * across)
        ahead = np.cross(across, up)
        feet = sum(_foot(curve, nodes, ahead) for nodes in figure.hind)
        if figure.tail:  # a tail is behind
            way = unit_rows(np.diff(curve.nodes[[figure.tail[0], figure.tail[-1]]], axis=0)[0])
            feet -= 2 * FACING * float(way @ ahead)
        if abs(feet) < 2 * FACING:
            return None
        ahead = ahead * np.sign(feet)
    return _Pose(up, np.cross(up, ahead), ahead, plane)


def _foot(curve: CurveSkeleton, nodes: list[int], ahead: FloatArray) -> float:
    """Return how much farther a foot goes ahead of its shin than back, of the leg's length."""
    strand = Strand.of(curve, nodes)
    n = len(strand.table)
    low, high = strand.points[int(0.5 * n)], strand.points[int(0.8 * n)]
    shin = unit_rows(high - low)
    side = unit_rows(ahead - (ahead @ shin) * shin)
    length = strand.length
    ends = strand.points[int(0.8 * n) :]
    surface, own = curve.surface, curve.vertex_node
    if surface is not None and own is not None:
        last = np.array(nodes)[places_along(curve.nodes[nodes]) >= 0.8 * length]
        ends = surface.points[: len(own)][np.isin(own, last)]
    if len(ends) == 0:
        return 0.0
    off = (ends - high) @ side
    return float((off.max() + off.min()) / length)


def _chains(curve: CurveSkeleton, figure: Figure, pose: _Pose) -> list[Chain]:
    """Return the chains of a figure, those above first."""
    left = 0 if figure.parts.across @ pose.left > 0 else 1
    sides = ((left, ".L"), (1 - left, ".R"))
    hind = {mark: _leg(curve, figure, figure.hind[k], pose) for k, mark in sides}
    front = {
        mark: (_arm if figure.kind == "biped" else _leg)(curve, figure, figure.front[k], pose)
        for k, mark in sides
    }
    for pair in (front, hind):
        _mirror(pair, pose.plane)
    roots = [np.mean([pair[".L"][0], pair[".R"][0]], axis=0) for pair in (hind, front)]
    wide = [float(np.linalg.norm(pair[".L"][0] - pair[".R"][0])) for pair in (hind, front)]
    ears: list[Chain] = []
    if figure.kind == "biped":
        trunk = _upright(curve, figure, pose, roots, wide)
    else:
        ears = _ears(curve, figure, pose)
        trunk = _level(curve, figure, pose, roots, ears)
    if pose.plane is not None:
        flat = (trunk.joints + pose.plane.image(trunk.joints)) / 2
        trunk = replace(trunk, joints=flat)
    # Depth first, as Blender lists bones.
    chains = [trunk, *ears]
    fingers: dict[str, list[Chain]] = {".L": [], ".R": []}
    if figure.kind == "biped":
        front = {mark: np.vstack([trunk.joints[3], front[mark]]) for mark in front}
        fingers = _fingers(curve, figure, pose, front, sides)
    for k, mark in sides:
        names: tuple[str, ...] = ("shoulder", *ARMS) if figure.kind == "biped" else FRONT_LEGS
        nodes = figure.front[k]
        if fingers[mark]:
            nodes = nodes[: nodes.index(fingers[mark][0].nodes[0]) + 1]
        chains.append(Chain(tuple(n + mark for n in names), front[mark], nodes, "chest"))
        chains += fingers[mark]
    for k, mark in sides:
        chains.append(Chain(tuple(n + mark for n in LEGS), hind[mark], figure.hind[k], "hips"))
    if figure.tail:
        chains.append(_tail(curve, figure, pose))
    return chains


def _ears(curve: CurveSkeleton, figure: Figure, pose: _Pose) -> list[Chain]:
    """Return a bone for each ear: the longest two branches that leave the head to both sides."""
    shoulders = curve.nodes[figure.front[0][0]]  # the head may leave the trunk before them
    beyond = int(np.linalg.norm(curve.nodes[figure.head] - shoulders, axis=1).argmin()) + 1
    known = set(itertools.chain(figure.head, *figure.front, *figure.hind, figure.tail))
    branches: dict[str, list[tuple[float, list[int]]]] = {".L": [], ".R": []}
    for node in figure.head[beyond:]:
        for other in sorted(set(curve.neighbours[node]) - known):
            nodes = [node, other]
            while len(onward := set(curve.neighbours[nodes[-1]]) - {nodes[-2]}) == 1:
                nodes.append(onward.pop())
                if len(nodes) > len(curve.nodes):
                    return []  # a loop
            way = curve.nodes[nodes[-1]] - curve.nodes[node]
            length = float(np.linalg.norm(way))
            aside = float(way @ pose.left) / length
            if not onward and abs(aside) >= EAR_ASIDE:
                branches[".L" if aside > 0 else ".R"].append((length, nodes))
    if not (branches[".L"] and branches[".R"]):
        return []
    found = {mark: max(some, key=lambda one: one[0]) for mark, some in branches.items()}
    lengths = sorted(length for length, _ in found.values())
    if lengths[1] > EARS_ALIKE * lengths[0]:
        return []
    joints = {}
    for mark, (_, nodes) in found.items():
        strand = Strand.of(curve, nodes)
        joints[mark] = np.array([strand.at(_base(curve, nodes, strand)), strand.at(1.0)])
    _mirror(joints, pose.plane)
    return [Chain(("ear" + mark,), joints[mark], found[mark][1], "head") for mark in (".L", ".R")]


def _fingers(
    curve: CurveSkeleton,
    figure: Figure,
    pose: _Pose,
    arms: dict[str, FloatArray],
    sides: tuple[tuple[int, str], ...],
) -> dict[str, list[Chain]]:
    """Return the fingers of both hands, where both have equally many; hands end where they begin.

    They are numbered across the palm, from the side of the finger that begins nearest to the wrist.
    """
    found = {mark: _finger_joints(curve, figure.front[k], arms[mark]) for k, mark in sides}
    count = len(found[".L"])
    if count < LEAST_FINGERS or len(found[".R"]) != count:
        return {".L": [], ".R": []}
    if pose.plane is not None:
        for (one, _), (other, _) in zip(found[".L"], found[".R"], strict=True):
            one[:] = (one + pose.plane.image(other)) / 2
            other[:] = pose.plane.image(one)
    chains: dict[str, list[Chain]] = {}
    for mark, fingers in found.items():
        arms[mark][-1] = np.mean([joints[0] for joints, _ in fingers], axis=0)
        chains[mark] = [
            Chain(tuple(f"finger_{k}_{b}{mark}" for b in range(1, FINGER_BONES + 1)), joints, nodes,
                  "hand" + mark)
            for k, (joints, nodes) in enumerate(fingers, 1)
        ]  # fmt: skip
    return chains


def _finger_joints(
    curve: CurveSkeleton, way: list[int], arm: FloatArray
) -> list[tuple[FloatArray, list[int]]]:
    """Return joints and nodes of the branches at the end of an arm, in their order."""
    first = next((k for k in _forks(curve, way)), None)
    if first is None:
        return []
    found = []
    waiting = [
        [way[first], other] for other in curve.neighbours[way[first]] if other != way[first - 1]
    ]
    while waiting:
        nodes = waiting.pop()
        onward = [other for other in curve.neighbours[nodes[-1]] if other != nodes[-2]]
        if len(nodes) > len(curve.nodes):
            return []  # a loop
        if not onward:
            last = max(k for k, node in enumerate(nodes) if curve.degrees[node] > 2)
            strand = Strand.of(curve, nodes[last:])
            base = _base(curve, nodes[last:], strand)
            shares = np.linspace(base, 1.0, FINGER_BONES + 1)
            found.append((np.array([strand.at(share) for share in shares]), nodes))
        waiting += [[*nodes, other] for other in onward]
    if len(found) < LEAST_FINGERS:
        return []
    hand = unit_rows(np.mean([joints[-1] for joints, _ in found], axis=0) - arm[-2])
    roots = np.array([joints[0] - arm[-2] for joints, _ in found])
    tips = np.array([joints[-1] - arm[-2] for joints, _ in found])
    flat = tips - (tips @ hand)[:, None] * hand
    across = np.linalg.svd(flat - flat.mean(axis=0))[2][0]
    places = flat @ across
    order = np.argsort(places, kind="stable")
    if roots[order[0]] @ hand > roots[order[-1]] @ hand:
        order = order[::-1]
    return [found[k] for k in order]


def _forks(curve: CurveSkeleton, way: list[int]) -> Iterator[int]:
    """Yield the places of the forks at the end of an arm."""
    return (k for k, node in enumerate(way) if curve.degrees[node] > 2 and k > 0.6 * len(way))


def _mirror(pair: dict[str, FloatArray], plane: Plane | None) -> None:
    """Make the joints of both sides mirror images."""
    if plane is None:
        return
    left = (pair[".L"] + plane.image(pair[".R"])) / 2
    pair[".L"], pair[".R"] = left, plane.image(left)


def _base(curve: CurveSkeleton, nodes: list[int], strand: Strand) -> float:
    """Return the share of a limb's length at which it leaves the ball of its fork."""
    points = curve.nodes[nodes]
    out = np.linalg.norm(points - points[0], axis=1) > curve.radii[nodes[0]]
    return strand.share_of(points[int(out.argmax()) if out.any() else len(nodes) // 2])


def _arm(curve: CurveSkeleton, figure: Figure, nodes: list[int], pose: _Pose) -> FloatArray:
    """Return shoulder, elbow, wrist and the end of the hand."""
    forks = list(_forks(curve, nodes))
    strand = Strand.of(curve, nodes[: forks[0] + 1] if forks else nodes)
    return anatomy.arm_joints(strand, _base(curve, nodes, strand), pose.up, bool(forks))


def _leg(curve: CurveSkeleton, figure: Figure, nodes: list[int], pose: _Pose) -> FloatArray:
    """Return hip, knee, ankle, ball of the foot and the end of the toes."""
    strand = Strand.of(curve, nodes)
    base = _base(curve, nodes, strand)
    if figure.kind == "quadruped":
        root = anatomy.hip(strand, base, pose.up, anatomy.HIPS_OF_FOUR)
        return anatomy.limb_joints(strand, anatomy.PAW, root)
    root = anatomy.hip(strand, base, pose.up, anatomy.HIPS)
    joints = anatomy.limb_joints(strand, anatomy.LEG, root)
    ball = joints[2] + BALL * (joints[3] - joints[2])
    return np.vstack([joints[:3], ball, joints[3:]])


def _upright(
    curve: CurveSkeleton, figure: Figure, pose: _Pose, roots: list[FloatArray], wide: list[float]
) -> Chain:
    """Return hips, spine, chest, neck and head of a biped."""
    hips, shoulders = roots
    strand = Strand.of(curve, figure.head)
    neck = shoulders + NECK_UP * wide[1] / 2 * unit_rows(shoulders - hips)
    first = round(strand.share_of(neck) * (len(strand.table) - 1))
    radii, points = strand.radii, strand.points
    thinnest = first + int(radii[first : first + max((len(radii) - first) // 2, 1)].argmin())
    middle = thinnest + int(radii[thinnest:].argmax())
    center, radius = points[middle], float(radii[middle])
    way = unit_rows(center - neck)
    joint = center - HEAD_DOWN * radius * way
    least = neck + 0.2 * (center - neck)
    joint = joint if (joint - least) @ way > 0 else least
    top = center + radius * way
    hips = hips + HIPS_UP * wide[0] * pose.up
    spine = [_between(strand, hips, neck, share, pose.ahead) for share in anatomy.SPINE]
    joints = np.array([hips, *spine, neck, joint, top])
    return Chain(("hips", "spine", "chest", "neck", "head"), joints, figure.head)


def _between(
    strand: Strand, low: FloatArray, high: FloatArray, share: float, ahead: FloatArray
) -> FloatArray:
    """Return the joint at a share of the way, as far ahead as the curve skeleton is there."""
    place = low + share * (high - low)
    along = (strand.points - place) @ (high - low)
    off = float((strand.points[int(np.abs(along).argmin())] - place) @ ahead)
    return place + off * ahead


def _level(
    curve: CurveSkeleton, figure: Figure, pose: _Pose, roots: list[FloatArray], ears: list[Chain]
) -> Chain:
    """Return hips, spine, chest, neck and head of a quadruped."""
    fork, front = curve.nodes[figure.hind[0][0]], curve.nodes[figure.front[0][0]]
    behind = BESIDE_LEGS * curve.radii[[figure.hind[0][0], figure.front[0][0]]]
    start = fork + ((roots[0] - fork) @ pose.ahead - behind[0]) * pose.ahead
    end = front + ((roots[1] - front) @ pose.ahead + behind[1]) * pose.ahead
    strand = Strand.of(curve, figure.head)
    first = round(strand.share_of(front) * (len(strand.table) - 1))
    spine = [_between(strand, start, end, share, pose.up) for share in (1 / 3, 2 / 3)]
    radii, points = strand.radii, strand.points
    rest = np.arange(first, len(radii))
    # The head is the thicker place beyond the thinnest of the neck.
    half = first + (len(rest) * 3) // 10
    thinnest = half + int(radii[half : first + (len(rest) * 8) // 10].argmin())
    middle = thinnest + int(radii[thinnest:].argmax())
    if radii[middle] < 1.05 * radii[thinnest] or middle >= len(radii) - 1:
        middle = min(middle, first + (len(rest) * 13) // 20)
    joint = points[middle]
    limbs = [*figure.front, *figure.hind, figure.tail, *(ear.nodes[1:] for ear in ears)]
    tip = _snout(curve, figure.head, set(itertools.chain(*limbs)), pose, joint)
    joints = np.array([start, *spine, end, joint, tip])
    return Chain(("hips", "spine", "chest", "neck", "head"), joints, figure.head)


def _snout(
    curve: CurveSkeleton, way: list[int], limbs: set[int], pose: _Pose, joint: FloatArray
) -> FloatArray:
    """Return the tip of the head: ahead of the middle of its front, wherever the head is turned.

    What hangs on the way to the head beyond its joint is the head's, but for limbs and ears.
    """
    surface, own = curve.surface, curve.vertex_node
    near = int(np.linalg.norm(curve.nodes[way] - joint, axis=1).argmin())
    head = way[near:]
    known = limbs.union(way)
    for node in head:  # grows while it is read
        more = sorted(set(curve.neighbours[node]) - known)
        known.update(more)
        head += more
    rows = np.flatnonzero(np.isin(own, head)) if surface is not None and own is not None else ()
    if surface is None or len(rows) == 0:
        return np.asarray(curve.nodes[way[-1]])
    points = surface.points[rows]
    ahead = unit_rows(pose.ahead - 0.4 * pose.up)
    reach = (points - joint) @ ahead
    front = reach >= reach.max() - FRONT * np.ptp(reach)
    return np.asarray(points[front].mean(axis=0) + (reach.max() - reach[front].mean()) * ahead)


def _tail(curve: CurveSkeleton, figure: Figure, pose: _Pose) -> Chain:
    """Return equal bones along the tail."""
    strand = Strand.of(curve, figure.tail)
    base = _base(curve, figure.tail, strand)
    joints = np.array([strand.at(s) for s in np.linspace(base, 1.0, TAIL_BONES + 1)])
    if pose.plane is not None:
        joints = (joints + pose.plane.image(joints)) / 2
    names = ("tail", *(f"tail.{k:03d}" for k in range(1, TAIL_BONES)))
    return Chain(names, joints, figure.tail, "hips")


def _lay(curve: CurveSkeleton, chains: list[Chain], kind: str, blend: float, pose: _Pose) -> Bones:
    """Lay the bones of the chains, and say where on them every edge and node lies."""
    parts = tuple(itertools.chain.from_iterable(chain.names for chain in chains))
    number = {name: bone for bone, name in enumerate(parts)}
    table: dict[str, list[Any]] = {}
    for rank, chain in enumerate(chains):
        along, radii = _places_of(curve, chain)
        half = np.diff(along) / 2
        window = np.minimum(blend * radii[:-1], np.minimum(half, np.append(half[:1], half[:-1])))
        bones = [number[name] for name in chain.names]
        for name, values in (
            ("heads", chain.joints[:-1]), ("tails", chain.joints[1:]),
            ("parents", [number.get(chain.parent, -1), *bones[:-1]]),
            ("limbs", [rank] * len(bones)), ("starts", along[:-1]), ("ends", along[1:]),
            ("head_radii", radii[:-1]), ("tail_radii", radii[1:]),
            ("before", window if chain.parent else [0.0, *window[1:]]), ("after", window),
        ):  # fmt: skip
            table.setdefault(name, []).append(values)
    twins = [name[:-1] + {"L": "R", "R": "L"}.get(name[-1], "") for name in parts]
    told = [name.endswith((".L", ".R")) for name in parts]
    mirrors = [number[twin] if own else -1 for twin, own in zip(twins, told, strict=True)]
    sides = [(1 if name.endswith(".L") else -1) if own else 0
             for name, own in zip(parts, told, strict=True)]  # fmt: skip
    joined: dict[str, Any] = {name: np.concatenate(rows) for name, rows in table.items()}
    joined |= {"mirrors": np.array(mirrors), "sides": np.array(sides)}
    joined |= _places(curve, chains)
    frame = np.array([pose.left, pose.ahead, pose.up])
    return Bones(curve=curve, given_names=parts, kind=kind, frame=frame, **joined)


def _places_of(curve: CurveSkeleton, chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return places of the joints along the nodes of a chain, rising, and the radii there."""
    points = curve.nodes[chain.nodes]
    places = places_along(points)
    total = float(places[-1]) or 1.0
    near = [float(places[np.linalg.norm(points - j, axis=1).argmin()]) for j in chain.joints]
    near[-1] = total
    least = 1e-3 * total
    along = np.maximum.accumulate(np.array(near) + least * np.arange(len(near)))
    along = along * (total / along[-1]) if along[-1] > total else along
    along = np.maximum.accumulate(along)
    return along, np.interp(along, places, curve.radii[chain.nodes])


def _places(curve: CurveSkeleton, chains: list[Chain]) -> dict[str, Any]:
    """Return chain and place of every node and edge; what hangs on a chain has those of its fork.

    Parts that nothing joins to the figure have those of the node that is nearest.
    """
    v = len(curve.nodes)
    limb, place = np.full(v, -1, np.int32), np.zeros(v)
    of_edge: dict[frozenset[int], tuple[int, float, int, float]] = {}
    for rank, chain in enumerate(chains):
        places = places_along(curve.nodes[chain.nodes])
        for k, node in enumerate(chain.nodes):
            if limb[node] < 0:
                limb[node], place[node] = rank, places[k]
                if k:
                    pair = frozenset(chain.nodes[k - 1 : k + 1])
                    of_edge[pair] = (rank, places[k - 1], node, places[k])
    waiting = np.flatnonzero(limb >= 0).tolist()
    own = np.array(waiting)
    for node in waiting:  # grows while it is read
        for other in curve.neighbours[node]:
            if limb[other] < 0:
                limb[other], place[other] = limb[node], place[node]
                waiting.append(other)
    lost = np.flatnonzero(limb < 0)
    if len(lost):
        near = own[kd_tree(curve.nodes[own]).query(curve.nodes[lost])[1]]
        limb[lost], place[lost] = limb[near], place[near]
    edges = curve.edges
    edge_limbs, spans = limb[edges[:, 0]].copy(), place[edges]
    for row, pair in enumerate(edges.tolist()):
        if (known := of_edge.get(frozenset(pair))) is not None:
            rank, low, end, high = known
            edge_limbs[row] = rank
            spans[row] = (low, high) if pair[1] == end else (high, low)
        elif limb[pair[0]] != limb[pair[1]] or abs(np.diff(spans[row])[0]) > 0:
            edge_limbs[row] = -1  # it closes a loop
    return {"edge_limbs": edge_limbs, "edge_spans": spans, "node_limbs": limb,
            "node_places": place}  # fmt: skip
