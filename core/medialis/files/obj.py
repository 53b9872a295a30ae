"""Wavefront OBJ in: vertices, polygons in every index form, vertex normals.

Strategy: each line is told apart by its first characters in numpy, the bytes of all lines of one
kind are joined, and each kind is parsed as one block of numbers.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.files._content import (
    ParsedMesh,
    blocks,
    numbers,
    numbers_by_line,
    places_of,
    replaced,
    rows_of,
    unix_lines,
    whole,
    without_comments,
)


def parse_obj(data: bytes) -> ParsedMesh:
    """Parse v, vn and f lines; colours, weights, lines, points and materials are ignored.

    Raises
    ------
    InvalidShapeError
        When there are no vertices or a line cannot be understood.
    """
    text = _plain_lines(data)
    lines = _Lines(text)
    points = _triples(lines.block(lines.vertex), "OBJ vertices (v)")
    if len(points) == 0:
        raise InvalidShapeError("the OBJ file has no vertices (no line 'v x y z').")
    vectors = _triples(lines.block(lines.normal), "OBJ normals (vn)")
    block = lines.block(lines.face)
    corners_only = replaced(rb"/[^\s]*", b"", block) if b"/" in block else block
    values, counts = numbers_by_line(corners_only, "OBJ faces (f)", keep_empty=True)
    counts = counts[:-1]  # the block ends with a line end
    defined = np.cumsum(lines.vertex)[lines.face]
    corners = _from_obj_index(values, np.repeat(defined, counts), "OBJ faces (f)")
    normals = None
    if len(vectors):
        seen = np.cumsum(lines.normal)[lines.face]
        normals = _vertex_normals(block, corners, np.repeat(seen, counts), vectors, len(points))
    return ParsedMesh(points, counts, corners, normals)


def _plain_lines(data: bytes) -> bytes:
    text = without_comments(unix_lines(data))
    if b"\\" in text:
        text = re.sub(rb"\\[ \t]*\n", b" ", text)
    if any(re.search(rb"(?m)^[ \t]+\S", block) for block in blocks(text)):
        text = replaced(rb"(?m)^[ \t]+", b"", text)
    return text.replace(b"\t", b" ") + b"\n   "


class _Lines:
    """The lines of a text by kind: boolean (lines,) masks, and the bytes of a kind."""

    def __init__(self, text: bytes) -> None:
        self.bytes = np.frombuffer(text, np.uint8)
        ends = np.flatnonzero(self.bytes == 10)
        self.start = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else np.array([0])
        self.length = np.diff(np.append(self.start, len(text) - 3))
        # The padding of three blanks at the end keeps start + 2 in range.
        first, second, third = (self.bytes[self.start + i] for i in range(3))
        blank = second <= 32
        self.vertex = (first == ord("v")) & blank
        self.normal = (first == ord("v")) & (second == ord("n")) & (third <= 32)
        self.face = (first == ord("f")) & blank

    def block(self, kind: NDArray[np.bool_]) -> bytes:
        """Return the lines of a kind with their keyword blanked out."""
        keep = np.repeat(kind, self.length)
        text = self.bytes[: len(keep)].copy()
        text[self.start[kind]] = 32
        named = self.start[kind & self.normal]
        text[named + 1] = 32
        return text[keep].tobytes()


def _triples(block: bytes, what: str) -> NDArray[np.float64]:
    values, counts = numbers_by_line(block, what)
    if (counts < 3).any():
        row = int((counts < 3).argmax())
        raise InvalidShapeError(
            f"expected at least 3 numbers in the {what}, found {counts[row]} in number {row + 1}."
        )
    return rows_of(values, counts, 3) if len(counts) else np.empty((0, 3))


def _from_obj_index(
    values: NDArray[np.float64], defined: NDArray[np.int64], what: str
) -> NDArray[np.int64]:
    """Return indices from 0: OBJ counts from 1, and negative ones back from the last defined."""
    index = whole(values, what)
    if (index == 0).any():
        raise InvalidShapeError(f"the {what} name vertex 0, but OBJ files count from 1.")
    if (index < 0).any():
        index = np.where(index < 0, index + defined, index - 1)
        if (index < 0).any():
            raise InvalidShapeError(f"the {what} count back beyond the first vertex.")
        return index
    return index - 1


def _vertex_normals(
    block: bytes,
    corners: NDArray[np.int64],
    seen: NDArray[np.int64],
    vectors: NDArray[np.float64],
    n: int,
) -> NDArray[np.float64] | None:
    """Return the sum of the normals that a vertex has at its corners (several at a sharp edge)."""
    if len(corners) == 0:
        return vectors if len(vectors) == n else None
    # From the start of a word, and no part takes a slash: a word of many slashes costs no more.
    words = places_of(rb"(?<!\S)[^\s/]+/[^\s/]*/([-+]?\d+)(?=\s)", block)
    if len(words) != len(corners):
        return None
    index = _from_obj_index(numbers(b" ".join(words), "OBJ normal indices"), seen, "OBJ normals")
    if (corners >= n).any() or (index >= len(vectors)).any():
        return None
    with np.errstate(all="ignore"):
        sums = [np.bincount(corners, weights=vectors[index, i], minlength=n) for i in range(3)]
    return np.stack(sums, axis=1)
