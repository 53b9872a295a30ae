"""Text, titles, colour bars, label keys and contact sheets.

Letters are those of DejaVu Sans, as tables of distances to their outlines: that gives smooth text
of any size, and a light rim round it that keeps it readable on dark pages. ``docs/make_font.py``
makes the tables. Characters that they lack are shown as a box.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidOptionError, InvalidShapeError
from medialis.base.validation import FloatArray, as_whole_number, frozen
from medialis.show.colors import MISSING, color_table, label_colors, limit_colors

CAP, REACH = 28, 4
"""Pixels of a capital's height in the tables, and the largest distance that they store."""

UNKNOWN = "□"
RIM = 0.11
"""Width of the light rim round letters, as a fraction of a capital's height."""


@dataclass(frozen=True, eq=False)
class _Tables:
    place: dict[str, int]
    advances: NDArray[np.float32]
    starts: NDArray[np.int32]
    distances: NDArray[np.uint8]
    baseline: int


@lru_cache(maxsize=1)
def _tables() -> _Tables:
    with np.load(Path(__file__).with_name("font.npz")) as tables:
        data = dict(tables)
    place = {chr(code): number for number, code in enumerate(data.pop("codes").tolist())}
    return _Tables(place, baseline=int(data.pop("baseline")), **data)


def _numbers(text: str) -> list[int]:
    """Return the numbers of the characters in the tables."""
    place = _tables().place
    return [place.get(character, place[UNKNOWN]) for character in text]


@lru_cache(maxsize=4096)
def _glyph(number: int, scale: float, shift: float) -> FloatArray:
    """Return distances to the outline in pixels, positive inside; `shift` moves it to the right."""
    tables = _tables()
    table = tables.distances[:, tables.starts[number] : tables.starts[number + 1]]
    rows, columns = (int(np.ceil(size * scale)) + 1 for size in table.shape)
    # The middle of the pixel r is at r + 1/2, in the table at (r + 1/2) / scale.
    row = (np.arange(rows) + 0.5) / scale - 0.5
    column = (np.arange(columns) + 0.5 - shift) / scale - 0.5
    stored = _between(_between(table.astype(np.float64), row).T, column).T
    return frozen((stored - 128) / 127 * REACH * scale, np.float64)


def _between(table: FloatArray, at: NDArray[np.floating]) -> FloatArray:
    """Return a table at places between its rows; 0 beyond them."""
    padded = np.pad(table, ((1, 2), (0, 0)))
    at = np.clip(at, -1.0, len(table)) + 1.0
    row = np.floor(at).astype(np.int64)
    share = (at - row)[:, None]
    return np.asarray((1.0 - share) * padded[row] + share * padded[row + 1])


def text_width(text: str, size: float) -> int:
    """Return the columns that a line of text takes whose capitals are `size` pixels high."""
    return int(np.ceil(float(_tables().advances[_numbers(text)].sum()) * size / CAP))


def draw_text(
    image: NDArray[np.uint8],
    text: str,
    row: float,
    col: float,
    size: float,
    *,
    anchor: str = "left",
) -> None:
    """Write a line of text into an image (h, w, 3 or 4) in place; what sticks out is cut off.

    `row` is the top of the capitals, `size` their height; `col` the left end, middle or right end,
    as `anchor` says. On a see-through image the letters get a light rim.
    """
    tables, scale = _tables(), size / CAP
    width = text_width(text, size)
    place = col - {"left": 0.0, "middle": width / 2, "right": float(width)}[anchor]
    outside = np.full((round((tables.distances.shape[0] + 1) * scale) + 2, width), -np.inf)
    pad = int(np.ceil(REACH * scale)) + 1
    away = np.pad(outside, ((0, 0), (pad, pad + 2)), constant_values=-np.inf)
    at = place - np.floor(place) + pad - REACH * scale
    for number in _numbers(text):
        glyph = _glyph(number, scale, round(4 * (at % 1.0)) / 4)
        left = int(np.floor(at))
        part = away[: len(glyph), left : left + glyph.shape[1]]
        np.maximum(part, glyph[: len(part), : part.shape[1]], out=part)
        at += float(tables.advances[number]) * scale
    top = round(row + size - tables.baseline * scale)
    _blend(image, away, top, int(np.floor(place)) - pad, size)


