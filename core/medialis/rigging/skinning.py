"""Weights with which bones along a curve skeleton move the surface."""

from __future__ import annotations

from typing import Any

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.armature import MOST_BONES, Bones, SkinWeights
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.shape import Shape
from medialis.validation import FloatArray, IntArray, as_number

DEFAULT_SMOOTHING = 0.3
LEAST = 0.01
"""Weights below this are left out: the tails of the smoothing would reach over the whole shape."""


def skin_weights(
    shape: Shape, curve: CurveSkeleton, rig: Bones, *, smoothing: float = DEFAULT_SMOOTHING
) -> SkinWeights:
    """Compute the weights with which bones move the vertices of a surface.

    Each vertex is projected on the edges of the curve skeleton at its own node, so that what lies
    near in space but on another branch has no say. The weights are a function of that place: 1 on
    a bone, and passing over to the next one linearly near a joint (`bones`, option `blend`). Where
    neighbours on the surface belong to different branches the weights would jump: they are smoothed
    along the surface.

    Parameters
    ----------
    shape : Shape
        n points.
    curve : CurveSkeleton
        With `vertex_node` for these points, as `curve_skeleton` returns it.
    rig : Bones
        From `bones` of this curve skeleton.
    smoothing : float
        Width of the smoothing, times the radius of the curve skeleton, 0 to 10. Needs faces.

    Returns
    -------
    SkinWeights
        Every vertex has at most four bones, and weights that sum to 1. One without a node (no
        ball, or a part without a skeleton) takes those of the nearest vertex that has one.

    Raises
    ------
    InvalidShapeError
        When the curve skeleton does not know the points of the shape, or the bones are those of
        another one.
    InvalidOptionError
        When the smoothing is out of its range.

    See Also
    --------
    bones : what moves the surface.

    Notes
    -----
    The smoothing solves one diffusion equation on the surface, as the heat weights of Baran and
    Popovic (2007) do; cost: one sparse factorization. Source: none; the map from the surface is
    that of thesis 3.6.

    Examples
    --------
    >>> import medialis
    >>> found = medialis.run("curve_skeleton", medialis.organic_shape(56))
    >>> rig = medialis.bones(found.graph)
    >>> skin = medialis.skin_weights(found.shape, found.graph, rig)
    >>> round(float(skin.weights.sum(axis=1).min()), 12)
    1.0
    """
    width = as_number(smoothing, "smoothing", low=0, high=10)
    n = shape.point_count
    if curve.vertex_node is None or len(curve.vertex_node) != n:
        known = "none" if curve.vertex_node is None else str(len(curve.vertex_node))
        raise InvalidShapeError(
            f"Skin weights need a curve skeleton with the node of each of the {n} points, this one "
            f"knows {known}: compute it with curve_skeleton from the same shape."
        )
    if (len(rig.node_limbs), len(rig.edge_limbs)) != (len(curve.nodes), len(curve.edges)):
        raise InvalidShapeError(
            f"The bones are of a curve skeleton with {len(rig.node_limbs)} nodes and "
            f"{len(rig.edge_limbs)} edges, this one has {len(curve.nodes)} and {len(curve.edges)}: "
            "call bones again."
        )
    node = _nodes_everywhere(shape.points, curve)
    limb, place = _project(shape.points, node, curve, rig)
    skin = _weights(limb, place, rig)
    if width == 0 or shape.faces is None or rig.count == 1:
        return skin
    return _smoothed(skin, shape, width * curve.radii[node])


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


def _project(
    points: FloatArray, node: IntArray, curve: CurveSkeleton, rig: Bones
) -> tuple[IntArray, FloatArray]:
    """Return limb and place of the nearest point on the edges at each vertex's node."""
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
        at = edge[first[node[rows]] + turn]
        a, b = curve.nodes[curve.edges[at, 0]], curve.nodes[curve.edges[at, 1]]
        way, off = b - a, points[rows] - a
        squared = (way**2).sum(axis=1)
        share = np.divide((way * off).sum(axis=1), squared, out=0 * squared, where=squared > 0)
        share = np.clip(share, 0.0, 1.0)
        distance = ((off - share[:, None] * way) ** 2).sum(axis=1)
        nearer = distance < best[rows]
        rows, at, share = rows[nearer], at[nearer], share[nearer]
        best[rows] = distance[nearer]
        limb[rows] = rig.edge_limbs[at]
        low, high = rig.edge_spans[at].T
        place[rows] = low + share * (high - low)
    return limb, place


