"""The limbs of a curve skeleton, their joints, and the pairs that are mirror images.

Limbs are chains of the tree of shortest paths from its root. Joints are where a limb bends, and
where its thickness changes. Pairs are the limbs that the plane under which the curve skeleton is
its own mirror image maps on each other.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from medialis.base.arrays import follow, kd_tree, places_along, rows_at, weighted_graph
from medialis.base.validation import FloatArray, IntArray
from medialis.curves.curve_skeleton import CurveSkeleton

LINK_SHARE = 0.5  # halved 0 %, doubled 59 %
"""Limbs between two forks need this share of the length that others need to have a bone: the trunk
of a stout figure is hardly longer than it is thick, and its spine has to get to the hips."""


TAPER = 0.15  # halved 77 %, doubled 12 %
"""The radius may be so far from a straight taper along a bone (root mean square over the mean). It
is 0.17 where the second half is half as thick as the first."""

PLACES_A_RADIUS = 4  # halved 8 %, doubled 4 %
"""Places at which a joint may be."""

MOST_PLACES = 128  # halved 29 %, doubled 1 %
"""Of a limb at which joints may be."""

SYMMETRIC = 0.65  # halved 100 %, doubled 100 %
"""Share of the length of all limbs whose image must be a limb, the less the farther it is off."""

EQUAL_PLANES = 0.05  # halved 67 %, doubled 0 %
"""Planes whose shares differ by less are equally good: the one facing x most is taken."""

SAMPLES = 400  # halved 44 %, doubled 0 %
"""Places along all limbs at which planes are compared."""

LONGEST_LIMBS = 24  # halved 59 %, doubled 0 %
"""Limbs between whose ends planes are tried."""

REFINED = 8  # halved 0 %, doubled 59 %
"""Best planes that are fitted."""

TURNS = 12  # halved 0 %, doubled 0 %
"""Of fitting a plane."""

STAYS = 0.9  # halved 0 %, doubled 0 %
"""Product of the normals of a plane before and after a turn below which it turned to another
symmetry."""

ALIKE = 0.97  # halved 63 %, doubled 63 %
"""Planes whose normals have at least this product are fitted once."""

COMPARED = np.linspace(0.0, 1.0, 17)
"""Shares of the length of limbs at which their balls are compared."""


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
        return rows_at(along, places, self.points)


def find_limbs(curve: CurveSkeleton, shortest: float) -> list[Limb]:
    """Return the limbs of the tree, those above first, twigs marked."""
    limbs = _limbs(curve, *shortest_tree(curve))
    _drop_twigs(curve, limbs, shortest)
    return limbs


def _roots(curve: CurveSkeleton) -> list[int]:
    """Return the root of each component: its thickest junction, else end, else node."""
    rank = np.where(curve.degrees >= 3, 2, np.where(curve.degrees == 1, 1, 0))
    order = np.lexsort((-np.arange(len(rank)), curve.radii, rank))  # the last one is the best
    best = dict(zip(curve.components[order].tolist(), order.tolist(), strict=True))
    return [best[number] for number in range(curve.component_count)]


def shortest_tree(curve: CurveSkeleton) -> tuple[IntArray, list[int]]:
    """Return the node before each one on its shortest path from the root, -1 at roots."""
    from scipy.sparse.csgraph import dijkstra

    v, roots = len(curve.nodes), _roots(curve)
    a, b = curve.edges.T
    # A length of zero would mean no edge.
    weights = np.maximum(curve.edge_lengths, 1e-12 * max(curve.length, 1e-300))
    graph = weighted_graph(weights, a, b, v)
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
        limb.kept = limb.length >= (LINK_SHARE * needed if leads_on[number] else needed)
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


def sample_shares(length: float, radii: FloatArray) -> FloatArray:
    """Return shares of the length of a limb where joints may be, (n + 1,), both ends included."""
    scale = float(np.median(radii)) or length or 1.0
    return np.linspace(
        0.0, 1.0, int(np.clip(np.ceil(PLACES_A_RADIUS * length / scale), 2, MOST_PLACES)) + 1
    )


def joint_rows(limbs: list[FloatArray], bend: float) -> list[int]:
    """Cut limbs that are alike into the fewest bones that they need; return the rows of the joints.

    Both ends are joints. A bone fits where its limb leaves it by no more than `bend` radii and its
    radius is nearly a straight taper. Of all ways with the fewest bones the one with the least
    squares is taken: with as many bones as there are straight parts, joints lie in the bends.

    Parameters
    ----------
    limbs : list of (n + 1, 4) float64
        Position and radius at equal steps along each limb.
    bend : float

    Notes
    -----
    Shortest path over all pairs of rows. Bones of one to two radii always fit and shorter ones
    never do, so that there is a path; a limb shorter than two radii is one bone.
    """
    last = len(limbs[0]) - 1
    steps = [np.linalg.norm(np.diff(limb[:, :3], axis=0), axis=1).mean() for limb in limbs]
    step = float(np.mean(steps))
    scale = max(float(np.median(np.concatenate([limb[:, 3] for limb in limbs]))), step)
    if last * step < 2 * scale or step == 0:
        return [0, last]
    found = [_misfits(limb, bend) for limb in limbs]
    squares = np.mean([mean for mean, _ in found], axis=0)
    most = np.mean([largest for _, largest in found], axis=0)
    taper = np.mean([_taper_misfits(limb[:, 3]) for limb in limbs], axis=0)
    apart = (np.arange(last + 1) - np.arange(last + 1)[:, None]) * step
    fits = ((most <= 1) & (taper <= TAPER) | (apart <= 2 * scale)) & (apart >= scale * (1 - 1e-9))
    # The shares sum to half a bone at most, so that one bone less always counts more.
    share = np.clip(squares, 0, 1) + np.minimum(taper / TAPER, 1) ** 2
    cost = np.where(fits, 1.0 + share * np.maximum(apart, 0) / (4 * last * step), np.inf)
    return _cheapest(cost)


def _cheapest(cost: FloatArray) -> list[int]:
    """Return the rows of the cheapest path from the first to the last by the costs of steps."""
    total, before = np.full(len(cost), np.inf), np.zeros(len(cost), int)
    total[0] = 0.0
    for row in range(1, len(cost)):
        sums = total[:row] + cost[:row, row]
        before[row] = int(np.argmin(sums))
        total[row] = sums[before[row]]
    rows = [len(cost) - 1]
    while rows[-1] > 0:
        rows.append(int(before[rows[-1]]))
    return rows[::-1]


def _misfits(samples: FloatArray, bend: float) -> tuple[FloatArray, FloatArray]:
    """Return mean and maximum of the square by which the limb leaves the bone i-j, (n, n) each.

    In units of the square that is allowed.
    """
    count = len(samples)
    # Tips may be as thin as they like: they count as half as thick as the limb.
    radii = np.maximum(samples[:, 3], 0.5 * np.median(samples[:, 3]))
    allowed = 1.0 / np.maximum(bend * radii, 1e-300) ** 2
    mean, most = np.zeros((count, count)), np.zeros((count, count))
    for i in range(count - 1):
        off = samples[i + 1 :, :3] - samples[i, :3]
        gram = off @ off.T
        # Row j: the bone ends there; column k: the sample, whose nearest place on it is sought.
        ends = np.diagonal(gram)
        share = np.clip(gram / np.maximum(ends, 1e-300)[:, None], 0.0, 1.0)
        apart = ends - 2 * share * gram + share**2 * ends[:, None]
        apart = np.tril(np.maximum(apart, 0) * allowed[i + 1 :])
        mean[i, i + 1 :] = apart.sum(axis=1) / np.arange(1, count - i)
        most[i, i + 1 :] = apart.max(axis=1)
    return mean, most


def _taper_misfits(radii: FloatArray) -> FloatArray:
    """Return how far the radii of the rows i to j are from a straight line, (n, n).

    Root mean square of the line of least squares, over the mean radius; from sums up to each row.
    """
    n = len(radii)
    x, y = np.arange(n, dtype=np.float64) - n / 2, np.asarray(radii / radii.mean(), np.float64)

    def summed(values: FloatArray) -> FloatArray:
        until = np.concatenate([[0.0], np.cumsum(values)])
        return until[1:] - until[:-1, None]

    count = np.maximum(np.arange(1, n + 1) - np.arange(n)[:, None], 1)
    mx, my = summed(x) / count, summed(y) / count
    xx, xy = summed(x**2) - count * mx**2, summed(x * y) - count * mx * my
    yy = summed(y**2) - count * my**2
    slope = np.divide(xy, xx, out=np.zeros_like(xy), where=xx > 0)
    left = np.maximum(yy - slope * xy, 0.0) / count
    return np.sqrt(left) / np.where(my > 0, my, 1.0)


@dataclass(frozen=True)
class Plane:
    """Points p with ``normal @ p == offset``; the left side is where it is larger."""

    normal: FloatArray
    offset: float

    def image(self, points: FloatArray) -> FloatArray:
        """Return the mirror image of points (..., 3)."""
        return points - 2 * (points @ self.normal - self.offset)[..., None] * self.normal


def mirrored_limbs(limbs: list[Limb]) -> list[tuple[int, int]]:
    """Return pairs of limbs that are mirror images of each other, left and right one.

    Planes are tried through the middle of all limbs, across their principal axes, and between the
    ends of any two of the longest; the best are fitted to what they map on what. A limb is the
    image of another where their balls overlap, on average, and each is the nearest image of the
    other. Without a plane that maps nearly all limbs on limbs (across it, or each along itself)
    there are no pairs.
    """
    kept = [number for number, limb in enumerate(limbs) if limb.kept and limb.length > 0]
    if len(kept) < 2:
        return []
    rows = np.stack([limbs[number].at(COMPARED) for number in kept])
    lengths = np.array([limbs[number].length for number in kept])
    planes = _planes(limbs, kept, rows, lengths)
    found = [(*_pairs(plane, rows, lengths), plane) for plane in planes]
    # A flat figure is its own image in its own plane, too: a limb that is mapped on another one
    # counts half as much again.
    found = [one for one in found if one[0] >= SYMMETRIC]
    if not found:
        return []
    in_pairs = [lengths[np.array(pairs, int)].sum() / lengths.sum() for _, pairs, _ in found]
    worth = np.array([share for share, _, _ in found]) + np.array(in_pairs) / 2
    equal = [found[k] for k in np.flatnonzero(worth >= worth.max() - EQUAL_PLANES)]
    _, pairs, plane = max(equal, key=lambda one: abs(one[2].normal[0]))
    side = rows[:, :, :3].mean(axis=1) @ plane.normal
    return [(kept[a], kept[b]) if side[a] > side[b] else (kept[b], kept[a]) for a, b in pairs]


def _planes(
    limbs: list[Limb], kept: list[int], rows: FloatArray, lengths: FloatArray
) -> list[Plane]:
    """Return the best planes, fitted."""
    step = lengths.sum() / SAMPLES
    shares = [np.linspace(0.0, 1.0, int(length / step) + 2) for length in lengths.tolist()]
    samples = np.concatenate([limbs[k].at(s) for k, s in zip(kept, shares, strict=True)])
    points = samples[:, :3]
    tree = kd_tree(points)
    middle = points.mean(axis=0)
    axes = np.linalg.eigh(np.cov((points - middle).T))[1].T
    planes = [_facing(axis, middle) for axis in axes]
    longest = np.argsort(-lengths, kind="stable")[:LONGEST_LIMBS]
    for a, b in itertools.combinations(longest.tolist(), 2):
        one, other = rows[a, -1, :3], rows[b, -1, :3]
        if (one != other).any():
            planes.append(_facing(one - other, (one + other) / 2))

    def misfit(plane: Plane) -> float:
        apart, near = tree.query(plane.image(points))
        return float(np.minimum(apart / np.maximum(samples[near, 3], 1e-300), 1.0).mean())

    order = np.argsort([misfit(plane) for plane in planes], kind="stable")
    distinct: list[Plane] = []
    for number in order.tolist():
        if all(abs(planes[number].normal @ plane.normal) < ALIKE for plane in distinct):
            distinct.append(planes[number])
    return [_fitted(plane, points, tree) for plane in distinct[:REFINED]]


def _facing(normal: FloatArray, through: FloatArray) -> Plane:
    """Return a plane through a point; the largest coordinate of its normal is positive."""
    normal = normal / np.linalg.norm(normal)
    normal = normal * np.sign(normal[np.argmax(np.round(np.abs(normal), 6))])
    return Plane(normal, float(normal @ through))


def _fitted(plane: Plane, points: FloatArray, tree: object) -> Plane:
    """Fit a plane to the pairs of a point and that nearest to its image, again and again.

    |q - image(p)|^2 is |q - p|^2 + 4 (n p)(n q) for p and q from their means: the best normal is
    the eigenvector of the smallest eigenvalue of the symmetric part of the sum of p q^T.
    """
    for _ in range(TURNS):
        _, near = tree.query(plane.image(points))  # type: ignore[attr-defined]
        p, q = points, points[near]
        product = (p - p.mean(axis=0)).T @ (q - q.mean(axis=0))
        normal = np.linalg.eigh(product + product.T)[1][:, 0]
        after = _facing(normal, (p.mean(axis=0) + q.mean(axis=0)) / 2)
        if abs(after.normal @ plane.normal) < STAYS:
            return plane
        plane = after
    return plane


def _pairs(
    plane: Plane, rows: FloatArray, lengths: FloatArray
) -> tuple[float, list[tuple[int, int]]]:
    """Return the share of the length whose image is a limb, and the pairs of limbs.

    A limb counts the less the farther its image is off: 1 - d^2, d = 1 where balls only touch.
    """
    from scipy.spatial.distance import cdist

    apart = np.zeros((len(rows), len(rows)))
    for k in range(len(COMPARED)):
        touching = np.maximum(rows[:, None, k, 3] + rows[None, :, k, 3], 1e-300)
        apart += cdist(plane.image(rows[:, k, :3]), rows[:, k, :3]) / touching
    apart = (apart + apart.T) / (2 * len(COMPARED))
    image = apart.argmin(axis=1)
    number = np.arange(len(rows))
    good = (image[image] == number) & (apart[number, image] <= 1.0)
    overlap = np.maximum(1.0 - apart[number, image] ** 2, 0.0)
    share = float((lengths * good * overlap).sum() / lengths.sum())
    pairs = [(a, int(image[a])) for a in np.flatnonzero(good & (image > number)).tolist()]
    return share, pairs
