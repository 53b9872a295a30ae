"""Results as objects of other libraries, which are imported when they are asked for."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.files.curve_graphs import node_attributes
from medialis.model.curve_skeleton import CurveSkeleton
from medialis.model.medial_cloud import Balls
from medialis.model.shape import Shape
from medialis.model.skeleton_mesh import SkeletonMesh
from medialis.operations.result import Layer, Outcome
from medialis.surface.given_shapes import ShapeLike, as_shape

Drawable: TypeAlias = Outcome | Layer | Balls | CurveSkeleton | ShapeLike
"""What has points: a result (its first layer), a layer, balls (the valid ones), a curve skeleton,
or a shape."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """Points with triangles or edges and named values, whatever they were before."""

    points: NDArray[np.float64]
    faces: NDArray[np.int32] | None = None
    edges: NDArray[np.int32] | None = None
    attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    face_attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)

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
        layer = Layer(name, **vars(self), color_by=next(iter(numbers), None))
        normals = np.zeros(self.points.shape)
        return Outcome(Shape(self.points, normals, self.faces), layers=(layer,))


def to_networkx(curve: CurveSkeleton | Outcome) -> Any:
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
    networkx = _library("networkx")
    found = curve.graph if isinstance(curve, Outcome) else curve
    if not isinstance(found, CurveSkeleton):
        raise InvalidShapeError(
            f"Expected a CurveSkeleton, or a result with a graph; got {type(curve).__name__}."
        )
    graph = networkx.Graph()
    rows = zip(found.nodes.tolist(), found.radii.tolist(), found.importance.tolist(), strict=True)
    for node, (place, radius, importance) in enumerate(rows):
        graph.add_node(node, position=tuple(place), radius=radius, importance=importance)
    lines = zip(
        found.edges.tolist(), found.edge_lengths.tolist(), found.branch.tolist(), strict=True
    )
    graph.add_edges_from((a, b, {"length": length, "branch": k}) for (a, b), length, k in lines)
    return graph


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
    to_pyvista : with edges.
    write_mesh : as a file.

    Examples
    --------
    >>> import medialis
    >>> mesh = medialis.to_trimesh(medialis.run("thickness", medialis.organic_shape(56)))
    >>> mesh.is_watertight, "thickness" in mesh.vertex_attributes
    (True, True)
    """
    trimesh = _library("trimesh")
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
    to_trimesh : without PyVista.

    Examples
    --------
    >>> import medialis
    >>> result = medialis.run("thickness", medialis.organic_shape(56))
    >>> medialis.to_pyvista(result).plot(scalars="thickness")  # doctest: +SKIP
    """
    pyvista = _library("pyvista")
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


def to_pandas(thing: Drawable | Sequence[Any]) -> Any:
    """Return a table: the points of a layer, the branches of a curve skeleton, or a list of rows.

    Parameters
    ----------
    thing : Layer, Result, MedialCloud, CurveSkeleton, or sequence of ThinSpot or Row
        A layer or result: one line a point, with x, y, z and every attribute. A curve skeleton: one
        line a branch. A list of thin spots or of rows of a batch: one line each.

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
    pandas = _library("pandas")
    if isinstance(thing, CurveSkeleton):
        ends = np.array([[row[0], row[-1]] for row in thing.branches]).reshape(-1, 2)
        columns: dict[str, Any] = {"start": ends[:, 0], "end": ends[:, 1]}
        columns |= {"length": thing.branch_lengths, "mean_radius": thing.mean_radii}
        return pandas.DataFrame({**columns, "tortuosity": thing.tortuosity})
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


def _library(name: str) -> Any:
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
            f"pip install {name}."
        ) from None
