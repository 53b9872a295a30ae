"""From candidates to a graph: the links it may take, and what is done with its branches (3.6.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from medialis.curves.from_balls.ball_links import BallLinks, link_balls
from medialis.curves.from_balls.candidates import CandidateMeasure, nearest_neighbours
from medialis.curves.graph.finishing import (
    merge_junctions,
    prune_spurs,
    sample_branches,
    smooth_nodes,
)
from medialis.curves.graph.growth import Growth
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import MedialCloud
from medialis.model.shape import Shape
from medialis.validation import FloatArray


def link_skeleton(
    shape: Shape,
    cloud: MedialCloud,
    measured: CandidateMeasure,
    found: NDArray[np.int64],
    near: NDArray[np.int32],
    level: float,
) -> BallLinks:
    """Link balls that are close to each other, and those of neighbouring samples."""
    rows = np.flatnonzero(cloud.valid)
    around, _ = nearest_neighbours(cloud.centers[rows], shape.diagonal)
    pairs = np.concatenate([_pairs(rows, around), _pairs(found, near)])
    pairs = pairs[shape.components[pairs[:, 0]] == shape.components[pairs[:, 1]]]
    needed = np.concatenate([shape.edges, cloud.features[rows]])
    needed = needed[cloud.valid[needed].all(axis=1)]
    needed = needed[shape.components[needed[:, 0]] == shape.components[needed[:, 1]]]
    closeness = np.nan_to_num(measured.spread)
    closeness *= np.minimum(1.0, np.nan_to_num(measured.measure) / level)
    centers = np.nan_to_num(cloud.centers)
    radii = np.nan_to_num(cloud.radii)
    return link_balls(centers, radii, closeness, pairs, needed, spacing=shape.spacing)


def _pairs(rows: NDArray[np.int64], near: NDArray[np.int32]) -> NDArray[np.int64]:
    return np.stack([np.repeat(rows, near.shape[1]), rows[near.ravel()]], axis=1)


def finish_graph(
    links: BallLinks,
    edges: NDArray[np.int64],
    strength: FloatArray,
    *,
    spacing: float,
    smoothing: float,
) -> tuple[CurveSkeleton, NDArray[np.int64]]:
    """Prune spurs, merge close junctions, sample and smooth the branches of a grown graph.

    Parameters
    ----------
    links : BallLinks
        k balls.
    edges : (e, 2) int
        Of `grow_graph`.
    strength : (k,) float64
        Of the balls that become one junction the strongest gives its place.
    spacing : float
        Typical distance of neighbouring balls.
    smoothing : float
        As in `medialis.curve_skeleton`.

    Returns
    -------
    CurveSkeleton
        Its radii are those of balls round the nodes that lie in the given balls.
    (k,) int64
        Node nearest to each ball along the links; -1 where none leads to the graph.
    """
    balls, inverse = np.unique(edges, return_inverse=True)
    ends = inverse.reshape(-1, 2)
    ends = ends[ends[:, 0] != ends[:, 1]]
    raw = CurveSkeleton.of(links.centers[balls], ends, links.radii[balls])
    stays = prune_spurs(raw)
    balls, number = balls[stays], np.cumsum(stays) - 1
    ends = number[ends[stays[ends].all(axis=1)]]
    raw = CurveSkeleton.of(links.centers[balls], ends, links.radii[balls])
    merged, into = merge_junctions(raw, strength[balls])
    sampled = sample_branches(merged, spacing)
    nodes = smooth_nodes(sampled.nodes, sampled.edges, sampled.room, smoothing)
    # The ways of all balls to the graph, by their length alone.
    nearest = Growth(replace(links, cost=links.length), spacing)
    nearest.add(balls.tolist())
    node_of_ball = np.full(len(links) + 1, -1, np.int64)  # one more row: no ball
    node_of_ball[balls] = sampled.node_of[into]
    moved = np.linalg.norm(nodes - sampled.nodes, axis=1)
    radii = np.maximum(sampled.room - moved, 0.0)
    return CurveSkeleton.of(nodes, sampled.edges, radii), node_of_ball[nearest.base]


def put_in_shape(
    shape: Shape, graph: CurveSkeleton, node_of_sample: NDArray[np.int64]
) -> CurveSkeleton:
    """Give nodes their distance to the nearest sample, and each sample its node and branch."""
    from scipy.spatial import cKDTree

    radii = cKDTree(shape.points).query(graph.nodes)[0]
    _fill(node_of_sample, shape)
    return CurveSkeleton.of(graph.nodes, graph.edges, radii, vertex_node=node_of_sample)


def _fill(values: NDArray[np.int64], shape: Shape) -> None:
    """Give samples without a value that of the nearest sample of their component that has one."""
    from scipy.spatial import cKDTree

    for number in np.unique(shape.components[values < 0]).tolist():
        rows = np.flatnonzero(shape.components == number)
        known, missing = rows[values[rows] >= 0], rows[values[rows] < 0]
        if len(known):
            nearest = cKDTree(shape.points[known]).query(shape.points[missing])[1]
            values[missing] = values[known[nearest]]


def node_importance(
    shape: Shape, graph: CurveSkeleton, found: NDArray[np.int64], centers: FloatArray,
    importance: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the importance of the nearest candidate of the same part of the shape for each node.

    On a single node hangs the whole area of its part, and so it does in a part without candidates.

    Parameters
    ----------
    shape : Shape
    graph : CurveSkeleton
        v nodes, with its map from the samples of the shape.
    found : (c,) int
        Samples of the candidates.
    centers : (c, 3) float64
    importance : (c,) float64
    """
    from scipy.spatial import cKDTree

    whole = np.bincount(shape.components, shape.point_areas)
    part = np.full(graph.component_count, -1)
    node = np.asarray(graph.vertex_node)
    part[graph.components[node[node >= 0]]] = shape.components[node >= 0]
    of_node, of_candidate = part[graph.components], shape.components[found]
    result = np.where(of_node >= 0, whole[of_node], np.nan)
    for number in np.intersect1d(of_node, of_candidate).tolist():
        nodes, rows = np.flatnonzero(of_node == number), np.flatnonzero(of_candidate == number)
        nearest = cKDTree(centers[rows]).query(graph.nodes[nodes])[1]
        result[nodes] = importance[rows[nearest]]
    alone = (graph.degrees == 0) & (of_node >= 0)
    result[alone] = whole[of_node[alone]]
    return result
