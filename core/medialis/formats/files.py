"""Files as bytes and text: read or written whole, numbers out of text, one sentence for each fault.

A folder of results appears whole or not at all as well (`output_folder.py`).

Parsers turn bytes into a `ParsedMesh`. They raise `InvalidShapeError` without the file name, which
`reading` puts in front.
"""

from __future__ import annotations

import errno
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from medialis.base.disk import folder_of, read_file
from medialis.base.disk import shown as shown_path
from medialis.base.errors import Cancelled, FileError, InvalidShapeError, MedialisError
from medialis.base.progress import Message


def file_bytes(name: str) -> bytes:
    """Return the content of a file.

    Raises
    ------
    FileError
        When it is missing, a folder, no regular file, or may not be read.
    InvalidShapeError
        When it is empty.
    """
    try:
        if Path(name).is_dir():
            raise FileError(f"Cannot read {name}: it is a folder; name a mesh file inside it.")
        data = read_file(name)
    except FileNotFoundError:
        raise FileError(f"Cannot read {name}: there is no such file; check the path.") from None
    except PermissionError:
        raise FileError(f"Cannot read {name}: permission denied; change its rights.") from None
    except FileError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise FileError(f"Cannot read {name!r}: {reason(error)}.") from None
    except MemoryError:
        raise FileError(f"Cannot read {name}: it does not fit into memory.") from None
    if not data:
        raise InvalidShapeError(f"Cannot read {name}: the file is empty.")
    return data


@contextmanager
def reading(name: str | os.PathLike[str]) -> Iterator[None]:
    """Turn whatever a damaged file makes a parser raise into one sentence about the file.

    Raises
    ------
    FileError
        As it was raised.
    InvalidShapeError
        For everything else, with the name of the file.
    """
    try:
        yield
    except (FileError, Cancelled):
        raise
    except MedialisError as error:
        raise InvalidShapeError(f"Cannot read {os.fspath(name)}: {error}") from None
    except (MemoryError, RecursionError) as error:
        what = "does not fit into memory" if isinstance(error, MemoryError) else "nests too deeply"
        raise InvalidShapeError(f"Cannot read {os.fspath(name)}: it {what}.") from None
    except Exception as error:  # noqa: BLE001 - a parser of a library may raise anything
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise InvalidShapeError(f"Cannot read {os.fspath(name)}: it is damaged ({text}).") from None


def number_lines(name: str) -> Iterator[tuple[int, str, list[str]]]:
    """Yield number, text and words of each line of a text file that has words; # is a comment.

    Raises
    ------
    FileError
        When the file cannot be read or is no text.
    InvalidShapeError
        When it is empty.
    """
    try:
        text = file_bytes(name).decode("utf-8")
    except UnicodeDecodeError:
        raise FileError(f"Cannot read {name}: it is no text.") from None
    for place, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].replace(",", " ").split()
        if words:
            yield place, line.strip()[:40], words


def absolute(path: str | os.PathLike[str]) -> Path:
    """Return the whole path of a file or folder.

    Raises
    ------
    FileError
        When it is relative to a working folder that was removed.
    """
    try:
        return Path(path).absolute()
    except FileNotFoundError:
        raise FileError(
            f"Cannot tell where {os.fspath(path)!r} is: the working folder was removed; go to one "
            "that is there."
        ) from None


def reason(error: Exception) -> str:
    """Return why an operation on a file failed, in lower-case words."""
    text = getattr(error, "strerror", None) or str(error)
    return text[:1].lower() + text[1:]


@contextmanager
def complete_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Give a hidden file beside `path` to write to; it takes that name when complete.

    On any error inside the block the hidden file is removed and `path` is as it was.

    Raises
    ------
    FileError
        When the file cannot be written (no such folder, no permission, disk full).
    """
    target = Path(path)
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder; name a file inside it")
        with folder_of(target) as (folder, name):
            hidden = f".{name}-{os.urandom(4).hex()}"
            try:
                with folder.new(hidden) as stream:
                    yield stream
                folder.move(hidden, folder, name)
            except BaseException:
                with suppress(OSError):
                    folder.remove(hidden)
                raise
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"Cannot write {shown_path(target)}: {reason(error)}.") from None


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a file of text by `complete_file`, with names in it that are no text."""
    with complete_file(path) as stream:
        stream.write(text.encode("utf-8", "backslashreplace"))


def write_lines(path: str | os.PathLike[str], lines: Iterable[str]) -> None:
    """Write a file of lines by `complete_file`."""
    with complete_file(path) as stream:
        for line in lines:
            stream.write(line.encode() + b"\n")


BLOCK = 1 << 21
"""Bytes of a text that are looked through at once, some 30 ms."""


