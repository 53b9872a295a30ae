"""Layers that go back to what the host gave: values on its rows, rigs on it, and edited layers.

`on_input` and `rig_of` undo repair and refinement. `write_edited` writes a layer as its user has
edited it, for the option of an operation that takes it back (`takes_back`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.options import Kind, Parameter
from medialis.base.validation import FloatArray
from medialis.operations.declaration import Operation
from medialis.operations.result import Layer, Levels, Outcome
from medialis.rigging.armature import Armature
from medialis.rigging.bones import Bones, SkinWeights
from medialis.rigging.naming import roll_axes
from medialis.shape.shape import Shape, missing_value


@dataclass(frozen=True, eq=False)
class InputFields:
    """Attributes of a layer on the vertices and faces before repair.

    Attributes
    ----------
    attributes : dict of (n_in, ...) arrays
    face_attributes : dict of (m_in, ...) arrays
        Vertices and faces that repair dropped have NaN or -1.
    """

    attributes: Mapping[str, NDArray[Any]]
    face_attributes: Mapping[str, NDArray[Any]]


def on_input(
    layer: Layer,
    shape: Shape,
    *,
    polygons: ArrayLike | None = None,
    polygon_count: int | None = None,
) -> InputFields:
    """Bring the attributes of an `on_input` layer to the rows of the input before repair.

    Parameters
    ----------
    layer : Layer
        Its rows are the points and faces of `shape`.
    shape : Shape
        As read or made, not refined.
    polygons : (m_in,) int, optional
        Polygon of each triangle of the input, rising, where the host has polygons: one has the
        value of its first triangle.
    polygon_count : int, optional
        Number of polygons; those without a triangle have no value.

    Returns
    -------
    InputFields
        In the dtype of the layer; truth values and unsigned numbers as int64, which has -1.

    Raises
    ------
    InvalidShapeError
        When the layer has other rows than the shape.

    Examples
    --------
    >>> import medialis, numpy as np
    >>> twins = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> faces = [[1, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]]
    >>> shape = medialis.make_shape(twins, faces, repair=True)
    >>> layer = medialis.Layer("x", shape.points, attributes={"x": shape.points[:, 0]})
    >>> on_input(layer, shape).attributes["x"].tolist()
    [0.0, 0.0, 1.0, 0.0, 0.0]
    """
    faces = 0 if layer.faces is None else len(layer.faces)
    if len(layer.points) != shape.point_count or (
        layer.face_attributes and faces != shape.face_count
    ):
        raise InvalidShapeError(
            f"Layer {layer.name} has {len(layer.points)} points and {faces} faces, the shape "
            f"{shape.point_count} and {shape.face_count}: it does not lie on it."
        )
    given = shape.face_count if shape.diagnosis is None else shape.diagnosis.faces
    on_faces = {
        name: shape.on_input_faces(_signed(values), given)
        for name, values in layer.face_attributes.items()
    }
    if polygons is not None:
        of = np.asarray(polygons)
        count = int(of.max(initial=-1)) + 1 if polygon_count is None else polygon_count
        on_faces = {name: _on_polygons(values, of, count) for name, values in on_faces.items()}
    return InputFields(
        {name: shape.on_input_points(_signed(values)) for name, values in layer.attributes.items()},
        on_faces,
    )


def _signed(values: ArrayLike) -> NDArray[Any]:
    """Return values in a type that can hold NaN or -1 for none."""
    array = np.asarray(values)
    return array.astype(np.int64) if array.dtype.kind in "ub" else array


def _on_polygons(values: NDArray[Any], polygons: NDArray[Any], count: int) -> NDArray[Any]:
    result = np.full((count, *values.shape[1:]), missing_value(values), values.dtype)
    first = np.flatnonzero(np.diff(polygons, prepend=-1))
    result[polygons[first]] = values[first]
    return result


@dataclass(frozen=True, eq=False)
class Rig:
    """Bones of a result and what they move, for hosts that have armatures.

    Attributes
    ----------
    bones : Bones or Armature
        An `Armature` is the user's, and in the host already.
    rolls : (b, 3) float64
        Z axis of each bone, at right angles to it: it bends about its x axis. Empty for an armature
        of the user.
    layer : Layer or None
        The layer that shows the bones, in whose place hosts add an armature.
    skin_layer : Layer or None
        The layer on the input that shows the weights.
    weights : SkinWeights or None
        On the vertices of the input; those that repair dropped have no bone.
    """

    bones: Bones | Armature
    rolls: FloatArray
    layer: Layer | None
    skin_layer: Layer | None
    weights: SkinWeights | None


def rig_of(result: Outcome, shape: Shape) -> Rig | None:
    """Return the rig of a result with weights on the rows of the input; None: it has none.

    Parameters
    ----------
    result : Result
    shape : Shape
        What it was run on, as read.
    """
    bones, skin = result.extras.get("bones"), result.extras.get("skin")
    if bones is None:
        return None
    by_role = {layer.role: layer for layer in result.layers if layer.role}
    weights = None
    if skin is not None:
        weights = SkinWeights(
            shape.on_input_points(skin.bones, -1),
            shape.on_input_points(skin.weights, 0.0),
        )
    rolls = roll_axes(bones) if isinstance(bones, Bones) else np.empty((0, 3))
    return Rig(bones, rolls, by_role.get("bones"), by_role.get("skin"), weights)


def unpacked_levels(data: bytes) -> Levels:
    """Return the levels of a layer from what their `packed` gave."""
    from medialis.medial_meshes.operation import MeshLevels

    return MeshLevels.unpacked(data)


def takes_back(operation: Operation, layer: str) -> Parameter | None:
    """Return the option of an operation that takes a layer of its result as it was edited.

    Examples
    --------
    >>> from medialis import operation
    >>> takes_back(operation("medial_mesh"), "medial_mesh").name
    'edited'
    """
    files = (p for p in operation.parameters if p.kind is Kind.FILE and p.layer)
    return next((p for p in files if p.layer == layer), None)


def write_edited(
    path: str | os.PathLike[str],
    points: ArrayLike,
    faces: ArrayLike | None,
    edges: ArrayLike | None,
    attributes: Mapping[str, Any],
    *,
    unit: str | None = None,
) -> None:
    """Write points, triangles and edges as they are in a host, in the format of the file's ending.

    Parameters
    ----------
    path : path
        Ends in one of `Layer.formats`.
    points : (p, 3) float
    faces : (m, 3) int or None
    edges : (e, 2) int or None
    attributes : dict
        Of points: `radius` where they are balls.
    unit : str, optional
        What one unit of the points is.

    Raises
    ------
    InvalidOptionError
        For another ending, and where the format needs what is not there, such as a radius.
    InvalidShapeError
        When a number is not finite.
    FileError
        When the file cannot be written.
    """
    from medialis.show.writing import write_layer

    given = None if faces is None else np.asarray(faces, np.int32).reshape(-1, 3)
    lines = None if edges is None else np.asarray(edges, np.int32).reshape(-1, 2)
    places = np.asarray(points, np.float64).reshape(-1, 3)
    layer = Layer("edited", places, given, lines, attributes)
    write_layer(Path(path), layer, unit)
