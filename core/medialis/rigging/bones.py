"""Bones along the branches of a curve skeleton, and the weights with which they move the surface.

Steps: limbs of the tree of shortest paths, and pairs of mirrored ones (`limbs.py`); joints where a
limb bends or its thickness changes (`_joints`); bones from joint to joint, and where on them every
node and edge of the curve skeleton lies (`_lay_bones`), which is what skin weights rest on
(`_skin`); these are smoothed along the surface.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from medialis.base.arrays import kd_tree
from medialis.base.errors import InvalidShapeError
from medialis.base.kept import Bound
from medialis.base.options import Options, algorithm, length, number
from medialis.base.progress import Progress, counted
from medialis.base.threads import run_patiently
from medialis.base.validation import (
    Directions,
    FloatArray,
    IntArray,
    Measures,
    Positions,
    frozen,
    hold,
)
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.rigging.armature import Armature
from medialis.rigging.limbs import (
    Limb,
    find_limbs,
    hang_limbs,
    joint_rows,
    mirrored_limbs,
    sample_shares,
)
from medialis.shape.graph import dissected
from medialis.shape.surface import Surface

MOST_BONES = 4  # halved 6 %, doubled 0.4 %
"""Bones that move one vertex: what game engines and exchange formats hold."""

LEAST_WEIGHT = 0.01  # halved 0.2 %, doubled 0.5 %
"""Weights below this are left out: the tails of the smoothing would run over the whole shape."""

AT_ONCE = 16  # halved 0 %, doubled 0 %
"""Bones whose weights are solved for together: the factors are read once for all of them."""

BY_DEGREE = 50_000
"""Vertices up to which they are put in order by minimum degree, which leaves half to a tenth of the
factors that halving across space does. On 500,000 it takes minutes."""

NAMES_TOLD = 6
"""Names of bones in their text."""

_WHOLE = ("parents", "limbs", "mirrors", "sides", "edge_limbs", "node_limbs")


@dataclass(frozen=True, eq=False, repr=False)
class Bones(Bound):
    """A tree of straight bones along the limbs of a curve skeleton; parents come first.

    A limb is a chain of bones from one fork of the tree to the next, or to an end.

    Attributes
    ----------
    heads, tails : (b, 3) float64
        Joints, in the units of the shape.
    parents : (b,) int32
        -1: a root, one for each component of the curve skeleton.
    limbs : (b,) int32
        Limb of each bone, 0, 1, ...; those of a limb follow each other.
    mirrors : (b,) int32
        Bone that is the mirror image of each one; -1: none.
    sides : (b,) int32
        1 left of the plane of symmetry, -1 right of it, 0 where there is no mirror image. Left is
        where the largest coordinate of the normal of the plane is positive: x in Blender.
    starts, ends : (b,) float64
        Positions of the joints along the limb's curve; a limb begins with 0.
    head_radii, tail_radii : (b,) float64
        Radius of the curve skeleton at the joints.
    before, after : (b,) float64
        The weight passes from the parent to the bone between so far before its head (on the parent)
        and so far behind it, along the curve.
    edge_limbs : (e,) int32
        Limb that each edge of the curve skeleton belongs to; -1: it was cut.
    edge_spans : (e, 2) float64
        Positions of both ends of an edge along the limb; equal on twigs too short for a bone.
    node_limbs, node_places : (v,) int32, (v,) float64
        The same for nodes.
    curve : CurveSkeleton
        The curve skeleton that they lie along, with v nodes and e edges.
    given_names : tuple of str
        Names in the place of numbers.
    kind : str
        "biped" or "quadruped" where the bones are those of one (`figure_bones.py`), else "".
    frame : (3, 3) float64 or None
        Of a figure: the directions to its own left, ahead and up, unit rows.
    """

    heads: Positions
    tails: Positions
    parents: IntArray
    limbs: IntArray
    mirrors: IntArray
    sides: IntArray
    starts: FloatArray
    ends: FloatArray
    head_radii: FloatArray
    tail_radii: FloatArray
    before: FloatArray
    after: FloatArray
    edge_limbs: IntArray
    edge_spans: Measures
    node_limbs: IntArray
    node_places: FloatArray
    curve: CurveSkeleton = field(kw_only=True)
    given_names: tuple[str, ...] = field(default=(), kw_only=True)
    kind: str = field(default="", kw_only=True)
    frame: Directions | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if name not in ("curve", "given_names", "kind") and value is not None:
                kind = np.int32 if name in _WHOLE else np.float64
                object.__setattr__(self, name, frozen(value, kind))

    def __repr__(self) -> str:
        kind = f", a {self.kind}" if self.kind else ""
        first = ", ".join(self.names[:NAMES_TOLD])
        rest = ", ..." if self.count > NAMES_TOLD else ""
        return f"Bones({counted(self.count, 'bone')}{kind}: {first}{rest})"

    @property
    def count(self) -> int:
        """Number of bones b."""
        return len(self.parents)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each bone: a given one, or "bone 000", "bone 001.L", "bone 001.R", ..."""
        if self.given_names:
            return self.given_names
        first = np.where(self.mirrors >= 0, np.minimum(self.mirrors, np.arange(self.count)), -1)
        sides = zip(first.tolist(), self.sides.tolist(), strict=True)
        return tuple(
            f"bone {number if low < 0 else low:03d}{('', '.L', '.R')[side]}"
            for number, (low, side) in enumerate(sides)
        )

    @property
    def roots(self) -> IntArray:
        """Bones without a parent."""
        return frozen(np.flatnonzero(self.parents < 0), np.int32)

    @property
    def connected(self) -> np.ndarray:
        """Whether the head of each bone is the tail of its parent, (b,) bool."""
        return (self.parents >= 0) & (self.heads == self.tails[self.parents]).all(axis=1)

    @property
    def graph(self) -> CurveSkeleton:
        """The bones as a graph: a node at each joint, an edge for each bone, in their order."""
        connected = self.connected
        up = self.parents
        free = (up < 0) | ~connected & (self.heads != self.heads[up]).any(axis=1)
        first = int(free.sum())  # the heads of the roots and of free bones, then all tails
        node = np.empty(self.count, np.int64)
        node[free] = np.arange(first)
        links = []
        for bone, parent in enumerate(up.tolist()):
            if not free[bone]:  # a bone begins at an end of its parent, which comes before it
                node[bone] = first + parent if connected[bone] else node[parent]
            elif parent >= 0:  # hips and shoulders of figures: joined to the head of the parent
                links.append([node[parent], node[bone]])
        own = np.stack([node, first + np.arange(self.count)], axis=1)
        return CurveSkeleton.of(
            np.concatenate([self.heads[free], self.tails]),
            np.concatenate([own, np.array(links, np.int64).reshape(-1, 2)]),
            np.concatenate([self.head_radii[free], self.tail_radii]),
        )

    @property
    def cut(self) -> int:
        """Number of edges that were cut because they close loops."""
        return int((self.edge_limbs < 0).sum())


