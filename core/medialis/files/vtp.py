"""Points, triangles and lines with named values as VTK's PolyData (.vtp): ParaView, VTK, PyVista.

The numbers stand as they are behind the text (`_vtk.py`), so files are as small as PLY.
Attributes of any number of columns are kept, int64 and NaN as well.
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
    places = as_points(points)
    lines, triangles = cell_rows(edges, 2), cell_rows(faces, 3)
    own = np.arange(0 if len(lines) or len(triangles) else len(places), dtype=np.int64)[:, None]
    cells = {"Verts": own, "Lines": lines, "Polys": triangles}
    data = Appended()
    inside = ["<Points>", data.add("Points", places), "</Points>"]
    for name, rows in cells.items():
        ends = rows.shape[1] * np.arange(1, len(rows) + 1, dtype=np.int64)
        columns = [data.add("connectivity", rows.ravel()), data.add("offsets", ends)]
        inside += [f"<{name}>", *columns, f"</{name}>"]
    given = {name: as_column(name, v, len(places)) for name, v in (attributes or {}).items()}
    first = f" Scalars={quoteattr(show)}" if show in given and given[show].ndim == 1 else ""
    columns = [data.add(name, values) for name, values in given.items()]
    inside += [f"<PointData{first}>", *columns, "</PointData>"]
    if face_attributes:
        before = len(own) + len(lines)
        on_faces = {name: as_column(name, v, len(triangles)) for name, v in face_attributes.items()}
        columns = [data.add(name, behind(values, before)) for name, values in on_faces.items()]
        inside += ["<CellData>", *columns, "</CellData>"]
    counts = zip(("Points", "Verts", "Lines", "Polys"), (places, *cells.values()), strict=True)
    about = " ".join(f'NumberOf{name}="{len(rows)}"' for name, rows in counts)
    piece = f'<PolyData><Piece {about} NumberOfStrips="0">'
    with complete_file(path) as stream:
        stream.writelines(xml_file("PolyData", [piece, *inside, "</Piece></PolyData>"], data))
