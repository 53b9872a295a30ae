"""Results as meshes of other libraries, which are imported when they are asked for."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Mapping
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


PIP = {"skimage": "scikit-image"}
"""Names of packages that are not those of what they hold."""


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
    cells: list[tuple[str, NDArray[Any]]] = []
    for kind, rows in (("triangle", drawn.faces), ("line", drawn.edges)):
        if rows is not None:
            cells.append((kind, np.array(rows)))
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
