# SPDX-License-Identifier: GPL-3.0-or-later
"""One filter from call to result: compute everything first, then change the MeshSet, or neither."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
import pymeshlab
from pymeshlab import PyMeshLabException

import medialis
from medialis import MedialisError, Result
from medialis.hosts import (
    AUTO,
    AUXILIARY,
    HIDE_SOURCE,
    SELECTED,
    SOLID,
    USE_SELECTION,
    Filter,
    Kind,
    host_layers,
)
from medialis_meshset.interrupt import interrupts_held
from medialis_meshset.layers import NewLayer, add_layer, new_layer
from medialis_meshset.listing import require_filter
from medialis_meshset.on_input import InputData, input_data, write_on_current
from medialis_meshset.parameters import checked, with_fractions
from medialis_meshset.reading import shape_of_mesh
from medialis_meshset.script import filter_script_kept, record
from medialis_meshset.selection import selection_files
from medialis_meshset.verbosity import progress_of


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
    host = {p.name: values.pop(p.name, False) for p in chosen.host_parameters}
    if mesh_set.mesh_number() == 0:
        raise PyMeshLabException(f"{name} requires at least one mesh loaded in the MeshSet.")
    mesh = mesh_set.current_mesh()
    if chosen.operation.needs_faces and mesh.face_number() == 0:
        raise PyMeshLabException(
            f"Failed to apply filter:  '{name}. Current mesh does not have Any Faces."
        )
    with _errors_of_meshlab(name), ExitStack() as stack:
        no_files: dict[str, str] = {}
        if host.get(USE_SELECTION.name):
            no_files = {p.name: "" for p in chosen.parameters if p.selection}
            values = {**stack.enter_context(selection_files(mesh, chosen)), **values}
        result, new, data = _compute(chosen, mesh_set, values, host)
    hide = host.get(HIDE_SOURCE.name)
    if hide is not False:  # it lies inside, or the result lies on it
        mesh_set.set_mesh_visibility(mesh.id(), not hide)
    layers, attributes, message = _change(mesh_set, chosen, new, data)
    given = {**result.parameters, **dict.fromkeys(result.automatic, AUTO)}
    record(mesh_set, chosen, {**given, **no_files, **host})
    return {
        **(result.values if data.selected is None else {SELECTED: int(data.selected.sum())}),
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
    host = {p.name: given.pop(p.name, False) for p in chosen.host_parameters}
    values = chosen.resolve(with_fractions(chosen, given, diagonal)).values()
    for parameter in chosen.parameters:
        if parameter.auto is not None and values[parameter.name] == AUTO:
            continue
        if parameter.kind is Kind.LENGTH:
            values[parameter.name] *= diagonal
        elif parameter.kind is Kind.CHOICE:
            values[parameter.name] = parameter.choices.index(values[parameter.name])
    return {**values, **host}


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
    chosen: Filter,
    mesh_set: pymeshlab.MeshSet,
    values: Mapping[str, Any],
    host: Mapping[str, bool],
) -> tuple[Result, list[NewLayer], InputData]:
    """Run the operation and make all that will be added; nothing changes yet."""
    progress = progress_of(mesh_set)
    shape = shape_of_mesh(mesh_set.current_mesh(), progress)
    given = {**chosen.defaults, **with_fractions(chosen, values, shape.diagonal)}
    result = medialis.run(chosen.operation.name, shape, progress=progress, **given)
    auxiliary, draw_solid = host.get(AUXILIARY.name, False), host.get(SOLID.name, False)
    layers = host_layers(result, shape, chosen, auxiliary=auxiliary, draw_solid=draw_solid)
    new = [new_layer(layer) for layer in layers if not layer.on_input]
    return result, new, input_data([layer for layer in layers if layer.on_input], shape)


def _change(
    mesh_set: pymeshlab.MeshSet, chosen: Filter, new: Sequence[NewLayer], data: InputData
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
        if added and chosen.generates:
            mesh_set.set_current_mesh(next(iter(added.values())))
    return added, names, message


def _remove_layers(mesh_set: pymeshlab.MeshSet, numbers: Collection[int]) -> None:
    if numbers:
        with filter_script_kept(mesh_set):
            for number in numbers:
                mesh_set.set_current_mesh(number)
                mesh_set.delete_current_mesh()
