"""Layers in the formats that they name besides PLY: triangles for other programs, balls for robots.

``obj`` and ``glb`` hold triangles, ``ma`` a medial mesh, ``json`` and ``urdf`` balls.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidOptionError
from medialis.files._files import complete_file
from medialis.files.gltf import write_gltf
from medialis.files.ma import write_ma
from medialis.files.robots import write_ball_cover
from medialis.model.medial_mesh import BallCover, MedialMesh
from medialis.model.surface import Surface
from medialis.validation import FloatArray


class Content:
    """What a file is made of.

    Parameters
    ----------
    points : (p, 3) float64
    faces : (m, 3) int32 or None
    edges : (e, 2) int32 or None
    attributes : dict
        Those of points; balls have their `radius` here.
    facts : dict
        Numbers that belong to all of it.
    unit : str or None
        What one unit of the points is.
    """

    def __init__(
        self,
        points: FloatArray,
        faces: NDArray[np.int32] | None,
        edges: NDArray[np.int32] | None,
        attributes: Mapping[str, NDArray[Any]],
        facts: Mapping[str, float],
        unit: str | None,
    ) -> None:
        self.points, self.attributes, self.facts, self.unit = points, attributes, facts, unit
        self.faces = np.zeros((0, 3), np.int32) if faces is None else faces
        self.edges = np.zeros((0, 2), np.int32) if edges is None else edges

    @property
    def radii(self) -> FloatArray:
        """Of the balls; negative ones, which a host may have made, count as 0.

        Raises
        ------
        InvalidOptionError
            When the points have none.
        """
        if "radius" not in self.attributes:
            raise InvalidOptionError("The points have no attribute radius: they are no balls.")
        return np.maximum(np.asarray(self.attributes["radius"], np.float64), 0.0)

    @property
    def surface(self) -> Surface:
        """The triangles.

        Raises
        ------
        InvalidOptionError
            When there are none.
        """
        if not len(self.faces):
            raise InvalidOptionError("There are no triangles to write.")
        return Surface(self.points, self.faces)

    @property
    def mesh(self) -> MedialMesh:
        """The balls, their edges and triangles."""
        balls = np.column_stack([self.points, self.radii])
        return MedialMesh.of_rows(balls, self.edges, self.faces)  # type: ignore[arg-type]


def write_content(path: str | os.PathLike[str], content: Content) -> None:
    """Write a file in the format that its ending names.

    Raises
    ------
    InvalidOptionError
        For another ending, and where the content has not what the format is for.
    FileError
        When the file cannot be written.
    """
    name = Path(path)
    ending = name.suffix.lower().removeprefix(".")
    if ending not in _WRITERS:
        raise InvalidOptionError(f"Files end in {', '.join(_WRITERS)}, got {name.name!r}.")
    _WRITERS[ending](name, content)


def _write_obj(path: Path, content: Content) -> None:
    surface = content.surface
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in surface.points.tolist()]
    assert surface.faces is not None
    lines += [f"f {a} {b} {c}" for a, b, c in (surface.faces + 1).tolist()]
    with complete_file(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode("ascii"))


def _write_glb(path: Path, content: Content) -> None:
    write_gltf(path, content.surface, path.stem, unit=content.unit)


def _write_ma(path: Path, content: Content) -> None:
    write_ma(path, content.mesh)


def _write_balls(path: Path, content: Content) -> None:
    excess = float(content.facts.get("excess_volume", np.nan))
    cover = BallCover(content.points, content.radii, excess)
    write_ball_cover(path, cover, unit=content.unit)


_WRITERS: dict[str, Callable[[Path, Content], None]] = {
    "obj": _write_obj,
    "glb": _write_glb,
    "ma": _write_ma,
    "json": _write_balls,
    "urdf": _write_balls,
}
