"""SWC, the tree format of neuron tracing: one line a node, `number type x y z radius parent`.

Curve skeletons out as SWC, JSON, GraphML, OBJ and PLY lines; SWC and JSON in.

Numbers are written with as many digits as they need to come back the same.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.validation import as_points
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.formats.files import complete_file, file_bytes, reading
from medialis.formats.ply_attributes import write_ply
from medialis.operations.declaration import Format
from medialis.operations.result import Result

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
    near = graph.neighbours
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


def _swc_text(graph: CurveSkeleton) -> str:
    tree = tree_of(graph)
    lines = ["# medialis curve skeleton", "# number type x y z radius parent"]
    if tree.cut:
        lines.append(f"# SWC holds trees: {len(tree.cut)} edges that close loops were left out")
        lines += [f"{LOOP} {a} {b}" for a, b in tree.cut]
    for row, (node, parent) in enumerate(zip(tree.nodes, tree.parents, strict=True), 1):
        x, y, z = graph.nodes[node].tolist()
        lines.append(f"{row} 0 {x!r} {y!r} {z!r} {float(graph.radii[node])!r} {parent}")
    return "\n".join(lines) + "\n"


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


FORMATS = ("swc", "graphml", "json", "obj", "ply")
NAME = "medialis curve skeleton"


def write_curve_skeleton(path: str | os.PathLike[str], graph: CurveSkeleton) -> int:
    """Write a curve skeleton in the format that the file name ends in.

    Parameters
    ----------
    path : path
        ``.json`` holds everything. ``.swc`` holds a tree: an edge of each loop is cut, and named in
        a comment. ``.graphml`` holds nodes and edges with all measures. ``.obj`` holds branches
        as polylines, the radius as texture coordinate. ``.ply`` holds edges and attributes.
    graph : CurveSkeleton

    Returns
    -------
    int
        Loops that were cut.

    Raises
    ------
    InvalidOptionError
        For another ending.
    FileError
        When the file cannot be written.

    See Also
    --------
    read_curve_skeleton : reads SWC and JSON back.
    write_result : writes them with all else.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> curve = medialis.curve_skeleton(medialis.surface_skeleton(medialis.organic_shape(56)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_curve_skeleton(f"{folder}/curve.swc", curve)
    0
    """
    ending = Path(path).suffix[1:].lower()
    if ending not in FORMATS:
        raise InvalidOptionError(
            f"A curve skeleton is written as {', '.join('.' + name for name in FORMATS)}; "
            f"got {os.fspath(path)!r}."
        )
    if ending == "ply":
        write_ply(path, graph.nodes, edges=graph.edges, attributes=node_attributes(graph))
        return 0
    texts = {"swc": _swc_text, "json": _json_text, "graphml": _graphml_text, "obj": _obj_text}
    with complete_file(path) as stream:
        stream.write(texts[ending](graph).encode("ascii"))
    return graph.loops if ending == "swc" else 0


def read_curve_skeleton(path: str | os.PathLike[str]) -> CurveSkeleton:
    """Read a curve skeleton from JSON (as written) or SWC (of any program).

    SWC files that this project wrote get their loops back. Other programs' files are forests.

    Raises
    ------
    FileError
        When the file is missing or cannot be read.
    InvalidShapeError
        When its content is no such graph.
    InvalidOptionError
        For another ending.

    See Also
    --------
    write_curve_skeleton : writes such files.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> curve = medialis.curve_skeleton(medialis.surface_skeleton(medialis.organic_shape(56)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = medialis.write_curve_skeleton(f"{folder}/curve.json", curve)
    ...     again = medialis.read_curve_skeleton(f"{folder}/curve.json")
    >>> bool((again.nodes == curve.nodes).all())
    True
    """
    name = os.fspath(path)
    ending = Path(name).suffix[1:].lower()
    if ending not in ("json", "swc"):
        raise InvalidOptionError(f"A curve skeleton is read from .json or .swc; got {name!r}.")
    data = file_bytes(name)
    with reading(name):
        return _parse_json(data) if ending == "json" else parse_swc(data)


def node_attributes(graph: CurveSkeleton) -> dict[str, NDArray[Any]]:
    """Return what hosts show of each node: radius, importance, branch, degree.

    The branch of a junction is the thickest one, that of a single node is -1.
    """
    branch = np.full(len(graph.nodes), -1, np.int32)
    for number in np.argsort(graph.mean_radii, kind="stable").tolist():
        branch[graph.branches[number]] = number
    return {
        "radius": graph.radii,
        "importance": graph.importance,
        "branch": branch,
        "degree": graph.degrees,
    }


def _json_text(graph: CurveSkeleton) -> str:
    content: dict[str, Any] = {"format": NAME, "version": 1}
    for name in ("nodes", "radii", "importance", "edges", "branch", "vertex_node", "vertex_branch"):
        values = getattr(graph, name)
        content[name] = None if values is None else values.tolist()
    for name in ("radii", "importance"):
        content[name] = [v if math.isfinite(v) else None for v in getattr(graph, name).tolist()]
    return json.dumps(content, allow_nan=False) + "\n"


def _parse_json(data: bytes) -> CurveSkeleton:
    try:
        content = json.loads(data)
    except ValueError as error:
        raise InvalidShapeError(f"it is no JSON ({error}).") from None
    if not isinstance(content, dict) or content.get("format") != NAME:
        raise InvalidShapeError(f"it is no {NAME}.")
    radii, importance = (
        np.array([np.nan if v is None else v for v in content[name]], np.float64)
        for name in ("radii", "importance")
    )
    nodes = as_points(content["nodes"], "nodes")
    edges = np.array(content["edges"], np.int32).reshape(-1, 2)
    branch = np.array(content["branch"], np.int32)
    given = (content.get(name) for name in ("vertex_node", "vertex_branch"))
    maps = [None if row is None else np.array(row, np.int32) for row in given]
    return CurveSkeleton(nodes, edges, radii, importance, branch, *maps)


def _obj_text(graph: CurveSkeleton) -> str:
    lines = ["# medialis curve skeleton; vt is the radius of each node"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in graph.nodes.tolist()]
    lines += [f"vt {r!r}" for r in graph.radii.tolist()]
    for row in graph.branches:
        lines.append("l " + " ".join(f"{node}/{node}" for node in (row + 1).tolist()))
    return "\n".join(lines) + "\n"


def _graphml_text(graph: CurveSkeleton) -> str:
    keys = [("node", name, "double") for name in ("x", "y", "z", "radius", "importance")]
    keys += [("node", "degree", "int"), ("edge", "branch", "int"), ("edge", "length", "double")]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">',
    ]
    lines += [
        f'<key id="{name}" for="{kind}" attr.name="{name}" attr.type="{of}"/>'
        for kind, name, of in keys
    ]
    lines.append('<graph id="curve_skeleton" edgedefault="undirected">')
    columns = (*graph.nodes.T.tolist(), graph.radii.tolist(), graph.importance.tolist())
    degrees = graph.degrees.tolist()
    for node, values in enumerate(zip(*columns, strict=True)):
        data = "".join(
            f'<data key="{name}">{value!r}</data>'
            for (_, name, _), value in zip(keys, values, strict=False)
            if math.isfinite(value)
        )
        data += f'<data key="degree">{degrees[node]}</data>'
        lines.append(f'<node id="n{node}">{data}</node>')
    rows = zip(
        graph.edges.tolist(), graph.branch.tolist(), graph.edge_lengths.tolist(), strict=True
    )
    for (a, b), branch, length in rows:
        lines.append(
            f'<edge source="n{a}" target="n{b}"><data key="branch">{branch}</data>'
            f'<data key="length">{length!r}</data></edge>'
        )
    return "\n".join([*lines, "</graph>", "</graphml>"]) + "\n"


def graph_formats(graph_of: Callable[[Result], CurveSkeleton]) -> tuple[Format, ...]:
    """Return the formats of an operation whose result has a graph; JSON comes back without loss."""

    def write(path: Path, result: Result) -> None:
        write_curve_skeleton(path, graph_of(result))

    read = {"json": read_curve_skeleton}
    names = (name for name in FORMATS if name != "ply")  # its layer is one
    return tuple(Format(name, write, "graph", read.get(name)) for name in names)


GRAPH_FORMATS = graph_formats(lambda result: result.extras["graph"])