def _blend(
    image: NDArray[np.uint8],
    away: FloatArray,
    top: int,
    left: int,
    size: float,
) -> None:
    """Lay the letters, and below them their rim where the image is see-through, over the image."""
    height, width = image.shape[:2]
    rows = slice(max(top, 0), min(top + away.shape[0], height))
    columns = slice(max(left, 0), min(left + away.shape[1], width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return
    away = away[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    area = image[rows, columns].astype(np.float64)
    if image.shape[2] == 4:
        rim = np.clip(away + 0.5 + max(RIM * size, 1.0), 0.0, 1.0)
        over(area, np.array([255.0, 255.0, 255.0]), 0.85 * rim)
    over(area, INK, np.clip(away + 0.5, 0.0, 1.0))
    image[rows, columns] = np.rint(area).astype(np.uint8)


def over(area: FloatArray, color: FloatArray, cover: FloatArray) -> None:
    """Lay a colour with the given cover 0..1 over an area (h, w, 3 or 4) in place."""
    cover = cover[..., None]
    below = np.ones_like(cover) if area.shape[2] == 3 else area[..., 3:] / 255
    total = cover + below * (1 - cover)
    share = np.divide(cover, total, out=np.zeros_like(cover), where=total > 0)
    area[..., :3] += (color - area[..., :3]) * share
    if area.shape[2] == 4:
        area[..., 3:] = 255 * total


Image = NDArray[np.uint8]
MAX_KEYS = 24
"""Labels that a key lists; it says how many more there are."""

BAR_STEPS = 5
"""Round numbers that a colour bar shows between its ends, at most."""

INK, _DARK = np.array([35.0, 38.0, 45.0]), np.array([60.0, 60.0, 60.0])


@dataclass(frozen=True)
class ColorBar:
    """A colour scale from `low` to `high`; `missing` adds the grey of NaN.

    A `limit` has colours of its own (`limit_colors`) and its number. With `whole`, only integers
    are labelled between the ends.
    """

    label: str
    cmap: str
    low: float
    high: float
    missing: bool = False
    limit: float | None = None
    whole: bool = False

    @property
    def numbers(self) -> list[float]:
        """Numbers at the scale, those that must have room first."""
        marks = [self.low, self.high] if self.limit is None else [self.limit, self.low, self.high]
        steps = round_steps(self.low, self.high, BAR_STEPS)
        return [*marks, *(x for x in steps if x.is_integer() or not self.whole)]

    def text(self, number: float) -> str:
        """Return what stands at a number."""
        more = " limit" if number == self.limit else ""
        return number_text(number) + more

    def colors(self, count: int) -> FloatArray:
        """Return sRGB colours of the scale, the highest first."""
        if self.limit is None:
            table = color_table(self.cmap)
            return table[np.linspace(len(table) - 1, 0, count).astype(np.int64)]
        return limit_colors(np.linspace(self.high, self.low, count), self.limit)


@dataclass(frozen=True, eq=False)
class LabelKey:
    """The colours of labels; `names[i]` is the text of label i, `palette[i]` its own colour."""

    label: str
    labels: NDArray[Any]
    names: Sequence[str] | None = None
    palette: ArrayLike | None = None


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


def text_size(width: int, height: int) -> int:
    """Return the height in pixels of a capital in a picture of this size.

    On a phone, where the picture is some 390 points wide, letters are then as large as small print.
    """
    return int(min(max(width / 48, 7), max(height / 22, 7), 80))


def title_height(size: int) -> int:
    """Return the rows that a title takes above a picture whose text has this size."""
    return 3 * size


def draw_title(image: Image, title: str, size: int) -> None:
    """Write a title in the middle of the top rows; a long one is written smaller."""
    width = max(text_width(title, 1.2 * size), 1)
    letters = min(1.2 * size, 1.2 * size * 0.96 * image.shape[1] / width)
    draw_text(image, title, 0.9 * size, image.shape[1] / 2, letters, anchor="middle")


def round_steps(low: float, high: float, most: int) -> list[float]:
    """Return at most `most` round numbers strictly between two numbers, evenly spaced.

    Examples
    --------
    >>> round_steps(0.0412, 0.294, 5)
    [0.05, 0.1, 0.15, 0.2, 0.25]
    """
    if not (np.isfinite([low, high]).all() and high > low):
        return []
    step = 10.0 ** np.floor(np.log10((high - low) / (most + 1)))
    for factor in (1, 2, 5, 10, 20, 50, 100):
        first = np.floor(low / (factor * step)) + 1
        count = int(np.ceil(high / (factor * step)) - first)
        if count <= most:
            return [float(f"{(first + k) * factor * step:.12g}") for k in range(count)]
    return []


def _lines(key: ColorBar | LabelKey) -> tuple[list[str], list[str]]:
    """Return the wrapped heading and the texts of the entries."""
    heading = textwrap.wrap(key.label, 17) or [""]
    if isinstance(key, ColorBar):
        return heading, [key.text(x) for x in key.numbers] + ["no value"] * key.missing
    named = dict(enumerate(map(str, key.names or ())))
    labels = key.labels[:MAX_KEYS].tolist()
    entries = ["none" if label < 0 else named.get(label, str(label)) for label in labels]
    if len(key.labels) > MAX_KEYS:
        entries.append(f"+ {len(key.labels) - MAX_KEYS} more")
    return heading, entries


def legend_size(key: ColorBar | LabelKey, size: int) -> tuple[int, int]:
    """Return the columns and the rows that a legend takes whose text has this size."""
    heading, entries = _lines(key)
    inner = max(text_width(line, size) for line in [*entries, ""]) + round(2.6 * size)
    columns = max(max(text_width(line, size) for line in heading), inner) + 3 * size
    head = round(1.9 * size) * len(heading) + round(0.6 * size)
    if isinstance(key, ColorBar):
        return columns, head + 22 * size + 3 * size * key.missing
    return columns, head + round(2.1 * size) * len(entries) + size


def draw_legend(image: Image, key: ColorBar | LabelKey, *, left: int, top: int, size: int) -> None:
    """Draw a legend into the columns from `left` on, below the row `top`, centered in height."""
    heading, entries = _lines(key)
    left += size
    head = round(1.9 * size) * len(heading) + round(0.6 * size)
    room = len(image) - top - 2 * size - head
    if isinstance(key, ColorBar):
        body = min(max(room, 4 * size), 20 * size) - 3 * size * key.missing
    else:
        body = min(round(2.1 * size), max(room // max(len(entries), 1), 4)) * len(entries)
    start = top + max((len(image) - top - head - body) // 2, size)
    for number, line in enumerate(heading):
        draw_text(image, line, start + round(1.9 * size) * number, left, size)
    start += head
    if isinstance(key, ColorBar):
        _draw_bar(image, key, start, left, body, size)
    else:
        _draw_keys(image, key, entries, start, left, body, size)


def _draw_bar(image: Image, key: ColorBar, top: int, left: int, rows: int, size: int) -> None:
    """Draw the scale with its ends and the round numbers between them that have room."""
    width = round(1.4 * size)
    _fill(image, top, left, rows, width, np.rint(255 * key.colors(rows))[:, None])
    used: list[float] = []
    for value in key.numbers:
        share = (value - key.low) / (key.high - key.low) if key.high > key.low else 0.5
        row = top + (1 - share) * (rows - 1)
        if all(abs(row - other) >= 1.8 * size for other in used):
            used.append(row)
            thick = max(size // 12, 1)
            _fill(image, round(row), left + width, thick, max(size // 3, 2), _DARK)
            draw_text(image, key.text(value), row - size / 2, left + width + 0.7 * size, size)
    if key.missing:
        top += rows + round(1.4 * size)
        _fill(image, top, left, width, width, np.rint(255 * np.array(MISSING)))
        draw_text(image, "no value", top + (width - size) / 2, left + width + 0.7 * size, size)


def _draw_keys(
    image: Image, key: LabelKey, entries: list[str], top: int, left: int, rows: int, size: int
) -> None:
    colors = np.rint(255 * label_colors(key.labels[:MAX_KEYS], key.palette))
    pitch = rows // max(len(entries), 1)
    swatch = max(round(0.7 * pitch), 3)
    letters = min(size, 0.62 * pitch)
    for number, text in enumerate(entries):
        row = top + number * pitch
        if number < len(colors):
            _fill(image, row, left, swatch, swatch, colors[number])
        draw_text(image, text, row + swatch / 2 - letters / 2, left + swatch + 0.7 * size, letters)


def _fill(
    image: Image, top: int, left: int, rows: int, columns: int, fill: NDArray[np.float64]
) -> None:
    """Fill a rectangle, as far as it lies in the image, with a colour or a column of colours."""
    area = image[max(top, 0) : max(top + rows, 0), left : left + columns]
    if area.size:
        area[..., :3] = fill if fill.ndim == 1 else fill[-len(area) :]
        area[..., 3:] = 255


def content_box(image: Image, ground: Image, margin: int) -> tuple[slice, slice]:
    """Return the rows and columns that differ from the background's colour, with a margin.

    All where nothing does.
    """
    drawn = image[..., 0] != ground[0]
    for channel in range(1, image.shape[2]):  # numpy goes along the short axis one by one
        drawn |= image[..., channel] != ground[channel]
    box = []
    for axis in (1, 0):
        used = np.flatnonzero(drawn.any(axis=axis))
        length = drawn.shape[1 - axis]
        low, high = (used[0], used[-1] + 1) if len(used) else (0, length)
        box.append(slice(max(int(low) - margin, 0), min(int(high) + margin, length)))
    return box[0], box[1]


def contact_sheet(
    images: Sequence[ArrayLike],
    captions: Sequence[str] | None = None,
    columns: int = 4,
    *,
    key: ColorBar | LabelKey | None = None,
) -> Image:
    """Return one picture of several uint8 images in rows, each with its caption below.

    Cells have the size of the largest image; smaller ones are centered. See-through images
    (h, w, 4) come on white, as the gaps. `key` is one legend for all, at the right.

    Raises
    ------
    InvalidShapeError
        When there is no image or one is not (h, w, 3) or (h, w, 4) uint8.
    InvalidOptionError
        When there is not one caption for each image.

    Examples
    --------
    >>> sheet = contact_sheet([np.zeros((60, 80, 3), np.uint8)] * 3, ["a", "b", "c"], columns=2)
    >>> sheet.shape[1]
    184
    """
    pictures = [_on_white(np.asarray(image)) for image in images]
    columns = as_whole_number(columns, "columns", low=1, high=1000)
    if not pictures:
        raise InvalidShapeError("A contact sheet needs at least one image.")
    texts = [""] * len(pictures) if captions is None else [str(text) for text in captions]
    if len(texts) != len(pictures):
        raise InvalidOptionError(f"{len(pictures)} images need as many captions, got {len(texts)}.")
    columns = min(columns, len(pictures))
    high, wide = (max(picture.shape[axis] for picture in pictures) for axis in (0, 1))
    gap, size = 8, round(0.9 * text_size(wide * columns, high * 2))
    below = round(2.4 * size) if any(texts) else 0
    rows = -(-len(pictures) // columns)
    cell_h, cell_w = high + below + gap, wide + gap
    right = 0 if key is None else legend_size(key, size)[0]
    left = columns * cell_w + gap
    sheet = np.full((rows * cell_h + gap, left + right, 3), 255, np.uint8)
    for number, (picture, text) in enumerate(zip(pictures, texts, strict=True)):
        top, start = gap + number // columns * cell_h, gap + number % columns * cell_w
        row, col = top + (high - len(picture)) // 2, start + (wide - picture.shape[1]) // 2
        sheet[row : row + len(picture), col : col + picture.shape[1]] = picture
        letters = min(size, size * wide / max(text_width(text, size), 1))
        draw_text(sheet, text, top + high + 0.6 * size, start + wide / 2, letters, anchor="middle")
    if key is not None:
        draw_legend(sheet, key, left=left, top=0, size=size)
    return sheet


def _on_white(picture: NDArray[Any]) -> Image:
    """Return a picture without see-through parts."""
    if picture.ndim != 3 or picture.shape[2] not in (3, 4) or picture.dtype != np.uint8:
        raise InvalidShapeError(
            f"images must be (h, w, 3) or (h, w, 4) uint8, got {picture.shape} {picture.dtype}."
        )
    if picture.shape[2] == 3:
        return picture
    white = np.full((*picture.shape[:2], 3), 255.0)
    over(white, picture[..., :3].astype(np.float64), picture[..., 3] / 255)
    return np.rint(white).astype(np.uint8)
