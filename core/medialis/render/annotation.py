"""Titles, colour bars, label keys and contact sheets."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.errors import InvalidOptionError, InvalidShapeError
from medialis.render.colors import MISSING, color_table, label_colors
from medialis.render.font import draw_text, text_ink
from medialis.validation import as_whole_number

Image = NDArray[np.uint8]
MAX_KEYS = 24
"""Labels that a key lists; it says how many more there are."""


@dataclass(frozen=True)
class ColorBar:
    """A colour scale from `low` to `high`; `missing` adds the grey of NaN."""

    label: str
    cmap: str
    low: float
    high: float
    missing: bool = False


@dataclass(frozen=True, eq=False)
class LabelKey:
    """The colours of labels; `names[i]` is the text of label i."""

    label: str
    labels: NDArray[Any]
    names: Sequence[str] | None = None


def number_text(value: float) -> str:
    """Return a number with three significant digits, short and plain.

    Examples
    --------
    >>> [number_text(x) for x in (0.0, 0.012345, 1.5, 12345.0, 2e-7, 1.0)]
    ['0', '0.0123', '1.5', '12300', '2e-7', '1']
    """
    if value == 0:
        return "0"
    rounded = float(f"{value:.3g}")
    if 1e-3 <= abs(rounded) < 1e6:
        text = f"{rounded:.6f}"
        return text.rstrip("0").rstrip(".")
    mantissa, exponent = f"{rounded:.2e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


def text_size(height: int) -> int:
    """Return the height in pixels of a capital in a picture of this height."""
    return int(min(max(height / 58, 7), 40))


def title_height(height: int) -> int:
    """Return the rows that a title takes."""
    return 4 * text_size(height)


def draw_title(image: Image, title: str) -> None:
    """Write a title in the middle of the top rows; a long one is written smaller."""
    size = 1.25 * text_size(len(image))
    width = text_ink(title, size).shape[1]
    size = min(size, size * 0.96 * image.shape[1] / max(width, 1))
    row = round(1.4 * text_size(len(image)))
    draw_text(image, title, row, image.shape[1] // 2, size, anchor="middle")


def _lines(key: ColorBar | LabelKey) -> tuple[list[str], list[str]]:
    """Return the wrapped heading and the texts of the entries."""
    heading = textwrap.wrap(key.label, 15) or [""]
    if isinstance(key, ColorBar):
        numbers = [key.high, (key.low / 2 + key.high / 2), key.low]
        return heading, [number_text(x) for x in numbers] + ["no value"] * key.missing
    entries = []
    for label in key.labels[:MAX_KEYS].tolist():
        named = key.names is not None and 0 <= label < len(key.names)
        text = str(key.names[label]) if named and key.names is not None else str(label)
        entries.append("none" if label < 0 else text)
    if len(key.labels) > MAX_KEYS:
        entries.append(f"+ {len(key.labels) - MAX_KEYS} more")
    return heading, entries


def legend_width(key: ColorBar | LabelKey, width: int, height: int) -> int:
    """Return the columns that a legend takes at the right of a picture.

    Raises
    ------
    InvalidOptionError
        When that is more than half of the picture.
    """
    size = text_size(height)
    heading, entries = _lines(key)
    text = max(text_ink(line, size).shape[1] for line in heading)
    inner = max(text_ink(line, size).shape[1] for line in [*entries, ""]) + 3 * size
    columns = max(text, inner) + 3 * size
    if columns > width / 2:
        raise InvalidOptionError(
            f"The legend needs {columns} of the {width} columns: use a wider picture or a shorter "
            "legend text."
        )
    return columns


def draw_legend(image: Image, key: ColorBar | LabelKey, *, left: int, top: int) -> None:
    """Draw a legend into the columns from `left` on, below the row `top`, centered in height."""
    size = text_size(len(image))
    heading, entries = _lines(key)
    left += size
    head = round(1.9 * size) * len(heading) + round(0.6 * size)
    room = len(image) - top - 4 * size - head
    if isinstance(key, ColorBar):
        body = min(max(room, 4 * size), 20 * size) - 3 * size * key.missing
    else:
        body = min(round(2.1 * size), max(room // max(len(entries), 1), 4)) * len(entries)
    start = top + max((len(image) - top - head - body) // 2, size)
    for number, line in enumerate(heading):
        draw_text(image, line, start + round(1.9 * size) * number, left, size)
    start += head
    if isinstance(key, ColorBar):
        _draw_bar(image, key, entries, start, left, body, size)
    else:
        _draw_keys(image, key, entries, start, left, body, size)


def _draw_bar(
    image: Image, key: ColorBar, entries: list[str], top: int, left: int, rows: int, size: int
) -> None:
    width = round(1.6 * size)
    table = color_table(key.cmap)
    place = np.linspace(len(table) - 1, 0, rows).astype(np.int64)
    _box(image, top, left, rows, width, np.rint(255 * table[place])[:, None])
    for text, share in zip(entries[:3], (0.0, 0.5, 1.0), strict=True):
        row = round(top + share * (rows - 1))
        image[row : row + 1, left + width : left + width + size // 3] = 60
        draw_text(image, text, row - size // 2, left + width + round(0.8 * size), size)
    if key.missing:
        top += rows + round(1.4 * size)
        _box(image, top, left, width, width, np.rint(255 * np.array(MISSING)))
        row = top + (width - size) // 2
        draw_text(image, entries[3], row, left + width + round(0.8 * size), size)


def _draw_keys(
    image: Image, key: LabelKey, entries: list[str], top: int, left: int, rows: int, size: int
) -> None:
    colors = np.rint(255 * label_colors(key.labels[:MAX_KEYS]))
    pitch = rows // max(len(entries), 1)
    swatch = max(round(0.7 * pitch), 3)
    letters = min(size, 0.62 * pitch)
    for number, text in enumerate(entries):
        row = top + number * pitch
        if number < len(colors):
            _box(image, row, left, swatch, swatch, colors[number])
        middle = round(row + swatch / 2 - letters / 2)
        draw_text(image, text, middle, left + swatch + round(0.7 * size), letters)


def _box(
    image: Image, top: int, left: int, rows: int, columns: int, fill: NDArray[np.float64]
) -> None:
    area = image[top : top + rows, left : left + columns]
    if area.size:
        fill = fill if fill.ndim == 1 else fill[: len(area)]
        area[...] = np.broadcast_to(fill, area.shape).astype(np.uint8)
        area[[0, -1]] = 60
        area[:, [0, -1]] = 60


def contact_sheet(
    images: Sequence[ArrayLike], captions: Sequence[str] | None = None, columns: int = 4
) -> Image:
    """Return one picture of several (h, w, 3) uint8 images in rows, each with its caption below.

    Cells have the size of the largest image; smaller ones are centered. The gaps are white.

    Raises
    ------
    InvalidShapeError
        When there is no image or one is not (h, w, 3) uint8.
    InvalidOptionError
        When there is not one caption for each image.

    Examples
    --------
    >>> sheet = contact_sheet([np.zeros((60, 80, 3), np.uint8)] * 3, ["a", "b", "c"], columns=2)
    >>> sheet.shape[1]
    184
    """
    pictures = [np.asarray(image) for image in images]
    columns = as_whole_number(columns, "columns", low=1, high=1000)
    if not pictures:
        raise InvalidShapeError("A contact sheet needs at least one image.")
    for picture in pictures:
        if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
            raise InvalidShapeError(
                f"images must be (h, w, 3) uint8, got {picture.shape} {picture.dtype}."
            )
    texts = [""] * len(pictures) if captions is None else [str(text) for text in captions]
    if len(texts) != len(pictures):
        raise InvalidOptionError(f"{len(pictures)} images need as many captions, got {len(texts)}.")
    columns = min(columns, len(pictures))
    high, wide = (max(picture.shape[axis] for picture in pictures) for axis in (0, 1))
    gap, size = 8, max(text_size(high), 8)
    below = round(2.4 * size) if any(texts) else 0
    rows = -(-len(pictures) // columns)
    cell_h, cell_w = high + below + gap, wide + gap
    sheet = np.full((rows * cell_h + gap, columns * cell_w + gap, 3), 255, np.uint8)
    for number, (picture, text) in enumerate(zip(pictures, texts, strict=True)):
        top, left = gap + number // columns * cell_h, gap + number % columns * cell_w
        row, col = top + (high - len(picture)) // 2, left + (wide - picture.shape[1]) // 2
        sheet[row : row + len(picture), col : col + picture.shape[1]] = picture
        width = text_ink(text, size).shape[1]
        letters = min(size, size * wide / max(width, 1))
        middle = round(top + high + 0.6 * size)
        draw_text(sheet, text, middle, left + wide // 2, letters, anchor="middle")
    return sheet
