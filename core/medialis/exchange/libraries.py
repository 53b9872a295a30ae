"""Results as objects of other libraries, which are imported when they are asked for, and back.

Everything with points is a `Drawn` first. From there it becomes a mesh or cloud (trimesh, PyVista,
Open3D, meshio) or a table (pandas); curve skeletons become graphs and neurons (networkx, navis),
and are made of them. `write_mesh` writes it in the formats that other programs read.
"""

from __future__ import annotations

import dataclasses
import importlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.curves.curve_skeleton import CurveSkeleton
from medialis.curves.operation import node_attributes, read_curve_skeleton, tree_of
from medialis.formats import files
from medialis.formats.ply_attributes import write_layer_ply
from medialis.formats.shells import write_inp, write_msh
from medialis.formats.text_meshes import write_obj, write_off, write_stl
from medialis.formats.vtk import write_vtp, write_vtu
from medialis.operations.result import Layer, Outcome
from medialis.shape.reading import ShapeLike, as_shape
from medialis.shape.shape import Shape
from medialis.skeleton.medial_cloud import Balls
from medialis.skeleton.skeleton_mesh import SkeletonMesh

Drawable: TypeAlias = Outcome | Layer | Balls | CurveSkeleton | ShapeLike
"""What has points: a result (its first layer), a layer, balls (the valid ones), a curve skeleton,
or a shape."""


PIP = {"skimage": "scikit-image"}
"""Names of packages that are not those of what they hold."""


class Drawn(files.Drawn):
    """Points with triangles or edges and named values, whatever they were before."""

    @classmethod
    def of(cls, thing: Drawable) -> Drawn:
        """Return the points of anything that has some.

        Raises
        ------
        InvalidShapeError
            When it has none; the sentence says what came.
        """
        if isinstance(thing, Outcome):
            if not thing.layers:
                raise InvalidShapeError("The result has no layer.")
            thing = thing.layers[0]
        if isinstance(thing, Layer):
            names = (f.name for f in dataclasses.fields(cls))
            return cls(**{name: getattr(thing, name) for name in names})
        if isinstance(thing, CurveSkeleton):
            return cls(thing.nodes, edges=thing.edges, attributes=node_attributes(thing))
        if isinstance(thing, Balls):
            balls = thing.subset(thing.valid)
            values = {"radius": balls.radii, "spoke_angle": balls.spoke_angles}
            return cls(balls.centers, attributes={**values, "source": balls.source})
        if isinstance(thing, SkeletonMesh):
            radii = thing.cloud.radii[thing.rows]
            return cls(thing.points, thing.faces, attributes={"radius": radii})
        shape = as_shape(thing)
        return cls(shape.points, shape.faces, attributes={"normal": shape.normals})

    def outcome(self, name: str) -> Outcome:
        """Return these as an outcome of one layer, which is coloured by its first values."""
        numbers = [k for k, v in self.attributes.items() if np.ndim(v) == 1]
        layer = Layer(name, **{**vars(self), "color_by": next(iter(numbers), None)})
        normals = np.zeros(self.points.shape)
        return Outcome(Shape(self.points, normals, self.faces), layers=(layer,))


def to_trimesh(thing: Drawable) -> Any:
    """Return a shape, a layer or a result (its first layer) as a mesh or a cloud of trimesh.

    Parameters
    ----------
    thing : Shape, SkeletonMesh, Layer, MedialCloud, Result, or what stands for a shape

    Returns
    -------
    trimesh.Trimesh or trimesh.PointCloud
        The vertices as they are, none merged. Attributes are in `vertex_attributes` and
        `face_attributes` of a mesh, and in `metadata` of a cloud.

    Raises
    ------
    InvalidShapeError
        When it has no points.
    InvalidOptionError
        When trimesh is not installed.

    See Also
    --------
    to_pyvista, to_open3d, to_meshio : with edges.
    write_mesh : as a file.

    Examples
    --------
    >>> import medialis
    >>> mesh = medialis.to_trimesh(medialis.run("thickness", medialis.organic_shape(56)))
    >>> mesh.is_watertight, "thickness" in mesh.vertex_attributes
    (True, True)
    """
    trimesh = library("trimesh")
    drawn = Drawn.of(thing)
    attributes = {name: np.array(values) for name, values in drawn.attributes.items()}
    points = np.array(drawn.points)
    if drawn.faces is None:
        return trimesh.PointCloud(points, metadata=attributes)
    return trimesh.Trimesh(
        points,
        np.array(drawn.faces),
        process=False,
        vertex_attributes=attributes,
        face_attributes={name: np.array(v) for name, v in drawn.face_attributes.items()},
    )


