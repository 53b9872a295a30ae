"""Medial meshes as MA files, the text form that programs for medial meshes share.

The first line counts vertices, edges and triangles; then come ``v x y z r``, ``e i j`` and
``f i j k``, counted from 0. Some programs write more numbers behind them, more lines, or leave
edges of triangles out. MATFP ends rows with a type and with a 1 where they were deleted; deleted
balls stay in the file, so that numbers still mean the same.
"""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.files._files import complete_file, number_lines, reading
from medialis.model.medial_mesh import MedialMesh

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


def _simplices(
    rows: list[list[float]], deleted: list[bool], width: int, number: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the edges or triangles between balls that are there, in their numbers."""
    found = np.array(rows, np.float64).reshape(-1, width)
    count = len(number)
    if found.size and not ((found >= 0) & (found < count) & (found == np.rint(found))).all():
        raise InvalidShapeError(f"its edges and triangles must name balls from 0 to {count - 1}.")
    known = number[found[~np.array(deleted, bool)].astype(np.int64)]
    return known[(known >= 0).all(axis=1)]
