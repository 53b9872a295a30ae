"""What is compared: ends and graphs of curve skeletons, thickness, and known axes of trees."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import medialis
from stability_suite.trees import Tree

STEP = 0.002
"""Fraction of the diagonal: distance of places along the edges of a graph."""


def along(graph: medialis.CurveSkeleton) -> np.ndarray:
    """Places along the edges of a graph; its nodes where it has none."""
    step = STEP * max(graph.diagonal, 1e-300)
    return np.concatenate([graph.nodes, places_along(graph.nodes, graph.edges, step)])


def places_along(nodes: np.ndarray, edges: np.ndarray, step: float) -> np.ndarray:
    """Places along edges, no farther apart than a step; in the middle of their stretch."""
    a, b = nodes[edges[:, 0]], nodes[edges[:, 1]]
    count = 1 + np.ceil(np.linalg.norm(b - a, axis=1) / step).astype(int)
    row = np.repeat(np.arange(len(a)), count)
    t = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[row]
    return np.asarray(a[row] + t[:, None] * (b - a)[row])


def hausdorff(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest distance of a place of either set from the other one."""
    there, back = cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]
    return float(max(there.max(), back.max()))


def values_at(result: medialis.Result, name: str, places: np.ndarray) -> np.ndarray:
    """Return what an array of a result has at the samples nearest to places."""
    return np.asarray(result.arrays[name])[cKDTree(result.shape.points).query(places)[1]]


def rand_index(one: np.ndarray, other: np.ndarray) -> float:
    """Return the share of pairs that two partitions (n,) agree about."""
    rows, columns = (np.unique(labels, return_inverse=True)[1] for labels in (one, other))
    table = np.zeros((rows.max() + 1, columns.max() + 1))
    np.add.at(table, (rows, columns), 1)
    together, mine, theirs, every = (
        float((counts * (counts - 1) / 2).sum())
        for counts in (table, table.sum(axis=1), table.sum(axis=0), np.array([len(one)]))
    )
    return 1.0 - (mine + theirs - 2 * together) / every


def tree_row(
    nodes: np.ndarray, edges: np.ndarray, tree: Tree, radii: np.ndarray | None = None
) -> dict[str, float]:
    """Compare a graph with the known axis.

    ``tips``: there are; ``absent``: limbs without an end; ``short``: ends more than one radius
    from the tip; ``false``: ends that are none; ``loops_off``; ``axis``: median distance to the
    axis, along the edges, in per cent of its radius there; ``radius``: median error of the radius
    of nodes, where these have one.
    """
    near = cKDTree(tree.places)
    edges = np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0)
    degree = np.bincount(edges.ravel(), minlength=len(nodes))
    links = coo_array((np.ones(len(edges)), edges.T), shape=(len(nodes), len(nodes)))
    pieces = connected_components(links, directed=False)[0]
    ends = nodes[degree == 1]
    limb = tree.limb[near.query(ends)[1]] if len(ends) else np.empty(0, int)
    absent = short = matched = 0
    for number, (tip, radius) in enumerate(zip(tree.tips, tree.tip_radii, strict=True)):
        mine = ends[limb == number]
        if len(mine) == 0:
            absent += 1
            continue
        matched += 1
        short += bool(np.linalg.norm(mine - tip, axis=1).min() > radius)
    off, place = near.query(places_along(nodes, edges, 0.1 * tree.place_radii.min()))
    row = {
        "tips": len(tree.tips),
        "absent": absent,
        "short": short,
        "false": len(ends) - matched,
        "loops_off": abs(len(edges) - len(nodes) + pieces - tree.loops),
        "axis": 100 * float(np.median(off / tree.place_radii[place])),
    }
    if radii is not None:
        thick = tree.place_radii[near.query(nodes)[1]]
        row["radius"] = 100 * float(np.median(np.abs(radii / thick - 1)))
    return row
