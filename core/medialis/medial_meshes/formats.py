"""Medial meshes as MA files, the text form that programs for medial meshes share.

The first line counts vertices, edges and triangles; then come ``v x y z r``, ``e i j`` and
``f i j k``, counted from 0. Some programs write more numbers behind them, more lines, or leave
edges of triangles out. MATFP ends rows with a type and with a 1 where they were deleted; deleted
balls stay in the file, so that numbers still mean the same.

Balls alone are for programs that keep robots clear of things: JSON, and collision elements of URDF.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np

from medialis.base.arrays import Index
from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.options import METERS
from medialis.formats.files import complete_file, number_lines, reading
from medialis.medial_meshes.mesh import BallCover, MedialMesh
from medialis.operations.declaration import Format
from medialis.operations.result import Layer

WIDTHS = {"v": 4, "e": 2, "f": 3}
FLAGGED = {"v": 6, "e": 4, "f": 4}
"""Numbers of a row that ends with whether it was deleted."""


def write_ma(path: str | os.PathLike[str], mesh: MedialMesh, *, flags: bool = False) -> None:
    """Write a medial mesh as an MA file, with all digits.

    Parameters
    ----------
    path : path
    mesh : MedialMesh
    flags : bool
        Write what MATFP wants behind balls and edges: a type, and that no ball was deleted. Q-MAT
        and importers for Blender read files without.

    Raises
    ------
    FileError
        When the file cannot be written.

    See Also
    --------
    read_ma : reads it back.

    Examples
    --------
    >>> import tempfile
    >>> import medialis
    >>> mesh = medialis.MedialMesh([[0, 0, 0], [1, 0, 0]], [0.5, 0.25], [[0, 1]], [])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     medialis.write_ma(f"{folder}/capsule.ma", mesh)
    ...     medialis.read_ma(f"{folder}/capsule.ma").radii.tolist()
    [0.5, 0.25]
    """
    with complete_file(path) as stream:
        stream.write(_text(mesh, flags).encode("ascii"))


def _text(mesh: MedialMesh, flags: bool) -> str:
    lines = [f"{len(mesh)} {len(mesh.edges)} {len(mesh.faces)}"]
    balls = np.column_stack([mesh.centers, mesh.radii])
    for word, rows, flag in (("v", balls, "0 0"), ("e", mesh.edges, "0"), ("f", mesh.faces, "")):
        behind = [flag] if flags and flag else []
        lines += [" ".join([word, *map(repr, row), *behind]) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def read_ma(path: str | os.PathLike[str]) -> MedialMesh:
    """Read a medial mesh from an MA file, of this or of another program.

    Parameters
    ----------
    path : path

    Returns
    -------
    MedialMesh
        Sides of triangles that the file has no edge for are added; edges and triangles that it
        names twice, or with equal ends, are there once or not at all.

    Raises
    ------
    FileError
        When the file is missing or cannot be read.
    InvalidShapeError
        When its content is no medial mesh.

    See Also
    --------
    write_ma : writes such files.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import medialis
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "triangle.ma"
    ...     text = "3 0 1;v 0 0 0 1;v 3 0 0 1;v 0 3 0 1;f 0 1 2"
    ...     _ = path.write_text(text.replace(";", chr(10)))
    ...     len(medialis.read_ma(path).edges)
    3
    """
    name = os.fspath(path)
    with reading(name):
        rows: dict[str, list[list[float]]] = {word: [] for word in WIDTHS}
        deleted: dict[str, list[bool]] = {word: [] for word in WIDTHS}
        said = 0
        for number, text, words in number_lines(name):
            kind = words[0]
            if kind in WIDTHS:
                rows[kind].append(_numbers(number, text, words[1:], WIDTHS[kind]))
                deleted[kind].append(len(words) - 1 == FLAGGED[kind] and words[-1] == "1")
            elif not said and kind.lstrip("+-").isdigit():
                said = int(kind)
        return _mesh(rows, deleted, said)


def _numbers(number: int, text: str, words: list[str], width: int) -> list[float]:
    if len(words) < width:
        raise InvalidShapeError(f"line {number} has {len(words)} of {width} numbers: {text!r}.")
    return [float(word) for word in words[:width]]


def _mesh(
    rows: dict[str, list[list[float]]], deleted: dict[str, list[bool]], said: int
) -> MedialMesh:
    balls = np.array(rows["v"], np.float64).reshape(-1, 4)
    if len(balls) == 0:
        raise InvalidShapeError("it has no balls (lines v x y z r).")
    if said > len(balls):
        raise InvalidShapeError(f"it has {len(balls)} balls and says {said}: it was cut off.")
    kept = ~np.array(deleted["v"], bool)
    if not kept.any():
        raise InvalidShapeError("all its balls are marked as deleted.")
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    edges, faces = (
        _simplices(rows[word], deleted[word], WIDTHS[word], number) for word in ("e", "f")
    )
    return MedialMesh.of_rows(balls[kept], edges, faces)


def _simplices(rows: list[list[float]], deleted: list[bool], width: int, number: Index) -> Index:
    """Return the edges or triangles between balls that are there, in their numbers."""
    found = np.array(rows, np.float64).reshape(-1, width)
    count = len(number)
    if found.size and not ((found >= 0) & (found < count) & (found == np.rint(found))).all():
        raise InvalidShapeError(f"its edges and triangles must name balls from 0 to {count - 1}.")
    known = number[found[~np.array(deleted, bool)].astype(np.int64)]
    return known[(known >= 0).all(axis=1)]


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


def mesh_of(layer: Layer) -> MedialMesh:
    """Return the balls of a layer with their edges and triangles.

    Raises
    ------
    InvalidOptionError
        When its points have no radius. Negative ones, which a host may have made, count as 0.
    """
    if "radius" not in layer.attributes:
        raise InvalidOptionError("The points have no attribute radius: they are no balls.")
    radii = np.maximum(np.asarray(layer.attributes["radius"], np.float64), 0.0)
    none = np.zeros((0, 3), np.int64)
    edges = none[:, :2] if layer.edges is None else layer.edges.astype(np.int64)
    faces = none if layer.faces is None else layer.faces.astype(np.int64)
    return MedialMesh.of_rows(np.column_stack([layer.points, radii]), edges, faces)


def _write_mesh(path: Path, layer: Layer, unit: str | None) -> None:
    write_ma(path, mesh_of(layer))


def _write_balls(path: Path, layer: Layer, unit: str | None) -> None:
    mesh, excess = mesh_of(layer), float(layer.facts.get("excess_volume", np.nan))
    write_ball_cover(path, BallCover(mesh.centers, mesh.radii, excess), unit=unit)


BALL_FORMATS = (
    Format("ma", _write_mesh),
    Format("json", _write_balls),
    Format("urdf", _write_balls),
)
"""Of layers of balls: a medial mesh, and balls for robots."""
