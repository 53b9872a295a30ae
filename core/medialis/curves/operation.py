"""Operation: the curve skeleton of a mesh as a graph (thesis 3.6), and its files.

Curve skeletons go out as SWC, JSON, GraphML, OBJ and PLY lines; SWC and JSON come in. SWC is the
tree format of neuron tracing: one line a node, `number type x y z radius parent`. Numbers are
written with as many digits as they need to come back the same.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Mask
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import Options
from medialis.base.progress import Progress, counted
from medialis.base.validation import as_points
from medialis.curves.curve_skeleton import CurveEvidence, CurveSkeleton
from medialis.curves.from_balls import CurveSkeletonOptions, curve_skeleton
from medialis.formats.files import complete_file, file_bytes, reading
from medialis.formats.ply_attributes import write_ply
from medialis.operations.declaration import Format, Operation
from medialis.operations.positions import numbers, places
from medialis.operations.result import FilterUnit, Layer, Outcome, Result, unit_of
from medialis.shape.shape import Shape
from medialis.skeleton.layers import cloud_arrays, samples_layer, surface_layers
from medialis.skeleton.medial_cloud import MedialCloud

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
    """Return a curve skeleton as a tree. Roots are ends of branches where there are any.

    Loops are cut beside a fork, so that each makes one end and not two.
    """
    near, number, parent = graph.neighbours, dict[int, int](), dict[int, int]()
    for root in [*graph.end_points.tolist(), *range(len(graph.nodes))]:
        waiting = [(root, -1)]
        while waiting:  # depth first: a branch stays together
            node, before = waiting.pop()
            if node in number:
                continue
            number[node], parent[node] = len(number) + 1, before
            waiting += [(other, number[node]) for other in near[node] if other not in number]
    cut = [
        (number[a], number[b])
        for a, b in graph.edges.tolist()
        if number[b] != parent[a] and number[a] != parent[b]
    ]
    return Tree(list(number), [parent[node] for node in number], cut)


def _swc_text(graph: CurveSkeleton, unit: str | None) -> str:
    tree = tree_of(graph)
    lines = ["# medialis curve skeleton", "# number type x y z radius parent"]
    lines += [f"# {_lengths(unit)}"] if unit else []
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


FORMATS = ("swc", "graphml", "json", "obj", "csv", "branches.graphml", "branches.json", "ply")
NAME = "medialis curve skeleton"


def write_curve_skeleton(
    path: str | os.PathLike[str], graph: CurveSkeleton, *, unit: str | None = None
) -> int:
    """Write a curve skeleton in the format that the file name ends in.

    Parameters
    ----------
    path : path
        ``.json`` holds everything. ``.swc`` holds a tree: an edge of each loop is cut, and named in
        a comment. ``.graphml`` holds nodes and edges with all measures. ``.obj`` holds branches
        as polylines, the radius as texture coordinate. ``.ply`` holds edges and attributes.
        ``.csv`` is the table of the branches, with angles in degrees; ``.branches.graphml`` and
        ``.branches.json`` hold a node for each fork and end, and an edge for each branch, with what
        the table has, and angles in radians.
    graph : CurveSkeleton
    unit : str, optional
        Of lengths, such as "mm", which files then say.

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
    name = Path(path).name.lower()
    ending = next((one for one in reversed(FORMATS) if name.endswith(f".{one}")), "")
    if not ending:
        raise InvalidOptionError(
            f"A curve skeleton is written as {', '.join('.' + name for name in FORMATS)}; "
            f"got {os.fspath(path)!r}."
        )
    if ending == "ply":
        write_ply(path, graph.nodes, edges=graph.edges, attributes=node_attributes(graph))
        return 0
    with complete_file(path) as stream:
        stream.write(TEXTS[ending](graph, unit).encode())
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
    """Return what hosts show of each node: radius, importance, branch, degree, persistence.

    The branch of a junction is the thickest one, that of a single node is -1.
    """
    branch = np.full(len(graph.nodes), -1, np.int32)
    for number in np.argsort(graph.mean_radii, kind="stable").tolist():
        branch[graph.branches[number]] = number
    known = {"radius": graph.radii, "importance": graph.importance}
    sure = {} if graph.persistence is None else {"persistence": graph.persistence}
    return {**known, "branch": branch, "degree": graph.degrees, **sure}


