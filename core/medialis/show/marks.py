"""What is written over a picture: numbers at places, a bar that tells the scale, the axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from medialis.base.options import with_unit
from medialis.base.progress import Progress
from medialis.base.validation import FloatArray, IntArray
from medialis.show.annotation import draw_text, over, text_width
from medialis.show.camera import Camera
from medialis.show.raster import rasterize

COARSER = 4
"""Pixels of the picture a pixel of what hides places."""
BEHIND = 0.02
"""Share of the visible height that a place may lie below the surface and still be seen."""
LONGEST = 0.25
"""Share of the picture's width that the bar takes at most."""
AXIS_COLORS = {"x": (197, 51, 51), "y": (63, 133, 45), "z": (44, 92, 184)}

Image = NDArray[np.uint8]


def seen(
    camera: Camera, places: FloatArray, points: FloatArray, faces: IntArray, progress: Progress
) -> NDArray[np.bool_]:
    """Return which places (k, 3) no triangle hides."""
    small = replace(
        camera,
        width=max(camera.width // COARSER, 1),
        height=max(camera.height // COARSER, 1),
    )
    depth = rasterize(small, points=points, faces=faces, progress=progress.unnamed).depth
    at, far = small.project(places)
    column, row = np.nan_to_num(np.floor(at), nan=-1.0).astype(np.int64).T
    inside = (column >= 0) & (row >= 0) & (column < small.width) & (row < small.height)
    front = depth[np.clip(row, 0, small.height - 1), np.clip(column, 0, small.width - 1)]
    return inside & (far <= front + BEHIND * camera.extent)


def write_texts(image: Image, camera: Camera, places: FloatArray, texts: Sequence[str]) -> None:
    """Write a text beside each place (k, 3), the first ones first; none over another.

    One that has to go away from its place has a line to it; none goes out of the picture.
    """
    size = max(7, round(min(image.shape[0], image.shape[1]) / 64))
    at, _ = camera.project(places)
    taken: list[tuple[float, float, float, float]] = []
    for (column, row), text in zip(at, texts, strict=True):
        if not text:
            continue
        wide, left = text_width(text, size), column + size
        if left + wide + size > image.shape[1]:
            left = column - size - wide
        for step in (0, -1, 1, -2, 2, -3, 3):
            top = row - size / 2 + 2 * size * step
            box = left - size / 2, top - size / 2, left + wide + size / 2, top + 1.5 * size
            inside = box[1] >= 0 and box[3] <= image.shape[0]
            if inside and not any(_overlap(box, other) for other in taken):
                taken.append(box)
                if step:
                    near = box[0] if left > column else box[2], (box[1] + box[3]) / 2
                    start = np.array([column, row])
                    _line(image, start, np.array(near), max(size / 10, 1.0), (60, 60, 60))
                _plate(image, box)
                draw_text(image, text, top, left, size)
                break


def _overlap(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return (one[0] < other[2] and other[0] < one[2]) and (one[1] < other[3] and other[1] < one[3])


def _plate(image: Image, box: tuple[float, float, float, float]) -> None:
    """Lay a light rectangle under a text."""
    left, top, right, bottom = (max(round(x), 0) for x in box)
    part = image[top:bottom, left:right]
    if part.size:
        area = part.astype(np.float64)
        over(area, np.array([255.0, 255.0, 255.0]), np.full(area.shape[:2], 0.8))
        image[top:bottom, left:right] = np.rint(area).astype(np.uint8)


def scale_height(size: int) -> int:
    """Return the rows that axes and bar take below a picture whose text has this size."""
    return 5 * size


def draw_scale(image: Image, camera: Camera, top: int, size: int, unit: str | None) -> None:
    """Draw the axes of the shape at the left, and a bar of a round length, below the row `top`.

    A perspective camera has no bar: there a length is as long as it is near.
    """
    middle = top + 2.5 * size
    reach = 1.6 * size
    ends = [(axis, camera.axes @ np.eye(3)[k]) for k, axis in enumerate("xyz")]
    for axis, end in sorted(ends, key=lambda one: -one[1][2]):  # what points away comes first
        tip = np.array([2.6 * size + reach * end[0], middle - reach * end[1]])
        _line(image, np.array([2.6 * size, middle]), tip, max(size / 7, 1.0), AXIS_COLORS[axis])
        if math.hypot(end[0], end[1]) > 0.25:
            beyond = tip + 0.55 * size * np.array([end[0], -end[1]]) / math.hypot(end[0], end[1])
            draw_text(image, axis, beyond[1] - 0.4 * size, beyond[0], 0.8 * size, anchor="middle")
    if camera.perspective:
        return
    length = round_length(LONGEST * camera.width / camera.scale)
    left, right = 6.0 * size, 6.0 * size + length * camera.scale
    thick = max(size / 6, 1.0)
    _line(image, np.array([left, middle]), np.array([right, middle]), thick, (60, 60, 60))
    for end in (left, right):
        up, down = middle - size / 3, middle + size / 3
        _line(image, np.array([end, up]), np.array([end, down]), thick, (60, 60, 60))
    text = with_unit(length, unit)
    draw_text(image, text, middle - 0.5 * size, right + 0.8 * size, size)


def round_length(longest: float) -> float:
    """Return the longest of 1, 2 and 5 times a power of ten that is no longer.

    Examples
    --------
    >>> [round_length(x) for x in (0.7, 3.0, 5.0, 99.0)]
    [0.5, 2.0, 5.0, 50.0]
    """
    power = 10.0 ** math.floor(math.log10(longest))
    factor = next(f for f in (5.0, 2.0, 1.0, 0.5) if f * power <= longest * (1 + 1e-9))
    return float(f"{factor * power:.6g}")


def _line(
    image: Image, start: FloatArray, end: FloatArray, thick: float, color: tuple[int, int, int]
) -> None:
    """Draw a line with soft edges."""
    low = np.floor(np.minimum(start, end) - thick - 1).astype(int).clip(0)
    high = np.ceil(np.maximum(start, end) + thick + 1).astype(int)
    part = image[low[1] : high[1], low[0] : high[0]]
    if not part.size:
        return
    rows, columns = np.mgrid[: part.shape[0], : part.shape[1]]
    at = np.stack([columns + low[0] + 0.5, rows + low[1] + 0.5], axis=-1) - start
    along = end - start
    share = np.clip(at @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    away = np.linalg.norm(at - share[..., None] * along, axis=-1)
    area = part.astype(np.float64)
    over(area, np.array(color, np.float64), np.clip(thick / 2 + 0.5 - away, 0.0, 1.0))
    part[...] = np.rint(area).astype(np.uint8)
