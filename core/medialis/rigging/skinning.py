"""Weights with which bones along a curve skeleton move the surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from medialis.base.errors import InvalidShapeError
from medialis.base.options import Options, algorithm, number
from medialis.base.progress import Progress
from medialis.base.threads import run_patiently
from medialis.base.validation import FloatArray, IntArray
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.rigging.bones import MOST_BONES, Bones, SkinWeights
from medialis.shape.graph import dissected
from medialis.shape.surface import Surface

LEAST = 0.01
"""Weights below this are left out: the tails of the smoothing would run over the whole shape."""

AT_ONCE = 16
"""Bones whose weights are solved for together: the factors are read once for all of them."""


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
    return _smoothed(skin, surface, smoothing * rig.curve.radii[node])


def _nodes_everywhere(points: FloatArray, curve: CurveSkeleton) -> IntArray:
    """Return the node of each vertex; those without one take it from the nearest vertex."""
    from scipy.spatial import cKDTree

    node = np.array(curve.vertex_node)
    missing = node < 0
    if missing.all():
        return cKDTree(curve.nodes).query(points)[1].astype(np.int32)
    if missing.any():
        node[missing] = node[~missing][cKDTree(points[~missing]).query(points[missing])[1]]
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


def _smoothed(skin: SkinWeights, surface: Surface, width: FloatArray) -> SkinWeights:
    """Diffuse the weights over the surface, each vertex over its own width.

    Solves (M / width^2 + L) W = M / width^2 W0. L has no positive entry beside its diagonal and
    rows that sum to zero, so weights stay within 0 and 1 and keep their sum.
    """
    from scipy.sparse import csc_array, csr_array, diags_array
    from scipy.sparse.linalg import splu

    stiff, mass = _laplacian(surface)
    pull = mass / np.maximum(width, 1e-6 * surface.diagonal) ** 2
    # Sorted by component the matrix has a block for each: a bone of one moves nothing of another.
    order = dissected(surface.points, surface.edges)
    order = order[np.argsort(surface.components[order], kind="stable")]
    matrix = (stiff + diags_array(pull)).tocsr()[order][:, order]
    ends = np.cumsum(np.bincount(surface.components))
    used = skin.weights > 0
    table = csr_array(
        (skin.weights[used], (np.nonzero(used)[0], skin.bones[used])),
        shape=(len(width), int(skin.bones.max()) + 1),
    )
    bones = np.full((len(width), MOST_BONES), -1, np.int32)
    weights = np.zeros((len(width), MOST_BONES))
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        rows = order[begin:end]
        solver = splu(
            csc_array(matrix[begin:end, begin:end]), permc_spec="NATURAL",
            diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
        own_bones, own_weights = bones[rows], weights[rows]
        own = csc_array(table[rows])
        present = np.flatnonzero(np.diff(own.indptr))
        for some in np.array_split(present, -(-len(present) // AT_ONCE)):
            spread = solver.solve(pull[rows, None] * own[:, some].toarray())
            for bone, values in zip(some.tolist(), spread.T, strict=True):
                _insert(own_bones, own_weights, bone, np.where(values < LEAST, 0.0, values))
        bones[rows], weights[rows] = own_bones, own_weights
    return replace(skin, bones=bones, weights=weights / weights.sum(axis=1, keepdims=True))


def _insert(bones: IntArray, weights: FloatArray, bone: int, values: FloatArray) -> None:
    """Sort one more bone into the rows of the heaviest four; the lightest falls out."""
    rows = np.flatnonzero(values > weights[:, -1])
    bones[rows, -1], weights[rows, -1] = bone, values[rows]
    order = np.argsort(-weights[rows], axis=1, kind="stable")
    bones[rows] = np.take_along_axis(bones[rows], order, axis=1)
    weights[rows] = np.take_along_axis(weights[rows], order, axis=1)


def _laplacian(surface: Surface) -> tuple[Any, FloatArray]:
    """Return the cotangent Laplacian, its negative weights set to zero, and the vertex areas."""
    from scipy.sparse import diags_array

    weights = surface.cotangent_weights.copy()
    weights.data = np.maximum(weights.data, 0.0)
    stiff = diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights
    return stiff, np.where(surface.point_areas > 0, surface.point_areas, 1.0)
