"""Balls for programs that keep robots clear of things: JSON, and collision elements of URDF."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np

from medialis.errors import InvalidOptionError
from medialis.files._files import complete_file
from medialis.model.medial_mesh import BallCover
from medialis.units import METERS

ENDINGS = (".json", ".urdf")


def write_ball_cover(
    path: str | os.PathLike[str], cover: BallCover, *, unit: str | None = None
) -> None:
    """Write the balls that cover a shape, as JSON or as a link of URDF.

    Parameters
    ----------
    path : path
        Ends in .json (a list of balls, each with its center and radius, and the excess volume
        where it is known) or
        .urdf (a robot of one link with a collision element for each ball).
    cover : BallCover
    unit : str, optional
        What one unit of the shape is, as "mm"; lengths are written in metres then, else as they
        are.

    Raises
    ------
    InvalidOptionError
        For another ending, and for a unit that is not known.
    FileError
        When the file cannot be written.

    See Also
    --------
    ball_cover : makes the balls.

    Examples
    --------
    >>> import json
    >>> import tempfile
    >>> import medialis
    >>> shape = medialis.organic_shape(56)
    >>> cover = medialis.ball_cover(medialis.medial_mesh(shape, balls=12), shape)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_ball_cover(f"{folder}/balls.json", cover)
    ...     with open(f"{folder}/balls.json") as stream:
    ...         len(json.load(stream)["spheres"]) == len(cover)
    True
    """
    name = Path(path)
    ending = name.suffix.lower()
    if ending not in ENDINGS:
        raise InvalidOptionError(f"Balls are written as .json or .urdf, got {name.name!r}.")
    if unit is not None and unit not in METERS:
        raise InvalidOptionError(f"unit must be one of {', '.join(METERS)}, got {unit!r}.")
    scale = METERS[unit] if unit else 1.0
    balls = scale * np.column_stack([cover.centers, cover.radii])
    text = _json(balls, cover.excess) if ending == ".json" else _urdf(balls, name.stem)
    with complete_file(name) as stream:
        stream.write(text.encode("utf-8"))


def _json(balls: np.ndarray, excess: float) -> str:
    spheres = [{"center": ball[:3], "radius": ball[3]} for ball in balls.tolist()]
    known = {"excess_volume": excess} if math.isfinite(excess) else {}
    return json.dumps({"spheres": spheres, **known}, indent=1) + "\n"


def _urdf(balls: np.ndarray, name: str) -> str:
    from xml.sax.saxutils import quoteattr

    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(name)}>", '  <link name="body">']
    for x, y, z, radius in balls.tolist():
        lines += [
            "    <collision>",
            f'      <origin xyz="{x!r} {y!r} {z!r}" rpy="0 0 0"/>',
            f'      <geometry><sphere radius="{radius!r}"/></geometry>',
            "    </collision>",
        ]
    return "\n".join([*lines, "  </link>", "</robot>", ""])
