"""Whole files in and out: one sentence for what the system refuses, nothing half-written."""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from medialis.errors import Cancelled, FileError, InvalidShapeError, MedialisError


def file_bytes(name: str) -> bytes:
    """Return the content of a file.

    Raises
    ------
    FileError
        When it is missing, a folder, no regular file, or may not be read.
    InvalidShapeError
        When it is empty.
    """
    path = Path(name)
    try:
        if path.is_dir():
            raise FileError(f"Cannot read {name}: it is a folder; name a mesh file inside it.")
        if path.exists() and not path.is_file():
            raise FileError(f"Cannot read {name}: it is not a regular file.")
        data = path.read_bytes()
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


def take_lock(handle: int) -> bool | None:
    """Lock an open file without waiting; False when another has it, None where there are no locks.

    The system gives it back when the process ends in whatever way.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (PermissionError, BlockingIOError):  # the first is Windows
        return False
    except OSError:
        return None
    return True


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
    hidden = target.with_name(f".{target.name}-{secrets.token_hex(4)}") if target.name else target
    try:
        if target.is_dir():
            raise FileError(f"Cannot write {target}: it is a folder; name a file inside it.")
        with _new_file(hidden) as stream:
            yield stream
        hidden.replace(target)
    except OSError as error:
        _remove(hidden)
        if isinstance(error, FileError):
            raise
        raise FileError(f"Cannot write {target}: {reason(error)}.") from None
    except BaseException:
        _remove(hidden)
        raise


def _new_file(path: Path) -> BinaryIO:
    try:
        return path.open("xb")
    except ValueError as error:  # a NUL character in the name
        raise FileError(f"Cannot write {str(path)!r}: {reason(error)}.") from None


def _remove(path: Path) -> None:
    with suppress(OSError, ValueError):
        path.unlink()
