"""PNG files (8-bit RGB or RGBA), by nothing but the standard library's zlib."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from medialis.base.errors import InvalidShapeError
from medialis.base.threads import run_chunks
from medialis.formats.files import complete_file

SIGNATURE = b"\x89PNG\r\n\x1a\n"
COMPRESSION = 1
"""zlib level: 1000 x 750 pixels of a rendered mesh take about 11 ms, pure noise 42 ms."""
ROWS = 64
"""Rows of a strip: each is compressed by itself, on all threads."""
ADLER = 65521
"""Modulus of the checksum of zlib (RFC 1950)."""


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = zlib.crc32(data, zlib.crc32(kind))
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", checksum)


def encode_png(image: ArrayLike) -> bytes:
    """Return the PNG bytes of an image (h, w, 3) or, see-through, (h, w, 4) uint8.

    Each row is stored as the difference to the row above or to the pixel at its left, whichever has
    the smaller sum of absolute differences: smooth shading then compresses well.

    Raises
    ------
    InvalidShapeError
        For another shape or another type than uint8.
    """
    pixels = np.asarray(image)
    right = pixels.ndim == 3 and pixels.shape[2] in (3, 4) and pixels.dtype == np.uint8
    if not right or 0 in pixels.shape:
        raise InvalidShapeError(
            "image must be (h, w, 3) or (h, w, 4) uint8 with h, w >= 1, "
            f"got {pixels.shape} {pixels.dtype}."
        )
    height, width, channels = pixels.shape
    strips = [b""] * -(-height // ROWS)
    sums = [(1, 0)] * len(strips)

    def pack(begin: int, end: int) -> None:
        rows = _filtered(pixels, begin, end).tobytes()
        packer = zlib.compressobj(COMPRESSION, wbits=-zlib.MAX_WBITS)
        ending = zlib.Z_FINISH if end == height else zlib.Z_FULL_FLUSH
        strips[begin // ROWS] = packer.compress(rows) + packer.flush(ending)
        sums[begin // ROWS] = zlib.adler32(rows), len(rows)

    run_chunks(pack, height, ROWS)
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if channels == 3 else 6, 0, 0, 0)
    data = b"".join([b"\x78\x01", *strips, struct.pack(">I", _joined(sums))])
    return SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")


def _filtered(pixels: NDArray[np.uint8], begin: int, end: int) -> NDArray[np.uint8]:
    """Return rows begin..end as a PNG has them: the kind of difference, and the differences."""
    strip = pixels[begin:end]
    height, width, channels = strip.shape
    left, above = strip.copy(), strip.copy()
    left[:, 1:] -= strip[:, :-1]
    above[1:] -= strip[:-1]
    if begin > 0:
        above[0] -= pixels[begin - 1]
    # The absolute value of -128 is 128 without a sign.
    cost = [
        np.abs(rows.reshape(height, -1).view(np.int8)).view(np.uint8).sum(axis=1, dtype=np.int64)
        for rows in (left, above)
    ]
    use_left = cost[0] < cost[1]
    rows = np.empty((height, 1 + channels * width), np.uint8)
    rows[:, 0] = np.where(use_left, 1, 2)
    rows[:, 1:] = np.where(use_left[:, None, None], left, above).reshape(height, -1)
    return rows


def _joined(sums: Sequence[tuple[int, int]]) -> int:
    """Return the Adler-32 checksum of data, from those of its parts and their lengths."""
    low, high = 1, 0
    for part, length in sums:
        high = (high + (part >> 16) + (low - 1) * length) % ADLER
        low = (low + (part & 0xFFFF) - 1) % ADLER
    return (high << 16) | low


def reduced(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3 or 4) at a whole fraction of its size, no narrower than `width`.

    Each pixel is the mean of a square, colours weighed by cover; a rest that fills no square is cut
    off.
    """
    step = max(1, image.shape[1] // width)
    high, wide = (max(1, size // step) for size in image.shape[:2])
    shape = high, min(step, len(image)), wide, step, image.shape[2]
    squares = image[: high * step, : wide * step].reshape(shape).astype(np.float64)
    if image.shape[2] == 3:
        return np.rint(squares.mean(axis=(1, 3))).astype(np.uint8)
    cover = squares[..., 3:].mean(axis=(1, 3))
    inked = (squares[..., :3] * squares[..., 3:]).mean(axis=(1, 3))
    color = np.divide(inked, cover, out=np.zeros_like(inked), where=cover > 0)
    return np.rint(np.concatenate([color, cover], axis=2)).astype(np.uint8)


def write_png(path: str | os.PathLike[str], image: ArrayLike) -> None:
    """Write an image (h, w, 3 or 4) uint8; the file appears whole or not at all.

    Raises
    ------
    InvalidShapeError
        For another shape or another type than uint8.
    FileError
        When the file cannot be written.
    """
    with complete_file(path) as stream:
        stream.write(encode_png(image))
