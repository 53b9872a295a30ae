"""SWC, the tree format of neuron tracing: one line a node, `number type x y z radius parent`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.model.curve_skeleton import CurveSkeleton

LOOP = "# loop"
"""Comment that names the two nodes of a cut edge, so that we can close the loop again."""


@dataclass(frozen=True)
class Tree:
    """A curve skeleton as neuron tracing has it: each node after its parent, loops cut.

    Attributes
    ----------
    nodes : list of int
        Nodes of the graph in the order of the tree; row i has the number i + 1.
    parents : list of int
        Number of the parent of each row; -1: a root.
    cut : list of (int, int)
        Numbers of the nodes of each edge that was left out.
    """

    nodes: list[int]
    parents: list[int]
    cut: list[tuple[int, int]]


def tree_of(graph: CurveSkeleton) -> Tree:
    """Return a curve skeleton as a tree. Roots are ends of branches where there are any."""
    near: list[list[int]] = [[] for _ in range(len(graph.nodes))]
    for a, b in graph.edges.tolist():
        near[a].append(b)
        near[b].append(a)
    number: dict[int, int] = {}
    parent: dict[int, int] = {}
    for root in [*graph.end_points.tolist(), *range(len(graph.nodes))]:
        if root in number:
            continue
        number[root], parent[root] = len(number) + 1, -1
        waiting = [root]
        while waiting:  # depth first: a branch stays together
            node = waiting.pop()
            for other in near[node]:
                if other not in number:
                    number[other], parent[other] = len(number) + 1, number[node]
                    waiting.append(other)
    cut = [
        (number[a], number[b])
        for a, b in graph.edges.tolist()
        if number[b] != parent[a] and number[a] != parent[b]
    ]
    return Tree(list(number), [parent[node] for node in number], cut)


def swc_text(graph: CurveSkeleton) -> tuple[str, int]:
    """Return the text of an SWC file and the number of loops that were cut."""
    tree = tree_of(graph)
    lines = ["# medialis curve skeleton", "# number type x y z radius parent"]
    if tree.cut:
        lines.append(f"# SWC holds trees: {len(tree.cut)} edges that close loops were left out")
        lines += [f"{LOOP} {a} {b}" for a, b in tree.cut]
    for row, (node, parent) in enumerate(zip(tree.nodes, tree.parents, strict=True), 1):
        x, y, z = graph.nodes[node].tolist()
        lines.append(f"{row} 0 {x!r} {y!r} {z!r} {float(graph.radii[node])!r} {parent}")
    return "\n".join(lines) + "\n", len(tree.cut)


def parse_swc(data: bytes) -> CurveSkeleton:
    """Parse an SWC file; nodes come in the order of the lines.

    Raises
    ------
    InvalidShapeError
        When a line does not hold seven numbers, a parent is missing, or numbers come twice.
    """
    numbers: dict[int, int] = {}
    rows: list[tuple[float, ...]] = []
    parents: list[int] = []
    loops: list[tuple[int, int]] = []
    for place, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        text = line.strip()
        if text.startswith(LOOP):
            words = text[len(LOOP) :].split()
            if len(words) == 2 and all(re.fullmatch("[0-9]{1,18}", word) for word in words):
                loops.append((int(words[0]), int(words[1])))
        if not text or text.startswith("#"):
            continue
        words = text.split()
        try:
            values = tuple(float(word) for word in words[2:6])
            name, above = int(float(words[0])), int(float(words[6]))
        except (ValueError, IndexError, OverflowError):
            raise InvalidShapeError(
                f"line {place} must hold seven numbers (number type x y z radius parent), "
                f"got {text[:60]!r}."
            ) from None
        if not all(math.isfinite(value) for value in values):
            raise InvalidShapeError(f"line {place} must hold finite numbers, got {text[:60]!r}.")
        if name in numbers:
            raise InvalidShapeError(f"node {name} comes twice (line {place}).")
        numbers[name] = len(rows)
        rows.append(values)
        parents.append(above)
    if not rows:
        raise InvalidShapeError("there is no node in it.")
    missing = [above for above in parents if above >= 0 and above not in numbers]
    missing += [name for pair in loops for name in pair if name not in numbers]
    if missing:
        raise InvalidShapeError(f"node {missing[0]} is named as a parent, but it is not there.")
    edges = [(numbers[above], node) for node, above in enumerate(parents) if above >= 0]
    edges += [(numbers[a], numbers[b]) for a, b in loops]
    table = np.array(rows)
    return CurveSkeleton.of(table[:, :3], edges, table[:, 3])
