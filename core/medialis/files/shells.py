"""Triangles as shell elements: groups of them, and the thickness of each (for files of solvers).

A face attribute of whole numbers tells the groups: the sheets of a midsurface, else the first one
there is. The attribute `thickness` tells how thick the shell is: that of the points, and that of
the faces where there is one, since a point at a weld has only one value for several sheets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidOptionError
from medialis.files._vtk import as_column, cell_rows
from medialis.validation import FloatArray, as_faces, as_points

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

    Parameters
    ----------
    points : (n, 3) float
    faces : (m, 3) int or None
    attributes, face_attributes : dict of arrays

    Raises
    ------
    InvalidOptionError
        When there are no triangles, or an attribute has another number of rows.
    """

    def __init__(
        self,
        points: ArrayLike,
        faces: ArrayLike | None,
        attributes: Mapping[str, ArrayLike] | None,
        face_attributes: Mapping[str, ArrayLike] | None,
    ) -> None:
        self.points = as_points(points)
        self.faces = as_faces(cell_rows(faces, 3), len(self.points))
        n, m = len(self.points), len(self.faces)
        if m == 0:
            raise InvalidOptionError("There are no triangles to write as shell elements.")
        self.attributes = {k: as_column(k, v, n) for k, v in (attributes or {}).items()}
        self.face_attributes = {k: as_column(k, v, m) for k, v in (face_attributes or {}).items()}

    @cached_property
    def thickness(self) -> FloatArray | None:
        """At each point, (n,); None where it is not known."""
        values = self.attributes.get(THICKNESS)
        return None if values is None or values.ndim > 1 else np.asarray(values, np.float64)

    @cached_property
    def face_thickness(self) -> FloatArray | None:
        """At each face, (m,); None where it is not known."""
        values = self.face_attributes.get(FACE_THICKNESS)
        return None if values is None or values.ndim > 1 else np.asarray(values, np.float64)

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
        values, which = np.unique(numbers, return_inverse=True)
        order = np.argsort(which.ravel(), kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(which.ravel()))[:-1])
        return tuple(
            self._group(number, f"NO_{stem}" if number < 0 else f"{stem}_{number}", rows)
            for number, rows in zip(values.tolist(), parts, strict=True)
        )

    @cached_property
    def _areas(self) -> FloatArray:
        a, b, c = (self.points[self.faces[:, j]] for j in range(3))
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    @cached_property
    def _shared(self) -> NDArray[np.bool_]:
        """Which points several groups have: their thickness may be that of another one."""
        if self.grouped_by is None:
            return np.zeros(len(self.points), np.bool_)
        numbers = np.repeat(self.face_attributes[self.grouped_by].astype(np.int64), 3)
        corners = self.faces.ravel()
        low = np.full(len(self.points), np.iinfo(np.int64).max)
        high = np.full(len(self.points), np.iinfo(np.int64).min)
        np.minimum.at(low, corners, numbers)
        np.maximum.at(high, corners, numbers)
        return np.asarray(low < high)

    def _group(self, number: int, name: str, rows: NDArray[np.int64]) -> ShellGroup:
        if self.face_thickness is not None:
            known = rows[np.isfinite(self.face_thickness[rows])]
            return self._measured(number, name, rows, self.face_thickness[known], known)
        if self.thickness is None:
            return ShellGroup(number, name, rows, np.nan, True)
        corners = self.faces[rows]
        own = ~self._shared[corners] & np.isfinite(self.thickness[corners])
        if not own.any():  # a strip between two welds
            own = np.isfinite(self.thickness[corners])
        faces = np.broadcast_to(rows[:, None], corners.shape)[own]
        return self._measured(number, name, rows, self.thickness[corners[own]], faces)

    def _measured(
        self,
        number: int,
        name: str,
        rows: NDArray[np.int64],
        values: FloatArray,
        faces: NDArray[np.int64],
    ) -> ShellGroup:
        """Make a group of some faces from values at faces."""
        weights = self._areas[faces]
        if not weights.any():
            return ShellGroup(number, name, rows, np.nan, True)
        mean = float((weights * values).sum() / weights.sum())
        even = self.thickness is None or float(np.ptp(values)) <= EVEN * mean
        return ShellGroup(number, name, rows, mean, even)


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
