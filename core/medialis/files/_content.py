"""What every format parser hands on, and fast numbers from text with a sentence when they are not.

Parsers raise `InvalidShapeError` without the file name; `read_mesh` puts it in front.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from medialis.errors import InvalidShapeError
from medialis.progress import Message

BLOCK = 1 << 21
"""Bytes of a text that are looked through at once, some 30 ms."""


@dataclass(eq=False)
class ParsedMesh:
    """A file's vertices and polygons as written, not yet checked or triangulated."""

    points: NDArray[np.float64]
    """(n, 3) vertices; NaN and infinity may occur."""
    counts: NDArray[np.int64]
    """(p,) corners of each polygon; no rows for a point cloud."""
    corners: NDArray[np.int64]
    """(sum of counts,) vertex indices, not yet checked."""
    normals: NDArray[np.float64] | None = None
    """(n, 3) vertex normals of any length, or None when the file has none."""
    messages: tuple[Message, ...] = ()
    viewpoints: NDArray[np.float64] | None = None
    """(n, 3) where each vertex was seen from, NaN where unknown; None when the file has none."""


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
    result = np.empty(len(words))
    for i, word in enumerate(words):
        try:
            result[i] = float(word)
        except ValueError:
            raise InvalidShapeError(
                f"expected a number in the {what}, found {shown(word.encode('latin-1'))}."
            ) from None
    return result


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


def whole(values: NDArray[Any], what: str) -> NDArray[np.int64]:
    """Return numbers as int64.

    Raises
    ------
    InvalidShapeError
        When one is fractional, not finite or beyond what an index can be.
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize < 8:
        return values.astype(np.int64)
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
