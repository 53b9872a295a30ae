"""Bones for rigging along the branches of a curve skeleton."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.armature import Bones
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.polylines import follow, places_along
from medialis.options import Options, algorithm, length, number
from medialis.progress import Progress
from medialis.threads import run_patiently
from medialis.validation import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True)
class BonesOptions(Options):
    """Options of `bones`."""

    bone_length: float = length(
        0.12,
        "Bone length",
        "Longer branches are split into equal bones, none longer than this fraction of the size.",
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
        "Branches shorter than this times the radius where they begin get no bone.",
        high=10.0,
        advanced=True,
    )


@dataclass(eq=False)
class _Limb:
    """A chain of nodes of the tree, from a fork to the next fork or an end."""

    nodes: list[int]
    above: int
    """Limb that it hangs on; -1 at a root."""
    length: float = 0.0
    kept: bool = True
    start: tuple[int, float] = (-1, 0.0)
    """Limb with bones that its first node belongs to, and where on it; itself at a root."""
    end: tuple[int, float] = (-1, 0.0)
    """The same for its last node."""
    bones: range = range(0)


@algorithm(BonesOptions)
def bones(curve: CurveSkeleton, options: BonesOptions, progress: Progress) -> Bones:
    """Lay bones along the branches of a curve skeleton.

    Each component has its root at the thickest junction (without one, at the thickest end) and
    becomes a tree of shortest paths from there; edges that close loops are cut, where both ways
    round are equally long. The first bone of the thickest limb at the root is the root bone. The
    other limbs there are its children, but begin at its head.

    Limbs that are too short for a bone lie inside the ball where they begin; what hangs on them
    hangs on the limb before. Where two bones meet, the weight passes over on both sides of the
    joint, at most to the middle of a bone; at forks on the child alone, so that no limb moves its
    neighbours.

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
    limbs = _limbs(curve, *_tree(curve))
    _drop_twigs(curve, limbs, options.shortest)
    longest = options.bone_length * curve.diagonal or 1.0
    return _lay_bones(curve, limbs, _hang(curve, limbs), longest, options.blend)


def _roots(curve: CurveSkeleton) -> list[int]:
    """Return the root of each component: its thickest junction, else end, else node."""
    rank = np.where(curve.degrees >= 3, 2, np.where(curve.degrees == 1, 1, 0))
    order = np.lexsort((-np.arange(len(rank)), curve.radii, rank))  # the last one is the best
    best = dict(zip(curve.components[order].tolist(), order.tolist(), strict=True))
    return [best[number] for number in range(curve.component_count)]