@dataclass(frozen=True, eq=False, repr=False)
class SkinWeights(Bound):
    """Which bones move each vertex of a surface, and how much.

    Attributes
    ----------
    bones : (n, k) int32
        By falling weight; -1: none. k is 4, or what was asked for.
    weights : (n, k) float64
        They sum to 1; 0 where there is no bone.
    rig : Bones, Armature or None
        The bones; of `Bones` the vertices are the first n points of ``rig.curve.surface``.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    bones: IntArray
    weights: Measures
    rig: Bones | Armature | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        wanted = np.shape(self.bones)
        if len(wanted) != 2 or wanted[1] == 0 or np.shape(self.weights) != wanted:
            raise InvalidShapeError(
                "bones and weights must both have shape (n, k), with one column or more, got "
                f"{wanted} and {np.shape(self.weights)}."
            )
        hold(self, bones=wanted, weights=wanted)

    def of_bone(self, bone: int) -> FloatArray:
        """Return the weight of one bone on every vertex, (n,)."""
        return frozen((self.weights * (self.bones == bone)).sum(axis=1), np.float64)


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
    for one, other in pairs:
        left, right = limbs[one].bones, limbs[other].bones
        mirrors[left], mirrors[right] = right, left
        sides[left], sides[right] = 1, -1
    joined: dict[str, Any] = {name: np.concatenate(parts) for name, parts in table.items()}
    joined |= _places(curve, limbs, {number: rank for rank, number in enumerate(kept)})
    joined |= {"parents": np.array(parents), "limbs": np.array(of_limb)}
    return Bones(curve=curve, mirrors=mirrors, sides=sides, **joined)


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
        along = limb.places if limb.kept else np.full(len(limb.nodes), place)
        if limb.above < 0:
            node_limbs[limb.nodes[0]] = rank[limb.start[0]]
        # All other first nodes are the last ones of the limb above.
        node_limbs[limb.nodes[1:]], node_places[limb.nodes[1:]] = rank[on], along[1:]
        for step, pair in enumerate(itertools.pairwise(limb.nodes)):
            edge = number_of[frozenset(pair)]
            span = along[[step, step + 1]]
            edge_limbs[edge] = rank[on]
            edge_spans[edge] = span if curve.edges[edge, 0] == pair[0] else span[::-1]
    of_nodes = {"node_limbs": node_limbs, "node_places": node_places}
    return {**of_nodes, "edge_limbs": edge_limbs, "edge_spans": edge_spans}


@dataclass(frozen=True, kw_only=True)
class SkinOptions(Options):
    """Options of `skin_weights`."""

    skin_smoothing: float = number(
        0.3,
        "Skin smoothing",
        "Weights are smoothed along the surface over this times the radius.",
        high=10.0,
        advanced=True,
    )


@algorithm(SkinOptions)
def skin_weights(rig: Bones, options: SkinOptions, progress: Progress) -> SkinWeights:
    """Compute the weights with which bones move the vertices of a surface.

    Each vertex is projected on the edges of the curve skeleton at its own node, so that what lies
    near in space but on another branch has no say. The weights are a function of that place: 1 on
    a bone, and passing over to the next one linearly near a joint (`bones`, option `blend`). Where
    neighbours on the surface belong to different branches the weights would jump: they are smoothed
    along the surface, if it has faces.

    Parameters
    ----------
    rig : Bones
        ``bones(curve_skeleton(cloud))``.

    Returns
    -------
    SkinWeights
        Every point of the surface has at most four bones, and weights that sum to 1. One without a
        node (no ball, or a part without a skeleton) takes those of the nearest one that has one.

    Raises
    ------
    InvalidShapeError
        When the curve skeleton of the bones does not know which point of a surface belongs to
        which node.

    See Also
    --------
    bones : the bones along a curve skeleton.

    Notes
    -----
    The smoothing solves one diffusion equation on the surface, as the heat weights of Baran and
    Popovic (2007) do; cost: one sparse factorization. Source: none; the map from the surface is
    that of thesis 3.6.

    Examples
    --------
    >>> import medialis
    >>> cloud = medialis.surface_skeleton(medialis.organic_shape(56))
    >>> skin = medialis.skin_weights(medialis.bones(medialis.curve_skeleton(cloud)))
    >>> round(float(skin.weights.sum(axis=1).min()), 12)
    1.0
    """
    curve = rig.curve
    if curve.surface is None or curve.vertex_node is None:
        raise InvalidShapeError(
            "Skin weights need bones along a curve skeleton that knows the points of its surface, "
            "as curve_skeleton computes it."
        )
    surface = curve.surface
    return run_patiently(lambda: _skin(rig, surface, options.skin_smoothing), progress)


def _skin(rig: Bones, surface: Surface, smoothing: float) -> SkinWeights:
    """Weigh the bones at each point by the nearest place on their curve, and smooth."""
    node = _nodes_everywhere(surface.points, rig.curve)
    skin = _weights(*_project(surface.points, node, rig), rig)
    if smoothing == 0 or surface.faces is None or rig.count == 1:
        return skin
    return smoothed_weights(skin, surface, smoothing * rig.curve.radii[node])


def _nodes_everywhere(points: FloatArray, curve: CurveSkeleton) -> IntArray:
    """Return the node of each vertex; those without one take it from the nearest vertex."""
    node = np.array(curve.vertex_node)
    missing = node < 0
    if missing.all():
        return kd_tree(curve.nodes).query(points)[1].astype(np.int32)
    if missing.any():
        node[missing] = node[~missing][kd_tree(points[~missing]).query(points[missing])[1]]
    return node


def _project(points: FloatArray, node: IntArray, rig: Bones) -> tuple[IntArray, FloatArray]:
    """Return limb and place of the nearest point on the edges at each vertex's node."""
    curve = rig.curve
    limb, place = rig.node_limbs[node], rig.node_places[node]
    best = ((points - curve.nodes[node]) ** 2).sum(axis=1)
    kept = np.flatnonzero(rig.edge_limbs >= 0)
    ends = np.concatenate([curve.edges[kept, 0], curve.edges[kept, 1]])
    order = np.argsort(ends, kind="stable")
    edge = np.concatenate([kept, kept])[order]
    count = np.bincount(ends, minlength=len(curve.nodes))
    first = np.cumsum(count) - count
    for turn in range(int(count.max(initial=0))):  # the edges of each node, one after the other
        rows = np.flatnonzero(count[node] > turn)
        near = edge[first[node[rows]] + turn]
        a, b = curve.nodes[curve.edges[near, 0]], curve.nodes[curve.edges[near, 1]]
        chord, off = b - a, points[rows] - a
        squared = (chord**2).sum(axis=1)
        share = np.divide((chord * off).sum(axis=1), squared, out=0 * squared, where=squared > 0)
        share = np.clip(share, 0.0, 1.0)
        distance = ((off - share[:, None] * chord) ** 2).sum(axis=1)
        nearer = distance < best[rows]
        rows, near, share = rows[nearer], near[nearer], share[nearer]
        best[rows] = distance[nearer]
        limb[rows] = rig.edge_limbs[near]
        low, high = rig.edge_spans[near].T
        place[rows] = low + share * (high - low)
    return limb, place


