"""Objects with large arrays handed to another process of this machine: small text, and one file.

Arrays do not go through a pipe, where the sender would wait for the receiver: they are written to a
file of a folder that both know, and read from there in one piece.
"""

from __future__ import annotations

import os
import pickle
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from medialis.errors import FileError

ALIGNMENT = 64
"""Bytes: where an array may begin."""


class Parcel(NamedTuple):
    """An object on its way: all of it but its arrays, the file of these, and where each lies."""

    pickled: bytes
    file: str
    spans: tuple[tuple[int, int], ...]


def pack(thing: Any, folder: str | os.PathLike[str]) -> Parcel:
    """Write the arrays of an object to a new file of a folder.

    Raises
    ------
    FileError
        When the folder cannot be written, or the disk is full.
    """
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
    if not buffers:
        return Parcel(pickled, "", ())
    path = None
    try:
        handle, path = tempfile.mkstemp(".arrays", "medialis-", folder)
        with os.fdopen(handle, "wb") as file:
            spans = tuple(_write(file, buffer) for buffer in buffers)
    except OSError as error:
        if path is not None:
            discard(path)
        raise FileError(
            f"Cannot hand arrays over in {folder}: {error.strerror or error}. Free some space, or "
            "choose another folder."
        ) from None
    return Parcel(pickled, path, spans)


def _write(file: Any, buffer: pickle.PickleBuffer) -> tuple[int, int]:
    file.seek(-file.tell() % ALIGNMENT, os.SEEK_CUR)
    begin = file.tell()
    with buffer.raw() as content:
        file.write(content)
        return begin, content.nbytes


def unpack(parcel: Parcel) -> Any:
    """Return the object, its arrays read-only; the file is gone then.

    Raises
    ------
    FileError
        When the file cannot be read.
    """
    if not parcel.file:
        return pickle.loads(parcel.pickled)
    try:
        content = np.fromfile(parcel.file, np.uint8)
    except OSError as error:
        raise FileError(f"Cannot read what was handed over: {error}.") from None
    finally:
        discard(parcel.file)
    content.flags.writeable = False
    view = content.data
    return pickle.loads(
        parcel.pickled, buffers=[view[begin : begin + size] for begin, size in parcel.spans]
    )


def discard(file: str) -> None:
    """Remove the file of a parcel that nobody will unpack."""
    if file:
        with suppress(OSError):
            Path(file).unlink()
