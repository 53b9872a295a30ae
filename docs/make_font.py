"""Make the letters of pictures from a font that matplotlib ships, and write them to the data.

python docs/make_font.py (needs matplotlib and Pillow; nothing else of the project does)
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt

from medialis.show.annotation import CAP, REACH, UNKNOWN

FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
TARGET = Path(__file__).resolve().parents[1] / "core" / "medialis" / "render" / "font.npz"
FINER = 8
"""Pixels of the drawn letter for one of the stored table, along each axis."""

CHARACTERS = [
    *range(0x20, 0x7F),
    *range(0xA0, 0x180),  # Latin
    *(code for code in range(0x386, 0x3CF) if code not in (0x38B, 0x38D, 0x3A2)),  # Greek
    *range(0x400, 0x460),  # Cyrillic
    *map(ord, "–—‘’‚“”„†•…‰‹›€™←↑→↓∂∆∏∑−√∞∫≈≠≤≥⌀"),
    ord(UNKNOWN),
]


def main() -> None:
    """Write signed distances, the advance and the code of each character."""
    sized = ImageFont.truetype(FONT, 1000)
    cap = -sized.getbbox("H", anchor="ls")[1]
    font = ImageFont.truetype(FONT, 1000 * CAP * FINER / cap)
    above, below = (round(x * CAP) + REACH for x in (1.32, 0.34))
    tables, advances = [], []
    for code in CHARACTERS:
        advance = font.getlength(chr(code)) / FINER
        wide = int(np.ceil(advance)) + 2 * REACH
        large = Image.new("L", (wide * FINER, (above + below) * FINER))
        place = REACH * FINER, above * FINER
        ImageDraw.Draw(large).text(place, chr(code), fill=255, font=font, anchor="ls")
        tables.append(_distances(np.asarray(large) > 127))
        advances.append(advance)
    widths = np.array([table.shape[1] for table in tables])
    np.savez_compressed(
        TARGET,
        codes=np.array(CHARACTERS, np.int32),
        advances=np.array(advances, np.float32),
        starts=np.concatenate([[0], np.cumsum(widths)]).astype(np.int32),
        distances=np.concatenate(tables, axis=1),
        baseline=above,
    )


def _distances(ink: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return 128 at the outline, more inside, 255 and 0 at `REACH` pixels from it."""
    inside, outside = distance_transform_edt(ink), distance_transform_edt(~ink)
    signed = np.where(ink, inside - 0.5, 0.5 - outside) / FINER
    rows, columns = (size // FINER for size in ink.shape)
    mean = signed.reshape(rows, FINER, columns, FINER).mean(axis=(1, 3))
    return np.clip(np.rint(128 + 127 * mean / REACH), 0, 255).astype(np.uint8)


if __name__ == "__main__":
    main()
