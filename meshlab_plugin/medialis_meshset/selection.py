# SPDX-License-Identifier: GPL-3.0-or-later
"""Selected vertices of a mesh: handed to an operation, or set as its result says."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pymeshlab
from numpy.typing import NDArray
from pymeshlab import PyMeshLabException

from medialis.hosts import Filter


@contextmanager
def selection_files(mesh: pymeshlab.Mesh, chosen: Filter) -> Iterator[dict[str, str]]:
    """Give the options of a filter that take the selected vertices, as files while the block runs.

    Empty where no vertex is selected.

    Raises
    ------
    PyMeshLabException
        When the filter takes two and another number is selected.
    """
    if not mesh.is_compact():
        mesh.compact()
    numbers = np.flatnonzero(mesh.vertex_selection_array())
    with tempfile.TemporaryDirectory(prefix="medialis-") as folder:
        files = {}
        for parameter in chosen.parameters if len(numbers) else ():
            if not parameter.selection:
                continue
            if parameter.selection == "pair" and len(numbers) != 2:
                raise PyMeshLabException(
                    f"Failed to apply filter: {chosen.name}\nDetails: Select two vertices, or "
                    f"none: {len(numbers)} are selected."
                )
            path = Path(folder) / f"{parameter.name}.txt"
            path.write_text(
                (" " if parameter.selection == "pair" else "\n").join(map(str, numbers))
            )
            files[parameter.name] = str(path)
        yield files


def select_by_attribute(mesh_set: pymeshlab.MeshSet, name: str) -> None:
    """Select the vertices whose attribute is 1, and no others."""
    mesh_set.compute_selection_by_condition_per_vertex(condselect=f"({name} == 1)")


def select_by_copy(mesh_set: pymeshlab.MeshSet, chosen: NDArray[np.bool_]) -> None:
    """Select vertices by a layer of the same points, where expressions may crash."""
    target = mesh_set.current_mesh_id()
    points = mesh_set.current_mesh().vertex_matrix()
    copy = pymeshlab.Mesh(vertex_matrix=points, v_scalar_array=chosen.astype(np.float64))
    mesh_set.add_mesh(copy, "medialis")
    source = mesh_set.current_mesh_id()
    try:
        mesh_set.compute_selection_by_condition_per_vertex(condselect="(q == 1)")
        mesh_set.transfer_attributes_per_vertex(
            sourcemesh=source, targetmesh=target, colortransfer=False, selectiontransfer=True
        )
    finally:
        mesh_set.set_current_mesh(source)
        mesh_set.delete_current_mesh()
        mesh_set.set_current_mesh(target)
