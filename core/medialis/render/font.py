"""Text for pictures: letters of DejaVu Sans as tables of distances to their outlines.

Such a table gives smooth text of any size, and a light rim round it that keeps it readable on dark
pages. ``docs/make_font.py`` makes the tables. Characters that they lack are shown as a box.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from medialis.validation import FloatArray, frozen

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
    with (resources.files("medialis.render") / "font.npz").open("rb") as stream:
        data = dict(np.load(stream))
    place = {chr(code): number for number, code in enumerate(data.pop("codes").tolist())}
    return _Tables(place, baseline=int(data.pop("baseline")), **data)


@lru_cache(maxsize=4096)
def _glyph(character: str, scale: float, shift: float) -> FloatArray:
    """Return distances to the outline in pixels, positive inside; `shift` moves it to the right."""
    tables = _tables()
    number = tables.place.get(character, tables.place[UNKNOWN])
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
    tables = _tables()
    unknown = tables.place[UNKNOWN]
    numbers = [tables.place.get(character, unknown) for character in text]
    return int(np.ceil(float(tables.advances[numbers].sum()) * size / CAP))


def draw_text(
    image: NDArray[np.uint8],
    text: str,
    row: float,
    col: float,
    size: float,
    *,
    anchor: str = "left",
    color: tuple[int, int, int] = (35, 38, 45),
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
    for character in text:
        shift = round(4 * (at % 1.0)) / 4
        glyph = _glyph(character, scale, shift)
        left = int(np.floor(at))
        part = away[: len(glyph), left : left + glyph.shape[1]]
        np.maximum(part, glyph[: len(part), : part.shape[1]], out=part)
        number = tables.place.get(character, tables.place[UNKNOWN])
        at += float(tables.advances[number]) * scale
    top = round(row + size - tables.baseline * scale)
    _blend(image, away, top, int(np.floor(place)) - pad, size, color)


def _blend(
    image: NDArray[np.uint8],
    away: FloatArray,
    top: int,
    left: int,
    size: float,
    color: tuple[int, int, int],
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
    over(area, np.array(color, np.float64), np.clip(away + 0.5, 0.0, 1.0))
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