def _lengths(unit: str | None) -> str:
    return f"lengths in {unit}" if unit else "lengths in the unit of the shape"


def json_content(graph: CurveSkeleton, unit: str | None) -> dict[str, Any]:
    """Return what a JSON file of a curve skeleton holds."""
    content: dict[str, Any] = {"format": NAME, "version": 1, "unit": unit}
    for name in ("nodes", "radii", "importance", "edges", "branch", "vertex_node", "vertex_branch"):
        values = getattr(graph, name)
        content[name] = None if values is None else values.tolist()
        if name in ("radii", "importance"):
            content[name] = [v if math.isfinite(v) else None for v in content[name]]
    if graph.persistence is not None:
        sure = graph.persistence.tolist()
        content["persistence"] = [v if math.isfinite(v) else None for v in sure]
    return content


def _json_text(graph: CurveSkeleton, unit: str | None) -> str:
    return json.dumps(json_content(graph, unit), allow_nan=False) + "\n"


def _parse_json(data: bytes) -> CurveSkeleton:
    try:
        content = json.loads(data)
    except ValueError as error:
        raise InvalidShapeError(f"it is no JSON ({error}).") from None
    if not isinstance(content, dict) or content.get("format") != NAME:
        raise InvalidShapeError(f"it is no {NAME}.")
    floats: list[Any] = [
        np.array([np.nan if v is None else v for v in content[name]], np.float64)
        for name in ("radii", "importance")
    ]
    nodes = as_points(content["nodes"], "nodes")
    edges = np.array(content["edges"], np.int32).reshape(-1, 2)
    given = content["branch"], content.get("vertex_node"), content.get("vertex_branch")
    whole: list[Any] = [None if row is None else np.array(row, np.int32) for row in given]
    sure = content.get("persistence")
    if sure is not None:
        sure = np.array([np.inf if v is None else v for v in sure], np.float64)
    return CurveSkeleton(nodes, edges, *floats, *whole, persistence=sure)


def _obj_text(graph: CurveSkeleton, unit: str | None) -> str:
    lines = ["# medialis curve skeleton; vt is the radius of each node"]
    lines += [f"# {_lengths(unit)}"] if unit else []
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in graph.nodes.tolist()]
    lines += [f"vt {r!r}" for r in graph.radii.tolist()]
    for row in graph.branches:
        lines.append("l " + " ".join(f"{node}/{node}" for node in (row + 1).tolist()))
    return "\n".join(lines) + "\n"


def _graphml_text(graph: CurveSkeleton, unit: str | None) -> str:
    nodes: dict[str, NDArray[Any]] = {
        **dict(zip("xyz", graph.nodes.T, strict=True)),
        "radius": graph.radii,
        "importance": graph.importance,
        "degree": graph.degrees,
    }
    if graph.persistence is not None:
        nodes["persistence"] = graph.persistence
    edges: dict[str, NDArray[Any]] = {"branch": graph.branch, "length": graph.edge_lengths}
    return _graphml("curve_skeleton", nodes, graph.edges, edges, unit)


