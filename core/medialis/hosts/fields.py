"""Fields that lie on the input: their values on the rows that the host gave, and rigs on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidShapeError
from medialis.model.armature import Bones, SkinWeights
from medialis.model.shape import Shape, missing_value
from medialis.operations.result import Layer, Outcome
from medialis.rigging.rolls import roll_axes
from medialis.validation import FloatArray


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
    bones : Bones
    rolls : (b, 3) float64
        Z axis of each bone, at right angles to it: it bends about its x axis.
    layer : Layer or None
        The layer that shows the bones, in whose place hosts add an armature.
    skin_layer : Layer or None
        The layer on the input that shows the weights.
    weights : SkinWeights or None
        On the vertices of the input; those that repair dropped have no bone.
    """

    bones: Bones
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
    if result.rig is None:
        return None
    by_role = {layer.role: layer for layer in result.layers if layer.role}
    weights = None
    if result.skin is not None:
        weights = SkinWeights(
            shape.on_input_points(result.skin.bones, -1),
            shape.on_input_points(result.skin.weights, 0.0),
        )
    return Rig(
        result.rig, roll_axes(result.rig), by_role.get("bones"), by_role.get("skin"), weights
    )
