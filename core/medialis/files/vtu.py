"""Points, triangles and lines with named values as VTK's UnstructuredGrid (.vtu).

What solvers and their post-processors read and write: ParaView, PyVista, meshio, FEniCS, Elmer. The
numbers stand as they are behind the text (`_vtk.py`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from medialis.files._vtk import Layer

VERTEX, LINE, TRIANGLE = 1, 3, 5
"""VTK's numbers of the kinds of cells."""


def write_vtu(
    path: str | os.PathLike[str],
    points: ArrayLike,
    faces: ArrayLike | None = None,
    edges: ArrayLike | None = None,
    attributes: Mapping[str, ArrayLike] | None = None,
    face_attributes: Mapping[str, ArrayLike] | None = None,
    *,
    show: str | None = None,
) -> None:
    """Write a layer as a .vtu file.

    Arguments and errors are those of `write_vtp`; cells are the edges, then the triangles.
    """
    layer = Layer(points, faces, edges, attributes, face_attributes, show)
    cells = {VERTEX: layer.vertices, LINE: layer.lines, TRIANGLE: layer.triangles}
    counts = [len(rows) for rows in cells.values()]
    kinds = np.repeat(np.array(list(cells), np.uint8), counts)
    sizes = np.repeat([rows.shape[1] for rows in cells.values()], counts)
    columns = [
        ("connectivity", np.concatenate([rows.ravel() for rows in cells.values()])),
        ("offsets", np.cumsum(sizes, dtype=np.int64)),
        ("types", kinds),
    ]
    inside = [
        f'<Piece NumberOfPoints="{len(layer.points)}" NumberOfCells="{len(kinds)}">',
        *layer.places(),
        *("<Cells>", *(layer.data.add(*column) for column in columns), "</Cells>"),
    ]
    layer.write(path, "UnstructuredGrid", [*inside, *layer.values(), "</Piece>"])
