"""Curve skeletons as graphs and neurons of other libraries, and back."""

from __future__ import annotations

import os
from typing import Any, TypeAlias

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.files.curve_graphs import read_curve_skeleton
from medialis.files.swc import tree_of
from medialis.hosts.other_libraries import library
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.operations.result import Outcome

Curve: TypeAlias = CurveSkeleton | Outcome
"""A curve skeleton, or the result of an operation that makes one."""


def to_networkx(curve: Curve) -> Any:
    """Return a curve skeleton as a graph of networkx.

    Parameters
    ----------
    curve : CurveSkeleton, or the result of an operation that makes one

    Returns
    -------
    networkx.Graph
        Nodes 0..v-1 with `position` (a tuple), `radius` and `importance`; edges with `length` and
        `branch`.

    Raises
    ------
    InvalidShapeError
        When a result has no graph.
    InvalidOptionError
        When networkx is not installed.

    See Also
    --------
    curve_skeleton : makes one.
    as_curve_skeleton : and back.
    to_navis : for neurons.
    write_curve_skeleton : as a file.

    Examples
    --------
    >>> import medialis
    >>> fork = medialis.CurveSkeleton.of([[0, 0, 0], [1, 0, 0], [2, 1, 0]], [[0, 1], [1, 2]],
    ...                                  [0.5, 0.4, 0.3])
    >>> graph = medialis.to_networkx(fork)
    >>> graph.nodes[1]["radius"], graph.edges[0, 1]["length"]
    (0.4, 1.0)
    """
    networkx = library("networkx")
    found = _graph(curve)
    graph = networkx.Graph()
    rows = zip(found.nodes.tolist(), found.radii.tolist(), found.importance.tolist(), strict=True)
    for node, (place, radius, importance) in enumerate(rows):
        graph.add_node(node, position=tuple(place), radius=radius, importance=importance)
    lines = zip(
        found.edges.tolist(), found.edge_lengths.tolist(), found.branch.tolist(), strict=True
    )
    graph.add_edges_from((a, b, {"length": length, "branch": k}) for (a, b), length, k in lines)
    return graph


def to_navis(curve: Curve, *, units: str | None = None) -> Any:
    """Return a curve skeleton as a neuron of navis.

    Parameters
    ----------
    curve : CurveSkeleton, or the result of an operation that makes one
    units : str, optional
        What one unit is, such as "8 nanometer"; navis reckons with it. Of a result that knows its
        unit, that.

    Returns
    -------
    navis.TreeNeuron
        A tree (an edge of each loop is cut), or several, with the radius of each node. Row i is the
        node that the SWC file has in its row i.

    Raises
    ------
    InvalidShapeError
        When a result has no graph.
    InvalidOptionError
        When navis is not installed.

    See Also
    --------
    as_curve_skeleton : and back.
    write_curve_skeleton : as a SWC file.

    Examples
    --------
    >>> import medialis
    >>> neuron = medialis.to_navis(medialis.run("curve_skeleton", "a.ply"))  # doctest: +SKIP
    >>> neuron.cable_length  # doctest: +SKIP
    """
    navis, pandas = library("navis"), library("pandas")
    found = _graph(curve)
    if units is None and isinstance(curve, Outcome) and curve.shape.unit:
        units = f"1 {curve.shape.unit}"
    tree = tree_of(found)
    x, y, z = found.nodes[tree.nodes].T
    columns = {"node_id": np.arange(1, len(tree.nodes) + 1), "label": 0}
    columns |= {
        "parent_id": tree.parents,
        "x": x,
        "y": y,
        "z": z,
        "radius": found.radii[tree.nodes],
    }
    return navis.TreeNeuron(pandas.DataFrame(columns), units=units)


def as_curve_skeleton(given: Any) -> CurveSkeleton:
    """Return what was given as a curve skeleton: a graph, a neuron, or a file.

    Parameters
    ----------
    given : CurveSkeleton, result, path, networkx.Graph, navis.TreeNeuron
        Nodes of a graph need a `position`, or `x`, `y` and `z`; their `radius` is 0 where it is
        missing. Whatever has a table `nodes` with node_id, parent_id, x, y, z and radius is a
        neuron; and what has one as `swc`, as skeletons of skeletor do.

    Raises
    ------
    InvalidShapeError
        When it is none of these, or a node has no position.
    FileError
        When a file cannot be read.

    See Also
    --------
    to_networkx, to_navis : the other way.
    bones : one thing to do with it.

    Examples
    --------
    >>> import medialis
    >>> fork = medialis.CurveSkeleton.of([[0, 0, 0], [1, 0, 0], [2, 1, 0]], [[0, 1], [1, 2]],
    ...                                  [0.5, 0.4, 0.3])
    >>> again = medialis.as_curve_skeleton(medialis.to_networkx(fork))
    >>> again.radii.tolist()
    [0.5, 0.4, 0.3]
    """
    if isinstance(given, CurveSkeleton | Outcome):
        return _graph(given)
    if isinstance(given, str | os.PathLike):
        return read_curve_skeleton(given)
    if hasattr(given, "nodes") and callable(getattr(given, "edges", None)):
        return _of_graph(given)
    for name in ("nodes", "swc"):
        table = getattr(given, name, None)
        if table is not None and {"node_id", "parent_id"} <= set(getattr(table, "columns", ())):
            return _of_table(table)
    raise InvalidShapeError(
        "Expected a CurveSkeleton, a path, a graph of networkx or a neuron of navis; got "
        f"{type(given).__name__}."
    )


def _graph(curve: Any) -> CurveSkeleton:
    """Return the curve skeleton that is given, or that a result has."""
    found = curve.graph if isinstance(curve, Outcome) else curve
    if not isinstance(found, CurveSkeleton):
        raise InvalidShapeError(
            f"Expected a CurveSkeleton, or a result with a graph; got {type(curve).__name__}."
        )
    return found


def _of_graph(given: Any) -> CurveSkeleton:
    """Return the curve skeleton of a graph as networkx has them."""
    number = {name: row for row, name in enumerate(given.nodes)}
    places, radii = [], []
    for name, data in given.nodes(data=True):
        place = data.get("position", [data.get(axis) for axis in "xyz"])
        if np.shape(place) != (3,) or any(x is None for x in place):
            raise InvalidShapeError(f"Node {name!r} has no position, and no x, y and z.")
        places.append([float(x) for x in place])
        radii.append(float(data.get("radius", 0.0)))
    measured = [float(data.get("importance", np.nan)) for _, data in given.nodes(data=True)]
    pairs = [sorted((number[a], number[b])) for a, b in given.edges() if a != b]
    edges = np.unique(np.array(pairs, np.int32).reshape(-1, 2), axis=0)
    return CurveSkeleton.of(places, edges, radii, importance=measured)


def _of_table(table: Any) -> CurveSkeleton:
    """Return the curve skeleton of a table of nodes with their parents."""
    number = {int(name): row for row, name in enumerate(table["node_id"])}
    parents = [int(name) for name in table["parent_id"]]
    missing = [name for name in parents if name >= 0 and name not in number]
    if missing:
        raise InvalidShapeError(f"Node {missing[0]} is named as a parent, but it is not there.")
    edges = [(number[name], row) for row, name in enumerate(parents) if name >= 0]
    places = np.column_stack([np.asarray(table[axis], np.float64) for axis in "xyz"])
    radii = table["radius"] if "radius" in table.columns else np.zeros(len(places))
    return CurveSkeleton.of(places, edges, np.nan_to_num(np.asarray(radii, np.float64)))
