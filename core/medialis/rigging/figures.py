"""Which limbs of a curve skeleton are the arms, legs, head and tail of a figure.

A figure has two pairs of limbs at the two ends of a trunk, a head, and perhaps a tail. All ways to
give these parts to the tips of the tree of the curve skeleton are weighed by what does not depend
on where the shape lies: lengths and radii of the limbs of a pair, the ways between them along the
tree, and the angles between trunk, pairs and limbs. Legs that go on where the trunk ends are those
of a biped, legs across it those of a quadruped. The axis that points up only decides where the rest
does not. What is not clearly a figure is none.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.arrays import kd_tree, places_along, unit_rows
from medialis.base.validation import FloatArray
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.rigging.limbs import shortest_tree

SHORT_TIP = 0.08  # halved 0 %, doubled 100 %
"""Free length, of the longest way between two tips, below which a branch is a detail of its limb:
ears, fingers, heels."""

MOST_TIPS = 9  # halved 100 %, doubled 0 %
"""Of the longest branches, that may be limbs."""

WHOLE = 0.75  # halved 0 %, doubled 100 %
"""Share of the length of all curves that one component has, for the shape to be one figure."""

ALIKE_LENGTHS = 0.3  # halved 0 %, doubled 0 %
"""Logarithm of the ratio of the lengths, or of the radii, of a pair that costs one."""

ROUND, MOST_ROUND = 0.6, 2  # halved 0.7 %, doubled 0 %; halved 0 %, doubled 0 %
"""Radius of a round part without a curve, of the largest of the curve skeleton; so many get one."""

LEAVING = 0.1
"""Share of its radius by which rounding may take a ball out of the box of its shape."""

ROUND_NODES = 8  # halved 0 %, doubled 0 %
"""Nodes of such a curve."""

MOST_UNLIKE = 4.0
"""What unlike lengths, or radii, of a pair cost at most: an arm may lie at the body."""

FLAT = 1.5  # halved 100 %, doubled 0 %
"""Area of a limb, of that of a round one, above which it is a sheet: wings, backs of chairs."""

CLEAR = 6.0
"""What the best way to tell limbs apart may cost."""

MOST_COST = 4 * CLEAR
"""From which on a way is absurd; whatever else is told of it adds to that."""

DISTINCT = 1.5  # halved 0 %, doubled 0 %
"""How much more each way must cost that gives the parts to others."""

EAR_ASIDE = 0.2
"""Least cosine of the angle between an ear and the axis across the head."""

EARS_ALIKE = 2.0
"""Ratio up to which the distances from the forks of both ears to their ends may differ."""

EARS, EAR, NECK = 1.5, 0.8, 0.15
"""Ratio up to which the lengths of two ears differ; their length, of that of legs, below which they
are ears; and how far beyond the front legs they leave the way to the head, of that."""

ALONG_TRUNK, ACROSS_TRUNK = 0.62, 0.5  # halved 0 %, doubled 0 %; halved 0 %, doubled 0 %
"""Cosine of the angle between the mean of the hind limbs and the trunk, from which on they are legs
of a biped, and to which those of a quadruped."""


@dataclass(frozen=True)
class Tip:
    """A branch of the tree that ends: from its fork to its end.

    Attributes
    ----------
    nodes : list of int
        From the fork to the end.
    base : (3,) float64
        Where it leaves the ball of the fork.
    end : (3,) float64
    length : float
        From its base to the surface beyond its end.
    radius : float
        Median of the radii from the base on.
    thickness : float
        Their upper quartile.
    flatness : float
        Area of the surface that belongs to it, of that of the round limb; 0 where it is unknown.
    toe : (3,) float64
        How far its end is off the line of what is before it, of its length.
    """

    nodes: list[int]
    base: FloatArray
    end: FloatArray
    length: float
    radius: float
    thickness: float
    flatness: float
    toe: FloatArray


@dataclass(frozen=True)
class Figure:
    """The parts of a biped or quadruped: nodes of the curve skeleton on the way to each tip.

    Attributes
    ----------
    kind : {"biped", "quadruped"}
    front, hind : (left, right)
        Nodes of the arms, or front legs, and of the legs, from their forks on.
    head : list of int
    tail : list of int
        Empty where there is none.
    parts : object
    """

    kind: str
    front: tuple[list[int], list[int]]
    hind: tuple[list[int], list[int]]
    head: list[int]
    tail: list[int]
    parts: _Parts


@dataclass(frozen=True)
class _Parts:
    """Rows of tips: which is what, and what is against it; the first of each pair is on one side.

    The middles of the pairs, the way across of the wider pair, the mean way and length of the legs.
    """

    kind: str
    front: tuple[int, int]
    hind: tuple[int, int]
    head: int
    tail: int
    against: dict[str, float]
    middles: tuple[FloatArray, FloatArray]
    across: FloatArray
    down: FloatArray
    leg: float

    @property
    def trunk(self) -> FloatArray:
        """The way from the hind pair to the front pair."""
        return self.middles[0] - self.middles[1]

    @property
    def cost(self) -> float:
        """All that is against it."""
        return sum(self.against.values())

    @property
    def named(self) -> tuple[object, ...]:
        """What the names say, but for the sides."""
        return self.kind, frozenset(self.front), frozenset(self.hind), self.head


class _Tree:
    """The tree of the largest component, without its short branches."""

    def __init__(self, curve: CurveSkeleton) -> None:
        self.curve = curve
        self.above, roots = shortest_tree(curve)
        lengths = np.bincount(
            curve.components[curve.edges[:, 0]], curve.edge_lengths, curve.component_count
        )
        largest = int(lengths.argmax())
        self.whole = bool(lengths[largest] >= WHOLE * lengths.sum())
        self.root = roots[largest]
        self.areas: FloatArray = np.zeros(len(curve.nodes))
        surface, own = curve.surface, curve.vertex_node
        if surface is not None and surface.faces is not None and own is not None:
            told = own >= 0
            weights = surface.point_areas[told]
            self.areas = np.bincount(own[told], weights, len(curve.nodes)).astype(np.float64)
        self.ways: dict[tuple[int, int], list[int]] = {}
        self.lengths: dict[tuple[int, int], float] = {}
        self.meetings: dict[tuple[int, int, int], int] = {}
        self.known: dict[tuple[int, ...], Tip] = {}
        self.beside: dict[int, set[int]] = {self.root: set()}
        for node in np.flatnonzero(curve.components == largest).tolist():
            if node != self.root:
                before = int(self.above[node])
                self.beside.setdefault(node, set()).add(before)
                self.beside.setdefault(before, set()).add(node)

    def from_root(self, node: int) -> list[int]:
        """Return the nodes on the way from the root to a node."""
        found = [node]
        while self.above[found[-1]] >= 0:
            found.append(int(self.above[found[-1]]))
        return found[::-1]

    def between(self, a: int, b: int) -> list[int]:
        """Return the nodes on the way from one node to another."""
        if (a, b) not in self.ways:
            self.ways[a, b] = self._between(a, b)
        return self.ways[a, b]

    def _between(self, a: int, b: int) -> list[int]:
        one, other = self.from_root(a), self.from_root(b)
        same = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1],
                                                  zip(one, other, strict=False)))  # fmt: skip
        return [*one[: same - 1 : -1], *other[same - 1 :]]

    def apart(self, a: int, b: int) -> float:
        """Return the length of the way between two nodes."""
        if (a, b) not in self.lengths:
            points = self.curve.nodes[self.between(a, b)]
            steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
            self.lengths[a, b] = float(steps.sum())
        return self.lengths[a, b]

    def tips(self) -> list[Tip]:
        """Return the branches that are long enough."""
        beside = {node: set(others) for node, others in self.beside.items()}
        ends = [node for node, others in beside.items() if len(others) == 1]
        span = max((self.apart(a, b) for a, b in itertools.combinations(ends, 2)), default=0.0)
        while len(ends) >= 4:
            found = [self._tip(end, beside) for end in ends]
            least = min(found, key=lambda tip: tip.length)
            if least.length >= SHORT_TIP * span and len(ends) <= MOST_TIPS:
                return found
            for node in least.nodes[1:]:
                for other in beside.pop(node):
                    if other in beside:
                        beside[other].discard(node)
            ends = [node for node, others in beside.items() if len(others) == 1]
        return []

    def _tip(self, end: int, beside: dict[int, set[int]]) -> Tip:
        """Follow a branch from its end to its fork."""
        nodes = [end]
        while len(onward := beside[nodes[-1]] - set(nodes[-2:])) == 1:
            nodes.append(onward.pop())
        return self.branch(tuple(nodes[::-1]))

    def meeting(self, a: int, b: int, c: int) -> int:
        """Return the node at which the ways between three others meet."""
        if (a, b, c) not in self.meetings:
            known = set(self.between(a, c))
            common = itertools.takewhile(lambda node: node in known, self.between(a, b))
            self.meetings[a, b, c] = [*common][-1]
        return self.meetings[a, b, c]

    def without_ears(self, way: list[int], limbs: set[int], across: FloatArray) -> list[int]:
        """Return the way to a head: to where it parts into two ears, if it does so.

        Ears are none of the limbs, whose nodes are given.
        """
        nodes, side = self.curve.nodes, across / np.linalg.norm(across)
        for place in range(len(way) - 2, 0, -1):
            fork = way[place]
            for other in self.beside[fork] - {way[place - 1], way[place + 1]}:
                branch = [way[place - 1], fork, other]
                while len(onward := self.beside[branch[-1]] - {branch[-2]}) == 1:
                    branch.append(onward.pop())
                one, twin = (nodes[end] - nodes[fork] for end in (way[-1], branch[-1]))
                own, its = (float(np.linalg.norm(v)) for v in (one, twin))
                left, right = sorted((float(one @ side / own), float(twin @ side / its)))
                ear = other not in limbs
                aside = left < -EAR_ASIDE and right > EAR_ASIDE
                if ear and aside and max(own, its) < EARS_ALIKE * min(own, its):
                    return way[: place + 1]
        return way

    def limb(self, end: int, other: int, beyond: int) -> Tip:
        """Return the branch to an end from where the ways to two others part from it."""
        return self.branch(tuple(self.between(self.meeting(end, other, beyond), end)))

    def branch(self, nodes: tuple[int, ...]) -> Tip:
        """Measure a branch from its fork to its end."""
        if nodes in self.known:
            return self.known[nodes]
        points, radii = self.curve.nodes[list(nodes)], self.curve.radii[list(nodes)]
        out = np.linalg.norm(points - points[0], axis=1) > radii[0]
        first = int(out.argmax()) if out.any() else len(nodes) - 1
        steps = np.linalg.norm(np.diff(points[first:], axis=0), axis=1)
        tube = float(np.pi * (steps * (radii[first:-1] + radii[first + 1 :])).sum())
        area = float(self.areas[list(nodes[first:])].sum())
        self.known[nodes] = Tip(
            nodes=list(nodes),
            base=points[first],
            end=points[-1],
            length=float(steps.sum() + radii[-1]),
            radius=float(np.median(radii[first:])),
            thickness=float(np.quantile(radii[first:], 0.75)),
            flatness=area / max(tube + 2 * np.pi * radii[-1] ** 2, 1e-300),
            toe=_toe(points[first:]),
        )
        return self.known[nodes]


def with_round_parts(curve: CurveSkeleton) -> CurveSkeleton:
    """Return the curve skeleton with a branch to the middle of each round part that has none.

    A head that is a large ball on a short neck is no limb to curve skeletons. Its ball is one of
    the largest whose middle no ball of the curve skeleton holds.
    """
    cloud, own = curve.cloud, curve.vertex_node
    if cloud is None or own is None or len(curve.edges) == 0:
        return curve
    balls = cloud.subset(cloud.valid)
    low, high = cloud.surface.bounds
    room = np.minimum(balls.centers - low, high - balls.centers).min(axis=1)
    # A ball that leaves the box of the shape is none of its inside: its sample has a wrong normal.
    fits = room >= (1.0 - LEAVING) * balls.radii
    large = fits & (balls.radii >= ROUND * float(curve.radii.max()))
    centers, radii = balls.centers[large], balls.radii[large]
    all_centers = kd_tree(balls.centers)
    points = cloud.surface.points[: len(own)]
    away, near = kd_tree(curve.nodes).query(centers)
    free = away > curve.radii[near]  # most lie in the ball of the nearest node
    left = np.flatnonzero(free)
    for held in kd_tree(centers[left]).query_ball_point(curve.nodes, curve.radii):
        free[left[held]] = False
    for _ in range(MOST_ROUND):
        if not free.any():
            break
        best = int(np.argmax(np.where(free, radii, 0.0)))
        start = int((_apart(centers[best, None], curve.nodes)[0] - curve.radii).argmin())
        steps = np.linspace(0.0, 1.0, ROUND_NODES + 1)[1:, None]
        places = curve.nodes[start] + steps * (centers[best] - curve.nodes[start])
        sizes = balls.radii[all_centers.query(places)[1]]
        sizes[-1] = radii[best]
        free &= (_apart(centers, places) > sizes).all(axis=1)
        first = len(curve.nodes)
        chain = [start, *range(first, first + ROUND_NODES)]
        # What is nearer to a new ball than to that of its own node goes over to it.
        depth = _apart(points, places) - sizes
        given = np.maximum(own, 0)
        kept = np.linalg.norm(points - curve.nodes[given], axis=1) - curve.radii[given]
        goes = depth.min(axis=1) < np.where(own < 0, np.inf, kept)
        own = np.where(goes, first + depth.argmin(axis=1), own).astype(np.int32)
        curve = CurveSkeleton.of(
            np.concatenate([curve.nodes, places]),
            np.concatenate([curve.edges, np.stack([chain[:-1], chain[1:]], axis=1)]),
            np.concatenate([curve.radii, sizes]),
            vertex_node=own,
            cloud=cloud,
        )
    return curve


def _apart(points: FloatArray, others: FloatArray) -> FloatArray:
    """Return the distances of points from others, (n, m)."""
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(points, others))


def _toe(points: FloatArray) -> FloatArray:
    """Return how far the end of a limb is off the line before it, of its length, (3,)."""
    places = places_along(points)
    if places[-1] == 0:
        return np.zeros(3)
    low, high = (points[int(np.searchsorted(places, share * places[-1]))] for share in (0.5, 0.8))
    shin, off = unit_rows(high - low), points[-1] - high
    return np.asarray((off - (off @ shin) * shin) / places[-1])


def find_figure(curve: CurveSkeleton) -> tuple[Figure | None, str]:
    """Return the parts of the biped or quadruped whose curve skeleton this is.

    Parameters
    ----------
    curve : CurveSkeleton

    Returns
    -------
    Figure or None
        None where it is not clearly one.
    str
        What is not clear, as a sentence; empty where it is no figure at all.
    """
    if len(curve.edges) == 0:
        return None, ""
    tree = _Tree(curve)
    tips = tree.tips() if tree.whole else []
    found = sorted(_weighed(tree, tips), key=lambda parts: parts.cost)
    if not found or found[0].cost > CLEAR:
        return None, ""
    best = found[0]
    rivals = [one for one in found if one.cost < best.cost + DISTINCT and one.named != best.named]
    if any(one.named[:3] != best.named[:3] for one in rivals):
        return None, "Which limbs of the figure are arms, legs, head and tail is not clear."
    # Two ears that both could be the head hang on it.
    heads = [best.head, *(one.head for one in rivals)]
    figure = _figure(tree, tips, best, heads)
    return figure, "" if figure else "Where the head of the figure is, is not clear."


def _figure(tree: _Tree, tips: list[Tip], parts: _Parts, heads: list[int]) -> Figure | None:
    """Return the ways to the parts."""
    ends = [tip.nodes[-1] for tip in tips]
    (a, b), (c, d) = parts.front, parts.hind
    front, hind = tree.meeting(ends[a], ends[b], ends[c]), tree.meeting(ends[c], ends[d], ends[a])
    limbs = {node for k in (a, b) for node in tree.between(front, ends[k])}
    head = tree.without_ears(tree.between(hind, ends[heads[0]]), limbs, parts.across)
    for other in heads[1:]:
        same = zip(head, tree.between(hind, ends[other]), strict=False)
        head = [one for one, _ in itertools.takewhile(lambda pair: pair[0] == pair[1], same)]
    if front in head and head[-1] == front:
        return None
    tail = tree.between(hind, ends[parts.tail]) if parts.tail >= 0 else []
    ways = [tree.between(front, ends[k]) for k in (a, b)]
    ways += [tree.between(hind, ends[k]) for k in (c, d)]
    return Figure(parts.kind, (ways[0], ways[1]), (ways[2], ways[3]), head, tail, parts)


def _weighed(tree: _Tree, tips: list[Tip]) -> list[_Parts]:
    """Return all ways to give the parts of figures to tips that are not absurd, with costs."""
    n = len(tips)
    apart = np.array([[tree.apart(a.nodes[-1], b.nodes[-1]) for b in tips] for a in tips])
    found: list[_Parts] = []
    for front in itertools.combinations(range(n), 2):
        for hind in itertools.combinations(sorted(set(range(n)) - set(front)), 2):
            body = _body(tree, tips, apart, (front, hind))
            if body is None or body.cost >= MOST_COST:
                continue
            rest = sorted(set(range(n)) - set(front) - set(hind))
            for head in rest:
                twin = _other_ear(tree, tips, body, head, rest)
                top = tips[head] if twin < 0 else _between_ears(tree, tips, body, (head, twin))
                against = body.against | _against_head(top, apart, body, head)
                if sum(against.values()) >= MOST_COST:
                    continue
                for tail in (-1, *(k for k in rest if k not in (head, twin))):
                    others = [tips[k].length for k in rest if k not in (head, twin, tail)]
                    more = float(sum((length / body.leg / 0.35) ** 2 for length in others))
                    full = against | {"others": more}
                    if sum(full.values()) >= MOST_COST:
                        continue
                    if tail >= 0:
                        full |= _against_tail(tips, apart, body, top, tail)
                    parts = replace(body, head=head, tail=tail, against=full)
                    if parts.cost < MOST_COST:
                        found.append(parts)
    return found


def _body(
    tree: _Tree, tips: list[Tip], apart: FloatArray, pairs: tuple[tuple[int, int], tuple[int, int]]
) -> _Parts | None:
    """Return trunk and pairs with what is against them; None where they are no figure's."""
    ends = [tip.nodes[-1] for tip in tips]
    (a, b), (c, d) = pairs
    # By the ways along the tree, both of a pair are at the same end of the trunk.
    way = min(apart[a, c] + apart[b, d], apart[a, d] + apart[b, c])
    way = (way - apart[a, b] - apart[c, d]) / 2
    against = {"ends": (min(way, 0.0) / (0.05 * apart.max())) ** 2}
    arms = [tree.limb(ends[k], ends[other], ends[c]) for k, other in ((a, b), (b, a))]
    legs = [tree.limb(ends[k], ends[other], ends[a]) for k, other in ((c, d), (d, c))]
    for word, pair in (("arms", arms), ("legs", legs)):
        for name in ("length", "radius"):
            ratio = getattr(pair[0], name) / max(getattr(pair[1], name), 1e-300)
            against[f"{name} of {word}"] = min((np.log(ratio) / ALIKE_LENGTHS) ** 2, MOST_UNLIKE)
        against[f"flat {word}"] = _flat(pair[0].flatness + pair[1].flatness)
    if sum(against.values()) > MOST_COST:
        return None
    front, hind = (np.array([tip.base for tip in pair]) for pair in (arms, legs))
    trunk = front.mean(axis=0) - hind.mean(axis=0)
    wide, wide_hind = front[0] - front[1], hind[0] - hind[1]
    if wide @ wide_hind < 0:
        wide_hind, c, d = -wide_hind, d, c
    size = [float(np.linalg.norm(v)) for v in (trunk, wide, wide_hind)]
    if min(size) <= 0:
        return None
    across = wide / size[1] + wide_hind / size[2]
    across /= np.linalg.norm(across)
    along = trunk / size[0]
    against["twisted"] = ((1 - wide @ wide_hind / size[1] / size[2]) / 0.35) ** 2
    against["askew"] = (across @ along / 0.3) ** 2
    down = _mean_way(np.array([tip.end for tip in legs]) - hind, across)
    reach = _mean_way(np.array([tip.end for tip in arms]) - front, across)
    arm, leg = (sum(tip.length for tip in pair) / 2 for pair in (arms, legs))
    if -(down @ along) >= ALONG_TRUNK:
        kind = "biped"
        against["short legs"] = _excess(0.6 - leg / size[0], 0.2)
        against["long arms"] = _excess(abs(np.log(arm / leg)) - np.log(2), 0.3)
    elif abs(down @ along) <= ACROSS_TRUNK:
        kind = "quadruped"
        against["front legs along"] = _excess(abs(reach @ along) - ACROSS_TRUNK, 0.2)
        against["legs apart"] = _excess(0.7 - reach @ down, 0.3)
        against["uneven legs"] = (np.log(arm / leg) / 0.5) ** 2
        toes = np.mean([tip.toe @ along for tip in (*arms, *legs)])
        against["toes behind"] = _excess(-toes, 0.04)
    else:
        return None
    across = across * max(size[1:])
    middles = front.mean(axis=0), hind.mean(axis=0)
    return _Parts(kind, (a, b), (c, d), -1, -1, against, middles, across, down, float(leg))


