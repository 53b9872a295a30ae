"""Triangles as shell elements: meshes of Gmsh (.msh), input files of Abaqus and CalculiX (.inp).

A face attribute of whole numbers tells the groups: the sheets of a midsurface, else the first one
there is. The attribute `thickness` tells how thick the shell is: that of the points, and that of
the faces where there is one, since a point at a weld has only one value for several sheets.

Gmsh gets text of version 2.2, which most programs that take its files can read. Each group is a
physical group, so that solvers find it by its name; values of points and faces follow as views.

Abaqus and CalculiX get an element set for each group with its shell section: one thickness where
the sheet is even, that of its nodes where it tapers. The file holds the mesh and its sections
alone; material, supports, loads and steps belong to the analysis, whose file includes this one.
Abaqus gets S3, its triangle for all shells. CalculiX makes solid wedges of shell elements, and of
S3 those with straight edges, which are far too stiff in bending (a strip bends half as far as it
should): it gets S6, with a node in the middle of each edge.

Source: Gmsh reference manual, section "MSH file format version 2 (Legacy)"; Abaqus keywords *NODE,
*ELEMENT, *SHELL SECTION, *NODAL THICKNESS; CalculiX manual 2.20, "Three-node shell element (S3)",
"Six-node shell element (S6)".
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import rows_of_labels, twice_areas
from medialis.base.errors import InvalidOptionError
from medialis.base.validation import FloatArray, as_faces, as_points
from medialis.formats.files import Drawn, write_lines
from medialis.formats.vtk import as_column, cell_rows

SHEET, THICKNESS, FACE_THICKNESS = "sheet", "thickness", "face_thickness"
"""The attributes of a midsurface."""

EVEN = 0.02
"""A sheet whose thickness spans at most this share of its mean is even: it gets one number. Four
times the 0.5 % to which a midsurface knows the thickness of an even wall."""


@dataclass(frozen=True)
class ShellGroup:
    """Triangles that belong together.

    Attributes
    ----------
    number : int
        The value of the attribute; -1 for none.
    name : str
        Letters, digits and underscores: SHEET_0, PATCH_3, NO_SHEET.
    faces : (k,) int64
        Its triangles, ascending.
    thickness : float
        Mean over its area; NaN where none is known.
    even : bool
        Whether this one number will do.
    """

    number: int
    name: str
    faces: NDArray[np.int64]
    thickness: float
    even: bool


class ShellMesh:
    """The triangles of a layer as shell elements.

    Attributes
    ----------
    thickness, face_thickness : (n,) and (m,) float64, or None
        At each point, and at each face; None where it is not known.

    Raises
    ------
    InvalidOptionError
        When there are no triangles, or an attribute has another number of rows.
    """

    def __init__(self, layer: Drawn) -> None:
        self.points = as_points(layer.points)
        self.faces = as_faces(cell_rows(layer.faces, 3), len(self.points))
        n, m = len(self.points), len(self.faces)
        if m == 0:
            raise InvalidOptionError("There are no triangles to write as shell elements.")
        self.attributes = {k: as_column(k, v, n) for k, v in layer.attributes.items()}
        self.face_attributes = {k: as_column(k, v, m) for k, v in layer.face_attributes.items()}
        self.thickness = _scalar(self.attributes.get(THICKNESS))
        self.face_thickness = _scalar(self.face_attributes.get(FACE_THICKNESS))

    @cached_property
    def grouped_by(self) -> str | None:
        """Name of the face attribute that tells the groups."""
        whole = [k for k, v in self.face_attributes.items() if v.ndim == 1 and v.dtype.kind in "iu"]
        return SHEET if SHEET in whole else next(iter(whole), None)

    @cached_property
    def groups(self) -> tuple[ShellGroup, ...]:
        """The groups by rising number; one where nothing tells any."""
        if self.grouped_by is None:
            return (self._group(0, "SHELL", np.arange(len(self.faces))),)
        numbers, stem = self.face_attributes[self.grouped_by], _word(self.grouped_by)
        parts = rows_of_labels(np.unique(numbers, return_inverse=True)[1].ravel())
        return tuple(
            self._group(number, f"NO_{stem}" if number < 0 else f"{stem}_{number}", rows)
            for number, rows in zip(np.unique(numbers).tolist(), parts, strict=True)
        )

    @cached_property
    def _areas(self) -> FloatArray:
        return twice_areas(self.points, self.faces) / 2

    @cached_property
    def _shared(self) -> NDArray[np.bool_]:
        """Which points several groups have: their thickness may be that of another one."""
        if self.grouped_by is None:
            return np.zeros(len(self.points), np.bool_)
        numbers = np.repeat(self.face_attributes[self.grouped_by].astype(np.int64), 3)
        pairs = np.unique(np.stack([self.faces.ravel(), numbers], axis=1), axis=0)
        return np.bincount(pairs[:, 0], minlength=len(self.points)) > 1

    def _group(self, number: int, name: str, rows: NDArray[np.int64]) -> ShellGroup:
        values, faces = np.empty(0), rows[:0]
        if self.face_thickness is not None:
            faces = rows[np.isfinite(self.face_thickness[rows])]
            values = self.face_thickness[faces]
        elif self.thickness is not None:
            corners = self.faces[rows]
            own = ~self._shared[corners] & np.isfinite(self.thickness[corners])
            if not own.any():  # a strip between two welds
                own = np.isfinite(self.thickness[corners])
            faces = np.broadcast_to(rows[:, None], corners.shape)[own]
            values = self.thickness[corners[own]]
        weights = self._areas[faces]
        if not weights.any():
            return ShellGroup(number, name, rows, np.nan, True)
        mean = float((weights * values).sum() / weights.sum())
        even = self.thickness is None or float(np.ptp(values)) <= EVEN * mean
        return ShellGroup(number, name, rows, mean, even)


def _scalar(values: NDArray[Any] | None) -> FloatArray | None:
    return None if values is None or values.ndim > 1 else np.asarray(values, np.float64)


def _word(name: str) -> str:
    """Return a name that all solvers take."""
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in name).upper()


def number_rows(numbers: NDArray[Any], rows: NDArray[Any], separator: str = ", ") -> list[str]:
    """Return lines of text: a number, and a row with all its digits, (k,) or (k, d)."""
    columns = rows.reshape(len(numbers), -1).tolist()
    return [
        separator.join((str(number), *map(repr, row)))
        for number, row in zip(numbers.tolist(), columns, strict=True)
    ]


TRIANGLE = 2
"""Gmsh's number of triangles with three nodes."""


