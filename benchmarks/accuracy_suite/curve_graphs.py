"""Curve skeletons and segments against truth."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

import medialis
from accuracy_suite.known import KnownShape

DENSE = 0.001
"""Fraction of the diagonal: distance of places along the edges of a graph."""


def curve_row(shape: medialis.Shape, known: KnownShape) -> dict[str, float]:
    """Compare the curve skeleton of the operation at its defaults with the truth.

    ``loops``, ``true_loops``, ``expected_loops`` (what the operation says), ``ends``,
    ``true_ends``. ``off_mean``, ``off_max``: distance of the graph from the true curve, in per cent
    of the local radius (that of the node's ball): 0 is centred. ``missing``: the largest distance
    of the true curve from the graph, per cent of the diagonal: how much of an end is not reached.
    None where it is not known.
    """
    result = medialis.run("curve_skeleton", shape)
    graph = result.extras["graph"]
    row: dict[str, float] = {
        "samples": graph.cloud.surface.point_count,
        "loops": graph.loops,
        "true_loops": known.loops,
        "expected_loops": result.values.get("expected_loops"),
        "ends": len(graph.end_points),
        "true_ends": known.ends,
        "off_mean": None,
        "off_max": None,
        "missing": None,
    }
    if known.curve is not None and len(graph.edges):
        places, radii = dense_places(graph)
        off = 100 * cKDTree(known.curve).query(places)[0] / radii
        back = cKDTree(places).query(known.curve)[0]
        row["off_mean"], row["off_max"] = float(off.mean()), float(off.max())
        row["missing"] = 100 * float(back.max()) / shape.diagonal
    return row


def dense_places(graph: medialis.CurveSkeleton) -> tuple[np.ndarray, np.ndarray]:
    """Places along the edges of a graph, and the radius there."""
    a, b = graph.edges.T
    count = 1 + np.ceil(graph.edge_lengths / (DENSE * graph.diagonal)).astype(int)
    row = np.repeat(np.arange(len(a)), count)
    t = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[row]
    one, two = graph.nodes[a[row]], graph.nodes[b[row]]
    radii = (1 - t) * graph.radii[a[row]] + t * graph.radii[b[row]]
    return one + t[:, None] * (two - one), np.maximum(radii, 1e-300)


def rand_index(one: np.ndarray, other: np.ndarray, weight: np.ndarray) -> float:
    """Return the adjusted Rand index of two labellings by area: 1 the same, 0 by chance."""
    weight = weight / weight.sum()
    pairs = np.unique(np.stack([one, other], axis=1), axis=0, return_inverse=True)[1].ravel()
    both = (np.bincount(pairs, weight) ** 2).sum()
    left, right = (
        (np.bincount(np.unique(x, return_inverse=True)[1].ravel(), weight) ** 2).sum()
        for x in (one, other)
    )
    chance = left * right
    return float((both - chance) / ((left + right) / 2 - chance)) if chance < 1 else 1.0


def patch_row(shape: medialis.Shape) -> dict[str, float]:
    """Compare the patches of a polyhedron with its faces: pieces of one plane that hang together.

    ``segments``, ``true_segments``, and ``rand``: adjusted Rand index by area over the samples
    inside faces.
    """
    result = medialis.run("patches", shape, refine=0)
    fine = result.shape
    labels = result.arrays["patches"]
    side = fine.edge_twins
    edge = np.flatnonzero(side >= 0)
    normals = fine.face_normals
    level = (normals[edge // 3] * normals[side[edge] // 3]).sum(axis=1) > 1 - 1e-9
    from medialis.shape.surface import piece_labels

    links = np.stack([edge[level] // 3, side[edge[level]] // 3], axis=1)
    face = piece_labels(fine.face_count, links)
    low, high = np.full(fine.point_count, len(face)), np.full(fine.point_count, -1)
    np.minimum.at(low, fine.faces.ravel(), np.repeat(face, 3))
    np.maximum.at(high, fine.faces.ravel(), np.repeat(face, 3))
    inside = low == high
    return {
        "samples": fine.point_count,
        "segments": int(labels.max()) + 1,
        "true_segments": int(face.max()) + 1,
        "rand": rand_index(labels[inside], low[inside], fine.point_areas[inside]),
    }


def part_row(shape: medialis.Shape, truth: np.ndarray) -> dict[str, float]:
    """Compare the parts of a shape with those of its vertices (n,); as `patch_row`, all samples."""
    result = medialis.run("parts", shape, method="limbs", refine=0)
    labels = result.arrays["parts"]
    return {
        "samples": shape.point_count,
        "segments": int(labels.max()) + 1,
        "true_segments": int(truth.max()) + 1,
        "rand": rand_index(labels, truth, shape.point_areas),
    }
