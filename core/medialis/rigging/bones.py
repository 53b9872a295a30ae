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
from medialis.validation import FloatArray, IntArray, as_number

DEFAULT_BONE_LENGTH = 0.12
"""Longest bone as a fraction of the diagonal: a finger of a hand gets two or three."""
DEFAULT_SHORTEST = 1.0
DEFAULT_BLEND = 1.0


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


def bones(
    curve: CurveSkeleton,
    *,
    length: float | None = None,
    shortest: float = DEFAULT_SHORTEST,
    blend: float = DEFAULT_BLEND,
) -> Bones:
    """Lay bones along the branches of a curve skeleton.

    Each component has its root at the thickest junction (without one, at the thickest end) and
    becomes a tree of shortest ways from there; edges that close loops are cut, where both ways
    round are equally long. The first bone of the thickest limb at the root is the root bone. The
    other limbs there are its children, but begin at its head.

    Parameters
    ----------
    curve : CurveSkeleton
        With at least one node.
    length : float, optional
        Longest bone, in the units of the shape: longer limbs are split into equal bones. When
        missing, 0.12 of the diagonal of the nodes' bounding box.
    shortest : float
        Limbs shorter than this times the radius at their beginning get no bone: they lie inside the
        ball there. What hangs on them hangs on the limb before. 0 to 100.
    blend : float
        Where two bones meet, the weight passes over within this times the radius on both sides of
        the joint, at most to the middle of a bone. At forks it passes over on the child, so that no
        limb moves its neighbours. 0 (stiff) to 100.

    Raises
    ------
    InvalidShapeError
        When the curve skeleton has no node.
    InvalidOptionError
        When an option is out of its range.

    See Also
    --------
    curve_skeleton : what the bones lie along.
    skin_weights : how they move the surface.

    Notes
    -----
    Cost: shortest ways from one node of each component. Source: none; the thesis has no rigging.

    Examples
    --------
    >>> import medialis
    >>> line = medialis.CurveSkeleton.of([[0, 0, 0], [4, 0, 0]], [[0, 1]], [1, 1])
    >>> rig = medialis.bones(line, length=2)
    >>> rig.heads[:, 0].tolist(), rig.parents.tolist()
    ([0.0, 2.0], [-1, 0])
    """
    if len(curve.nodes) == 0:
        raise InvalidShapeError("Bones need a curve skeleton with at least one node, got none.")
    as_number(shortest, "shortest", low=0, high=100)
    as_number(blend, "blend", low=0, high=100)
    if length is None:
        size = math.dist(curve.nodes.min(axis=0), curve.nodes.max(axis=0))
        length = DEFAULT_BONE_LENGTH * size or 1.0
    longest = as_number(length, "length", low=0, open_low=True)
    limbs = _limbs(curve, *_tree(curve))
    _drop_twigs(curve, limbs, shortest)
    return _lay_bones(curve, limbs, _hang(curve, limbs), longest, blend)


def _roots(curve: CurveSkeleton) -> list[int]:
    """Return the root of each component: its thickest junction, else end, else node."""
    rank = np.where(curve.degrees >= 3, 2, np.where(curve.degrees == 1, 1, 0))
    order = np.lexsort((-np.arange(len(rank)), curve.radii, rank))  # the last one is the best
    best = dict(zip(curve.components[order].tolist(), order.tolist(), strict=True))
    return [best[number] for number in range(curve.component_count)]


def _tree(curve: CurveSkeleton) -> tuple[IntArray, list[int]]:
    """Return the node before each one on its shortest way from the root, -1 at roots."""
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
    limbs: list[_Limb] = []
    for root in roots:
        if not below[root]:
            limbs.append(_Limb([root], -1))
            continue
        waiting = [(root, node, -1) for node in _thickest_first(curve, below, root)[::-1]]
        while waiting:
            start, node, hangs_on = waiting.pop()
            row = [start, node]
            while len(below[row[-1]]) == 1:
                row.append(below[row[-1]][0])
            points = curve.nodes[row]
            reach = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
            limbs.append(_Limb(row, hangs_on, reach))
            number, end = len(limbs) - 1, row[-1]
            waiting += [(end, node, number) for node in below[end][::-1]]
    return limbs


def _thickest_first(curve: CurveSkeleton, below: list[list[int]], root: int) -> list[int]:
    """Return the nodes after the root, that of the limb with the largest mean radius first."""

    def thickness(node: int) -> float:
        row = [node]
        while len(below[row[-1]]) == 1:
            row.append(below[row[-1]][0])
        return -float(curve.radii[row].mean())

    return sorted(below[root], key=thickness)


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
    kept = [number for number, limb in enumerate(limbs) if limb.kept]
    root_of: dict[int, int] = {}
    for number in sorted(kept, key=lambda number: limbs[number].above >= 0):
        root_of.setdefault(int(curve.components[limbs[number].nodes[0]]), number)
    for number, limb in enumerate(limbs):
        root = root_of[int(curve.components[limb.nodes[0]])]
        on_root = limb.above < 0 or number == root
        limb.start = (root, 0.0) if on_root else limbs[limb.above].end
        limb.end = (number, limb.length) if limb.kept else limb.start
    first = set(root_of.values())
    return [*sorted(first), *(number for number in kept if number not in first)]


def _lay_bones(
    curve: CurveSkeleton, limbs: list[_Limb], kept: list[int], longest: float, blend: float
) -> Bones:
    """Split the limbs into bones, and say where on them every edge and node lies."""
    table: dict[str, Any] = {}
    parents: list[int] = []
    of_limb: list[int] = []
    for rank, number in enumerate(kept):
        limb = limbs[number]
        row, along = _joints(curve, limb, longest)
        count, first = len(along) - 1, len(parents)
        limb.bones = range(first, first + count)
        above, place = limb.start
        above_bones = limbs[above].bones
        parent = -1 if above == number else above_bones[-1 if place > 0 else 0]
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
    at = _along(curve, limb)
    # The margin lets a limb of exactly two lengths have two bones.
    along = np.linspace(0.0, at[-1], max(1, math.ceil(at[-1] / longest * (1 - 1e-9))) + 1)
    return np.stack([np.interp(along, at, column) for column in rows.T], axis=1), along


def _along(curve: CurveSkeleton, limb: _Limb) -> FloatArray:
    """Return the length of the limb up to each of its nodes."""
    steps = np.linalg.norm(np.diff(curve.nodes[limb.nodes], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _windows(
    limb: _Limb, radii: FloatArray, along: FloatArray, blend: float
) -> tuple[FloatArray, FloatArray]:
    """Return where the weight passes over, before and behind the head of each bone.

    Windows of one bone never overlap: each keeps to its half.
    """
    reach = np.minimum(blend * radii, np.diff(along).min() / 2)
    before, after = reach.copy(), reach.copy()
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
        along = _along(curve, limb) if limb.kept else np.full(len(limb.nodes), place)
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
