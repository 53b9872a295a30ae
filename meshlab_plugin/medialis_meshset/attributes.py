# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes of a core layer as MeshLab stores them: custom attributes, quality, colour.

Custom attributes hold the core's values as they are. Quality is the shown attribute with every
value finite, because MeshLab's statistics crash on NaN: NaN becomes the lowest finite value and
infinity the highest.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from medialis.operations.result import Layer
from medialis.render.colors import label_colors, map_colors, value_range

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Display:
    """What is shown of a layer: one attribute, as quality and as colour.

    Attributes
    ----------
    name : str
        The attribute, as a word.
    values : (n,) array
    color_map : str
    limits : (float, float)
        Values of the first and last colour.
    is_label : bool
        Values number segments, which have the colours of labels.
    """

    name: str
    values: NDArray[Any]
    color_map: str
    limits: tuple[float, float]
    is_label: bool

    @property
    def quality(self) -> FloatArray:
        """The values (n,), all finite."""
        low, high = value_range(self.values)
        values = np.asarray(self.values, np.float64)
        return np.clip(np.where(np.isnan(values), low, values), low, high)

    @property
    def colors(self) -> FloatArray:
        """RGBA (n, 4) in 0..1, of which pymeshlab takes the 8 bits that are meant."""
        if self.is_label:
            rgb = label_colors(self.values)
        else:
            rgb = map_colors(self.values, self.color_map, *self.limits)
        # pymeshlab rounds down: half a step more gives the nearest.
        rgba = np.column_stack([np.rint(255 * rgb), np.full(len(rgb), 255.0)])
        return np.minimum((rgba + 0.5) / 255, 1.0)


def display_of(layer: Layer, attributes: Mapping[str, NDArray[Any]]) -> Display | None:
    """Return what a layer shows of these (its vertex or its face) attributes; None: nothing."""
    name = layer.color_by
    if name is None or name not in attributes:
        return None
    values = np.asarray(attributes[name])
    if values.ndim != 1:
        return None
    is_label = name in layer.labels and values.dtype.kind in "iub"
    limits = value_range(values, *layer.color_limits)
    return Display(as_word(name), values, layer.color_map, limits, is_label)


def custom_arrays(attributes: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, FloatArray]]:
    """Give names and arrays of custom attributes: (n,) scalars and (n, 3) points, float64.

    Names become words. Of vectors that are not of length 3, each component is a scalar: name_0,
    name_1, ...
    """
    for name, given in attributes.items():
        word = as_word(name)
        values = np.asarray(given, np.float64)
        if values.ndim == 1 or values.shape[1:] == (3,):
            yield word, values
        else:
            for number, column in enumerate(values.reshape(len(values), -1).T):
                yield f"{word}_{number}", np.ascontiguousarray(column)


def as_word(name: str) -> str:
    """Return a name as MeshLab's expressions can hold it: letters, digits, underscores."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{word}" if word[:1].isdigit() else word


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, or with _2, _3, ... when it is taken in any case of letters.

    MeshLab refuses a name twice, or crashes when one is a scalar and the other a point.
    """
    known = {other.lower() for other in taken}
    number, free = 1, name
    while free.lower() in known:
        number += 1
        free = f"{name}_{number}"
    return free


def taken_names(mesh_set: pymeshlab.MeshSet, element: str) -> list[str]:
    """Names (lower case) of custom attributes of the current mesh.

    Parameters
    ----------
    mesh_set : MeshSet
    element : "v" or "f"
        Of its vertices or of its faces.
    """
    prefixes = f"__ca_{element}s__", f"__ca_{element}p__"
    keys = mesh_set.filter_parameter_values("ply")
    return [key[len(prefixes[0]) :] for key in keys if key.startswith(prefixes)]


def add_vertex_attribute(mesh: pymeshlab.Mesh, name: str, values: FloatArray) -> None:
    """Add a custom scalar or point attribute to the vertices of a mesh that lacks the name."""
    if values.ndim == 1:
        mesh.add_vertex_custom_scalar_attribute(values, name)
    else:
        mesh.add_vertex_custom_point_attribute(values, name)


def add_face_attribute(mesh: pymeshlab.Mesh, name: str, values: FloatArray) -> None:
    """Add a custom scalar or point attribute to the faces of a mesh that lacks the name."""
    if values.ndim == 1:
        mesh.add_face_custom_scalar_attribute(values, name)
    else:
        mesh.add_face_custom_point_attribute(values, name)