def _graphml(
    name: str,
    nodes: Mapping[str, NDArray[Any]],
    pairs: NDArray[Any],
    edges: Mapping[str, NDArray[Any]],
    unit: str | None,
) -> str:
    """Return a graph with columns of its nodes and edges; what is not finite is left out."""

    def data(columns: Mapping[str, NDArray[Any]]) -> Iterator[str]:
        for values in zip(*(column.tolist() for column in columns.values()), strict=True):
            told = zip(columns, values, strict=True)
            yield "".join(f'<data key="{k}">{v!r}</data>' for k, v in told if math.isfinite(v))

    keys = [
        f'<key id="{column}" for="{kind}" attr.name="{column}" '
        f'attr.type="{"double" if values.dtype.kind == "f" else "int"}"/>'
        for kind, columns in (("node", nodes), ("edge", edges))
        for column, values in columns.items()
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<graphml xmlns="http://graphml.graphdrawing.org/xmlns">',
        *([f"<desc>{_lengths(unit)}, angles in radians</desc>"] if unit else []),
        *keys,
        f'<graph id="{name}" edgedefault="undirected">',
        *(f'<node id="n{row}">{text}</node>' for row, text in enumerate(data(nodes))),
        *(
            f'<edge source="n{a}" target="n{b}">{text}</edge>'
            for (a, b), text in zip(pairs.tolist(), data(edges), strict=True)
        ),
    ]
    return "\n".join([*lines, "</graph>", "</graphml>"]) + "\n"


def _csv_text(graph: CurveSkeleton, unit: str | None) -> str:
    """Return a line a branch; heads have units, and angles are in degrees."""
    heads, columns = ["branch"], [list(range(graph.branch_count))]
    for name, values in graph.branch_table.items():
        own = unit_of(name, unit)
        heads.append(f"{name} ({own})" if own else name)
        columns.append((np.degrees(values) if own == "degrees" else values).tolist())
    rows = zip(*columns, strict=True)
    lines = [",".join(repr(v) if math.isfinite(v) else "" for v in row) for row in rows]
    return "\n".join([",".join(heads), *lines]) + "\n"


def _reduced(graph: CurveSkeleton) -> tuple[dict[str, NDArray[Any]], NDArray[Any]]:
    """Return forks and ends as columns, and the two rows of them that each branch joins.

    A closed branch without a fork has its first node.
    """
    table = graph.branch_table
    ends = np.stack([table["start"], table["end"]], axis=1)
    alone = np.flatnonzero(graph.degrees == 0)
    chosen = np.unique(np.concatenate([ends.ravel(), alone]))
    nodes: dict[str, NDArray[Any]] = {
        "node": chosen,
        **dict(zip("xyz", graph.nodes[chosen].T, strict=True)),
        "radius": graph.radii[chosen],
        "degree": graph.degrees[chosen],
    }
    return nodes, np.searchsorted(chosen, ends)


def _of_branches(graph: CurveSkeleton) -> dict[str, NDArray[Any]]:
    measured = {k: v for k, v in graph.branch_table.items() if k not in ("start", "end")}
    return {"branch": np.arange(graph.branch_count), **measured}


def _branches_graphml_text(graph: CurveSkeleton, unit: str | None) -> str:
    nodes, pairs = _reduced(graph)
    return _graphml("branches", nodes, pairs, _of_branches(graph), unit)


def _branches_json_text(graph: CurveSkeleton, unit: str | None) -> str:
    nodes, pairs = _reduced(graph)
    edges = {"start": pairs[:, 0], "end": pairs[:, 1], **_of_branches(graph)}
    content: dict[str, Any] = {"format": "medialis branches", "version": 1, "unit": unit}
    for name, columns in (("nodes", nodes), ("edges", edges)):
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        content[name] = [
            {key: v if math.isfinite(v) else None for key, v in zip(columns, row, strict=True)}
            for row in rows
        ]
    return json.dumps(content, allow_nan=False) + "\n"


TEXTS: dict[str, Callable[[CurveSkeleton, str | None], str]] = {
    "swc": _swc_text,
    "json": _json_text,
    "graphml": _graphml_text,
    "obj": _obj_text,
    "csv": _csv_text,
    "branches.graphml": _branches_graphml_text,
    "branches.json": _branches_json_text,
}


def graph_formats(graph_of: Callable[[Result], CurveSkeleton]) -> tuple[Format, ...]:
    """Return the formats of an operation whose result has a graph.

    JSON is written by default: it comes back without loss.
    """

    def write(path: Path, result: Result) -> None:
        write_curve_skeleton(path, graph_of(result), unit=result.shape.unit)

    read = {"json": read_curve_skeleton}
    names = (name for name in FORMATS if name != "ply")  # its layer is one
    return tuple(
        Format(name, write, "graph", read.get(name), by_default=name in read) for name in names
    )