def _tree(curve: CurveSkeleton) -> tuple[IntArray, list[int]]:
    """Return the node before each one on its shortest path from the root, -1 at roots."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    v, roots = len(curve.nodes), _roots(curve)
    a, b = curve.edges.T
    # A length of zero would mean no edge.
    weights = np.maximum(curve.edge_lengths, 1e-12 * max(curve.length, 1e-300))
    graph = coo_array((weights, (a, b)), shape=(v, v)).tocsr()
    _, above, _ = dijkstra(
        graph, directed=False, indices=roots, min_only=True, return_predecessors=True
    )
    return np.where(above < 0, -1, above).astype(np.int32), roots


def _limbs(curve: CurveSkeleton, above: IntArray, roots: list[int]) -> list[_Limb]:
    """Return the limbs of the tree, those above first."""
    below: list[list[int]] = [[] for _ in range(len(curve.nodes))]
    for node, before in enumerate(above.tolist()):
        if before >= 0:
            below[before].append(node)
    onward = np.array([nodes[0] if len(nodes) == 1 else -1 for nodes in below])
    limbs: list[_Limb] = []
    for root in roots:
        if not below[root]:
            limbs.append(_Limb([root], -1))
            continue
        # That of the limb with the largest mean radius comes first.
        thick = [float(curve.radii[follow(onward, node)].mean()) for node in below[root]]
        order = np.argsort(np.negative(thick), kind="stable")[::-1]
        waiting = [(root, below[root][place], -1) for place in order]
        while waiting:
            start, node, hangs_on = waiting.pop()
            row = [start, *follow(onward, node)]
            steps = np.linalg.norm(np.diff(curve.nodes[row], axis=0), axis=1)
            limbs.append(_Limb(row, hangs_on, float(steps.sum())))
            number, end = len(limbs) - 1, row[-1]
            waiting += [(end, node, number) for node in below[end][::-1]]
    return limbs


def _drop_twigs(curve: CurveSkeleton, limbs: list[_Limb], shortest: float) -> None:
    """Mark limbs that lie inside the ball they begin in; each component keeps one."""
    members_of: dict[int, list[_Limb]] = {}
    for limb in limbs:
        limb.kept = limb.length >= shortest * curve.radii[limb.nodes[0]]
        members_of.setdefault(int(curve.components[limb.nodes[0]]), []).append(limb)
    for members in members_of.values():
        if not any(limb.kept for limb in members):
            max(members, key=lambda limb: limb.length).kept = True


def _hang(curve: CurveSkeleton, limbs: list[_Limb]) -> list[int]:
    """Find out where both ends of each limb belong to; return those with bones, parents first.

    The root bone of a component is on the first limb at the root, unless all there are twigs.
    """
    kept = [one for one, limb in enumerate(limbs) if limb.kept]
    root_of: dict[int, int] = {}
    for one in sorted(kept, key=lambda one: limbs[one].above >= 0):
        root_of.setdefault(int(curve.components[limbs[one].nodes[0]]), one)
    for one, limb in enumerate(limbs):
        root = root_of[int(curve.components[limb.nodes[0]])]
        on_root = limb.above < 0 or one == root
        limb.start = (root, 0.0) if on_root else limbs[limb.above].end
        limb.end = (one, limb.length) if limb.kept else limb.start
    first = set(root_of.values())
    return [*sorted(first), *(one for one in kept if one not in first)]


def _lay_bones(
    curve: CurveSkeleton, limbs: list[_Limb], kept: list[int], longest: float, blend: float
) -> Bones:
    """Split the limbs into bones, and say where on them every edge and node lies."""
    table: dict[str, Any] = {}
    parents: list[int] = []
    of_limb: list[int] = []
    for rank, here in enumerate(kept):
        limb = limbs[here]
        row, along = _joints(curve, limb, longest)
        count, first = len(along) - 1, len(parents)
        limb.bones = range(first, first + count)
        above, place = limb.start
        above_bones = limbs[above].bones
        parent = -1 if above == here else above_bones[-1 if place > 0 else 0]
        parents += [parent, *range(first, first + count - 1)]
        of_limb += [rank] * count
        before, after = _windows(limb, row[:-1, 3], along, blend)
        for name, values in (
            ("heads", row[:-1, :3]), ("tails", row[1:, :3]),
            ("head_radii", row[:-1, 3]), ("tail_radii", row[1:, 3]),
            ("starts", along[:-1]), ("ends", along[1:]), ("before", before), ("after", after),
        ):  # fmt: skip
            table.setdefault(name, []).append(values)
    return Bones(
        curve=curve,
        parents=np.array(parents),
        limbs=np.array(of_limb),
        **{name: np.concatenate(parts) for name, parts in table.items()},
        **_places(curve, limbs, {number: rank for rank, number in enumerate(kept)}),
    )


def _joints(curve: CurveSkeleton, limb: _Limb, longest: float) -> tuple[FloatArray, FloatArray]:
    """Return position and radius (j, 4) of the joints of a limb, and their places along it."""
    rows = np.column_stack([curve.nodes[limb.nodes], curve.radii[limb.nodes]])
    if len(rows) == 1:  # a round part has no direction: its bone points up
        size = rows[0, 3] or 1.0
        return np.vstack([rows, rows[0] + [0, 0, size, 0]]), np.array([0.0, size])
    places = places_along(curve.nodes[limb.nodes])
    # The margin lets a limb of exactly two lengths have two bones.
    count = max(1, math.ceil(places[-1] / longest * (1 - 1e-9)))
    along = np.linspace(0.0, places[-1], count + 1)
    return np.stack([np.interp(along, places, column) for column in rows.T], axis=1), along


def _windows(
    limb: _Limb, radii: FloatArray, along: FloatArray, blend: float
) -> tuple[FloatArray, FloatArray]:
    """Return where the weight passes over, before and behind the head of each bone.

    Windows of one bone never overlap: each keeps to its half.
    """
    width = np.minimum(blend * radii, np.diff(along).min() / 2)
    before, after = width.copy(), width.copy()
    before[0], after[0] = 0.0, min(2 * blend * float(radii[0]), float(along[1]) / 2)
    return before, after


def _places(curve: CurveSkeleton, limbs: list[_Limb], rank: dict[int, int]) -> dict[str, Any]:
    """Return limb and place of every node and edge; twigs have those of the fork they hang on."""
    v, e = len(curve.nodes), len(curve.edges)
    number_of = {pair: i for i, pair in enumerate(map(frozenset, curve.edges.tolist()))}
    node_limbs, node_places = np.full(v, -1, np.int32), np.zeros(v)
    edge_limbs, edge_spans = np.full(e, -1, np.int32), np.zeros((e, 2))
    for limb in limbs:
        on, place = limb.end
        along = np.full(len(limb.nodes), place)
        if limb.kept:
            along = places_along(curve.nodes[limb.nodes])
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