def write_msh(path: str | os.PathLike[str], layer: Drawn) -> None:
    """Write the triangles of a layer as a .msh file.

    Parameters
    ----------
    path : path
        Replaced when it is there.
    layer : Drawn
        With triangles; shell models have no lines. Attributes that are numbers or rows of three
        become views, that of `color_by` first; NaN is left out, and so are other columns.

    Raises
    ------
    InvalidShapeError
        When the points are none.
    InvalidOptionError
        When there are no triangles, or an attribute has another number of rows.
    FileError
        When the file cannot be written.
    """
    write_lines(path, _msh_lines(ShellMesh(layer), layer.color_by))


def _msh_lines(mesh: ShellMesh, show: str | None) -> Iterator[str]:
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


CALCULIX = ".ccx.inp"
"""How names of files for CalculiX end."""

MATERIAL = "PART"
"""The material that all sections name."""

PER_LINE = 12
"""Numbers in a line of an element set: 16 at most."""


def write_inp(path: str | os.PathLike[str], layer: Drawn, *, unit: str | None = None) -> None:
    """Write the triangles of a layer as shell elements: S3, or S6 for CalculiX.

    Parameters
    ----------
    path : path
        Replaced when it is there. Names that end in ``.ccx.inp`` are for CalculiX.
    layer : Drawn
        With triangles. `thickness` of the points makes sections; `sheet` of the faces, or their
        first attribute of whole numbers, makes element sets: SHEET_0, ...
    unit : str, optional
        Of lengths; the file says it.

    Raises
    ------
    InvalidShapeError
        When the points are none.
    InvalidOptionError
        When there are no triangles, or an attribute has another number of rows.
    FileError
        When the file cannot be written.
    """
    element = "S6" if os.fspath(path).lower().endswith(CALCULIX) else "S3"
    write_lines(path, _inp_lines(ShellMesh(layer), element, unit))


def _nodes(
    mesh: ShellMesh, element: str
) -> tuple[FloatArray, FloatArray | None, NDArray[np.int64]]:
    """Return places and thickness of the nodes, and those of each element.

    S6 has a node in the middle of each edge, behind the others.
    """
    corners = mesh.faces.astype(np.int64)
    if element == "S3":
        return mesh.points, mesh.thickness, corners
    n, m = len(mesh.points), len(mesh.faces)
    sides = np.concatenate([corners[:, [j, (j + 1) % 3]] for j in range(3)])
    low, high = sides.min(axis=1), sides.max(axis=1)
    keys, which = np.unique(low * n + high, return_inverse=True)
    ends = np.stack([keys // n, keys % n], axis=1)
    middles = mesh.points[ends].mean(axis=1)
    thickness = mesh.thickness
    if thickness is not None:
        thickness = np.concatenate([thickness, thickness[ends].mean(axis=1)])
    between = n + which.reshape(3, m).T
    points = np.concatenate([mesh.points, middles])
    return points, thickness, np.concatenate([corners, between], axis=1)


DIGITS = 12
"""Of a number in an INP file: CalculiX reads 20 characters, -2.848362679850857e-20 has 22."""


def _short(values: FloatArray) -> FloatArray:
    """Return numbers of `DIGITS` digits."""
    return np.char.mod(f"%.{DIGITS}g", values).astype(np.float64)


def _inp_lines(mesh: ShellMesh, element: str, unit: str | None) -> Iterator[str]:
    points, thickness, elements = _nodes(mesh, element)
    numbers = np.arange(1, len(mesh.faces) + 1)
    yield "*HEADING"
    yield "Shell model written by medialis"
    yield f"** Lengths are in {unit or 'the unit of the shape'}."
    if not all(np.isnan(group.thickness) for group in mesh.groups):
        yield f"** Define *MATERIAL, NAME={MATERIAL} before you include this file."
    yield "*NODE, NSET=ALL_NODES"
    yield from number_rows(np.arange(1, len(points) + 1), _short(points))
    for group in mesh.groups:
        yield f"*ELEMENT, TYPE={element}, ELSET={group.name}"
        yield from number_rows(numbers[group.faces], elements[group.faces] + 1)
    yield "*ELSET, ELSET=ALL_SHELLS"
    names = [group.name for group in mesh.groups]
    for first in range(0, len(names), PER_LINE):
        yield ", ".join(names[first : first + PER_LINE])
    tapered = [group for group in mesh.groups if not group.even]
    if tapered and thickness is not None:
        yield "*NODAL THICKNESS"
        used = np.unique(elements[np.concatenate([group.faces for group in tapered])])
        used = used[np.isfinite(thickness[used])]
        yield from number_rows(used + 1, _short(thickness[used]))
    for group in mesh.groups:
        if np.isnan(group.thickness):
            continue
        by_nodes = "" if group.even else ", NODAL THICKNESS"
        yield f"*SHELL SECTION, ELSET={group.name}, MATERIAL={MATERIAL}{by_nodes}"
        yield f"{group.thickness:.{DIGITS}g}"
