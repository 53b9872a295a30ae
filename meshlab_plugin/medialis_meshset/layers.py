# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers of a result as new layers of a MeshSet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from medialis.hosts import Layer, free_name, shown
from medialis_meshset.attributes import (
    FloatArray,
    add_face_attribute,
    add_vertex_attribute,
    colors_of,
    custom_arrays,
)
from medialis_meshset.own_attributes import note_own


@dataclass(frozen=True, eq=False)
class NewLayer:
    """A layer ready to be added.

    Its custom attributes wait outside the mesh: adding a mesh copies it, and MeshLab crashes in
    expressions on a mesh with copied attributes.
    """

    name: str
    mesh: pymeshlab.Mesh
    vertex_attributes: dict[str, FloatArray]
    face_attributes: dict[str, FloatArray]
    visible: bool = True


def new_layer(layer: Layer) -> NewLayer:
    """Make the mesh and the attribute arrays of a layer.

    Quality and colour come from `Layer.color_by`, normals of points from a vector attribute
    ``normal`` (those of triangles MeshLab computes itself).
    """
    given: dict[str, Any] = {"vertex_matrix": np.ascontiguousarray(layer.points)}
    if layer.faces is not None and len(layer.faces):
        given["face_matrix"] = np.ascontiguousarray(layer.faces, np.int32)
    if layer.edges is not None and len(layer.edges):
        given["edge_matrix"] = np.ascontiguousarray(layer.edges, np.int32)
    normals = layer.attributes.get("normal")
    if normals is not None and np.shape(normals)[1:] == (3,):
        given["v_normals_matrix"] = np.ascontiguousarray(normals, np.float64)
    for letter, first in (("v", shown(layer, None, {})), ("f", shown(layer, {}, None))):
        if first is not None and len(first.values):
            given[f"{letter}_scalar_array"] = first.finite
            given[f"{letter}_color_matrix"] = colors_of(first)
    return NewLayer(
        layer.name,
        pymeshlab.Mesh(**given),
        _named(layer.attributes),
        _named(layer.face_attributes),
        visible=layer.role != "hidden",
    )


def add_layer(mesh_set: pymeshlab.MeshSet, layer: NewLayer) -> int:
    """Add a layer, which becomes the current one, and return its id."""
    mesh_set.add_mesh(layer.mesh, layer.name)
    mesh = mesh_set.current_mesh()
    for name, values in layer.vertex_attributes.items():
        add_vertex_attribute(mesh, name, values)
    for name, values in layer.face_attributes.items():
        add_face_attribute(mesh, name, values)
    note_own(mesh_set, mesh.id(), "v", layer.vertex_attributes)
    note_own(mesh_set, mesh.id(), "f", layer.face_attributes)
    if not layer.visible:
        mesh_set.set_current_mesh_visibility(False)
    return int(mesh.id())


def _named(attributes: Mapping[str, NDArray[Any]]) -> dict[str, FloatArray]:
    named: dict[str, FloatArray] = {}
    for name, values in custom_arrays(attributes):
        named[free_name(name, named)] = values
    return named