def _weights(limb: IntArray, place: FloatArray, rig: Bones) -> SkinWeights:
    """Evaluate the weights: the bone at a place, and its neighbour where they meet."""
    count = np.bincount(rig.limbs)
    first = np.cumsum(count) - count
    length = rig.ends[first + count - 1]
    # Bones of a limb have the same length.
    step = np.minimum((place / length[limb] * count[limb]).astype(np.int64), count[limb] - 1)
    bone = first[limb] + step
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
    return SkinWeights(bones, weights)


def _passed(distance: FloatArray, there: FloatArray, here: FloatArray) -> FloatArray:
    """Return the weight of the neighbour at a distance from the joint: linear over both widths."""
    width = there + here
    ramp = np.divide(here - distance, width, out=np.zeros_like(width), where=width > 0)
    return np.clip(ramp, 0.0, 1.0)


def _smoothed(skin: SkinWeights, shape: Shape, width: FloatArray) -> SkinWeights:
    """Diffuse the weights over the surface, each vertex over its own width.

    Solves (M / width^2 + L) W = M / width^2 W0. L has no positive entry beside its diagonal and
    rows that sum to zero, so weights stay within 0 and 1 and keep their sum.
    """
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import splu

    stiff, mass = _laplacian(shape)
    pull = mass / np.maximum(width, 1e-6 * shape.diagonal) ** 2
    # Sorted by component the matrix has a block for each: a bone of one moves nothing of another.
    order = np.argsort(shape.components, kind="stable")
    matrix = (stiff + diags_array(pull)).tocsr()[order][:, order]
    ends = np.cumsum(np.bincount(shape.components))
    bones = np.full((len(width), MOST_BONES), -1, np.int32)
    weights = np.zeros((len(width), MOST_BONES))
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        rows = order[begin:end]
        solver = splu(
            csc_array(matrix[begin:end, begin:end]), permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
        own_bones, own_weights = bones[rows], weights[rows]
        for bone in np.unique(skin.bones[rows][skin.weights[rows] > 0]).tolist():
            given = (skin.weights[rows] * (skin.bones[rows] == bone)).sum(axis=1)
            found = solver.solve(pull[rows] * given)
            _insert(own_bones, own_weights, bone, np.where(found < LEAST, 0.0, found))
        bones[rows], weights[rows] = own_bones, own_weights
    return SkinWeights(bones, weights / weights.sum(axis=1, keepdims=True))


def _insert(bones: IntArray, weights: FloatArray, bone: int, values: FloatArray) -> None:
    """Sort one more bone into the rows of the heaviest four; the lightest falls out."""
    rows = np.flatnonzero(values > weights[:, -1])
    bones[rows, -1], weights[rows, -1] = bone, values[rows]
    order = np.argsort(-weights[rows], axis=1, kind="stable")
    bones[rows] = np.take_along_axis(bones[rows], order, axis=1)
    weights[rows] = np.take_along_axis(weights[rows], order, axis=1)


def _laplacian(shape: Shape) -> tuple[Any, FloatArray]:
    """Return the cotangent Laplacian, its negative weights set to zero, and the vertex areas."""
    from scipy.sparse import coo_array, diags_array

    n, faces = shape.point_count, np.asarray(shape.faces)
    corners = shape.points[faces]
    rows, columns, values = [], [], []
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    safe = np.maximum(area, 1e-12 * max(float(area.max(initial=0)), 1e-300))
    for k in range(3):
        u, v = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        rows.append(faces[:, (k + 1) % 3])
        columns.append(faces[:, (k + 2) % 3])
        values.append(0.5 * (u * v).sum(axis=1) / safe)
    i, j, w = (np.concatenate(part) for part in (rows, columns, values))
    one_way = coo_array((w, (i, j)), shape=(n, n)).tocsr()
    both = (one_way + one_way.T).tocsr()
    both.data = np.maximum(both.data, 0.0)
    mass = np.bincount(faces.ravel(), np.repeat(area / 6, 3), minlength=n)
    mass = np.where(mass > 0, mass, 1.0)
    stiff = diags_array(np.asarray(both.sum(axis=1)).ravel()) - both
    return stiff, np.asarray(mass, np.float64)