@dataclass(eq=False)
class ParsedMesh:
    """A file's vertices and polygons as written, not yet checked or triangulated."""

    points: NDArray[np.float64]
    """(n, 3) vertices; NaN and infinity may occur."""
    counts: NDArray[np.int64]
    """(p,) corners of each polygon; no rows for a point cloud."""
    corners: NDArray[Any]
    """(sum of counts,) int32 or int64, vertex indices, not yet checked."""
    normals: NDArray[np.float64] | None = None
    """(n, 3) vertex normals of any length, or None when the file has none."""
    messages: tuple[Message, ...] = ()
    viewpoints: NDArray[np.float64] | None = None
    """(n, 3) where each vertex was seen from, NaN where unknown; None when the file has none."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """Points with triangles or edges and named values: what is written as a mesh, as a layer is.

    Attributes
    ----------
    points : (n, 3) float
    faces : (m, 3) int or None
    edges : (e, 2) int or None
    attributes : dict of (n,) or (n, ...) arrays
    face_attributes : dict of (m,) or (m, ...) arrays
    color_by : str or None
        The attribute that programs colour by at first.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int32] | None = None
    edges: NDArray[np.int32] | None = None
    attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    face_attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    color_by: str | None = None


def no_polygons() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the counts and corners of a point cloud."""
    return np.empty(0, np.int64), np.empty(0, np.int64)


def unix_lines(data: bytes) -> bytes:
    """Return text with line feeds as line ends, whatever the file used."""
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def blocks(text: bytes) -> Iterator[bytes]:
    """Give a text in blocks of whole lines: no other thread runs while a pattern is looked for."""
    begin = 0
    while begin < len(text):
        end = text.find(b"\n", begin + BLOCK) + 1 or len(text)
        yield text[begin:end]
        begin = end


def replaced(pattern: bytes, by: bytes, text: bytes) -> bytes:
    """Return a text in which all places of a pattern within lines are replaced."""
    return b"".join(re.sub(pattern, by, block) for block in blocks(text))


def places_of(pattern: bytes, text: bytes) -> list[bytes]:
    """Return all places of a pattern within lines, or what its group matched there."""
    return [place for block in blocks(text) for place in re.findall(pattern, block)]


def without_comments(data: bytes, mark: bytes = b"#") -> bytes:
    """Return text with each comment cut from its mark to the end of the line."""
    return replaced(re.escape(mark) + rb"[^\n]*", b"", data) if mark in data else data


def shown(text: bytes, limit: int = 40) -> str:
    """Return a piece of a file for an error sentence: printable, short, quoted."""
    return repr(text[:limit].decode("latin-1"))


def numbers(data: bytes, what: str) -> NDArray[np.float64]:
    """Return all white-space separated numbers of a text.

    Raises
    ------
    InvalidShapeError
        When something in it is not a number; the sentence shows it.
    """
    text = data.decode("latin-1").strip()
    if not text:
        return np.empty(0)
    try:
        # Older numpy only warns when it stops at text that is no number.
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            return np.fromstring(text, dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        return _numbers_one_by_one(text.split(), what)


def _numbers_one_by_one(words: list[str], what: str) -> NDArray[np.float64]:
    result = []
    for word in words:
        try:
            result.append(float(word))
        except ValueError:
            raise InvalidShapeError(
                f"expected a number in the {what}, found {shown(word.encode('latin-1'))}."
            ) from None
    return np.array(result)


def numbers_by_line(
    data: bytes, what: str, *, keep_empty: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return all numbers of a text and how many stand on each line that has any.

    With `keep_empty` lines without numbers count too, and so does what follows the last line end.

    Raises
    ------
    InvalidShapeError
        When something in it is not a number.
    """
    # A word starts where a byte above blank follows one that is not; counting the starts before
    # each line end gives the words per line without a Python loop.
    blank = np.frombuffer(data, np.uint8) <= 32
    starts = np.flatnonzero(~blank & np.concatenate([[True], blank[:-1]])[: len(blank)])
    ends = np.flatnonzero(np.frombuffer(data, np.uint8) == 10)
    counts = np.diff(np.searchsorted(starts, ends), prepend=0, append=len(starts))
    values = numbers(data, what)
    if len(values) != len(starts):
        raise InvalidShapeError(f"the {what} holds control characters between its numbers.")
    return values, counts if keep_empty else counts[counts > 0]


def rows_of(values: NDArray[Any], counts: NDArray[np.int64], width: int) -> NDArray[Any]:
    """Return the first `width` numbers of each line, (lines, width); each line has that many."""
    starts = np.cumsum(counts) - counts
    if len(counts) and (counts == counts[0]).all():
        return values.reshape(-1, counts[0])[:, :width]
    return values[starts[:, None] + np.arange(width)]


def whole(values: NDArray[Any], what: str) -> NDArray[Any]:
    """Return numbers as int64, or as the int32 that they are.

    Raises
    ------
    InvalidShapeError
        When one is fractional, not finite or beyond what an index can be.
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize < 8:
        return values if values.dtype == np.int32 else values.astype(np.int64)
    # Text and float properties arrive as doubles; 2^53 is far beyond any vertex count.
    doubles = values.astype(np.float64)
    bad = ~(np.abs(doubles) < 2.0**53) | (doubles != np.rint(doubles))
    if bad.any():
        raise InvalidShapeError(
            f"expected whole numbers in the {what}, found {float(doubles[bad.argmax()]):g}."
        )
    return doubles.astype(np.int64)


def ragged_rows(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the positions starts[i] .. starts[i] + counts[i] - 1 of all rows in one array."""
    offsets = np.cumsum(counts) - counts
    return np.arange(int(counts.sum())) + np.repeat(starts - offsets, counts)