GRAPH_FORMATS = graph_formats(lambda result: result.extras["graph"])


FEW_SAMPLES = 100  # halved 0 %, doubled 0 %
"""Below which a shape is said to have few."""

SHEET_RADII = 4.0  # halved 100 %, doubled 100 %
"""A place of the surface belongs to a sheet where its ball reaches farther than four radii from the
curve skeleton: the cross-section is there more than four times as wide (2 4 r) as thick (2 r)."""

LEFT_OUT = 0.05
"""Share of its area that is not explained from which a warning says so."""

SHEET_SHARE = 0.2  # halved 0 %, doubled 0 %
"""Share of its area on sheets from which a shape is called sheet-like. Shoulder blade: 29 %; thin
plates: 57 %; rocker arm, a mechanical part with flat arms: 14 %; gears, screwdriver: below 6 %."""


def described(shape: Shape, options: Options, progress: Progress) -> tuple[CurveSkeleton, float]:
    """Return the curve skeleton of a mesh and its `sheet_share`; say what is uncertain.

    Raises
    ------
    InvalidShapeError
        For a point cloud, and for a shape without balls.
    """
    graph = curve_skeleton.of(shape, options, progress)
    cloud = graph.cloud
    assert cloud is not None
    sheet = sheet_share(cloud, graph)
    if graph.evidence is not None:
        _note_shape(graph, cloud.surface, graph.evidence, progress)
    _note_result(graph, sheet, progress)
    return graph, sheet


def run(shape: Shape, options: CurveSkeletonOptions, progress: Progress) -> Outcome:
    """Smooth where noisy, refine, shrink balls, trace geodesics, find the curve skeleton."""
    graph, sheet = described(shape, options, progress)
    cloud, evidence = graph.cloud, graph.evidence
    assert cloud is not None and evidence is not None
    known = _by_importance(cloud.surface)
    known |= {"attributes": node_attributes(graph), "color_by": "radius", "labels": ("branch",)}
    return Outcome(
        shape=cloud.surface,
        layers=(
            Layer("curve_skeleton", graph.nodes, edges=graph.edges, **known),
            _parts_layer(shape, cloud, graph),
            *([_candidates_layer(cloud, evidence)] if len(evidence.candidates) else []),
            samples_layer(cloud.surface),
        ),
        values=_values(cloud.surface, graph, evidence, sheet),
        arrays={
            **cloud_arrays(cloud),
            **_candidate_arrays(evidence),
            "nodes": places(graph.nodes),
            "edges": graph.edges,
            "node_radius": graph.radii,
            "node_importance": graph.importance,
            "edge_branch": graph.branch,
            "vertex_node": np.asarray(graph.vertex_node),
            "vertex_branch": np.asarray(graph.vertex_branch),
        },
        extras={"graph": graph},
    )


def _candidate_arrays(evidence: CurveEvidence) -> dict[str, Any]:
    """Return the arrays of the candidates; none for level sets."""
    if evidence.measured is None:
        return {}
    return {
        "tangent": numbers(evidence.measured.tangents),
        "candidate_measure": evidence.measured.measure,
        "candidates": evidence.candidates,
        "area_importance": evidence.importance,
    }


def _parts_layer(shape: Shape, cloud: MedialCloud, graph: CurveSkeleton) -> Layer:
    """Layer of the surface with the branch and the node of each of its points."""
    own = {
        "branch": np.asarray(graph.vertex_branch),
        "node": np.asarray(graph.vertex_node),
        "left_out": left_out(cloud, graph).astype(np.int32),
    }
    shown: dict[str, Any] = {"color_by": "branch", "labels": ("branch",)}
    # A refined shape has the given points first.
    return surface_layers("curve_skeleton_parts", shape, shape, own, **shown)[0]


def _by_importance(surface: Shape) -> dict[str, Any]:
    """How the slider of a layer filters areas of importance."""
    unit = FilterUnit.length(surface.diagonal, "threshold", power=2.0)
    return {"filter_by": "importance", "filter_unit": unit}


