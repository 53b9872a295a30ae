# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes of a result written on the current mesh: custom attributes, quality and colour.

pymeshlab can add custom attributes to a mesh but not set its quality or colour. There are two ways
round, and each has its trap:

- An expression that reads the new attribute. It can crash on a mesh with attributes that were
  copied (by ``add_mesh``), and Python cannot see whether they were.
- For vertices, ``transfer_attributes_per_vertex`` from a layer of the same points: slow where few
  points lie far from all others, and it moves the vertices of a transformed layer by rounding.

So a mesh without attributes but ours goes the first way. Vertices of any other go the second, with
the transform put aside; its faces get the attribute only, and a message says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from medialis import Layer, Shape
from medialis.hosts import SELECTED, Shown, free_name, identifier, on_input, shown
from medialis_meshset.attributes import (
    FloatArray,
    add_face_attribute,
    add_vertex_attribute,
    colors_of,
    custom_arrays,
    taken_names,
)
from medialis_meshset.expressions import color_expressions, quality_expression
from medialis_meshset.own_attributes import all_own, note_own
from medialis_meshset.reading import is_identity
from medialis_meshset.script import filter_script_kept
from medialis_meshset.selection import select_by_attribute, select_by_copy

NO_FACE_EXPRESSION = (
    "Quality and colour of the faces were not set: MeshLab's expressions fail or may crash on the "
    "face attributes that this mesh has. The values are in the attribute {name}."
)


@dataclass(frozen=True, eq=False)
class InputData:
    """All that will be written on the current mesh, one row a vertex or face of it.

    The first names are those of the core; those written may differ (`free_name`).
    """

    vertex_attributes: dict[str, FloatArray]
    face_attributes: dict[str, FloatArray]
    vertex_shown: Shown | None = None
    face_shown: Shown | None = None
    selected: NDArray[np.bool_] | None = None


def input_data(layers: Sequence[Layer], shape: Shape) -> InputData:
    """Bring the attributes of `on_input` layers to the vertices and faces that were given.

    Vertices and faces that repair dropped get NaN, and -1 for whole numbers. The first layer with
    something to show decides quality and colour.
    """
    data = InputData({}, {})
    for layer in layers:
        fields = on_input(layer, shape)
        points, faces = fields.attributes, fields.face_attributes
        on_points, on_faces = shown(layer, points, {}), shown(layer, {}, faces)
        data = replace(
            data,
            vertex_shown=_collect(points, data.vertex_attributes, data.vertex_shown, on_points),
            face_shown=_collect(faces, data.face_attributes, data.face_shown, on_faces),
        )
        if layer.role == "selection":
            data = replace(data, selected=points[SELECTED] == 1)
    return data


def _collect(
    given: Mapping[str, NDArray[Any]],
    collected: dict[str, FloatArray],
    before: Shown | None,
    new: Shown | None,
) -> Shown | None:
    """Add the arrays of a layer to those of the others; return what is shown of all."""
    first = before or (None if new is None else replace(new, name=identifier(new.name)))
    for name, array in custom_arrays(given):
        free = free_name(name, collected)
        collected[free] = array
        if before is None and first is not None and first.name == name:
            first = replace(first, name=free)
    return first


def write_on_current(mesh_set: pymeshlab.MeshSet, data: InputData) -> tuple[dict[str, str], str]:
    """Write on the current mesh.

    Returns
    -------
    names : dict
        The name of each custom attribute on the mesh by its name in the core.
    message : str
        What could not be done; empty otherwise.
    """
    mesh, message = mesh_set.current_mesh(), ""
    taken = {element: taken_names(mesh_set, element) for element in "vf"}
    safe = {element: all_own(mesh_set, mesh.id(), element, taken[element]) for element in "vf"}
    seen = (data.vertex_shown, data.face_shown, data.selected)
    colored = any(each is not None for each in seen)
    with filter_script_kept(mesh_set) if colored else nullcontext():
        names = _add_all(mesh, add_vertex_attribute, data.vertex_attributes, taken["v"])
        face_names = _add_all(mesh, add_face_attribute, data.face_attributes, taken["f"])
        note_own(mesh_set, mesh.id(), "v", names.values())
        note_own(mesh_set, mesh.id(), "f", face_names.values())
        if data.vertex_shown is not None:
            _show_vertices(mesh_set, data.vertex_shown, names, safe=safe["v"])
        if data.face_shown is not None:
            message = _show_faces(mesh_set, data.face_shown, face_names, safe=safe["f"])
        if data.selected is not None and safe["v"]:
            select_by_attribute(mesh_set, names[SELECTED])
        elif data.selected is not None:
            with _untransformed(mesh_set):
                select_by_copy(mesh_set, data.selected)
    return {**face_names, **names}, message


def _add_all(
    mesh: pymeshlab.Mesh,
    add: Callable[[pymeshlab.Mesh, str, FloatArray], None],
    attributes: Mapping[str, FloatArray],
    taken: Sequence[str],
) -> dict[str, str]:
    """Add attributes under free names, and tell which."""
    names: dict[str, str] = {}
    for name, values in attributes.items():
        names[name] = free_name(name, {*taken, *names.values()})
        add(mesh, names[name], values)
    return names


def _show_vertices(
    mesh_set: pymeshlab.MeshSet, first: Shown, names: Mapping[str, str], *, safe: bool
) -> None:
    """Set quality and colour of the vertices; `safe`: expressions do not crash."""
    if safe:
        name = names[first.name]
        red, green, blue = color_expressions(first, name)
        with suppress(RuntimeError):  # the name is too long for an expression
            mesh_set.compute_scalar_by_function_per_vertex(q=quality_expression(first, name))
            mesh_set.compute_color_by_function_per_vertex(x=red, y=green, z=blue)
            return
    _transfer(mesh_set, first)


def _show_faces(
    mesh_set: pymeshlab.MeshSet, first: Shown, names: Mapping[str, str], *, safe: bool
) -> str:
    """Set quality and colour of the faces, or return why not."""
    name = names[first.name]
    if safe:
        red, green, blue = color_expressions(first, name)
        with suppress(RuntimeError):
            mesh_set.compute_scalar_by_function_per_face(q=quality_expression(first, name))
            mesh_set.compute_color_by_function_per_face(r=red, g=green, b=blue)
            return ""
    return NO_FACE_EXPRESSION.format(name=name)


def _transfer(mesh_set: pymeshlab.MeshSet, first: Shown) -> None:
    """Copy quality and colour from a layer of the same points, added for the moment."""
    target = mesh_set.current_mesh_id()
    with _untransformed(mesh_set):
        source = pymeshlab.Mesh(
            vertex_matrix=mesh_set.current_mesh().vertex_matrix(),
            v_scalar_array=first.finite,
            v_color_matrix=colors_of(first),
        )
        mesh_set.add_mesh(source, "medialis")
        try:
            mesh_set.transfer_attributes_per_vertex(
                sourcemesh=mesh_set.current_mesh_id(),
                targetmesh=target,
                qualitytransfer=True,
                colortransfer=True,
            )
        finally:
            mesh_set.delete_current_mesh()
            mesh_set.set_current_mesh(target)


@contextmanager
def _untransformed(mesh_set: pymeshlab.MeshSet) -> Iterator[None]:
    """Put the transform of the current mesh aside; its vertices stay as they are."""
    matrix = mesh_set.current_mesh().transform_matrix().copy()
    if is_identity(matrix):
        yield
        return
    mesh_set.set_matrix(transformmatrix=np.eye(4), freeze=False)
    try:
        yield
    finally:
        mesh_set.set_matrix(transformmatrix=matrix, freeze=False)
