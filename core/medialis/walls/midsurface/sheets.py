"""What a midsurface is: sheets with their thickness, welds where they meet, lumps beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from medialis.base.arrays import Described
from medialis.base.validation import FloatArray, IntArray, Positions, hold


@dataclass(frozen=True)
class Lump:
    """A part of a solid that is no wall.

    Attributes
    ----------
    share : float
        Of the volume of the solid.
    position : tuple of float
        A place in its middle.
    """

    share: float
    position: tuple[float, float, float]


@dataclass(frozen=True, eq=False, repr=False)
class Midsurface(Described):
    """Triangles in the middle of walls.

    Attributes
    ----------
    points : (n, 3) float64
        In the units of the shape. Sheets that meet have the same vertices at their weld.
    faces : (m, 3) int32
    thickness : (n,) float64
        Of the wall at each vertex; at a weld that of the thickest one.
    face_thickness : (m,) float64
        Of the wall that each face is in.
    sheet : (m,) int32
        The sheet of each face, the largest first.
    weld_edges : (e, 2) int32
        Edges where sheets meet.
    weld : (e,) int32
        The weld curve of each.
    lumps : tuple of Lump
        What is no wall, the largest first.
    wall_share : float or None
        Share of the volume of the solid that lies in the walls; None: the mesh is open.
    """

    points: Positions
    faces: IntArray
    thickness: FloatArray
    face_thickness: FloatArray
    sheet: IntArray
    weld_edges: IntArray
    weld: IntArray
    lumps: tuple[Lump, ...] = ()
    wall_share: float | None = None

    def __post_init__(self) -> None:
        n, m, e = len(self.points), len(self.faces), len(self.weld)
        hold(
            self,
            points=(np.float64, n, 3),
            faces=(np.int32, m, 3),
            thickness=(np.float64, n),
            face_thickness=(np.float64, m),
            sheet=(np.int32, m),
            weld_edges=(np.int32, e, 2),
            weld=(np.int32, e),
        )

    @property
    def sheets(self) -> int:
        """How many sheets there are."""
        return int(self.sheet.max(initial=-1)) + 1

    @property
    def welds(self) -> int:
        """How many curves there are at which sheets meet."""
        return int(self.weld.max(initial=-1)) + 1

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Area of each face, (m,)."""
        a, b, c = (self.points[self.faces[:, j]] for j in range(3))
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    def of_sheet(self, number: int) -> dict[str, float | int]:
        """Return area, number of faces, and mean, smallest and largest thickness of one sheet."""
        mine = self.sheet == number
        area, values = self.areas[mine], self.face_thickness[mine]
        return {
            "sheet": number,
            "area": float(area.sum()),
            "faces": int(mine.sum()),
            "thickness_mean": float((area * values).sum() / max(float(area.sum()), 1e-300)),
            "thickness_min": float(values.min()),
            "thickness_max": float(values.max()),
        }
