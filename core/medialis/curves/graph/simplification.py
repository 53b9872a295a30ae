"""Simplification of a curve skeleton: fewer nodes, the same topology (thesis 3.6.3)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import places_along
from medialis.base.options import Options, algorithm, length
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray
from medialis.curves.curve_skeleton import CurveSkeleton

INSIDE = 0.9
"""Share of its radius by which a branch may move away from a node."""


@dataclass(frozen=True, kw_only=True)
class SimplifyOptions(Options):
    """Options of `simplify_branches`."""

    simplify: float = length(
        0.005,
        "Simplify",
        "Leave out nodes where the branch changes by less than this share of the size. 0 keeps "
        "all; the topology stays the same.",
    )


@algorithm(SimplifyOptions, keep=False)
def simplify_branches(
    graph: CurveSkeleton, options: SimplifyOptions, progress: Progress
) -> CurveSkeleton:
    """Leave out nodes of degree 2 while the branches stay where they are, up to a tolerance.

    No node that goes is farther than that from the new branch, nor than 0.9 of its radius, so that
    the branch stays inside the shape.

    Parameters
    ----------
    graph : CurveSkeleton
        v nodes.

    Returns
    -------
    CurveSkeleton
        With the same ends, junctions, components and loops. Vertices of the surface keep their
        branch; their node is the nearest one along it.

    See Also
    --------
    curve_skeleton : has the same option.

    Notes
    -----
    Douglas and Peucker's method, branch by branch. Not in the thesis.

    Examples
    --------
    >>> import medialis
    >>> line = medialis.CurveSkeleton.of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1], [1, 2]],
    ...                                  [1, 1, 1])
    >>> medialis.simplify_branches(line, simplify=0.05).nodes.tolist()
    [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    """
    tolerance = options.simplify * graph.diagonal
    stays = graph.degrees != 2
    kept_of: list[NDArray[np.int64]] = []
    taken: set[tuple[int, int]] = set()
    for row in graph.branches:
        closed = row[0] == row[-1]
        ends = (int(min(row[0], row[-1])), int(max(row[0], row[-1])))
        # Fewer nodes would make a loop of one or two edges, or an edge that comes twice.
        least = 2 if closed else 1 if ends in taken else 0
        taken.add(ends)
        bound = np.minimum(tolerance, INSIDE * graph.radii[row])
        kept = _kept(graph.nodes[row], bound, least)
        kept_of.append(kept)
        stays[row[kept]] = True
    number = np.cumsum(stays) - 1
    edges, near = [], np.where(stays, number, -1)
    for row, kept in zip(graph.branches, kept_of, strict=True):
        names = number[row[kept]]
        edges.append(np.stack([names[:-1], names[1:]], axis=1))
        along = places_along(graph.nodes[row])
        middle = (along[kept][1:] + along[kept][:-1]) / 2
        near[row[1:-1]] = names[np.searchsorted(middle, along)][1:-1]
    joined = np.concatenate(edges) if edges else np.empty((0, 2))
    node = graph.vertex_node
    simple = CurveSkeleton.of(
        graph.nodes[stays],
        joined,
        graph.radii[stays],
        importance=graph.importance[stays],
        vertex_node=None if node is None else np.where(node >= 0, near[node], -1),
    )
    # Branches are numbered by their lowest edge, and edges come branch after branch.
    return replace(
        graph, nodes=simple.nodes, edges=simple.edges, radii=simple.radii,
        importance=simple.importance, branch=simple.branch, vertex_node=simple.vertex_node,
    )  # fmt: skip


def _kept(points: FloatArray, bound: FloatArray, least: int) -> NDArray[np.int64]:
    """Places along a polyline that stay: both ends, what is needed, and `least` more at least."""
    last = len(points) - 1
    # A closed branch has no chord to begin with, and a second branch needs a node: split evenly.
    kept = set(np.linspace(0, last, least + 2).round().astype(int).tolist())
    marks = sorted(kept)
    pieces = list(itertools.pairwise(marks))
    while pieces:
        a, b = pieces.pop()
        if b - a < 2:
            continue
        chord = points[b] - points[a]
        inner = points[a + 1 : b] - points[a]
        share = np.clip(inner @ chord / max(float(chord @ chord), 1e-300), 0, 1)
        over = np.linalg.norm(inner - share[:, None] * chord, axis=1) - bound[a + 1 : b]
        if over.max() > 0:
            middle = a + 1 + int(over.argmax())
            kept.add(middle)
            pieces += [(a, middle), (middle, b)]
    return np.array(sorted(kept), np.int64)
