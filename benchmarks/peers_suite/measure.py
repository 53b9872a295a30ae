"""The ten shapes, and how right a skeleton or a thickness is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from accuracy_suite.catalogue import shapes
from accuracy_suite.known import KnownShape, Truth
from accuracy_suite.networks import networks
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from medialis.shape.shape import Shape
from medialis.show.reports.measures import distance_to_balls

NAMES = (
    *("torus", "tentacle", "knot", "snake", "hourglass", "bead ring"),
    *("fork", "six arms", "wheel", "ladder"),
)
"""Shapes round known curves, and samples and voxels across their smallest thickness:"""
ACROSS, VOXELS, FINE_VOXELS = 5, 6, 10

STEP = 0.002
"""Fraction of the diagonal between places along edges."""


@dataclass(frozen=True)
class Case:
    """A shape and what is known of it."""

    name: str
    shape: Shape
    known: KnownShape
    truth: Truth


@cache
def cases() -> dict[str, Case]:
    """Return the ten shapes by the stem of their file."""
    every = {**shapes(), **networks()}
    found = {}
    for name in NAMES:
        known = every[name]
        shape = known.make(known.across / ACROSS, None)
        found[name.replace(" ", "_")] = Case(name, shape, known, known.truth())
    return found


def write_cases(folder: Path) -> None:
    """Write the shapes as meshes and as voxels, for the workers."""
    for stem, case in cases().items():
        rows: dict[str, Any] = {"points": case.shape.points, "faces": case.shape.faces}
        rows |= {"normals": case.shape.normals, "across": case.known.across}
        for end, count in (("", VOXELS), ("_fine", FINE_VOXELS)):
            pitch = case.known.across / count
            low, high = case.shape.bounds
            origin = low - 2 * pitch
            axes = [np.arange(a, b, pitch) for a, b in zip(origin, high + 2 * pitch, strict=True)]
            grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            inside = depth(case.truth, grid.reshape(-1, 3)) < 0
            named = {"volume": inside.reshape(grid.shape[:3]), "pitch": pitch, "origin": origin}
            rows |= {name + end: value for name, value in named.items()}
        np.savez(folder / f"{stem}.npz", **rows)


def depth(truth: Truth, places: np.ndarray) -> np.ndarray:
    """Return the signed distance to the true solid, the union of its balls; negative inside."""
    return distance_to_balls(places, truth.points, truth.radii)[0]


def measured(found: Mapping[str, np.ndarray], case: Case) -> dict[str, float]:
    """Measure what a method found.

    Returns
    -------
    dict
        Always ``seconds``. Of a skeleton ``topology`` (1: one piece, and the true number of loops),
        ``ends`` (1: the true number), ``inside`` (per cent of its length in the true solid),
        ``off`` (mean distance from the true curve along it, per cent of the true radius there) and
        ``reached`` (per cent of the true curve that has it within a radius). Of a thickness
        ``error`` and ``error_95``: per cent of the true thickness, the median over the vertices (or
        the places that the method has) and what 95 % do not exceed; one without a value is
        infinitely wrong.
    """
    row = {"seconds": float(found["seconds"])}
    truth = case.truth
    if "thickness" in found:
        places = found.get("places", case.shape.points)
        ball = distance_to_balls(places, truth.points, truth.radii)[1]
        error = np.abs(found["thickness"] / (2 * truth.radii[ball]) - 1)
        error[~np.isfinite(error)] = np.inf
        ranks = np.sort(100 * error)
        count = len(ranks)
        return row | {
            "error": float(ranks[count // 2]),
            "error_95": float(ranks[95 * count // 100]),
        }
    graph = _voxel_graph(found) if "voxels" in found else _graph(found, case)
    if len(graph.places) == 0:
        return row | {"topology": 0.0, "ends": 0.0, "inside": 0.0, "off": np.inf, "reached": 0.0}
    away, near = cKDTree(truth.points).query(graph.places)
    back = cKDTree(graph.places).query(truth.points)[0]
    weight = graph.weights / graph.weights.sum()
    return row | {
        "topology": float(graph.pieces == 1 and graph.loops == case.known.loops),
        "ends": float(graph.ends == case.known.ends),
        "inside": 100 * float(weight @ (depth(truth, graph.places) < 0)),
        "off": 100 * float(weight @ (away / truth.radii[near])),
        "reached": 100 * float((back < truth.radii).mean()),
    }


@dataclass(frozen=True)
class Graph:
    """A skeleton: its topology, and places along it with the length that each stands for."""

    pieces: int
    loops: int
    ends: int
    places: np.ndarray
    weights: np.ndarray


def _graph(found: Mapping[str, np.ndarray], case: Case) -> Graph:
    """Return a skeleton of nodes and edges."""
    nodes = np.asarray(found["nodes"], float).reshape(-1, 3)
    edges = np.sort(np.asarray(found["edges"], int).reshape(-1, 2), axis=1)
    edges = np.unique(edges[edges[:, 0] != edges[:, 1]], axis=0)
    links = coo_array((np.ones(len(edges)), edges.T), shape=(len(nodes), len(nodes)))
    degree = np.bincount(edges.ravel(), minlength=len(nodes))
    alone = int((degree == 0).sum())  # nodes that nothing joins: pieces only where all are
    pieces = connected_components(links, directed=False)[0] - (alone if len(edges) else 0)
    loops = len(edges) - (len(nodes) - (alone if len(edges) else 0)) + pieces
    if len(edges) == 0:
        return Graph(pieces, 0, 0, nodes, np.ones(len(nodes)))
    one, two = nodes[edges.T]
    length = np.linalg.norm(two - one, axis=1)
    count = 1 + np.ceil(length / (STEP * case.shape.diagonal)).astype(int)
    row = np.repeat(np.arange(len(edges)), count)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[row]
    places = one[row] + share[:, None] * (two - one)[row]
    return Graph(pieces, loops, int((degree == 1).sum()), places, (length / count)[row])


def _voxel_graph(found: Mapping[str, np.ndarray]) -> Graph:
    """Return a skeleton of voxels: pieces, and loops by the Euler number, of 26 neighbours.

    A thin line encloses no hollow, so that loops are pieces minus the Euler number.
    """
    line = np.pad(found["voxels"].astype(bool), 1)
    inner = np.argwhere(line)
    number = np.full(line.shape, -1)
    number[tuple(inner.T)] = np.arange(len(inner))
    shifts = np.argwhere(np.ones((3, 3, 3))) - 1
    pairs = []
    for shift in shifts[len(shifts) // 2 + 1 :]:
        other = number[tuple((inner + shift).T)]
        rows = np.flatnonzero(other >= 0)
        pairs.append(np.stack([rows, other[rows]], axis=1))
    edges = np.concatenate(pairs)
    links = coo_array((np.ones(len(edges)), edges.T), shape=(len(inner), len(inner)))
    pieces = connected_components(links, directed=False)[0]
    degree = np.bincount(edges.ravel(), minlength=len(inner))
    places = found["origin"] + found["pitch"] * (inner - 1)
    loops = pieces - euler_number(line)
    return Graph(pieces, loops, int((degree == 1).sum()), places, np.ones(len(inner)))


def euler_number(voxels: np.ndarray) -> int:
    """Return corners - edges + squares - cubes of the union of closed voxels."""
    total = 0
    for open_axes in np.ndindex(2, 2, 2):  # which axes a cell extends along
        held = voxels
        for axis, is_open in enumerate(open_axes):
            if not is_open:  # a corner along this axis belongs to the voxels on both sides
                pad = [(0, 0)] * 3
                pad[axis] = (1, 1)
                wide = np.pad(held, pad)
                ends = [[slice(None)] * 3 for _ in (0, 1)]
                ends[0][axis], ends[1][axis] = slice(None, -1), slice(1, None)
                held = wide[tuple(ends[0])] | wide[tuple(ends[1])]
        total += (-1) ** sum(open_axes) * int(held.sum())
    return total