def _candidates_layer(cloud: MedialCloud, evidence: CurveEvidence) -> Layer:
    assert evidence.measured is not None
    rows, known = evidence.candidates, _by_importance(cloud.surface)
    measured = {"measure": evidence.measured.measure[rows], "importance": evidence.importance}
    source, stay = cloud.source[rows], evidence.kept.astype(np.int32)
    known |= {"attributes": {**measured, "kept": stay, "source": source}, "color_by": "measure"}
    return Layer("curve_skeleton_candidates", cloud.centers[rows], auxiliary=True, **known)


def _values(
    surface: Shape, graph: CurveSkeleton, evidence: CurveEvidence, sheet: float
) -> dict[str, Any]:
    samples = np.bincount(np.asarray(graph.vertex_branch) + 1, minlength=graph.branch_count + 1)[1:]
    return {
        "nodes": len(graph.nodes),
        "edges": len(graph.edges),
        "branches": graph.branch_count,
        "junctions": len(graph.junctions),
        "end_points": len(graph.end_points),
        "components": graph.component_count,
        "loops": graph.loops,
        "expected_loops": sum(evidence.genus.values()),
        "expected_loops_certain": evidence.unclear == 0,
        "length": graph.length,
        "candidates": len(evidence.candidates),
        "kept_candidates": int(evidence.kept.sum()),
        "explained": 1.0 - sheet,
        "sheet_share": sheet,
        "samples": surface.point_count,
        "diagonal": surface.diagonal,
        "branch_table": branch_rows(graph, samples),
    }


def branch_rows(graph: CurveSkeleton, samples: NDArray[np.integer] | None = None) -> list[Any]:
    """Return the table of the branches as rows for people and programs; angles are in radians."""
    table, degrees = graph.branch_table, graph.degrees
    words = {1: "end", 2: "loop"}
    rows = []
    for branch, (a, b) in enumerate(zip(table["start"], table["end"], strict=True)):
        kinds = sorted(words.get(int(degrees[node]), "fork") for node in (a, b))
        row: dict[str, Any] = {"kind": "loop" if "loop" in kinds else " to ".join(kinds)}
        row |= {k: float(v[branch]) for k, v in table.items() if k not in ("start", "end")}
        row["nodes"] = [int(a), int(b)]
        if samples is not None:
            row["samples"] = int(samples[branch])
        rows.append(row)
    return rows


def left_out(cloud: MedialCloud, graph: CurveSkeleton) -> Mask:
    """Return the samples (n,) that the graph does not explain.

    Their balls reach farther than `SHEET_RADII` radii off their node; the larger radius counts.
    """
    node = np.asarray(graph.vertex_node)
    rows = np.flatnonzero(cloud.valid & (node >= 0))
    radii, near = cloud.radii[rows], node[rows]
    away = np.linalg.norm(cloud.centers[rows] - graph.nodes[near], axis=1)
    far = np.zeros(len(node), bool)
    far[rows] = away + radii > SHEET_RADII * np.maximum(radii, graph.radii[near])
    return far


def sheet_share(cloud: MedialCloud, graph: CurveSkeleton) -> float:
    """Return the share of the area that the graph does not explain."""
    node = np.asarray(graph.vertex_node)
    area = np.where(cloud.valid & (node >= 0), cloud.surface.point_areas, 0.0)
    return float(area[left_out(cloud, graph)].sum() / max(area.sum(), 1e-300))