def to_pyvista(thing: Drawable) -> Any:
    """Return a shape, a layer, a curve skeleton or a result (its first layer) for PyVista.

    Parameters
    ----------
    thing : Shape, SkeletonMesh, Layer, MedialCloud, CurveSkeleton, Result, or what stands for one

    Returns
    -------
    pyvista.PolyData
        Points, triangles or lines, with the attributes in `point_data` and `cell_data`.

    Raises
    ------
    InvalidShapeError
        When it has no points.
    InvalidOptionError
        When PyVista is not installed.

    See Also
    --------
    to_trimesh, to_open3d, to_meshio : of other libraries.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> medialis.to_pyvista(result).plot(scalars="thickness")  # doctest: +SKIP
    """
    pyvista = library("pyvista")
    drawn = Drawn.of(thing)
    cells: dict[str, NDArray[np.int64]] = {}
    for name, rows in (("faces", drawn.faces), ("lines", drawn.edges)):
        if rows is not None and len(rows):
            count = np.full((len(rows), 1), rows.shape[1], np.int64)
            cells[name] = np.concatenate([count, rows], axis=1).ravel()
    mesh = pyvista.PolyData(np.array(drawn.points), **cells)
    for name, values in drawn.attributes.items():
        mesh.point_data[name] = np.array(values)
    if set(cells) == {"faces"}:
        for name, values in drawn.face_attributes.items():
            mesh.cell_data[name] = np.array(values)
    return mesh


def to_open3d(thing: Drawable) -> Any:
    """Return a shape, a layer, a curve skeleton or a result (its first layer) for Open3D.

    Parameters
    ----------
    thing : Shape, SkeletonMesh, Layer, MedialCloud, CurveSkeleton, Result, or what stands for one

    Returns
    -------
    open3d.t.geometry.TriangleMesh, LineSet or PointCloud
        Tensor geometry, as the older one holds no attributes; `to_legacy()` makes that of it.
        Attributes are in `vertex` and `triangle`, or in `point`, with one column at least.

    Raises
    ------
    InvalidShapeError
        When it has no points.
    InvalidOptionError
        When Open3D is not installed.

    See Also
    --------
    to_trimesh, to_pyvista, to_meshio : of other libraries.

    Examples
    --------
    >>> import medialis
    >>> mesh = medialis.to_open3d(medialis.run("thickness", "bunny.ply"))  # doctest: +SKIP
    >>> mesh.vertex["thickness"].min()  # doctest: +SKIP
    """
    open3d, drawn = library("open3d"), Drawn.of(thing)

    def tensor(values: NDArray[Any]) -> Any:
        return open3d.core.Tensor(np.array(values).reshape(len(values), -1))

    points = tensor(drawn.points)
    if drawn.faces is not None:
        mesh = open3d.t.geometry.TriangleMesh(points, tensor(drawn.faces))
        rows = mesh.vertex
        for name, values in drawn.face_attributes.items():
            mesh.triangle[name] = tensor(values)
    elif drawn.edges is not None:
        mesh = open3d.t.geometry.LineSet(points, tensor(drawn.edges))
        rows = mesh.point
    else:
        mesh = open3d.t.geometry.PointCloud(points)
        rows = mesh.point
    for name, values in drawn.attributes.items():
        rows["normals" if name == "normal" else name] = tensor(values)
    return mesh


def to_meshio(thing: Drawable) -> Any:
    """Return a shape, a layer, a curve skeleton or a result (its first layer) for meshio.

    Parameters
    ----------
    thing : Shape, SkeletonMesh, Layer, MedialCloud, CurveSkeleton, Result, or what stands for one

    Returns
    -------
    meshio.Mesh
        Cells are triangles, lines, or vertices where there are neither; with the attributes in
        `point_data`, and in `cell_data` where all cells are triangles.

    Raises
    ------
    InvalidShapeError
        When it has no points.
    InvalidOptionError
        When meshio is not installed.

    See Also
    --------
    to_trimesh, to_pyvista, to_open3d : of other libraries.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> medialis.to_meshio(result).write("thickness.xdmf")  # doctest: +SKIP
    """
    meshio, drawn = library("meshio"), Drawn.of(thing)
    both = {"triangle": drawn.faces, "line": drawn.edges}
    cells: list[Any] = [(kind, np.array(rows)) for kind, rows in both.items() if rows is not None]
    only_triangles = [kind for kind, _ in cells] == ["triangle"]
    return meshio.Mesh(
        np.array(drawn.points),
        cells or [("vertex", np.arange(len(drawn.points))[:, None])],
        point_data={name: np.array(v) for name, v in drawn.attributes.items()},
        cell_data={name: [np.array(v)] for name, v in drawn.face_attributes.items()}
        if only_triangles
        else None,
    )


