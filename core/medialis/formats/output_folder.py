"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from medialis.base.errors import FileError, InvalidOptionError
from medialis.formats.files import absolute, reason, take_lock

MANIFEST = "manifest.json"
"""Moved after all others, and an old one away before: where it is, all it lists belongs to it."""
LOCK = ".medialis-lock"
"""In each hidden folder, held as long as its process lives: what nobody holds was left behind."""


def remove_left(path: str | os.PathLike[str]) -> None:
    """Remove the hidden folders of killed runs that wrote to `path`; never one in use."""
    target = absolute(path)
    ours = re.compile(re.escape(f".{target.name}-") + "[0-9a-f]{8}")
    for place in (target.parent, target):
        try:
            left = [entry for entry in place.iterdir() if ours.fullmatch(entry.name)]
        except (OSError, ValueError):  # not there, or not to be read
            continue
        for folder in left:
            _remove_unless_held(folder)


def _remove_unless_held(folder: Path) -> None:
    try:
        handle = os.open(folder / LOCK, os.O_RDWR)
    except OSError:
        with suppress(OSError):  # its process was killed before it made the lock, or it is not ours
            folder.rmdir()
        return
    try:
        taken = take_lock(handle)
        if taken:
            _remove(folder)
    finally:
        os.close(handle)
    if taken:  # Windows removes no open file
        _remove(folder)


def _remove(folder: Path) -> None:
    """Remove a hidden folder, the mark that it is ours last: who is killed leaves no other one."""
    with suppress(OSError):
        for entry in folder.iterdir():
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.name != LOCK:
                entry.unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)


class OutputFolder:
    """Collect files in a hidden folder and move them to `path` when the block ends well.

    The hidden folder lies beside `path` (inside it where only that is possible: another disk is
    mounted there, or the folder around it may not be written), so moving is renaming. When the
    block ends with any exception, or moving fails, everything is as it was before. What a killed
    run has left is removed by the next one.

    Parameters
    ----------
    path : path
        The folder; made with its parents when missing. Files in it that are not written again stay.
    replaced : iterable of str
        Names of files that go in any case: those of an older result.

    Raises
    ------
    FileError
        On entering: `path` is a file or cannot be made or written. On leaving: moving failed.

    Examples
    --------
    >>> import tempfile
    >>> out = Path(tempfile.mkdtemp()) / "results"
    >>> with OutputFolder(out) as folder:
    ...     _ = folder.file("note.txt").write_text("done")
    >>> (out / "note.txt").read_text()
    'done'
    """

    def __init__(self, path: str | os.PathLike[str], *, replaced: Iterable[str] = ()) -> None:
        self.path, self._replaced = Path(path), tuple(replaced)
        self._hidden: Path | None = None
        self._lock: int | None = None
        self._made: list[Path] = []

    def __enter__(self) -> OutputFolder:
        self._hidden, self._made = None, []
        target = absolute(self.path)
        try:
            if target.exists() and not target.is_dir():
                raise FileError(
                    f"Cannot write results to {self.path}: it is a file; name a folder."
                )
            self._make(target.parent)
            place = target.parent
            if target.exists():
                if not os.access(target, os.W_OK | os.X_OK):
                    raise PermissionError(13, "permission denied")
                apart = target.stat().st_dev != place.stat().st_dev or not target.name
                place = target if apart or not os.access(place, os.W_OK | os.X_OK) else place
            remove_left(target)
            while not self._hide(place, target.name):
                pass
        except BaseException as error:
            self._clean()
            if isinstance(error, FileError) or not isinstance(error, OSError | ValueError):
                raise
            raise FileError(f"Cannot write results to {self.path}: {reason(error)}.") from None
        return self

    def _hide(self, place: Path, name: str) -> bool:
        """Make the hidden folder and hold its lock; False when another run removed it meanwhile."""
        hidden = place / f".{name}-{secrets.token_hex(4)}"
        try:
            hidden.mkdir(mode=0o700)
        except FileExistsError:
            return False
        self._hidden = hidden
        try:
            self._lock = os.open(hidden / LOCK, os.O_RDWR | os.O_CREAT, 0o600)
        except FileNotFoundError:
            return False
        if take_lock(self._lock) is not False and (hidden / LOCK).exists():
            return True
        self._unlock()
        return False

    def _unlock(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def file(self, name: str) -> Path:
        """Return where to write the file `name` (such as "skeleton.ply" or "sheets/3.ply").

        Raises
        ------
        InvalidOptionError
            When the name leaves the folder, or outside of the `with` block.
        """
        if self._hidden is None:
            raise InvalidOptionError("OutputFolder.file works only inside its `with` block.")
        relative = Path(name)
        if relative.is_absolute() or ".." in relative.parts or not relative.name:
            raise InvalidOptionError(f"a result file must lie inside its folder, got {name!r}.")
        result = self._hidden / relative
        result.parent.mkdir(parents=True, exist_ok=True)
        return result

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self._move()
                self._made = []
        except OSError as failure:
            if isinstance(failure, FileError):
                raise
            raise FileError(f"Cannot write results to {self.path}: {reason(failure)}.") from None
        finally:
            self._clean()

    def _make(self, folder: Path) -> None:
        """Make a folder and its parents, remembering which ones are new."""
        missing = []
        while not folder.exists():
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            new.mkdir(exist_ok=True)
            self._made.append(new)

    def _move(self) -> None:
        """Rename all files into place; put everything back when one cannot be moved."""
        if self._hidden is None:
            return
        hidden, target = self._hidden, absolute(self.path)
        files = sorted(p for p in hidden.rglob("*") if not p.is_dir() and p != hidden / LOCK)
        files.sort(key=lambda p: p.name == MANIFEST)
        blocked = [p for p in files if (target / p.relative_to(hidden)).is_dir()]
        if blocked:
            raise FileError(
                f"Cannot write results to {self.path}: {blocked[0].name} is a folder there."
            )
        backup = hidden / ".replaced"
        done: list[tuple[Path, Path | None]] = []
        try:
            if (target / MANIFEST).exists():  # a kill between moves leaves none
                backup.mkdir(exist_ok=True)
                (target / MANIFEST).replace(backup / MANIFEST)
            for number, name in enumerate(self._replaced):
                if name != MANIFEST and not (hidden / name).exists() and (target / name).is_file():
                    backup.mkdir(exist_ok=True)
                    done.append((target / name, backup / f"old{number}"))
                    (target / name).replace(backup / f"old{number}")
            for number, source in enumerate(files):
                place = target / source.relative_to(hidden)
                self._make(place.parent)
                old = backup / str(number) if place.exists() else None
                done.append((place, old))
                if old is not None:
                    backup.mkdir(exist_ok=True)
                    place.replace(old)
                source.replace(place)
            self._make(target)
        except BaseException:
            for place, old in reversed(done):
                if old is None:
                    place.unlink(missing_ok=True)
                elif old.exists():
                    old.replace(place)
            if (backup / MANIFEST).exists():
                (backup / MANIFEST).replace(target / MANIFEST)
            raise

    def _clean(self) -> None:
        if self._hidden is not None:
            self._unlock()  # Windows removes no open file
            _remove(self._hidden)
            self._hidden = None
        for folder in reversed(self._made):
            try:
                folder.rmdir()
            except OSError:  # someone else has put something there meanwhile
                break
        self._made = []