def _note_shape(
    graph: CurveSkeleton, surface: Shape, evidence: CurveEvidence, progress: Progress
) -> None:
    """Say what about the surface makes the result less certain."""
    if surface.point_count < FEW_SAMPLES:
        text = (
            f"The shape has only {counted(surface.point_count, 'sample')}; a curve skeleton needs "
            f"at least about {FEW_SAMPLES}. Refine the mesh."
        )
        progress.warn(text, "few_samples", samples=surface.point_count)
    parts = surface.part_count
    if parts > 1:
        graphs = graph.component_count
        text = f"The shape has {parts} separate parts; each has a graph of its own."
        if graphs < parts:
            text = (
                f"The shape has {parts} separate parts in {counted(graphs, 'graph')}: parts that "
                "touch are joined."
            )
        progress.note(text, "separate_parts", parts=parts, graphs=graphs)
    if evidence.seams:
        progress.note(
            f"The surface touches itself at {counted(evidence.seams, 'place')}; the "
            "handles that are counted are those of the solid inside.",
            "handles_of_solid",
            seams=evidence.seams,
        )
    if evidence.unclear:
        text = (
            f"At {counted(evidence.unclear, 'edge')} it is not known what is inside: a wall ends "
            "there, or the surface has only one side. The number of handles is the best guess."
        )
        progress.warn(text, "handles_uncertain", edges=evidence.unclear)
    if surface.border_edges > 0:
        progress.note(
            f"The shape is open: {counted(surface.border_edges, 'edge', verbs=('lies', 'lie'))} at "
            "holes. Loops are counted as if a disc closed each hole, and the skeleton near large "
            "holes is uncertain.",
            "open_shape",
            border_edges=surface.border_edges,
        )
    for number, genus in sorted(evidence.genus.items()):
        closed = evidence.closed_loops.get(number, 0)
        if closed < genus:
            progress.warn(
                f"Part {number} has {counted(genus, 'handle')}, but its graph has "
                f"{counted(closed, 'loop')}: "
                + (
                    "handles are thinner than the tolerance, more than 2,048, or faces cross."
                    if evidence.measured is not None
                    else "handles are shorter than a third of the radius there, or faces cross."
                ),
                "loops_missing",
                part=number,
                handles=genus,
                loops=closed,
            )


def _note_result(graph: CurveSkeleton, sheet: float, progress: Progress) -> None:
    """Say where a curve skeleton says little about the shape."""
    alone = int((graph.degrees == 0).sum())
    if alone:
        text = (
            f"{counted(alone, 'part', of=graph.component_count, verbs=('is', 'are'))} a single "
            "node. Round shapes have no direction, small parts lie below the threshold, and thin "
            "ones need smaller candidates."
        )
        progress.note(text, "single_nodes", parts=alone, of=graph.component_count)
    if sheet > LEFT_OUT:
        text = (
            f"{100 * sheet:.0f} % of the surface reaches more than {SHEET_RADII:g} radii off the "
            "curve skeleton, which does not explain it: `left_out` marks it in "
            "curve_skeleton_parts."
        )
        if sheet > SHEET_SHARE:
            text += " Use surface_skeleton for thin sheets, smaller candidates for limbs."
        code = "thin_sheets" if sheet > SHEET_SHARE else "left_out"
        progress.warn(text, code, share=sheet)


OPERATION = Operation(
    name="curve_skeleton",
    filter_name="generate_curve_skeleton",
    label="Curve skeleton",
    group="Skeleton",
    help="Compute the curve skeleton of a mesh: a graph along the middle of its parts.\n\n"
    "The graph runs in the middle of the limbs. It has one component for each part of the shape "
    "and one loop for each handle; it lies inside the shape. Each node has its radius, each point "
    "of the surface its branch. Needs a mesh; thin sheets have no meaningful curve skeleton.",
    source="thesis 3.6",
    examples=(
        ("creature.ply --formats swc,graphml", "a graph for neuron and network tools"),
        ("creature.ply -o coarse --threshold 10%", "main branches only"),
    ),
    layers={
        "curve_skeleton": "the graph as lines with radius, branch, importance and persistence",
        "curve_skeleton_parts": "the surface with the branch and the node of each vertex; "
        "`left_out` is 1 where the graph does not explain it",
        "curve_skeleton_candidates": "the balls that the graph was chosen from",
        "samples": "the surface as computed on; feature points and sources index its points",
    },
    options=CurveSkeletonOptions,
    run=run,
    needs_faces=True,
    formats=GRAPH_FORMATS,
    thin_lines=True,
    order=70,
    words=("centerline", "centreline", "limbs"),
)