def _excess(value: Any, unit: float) -> float:
    """Return the square of what is above zero, in a unit."""
    return float(max(0.0, float(value)) / unit) ** 2


def _flat(twice: float) -> float:
    """Return what the mean flatness of a pair costs."""
    return _excess(np.log(max(twice / 2 / FLAT, 1e-300)), 0.15)


def _mean_way(ways: FloatArray, across: FloatArray) -> FloatArray:
    """Return the mean direction of both limbs of a pair, without what of it is across."""
    mean = unit_rows(ways).mean(axis=0)
    mean = mean - (mean @ across) * across
    return np.asarray(mean / max(np.linalg.norm(mean), 1e-300))


def _other_ear(tree: _Tree, tips: list[Tip], body: _Parts, head: int, rest: list[int]) -> int:
    """Return the other ear, where this tip is one and the head has none of its own; else -1.

    Ears are alike, on both sides, shorter than legs, and leave the head beyond the front pair.
    """
    ends, side = [tip.nodes[-1] for tip in tips], unit_rows(body.across)
    (a, b), (c, _), own = body.front, body.hind, tips[head]
    start = tree.apart(ends[c], tree.meeting(ends[a], ends[b], ends[c]))
    for other in rest:
        one, twin = own, tips[other]
        aside = (one.end - body.middles[0]) @ side, (twin.end - body.middles[0]) @ side
        alike = abs(np.log(one.length / twin.length)) < np.log(EARS)
        if other == head or not alike or aside[0] * aside[1] >= 0:
            continue
        fork = tree.meeting(ends[head], ends[other], ends[c])
        beyond = tree.apart(ends[c], fork) - start
        if max(one.length, twin.length) < EAR * body.leg and beyond > NECK * body.leg:
            return other
    return -1


