# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes of a core layer as MeshLab stores them: custom attributes, quality, colour.

Custom attributes hold the core's values as they are. Quality is `Shown.finite`, because MeshLab's
statistics crash on NaN.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from medialis.hosts import Shown, identifier
from medialis_meshset.own_attributes import all_own

FloatArray = NDArray[np.float64]


def colors_of(shown: Shown) -> FloatArray:
    """Return RGBA (n, 4) in 0..1, of which pymeshlab takes the 8 bits that are meant."""
    # pymeshlab rounds down: half a step more gives the nearest.
    return np.minimum((shown.rgba_bytes + 0.5) / 255, 1.0)


def custom_arrays(attributes: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, FloatArray]]:
    """Give names and arrays of custom attributes: (n,) scalars and (n, 3) points, float64.

    Names become words. Of vectors that are not of length 3, each component is a scalar: name_0,
    name_1, ...
    """
    for name, given in attributes.items():
        word = identifier(name)
        values = np.asarray(given, np.float64)
        if values.ndim == 1 or values.shape[1:] == (3,):
            yield word, values
        else:
            for number, column in enumerate(values.reshape(len(values), -1).T):
                yield f"{word}_{number}", np.ascontiguousarray(column)


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


def saved_attributes(mesh_set: pymeshlab.MeshSet) -> list[str]:
    """Return the options by which `save_current_mesh` writes the attributes that are ours."""
    number, keys = mesh_set.current_mesh_id(), mesh_set.filter_parameter_values("ply")
    return [
        key
        for key in keys
        for element in "vf"
        for kind in "sp"
        if key.startswith(prefix := f"__ca_{element}{kind}__")
        and all_own(mesh_set, number, element, [key[len(prefix) :]])
    ]


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