def library(name: str) -> Any:
    """Import another library.

    Raises
    ------
    InvalidOptionError
        When it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidOptionError(
            f"{name} is needed for this and cannot be loaded ({error}); install it with: "
            f"pip install {PIP.get(name, name)}."
        ) from None


def to_pandas(thing: Drawable | Sequence[Any]) -> Any:
    """Return a table: the points of a layer, the branches of a curve skeleton, or a list of rows.

    Parameters
    ----------
    thing : Layer, Result, MedialCloud, CurveSkeleton, or sequence of ThinSpot or Row
        A layer or result: one line a point, with x, y, z and every attribute. A curve skeleton: one
        line a branch (`CurveSkeleton.branch_table`). A list of thin spots or of rows of a batch:
        one line each.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    InvalidShapeError
        When there is no table of it.
    InvalidOptionError
        When pandas is not installed.

    See Also
    --------
    thin_spots : makes a list.
    batch : makes rows.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> medialis.to_pandas(result).thickness.min()  # doctest: +SKIP
    """
    pandas = library("pandas")
    if isinstance(thing, CurveSkeleton):
        return pandas.DataFrame({name: np.array(v) for name, v in thing.branch_table.items()})
    if isinstance(thing, list | tuple) and all(dataclasses.is_dataclass(row) for row in thing):
        return pandas.DataFrame([_line(row) for row in thing])
    drawn = Drawn.of(thing)  # type: ignore[arg-type]
    return pandas.DataFrame(_columns({"": drawn.points, **drawn.attributes}))


def _line(row: Any) -> dict[str, Any]:
    """Return the columns of one line of a list: numbers, words and places."""
    line: dict[str, Any] = {}
    for one in dataclasses.fields(row):
        value = getattr(row, one.name)
        if isinstance(value, Mapping):
            line |= {k: v for k, v in value.items() if isinstance(v, int | float | str)}
        elif np.shape(value) == (3,) and np.asarray(value).dtype.kind == "f":
            line |= {f"{one.name}_{axis}": v for axis, v in zip("xyz", value, strict=True)}
        else:
            line[one.name] = value
    return line


def _columns(attributes: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return one column a number: vectors as name_x, name_y, name_z, others by number."""
    found: dict[str, NDArray[Any]] = {}
    for name, values in attributes.items():
        if np.ndim(values) == 1:
            found[name] = np.array(values)
            continue
        flat = np.reshape(values, (len(values), -1))
        ends = "xyz" if flat.shape[1] == 3 else range(flat.shape[1])
        for end, column in zip(ends, flat.T, strict=True):
            found[f"{name}_{end}".lstrip("_")] = column.copy()
    return found


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
    columns |= {"parent_id": tree.parents, "x": x, "y": y, "z": z}
    columns["radius"] = found.radii[tree.nodes]
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
    found = curve.extras.get("graph") if isinstance(curve, Outcome) else curve
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


WITH_VALUES = {
    **{".ply": write_layer_ply, ".vtp": write_vtp, ".vtu": write_vtu, ".msh": write_msh},
    ".inp": write_inp,
}
"""Formats that hold attributes."""

WRITERS = {**WITH_VALUES, ".obj": write_obj, ".off": write_off, ".stl": write_stl}


def write_mesh(
    path: str | os.PathLike[str],
    thing: Drawable,
    *,
    attributes: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write points, triangles and edges in the format that the extension names.

    Parameters
    ----------
    path : path
        ``.ply`` keeps everything without loss, and so do ``.vtp`` and ``.vtu`` for ParaView and
        VTK. ``.msh`` (Gmsh), ``.inp`` (Abaqus) and ``.ccx.inp`` (CalculiX) hold triangles as shell
        elements: `thickness` of points becomes sections, `sheet` of faces groups. ``.obj``
        and ``.off`` keep points and triangles, and OBJ edges, with 17 digits. ``.stl`` keeps
        triangles in single precision.
    thing : Shape, SkeletonMesh, Layer, MedialCloud, CurveSkeleton, Result, or what stands for one
        A result gives its first layer.
    attributes : dict of (n,) or (n, d) arrays, optional
        More values of the points; not for OBJ, OFF and STL.

    Raises
    ------
    InvalidOptionError
        When the format is unknown, cannot hold attributes, or holds triangles only and there are
        none.
    InvalidShapeError
        When there are no points, or no triangles for STL.
    FileError
        When the file cannot be written.

    See Also
    --------
    read_shape : reads it again.
    write_result : all files of a result.
    write_curve_skeleton : graph formats.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_mesh(f"{folder}/organic.obj", shape)
    ...     medialis.read_shape(f"{folder}/organic.obj").face_count == shape.face_count
    True
    """
    ending = Path(path).suffix.lower()
    if ending not in WRITERS:
        raise InvalidOptionError(
            f"Meshes are written as {', '.join(WRITERS)}; got {os.fspath(path)!r}."
        )
    if attributes and ending not in WITH_VALUES:
        names = ", ".join(WITH_VALUES)
        raise InvalidOptionError(f"Only {names} hold attributes; got {os.fspath(path)!r}.")
    drawn = Drawn.of(thing)
    values = {name: np.asarray(column) for name, column in (attributes or {}).items()}
    given = {**drawn.attributes, **values}
    WRITERS[ending](path, dataclasses.replace(drawn, attributes=given, color_by=None))