def _between_ears(tree: _Tree, tips: list[Tip], body: _Parts, ears: tuple[int, int]) -> Tip:
    """Return a tip in the middle of two ears, as thick as the head where they part."""
    one, other = (tips[k] for k in ears)
    fork = tree.meeting(one.nodes[-1], other.nodes[-1], tips[body.hind[0]].nodes[-1])
    return replace(one, base=(one.base + other.base) / 2, end=(one.end + other.end) / 2,
                   thickness=float(tree.curve.radii[fork]))  # fmt: skip


def _against_head(tip: Tip, apart: FloatArray, body: _Parts, head: int) -> dict[str, float]:
    """Return what is against the head: it hangs on the front end, in the middle, and leads on."""
    (a, b), (c, d) = body.front, body.hind
    size, wide = float(np.linalg.norm(body.trunk)), float(np.linalg.norm(body.across))
    along, side = body.trunk / size, body.across / wide
    near = apart[head, a] + apart[head, b] - apart[a, b]
    far = apart[head, c] + apart[head, d] - apart[c, d]
    middle = body.middles[0]
    on = tip.end - middle
    reach = float(np.linalg.norm(on))
    least, most = (0.6, 1.3) if body.kind == "biped" else (-0.2, 2.0)
    return {
        "head behind": (min(far - near, 0.0) / (0.1 * apart.max())) ** 2,
        "head aside": float((tip.base - middle) @ side / wide / 0.35) ** 2,
        "head turned": _excess(abs(on @ side) - 0.3 * reach, 0.2 * reach),
        "long head": _excess(np.log(tip.length / body.leg / most), 0.2),
        "head back": _excess(least * reach - on @ along, 0.25 * reach),
    }


def _against_tail(
    tips: list[Tip], apart: FloatArray, body: _Parts, head: Tip, tail: int
) -> dict[str, float]:
    """Return what is against the tail: it hangs on the hind end, in the middle, is the thinner."""
    (a, b), (c, d), tip = body.front, body.hind, tips[tail]
    wide = float(np.linalg.norm(body.across))
    near = apart[tail, c] + apart[tail, d] - apart[c, d]
    far = apart[tail, a] + apart[tail, b] - apart[a, b]
    aside = (tip.base - body.middles[1]) @ body.across / wide**2
    thicker = np.log(tip.thickness / max(head.thickness, 1e-300))
    return {
        "tail in front": (min(far - near, 0.0) / (0.1 * apart.max())) ** 2,
        "tail aside": (aside / 0.35) ** 2,
        "tail thick": _excess(thicker + 0.3, 0.3),
    }