def _weights(limb: IntArray, place: FloatArray, rig: Bones) -> SkinWeights:
    """Evaluate the weights: the bone at a place, and its neighbour where they meet."""
    count = np.bincount(rig.limbs)
    first = np.cumsum(count) - count
    bone = _bones_at(limb, place, rig, first)
    step = bone - first[limb]
    behind, ahead = place - rig.starts[bone], rig.ends[bone] - place
    parent = rig.parents[bone]
    from_parent = np.where(parent >= 0, _passed(behind, rig.before[bone], rig.after[bone]), 0.0)
    child = np.where(step + 1 < count[limb], bone + 1, -1)
    to_child = np.where(child >= 0, _passed(ahead, rig.after[child], rig.before[child]), 0.0)
    other = np.where(from_parent > 0, parent, child)
    share = np.where(from_parent > 0, from_parent, to_child)
    swap = share > 0.5
    n = len(limb)
    bones, weights = np.full((n, MOST_BONES), -1, np.int32), np.zeros((n, MOST_BONES))
    bones[:, 0], weights[:, 0] = np.where(swap, other, bone), np.where(swap, share, 1 - share)
    two = (share > 0) & (share < 1)
    bones[:, 1] = np.where(two, np.where(swap, bone, other), -1)
    weights[:, 1] = np.where(two, 1 - weights[:, 0], 0.0)
    return SkinWeights(bones, weights, rig=rig)


