"""Triangles with named values as Gmsh's mesh file (.msh), version 2.2, as text.

That version is read by Gmsh itself and by most programs that take its files. Each sheet is a
physical group, so that solvers find it by its name; values of points and faces follow as views.

Source: Gmsh reference manual, section "MSH file format version 2 (Legacy)".
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.files._files import complete_file
from medialis.files.shells import ShellMesh, number_rows

TRIANGLE = 2
"""Gmsh's number of triangles with three nodes."""


def write_msh(
    path: str | os.PathLike[str],
    points: ArrayLike,
    faces: ArrayLike | None = None,
    edges: ArrayLike | None = None,
    attributes: Mapping[str, ArrayLike] | None = None,
    face_attributes: Mapping[str, ArrayLike] | None = None,
    *,
    show: str | None = None,
) -> None:
    """Write the triangles of a layer as a .msh file.

    Parameters
    ----------
    path : path
        Replaced when it is there.
    points : (n, 3) float
    faces : (m, 3) int
    edges : ignored
        Shell models have no lines.
    attributes, face_attributes : dict of arrays, optional
        Numbers and rows of three become views; NaN is left out, and so are other columns.
    show : str, optional
        The attribute whose view comes first.

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
    with complete_file(path) as stream:
        for line in _lines(mesh, show):
            stream.write(line.encode() + b"\n")


def _lines(mesh: ShellMesh, show: str | None) -> Iterator[str]:
    yield from ("$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(mesh.groups)))
    tags = np.zeros(len(mesh.faces), np.int64)
    for tag, group in enumerate(mesh.groups, 1):  # tags begin at 1
        yield f'2 {tag} "{group.name}"'
        tags[group.faces] = tag
    yield from ("$EndPhysicalNames", "$Nodes", str(len(mesh.points)))
    nodes, elements = (np.arange(1, len(rows) + 1) for rows in (mesh.points, mesh.faces))
    yield from number_rows(nodes, mesh.points, " ")
    yield from ("$EndNodes", "$Elements", str(len(elements)))
    kind = np.broadcast_to([TRIANGLE, 2], (len(elements), 2))
    yield from number_rows(elements, np.column_stack([kind, tags, tags, mesh.faces + 1]), " ")
    yield "$EndElements"
    for name in sorted(mesh.attributes, key=lambda name: name != show):
        yield from _view("NodeData", name, nodes, mesh.attributes[name])
    for name in sorted(mesh.face_attributes, key=lambda name: name != show):
        yield from _view("ElementData", name, elements, mesh.face_attributes[name])


def _view(kind: str, name: str, numbers: NDArray[np.int64], given: NDArray[Any]) -> Iterator[str]:
    values = np.asarray(given, np.float64).reshape(len(given), -1)
    known = np.isfinite(values).all(axis=1)
    width = values.shape[1]
    if width not in (1, 3) or not known.any():
        return
    title = name.replace('"', "'").replace("\n", " ")
    yield from (f"${kind}", "1", f'"{title}"', "1", "0.0")
    yield from ("3", "0", str(width), str(int(known.sum())))
    yield from number_rows(numbers[known], values[known], " ")
    yield f"$End{kind}"
