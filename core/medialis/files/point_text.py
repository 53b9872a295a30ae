"""Plain text point clouds in (.xyz, .pts, .txt, .csv, .asc): one point a line, maybe a normal."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.files._content import (
    ParsedMesh,
    no_polygons,
    numbers_by_line,
    rows_of,
    shown,
    unix_lines,
    without_comments,
)
from medialis.files._viewpoints import for_each_point, said_viewpoints
from medialis.progress import Message

# A normal written with two digits is off by at most 0.01 in length; colours 0..255 are far away.
_NORMAL_SLACK = 0.02


def parse_point_text(data: bytes) -> ParsedMesh:
    """Parse x y z in the first three columns; columns 4 to 6 are normals if all have length 1 or 0.

    Columns are separated by blanks, commas or semicolons; one heading line and the point count of
    a .pts file are passed over; further columns (colour, intensity) are ignored with a message.
    Comments such as `# VIEWPOINT x y z` say where the points were seen from.

    Raises
    ------
    InvalidShapeError
        When a line is no point or there are no points.
    """
    lines = unix_lines(data)
    comments = [line.decode("latin-1") for line in re.findall(rb"(?:#|//)([^\n]*)", lines)]
    text = without_comments(without_comments(lines), b"//")
    text = text.translate(bytes.maketrans(b",;", b"  ")).lstrip()
    first, _, rest = text.partition(b"\n")
    messages: list[Message] = []
    if first and not _is_numbers(first):
        if not _is_numbers(rest.lstrip().partition(b"\n")[0]):
            raise InvalidShapeError(f"expected lines with the numbers x y z, found {shown(first)}.")
        passed = f"Passed over the heading {shown(first.strip())}."
        messages.append(Message(passed, "heading"))
        text = rest
    values, counts = numbers_by_line(text, "point list")
    if len(counts) > 1 and counts[0] == 1:
        _check_point_count(values[0], len(counts) - 1)
        values, counts = values[1:], counts[1:]
    if len(counts) == 0:
        raise InvalidShapeError("the file has no points.")
    if (counts < 3).any():
        row = int((counts < 3).argmax())
        raise InvalidShapeError(
            f"expected at least the numbers x y z for each point, point {row + 1} has "
            f"{counts[row]}."
        )
    width = int(counts.min())
    rows = rows_of(values, counts, width)
    normals = _normals(rows)
    used = 3 if normals is None else 6
    if counts.max() > used:
        more = int(counts.max()) - used
        ignored = f"Ignored {more} columns after the first {used}."
        messages.append(Message(ignored, "columns_ignored", columns=more))
    viewpoints, told = for_each_point(rows[:, :3], said_viewpoints(comments))
    messages.extend(told)
    return ParsedMesh(rows[:, :3], *no_polygons(), normals, tuple(messages), viewpoints)


def starts_with_numbers(data: bytes) -> bool:
    """Return whether the first or second line that is no comment holds only numbers."""
    text = without_comments(without_comments(unix_lines(data[:4000])), b"//")
    lines = [line for line in re.split(rb"\n+", text) if line.strip()]
    return any(_is_numbers(re.sub(rb"[,;]", b" ", line)) for line in lines[:2])


def _is_numbers(line: bytes) -> bool:
    try:
        return bool([float(word) for word in line.split()])
    except ValueError:
        return False


def _check_point_count(announced: float, found: int) -> None:
    if announced != found:
        raise InvalidShapeError(
            f"the first line announces {announced:g} points, but {found} follow."
        )


def _normals(rows: NDArray[np.float64]) -> NDArray[np.float64] | None:
    if rows.shape[1] < 6:
        return None
    with np.errstate(all="ignore"):
        length = np.linalg.norm(rows[:, 3:6], axis=1)
    unit = np.abs(length - 1) <= _NORMAL_SLACK
    missing = ~(length > 0)
    return rows[:, 3:6] if unit.any() and (unit | missing).all() else None
