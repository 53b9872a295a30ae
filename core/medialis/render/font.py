"""Text for pictures: a 5 x 9 dot table of ASCII whose dots are joined to anti-aliased strokes.

Neighbouring dots of a glyph become line segments with round ends, so the same small table gives
smooth text at any size. Other characters are shown as a question mark.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from medialis.validation import FloatArray, frozen

CAP_DOTS = 7
"""Dots from the baseline to the top of a capital; two more rows hang below the baseline."""


@lru_cache(maxsize=1)
def _dots() -> NDArray[np.bool_]:
    """Return the dots of the characters 32..126, (95, 9, 5), which are drawn in ``font.txt``."""
    text = (resources.files("medialis.render") / "font.txt").read_text("ascii")
    glyphs: list[list[str]] = []
    for block in text.strip().split("\n\n"):
        rows = [line.split() for line in block.splitlines()]
        glyphs += [[row[i] for row in rows] for i in range(len(rows[0]))]
    return np.array([[[dot == "#" for dot in row] for row in glyph] for glyph in glyphs])


def _strokes(dots: NDArray[np.bool_]) -> FloatArray:
    """Return segments (s, 4) as row, col, row, col; a lone dot is a segment of length zero."""
    found = []
    for row, col in np.argwhere(dots):
        joined = False
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = row + dr, col + dc
                if (dr, dc) == (0, 0) or not (0 <= r < len(dots) and 0 <= c < dots.shape[1]):
                    continue
                # A diagonal only where no dot beside it already joins the two.
                corner = dr != 0 and dc != 0 and (dots[row, c] or dots[r, col])
                if dots[r, c] and not corner:
                    joined = True
                    if (dr, dc) > (0, 0):
                        found.append([row, col, r, c])
        if not joined:
            found.append([row, col, row, col])
    return np.array(found, np.float64).reshape(-1, 4)


@lru_cache(maxsize=2048)
def _glyph(character: str, dot: float) -> FloatArray:
    """Return the ink 0..1 of a character whose dots are `dot` pixels apart, read-only."""
    code = ord(character) if 32 <= ord(character) <= 126 else ord("?")
    dots = _dots()[code - 32]
    used = np.flatnonzero(dots.any(axis=0))
    if len(used) == 0:
        return np.zeros((round(9 * dot), round(3 * dot)))
    dots = dots[:, used[0] : used[-1] + 1]
    rows = np.arange(round(9 * dot))[:, None] + 0.5
    cols = np.arange(round((dots.shape[1] + 1.0) * dot))[None, :] + 0.5
    nearest = np.full((rows.size, cols.size), np.inf)
    for segment in (_strokes(dots) + 0.5) * dot:
        dr, dc = segment[2] - segment[0], segment[3] - segment[1]
        length = dr * dr + dc * dc
        along = (rows - segment[0]) * dr + (cols - segment[1]) * dc
        share = np.clip(along / length, 0, 1) if length > 0 else np.zeros_like(along)
        away = np.hypot(rows - segment[0] - share * dr, cols - segment[1] - share * dc)
        nearest = np.minimum(nearest, away)
    return frozen(np.clip(max(0.42 * dot, 0.55) + 0.5 - nearest, 0.0, 1.0), np.float64)


def text_ink(text: str, size: float) -> FloatArray:
    """Return the ink 0..1 of one line of text, (rows, columns); the baseline is at 7/9 of the rows.

    Parameters
    ----------
    text : str
    size : float
        Height of a capital in pixels, at least 5.
    """
    dot = max(float(size), 5.0) / CAP_DOTS
    glyphs = [_glyph(character, dot) for character in text]
    if not glyphs:
        return np.zeros((round(9 * dot), 0))
    # Half a dot of extra space between letters, besides the dot that every glyph has at its right.
    gap = np.zeros((len(glyphs[0]), max(round(0.35 * dot), 0)))
    return np.concatenate([part for glyph in glyphs for part in (glyph, gap)], axis=1)


def draw_text(
    image: NDArray[np.uint8],
    text: str,
    row: int,
    col: int,
    size: float,
    *,
    anchor: str = "left",
    color: tuple[int, int, int] = (35, 38, 45),
) -> None:
    """Write a line of text into an image (h, w, 3) in place; what sticks out is cut off.

    `row` is the top of the capitals; `col` the left end, middle or right end, as `anchor` says.
    """
    ink = text_ink(text, size)
    col -= {"left": 0, "middle": ink.shape[1] // 2, "right": ink.shape[1]}[anchor]
    top, left = max(row, 0), max(col, 0)
    bottom, right = min(row + ink.shape[0], len(image)), min(col + ink.shape[1], image.shape[1])
    if top >= bottom or left >= right:
        return
    share = ink[top - row : bottom - row, left - col : right - col, None]
    area = image[top:bottom, left:right]
    area[...] = np.rint(area * (1 - share) + np.array(color) * share).astype(np.uint8)
