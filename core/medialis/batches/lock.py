"""One batch at a time in an output folder, and no batch at all where nothing can be written."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from medialis.errors import FileError
from medialis.files._files import reason, take_lock

LOCK = ".medialis-batch"


@contextmanager
def locked_folder(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Hold an output folder; it is made when missing, and removed again when it stays empty.

    The system gives the lock back when the process ends in whatever way, so a killed batch leaves
    none behind.

    Raises
    ------
    FileError
        When another batch holds the folder, or it cannot be made or written.
    """
    path = Path(folder) / LOCK
    try:
        made = [p for p in (path.parent, *path.parent.parents) if not p.exists()]
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except (OSError, ValueError) as error:
        raise FileError(f"Cannot write results to {folder}: {reason(error)}.") from None
    try:
        if not _take(handle, path):
            raise FileError(
                f"Another batch is writing to {folder}: wait until it has ended, or name another "
                "folder."
            )
        try:
            yield
        finally:
            if sys.platform != "win32":  # before the next one can open and lock it
                path.unlink(missing_ok=True)
    finally:
        os.close(handle)
        if sys.platform == "win32":  # an open file cannot be removed: not that of another batch
            with suppress(OSError):
                path.unlink()
        with suppress(OSError):  # something is in it
            for new in made:
                new.rmdir()


def _take(handle: int, path: Path) -> bool:
    """Lock an open file without waiting; False when another process has it."""
    if take_lock(handle) is False:
        return False
    # The one who had it may have removed it between our opening and locking.
    return path.exists() and os.path.samestat(os.fstat(handle), path.stat())