def _bones_at(limb: IntArray, place: FloatArray, rig: Bones, first: IntArray) -> IntArray:
    """Return the bone at a place on a limb: the last one of it that begins there or before."""
    bone = first[limb]
    last = np.append(first[1:], rig.count)[limb] - 1
    while (onward := (bone < last) & (rig.starts[np.minimum(bone + 1, last)] <= place)).any():
        bone = bone + onward
    return bone


def _passed(distance: FloatArray, there: FloatArray, here: FloatArray) -> FloatArray:
    """Return the weight of the neighbour at a distance from the joint: linear over both widths."""
    width = there + here
    ramp = np.divide(here - distance, width, out=np.zeros_like(width), where=width > 0)
    return np.clip(ramp, 0.0, 1.0)


def smoothed_weights(
    skin: SkinWeights, surface: Surface, width: FloatArray, most: int = MOST_BONES
) -> SkinWeights:
    """Diffuse the weights over the surface, each vertex over its own width; keep the largest.

    Solves (M / width^2 + L) W = M / width^2 W0. L has no positive entry beside its diagonal and
    rows that sum to zero, so weights stay within 0 and 1 and keep their sum.
    """
    from scipy.sparse import csc_array, csr_array, diags_array
    from scipy.sparse.linalg import splu

    stiff, mass = stiffness(surface)
    pull = mass / np.maximum(width, 1e-6 * surface.diagonal) ** 2
    # Sorted by component the matrix has a block for each: a bone of one moves nothing of another.
    small = surface.point_count <= BY_DEGREE
    order = np.arange(len(width)) if small else dissected(surface.points, surface.edges)
    order = order[np.argsort(surface.components[order], kind="stable")]
    matrix = (stiff + diags_array(pull)).tocsr()[order][:, order]
    ends = np.cumsum(np.bincount(surface.components))
    used = skin.weights > 0
    table = csr_array(
        (skin.weights[used], (np.nonzero(used)[0], skin.bones[used])),
        shape=(len(width), int(skin.bones.max()) + 1),
    )
    bones = np.full((len(width), most), -1, np.int32)
    weights = np.zeros((len(width), most))
    room = ((0, 0), (0, max(most - skin.bones.shape[1], 0)))
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        rows = order[begin:end]
        try:
            solver = splu(
                csc_array(matrix[begin:end, begin:end]), diag_pivot_thresh=0.0,
                permc_spec="MMD_AT_PLUS_A" if small else "NATURAL", options={"SymmetricMode": True},
            )  # fmt: skip
        except RuntimeError:  # a body so small that rounding loses its areas
            continue
        own_bones, own_weights = bones[rows], weights[rows]
        own = csc_array(table[rows])
        present = np.flatnonzero(np.diff(own.indptr))
        for some in np.array_split(present, -(-len(present) // AT_ONCE)):
            spread = solver.solve(pull[rows, None] * own[:, some].toarray())
            for bone, values in zip(some.tolist(), spread.T, strict=True):
                _insert(own_bones, own_weights, bone, np.where(values < LEAST_WEIGHT, 0.0, values))
        bones[rows], weights[rows] = own_bones, own_weights
    total = weights.sum(axis=1, keepdims=True)
    lost = ~(total[:, 0] > 0.0)  # bodies far smaller than the whole: nothing of theirs is left
    bones[lost] = np.pad(skin.bones[lost], room, constant_values=-1)[:, :most]
    weights[lost], total[lost] = np.pad(skin.weights[lost], room)[:, :most], 1.0
    return replace(skin, bones=bones, weights=weights / total)


def _insert(bones: IntArray, weights: FloatArray, bone: int, values: FloatArray) -> None:
    """Sort one more bone into the rows of the heaviest four; the lightest falls out."""
    rows = np.flatnonzero(values > weights[:, -1])
    bones[rows, -1], weights[rows, -1] = bone, values[rows]
    order = np.argsort(-weights[rows], axis=1, kind="stable")
    bones[rows] = np.take_along_axis(bones[rows], order, axis=1)
    weights[rows] = np.take_along_axis(weights[rows], order, axis=1)


def stiffness(surface: Surface) -> tuple[Any, FloatArray]:
    """Return the cotangent Laplacian, its negative weights set to zero, and the vertex areas."""
    from scipy.sparse import diags_array

    weights = surface.cotangent_weights.copy()
    weights.data = np.maximum(weights.data, 0.0)
    stiff = diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights
    return stiff, np.where(surface.point_areas > 0, surface.point_areas, 1.0)
