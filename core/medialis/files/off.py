"""OFF in: the Geomview text format with its colour, normal and texture variants."""

from __future__ import annotations

import re

import numpy as np

from medialis.errors import InvalidShapeError
from medialis.files._content import (
    ParsedMesh,
    numbers_by_line,
    ragged_rows,
    rows_of,
    unix_lines,
    whole,
    without_comments,
)

KEYWORD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF")


def parse_off(data: bytes) -> ParsedMesh:
    """Parse vertices, normals and polygons; colours and texture coordinates are ignored.

    Raises
    ------
    InvalidShapeError
        When the file is binary, four-dimensional, damaged or cut short.
    """
    text = without_comments(unix_lines(data))
    keyword = KEYWORD.match(text)
    has_normals = False
    if keyword:
        if keyword[4] or keyword[5]:
            raise InvalidShapeError("the OFF file is not three-dimensional (4OFF or nOFF).")
        has_normals = bool(keyword[3])
        text = text[keyword.end() :]
        if re.match(rb"\s*BINARY", text):
            raise InvalidShapeError("binary OFF is not supported; save it as text OFF or PLY.")
    values, words = numbers_by_line(text, "OFF data")
    if len(words) == 0 or words[0] < 2:
        raise InvalidShapeError("the OFF file does not start with its vertex and face counts.")
    n, m = (int(v) for v in whole(values[:2], "OFF counts"))
    if n < 0 or m < 0:
        raise InvalidShapeError(f"the OFF file announces {n} vertices and {m} faces.")
    starts = np.cumsum(words) - words
    found = len(words) - 1
    if found < n + m:
        raise InvalidShapeError(
            f"the file is cut short: the OFF header announces {n} vertices and {m} faces, only "
            f"{min(found, n)} vertices and {max(found - n, 0)} faces were found."
        )
    width = 6 if has_normals else 3
    if (words[1 : n + 1] < width).any():
        row = int((words[1 : n + 1] < width).argmax())
        raise InvalidShapeError(
            f"expected at least {width} numbers for each OFF vertex, vertex {row} has "
            f"{words[1 + row]}."
        )
    rows = (
        rows_of(values[starts[1] :][: words[1 : n + 1].sum()], words[1 : n + 1], width)
        if n
        else np.empty((0, width))
    )
    first = starts[n + 1 : n + 1 + m]
    counts = whole(values[first], "OFF face sizes")
    if (counts < 0).any() or (counts > words[n + 1 : n + 1 + m] - 1).any():
        row = int(((counts < 0) | (counts > words[n + 1 : n + 1 + m] - 1)).argmax())
        raise InvalidShapeError(
            f"OFF face {row} announces {counts[row]} corners, its line has "
            f"{words[n + 1 + row] - 1} numbers."
        )
    corners = whole(values[ragged_rows(first + 1, counts)], "OFF faces")
    normals = rows[:, 3:6] if has_normals else None
    return ParsedMesh(rows[:, :3], counts, corners, normals)
