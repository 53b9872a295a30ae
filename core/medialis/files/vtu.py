"""Points, triangles and lines with named values as VTK's UnstructuredGrid (.vtu).

What solvers and their post-processors read and write: ParaView, PyVista, meshio, FEniCS, Elmer. The
numbers stand as they are behind the text (`_vtk.py`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from medialis.files._files import complete_file
from medialis.files._vtk import Appended, as_column, behind, cell_rows, xml_file
from medialis.validation import as_points

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

    Parameters
    ----------
    path : path
        Replaced when it is there.
    points : (n, 3) float
    faces : (m, 3) int, optional
    edges : (e, 2) int, optional
        Cells are the edges, then the triangles. Points without both are cells of their own.
    attributes : dict of (n,) or (n, ...) arrays, optional
        Point data, as in `write_vtp`.
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
    places = as_points(points)
    lines, triangles = cell_rows(edges, 2), cell_rows(faces, 3)
    own = np.arange(0 if len(lines) or len(triangles) else len(places), dtype=np.int64)[:, None]
    cells = {VERTEX: own, LINE: lines, TRIANGLE: triangles}
    counts = [len(rows) for rows in cells.values()]
    kinds = np.repeat(np.array(list(cells), np.uint8), counts)
    sizes = np.repeat([rows.shape[1] for rows in cells.values()], counts)
    data = Appended()
    inside = [
        *("<Points>", data.add("Points", places), "</Points>", "<Cells>"),
        data.add("connectivity", np.concatenate([rows.ravel() for rows in cells.values()])),
        data.add("offsets", np.cumsum(sizes, dtype=np.int64)),
        *(data.add("types", kinds), "</Cells>"),
    ]
    given = {name: as_column(name, v, len(places)) for name, v in (attributes or {}).items()}
    first = f" Scalars={quoteattr(show)}" if show in given and given[show].ndim == 1 else ""
    columns = [data.add(name, values) for name, values in given.items()]
    inside += [f"<PointData{first}>", *columns, "</PointData>"]
    on_faces = {n: as_column(n, v, len(triangles)) for n, v in (face_attributes or {}).items()}
    before = len(own) + len(lines)
    columns = [data.add(name, behind(values, before)) for name, values in on_faces.items()]
    inside += ["<CellData>", *columns, "</CellData>"]
    piece = f'<Piece NumberOfPoints="{len(places)}" NumberOfCells="{len(kinds)}">'
    inside = ["<UnstructuredGrid>", piece, *inside, "</Piece>", "</UnstructuredGrid>"]
    with complete_file(path) as stream:
        stream.writelines(xml_file("UnstructuredGrid", inside, data))
