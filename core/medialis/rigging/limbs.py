"""The limbs of a curve skeleton: chains of the tree of shortest paths from its root."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.polylines import follow, places_along
from medialis.validation import FloatArray, IntArray

LINK = 0.5
"""Limbs between two forks need this share of the length that others need to have a bone: the trunk
of a stout figure is hardly longer than it is thick, and its spine has to get to the hips."""


@dataclass(eq=False)
class Limb:
    """A chain of nodes of the tree, from a fork to the next fork or an end."""

    nodes: list[int]
    above: int
    """Limb that it hangs on; -1 at a root."""
    points: FloatArray
    """Position and radius along it, (k, 4); its first position is the joint that it hangs on."""
    kept: bool = True
    start: tuple[int, float] = (-1, 0.0)
    """Limb with bones that its first node belongs to, and where on it; itself at a root."""
    end: tuple[int, float] = (-1, 0.0)
    """The same for its last node."""
    bones: range = field(default=range(0))

    @property
    def places(self) -> FloatArray:
        """Length up to each of its points, (k,)."""
        return places_along(self.points[:, :3])

    @property
    def length(self) -> float:
        """Length of all of it."""
        return float(self.places[-1])

    def at(self, shares: FloatArray) -> FloatArray:
        """Return position and radius at shares of the length, (s, 4)."""
        places = self.places
        along = shares * places[-1]
        return np.stack([np.interp(along, places, column) for column in self.points.T], axis=1)


def find_limbs(curve: CurveSkeleton, shortest: float) -> list[Limb]:
    """Return the limbs of the tree, those above first, twigs marked."""
    limbs = _limbs(curve, *_tree(curve))
    _drop_twigs(curve, limbs, shortest)
    return limbs


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


def _limbs(curve: CurveSkeleton, above: IntArray, roots: list[int]) -> list[Limb]:
    """Follow the tree from the roots, from fork to fork."""
    table = np.column_stack([curve.nodes, curve.radii])
    below: list[list[int]] = [[] for _ in range(len(curve.nodes))]
    for node, before in enumerate(above.tolist()):
        if before >= 0:
            below[before].append(node)
    onward = np.array([nodes[0] if len(nodes) == 1 else -1 for nodes in below])
    limbs: list[Limb] = []
    for root in roots:
        if not below[root]:
            limbs.append(Limb([root], -1, table[[root]]))
            continue
        # That of the limb with the largest mean radius comes first.
        thick = [float(curve.radii[follow(onward, node)].mean()) for node in below[root]]
        order = np.argsort(np.negative(thick), kind="stable")[::-1]
        waiting = [(root, below[root][place], -1) for place in order]
        while waiting:
            start, node, hangs_on = waiting.pop()
            row = [start, *follow(onward, node)]
            limbs.append(Limb(row, hangs_on, table[row]))
            number, end = len(limbs) - 1, row[-1]
            waiting += [(end, node, number) for node in below[end][::-1]]
    return limbs


def _drop_twigs(curve: CurveSkeleton, limbs: list[Limb], shortest: float) -> None:
    """Mark limbs that lie inside the ball they begin in; each component keeps one."""
    members_of: dict[int, list[Limb]] = {}
    leads_on = [False] * len(limbs)
    for number in reversed(range(len(limbs))):  # those below first
        limb = limbs[number]
        needed = shortest * curve.radii[limb.nodes[0]]
        limb.kept = limb.length >= (LINK * needed if leads_on[number] else needed)
        if limb.above >= 0:
            leads_on[limb.above] |= limb.kept or leads_on[number]
        members_of.setdefault(int(curve.components[limb.nodes[0]]), []).append(limb)
    for members in members_of.values():
        if not any(limb.kept for limb in members):
            max(members[::-1], key=lambda limb: limb.length).kept = True


def hang_limbs(curve: CurveSkeleton, limbs: list[Limb], paired: set[int]) -> list[int]:
    """Find out where both ends of each limb belong to; return those with bones, parents first.

    The root bone of a component is on the first limb at the root that has no mirror image, else on
    the first there; unless all there are twigs. What hangs on a twig begins at the joint that the
    twig hangs on, so that no bone begins in the void.
    """
    kept = [one for one, limb in enumerate(limbs) if limb.kept]
    root_of: dict[int, int] = {}
    for one in sorted(kept, key=lambda one: (limbs[one].above >= 0, one in paired)):
        root_of.setdefault(int(curve.components[limbs[one].nodes[0]]), one)
    for one, limb in enumerate(limbs):
        root = root_of[int(curve.components[limb.nodes[0]])]
        on_root = limb.above < 0 or one == root
        limb.start = (root, 0.0) if on_root else limbs[limb.above].end
        if limb.kept and one != root:
            limb.points = limb.points.copy()
            limb.points[0, :3] = limbs[limb.start[0]].points[-1 if limb.start[1] > 0 else 0, :3]
        limb.end = (one, limb.length) if limb.kept else limb.start
    first = set(root_of.values())
    return [*sorted(first), *(one for one in kept if one not in first)]
