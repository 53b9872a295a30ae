# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays of the core as Blender attributes: float32, int32, vectors; checked before anything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis import InvalidShapeError
from medialis.hosts import to_linear

VECTORS = {2: ("FLOAT2", "vector"), 3: ("FLOAT_VECTOR", "vector"), 4: ("FLOAT_COLOR", "color")}


@dataclass(frozen=True, eq=False)
class Column:
    """One attribute, ready to be written: its name, Blender's type, key of the values, values."""

    name: str
    type: str
    key: str
    values: NDArray[Any]

    @property
    def width(self) -> int:
        """Numbers of a row."""
        return next((n for n, (kind, _) in VECTORS.items() if kind == self.type), 1)


def columns(attributes: Mapping[str, ArrayLike]) -> list[Column]:
    """Convert attributes; numbers become float32, whole numbers int32, rows of 2 to 4 vectors.

    Other rows become one attribute a column, `name_1`, `name_2` and so on.

    Raises
    ------
    InvalidShapeError
        When a whole number does not fit into 32 bits.
    """
    found = []
    for name, given in attributes.items():
        values = np.asarray(given)
        flat = values.ndim == 1
        if flat or (values.dtype.kind == "f" and values.shape[1] in VECTORS):
            found.append(_column(name, values))
        else:
            parts = values.reshape(len(values), -1).T
            found += [_column(f"{name}_{i}", part) for i, part in enumerate(parts, 1)]
    return found


def _column(name: str, values: NDArray[Any]) -> Column:
    if values.dtype.kind == "b":
        return Column(name, "BOOLEAN", "value", np.ascontiguousarray(values))
    if values.dtype.kind in "iu":
        limits = np.iinfo(np.int32)
        if len(values) and (values.min() < limits.min or values.max() > limits.max):
            raise InvalidShapeError(f"Blender keeps numbers of 32 bits: {name} has larger ones.")
        return Column(name, "INT", "value", np.ascontiguousarray(values, np.int32))
    kind, key = ("FLOAT", "value") if values.ndim == 1 else VECTORS[values.shape[1]]
    return Column(name, kind, key, single(values).ravel())


def single(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return the values in single precision; what is too large becomes infinite, silently."""
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(values, np.float32)


def coordinates(points: NDArray[np.float64], name: str) -> NDArray[np.float32]:
    """Return points in single precision.

    Raises
    ------
    InvalidShapeError
        When they do not fit.
    """
    found = single(points)
    if not np.isfinite(found).all():
        raise InvalidShapeError(
            f"The points of {name} are too large for Blender's single precision: scale the object "
            "down."
        )
    return found


def write(data: Any, column: Column, domain: str) -> bpy.types.Attribute:
    """Write a column as an attribute of a mesh or point cloud; one of that name is replaced."""
    attribute = data.attributes.get(column.name)
    if attribute is not None and (attribute.domain, attribute.data_type) != (domain, column.type):
        data.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = data.attributes.new(column.name, column.type, domain)
    attribute.data.foreach_set(column.key, column.values)
    return attribute


def add(data: Any, column: Column, domain: str) -> str:
    """Write a column as a new attribute; return its name, with a number where that was taken."""
    made = data.attributes.new(column.name, column.type, domain)
    made.data.foreach_set(column.key, column.values)
    return made.name


def color_column(name: str, srgb: NDArray[np.float64]) -> Column:
    """Return an opaque colour attribute; Blender keeps linear light."""
    rgba = np.ones((len(srgb), 4), np.float32)
    rgba[:, :3] = to_linear(srgb)
    return Column(name, "FLOAT_COLOR", "color", rgba.ravel())
