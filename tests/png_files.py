"""PNG files as `write_png` writes them, read back."""

import struct
import zlib
from pathlib import Path

import numpy as np

from medialis.show.png import SIGNATURE


def read_png(path):
    """Image (h, w, 3 or 4) of a PNG file that `write_png` wrote."""
    data = Path(path).read_bytes()
    assert data.startswith(SIGNATURE)
    header, packed = _read_chunks(data)
    width, height, *kind = struct.unpack(">IIBBBBB", header)
    channels = {2: 3, 6: 4}[kind[1]]
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + channels * width)
    assert kind == [8, kind[1], 0, 0, 0] and np.isin(rows[:, 0], (0, 1, 2)).all()
    image = rows[:, 1:].reshape(height, width, channels).copy()
    left = rows[:, 0] == 1
    image[left] = np.cumsum(image[left], axis=1, dtype=np.uint8)
    for row in np.flatnonzero(rows[1:, 0] == 2) + 1:
        image[row] += image[row - 1]
    return image


def _read_chunks(data):
    header, packed, place = b"", [], len(SIGNATURE)
    while place < len(data):
        (size,) = struct.unpack_from(">I", data, place)
        kind, body = data[place + 4 : place + 8], data[place + 8 : place + 8 + size]
        (checksum,) = struct.unpack_from(">I", data, place + 8 + size)
        if checksum != zlib.crc32(body, zlib.crc32(kind)):
            raise ValueError("checksum")
        if kind == b"IHDR":
            header = body
        elif kind == b"IDAT":
            packed.append(body)
        place += 12 + size
    return header, b"".join(packed)
