"""Points as text (.xyz, .pts, .txt, .csv, .asc), one a line: of scanners and of spreadsheets.

Columns are separated by semicolons, commas, tabs or blanks; a comma may be the decimal mark. A
heading says which columns are x, y, z and the normal. Without one they are the first three, and
the next three where these are unit vectors. What can be understood in two ways is refused.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.progress import Message
from medialis.formats.files import (
    ParsedMesh,
    blocks,
    no_polygons,
    numbers_by_line,
    places_of,
    replaced,
    rows_of,
    shown,
    unix_lines,
    without_comments,
)
from medialis.formats.ply import for_each_point, said_viewpoints

NORMAL_SLACK = 0.02
"""A normal written with two digits is off by at most 0.01 in length; colours are far away."""

_AXES = {"x": 0, "y": 1, "z": 2, "0": 0, "1": 1, "2": 2}
_AXIS = r"([xyz]|(?<=[:_. ])[012])"
_POSITION = re.compile(
    rf"(?:points?|pos|position|coords?|coordinates?|p|vertex)?[ ._:]*{_AXIS}"
    r"(?:[ _]?(?:coord|coordinate|pos))?"
)
_NORMAL = re.compile(rf"(?:n|normals?)[ ._:]*{_AXIS}")
_NUMBERING = frozenset(
    (*("id", "ids", "nr", "no", "nr.", "no.", "num", "number", "index", "idx", "i", "n", "#"),
     *("point", "point id", "pointid", "point_id", "name", "label", "fid", "pt", "row"))
)  # fmt: skip
"""Names of a first column that counts points."""


class _Columns(NamedTuple):
    """Where x, y, z stand, and the normal."""

    position: tuple[int, ...]
    normal: tuple[int, ...]
    names: int


def parse_point_text(data: bytes) -> ParsedMesh:
    """Parse points, and normals where there are any.

    Further columns (colour, intensity) are ignored with a message, and so are a heading that names
    no x, y and z, and the point count of a .pts file. An empty field is NaN. Comments such as
    `# VIEWPOINT x y z` say where the points were seen from.

    Raises
    ------
    InvalidShapeError
        When a line is no point, there are no points, or it is not clear which numbers are meant.
    """
    lines = unix_lines(data)
    comments = [line.decode("latin-1") for line in re.findall(rb"(?:#|//)([^\n]*)", lines)]
    text = without_comments(without_comments(lines), b"//").lstrip(b"\n ")
    messages: list[Message] = []
    first, _, rest = text.partition(b"\n")
    heading = b""
    if first.strip() and not _is_numbers(first):
        if not _is_numbers(rest.lstrip().partition(b"\n")[0]):
            raise InvalidShapeError(f"expected lines with the numbers x y z, found {shown(first)}.")
        heading, text = first.strip(), rest
    values, counts = numbers_by_line(_plain_numbers(text), "point list")
    if len(counts) > 1 and counts[0] == 1:
        if values[0] != len(counts) - 1:
            raise InvalidShapeError(
                f"the first line announces {values[0]:g} points, but {len(counts) - 1} follow."
            )
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
    columns = _said(heading, comments, width, int(counts.max()), messages)
    if columns is None:
        columns = _Columns((0, 1, 2), (3, 4, 5) if _are_normals(rows) else (), width)
    normals = rows[:, columns.normal] if columns.normal else None
    used = 3 + len(columns.normal)
    if counts.max() > used:
        more = int(counts.max()) - used
        where = "after the first" if max(columns.position + columns.normal) < used else "beside the"
        ignored = f"Ignored {more} columns {where} {used}."
        messages.append(Message(ignored, "columns_ignored", columns=more))
    points = rows[:, columns.position]
    viewpoints, told = for_each_point(points, said_viewpoints(comments))
    messages.extend(told)
    return ParsedMesh(points, *no_polygons(), normals, tuple(messages), viewpoints)


def starts_with_numbers(data: bytes) -> bool:
    """Return whether the first or second line that is no comment holds only numbers."""
    text = without_comments(without_comments(unix_lines(data[:4000])), b"//")
    lines = [line for line in re.split(rb"\n+", text) if line.strip()]
    return any(_is_numbers(line) for line in lines[:2])


def _is_numbers(line: bytes) -> bool:
    try:
        return bool([float(word) for word in re.sub(rb"[,;]", b" ", line).split()])
    except ValueError:
        return False


def _plain_numbers(text: bytes) -> bytes:
    """Return the text with decimal points, blanks between columns and `nan` in empty fields.

    Raises
    ------
    InvalidShapeError
        When commas may be decimal marks, or group thousands, as well as separate columns.
    """
    if b";" in text:
        if b"," in text and not _has(rb",[^;\n]*,", text):  # one a field at most
            if b"." in text:
                raise InvalidShapeError(
                    "between semicolons it has commas and points: write numbers with decimal "
                    "points, and nothing between thousands."
                )
            text = text.replace(b",", b".")
        return _separated(text.replace(b",", b";") if b"," in text else text, b";")
    if b"," in text:
        words = max((len(line.split()) for line in text[:4000].split(b"\n")[:10]), default=0)
        if words >= 3 and not _has(rb",(?=[,\s]|$)|(?:(?<=\s)|^),|,[^,\s]*,", text):
            if b"." in text:
                raise InvalidShapeError(
                    "its numbers have commas and points: write them with decimal points, and "
                    "nothing between thousands."
                )
            return text.replace(b",", b".")
        return _separated(text, b",")
    if b"\t\t" in text:  # empty fields, where lines have as many tabs, but not as many words
        lines = [line for line in text.split(b"\n") if line.strip()]
        tabs, words_of = ({f(line) for line in lines} for f in (_tabs, _words))
        if len(tabs) == 1 and len(words_of) > 1:
            return _separated(text, b"\t")
    return text


def _tabs(line: bytes) -> int:
    return line.count(b"\t")


def _words(line: bytes) -> int:
    return len(line.split())


def _has(pattern: bytes, text: bytes) -> bool:
    """Return whether a pattern is found within a line."""
    return any(re.search(pattern, block) for block in blocks(text))


def _separated(text: bytes, mark: bytes) -> bytes:
    """Return the text with blanks for the marks between columns; an empty field becomes `nan`.

    A mark at the end of lines separates nothing, unless only some lines have it there.
    """
    text = replaced(rb"(?m)(?:^|(?<=%b))[ \t]*?(?=%b)" % (mark, mark), b" nan ", text)
    at_end = len(places_of(rb"(?m)%b[ ]*$" % mark, text))
    if at_end:
        counts = {line.count(mark) for line in text.split(b"\n") if line.strip()}
        all_lines = sum(1 for line in text.split(b"\n") if line.strip())
        if at_end < all_lines and len(counts) == 1:
            text = replaced(rb"(?m)%b[ ]*$" % mark, mark + b" nan", text)
    return text.replace(mark, b" ")


def _said(
    heading: bytes, comments: list[str], width: int, most: int, messages: list[Message]
) -> _Columns | None:
    """Return the columns that a heading names, or the last comment does; None where none does.

    Raises
    ------
    InvalidShapeError
        When the heading names too few columns, or says that the first ones are no positions.
    """
    if not heading:
        for line in comments[::-1]:
            found = _named(_names(line))
            if found is not None and found.names == width == most:
                return found
        return None
    text = heading.decode("latin-1")
    names = _names(text)
    found = _named(names)
    if found is None:
        if _known(names) or (names[0] in _NUMBERING and most > 3):
            raise InvalidShapeError(
                f"its heading {shown(heading)} does not say which columns are x, y and z: "
                "name them so."
            )
        messages.append(Message(f"Passed over the heading {shown(heading)}.", "heading"))
        return None
    if not found.names == width:
        raise InvalidShapeError(
            f"its heading names {found.names} columns, but its lines have "
            f"{width if width == most else f'{width} to {most}'} numbers."
        )
    messages.append(Message(f"Columns as the heading says: {shown(heading)}.", "heading"))
    return found


def _names(heading: str) -> list[str]:
    """Return the names of columns, without units and quotes."""
    bare = re.sub(r"[\[(][^\])]*[\])]", "", heading)
    mark = next((mark for mark in ";,\t" if mark in bare.strip()), None)
    words = bare.strip().removesuffix(mark or "\0").split(mark)
    return [word.strip(" \t\"'").lower() for word in words]


def _known(names: list[str]) -> bool:
    """Return whether some name is that of a coordinate."""
    return any(_POSITION.fullmatch(name) for name in names)


def _named(names: list[str]) -> _Columns | None:
    """Return which columns are x, y, z and the normal; None where these names are not all there."""
    places: dict[tuple[str, int], int] = {}
    for row, name in enumerate(names):
        for kind, pattern in (("position", _POSITION), ("normal", _NORMAL)):
            if match := pattern.fullmatch(name):
                places.setdefault((kind, _AXES[match[1]]), row)
    position = tuple(places.get(("position", axis), -1) for axis in range(3))
    normal = tuple(places.get(("normal", axis), -1) for axis in range(3))
    if min(position) < 0:
        return None
    return _Columns(position, normal if min(normal) >= 0 else (), len(names))


def _are_normals(rows: NDArray[np.float64]) -> bool:
    """Return whether columns 4 to 6 are unit vectors, or zero, which is none."""
    if rows.shape[1] < 6:
        return False
    with np.errstate(all="ignore"):
        length = np.linalg.norm(rows[:, 3:6], axis=1)
    unit = np.abs(length - 1) <= NORMAL_SLACK
    return bool(unit.any() and (unit | ~(length > 0)).all())
