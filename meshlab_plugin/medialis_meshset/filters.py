# SPDX-License-Identifier: GPL-3.0-or-later
"""One filter from call to result: compute everything first, then change the MeshSet, or neither."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pymeshlab
from pymeshlab import PyMeshLabException

import medialis
from medialis import Layer, MedialisError, Progress, Result
from medialis.hosts import Kind, Operation, hidden_apart
from medialis_meshset.interrupt import interrupts_held
from medialis_meshset.layers import NewLayer, add_layer, new_layer
from medialis_meshset.listing import require_filter
from medialis_meshset.on_input import InputData, input_data, write_on_current
from medialis_meshset.parameters import ADD_SAMPLES, checked, with_fractions
from medialis_meshset.reading import shape_of_mesh
from medialis_meshset.script import filter_script_kept


def run_filter(
    mesh_set: pymeshlab.MeshSet, name: str, parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Run an operation on the current mesh and add what it found to the MeshSet.

    Returns
    -------
    dict
        The values of the operation, and "layers", "attributes", "images", "messages" (see
        `listing.RESULTS`).

    Raises
    ------
    PyMeshLabException, InvalidEnumException
        When the mesh or a parameter cannot be used; the MeshSet is then as it was.
    """
    chosen = require_filter(name)
    values = checked(chosen, parameters)
    add_auxiliary = values.pop(ADD_SAMPLES.name, ADD_SAMPLES.default)
    if mesh_set.mesh_number() == 0:
        raise PyMeshLabException(f"{name} requires at least one mesh loaded in the MeshSet.")
    mesh = mesh_set.current_mesh()
    if chosen.needs_faces and mesh.face_number() == 0:
        raise PyMeshLabException(
            f"Failed to apply filter:  '{name}. Current mesh does not have Any Faces."
        )
    with _errors_of_meshlab(name):
        result, new, data = _compute(chosen, mesh, values, add_auxiliary)
    layers, attributes, message = _change(mesh_set, name, new, data)
    return {
        **result.values,
        "layers": layers,
        "attributes": attributes,
        "images": dict(result.images),
        "messages": [*result.messages, *filter(None, [message])],
    }


def filter_values(
    mesh_set: pymeshlab.MeshSet, name: str, parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Return all parameters as `MeshSet.filter_parameter_values` does.

    Lengths are in units of the current mesh, choices are numbers.
    """
    chosen = require_filter(name)
    diagonal = 0.0
    if mesh_set.mesh_number() and mesh_set.current_mesh().vertex_number():
        points = mesh_set.current_mesh().transformed_vertex_matrix()
        diagonal = math.hypot(*np.ptp(points, axis=0))
    given = checked(chosen, parameters)
    add = given.pop(ADD_SAMPLES.name, ADD_SAMPLES.default)
    values = chosen.resolve(with_fractions(chosen, given, diagonal)).values()
    for parameter in chosen.parameters:
        if parameter.kind is Kind.LENGTH:
            values[parameter.name] *= diagonal
        elif parameter.kind is Kind.CHOICE:
            values[parameter.name] = parameter.choices.index(values[parameter.name])
    return {**values, ADD_SAMPLES.name: add}


@contextmanager
def _errors_of_meshlab(name: str) -> Iterator[None]:
    """Raise what the core raises as pymeshlab would, with the same sentence."""
    try:
        yield
    except MedialisError as error:
        raise PyMeshLabException(f"Failed to apply filter: {name}\nDetails: {error}") from error
    except MemoryError as error:
        raise PyMeshLabException(
            f"Failed to apply filter: {name}\nDetails: There is not enough memory for this mesh "
            "and these parameters."
        ) from error


def _compute(
    chosen: Operation, mesh: pymeshlab.Mesh, values: Mapping[str, Any], add_auxiliary: bool
) -> tuple[Result, list[NewLayer], InputData]:
    """Run the operation and make all that will be added; nothing changes yet."""
    progress = Progress()
    shape = shape_of_mesh(mesh, progress)
    result = medialis.run(
        chosen.name, shape, progress=progress, **with_fractions(chosen, values, shape.diagonal)
    )
    on_input = [layer for layer in result.layers if layer.on_input]
    new = [new_layer(layer) for layer in _wanted(result, add_auxiliary)]
    return result, new, input_data(on_input, shape)


def _wanted(result: Result, add_auxiliary: bool) -> Sequence[Layer]:
    """Layers to add: where pictures are the result, layers are only what they show.

    MeshLab has no slider: points that a layer hides become an invisible layer of their own.
    """
    return [
        part
        for layer in result.layers
        if not layer.on_input and (add_auxiliary or not (layer.auxiliary or result.images))
        for part in hidden_apart(layer)
    ]


def _change(
    mesh_set: pymeshlab.MeshSet, name: str, new: Sequence[NewLayer], data: InputData
) -> tuple[dict[str, int], dict[str, str], str]:
    """Add the layers, then write on the input, which cannot be undone; on failure undo.

    The first new layer of a ``generate_`` filter becomes the current one; others leave it.
    """
    before = mesh_set.current_mesh_id()
    present = {mesh.id() for mesh in mesh_set}
    added: dict[str, int] = {}
    with interrupts_held() as interrupt:
        try:
            for layer in new:
                added[layer.name] = add_layer(mesh_set, layer)
                interrupt.deliver()
            mesh_set.set_current_mesh(before)
            names, message = write_on_current(mesh_set, data)
        except BaseException:
            _remove_layers(mesh_set, {mesh.id() for mesh in mesh_set} - present)
            mesh_set.set_current_mesh(before)
            raise
        if added and name.startswith("generate_"):
            mesh_set.set_current_mesh(next(iter(added.values())))
    return added, names, message


def _remove_layers(mesh_set: pymeshlab.MeshSet, numbers: Collection[int]) -> None:
    if numbers:
        with filter_script_kept(mesh_set):
            for number in numbers:
                mesh_set.set_current_mesh(number)
                mesh_set.delete_current_mesh()
