"""Triangles as shell elements in an input file of Abaqus or CalculiX (.inp).

Each sheet is an element set with its shell section: one thickness where the sheet is even, that of
its nodes where it tapers. The file holds the mesh and its sections alone; material, supports, loads
and steps belong to the analysis, whose file includes this one.

Abaqus gets S3, its triangle for all shells. CalculiX makes solid wedges of shell elements, and of
S3 those with straight edges, which are far too stiff in bending (a strip bends half as far as it
should): it gets S6, with a node in the middle of each edge.

Source: Abaqus keywords *NODE, *ELEMENT, *SHELL SECTION, *NODAL THICKNESS; CalculiX manual 2.20,
"Three-node shell element (S3)", "Six-node shell element (S6)".
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.files._files import complete_file
from medialis.files.shells import ShellMesh, number_rows
from medialis.validation import FloatArray, as_choice

ShellElement = Literal["S3", "S6"]

CALCULIX = ".ccx.inp"
"""How names of files for CalculiX end."""

MATERIAL = "PART"
"""The material that all sections name."""

PER_LINE = 12
"""Numbers in a line of an element set: 16 at most."""


def write_inp(
    path: str | os.PathLike[str],
    points: ArrayLike,
    faces: ArrayLike | None = None,
    edges: ArrayLike | None = None,
    attributes: Mapping[str, ArrayLike] | None = None,
    face_attributes: Mapping[str, ArrayLike] | None = None,
    *,
    show: str | None = None,
    element: ShellElement | None = None,
    unit: str | None = None,
) -> None:
    """Write the triangles of a layer as shell elements.

    Parameters
    ----------
    path : path
        Replaced when it is there. Names that end in ``.ccx.inp`` are for CalculiX.
    points : (n, 3) float
    faces : (m, 3) int
    edges, show : ignored
    attributes : dict of arrays, optional
        `thickness` (n,) makes sections.
    face_attributes : dict of arrays, optional
        `sheet` (m,), or the first one of whole numbers, makes element sets: SHEET_0, ...
    element : {"S3", "S6"}, optional
        S6 has a node in the middle of each edge. S3 when missing, S6 for CalculiX.
    unit : str, optional
        What one unit of the points is; a comment says it.

    Raises
    ------
    InvalidShapeError
        When the points are none.
    InvalidOptionError
        When there are no triangles, or an attribute has another number of rows.
    FileError
        When the file cannot be written.
    """
    mesh = ShellMesh(points, faces, attributes, face_attributes)
    if element is None:
        element = "S6" if os.fspath(path).lower().endswith(CALCULIX) else "S3"
    as_choice(element, "element", ("S3", "S6"))
    nodes = _first_order(mesh) if element == "S3" else _second_order(mesh)
    with complete_file(path) as stream:
        for line in _lines(mesh, nodes, element, unit):
            stream.write(line.encode() + b"\n")


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Places and thickness of the nodes, and those of each element."""

    points: FloatArray
    thickness: FloatArray | None
    elements: NDArray[np.int64]


def _first_order(mesh: ShellMesh) -> _Nodes:
    return _Nodes(mesh.points, mesh.thickness, mesh.faces.astype(np.int64))


def _second_order(mesh: ShellMesh) -> _Nodes:
    """Add a node in the middle of each edge, behind the others."""
    n, m = len(mesh.points), len(mesh.faces)
    sides = np.concatenate([mesh.faces[:, [j, (j + 1) % 3]] for j in range(3)]).astype(np.int64)
    low, high = sides.min(axis=1), sides.max(axis=1)
    keys, which = np.unique(low * n + high, return_inverse=True)
    ends = np.stack([keys // n, keys % n], axis=1)
    middles = mesh.points[ends].mean(axis=1)
    thickness = mesh.thickness
    if thickness is not None:
        thickness = np.concatenate([thickness, thickness[ends].mean(axis=1)])
    between = n + which.reshape(3, m).T
    return _Nodes(
        np.concatenate([mesh.points, middles]),
        thickness,
        np.concatenate([mesh.faces.astype(np.int64), between], axis=1),
    )


def _lines(mesh: ShellMesh, nodes: _Nodes, element: str, unit: str | None) -> Iterator[str]:
    numbers = np.arange(1, len(mesh.faces) + 1)
    yield "*HEADING"
    yield "Shell model written by medialis"
    yield f"** Lengths are in {unit or 'the unit of the shape'}."
    if not all(np.isnan(group.thickness) for group in mesh.groups):
        yield f"** Define *MATERIAL, NAME={MATERIAL} before you include this file."
    yield "*NODE, NSET=ALL_NODES"
    yield from number_rows(np.arange(1, len(nodes.points) + 1), nodes.points)
    for group in mesh.groups:
        yield f"*ELEMENT, TYPE={element}, ELSET={group.name}"
        yield from number_rows(numbers[group.faces], nodes.elements[group.faces] + 1)
    yield "*ELSET, ELSET=ALL_SHELLS"
    names = [group.name for group in mesh.groups]
    for first in range(0, len(names), PER_LINE):
        yield ", ".join(names[first : first + PER_LINE])
    tapered = [group for group in mesh.groups if not group.even]
    if tapered and nodes.thickness is not None:
        yield "*NODAL THICKNESS"
        corners = nodes.elements[np.concatenate([group.faces for group in tapered])]
        used = np.unique(corners)
        used = used[np.isfinite(nodes.thickness[used])]
        yield from number_rows(used + 1, nodes.thickness[used])
    for group in mesh.groups:
        if np.isnan(group.thickness):
            continue
        by_nodes = "" if group.even else ", NODAL THICKNESS"
        yield f"*SHELL SECTION, ELSET={group.name}, MATERIAL={MATERIAL}{by_nodes}"
        yield repr(group.thickness)
