"""Points, triangles and lines with named values as VTK's PolyData (.vtp): ParaView, VTK, PyVista.

The numbers stand as they are behind the text (`_vtk.py`), so files are as small as PLY.
Attributes of any number of columns are kept, int64 and NaN as well.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from medialis.files._vtk import Layer


def write_vtp(
    path: str | os.PathLike[str],
    points: ArrayLike,
    faces: ArrayLike | None = None,
    edges: ArrayLike | None = None,
    attributes: Mapping[str, ArrayLike] | None = None,
    face_attributes: Mapping[str, ArrayLike] | None = None,
    *,
    show: str | None = None,
) -> None:
    """Write a layer as a .vtp file.

    Parameters
    ----------
    path : path
        Replaced when it is there.
    points : (n, 3) float
    faces : (m, 3) int, optional
    edges : (e, 2) int, optional
        Points without faces and edges are cells of their own, so that programs draw them.
    attributes : dict of (n,) or (n, ...) arrays, optional
        Point data. Arrays of more than two axes become columns, row by row; bool becomes 0 and 1.
    face_attributes : dict of (m,) or (m, ...) arrays, optional
        Cell data of the triangles; edges beside them have NaN, or 0 in whole numbers.
    show : str, optional
        The attribute that programs colour by at first.

    Raises
    ------
    InvalidShapeError
        When the points are none.
    InvalidOptionError
        When an attribute has another number of rows, or holds no numbers.
    FileError
        When the file cannot be written.
    """
    layer = Layer(points, faces, edges, attributes, face_attributes, show)
    cells = {"Verts": layer.vertices, "Lines": layer.lines, "Polys": layer.triangles}
    counts = {"Points": layer.points, **cells}
    about = " ".join(f'NumberOf{name}="{len(rows)}"' for name, rows in counts.items())
    inside = [f'<Piece {about} NumberOfStrips="0">', *layer.places()]
    for name, rows in cells.items():
        ends = rows.shape[1] * np.arange(1, len(rows) + 1, dtype=np.int64)
        columns = [("connectivity", rows.ravel()), ("offsets", ends)]
        inside += [f"<{name}>", *(layer.data.add(*column) for column in columns), f"</{name}>"]
    layer.write(path, "PolyData", [*inside, *layer.values(), "</Piece>"])
