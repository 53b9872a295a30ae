"""Bones along a curve skeleton, and the weights with which they move a surface."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.kept import Bound
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.validation import FloatArray, IntArray, frozen

MOST_BONES = 4
"""Bones that move one vertex: what game engines and exchange formats hold."""

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
    """

    heads: FloatArray
    tails: FloatArray
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
    edge_spans: FloatArray
    node_limbs: IntArray
    node_places: FloatArray
    curve: CurveSkeleton = field(kw_only=True)
    given_names: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if name not in ("curve", "given_names"):
                kind = np.int32 if name in _WHOLE else np.float64
                object.__setattr__(self, name, frozen(value, kind))

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
        return tuple(
            f"bone {number if low < 0 else low:03d}{('', '.L', '.R')[side]}"
            for number, (low, side) in enumerate(
                zip(first.tolist(), self.sides.tolist(), strict=True)
            )
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
        first = len(self.roots)  # the heads of the roots, then the tail of each bone
        node = np.empty(self.count, np.int64)
        node[self.roots] = np.arange(first)
        connected = self.connected
        for bone, parent in enumerate(self.parents.tolist()):
            if parent >= 0:  # a bone begins at an end of its parent, which comes before it
                node[bone] = first + parent if connected[bone] else node[parent]
        return CurveSkeleton.of(
            np.concatenate([self.heads[self.roots], self.tails]),
            np.stack([node, first + np.arange(self.count)], axis=1),
            np.concatenate([self.head_radii[self.roots], self.tail_radii]),
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
    bones : (n, 4) int32
        By falling weight; -1: none.
    weights : (n, 4) float64
        They sum to 1; 0 where there is no bone.
    rig : Bones or None
        The bones; the vertices are the first n points of ``rig.curve.surface``.

    Raises
    ------
    InvalidShapeError
        When the arrays do not fit together.
    """

    bones: IntArray
    weights: FloatArray
    rig: Bones | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        wanted = (len(self.bones), MOST_BONES)
        if np.shape(self.bones) != wanted or np.shape(self.weights) != wanted:
            raise InvalidShapeError(
                f"bones and weights must both have shape (n, {MOST_BONES}), got "
                f"{np.shape(self.bones)} and {np.shape(self.weights)}."
            )
        object.__setattr__(self, "bones", frozen(self.bones, np.int32))
        object.__setattr__(self, "weights", frozen(self.weights, np.float64))

    def of_bone(self, bone: int) -> FloatArray:
        """Return the weight of one bone on every vertex, (n,)."""
        return frozen((self.weights * (self.bones == bone)).sum(axis=1), np.float64)
